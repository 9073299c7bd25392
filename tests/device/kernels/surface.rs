//! Visibility, filling and shape against their f64 twins, each from what the kernels before it
//! made.

use crate::gpu::{CANVAS_POINTS, Canvas, Stage, Surface, canvas, nothing, random_keys, views};
use crate::points::Random;
use pointillist::config::NO_POINT;
use pointillist::passes::{Effects, Switch, fill, shape, visibility};
use pointillist::study::oracle::fill::{self as fill_oracle, Pixel};
use pointillist::study::oracle::levels;
use pointillist::study::oracle::shape as shape_oracle;
use pointillist::study::oracle::visibility::{Depths, Verdict};
use pointillist::view::View;
use rayon::prelude::*;

pub const SIZES: [[u32; 2]; 5] = [[1, 1], [7, 3], [8, 8], [65, 33], [127, 61]];

/// Returns a bumpy surface, another behind it, and gaps.
pub fn layered_keys(size: [u32; 2], random: &mut Random) -> Vec<[u32; 2]> {
    let key = |i: u32| {
        let (x, y) = ((i % size[0]) as f64, (i / size[0]) as f64);
        let front = 5.0 + 0.3 * (x / 9.0).sin() * (y / 7.0).cos() + random.within(-0.01, 0.01);
        let depth = match random.bits() % 8 {
            0 | 1 => return [NO_POINT; 2],
            2 | 3 => front + 3.0,
            _ => front,
        };
        [(random.bits() % CANVAS_POINTS as u64) as u32, (depth as f32).to_bits()]
    };
    (0..size[0] * size[1]).map(key).collect()
}

pub fn only_visibility(settings: visibility::Settings) -> Effects {
    let mut effects = nothing();
    effects.visibility.switch = Switch::On;
    effects.visibility.settings = settings;
    effects
}

#[derive(Default, Debug)]
struct Tally {
    pixels: usize,
    invisible: usize,
    in_band: usize,
}

impl Tally {
    /// Counts a pixel. Fails if it differs from the twin's.
    fn count(&mut self, verdict: Verdict, surface: &Surface, i: usize) -> Result<(), String> {
        let (raw, seen) = (&surface.raw, &surface.seen);
        let same = raw.depth[i] == seen.depth[i]
            && raw.index[i] == seen.index[i]
            && raw.color[i] == seen.color[i];
        let taken_out = seen.depth[i] == f32::NEG_INFINITY
            && seen.index[i] == NO_POINT
            && seen.color[i] == [0.0; 4];
        self.pixels += 1;
        self.invisible += taken_out as usize;
        self.in_band += (verdict == Verdict::InBand) as usize;
        let agrees = match verdict {
            Verdict::Visible => same,
            Verdict::Invisible => taken_out,
            Verdict::InBand => same || taken_out,
        };
        if agrees {
            Ok(())
        } else {
            Err(format!("{verdict:?}, but {} became {}", raw.depth[i], seen.depth[i]))
        }
    }
}

/// Checks that the kernel of a single level decides as the twin does.
fn check_seen(
    canvas: &mut Canvas,
    view: &View,
    keys: &[[u32; 2]],
    settings: visibility::Settings,
    tally: &mut Tally,
) {
    let surface = canvas.draw(view, keys, &only_visibility(settings));
    let depths = Depths { view, depth: &surface.raw.depth };
    let (width, kernel) =
        (view.size[0] as i64, visibility::Kernel::of_width(settings.kernel as u32));
    let at = |i: usize| [i as i64 % width, i as i64 / width];
    let verdicts: Vec<_> =
        (0..keys.len()).into_par_iter().map(|i| depths.verdict(at(i), kernel, &settings)).collect();
    for (i, &verdict) in verdicts.iter().enumerate() {
        tally.count(verdict, &surface, i).unwrap_or_else(|why| {
            let sum = depths.solid_angle(at(i), kernel, &settings);
            panic!(
                "{:?} {:?} {settings:?} {:?}, sum {sum:?}: {why}",
                view.camera.projection,
                view.size,
                at(i)
            )
        });
    }
}

const ALL: visibility::Looked = visibility::Looked::All;

/// The paper's own single kernel.
#[test]
fn visibility_decides_as_f64_does() {
    let random = &mut Random(0x5EE);
    let mut tally = Tally::default();
    canvas(|canvas| {
        let widths = (3..=15).step_by(2).map(|width| (width, 8));
        for (width, sectors) in widths.chain([(5, 4), (5, 16), (15, 16)]) {
            for (n, size) in SIZES.into_iter().enumerate() {
                for view in views(size) {
                    let wild = (width as usize / 2 + n).is_multiple_of(2);
                    let keys = if wild {
                        random_keys(size, CANVAS_POINTS, random)
                    } else {
                        layered_keys(size, random)
                    };
                    let (threshold, holes) = (random.within(0.5, 5.0), random.within(0.3, 4.0));
                    let lead = random.within(-10.0, 20.0).max(0.0);
                    let (kernel, sectors) = (width as f64, sectors as f64);
                    let settings = visibility::Settings {
                        levels: 1.0,
                        kernel,
                        sectors,
                        threshold,
                        holes,
                        lead,
                        tiles: ALL,
                        ..Default::default()
                    };
                    check_seen(canvas, &view, &keys, settings, &mut tally);
                }
            }
        }
    });
    println!("{tally:?}");
    assert!(
        tally.invisible > tally.pixels / 4 && tally.in_band as f64 <= 1e-4 * tally.pixels as f64,
        "{tally:?}"
    );
}

/// A pyramid, all rounds together. Pixels may depend on others that f64 and f32 decide differently.
#[test]
fn levels_decide_as_f64_does() {
    let random = &mut Random(0x1E7E1);
    let mut tally = Tally::default();
    canvas(|canvas| {
        for (levels, kernel) in [(2.0, 3.0), (3.0, 7.0), (7.0, 7.0), (8.0, 5.0)] {
            for (n, size) in SIZES.into_iter().enumerate() {
                for view in views(size) {
                    let thin = random.bits() % 30 + 1;
                    let keys = if (n + kernel as usize / 2).is_multiple_of(3) {
                        random_keys(size, CANVAS_POINTS, random)
                    } else {
                        layered_keys(size, random)
                    };
                    let keys: Vec<_> =
                        keys.into_iter()
                            .map(|key| {
                                if random.bits().is_multiple_of(thin) { key } else { [NO_POINT; 2] }
                            })
                            .collect();
                    let (threshold, holes, expected) = (
                        random.within(0.5, 5.0),
                        random.within(0.3, 4.0),
                        random.within(2.0, 40.0),
                    );
                    let settings = visibility::Settings {
                        levels,
                        kernel,
                        threshold,
                        holes,
                        expected,
                        sparsest_px: random.within(0.0, 20.0),
                        tiles: ALL,
                        ..Default::default()
                    };
                    canvas.crossed = [0, 1, 2, 3].map(|_| random.bits().is_multiple_of(2));
                    let surface = canvas.draw(&view, &keys, &only_visibility(settings));
                    for (i, verdict) in levels::verdicts(
                        &view,
                        &settings,
                        canvas.spacing() as f32 as f64,
                        canvas.crossed,
                        &surface.raw.depth,
                    )
                    .into_iter()
                    .enumerate()
                    {
                        let at = [i as u32 % size[0], i as u32 / size[0]];
                        tally.count(verdict, &surface, i).unwrap_or_else(|why| {
                            panic!(
                                "{:?} {size:?} {settings:?} {at:?}: {why}",
                                view.camera.projection
                            )
                        });
                    }
                }
            }
        }
    });
    println!("{tally:?}");
    assert!(
        tally.invisible > tally.pixels / 10 && tally.in_band as f64 <= 1e-3 * tally.pixels as f64,
        "{tally:?}"
    );
}

/// Returns a plane at a depth, and another twice as far behind it. Columns of the nearer one,
/// `wide` pixels each, hold in turn three points in four pixels and one in `one_in`.
fn patchy_keys(view: &View, z: f64, wide: u32, one_in: u64, random: &mut Random) -> Vec<[u32; 2]> {
    let width = view.size[0];
    let key = |i: u32| {
        let dense = (i % width / wide).is_multiple_of(2);
        let nearer = if dense {
            !random.bits().is_multiple_of(4)
        } else {
            random.bits().is_multiple_of(one_in)
        };
        let depth = if nearer { z } else { 2.0 * z };
        [(random.bits() % CANVAS_POINTS as u64) as u32, (depth as f32).to_bits()]
    };
    (0..width * view.size[1]).map(key).collect()
}

/// Each part of a surface is judged by its own density, not by that of denser parts beside it.
#[test]
fn sparse_parts_of_a_surface_hide_what_is_behind_them() {
    let random = &mut Random(0xD1A);
    canvas(|canvas| {
        let view = &views([320, 160])[0];
        for (apart_px, wide, one_in, most) in [(2.0, 24, 8, 0.005), (3.0, 80, 20, 0.01)] {
            // The node says that points are `apart_px` apart.
            let z = canvas.spacing() * view.focal_px() / apart_px;
            let keys = patchy_keys(view, z, wide, one_in, random);
            let surface =
                canvas.draw(view, &keys, &only_visibility(visibility::Settings::default()));
            let behind = |depths: &[f32]| {
                depths.iter().filter(|depth| depth.is_finite() && **depth as f64 > 1.5 * z).count()
            };
            let [all, shown] =
                [&surface.raw.depth, &surface.seen.depth].map(|depths| behind(depths));
            println!("one in {one_in}: {shown} of {all} points behind the plane are shown");
            assert!(all > 20_000 && (shown as f64) < most * all as f64, "{shown} of {all}");
        }
    });
}

/// Returns what filling starts from, or continues from.
fn pixels(seen: &Stage, filled: &Stage) -> Vec<Pixel> {
    let filling = |i: usize| {
        seen.depth[i] == f32::NEG_INFINITY
            || (seen.depth[i] == f32::INFINITY && filled.depth[i].is_finite())
    };
    (0..seen.depth.len())
        .map(|i| Pixel::new(filled.depth[i], filled.color[i], filling(i)))
        .collect()
}

/// Returns the layers before filling, and after `steps` steps of it.
fn after_steps(
    canvas: &mut Canvas,
    view: &View,
    keys: &[[u32; 2]],
    effects: &Effects,
    steps: u32,
) -> (Stage, Stage) {
    let mut effects = effects.clone();
    effects.fill.switch = if steps == 0 { Switch::Off } else { Switch::On };
    effects.fill.settings.method = fill::Method::Median;
    effects.fill.settings.iterations = steps as f64;
    let surface = canvas.draw(view, keys, &effects);
    let filled = if steps == 0 { surface.seen.clone() } else { surface.filled };
    (surface.seen, filled)
}

/// Checks one step. Returns how many pixels it may change, and how wide their bounds are.
fn check_step(
    view: &View,
    effects: &Effects,
    seen: &Stage,
    before: &Stage,
    after: &Stage,
    case: &str,
) -> (usize, f64) {
    let (settings, kernel) = (&effects.fill.settings, effects.visibility.settings.kernel as u32);
    let (mut filling, mut widest) = (0, 0f64);
    for (i, next) in
        fill_oracle::step(view, settings, kernel, &pixels(seen, before)).iter().enumerate()
    {
        let (z, color) = (after.depth[i], after.color[i]);
        let case = || {
            format!("{:?} {:?} {settings:?} {case} pixel {i}", view.camera.projection, view.size)
        };
        assert_eq!(after.index[i], seen.index[i], "{}", case());
        match next.filling {
            true => assert!(next.holds(z, color), "{}: {} {:?} is not {next:?}", case(), z, color),
            false => assert_eq!(
                (z.to_bits(), color),
                (seen.depth[i].to_bits(), seen.color[i]),
                "{}",
                case()
            ),
        }
        assert!(
            !before.depth[i].is_finite() || z.is_finite(),
            "{}: what was filled is gone",
            case()
        );
        filling += next.filling as usize;
        widest = next.depths.iter().map(|z| z.error / z.value).fold(widest, f64::max);
    }
    (filling, widest)
}

#[test]
fn filling_takes_every_step_as_f64_does() {
    let random = &mut Random(0xF111);
    let (mut filling, mut widest) = (0, 0f64);
    canvas(|canvas| {
        for size in SIZES {
            for view in views(size) {
                for (tolerance, surrounded, holes) in
                    [(0.0, 5.0, 0.7), (0.05, 9.0, 3.0), (1e9, 1.0, 1.6), (1e-300, 3.0, 10.0)]
                {
                    let keys = if surrounded == 9.0 {
                        random_keys(size, CANVAS_POINTS, random)
                    } else {
                        layered_keys(size, random)
                    };
                    let mut effects = only_visibility(visibility::Settings {
                        levels: 1.0,
                        kernel: 5.0,
                        holes,
                        ..visibility::Settings::default()
                    });
                    effects.fill.settings = fill::Settings {
                        method: fill::Method::Median,
                        tolerance,
                        surrounded,
                        ..fill::Settings::default()
                    };
                    for steps in [0, 1, 6] {
                        let [(seen, before), (_, after)] = [steps, steps + 1]
                            .map(|steps| after_steps(canvas, &view, &keys, &effects, steps));
                        let case = format!("step {}", steps + 1);
                        let (filled, wide) =
                            check_step(&view, &effects, &seen, &before, &after, &case);
                        filling += filled;
                        widest = widest.max(wide);
                    }
                }
            }
        }
    });
    println!("{filling} pixels filled, bounds at most {widest:e} of the depth");
    assert!(filling > 50_000 && widest < 1e-5);
}

/// A picture is filled to the end. Holes take many steps, so that tiles are skipped and wake up
/// through their neighbours. Every step is that of the twin, which skips none.
#[test]
fn filling_sleeps_where_nothing_changes_and_nowhere_else() {
    let random = &mut Random(0x51EE9);
    canvas(|canvas| {
        let size = [65, 33];
        let mut keys = layered_keys(size, random);
        // Rings of points around a hole 40 pixels wide, and a flat patch that settles at once.
        for (i, key) in keys.iter_mut().enumerate() {
            let (x, y) = (i as i64 % 65, i as i64 / 65);
            match x {
                12..=52 if (4..=28).contains(&y) => *key = [NO_POINT; 2],
                53.. => *key = [3, (if (x + y) % 5 == 0 { 9f32 } else { 5f32 }).to_bits()],
                _ => {}
            }
        }
        for view in views(size) {
            // Every pixel without a point is a hole.
            let effects = only_visibility(visibility::Settings {
                levels: 1.0,
                kernel: 5.0,
                holes: 10.0,
                ..visibility::Settings::default()
            });
            let (seen, mut before) = after_steps(canvas, &view, &keys, &effects, 0);
            let mut at_rest = 0;
            for step in 1..=24 {
                let (_, after) = after_steps(canvas, &view, &keys, &effects, step);
                check_step(&view, &effects, &seen, &before, &after, &format!("step {step}"));
                at_rest = if after == before { at_rest + 1 } else { 0 };
                before = after;
            }
            println!("{:?}: nothing has changed for {at_rest} steps", view.camera.projection);
        }
    });
}

/// The light that reaches a surface is filled and smoothed as its colour is. If both begin alike
/// they end alike, bit for bit. Methods that carry points look it up anew.
#[test]
fn what_reaches_a_surface_is_filled_and_smoothed_like_its_colour() {
    let random = &mut Random(0x5ADE);
    canvas(|canvas| {
        for size in SIZES {
            for view in views(size) {
                for method in ["median", "pullpush"] {
                    let mut effects = only_visibility(visibility::Settings {
                        levels: 1.0,
                        kernel: 5.0,
                        ..visibility::Settings::default()
                    });
                    effects.set_any(&format!("fill=on,method={method}")).unwrap();
                    effects.set_any("smooth=on,iterations=2,pixels=all").unwrap();
                    let keys = layered_keys(size, random);
                    canvas.reached = false;
                    let plain = canvas.draw(&view, &keys, &effects);
                    canvas.reached = true;
                    let surface = canvas.draw(&view, &keys, &effects);
                    for (stage, plain) in
                        [(&surface.filled, &plain.filled), (&surface.smoothed, &plain.smoothed)]
                    {
                        assert_eq!(
                            (&stage.depth, &stage.index, &stage.color),
                            (&plain.depth, &plain.index, &plain.color),
                            "{method} {size:?}"
                        );
                        assert!(
                            stage.reached == stage.color,
                            "{method} {size:?} {:?}",
                            view.camera.projection
                        );
                    }
                }
            }
        }
    });
}

fn only_shape(settings: shape::Settings) -> Effects {
    let mut effects = nothing();
    effects.shape.switch = Switch::On;
    effects.shape.settings = settings;
    effects
}

#[test]
fn shape_leaves_the_light_that_f64_does() {
    let random = &mut Random(0x54A9E);
    let mut bounds = Vec::new();
    canvas(|canvas| {
        for size in SIZES {
            for view in views(size) {
                for (levels, xi, first, softness) in [
                    (1.0, 1.5, 0.0, 1.0),
                    (2.0, 0.0, 0.0, 0.0),
                    (8.0, 1.5, 0.0, 1.0),
                    (8.0, 1.5, 1.0, 0.0),
                    (12.0, 0.5, 0.0, 5.0),
                ] {
                    for (layered, keys) in [
                        (false, random_keys(size, CANVAS_POINTS, random)),
                        (true, layered_keys(size, random)),
                    ] {
                        let settings = shape::Settings {
                            levels,
                            xi,
                            first,
                            softness,
                            ..shape::Settings::default()
                        };
                        let surface = canvas.draw(&view, &keys, &only_shape(settings));
                        let twin = shape_oracle::light(&view, &settings, &surface.raw.depth);
                        for (i, (lit, twin)) in surface.lit.iter().zip(&twin).enumerate() {
                            assert!(
                                twin.holds(*lit),
                                "{:?} {size:?} {settings:?} pixel {i} at {}: {lit} is not {twin:?}",
                                view.camera.projection,
                                surface.raw.depth[i]
                            );
                            bounds.extend(layered.then_some(twin.error));
                        }
                    }
                }
            }
        }
    });
    // Only surfaces count: where depths of millimetres and megametres meet, nearly anything is
    // within rounding.
    bounds.sort_by(f64::total_cmp);
    let [middle, most] = [0.5, 0.9].map(|share| bounds[(share * bounds.len() as f64) as usize]);
    println!("{} pixels, bounds: median {middle:e}, nine in ten {most:e}", bounds.len());
    assert!(most < 1e-3);
}

/// Tilted planes lie beside a rough strip. Where whole tiles are planes the kernels omit deeper
/// levels, which changes the light by the last bits of a screen's colour at most. Memory of a frame
/// before shows nowhere, however many levels there are.
#[test]
fn shape_leaves_deeper_levels_out_where_they_change_nothing() {
    let random = &mut Random(0x914E);
    let size = [301, 61];
    canvas(|canvas| {
        for view in views(size) {
            let depth = |i: u32| {
                let (x, y) = ((i % size[0]) as f64, (i / size[0]) as f64);
                // Planes: 1 / z is affine with perspective, z without.
                let affine = 0.2 + 2e-5 * x + 1e-5 * y;
                let z = if view.camera.projection == pointillist::view::Projection::Perspective {
                    1.0 / affine
                } else {
                    25.0 * affine
                };
                [
                    i % CANVAS_POINTS,
                    ((if x < 9.0 { z * random.within(1.0, 1.05) } else { z }) as f32).to_bits(),
                ]
            };
            let keys: Vec<_> = (0..size[0] * size[1]).map(depth).collect();
            for (levels, softness) in [(8.0, 1.0), (8.0, 0.1), (20.0, 1.0), (64.0, 1.0)] {
                let settings = shape::Settings { levels, softness, ..shape::Settings::default() };
                let effects = only_shape(settings);
                let surface = canvas.draw(&view, &keys, &effects);
                for _ in 0..2 {
                    canvas.draw(&view, &random_keys(size, CANVAS_POINTS, random), &effects);
                    let again = canvas.draw(&view, &keys, &effects);
                    let differing = surface
                        .lit
                        .iter()
                        .zip(&again.lit)
                        .filter(|(a, b)| a.to_bits() != b.to_bits())
                        .count();
                    assert_eq!(
                        differing, 0,
                        "{:?} {levels} levels: pixels that show another frame",
                        view.camera.projection
                    );
                }
                if levels > 20.0 {
                    continue;
                }
                let twin = shape_oracle::light(&view, &settings, &surface.raw.depth);
                let off = |i: usize| (surface.lit[i] as f64 - twin[i].value).abs() - twin[i].error;
                // Planes end at the picture's edges. Deeper levels carry that inwards, and the
                // kernels omit them.
                let rim = levels as u32;
                let inside = |i: &usize| {
                    let (x, y) = (*i as u32 % size[0], *i as u32 / size[0]);
                    x >= rim && y >= rim && x + rim < size[0] && y + rim < size[1]
                };
                let worst = |pixels: &mut dyn Iterator<Item = usize>| {
                    pixels.max_by(|&a, &b| off(a).total_cmp(&off(b))).unwrap()
                };
                let (middle, anywhere) =
                    (worst(&mut (0..keys.len()).filter(inside)), worst(&mut (0..keys.len())));
                let at = |i: usize| {
                    format!("{:e} at {:?}", off(i), [i as u32 % size[0], i as u32 / size[0]])
                };
                let case = format!(
                    "{:?} {levels} levels, softness {softness}: off by {} inside, by {} anywhere",
                    view.camera.projection,
                    at(middle),
                    at(anywhere)
                );
                println!("{case}");
                assert!(off(middle) < 1.0 / 256.0 && off(anywhere) < 1.0 / 64.0, "{case}");
            }
        }
    });
}
