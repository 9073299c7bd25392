//! `bench project`: our projection against the way the papers drew points, and against the CPU.
//!
//! In: a sphere from `synth`, in Morton order or shuffled. Ways, interleaved round by round on the
//! same device and view:
//! - `compute64`, `compute32`: ours, clearing and projecting; the keys hold depth and point;
//! - `point_list`: a POINT_LIST pipeline with depth test that writes depth and point, from a vertex
//!   buffer of f32 positions in the same order;
//! - `cpu`: a plain multi-threaded loop over the same f32 positions with atomic 64-bit minima and
//!   an early read: what the CPU can do at all.
//!
//! The rasteriser draws on a device of its own: once lavapipe has rasterised, the timestamps around
//! its compute passes no longer wait for them. Before anything is timed all ways draw once, which
//! warms them up, and the numbers of pixels that they cover are compared.

use super::{Row, quartiles};
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::config::NO_POINT;
use crate::error::{Error, Result};
use crate::gpu::DeviceOptions;
use crate::graph::{Buffer, Gpu, Graph, Handle, ImageDesc, Kind, Vertices};
use crate::index::Arrangement;
use crate::passes::project::{self, Precision};
use crate::progress::Progress;
use crate::resident::Resident;
use crate::shader;
use crate::synth::{self, SceneKind};
use crate::view::{Camera, Preset, View};
use glam::DVec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Instant;

pub const WAYS: [&str; 4] = ["compute64", "compute32", "point_list", "cpu"];

/// Options of the benchmark.
pub struct Plan {
    pub points: Vec<u64>,
    pub sizes: Vec<[u32; 2]>,
    pub repeat: usize,
    pub seed: u64,
}

struct Gpus {
    compute: Gpu,
    raster: Gpu,
}

pub fn run(options: &DeviceOptions, plan: &Plan, progress: &dyn Progress) -> Result<Vec<Row>> {
    let mut gpus = Gpus { compute: Gpu::open(options)?, raster: Gpu::open(options)? };
    let mut rows = Vec::new();
    for &points in &plan.points {
        let world = synth::build(SceneKind::Sphere, plan.seed, 0.0);
        let cloud = synth::collect("sphere", &world, points, plan.seed, 0.0, progress)?;
        let sample = cloud.core_points();
        for order in ["morton", "shuffled"] {
            let arrangement =
                if order == "morton" { Arrangement::Morton } else { Arrangement::Shuffled };
            let shown = DisplayAttribute::new(Attribute::White, &cloud);
            let resident =
                Resident::arrange(&mut gpus.compute, cloud.clone(), shown, arrangement, progress)?;
            let scene = Points::new(&mut gpus.compute, &resident)?;
            for &size in &plan.sizes {
                let view = View::new(Camera::framing(Preset::Fit, &sample, size), size)?;
                rows.extend(measure(
                    &mut gpus,
                    &resident,
                    &scene,
                    &view,
                    order,
                    plan.repeat,
                    progress,
                )?);
            }
        }
    }
    Ok(rows)
}

/// f32 positions relative to a centre, as in a vertex buffer and in the CPU's loop.
struct Points {
    centre: DVec3,
    positions: Vec<[f32; 3]>,
}

impl Points {
    fn new(gpu: &mut Gpu, resident: &Resident) -> Result<Points> {
        let centre = resident.nodes.first().map_or(DVec3::ZERO, |node| node.bounds().0);
        Ok(Points {
            centre,
            positions: resident
                .positions(gpu)?
                .into_iter()
                .map(|p| (p - centre).as_vec3().to_array())
                .collect(),
        })
    }

    /// Returns the rows that map to pixels times depth from the picture's centre, and to depth.
    fn rows(&self, view: &View) -> [[f32; 4]; 3] {
        let offset = self.centre - view.camera.eye;
        let f = view.focal_px();
        [view.basis.right * f, view.basis.up * -f, view.basis.forward]
            .map(|axis| axis.extend(axis.dot(offset)).as_vec4().to_array())
    }
}

fn measure(
    gpus: &mut Gpus,
    resident: &Resident,
    points: &Points,
    view: &View,
    order: &str,
    repeat: usize,
    progress: &dyn Progress,
) -> Result<Vec<Row>> {
    let ways: Vec<_> = WAYS
        .into_iter()
        .filter(|&way| way != "compute64" || gpus.compute.device.int64_atomics)
        .collect();
    let mut covered = Vec::new();
    for &way in &ways {
        covered.push(draw(gpus, resident, points, view, way, true)?.1);
    }
    // Reversed f32 depth and positions relative to one centre round differently: a few pixels in a
    // thousand may differ.
    if covered.iter().any(|&pixels| pixels.abs_diff(covered[0]) as f64 > 3e-3 * covered[0] as f64) {
        return Err(Error::Request(format!(
            "the ways do not draw the same: {ways:?} cover {covered:?} pixels"
        )));
    }
    let mut times = vec![Vec::new(); ways.len()];
    for round in 0..repeat {
        progress.tick(
            &format!("bench {} points {order}", points.positions.len()),
            round as u64,
            repeat as u64,
        )?;
        for (way, times) in ways.iter().zip(&mut times) {
            times.push(draw(gpus, resident, points, view, way, false)?.0);
        }
    }
    let row = |(way, mut times): (&str, Vec<f64>)| {
        let [ms_q1, ms_median, ms_q3] = quartiles(&mut times);
        let cpu = way == "cpu";
        Row {
            way: way.to_string(),
            points: points.positions.len() as u64,
            order: order.to_string(),
            size: format!("{}x{}", view.size[0], view.size[1]),
            ms_median,
            ms_q1,
            ms_q3,
            mpts_per_s: points.positions.len() as f64 / ms_median / 1e3,
            device: if cpu {
                format!("{} threads", rayon::current_num_threads())
            } else {
                gpus.compute.device.name.clone()
            },
            driver: if cpu {
                format!("rustc, {}", std::env::consts::ARCH)
            } else {
                gpus.compute.device.driver.clone()
            },
        }
    };
    Ok(ways.into_iter().zip(times).map(row).collect())
}

/// Draws once. Returns milliseconds, and the number of covered pixels if counted.
fn draw(
    gpus: &mut Gpus,
    resident: &Resident,
    points: &Points,
    view: &View,
    way: &str,
    count: bool,
) -> Result<(f64, usize)> {
    match way {
        "cpu" => Ok(draw_on_cpu(points, view)),
        "point_list" => draw_point_list(&mut gpus.raster, points, view, count),
        _ => {
            let gpu = &mut gpus.compute;
            let int64 = gpu.device.int64_atomics;
            gpu.device.int64_atomics = way == "compute64";
            let drawn = draw_keys(gpu, resident, view, count);
            gpu.device.int64_atomics = int64;
            drawn
        }
    }
}

fn draw_keys(gpu: &mut Gpu, resident: &Resident, view: &View, count: bool) -> Result<(f64, usize)> {
    let mut g = Graph::new(gpu);
    let drawn = project::draw(&mut g, view, resident, Precision::Auto)?;
    let mut wanted = Vec::new();
    for strip in project::strips(view.size, project::KEY_BYTES, g.gathered_limit()) {
        wanted.push(project::record(&mut g, view, &drawn, None, None, strip).words);
    }
    let downloads: Vec<Buffer> = if count {
        wanted.iter().map(|keys| g.download_buffer(keys)).collect()
    } else {
        Vec::new()
    };
    let frame = g.submit_and_wait(&wanted.iter().map(Handle::resource).collect::<Vec<_>>())?;
    let covered = downloads
        .iter()
        .map(|keys| frame.read::<[u32; 2]>(keys).iter().filter(|key| key[0] != NO_POINT).count())
        .sum();
    let ms = frame.ms("project") + frame.ms("clear");
    Ok((ms, covered))
}

fn draw_point_list(
    gpu: &mut Gpu,
    points: &Points,
    view: &View,
    count: bool,
) -> Result<(f64, usize)> {
    let rows = points.rows(view);
    let clip = |row: [f32; 4], side: u32| row.map(|v| v * 2.0 / side as f32);
    let push = shader::point_list::Push {
        row_x: clip(rows[0], view.size[0]),
        row_y: clip(rows[1], view.size[1]),
        row_w: rows[2],
        near: 1e-3,
    };
    let mut g = Graph::new(gpu);
    let vertices = g.upload("vertices", &points.positions)?;
    let mut index = g.image("index", view.size, Kind::R32ui);
    let mut depth = g.image_of("depth", ImageDesc::depth(view.size));
    let drawn = Vertices::Points(&vertices, points.positions.len() as u32);
    g.draw(shader::PointList { push }, drawn, [&mut index, &mut depth], false);
    let download = count.then(|| g.download(&index));
    let frame = g.submit_and_wait(&[index.resource(), depth.resource()])?;
    let covered = download.map_or(0, |index| {
        frame.read::<u32>(&index).iter().filter(|&&point| point != NO_POINT).count()
    });
    let ms = frame.ms("point_list");
    Ok((ms, covered))
}

fn draw_on_cpu(points: &Points, view: &View) -> (f64, usize) {
    let [row_x, row_y, row_z] = points.rows(view);
    let [width, height] = view.size.map(|side| side as f32);
    // Touched before the clock starts: fresh memory costs the system more than clearing it.
    let keys: Vec<AtomicU64> =
        (0..view.size[0] as usize * view.size[1] as usize).map(|_| AtomicU64::new(1)).collect();
    let start = Instant::now();
    keys.par_iter().for_each(|key| key.store(u64::MAX, Relaxed));
    const CHUNK: usize = 4096;
    points.positions.par_chunks(CHUNK).enumerate().for_each(|(chunk, positions)| {
        for (i, p) in positions.iter().enumerate() {
            let row = |r: [f32; 4]| r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + r[3];
            let depth = row(row_z);
            if depth <= 0.0 {
                continue;
            }
            let scale = 1.0 / depth;
            let (x, y) = (row(row_x) * scale + width / 2.0, row(row_y) * scale + height / 2.0);
            if x >= 0.0 && x < width && y >= 0.0 && y < height {
                let key = (depth.to_bits() as u64) << 32 | (chunk * CHUNK + i) as u64;
                let slot = &keys[y as i32 as usize * view.size[0] as usize + x as i32 as usize];
                if key < slot.load(Relaxed) {
                    slot.fetch_min(key, Relaxed);
                }
            }
        }
    });
    let ms = start.elapsed().as_secs_f64() * 1e3;
    (ms, keys.iter().filter(|key| key.load(Relaxed) != u64::MAX).count())
}
