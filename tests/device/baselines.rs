//! Baselines of filling, fixed-size splats and pull-push, on a plane with holes.

use crate::cameras::{orthographic, perspective};
use crate::gpu::{Layers, Way, cloud, draw, part};
use glam::DVec3;
use pointillist::cloud::{Cloud, Lattice};
use pointillist::render::settings::RenderSettings;
use pointillist::view::{Camera, View};

const SIZE: [u32; 2] = [67, 61];
const LATTICE: Lattice = Lattice { step: DVec3::splat(0.001), offset: DVec3::ZERO };

/// Returns a plane 10 m wide with a point every 10 cm, except for holes of 40 cm.
fn plane() -> Cloud {
    let all = (-50..=50).flat_map(|x| (-50..=50).map(move |y| [x, y]));
    let points: Vec<[i32; 3]> = all
        .filter(|[x, y]: &[i32; 2]| x.rem_euclid(17) >= 4 || y.rem_euclid(13) >= 4)
        .map(|[x, y]| [100 * x, 100 * y, 0])
        .collect();
    let colors = points.iter().map(|_| [200, 100, 50]).collect();
    cloud(vec![part(LATTICE, &points, Some(colors))])
}

/// Returns cameras from above and oblique; a pixel is about 15 cm wide.
fn cameras() -> [Camera; 3] {
    let lean = DVec3::new(3.0, -5.0, 11.0);
    [
        perspective(lean, DVec3::ZERO, 50.0),
        orthographic(lean, DVec3::ZERO, 14.0),
        orthographic(DVec3::new(0.0, -0.001, 9.0), DVec3::ZERO, 14.0),
    ]
}

fn drawn(camera: Camera, effects: &[&str]) -> Layers {
    let view = View::new(camera, SIZE).unwrap();
    let mut settings = RenderSettings::default();
    ["shape=off", "edl=off"]
        .iter()
        .chain(effects)
        .for_each(|effect| settings.effects.set_any(effect).unwrap());
    let layers = draw(Way::Compute64, &plane(), &view, &settings);
    layers.depth.iter().for_each(|z| assert!(*z > 0.0, "{effects:?}: {z}"));
    layers
}

/// Returns the depth of pixels whose centre's ray meets the plane, at least `inset` metres from its
/// rim, or at most -`inset` beyond it.
fn true_depth(camera: Camera, inset: f64) -> Vec<Option<f64>> {
    let view = View::new(camera, SIZE).unwrap();
    let pixel = |i: u32| {
        let (origin, direction) = view.ray((i % SIZE[0]) as f64 + 0.5, (i / SIZE[0]) as f64 + 0.5);
        let t = -origin.z / direction.z;
        let at = origin + direction * t;
        (at.x.abs().max(at.y.abs()) < 5.0 - inset)
            .then(|| (at - view.camera.eye).dot(view.basis.forward))
    };
    (0..SIZE[0] * SIZE[1]).map(pixel).collect()
}

#[test]
fn splats_are_the_nearest_points_of_their_discs() {
    for camera in cameras() {
        let points = drawn(camera, &["visibility=off", "fill=off"]);
        for radius in [0.5, 1.0, 2.0, 4.5] {
            let splats = drawn(
                camera,
                &["visibility=off", &format!("fill=auto,method=splat,radius={radius}")],
            );
            let [width, height] = SIZE.map(|side| side as i32);
            for (i, z) in splats.depth.iter().enumerate() {
                let (x, y) = (i as i32 % width, i as i32 / width);
                let inside = |x: i32, y: i32| x >= 0 && y >= 0 && x < width && y < height;
                let reach = radius as i32;
                let disc = (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy)));
                let near = disc.filter(|&(dx, dy)| {
                    (dx * dx + dy * dy) as f64 <= radius * radius && inside(x + dx, y + dy)
                });
                let nearest = near
                    .map(|(dx, dy)| points.depth[((y + dy) * width + x + dx) as usize])
                    .fold(f32::INFINITY, f32::min);
                assert_eq!(*z, nearest, "{radius} at {x}, {y}");
                assert_eq!(splats.color[i][3], if nearest.is_finite() { 1.0 } else { 0.0 });
            }
        }
        let splats = drawn(camera, &["visibility=off", "fill=auto,method=splat,radius=4"]);
        let holes = |layers: &Layers| {
            true_depth(camera, 0.3)
                .iter()
                .zip(&layers.depth)
                .filter(|(on, z)| on.is_some() && !z.is_finite())
                .count()
        };
        assert!(
            holes(&points) > 20 && holes(&splats) == 0,
            "{} {}",
            holes(&points),
            holes(&splats)
        );
    }
}

#[test]
fn pull_push_fills_what_visibility_asks_for_and_without_it_everything() {
    for camera in cameras() {
        let filled = drawn(
            camera,
            &["visibility=auto,levels=1,kernel=15,holes=0.7", "fill=auto,method=pullpush"],
        );
        let close = |z: f32, truth: f64| (z as f64 - truth).abs() < 0.5;
        for (z, truth) in filled.depth.iter().zip(true_depth(camera, 0.3)) {
            assert!(truth.is_none_or(|truth| close(*z, truth)), "{z} {truth:?}");
        }
        let spilled = true_depth(camera, -0.6)
            .iter()
            .zip(&filled.depth)
            .filter(|(on, z)| on.is_none() && z.is_finite())
            .count();
        assert_eq!(spilled, 0);
        // One colour stays one colour, up to rounding.
        let color = filled.color.iter().find(|color| color[3] == 1.0).unwrap();
        let alike = |other: &[f32; 4]| (0..3).all(|c| (other[c] - color[c]).abs() < 1e-5);
        assert!(filled.color.iter().all(|other| other[3] == 0.0 || alike(other)));
        let flooded = drawn(camera, &["visibility=off", "fill=auto,method=pullpush"]);
        assert!(
            flooded
                .depth
                .iter()
                .zip(&flooded.color)
                .all(|(z, color)| z.is_finite() && alike(color))
        );
    }
}
