//! Builds the nodes of one chunk: leaves, and the inner nodes above them within the chunk.
//!
//! ```text
//! sort the records by Morton code, a bucket at a time (`morton_sort`)
//! grow(cell of the kd-tree: a run of the order):
//!   at most M points: a leaf, and one of their strays (a cell one step wide with more cannot be
//!     split: several leaves, four of which get a parent; guide: numerics, case 27)
//!   else the cell's halves differ in one bit of the code: grow both, and join their open nodes
//!   once the open nodes hold G samples, `merge` makes a parent of them, the only open node left
//! ```
//!
//! The tree is the binary one of Pintus, section 7 (guide: papers), but only cells with enough
//! samples get a node: with G = 4 M inner nodes cost about a sixth of the leaves' bytes, where a
//! node in every cell would cost as much again. Which cells get one depends on the points alone,
//! not on chunks, threads or memory.

use super::morton_sort::RadixSorter;
use super::point_record::{Colors, Layout};
use super::spill_bucket::{Bucket, Spill};
use crate::cloud::strays::RobustBounds;
use crate::cloud::{ColumnSet, Lattice};
use crate::config::{BITS_PER_PLANE, POINTS_PER_PAGE, POSITION_PLANES};
use crate::error::Result;
use crate::index::format::NodeRecord;
use crate::index::format::morton;
use crate::index::format::samples::{DerivedColumns, DerivedPlanes, Samples};
use crate::index::merge::{Gains, Merged, merge};
use glam::DVec3;
use std::sync::Arc;

/// Samples of open nodes that make a parent.
const PARENT_SAMPLES: u64 = 4 * POINTS_PER_PAGE as u64;

/// Points in one place whose leaves get a parent together. More of them are several chunks.
pub const PIECE_POINTS: usize = PARENT_SAMPLES as usize;

/// Properties of all nodes of a tree.
pub struct TreeSpec {
    /// Columns that nodes store.
    pub has: ColumnSet,
    /// Derived planes that nodes have room for.
    pub derive: DerivedPlanes,
    /// Corner of the tree's lattice, in steps of the file's.
    pub corner: [i64; 3],
    /// The tree's cube is 2^bits steps wide.
    pub bits: u32,
    pub lattice: Lattice,
    /// Number of the file's lattice; the next is that of rounded positions.
    pub lattice_number: u16,
    /// Exposure gains of the stations, if known.
    pub gains: Option<Arc<Gains>>,
}

/// Properties of a tree, and the layout of its points.
pub struct TreeLayout {
    pub kind: TreeSpec,
    pub layout: Layout,
}

/// A node with the numbers of its children.
pub struct BuiltNode {
    pub record: NodeRecord,
    pub children: Vec<u32>,
}

/// A node without a parent yet, with its samples if they are in memory.
pub struct OpenNode {
    pub node: u32,
    pub count: u32,
    pub samples: Option<Samples>,
}

/// Returns whether the open nodes of a cell are enough for a parent.
pub fn has_enough_samples(open: &[OpenNode]) -> bool {
    open.len() > 1 && open.iter().map(|open| open.count as u64).sum::<u64>() >= PARENT_SAMPLES
}

/// A built chunk: nodes numbered from 0, planes from byte 0.
#[derive(Default)]
pub struct GrownChunk {
    pub planes: Vec<u8>,
    pub nodes: Vec<BuiltNode>,
    pub open: Vec<OpenNode>,
}

/// Memory that a thread reuses for every chunk.
#[derive(Default)]
pub struct Worker {
    sorter: RadixSorter,
    /// Records of the chunk, bucket by bucket, and their order.
    records: Vec<u8>,
    order: Vec<u32>,
    /// Planes of a chunk that has been written: reused memory costs nothing to get.
    pub planes: Vec<u8>,
}

impl Worker {
    /// Builds one chunk: `depth` bits of the code are decided, and the buckets' points lie in that
    /// cell, in Morton order of the buckets. `colors` are those of every part.
    pub fn grow(
        &mut self,
        tree: &TreeLayout,
        colors: &[Colors],
        depth: u32,
        buckets: Vec<Bucket>,
        station: &impl Fn(u16, u16) -> u16,
        spill: &Spill,
    ) -> Result<GrownChunk> {
        let layout = &tree.layout;
        self.records.clear();
        self.order.clear();
        for bucket in buckets {
            let start = self.records.len();
            bucket.drain(spill, &mut |records| {
                self.records.extend_from_slice(records);
                Ok(())
            })?;
            let own = &mut self.records[start..];
            layout.settle(own, colors);
            self.sorter.sort(layout, own, (start / layout.bytes) as u32, &mut self.order)?;
        }
        let mut planes = std::mem::take(&mut self.planes);
        planes.clear();
        planes.reserve(self.records.len());
        let grown = GrownChunk { planes, ..GrownChunk::default() };
        let mut growth = Growth { tree, records: &self.records, station, grown };
        let open = growth.grow(&self.order, 3 * tree.kind.bits - depth);
        Ok(GrownChunk { open, ..growth.grown })
    }
}

struct Growth<'a, S> {
    tree: &'a TreeLayout,
    records: &'a [u8],
    station: &'a S,
    grown: GrownChunk,
}

impl<S: Fn(u16, u16) -> u16> Growth<'_, S> {
    /// Returns the open nodes of a cell that leaves `left` bits of the code open.
    fn grow(&mut self, order: &[u32], left: u32) -> Vec<OpenNode> {
        if order.is_empty() {
            return Vec::new();
        }
        let fits = left.div_ceil(3) <= BITS_PER_PLANE * POSITION_PLANES;
        if order.len() <= POINTS_PER_PAGE as usize && fits {
            return self.leaves(order);
        }
        if left == 0 {
            return order.chunks(PIECE_POINTS).flat_map(|piece| self.piece(piece)).collect();
        }
        let layout = &self.tree.layout;
        let cell = |&i: &u32| layout.cell(layout.record(self.records, i));
        let (low, high) =
            order.split_at(order.partition_point(|i| !morton::has(cell(i), left - 1)));
        let mut open = self.grow(low, left - 1);
        let upper = self.grow(high, left - 1);
        let joined = !open.is_empty() && !upper.is_empty();
        open.extend(upper);
        if joined { self.parent(open) } else { open }
    }

    /// Makes leaves of points in one place, and their parent.
    fn piece(&mut self, order: &[u32]) -> Vec<OpenNode> {
        let mut open = Vec::new();
        for run in order.chunks(POINTS_PER_PAGE as usize) {
            let samples = self.read(run);
            open.push(self.leaf(samples));
        }
        self.parent(open)
    }

    /// Makes a leaf, and another one of strays, which would otherwise decide its width.
    fn leaves(&mut self, order: &[u32]) -> Vec<OpenNode> {
        let samples = self.read(order);
        let place = |i: usize| DVec3::from_array(samples.q[i].map(f64::from));
        let Some(core) = RobustBounds::of(samples.len(), place) else {
            return vec![self.leaf(samples)];
        };
        let (inside, strays): (Vec<usize>, Vec<usize>) =
            (0..order.len()).partition(|&i| core.has(place(i)));
        [inside, strays]
            .map(|some| self.read(&some.iter().map(|&i| order[i]).collect::<Vec<_>>()))
            .map(|some| self.leaf(some))
            .into()
    }

    fn read(&self, order: &[u32]) -> Samples {
        self.tree.layout.read(self.records, order, self.tree.kind.has, self.station)
    }

    fn leaf(&mut self, mut samples: Samples) -> OpenNode {
        let record = pack(&self.tree.kind, &mut samples, 0, &mut self.grown.planes);
        self.grown.nodes.push(BuiltNode { record, children: Vec::new() });
        OpenNode {
            node: self.grown.nodes.len() as u32 - 1,
            count: samples.len() as u32,
            samples: Some(samples),
        }
    }

    fn parent(&mut self, mut open: Vec<OpenNode>) -> Vec<OpenNode> {
        if !has_enough_samples(&open) {
            return open;
        }
        let parts: Vec<Samples> = open
            .iter_mut()
            .map(|open| open.samples.take().expect("samples of a chunk's open nodes are at hand"))
            .collect();
        let nodes = &self.grown.nodes;
        let (built, samples) = parent(
            &self.tree.kind,
            &open,
            |child| nodes[child as usize].record.spacing,
            parts,
            &mut self.grown.planes,
        );
        self.grown.nodes.push(built);
        vec![OpenNode {
            node: self.grown.nodes.len() as u32 - 1,
            count: samples.len() as u32,
            samples: Some(samples),
        }]
    }
}

/// Makes the parent of open nodes with the samples `parts`. Returns its record, with its planes
/// appended, and its samples as the planes hold them. `spacing` returns that of a node.
pub fn parent(
    kind: &TreeSpec,
    open: &[OpenNode],
    spacing: impl Fn(u32) -> f64,
    parts: Vec<Samples>,
    planes: &mut Vec<u8>,
) -> (BuiltNode, Samples) {
    let Merged { mut samples, dropped, coarser } =
        merge(&Samples::together(&parts), kind.has, kind.gains.as_deref());
    let mut record = pack(kind, &mut samples, coarser, planes);
    record.points = parts.iter().map(Samples::points).sum();
    let widest = |axis: usize| {
        kind.lattice.step[axis].abs() * 2f64.powi(morton::axis_bits(dropped)[axis] as i32)
    };
    // A dense child beside sparse ones may have been merged further than all of them need: the
    // parent is not finer. And an index with an infinite number would be refused.
    let own = widest(0).max(widest(1)).max(widest(2)).min(f64::MAX);
    record.spacing = open.iter().fold(own, |coarsest, open| coarsest.max(spacing(open.node)));
    (BuiltNode { record, children: open.iter().map(|open| open.node).collect() }, samples)
}

fn pack(kind: &TreeSpec, samples: &mut Samples, coarser: u32, planes: &mut Vec<u8>) -> NodeRecord {
    samples.derived = DerivedColumns::zeroed(kind.derive, samples.len());
    let mut record = samples.pack(kind.corner, coarser, planes);
    samples.derived = DerivedColumns::default();
    record.lattice = kind.lattice_number + (coarser > 0) as u16;
    record
}
