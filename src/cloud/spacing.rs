//! Point spacing: one measure for whole clouds and for nodes of an index.
//!
//! If the eighth nearest position lies at distance `r`, eight lie on a disc of `pi r^2`: they are
//! `sqrt(pi r^2 / 8)` apart, the root of the area per position. Positions measured repeatedly count
//! once.
//!
//! The result is the upper quartile over about two thousand positions, world, f64: sparser areas
//! have the larger gaps. It is exact for these seeds and independent of the order of points: the
//! seeds are binned on a grid, then every point visits the seeds in its own and the adjacent cells
//! only. The first cell size is guessed from the spacing of the seeds, not from the bounding box,
//! which one stray point inflates. It grows until the neighbours of three quarters of the seeds lie
//! within a cell's width, where none can be missed.

use super::strays::scatter_steps;
use super::{Cloud, Columns, Lattice, Part};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::HashMap;
use std::f64::consts::PI;
use std::hash::{BuildHasherDefault, Hasher};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// Growth of cells per round.
const GROWTH: f64 = 4.0;

/// Smallest cell relative to the widest extent: cells are numbered with i64, and points are not
/// distinguished below an `f64` of that extent.
const SMALLEST_CELL: f64 = 1.0 / (1u64 << 40) as f64;

/// Neighbours whose distance defines the spacing.
pub const NEIGHBOURS: usize = 8;

/// Returns the spacing of places, from the squared distance to the farthest of `neighbours` around
/// one.
pub fn apart(square: f64, neighbours: usize) -> f64 {
    (PI * square / neighbours as f64).sqrt()
}

/// Returns the upper quartile of `count` values, of which the smallest are given.
pub fn quartile(values: &mut [f64], count: usize) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(count * 3 / 4).or(values.last()).copied()
}

/// Approximate number of seeds.
pub const SEEDS: u64 = 2048;

/// Returns the spacing of a cloud; `None` for a single position.
pub fn spacing(cloud: &Cloud) -> Option<f64> {
    let parts = || cloud.parts.iter().filter(|part| !part.header.strays);
    let bounds = parts().filter_map(Part::bounds);
    let (lo, hi) =
        bounds.reduce(|(lo, hi), (part_lo, part_hi)| (lo.min(part_lo), hi.max(part_hi)))?;
    let seeds = seeds(cloud);
    let widest = (hi - lo).max_element();
    if !widest.is_finite() || widest <= 0.0 {
        return None;
    }
    // On a surface, n points are closer than m of them by the square root of m / n, and the eighth
    // is three times as far as the first.
    let closer = (seeds.len() as f64 / cloud.len() as f64).sqrt();
    let mut cell = between(&seeds)
        .map_or(widest, |distance| 8.0 * distance * closer)
        .max(widest * SMALLEST_CELL);
    loop {
        let around = around(cloud, &seeds, cell);
        let is_last = cell > 2.0 * widest;
        let is_settled = |found: &&Around| {
            is_last || found.count == NEIGHBOURS && found.squares[NEIGHBOURS - 1] <= cell * cell
        };
        let mut settled: Vec<f64> =
            around.iter().filter(is_settled).filter_map(Around::apart).collect();
        if is_last || settled.len() > seeds.len() * 3 / 4 {
            // Relative to all seeds: the unsettled ones are farther than any settled one.
            return quartile(&mut settled, seeds.len());
        }
        cell *= GROWTH;
    }
}

/// Squared distances to the nearest positions of a seed, ascending.
#[derive(Clone, Copy)]
pub struct Around {
    squares: [f64; NEIGHBOURS],
    places: [DVec3; NEIGHBOURS],
    count: usize,
}

impl Around {
    pub const NONE: Around = Around {
        squares: [f64::INFINITY; NEIGHBOURS],
        places: [DVec3::ZERO; NEIGHBOURS],
        count: 0,
    };

    pub fn add(&mut self, square: f64, place: DVec3) {
        if square >= self.squares[NEIGHBOURS - 1] || self.places[..self.count].contains(&place) {
            return;
        }
        let rank = self.squares.partition_point(|&nearer| nearer <= square);
        self.squares.copy_within(rank..NEIGHBOURS - 1, rank + 1);
        self.places.copy_within(rank..NEIGHBOURS - 1, rank + 1);
        (self.squares[rank], self.places[rank]) = (square, place);
        self.count = (self.count + 1).min(NEIGHBOURS);
    }

    /// Returns the spacing; `None` if there is no neighbour.
    pub fn apart(&self) -> Option<f64> {
        self.count.checked_sub(1).map(|last| apart(self.squares[last], self.count))
    }
}

/// Returns the median distance of each seed to its nearest; `None` for a single one.
fn between(seeds: &[DVec3]) -> Option<f64> {
    let nearest = |i: usize| {
        let others = seeds.iter().enumerate().filter(|(j, _)| *j != i);
        others
            .map(|(_, other)| other.distance_squared(seeds[i]))
            .fold(f64::INFINITY, f64::min)
            .sqrt()
    };
    let mut distances: Vec<f64> = (0..seeds.len()).into_par_iter().map(nearest).collect();
    distances.sort_by(f64::total_cmp);
    distances.get(distances.len() / 2).copied().filter(|distance| distance.is_finite())
}

/// Returns about this many distinct positions, chosen by a hash of their steps from the lower
/// corner, in any order of points.
fn seeds(cloud: &Cloud) -> Vec<DVec3> {
    let every = cloud.len().div_ceil(SEEDS).max(1);
    let of_part = |part: &Part| {
        let Some(extent) = part.columns.extent() else { return Vec::new() };
        let is_chosen =
            |place: &&[i32; 3]| u64::from(scatter_steps(**place, extent.low)) < (1 << 32) / every;
        let chosen = extent.samples.iter().filter(is_chosen);
        chosen.map(|place| part.lattice.world(place.map(i64::from))).collect::<Vec<_>>()
    };
    let mut seeds: Vec<DVec3> = cloud.parts.iter().flat_map(of_part).collect();
    seeds.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
    seeds.dedup();
    seeds
}

/// Returns the nearest positions of each seed, none missing within a distance of `cell`.
fn around(cloud: &Cloud, seeds: &[DVec3], cell: f64) -> Vec<Around> {
    let found: Vec<Mutex<Around>> = seeds.iter().map(|_| Mutex::new(Around::NONE)).collect();
    // The farthest relevant distance. Squared distances are positive, so their bits order as they
    // do.
    let bounds: Vec<AtomicU64> =
        seeds.iter().map(|_| AtomicU64::new(f64::INFINITY.to_bits())).collect();
    for part in &cloud.parts {
        let Columns { x, y, z, .. } = &part.columns;
        let grid = Grid::new(part.lattice, cell);
        let watching = grid.watching(part, seeds);
        // Few points are near a seed: one bit per hash of the cell rejects the others before the
        // map is queried.
        let mut near = Box::new([0u64; FILTER_BITS / 64]);
        for cell in watching.keys() {
            let bit = filter_bit(*cell);
            near[bit / 64] |= 1 << (bit % 64);
        }
        let visit = |q: [i64; 3], cell: [i64; 3]| {
            let p = part.lattice.world(q);
            for &seed in watching.get(&cell).into_iter().flatten() {
                let square = (p - seeds[seed]).length_squared();
                if square > 0.0 && square.to_bits() < bounds[seed].load(Ordering::Relaxed) {
                    let mut around =
                        found[seed].lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                    around.add(square, p);
                    bounds[seed].store(around.squares[NEIGHBOURS - 1].to_bits(), Ordering::Relaxed);
                }
            }
        };
        let [x, y, z] = [x, y, z].map(|column| column.par_chunks(TASK));
        x.zip(y).zip(z).for_each(|((x, y), z)| {
            for ((&x, &y), &z) in x.iter().zip(y).zip(z) {
                let q = [x, y, z].map(i64::from);
                let cell = grid.cell(q);
                let bit = filter_bit(cell);
                if near[bit / 64] >> (bit % 64) & 1 != 0 {
                    visit(q, cell);
                }
            }
        });
    }
    found
        .into_iter()
        .map(|around| around.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner()))
        .collect()
}

/// Cells of a power of two lattice steps per axis, found by a shift.
struct Grid {
    lattice: Lattice,
    shifts: [u32; 3],
}

impl Grid {
    /// Makes cells at least `width` wide, and a step more, for the rounding of seeds to steps.
    fn new(lattice: Lattice, width: f64) -> Grid {
        let shift = |step: f64| (width / step.abs() + 1.0).log2().ceil().clamp(0.0, 63.0) as u32;
        Grid { lattice, shifts: lattice.step.to_array().map(shift) }
    }

    fn cell(&self, q: [i64; 3]) -> [i64; 3] {
        [q[0] >> self.shifts[0], q[1] >> self.shifts[1], q[2] >> self.shifts[2]]
    }

    /// Returns the seeds near each cell: each seed is listed in all cells that see it, so that a
    /// point visits one cell only. Seeds far from the part are left out.
    fn watching(&self, part: &Part, seeds: &[DVec3]) -> Watching {
        let mut watching = Watching::default();
        let Some(extent) = part.columns.extent() else { return watching };
        let [low, high] = [extent.low, extent.high].map(|end| self.cell(end.map(i64::from)));
        for (index, &seed) in seeds.iter().enumerate() {
            let q = ((seed - self.lattice.offset) / self.lattice.step).round();
            let near = self.cell(q.to_array().map(|q| q as i64));
            let seen = [0, 1, 2].map(|axis: usize| {
                let [first, last] = [near[axis].saturating_sub(1), near[axis].saturating_add(1)];
                first.max(low[axis])..=last.min(high[axis])
            });
            for x in seen[0].clone() {
                for y in seen[1].clone() {
                    for z in seen[2].clone() {
                        watching.entry([x, y, z]).or_default().push(index);
                    }
                }
            }
        }
        watching
    }
}

/// Seeds near each cell.
type Watching = HashMap<[i64; 3], Vec<usize>, BuildHasherDefault<CellHasher>>;

/// Hashes cells by a multiplication a number: most points near seeds look one up.
#[derive(Default)]
struct CellHasher(u64);

impl Hasher for CellHasher {
    fn write(&mut self, bytes: &[u8]) {
        for number in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..number.len()].copy_from_slice(number);
            self.0 = (self.0.rotate_left(23) ^ u64::from_le_bytes(word))
                .wrapping_mul(0x9E37_79B9_7F4A_7C15);
        }
    }

    fn finish(&self) -> u64 {
        // The map takes its places from the low bits.
        self.0 ^ self.0 >> 32
    }
}

/// Points per task.
const TASK: usize = 1 << 15;

const FILTER_BITS: usize = 1 << 20;

/// Hashes a cell.
fn filter_bit([x, y, z]: [i64; 3]) -> usize {
    let mixed = (x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
        ^ (y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F)
        ^ (z as u64).wrapping_mul(0x1656_67B1_9E37_79F9);
    (mixed >> 44) as usize & (FILTER_BITS - 1)
}
