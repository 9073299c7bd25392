//! Splats against their f64 twin, and both ways of atomics against each other.

use super::surface::{SIZES, layered_keys};
use crate::gpu::{CANVAS_POINTS, Way, canvas, canvas_on, nothing, random_keys, views};
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
                            let spacing = |i: usize| canvas.splat_spacing(raw.index[i]) as f32;
                            let twin = oracle::splat::splats(&view, &settings, &raw.depth, spacing);
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

/// Pixels show the nearer of the surface's point and the splats of those on none.
#[test]
fn splats_of_scattered_points_stand_before_and_behind_a_surface() {
    let random = &mut Random(0x5CA7);
    canvas(|canvas| {
        let nodes = canvas.scatter().to_vec();
        let settings = Settings::default();
        let mut effects = nothing();
        effects.scattered.switch = Switch::On;
        effects.splat.switch = Switch::On;
        // Pixels of the surface, of splats before it, and of splats alone.
        let (mut shown, mut declined) = ([0; 3], 0);
        for size in SIZES {
            for view in views(size) {
                let keys = random_keys(size, CANVAS_POINTS, random);
                let drawn = canvas.draw(&view, &keys, &effects);
                let (raw, got) = (&drawn.raw, &drawn.splats);
                let is_scattered = |i: usize| oracle::scattered::is_scattered(&nodes, raw.index[i]);
                let of = |scattered: bool| -> Vec<f32> {
                    let is_of = |i: usize| is_scattered(i) == scattered;
                    let depths = raw.depth.iter().enumerate();
                    depths.map(|(i, z)| if is_of(i) { *z } else { f32::INFINITY }).collect()
                };
                let [surface, aside] = [of(false), of(true)];
                let spacing = |i: usize| canvas.splat_spacing(raw.index[i]) as f32;
                let twin = oracle::splat::splats(&view, &settings, &aside, spacing);
                for (i, splat) in twin.into_iter().enumerate() {
                    let case = format!("{size:?} pixel {i}: {splat:?} and {}", surface[i]);
                    let Ok(splat) = splat else {
                        declined += 1;
                        continue;
                    };
                    let before = splat.filter(|splat| {
                        let depth = splat.depth;
                        depth.value - depth.error <= surface[i] as f64 && got.depth[i] != surface[i]
                    });
                    let source = before.map_or(i, |splat| splat.source);
                    if let Some(splat) = before {
                        assert!(splat.depth.holds(got.depth[i]), "{case}");
                        shown[if surface[i].is_finite() { 1 } else { 2 }] += 1;
                    } else {
                        assert_eq!(got.depth[i], surface[i], "{case}");
                        shown[0] += surface[i].is_finite() as usize;
                    }
                    let is_shown = got.depth[i].is_finite();
                    assert_eq!(got.index[i], if is_shown { raw.index[source] } else { NO_POINT });
                    assert_eq!(got.color[i], if is_shown { raw.color[source] } else { [0.0; 4] });
                }
            }
        }
        println!("{shown:?}, {declined} declined");
        assert!(shown.iter().all(|count| *count > 100) && declined * 10 < shown[0], "{shown:?}");
    });
}

/// Rims of discs are part disc and part background, and nothing else is.
#[test]
fn rims_of_splats_are_blended_when_asked() {
    let size = [63, 65];
    canvas(|canvas| {
        let mut keys = vec![[NO_POINT; 2]; (size[0] * size[1]) as usize];
        keys[(32 * size[0] + 31) as usize] = [7, 5f32.to_bits()];
        let mut effects = nothing();
        effects.splat.switch = Switch::On;
        effects.splat.settings = Settings { pixels: 21.0, ..Settings::default() };
        let view = &views(size)[0];
        let hard = canvas.draw(view, &keys, &effects).splats;
        effects.set("antialias=on").unwrap();
        let soft = canvas.draw(view, &keys, &effects).blended;
        let mut blended = 0;
        for (i, (hard, soft)) in hard.color.iter().zip(&soft.color).enumerate() {
            let (x, y) = ((i as u32 % size[0]) as f64 - 31.0, (i as u32 / size[0]) as f64 - 32.0);
            let from_rim = (x.hypot(y) - 10.5).abs();
            assert_eq!(hard[3], if x.hypot(y) <= 10.5 { 1.0 } else { 0.0 });
            assert!(from_rim < 2.0 || hard == soft, "{x} {y}");
            blended += (soft[3] > 0.0 && soft[3] < 1.0) as usize;
        }
        // The circumference has 66 pixels, on both sides.
        assert!((66..=160).contains(&blended), "{blended}");
    });
}
