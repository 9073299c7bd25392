//! Study `lod`: the projected error at which refinement ends, against the picture of the full
//! cloud.
//!
//! The parameter is `Detail::lod_px` without a budget, and `auto`: its default with the default
//! budget. The reference is the same renderer's picture of all leaves, lod 0. Errors are therefore
//! those of merged samples alone: scan noise and gaps are in both pictures. Where the full cloud
//! covers a pixel with the nearest of a hundred points, the cut covers it with their mean, which is
//! not worse, but differs. All metrics are over the foreground: pixels that either covers.

use super::flip::{self, Seen};
use super::popping::{self, Popping};
use super::report::{self, Section, Table};
use super::scan::Scan;
use super::{Plan, Row, mark_fronts, metrics, sweep};
use crate::cloud::attribute::Attribute;
use crate::cloud::colormap::linear_to_srgb;
use crate::error::Result;
use crate::graph::{Gpu, Graph, Handle};
use crate::passes::Switch;
use crate::passes::project;
use crate::progress::Progress;
use crate::render::frame;
use crate::render::index_samples;
use crate::render::settings::{FrameConfig, RenderSettings};
use crate::resident::{Residency, Resident};
use crate::select::lod::{Detail, Precision};
use crate::synth::{SceneKind, World};
use crate::view::{Camera, Projection, View};
use glam::DVec3;

pub const SUMMARY: &str = "projected error of the cut, against the full cloud's picture";

const SCENES: [(&str, SceneKind); 2] =
    [("street", SceneKind::Street), ("terrain", SceneKind::Terrain)];

const SETTINGS: [&str; 7] = ["0.25", "0.5", "1", "2", "4", "8", "auto"];

/// Frames of the dolly, and the divisor of its picture size.
const DOLLY_FRAMES: usize = 60;
const DOLLY_SHRINK: u32 = 4;

/// Metric, its unit for axes, and its description: of the settled picture, then of the dolly.
const METRICS: [(&str, &str, &str); 8] = [
    ("rms", "RMS error of colour", "Colour: root mean square error of sRGB values, 0 to 1"),
    ("flip", "mean FLIP", "FLIP: how different the pictures look"),
    (
        "depth_median",
        "relative error of depth, median",
        "Depth: median relative error where both pictures are covered",
    ),
    (
        "depth_p95",
        "relative error of depth, 95 %",
        "Depth: relative error that 95 % of the pixels stay below",
    ),
    (
        "holes",
        "share of pixels",
        "Holes: of the pixels that the full cloud covers, those that the cut does not",
    ),
    (
        "false_fills",
        "share of pixels",
        "False fills: of the pixels that the cut covers, those that the full cloud does not",
    ),
    ("points", "points drawn", "Points drawn, which are a cost, not an error"),
    (
        "bytes_read",
        "bytes read",
        "Bytes read from the index for this picture alone, which are a cost, not an error",
    ),
];
const PSNR: &str = "psnr_db";
const POPPING: [(&str, &str, &str); 2] = [
    (
        "popping_max",
        "mean FLIP from frame to frame",
        "Popping: the largest change from frame to frame of a slow dolly through a level change",
    ),
    (
        "popping_median",
        "mean FLIP from frame to frame",
        "Popping: the median change from frame to frame without a level change",
    ),
];

pub fn run(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    let mut rows = Vec::new();
    let mut counters = table(
        "What was drawn",
        &[
            "scene",
            "view",
            "lod, px",
            "nodes",
            "points drawn",
            "MiB read",
            "of the index, %",
            "PSNR, dB",
            "ms (quartiles)",
        ],
    );
    let mut dollies = table(
        "Dollies",
        &[
            "scene",
            "lod, px",
            "level changes",
            "largest FLIP",
            "median FLIP",
            "median FLIP after one pixel",
        ],
    );
    for (name, scene) in SCENES {
        let scan = Scan::new(scene, |world| world.step, plan.points, plan.seed, progress)?;
        for (view_name, camera) in cameras(&scan.world) {
            let view = View::new(camera, plan.size)?;
            let reference =
                Reference::new(cold(gpu, &scan, &view, &full(plan.size), progress)?.1, plan.size);
            let (mut residency, settings) =
                (open(gpu, &scan)?, SETTINGS.map(|value| (value, detail(value, plan.size))));
            let times = sweep::interleaved(&settings, plan.repeat, |(_, detail)| {
                progress.tick("study lod", 0, 0)?;
                residency.wait_until_resident(gpu, &view, detail, progress)?;
                project_ms(gpu, &view, residency.resident())
            })?;
            for ((value, detail), times) in settings.iter().zip(&times) {
                let (taken, drawing) = cold(gpu, &scan, &view, detail, progress)?;
                let errors = reference.errors(&drawing, plan.size);
                let ms = metrics::quartiles(times);
                let costs = [taken.points as f64, taken.bytes as f64];
                let values = [
                    errors.rms,
                    errors.flip,
                    errors.depth[0],
                    errors.depth[1],
                    errors.holes,
                    errors.false_fills,
                ];
                let values = values.into_iter().chain(costs).chain([errors.psnr_db()]);
                let names = METRICS.iter().map(|metric| metric.0).chain([PSNR]);
                rows.extend(names.zip(values).map(|(metric, error)| {
                    row(name, view_name, value, metric, error, ms, times.len())
                }));
                counters.rows.push(vec![
                    name.into(),
                    view_name.into(),
                    value.to_string(),
                    taken.nodes.to_string(),
                    taken.points.to_string(),
                    format!("{:.2}", taken.bytes as f64 / (1 << 20) as f64),
                    format!("{:.1}", 100.0 * taken.bytes as f64 / scan.index.bytes() as f64),
                    format!("{:.1}", errors.psnr_db()),
                    format!("{:.2} ({:.2} to {:.2})", ms[1], ms[0], ms[2]),
                ]);
            }
        }
        let size = plan.size.map(|side| (side / DOLLY_SHRINK).max(1));
        let [(_, far), ..] = cameras(&scan.world);
        for value in SETTINGS {
            let mut residency = open(gpu, &scan)?;
            let seen = popping::watch(
                gpu,
                &mut residency,
                far,
                size,
                &detail(value, size),
                DOLLY_FRAMES,
                progress,
            )?;
            let (ms, n) = (metrics::quartiles(&seen.ms), seen.ms.len());
            let metrics = POPPING.iter().map(|metric| metric.0).zip([seen.max, seen.median]);
            rows.extend(
                metrics.map(|(metric, error)| row(name, "dolly", value, metric, error, ms, n)),
            );
            let Popping { changes, max, median, moved, .. } = seen;
            let number = |value: f64| format!("{value:.4}");
            dollies.rows.push(vec![
                name.into(),
                value.into(),
                changes.to_string(),
                number(max),
                number(median),
                number(moved),
            ]);
        }
    }
    mark_fronts(&mut rows);
    // More dB are better, so the front is that of the underlying error.
    for i in (0..rows.len()).filter(|&i| rows[i].metric == PSNR).collect::<Vec<_>>() {
        let key = |row: &Row| (row.scene, row.view, row.value.clone());
        rows[i].front =
            rows.iter().any(|row| row.metric == "rms" && row.front && key(row) == key(&rows[i]));
    }
    let chart = |&(metric, y_axis, caption): &_| {
        let x_axis = "milliseconds to clear and project";
        report::chart(metric, [x_axis, y_axis], caption, &rows, &|row| {
            if row.auto { row.value.clone() } else { format!("{} px", row.value) }
        })
    };
    let charts = METRICS.iter().chain(&POPPING).map(chart).collect();
    let method = format!(
        "{} points a scene, indexed, drawn at {} x {} pixels without effects; n = {} interleaved rounds after one that is not counted. The reference is the full cloud's own \
         picture (kind <em>self</em>, lod 0): errors are those of the cut and of nothing else. <em>auto</em> is lod {} with a budget of {} points a pixel; the other settings have \
         no budget. Colour and FLIP (at {} pixels per degree) are over the foreground, the pixels that either picture covers; depth over those that both cover. PSNR is \
         of the mean of squared errors of sRGB values, so its front is that of the RMS error. Bytes are those of a cold start. A dolly is {} frames of {} x {} pixels around \
         the first level change on the way from the far view to what it looks at, {} px a frame at the picture's edge.",
        plan.points,
        plan.size[0],
        plan.size[1],
        plan.repeat,
        crate::config::LOD_PX,
        crate::config::BUDGET_PER_PIXEL,
        flip::PIXELS_PER_DEGREE,
        DOLLY_FRAMES,
        plan.size[0] / DOLLY_SHRINK,
        plan.size[1] / DOLLY_SHRINK,
        popping::STEP_PX,
    );
    Ok(Section {
        name: "lod",
        title: "Level of detail".into(),
        method,
        rows,
        charts,
        tables: vec![counters, dollies],
    })
}

fn table(title: &str, head: &[&str]) -> Table {
    Table {
        title: title.into(),
        head: head.iter().map(|name| name.to_string()).collect(),
        rows: Vec::new(),
    }
}

fn row(
    scene: &'static str,
    view: &'static str,
    value: &str,
    metric: &'static str,
    error: f64,
    ms: [f64; 3],
    n: usize,
) -> Row {
    Row {
        scene,
        view,
        parameter: "lod",
        value: value.into(),
        metric,
        error,
        ms,
        n,
        auto: value == "auto",
        front: false,
    }
}

/// Returns cameras at sixteen and four times the distance of the scene's own, so that cuts are
/// deep, and at that distance.
pub(super) fn cameras(world: &World) -> [(&'static str, Camera); 3] {
    let viewpoint = world.camera();
    [("far", 16.0), ("near", 4.0), ("close-up", 1.0)].map(|(name, times)| {
        let eye = viewpoint.target + (viewpoint.eye - viewpoint.target) * times;
        (
            name,
            Camera {
                eye,
                target: viewpoint.target,
                up: DVec3::Z,
                fov_y: viewpoint.fov_y,
                projection: Projection::Perspective,
                ortho_height: None,
            },
        )
    })
}

fn detail(value: &str, size: [u32; 2]) -> Detail {
    value.parse().map_or(Detail::of(size), |lod_px| Detail { lod_px, ..full(size) })
}

/// Returns limits that select all leaves.
pub fn full(size: [u32; 2]) -> Detail {
    Detail { budget: u64::MAX, lod_px: 0.0, ..Detail::of(size) }
}

fn open(gpu: &mut Gpu, scan: &Scan) -> Result<Residency> {
    Residency::open(
        gpu,
        scan.index.clone(),
        index_samples::shown(&scan.index, Attribute::Rgb),
        u64::MAX,
    )
}

struct Taken {
    nodes: usize,
    points: u64,
    bytes: u64,
}

/// Draws the settled picture of a fresh start, and measures it.
fn cold(
    gpu: &mut Gpu,
    scan: &Scan,
    view: &View,
    detail: &Detail,
    progress: &dyn Progress,
) -> Result<(Taken, Drawing)> {
    let mut residency = open(gpu, scan)?;
    let update = residency.wait_until_resident(gpu, view, detail, progress)?;
    let drawing = draw(gpu, view, residency.resident())?;
    Ok((
        Taken {
            nodes: update.cut.nodes.len(),
            points: update.cut.points,
            bytes: update.bytes_read,
        },
        drawing,
    ))
}

pub struct Drawing {
    /// Picture, linear.
    pub picture: Vec<[f32; 4]>,
    pub depth: Vec<f32>,
    pub index: Vec<u32>,
    /// Time of clearing and projecting `[ms]`.
    pub ms: f64,
}

/// Draws what is resident, without effects.
pub fn draw(gpu: &mut Gpu, view: &View, resident: &Resident) -> Result<Drawing> {
    let mut settings = RenderSettings::points();
    settings.effects.edl.switch = Switch::Off;
    let config = FrameConfig::new(&settings, view, resident);
    let mut g = Graph::new(gpu);
    let outcome = frame::record(&mut g, view, resident, &config)?;
    let picture = g.download(&outcome.picture);
    let [depth, index] =
        [&outcome.gbuffer.depth, &outcome.gbuffer.index].map(|image| g.download(image));
    let frame = g.submit_and_wait(&[])?;
    let drawing = Drawing {
        picture: frame.read(&picture).to_vec(),
        depth: frame.read(&depth).to_vec(),
        index: frame.read(&index).to_vec(),
        ms: frame.ms("project") + frame.ms("clear"),
    };
    Ok(drawing)
}

/// Returns the device time of clearing and projecting alone: nothing else depends on the parameter.
fn project_ms(gpu: &mut Gpu, view: &View, resident: &Resident) -> Result<f64> {
    let mut g = Graph::new(gpu);
    let drawn = project::draw(&mut g, view, resident, Precision::Auto)?;
    let mut wanted = Vec::new();
    for strip in project::strips(view.size, project::KEY_BYTES, g.gathered_limit()) {
        wanted.push(project::record(&mut g, view, &drawn, None, None, strip).words.resource());
    }
    let frame = g.submit_and_wait(&wanted)?;
    let ms = frame.ms("project") + frame.ms("clear");
    Ok(ms)
}

/// Returns the pixels with a point.
pub fn covered(depth: &[f32]) -> Vec<bool> {
    depth.iter().map(|z| z.is_finite()).collect()
}

/// The picture of all leaves, prepared for comparisons.
struct Reference {
    drawing: Drawing,
    seen: Seen,
}

#[derive(Clone, Copy, Debug, Default)]
struct Errors {
    rms: f64,
    flip: f64,
    /// Median and 95 % of depth errors.
    depth: [f64; 2],
    holes: f64,
    false_fills: f64,
}

impl Errors {
    /// Returns the PSNR; infinite for equal pictures.
    fn psnr_db(&self) -> f64 {
        -20.0 * self.rms.log10()
    }
}

impl Reference {
    fn new(drawing: Drawing, size: [u32; 2]) -> Reference {
        let seen = Seen::new(&drawing.picture, size, flip::PIXELS_PER_DEGREE);
        Reference { drawing, seen }
    }

    fn errors(&self, drawing: &Drawing, size: [u32; 2]) -> Errors {
        let (truth, cut) = (&covered(&self.drawing.depth), &covered(&drawing.depth));
        let map = flip::difference(
            &self.seen,
            &Seen::new(&drawing.picture, size, flip::PIXELS_PER_DEGREE),
        );
        let pixels = |keep: fn(bool, bool) -> bool| {
            (0..truth.len()).filter(move |&i| keep(truth[i], cut[i]))
        };
        let foreground = || pixels(|truth, cut| truth || cut);
        let count = |keep: fn(bool, bool) -> bool| pixels(keep).count() as f64;
        let srgb = |picture: &[[f32; 4]], i: usize, c: usize| linear_to_srgb(picture[i][c] as f64);
        let apart =
            |i: usize, c: usize| srgb(&self.drawing.picture, i, c) - srgb(&drawing.picture, i, c);
        let depths: Vec<f64> = pixels(|truth, cut| truth && cut)
            .map(|i| {
                ((drawing.depth[i] - self.drawing.depth[i]) / self.drawing.depth[i]).abs() as f64
            })
            .collect();
        Errors {
            rms: metrics::errors(foreground().flat_map(|i| [0, 1, 2].map(|c| apart(i, c)))).rms,
            flip: metrics::mean(foreground().map(|i| map[i] as f64)),
            depth: metrics::quantiles(&depths, [0.5, 0.95]),
            holes: count(|truth, cut| truth && !cut) / count(|truth, _| truth).max(1.0),
            false_fills: count(|truth, cut| cut && !truth) / count(|_, cut| cut).max(1.0),
        }
    }
}
