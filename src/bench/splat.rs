//! `bench splat`: round points against one-pixel points that cover as many pixels.
//!
//! The scene is a wall with random points. With splats of a given diameter it has as many as cover
//! `COVERED` of the picture; with one-pixel points, as many as cover the same. All ways are
//! interleaved round by round on the same device. Times are of all passes of the frame.

use super::quartiles;
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::error::Result;
use crate::gpu::DeviceOptions;
use crate::graph::{Gpu, Graph, Handle};
use crate::passes::Switch;
use crate::passes::splat::PointSize;
use crate::progress::Progress;
use crate::render::frame;
use crate::render::settings::{FrameConfig, RenderSettings, Style};
use crate::resident::Resident;
use crate::view::View;
use serde::Serialize;
use std::fmt::Write;

/// Options of the benchmark.
pub struct Plan {
    pub size: [u32; 2],
    pub repeat: usize,
    pub seed: u64,
}

/// Splats of a diameter, and points that cover as much.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    pub bench: &'static str,
    pub diameter_px: f64,
    pub size: String,
    /// Numbers of points, and shares of the picture that they cover: of splats and of one-pixel
    /// points.
    pub points: [u64; 2],
    pub covered: [f64; 2],
    /// Medians of whole frames `[ms]`, likewise.
    pub ms: [f64; 2],
    pub ms_q1: [f64; 2],
    pub ms_q3: [f64; 2],
    /// Time of splats in times of points, between medians.
    pub ratio: f64,
    /// The target.
    pub target: f64,
    pub device: String,
    pub driver: String,
}

/// Share of the picture that is covered.
const COVERED: f64 = 0.9;

/// Diameters of splats `[px]`.
const DIAMETERS: [f64; 4] = [3.0, 5.0, 9.0, 17.0];

pub fn run(options: &DeviceOptions, plan: &Plan, progress: &dyn Progress) -> Result<Vec<Row>> {
    let mut gpu = Gpu::open(options)?;
    let view = View::new(super::surface::camera(plan.size), plan.size)?;
    let pixels = plan.size[0] as f64 * plan.size[1] as f64;
    // Random discs of an area leave exp(-area density) of the picture.
    let open = -(1.0 - COVERED).ln();
    let mut ways = Vec::new();
    for diameter in DIAMETERS {
        let area = disc(diameter);
        for (density, diameter) in [(open / area, Some(diameter)), (open, None)] {
            let count = (density * pixels) as u64;
            let cloud = super::surface::wall(&[0], count, plan.size, plan.seed);
            let shown = DisplayAttribute::new(Attribute::White, &cloud);
            let resident = Resident::fill(&mut gpu, cloud, shown, progress)?;
            ways.push((resident, diameter, Vec::new(), 0.0));
        }
    }
    // The first round warms up.
    for round in 0..=plan.repeat {
        progress.tick("bench splat", round as u64, plan.repeat as u64)?;
        for (resident, diameter, times, covered) in &mut ways {
            let (ms, share) = draw(&mut gpu, &view, resident, *diameter)?;
            *covered = share;
            if round > 0 {
                times.push(ms);
            }
        }
    }
    let row = |(pair, diameter_px): (&mut [Way], f64)| {
        let [splats, points] = pair else { unreachable!("two ways a diameter") };
        let [of_splats, of_points] = [&mut splats.2, &mut points.2].map(|times| quartiles(times));
        let quartile = |k: usize| [of_splats[k], of_points[k]];
        Row {
            bench: "splat",
            diameter_px,
            size: format!("{}x{}", plan.size[0], plan.size[1]),
            points: [splats.0.points, points.0.points],
            covered: [splats.3, points.3],
            ms: quartile(1),
            ms_q1: quartile(0),
            ms_q3: quartile(2),
            ratio: of_splats[1] / of_points[1],
            target: 2.0,
            device: gpu.device.name.clone(),
            driver: gpu.device.driver.clone(),
        }
    };
    Ok(ways.chunks_mut(2).zip(DIAMETERS).map(row).collect())
}

/// Points, diameter of their splats, times `[ms]`, and the share that they covered.
type Way = (Resident, Option<f64>, Vec<f64>, f64);

/// Returns the pixels of a disc.
fn disc(diameter: f64) -> f64 {
    let radius = (diameter / 2.0) as i64;
    let inside = |x: i64, y: i64| ((x * x + y * y) as f64) <= diameter * diameter / 4.0;
    let count = (-radius..=radius)
        .flat_map(|y| (-radius..=radius).map(move |x| (x, y)))
        .filter(|&(x, y)| inside(x, y))
        .count();
    count as f64
}

/// Returns the time of a frame `[ms]` and the share of its pixels that show a point.
fn draw(
    gpu: &mut Gpu,
    view: &View,
    resident: &Resident,
    diameter: Option<f64>,
) -> Result<(f64, f64)> {
    let mut settings = RenderSettings::points();
    settings.effects.edl.switch = Switch::Off;
    if let Some(diameter) = diameter {
        settings.effects.set_style(Style::Splats);
        settings.effects.edl.switch = Switch::Off;
        settings.effects.splat.settings.set_size(PointSize::Pixels(diameter));
    }
    let config = FrameConfig::new(&settings, view, resident);
    let mut g = Graph::new(gpu);
    let outcome = frame::record(&mut g, view, resident, &config)?;
    let wanted = [outcome.gbuffer.depth.resource(), outcome.picture.resource()];
    let depth = g.download(&outcome.gbuffer.depth);
    let frame = g.submit_and_wait(&wanted)?;
    let depth: &[f32] = frame.read(&depth);
    let shown = depth.iter().filter(|z| z.is_finite()).count();
    let is_counted = |name: &str| !name.starts_with("copy ");
    let ms = frame.passes.iter().filter(|(name, _)| is_counted(name)).map(|(_, ms)| ms).sum();
    Ok((ms, shown as f64 / depth.len() as f64))
}

pub fn table(rows: &[Row]) -> String {
    let mut text = format!(
        "{:>8} {:>10} {:>20} {:>15} {:>20} {:>8} {:>8}\n",
        "diameter", "size", "points", "covered", "ms", "ratio", "at most"
    );
    for row in rows {
        let [of_splats, of_points] = row.points;
        writeln!(
            text,
            "{:>5} px {:>10} {of_splats:>9} {of_points:>10} {:>6.1} % {:>4.1} % {:>9.2} {:>10.2} {:>8.2} {:>8.0}",
            row.diameter_px,
            row.size,
            100.0 * row.covered[0],
            100.0 * row.covered[1],
            row.ms[0],
            row.ms[1],
            row.ratio,
            row.target,
        )
        .expect("writing to a string");
    }
    if let Some(row) = rows.first() {
        writeln!(text, "splats, then points; device: {} ({})", row.device, row.driver)
            .expect("writing to a string");
    }
    text
}
