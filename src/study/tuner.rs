//! Measures the tunings of a device: their errors against the finest one, and their times.
//!
//! ```text
//!     the default, and each other value of each knob -> combinations that no other is expected
//!     to beat -> their front, timed again in turn
//! ```
//!
//! What each value adds to the default's error and time is added up, so that all combinations are
//! known from as many pictures as there are values. (A divisor of the resolution multiplies times.)
//! Combinations that no other beats follow from those of fewer knobs, one knob after the other.
//!
//! Other programs slow a device down for a while. Times are therefore taken as parts of the
//! default's, which is drawn again after every few pictures, and made milliseconds by the median of
//! all of its times.

use super::chart::{Chart, Mark, Panel};
use super::report::{self, Table};
use super::{lod, metrics, scan::Scan, sweep};
use crate::cloud::attribute::Attribute;
use crate::error::Result;
use crate::graph::{Gpu, Graph};
use crate::passes::encode;
use crate::progress::Progress;
use crate::render::frame;
use crate::render::gpu_cloud::GpuCloud;
use crate::render::index_samples;
use crate::render::settings::{FrameConfig, RenderSettings};
use crate::render::source::Source;
use crate::select::lod::LodOptions;
use crate::synth::SceneKind;
use crate::tune::error::{Errors, Pixels};
use crate::tune::governor::divided;
use crate::tune::knobs::Knob;
use crate::tune::{Front, KNOBS, Load, Tuned, Tuning, split};
use crate::view::{Camera, View};
use glam::DVec3;

/// How long and how thoroughly tunings are measured.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Rounds that the times of single values are medians of.
    pub singles: usize,
    /// Rounds that the times of the front are medians of.
    pub rounds: usize,
    /// Most tunings of a front.
    pub most: usize,
    /// Points of each simulated scene.
    pub points: u64,
    /// Size of the pictures `[px]`.
    pub size: [u32; 2],
    /// Simulated scenes with their views, of few points a pixel and of many.
    pub scenes: &'static [(&'static str, SceneKind, &'static [&'static str])],
}

impl Effort {
    /// Returns the effort on a device: a GPU draws larger pictures of more points, since small ones
    /// take it no time.
    pub fn on(self, is_cpu: bool) -> Effort {
        if is_cpu {
            return self;
        }
        Effort { points: 4 * self.points, size: self.size.map(|side| side * 5 / 2), ..self }
    }

    pub const FULL: Effort = Effort {
        singles: 2,
        rounds: 5,
        most: 20,
        points: 1_000_000,
        size: [512, 288],
        scenes: &[
            ("street", SceneKind::Street, &["far", "near", "close-up"]),
            ("terrain", SceneKind::Terrain, &["near", "close-up"]),
        ],
    };
    pub const QUICK: Effort = Effort {
        singles: 1,
        rounds: 2,
        most: 12,
        points: 300_000,
        size: [256, 144],
        scenes: &[
            ("street", SceneKind::Street, &["near", "close-up"]),
            ("terrain", SceneKind::Terrain, &["close-up"]),
        ],
    };
}

/// A share of the time or the error by which a tuning must be better than the next one.
const WORTH: f64 = 0.02;

/// Least part of the default's time that is left if the savings of values are added up.
const LEAST: f64 = 0.1;

/// Pictures between two of the default.
const REFERENCE_EVERY: usize = 4;

/// A combination with what is expected of it.
#[derive(Clone, Copy, Debug)]
struct Expected {
    tuning: Tuning,
    /// Time of a picture `[ms]`.
    ms: f64,
    /// Mean error `[px]`.
    px: f64,
}

/// Returns some combinations, evenly by the logarithm of their times.
fn spread(expected: &[Expected], most: usize) -> Vec<Tuning> {
    let log = |own: &Expected| own.ms.ln();
    let (Some(first), Some(last)) = (expected.first(), expected.last()) else { return Vec::new() };
    let place = |k: usize| log(first) + (log(last) - log(first)) * k as f64 / most.max(2) as f64;
    let nearest = |k: usize| {
        let off = |own: &&Expected| (log(own) - place(k)).abs();
        expected.iter().min_by(|a, b| off(a).total_cmp(&off(b))).map(|own| own.tuning)
    };
    (0..=most).filter_map(nearest).collect()
}

/// A cloud with the views that it is drawn in.
pub struct Subject {
    pub name: String,
    pub cloud: GpuCloud,
    pub views: Vec<View>,
}

/// A tuning in a view.
#[derive(Clone, Debug)]
pub struct InView {
    pub errors: Errors,
    /// Errors against the default's picture, which a window settles on.
    pub moving: Errors,
    pub load: Load,
    /// Times of points and of pixels, by rounds, in parts of the default's.
    pub parts: Vec<[f64; 2]>,
    /// Least time of a picture `[ms]`: of few pictures it tells more than their median.
    least: f64,
}

/// A tuning with all that was measured of it.
#[derive(Clone, Debug)]
pub struct Measured {
    pub tuning: Tuning,
    pub views: Vec<InView>,
}

/// What is drawn, and what has been measured.
pub struct Tuner<'t> {
    gpu: &'t mut Gpu,
    subjects: Vec<Subject>,
    settings: RenderSettings,
    cut: LodOptions,
    references: Vec<Pixels>,
    /// Pictures of the default.
    settled: Vec<Pixels>,
    /// Times of the default, by views `[ms]`.
    usual_ms: Vec<Vec<f64>>,
    pub found: Vec<Measured>,
}

/// Returns the simulated scenes that a device is tuned with if there is no cloud.
pub fn scenes(
    gpu: &mut Gpu,
    effort: &Effort,
    seed: u64,
    progress: &dyn Progress,
) -> Result<Vec<Subject>> {
    effort
        .scenes
        .iter()
        .map(|&(name, kind, views)| {
            let scan = Scan::new(kind, |world| world.step, effort.points, seed, progress)?;
            let cameras = lod::cameras(&scan.world).into_iter();
            let views = cameras.filter(|(name, _)| views.contains(name));
            let views = views.map(|(_, camera)| View::new(camera, effort.size));
            Ok(Subject {
                name: name.into(),
                cloud: of_scan(gpu, &scan, progress)?,
                views: views.collect::<Result<_>>()?,
            })
        })
        .collect()
}

/// Returns three views: the camera's, from half as far, and from another side.
pub fn views(camera: Camera, up: DVec3, size: [u32; 2]) -> Result<Vec<View>> {
    let nearer = Camera { eye: camera.target + (camera.eye - camera.target) / 2.0, ..camera };
    let turned = camera.turned(up, camera.target, 2.0);
    [camera, nearer, turned].into_iter().map(|camera| View::new(camera, size)).collect()
}

/// Opens the index of a scan, whose file may be removed then.
pub(super) fn of_scan(gpu: &mut Gpu, scan: &Scan, progress: &dyn Progress) -> Result<GpuCloud> {
    let shown = index_samples::shown(&scan.index, Attribute::Rgb);
    Source::Index(scan.index.clone()).upload(gpu, shown, u64::MAX, progress)
}

impl<'t> Tuner<'t> {
    /// Draws the finest pictures, which errors are measured against.
    pub fn new(
        gpu: &'t mut Gpu,
        subjects: Vec<Subject>,
        settings: RenderSettings,
        cut: LodOptions,
        progress: &dyn Progress,
    ) -> Result<Tuner<'t>> {
        let [references, settled] = [Vec::new(), Vec::new()];
        let (usual_ms, found) = (Vec::new(), Vec::new());
        let mut tuner =
            Tuner { gpu, subjects, settings, cut, references, settled, usual_ms, found };
        for view in 0..tuner.views() {
            let drawn = tuner.draw(view, &Tuning::finest(), true, progress)?;
            tuner.references.push(drawn.pixels);
            // The first one also takes memory into use.
            let drawn = tuner.draw(view, &Tuning::usual(), true, progress)?;
            tuner.settled.push(drawn.pixels);
            tuner.usual_ms.push(Vec::new());
            tuner.time_usual(view, progress)?;
        }
        Ok(tuner)
    }

    fn views(&self) -> usize {
        self.subjects.iter().map(|subject| subject.views.len()).sum()
    }

    /// Measures tunings in all views, in turn; times are added to those known.
    pub fn measure(
        &mut self,
        tunings: &[Tuning],
        rounds: usize,
        progress: &dyn Progress,
    ) -> Result<()> {
        for view in 0..self.views() {
            let known: Vec<bool> = tunings.iter().map(|own| self.in_view(own, view)).collect();
            let mut first: Vec<Option<InView>> = vec![None; tunings.len()];
            let numbers: Vec<usize> = (0..tunings.len()).collect();
            let (mut usual, mut since) = (1.0, REFERENCE_EVERY);
            let times = sweep::interleaved(&numbers, rounds, |&number| {
                if since == REFERENCE_EVERY {
                    (usual, since) = (self.time_usual(view, progress)?, 0);
                }
                since += 1;
                progress.tick("tuning", self.found.len() as u64, 0)?;
                let layers = !known[number] && first[number].is_none();
                let drawn = self.draw(view, &tunings[number], layers, progress)?;
                let parts = drawn.ms.map(|ms| ms / usual);
                let least = drawn.ms.iter().sum();
                if layers {
                    let [errors, moving] = [&self.references[view], &self.settled[view]]
                        .map(|reference| drawn.pixels.errors(reference));
                    let (load, parts) = (drawn.load, Vec::new());
                    first[number] = Some(InView { errors, moving, load, parts, least });
                } else if let Some(first) = &mut first[number] {
                    first.least = first.least.min(least);
                }
                Ok(parts)
            })?;
            for ((tuning, first), parts) in tunings.iter().zip(first).zip(times) {
                let place = self.found.iter().position(|found| found.tuning == *tuning);
                let place = place.unwrap_or_else(|| {
                    self.found.push(Measured { tuning: *tuning, views: Vec::new() });
                    self.found.len() - 1
                });
                let views = &mut self.found[place].views;
                views.extend(first);
                views[view].parts.extend(parts);
            }
        }
        Ok(())
    }

    /// Draws the default. Returns its time `[ms]`.
    pub fn time_usual(&mut self, view: usize, progress: &dyn Progress) -> Result<f64> {
        let drawn = self.draw(view, &Tuning::usual(), false, progress)?;
        let ms = drawn.ms.iter().sum();
        self.usual_ms[view].push(ms);
        Ok(ms)
    }

    /// Returns the median time of the default `[ms]`.
    pub fn usual_ms(&self, view: usize) -> f64 {
        metrics::quartiles(&self.usual_ms[view])[1]
    }

    fn in_view(&self, tuning: &Tuning, view: usize) -> bool {
        self.get(tuning).is_some_and(|found| found.views.len() > view)
    }

    /// Returns what was measured of a tuning.
    pub fn get(&self, tuning: &Tuning) -> Option<&Measured> {
        self.found.iter().find(|found| found.tuning == *tuning)
    }

    /// Draws one view.
    pub fn draw(
        &mut self,
        view: usize,
        tuning: &Tuning,
        layers: bool,
        progress: &dyn Progress,
    ) -> Result<Drawn> {
        let mut number = view;
        let subject = self.subjects.iter_mut().find(|subject| {
            let own = subject.views.len();
            let is_own = number < own;
            number -= if is_own { 0 } else { own };
            is_own
        });
        let subject = subject.expect("a view of a subject");
        let view = subject.views[number];
        let cloud = &mut subject.cloud;
        draw(self.gpu, cloud, &view, (&self.settings, self.cut), tuning, layers, progress)
    }

    /// Returns the knobs that can change a picture, each with its values.
    fn knobs(&mut self, progress: &dyn Progress) -> Result<Vec<usize>> {
        let mut runs = [false; KNOBS.len()];
        let (settings, cut) = (&self.settings, self.cut);
        for subject in &mut self.subjects {
            for view in &subject.views {
                let detail = cut.of(view.size);
                subject.cloud.wait_until_resident(self.gpu, view, &detail, progress)?;
                let config = FrameConfig::new(settings, view, subject.cloud.resident());
                for (runs, knob) in runs.iter_mut().zip(&KNOBS) {
                    let own = |name| {
                        let decisions = &config.decisions.0;
                        decisions.iter().any(|(effect, why)| effect.name() == name && why.runs)
                    };
                    *runs |= knob.effect().is_none_or(own);
                }
            }
        }
        Ok((0..KNOBS.len()).filter(|knob| runs[*knob]).collect())
    }

    /// Returns the default, the finest tuning, and each other value of each knob that can change a
    /// picture.
    pub fn singles(&mut self, progress: &dyn Progress) -> Result<Vec<Tuning>> {
        let usual = Tuning::usual();
        let mut singles = vec![usual, Tuning::finest()];
        for knob in self.knobs(progress)? {
            let values = (0..KNOBS[knob].values.len()).map(|value| usual.with(knob, value));
            singles.extend(values.filter(|tuning| *tuning != usual));
        }
        Ok(singles)
    }

    /// Searches for the tunings that no other beats. Returns their front.
    pub fn search(&mut self, effort: &Effort, progress: &dyn Progress) -> Result<Front> {
        let singles = self.singles(progress)?;
        self.measure(&singles, effort.singles, progress)?;
        // Of moving pictures, and of those at rest.
        let mut tunings = Vec::new();
        for moves in [true, false] {
            tunings.extend(spread(&self.expected(&singles, moves), 2 * effort.most));
        }
        tunings.retain(|tuning| self.get(tuning).is_none());
        tunings.sort_by_key(Tuning::words);
        tunings.dedup();
        self.measure(&tunings, 1, progress)?;
        let left = self.fronts(&self.tunings(), effort.most);
        self.measure(&left, effort.rounds, progress)?;
        let left = self.fronts(&left, effort.most);
        Ok(self.summary(&left, effort.rounds))
    }

    /// Returns the combinations of values that no other is expected to beat, the fastest first: of
    /// pictures at rest against the finest one, or of moving ones, which are no finer than the
    /// default, against that.
    fn expected(&self, singles: &[Tuning], moves: bool) -> Vec<Expected> {
        let of = |tuning: &Tuning| {
            let found = self.get(tuning).expect("measured");
            let px = mean(found, moves).px;
            let ms = metrics::mean(found.views.iter().map(|view| view.least));
            Expected { tuning: *tuning, ms, px }
        };
        let usual = of(&Tuning::usual());
        let mut sums = vec![usual];
        for (knob, Knob { name, .. }) in KNOBS.iter().enumerate() {
            let own = usual.tuning.value(knob);
            let is_other = |tuning: &&Tuning| match moves {
                true => tuning.value(knob) > own,
                false => tuning.value(knob) != own && tuning.divisor() == 1,
            };
            let values = singles[2..].iter().filter(is_other).map(&of);
            // Values that gain nothing are passed over: noise is no gain.
            let gains = |own: &Expected| {
                own.ms < usual.ms * (1.0 - WORTH) || own.px < usual.px * (1.0 - WORTH)
            };
            for own in values.filter(gains).collect::<Vec<_>>() {
                let value = own.tuning.value(knob);
                let with = |sum: &Expected| Expected {
                    tuning: sum.tuning.with(knob, value),
                    ms: match *name {
                        "resolution" => sum.ms * own.ms / usual.ms,
                        _ => (sum.ms + own.ms - usual.ms).max(LEAST * usual.ms),
                    },
                    px: sum.px + own.px - usual.px,
                };
                let of_others =
                    sums.iter().filter(|sum| sum.tuning.value(knob) == usual.tuning.value(knob));
                let with: Vec<Expected> = of_others.map(with).collect();
                sums.extend(with);
            }
            sums.sort_by(|a, b| a.ms.total_cmp(&b.ms).then(a.px.total_cmp(&b.px)));
            let mut best = f64::INFINITY;
            sums.retain(|sum| {
                let is_better = sum.px < best;
                best = best.min(sum.px);
                is_better
            });
        }
        sums
    }

    fn tunings(&self) -> Vec<Tuning> {
        self.found.iter().map(|found| found.tuning).collect()
    }

    /// Returns the fronts of moving pictures and of those at rest.
    fn fronts(&self, of: &[Tuning], most: usize) -> Vec<Tuning> {
        let mut fronts: Vec<Tuning> =
            [true, false].into_iter().flat_map(|moves| self.front(of, most, moves)).collect();
        fronts.sort_by_key(Tuning::words);
        fronts.dedup();
        fronts
    }

    /// Returns those tunings that no other beats in pixels or in depth by what is worth it, and the
    /// default and the finest one; the fastest first.
    fn front(&self, of: &[Tuning], most: usize, moves: bool) -> Vec<Tuning> {
        let mut sorted: Vec<&Measured> = of
            .iter()
            .filter(|tuning| moves || tuning.divisor() == 1)
            .filter_map(|tuning| self.get(tuning))
            .collect();
        sorted.sort_by(|a, b| self.ms(a)[1].total_cmp(&self.ms(b)[1]));
        let mut best = Errors { px: f64::MAX, depth: f64::MAX };
        let always = [Tuning::usual(), Tuning::finest()];
        let mut gains: Vec<(f64, Tuning)> = Vec::new();
        for found in sorted {
            let own = mean(found, moves);
            let better = |own: f64, best: f64| {
                if own < best * (1.0 - WORTH) {
                    (best.max(1e-12) / own.max(1e-12)).ln()
                } else {
                    0.0
                }
            };
            let gain = better(own.px, best.px).max(0.5 * better(own.depth, best.depth));
            if gain > 0.0 {
                best = Errors { px: best.px.min(own.px), depth: best.depth.min(own.depth) };
            }
            let needed = always.contains(&found.tuning);
            // Finer ones than the default draw no moving picture, but may beat those that do.
            if (gain > 0.0 || needed) && (!moves || found.tuning.is_no_finer()) {
                gains.push((if needed { f64::INFINITY } else { gain }, found.tuning));
            }
        }
        while gains.len() > most {
            let least = (0..gains.len()).min_by(|a, b| gains[*a].0.total_cmp(&gains[*b].0));
            gains.remove(least.expect("more than none"));
        }
        gains.into_iter().map(|(_, tuning)| tuning).collect()
    }

    /// Returns quartiles of the mean time of a picture of each view `[ms]`.
    fn ms(&self, found: &Measured) -> [f64; 3] {
        let quartiles = found.views.iter().zip(&self.usual_ms).map(|(view, usual)| {
            let parts: Vec<f64> = view.parts.iter().map(|parts| parts.iter().sum()).collect();
            metrics::quartiles(&parts).map(|part| part * metrics::quartiles(usual)[1])
        });
        let sums = quartiles.fold([0.0; 3], |sums, ms| std::array::from_fn(|k| sums[k] + ms[k]));
        sums.map(|sum| sum / found.views.len() as f64)
    }

    /// Returns the costs of a tuning.
    fn costs(&self, found: &Measured) -> Tuned {
        let median = |view: &InView, k: usize| {
            metrics::quartiles(&view.parts.iter().map(|parts| parts[k]).collect::<Vec<_>>())[1]
        };
        let medians: Vec<[f64; 2]> = found
            .views
            .iter()
            .zip(&self.usual_ms)
            .map(|(view, usual)| [0, 1].map(|k| median(view, k) * metrics::quartiles(usual)[1]))
            .collect();
        let whole = |load: &dyn Fn(&Load) -> u64| {
            found.views.iter().map(|view| load(&view.load) as f64).sum::<f64>().max(1.0) / 1e6
        };
        let sum = |k: usize| medians.iter().map(|ms| ms[k]).sum::<f64>();
        let mut tuned = Tuned {
            values: found.tuning.words(),
            mean: mean(found, false),
            most: found.views.iter().map(|view| view.errors).fold(Errors::default(), Errors::worst),
            moving: mean(found, true),
            ms: self.ms(found),
            point_ms: sum(0) / whole(&|load| load.points),
            pixel_ms: sum(1) / whole(&|load| load.pixels),
            spread: 1.0,
        };
        let quotients = found.views.iter().zip(&medians).map(|(view, ms)| {
            ms.iter().sum::<f64>() / tuned.predicted(&view.load, &Default::default())
        });
        tuned.spread = quotients.fold(1.0, f64::max);
        tuned
    }

    fn summary(&self, tunings: &[Tuning], rounds: usize) -> Front {
        let mut tuned: Vec<Tuned> = tunings
            .iter()
            .filter_map(|tuning| self.get(tuning))
            .map(|found| self.costs(found))
            .collect();
        tuned.sort_by(|a, b| a.ms[1].total_cmp(&b.ms[1]));
        Front {
            device: self.gpu.device.name.clone(),
            driver: self.gpu.device.driver.clone(),
            is_cpu: self.gpu.device.is_cpu,
            scenes: self.subjects.iter().map(|subject| subject.name.clone()).collect(),
            size: self.subjects[0].views[0].size,
            rounds,
            tuned,
        }
    }
}

/// A drawn picture.
pub struct Drawn {
    /// Empty if not asked for.
    pub pixels: Pixels,
    pub load: Load,
    /// Times of points and pixels `[ms]`.
    pub ms: [f64; 2],
}

/// Draws a view with a tuning, as `render` does; in fewer pixels as the window does while it moves.
pub fn draw(
    gpu: &mut Gpu,
    cloud: &mut GpuCloud,
    view: &View,
    (settings, cut): (&RenderSettings, LodOptions),
    tuning: &Tuning,
    layers: bool,
    progress: &dyn Progress,
) -> Result<Drawn> {
    let divisor = tuning.divisor();
    let (full, view) = (view, &View::new(view.camera, divided(view.size, divisor))?);
    let (settings, cut) = tuning.applied(settings, cut, view.size);
    cloud.wait_until_resident(gpu, view, &cut.of(view.size), progress)?;
    let mut config = FrameConfig::new(&settings, full, cloud.resident());
    if divisor > 1 {
        config = config.interactive(divisor).for_view(view, cloud.resident());
    }
    let mut g = Graph::new(gpu);
    let outcome = frame::record(&mut g, view, cloud.resident(), &config)?;
    let picture = encode::download(&mut g, &outcome.picture)?;
    let depth = layers.then(|| g.download(&outcome.gbuffer.depth));
    let frame = g.submit_and_wait(&[])?;
    let pixels = depth.map(|depth| {
        let (depth, rgb) = (frame.read(&depth).to_vec(), picture.read(&frame).concat());
        Pixels { size: view.size, depth, rgb }.enlarged(full.size)
    });
    let load = Load {
        points: outcome.statistics.points_drawn,
        pixels: view.size[0] as u64 * view.size[1] as u64,
    };
    Ok(Drawn { pixels: pixels.unwrap_or_default(), load, ms: split(&frame.passes) })
}

/// Returns the mean errors of the views, against the finest picture or, if it moves, the default's.
fn mean(found: &Measured, moves: bool) -> Errors {
    let all = || found.views.iter().map(|view| if moves { view.moving } else { view.errors });
    Errors {
        px: metrics::mean(all().map(|errors| errors.px)),
        depth: metrics::mean(all().map(|errors| errors.depth)),
    }
}

/// Formats a front as a table.
pub fn table(front: &Front) -> String {
    let mut text = format!(
        "{:>3} {:>9} {:>9} {:>9} {:>9}  {}\n",
        "", "ms", "px", "px most", "depth %", "values that are not the defaults"
    );
    for (number, tuned) in front.tuned.iter().enumerate() {
        let Errors { px, depth } = tuned.mean;
        text += &format!(
            "{number:>3} {:>9.2} {px:>9.4} {:>9.4} {:>9.4}  {}\n",
            tuned.ms[1],
            tuned.most.px,
            100.0 * depth,
            words(tuned)
        );
    }
    text + &format!(
        "errors: means over pixels, and of views, against the finest picture (self); {}x{} pixels of {}; {} rounds on {} ({})\n",
        front.size[0],
        front.size[1],
        front.scenes.join(", "),
        front.rounds,
        front.device,
        front.driver
    )
}

/// Returns the values that are not the defaults, after the name of the default and the finest one.
fn words(tuned: &Tuned) -> String {
    let name = match tuned.tuning() {
        Some(tuning) if tuning == Tuning::usual() => return "the default".into(),
        Some(tuning) if tuning == Tuning::finest() => "the finest: ",
        _ => "",
    };
    format!("{name}{}", tuned.values.join(" "))
}

/// Returns the chart of a front: error against milliseconds.
pub fn chart(front: &Front) -> Chart {
    let mark = |tuned: &Tuned| {
        let is_usual = tuned.values.is_empty();
        Mark::new(words(tuned), tuned.ms, tuned.mean.px, is_usual)
    };
    let panel = Panel {
        title: format!("{}, {} x {} pixels", front.scenes.join(", "), front.size[0], front.size[1]),
        marks: front.tuned.iter().map(mark).collect(),
    };
    Chart::new(
        &format!("Accuracy against time on {}", front.device),
        ["milliseconds a picture", "error against the finest picture (self), px"],
        "ms",
        vec![panel],
    )
}

/// Returns a page with the chart of a front and its table.
pub fn page(front: &Front) -> String {
    let number = |value: f64| format!("{value:.4}");
    let row = |tuned: &Tuned| {
        let [_, ms, _] = tuned.ms;
        let Errors { px, depth } = tuned.mean;
        let numbers = [ms, px, tuned.most.px, 100.0 * depth].map(number);
        numbers.into_iter().chain([words(tuned)]).collect()
    };
    let table = Table {
        title: "all settings of the front".into(),
        head: ["ms", "px", "px most", "depth %", "values that are not the defaults"]
            .map(String::from)
            .to_vec(),
        rows: front.tuned.iter().map(row).collect(),
    };
    report::chart_page(&chart(front), &table)
}
