//! Small indexes with known points, without the builder: a kd-tree of a few hundred points a node.

use glam::DVec3;
use pointillist::cloud::Columns;
use pointillist::index::Arrangement;
use pointillist::index::build::pack;
use pointillist::index::format::{
    CHECKSUMS, Contents, Directory, Index, NodeRecord, PLANES, Plane, Writer,
};
use std::path::Path;
use std::sync::Arc;

/// Points of a leaf or samples of an inner node, before they are written.
struct Grown {
    points: Vec<usize>,
    weights: Vec<u32>,
    children: Vec<Grown>,
    represented: u64,
    /// The box around all points below.
    bounds: [[i32; 3]; 2],
}

pub const STEP: f64 = 0.001;

/// Shape of the tree.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    pub leaf_points: usize,
    /// Halvings between a node and its children.
    pub halvings: u32,
    pub roots: usize,
    pub colored: bool,
}

impl Default for Shape {
    fn default() -> Self {
        Shape { leaf_points: 600, halvings: 2, roots: 1, colored: true }
    }
}

fn halves(points: Vec<usize>, at: &[[i32; 3]], halvings: u32) -> Vec<Vec<usize>> {
    if halvings == 0 || points.len() < 2 {
        return vec![points];
    }
    let side = |axis: usize| {
        let values = || points.iter().map(|&i| at[i][axis] as i64);
        values().max().unwrap() - values().min().unwrap()
    };
    let axis = (0..3).max_by_key(|&axis| side(axis)).unwrap();
    let mut points = points;
    points.sort_by_key(|&i| (at[i][axis], i));
    let right = points.split_off(points.len() / 2);
    [points, right].into_iter().flat_map(|half| halves(half, at, halvings - 1)).collect()
}

fn grow(points: Vec<usize>, at: &[[i32; 3]], shape: &Shape) -> Grown {
    let represented = points.len() as u64;
    let corner = |pick: fn(i32, i32) -> i32| {
        [0, 1, 2].map(|axis| points.iter().map(|&i| at[i][axis]).reduce(pick).unwrap_or(0))
    };
    let bounds = [corner(i32::min), corner(i32::max)];
    if points.len() <= shape.leaf_points {
        return Grown { weights: Vec::new(), points, children: Vec::new(), represented, bounds };
    }
    let children: Vec<Grown> =
        halves(points, at, shape.halvings).into_iter().map(|half| grow(half, at, shape)).collect();
    // Every sample of a parent is one of its children's.
    let all: Vec<usize> = children.iter().flat_map(|child| child.points.iter().copied()).collect();
    let every = all.len().div_ceil(shape.leaf_points).max(1);
    let points: Vec<usize> = all.into_iter().step_by(every).collect();
    let weights = vec![(represented / points.len() as u64) as u32; points.len()];
    Grown { points, weights, children, represented, bounds }
}

/// Writes an index of these points (millimetres) and opens it.
pub fn plant(path: &Path, at: &[[i32; 3]], rgb: &[[u8; 3]], shape: &Shape) -> Arc<Index> {
    let column = |axis: usize| at.iter().map(|p| p[axis]).collect();
    let columns = Columns { x: column(0), y: column(1), z: column(2), ..Columns::default() };
    let writer = Writer::create(path).unwrap();
    let mut end = Writer::START;
    let mut nodes: Vec<NodeRecord> = Vec::new();
    let per_root = at.len().div_ceil(shape.roots.max(1)).max(1);
    let all: Vec<usize> = (0..at.len()).collect();
    // Breadth first: children follow each other in the order of their parents.
    let mut level: Vec<(Grown, u32)> = all
        .chunks(per_root)
        .enumerate()
        .map(|(i, points)| (grow(points.to_vec(), at, shape), i as u32))
        .collect();
    let roots = level.len() as u32;
    let mut depth = 0;
    while !level.is_empty() {
        let mut next = Vec::new();
        let mut first_child = nodes.len() as u32 + level.len() as u32;
        for (grown, parent) in level {
            let number = nodes.len() as u32;
            let order: Vec<u32> = grown.points.iter().map(|&i| i as u32).collect();
            let row = |&i: &u32| {
                let at = i as usize;
                [columns.x[at] as u32, columns.y[at] as u32, columns.z[at] as u32, i]
            };
            let rows: Vec<[u32; 4]> = order.iter().map(row).collect();
            let frame = pack::frame(&rows);
            let mut pages = vec![vec![0u32; order.len()]; frame.planes as usize + 1];
            let mut planes: Vec<&mut [u32]> = pages.iter_mut().map(Vec::as_mut_slice).collect();
            pack::pack(&rows, &frame, Arrangement::Morton, &mut planes);
            let sorted = pages.pop().unwrap();
            let spacing = frame.extent.iter().max().map_or(0.0, |&side| {
                side.max(1) as f64 * STEP / (order.len() as f64).sqrt().max(1.0)
            });
            // Points lie no further outside the samples' box than that.
            let [low, high] = grown.bounds;
            let beyond = |axis: usize| {
                (frame.origin[axis] - low[axis] as i64)
                    .max(high[axis] as i64 - frame.origin[axis] - frame.extent[axis] as i64)
            };
            let spacing = spacing.max((0..3).map(beyond).max().unwrap_or(0) as f64 * STEP);
            let mut record = NodeRecord {
                origin: frame.origin,
                points: grown.represented,
                at: end,
                spacing: if grown.children.is_empty() { 0.0 } else { spacing },
                extent: frame.extent,
                count: order.len() as u32,
                crc: [0; CHECKSUMS],
                first_child: 0,
                children: grown.children.len() as u32,
                parent,
                planes: 0,
                lattice: 0,
                bits: frame.bits as u8,
                coarser: 0,
                level: depth,
                station: 0,
            };
            let mut put = |plane: Plane, bytes: &[u8]| {
                writer.put(end, bytes).unwrap();
                end += bytes.len() as u64;
                record.planes |= 1 << plane as u16;
                record.crc[plane as usize] = crc32c::crc32c(bytes);
            };
            for (page, &(plane, _)) in pages.iter().zip(&PLANES) {
                put(plane, bytemuck::cast_slice(page));
            }
            if shape.colored {
                put(Plane::Rgb, &sorted.iter().flat_map(|&i| rgb[i as usize]).collect::<Vec<u8>>());
            }
            if !grown.weights.is_empty() {
                put(Plane::Weight, bytemuck::cast_slice(&grown.weights));
            }
            if !grown.children.is_empty() {
                record.first_child = first_child;
                first_child += grown.children.len() as u32;
            }
            nodes.push(record);
            next.extend(grown.children.into_iter().map(|child| (child, number)));
        }
        level = next;
        depth += 1;
    }
    let corner = |pick: fn(i32, i32) -> i32| {
        let axis = |axis: usize| at.iter().map(|p| p[axis]).reduce(pick).unwrap_or(0) as f64 * STEP;
        DVec3::new(axis(0), axis(1), axis(2))
    };
    let contents = Contents {
        lattices: vec![[DVec3::splat(STEP), DVec3::ZERO]],
        points: at.len() as u64,
        bounds: (!at.is_empty()).then(|| [corner(i32::min), corner(i32::max)]),
        elevation_stretch: [0, 65_535],
        ..Contents::default()
    };
    writer.finish(&Directory { nodes, roots, contents }, end).unwrap();
    Arc::new(Index::open(path).unwrap())
}
