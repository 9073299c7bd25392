//! Splats against their f64 twin, and both ways of atomics against each other.

use super::surface::{SIZES, layered_keys};
use crate::gpu::{CANVAS_POINTS, Way, canvas_on, nothing, random_keys, views};
use crate::points::Random;
use pointillist::config::NO_POINT;
use pointillist::passes::Switch;
use pointillist::passes::splat::{Settings, Shape};
use pointillist::study::oracle;

#[test]
fn splats_are_those_of_f64_and_both_ways_agree() {
    let settings = [
        Settings::default(),
        Settings { shape: Shape::Disc, pixels: 5.0, ..Settings::default() },
        Settings { metres: 0.3, largest: 17.0, ..Settings::default() },
    ];
    let [wide, narrow] = [Way::Compute64, Way::Compute32].map(|way| {
        let random = &mut Random(0x51A7);
        canvas_on(way, |canvas| {
            let (mut decided, mut declined) = (0, 0);
            let mut pictures = Vec::new();
            for size in SIZES {
                for settings in settings {
                    for keys in
                        [random_keys(size, CANVAS_POINTS, random), layered_keys(size, random)]
                    {
                        for view in views(size) {
                            let mut effects = nothing();
                            effects.splat.switch = Switch::On;
                            effects.splat.settings = settings;
                            let drawn = canvas.draw(&view, &keys, &effects);
                            let (raw, got) = (&drawn.raw, &drawn.splats);
                            let spacing = canvas.spacing() as f32;
                            let twin =
                                oracle::splat::splats(&view, &settings, &raw.depth, |_| spacing);
                            for (i, expected) in twin.into_iter().enumerate() {
                                let case = format!("{size:?} {settings:?} pixel {i}");
                                match expected {
                                    Err(()) => declined += 1,
                                    Ok(None) => {
                                        decided += 1;
                                        assert_eq!(got.index[i], NO_POINT, "{case}");
                                        assert!(got.depth[i] == f32::INFINITY, "{case}");
                                    }
                                    Ok(Some(splat)) => {
                                        decided += 1;
                                        assert!(
                                            splat.depth.holds(got.depth[i]),
                                            "{case}: {} {splat:?}",
                                            got.depth[i]
                                        );
                                        assert_eq!(got.index[i], raw.index[splat.source], "{case}");
                                        assert_eq!(got.color[i], raw.color[splat.source], "{case}");
                                    }
                                }
                            }
                            pictures.push(got.clone());
                        }
                    }
                }
            }
            println!("{decided} pixels decided, {declined} declined");
            assert!(declined * 10 < decided, "{declined} of {decided}");
            pictures
        })
    });
    assert!(wide == narrow);
}
