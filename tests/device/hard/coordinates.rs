//! Where points are: huge nodes, extreme lattices, and coordinates that are not numbers (guide:
//! numerics, case 1, case 30).

use crate::cameras::{orthographic, perspective};
use crate::gpu::{Layers, Way, bare, cloud, draw, part};
use crate::points::Random;
use glam::DVec3;
use pointillist::cloud::{self, Cloud, Lattice, ReadOptions};
use pointillist::config::NO_POINT;
use pointillist::passes::project::Precision;
use pointillist::progress::Silent;
use pointillist::render::settings::RenderSettings;
use pointillist::study::oracle::{points::Points, project};
use pointillist::view::View;

/// Draws with both precisions and compares depths with f64.
fn agrees(cloud: &Cloud, view: &View) -> Layers {
    let draw = |precision| {
        let layers = draw(Way::Compute64, cloud, view, &RenderSettings { precision, ..bare() });
        let sources: Vec<_> = cloud
            .parts
            .iter()
            .map(|part| {
                (
                    project::Source::new(part, view, precision, DVec3::ZERO),
                    project::positions(part, view.camera.eye),
                )
            })
            .collect();
        let agreement = project::check(view, &sources, &layers.depth);
        println!("{precision:?} {agreement:?}");
        assert_eq!(agreement.objection(), None, "{precision:?} {:?}", view.camera);
        layers.assert_finite();
        layers
    };
    draw(Precision::Planes(3));
    draw(Precision::Auto)
}

/// The node is 10 km wide, and the eye is a metre from a wall within it.
#[test]
fn hard_02_camera_in_a_huge_node() {
    let random = &mut Random(2);
    let lattice =
        Lattice { step: DVec3::splat(1e-4), offset: DVec3::new(500_000.0, 5_000_000.0, 0.0) };
    let metres = |random: &mut Random, lo: f64, hi: f64| (random.within(lo, hi) * 1e4) as i32;
    let far = (0..5000)
        .map(|_| {
            [
                metres(random, -5000.0, 5000.0),
                metres(random, -5000.0, 5000.0),
                metres(random, -50.0, 50.0),
            ]
        })
        .collect::<Vec<_>>();
    let wall = (0..55_000).map(|_| {
        [metres(random, 1233.0, 1235.0), metres(random, 2001.0, 2001.01), metres(random, 1.0, 3.0)]
    });
    let points: Vec<_> = far.into_iter().chain(wall).collect();
    let cloud = cloud(vec![part(lattice, &points, None)]);
    let eye = lattice.offset + DVec3::new(1234.0, 2000.0, 2.0);
    let view = View::new(perspective(eye, eye + DVec3::Y, 60.0), [480, 270]).unwrap();
    let layers = agrees(&cloud, &view);
    assert_eq!(layers.nodes.len(), 1);

    // guide: numerics, case 2: 12 u f, beyond the chosen quantisation. A drawn point lies in its
    // pixel, or nearer to it than that.
    let exact = draw(
        Way::Compute64,
        &cloud,
        &view,
        &RenderSettings { precision: Precision::Planes(3), ..bare() },
    );
    let points = Points::new(&cloud.parts, &exact.nodes);
    let f = view.focal_px();
    let beside = |at: f64, pixel: f64| (pixel - at).max(at - (pixel + 1.0)).max(0.0);
    let mut worst = 0f64;
    for (i, &id) in exact.index.iter().enumerate().filter(|(_, id)| **id != NO_POINT) {
        let v = points.relative(id, eye);
        let z = v.dot(view.basis.forward);
        let at = [v.dot(view.basis.right) * f / z + 240.0, -v.dot(view.basis.up) * f / z + 135.0];
        worst = worst.max(beside(at[0], (i % 480) as f64)).max(beside(at[1], (i / 480) as f64));
    }
    println!("worst {worst:e} px of {:e}", 12.0 * 2f64.powi(-24) * f);
    assert!(worst <= 12.0 * 2f64.powi(-24) * f);
}

/// A pixel is a lattice step. Points lie in the middle of pixels, within the picture and beyond
/// each of its edges, before the camera plane, on it and behind it.
#[test]
fn hard_03_at_and_behind_the_camera_plane() {
    let lattice = Lattice { step: DVec3::ONE, offset: DVec3::ZERO };
    let grid: Vec<[i32; 3]> = (-20..20)
        .flat_map(|x| (-20..20).flat_map(move |z| [-7, -1, 0, 5].map(|y| [x, y, z])))
        .collect();
    let cloud = cloud(vec![part(lattice, &grid, None)]);
    let size = [16, 12];
    // The camera looks along +y from between the lattice points: pixel centres are at whole x and
    // z.
    let eye = DVec3::new(0.5, 0.0, 0.5);
    let flat = View::new(orthographic(eye, eye + DVec3::Y, 12.0), size).unwrap();
    let layers = draw(Way::Compute64, &cloud, &flat, &bare());
    assert_eq!(
        layers.depth,
        vec![5.0; 16 * 12],
        "each pixel shows its point at y = 5, none of those at y <= 0"
    );
    let mut ids = layers.index.clone();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), 16 * 12, "no column or row of points from beyond an edge");

    // With perspective, points on the camera plane would be divided by zero, and those behind it
    // mirrored into the picture.
    let deep = View::new(perspective(eye, eye + DVec3::Y, 90.0), size).unwrap();
    let layers = draw(Way::Compute64, &cloud, &deep, &bare());
    assert!(layers.depth.iter().all(|&z| z == 5.0 || z == f32::INFINITY));
    agrees(&cloud, &deep);

    // Nothing is in front.
    let away =
        View::new(perspective(DVec3::new(0.0, 6.0, 0.0), DVec3::new(0.0, 7.0, 0.0), 90.0), size)
            .unwrap();
    assert_eq!(draw(Way::Compute64, &cloud, &away, &bare()).depth, vec![f32::INFINITY; 16 * 12]);
}

fn read(name: &str, text: &str) -> Cloud {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, text).unwrap();
    cloud::read(&[path], &ReadOptions::default(), &Silent).unwrap()
}

#[test]
fn hard_03_coordinates_that_are_no_numbers_are_left_out_and_said() {
    let cloud = read("odd.xyz", "0 0 5\nnan 0 5\n1 inf 5\n1 1 -inf\n1 1 5\n");
    assert_eq!(cloud.len(), 2);
    assert!(
        cloud.notes.iter().any(|note| note.contains("3 points with NaN or infinite")),
        "{:?}",
        cloud.notes
    );
    let view = View::new(orthographic(DVec3::ZERO, DVec3::Z, 4.0), [8, 8]).unwrap();
    agrees(&cloud, &view);
}

/// Depths and pixel positions that an f32 cannot hold may go undrawn, but nothing that is not a
/// number is drawn.
#[test]
fn hard_03_coordinates_beyond_f32_do_not_reach_the_picture() {
    for huge in ["1e38", "3e38", "1e39", "1e100"] {
        let text = format!(
            "0 0 {huge}\n{huge} 0 {huge}\n-{huge} {huge} 0\n0 {huge} {huge}\n1 2 3\n{huge} {huge} 1\n"
        );
        let cloud = read("huge.xyz", &text);
        for camera in [
            perspective(DVec3::ZERO, DVec3::Z, 60.0),
            perspective(DVec3::splat(-1e30), DVec3::ZERO, 60.0),
            orthographic(DVec3::ZERO, DVec3::Z, huge.parse().unwrap()),
        ] {
            let layers =
                draw(Way::Compute64, &cloud, &View::new(camera, [33, 17]).unwrap(), &bare());
            println!(
                "{huge} {:?}: {} pixels",
                camera.projection,
                layers.index.iter().filter(|id| **id != NO_POINT).count()
            );
            layers.assert_finite();
        }
    }
}

/// LAS numbers span the whole range of i32 on every axis: differences reach 2^32 - 1.
#[test]
fn hard_30_las_extremes() {
    let random = &mut Random(30);
    let far = [i32::MIN, i32::MAX];
    let corners = (0..8).map(|c| [far[c & 1], far[c >> 1 & 1], far[c >> 2]]);
    let points: Vec<[i32; 3]> =
        corners.chain((0..50_000).map(|_| [0; 3].map(|_: i32| random.bits() as i32))).collect();
    for (step, offset) in
        [(1e-3, DVec3::new(500_000.0, 5_000_000.0, 0.0)), (1e-7, DVec3::splat(1e6))]
    {
        let cloud = cloud(vec![part(Lattice { step: DVec3::splat(step), offset }, &points, None)]);
        let (min, max) = cloud.bounds().unwrap();
        let (centre, radius) = ((min + max) / 2.0, (max - min).length() / 2.0);
        agrees(
            &cloud,
            &View::new(
                perspective(centre - DVec3::new(1.5, 2.0, -1.0) * radius, centre, 40.0),
                [127, 101],
            )
            .unwrap(),
        );
        agrees(
            &cloud,
            &View::new(perspective(centre, centre + DVec3::new(1.0, 0.3, -0.2), 60.0), [127, 101])
                .unwrap(),
        );
        agrees(
            &cloud,
            &View::new(orthographic(centre + DVec3::Z * radius, centre, radius), [127, 101])
                .unwrap(),
        );
    }
}

/// If |scale| < ulp(|offset|) / 2, offset + scale * X rounds neighbours together in f64. On the
/// lattice each keeps its own pixel.
#[test]
fn hard_30_steps_below_the_ulp_of_the_offset() {
    let offset = (1u64 << 40) as f64;
    let step = 2f64.powi(-20);
    assert_eq!(offset + step, offset);
    let points: Vec<[i32; 3]> =
        (0..64).flat_map(|x| (0..32).map(move |y| [x - 32, y - 16, 0])).collect();
    let lattice = Lattice { step: DVec3::splat(step), offset: DVec3::splat(offset) };
    let cloud = cloud(vec![part(lattice, &points, None)]);
    // An eye can only be where f64 has a number: at the offset. The even size puts it half a pixel
    // beside the points; a pixel is a step.
    let eye = DVec3::splat(offset) + DVec3::Z;
    let view = View::new(orthographic(eye, eye - DVec3::Z, 32.0 * step), [64, 32]).unwrap();
    let layers = draw(Way::Compute64, &cloud, &view, &bare());
    // Points lie exactly on the edges between pixels, and their arithmetic is exact: x = 32 + i
    // falls into pixel 32 + i. Rows run downwards: y = 16 - j is row 32 for j = -16.
    let drawn = layers.index.iter().filter(|id| **id != NO_POINT).count();
    assert_eq!(drawn, 64 * 31, "neighbours share pixels");
    assert!(layers.depth[64..].iter().all(|&z| z == 1.0));
}
