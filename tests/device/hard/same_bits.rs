//! Metamorphic oracles (guide: numerics, rule 4): what must not change a single bit.

use crate::cameras::{orthographic, perspective};
use crate::gpu::{Layers, WAYS, Way, cloud, draw, draw_resident, part, upload, with};
use crate::points::{Random, bumpy};
use glam::DVec3;
use pointillist::cloud::{Cloud, Columns, Lattice};
use pointillist::passes::{Effects, Switch};
use pointillist::render::settings::{RenderSettings, Style};
use pointillist::view::light::Light;
use pointillist::view::{Camera, View};

/// Step of lattices, a power of two: coordinates, translations and scalings are exact in f64, and
/// only f32 could go wrong.
const STEP: f64 = 1.0 / 1024.0;
const SIZE: [u32; 2] = [160, 120];

fn settings() -> RenderSettings {
    let mut settings = RenderSettings::default();
    settings.effects.edl.switch = Switch::On;
    settings
}

/// Returns cameras whose eyes are on multiples of 1/8 m, so that moved eyes are exact, too.
fn cameras() -> [Camera; 3] {
    let at = DVec3::new;
    [
        perspective(at(14.0, -22.5, 12.125), at(0.0, 0.0, 0.0), 55.0),
        perspective(at(0.25, 0.125, 0.5), at(4.0, 1.0, 0.0), 75.0),
        orthographic(at(5.0, -6.0, 30.0), at(0.0, 0.5, 0.25), 17.0),
    ]
}

fn scene(scale: f64, offset: DVec3) -> Cloud {
    let (points, colors) = bumpy(60_000, 20_000, &mut Random(0xB175));
    cloud(vec![part(Lattice { step: DVec3::splat(STEP * scale), offset }, &points, Some(colors))])
}

fn moved(camera: Camera, by: DVec3, scale: f64) -> Camera {
    Camera {
        eye: camera.eye * scale + by,
        target: camera.target * scale + by,
        ortho_height: camera.ortho_height.map(|height| height * scale),
        ..camera
    }
}

fn picture(cloud: &Cloud, camera: Camera) -> Layers {
    picture_of(cloud, camera, &settings())
}

fn picture_of(cloud: &Cloud, camera: Camera, settings: &RenderSettings) -> Layers {
    let layers = draw(Way::Compute64, cloud, &View::new(camera, SIZE).unwrap(), settings);
    layers.shows_something();
    layers
}

impl Layers {
    fn shows_something(&self) {
        let covered = self.depth.iter().filter(|z| z.is_finite()).count();
        assert!(covered > 1000, "hardly anything is in the picture");
        self.assert_finite();
    }
}

#[test]
fn hard_01_utm_translation_is_bit_identical() {
    for camera in cameras() {
        let here = picture(&scene(1.0, DVec3::ZERO), camera);
        for utm in [
            DVec3::new(500_000.0, 5_000_000.0, 100.0),
            DVec3::new(-499_999.0 * STEP, 4_999_999.0, 12_345.0 * STEP),
            DVec3::splat(-8e6),
        ] {
            let there = picture(&scene(1.0, utm), moved(camera, utm, 1.0));
            assert!(
                here.bits() == there.bits(),
                "moving cloud and camera by {utm} changes the picture"
            );
        }
    }
}

#[test]
fn hard_01_translation_within_the_lattice_is_bit_identical() {
    // The same place is once in the offset and once in the integers.
    for camera in cameras() {
        let here = picture(&scene(1.0, DVec3::ZERO), camera);
        let steps = [1 << 28, -(1 << 27) + 5, 77];
        let by = DVec3::from_array(steps.map(|s| s as f64 * STEP));
        assert!(here.bits() == picture(&shifted(steps, true), moved(camera, by, 1.0)).bits());
    }
}

/// Returns the scene with all of its points moved by whole steps, in the integers or in the offset.
fn shifted(steps: [i64; 3], within: bool) -> Cloud {
    let mut there = scene(1.0, DVec3::ZERO);
    let part = &mut there.parts[0];
    if !within {
        part.lattice.offset += part.lattice.step * DVec3::from_array(steps.map(|s| s as f64));
        return there;
    }
    let Columns { x, y, z, .. } = &mut part.columns;
    for (column, shift) in [x, y, z].into_iter().zip(steps) {
        column.iter_mut().for_each(|q| *q += i32::try_from(shift).unwrap());
    }
    there
}

/// Shifts by whole steps: within 32 bits in the integers, and by up to 2^40 in the offset.
const SHIFTS: [([i64; 3], bool); 6] = [
    ([1, 0, 0], true),
    ([1 << 28, -(1 << 27) + 5, 77], true),
    ([-(1 << 29) + 1, 3, 1 << 29], true),
    ([512_000_000, 5_120_000_000, 102_400], false),
    ([(1 << 40) + 1, -(1 << 40) + 3, 1 << 39], false),
    ([-(1 << 40), 1 << 40, (1 << 40) - 7], false),
];

/// Checks that pictures are the same wherever cloud, camera and light are together. The cloud is
/// taken to the device once for all settings and cameras.
fn same_under_shifts(all: &[RenderSettings], place: impl Fn(DVec3) -> Light) {
    let strokes = all.iter().any(|settings| settings.effects.strokes.switch == Switch::On);
    let at = |steps: [i64; 3], within: bool| {
        let by = DVec3::from_array(steps.map(|steps| steps as f64 * STEP));
        with(Way::Compute64, |gpu| {
            let resident = upload(gpu, &shifted(steps, within), strokes);
            let mut pictures = Vec::new();
            for settings in all {
                let settings = RenderSettings { light: place(by), ..settings.clone() };
                for camera in cameras() {
                    let view = View::new(moved(camera, by, 1.0), SIZE).unwrap();
                    let layers = draw_resident(gpu, &resident, &view, &settings);
                    layers.shows_something();
                    pictures.push(layers);
                }
            }
            pictures
        })
    };
    let here = at([0; 3], false);
    for (steps, within) in SHIFTS {
        for (there, here) in at(steps, within).iter().zip(&here) {
            assert!(here.bits() == there.bits(), "a shift by {steps:?} ({within}) changes it");
        }
    }
}

#[test]
fn hard_01_strokes_under_shifts_by_whole_steps_are_bit_identical() {
    let blended = ["opaque", "blur", "abuffer"].map(|blend| {
        let mut settings =
            RenderSettings { effects: Effects::of(Style::Strokes), ..Default::default() };
        settings.effects.set_any(&format!("strokes=on,blend={blend}")).unwrap();
        settings
    });
    same_under_shifts(&blended, |_| Light::Headlight);
}

#[test]
fn hard_01_shadows_under_shifts_by_whole_steps_are_bit_identical() {
    let mut settings = settings();
    settings.effects.set_any("shadows=on").unwrap();
    let settings = [settings];
    same_under_shifts(&settings, |_| Light::Direction(DVec3::new(0.3, 0.8, -0.8)));
    same_under_shifts(&settings, |by| Light::Position(by + DVec3::new(3.0, -4.0, 9.5)));
}

#[test]
fn hard_01_scaling_by_powers_of_two_is_bit_identical() {
    for camera in cameras() {
        let here = picture(&scene(1.0, DVec3::ZERO), camera);
        for k in -20..=20 {
            let scale = 2f64.powi(k);
            let mut there = picture(&scene(scale, DVec3::ZERO), moved(camera, DVec3::ZERO, scale));
            // Depth is a length, the one layer that scales. Dividing by a power of two is exact.
            there.depth.iter_mut().for_each(|z| *z /= scale as f32);
            assert!(here.bits() == there.bits(), "scaling by 2^{k} changes more than depths");
        }
    }
}

#[test]
fn hard_00_shuffled_input() {
    let straight = scene(1.0, DVec3::ZERO);
    let mut shuffled = straight.clone();
    let columns = &mut shuffled.parts[0].columns;
    let random = &mut Random(0x5FF1E);
    let colors = columns.rgb.as_mut().unwrap();
    for i in (1..columns.x.len()).rev() {
        let j = (random.bits() % (i as u64 + 1)) as usize;
        [&mut columns.x, &mut columns.y, &mut columns.z]
            .into_iter()
            .for_each(|column| column.swap(i, j));
        colors.swap(i, j);
    }
    assert_ne!(straight.parts[0].columns, shuffled.parts[0].columns);
    for camera in cameras() {
        assert!(picture(&straight, camera).bits() == picture(&shuffled, camera).bits());
    }
}

/// There are few enough points for their duplicates to be in the same node. Another node has
/// another origin, and draws the same point from other integers: equal within the bounds of f32
/// only.
#[test]
fn hard_00_duplicated_points() {
    let mut once = scene(1.0, DVec3::ZERO);
    let columns = &mut once.parts[0].columns;
    [&mut columns.x, &mut columns.y, &mut columns.z]
        .into_iter()
        .for_each(|column| column.truncate(20_000));
    columns.rgb.as_mut().unwrap().truncate(20_000);
    let mut thrice = once.clone();
    let columns = &mut thrice.parts[0].columns;
    for _ in 0..2 {
        [&mut columns.x, &mut columns.y, &mut columns.z]
            .into_iter()
            .for_each(|column| column.extend_from_within(..20_000));
        columns.rgb.as_mut().unwrap().extend_from_within(..20_000);
    }
    // More points per node are denser, and an automatic kernel is narrower.
    let mut settings = settings();
    settings.effects.set_any("visibility=on,levels=1,kernel=9").unwrap();
    for camera in cameras() {
        let [a, b] = [&once, &thrice].map(|cloud| picture_of(cloud, camera, &settings));
        assert_eq!((a.nodes.len(), b.nodes.len()), (1, 1));
        let ((depth, _, color, shaded), (depths, _, colors, shadeds)) = (a.bits(), b.bits());
        assert!(
            depth == depths && color == colors && shaded == shadeds,
            "duplicates change more than ids"
        );
    }
}

#[test]
fn hard_00_two_runs_and_both_ways_give_the_same_bits() {
    let cloud = scene(1.0, DVec3::new(500_000.0, 5_000_000.0, 100.0));
    for camera in cameras() {
        let view = View::new(moved(camera, cloud.parts[0].lattice.offset, 1.0), SIZE).unwrap();
        let first = draw(Way::Compute64, &cloud, &view, &settings());
        for way in WAYS {
            assert!(first.bits() == draw(way, &cloud, &view, &settings()).bits(), "{way:?}");
        }
    }
}
