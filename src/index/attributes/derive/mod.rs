//! Derives the planes of an index that depend on neighbours: normals, strokes, and colours of one
//! luminance.
//!
//! ```text
//! leaves, on all cores: every point, from its neighbours in any leaves (`leaves`, `knn_query`)
//! radii of strokes: none larger than that of all but one in a hundred of a tree's points
//! inner nodes, from the deepest level up: every sample, from those of its children that it stands
//!   for (`inner`)
//! ```
//!
//! All of it is written to room that the file has for it, before there is a directory: an index is
//! complete or absent. The results depend neither on leaves, nor on threads or memory, and are
//! those of a cloud in memory.

mod inner;
mod leaves;

use super::axes::Moments;
use super::leaf_cache::{LeafCache, Read};
use super::strokes;
use crate::error::Result;
use crate::index::format::samples::{DerivedColumns, DerivedPlanes};
use crate::index::format::{Directory, NodeRecord, Plane, Writer};
use crate::progress::Progress;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// The attributes to derive, and resources for it.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    pub derive: DerivedPlanes,
    /// Bytes.
    pub memory: u64,
    pub threads: usize,
}

/// Derives the planes. `corners` has the corner of the tree of every lattice `[steps]`.
pub fn derive(
    directory: &mut Directory,
    writer: &Writer,
    corners: &[[i64; 3]],
    options: &Options,
    progress: &dyn Progress,
) -> Result<()> {
    let read = |at: u64, bytes: &mut [u8]| writer.get(at, bytes);
    let work = Work { writer, corners, options, progress };
    // Checksums are stored before anything is read again: a write that the disk has lost is found.
    let keep = |directory: &mut Directory, crcs: Vec<Crc>| {
        crcs.into_iter()
            .for_each(|Crc { node, plane, crc }| directory.nodes[node].crc[plane as usize] = crc);
    };
    let Leaves { crcs, radii, moments, oriented } =
        work.leaves(&work.leaf_cache(directory, &read))?;
    keep(directory, crcs);
    directory.contents.oriented = oriented;
    directory.contents.axes = moments.axes();
    if options.derive.strokes {
        let crcs = work.cap(&work.leaf_cache(directory, &read), &radii)?;
        keep(directory, crcs);
    }
    let deepest = directory.nodes.iter().map(|node| node.level).max().unwrap_or(0);
    for level in (0..=deepest).rev() {
        progress.tick("joining", (deepest - level) as u64, deepest as u64 + 1)?;
        let crcs = work.inner(&work.leaf_cache(directory, &read), level)?;
        keep(directory, crcs);
    }
    Ok(())
}

/// Checksum of a plane that has been written.
struct Crc {
    node: usize,
    plane: Plane,
    crc: u32,
}

/// Results of all leaves.
struct Leaves {
    crcs: Vec<Crc>,
    /// Histogram of stroke radii, per tree by its lattice.
    radii: BTreeMap<u16, Vec<u64>>,
    /// Moments of all points, if strokes are derived.
    moments: Moments,
    /// True if all normals are those of files.
    oriented: bool,
}

struct Work<'w> {
    writer: &'w Writer,
    corners: &'w [[i64; 3]],
    options: &'w Options,
    progress: &'w dyn Progress,
}

impl Work<'_> {
    fn leaf_cache<'f>(&self, directory: &'f Directory, read: &'f Read<'f>) -> LeafCache<'f> {
        // Half of the memory for cached leaves, a quarter for those that threads hold, the rest for
        // results.
        let Options { memory, threads, derive, .. } = *self.options;
        LeafCache::new(
            directory,
            read,
            derive.strokes || derive.luminance,
            memory / 2,
            memory / 4 / threads as u64,
        )
    }

    /// Returns the derived planes that a node has room for.
    fn planes(&self, record: &NodeRecord) -> Vec<Plane> {
        self.options.derive.planes().into_iter().filter(|&plane| record.has(plane)).collect()
    }

    fn put(&self, record: &NodeRecord, node: usize, plane: Plane, bytes: &[u8]) -> Result<Crc> {
        let (at, length) = record.range(plane);
        assert_eq!(bytes.len() as u64, length, "node {node}: {plane:?}");
        self.writer.put(at, bytes)?;
        Ok(Crc { node, plane, crc: crc32c::crc32c(bytes) })
    }

    fn put_all(
        &self,
        record: &NodeRecord,
        node: usize,
        derived: &DerivedColumns,
    ) -> Result<Vec<Crc>> {
        self.planes(record)
            .into_iter()
            .map(|plane| self.put(record, node, plane, derived.bytes(plane)))
            .collect()
    }

    /// Lists the leaves from the roots down, siblings consecutively, so that neighbours are in
    /// memory.
    fn leaves_in_order(directory: &Directory) -> Vec<usize> {
        let nodes = &directory.nodes;
        let mut open: Vec<usize> = (0..directory.roots as usize).rev().collect();
        let mut leaves = Vec::new();
        while let Some(node) = open.pop() {
            if nodes[node].is_leaf() {
                leaves.push(node);
            }
            open.extend(nodes[node].children().rev().filter(|_| !nodes[node].is_leaf()));
        }
        leaves
    }

    fn leaves(&self, leaf_cache: &LeafCache) -> Result<Leaves> {
        let leaves = Work::leaves_in_order(leaf_cache.directory);
        let nodes = &leaf_cache.directory.nodes;
        let passes =
            self.options.derive.has_normals() as u64 + self.options.derive.luminance as u64;
        let total = passes * leaves.iter().map(|&leaf| nodes[leaf].points).sum::<u64>();
        let done = AtomicU64::new(0);
        let found = |points: u64| {
            self.progress.tick(
                "looking around points",
                done.fetch_add(points, Relaxed) + points,
                total,
            )
        };
        let of_leaf = |&leaf: &usize| {
            let found = leaves::leaf(leaf_cache, leaf, self.corners, self.options.derive, &found)?;
            let counts = leaves::radii(&found.derived);
            Ok((
                self.put_all(&nodes[leaf], leaf, &found.derived)?,
                (nodes[leaf].lattice, counts),
                found.moments,
                found.oriented,
            ))
        };
        let mut all = Leaves {
            crcs: Vec::new(),
            radii: BTreeMap::new(),
            moments: Moments::default(),
            oriented: !leaves.is_empty(),
        };
        // A leaf's histogram has as many entries as radii: summed up early.
        for some in leaves.chunks(8 * self.options.threads) {
            for (own, (lattice, counts), moments, is_oriented) in
                some.par_iter().map(of_leaf).collect::<Result<Vec<_>>>()?
            {
                all.crcs.extend(own);
                all.oriented &= is_oriented;
                all.moments = all.moments.and(moments);
                let sums = all.radii.entry(lattice).or_insert_with(|| vec![0; leaves::RADII]);
                counts
                    .into_iter()
                    .for_each(|(radius, count)| sums[radius as usize] += count as u64);
            }
        }
        Ok(all)
    }

    /// Limits the strokes of leaves, see [`strokes::capped`].
    fn cap(&self, leaf_cache: &LeafCache, radii: &BTreeMap<u16, Vec<u64>>) -> Result<Vec<Crc>> {
        let nodes = &leaf_cache.directory.nodes;
        let largest: BTreeMap<u16, u32> =
            radii.iter().map(|(&lattice, counts)| (lattice, leaves::largest(counts))).collect();
        let of_leaf = |&leaf: &usize| {
            let mut brushes = leaf_cache.bytes(leaf, Plane::Brush)?;
            let largest = largest[&nodes[leaf].lattice];
            for brush in brushes.as_chunks_mut().0 {
                *brush = strokes::capped(u32::from_le_bytes(*brush), largest).to_le_bytes();
            }
            self.put(&nodes[leaf], leaf, Plane::Brush, &brushes)
        };
        Work::leaves_in_order(leaf_cache.directory).par_iter().map(of_leaf).collect()
    }

    fn inner(&self, leaf_cache: &LeafCache, level: u8) -> Result<Vec<Crc>> {
        let nodes = &leaf_cache.directory.nodes;
        let at_level: Vec<usize> = (0..nodes.len())
            .filter(|&node| nodes[node].level == level && !nodes[node].is_leaf())
            .collect();
        let oriented = leaf_cache.directory.contents.oriented;
        let of_node = |&node: &usize| {
            let record = &nodes[node];
            let derived =
                inner::node(leaf_cache, node, self.corners, &self.planes(record), oriented)?;
            self.put_all(record, node, &derived)
        };
        let crcs = at_level.par_iter().map(of_node).collect::<Result<Vec<_>>>()?;
        Ok(crcs.into_iter().flatten().collect())
    }
}
