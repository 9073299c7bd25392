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

use super::strays::Samples;
use super::{Cloud, Lattice, Part};
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
    let samples =
        cloud.parts.iter().filter_map(|part| Some((part.lattice, &part.columns.extent()?.samples)));
    let seeds = seeds(samples, cloud.len());
    let mut search = Search::new(seeds, cloud.len(), (hi - lo).max_element())?;
    loop {
        for part in &cloud.parts {
            let Some(extent) = part.columns.extent() else { continue };
            let watch = search.watch(part.lattice, [extent.low, extent.high]);
            let [x, y, z] = [0, 1, 2].map(|axis| part.columns.along(axis).par_chunks(TASK));
            x.zip(y).zip(z).for_each(|((x, y), z)| search.look(&watch, [x, y, z]));
        }
        match search.settle() {
            Round::Found(spacing) => return spacing,
            Round::Wider(wider) => search = wider,
        }
    }
}

/// A search for the neighbours of seeds, in rounds in which every point is looked at once.
pub struct Search {
    seeds: Vec<DVec3>,
    found: Vec<Mutex<Around>>,
    /// The farthest relevant distance of each seed. Squared distances are positive, so their bits
    /// order as they do.
    bounds: Vec<AtomicU64>,
    /// No position is missed within this distance.
    cell: f64,
    widest: f64,
}

/// Outcome of a round.
pub enum Round {
    Found(Option<f64>),
    /// Too few neighbours were near enough: the points are looked at again.
    Wider(Search),
}

/// The seeds that points of a part may be near.
pub struct Watch {
    grid: Grid,
    watching: Watching,
    /// Few points are near a seed: a bit per hash of the cell rejects the others before the map is
    /// queried.
    near: Box<[u64; FILTER_BITS / 64]>,
}

impl Search {
    /// Begins a search among `count` points, whose box is `widest` along its longest side; `None`
    /// if they have no extent.
    pub fn new(seeds: Vec<DVec3>, count: u64, widest: f64) -> Option<Search> {
        if !widest.is_finite() || widest <= 0.0 {
            return None;
        }
        // On a surface, n points are closer than m of them by the square root of m / n, and the
        // eighth is three times as far as the first.
        let closer = (seeds.len() as f64 / count as f64).sqrt();
        let cell = between(&seeds)
            .map_or(widest, |distance| 8.0 * distance * closer)
            .max(widest * SMALLEST_CELL);
        Some(Search::of(seeds, cell, widest))
    }

    fn of(seeds: Vec<DVec3>, cell: f64, widest: f64) -> Search {
        let found = seeds.iter().map(|_| Mutex::new(Around::NONE)).collect();
        let bounds = seeds.iter().map(|_| AtomicU64::new(f64::INFINITY.to_bits())).collect();
        Search { seeds, found, bounds, cell, widest }
    }

    /// Returns the seeds near points on a lattice, which lie within these corners
    /// `[lattice steps]`.
    pub fn watch(&self, lattice: Lattice, ends: [[i32; 3]; 2]) -> Watch {
        let grid = Grid::new(lattice, self.cell);
        let watching = grid.watching(ends, &self.seeds);
        let mut near = Box::new([0u64; FILTER_BITS / 64]);
        for cell in watching.keys() {
            let bit = filter_bit(*cell);
            near[bit / 64] |= 1 << (bit % 64);
        }
        Watch { grid, watching, near }
    }

    /// Looks at points, from any thread.
    pub fn look(&self, watch: &Watch, [x, y, z]: [&[i32]; 3]) {
        for ((&x, &y), &z) in x.iter().zip(y).zip(z) {
            let q = [x, y, z].map(i64::from);
            let cell = watch.grid.cell(q);
            let bit = filter_bit(cell);
            if watch.near[bit / 64] >> (bit % 64) & 1 != 0 {
                self.visit(watch, q, cell);
            }
        }
    }

    /// Looks at a point that is probably near a seed.
    fn visit(&self, watch: &Watch, q: [i64; 3], cell: [i64; 3]) {
        let p = watch.grid.lattice.world(q);
        for &seed in watch.watching.get(&cell).into_iter().flatten() {
            let square = (p - self.seeds[seed]).length_squared();
            if square > 0.0 && square.to_bits() < self.bounds[seed].load(Ordering::Relaxed) {
                let mut around =
                    self.found[seed].lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                around.add(square, p);
                self.bounds[seed]
                    .store(around.squares[NEIGHBOURS - 1].to_bits(), Ordering::Relaxed);
            }
        }
    }

    /// Ends a round.
    pub fn settle(self) -> Round {
        let Search { seeds, found, cell, widest, .. } = self;
        let is_last = cell > 2.0 * widest;
        let is_settled = |found: &Around| {
            is_last || found.count == NEIGHBOURS && found.squares[NEIGHBOURS - 1] <= cell * cell
        };
        let around = found
            .into_iter()
            .map(|around| around.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner()));
        let mut settled: Vec<f64> =
            around.filter(is_settled).filter_map(|found| found.apart()).collect();
        if is_last || settled.len() > seeds.len() * 3 / 4 {
            // Relative to all seeds: the unsettled ones are farther than any settled one.
            return Round::Found(quartile(&mut settled, seeds.len()));
        }
        Round::Wider(Search::of(seeds, cell * GROWTH, widest))
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

/// Returns about [`SEEDS`] distinct positions of `count` points, from lattices and samples of
/// parts.
pub fn seeds<'s>(parts: impl Iterator<Item = (Lattice, &'s Samples)>, count: u64) -> Vec<DVec3> {
    let every = count.div_ceil(SEEDS).max(1);
    let mut seeds = Vec::new();
    for (lattice, samples) in parts {
        let places = samples.places_below((1 << 32) / every);
        seeds.extend(places.map(|place| lattice.world(place.map(i64::from))));
    }
    seeds.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
    seeds.dedup();
    seeds
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
    fn watching(&self, ends: [[i32; 3]; 2], seeds: &[DVec3]) -> Watching {
        let mut watching = Watching::default();
        let [low, high] = ends.map(|end| self.cell(end.map(i64::from)));
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
