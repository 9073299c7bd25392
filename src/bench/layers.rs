//! `bench layers`: the cost of layers and shadows relative to local illumination. Rows and columns
//! are those of table 3 of Dobrev, Rosenthal and Linsen 2010, as times and as multiples of the
//! first row, round by round.
//!
//! Every filter of the surface runs once, like in the paper. Shadows are cast anew in every frame,
//! by a light that moves a little. All ways are interleaved round by round on the same device;
//! times are of all passes of a frame.

use super::quartiles;
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::cloud::{self, Cloud, ReadOptions};
use crate::error::Result;
use crate::gpu::DeviceOptions;
use crate::graph::{Gpu, Graph, Handle};
use crate::passes::Effects;
use crate::progress::Progress;
use crate::render::frame;
use crate::render::settings::{FrameConfig, RenderSettings, Style};
use crate::resident::Resident;
use crate::select::opacity::{Opacities, Rule, What};
use crate::synth;
use crate::view::light::Light;
use crate::view::{Camera, Preset, View};
use glam::DVec3;
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;

/// Options of the benchmark.
pub struct Plan {
    /// Points of the nested tori.
    pub points: u64,
    /// Further clouds.
    pub models: Vec<PathBuf>,
    pub sizes: Vec<[u32; 2]>,
    pub repeat: usize,
    pub seed: u64,
}

/// The times of one way.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    pub bench: &'static str,
    pub cloud: String,
    pub points: u64,
    pub way: &'static str,
    pub size: String,
    pub ms_median: f64,
    pub ms_q1: f64,
    pub ms_q3: f64,
    /// Multiples of local illumination in the same round, which are robust against changes of the
    /// machine's speed: median and quartiles of all rounds.
    pub ratio_median: f64,
    pub ratio_q1: f64,
    pub ratio_q3: f64,
    /// The same in the paper for its nested tori, or for its dragon for other clouds, at 512 x 512
    /// and 1024 x 1024.
    pub paper: [f64; 2],
    pub device: String,
    pub driver: String,
}

struct Way {
    name: &'static str,
    layers: u32,
    samples: u32,
    /// Frames per second in the paper: nested tori, and dragon.
    paper: [[f64; 2]; 2],
}

const WAYS: [Way; 6] = [
    Way { name: "local", layers: 1, samples: 0, paper: [[8.0, 8.0], [103.0, 68.0]] },
    Way { name: "3 layers", layers: 3, samples: 0, paper: [[2.7, 2.7], [35.0, 23.0]] },
    Way { name: "6 layers", layers: 6, samples: 0, paper: [[1.4, 1.4], [18.0, 12.0]] },
    Way { name: "1 sample", layers: 1, samples: 1, paper: [[4.0, 3.7], [50.0, 49.0]] },
    Way { name: "5 samples", layers: 1, samples: 5, paper: [[1.3, 1.1], [18.0, 17.0]] },
    Way { name: "10 samples", layers: 1, samples: 10, paper: [[0.6, 0.6], [9.6, 9.0]] },
];

const SURFACE: [&str; 6] = [
    "visibility=off",
    "fill=on,method=mask,iterations=1",
    "smooth=on",
    "shape=off",
    "phong=on",
    "antialias=on",
];

pub fn run(options: &DeviceOptions, plan: &Plan, progress: &dyn Progress) -> Result<Vec<Row>> {
    let mut gpu = Gpu::open(options)?;
    let mut rows = Vec::new();
    let world = synth::build(synth::SceneKind::NestedTori, plan.seed, 0.0);
    let tori = synth::collect("nested tori", &world, plan.points, plan.seed, 0.0, progress)?;
    rows.extend(of(&mut gpu, "nested tori", tori, 0, plan, progress)?);
    for path in &plan.models {
        let cloud = cloud::read(std::slice::from_ref(path), &ReadOptions::default(), progress)?;
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        rows.extend(of(&mut gpu, &name, cloud, 1, plan, progress)?);
    }
    Ok(rows)
}

fn of(
    gpu: &mut Gpu,
    name: &str,
    cloud: Cloud,
    paper: usize,
    plan: &Plan,
    progress: &dyn Progress,
) -> Result<Vec<Row>> {
    let (points, core) = (cloud.len(), cloud.core_points());
    let shown = DisplayAttribute::new(Attribute::White, &cloud);
    let mut resident = Resident::fill(gpu, cloud, shown, progress)?;
    let mut rows = Vec::new();
    for &size in &plan.sizes {
        let view = View::new(Camera::framing(Preset::Fit, &core, size), size)?;
        let mut times = vec![Vec::new(); WAYS.len()];
        // The first round warms up.
        for round in 0..=plan.repeat {
            progress.tick("bench layers", round as u64, plan.repeat as u64)?;
            for (way, times) in WAYS.iter().zip(&mut times) {
                let ms = draw(gpu, &view, &mut resident, way, round)?;
                times.extend((round > 0).then_some(ms));
            }
        }
        let local = &times[0];
        let quartiles = times.iter().map(|times| {
            let ratios = times.iter().zip(local).map(|(ms, local)| ms / local);
            [quartiles(&mut times.clone()), quartiles(&mut ratios.collect::<Vec<_>>())]
        });
        let row = |(way, [[ms_q1, ms_median, ms_q3], [ratio_q1, ratio_median, ratio_q3]]): (
            &Way,
            [[f64; 3]; 2],
        )| Row {
            bench: "layers",
            cloud: name.into(),
            points,
            way: way.name,
            size: format!("{}x{}", size[0], size[1]),
            ms_median,
            ms_q1,
            ms_q3,
            ratio_median,
            ratio_q1,
            ratio_q3,
            paper: [0, 1].map(|column| WAYS[0].paper[paper][column] / way.paper[paper][column]),
            device: gpu.device.name.clone(),
            driver: gpu.device.driver.clone(),
        };
        rows.extend(WAYS.iter().zip(quartiles).map(row));
    }
    Ok(rows)
}

/// Returns the time of all passes of a frame `[ms]`.
fn draw(
    gpu: &mut Gpu,
    view: &View,
    resident: &mut Resident,
    way: &Way,
    round: usize,
) -> Result<f64> {
    let opacity = if way.layers > 1 { 0.5 } else { 1.0 };
    resident.opacities = Opacities(vec![Rule { what: What::All, opacity }]);
    // Never the same light twice, so that no shadows are cached.
    let mut settings = RenderSettings {
        light: Light::Direction(DVec3::new(0.5, 0.7, -0.8 - 1e-3 * round as f64)),
        effects: Effects::of(Style::Surface),
        ..RenderSettings::default()
    };
    let transparency = format!("transparency=auto,layers={}", way.layers);
    let shadows = format!(
        "shadows={},samples={},radius=2",
        if way.samples > 0 { "on" } else { "off" },
        way.samples.max(1)
    );
    let effects = SURFACE.into_iter().chain([transparency.as_str(), shadows.as_str()]);
    effects.for_each(|effect| settings.effects.set_any(effect).expect("constants above"));
    let config = FrameConfig::new(&settings, view, resident);
    let mut g = Graph::new(gpu);
    let outcome = frame::record(&mut g, view, resident, &config)?;
    let frame = g.submit_and_wait(&[outcome.picture.resource()])?;
    let ms = frame.passes.iter().map(|(_, ms)| ms).sum();
    Ok(ms)
}

pub fn table(rows: &[Row]) -> String {
    let mut text = format!(
        "{:<20} {:>10} {:>10} {:<10} {:>10} {:>10} {:>10} {:>8} {:>6} {:>6} {:>14}\n",
        "cloud", "points", "size", "way", "ms", "q1", "q3", "ratio", "q1", "q3", "in the paper"
    );
    for row in rows {
        let paper = format!(
            "{:.2} to {:.2}",
            row.paper[0].min(row.paper[1]),
            row.paper[0].max(row.paper[1])
        );
        writeln!(
            text,
            "{:<20} {:>10} {:>10} {:<10} {:>10.2} {:>10.2} {:>10.2} {:>8.2} {:>6.2} {:>6.2} {:>14}",
            row.cloud,
            row.points,
            row.size,
            row.way,
            row.ms_median,
            row.ms_q1,
            row.ms_q3,
            row.ratio_median,
            row.ratio_q1,
            row.ratio_q3,
            paper
        )
        .expect("writing to a string");
    }
    if let Some(row) = rows.first() {
        writeln!(text, "device: {} ({})", row.device, row.driver).expect("writing to a string");
    }
    text
}
