//! Study `zoom`: changes between frames of a surface that grows (guide: numerics, case 31).
//!
//! The focal length grows to four times in steps so small that nothing moves by more than 0.1 px a
//! frame. All changes are therefore due to methods: levels that begin to act, and fillings that
//! take turns. The parameter is the surface; the error is FLIP between consecutive frames over what
//! either covers: maximum and median. Points alone flicker too, whenever they cross into another
//! pixel.

use super::configurations::AUTO;
use super::flip::{PIXELS_PER_DEGREE, Seen};
use super::lod::covered;
use super::popping::{STEP_PX, mean_flip};
use super::report::{self, Section, Table};
use super::surface::render_settings;
use super::{Plan, mark_fronts, metrics, rows, white};
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::error::Result;
use crate::graph::{Gpu, Graph};
use crate::progress::Progress;
use crate::render::frame;
use crate::render::settings::{FrameConfig, RenderSettings};
use crate::resident::Resident;
use crate::synth;
use crate::view::{Camera, Preset, View};
use glam::DVec3;

pub const SUMMARY: &str = "change from frame to frame while the picture grows";

/// Name and settings. For `fixed` nothing depends on the point spacing on the screen.
const STYLES: [(&str, &[&str]); 3] = [
    ("auto", &["visibility=auto", "fill=auto"]),
    ("fixed", &["visibility=auto,levels=1,kernel=15,threshold=2.1", "fill=auto,method=pullpush"]),
    ("points", &["visibility=off", "fill=off", "shape=off"]),
];

const METRICS: [&str; 2] = ["flip_max", "flip_median"];

/// Point spacing at the beginning `[px]`; four times as much at the end.
const APART_PX: f64 = 1.0;

/// Final width of the view relative to the first.
const NEARER: f64 = 0.25;

pub fn run(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    let scene = synth::SceneKind::Torus;
    let styles = STYLES
        .iter()
        .map(|(name, settings)| Ok((*name, render_settings(settings)?)))
        .collect::<Result<Vec<_>>>()?;
    // The number of points gives this spacing in the first frame, for any picture size.
    let pilot = synth::collect(
        "torus",
        &synth::build(scene, plan.seed, 0.0),
        5000,
        plan.seed,
        0.0,
        progress,
    )?;
    let part = &pilot.parts[0];
    let places: Vec<DVec3> = (0..part.columns.len())
        .map(|i| {
            part.lattice
                .world([part.columns.x[i], part.columns.y[i], part.columns.z[i]].map(i64::from))
        })
        .collect();
    let camera = Camera::framing(Preset::Fit, &places, plan.size);
    let view = View::new(camera, plan.size)?;
    let apart = white(gpu, &pilot, progress)?;
    let pilot_px = crate::resident::PointDensity::of(&apart, &view).spacing_px();
    let count = (5000.0 * (pilot_px / APART_PX).powi(2)).max(1.0) as u64;
    let cloud = synth::collect(
        "torus",
        &synth::build(scene, plan.seed, 0.0),
        count,
        plan.seed,
        0.0,
        progress,
    )?;
    let resident = Resident::fill(
        gpu,
        cloud.clone(),
        DisplayAttribute::new(Attribute::Rgb, &cloud),
        progress,
    )?;

    let shrink = 1.0 - STEP_PX / (plan.size[0] as f64 / 2.0);
    let frames = (NEARER.ln() / shrink.ln()).ceil() as usize;
    let mut all = Vec::new();
    let head = ["surface", "largest FLIP", "at frame", "median"].map(String::from).to_vec();
    let mut table =
        Table { title: format!("{frames} frames, {count} points"), head, rows: Vec::new() };
    for (style, settings) in &styles {
        let mut before: Option<(Seen, Vec<bool>)> = None;
        let [mut flips, mut times] = [const { Vec::new() }; 2];
        for number in 0..frames {
            progress.tick("study zoom", number as u64, frames as u64)?;
            let half = (camera.fov_y.to_radians() / 2.0).tan() * shrink.powi(number as i32);
            let view =
                View::new(Camera { fov_y: 2.0 * half.atan().to_degrees(), ..camera }, plan.size)?;
            let (seen, ms) = draw(gpu, &view, &resident, settings)?;
            flips.extend(before.as_ref().map(|before| mean_flip(before, &seen)));
            times.push(ms);
            before = Some(seen);
        }
        let (at, max) = flips
            .iter()
            .copied()
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or_default();
        let median = metrics::quartiles(&flips)[1];
        let line =
            vec![style.to_string(), format!("{max:.4}"), at.to_string(), format!("{median:.4}")];
        progress.note(&line.join("  "));
        table.rows.push(line);
        let parameter = if *style == AUTO { AUTO } else { "surface" };
        all.extend(rows(["torus", "zoom"], [parameter, style], METRICS, &[max, median], &times));
    }
    mark_fronts(&mut all);
    let charts = METRICS.map(|metric| {
        let title = format!("{}, FLIP from frame to frame", metric.trim_start_matches("flip_"));
        let axes = ["milliseconds of a frame", "mean FLIP from frame to frame"];
        report::chart(metric, axes, &title, &all, &|row| row.value.clone())
    });
    let method = format!(
        "A torus whose points lie {APART_PX} px apart at first, and {} px at last; {STEP_PX} px a frame. <em>fixed</em> is one level and one filling, whatever the distance.",
        APART_PX / NEARER
    );
    Ok(Section {
        name: "zoom",
        title: "From frame to frame".into(),
        method,
        rows: all,
        charts: charts.into(),
        tables: vec![table],
    })
}

/// Returns the picture, its coverage, and the device time of all passes `[ms]`.
fn draw(
    gpu: &mut Gpu,
    view: &View,
    resident: &Resident,
    settings: &RenderSettings,
) -> Result<((Seen, Vec<bool>), f64)> {
    let config = FrameConfig::new(settings, view, resident);
    let mut g = Graph::new(gpu);
    let outcome = frame::record(&mut g, view, resident, &config)?;
    let (picture, depth) = (g.download(&outcome.picture), g.download(&outcome.gbuffer.depth));
    let frame = g.submit_and_wait(&[])?;
    let seen = Seen::new(frame.read(&picture), view.size, PIXELS_PER_DEGREE);
    let covered = covered(frame.read(&depth));
    let ms = frame.ms("");
    Ok(((seen, covered), ms))
}
