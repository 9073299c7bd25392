//! Sample of points for exposures: all, or, if they are many, those of some blocks of space, whole,
//! so that overlaps stay together.
//!
//! The choice depends only on the cloud's bounds and number of points: building an index chooses
//! the same points as a cloud in memory.

use crate::cloud::colormap::linear_to_srgb;
use crate::cloud::{Cloud, Part};
use crate::index::format::morton;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Points per task.
const RUN: usize = 1 << 16;
/// Points whose cells are computed together.
const BLOCK: usize = 1 << 10;
/// Bits of the finest cells per axis that a code has room for.
pub const AXIS_BITS: u32 = 21;
/// Target size of the sample; beyond it whole blocks are left out, of which there are 2^7 per axis.
const SAMPLE: u64 = 1 << 20;
const BLOCK_BITS: u32 = 7;
/// Largest sample: while blocks near a scanner make it larger, half of the blocks are left out.
const MAX_SAMPLE: usize = 2 * SAMPLE as usize;

/// A coloured point: Morton code of its finest cell, station, and V.
pub type Point = (u64, u16, u8);

/// The finest cells over a cloud.
#[derive(Clone, Copy)]
struct Cells {
    lo: DVec3,
    /// Reciprocal of the cell size [1/m].
    per_metre: f64,
}

impl Cells {
    /// Creates cells over slightly more than the box, so that its far sides are inside.
    fn over((lo, hi): (DVec3, DVec3)) -> Cells {
        Cells {
            lo,
            per_metre: (1u64 << AXIS_BITS) as f64
                / (1.001 * (hi - lo).max_element()).max(f64::MIN_POSITIVE),
        }
    }

    /// Returns the nearest cell.
    fn of(self, place: DVec3) -> [u32; 3] {
        [0, 1, 2].map(|axis| self.along(axis, place[axis]))
    }

    /// Returns the nearest cell along an axis. Adding 2^52 leaves the bits of the integer, without
    /// a conversion.
    #[inline]
    fn along(self, axis: usize, at: f64) -> u32 {
        const WHOLE: f64 = (1u64 << 52) as f64;
        ((at - self.lo[axis]) * self.per_metre + WHOLE).to_bits() as u32
    }
}

/// What points show: colours, or intensities as greys.
pub enum Values {
    Colors,
    /// The grey of each intensity.
    Intensities(Vec<u8>),
}

impl Values {
    /// Returns intensities as [`greys`].
    pub fn of_intensities(full: u32) -> Values {
        Values::Intensities(greys(full))
    }
}

/// Returns the grey of each intensity, light being proportional to it, and `full` the brightest.
pub fn greys(full: u32) -> Vec<u8> {
    let grey = |v: u32| linear_to_srgb(v as f64 / full.max(1) as f64).min(1.0);
    (0..1 << 16).map(|v| (255.0 * grey(v)).round() as u8).collect()
}

/// Returns the sample of a cloud, in order.
pub fn some(cloud: &Cloud, values: &Values) -> Option<Vec<Point>> {
    Some(Sample::new(cloud.bounds()?, cloud.len()).points_of(cloud, values))
}

/// A sample of points that arrive in any order, from any thread.
pub struct Sample {
    cells: Cells,
    /// A bit per block, x highest; `None` if all are wanted.
    wanted: Option<Vec<u64>>,
    kept: Mutex<Kept>,
}

impl Sample {
    /// Creates a sample of a number of points within a box.
    pub fn new(bounds: (DVec3, DVec3), points: u64) -> Sample {
        Sample::of(bounds, max_block_hash(points), MAX_SAMPLE)
    }

    /// Creates a sample of the blocks whose hashed number is at most `most`, and of fewer if they
    /// hold more than `limit` points.
    pub fn of(bounds: (DVec3, DVec3), most: u64, limit: usize) -> Sample {
        // Bits of a number spread as in a code, x lowest.
        let spread: [u64; 1 << BLOCK_BITS] =
            std::array::from_fn(|axis| morton::code_63([axis as u32, 0, 0]));
        let word = |word: usize| {
            let axis = |number: usize, axis: u32| {
                spread[number >> (axis * BLOCK_BITS) & ((1 << BLOCK_BITS) - 1)]
            };
            let block =
                |number: usize| axis(number, 2) | axis(number, 1) << 1 | axis(number, 0) << 2;
            (0..64).fold(0, |bits, bit| {
                bits | ((block_hash(block(word << 6 | bit)) <= most) as u64) << bit
            })
        };
        let wanted = (most < u64::MAX)
            .then(|| (0..1usize << (3 * BLOCK_BITS - 6)).into_par_iter().map(word).collect());
        Sample {
            cells: Cells::over(bounds),
            wanted,
            kept: Mutex::new(Kept { most, limit, points: Vec::new() }),
        }
    }

    /// Returns the cell of a place, if its block is wanted. Samples of the same bounds and number
    /// of points want the same.
    #[inline]
    pub fn cell(&self, place: DVec3) -> Option<[u32; 3]> {
        Some(self.cell_of(place)).filter(|&cell| self.wants(cell))
    }

    #[inline]
    pub fn cell_of(&self, place: DVec3) -> [u32; 3] {
        self.cells.of(place)
    }

    /// Begins points of which those of blocks that are wanted by now are kept.
    pub fn begin(&self) -> Begun {
        let most = self.kept.lock().unwrap_or_else(PoisonError::into_inner).most;
        Begun { most, points: Vec::new() }
    }

    #[inline]
    fn wants(&self, cell: [u32; 3]) -> bool {
        let Some(wanted) = &self.wanted else { return true };
        let block = cell.into_iter().fold(0, |block, axis| {
            block << BLOCK_BITS
                | (axis >> (AXIS_BITS - BLOCK_BITS)) as usize & ((1 << BLOCK_BITS) - 1)
        });
        wanted[block >> 6] >> (block & 63) & 1 != 0
    }

    /// Adds those of these points that are wanted.
    pub fn keep(&self, points: Vec<Point>) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let most = kept.most;
        kept.points.extend(points.into_iter().filter(|point| hash_of(*point) <= most));
        kept.thin();
    }

    /// Adds the points of a cloud. Returns the sample, in order.
    fn points_of(self, cloud: &Cloud, values: &Values) -> Vec<Point> {
        for (number, Part { columns, lattice, .. }) in cloud.parts.iter().enumerate() {
            let (rgb, intensity) = (columns.rgb.as_deref(), columns.intensity.as_deref());
            let color: Box<dyn Fn(usize) -> [u8; 3] + Sync> = match (values, rgb, intensity) {
                (Values::Colors, Some(rgb), _) => Box::new(|i| rgb[i]),
                (Values::Intensities(greys), _, Some(intensity)) => {
                    Box::new(|i| [greys[intensity[i] as usize]; 3])
                }
                _ => continue,
            };
            let first = cloud.stations.partition_point(|station| station.part < number);
            let end = cloud.stations.partition_point(|station| station.part <= number);
            let station = |i: usize| {
                let source = columns.source.as_ref().map(|column| column[i]);
                let stations = &cloud.stations[first..end];
                first + stations.binary_search_by_key(&source, |s| s.source).unwrap_or(0)
            };
            // The cells of many points along an axis are computed together.
            let cells = |axis: usize, points: Range<usize>| {
                let (offset, step) = (lattice.offset[axis], lattice.step[axis]);
                let column = columns.along(axis)[points].iter();
                let cell = |&steps: &i32| self.cells.along(axis, offset + step * f64::from(steps));
                column.map(cell).collect::<Vec<u32>>()
            };
            let find = |start: usize| {
                let mut found = Vec::new();
                let run = start..columns.len().min(start + RUN);
                for start in run.clone().step_by(BLOCK) {
                    let block = start..run.end.min(start + BLOCK);
                    let [x, y, z] = [0, 1, 2].map(|axis| cells(axis, block.clone()));
                    let cells = x.into_iter().zip(y).zip(z).map(|((x, y), z)| [x, y, z]);
                    let wanted = block.zip(cells).filter(|(_, cell)| self.wants(*cell));
                    found.extend(
                        wanted.filter_map(|(i, cell)| point(cell, station(i) as u16, color(i))),
                    );
                }
                self.keep(found);
            };
            (0..columns.len()).into_par_iter().step_by(RUN).for_each(find);
        }
        self.into_points()
    }

    /// Returns whether points were left out.
    pub fn is_thinned(&self) -> bool {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner).most < u64::MAX
    }

    /// Returns the sample, in order.
    pub fn into_points(self) -> Vec<Point> {
        let Kept { mut points, .. } =
            self.kept.into_inner().unwrap_or_else(PoisonError::into_inner);
        sort(&mut points);
        points
    }
}

/// Points of the blocks whose hashed number is at most `most`, before they are kept.
pub struct Begun {
    most: u64,
    pub points: Vec<Point>,
}

impl Begun {
    /// Adds a point if its block, whose hashed number is given, is wanted.
    #[inline]
    pub fn add(&mut self, point: Point, block: u64) {
        if block <= self.most {
            self.points.push(point);
        }
    }
}

/// Points of the blocks whose hashed number is at most `most`.
struct Kept {
    most: u64,
    limit: usize,
    points: Vec<Point>,
}

impl Kept {
    fn thin(&mut self) {
        while self.points.len() > self.limit && self.most > 0 {
            self.most /= 2;
            self.points.retain(|point| hash_of(*point) <= self.most);
        }
    }
}

/// Sorts by code, then station, then V, compared as one number without branches.
fn sort(points: &mut [Point]) {
    points.par_sort_unstable_by_key(|&(code, station, value)| {
        (code as u128) << 24 | (station as u128) << 8 | value as u128
    });
}

/// Returns the point of a cell; `None` for white.
#[inline]
pub fn point(cell: [u32; 3], station: u16, rgb: [u8; 3]) -> Option<Point> {
    Some((morton::code_63(cell), station, value(rgb)?))
}

/// Returns V; `None` for white, which parts without colours show.
pub fn value(rgb: [u8; 3]) -> Option<u8> {
    (rgb != [255; 3]).then(|| rgb[0].max(rgb[1]).max(rgb[2]))
}

/// Returns the highest hashed block number that is wanted for this many points.
fn max_block_hash(points: u64) -> u64 {
    ((SAMPLE as f64 / points as f64).min(1.0) * u64::MAX as f64) as u64
}

/// Returns the hashed number of a point's block.
#[inline]
pub fn hash_of((code, ..): Point) -> u64 {
    block_hash(code >> (3 * (AXIS_BITS - BLOCK_BITS)))
}

/// Hashes a block number uniformly (the mixing step of SplitMix64, Steele, Lea and Flood 2014).
fn block_hash(block: u64) -> u64 {
    let block = (block ^ block >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let block = (block ^ block >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    block ^ block >> 31
}
