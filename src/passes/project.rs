//! POINTS -> KEYS: one 64-bit key a pixel, `depth bits << 32 | point id`, the least of all points that fall into it.
//!
//! On the CPU, in f64: which nodes the view can see, from how many planes each is drawn, and each node's rows to pixels and depth.
//! On the GPU: `project64` with 64-bit atomics, or `project32` twice (depths first, then the least id at that depth) where a device has none.

use crate::config::{BITS_PER_PLANE, CHUNKS_PER_PAGE, NEAR_M, PAGES_PER_BLOCK, POINTS_PER_CHUNK, POINTS_PER_PAGE, QUANTISATION_PX};
use crate::error::Result;
use crate::graph::{Buffer, Graph, Tiles};
use crate::resident::{Resident, ResidentNode};
use crate::shader::{self, Node, project32, project64};
use crate::view::{Projection, View};
use glam::DVec3;
use std::collections::BTreeMap;

/// How much of each position to read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// As few planes as keep the quantisation below a quarter of a thousandth of a pixel.
    Auto,
    /// At most so many planes of ten bits.
    Planes(u32),
}

/// The nodes that a view draws, on the GPU, grouped by the number of planes that they are drawn from.
pub struct Drawn {
    nodes: Buffer,
    chunks: Buffer,
    pages: Vec<Buffer>,
    groups: Vec<Group>,
    pub statistics: Statistics,
}

/// Chunks that one dispatch walks: of nodes in the same block, drawn from the same number of planes.
struct Group {
    block: usize,
    planes: u32,
    first_chunk: u32,
    chunk_count: u32,
}

/// For `--explain`.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Statistics {
    pub nodes_drawn: usize,
    pub nodes_outside: usize,
    pub points_drawn: u64,
    /// Bytes of position planes read.
    pub position_bytes: u64,
    /// The largest quantisation error of a drawn node, pixels.
    pub quantisation_px: f64,
}

/// A horizontal band of the picture: all of it, unless its keys would not fit one binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Band {
    pub top: u32,
    pub size: [u32; 2],
}

/// Bands whose keys fit into `limit` bytes.
pub fn bands(size: [u32; 2], limit: u64) -> Vec<Band> {
    let rows = (limit / (8 * size[0] as u64)).clamp(1, size[1] as u64) as u32;
    (0..size[1]).step_by(rows as usize).map(|top| Band { top, size: [size[0], rows.min(size[1] - top)] }).collect()
}

/// Chooses nodes and planes for a view and brings the list to the GPU.
pub fn draw(g: &mut Graph, view: &View, resident: &Resident, precision: Precision) -> Result<Drawn> {
    let mut statistics = Statistics::default();
    let mut records = Vec::new();
    let mut chunks: BTreeMap<(usize, u32), Vec<u32>> = BTreeMap::new();
    let mut seen: Vec<_> = resident.nodes.iter().filter_map(|node| Some((visible(view, node)?, node))).collect();
    statistics.nodes_outside = resident.nodes.len() - seen.len();
    // Front to back, so that what lies behind finds its pixels taken. The order does not show: keys are unique.
    seen.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (distance, node) in seen {
        let planes = planes(view, node, distance, precision);
        statistics.nodes_drawn += 1;
        statistics.points_drawn += node.count as u64;
        statistics.position_bytes += 4 * planes as u64 * node.count as u64;
        statistics.quantisation_px = statistics.quantisation_px.max(quantisation_px(view, node, distance, planes));
        let number = records.len() as u32;
        records.push(record_of(view, node, planes));
        let group = ((node.first_page / PAGES_PER_BLOCK) as usize, planes);
        chunks.entry(group).or_default().extend((0..node.count.div_ceil(POINTS_PER_CHUNK)).map(|chunk| number * CHUNKS_PER_PAGE + chunk));
    }
    let mut groups = Vec::new();
    let mut first_chunk = 0;
    for (&(block, planes), chunks) in &chunks {
        let chunk_count = chunks.len() as u32;
        groups.push(Group { block, planes, first_chunk, chunk_count });
        first_chunk += chunk_count;
    }
    let nodes = g.upload("nodes", &records)?;
    let chunks = g.upload("chunks", &chunks.into_values().flatten().collect::<Vec<u32>>())?;
    Ok(Drawn { nodes, chunks, pages: resident.import(g), groups, statistics })
}

/// Keys of one band.
pub fn record(g: &mut Graph, view: &View, drawn: &Drawn, band: Band) -> Buffer {
    let mut keys = g.buffer("keys", 8 * band.size[0] as u64 * band.size[1] as u64);
    g.fill(&mut keys, u32::MAX);
    let centre = [view.size[0] as f32 / 2.0, view.size[1] as f32 / 2.0 - band.top as f32];
    let size = band.size.map(|side| side as f32);
    let perspective = view.camera.projection == Projection::Perspective;
    let lanes = if g.gpu.device.is_cpu { 8 } else { 128 };
    // Read beside the atomics on purpose: a stale key only costs an atomic.
    let front = &keys.racing();
    let (int64, texels) = (g.gpu.device.int64_atomics, g.gpu.device.texels);
    let steps: &[u32] = if int64 { &[0] } else { &[0, 1] };
    for &step in steps {
        for &Group { block, planes, first_chunk, chunk_count } in &drawn.groups {
            // Exact up to 65,535 workgroups, and beyond that with less than one row too many.
            let rows = chunk_count.div_ceil(65_535);
            let tiles = Tiles::Groups([chunk_count.div_ceil(rows), rows, 1]);
            let (nodes, chunks, pages) = (&drawn.nodes, &drawn.chunks, &drawn.pages[block]);
            if int64 {
                let push = project64::Push { centre, size, near: NEAR_M, first_chunk, chunk_count };
                let spec = project64::Spec { lanes, planes, perspective, texels, points_per_chunk: POINTS_PER_CHUNK };
                g.run(shader::Project64 { nodes, chunks, pages, page_words: pages, front, keys: &mut keys, push, spec }, tiles);
            } else {
                let push = project32::Push { centre, size, near: NEAR_M, first_chunk, chunk_count };
                let spec = project32::Spec { lanes, planes, perspective, texels, points_per_chunk: POINTS_PER_CHUNK, step };
                g.run(shader::Project32 { nodes, chunks, pages, page_words: pages, front, keys: &mut keys, push, spec }, tiles);
            }
        }
    }
    keys
}

/// The least planar depth of the node's box in front of the camera, or none if no point of the box can be seen.
fn visible(view: &View, node: &ResidentNode) -> Option<f64> {
    let (min, max) = node.bounds();
    let centre = (min + max) / 2.0 - view.camera.eye;
    let half = (max - min) / 2.0;
    let reach = |axis: DVec3| half.dot(axis.abs());
    let basis = &view.basis;
    let depth = centre.dot(basis.forward);
    // A hair more than the box, against rounding.
    let slack = 1e-9 * (centre.length() + half.length());
    if depth + reach(basis.forward) + slack <= 0.0 {
        return None;
    }
    let half_size = [view.size[0] as f64 / 2.0 / view.focal_px(), view.size[1] as f64 / 2.0 / view.focal_px()];
    let outside = |side: DVec3, half: f64| match view.camera.projection {
        // The plane through the eye and the picture's edge has the normal side - half * forward.
        Projection::Perspective => [side, -side].iter().any(|&side| {
            let normal = side - basis.forward * half;
            centre.dot(normal) - reach(normal) > slack * (1.0 + half)
        }),
        Projection::Orthographic => centre.dot(side).abs() - reach(side) > half + slack,
    };
    if outside(basis.right, half_size[0]) || outside(basis.up, half_size[1]) {
        return None;
    }
    Some((depth - reach(basis.forward)).max(0.0))
}

/// Lattice steps of one cell of the node drawn from so many planes; below 1 where the planes hold more bits than the node has.
fn cell_steps(node: &ResidentNode, planes: u32) -> f64 {
    (2f64).powi(node.frame.bits as i32 - (BITS_PER_PLANE * planes) as i32)
}

/// How far a point may be drawn from where it is, pixels, at the node's least depth. With perspective a displacement d moves a point's pixel by at most
/// |d| f / depth, times the secant of its angle from the axis: f (dx - tan dz) / depth, by Cauchy and Schwarz.
fn quantisation_px(view: &View, node: &ResidentNode, distance: f64, planes: u32) -> f64 {
    if planes >= node.frame.planes {
        return 0.0;
    }
    let half_cell = 0.5 * cell_steps(node, planes) * node.lattice.step.length();
    match view.camera.projection {
        Projection::Perspective => {
            let f = view.focal_px();
            let corner = 0.5 * (view.size[0] as f64).hypot(view.size[1] as f64);
            half_cell * f.hypot(corner) / distance
        }
        Projection::Orthographic => half_cell * view.focal_px(),
    }
}

fn planes(view: &View, node: &ResidentNode, distance: f64, precision: Precision) -> u32 {
    match precision {
        Precision::Planes(most) => most.clamp(1, node.frame.planes),
        Precision::Auto => (1..node.frame.planes)
            .find(|&planes| quantisation_px(view, node, distance, planes) <= QUANTISATION_PX)
            .unwrap_or(node.frame.planes),
    }
}

/// The node's rows, in f64, rounded once (HARD_CASES 1.2).
fn record_of(view: &View, node: &ResidentNode, planes: u32) -> Node {
    let steps = cell_steps(node, planes);
    let cell = node.lattice.step * steps;
    // Cells drop the finer bits: their points lie half a cell further on average, less half of the finest step.
    let finest = cell_steps(node, node.frame.planes);
    let middle = if planes < node.frame.planes { (steps - finest.max(1.0)) / 2.0 } else { 0.0 };
    let [x, y, z] = node.frame.origin.map(|origin| origin as f64 + middle);
    // World position of cell 0, relative to the eye.
    let corner = (node.lattice.offset - view.camera.eye) + node.lattice.step * DVec3::new(x, y, z);
    let [x, y, z] = node.frame.extent.map(|extent| (extent as f64 / steps).floor());
    let nearest = (-corner / cell).round().clamp(DVec3::ZERO, DVec3::new(x, y, z));
    let offset = corner + cell * nearest;
    let row = |axis: DVec3| {
        let r = axis * cell;
        [r.x as f32, r.y as f32, r.z as f32, axis.dot(offset) as f32]
    };
    let f = view.focal_px();
    let basis = &view.basis;
    Node {
        row_x: row(basis.right * f),
        row_y: row(basis.up * -f),
        row_z: row(basis.forward),
        nearest: [nearest.x as i32, nearest.y as i32, nearest.z as i32],
        count: node.count,
        first_point: node.first_point(),
        first_word: node.first_page % PAGES_PER_BLOCK * POINTS_PER_PAGE,
    }
}
