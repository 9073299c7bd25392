//! One chunk's records in, its nodes out: leaves, and the inner nodes above them as far as the chunk reaches.
//!
//! ```text
//! sort the records by Morton code
//! grow(cell of the kd-tree: a run of the order):
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
use crate::cloud::{Lattice, Wanted};
use crate::config::{BITS_PER_PLANE, POINTS_PER_PAGE, POSITION_PLANES};
use crate::error::Result;

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
    records: Vec<u8>,
    order: Vec<(u64, u32)>,
    sorted: Vec<(u64, u32)>,
    /// How often each intensity occurs.
    pub intensities: Vec<u64>,
    /// Of a chunk that has been written: memory that is used again costs nothing to get.
    pub planes: Vec<u8>,
}

impl Worker {
    /// Grows one chunk: `depth` bits of the code are decided, and the buckets' points lie in that cell.
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
            bucket.drain(spill, &mut |records| {
                self.records.extend_from_slice(records);
                Ok(())
            })?;
        }
        if self.records.is_empty() {
            return Ok(Grown::default());
        }
        tree.layout.settle(&mut self.records, &tree.colors);
        // The bits of each axis that the chunk leaves open, rounded up to a cube.
        let bits = tree.bits - depth / 3;
        let stride = tree.layout.bytes;
        let cells = self.records.chunks_exact(stride).map(Layout::cell);
        if bits <= 21 {
            self.order.clear();
            self.order.extend(cells.enumerate().map(|(i, q)| (morton::code_63(q) & ((1u64 << (3 * bits)) - 1), i as u32)));
            radix_sort(&mut self.order, &mut self.sorted, 3 * bits);
            let order = std::mem::take(&mut self.order);
            let grown = self.grow_sorted(tree, 3 * bits, depth, &order, station);
            self.order = order;
            Ok(grown)
        } else {
            let open = (1u128 << (3 * bits)) - 1;
            let mut order: Vec<(u128, u32)> = cells.enumerate().map(|(i, q)| (morton::code_96(q) & open, i as u32)).collect();
            order.sort_unstable();
            Ok(self.grow_sorted(tree, 3 * bits, depth, &order, station))
        }
    }

    fn grow_sorted<K: Key>(
        &mut self,
        tree: &Tree,
        code_bits: u32,
        depth: u32,
        order: &[(K, u32)],
        station: &impl Fn(u16, u16) -> u16,
    ) -> Grown {
        let records = std::mem::take(&mut self.records);
        let mut growth = Growth {
            tree,
            records: &records,
            station,
            intensities: &mut self.intensities,
            leaf_records: Vec::new(),
            grown: Grown::default(),
        };
        growth.grown.planes = std::mem::take(&mut self.planes);
        growth.grown.planes.clear();
        growth.grown.planes.reserve(records.len());
        // Of the cube's bits, those that the chunk's own cell has decided.
        let open = growth.grow(order, code_bits - depth % 3);
        let mut grown = growth.grown;
        grown.open = open;
        self.records = records;
        grown
    }
}

/// A Morton code of some width.
trait Key: Copy + Ord {
    fn bit(self, k: u32) -> bool;
}

impl Key for u64 {
    fn bit(self, k: u32) -> bool {
        self >> k & 1 == 1
    }
}

impl Key for u128 {
    fn bit(self, k: u32) -> bool {
        self >> k & 1 == 1
    }
}

struct Growth<'a, S> {
    tree: &'a Tree,
    records: &'a [u8],
    station: &'a S,
    intensities: &'a mut Vec<u64>,
    /// Of one leaf, in order.
    leaf_records: Vec<u8>,
    grown: Grown,
}

impl<S: Fn(u16, u16) -> u16> Growth<'_, S> {
    /// The open nodes of a cell that leaves `left` bits of the code open.
    fn grow<K: Key>(&mut self, order: &[(K, u32)], left: u32) -> Vec<Open> {
        if order.is_empty() {
            return Vec::new();
        }
        let fits = left.div_ceil(3) <= BITS_PER_PLANE * POSITION_PLANES;
        if order.len() <= POINTS_PER_PAGE as usize && fits {
            return vec![self.leaf(order)];
        }
        if left == 0 {
            let mut whole = order.to_vec();
            // All at one place: ordered by what else they are, so that the leaves do not depend on the order of the file.
            whole.sort_unstable_by(|a, b| self.rest(a.1).cmp(self.rest(b.1)));
            let open = whole.chunks(POINTS_PER_PAGE as usize).map(|run| self.leaf(run)).collect();
            return self.parent(open);
        }
        let (low, high) = order.split_at(order.partition_point(|(code, _)| !code.bit(left - 1)));
        let mut open = self.grow(low, left - 1);
        let upper = self.grow(high, left - 1);
        let joined = !open.is_empty() && !upper.is_empty();
        open.extend(upper);
        if joined { self.parent(open) } else { open }
    }

    fn rest(&self, i: u32) -> &[u8] {
        Layout::rest(&self.records[i as usize * self.tree.layout.bytes..][..self.tree.layout.bytes])
    }

    fn leaf<K: Key>(&mut self, order: &[(K, u32)]) -> Open {
        let stride = self.tree.layout.bytes;
        let record = |i: u32| &self.records[i as usize * stride..][..stride];
        self.leaf_records.clear();
        for run in order.chunk_by(|a, b| a.0 == b.0) {
            if let [(_, i)] = run {
                self.leaf_records.extend_from_slice(record(*i));
                continue;
            }
            let mut run: Vec<u32> = run.iter().map(|(_, i)| *i).collect();
            run.sort_unstable_by(|&a, &b| self.rest(a).cmp(self.rest(b)));
            run.iter().for_each(|&i| self.leaf_records.extend_from_slice(record(i)));
        }
        let samples = self.tree.layout.read(&self.leaf_records, self.tree.has, self.station);
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

/// Sorts by the low `bits` of the code, 11 at a time (least significant digit first): the codes of a chunk have few bits, and a comparison sort costs
/// three times as much.
fn radix_sort(items: &mut Vec<(u64, u32)>, other: &mut Vec<(u64, u32)>, bits: u32) {
    const DIGIT: u32 = 11;
    other.resize(items.len(), (0, 0));
    for shift in (0..bits).step_by(DIGIT as usize) {
        let digit = |code: u64| (code >> shift) as usize & ((1 << DIGIT) - 1);
        let mut next = [0u32; 1 << DIGIT];
        items.iter().for_each(|&(code, _)| next[digit(code)] += 1);
        if next.iter().any(|&count| count as usize == items.len()) {
            continue;
        }
        let mut sum = 0;
        next.iter_mut().for_each(|count| sum += std::mem::replace(count, sum));
        for &item in items.iter() {
            let slot = &mut next[digit(item.0)];
            other[*slot as usize] = item;
            *slot += 1;
        }
        std::mem::swap(items, other);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn radix_sort_sorts(codes in prop::collection::vec(any::<u64>(), 0..400), bits in 1u32..64) {
            let mut items: Vec<_> = codes.iter().enumerate().map(|(i, &code)| (code & ((1 << bits) - 1), i as u32)).collect();
            let mut sorted = items.clone();
            sorted.sort();
            radix_sort(&mut items, &mut Vec::new(), bits);
            prop_assert_eq!(items, sorted);
        }
    }
}
