//! Derived attributes of a leaf's points.

use super::super::axes::Moments;
use super::super::clusters::{self, Cluster, NEAREST, NO_NEIGHBOUR};
use super::super::kd_tree::KdTree;
use super::super::knn_query::KnnQuery;
use super::super::leaf_cache::{Leaf, LeafCache};
use super::super::luminance::{self, NEIGHBOURS};
use super::super::normals::{self, FIT, Patch, Scratch};
use super::super::strokes::{self, Stroke};
use crate::cloud::{Columns, octahedral};
use crate::error::Result;
use crate::index::format::Plane;
use crate::index::format::samples::{DerivedColumns, DerivedPlanes};
use glam::DVec3;
use std::sync::Arc;

/// Points between checks for cancellation.
const BATCH: usize = 1 << 12;

/// Derived attributes of a leaf.
pub struct LeafAttributes {
    pub derived: DerivedColumns,
    /// Moments relative to the centre of the cloud, if strokes are derived.
    pub moments: Moments,
    /// True if all normals are those of the file.
    pub oriented: bool,
}

/// Derives a leaf's attributes. `corners` has the corner of the tree of every lattice `[steps]`;
/// `found` gets the number of points that each pass processes.
pub fn leaf(
    leaf_cache: &LeafCache,
    node: usize,
    corners: &[[i64; 3]],
    derive: DerivedPlanes,
    found: &(dyn Fn(u64) -> Result<()> + Sync),
) -> Result<LeafAttributes> {
    let own = leaf_cache.leaf(node)?;
    let record = &leaf_cache.directory.nodes[node];
    let (count, corner) = (own.tree.len(), corners[record.lattice as usize]);
    let luminance = derive.luminance && record.has(Plane::Corrected);
    let mut derived = DerivedColumns::zeroed(DerivedPlanes { luminance, ..derive }, count);
    let mut oriented = false;
    if let Some(facing) = &mut derived.facing {
        let bytes = if record.has(Plane::Normal) {
            leaf_cache.bytes(node, Plane::Normal)?
        } else {
            vec![0; 3 * count]
        };
        let normals: &[[u8; 3]] = bytes.as_chunks().0;
        let of_file: Vec<u32> =
            normals.iter().map(|normal| octahedral::of_bytes(normal.map(|v| v as i8))).collect();
        oriented = of_file.iter().all(|&normal| normal != octahedral::UNKNOWN);
        let patches = if oriented && !derive.strokes {
            None
        } else {
            Some(patches(leaf_cache, node, &own, found)?)
        };
        let clusters = derive
            .strokes
            .then(|| {
                patches.as_ref().map(|patches| clusters_around(leaf_cache, node, &own, patches))
            })
            .flatten();
        let clusters = clusters.transpose()?;
        for place in 0..count {
            let (number, steps) = (own.tree.number(place), own.tree.steps(place));
            let patch = patches.as_ref().map(|patches| patches[place]);
            let fitted = patch
                .and_then(|patch| patch.plane)
                .map_or(octahedral::UNKNOWN, |plane| octahedral::pack(plane.normal));
            let normal =
                if of_file[number] == octahedral::UNKNOWN { fitted } else { of_file[number] };
            let along = |axis: usize| own.origin[axis] - corner[axis] + steps[axis] as i64;
            let at = [0, 1, 2].map(|axis| along(axis) as i32);
            facing[number] = strokes::seeded(normal, at);
            if let (Some(brush), Some(Patch { radius_m, lonely, plane }), Some(clusters)) =
                (&mut derived.brush, patch, &clusters)
            {
                brush[number] =
                    Stroke { radius_m, lonely, plane, cluster: clusters[place] }.brush(normal);
            }
        }
    }
    if let Some(corrected) = &mut derived.corrected {
        let mut around = KnnQuery::of(leaf_cache, node, &own, true);
        for first in (0..count).step_by(BATCH) {
            let places = first..(first + BATCH).min(count);
            found(places.len() as u64)?;
            let colors = luminance::average(&mut around, places.clone(), NEIGHBOURS)?;
            places.zip(colors).for_each(|(place, color)| corrected[own.tree.number(place)] = color);
        }
    }
    let moments = if derive.strokes { moments(leaf_cache, node, &own) } else { Moments::default() };
    Ok(LeafAttributes { derived, moments, oriented })
}

fn moments(leaf_cache: &LeafCache, node: usize, own: &Leaf) -> Moments {
    let (lattice, middle) = (
        leaf_cache.lattice(node),
        leaf_cache.directory.contents.bounds.map_or(DVec3::ZERO, |[lo, hi]| (lo + hi) / 2.0),
    );
    let world = |place: usize| {
        let steps = own.tree.steps(place);
        lattice.world([0, 1, 2].map(|axis| own.origin[axis] + steps[axis] as i64))
    };
    Moments::of((0..own.tree.len()).map(|place| world(place) - middle))
}

/// Fits all points of a leaf, by their places.
fn patches(
    leaf_cache: &LeafCache,
    node: usize,
    own: &Leaf,
    found: &(dyn Fn(u64) -> Result<()> + Sync),
) -> Result<Vec<Patch>> {
    let (mut around, mut scratch) =
        (KnnQuery::of(leaf_cache, node, own, false), Scratch::default());
    let mut patches = Vec::with_capacity(own.tree.len());
    for place in 0..own.tree.len() {
        if place % BATCH == 0 {
            found(BATCH.min(own.tree.len() - place) as u64)?;
        }
        patches.push(normals::patch(&mut around, place, FIT, &mut scratch, &mut |_| {})?);
    }
    Ok(patches)
}

/// Margin around a leaf [median radii] within which clusters are found, so that a cluster cut by
/// the leaf's border does not seem small.
const HALO: f64 = 16.0;

/// Returns the cluster of each place; one cluster of everything, without shape, if there are no
/// colours.
fn clusters_around(
    leaf_cache: &LeafCache,
    node: usize,
    own: &Arc<Leaf>,
    patches: &[Patch],
) -> Result<Vec<Cluster>> {
    if own.colors.is_empty() {
        return Ok(vec![
            Cluster { points: leaf_cache.directory.contents.points, elongation: 1.0 };
            patches.len()
        ]);
    }
    let mut radii: Vec<f64> = patches.iter().map(|patch| patch.radius_m).collect();
    let middle = radii.len() / 2;
    let reach = HALO * *radii.select_nth_unstable_by(middle, f64::total_cmp).1;
    let mut columns = Columns::default();
    let mut colors = own.colors.clone();
    let mut add = |at: [i32; 3]| {
        columns.x.push(at[0]);
        columns.y.push(at[1]);
        columns.z.push(at[2]);
    };
    (0..own.tree.len()).for_each(|place| add(own.tree.steps(place)));
    let (step, extent) = (own.tree.step(), leaf_cache.directory.nodes[node].extent);
    for near in leaf_cache.beside(node, reach, false) {
        let leaf = leaf_cache.leaf(near.node)?;
        for place in 0..leaf.tree.len() {
            let steps = leaf.tree.steps(place);
            let at =
                [0, 1, 2].map(|axis| leaf.origin[axis] - own.origin[axis] + steps[axis] as i64);
            let outside = |axis: usize| {
                (-at[axis]).max(at[axis] - extent[axis] as i64).max(0) as f64 * step[axis]
            };
            // Points this near to a leaf of at most 2^30 steps fit 32 bits; a radius as large as a
            // leaf is no reason for more.
            if (0..3).all(|axis| outside(axis) <= reach && i32::try_from(at[axis]).is_ok()) {
                add(at.map(|steps| steps as i32));
                colors.push(leaf.colors[place]);
            }
        }
    }
    let tree = KdTree::new(&columns, &leaf_cache.lattice(node));
    let mut found = Vec::with_capacity(NEAREST);
    let near: Vec<[u32; NEAREST]> = (0..tree.len())
        .map(|place| {
            tree.nearest(place, NEAREST, &mut found);
            std::array::from_fn(|k| found.get(k).map_or(NO_NEIGHBOUR, |neighbour| neighbour.place))
        })
        .collect();
    let colors: Vec<[u8; 3]> = (0..tree.len()).map(|place| colors[tree.number(place)]).collect();
    let all = clusters::clusters(&tree, &near, &colors);
    let mut of = vec![Cluster::default(); tree.len()];
    (0..tree.len()).for_each(|place| of[tree.number(place)] = all.clusters[all.of[place] as usize]);
    of.truncate(own.tree.len());
    Ok(of)
}

/// Number of radii, as upper halves of f32.
pub const RADII: usize = 1 << 16;

/// Returns the histogram of radii.
pub fn radii(derived: &DerivedColumns) -> Vec<(u16, u32)> {
    let mut all: Vec<u16> =
        derived.brush.iter().flatten().map(|&brush| (brush >> 16) as u16).collect();
    all.sort_unstable();
    all.chunk_by(|a, b| a == b).map(|run| (run[0], run.len() as u32)).collect()
}

/// Returns the largest allowed stroke radius, as an upper half of f32.
pub fn largest(counts: &[u64]) -> u32 {
    let rank = strokes::rank(counts.iter().sum());
    let mut sum = 0;
    let at = counts.iter().position(|&count| {
        sum += count;
        sum > rank
    });
    at.unwrap_or(RADII - 1) as u32
}
