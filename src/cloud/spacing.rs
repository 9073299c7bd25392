//! How far apart neighbouring points are.
//!
//! In: a cloud. Out: the median, over a few thousand points spread evenly through it, of the distance to the nearest other point, world, f64.
//! Exact for those seeds and deterministic: the seeds are binned on a grid, then every point looks at the seeds in its own and the adjacent cells
//! only. The first cell is guessed from how far apart the seeds themselves are, not from the bounding box, which one stray point inflates.
//! It grows until the nearest point of half the seeds lies within a cell's width, where it cannot be missed: all that a median needs.

use super::{Cloud, Part};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};

const SEEDS: u64 = 2048;

/// Cells grow by this factor a round.
const GROWTH: f64 = 4.0;

/// Of the widest extent: cells are numbered with i64, and points are not told apart below an `f64` of that extent.
const SMALLEST_CELL: f64 = 1.0 / (1u64 << 40) as f64;

/// Coincident points are one place measured twice, and say nothing about spacing: a distance of 0 does not count.
pub fn spacing(cloud: &Cloud) -> Option<f64> {
    let parts = || cloud.parts.iter().filter(|part| !part.header.strays);
    let bounds = parts().filter_map(Part::bounds);
    let (lo, hi) = bounds.reduce(|(lo, hi), (part_lo, part_hi)| (lo.min(part_lo), hi.max(part_hi)))?;
    let seeds = seeds(cloud);
    let widest = (hi - lo).max_element();
    if !widest.is_finite() || widest <= 0.0 {
        return None;
    }
    // On a surface, n points are closer than m of them by the square root of m / n.
    let closer = (seeds.len() as f64 / cloud.len() as f64).sqrt();
    let mut cell = between(&seeds).map_or(widest, |distance| 2.0 * distance * closer).max(widest * SMALLEST_CELL);
    loop {
        let nearest = nearest(cloud, &seeds, lo, cell);
        let mut settled: Vec<f64> = nearest.into_iter().filter(|&distance| distance <= cell).collect();
        if settled.len() * 2 > seeds.len() {
            settled.sort_by(f64::total_cmp);
            // The median of all seeds: the unsettled ones are farther than any settled one.
            return settled.get(seeds.len().div_ceil(2) - 1).or(settled.last()).copied();
        }
        if cell > 2.0 * widest {
            return settled.into_iter().max_by(f64::total_cmp);
        }
        cell *= GROWTH;
    }
}

/// The median distance among the seeds, each to its nearest; `None` for a single one.
fn between(seeds: &[DVec3]) -> Option<f64> {
    let nearest = |i: usize| {
        let others = seeds.iter().enumerate().filter(|(j, _)| *j != i);
        others.map(|(_, other)| other.distance_squared(seeds[i])).fold(f64::INFINITY, f64::min).sqrt()
    };
    let mut distances: Vec<f64> = (0..seeds.len()).into_par_iter().map(nearest).collect();
    distances.sort_by(f64::total_cmp);
    distances.get(distances.len() / 2).copied().filter(|distance| distance.is_finite())
}

/// Evenly through the file's order, each place once.
fn seeds(cloud: &Cloud) -> Vec<DVec3> {
    let stride = cloud.len().div_ceil(SEEDS).max(1);
    let mut seeds = Vec::new();
    let mut next = stride / 2;
    let mut before = 0;
    for part in &cloud.parts {
        let count = part.columns.len() as u64;
        while next < before + count {
            let i = (next - before) as usize;
            seeds.push(part.lattice.world([part.columns.x[i].into(), part.columns.y[i].into(), part.columns.z[i].into()]));
            next += stride;
        }
        before += count;
    }
    seeds.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
    seeds.dedup();
    seeds
}

/// For each seed the distance to its nearest other place, infinite if that is beyond the adjacent cells.
fn nearest(cloud: &Cloud, seeds: &[DVec3], lo: DVec3, cell: f64) -> Vec<f64> {
    let key = |p: DVec3| ((p - lo) / cell).floor().as_i64vec3().to_array();
    // Each seed in all cells that see it, so that a point looks into one cell only.
    let mut watching: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
    for (index, &seed) in seeds.iter().enumerate() {
        let [x, y, z] = key(seed);
        for offset in 0..27 {
            watching.entry([x + offset / 9 - 1, y + offset / 3 % 3 - 1, z + offset % 3 - 1]).or_default().push(index);
        }
    }
    // Few points are near a seed: one bit a coarse hash of the cell turns the others away before the map is asked.
    let mut near = vec![0u64; FILTER_BITS / 64];
    for cell in watching.keys() {
        let bit = filter_bit(*cell);
        near[bit / 64] |= 1 << (bit % 64);
    }
    // Squared distances are positive, so their bits order as they do.
    let best: Vec<AtomicU64> = seeds.iter().map(|_| AtomicU64::new(f64::INFINITY.to_bits())).collect();
    for part in &cloud.parts {
        let columns = &part.columns;
        (0..columns.len()).into_par_iter().with_min_len(1 << 15).for_each(|i| {
            let p = part.lattice.world([columns.x[i].into(), columns.y[i].into(), columns.z[i].into()]);
            let cell = key(p);
            let bit = filter_bit(cell);
            if near[bit / 64] >> (bit % 64) & 1 == 0 {
                return;
            }
            for &seed in watching.get(&cell).into_iter().flatten() {
                let squared = (p - seeds[seed]).length_squared();
                if squared > 0.0 {
                    best[seed].fetch_min(squared.to_bits(), Ordering::Relaxed);
                }
            }
        });
    }
    best.iter().map(|bits| f64::from_bits(bits.load(Ordering::Relaxed)).sqrt()).collect()
}

const FILTER_BITS: usize = 1 << 20;

fn filter_bit([x, y, z]: [i64; 3]) -> usize {
    let hash = (x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
        ^ (y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F)
        ^ (z as u64).wrapping_mul(0x1656_67B1_9E37_79F9);
    (hash >> 44) as usize & (FILTER_BITS - 1)
}
