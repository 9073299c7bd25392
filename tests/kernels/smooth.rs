//! Smoothing against its f64 twin.

use crate::gpu::{CANVAS_POINTS, Random, canvas, random_keys};
use crate::surface::{SIZES, layered_keys, nothing, views};
use pointillist::passes::{Switch, smooth};
use pointillist::study::oracle;

#[test]
fn smoothing_takes_the_means_that_f64_does() {
    let random = &mut Random(0x5300);
    let mut widest = 0f64;
    canvas(|canvas| {
        for size in SIZES {
            for filter in [smooth::Filter::Alleviated, smooth::Filter::Gaussian, smooth::Filter::Box] {
                for (wild, keys) in [(true, random_keys(size, CANVAS_POINTS, random)), (false, layered_keys(size, random))] {
                    let mut effects = nothing();
                    effects.smooth.switch = Switch::On;
                    effects.smooth.settings = smooth::Settings { filter, iterations: 1.0 };
                    let surface = canvas.draw(&views(size)[0], &keys, &effects);
                    let (raw, got) = (&surface.raw, &surface.smoothed);
                    for (i, twin) in oracle::smooth::means(size, filter, &raw.depth, &raw.color).iter().enumerate() {
                        assert_eq!((got.index[i], got.color[i][3]), (raw.index[i], raw.color[i][3]));
                        let Some((depth, color)) = twin else {
                            assert_eq!((got.depth[i].to_bits(), got.color[i]), (raw.depth[i].to_bits(), raw.color[i]));
                            continue;
                        };
                        let case = format!("{size:?} {filter:?} pixel {i}: {} {:?}, not {depth:?} {color:?}", got.depth[i], got.color[i]);
                        assert!(depth.holds(got.depth[i]) && (0..3).all(|c| color[c].holds(got.color[i][c])), "{case}");
                        widest = if wild { widest } else { widest.max(depth.error / depth.value) };
                    }
                }
            }
        }
    });
    println!("bounds at most {widest:e} of the depth");
    assert!(widest < 1e-5);
}
