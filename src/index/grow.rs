//! One chunk's records in, its nodes out: leaves, and the inner nodes above them as far as the chunk reaches.
//!
//! ```text
//! sort the records by Morton code, a bucket at a time                                             (`sort`)
//! grow(cell of the kd-tree: a run of the records):
//!   at most M points: a leaf                                     (one step wide with more, which cannot be split: several leaves; HARD_CASES 27)
//!   else the cell's halves differ in one bit of the code: grow both, and put their open nodes together
//!   once the open nodes hold G samples, `merge` makes a parent of them, which is then the only open node
//! ```
//! The tree is the binary one of Pintus, section 7, but only cells that gather enough samples get a node: with G = 4 M inner nodes cost about a sixth of the
//! leaves' bytes, where a node in every cell would cost as much again. Which cells get one depends on the points alone, not on chunks, threads or memory.

use super::bucket::{Bucket, Colors, Layout, Spill};
use super::file::NodeRecord;
use super::merge::{Merged, merge};
use super::morton;
use super::samples::Samples;
use super::sort::RadixSorter;
use crate::cloud::{Lattice, Wanted};
use crate::config::{BITS_PER_PLANE, POINTS_PER_PAGE, POSITION_PLANES};
use crate::error::Result;
use std::ops::Range;

/// Open nodes with so many samples between them get a parent.
const GATHERED: u64 = 4 * POINTS_PER_PAGE as u64;

/// What all nodes of one tree have in common.
pub struct Tree {
    pub layout: Layout,
    /// The columns that nodes keep.
    pub has: Wanted,
    /// Where the tree's lattice starts, in steps of the file's.
    pub corner: [i64; 3],
    /// The tree's cube is 2^bits steps wide.
    pub bits: u32,
    pub lattice: Lattice,
    /// Of the file's lattice; the next is the one that rounded positions lie on.
    pub lattice_number: u16,
    /// Of every part.
    pub colors: Vec<Colors>,
}

/// A node with the numbers of its children.
pub struct Built {
    pub record: NodeRecord,
    pub children: Vec<u32>,
}

/// A node without a parent yet, and its samples where they are still at hand.
pub struct Open {
    pub node: u32,
    pub count: u32,
    pub samples: Option<Samples>,
}

/// Whether nodes that are open in one cell of the kd-tree are enough for a parent.
pub fn gathered(open: &[Open]) -> bool {
    open.len() > 1 && open.iter().map(|open| open.count as u64).sum::<u64>() >= GATHERED
}

/// Nodes numbered from 0, their planes from byte 0.
#[derive(Default)]
pub struct Grown {
    pub planes: Vec<u8>,
    pub nodes: Vec<Built>,
    pub open: Vec<Open>,
}

/// What a thread keeps from chunk to chunk.
#[derive(Default)]
pub struct Worker {
    sorter: RadixSorter,
    /// Of one bucket, as they came.
    unsorted: Vec<u8>,
    /// Of the chunk, in Morton order.
    records: Vec<u8>,
    /// How often each intensity occurs.
    pub intensities: Vec<u64>,
    /// Of a chunk that has been written: memory that is used again costs nothing to get.
    pub planes: Vec<u8>,
}

impl Worker {
    /// Grows one chunk: `depth` bits of the code are decided, and the buckets' points lie in that cell, in Morton order of the buckets.
    pub fn grow(
        &mut self,
        tree: &Tree,
        depth: u32,
        buckets: Vec<Bucket>,
        station: &impl Fn(u16, u16) -> u16,
        spill: &Spill,
    ) -> Result<Grown> {
        self.records.clear();
        for bucket in buckets {
            self.unsorted.clear();
            bucket.drain(spill, &mut |records| {
                self.unsorted.extend_from_slice(records);
                Ok(())
            })?;
            tree.layout.settle(&mut self.unsorted, &tree.colors);
            self.sorter.sort(&tree.layout, &self.unsorted, &mut self.records)?;
        }
        let mut planes = std::mem::take(&mut self.planes);
        planes.clear();
        planes.reserve(self.records.len());
        let grown = Grown { planes, ..Grown::default() };
        let mut growth = Growth { tree, records: &self.records, station, intensities: &mut self.intensities, grown };
        let open = growth.grow(0..self.records.len() / tree.layout.bytes, 3 * tree.bits - depth);
        Ok(Grown { open, ..growth.grown })
    }
}

struct Growth<'a, S> {
    tree: &'a Tree,
    records: &'a [u8],
    station: &'a S,
    intensities: &'a mut Vec<u64>,
    grown: Grown,
}

impl<S: Fn(u16, u16) -> u16> Growth<'_, S> {
    /// The open nodes of a cell that leaves `left` bits of the code open.
    fn grow(&mut self, points: Range<usize>, left: u32) -> Vec<Open> {
        if points.is_empty() {
            return Vec::new();
        }
        let fits = left.div_ceil(3) <= BITS_PER_PLANE * POSITION_PLANES;
        if points.len() <= POINTS_PER_PAGE as usize && fits {
            return vec![self.leaf(points)];
        }
        if left == 0 {
            let starts = points.clone().step_by(POINTS_PER_PAGE as usize);
            let open = starts.map(|start| self.leaf(start..points.end.min(start + POINTS_PER_PAGE as usize))).collect();
            return self.parent(open);
        }
        let middle = self.middle(&points, left - 1);
        let mut open = self.grow(points.start..middle, left - 1);
        let upper = self.grow(middle..points.end, left - 1);
        let joined = !open.is_empty() && !upper.is_empty();
        open.extend(upper);
        if joined { self.parent(open) } else { open }
    }

    fn records(&self, points: Range<usize>) -> &[u8] {
        let stride = self.tree.layout.bytes;
        &self.records[points.start * stride..points.end * stride]
    }

    /// The first point whose code has a bit, where all bits above are equal.
    fn middle(&self, points: &Range<usize>, bit: u32) -> usize {
        let (mut low, mut high) = (points.start, points.end);
        while low < high {
            let middle = low.midpoint(high);
            if morton::has(Layout::cell(self.records(middle..middle + 1)), bit) {
                high = middle;
            } else {
                low = middle + 1;
            }
        }
        low
    }

    fn leaf(&mut self, points: Range<usize>) -> Open {
        let samples = self.tree.layout.read(self.records(points), self.tree.has, self.station);
        if let Some(column) = &samples.intensity {
            self.intensities.resize(1 << 16, 0);
            column.iter().for_each(|&v| self.intensities[v as usize] += 1);
        }
        let record = pack(self.tree, &samples, 0, &mut self.grown.planes);
        self.grown.nodes.push(Built { record, children: Vec::new() });
        Open { node: self.grown.nodes.len() as u32 - 1, count: samples.len() as u32, samples: Some(samples) }
    }

    fn parent(&mut self, mut open: Vec<Open>) -> Vec<Open> {
        if !gathered(&open) {
            return open;
        }
        let parts: Vec<Samples> =
            open.iter_mut().map(|open| open.samples.take().expect("samples of a chunk's open nodes are at hand")).collect();
        let nodes = &self.grown.nodes;
        let (built, samples) = parent(self.tree, &open, |child| nodes[child as usize].record.spacing, parts, &mut self.grown.planes);
        self.grown.nodes.push(built);
        vec![Open { node: self.grown.nodes.len() as u32 - 1, count: samples.len() as u32, samples: Some(samples) }]
    }
}

/// The parent of open nodes whose samples are `parts`: its record with its planes appended, and its samples as the planes hold them. `spacing` is that of
/// a node.
pub fn parent(tree: &Tree, open: &[Open], spacing: impl Fn(u32) -> f64, parts: Vec<Samples>, planes: &mut Vec<u8>) -> (Built, Samples) {
    let Merged { samples, dropped, coarser } = merge(&Samples::concatenated(&parts), tree.has);
    let mut record = pack(tree, &samples, coarser, planes);
    record.points = parts.iter().map(Samples::points).sum();
    let widest = |axis: usize| tree.lattice.step[axis].abs() * 2f64.powi(morton::axis_bits(dropped)[axis] as i32);
    // Beside sparse children a dense one may have been merged further than all of them together need: it is not finer here. And an index with an infinite
    // number would be refused.
    let own = widest(0).max(widest(1)).max(widest(2)).min(f64::MAX);
    record.spacing = open.iter().fold(own, |coarsest, open| coarsest.max(spacing(open.node)));
    (Built { record, children: open.iter().map(|open| open.node).collect() }, samples)
}

fn pack(tree: &Tree, samples: &Samples, coarser: u32, planes: &mut Vec<u8>) -> NodeRecord {
    let mut record = samples.pack(tree.corner, coarser, planes);
    record.lattice = tree.lattice_number + (coarser > 0) as u16;
    record
}
