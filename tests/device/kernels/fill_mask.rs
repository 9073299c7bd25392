//! Filling by masks against its twin: every depth, index and colour.

use super::surface::{SIZES, layered_keys};
use crate::gpu::{CANVAS_POINTS, canvas, nothing, random_keys, views};
use crate::points::Random;
use pointillist::config::NO_POINT;
use pointillist::passes::{Switch, fill};
use pointillist::study::oracle;

#[test]
fn masks_fill_what_the_twin_fills() {
    let (filled, replaced) = fill_as_the_twin_does("visibility=off");
    assert!(filled > 5_000 && replaced > 5_000);
}

/// Holes that visibility has found are filled, and pixels that masks take for hidden are replaced.
#[test]
fn known_holes_are_filled_as_the_twin_fills_them() {
    let (filled, replaced) = fill_as_the_twin_does("visibility=on,levels=1,kernel=5");
    assert!(filled > 5_000 && replaced > 500, "{filled}, {replaced}");
}

/// Returns how many filled pixels held no point, and how many held another.
fn fill_as_the_twin_does(visibility: &str) -> (usize, usize) {
    let random = &mut Random(0xD0B);
    let (mut filled, mut replaced) = (0, 0);
    let found = visibility != "visibility=off";
    canvas(|canvas| {
        for size in SIZES {
            let view = views(size)[0];
            for (layer, steps) in [(0.5, 1), (0.5, 3), (0.02, 12), (1e-30, 2), (0.5, 0)] {
                for keys in [random_keys(size, CANVAS_POINTS, random), layered_keys(size, random)] {
                    let mut effects = nothing();
                    effects.set_any(visibility).unwrap();
                    effects.fill.switch = Switch::On;
                    effects.fill.settings = fill::Settings {
                        method: fill::Method::Mask,
                        layer,
                        iterations: steps as f64,
                        ..fill::Settings::default()
                    };
                    let surface = canvas.draw(&view, &keys, &effects);
                    let (raw, got) =
                        (if found { &surface.seen } else { &surface.raw }, &surface.filled);
                    // By default the number of steps is one and a half times the point spacing in
                    // pixels, at most 31.
                    let spacing_px =
                        |z: f32| canvas.spacing() as f32 as f64 * view.focal_px() / z as f64;
                    let reach = |z: f32| {
                        if steps == 0 {
                            (1.5 * spacing_px(z)).ceil().clamp(1.0, 31.0) as u32
                        } else {
                            steps
                        }
                    };
                    let twin = oracle::fill_mask::fill(
                        size,
                        &raw.depth,
                        layer as f32,
                        if steps == 0 { 31 } else { steps },
                        found,
                        reach,
                    );
                    for (i, twin) in twin.iter().enumerate() {
                        let expected = twin
                            .map_or((f32::INFINITY, NO_POINT, [0.0; 4]), |(z, from, _)| {
                                (z, raw.index[from], raw.color[from])
                            });
                        let case =
                            format!("{size:?} layer {layer} steps {steps} pixel {i}, {twin:?}");
                        assert_eq!(
                            (got.depth[i].to_bits(), got.index[i], got.color[i]),
                            (expected.0.to_bits(), expected.1, expected.2),
                            "{case}"
                        );
                        filled += (raw.index[i] == NO_POINT && twin.is_some()) as usize;
                        replaced +=
                            (raw.index[i] != NO_POINT && raw.depth[i] != got.depth[i]) as usize;
                    }
                }
            }
        }
    });
    println!(
        "{visibility}: {filled} pixels of the background filled, {replaced} that were occluded"
    );
    (filled, replaced)
}

/// Each of the 2^8 sets of neighbours with points, around a pixel without one and around one that
/// they may hide. It changes unless five of the others lie side by side.
#[test]
fn every_mask_keeps_what_it_should() {
    const CELL: usize = 5;
    let across = 16 * CELL;
    let ring: [(usize, usize); 8] =
        [(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 2), (0, 2), (0, 1)];
    let place = |mask: usize, (x, y): (usize, usize)| {
        (mask / 16 * CELL + 1 + y) * across + mask % 16 * CELL + 1 + x
    };
    let kept =
        |mask: usize| (0..8).any(|first| (first..first + 5).all(|k| mask >> (k % 8) & 1 == 0));
    let size = [across as u32; 2];
    canvas(|canvas| {
        for occluded in [false, true] {
            let far = if occluded { [7, 9f32.to_bits()] } else { [NO_POINT; 2] };
            let mut keys = vec![far; across * across];
            for mask in 0..256 {
                for (k, &at) in ring.iter().enumerate().filter(|(k, _)| mask >> k & 1 == 1) {
                    keys[place(mask, at)] = [100 + k as u32, (5.0 + 0.1 * k as f32).to_bits()];
                }
            }
            let mut effects = nothing();
            effects.set_any("fill=on,method=mask,layer=1,iterations=1").unwrap();
            // Both kinds of steps run: no occluded pixel here is background.
            let got = canvas.draw(&views(size)[0], &keys, &effects).filled;
            for mask in 0..256usize {
                let middle = place(mask, (1, 1));
                let index = if kept(mask) { far[0] } else { 100 + mask.trailing_zeros() };
                assert_eq!(got.index[middle], index, "occluded {occluded}, {mask:#010b}");
            }
        }
    });
}
