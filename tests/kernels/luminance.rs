//! Luminance correction against its f64 twin: random points, both spaces, both neighbourhoods, both ways of adding; and a picture in more than one band.

use crate::gpu::{Random, WAYS, Way, bare, bumpy, cloud, draw, orthographic, part, perspective};
use glam::DVec3;
use pointillist::cloud::{Cloud, Lattice};
use pointillist::passes::project::Precision;
use pointillist::passes::{Switch, luminance};
use pointillist::study::oracle::{luminance as oracle, project};
use pointillist::view::{Camera, View};

const LATTICE: Lattice = Lattice { step: DVec3::splat(0.001), offset: DVec3::new(500_000.0, 5_000_000.0, 100.0) };

fn cameras() -> [Camera; 2] {
    let around = |x, y, z| LATTICE.offset + DVec3::new(x, y, z);
    [perspective(around(11.0, -17.0, 9.0), LATTICE.offset, 50.0), orthographic(around(5.0, 6.0, 30.0), around(0.1, 0.2, 0.3), 19.0)]
}

fn scene(points: usize) -> Cloud {
    let (points, colors) = bumpy(points, 20_000, &mut Random(0x1057));
    cloud(vec![part(LATTICE, &points, Some(colors))])
}

/// How many pixels changed, and how many are in doubt.
fn check(cloud: &Cloud, view: &View, settings: luminance::Settings, ways: &[Way]) -> [usize; 3] {
    let mut wishes = bare();
    wishes.precision = Precision::Planes(3);
    let plain = draw(Way::Compute64, cloud, view, &wishes);
    wishes.effects.luminance.switch = Switch::On;
    wishes.effects.luminance.settings = settings;
    let drawn: Vec<_> = ways.iter().map(|&way| draw(way, cloud, view, &wishes)).collect();
    assert!(drawn.iter().all(|layers| layers.bits() == drawn[0].bits()), "the ways of adding differ");
    let got = &drawn[0];
    got.assert_finite();
    assert!(got.depth == plain.depth && got.index == plain.index);
    let part = &cloud.parts[0];
    let source = project::Source::new(part, view, wishes.precision, DVec3::ZERO);
    let colors = part.columns.rgb.as_ref().unwrap();
    let positions = project::positions(part, view.camera.eye);
    let points: Vec<oracle::Point> =
        positions.iter().zip(colors).filter_map(|(v, &rgb)| Some((project::footprint(view, &source, *v)?, rgb))).collect();
    let twin = oracle::colors(view.size, &settings, settings.epsilon as f32, &plain.depth, &plain.color, &points);
    let (mut changed, mut doubtful) = (0, 0);
    for (i, twin) in twin.iter().enumerate() {
        let Some(twin) = twin else {
            doubtful += 1;
            continue;
        };
        let holds = (0..3).all(|c| twin[c].holds(got.color[i][c])) && got.color[i][3] == plain.color[i][3];
        assert!(holds, "{:?} {settings:?} pixel {i}: {:?} became {:?}, not {twin:?}", view.size, plain.color[i], got.color[i]);
        changed += (got.color[i] != plain.color[i]) as usize;
    }
    [twin.len(), changed, doubtful]
}

#[test]
fn luminance_is_the_mean_that_f64_finds() {
    let cloud = scene(60_000);
    let mut total = [0; 3];
    for size in [[1, 1], [7, 3], [65, 33], [127, 61]] {
        for camera in cameras() {
            let view = View::new(camera, size).unwrap();
            for space in [luminance::Space::Hsv, luminance::Space::Rgb] {
                for neighbourhood in [1.0, 3.0] {
                    for epsilon in [1e-3, 0.05, 3.0] {
                        let found = check(&cloud, &view, luminance::Settings { space, neighbourhood, epsilon }, &WAYS);
                        total = [0, 1, 2].map(|k| total[k] + found[k]);
                    }
                }
            }
        }
    }
    println!("pixels, changed, doubtful: {total:?}");
    assert!(total[1] > total[0] / 5 && total[2] < total[0] / 10, "{total:?}");
}

/// Sums of three channels are 24 bytes a pixel: more than one binding of many devices.
#[test]
fn luminance_of_a_large_picture_is_corrected_band_by_band() {
    let cloud = scene(300_000);
    let view = View::new(cameras()[1], [2600, 2200]).unwrap();
    let settings = luminance::Settings { space: luminance::Space::Rgb, neighbourhood: 3.0, epsilon: 0.5 };
    let [_, changed, doubtful] = check(&cloud, &view, settings, &[Way::Compute64]);
    assert!(changed > 10_000 && doubtful < changed, "{changed} changed, {doubtful} doubtful");
}
