//! Visibility, filling and shape against their f64 twins, each from what the kernels before it made.

use crate::gpu::{CANVAS_POINTS, Canvas, Random, Stage, Surface, canvas, orthographic, perspective, random_keys};
use glam::DVec3;
use pointillist::config::NO_POINT;
use pointillist::passes::{Effects, Switch, TILE_PX, fill, shape, tiles, visibility};
use pointillist::study::oracle::fill::{self as fill_oracle, Pixel};
use pointillist::study::oracle::shape as shape_oracle;
use pointillist::study::oracle::visibility::{Depths, Kernel, Verdict};
use pointillist::view::View;

const SIZES: [[u32; 2]; 5] = [[1, 1], [7, 3], [8, 8], [65, 33], [127, 61]];

/// A wide angle, so that rays lean, and ten pixels a metre.
fn views(size: [u32; 2]) -> [View; 2] {
    let height = size[1] as f64 / 10.0;
    [perspective(DVec3::ZERO, DVec3::Y, 75.0), orthographic(DVec3::ZERO, DVec3::Y, height)].map(|camera| View::new(camera, size).unwrap())
}

/// A bumpy surface, another behind it, and gaps.
fn layered_keys(size: [u32; 2], random: &mut Random) -> Vec<[u32; 2]> {
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

/// Beyond 15 the setting numbers the kernels and is no width.
fn asked(width: i64) -> f64 {
    if width <= 15 { width as f64 } else { (2 * ((width - 19) / 4 + 7) + 3) as f64 }
}

/// Every effect switched off.
fn nothing() -> Effects {
    let mut effects = Effects::default();
    for effect in pointillist::passes::EFFECTS {
        effects.set(&format!("{effect}=off")).unwrap();
    }
    effects
}

fn only_visibility(settings: visibility::Settings) -> Effects {
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
    /// Whether a pixel is as the twin has it.
    fn count(&mut self, verdict: Verdict, surface: &Surface, i: usize) -> Result<(), String> {
        let (raw, seen) = (&surface.raw, &surface.seen);
        let same = raw.depth[i] == seen.depth[i] && raw.index[i] == seen.index[i] && raw.color[i] == seen.color[i];
        let taken_out = seen.depth[i] == f32::NEG_INFINITY && seen.index[i] == NO_POINT && seen.color[i] == [0.0; 4];
        self.pixels += 1;
        self.invisible += taken_out as usize;
        self.in_band += (verdict == Verdict::InBand) as usize;
        let agrees = match verdict {
            Verdict::Visible => same,
            Verdict::Invisible => taken_out,
            Verdict::InBand => same || taken_out,
        };
        if agrees { Ok(()) } else { Err(format!("{verdict:?}, but {} became {}", raw.depth[i], seen.depth[i])) }
    }

    fn assert_few_in_band(&self) {
        println!("{self:?}");
        assert!(self.invisible > 0 && self.in_band as f64 <= 1e-4 * self.pixels as f64, "{self:?}");
    }
}

#[test]
fn visibility_decides_as_f64_does_at_every_kernel() {
    let random = &mut Random(0x5EE);
    let mut tally = Tally::default();
    canvas(|canvas| {
        for (n, width) in (3..=15).step_by(2).chain((19..=31).step_by(4)).enumerate() {
            for size in SIZES {
                for view in views(size) {
                    let sectors = [4, 8, 16][n % 3];
                    for keys in [random_keys(size, CANVAS_POINTS, random), layered_keys(size, random)] {
                        let settings = visibility::Settings {
                            kernel: asked(width),
                            sectors: sectors as f64,
                            threshold: random.within(0.5, 5.0),
                            holes: random.within(0.3, 4.0),
                            tiles: visibility::Looked::All,
                            ..visibility::Settings::default()
                        };
                        let surface = canvas.draw(&view, &keys, &only_visibility(settings));
                        let depths = Depths { view: &view, depth: &surface.raw.depth };
                        for i in 0..keys.len() {
                            let at = [i as i64 % size[0] as i64, i as i64 / size[0] as i64];
                            let verdict = depths.verdict(at, Kernel::of_width(width), &settings);
                            tally.count(verdict, &surface, i).unwrap_or_else(|why| {
                                let sum = depths.solid_angle(at, Kernel::of_width(width), sectors);
                                panic!("{:?} {size:?} {width} {settings:?} {at:?}, sum {sum}: {why}", view.camera.projection)
                            });
                        }
                    }
                }
            }
        }
    });
    tally.assert_few_in_band();
}

/// Sectors that other tests do not try, at the default kernel.
#[test]
fn visibility_decides_as_f64_does_with_every_number_of_sectors() {
    let random = &mut Random(0x5EC);
    let mut tally = Tally::default();
    canvas(|canvas| {
        for sectors in [4.0, 8.0, 16.0] {
            for view in views([65, 33]) {
                for keys in [random_keys(view.size, CANVAS_POINTS, random), layered_keys(view.size, random)] {
                    let settings =
                        visibility::Settings { kernel: 9.0, sectors, tiles: visibility::Looked::All, ..visibility::Settings::default() };
                    let surface = canvas.draw(&view, &keys, &only_visibility(settings));
                    let depths = Depths { view: &view, depth: &surface.raw.depth };
                    for i in 0..keys.len() {
                        let verdict = depths.verdict([i as i64 % 65, i as i64 / 65], Kernel::of_width(9), &settings);
                        tally.count(verdict, &surface, i).unwrap_or_else(|why| panic!("{:?} {sectors} {i}: {why}", view.camera.projection));
                    }
                }
            }
        }
    });
    tally.assert_few_in_band();
}

/// Depths that grow across the picture: every automatic kernel is some tile's.
#[test]
fn visibility_chooses_kernels_by_the_spacing_of_the_nearest_points() {
    let random = &mut Random(0xA070);
    let mut tally = Tally::default();
    let mut kernels = std::collections::HashSet::new();
    canvas(|canvas| {
        let size = [127, 61];
        for view in views(size) {
            for round in 0..3 {
                // Perspective: from 40 pixels a spacing's reach to less than 3.
                let settings = visibility::Settings { tiles: visibility::Looked::All, ..visibility::Settings::default() };
                let px = canvas.spacing() * view.focal_px() * settings.reach;
                let keys: Vec<[u32; 2]> = layered_keys(size, random)
                    .into_iter()
                    .enumerate()
                    .map(|(i, [point, bits])| {
                        let wanted = 40.0 - 38.0 * (i % 127) as f64 / 127.0;
                        let z = f32::from_bits(bits) as f64 / 5.0 * px / wanted;
                        // A tile in twenty has no points at all.
                        let empty = (i % 127 / 8 + 16 * (i / 127 / 8) + round) % 20 == 0 || point == NO_POINT;
                        if empty { [NO_POINT; 2] } else { [point, (z as f32).to_bits()] }
                    })
                    .collect();
                let settings = visibility::Settings { reach: settings.reach * [1.0, 0.7, 1.6][round], ..settings };
                let surface = canvas.draw(&view, &keys, &only_visibility(settings));
                let depths = Depths { view: &view, depth: &surface.raw.depth };
                let chosen = depths.kernels(&settings, canvas.spacing());
                for i in 0..keys.len() {
                    let at = [i as i64 % 127, i as i64 / 127];
                    let tile = at[1] / TILE_PX as i64 * tiles(size)[0] as i64 + at[0] / TILE_PX as i64;
                    let Some(kernel) = chosen[tile as usize] else { continue };
                    kernels.insert((kernel.radius, kernel.step));
                    let verdict = depths.verdict(at, kernel, &settings);
                    tally
                        .count(verdict, &surface, i)
                        .unwrap_or_else(|why| panic!("{:?} {round} {at:?} {kernel:?}: {why}", view.camera.projection));
                }
            }
        }
    });
    assert_eq!(kernels.len(), 11, "{kernels:?}");
    tally.assert_few_in_band();
}

/// What filling starts from, or goes on from.
fn pixels(seen: &Stage, filled: &Stage) -> Vec<Pixel> {
    let filling = |i: usize| seen.depth[i] == f32::NEG_INFINITY || (seen.depth[i] == f32::INFINITY && filled.depth[i].is_finite());
    (0..seen.depth.len()).map(|i| Pixel::new(filled.depth[i], filled.color[i], filling(i))).collect()
}

/// Draws so many steps and one more; how many pixels that one may change, and how wide their bounds are.
fn check_step(canvas: &mut Canvas, view: &View, keys: &[[u32; 2]], effects: &Effects, steps: u32) -> (usize, f64) {
    let mut draw = |steps: u32| {
        let mut effects = effects.clone();
        effects.fill.switch = if steps == 0 { Switch::Off } else { Switch::On };
        effects.fill.settings.iterations = steps as f64;
        let surface = canvas.draw(view, keys, &effects);
        let filled = if steps == 0 { surface.seen.clone() } else { surface.filled };
        (surface.seen, filled)
    };
    let ((seen, before), (_, after)) = (draw(steps), draw(steps + 1));
    let settings = &effects.fill.settings;
    let (mut filling, mut widest) = (0, 0f64);
    for (i, next) in fill_oracle::step(view, settings, &pixels(&seen, &before)).iter().enumerate() {
        let (z, color) = (after.depth[i], after.color[i]);
        let case = || format!("{:?} {:?} {settings:?} step {} pixel {i}", view.camera.projection, view.size, steps + 1);
        assert_eq!(after.index[i], seen.index[i], "{}", case());
        match next.filling {
            true => assert!(next.holds(z, color), "{}: {} {:?} is not {next:?}", case(), z, color),
            false => assert_eq!((z.to_bits(), color), (seen.depth[i].to_bits(), seen.color[i]), "{}", case()),
        }
        assert!(!before.depth[i].is_finite() || z.is_finite(), "{}: what was filled is gone", case());
        filling += next.filling as usize;
        widest = widest.max(next.depth.map_or(0.0, |z| z.error / z.value));
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
                for (tolerance, surrounded, holes) in [(0.0, 5.0, 0.7), (0.05, 9.0, 3.0), (1e9, 1.0, 1.6), (1e-300, 3.0, 10.0)] {
                    let keys = if surrounded == 9.0 { random_keys(size, CANVAS_POINTS, random) } else { layered_keys(size, random) };
                    let mut effects = only_visibility(visibility::Settings { kernel: 5.0, holes, ..visibility::Settings::default() });
                    effects.fill.settings = fill::Settings { tolerance, surrounded, ..fill::Settings::default() };
                    for steps in [0, 1, 2, 7] {
                        let (filled, wide) = check_step(canvas, &view, &keys, &effects, steps);
                        filling += filled;
                        widest = widest.max(wide);
                    }
                }
            }
        }
    });
    println!("{filling} pixels filled, bounds at most {widest:e} of the depth");
    assert!(filling > 100_000 && widest < 1e-5);
}

/// One picture to the end: holes as wide as take many steps, so that tiles fall asleep and are woken by their neighbours. Every step is the twin's from the step before, with every tile awake.
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
            let effects = only_visibility(visibility::Settings { kernel: 5.0, holes: 10.0, ..visibility::Settings::default() });
            let filling: Vec<usize> = (0..62).map(|steps| check_step(canvas, &view, &keys, &effects, steps).0).collect();
            println!("{filling:?}");
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
    let mut widest = 0f64;
    canvas(|canvas| {
        for size in SIZES {
            for view in views(size) {
                for (levels, xi, first, softness) in
                    [(1.0, 1.5, 0.0, 1.0), (2.0, 0.0, 0.0, 0.0), (8.0, 1.5, 0.0, 1.0), (8.0, 1.5, 1.0, 0.0), (12.0, 0.5, 0.0, 5.0)]
                {
                    for keys in [random_keys(size, CANVAS_POINTS, random), layered_keys(size, random)] {
                        let settings = shape::Settings { levels, xi, first, softness, ..shape::Settings::default() };
                        let surface = canvas.draw(&view, &keys, &only_shape(settings));
                        let twin = shape_oracle::light(&view, &settings, &surface.raw.depth);
                        for (i, (lit, twin)) in surface.lit.iter().zip(&twin).enumerate() {
                            assert!(
                                twin.holds(*lit),
                                "{:?} {size:?} {settings:?} pixel {i} at {}: {lit} is not {twin:?}",
                                view.camera.projection,
                                surface.raw.depth[i]
                            );
                            widest = widest.max(twin.error);
                        }
                    }
                }
            }
        }
    });
    println!("widest bound {widest:e}");
    assert!(widest < 1e-2);
}
