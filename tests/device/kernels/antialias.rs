//! Anti-aliasing against its f64 twin.

use super::surface::{SIZES, layered_keys};
use crate::gpu::{CANVAS_POINTS, Canvas, canvas, nothing, random_keys, views};
use crate::points::Random;
use pointillist::config::NO_POINT;
use pointillist::study::oracle;

#[test]
fn silhouettes_are_blended_as_f64_does() {
    let random = &mut Random(0xAA);
    let (mut blended, mut stayed, mut doubtful) = (0, 0, 0);
    canvas(|canvas| {
        for size in SIZES {
            for view in views(size) {
                for text in [
                    "",
                    "threshold=high",
                    "laplacian=depth",
                    "laplacian=depth,threshold=high,jump=0.5",
                    "jump=1.9",
                ] {
                    for shape in ["off", "on"] {
                        for keys in
                            [random_keys(size, CANVAS_POINTS, random), layered_keys(size, random)]
                        {
                            let mut effects = nothing();
                            let comma = if text.is_empty() { "" } else { "," };
                            effects.set_any(&format!("antialias=on{comma}{text}")).unwrap();
                            effects.set_any(&format!("shape={shape}")).unwrap();
                            let settings = effects.antialias.settings;
                            let surface = canvas.draw(&view, &keys, &effects);
                            let (raw, got) = (&surface.raw, &surface.blended);
                            assert!(got.depth == raw.depth && got.index == raw.index);
                            let lit = if shape == "on" {
                                surface.lit.clone()
                            } else {
                                vec![1.0; keys.len()]
                            };
                            let twin = oracle::antialias::blend(
                                size, &settings, &raw.depth, &raw.color, &lit,
                            );
                            for (i, twin) in twin.iter().enumerate() {
                                let (color, left) = (
                                    got.color[i],
                                    if shape == "on" { surface.left[i] } else { 1.0 },
                                );
                                let stays =
                                    twin.may_stay && color == raw.color[i] && left == lit[i];
                                let holds = |allowed: &[oracle::Bounded; 4]| {
                                    left == 1.0 && (0..4).all(|c| allowed[c].holds(color[c]))
                                };
                                let case = format!(
                                    "{:?} {size:?} {settings:?} shape {shape} pixel {i}",
                                    view.camera.projection
                                );
                                assert!(
                                    stays || twin.blended.as_ref().is_some_and(holds),
                                    "{case}: {color:?}, {left}"
                                );
                                blended += !stays as usize;
                                stayed += stays as usize;
                                doubtful += (twin.may_stay && twin.blended.is_some()) as usize;
                            }
                        }
                    }
                }
            }
        }
    });
    println!("{blended} pixels blended, {stayed} not, {doubtful} doubtful");
    assert!(blended > 50_000 && stayed > 50_000 && doubtful < stayed / 10_000);
}

/// Tiles without a jump of depth are skipped, and the picture is the same, bit by bit.
#[test]
fn tiles_without_silhouettes_are_skipped_and_the_picture_is_the_same() {
    let random = &mut Random(0x5A);
    // A bumpy surface with a step through its middle, and another end in a corner.
    let size = [203, 131];
    let key = |i: u32| {
        let (x, y) = ((i % size[0]) as f64, (i / size[0]) as f64);
        let depth = if x + y < 20.0 {
            return [NO_POINT; 2];
        } else {
            5.0 + 0.01 * (x / 9.0).sin() + if x > 100.0 + y / 3.0 { 1.0 } else { 0.0 }
        };
        [(random.bits() % CANVAS_POINTS as u64) as u32, (depth as f32).to_bits()]
    };
    let keys: Vec<_> = (0..size[0] * size[1]).map(key).collect();
    canvas(|canvas| {
        for view in views(size) {
            for (text, shape) in [
                ("", "off"),
                ("", "on"),
                ("threshold=high,", "on"),
                ("laplacian=depth,", "off"),
                ("jump=4,", "on"),
            ] {
                let of = |canvas: &mut Canvas, tiles: &str| {
                    let mut effects = nothing();
                    effects.set_any(&format!("antialias=on,{text}tiles={tiles}")).unwrap();
                    effects.set_any(&format!("shape={shape}")).unwrap();
                    canvas.draw(&view, &keys, &effects)
                };
                let (needed, all) = (of(canvas, "needed"), of(canvas, "all"));
                assert!(
                    needed.blended == all.blended
                        && needed.left == all.left
                        && needed.picture == all.picture,
                    "{text} {shape}"
                );
                assert_eq!(
                    needed.blended.color == needed.raw.color,
                    text == "jump=4,",
                    "{text}: something is blended unless nothing jumps so far"
                );
            }
        }
    });
}
