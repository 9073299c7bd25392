//! Pull-push filling against its f64 twin.

use super::surface::{SIZES, only_visibility};
use crate::gpu::{CANVAS_POINTS, canvas, nothing, views};
use crate::points::Random;
use pointillist::config::NO_POINT;
use pointillist::passes::{Switch, fill, visibility};
use pointillist::study::oracle::pullpush::{BAND, fill as twin};

/// Returns keys of a bumpy surface, one pixel of `every`, and of another at its right.
fn sparse_keys(size: [u32; 2], every: u64, random: &mut Random) -> Vec<[u32; 2]> {
    let key = |i: u32| {
        let (x, y) = ((i % size[0]) as f64, (i / size[0]) as f64);
        let far = if x + 0.3 * y > 0.6 * size[0] as f64 { 2.0 } else { 0.0 };
        let depth = 5.0 + far + 0.3 * (x / 9.0).sin() * (y / 7.0).cos() + 0.01 * x;
        match random.bits() % every {
            0 => [(random.bits() % CANVAS_POINTS as u64) as u32, (depth as f32).to_bits()],
            _ => [NO_POINT; 2],
        }
    };
    (0..size[0] * size[1]).map(key).collect()
}

#[test]
fn depths_are_filled_as_in_f64() {
    let random = &mut Random(0xF111);
    let (mut compared, mut unsure, mut worst) = (0, 0, 0f64);
    canvas(|canvas| {
        for size in SIZES.into_iter().chain([[200, 150]]) {
            for view in views(size) {
                for (every, tolerance, holes) in [
                    (2, 0.0, false),
                    (9, 0.0, false),
                    (9, 0.5, false),
                    (60, 0.0, false),
                    (4, 0.0, true),
                ] {
                    let mut effects = match holes {
                        true => only_visibility(visibility::Settings::default()),
                        false => nothing(),
                    };
                    effects.fill.switch = Switch::On;
                    effects.fill.settings = fill::Settings {
                        method: fill::Method::Pullpush,
                        tolerance,
                        ..fill::Settings::default()
                    };
                    let surface = canvas.draw(&view, &sparse_keys(size, every, random), &effects);
                    let before = if holes { &surface.seen } else { &surface.raw };
                    let unknown: Vec<bool> =
                        before.depth.iter().map(|z| *z == f32::NEG_INFINITY).collect();
                    let unknown = holes.then_some(&unknown[..]);
                    let expected = twin(&view, &effects.fill.settings, &before.depth, unknown);
                    for (i, (pixel, &got)) in expected.iter().zip(&surface.filled.depth).enumerate()
                    {
                        let case = format!(
                            "{size:?} {:?} one of {every}, tolerance {tolerance}, pixel {i}: {got}, {pixel:?}",
                            view.camera.projection
                        );
                        compared += 1;
                        if !pixel.sure {
                            unsure += 1;
                            continue;
                        }
                        assert_eq!(pixel.depth.is_some(), got.is_finite(), "{case}");
                        let Some(depth) = pixel.depth else { continue };
                        let off = (got as f64 / depth - 1.0).abs();
                        worst = worst.max(off);
                        assert!(off <= BAND, "{case}: {off:e} off");
                    }
                }
            }
        }
    });
    println!("{compared} pixels, {unsure} unsure, at most {worst:e} off");
    assert!(100 * unsure <= compared, "{unsure} of {compared} pixels are unsure");
}
