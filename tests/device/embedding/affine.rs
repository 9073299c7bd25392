//! Clouds whose transform stretches, shears or mirrors them.

use super::*;
use glam::{DMat3, DMat4};
use pointillist::cloud::Cloud;
use pointillist::cloud::attribute::DisplayAttribute;
use pointillist::graph::Gpu;
use std::collections::HashMap;

/// Where points lie.
const MIDDLE: DVec3 = DVec3::new(5e5, 4e6, 120.0);

/// Linear maps that are no similarities; the last one mirrors.
fn maps() -> [DMat3; 3] {
    [
        DMat3::from_diagonal(DVec3::new(1.0, 1.0, 3.0)),
        DMat3::from_cols_array(&[1.3, 0.2, 0.0, -0.4, 0.8, 0.1, 0.0, 0.5, 1.5]),
        DMat3::from_cols_array(&[-0.9, 0.3, 0.2, 0.5, 1.1, 0.0, 0.0, -0.4, 0.7]),
    ]
}

/// Returns a map about the middle of the points, and a translation.
fn about_middle(map: DMat3) -> DMat4 {
    let moved = DVec3::new(10.0, -20.0, 5.0);
    DMat4::from_translation(MIDDLE + moved)
        * DMat4::from_mat3(map)
        * DMat4::from_translation(-MIDDLE)
}

/// Returns points of a bumpy sphere of radius 1, and their normals.
fn sphere(count: u32) -> (Vec<DVec3>, Vec<DVec3>) {
    let direction = |i: u32| {
        let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
        let angle = i as f64 * 2.399963229728653;
        (DVec3::new(angle.cos(), angle.sin(), 0.0) * (1.0 - z * z).sqrt()).with_z(z)
    };
    ((0..count).map(|i| MIDDLE + direction(i)).collect(), (0..count).map(direction).collect())
}

fn colors(count: usize) -> Vec<[u8; 3]> {
    (0..count).map(|i| [(i * 7 % 251) as u8, (i * 31 % 253) as u8, (i % 200) as u8]).collect()
}

fn places(points: &[DVec3]) -> Vec<[f64; 3]> {
    points.iter().map(|point| point.to_array()).collect()
}

/// Returns the positions of points as they are kept, by id.
fn by_id(points: &Points) -> HashMap<u32, DVec3> {
    let mut gpu = Gpu::open(&DeviceOptions::default()).unwrap();
    let cloud = Cloud::of_points(points).unwrap();
    let (shown, _) = DisplayAttribute::automatic(&cloud);
    let resident = Resident::fill(&mut gpu, cloud, shown, &Silent).unwrap();
    let positions = resident.positions(&mut gpu).unwrap();
    let ids =
        resident.nodes.iter().flat_map(|node| (0..node.count).map(|i| node.first_point() + i));
    ids.zip(positions).collect()
}

struct Picture {
    color: Vec<u8>,
    depth: Vec<f32>,
    ids: Vec<u32>,
    normals: Vec<[f32; 4]>,
}

/// Draws a cloud that `add` adds, with these settings.
fn drawn(
    settings: &[(&str, &str)],
    transform: Option<DMat4>,
    camera: Camera,
    add: impl FnOnce(&mut Renderer) -> pointillist::renderer::CloudId,
) -> Picture {
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    settings.iter().for_each(|(name, value)| renderer.set(name, value).unwrap());
    let cloud = add(&mut renderer);
    if let Some(transform) = transform {
        renderer.set_transform(cloud, &transform.to_cols_array()).unwrap();
    }
    let targets = application.targets();
    let (report, color, depth) = application.settle(&mut renderer, targets, &[view_of(camera)]);
    assert!(report.points > 0);
    let (ids, normals) = std::mem::take(&mut application.layers);
    Picture { color, depth, ids: ids.iter().map(|id| id[0]).collect(), normals }
}

/// Returns the share of pixels whose colours differ by more than `by`.
fn differing(a: &Picture, b: &Picture, by: u8) -> f64 {
    let pixels = a.color.chunks(4).zip(b.color.chunks(4));
    let differs = |(a, b): &(&[u8], &[u8])| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > by);
    pixels.filter(differs).count() as f64 / PIXELS as f64
}

fn camera_of(transform: DMat4, points: &[DVec3]) -> Camera {
    let moved: Vec<_> = points.iter().map(|&point| transform.transform_point3(point)).collect();
    Camera::framing(Preset::Fit, &moved, SIZE)
}

/// Every pixel shows the point that is nearest in f64, through all matrices, at its depth.
#[test]
fn points_of_an_affine_transform_lie_where_f64_says() {
    let (points, _) = sphere(30_000);
    let (points, colors) = (places(&points), colors(points.len()));
    let points = Points { colors: Some(&colors), ..Points::new(Positions::F64(&points)) };
    let own = by_id(&points);
    for map in maps() {
        let transform = about_middle(map);
        let camera = camera_of(transform, &own.values().copied().collect::<Vec<_>>());
        let picture = drawn(&[("style", "points")], Some(transform), camera, |renderer| {
            renderer.add_points(&points).unwrap()
        });
        let matrices = Matrices::of(&camera, SIZE, 0.01, f64::INFINITY).unwrap();
        let [view, projection] =
            [matrices.view, matrices.projection].map(|matrix| DMat4::from_cols_array(&matrix));
        let seen = |own: DVec3| {
            let clip = projection * (view * transform.transform_point3(own).extend(1.0));
            let ndc = clip.truncate() / clip.w;
            [(ndc.x + 1.0) / 2.0 * SIZE[0] as f64, (ndc.y + 1.0) / 2.0 * SIZE[1] as f64, ndc.z]
        };
        // Points that rounding brings into a neighbouring pixel count for none.
        const EDGE: f64 = 2e-3;
        let mut nearest = vec![0.0f64; PIXELS];
        for &point in own.values() {
            let [x, y, depth] = seen(point);
            let inside = [x, y].iter().all(|at| (EDGE..1.0 - EDGE).contains(&at.fract()));
            let [x, y] = [x.floor() as usize, y.floor() as usize];
            if inside && x < SIZE[0] as usize && y < SIZE[1] as usize {
                let pixel = &mut nearest[y * SIZE[0] as usize + x];
                *pixel = pixel.max(depth);
            }
        }
        let mut shown = 0;
        for (pixel, (&id, &depth)) in picture.ids.iter().zip(&picture.depth).enumerate() {
            let slack = 1e-5 * depth as f64;
            assert!(depth as f64 >= nearest[pixel] - slack, "{map}: a point is missing in {pixel}");
            if id == NO_POINT {
                continue;
            }
            shown += 1;
            let [x, y, own_depth] = seen(own[&id]);
            let corner = [pixel % SIZE[0] as usize, pixel / SIZE[0] as usize].map(|at| at as f64);
            let off = [x - corner[0] - 0.5, y - corner[1] - 0.5].map(f64::abs);
            assert!(off[0].max(off[1]) <= 0.5 + EDGE, "{map}: pixel {pixel}, {x} {y}");
            assert!((own_depth - depth as f64).abs() <= slack, "{map}: {own_depth} {depth}");
        }
        assert!(shown > 5000, "{shown} pixels");
    }
}

/// Pictures are those of the same points transformed beforehand: same points, same shading.
#[test]
fn an_affine_transform_draws_what_transformed_points_do() {
    // Densely, and with gaps that are filled.
    for (count, most) in [(400_000, 1e-3), (15_000, 1e-3)] {
        draws_what_transformed_points_do(count, most);
    }
}

fn draws_what_transformed_points_do(count: u32, most: f64) {
    let (points, _) = sphere(count);
    let (own, colors) = (places(&points), colors(points.len()));
    let own = Points { colors: Some(&colors), ..Points::new(Positions::F64(&own)) };
    let own_by_id = by_id(&own);
    let turned = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 2.0);
    for map in maps().into_iter().chain([turned]) {
        let transform = about_middle(map);
        let before: Vec<_> = points.iter().map(|&at| transform.transform_point3(at)).collect();
        let camera = Camera::framing(Preset::Fit, &before, SIZE);
        let before = places(&before);
        let before = Points { colors: Some(&colors), ..Points::new(Positions::F64(&before)) };
        let before_by_id = by_id(&before);
        let sun = ("light", "direction:1,2,-2");
        let shaded = [("effect", "phong=on"), ("effect", "shadows=on"), ("effect", "edl=on"), sun];
        let styles = [
            &[("style", "points")][..],
            &[("style", "surface")],
            &[&[("style", "surface")][..], &shaded].concat(),
        ];
        for settings in styles {
            let [moved, baked] =
                [(&own, Some(transform)), (&before, None)].map(|(points, transform)| {
                    drawn(settings, transform, camera, |renderer| {
                        renderer.add_points(points).unwrap()
                    })
                });
            let share = differing(&moved, &baked, 8);
            let same = |(&a, &b): (&u32, &u32)| match [a, b].contains(&NO_POINT) {
                true => a == b,
                false => {
                    let place = transform.transform_point3(own_by_id[&a]);
                    (place - before_by_id[&b]).length() < 1e-6
                }
            };
            let pairs = moved.ids.iter().zip(&baked.ids);
            let others = pairs.filter(|pair| !same(*pair)).count() as f64 / PIXELS as f64;
            println!(
                "{count} {:?} {map}: {share:.5} of colours, {others:.5} of ids differ",
                settings.last()
            );
            assert!(share <= most && others <= most, "{settings:?} {map}: {share} {others}");
        }
    }
}

/// Normals of a file are turned with their surface, also where it is mirrored.
#[test]
fn normals_of_points_follow_an_affine_transform() {
    let folder = tempfile::tempdir().unwrap();
    let (points, normals) = sphere(200_000);
    let file = |name: &str, transform: DMat4| {
        let of_normals = DMat3::from_mat4(transform).inverse().transpose();
        let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", points.len());
        for name in ["x", "y", "z", "nx", "ny", "nz"] {
            text += &format!("property double {name}\n");
        }
        text += "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
        for (&point, &normal) in points.iter().zip(&normals) {
            let (p, n) = (transform.transform_point3(point), (of_normals * normal).normalize());
            text += &format!("{} {} {} {} {} {} 200 150 90\n", p.x, p.y, p.z, n.x, n.y, n.z);
        }
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    for map in maps() {
        let transform = about_middle(map);
        let camera = camera_of(transform, &points);
        let phong = [
            ("style", "surface"),
            ("effect", "phong=on,normals=file,backfaces=drop"),
            ("light", "direction:1,2,-2"),
        ];
        let files = [
            (file("own.ply", DMat4::IDENTITY), Some(transform)),
            (file("before.ply", transform), None),
        ];
        let [moved, baked] = files.map(|(path, transform)| {
            drawn(&phong, transform, camera, |renderer| {
                renderer.open(&[path], &OpenSettings::default()).unwrap()
            })
        });
        let share = differing(&moved, &baked, 6);
        // Against those of the surface itself, of as many pixels.
        let (view, back) = (View::new(camera, SIZE).unwrap(), transform.inverse());
        let off = |picture: &Picture| {
            let seen = picture.normals.iter().zip(&picture.depth).enumerate();
            let mut off: Vec<f64> = seen
                .filter(|(_, (_, depth))| **depth > 0.0)
                .map(|(pixel, (normal, &depth))| {
                    let [x, y] = [pixel % SIZE[0] as usize, pixel / SIZE[0] as usize];
                    let (origin, ray) = view.ray(x as f64 + 0.5, y as f64 + 0.5);
                    let place = origin + ray * 0.01 / depth as f64;
                    let truth = back.transform_point3(place) - MIDDLE;
                    let truth = DMat3::from_mat4(back).transpose() * truth;
                    let [x, y, z, _] = normal.map(f64::from);
                    truth.angle_between(DVec3::new(x, y, z)).to_degrees()
                })
                .collect();
            off.sort_by(f64::total_cmp);
            [off[off.len() / 2], off[off.len() * 99 / 100]]
        };
        let (moved, baked) = (off(&moved), off(&baked));
        println!(
            "{map}: {share:.5} of colours differ; normals off by {moved:.2?}, {baked:.2?} degrees"
        );
        assert!(share < 0.02, "{map}: {share}");
        assert!((0..2).all(|k| moved[k] <= baked[k] + 0.5), "{map}: {moved:?} {baked:?}");
    }
}

/// Returns points a centimetre apart.
fn on_lattice(steps: &[[i32; 3]]) -> Points<'_> {
    let (scale, offset) = ([0.01, 0.01, 0.01], MIDDLE.to_array());
    Points::new(Positions::Steps { steps, scale, offset })
}

/// Picks give the file's own coordinates to the last bit, and clip boxes are in these.
#[test]
fn picks_and_clip_boxes_of_an_affine_transform_are_the_clouds_own() {
    let steps: Vec<[i32; 3]> = (0..160_000).map(|i| [i % 400, i / 400, i % 3]).collect();
    let place =
        |step: [i32; 3]| MIDDLE + DVec3::splat(0.01) * DVec3::from_array(step.map(f64::from));
    for map in maps() {
        let transform = about_middle(map);
        let all: Vec<_> = steps.iter().map(|&step| place(step)).collect();
        let camera = camera_of(transform, &all);
        let (low, high) = (place([50, 120, 0]), place([300, 399, 2]));
        let clip = format!("box:{},{},{},{},{},{}", low.x, low.y, low.z, high.x, high.y, high.z);
        let left: Vec<[i32; 3]> = steps
            .iter()
            .copied()
            .filter(|&step| place(step).cmpge(low).all() && place(step).cmple(high).all())
            .collect();
        assert!(left.len() > 50_000 && left.len() < 100_000);
        let points = ("style", "points");
        let clipped = drawn(&[points, ("clip", &clip)], Some(transform), camera, |renderer| {
            renderer.add_points(&on_lattice(&steps)).unwrap()
        });
        let alone = drawn(&[points], Some(transform), camera, |renderer| {
            renderer.add_points(&on_lattice(&left)).unwrap()
        });
        let covered =
            |picture: &Picture| picture.ids.iter().map(|&id| id != NO_POINT).collect::<Vec<bool>>();
        let (clipped, alone) = (covered(&clipped), covered(&alone));
        let off = clipped.iter().zip(&alone).filter(|(a, b)| a != b).count();
        let all = alone.iter().filter(|covered| **covered).count();
        assert!(off * 1000 <= all && all > 1000, "{off} of {all} pixels");

        let mut application = Application::new(COLOR);
        let mut renderer = application.renderer();
        let cloud = renderer.add_points(&on_lattice(&steps)).unwrap();
        renderer.set_transform(cloud, &transform.to_cols_array()).unwrap();
        let (targets, views) = (application.targets(), [view_of(camera)]);
        application.settle(&mut renderer, targets, &views);
        let pick = renderer.pick(SIZE.map(|side| side / 2));
        application.draw(&mut renderer, targets, &views, None);
        application.draw(&mut renderer, targets, &views, None);
        let Picked::Point(point) = renderer.picked(pick) else { panic!("a point in the middle") };
        assert!(
            point.exact && steps.iter().any(|&step| place(step) == point.position),
            "{point:?}"
        );
        let world = transform.transform_point3(point.position);
        assert!((point.world - world).length() < 1e-8, "{point:?} {world}");
        let [x, y] = View::new(camera, SIZE).unwrap().pixel(world).unwrap();
        assert!((x - 160.5).hypot(y - 120.5) < 2.0, "{x} {y}");

        // Strokes are those of clouds as they are; what is refused changes nothing.
        renderer.set("style", "strokes").unwrap();
        let (report, ..) = application.draw(&mut renderer, targets, &views, None);
        assert!(report.errors[0].contains("drawn as points") && report.points > 0, "{report:?}");
        let flat = DMat4::from_scale(DVec3::new(1.0, 0.0, 1.0)).to_cols_array();
        let refused = renderer.set_transform(cloud, &flat).unwrap_err().to_string();
        assert!(refused.contains("must not flatten"), "{refused}");
    }
}

/// The cut of an index follows where its nodes are drawn: near enough, all points are there.
#[test]
fn an_index_is_cut_where_an_affine_transform_draws_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("torus.las");
    files::scan(&path, pointillist::synth::SceneKind::Torus, 600_000);
    let options = pointillist::cloud::ReadOptions::new(Default::default(), false);
    let cloud = pointillist::cloud::read(std::slice::from_ref(&path), &options, &Silent).unwrap();
    let core = cloud.core_points();
    let index = indexed(&[&path], "");
    let middle = core.iter().sum::<DVec3>() / core.len() as f64;
    for map in maps() {
        let about = DMat4::from_translation(middle);
        let transform = about * DMat4::from_mat3(map) * about.inverse();
        let mut camera = camera_of(transform, &core);
        // Beside the middle, and nearer.
        let at = transform.transform_point3(core[core.len() / 3]);
        camera = Camera { eye: at + (camera.eye - camera.target) * 0.15, target: at, ..camera };
        let points = [("style", "points")];
        let [whole, nodes] = [&path, &index].map(|path| {
            drawn(&points, Some(transform), camera, |renderer| {
                renderer.open(std::slice::from_ref(path), &OpenSettings::default()).unwrap()
            })
        });
        let off =
            whole.depth.iter().zip(&nodes.depth).filter(|(a, b)| (*a - *b).abs() > 1e-4 * **a);
        let (off, all) = (off.count(), whole.depth.iter().filter(|depth| **depth > 0.0).count());
        println!("{map}: {off} of {all} pixels");
        assert!(off * 200 <= all && all > 5000, "{map}: {off} of {all} pixels");
    }
}
