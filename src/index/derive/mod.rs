//! An index whose nodes have room for them in, what depends on the points around out: normals, strokes, and colours of one luminance.
//!
//! ```text
//! leaves, on all cores: of every point, from the points around it in whatever leaves they are (`leaves`, `surroundings`)
//! radii of strokes: none larger than that of all but one in a hundred of a tree's points
//! inner nodes, from the deepest level up: of every sample, from those of its children that it stands for (`inner`)
//! ```
//! All of it goes to where the file has room for it, before there is a directory: an index is complete or absent. What a point gets depends on the points alone, not on leaves, threads or memory: it is what a
//! cloud that is held in memory gets.

mod inner;
mod leaves;

use super::build::Options;
use super::file::{Directory, Plane, Writer};
use super::forest::Forest;
use super::samples::Derived;
use super::strokes;
use crate::error::Result;
use crate::progress::Progress;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// `corners`: of every lattice where its tree starts, steps.
pub fn derive(directory: &mut Directory, writer: &Writer, corners: &[[i64; 3]], options: &Options, progress: &dyn Progress) -> Result<()> {
    let read = |at: u64, bytes: &mut [u8]| writer.get(at, bytes);
    // Half of the memory for leaves that are kept, a quarter for those that threads have at hand, the rest for what they find.
    let colored = options.derive.strokes || options.derive.luminance;
    let hold = options.memory / 4 / options.threads as u64;
    let forest = Forest::new(directory, &read, colored, options.memory / 2, hold);
    let mut work = Work { forest: &forest, writer, corners, options, progress, crcs: Vec::new(), oriented: false };
    work.leaves()?;
    work.inner()?;
    let Work { crcs, oriented, .. } = work;
    for Crc { node, plane, crc } in crcs {
        directory.nodes[node].crc[plane as usize] = crc;
    }
    directory.contents.oriented = oriented;
    Ok(())
}

/// Of a plane that has been written.
struct Crc {
    node: usize,
    plane: Plane,
    crc: u32,
}

struct Work<'w> {
    forest: &'w Forest<'w>,
    writer: &'w Writer,
    corners: &'w [[i64; 3]],
    options: &'w Options,
    progress: &'w dyn Progress,
    /// Later ones of the same plane count.
    crcs: Vec<Crc>,
    oriented: bool,
}

impl Work<'_> {
    /// The planes that a node has room for, of those that are derived.
    fn planes(&self, node: usize) -> Vec<Plane> {
        self.options.derive.planes().into_iter().filter(|&plane| self.forest.directory.nodes[node].has(plane)).collect()
    }

    fn put(&self, node: usize, plane: Plane, bytes: &[u8]) -> Result<Crc> {
        let (at, length) = self.forest.directory.nodes[node].range(plane);
        assert_eq!(bytes.len() as u64, length, "node {node}: {plane:?}");
        self.writer.put(at, bytes)?;
        Ok(Crc { node, plane, crc: crc32c::crc32c(bytes) })
    }

    fn put_all(&self, node: usize, derived: &Derived) -> Result<Vec<Crc>> {
        self.planes(node).into_iter().map(|plane| self.put(node, plane, derived.bytes(plane))).collect()
    }

    /// From the roots down, siblings one after the other: who works on one has what is beside it in memory.
    fn leaves_in_order(&self) -> Vec<usize> {
        let nodes = &self.forest.directory.nodes;
        let mut open: Vec<usize> = (0..self.forest.directory.roots as usize).rev().collect();
        let mut leaves = Vec::new();
        while let Some(node) = open.pop() {
            if nodes[node].is_leaf() {
                leaves.push(node);
            }
            open.extend(nodes[node].children().rev().filter(|_| !nodes[node].is_leaf()));
        }
        leaves
    }

    fn leaves(&mut self) -> Result<()> {
        let leaves = self.leaves_in_order();
        let nodes = &self.forest.directory.nodes;
        let passes = self.options.derive.has_normals() as u64 + self.options.derive.luminance as u64;
        let total = passes * leaves.iter().map(|&leaf| nodes[leaf].points).sum::<u64>();
        let done = AtomicU64::new(0);
        let found = |points: u64| self.progress.tick("looking around points", done.fetch_add(points, Relaxed) + points, total);
        let of_leaf = |&leaf: &usize| {
            let found = leaves::leaf(self.forest, leaf, self.options.derive, &found)?;
            let counts = leaves::radii(&found.derived);
            Ok((self.put_all(leaf, &found.derived)?, (nodes[leaf].lattice, counts), found.oriented))
        };
        let (mut crcs, mut radii) = (Vec::new(), BTreeMap::<u16, Vec<u64>>::new());
        let mut oriented = !leaves.is_empty();
        // Counts of one leaf at a time would be as many numbers as a leaf has points: they are added up soon.
        for some in leaves.chunks(8 * self.options.threads) {
            for (own, (lattice, counts), is_oriented) in some.par_iter().map(of_leaf).collect::<Result<Vec<_>>>()? {
                crcs.extend(own);
                oriented &= is_oriented;
                let sums = radii.entry(lattice).or_insert_with(|| vec![0; leaves::RADII]);
                counts.into_iter().for_each(|(radius, count)| sums[radius as usize] += count as u64);
            }
        }
        if self.options.derive.strokes {
            let largest: BTreeMap<u16, u32> = radii.iter().map(|(&lattice, counts)| (lattice, leaves::largest(counts))).collect();
            let cap = |&leaf: &usize| {
                let mut brushes = self.forest.bytes(leaf, Plane::Brush)?;
                let largest = largest[&nodes[leaf].lattice];
                brushes
                    .as_chunks_mut()
                    .0
                    .iter_mut()
                    .for_each(|brush| *brush = strokes::capped(u32::from_le_bytes(*brush), largest).to_le_bytes());
                self.put(leaf, Plane::Brush, &brushes)
            };
            crcs.extend(leaves.par_iter().map(cap).collect::<Result<Vec<_>>>()?);
        }
        self.crcs.extend(crcs);
        self.oriented = oriented;
        Ok(())
    }

    fn inner(&mut self) -> Result<()> {
        let nodes = &self.forest.directory.nodes;
        let deepest = nodes.iter().map(|node| node.level).max().unwrap_or(0);
        for level in (0..=deepest).rev() {
            self.progress.tick("joining", (deepest - level) as u64, deepest as u64 + 1)?;
            let at_level: Vec<usize> = (0..nodes.len()).filter(|&node| nodes[node].level == level && !nodes[node].is_leaf()).collect();
            let of_node = |&node: &usize| {
                let derived =
                    inner::node(self.forest, node, self.corners[nodes[node].lattice as usize], &self.planes(node), self.oriented)?;
                self.put_all(node, &derived)
            };
            let crcs = at_level.par_iter().map(of_node).collect::<Result<Vec<_>>>()?;
            self.crcs.extend(crcs.into_iter().flatten());
        }
        Ok(())
    }
}
