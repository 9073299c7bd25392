//! Ambient occlusion against its f64 twin, and against corners whose occlusion is known.

use super::surface::{SIZES, layered_keys};
use crate::gpu::{CANVAS_POINTS, canvas, nothing, random_keys, views};
use crate::points::Random;
use pointillist::passes::{Switch, ao};
use pointillist::study::oracle;

#[test]
fn ao_leaves_the_light_that_f64_does() {
    let random = &mut Random(0xA0);
    let (mut pixels, mut doubtful, mut darkened, mut bounds) = (0, 0, 0, Vec::new());
    canvas(|canvas| {
        for size in SIZES {
            for view in views(size) {
                for settings in [
                    ao::Settings::default(),
                    ao::Settings {
                        radius: 0.7,
                        directions: 5.0,
                        steps: 3.0,
                        ..ao::Settings::default()
                    },
                    ao::Settings {
                        strength: 1.0,
                        bias: 0.0,
                        steps: 1.0,
                        ..ao::Settings::default()
                    },
                ] {
                    for (layered, keys) in [
                        (false, random_keys(size, CANVAS_POINTS, random)),
                        (true, layered_keys(size, random)),
                    ] {
                        let mut effects = nothing();
                        effects.ao.switch = Switch::On;
                        effects.ao.settings = settings;
                        let surface = canvas.draw(&view, &keys, &effects);
                        for (i, twin) in oracle::ao::left(&view, &settings, &surface.raw.depth)
                            .iter()
                            .enumerate()
                        {
                            let left = surface.left[i];
                            let at = || {
                                format!(
                                    "{:?} {size:?} {settings:?} pixel {i}",
                                    view.camera.projection
                                )
                            };
                            assert!((0.0..=1.0).contains(&left), "{}: {left}", at());
                            pixels += 1;
                            let Some(twin) = twin else {
                                doubtful += 1;
                                continue;
                            };
                            assert!(twin.holds(left), "{}: {left} is not {twin:?}", at());
                            darkened += (left < 1.0) as usize;
                            bounds.extend(layered.then_some(twin.error));
                        }
                    }
                }
            }
        }
    });
    bounds.sort_by(f64::total_cmp);
    let [middle, most] = [0.5, 0.9].map(|share| bounds[(share * bounds.len() as f64) as usize]);
    println!(
        "{darkened} of {pixels} pixels darkened, {doubtful} doubtful, bounds: median {middle:e}, nine in ten {most:e}"
    );
    assert!(darkened > pixels / 10 && doubtful < pixels / 6 && most < 1e-2);
}

/// Shape depiction leaves some light, and ambient occlusion a part of that.
#[test]
fn ao_multiplies_what_other_effects_leave() {
    let random = &mut Random(0xA1);
    canvas(|canvas| {
        let size = [63, 65];
        let (view, keys) = (views(size)[0], layered_keys(size, random));
        let mut effects = nothing();
        effects.shape.switch = Switch::On;
        let shape = canvas.draw(&view, &keys, &effects).left;
        effects.ao.switch = Switch::On;
        let both = canvas.draw(&view, &keys, &effects).left;
        effects.shape.switch = Switch::Off;
        let own = canvas.draw(&view, &keys, &effects).left;
        assert!(own.iter().any(|left| *left < 0.9) && shape.iter().any(|left| *left < 0.9));
        for i in 0..own.len() {
            assert_eq!(both[i].to_bits(), (shape[i] * own[i]).to_bits());
        }
    });
}
