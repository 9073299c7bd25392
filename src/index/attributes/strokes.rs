//! Brush strokes: surface normal, size and cluster of every point (dos Anjos et al. 2018, sec.
//! 3.2), as two words per point.
//!
//! ```text
//! of every point, in parallel:
//!     radius   mean distance to the nearest eight others + its standard deviation, or what closes
//!              the gap to surrounding points: larger where points are sparse
//!     normal   of the plane through all points within three radii (`normals`)
//! clusters of similar colour, if there are colours: small ones hold detail, long ones are painted
//!   along
//! ```
//!
//! The words of a point depend on its position and neighbours, not on its number, the file's order
//! or the threads: a stroke is the same in every frame.

use super::clusters::{self, Cluster, NEAREST, NO_NEIGHBOUR};
use super::knn_query::KnnQuery;
use super::leaf_cache::Leaf;
use super::normals::{self, FIT, Patch, Plane, Scratch};
use crate::cloud::strays::relative;
use crate::cloud::{Columns, Lattice, octahedral};
use crate::config::BITS_PER_PLANE;
use crate::error::Result;
use crate::index::format::{self, Index, PLANES};
use crate::progress::{Progress, Silent};
use blake3::{Hash, Hasher};
use glam::DVec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard};

/// Share of points whose radii bound that of an isolated point, so that a bird far from everything
/// is not painted as large as a barn door (guide: numerics, case 21).
const ISOLATED_SHARE: f64 = 0.01;
/// Factor on that bound for other points, which lie as sparsely as their neighbours. A power of
/// two, so that radii and the upper halves of f32 are bounded alike.
const COMMON_FACTOR: f64 = (1 << COMMON_POWER) as f64;
const COMMON_POWER: u32 = 1;
/// Clusters of fewer points are detail, and painted in two layers.
const SMALL_CLUSTER: u64 = 48;

/// Stroke parameters of a point.
#[derive(Clone, Copy, Debug)]
pub struct Stroke {
    pub radius_m: f64,
    /// See [`Patch::lonely`].
    pub lonely: bool,
    /// `None` if the neighbours determine no plane.
    pub plane: Option<Plane>,
    pub cluster: Cluster,
}

/// Cache of strokes by part, so that showing other colours or more files does not compute them
/// again.
#[derive(Default)]
pub struct StrokeCache(Mutex<Vec<CachedWords>>);

struct CachedWords {
    input_hash: Hash,
    words: Arc<Vec<[u32; 2]>>,
    /// True if the current cloud has requested it.
    requested: bool,
}

/// Returns the hash of all that a part's strokes depend on: positions and colours.
fn input_hash(columns: &Columns, lattice: &Lattice) -> Hash {
    let mut hasher = Hasher::new();
    let places = [lattice.step, lattice.offset].map(|place| place.to_array());
    hasher.update(bytemuck::bytes_of(&places)).update(&columns.len().to_le_bytes());
    for column in [&columns.x, &columns.y, &columns.z] {
        hasher.update(bytemuck::cast_slice(column));
    }
    if let Some(colors) = &columns.rgb {
        hasher.update(bytemuck::cast_slice(colors));
    }
    hasher.finalize()
}

impl StrokeCache {
    /// Returns the words of every point, in the order of the columns.
    pub fn of(
        &self,
        columns: &Columns,
        lattice: &Lattice,
        progress: &dyn Progress,
    ) -> Result<Arc<Vec<[u32; 2]>>> {
        let input_hash = input_hash(columns, lattice);
        if let Some(kept) = self.all().iter_mut().find(|kept| kept.input_hash == input_hash) {
            kept.requested = true;
            return Ok(kept.words.clone());
        }
        let words = Arc::new(words(columns, lattice, progress)?);
        self.all().push(CachedWords { input_hash, words: words.clone(), requested: true });
        Ok(words)
    }

    /// Drops what has not been requested since the last call.
    pub fn retain_requested(&self) {
        let mut all = self.all();
        all.retain(|kept| kept.requested);
        all.iter_mut().for_each(|kept| kept.requested = false);
    }

    fn all(&self) -> MutexGuard<'_, Vec<CachedWords>> {
        self.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }
}

/// Returns the words of every point, in the order of the columns.
pub fn words(
    columns: &Columns,
    lattice: &Lattice,
    progress: &dyn Progress,
) -> Result<Vec<[u32; 2]>> {
    let found = strokes(columns, lattice, progress)?;
    let corner = columns.extent().map_or([0; 3], |extent| extent.low);
    let at = |i: usize| relative([columns.x[i], columns.y[i], columns.z[i]], corner);
    Ok(found.par_iter().enumerate().map(|(i, stroke)| stroke.words(at(i))).collect())
}

/// Computes the strokes of all points, in the order of the columns.
pub fn strokes(
    columns: &Columns,
    lattice: &Lattice,
    progress: &dyn Progress,
) -> Result<Vec<Stroke>> {
    let leaf = Leaf::of(columns, lattice, [0; 3], columns.rgb.is_some());
    let tree = &leaf.tree;
    let (total, done) = (tree.len() as u64, AtomicU64::new(0));

    const CHUNK: usize = 1 << 12;
    let of_chunk = |first: usize| -> Result<Vec<(Patch, [u32; NEAREST])>> {
        let last = (first + CHUNK).min(tree.len());
        let (mut around, mut scratch) = (KnnQuery::alone(&leaf), Scratch::default());
        let known = (first..last).map(|place| {
            let mut near = [NO_NEIGHBOUR; NEAREST];
            let patch = normals::patch(&mut around, place, FIT, &mut scratch, &mut |found| {
                near.iter_mut().zip(found).for_each(|(near, neighbour)| *near = neighbour.place);
            })?;
            Ok((patch, near))
        });
        let known = known.collect::<Result<Vec<_>>>()?;
        progress.tick("painting", done.fetch_add((last - first) as u64, Relaxed), total)?;
        Ok(known)
    };
    let chunks: Vec<usize> = (0..tree.len()).step_by(CHUNK).collect();
    let known = chunks.into_par_iter().map(of_chunk).collect::<Result<Vec<_>>>()?.concat();

    let largest = cap(known.iter().map(|(patch, _)| patch.radius_m).collect());
    let clusters = columns.rgb.is_some().then(|| {
        let near: Vec<[u32; NEAREST]> = known.par_iter().map(|(_, near)| *near).collect();
        clusters::clusters(tree, &near, &leaf.colors)
    });
    let cluster = |place: usize| match &clusters {
        Some(clusters) => clusters.clusters[clusters.of[place] as usize],
        // Without colours there is one cluster of all points, without shape.
        None => Cluster { points: total, elongation: 1.0 },
    };
    let mut places = vec![0; tree.len()];
    (0..tree.len()).for_each(|place| places[tree.number(place)] = place);
    let stroke = |&place: &usize| {
        let (Patch { radius_m, lonely, plane }, _) = known[place];
        let most = if lonely { largest } else { COMMON_FACTOR * largest };
        Stroke { radius_m: radius_m.min(most), lonely, plane, cluster: cluster(place) }
    };
    Ok(places.par_iter().map(stroke).collect())
}

/// Returns the words of a node, computed from its own samples alone, and the bytes read. Samples of
/// an inner node are as much farther apart as they are fewer, so that their strokes are larger and
/// cover the same surface.
pub fn of_node(index: &Index, node: usize) -> Result<(Vec<[u32; 2]>, u64)> {
    let record = &index.nodes()[node];
    let count = record.count as usize;
    let (mut cells, mut words, mut read) = (vec![[0u32; 3]; count], vec![0u32; count], 0);
    for &(plane, _) in &PLANES[..record.position_planes() as usize] {
        read += index.read(node, plane, bytemuck::cast_slice_mut(&mut words))?;
        let next = |cell: u32, word: u32, axis: usize| {
            cell << BITS_PER_PLANE
                | word >> (BITS_PER_PLANE as usize * axis) & ((1 << BITS_PER_PLANE) - 1)
        };
        cells.iter_mut().zip(&words).for_each(|(cells, &word)| {
            *cells = std::array::from_fn(|axis| next(cells[axis], word, axis))
        });
    }
    let pad = BITS_PER_PLANE * record.position_planes() - record.bits as u32;
    let column = |axis: usize| cells.iter().map(|cells| (cells[axis] >> pad) as i32).collect();
    let mut columns = Columns { x: column(0), y: column(1), z: column(2), ..Columns::default() };
    if record.has(format::Plane::Rgb) {
        let mut bytes = vec![0; record.range(format::Plane::Rgb).1 as usize];
        read += index.read(node, format::Plane::Rgb, &mut bytes)?;
        columns.rgb = Some(bytes.as_chunks().0.to_vec());
    }
    let found = strokes(&columns, &index.lattice(record), &Silent)?;
    let at = |i: usize| [columns.x[i], columns.y[i], columns.z[i]];
    // Position in the whole tree, independent of the node. Rounded ones count from its corner.
    let corner = if record.lattice.is_multiple_of(2) { index.tree_corner(record) } else { [0; 3] };
    let whole = |i: usize| {
        let along = |axis: usize| record.origin[axis] - corner[axis] + at(i)[axis] as i64;
        std::array::from_fn(|axis| along(axis) as i32)
    };
    Ok((found.iter().enumerate().map(|(i, stroke)| stroke.words(whole(i))).collect(), read))
}

/// Returns the rank of the largest allowed radius among sorted radii.
pub fn rank(points: u64) -> u64 {
    (points as f64 * (1.0 - ISOLATED_SHARE)) as u64
}

fn cap(mut radii: Vec<f64>) -> f64 {
    if radii.is_empty() {
        return 0.0;
    }
    let rank = rank(radii.len() as u64) as usize;
    *radii.select_nth_unstable_by(rank, f64::total_cmp).1
}

/// Bit layout of the words, as in glsl/lib/stroke.glsl.
const SEED_SHIFT: u32 = 24;
const RADIUS_BITS: u32 = 0xFFFF_0000;
/// Shift of the exponent in an f32's upper half.
const EXPONENT_SHIFT: u32 = 7;
const ANGLE_SHIFT: u32 = 8;
const SMALL_BIT: u32 = 1 << 7;
const LONELY_BIT: u32 = 1 << 6;
/// Steps per unit of elongation beyond 1.
const ELONGATION_STEPS: f64 = 8.0;
const MAX_ELONGATION: u32 = 31;

impl Stroke {
    /// Returns the words of a point at these lattice steps from the lower corner:
    ///
    /// - facing: the normal on an octahedron, in 24 bits (`octahedral`); eight pseudo-random bits
    ///   for the brush
    /// - brush: radius, as the upper half of an f32; direction of largest spread, in 256ths of a
    ///   half turn from the normal's tangent; the cluster: small or not, and its elongation;
    ///   whether the point is isolated
    pub fn words(&self, at: [i32; 3]) -> [u32; 2] {
        let normal = self.plane.map_or(octahedral::UNKNOWN, |plane| octahedral::pack(plane.normal));
        [seeded(normal, at), self.brush(normal)]
    }

    /// Returns the brush word for a normal as stored: the plane's own, or a better one.
    pub fn brush(&self, normal: u32) -> u32 {
        let (small, long) = (
            self.cluster.points < SMALL_CLUSTER,
            (self.cluster.elongation - 1.0) * ELONGATION_STEPS,
        );
        let cluster = if small { SMALL_BIT } else { 0 } | (long.round() as u32).min(MAX_ELONGATION);
        let angle = octahedral::unpack(normal)
            .zip(self.plane)
            .map_or(0, |(normal, plane)| angle(normal, plane.along));
        radius_bits(self.radius_m)
            | angle << ANGLE_SHIFT
            | cluster
            | if self.lonely { LONELY_BIT } else { 0 }
    }
}

/// Rounds a radius up, so that no gap opens.
fn radius_bits(radius_m: f64) -> u32 {
    (radius_m as f32).to_bits().saturating_add(!RADIUS_BITS) & RADIUS_BITS
}

/// Returns the radius of a brush word `[m]`.
pub fn radius_m(brush: u32) -> f32 {
    f32::from_bits(brush & RADIUS_BITS)
}

/// Limits a brush's radius to `largest`, in units of an f32's upper half, for isolated points, and
/// to COMMON_FACTOR times that for others.
pub fn capped(brush: u32, largest: u32) -> u32 {
    let most =
        if brush & LONELY_BIT == 0 { largest + (COMMON_POWER << EXPONENT_SHIFT) } else { largest };
    (brush >> 16).min(most) << 16 | brush & !RADIUS_BITS
}

/// Returns the angle of `along` from the tangent of a stored normal [256ths of a half turn].
fn angle(normal: DVec3, along: DVec3) -> u32 {
    let (tangent, bitangent) = householder(normal);
    let turns = along.dot(bitangent).atan2(along.dot(tangent)) / std::f64::consts::PI;
    (turns * 256.0).round().rem_euclid(256.0) as u32
}

/// Returns a brush with another radius and normal, along the same direction.
pub fn turned(brush: u32, from: u32, to: u32, radius_m: f64) -> u32 {
    let turn = octahedral::unpack(from).zip(octahedral::unpack(to)).map_or(0, |(from, to)| {
        let (tangent, bitangent) = householder(from);
        let half_turns = (brush >> ANGLE_SHIFT & 0xFF) as f64 / 256.0;
        let (sin, cos) = (half_turns * std::f64::consts::PI).sin_cos();
        angle(to, tangent * cos + bitangent * sin)
    });
    radius_bits(radius_m) | turn << ANGLE_SHIFT | brush & 0xFF
}

/// Returns tangent and bitangent of a unit normal (dos Anjos et al. 2018, see guide: papers; guide:
/// numerics, case 19).
pub fn householder(n: DVec3) -> (DVec3, DVec3) {
    let lateral = n.y * n.y + n.z * n.z;
    if lateral == 0.0 && n.x < 0.0 {
        return (DVec3::Y, DVec3::NEG_Z);
    }
    let h = if n.x >= 0.0 { 1.0 + n.x } else { lateral / (1.0 - n.x) };
    (
        DVec3::new(-n.y, 1.0 - n.y * n.y / h, -n.y * n.z / h),
        DVec3::new(-n.z, -n.y * n.z / h, 1.0 - n.z * n.z / h),
    )
}

/// Adds the pseudo-random bits of a point, which lies these lattice steps from the lower corner of
/// its part or tree, to a normal's word.
pub fn seeded(facing: u32, at: [i32; 3]) -> u32 {
    facing | (scatter(at, facing) & 0xFF) << SEED_SHIFT
}

/// Hashes a position and a normal (the finaliser of SplitMix64, Steele et al. 2014).
fn scatter(at: [i32; 3], facing: u32) -> u32 {
    let [x, y, z] = at.map(|steps| steps as u32 as u64);
    let mut h = x ^ y.rotate_left(21) ^ z.rotate_left(42) ^ (facing as u64).rotate_left(11);
    h = (h ^ h >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    h = (h ^ h >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    (h ^ h >> 31) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cached_strokes_are_reused_until_points_change_or_are_not_requested() {
        let columns = |moved: i32| Columns {
            x: (0..5000).map(|i| i % 71).collect(),
            y: (0..5000).map(|i| i / 71).collect(),
            z: (0..5000).map(|i| if i == 2500 { moved } else { 0 }).collect(),
            rgb: Some(vec![[9, 9, 9]; 5000]),
            ..Columns::default()
        };
        let lattice = Lattice { step: DVec3::splat(0.01), offset: DVec3::ZERO };
        let found = StrokeCache::default();
        let of = |columns: &Columns| found.of(columns, &lattice, &Silent).unwrap();
        let (here, other) = (of(&columns(0)), of(&columns(3)));
        assert!(*here == words(&columns(0), &lattice, &Silent).unwrap() && here != other);
        assert!(Arc::ptr_eq(&here, &of(&columns(0))));
        let repainted = Columns { rgb: Some(vec![[200, 9, 9]; 5000]), ..columns(0) };
        assert!(!Arc::ptr_eq(&here, &of(&repainted)));
        found.retain_requested();
        of(&columns(0));
        found.retain_requested();
        assert!(Arc::ptr_eq(&here, &of(&columns(0))) && !Arc::ptr_eq(&other, &of(&columns(3))));
    }
}
