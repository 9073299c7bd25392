//! Points in, what a brush needs to know of each out: which way the surface faces, how large a stroke is, what it is part of (dos Anjos et al. 2018, sec. 3.2). Two words a point.
//!
//! ```text
//! of every point, in parallel:
//!     radius   mean distance to the nearest eight others + its standard deviation: what closes the surface, larger where points are sparse
//!     normal   of the plane through all points within three radii
//! clusters of like colour, where there are colours: small ones hold detail, long ones are painted along
//! ```
//! The words of a point depend on where it and its neighbours are, not on its number, the file's order or the threads: a stroke is the same in every frame.

use super::clusters::{self, Cluster, NEAR, NOBODY};
use super::file::{self, Index, PLANES};
use super::neighbours::Tree;
use super::normals::{self, Plane};
use crate::cloud::{Columns, Lattice};
use crate::config::BITS_PER_PLANE;
use crate::error::Result;
use crate::progress::{Progress, Silent};
use glam::DVec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Planes are fitted within so many radii.
const REACH: f64 = 3.0;
/// No radius is larger than that of all but this share of the points: a bird far from everything is no barn door (HARD_CASES 21).
const LONELY: f64 = 0.01;
/// Clusters of fewer points hold detail, and are painted in two layers.
const SMALL: u64 = 48;

/// What is known of a point.
#[derive(Clone, Copy, Debug)]
pub struct Stroke {
    pub radius_m: f64,
    /// None where the neighbours determine no plane.
    pub plane: Option<Plane>,
    pub cluster: Cluster,
}

/// What a point's neighbours tell of it.
#[derive(Clone, Copy)]
struct Around {
    radius: f64,
    plane: Option<Plane>,
    near: [u32; NEAR],
}

/// Of every point, in the order of the columns.
pub fn strokes(columns: &Columns, lattice: &Lattice, progress: &dyn Progress) -> Result<Vec<Stroke>> {
    let tree = Tree::new(columns, lattice);
    let step = lattice.step.abs().max_element();
    let (total, done) = (tree.len() as u64, AtomicU64::new(0));

    const CHUNK: usize = 1 << 12;
    let of_chunk = |first: usize| -> Result<Vec<Around>> {
        let last = (first + CHUNK).min(tree.len());
        let (mut found, mut differences) = (Vec::new(), Vec::new());
        let known = (first..last).map(|place| {
            tree.nearest(place, NEAR, &mut found);
            let near = std::array::from_fn(|k| found.get(k).map_or(NOBODY, |neighbour| neighbour.place));
            let radius = spread(found.iter().map(|neighbour| neighbour.squared.sqrt())).max(step / 2.0);
            tree.within(place, REACH * radius, &mut found);
            differences.clear();
            differences.extend(found.iter().map(|neighbour| tree.between(place, neighbour.place as usize)));
            Around { radius, plane: normals::plane(&differences, step), near }
        });
        let known = known.collect();
        progress.tick("painting", done.fetch_add((last - first) as u64, Relaxed), total)?;
        Ok(known)
    };
    let chunks: Vec<usize> = (0..tree.len()).step_by(CHUNK).collect();
    let known = chunks.into_par_iter().map(of_chunk).collect::<Result<Vec<_>>>()?.concat();

    let largest = cap(known.iter().map(|around| around.radius).collect());
    let clusters = columns.rgb.as_ref().map(|rgb| {
        let near: Vec<[u32; NEAR]> = known.par_iter().map(|around| around.near).collect();
        let colors: Vec<[u8; 3]> = (0..tree.len()).into_par_iter().map(|place| rgb[tree.number(place)]).collect();
        clusters::clusters(&tree, &near, &colors)
    });
    let cluster = |place: usize| match &clusters {
        Some(clusters) => clusters.clusters[clusters.of[place] as usize],
        // Without colours nothing says what belongs together: one cluster of everything, of no shape.
        None => Cluster { points: total, elongation: 1.0 },
    };
    let mut places = vec![0; tree.len()];
    (0..tree.len()).for_each(|place| places[tree.number(place)] = place);
    let stroke = |&place: &usize| {
        let Around { radius, plane, .. } = known[place];
        Stroke { radius_m: radius.min(largest), plane, cluster: cluster(place) }
    };
    Ok(places.par_iter().map(stroke).collect())
}

/// The words of a node of an index, which is looked at by itself, and the bytes read. An inner node's points stand for its children's, and lie as much farther apart as they are fewer: its strokes are
/// larger, and cover the same surface.
pub fn of_node(index: &Index, node: usize) -> Result<(Vec<[u32; 2]>, u64)> {
    let record = &index.nodes()[node];
    let count = record.count as usize;
    let (mut cells, mut words, mut read) = (vec![[0u32; 3]; count], vec![0u32; count], 0);
    for &(plane, bytes) in &PLANES[..record.position_planes() as usize] {
        index.read(node, plane, bytemuck::cast_slice_mut(&mut words))?;
        read += bytes * count as u64;
        let next = |cell: u32, word: u32, axis: usize| {
            cell << BITS_PER_PLANE | word >> (BITS_PER_PLANE as usize * axis) & ((1 << BITS_PER_PLANE) - 1)
        };
        cells.iter_mut().zip(&words).for_each(|(cells, &word)| *cells = std::array::from_fn(|axis| next(cells[axis], word, axis)));
    }
    let pad = BITS_PER_PLANE * record.position_planes() - record.bits as u32;
    let column = |axis: usize| cells.iter().map(|cells| (cells[axis] >> pad) as i32).collect();
    let mut columns = Columns { x: column(0), y: column(1), z: column(2), ..Columns::default() };
    if record.has(file::Plane::Rgb) {
        let mut bytes = vec![0; record.range(file::Plane::Rgb).1 as usize];
        index.read(node, file::Plane::Rgb, &mut bytes)?;
        read += bytes.len() as u64;
        columns.rgb = Some(bytes.as_chunks().0.to_vec());
    }
    let found = strokes(&columns, &index.lattice(record), &Silent)?;
    let at = |i: usize| [columns.x[i], columns.y[i], columns.z[i]];
    // Where it is in the whole cloud, which is the same in whatever node it is.
    let whole = |i: usize| std::array::from_fn(|axis| (record.origin[axis] + at(i)[axis] as i64) as i32);
    Ok((found.iter().enumerate().map(|(i, stroke)| stroke.words(whole(i))).collect(), read))
}

/// Mean and standard deviation of distances, together; 0 of none.
fn spread(distances: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = distances.clone().count().max(1) as f64;
    let mean = distances.clone().sum::<f64>() / count;
    mean + (distances.map(|distance| (distance - mean).powi(2)).sum::<f64>() / count).sqrt()
}

fn cap(mut radii: Vec<f64>) -> f64 {
    if radii.is_empty() {
        return 0.0;
    }
    let rank = (radii.len() as f64 * (1.0 - LONELY)) as usize;
    *radii.select_nth_unstable_by(rank, f64::total_cmp).1
}

/// Numbers of an octahedral coordinate: odd, so that 0 is one of them; the next one marks a normal that is not known.
const OCTAHEDRAL: f64 = 4094.0;
const UNKNOWN: u32 = 0xFFF;
/// Of the words' parts, as in glsl/lib/stroke.glsl.
const SEED_SHIFT: u32 = 24;
const SMALL_BIT: u32 = 1 << 7;
/// Elongations beyond 1, in steps of an eighth.
const ELONGATION_STEPS: f64 = 8.0;
const LONGEST: u32 = 31;

impl Stroke {
    /// What a point at these lattice steps brings to the device:
    ///   facing   the normal on an octahedron, 12 bits and 12 bits (Cigolle et al. 2014: 0.03 degrees off at most); eight bits that look random, for the brush
    ///   brush    radius, the upper half of an f32; where the points spread most, 256ths of a half turn from the normal's own tangent; the cluster: small or not, and how long
    pub fn words(&self, at: [i32; 3]) -> [u32; 2] {
        let [x, y] = self.plane.map_or([UNKNOWN; 2], |plane| octahedral(plane.normal));
        let facing = x | y << 12;
        let seed = scatter(at, facing) & 0xFF;
        let (small, long) = (self.cluster.points < SMALL, (self.cluster.elongation - 1.0) * ELONGATION_STEPS);
        let cluster = if small { SMALL_BIT } else { 0 } | (long.round() as u32).min(LONGEST);
        // Rounded up, so that no gap opens.
        let radius = (self.radius_m as f32).to_bits().saturating_add(0xFFFF) & 0xFFFF_0000;
        [facing | seed << SEED_SHIFT, radius | self.angle() << 8 | cluster]
    }

    /// From the tangent of the normal as it is stored, 256ths of a half turn.
    fn angle(&self) -> u32 {
        let Some(plane) = self.plane else { return 0 };
        let (tangent, bitangent) = householder(unpacked(octahedral(plane.normal)));
        let turns = plane.along.dot(bitangent).atan2(plane.along.dot(tangent)) / std::f64::consts::PI;
        (turns * 256.0).round().rem_euclid(256.0) as u32
    }
}

fn octahedral(normal: DVec3) -> [u32; 2] {
    let n = normal / normal.abs().element_sum();
    let fold = |a: f64, b: f64| (1.0 - b.abs()) * if a >= 0.0 { 1.0 } else { -1.0 };
    let (x, y) = if n.z >= 0.0 { (n.x, n.y) } else { (fold(n.x, n.y), fold(n.y, n.x)) };
    [x, y].map(|c| ((c * 0.5 + 0.5) * OCTAHEDRAL).round() as u32)
}

/// The normal that the device reads out of a word.
pub fn unpacked(code: [u32; 2]) -> DVec3 {
    let [x, y] = code.map(|c| c as f64 / (OCTAHEDRAL / 2.0) - 1.0);
    let z = 1.0 - x.abs() - y.abs();
    let fold = |a: f64, b: f64| (1.0 - b.abs()) * if a >= 0.0 { 1.0 } else { -1.0 };
    let n = if z >= 0.0 { DVec3::new(x, y, z) } else { DVec3::new(fold(x, y), fold(y, x), z) };
    n.normalize()
}

/// Tangent and bitangent of a unit normal (papers/README.md, dos Anjos; HARD_CASES 19).
pub fn householder(n: DVec3) -> (DVec3, DVec3) {
    let lateral = n.y * n.y + n.z * n.z;
    if lateral == 0.0 && n.x < 0.0 {
        return (DVec3::Y, DVec3::NEG_Z);
    }
    let h = if n.x >= 0.0 { 1.0 + n.x } else { lateral / (1.0 - n.x) };
    (DVec3::new(-n.y, 1.0 - n.y * n.y / h, -n.y * n.z / h), DVec3::new(-n.z, -n.y * n.z / h, 1.0 - n.z * n.z / h))
}

/// A number that looks random, of a place and a normal (the finaliser of SplitMix64, Steele et al. 2014).
fn scatter(at: [i32; 3], facing: u32) -> u32 {
    let [x, y, z] = at.map(|steps| steps as u32 as u64);
    let mut h = x ^ y.rotate_left(21) ^ z.rotate_left(42) ^ (facing as u64).rotate_left(11);
    h = (h ^ h >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    h = (h ^ h >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    (h ^ h >> 31) as u32
}
