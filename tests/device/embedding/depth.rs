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
