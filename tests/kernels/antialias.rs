//! Anti-aliasing against its f64 twin.

use crate::gpu::{CANVAS_POINTS, Random, canvas, random_keys};
use crate::surface::{SIZES, layered_keys, nothing, views};
use pointillist::study::oracle;

#[test]
fn silhouettes_are_blended_as_f64_does() {
    let random = &mut Random(0xAA);
    let (mut blended, mut stayed, mut doubtful) = (0, 0, 0);
    canvas(|canvas| {
        for size in SIZES {
            for view in views(size) {
                for text in ["", "threshold=high", "laplacian=depth", "laplacian=depth,threshold=high,jump=0.5", "jump=1.9"] {
                    for shape in ["off", "on"] {
                        for keys in [random_keys(size, CANVAS_POINTS, random), layered_keys(size, random)] {
                            let mut effects = nothing();
                            let comma = if text.is_empty() { "" } else { "," };
                            effects.set(&format!("antialias=on{comma}{text}")).unwrap();
                            effects.set(&format!("shape={shape}")).unwrap();
                            let settings = effects.antialias.settings;
                            let surface = canvas.draw(&view, &keys, &effects);
                            let (raw, got) = (&surface.raw, &surface.blended);
                            assert!(got.depth == raw.depth && got.index == raw.index);
                            let lit = if shape == "on" { surface.lit.clone() } else { vec![1.0; keys.len()] };
                            let twin = oracle::antialias::blend(size, &settings, &raw.depth, &raw.color, &lit);
                            for (i, twin) in twin.iter().enumerate() {
                                let (color, left) = (got.color[i], surface.left[i]);
                                let stays = twin.may_stay && color == raw.color[i] && left == lit[i];
                                let holds = |allowed: &[oracle::Bounded; 4]| left == 1.0 && (0..4).all(|c| allowed[c].holds(color[c]));
                                let case = format!("{:?} {size:?} {settings:?} shape {shape} pixel {i}", view.camera.projection);
                                assert!(stays || twin.blended.as_ref().is_some_and(holds), "{case}: {color:?}, {left}");
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
