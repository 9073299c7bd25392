//! `bench strokes`: the cost of strokes relative to plain points of the same cloud (dos Anjos et
//! al. 2018, table 2).
//!
//! Clouds are a torus without colour, three tori and streets with colour, and files. First the
//! one-time work: neighbours, radii, normals, clusters, and the upload; wall-clock time. Then
//! pictures, all ways interleaved round by round on the same device: `points`, a pixel each;
//! `opaque`, z-buffered strokes; `blur`, the same softened; `abuffer`, all strokes blended. Times
//! are wall-clock times until the picture is complete: once lavapipe has rasterised, its timestamps
//! are no longer valid.

use super::quartiles;
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::cloud::{self, Cloud, ReadOptions};
use crate::error::Result;
use crate::gpu::DeviceOptions;
use crate::graph::{Gpu, Graph};
use crate::passes::Effects;
use crate::progress::Progress;
use crate::render::frame;
use crate::render::settings::{FrameConfig, RenderSettings, Style};
use crate::resident::Resident;
use crate::synth::{self, SceneKind};
use crate::view::{Camera, Preset, View};
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;
use std::time::Instant;

/// Options of the benchmark.
pub struct Plan {
    /// Points of streets; the torus has as many as the dragon of the paper, the tori as the three
    /// models it draws together.
    pub points: Vec<u64>,
    pub models: Vec<PathBuf>,
    pub sizes: Vec<[u32; 2]>,
    pub repeat: usize,
    pub seed: u64,
}

const TORUS_POINTS: u64 = 437_645;
const TORI_POINTS: u64 = 1_500_000;

/// Larger clouds take minutes per round on a software device: they have one round without warm-up,
/// since smaller clouds have warmed up the kernels.
const LARGE: u64 = 10_000_000;

/// The times of one way.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    pub bench: &'static str,
    pub scene: String,
    pub points: u64,
    pub way: &'static str,
    pub size: String,
    pub ms_median: f64,
    pub ms_q1: f64,
    pub ms_q3: f64,
    /// Number of rounds.
    pub rounds: usize,
    /// Multiples of plain points, between medians; 0 if not a picture.
    pub of_points: f64,
    /// Fragments of the A-buffer.
    pub fragments: u64,
    pub device: String,
    pub driver: String,
}

const WAYS: [(&str, Style, &str); 4] = [
    ("points", Style::Points, "strokes=off"),
    ("opaque", Style::Strokes, "strokes=on,blend=opaque"),
    ("blur", Style::Strokes, "strokes=on,blend=blur"),
    ("abuffer", Style::Strokes, "strokes=on,blend=abuffer"),
];

pub fn run(options: &DeviceOptions, plan: &Plan, progress: &dyn Progress) -> Result<Vec<Row>> {
    let mut gpu = Gpu::open(options)?;
    let mut rows = Vec::new();
    let scenes =
        [("torus", SceneKind::Torus, TORUS_POINTS), ("tori", SceneKind::NestedTori, TORI_POINTS)]
            .into_iter();
    for (name, scene, points) in
        scenes.chain(plan.points.iter().map(|&points| ("street", SceneKind::Street, points)))
    {
        let world = synth::build(scene, plan.seed, 0.0);
        let mut cloud =
            synth::collect(name, &world, points, plan.seed, scene.default_noise(), progress)?;
        if scene == SceneKind::Torus {
            cloud.parts.iter_mut().for_each(|part| part.columns.rgb = None);
        }
        rows.extend(of(&mut gpu, name, cloud, plan, progress)?);
    }
    for path in &plan.models {
        let cloud = cloud::read(
            std::slice::from_ref(path),
            &ReadOptions::new(Attribute::Rgb.wanted(), false),
            progress,
        )?;
        rows.extend(of(
            &mut gpu,
            &path.file_name().unwrap_or_default().to_string_lossy(),
            cloud,
            plan,
            progress,
        )?);
    }
    Ok(rows)
}

fn of(
    gpu: &mut Gpu,
    name: &str,
    cloud: Cloud,
    plan: &Plan,
    progress: &dyn Progress,
) -> Result<Vec<Row>> {
    let (points, sample) = (cloud.len(), cloud.core_points());
    let [device, driver] = [gpu.device.name.clone(), gpu.device.driver.clone()];
    let row = |way, size: &str, mut times: Vec<f64>, plain: Option<f64>, fragments| {
        let rounds = times.len();
        let [ms_q1, ms_median, ms_q3] = quartiles(&mut times);
        let of_points = plain.map_or(0.0, |plain| ms_median / plain);
        let (scene, size, device, driver) =
            (name.to_string(), size.to_string(), device.clone(), driver.clone());
        Row {
            bench: "strokes",
            scene,
            points,
            way,
            size,
            ms_median,
            ms_q1,
            ms_q3,
            rounds,
            of_points,
            fragments,
            device,
            driver,
        }
    };
    let attribute = if Attribute::Rgb.is_in(&cloud) { Attribute::Rgb } else { Attribute::White };
    let mut shown = DisplayAttribute::new(attribute, &cloud);
    shown.further.strokes = true;
    let start = Instant::now();
    let resident = Resident::fill(gpu, cloud, shown, progress)?;
    let mut rows = vec![row("prepare", "-", vec![start.elapsed().as_secs_f64() * 1e3], None, 0)];
    let (warming, rounds) = if points < LARGE { (1, plan.repeat) } else { (0, 1) };
    for &size in &plan.sizes {
        let view = View::new(Camera::framing(Preset::Fit, &sample, size), size)?;
        let mut times = vec![Vec::new(); WAYS.len()];
        let mut fragments = vec![0; WAYS.len()];
        for round in 0..warming + rounds {
            progress.tick(
                &format!("bench strokes {name}"),
                round as u64,
                (warming + rounds) as u64,
            )?;
            for (k, (_, style, effect)) in WAYS.iter().enumerate() {
                let (ms, count) = draw(gpu, &view, &resident, *style, effect)?;
                fragments[k] = count;
                if round >= warming {
                    times[k].push(ms);
                }
            }
        }
        let plain = quartiles(&mut times[0].clone())[1];
        let size = format!("{}x{}", size[0], size[1]);
        rows.extend(
            WAYS.iter()
                .zip(times)
                .zip(fragments)
                .map(|((way, times), fragments)| row(way.0, &size, times, Some(plain), fragments)),
        );
    }
    Ok(rows)
}

/// Returns milliseconds and fragments of the A-buffer.
fn draw(
    gpu: &mut Gpu,
    view: &View,
    resident: &Resident,
    style: Style,
    effect: &str,
) -> Result<(f64, u64)> {
    let mut settings = RenderSettings { effects: Effects::of(style), ..RenderSettings::default() };
    for effect in [effect, "edl=off"] {
        settings.effects.set_any(effect).expect("an effect's own words");
    }
    let config = FrameConfig::new(&settings, view, resident);
    let start = Instant::now();
    let mut g = Graph::new(gpu);
    let outcome = frame::record(&mut g, view, resident, &config)?;
    let picture = g.download(&outcome.picture);
    let frame = g.submit_and_wait(&[])?;
    assert!(!frame.read::<f32>(&picture).is_empty());
    let ms = start.elapsed().as_secs_f64() * 1e3;
    let facts = outcome.strokes.map(|painted| painted.facts).unwrap_or_default();
    Ok((ms, facts.fragments))
}

pub fn table(rows: &[Row]) -> String {
    let mut text = format!(
        "{:<24} {:>10}  {:<8} {:>10} {:>10} {:>10} {:>10} {:>6} {:>10} {:>12}\n",
        "scene", "points", "way", "size", "ms", "q1", "q3", "rounds", "x points", "fragments"
    );
    for row in rows {
        let times =
            if row.of_points > 0.0 { format!("{:.2}", row.of_points) } else { "-".to_string() };
        writeln!(
            text,
            "{:<24} {:>10}  {:<8} {:>10} {:>10.1} {:>10.1} {:>10.1} {:>6} {:>10} {:>12}",
            row.scene,
            row.points,
            row.way,
            row.size,
            row.ms_median,
            row.ms_q1,
            row.ms_q3,
            row.rounds,
            times,
            row.fragments
        )
        .expect("writing to a string");
    }
    if let Some(row) = rows.first() {
        writeln!(
            text,
            "device: {} ({}); prepare: {} threads",
            row.device,
            row.driver,
            rayon::current_num_threads()
        )
        .expect("writing to a string");
    }
    text
}
