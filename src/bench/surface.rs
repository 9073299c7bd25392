//! `bench surface`: the cost of turning points into a surface, in multiples of a plain 3 x 3 pass
//! over the same image.
//!
//! The scene is two walls, one behind the other. On a lattice with one point per pixel, the front
//! one keeps one point in six in some parts of the picture, so that the other shows through. Strewn
//! randomly, both are equally dense everywhere: the cost should not depend on the density. All ways
//! are interleaved round by round on the same device. Times are of these passes alone: projecting
//! and resolving are measured by `bench project`.

use super::quartiles;
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::cloud::{Cloud, Columns, Header, Lattice, Part};
use crate::error::Result;
use crate::gpu::DeviceOptions;
use crate::graph::{Dispatch, Gpu, Graph, Handle, Kind};
use crate::passes::Effects;
use crate::progress::Progress;
use crate::render::frame;
use crate::render::settings::{FrameConfig, RenderSettings, Style};
use crate::resident::Resident;
use crate::shader;
use crate::synth::noise::Random;
use crate::view::{Camera, Projection, View};
use glam::DVec3;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Options of the benchmark.
pub struct Plan {
    pub size: [u32; 2],
    pub repeat: usize,
    pub seed: u64,
}

/// The times of one way.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    pub bench: &'static str,
    pub way: &'static str,
    pub size: String,
    pub ms_median: f64,
    pub ms_q1: f64,
    pub ms_q3: f64,
    /// Multiples of the plain pass, between medians.
    pub plain_passes: f64,
    /// Times of its passes in the last round `[ms]`.
    pub passes: BTreeMap<String, f64>,
    /// The target in plain passes.
    pub target: f64,
    pub device: String,
    pub driver: String,
}

/// The scene.
#[derive(Clone, Copy, PartialEq)]
enum Walls {
    /// On a lattice, with this share of the picture sparse.
    Lattice(f64),
    /// This many random points of each wall per pixel.
    Strewn(f64),
}

/// Name, scene, effects, counted passes, and the target in plain passes (0: none).
type Way = (&'static str, Walls, &'static [&'static str], &'static [&'static str], f64);

const WAYS: [Way; 9] = [
    ("box_blur_reference", Walls::Lattice(0.0), &[], &["box_blur_reference"], 1.0),
    (
        "visibility",
        Walls::Lattice(1.0),
        &["visibility=on,levels=1,kernel=9,tiles=all", "fill=off", "shape=off"],
        &["pack_depth", "visibility"],
        9.0,
    ),
    (
        "fill",
        Walls::Lattice(1.0),
        &["visibility=on,levels=1,kernel=9", "fill=on,method=median,iterations=18", "shape=off"],
        &["fill_median"],
        18.0,
    ),
    ("dense", Walls::Lattice(0.0), CHAIN, SURFACE, 4.0),
    ("tenth", Walls::Lattice(0.1), CHAIN, SURFACE, 8.0),
    ("0.003/px", Walls::Strewn(0.003), CHAIN, SURFACE, 0.0),
    ("0.03/px", Walls::Strewn(0.03), CHAIN, SURFACE, 0.0),
    ("0.3/px", Walls::Strewn(0.3), CHAIN, SURFACE, 0.0),
    ("3/px", Walls::Strewn(3.0), CHAIN, SURFACE, 0.0),
];

const CHAIN: &[&str] = &["visibility=auto", "fill=auto", "shape=auto"];

/// All passes that turn points into a surface, with the buffers they clear.
const SURFACE: &[&str] = &[
    "pack_depth",
    "tile_classify",
    "depth_pyramid",
    "visibility_assign",
    "visibility",
    "visibility_apply",
    "fill_",
    "shape",
    "shape_unpack",
    "clear pyramid",
    "clear places",
    "clear lists",
    "clear empty",
    "clear counts",
    "clear no points",
    "clear decided",
    "clear led",
    "clear holes",
    "clear invisible",
    "clear candidates",
    "clear kernels",
    "clear steps",
    "clear rough",
    "clear wanted",
];

pub fn run(options: &DeviceOptions, plan: &Plan, progress: &dyn Progress) -> Result<Vec<Row>> {
    let mut gpu = Gpu::open(options)?;
    let view = View::new(camera(plan.size), plan.size)?;
    let mut residents = Vec::new();
    for (_, drawn, ..) in WAYS {
        if residents.iter().any(|(made, _)| *made == drawn) {
            continue;
        }
        let cloud = match drawn {
            Walls::Lattice(share) => walls(plan.size, share, plan.seed),
            Walls::Strewn(density) => strewn(plan.size, density, plan.seed),
        };
        let shown = DisplayAttribute::new(Attribute::White, &cloud);
        residents.push((drawn, Resident::fill(&mut gpu, cloud, shown, progress)?));
    }
    let mut times = vec![Vec::new(); WAYS.len()];
    let mut parts = vec![BTreeMap::new(); WAYS.len()];
    // The first round warms up.
    for round in 0..=plan.repeat {
        progress.tick("bench surface", round as u64, plan.repeat as u64)?;
        for (k, (_, drawn, effects, passes, _)) in WAYS.iter().enumerate() {
            let (_, resident) =
                residents.iter().find(|(other, _)| other == drawn).expect("made above");
            parts[k] = draw(&mut gpu, &view, resident, effects, passes)?;
            if round > 0 {
                times[k].push(parts[k].values().sum::<f64>());
            }
        }
    }
    let one = quartiles(&mut times[0].clone())[1];
    let row = |(((way, _, _, _, target), mut times), passes): (
        (Way, Vec<f64>),
        BTreeMap<String, f64>,
    )| {
        let [ms_q1, ms_median, ms_q3] = quartiles(&mut times);
        let (device, driver) = (gpu.device.name.clone(), gpu.device.driver.clone());
        let size = format!("{}x{}", plan.size[0], plan.size[1]);
        Row {
            bench: "surface",
            way,
            size,
            ms_median,
            ms_q1,
            ms_q3,
            plain_passes: ms_median / one,
            passes,
            target,
            device,
            driver,
        }
    };
    Ok(WAYS.into_iter().zip(times).zip(parts).map(row).collect())
}

/// Returns a camera in front of walls, with a unit a pixel.
pub(super) fn camera(size: [u32; 2]) -> Camera {
    let [width, height] = size.map(f64::from);
    Camera {
        eye: DVec3::new(width / 2.0, -1e5, height / 2.0),
        target: DVec3::new(width / 2.0, 0.0, height / 2.0),
        up: DVec3::Z,
        fov_y: 60.0,
        projection: Projection::Orthographic,
        ortho_height: Some(height),
    }
}

/// Returns the times of the counted passes by name `[ms]`.
fn draw(
    gpu: &mut Gpu,
    view: &View,
    resident: &Resident,
    effects: &[&str],
    passes: &[&str],
) -> Result<BTreeMap<String, f64>> {
    let mut settings =
        RenderSettings { effects: Effects::of(Style::Surface), ..RenderSettings::default() };
    effects.iter().for_each(|effect| settings.effects.set_any(effect).expect("a constant above"));
    let config = FrameConfig::new(&settings, view, resident);
    let mut g = Graph::new(gpu);
    let outcome = frame::record(&mut g, view, resident, &config)?;
    let mut wanted = vec![outcome.gbuffer.depth.resource(), outcome.picture.resource()];
    if passes == ["box_blur_reference"] {
        let mut mean = g.image("mean", view.size, Kind::R32f);
        g.run(
            shader::BoxBlurReference {
                depth: &outcome.gbuffer.depth,
                mean: &mut mean,
                push: shader::box_blur_reference::Push { size: view.size },
            },
            Dispatch::PerPixel,
        );
        wanted = vec![mean.resource()];
    }
    let frame = g.submit_and_wait(&wanted)?;
    let mut ms = BTreeMap::new();
    for (name, time) in
        frame.passes.iter().filter(|(name, _)| passes.iter().any(|pass| name.starts_with(pass)))
    {
        *ms.entry(name.clone()).or_default() += time;
    }
    Ok(ms)
}

/// Returns a slightly tilted wall on a lattice with one point per unit, and another 50 units behind
/// it. In this share of columns of 64 units, the front one keeps one point in six.
fn walls(size: [u32; 2], sparse: f64, seed: u64) -> Cloud {
    let mut columns = Columns::default();
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    for z in 0..size[1] as i32 {
        for x in 0..size[0] as i32 {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            let in_sparse =
                ((x / 64) as f64 + 0.5) * sparse % 1.0 > 1.0 - sparse - 1e-9 && sparse > 0.0;
            for behind in [0, 50] {
                if behind == 0 && in_sparse && !state.is_multiple_of(6) || behind > 0 && !in_sparse
                {
                    continue;
                }
                columns.x.push(4 * x + 2);
                columns.y.push(4 * behind + x);
                columns.z.push(4 * z + 2);
            }
        }
    }
    cloud_of(columns)
}

/// Returns two walls at the same places with this many random points per unit.
fn strewn(size: [u32; 2], density: f64, seed: u64) -> Cloud {
    let count = (density * size[0] as f64 * size[1] as f64) as u64;
    wall(&[0, 50], count, size, seed)
}

/// Returns walls this far behind each other, each with as many random points.
pub(super) fn wall(behind: &[i32], count: u64, size: [u32; 2], seed: u64) -> Cloud {
    let mut columns = Columns::default();
    for &behind in behind {
        for i in 0..count {
            let mut random = Random::new(seed, behind as u64, i);
            let [x, z] = size.map(|side| (random.unit() * 4.0 * side as f64) as i32);
            columns.x.push(x);
            columns.y.push(4 * behind + x / 4);
            columns.z.push(z);
        }
    }
    cloud_of(columns)
}

fn cloud_of(columns: Columns) -> Cloud {
    let lattice = Lattice { step: DVec3::splat(0.25), offset: DVec3::ZERO };
    let part = Part {
        path: "walls".into(),
        name: None,
        header: Header::default(),
        lattice,
        columns,
        intensity_range: [0.0, 65535.0],
        rgb_scale: Default::default(),
    };
    Cloud { parts: vec![part], ..Cloud::default() }
}

pub fn table(rows: &[Row]) -> String {
    let mut text = format!(
        "{:<12} {:>10} {:>10} {:>10} {:>10} {:>12} {:>10}\n",
        "way", "size", "ms", "q1", "q3", "plain passes", "at most"
    );
    for row in rows {
        writeln!(
            text,
            "{:<12} {:>10} {:>10.2} {:>10.2} {:>10.2} {:>12.2} {:>10.0}",
            row.way, row.size, row.ms_median, row.ms_q1, row.ms_q3, row.plain_passes, row.target
        )
        .expect("writing to a string");
        if row.passes.len() > 1 {
            let parts: Vec<String> =
                row.passes.iter().map(|(name, ms)| format!("{name} {ms:.2}")).collect();
            writeln!(text, "    {}", parts.join(", ")).expect("writing to a string");
        }
    }
    if let Some(row) = rows.first() {
        writeln!(text, "device: {} ({})", row.device, row.driver).expect("writing to a string");
    }
    text
}
