//! Depth of the host and of points, and several views.

use super::affine::{EDGE, Slack, by_id, on_screen, pixel_of};
use super::*;

#[test]
fn host_geometry_and_points_hide_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    renderer.open(&[path], &OpenSettings::default()).unwrap();
    let (cleared, view) = (application.targets(), View::new(camera, SIZE).unwrap());
    let (_, alone, depth) = application.settle(&mut renderer, cleared, &[view_of(camera)]);
    // A triangle through the scan, of which the host knows its depth in f64.
    let middle = camera.target;
    let corners = [(-1.2, -1.0, -0.7), (1.3, -0.8, 0.2), (0.1, 1.2, 0.9)].map(|(x, y, z)| {
        let basis = view.basis;
        middle + basis.right * x + basis.up * y + basis.forward * z
    });
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let triangle = |x: usize, y: usize| {
        let (origin, direction) = view.ray(x as f64 + 0.5, y as f64 + 0.5);
        let t = (corners[0] - origin).dot(normal) / direction.dot(normal);
        let hit = origin + direction * t;
        let inside = (0..3).all(|i| {
            let (a, b) = (corners[i], corners[(i + 1) % 3]);
            (b - a).cross(hit - a).dot(normal) >= 0.0
        });
        (inside && t > 0.0).then_some(t)
    };
    let host: Vec<Option<f64>> =
        (0..PIXELS).map(|i| triangle(i % SIZE[0] as usize, i / SIZE[0] as usize)).collect();
    let colors: Vec<[u8; 4]> = host
        .iter()
        .map(|t| if t.is_some() { [200, 10, 20, 255] } else { [1, 2, 3, 255] })
        .collect();
    let depths: Vec<f32> = host.iter().map(|t| t.map_or(0.0, |t| (0.01 / t) as f32)).collect();
    let over = {
        let mut targets = cleared;
        let copied = Access::any(vk::ImageLayout::TRANSFER_DST_OPTIMAL.as_raw());
        targets.color = Target { clear: false, before: copied, ..targets.color };
        targets.depth = targets.depth.map(|depth| Target { clear: false, before: copied, ..depth });
        targets
    };
    let (_, both, both_depth) = application.draw(
        &mut renderer,
        over,
        &[view_of(camera)],
        Some((colors.as_flattened(), &depths)),
    );
    let (mut of_host, mut of_points) = (0, 0);
    for i in 0..PIXELS {
        let (points, triangle) = (depth[i], depths[i]);
        let pixel: [u8; 4] = both[4 * i..][..4].try_into().unwrap();
        if points >= triangle && points > 0.0 {
            assert_eq!(pixel, alone[4 * i..][..4], "points are nearer in pixel {i}");
            of_points += 1;
        } else {
            assert_eq!(pixel, colors[i], "the host is nearer in pixel {i}");
            of_host += host[i].is_some() as u32;
        }
        assert_eq!(both_depth[i], points.max(triangle), "pixel {i}");
    }
    assert!(of_host > 1000 && of_points > 1000, "{of_host} {of_points}");
}

/// A triangle of the host and points, both in f64: away from edges no pixel is wrong. Depth that is
/// not written stays the host's.
#[test]
fn host_geometry_and_points_hide_each_other_as_f64_says() {
    let place = |i: u32| {
        let [u, v] = [(i % 300) as f64 / 150.0 - 1.0, (i / 300) as f64 / 150.0 - 1.0];
        [u, v, 0.4 * (3.0 * u).sin() * (2.0 * v).cos()]
    };
    let places: Vec<[f64; 3]> = (0..90_000).map(place).collect();
    let points = Points::new(Positions::F64(&places));
    let own = by_id(&points);
    let camera = Camera {
        eye: DVec3::new(0.7, -2.8, 2.1),
        target: DVec3::ZERO,
        up: DVec3::Z,
        fov_y: 40.0,
        projection: pointillist::renderer::Projection::Perspective,
        ortho_height: None,
    };
    let matrices = Matrices::of(&camera, SIZE, 0.01, f64::INFINITY).unwrap();
    let slack = Slack::of(&matrices, DEPTH);
    // The triangle, in the middle of each pixel and at its edges.
    let corners =
        [DVec3::new(-0.9, -0.8, -0.6), DVec3::new(1.0, -0.5, 0.1), DVec3::new(0.0, 0.9, 0.7)];
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let view = View::new(camera, SIZE).unwrap();
    let triangle = |x: f64, y: f64| {
        let (origin, direction) = view.ray(x, y);
        let hit = origin + direction * ((corners[0] - origin).dot(normal) / direction.dot(normal));
        let inside = (0..3).all(|i| {
            let (a, b) = (corners[i], corners[(i + 1) % 3]);
            (b - a).cross(hit - a).dot(normal) >= 0.0
        });
        inside.then(|| on_screen(&matrices, hit)[2])
    };
    let host: Vec<Option<f64>> = (0..PIXELS)
        .map(|i| {
            let [x, y] = [i % SIZE[0] as usize, i / SIZE[0] as usize].map(|at| at as f64 + 0.5);
            triangle(x, y)
        })
        .collect();
    let colors: Vec<[u8; 4]> = host
        .iter()
        .map(|depth| if depth.is_some() { [200, 10, 20, 255] } else { [1, 2, 3, 255] })
        .collect();
    let depths: Vec<f32> = host.iter().map(|depth| depth.unwrap_or(0.0) as f32).collect();
    // The two nearest points of each pixel, unless one is at its edge.
    let mut nearest = vec![0.0f64; PIXELS];
    let mut at_edge = vec![false; PIXELS];
    for &point in own.values() {
        let [x, y, depth] = on_screen(&matrices, point);
        match pixel_of([x, y]) {
            Some(pixel) => nearest[pixel] = nearest[pixel].max(depth),
            None => {
                for [dx, dy] in [[-EDGE, -EDGE], [EDGE, -EDGE], [-EDGE, EDGE], [EDGE, EDGE]] {
                    let [x, y] = [x + dx, y + dy];
                    if x >= 0.0 && y >= 0.0 && x < SIZE[0] as f64 && y < SIZE[1] as f64 {
                        at_edge[y as usize * SIZE[0] as usize + x as usize] = true;
                    }
                }
            }
        }
    }
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    renderer.set("style", "points").unwrap();
    renderer.add_points(&points).unwrap();
    let cleared = application.targets();
    let (_, alone, _) = application.settle(&mut renderer, cleared, &[view_of(camera)]);
    let copied = Access::any(vk::ImageLayout::TRANSFER_DST_OPTIMAL.as_raw());
    let mut over = cleared;
    over.color = Target { clear: false, before: copied, ..over.color };
    over.depth = over.depth.map(|depth| Target { clear: false, before: copied, ..depth });
    for writes_depth in [true, false] {
        let over = Targets { writes_depth, ..over };
        let (_, both, both_depth) = application.draw(
            &mut renderer,
            over,
            &[view_of(camera)],
            Some((colors.as_flattened(), &depths)),
        );
        let ids = &application.layers.0;
        let [mut of_host, mut of_points, mut skipped] = [0; 3];
        for i in 0..PIXELS {
            let (point, triangle) = (nearest[i], host[i].unwrap_or(0.0));
            let near = point > 0.0 && (point - triangle).abs() <= slack.around(point);
            if at_edge[i] || near {
                skipped += 1;
                continue;
            }
            let pixel: [u8; 4] = both[4 * i..][..4].try_into().unwrap();
            if point > triangle {
                of_points += 1;
                assert_eq!(pixel, alone[4 * i..][..4], "points are nearer in pixel {i}");
                let [.., depth] = on_screen(&matrices, own[&ids[i][0]]);
                assert!((depth - point).abs() <= slack.around(point), "pixel {i}");
                if writes_depth {
                    let off = (both_depth[i] as f64 - point).abs();
                    assert!(off <= slack.around(point), "pixel {i}: {} {point}", both_depth[i]);
                }
            } else {
                of_host += host[i].is_some() as u32;
                assert_eq!(pixel, colors[i], "the host is nearer in pixel {i}");
                assert_eq!(ids[i], [NO_POINT, 0], "pixel {i}");
                assert_eq!(both_depth[i], depths[i], "pixel {i}");
            }
        }
        assert!(writes_depth || both_depth == depths, "depth is not to be written");
        println!("{of_points} of points, {of_host} of the host, {skipped} at edges");
        assert!(of_host > 3000 && of_points > 10_000 && skipped < PIXELS as u32 / 20);
    }
}

#[test]
fn clouds_hide_each_other_with_and_without_depth_of_the_host() {
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    // Two crossing planes.
    let plane = |slope: f64| -> Vec<[f64; 3]> {
        let place = |i: u32| {
            let [x, y] = [i % 400, i / 400].map(|k| k as f64 / 200.0 - 1.0);
            [x, y, slope * x]
        };
        (0..160_000).map(place).collect()
    };
    let colors = [[250, 20, 20], [20, 20, 250]].map(|color: [u8; 3]| vec![color; 160_000]);
    for (slope, colors) in [0.5, -0.5].into_iter().zip(&colors) {
        let places = plane(slope);
        let points = Points { colors: Some(colors), ..Points::new(Positions::F64(&places)) };
        renderer.add_points(&points).unwrap();
    }
    let mut settings = RenderSettings::points();
    settings.effects.set("fill=on").unwrap();
    renderer.set_settings(settings);
    let camera = Camera {
        eye: DVec3::new(0.0, 0.0, 3.0),
        target: DVec3::ZERO,
        up: DVec3::Y,
        fov_y: 30.0,
        projection: pointillist::renderer::Projection::Perspective,
        ortho_height: None,
    };
    let with = application.targets();
    let without = Targets { depth: None, ..with };
    for targets in [with, without] {
        let (report, color, _) = application.settle(&mut renderer, targets, &[view_of(camera)]);
        assert!(report.points > 0);
        let pixel = |x: usize| &color[4 * (120 * SIZE[0] as usize + x)..][..3];
        // The red plane is higher on the right, the blue one on the left.
        assert!(pixel(230)[0] > 100 && pixel(230)[2] < 50, "{:?}", pixel(230));
        assert!(pixel(90)[2] > 100 && pixel(90)[0] < 50, "{:?}", pixel(90));
    }
}

fn above() -> Camera {
    Camera {
        eye: DVec3::new(0.0, 0.0, 3.0),
        target: DVec3::ZERO,
        up: DVec3::Y,
        fov_y: 30.0,
        projection: pointillist::renderer::Projection::Perspective,
        ortho_height: None,
    }
}

/// Returns a plane across the view, this far above its middle.
fn across(height: f64) -> Vec<[f64; 3]> {
    let place = |i: u32| [i % 250, i / 250].map(|k| k as f64 / 100.0 - 1.25);
    (0..62_500).map(place).map(|[x, y]| [x, y, height]).collect()
}

const RED: [u8; 3] = [250, 20, 20];
const BLUE: [u8; 3] = [20, 20, 250];
const GREEN: [u8; 4] = [10, 200, 20, 255];

/// Returns targets that are drawn over.
fn over(application: &Application) -> Targets {
    let copied = Access::any(vk::ImageLayout::TRANSFER_DST_OPTIMAL.as_raw());
    let kept = |target: Target| Target { clear: false, before: copied, ..target };
    let all = application.targets();
    let (color, depth) = (kept(all.color), all.depth.map(kept));
    Targets { color, depth, copies_depth: true, ..all }
}

/// Returns a host's picture whose left half is a plane through the middle, and its depth.
fn half_plane() -> (Vec<[u8; 4]>, Vec<f32>) {
    let is_left = |i: usize| i % SIZE[0] as usize * 2 < SIZE[0] as usize;
    let pixels = || (0..PIXELS).map(is_left);
    (
        pixels().map(|left| if left { GREEN } else { [0, 0, 0, 255] }).collect(),
        pixels().map(|left| if left { 0.01 / 3.0 } else { 0.0 }).collect(),
    )
}

/// Returns the colours of pixels in the middle of the left and of the right half.
fn halves(color: &[u8]) -> [[u8; 3]; 2] {
    let [width, height] = SIZE.map(|side| side as usize);
    [width / 4, 3 * width / 4].map(|x| {
        let at = 4 * (height / 2 * width + x);
        [color[at], color[at + 1], color[at + 2]]
    })
}

/// A translucent plane before the host's, and one behind: that one shows beside the host's alone.
#[test]
fn geometry_of_the_host_hides_each_layer_of_translucent_points() {
    let formats = [DEPTH, vk::Format::D16_UNORM, vk::Format::D24_UNORM_S8_UINT];
    for format in formats.into_iter().filter(|format| super::affine::can_be_depth(*format)) {
        let mut application = Application::with_depth(COLOR, format);
        let drawn = |application: &mut Application, planes: &[(f64, [u8; 3])], copies_depth| {
            let mut renderer = application.renderer();
            renderer.set("opacity", "0.5").unwrap();
            let places: Vec<_> = planes.iter().flat_map(|(height, _)| across(*height)).collect();
            let colors: Vec<_> = planes
                .iter()
                .flat_map(|(_, color)| vec![*color; places.len() / planes.len()])
                .collect();
            let points = Points { colors: Some(&colors), ..Points::new(Positions::F64(&places)) };
            renderer.add_points(&points).unwrap();
            (application.frame, application.safe) = (0, 0);
            let views = [view_of(above())];
            let cleared = application.targets();
            application.settle(&mut renderer, cleared, &views);
            let (colors, depths) = half_plane();
            let given = Some((colors.as_flattened(), &depths[..]));
            let targets = Targets { copies_depth, ..over(application) };
            // The second frame would be the first one again, were it kept.
            application.draw(&mut renderer, targets, &views, given);
            let (report, color, _) = application.draw(&mut renderer, targets, &views, given);
            (report, halves(&color))
        };
        let (report, both) = drawn(&mut application, &[(0.5, RED), (-0.5, BLUE)], true);
        assert_eq!(report.errors, Vec::<String>::new());
        let (_, [left, _]) = drawn(&mut application, &[(0.5, RED)], true);
        println!("{format:?}: {both:?}, {left:?} without the plane behind");
        let off = both[0].iter().zip(left).map(|(a, b)| a.abs_diff(b)).max();
        assert!(off <= Some(1), "{format:?}: {both:?} {left:?}");
        assert!(both[1][2] > 100 && both[0][1] > 50 && both[0][2] < 60, "{format:?}: {both:?}");
        let (report, _) = drawn(&mut application, &[(0.5, RED), (-0.5, BLUE)], false);
        assert!(report.errors.iter().any(|error| error.contains("copies_depth")));
    }
}

/// The farther cloud is added later. The host's depth is as it was.
#[test]
fn clouds_hide_each_other_though_their_depth_is_not_written() {
    for format in [DEPTH, vk::Format::D16_UNORM, vk::Format::D24_UNORM_S8_UINT] {
        if !super::affine::can_be_depth(format) {
            continue;
        }
        let mut application = Application::with_depth(COLOR, format);
        let mut renderer = application.renderer();
        for (height, color) in [(0.5, RED), (-0.5, BLUE)] {
            let (places, colors) = (across(height), vec![color; 62_500]);
            let points = Points { colors: Some(&colors), ..Points::new(Positions::F64(&places)) };
            renderer.add_points(&points).unwrap();
        }
        let views = [view_of(above())];
        let cleared = application.targets();
        let (_, _, untouched) = {
            let nothing: Vec<FrameView> = Vec::new();
            let (colors, depths) = half_plane();
            let given = Some((colors.as_flattened(), &depths[..]));
            application.draw(&mut renderer, over(&application), &nothing, given)
        };
        application.settle(&mut renderer, cleared, &views);
        let (colors, depths) = half_plane();
        let given = Some((colors.as_flattened(), &depths[..]));
        let targets = Targets { writes_depth: false, ..over(&application) };
        let (report, color, depth) = application.draw(&mut renderer, targets, &views, given);
        assert_eq!(report.errors, Vec::<String>::new());
        let seen = halves(&color);
        assert!(seen.iter().all(|[r, _, b]| *r > 100 && *b < 60), "{format:?}: {seen:?}");
        assert!(depth == untouched, "{format:?}: the host's depth has changed");
        let targets = Targets { copies_depth: false, ..targets };
        let (report, ..) = application.draw(&mut renderer, targets, &views, given);
        assert!(report.errors.iter().any(|error| error.contains("copies_depth")));
    }
}

/// The host's geometry, before a surface in its left half and behind it in the right one: filling
/// and shading stay within the surface.
#[test]
fn surfaces_and_strokes_do_not_bleed_over_the_host() {
    for style in ["surface", "splats", "strokes"] {
        let mut application = Application::new(COLOR);
        let mut renderer = application.renderer();
        renderer.set("style", style).unwrap();
        // Sparse, so that pixels are filled.
        let places: Vec<_> = across(0.5).into_iter().step_by(7).collect();
        let colors = vec![RED; places.len()];
        let points = Points { colors: Some(&colors), ..Points::new(Positions::F64(&places)) };
        renderer.add_points(&points).unwrap();
        let views = [view_of(above())];
        let cleared = application.targets();
        application.settle(&mut renderer, cleared, &views);
        for (height, is_hidden) in [(0.6, true), (0.4, false)] {
            let (mut colors, mut depths) = half_plane();
            let plane = 0.01 / (3.0 - height as f32);
            depths.iter_mut().for_each(|depth| *depth = if *depth > 0.0 { plane } else { 0.0 });
            colors.iter_mut().for_each(|color| *color = GREEN);
            let given = Some((colors.as_flattened(), &depths[..]));
            let targets = over(&application);
            let (_, color, _) = application.draw(&mut renderer, targets, &views, given);
            let wrong = color.chunks(4).enumerate().filter(|(i, pixel)| {
                let is_left = i % SIZE[0] as usize * 2 < SIZE[0] as usize;
                let is_of_host = pixel[..3] == GREEN[..3];
                is_left && is_of_host != is_hidden
            });
            // Splats and strokes leave gaps.
            let gaps = if is_hidden || style == "surface" { 0 } else { PIXELS / 2 / 2 };
            let wrong = wrong.count();
            assert!(wrong <= gaps, "{style}, the host's plane at {height}: {wrong} pixels");
        }
    }
}

#[test]
fn two_views_of_matrices_share_a_target() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    renderer.open(&[path], &OpenSettings::default()).unwrap();
    let half = [SIZE[0] / 2, SIZE[1]];
    let views = [0, 1].map(|side| FrameView {
        camera: ViewCamera::Matrices(Matrices::of(&camera, half, 0.1, f64::INFINITY).unwrap()),
        area: Area { corner: [side * half[0] as i32, 0], size: half },
    });
    let targets = application.targets();
    let (_, color, _) = application.settle(&mut renderer, targets, &views);
    let row = |y: usize, side: usize| {
        &color[4 * (y * SIZE[0] as usize + side * half[0] as usize)..][..4 * half[0] as usize]
    };
    assert!((0..SIZE[1] as usize).all(|y| row(y, 0) == row(y, 1)));
    assert!(row(120, 0).chunks(4).any(|pixel| pixel != &row(0, 0)[..4]));
}
