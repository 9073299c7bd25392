//! Phong lighting against its f64 twin.

use crate::gpu::{CANVAS_POINTS, Random, canvas, random_keys};
use crate::surface::{SIZES, layered_keys, nothing, views};
use glam::DVec3;
use pointillist::light::Light;
use pointillist::passes::{Switch, phong};
use pointillist::study::oracle;

#[test]
fn phong_lights_as_f64_does() {
    let random = &mut Random(0x9405);
    let (mut bounds, mut doubtful, mut changed) = (Vec::new(), 0, 0);
    canvas(|canvas| {
        for size in SIZES {
            for view in views(size) {
                let lights = [Light::Headlight, Light::Direction(DVec3::new(1.0, 2.0, -1.5)), Light::Position(DVec3::new(1.0, 3.0, 2.0))];
                for light in lights {
                    for (ambient, shininess, radius) in [(0.2, 24.0, 3.0), (0.0, 1.0, 1.0), (0.5, 255.0, 2.0)] {
                        for (layered, keys) in [(false, random_keys(size, CANVAS_POINTS, random)), (true, layered_keys(size, random))] {
                            let mut effects = nothing();
                            effects.phong.switch = Switch::On;
                            effects.phong.settings =
                                phong::Settings { ambient, shininess, radius, diffuse: 1.0 - ambient, ..phong::Settings::default() };
                            let surface = canvas.draw_in(light, &view, &keys, &effects);
                            let (raw, got) = (&surface.raw, &surface.shaded);
                            assert!(got.depth == raw.depth && got.index == raw.index);
                            let twin = oracle::phong::shade(&view, light, &effects.phong.settings, &raw.depth, &raw.color);
                            for (i, twin) in twin.iter().enumerate() {
                                let color = got.color[i];
                                let case =
                                    || format!("{:?} {size:?} {light} {:?} pixel {i}", view.camera.projection, effects.phong.settings);
                                assert_eq!(color[3], raw.color[i][3]);
                                let holds = |allowed: &[oracle::Bounded; 3]| (0..3).all(|c| allowed[c].holds(color[c]));
                                assert!(twin.iter().any(holds), "{}: {color:?} is not {twin:?}", case());
                                doubtful += (twin.len() > 1) as usize;
                                changed += (color != raw.color[i]) as usize;
                                bounds.extend(layered.then_some(twin[0][1].error));
                            }
                        }
                    }
                }
            }
        }
    });
    bounds.sort_by(f64::total_cmp);
    let [middle, most] = [0.5, 0.9].map(|share| bounds[(share * bounds.len() as f64) as usize]);
    println!("{changed} pixels lit, {doubtful} doubtful, bounds: median {middle:e}, nine in ten {most:e}");
    assert!(changed > bounds.len() / 2 && doubtful < bounds.len() / 100 && most < 1e-3);
}
