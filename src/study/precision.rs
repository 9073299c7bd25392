//! Study `precision`: bits of position against error and time.
//!
//! The parameter is the number of planes, ten bits per axis each, read of every node: 10, 20, all,
//! or as `auto` chooses. A pixel names its point and its depth, and the file has the point's
//! position in f64. A pixel's error is how far outside of the pixel the point lies (0 if inside),
//! and the difference between its depth and the point's. The reference is the scan itself, neither
//! the renderer nor the analytic scene: noise is not an error of precision. One metric is against
//! the renderer's own picture at full precision: the share of pixels that show another point.

use super::metrics::{self, Errors};
use super::oracle::points::Points;
use super::report::{self, Section, Table};
use super::{Plan, Row, mark_fronts, sweep, white};
use crate::config::NO_POINT;
use crate::error::Result;
use crate::graph::{Gpu, Graph};
use crate::passes::Switch;
use crate::passes::project::{Precision, Statistics};
use crate::progress::Progress;
use crate::render::frame;
use crate::render::settings::{FrameConfig, RenderSettings};
use crate::resident::Resident;
use crate::synth::{self, SceneKind, World};
use crate::view::{Camera, Projection, View};
use glam::DVec3;
use rayon::prelude::*;

pub const SUMMARY: &str = "bits of position, against error in pixels and metres";

const SCENES: [(&str, SceneKind); 3] =
    [("sphere", SceneKind::Sphere), ("street", SceneKind::Street), ("terrain", SceneKind::Terrain)];

const SETTINGS: [(&str, Precision); 4] = [
    ("10", Precision::Planes(1)),
    ("20", Precision::Planes(2)),
    ("all", Precision::Planes(3)),
    ("auto", Precision::Auto),
];

/// Index of the setting that pictures are compared with.
const FULL: usize = 2;

/// A survey's offset, where f32 coordinates would fail.
pub(super) const UTM: DVec3 = DVec3::new(500_000.0, 5_000_000.0, 100.0);

/// Metric, its unit for axes, and its description.
const METRICS: [(&str, &str, &str); 6] = [
    (
        "px_max",
        "largest error, pixels",
        "Pixels: the point farthest outside of the pixel that shows it",
    ),
    ("px_rms", "RMS error, pixels", "Pixels: root mean square over all drawn pixels"),
    ("m_max", "largest error of depth, metres", "Metres: the largest error of depth"),
    ("m_rms", "RMS error of depth, metres", "Metres: root mean square error of depth"),
    (
        "index_share",
        "share of pixels with another point",
        "Pixels that show another point than at full precision",
    ),
    (
        "bytes_read",
        "bytes of positions read",
        "Bytes: position planes read of all drawn nodes, which is a cost, not an error",
    ),
];

pub fn run(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    let mut rows = Vec::new();
    let mut counters = Table {
        title: "What was read, and how long projecting took".into(),
        head: [
            "scene",
            "view",
            "bits",
            "points drawn",
            "MiB of positions read",
            "bytes a point",
            "quantised by at most, px",
            "ms (quartiles)",
        ]
        .map(String::from)
        .to_vec(),
        rows: Vec::new(),
    };
    for (done, (name, scene)) in SCENES.into_iter().enumerate() {
        progress.tick("study precision", done as u64, SCENES.len() as u64)?;
        let mut world = synth::build(scene, plan.seed, 0.0);
        world.offset = UTM;
        world.step = finest_step(&world);
        let cloud =
            synth::collect(name, &world, plan.points, plan.seed, scene.default_noise(), progress)?;
        let resident = white(gpu, &cloud, progress)?;
        let points = Points::new(&cloud.parts, &resident.nodes);
        for (view_name, camera) in cameras(&world) {
            let view = View::new(camera, plan.size)?;
            let drawings = SETTINGS
                .iter()
                .map(|(_, precision)| draw(gpu, &view, &resident, *precision))
                .collect::<Result<Vec<_>>>()?;
            let times = sweep::interleaved(&SETTINGS, plan.repeat, |(_, precision)| {
                progress.tick("study precision", done as u64, SCENES.len() as u64)?;
                Ok(draw(gpu, &view, &resident, *precision)?.ms)
            })?;
            for (i, (value, _)) in SETTINGS.iter().enumerate() {
                let ms = metrics::quartiles(&times[i]);
                let [px, metres] = truth(&view, &points, &drawings[i]);
                let index = index_share(&drawings[i], &drawings[FULL]);
                let bytes = drawings[i].statistics.position_bytes as f64;
                for (metric, error) in
                    METRICS.iter().zip([px.max, px.rms, metres.max, metres.rms, index, bytes])
                {
                    let (scene, view, metric, value) =
                        (name, view_name, metric.0, value.to_string());
                    rows.push(Row {
                        scene,
                        view,
                        parameter: "bits",
                        value,
                        metric,
                        error,
                        ms,
                        n: times[i].len(),
                        auto: SETTINGS[i].0 == "auto",
                        front: false,
                    });
                }
                counters.rows.push(counted(name, view_name, value, &drawings[i].statistics, ms));
            }
        }
    }
    mark_fronts(&mut rows);
    let label = |row: &Row| {
        if row.value.parse::<u32>().is_ok() {
            format!("{} bits", row.value)
        } else {
            row.value.clone()
        }
    };
    let chart = |&(metric, y_axis, caption): &_| {
        report::chart(metric, ["milliseconds to project", y_axis], caption, &rows, &label)
    };
    let charts = METRICS.iter().map(chart).collect();
    let method = format!(
        "{} points a scene at E 500 km, N 5000 km, drawn at {} x {} pixels; n = {} interleaved rounds after one that is not counted. Errors are those of what was drawn: \
         every pixel names its point and depth, and the scan says in f64 where that point is. A pixel's error is how far outside of the pixel its point truly lies. Errors \
         of about 1e-4 px and 1e-7 of the depth are those of 32-bit arithmetic, which no number of bits removes. Only <em>pixels that show another point</em> compares with the \
         renderer's own picture at full precision, so there <em>all</em> is 0 by definition.",
        plan.points, plan.size[0], plan.size[1], plan.repeat
    );
    Ok(Section {
        name: "precision",
        title: "Bits of position".into(),
        method,
        rows,
        charts,
        tables: vec![counters],
    })
}

/// Returns the finest step of floating-point files: less than 2^30 steps across. A millimetre
/// lattice needs at most 20 bits per node.
pub(super) fn finest_step(world: &World) -> f64 {
    let bounds = world.bounds();
    let reach = bounds.min.abs().max(bounds.max.abs()).max_element() + 1.0;
    2f64.powi((2.0 * reach).log2().ceil() as i32 - 30)
}

/// Returns cameras at four times the distance of the scene's own, at that distance, and at a
/// fortieth of it.
pub(super) fn cameras(world: &World) -> [(&'static str, Camera); 3] {
    let viewpoint = world.camera();
    let camera = |eye, target| Camera {
        eye,
        target,
        up: DVec3::Z,
        fov_y: viewpoint.fov_y,
        projection: Projection::Perspective,
        ortho_height: None,
    };
    let back = viewpoint.eye - viewpoint.target;
    let hit = world
        .trace(viewpoint.eye - world.offset, -back)
        .map_or(viewpoint.target, |hit| hit.point + world.offset);
    [
        ("far", camera(viewpoint.target + back * 4.0, viewpoint.target)),
        ("near", camera(viewpoint.eye, viewpoint.target)),
        ("close-up", camera(hit + (viewpoint.eye - hit) / 40.0, hit)),
    ]
}

struct Drawing {
    depth: Vec<f32>,
    index: Vec<u32>,
    statistics: Statistics,
    /// Time of projecting alone `[ms]`: nothing else depends on the parameter.
    ms: f64,
}

fn draw(gpu: &mut Gpu, view: &View, resident: &Resident, precision: Precision) -> Result<Drawing> {
    let mut settings = RenderSettings { precision, ..RenderSettings::points() };
    settings.effects.edl.switch = Switch::Off;
    let config = FrameConfig::new(&settings, view, resident);
    let mut g = Graph::new(gpu);
    let outcome = frame::record(&mut g, view, resident, &config)?;
    let (depth, index) = (g.download(&outcome.gbuffer.depth), g.download(&outcome.gbuffer.index));
    let frame = g.submit_and_wait(&[])?;
    let drawing = Drawing {
        depth: frame.read(&depth).to_vec(),
        index: frame.read(&index).to_vec(),
        statistics: outcome.statistics,
        ms: frame.ms("project"),
    };
    Ok(drawing)
}

/// Returns the errors of drawn pixels against the true positions of their points: in pixels, and of
/// depth in metres.
fn truth(view: &View, points: &Points, drawing: &Drawing) -> [Errors; 2] {
    let [width, height] = view.size.map(|side| side as f64);
    let f = view.focal_px();
    let pixel = |(i, (&id, &depth)): (usize, (&u32, &f32))| {
        let v = points.relative(id, view.camera.eye);
        let z = v.dot(view.basis.forward);
        let at = [
            v.dot(view.basis.right) * f / z + width / 2.0,
            -v.dot(view.basis.up) * f / z + height / 2.0,
        ];
        let corner = [(i % view.size[0] as usize) as f64, (i / view.size[0] as usize) as f64];
        let outside =
            |axis: usize| (corner[axis] - at[axis]).max(at[axis] - corner[axis] - 1.0).max(0.0);
        (outside(0).hypot(outside(1)), (depth as f64 - z).abs())
    };
    let drawn = drawing
        .index
        .par_iter()
        .zip(&drawing.depth)
        .enumerate()
        .filter(|(_, (id, _))| **id != NO_POINT);
    let errors: Vec<(f64, f64)> = drawn.map(pixel).collect();
    [metrics::errors(errors.iter().map(|e| e.0)), metrics::errors(errors.iter().map(|e| e.1))]
}

/// Returns the share of covered pixels that show another point.
fn index_share(drawing: &Drawing, full: &Drawing) -> f64 {
    let pairs = || {
        drawing.index.iter().zip(&full.index).filter(|(a, b)| **a != NO_POINT || **b != NO_POINT)
    };
    pairs().filter(|(a, b)| a != b).count() as f64 / pairs().count().max(1) as f64
}

fn counted(scene: &str, view: &str, value: &str, s: &Statistics, ms: [f64; 3]) -> Vec<String> {
    let bytes = s.position_bytes as f64;
    vec![
        scene.into(),
        view.into(),
        value.into(),
        s.points_drawn.to_string(),
        format!("{:.2}", bytes / (1 << 20) as f64),
        format!("{:.1}", bytes / s.points_drawn.max(1) as f64),
        if s.quantisation_px == 0.0 { "0".into() } else { format!("{:.1e}", s.quantisation_px) },
        format!("{:.2} ({:.2} to {:.2})", ms[1], ms[0], ms[2]),
    ]
}
