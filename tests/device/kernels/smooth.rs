//! Smoothing against its f64 twin.

use super::surface::{SIZES, layered_keys};
use crate::gpu::{CANVAS_POINTS, canvas, nothing, random_keys, views};
use crate::points::Random;
use pointillist::passes::smooth::{self, Pixels};
use pointillist::passes::{Switch, fill};
use pointillist::study::oracle;

#[test]
fn smoothing_takes_the_means_that_f64_does() {
    let random = &mut Random(0x5300);
    let (mut widest, mut stayed) = (0f64, 0);
    canvas(|canvas| {
        for size in SIZES {
            let filters =
                [smooth::Filter::Alleviated, smooth::Filter::Gaussian, smooth::Filter::Box];
            for (filter, pixels) in filters
                .map(|filter| [(filter, Pixels::All), (filter, Pixels::Filled)])
                .into_iter()
                .flatten()
            {
                for (wild, keys) in [
                    (true, random_keys(size, CANVAS_POINTS, random)),
                    (false, layered_keys(size, random)),
                ] {
                    let mut effects = nothing();
                    (effects.fill.switch, effects.fill.settings.method) =
                        (Switch::On, fill::Method::Mask);
                    effects.smooth.switch = Switch::On;
                    effects.smooth.settings = smooth::Settings { filter, iterations: 1.0, pixels };
                    let surface = canvas.draw(&views(size)[0], &keys, &effects);
                    let (from, got) = (&surface.filled, &surface.smoothed);
                    let filled = |i: usize| {
                        pixels == Pixels::All
                            || surface.raw.depth[i].to_bits() != from.depth[i].to_bits()
                    };
                    let filled: Vec<bool> = (0..from.depth.len()).map(filled).collect();
                    for (i, twin) in
                        oracle::smooth::means(size, filter, &filled, &from.depth, &from.color)
                            .iter()
                            .enumerate()
                    {
                        assert_eq!(
                            (got.index[i], got.color[i][3]),
                            (from.index[i], from.color[i][3])
                        );
                        let Some((depth, color)) = twin else {
                            assert_eq!(
                                (got.depth[i].to_bits(), got.color[i]),
                                (from.depth[i].to_bits(), from.color[i])
                            );
                            stayed += from.depth[i].is_finite() as usize;
                            continue;
                        };
                        let case = format!(
                            "{size:?} {filter:?} {pixels:?} pixel {i}: {} {:?}, not {depth:?} {color:?}",
                            got.depth[i], got.color[i]
                        );
                        assert!(
                            depth.holds(got.depth[i])
                                && (0..3).all(|c| color[c].holds(got.color[i][c])),
                            "{case}"
                        );
                        widest = if wild { widest } else { widest.max(depth.error / depth.value) };
                    }
                }
            }
        }
    });
    println!(
        "bounds at most {widest:e} of the depth; {stayed} pixels beside which nothing was filled stay as they are"
    );
    assert!(widest < 1e-5 && stayed > 1000);
}

/// Repeated smoothing does not go beyond the neighbours of filled pixels.
#[test]
fn smoothing_again_and_again_stays_where_something_was_filled() {
    let random = &mut Random(0x5301);
    canvas(|canvas| {
        for size in SIZES {
            let keys = layered_keys(size, random);
            let mut effects = nothing();
            (effects.fill.switch, effects.fill.settings.method) = (Switch::On, fill::Method::Mask);
            effects.smooth.switch = Switch::On;
            effects.smooth.settings = smooth::Settings {
                filter: smooth::Filter::Box,
                iterations: 5.0,
                pixels: Pixels::Filled,
            };
            let surface = canvas.draw(&views(size)[0], &keys, &effects);
            let (from, got) = (&surface.filled, &surface.smoothed);
            let filled: Vec<bool> = (0..from.depth.len())
                .map(|i| surface.raw.depth[i].to_bits() != from.depth[i].to_bits())
                .collect();
            let once =
                oracle::smooth::means(size, smooth::Filter::Box, &filled, &from.depth, &from.color);
            for (i, _) in once.iter().enumerate().filter(|(_, twin)| twin.is_none()) {
                assert_eq!(
                    (got.depth[i].to_bits(), got.color[i]),
                    (from.depth[i].to_bits(), from.color[i]),
                    "{size:?} pixel {i}"
                );
            }
        }
    });
}
