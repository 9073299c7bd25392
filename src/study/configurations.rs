//! Common parts of the studies `visibility`, `fill`, `smooth` and `shape`: from settings of effects
//! to rows, charts and tables.
//!
//! ```text
//!     case (scene, view, density) -> every configuration drawn once for its errors,
//!                                    and round by round, in turn, for its times
//!     views of a scene at a density, and all scenes at a density, are pooled:
//!                                    sums of errors over pixels, sums of times over frames
//! ```
//! Few densities and noises are used here: `surface` has all of them. The cost of a configuration
//! is that of its passes after points have become pixels.

use super::cases::{self, Case, Options, Sampling};
use super::chart::{ALL, Chart};
use super::report::{self, Section, Table};
use super::surface::render_settings;
use super::{Plan, Row, mark_fronts, metrics, sweep, white};
use crate::error::Result;
use crate::graph::{CompletedSubmission, Gpu, Graph, Handle};
use crate::passes::tile_stats::{self, Counts};
use crate::progress::Progress;
use crate::render::frame;
use crate::render::settings::{FrameConfig, RenderSettings};
use crate::resident::Resident;
use crate::view::View;

/// Points of the first surface per covered pixel, and the name of the case.
const DENSITIES: [(f64, &str); 3] =
    [(0.1, "0.1 points/px"), (0.5, "0.5 points/px"), (2.0, "2 points/px")];
const VERTICES: &str = "its vertices";
const SCENES: [&str; 4] = ["sphere", "torus", "street", "dragon"];

/// Most rounds: with many configurations, a study takes minutes, not hours, on a software device.
const MOST_ROUNDS: usize = 3;
const MOST_SIDE: u32 = 384;
const VIEWS: usize = 1;

/// The parameter of the renderer's defaults.
pub const AUTO: &str = "auto";

pub struct Configuration {
    pub parameter: &'static str,
    pub value: String,
    /// Settings as after `--effect`.
    pub settings: Vec<String>,
}

impl Configuration {
    pub fn new(
        parameter: &'static str,
        value: impl std::fmt::Display,
        settings: &[&str],
    ) -> Configuration {
        Configuration {
            parameter,
            value: value.to_string(),
            settings: settings.iter().map(|text| text.to_string()).collect(),
        }
    }
}

pub struct Metric {
    pub name: &'static str,
    /// Unit for axes.
    pub axis: &'static str,
    pub about: &'static str,
    /// True if parts are squares, and the error is the root of their mean.
    pub root: bool,
}

/// Sum of errors, and the number of pixels.
pub type Part = [f64; 2];

#[derive(Clone, Debug, Default)]
pub struct Drawing {
    pub depth: Vec<f32>,
    pub index: Vec<u32>,
    /// Remaining light; empty if no effect darkens.
    pub shading: Vec<f32>,
    pub counts: Counts,
}

/// A study of surfaces: its configurations, and what is measured of each.
pub trait Experiment {
    const NAME: &'static str;
    const TITLE: &'static str;
    const METRICS: &'static [Metric];
    /// Counters, for what times of this device do not show on another.
    const COUNTERS: &'static [&'static str];
    /// Settings drawn first and passed to `reference`.
    const REFERENCE: &'static [&'static str];
    /// The last pass before the measured ones.
    const AFTER: &'static [&'static str];
    /// How it is measured, HTML.
    const METHOD: &'static str;
    /// The reference of all configurations of a case.
    type Reference;

    /// Returns the configurations, equal in every case except for settings that depend on it.
    fn configurations(case: &Case) -> Vec<Configuration>;
    fn reference(case: &Case, drawing: Drawing) -> Self::Reference;
    /// Returns a part for every metric and a number for every counter.
    fn measure(
        case: &Case,
        reference: &Self::Reference,
        drawing: &Drawing,
    ) -> (Vec<Part>, Vec<f64>);
    fn more_charts(_rows: &[Row]) -> Vec<Chart> {
        Vec::new()
    }
}

/// A configuration in all cases of a scene and density.
#[derive(Clone, Default)]
struct Sum {
    parameter: &'static str,
    value: String,
    parts: Vec<Part>,
    counters: Vec<f64>,
    /// Times, one per round.
    times: Vec<f64>,
}

struct Pool {
    scene: &'static str,
    sampling: &'static str,
    sums: Vec<Sum>,
}

pub fn run<E: Experiment>(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    let scenes = if plan.scenes.is_empty() {
        SCENES.map(String::from).to_vec()
    } else {
        plan.scenes.clone()
    };
    let options = Options {
        size: plan.size.map(|side| side.min(MOST_SIDE)),
        seed: plan.seed,
        // Hidden sides take as many points as visible ones.
        most_points: 4 * plan.points,
        scenes,
        views: VIEWS,
        densities: DENSITIES.map(|(density, _)| density).to_vec(),
        noises_px: vec![0.0],
        ..Options::default()
    };
    let rounds = plan.repeat.min(MOST_ROUNDS);
    let mut pools: Vec<Pool> = Vec::new();
    let left_out = cases::each(&options, progress, |case| {
        let sampling = match case.sampling {
            Sampling::Density(density) => {
                DENSITIES.iter().find(|(known, _)| *known == density).expect("asked for").1
            }
            Sampling::Vertices => VERTICES,
        };
        let sums = measured::<E>(gpu, case, rounds, progress)?;
        let whole = (sampling != VERTICES).then_some(ALL);
        whole
            .into_iter()
            .chain([case.scene])
            .for_each(|scene| add(&mut pools, scene, sampling, &sums));
        Ok(())
    })?;
    left_out.iter().for_each(|line| progress.note(&format!("study {} leaves out {line}", E::NAME)));
    // Stable: scenes and densities stay in their order.
    pools.sort_by_key(|pool| pool.scene != ALL);
    let mut rows: Vec<Row> =
        pools.iter().flat_map(|pool| pool.sums.iter().flat_map(|sum| of::<E>(pool, sum))).collect();
    mark_fronts(&mut rows);
    let label = |row: &Row| {
        if row.auto { AUTO.to_string() } else { format!("{} {}", row.parameter, row.value) }
    };
    let of = |metric: &Metric| {
        let axes = ["milliseconds of the passes", metric.axis];
        report::chart(metric.name, axes, metric.about, &rows, &label)
    };
    let mut charts: Vec<Chart> = E::METRICS.iter().map(of).collect();
    charts.extend(E::more_charts(&rows));
    let method = format!(
        "{} Truth is the surface itself, ray-cast in f64. All scenes at one density are pooled: errors are sums over all pixels, milliseconds are sums over the frames, of \
         {} x {} pixels. Milliseconds are those of the passes that the settings change. n = {rounds} interleaved rounds after one that is not \
         counted. Left out: {}.",
        E::METHOD,
        options.size[0],
        options.size[1],
        if left_out.is_empty() { "nothing".into() } else { left_out.join("; ") }
    );
    let tables = vec![table::<E>(&pools)];
    Ok(Section { name: E::NAME, title: E::TITLE.into(), method, rows, charts, tables })
}

fn measured<E: Experiment>(
    gpu: &mut Gpu,
    case: &Case,
    rounds: usize,
    progress: &dyn Progress,
) -> Result<Vec<Sum>> {
    let resident = white(gpu, &case.cloud, progress)?;
    let reference =
        E::reference(case, draw(gpu, &case.view, &resident, &render_settings(E::REFERENCE)?)?);
    let mut sums = Vec::new();
    let mut asked = Vec::new();
    for Configuration { parameter, value, settings } in E::configurations(case) {
        let settings = render_settings(&settings.iter().map(String::as_str).collect::<Vec<_>>())?;
        let (parts, counters) =
            E::measure(case, &reference, &draw(gpu, &case.view, &resident, &settings)?);
        sums.push(Sum { parameter, value, parts, counters, times: Vec::new() });
        asked.push(settings);
    }
    let times = sweep::interleaved(&asked, rounds, |settings| {
        progress.tick(E::NAME, 0, 0)?;
        time(gpu, &case.view, &resident, settings, E::AFTER)
    })?;
    sums.iter_mut().zip(times).for_each(|(sum, times)| sum.times = times);
    Ok(sums)
}

fn draw(
    gpu: &mut Gpu,
    view: &View,
    resident: &Resident,
    settings: &RenderSettings,
) -> Result<Drawing> {
    let config = FrameConfig::new(settings, view, resident);
    let mut g = Graph::new(gpu);
    let outcome = frame::record(&mut g, view, resident, &config)?;
    let (depth, index) = (g.download(&outcome.gbuffer.depth), g.download(&outcome.gbuffer.index));
    let shading = outcome.gbuffer.shading.as_ref().map(|shading| g.download(shading));
    let asked = tile_stats::Asked::of(&mut g, &outcome.gbuffer);
    let frame = g.submit_and_wait(&[])?;
    fn words<T: bytemuck::Pod>(
        frame: &CompletedSubmission,
        buffer: Option<crate::graph::Buffer>,
    ) -> Vec<T> {
        buffer.map(|buffer| frame.read(&buffer).to_vec()).unwrap_or_default()
    }
    let drawing = Drawing {
        depth: frame.read(&depth).to_vec(),
        index: frame.read(&index).to_vec(),
        shading: words(&frame, shading),
        counts: asked.counts(&frame, view.size, &config.effects),
    };
    Ok(drawing)
}

/// Returns the time of the passes after the last one with a name in `after` `[ms]`.
fn time(
    gpu: &mut Gpu,
    view: &View,
    resident: &Resident,
    settings: &RenderSettings,
    after: &[&str],
) -> Result<f64> {
    let config = FrameConfig::new(settings, view, resident);
    let mut g = Graph::new(gpu);
    let gbuffer = frame::record(&mut g, view, resident, &config)?.gbuffer;
    let wanted = [&gbuffer.depth, &gbuffer.index, &gbuffer.color]
        .into_iter()
        .chain(&gbuffer.shading)
        .map(Handle::resource)
        .collect::<Vec<_>>();
    let frame = g.submit_and_wait(&wanted)?;
    let last = frame
        .passes
        .iter()
        .rposition(|(name, _)| after.iter().any(|after| name.starts_with(after)))
        .map_or(0, |last| last + 1);
    let ms = frame.passes[last..].iter().map(|(_, ms)| ms).sum();
    Ok(ms)
}

fn add(pools: &mut Vec<Pool>, scene: &'static str, sampling: &'static str, sums: &[Sum]) {
    let Some(pool) = pools.iter_mut().find(|pool| (pool.scene, pool.sampling) == (scene, sampling))
    else {
        return pools.push(Pool { scene, sampling, sums: sums.to_vec() });
    };
    for (pooled, sum) in pool.sums.iter_mut().zip(sums) {
        pooled
            .parts
            .iter_mut()
            .zip(&sum.parts)
            .for_each(|(to, from)| *to = [to[0] + from[0], to[1] + from[1]]);
        pooled.counters.iter_mut().zip(&sum.counters).for_each(|(to, from)| *to += from);
        pooled.times.iter_mut().zip(&sum.times).for_each(|(to, from)| *to += from);
    }
}

fn error(metric: &Metric, [sum, whole]: Part) -> f64 {
    let mean = sum / whole.max(1.0);
    if metric.root { mean.sqrt() } else { mean }
}

fn of<E: Experiment>(pool: &Pool, sum: &Sum) -> Vec<Row> {
    let ms = metrics::quartiles(&sum.times);
    let row = |(metric, part): (&Metric, &Part)| Row {
        scene: pool.scene,
        view: pool.sampling,
        parameter: sum.parameter,
        value: sum.value.clone(),
        metric: metric.name,
        error: error(metric, *part),
        ms,
        n: sum.times.len(),
        auto: sum.parameter == AUTO,
        front: false,
    };
    E::METRICS.iter().zip(&sum.parts).map(row).collect()
}

fn table<E: Experiment>(pools: &[Pool]) -> Table {
    let first = ["scene", "points", "parameter", "value"].map(String::from);
    let metrics = E::METRICS.iter().map(|metric| {
        if metric.root {
            metric.name.to_string()
        } else {
            format!("{}, %", metric.name.replace('_', " "))
        }
    });
    let head = first
        .into_iter()
        .chain(metrics)
        .chain(E::COUNTERS.iter().map(|name| name.to_string()))
        .chain(["ms".into()])
        .collect();
    let row = |(pool, sum): (&Pool, &Sum)| -> Vec<String> {
        let errors = E::METRICS.iter().zip(&sum.parts).map(|(metric, part)| match metric.root {
            true => format!("{:.4}", error(metric, *part)),
            false => format!("{:.3}", 100.0 * error(metric, *part)),
        });
        let names =
            [pool.scene.to_string(), pool.sampling.into(), sum.parameter.into(), sum.value.clone()]
                .into_iter();
        let counters = sum.counters.iter().map(|count| format!("{count:.0}"));
        names
            .chain(errors)
            .chain(counters)
            .chain([format!("{:.2}", metrics::quartiles(&sum.times)[1])])
            .collect()
    };
    let rows = pools
        .iter()
        .flat_map(|pool| pool.sums.iter().map(move |sum| (pool, sum)))
        .map(row)
        .collect();
    Table { title: "All configurations, with counters".into(), head, rows }
}
