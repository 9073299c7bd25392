//! Study `surface`: the error of the depth image of points against the surface they were sampled
//! from.
//!
//! The parameter is the style, as command line settings. Scenes, views, densities and noise are
//! those of `cases`, the metrics those of `truth`. Points alone are the baseline; they are also the
//! input of every style, so they tell which visible points should be hidden.

use super::cases::{self, Case, Options, Sampling};
use super::chart::{Chart, Mark, Panel};
use super::report::{Section, Table};
use super::truth::Errors;
use super::{Plan, Row, mark_fronts, metrics, sweep, white, yardstick};
use crate::config::NO_POINT;
use crate::error::{Error, Result};
use crate::graph::{Gpu, Graph};
use crate::progress::Progress;
use crate::render::frame;
use crate::render::settings::{FrameConfig, RenderSettings};
use crate::resident::Resident;
use crate::view::View;

pub const SUMMARY: &str = "depth, layers, holes and contours, against the surface itself";

/// Name and settings as for `--effect`. All others start from the first.
const STYLES: [(&str, &[&str]); 4] = [
    ("points", &["visibility=off", "fill=off", "shape=off", "edl=off"]),
    ("surface", &["visibility=auto", "fill=auto", "shape=off", "edl=off"]),
    ("splat", &["visibility=off", "fill=auto,method=splat", "shape=off", "edl=off"]),
    (
        "single",
        &[
            "visibility=auto,levels=1,kernel=9,threshold=2.1",
            "fill=auto,method=median",
            "shape=off",
            "edl=off",
        ],
    ),
];

/// Metric, its unit for axes, and its description.
const METRICS: [(&str, &str, &str); 6] = [
    (
        "depth_share",
        "share of pixels",
        "Depth: interior pixels farther than 0.5 % of the depth from the surface in them",
    ),
    (
        "layer_share",
        "share of pixels",
        "Layers: interior pixels outside of the true depths of their 3x3, by more than 0.05 % of the depth and the noise",
    ),
    ("holes", "share of pixels", "Holes: pixels of the silhouette without a depth"),
    (
        "spilled",
        "share of pixels",
        "Spilled: pixels with a depth more than 1 px outside of the silhouette",
    ),
    (
        "shown_hidden",
        "1 - precision",
        "Hidden points that show: of the points taken for visible, the share that is not",
    ),
    (
        "lost_visible",
        "1 - recall",
        "Visible points that are lost: of the visible points, the share that was taken for hidden",
    ),
];

const HEAD: [&str; 15] = [
    "scene",
    "view",
    "sampling",
    "points a pixel",
    "noise, px",
    "style",
    "points",
    "interior pixels",
    "depth off, %",
    "wrong layer, %",
    "holes, %",
    "spilled, %",
    "precision, %",
    "recall, %",
    "ms",
];

fn values(errors: &Errors) -> [f64; 6] {
    [
        errors.misplaced_share(),
        errors.wrong_layer_share(),
        errors.hole_share(),
        errors.spilled_share(),
        1.0 - errors.precision(),
        1.0 - errors.recall(),
    ]
}

pub fn run(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    let styles = STYLES
        .iter()
        .map(|(name, settings)| Ok((*name, render_settings(settings)?)))
        .collect::<Result<Vec<_>>>()?;
    let options = Options {
        size: plan.size,
        seed: plan.seed,
        most_points: plan.points,
        scenes: plan.scenes.clone(),
        ..Options::default()
    };
    let mut rows = Vec::new();
    let mut marks = Vec::new();
    let mut table = Table {
        title: "All cases".into(),
        head: HEAD.map(String::from).to_vec(),
        rows: Vec::new(),
    };
    let left_out =
        cases::each(&options, progress, |case| {
            progress.tick("study surface", 0, 0)?;
            let resident = white(gpu, &case.cloud, progress)?;
            let mut drawings: Vec<Drawing> = styles.iter().map(|_| Drawing::default()).collect();
            let order: Vec<usize> = (0..styles.len()).collect();
            let times = sweep::interleaved(&order, plan.repeat, |&style| {
                drawings[style] = draw(gpu, &case.view, &resident, &styles[style].1)?;
                Ok(drawings[style].ms)
            })?;
            let mut own = Vec::new();
            for (((style, _), drawing), times) in styles.iter().zip(&drawings).zip(&times) {
                let raw = &drawings[0].depth;
                let errors = case.errors(raw, &drawing.depth, Some(&drawing.visible(raw)));
                let ms = metrics::quartiles(times);
                own.extend(
                    METRICS.iter().zip(values(&errors)).map(|((metric, ..), error)| {
                        row(case, style, metric, error, ms, times.len())
                    }),
                );
                table.rows.push(counted(case, style, &errors, ms));
            }
            mark_fronts(&mut own);
            let raw = &drawings[0].depth;
            let visible = yardstick::visible(&case.truth, case.noise_px, raw);
            let linear = yardstick::linear(&case.truth, raw, &visible);
            let errors = case.errors(raw, &linear, Some(&visible));
            own.extend(METRICS.iter().zip(values(&errors)).map(|((metric, ..), error)| {
                row(case, yardstick::NAME, metric, error, [0.0; 3], 0)
            }));
            table.rows.push(counted(case, yardstick::NAME, &errors, [0.0; 3]));
            own.iter().for_each(|row| mark(&mut marks, case, row));
            rows.extend(own);
            Ok(())
        })?;
    left_out.iter().for_each(|line| progress.note(&format!("study surface leaves out {line}")));
    let charts = METRICS
        .iter()
        .map(|&(metric, y_axis, caption)| chart(metric, y_axis, caption, &mut marks))
        .collect();
    let method = format!(
        "Truth is the surface itself, ray-cast in f64 at centres, corners and sides of all pixels. Scenes and meshes are sampled uniformly by area, hidden sides too, the street by its \
         scanner; <em>vertices</em> are a mesh's own. Points a pixel are those of the first surface. Noise is Gaussian along the ray to the eye, cut off at three sigma. Here points a \
         pixel, not time, lie to the right. Interior pixels are more than 2 px from creases and edges of the true depth (bent by more than 1 % of the depth, and of the depth range); \
         shares are of those that have a depth. What no scanner saw is not counted. <em>Linear</em> is the best that points can tell: the truth says which are visible, depths between them are interpolated linearly. Aimed at: 1e-4 of depth, 1e-3 of layers, 1e-3 of holes, 1e-4 spilled. n = {} interleaved rounds. \
         Left out: {}.",
        plan.repeat,
        if left_out.is_empty() { "nothing".into() } else { left_out.join("; ") }
    );
    Ok(Section {
        name: "surface",
        title: "The surface itself".into(),
        method,
        rows,
        charts,
        tables: vec![table],
    })
}

pub(super) fn render_settings(words: &[&str]) -> Result<RenderSettings> {
    let mut settings = RenderSettings::points();
    words.iter().try_for_each(|text| settings.effects.set_any(text)).map_err(Error::Request)?;
    Ok(settings)
}

#[derive(Default)]
pub(super) struct Drawing {
    pub depth: Vec<f32>,
    index: Vec<u32>,
    /// Time of all passes `[ms]`.
    pub ms: f64,
}

impl Drawing {
    /// Returns which raw points were kept as visible: those that their own pixel still shows.
    fn visible(&self, raw: &[f32]) -> Vec<bool> {
        let shown = |((own, raw), index): ((&f32, &f32), &u32)| *index != NO_POINT && own == raw;
        self.depth.iter().zip(raw).zip(&self.index).map(shown).collect()
    }
}

pub(super) fn draw(
    gpu: &mut Gpu,
    view: &View,
    resident: &Resident,
    settings: &RenderSettings,
) -> Result<Drawing> {
    let config = FrameConfig::new(settings, view, resident);
    let mut g = Graph::new(gpu);
    let outcome = frame::record(&mut g, view, resident, &config)?;
    let (depth, index) = (g.download(&outcome.gbuffer.depth), g.download(&outcome.gbuffer.index));
    let frame = g.submit_and_wait(&[])?;
    let drawing = Drawing {
        depth: frame.read(&depth).to_vec(),
        index: frame.read(&index).to_vec(),
        ms: frame.ms(""),
    };
    Ok(drawing)
}

fn row(case: &Case, style: &str, metric: &'static str, error: f64, ms: [f64; 3], n: usize) -> Row {
    let value = format!("{style} {} noise {} px", sampling(case), case.noise_px);
    Row {
        scene: case.scene,
        view: case.view_name,
        parameter: "style",
        value,
        metric,
        error,
        ms,
        n,
        auto: false,
        front: false,
    }
}

fn sampling(case: &Case) -> String {
    match case.sampling {
        Sampling::Density(density) => format!("{density}/px"),
        Sampling::Vertices => "vertices".into(),
    }
}

fn counted(case: &Case, style: &str, errors: &Errors, ms: [f64; 3]) -> Vec<String> {
    let percent = |share: f64| format!("{:.3}", 100.0 * share);
    let shares = [
        errors.misplaced_share(),
        errors.wrong_layer_share(),
        errors.hole_share(),
        errors.spilled_share(),
        errors.precision(),
        errors.recall(),
    ];
    [
        case.scene.to_string(),
        case.view_name.into(),
        sampling(case),
        format!("{:.3}", case.density),
        case.noise_px.to_string(),
        style.into(),
        case.cloud.len().to_string(),
        errors.interior.to_string(),
    ]
    .into_iter()
    .chain(shares.map(percent))
    .chain([format!("{:.2}", ms[1])])
    .collect()
}

/// Adds a mark to the panel of its metric, scene and view: error over points per pixel.
fn mark(panels: &mut Vec<(&'static str, Panel)>, case: &Case, row: &Row) {
    let title = format!("{}, {}", case.scene, case.view_name);
    let at = panels
        .iter()
        .position(|(metric, panel)| *metric == row.metric && panel.title == title)
        .unwrap_or_else(|| {
            panels.push((row.metric, Panel { title, marks: Vec::new() }));
            panels.len() - 1
        });
    panels[at].1.marks.push(Mark::new(row.value.clone(), [case.density; 3], row.error, row.auto));
}

fn chart(
    metric: &str,
    y_axis: &str,
    caption: &str,
    panels: &mut Vec<(&'static str, Panel)>,
) -> Chart {
    let panels = panels.extract_if(.., |(of, _)| *of == metric).map(|(_, panel)| panel).collect();
    Chart::new(caption, ["points a pixel", y_axis], "points a pixel", panels)
}
