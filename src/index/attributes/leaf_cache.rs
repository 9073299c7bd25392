//! Kd-trees of an index's leaves: those nearest to a box, read from the file when requested, and
//! cached while memory lasts.
//!
//! The boxes of the index's nodes, walked from the roots down, tell which leaves are near. So the
//! neighbours of a leaf's points are found wherever they lie, and the result depends neither on
//! where leaves end nor on what is in memory.

use super::kd_tree::KdTree;
use crate::cloud::{Columns, Lattice};
use crate::error::{Error, Result};
use crate::index::format::samples::Samples;
use crate::index::format::schema::{self, Directory, NodeRecord, Plane};
use glam::DVec3;
use std::collections::HashMap;
use std::sync::{Arc, Mutex};

/// Largest relative rounding of world coordinates.
const ROUNDING: f64 = 1e-12;

/// A leaf, or a cloud without an index, as a tree; with colours by place in the tree.
pub struct Leaf {
    pub tree: KdTree,
    pub colors: Vec<[u8; 3]>,
    /// Origin of the tree's coordinates, in steps of the lattice.
    pub origin: [i64; 3],
}

impl Leaf {
    /// Builds a leaf from the columns of a cloud, with colours on request.
    pub fn of(columns: &Columns, lattice: &Lattice, origin: [i64; 3], colored: bool) -> Leaf {
        let tree = KdTree::new(columns, lattice);
        let rgb = columns.rgb.as_ref().filter(|_| colored);
        let colors = rgb.map_or(Vec::new(), |rgb| {
            (0..tree.len()).map(|place| rgb[tree.number(place)]).collect()
        });
        Leaf { tree, colors, origin }
    }

    /// Returns its size in memory `[bytes]`.
    pub fn bytes(&self) -> u64 {
        self.tree.bytes() + size_of_val(&*self.colors) as u64
    }
}

/// A leaf near another one.
pub struct Near {
    pub node: usize,
    /// Squared distance between the boxes `[m2]`.
    pub away: f64,
    /// Its box, in the other's steps from the other's origin; enlarged if the lattices differ.
    lo: DVec3,
    hi: DVec3,
    /// Scale and shift from the other's steps to its own; integers if both are on one lattice.
    scale: DVec3,
    shift: DVec3,
    pub leaf: Option<Arc<Leaf>>,
}

impl Near {
    /// Converts a position of the other leaf to its own steps.
    pub fn seen_from(&self, at: DVec3) -> DVec3 {
        at * self.scale + self.shift
    }

    /// Returns the squared distance from such a position to its box `[m2]`.
    pub fn away_from(&self, at: DVec3, step: DVec3) -> f64 {
        ((at.clamp(self.lo, self.hi) - at) * step).length_squared()
    }
}

/// Reads bytes of the index at an offset.
pub type Read<'r> = dyn Fn(u64, &mut [u8]) -> Result<()> + Sync + 'r;

pub struct LeafCache<'f> {
    pub directory: &'f Directory,
    read: &'f Read<'f>,
    colored: bool,
    /// Most bytes of cached leaves.
    most: u64,
    /// Bytes of leaves that each searching thread should hold, about.
    pub hold: u64,
    kept: Mutex<Kept>,
    /// Diagonal of the cloud `[m]`.
    pub diagonal: f64,
}

/// Leaves by node, each with its last access.
#[derive(Default)]
struct Kept {
    leaves: HashMap<usize, (Arc<Leaf>, u64)>,
    bytes: u64,
    asked: u64,
}

impl<'f> LeafCache<'f> {
    /// Creates a cache of `memory` bytes, beside about `hold` bytes that each searching thread
    /// holds.
    pub fn new(
        directory: &'f Directory,
        read: &'f Read<'f>,
        colored: bool,
        memory: u64,
        hold: u64,
    ) -> LeafCache<'f> {
        let diagonal = directory.contents.bounds.map_or(0.0, |[lo, hi]| (hi - lo).length());
        LeafCache { directory, read, colored, most: memory, hold, kept: Mutex::default(), diagonal }
    }

    fn record(&self, node: usize) -> &NodeRecord {
        &self.directory.nodes[node]
    }

    pub fn lattice(&self, node: usize) -> Lattice {
        schema::lattice(self.record(node), &self.directory.contents.lattices)
    }

    /// Reads a plane of a node; errors if its checksum is wrong.
    pub fn bytes(&self, node: usize, plane: Plane) -> Result<Vec<u8>> {
        let record = self.record(node);
        let (at, length) = record.range(plane);
        let mut bytes = vec![0; length as usize];
        (self.read)(at, &mut bytes)?;
        if crc32c::crc32c(&bytes) != record.crc[plane as usize] {
            let what = format!(
                "cannot read back node {node}'s {plane:?} plane: the disk has lost a write; try again"
            );
            return Err(Error::Request(what));
        }
        Ok(bytes)
    }

    /// Reads these planes and the positions of a node, relative to `corner`.
    pub fn samples(&self, node: usize, corner: [i64; 3], planes: &[Plane]) -> Result<Samples> {
        let record = self.record(node);
        let positions =
            schema::PLANES[..record.position_planes() as usize].iter().map(|(plane, _)| *plane);
        let wanted = positions.chain(planes.iter().copied()).filter(|&plane| record.has(plane));
        let read = wanted
            .map(|plane| Ok((plane, self.bytes(node, plane)?)))
            .collect::<Result<Vec<_>>>()?;
        let of = |plane: Plane| {
            read.iter().find(|(there, _)| *there == plane).map(|(_, bytes)| bytes.as_slice())
        };
        Ok(Samples::unpack(record, corner, &of))
    }

    /// Reads the samples of a node's children in the order in which it was merged of them. `corner`
    /// returns the corner of a node's tree; `bring` may add columns to a child's samples.
    pub fn below(
        &self,
        node: usize,
        corner: &dyn Fn(&NodeRecord) -> [i64; 3],
        planes: &[Plane],
        bring: &dyn Fn(usize, &mut Samples) -> Result<()>,
    ) -> Result<Samples> {
        let (own, lattices) = (self.record(node), &self.directory.contents.lattices);
        let part = |child: usize| {
            let record = self.record(child);
            let mut samples = self.samples(child, corner(record), planes)?;
            bring(child, &mut samples)?;
            let [from, to] = [record, own].map(|record| schema::tree_lattice(record, lattices));
            Ok(if from == to { samples } else { samples.moved(&from, &to) })
        };
        Ok(Samples::together(&own.children().map(part).collect::<Result<Vec<_>>>()?))
    }

    pub fn leaf(&self, node: usize) -> Result<Arc<Leaf>> {
        let kept = || self.kept.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        {
            let mut kept = kept();
            kept.asked += 1;
            let now = kept.asked;
            if let Some((leaf, asked)) = kept.leaves.get_mut(&node) {
                *asked = now;
                return Ok(leaf.clone());
            }
        }
        // Two threads may read the same leaf, rather than one waiting for the other's disk.
        let origin = self.record(node).origin;
        let planes: &[Plane] = if self.colored { &[Plane::Rgb] } else { &[] };
        let Samples { q, rgb, .. } = self.samples(node, origin, planes)?;
        let column = |axis: usize| q.iter().map(|q| q[axis] as i32).collect();
        let columns =
            Columns { x: column(0), y: column(1), z: column(2), rgb, ..Columns::default() };
        let leaf = Arc::new(Leaf::of(&columns, &self.lattice(node), origin, self.colored));
        let mut kept = kept();
        let now = kept.asked;
        while kept.bytes + leaf.bytes() > self.most {
            let oldest =
                kept.leaves.iter().min_by_key(|(_, (_, asked))| *asked).map(|(node, _)| *node);
            let Some((gone, _)) = oldest.and_then(|node| kept.leaves.remove(&node)) else { break };
            kept.bytes -= gone.bytes();
        }
        let before = kept.leaves.insert(node, (leaf.clone(), now));
        kept.bytes += leaf.bytes() - before.map_or(0, |(before, _)| before.bytes());
        Ok(leaf)
    }

    /// Returns all other leaves within `reach` `[m]` of a leaf's box, nearest first; those of the
    /// same lattice, or of any.
    pub fn beside(&self, leaf: usize, reach: f64, of_any_lattice: bool) -> Vec<Near> {
        let own = self.record(leaf);
        let lattices = &self.directory.contents.lattices;
        let (low, high) = schema::bounds(own, lattices);
        let slack = ROUNDING * low.abs().max(high.abs()).max_element();
        let mut near = Vec::new();
        let mut open: Vec<usize> = (0..self.directory.roots as usize).collect();
        while let Some(node) = open.pop() {
            let record = self.record(node);
            let (lo, hi) = schema::bounds(record, lattices);
            let apart = (lo - high).max(low - hi).max(DVec3::ZERO).length() - slack;
            if apart > reach {
                continue;
            }
            open.extend(record.children());
            if record.is_leaf() && node != leaf && (of_any_lattice || record.lattice == own.lattice)
            {
                near.extend(Some(self.near(own, node)).filter(|near| near.away <= reach * reach));
            }
        }
        near.sort_by(|a, b| a.away.total_cmp(&b.away).then(a.node.cmp(&b.node)));
        near
    }

    fn near(&self, own: &NodeRecord, node: usize) -> Near {
        let (record, lattices) = (self.record(node), &self.directory.contents.lattices);
        let steps = |from: [i64; 3], to: [i64; 3]| {
            DVec3::from_array([0, 1, 2].map(|axis| (to[axis] - from[axis]) as f64))
        };
        let extent = |record: &NodeRecord| DVec3::from_array(record.extent.map(f64::from));
        let [lattice, other] = [own, record].map(|record| schema::lattice(record, lattices));
        let (lo, hi, scale, shift) = if own.lattice == record.lattice {
            let lo = steps(own.origin, record.origin);
            (lo, lo + extent(record), DVec3::ONE, -lo)
        } else {
            let (a, b) = schema::bounds(record, lattices);
            let from = lattice.world(own.origin);
            let [a, b] = [a, b].map(|corner| (corner - from) / lattice.step);
            let pad = ROUNDING * from.abs().max_element() / lattice.step.abs()
                + DVec3::splat(f64::EPSILON) * (a.abs() + b.abs());
            (
                a.min(b) - pad,
                a.max(b) + pad,
                lattice.step / other.step,
                (from - other.world(record.origin)) / other.step,
            )
        };
        let apart = (lo - extent(own)).max(-hi).max(DVec3::ZERO);
        Near {
            node,
            away: (apart * lattice.step).length_squared(),
            lo,
            hi,
            scale,
            shift,
            leaf: None,
        }
    }
}
