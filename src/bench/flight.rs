//! `bench flight`: a flight through an index with a pool smaller than the data, in which no frame
//! may wait.
//!
//! The flight leads from a view of the whole to places spread over it, past each at a small height,
//! and up again, always the same. Measured per frame: the time of `Residency::update` and of the
//! whole frame, nodes of the cut that were not resident, and holes. Whether a hole could have been
//! filled is determined here by walking the tree, deliberately not by the code that selects what is
//! drawn.

use crate::cloud::attribute::Attribute;
use crate::error::{Error, Result};
use crate::gpu::DeviceOptions;
use crate::graph::Gpu;
use crate::index::format::{Index, Plane};
use crate::passes::encode;
use crate::progress::Progress;
use crate::render::gpu_cloud::GpuCloud;
use crate::render::index_samples;
use crate::render::source::Source;
use crate::renderer::{CloudId, Renderer, RendererOptions};
use crate::resident::pages::PAGE_BYTES;
use crate::resident::{Residency, streaming::Update};
use crate::select::lod::Detail;
use crate::view::{Camera, Preset, View};
use glam::DVec3;
use serde::Serialize;
use std::collections::HashSet;
use std::fmt::Write;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Options of the benchmark.
pub struct Plan {
    pub index: PathBuf,
    pub sizes: Vec<[u32; 2]>,
    pub frames: usize,
    pub budget: Option<u64>,
    pub lod_px: f64,
    /// Size of the pool; a quarter of the whole index if `None`.
    pub pool_bytes: Option<u64>,
}

/// The results of a flight. Milliseconds are wall-clock time.
#[derive(Clone, Debug, Serialize)]
pub struct Flight {
    pub bench: &'static str,
    pub size: String,
    pub frames: usize,
    pub points: u64,
    pub index_bytes: u64,
    /// Bytes of the pages of all nodes.
    pub whole_bytes: u64,
    pub pool_bytes: u64,
    pub budget: u64,
    pub lod_px: f64,
    pub ms_median: f64,
    pub ms_p999: f64,
    pub ms_worst: f64,
    pub update_ms_median: f64,
    pub update_ms_p999: f64,
    pub update_ms_worst: f64,
    pub points_drawn_median: f64,
    pub bytes_read: u64,
    /// Nodes of cuts that were not resident, summed over the frames.
    pub misses: u64,
    /// Frames whose cut was entirely resident.
    pub complete_frames: usize,
    pub evictions: u64,
    pub frames_with_holes: usize,
    /// Holes that a resident node could have filled.
    pub needless_holes: usize,
    /// Read errors.
    pub errors: Vec<String>,
    pub device: String,
    pub driver: String,
}

/// Number of places the camera visits.
const PLACES: usize = 6;

pub fn run(options: &DeviceOptions, plan: &Plan, progress: &dyn Progress) -> Result<Vec<Flight>> {
    let index = Arc::new(Index::open(&plan.index)?);
    if index.nodes().is_empty() {
        return Err(Error::format(&plan.index, "has no points"));
    }
    let mut renderer = Renderer::open_device(options, RendererOptions::default())?;
    plan.sizes.iter().map(|&size| fly(&mut renderer, &index, plan, size, progress)).collect()
}

fn fly(
    renderer: &mut Renderer,
    index: &Arc<Index>,
    plan: &Plan,
    size: [u32; 2],
    progress: &dyn Progress,
) -> Result<Flight> {
    let usual = Detail::of(size);
    let detail =
        Detail { budget: plan.budget.unwrap_or(usual.budget), lod_px: plan.lod_px, ..usual };
    let whole_bytes =
        index.nodes().iter().map(|node| (node.position_planes() + 1) as u64 * PAGE_BYTES).sum();
    let pool_bytes = plan.pool_bytes.unwrap_or(whole_bytes / 4).max(PAGE_BYTES);
    let contents = &index.directory.contents;
    let colored = index.nodes().iter().any(|node| node.has(Plane::Rgb));
    let shown =
        index_samples::shown(index, if colored { Attribute::Rgb } else { Attribute::Elevation });
    let path = Path::over(index, size)?;
    renderer.set_memory_budget(pool_bytes);
    let cloud = renderer.add_source(Source::Index(index.clone()), shown, progress)?;
    let [mut frames, mut updates, mut points] = [(); 3].map(|()| Vec::with_capacity(plan.frames));
    let (mut misses, mut complete_frames, mut frames_with_holes, mut needless_holes) = (0, 0, 0, 0);
    let mut errors = Vec::new();
    for number in 0..plan.frames {
        progress.tick("bench flight", number as u64, plan.frames as u64)?;
        let view = View::new(path.camera(number as f64 / (plan.frames.max(2) - 1) as f64), size)?;
        let began = Instant::now();
        let (gpu, residency) = streamed(renderer, cloud)?;
        let update = residency.update(gpu, &view, &detail)?;
        updates.push(milliseconds(began));
        let config = renderer.config(cloud, &view)?;
        let statistics = renderer
            .draw(cloud, &view, &config, progress, |g, outcome| {
                encode::download(g, &outcome.picture).map(|_| outcome.statistics)
            })?
            .asked;
        frames.push(milliseconds(began));
        points.push(statistics.points_drawn as f64);
        misses += update.missing as u64;
        complete_frames += update.is_complete() as usize;
        frames_with_holes += (update.holes > 0) as usize;
        needless_holes += holes_that_could_be_filled(streamed(renderer, cloud)?.1, &view, &update);
        errors.extend(update.errors);
    }
    let [ms_median, ms_p999, ms_worst] = ranks(&mut frames);
    let (gpu, residency) = streamed(renderer, cloud)?;
    let [update_ms_median, update_ms_p999, update_ms_worst] = ranks(&mut updates);
    let flight = Flight {
        bench: "flight",
        size: format!("{}x{}", size[0], size[1]),
        frames: plan.frames,
        points: contents.points,
        index_bytes: index.bytes(),
        whole_bytes,
        pool_bytes,
        budget: detail.budget,
        lod_px: detail.lod_px,
        ms_median,
        ms_p999,
        ms_worst,
        update_ms_median,
        update_ms_p999,
        update_ms_worst,
        points_drawn_median: ranks(&mut points)[0],
        bytes_read: residency.bytes_read,
        misses,
        complete_frames,
        evictions: residency.evictions,
        frames_with_holes,
        needless_holes,
        errors,
        device: gpu.device.name.clone(),
        driver: gpu.device.driver.clone(),
    };
    renderer.remove(cloud)?;
    Ok(flight)
}

/// Returns the device and the nodes of an index on it.
fn streamed(renderer: &mut Renderer, cloud: CloudId) -> Result<(&mut Gpu, &mut Residency)> {
    match renderer.cloud(cloud)? {
        (gpu, GpuCloud::Parts(residency)) => Ok((gpu, residency)),
        (_, GpuCloud::Whole(_)) => unreachable!("an index was added"),
    }
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}

/// Returns median, 99.9 % and maximum: the values nearest to those ranks.
fn ranks(values: &mut [f64]) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    [0.5, 0.999, 1.0].map(|share| {
        values
            .get(((values.len().max(1) - 1) as f64 * share).round() as usize)
            .copied()
            .unwrap_or(0.0)
    })
}

/// Returns visible nodes of the cut that are not shown although they or an ancestor are resident.
fn holes_that_could_be_filled(residency: &Residency, view: &View, update: &Update) -> usize {
    let index = residency.index();
    let drawn: HashSet<usize> = residency.drawn().iter().copied().collect();
    let parent =
        |node: usize| Some(index.nodes()[node].parent as usize).filter(|&parent| parent != node);
    let up = |node: usize| std::iter::successors(Some(node), move |&node| parent(node));
    let shown_below = |node: usize| {
        let mut open = vec![node];
        while let Some(node) = open.pop() {
            let record = &index.nodes()[node];
            if drawn.contains(&node) || view.least_depth(index.bounds(record)).is_none() {
                continue;
            }
            if record.is_leaf() {
                return false;
            }
            open.extend(record.children());
        }
        true
    };
    let hole = |node: usize| !up(node).any(|node| drawn.contains(&node)) && !shown_below(node);
    let could = |node: usize| up(node).any(|node| residency.is_resident(node));
    update.cut.nodes.iter().filter(|wanted| could(wanted.node) && hole(wanted.node)).count()
}

/// Eye and target along the flight.
struct Path {
    stops: Vec<[DVec3; 2]>,
    fov_y: f64,
}

/// Returns the cameras at the stops of a flight over an index.
pub fn stops(index: &Index, size: [u32; 2]) -> Result<Vec<Camera>> {
    let path = Path::over(index, size)?;
    let last = path.stops.len() - 1;
    Ok((0..=last).map(|stop| path.camera(stop as f64 / last as f64)).collect())
}

impl Path {
    fn over(index: &Index, size: [u32; 2]) -> Result<Path> {
        let mut samples = Vec::new();
        for root in 0..index.directory.roots as usize {
            samples.extend(index.samples(root)?.into_iter().map(|(p, _)| p));
        }
        let overview = Camera::framing(Preset::Fit, &samples, size);
        let away = overview.eye - overview.target;
        // Samples are in Morton order, so evenly spaced ones are spread over the cloud.
        let places = (0..PLACES).map(|k| samples[(2 * k + 1) * samples.len() / (2 * PLACES)]);
        let above = |(k, place): (usize, DVec3)| {
            // Near enough that a node or two fill the picture, from another side each time.
            let turned = DVec3::new(away.x, away.y, 0.0).rotate_z(k as f64 * 2.4);
            [place + turned * 0.06 + DVec3::Z * away.length() * 0.03, place]
        };
        let ends = [overview.eye, overview.target];
        let mut stops = vec![ends];
        stops.extend(places.enumerate().map(above));
        stops.push(ends);
        Ok(Path { stops, fov_y: overview.fov_y })
    }

    /// Returns the camera at `share` of the flight in 0..=1. The path is smooth, and slow at the
    /// stops.
    fn camera(&self, share: f64) -> Camera {
        let at = share.clamp(0.0, 1.0) * (self.stops.len() - 1) as f64;
        let k = (at as usize).min(self.stops.len() - 2);
        let t = at - k as f64;
        let t = t * t * (3.0 - 2.0 * t);
        let [eye, target] = [0, 1].map(|end| self.stops[k][end].lerp(self.stops[k + 1][end], t));
        Camera {
            eye,
            target,
            up: DVec3::Z,
            fov_y: self.fov_y,
            projection: crate::view::Projection::Perspective,
            ortho_height: None,
        }
    }
}

/// Formats the flights as a table.
pub fn table(flights: &[Flight]) -> String {
    let mut text = String::new();
    for f in flights {
        let mib = |bytes: u64| bytes as f64 / (1 << 20) as f64;
        writeln!(
            text,
            "{} points, {} frames of {} at --lod {} and --point-budget {}; pool {:.0} MiB of {:.0} MiB that all nodes would take",
            f.points,
            f.frames,
            f.size,
            f.lod_px,
            f.budget,
            mib(f.pool_bytes),
            mib(f.whole_bytes)
        )
        .expect("writing to a string");
        let row = |text: &mut String, name: &str, [median, p999, worst]: [f64; 3]| {
            writeln!(text, "  {name:<8} median {median:>9.3} ms   99.9 % {p999:>9.3} ms   worst {worst:>9.3} ms")
                .expect("writing to a string");
        };
        row(&mut text, "frame", [f.ms_median, f.ms_p999, f.ms_worst]);
        row(&mut text, "update", [f.update_ms_median, f.update_ms_p999, f.update_ms_worst]);
        writeln!(
            text,
            "  {:.0} points drawn (median), {:.1} MiB read, {} misses, {} evictions, {} of {} frames complete",
            f.points_drawn_median,
            mib(f.bytes_read),
            f.misses,
            f.evictions,
            f.complete_frames,
            f.frames
        )
        .expect("writing to a string");
        writeln!(
            text,
            "  {} frames with a hole, {} holes that something resident could have filled",
            f.frames_with_holes, f.needless_holes
        )
        .expect("writing to a string");
        f.errors
            .iter()
            .for_each(|error| writeln!(text, "  note: {error}").expect("writing to a string"));
    }
    if let Some(f) = flights.first() {
        writeln!(text, "device: {} ({})", f.device, f.driver).expect("writing to a string");
    }
    text
}
