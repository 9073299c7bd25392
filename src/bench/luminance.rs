//! `bench luminance`: the cost of luminance correction per frame, as in Table 1 of Kanzok, Linsen
//! and Rosenthal 2012, whose frames took 1.75 to 2 times as long with it.
//!
//! A street is scanned from five stations and drawn along it as a surface with defaults. With and
//! without are interleaved round by round; times are those of all passes of a frame.

use super::quartiles;
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::error::Result;
use crate::gpu::DeviceOptions;
use crate::graph::{Gpu, Graph, Handle};
use crate::passes::Switch;
use crate::progress::Progress;
use crate::render::frame;
use crate::render::settings::{FrameConfig, RenderSettings};
use crate::resident::Resident;
use crate::synth;
use crate::view::{Camera, Projection, View};
use glam::DVec3;
use serde::Serialize;
use std::fmt::Write;

/// Options of the benchmark.
pub struct Plan {
    pub points: Vec<u64>,
    pub size: [u32; 2],
    pub repeat: usize,
    pub seed: u64,
}

/// The results for one number of points.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    pub bench: &'static str,
    pub points: u64,
    pub size: String,
    /// Median of a frame `[ms]`.
    pub without_ms: f64,
    pub with_ms: f64,
    /// Time of the luminance passes, and of the walk that finds the front `[ms]`.
    pub luminance_ms: f64,
    pub project_ms: f64,
    /// Share of frames per second lost.
    pub lost: f64,
    /// The target for that share, and its value in the paper.
    pub target: f64,
    pub paper: f64,
    pub device: String,
    pub driver: String,
}

/// The paper's values for 1, 4, 16 and 64 million points.
const PAPER: [(u64, f64); 4] = [
    (1_000_000, 1.0 - 80.0 / 140.0),
    (4_000_000, 1.0 - 40.0 / 75.0),
    (16_000_000, 1.0 - 10.0 / 19.0),
    (64_000_000, 1.0 - 2.5 / 5.0),
];

pub fn run(options: &DeviceOptions, plan: &Plan, progress: &dyn Progress) -> Result<Vec<Row>> {
    let mut gpu = Gpu::open(options)?;
    let world = synth::build(synth::SceneKind::Street, plan.seed, 0.0);
    let viewpoint = world.camera();
    let camera = Camera {
        eye: viewpoint.eye,
        target: viewpoint.target,
        up: DVec3::Z,
        fov_y: viewpoint.fov_y,
        projection: Projection::Perspective,
        ortho_height: None,
    };
    let view = View::new(camera, plan.size)?;
    let ways = [Switch::Off, Switch::On].map(|switch| {
        let mut settings = RenderSettings::default();
        settings.effects.luminance.switch = switch;
        settings
    });
    let mut rows = Vec::new();
    for &points in &plan.points {
        let cloud = synth::collect(
            "street",
            &world,
            points,
            plan.seed,
            synth::SceneKind::Street.default_noise(),
            progress,
        )?;
        let shown = DisplayAttribute::new(Attribute::Rgb, &cloud);
        let resident = Resident::fill(&mut gpu, cloud, shown, progress)?;
        let mut times: [Vec<f64>; 4] = Default::default();
        // The first round warms up.
        for round in 0..=plan.repeat {
            progress.tick("bench luminance", round as u64, plan.repeat as u64)?;
            let [without, with] = [
                draw(&mut gpu, &view, &resident, &ways[0])?,
                draw(&mut gpu, &view, &resident, &ways[1])?,
            ];
            if round > 0 {
                times
                    .iter_mut()
                    .zip([without[0], with[0], with[1], with[2]])
                    .for_each(|(times, ms)| times.push(ms));
            }
        }
        let [without_ms, with_ms, luminance_ms, project_ms] =
            times.map(|mut times| quartiles(&mut times)[1]);
        let paper =
            PAPER.iter().find(|(known, _)| *known == points).map_or(f64::NAN, |(_, lost)| *lost);
        let (device, driver) = (gpu.device.name.clone(), gpu.device.driver.clone());
        let size = format!("{}x{}", plan.size[0], plan.size[1]);
        let lost = 1.0 - without_ms / with_ms;
        rows.push(Row {
            bench: "luminance",
            points,
            size,
            without_ms,
            with_ms,
            luminance_ms,
            project_ms,
            lost,
            target: 0.25,
            paper,
            device,
            driver,
        });
    }
    Ok(rows)
}

/// Returns the time of all passes, of the luminance passes, and of projecting `[ms]`.
fn draw(
    gpu: &mut Gpu,
    view: &View,
    resident: &Resident,
    settings: &RenderSettings,
) -> Result<[f64; 3]> {
    let config = FrameConfig::new(settings, view, resident);
    let mut g = Graph::new(gpu);
    let picture = frame::record(&mut g, view, resident, &config)?.picture;
    let frame = g.submit_and_wait(&[picture.resource()])?;
    let ms = [frame.ms(""), frame.ms("luminance") + frame.ms("clear sums"), frame.ms("project")];
    Ok(ms)
}

pub fn table(rows: &[Row]) -> String {
    let mut table = format!(
        "{:>10}  {:>9}  {:>10}  {:>9}  {:>12}  {:>10}  {:>6}  {:>6}  {:>5}\n",
        "points",
        "size",
        "without ms",
        "with ms",
        "luminance ms",
        "project ms",
        "lost",
        "target",
        "paper"
    );
    for row in rows {
        let Row {
            points,
            size,
            without_ms,
            with_ms,
            luminance_ms,
            project_ms,
            lost,
            target,
            paper,
            ..
        } = row;
        writeln!(table, "{points:>10}  {size:>9}  {without_ms:>10.2}  {with_ms:>9.2}  {luminance_ms:>12.2}  {project_ms:>10.2}  {:>5.1}%  {:>5.0}%  {:>4.0}%", 100.0 * lost, 100.0 * target, 100.0 * paper).expect("into a string");
    }
    if let Some(row) = rows.first() {
        writeln!(table, "{} ({})", row.device, row.driver).expect("into a string");
    }
    table
}
