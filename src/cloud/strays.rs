//! Strays: points far outside of what was scanned, such as a bird, a phantom at the origin, or a
//! failed photogrammetric match.
//!
//! Distances from the middle half of the points are binned by powers of two of its longest side.
//! Points beyond the first empty bin are strays if they are few: at most the square root of the
//! number of points. Only positions matter, not their order. Samples are chosen by a hash of places
//! relative to the lower corner, so that they move with the points.

use super::digits::number;
use super::up::Up;
use super::{Cloud, Columns, Lattice, Part};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::HashMap;
use std::convert::Infallible;
use std::ops::Range;
use std::sync::OnceLock;
use strum::{EnumString, IntoStaticStr, VariantArray};

/// Fewest points among which strays are sought.
const FEWEST: usize = 32;
/// Approximate number of samples for the middle half.
const SAMPLES: usize = 4096;
/// Bins: powers of two between the least and the greatest distance in f64.
const FACTORS: usize = 2048;
/// Points per task.
const AT_ONCE: usize = 1 << 15;
/// Points tested together for samples.
const BLOCK: usize = 64;

/// The treatment of strays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum Treatment {
    /// Draws strays where they lie
    #[default]
    Show,
    /// Leaves strays out
    Hide,
}

/// Positions of points, in memory or not.
pub trait Places: Sync {
    /// Error of reading them.
    type Error: Send;

    fn count(&self) -> usize;

    /// Adds places to sums, which begin as `empty`, on all threads, and joins these in order.
    fn fold<T: Send>(
        &self,
        empty: impl Fn() -> T + Sync + Send,
        add: impl Fn(&mut T, DVec3) + Sync + Send,
        join: impl Fn(T, T) -> T + Sync + Send,
    ) -> Result<T, Self::Error>;
}

/// Positions in memory by their numbers.
struct Numbered<F> {
    count: usize,
    place: F,
}

impl<F: Fn(usize) -> DVec3 + Sync> Places for Numbered<F> {
    type Error = Infallible;

    fn count(&self) -> usize {
        self.count
    }

    fn fold<T: Send>(
        &self,
        empty: impl Fn() -> T + Sync + Send,
        add: impl Fn(&mut T, DVec3) + Sync + Send,
        join: impl Fn(T, T) -> T + Sync + Send,
    ) -> Result<T, Infallible> {
        let of_range = |range: Range<usize>| {
            let mut sum = empty();
            range.for_each(|i| add(&mut sum, (self.place)(i)));
            sum
        };
        Ok(tasks(self.count).map(of_range).reduce(&empty, &join))
    }
}

/// A box around all points but strays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RobustBounds {
    pub low: DVec3,
    pub high: DVec3,
}

impl RobustBounds {
    /// Returns the box if some of `count` positions are strays; `None` if not.
    pub fn of(count: usize, place: impl Fn(usize) -> DVec3 + Sync) -> Option<RobustBounds> {
        let Ok(found) = RobustBounds::among(&Numbered { count, place });
        found
    }

    /// Returns the box if some places are strays; `None` if not.
    pub fn among<P: Places>(places: &P) -> Result<Option<RobustBounds>, P::Error> {
        let count = places.count();
        if count < FEWEST {
            return Ok(None);
        }
        let chosen = chosen(count);
        let none = || RobustBounds { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };
        let widen =
            |all: &mut RobustBounds, p: DVec3| *all = all.and(RobustBounds { low: p, high: p });
        let all = places.fold(none, widen, RobustBounds::and)?;
        let sample = |samples: &mut Vec<(DVec3, u64)>, p: DVec3| {
            if scatter(p - all.low) <= chosen {
                samples.push((p, 1));
            }
        };
        let join = |mut all: Vec<_>, mut own| {
            all.append(&mut own);
            all
        };
        let samples = places.fold(Vec::new, sample, join)?;
        let Some(bins) = Bins::of(all, samples) else { return Ok(None) };
        Ok(bins.core(&bins.count_all(places)?))
    }

    /// Returns the box if some of the points that samples stand for are strays; `None` if not.
    pub fn of_samples(samples: &[(DVec3, u32)]) -> Option<RobustBounds> {
        let weighted: Vec<_> = samples.iter().map(|&(p, points)| (p, points as u64)).collect();
        if weighted.iter().map(|(_, points)| points).sum::<u64>() < FEWEST as u64 {
            return None;
        }
        let all = samples.iter().map(|&(p, _)| RobustBounds { low: p, high: p });
        let bins = Bins::of(all.reduce(RobustBounds::and)?, weighted)?;
        let mut counts = vec![0; bins.number()];
        samples.iter().for_each(|&(p, points)| counts[bins.bin(p)] += points as u64);
        bins.core(&counts)
    }

    /// Returns the box around both.
    fn and(self, other: RobustBounds) -> RobustBounds {
        RobustBounds { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    pub fn has(&self, p: DVec3) -> bool {
        p.cmpge(self.low).all() && p.cmple(self.high).all()
    }

    /// Returns the largest distance outside along an axis.
    fn beyond(&self, p: DVec3) -> f64 {
        (self.low - p).max(p - self.high).max_element().max(0.0)
    }
}

/// Bins of points by their distance from the middle half.
pub struct Bins {
    middle: RobustBounds,
    /// Longest side of the middle half.
    size: f64,
    farthest: usize,
}

impl Bins {
    /// Returns the bins of points whose box and samples these are, the samples each with the number
    /// of points there; `None` if there can be no strays.
    pub fn of(all: RobustBounds, samples: Vec<(DVec3, u64)>) -> Option<Bins> {
        let middle = middle_half(samples.clone())?;
        let size = (middle.high - middle.low).max_element();
        if !(size > 0.0 && size.is_finite()) {
            return None;
        }
        let mut bins = Bins { middle, size, farthest: 0 };
        bins.farthest = bins.bin(all.low).max(bins.bin(all.high));
        // If samples fill every bin, there is no gap and nothing to count.
        let mut met = vec![false; bins.farthest + 1];
        samples.iter().for_each(|&(p, _)| met[bins.bin(p)] = true);
        (!met[..bins.farthest].iter().all(|&met| met)).then_some(bins)
    }

    /// Returns how many of `count` points are in each bin.
    pub fn count(&self, count: usize, place: impl Fn(usize) -> DVec3 + Sync) -> Vec<u64> {
        let Ok(counts) = self.count_all(&Numbered { count, place });
        counts
    }

    /// Returns how many places are in each bin.
    fn count_all<P: Places>(&self, places: &P) -> Result<Vec<u64>, P::Error> {
        let add = |a: Vec<u64>, b: Vec<u64>| a.into_iter().zip(b).map(|(a, b)| a + b).collect();
        let count = |counts: &mut Vec<u64>, p: DVec3| counts[self.bin(p)] += 1;
        places.fold(|| vec![0; self.number()], count, add)
    }

    /// Returns the bin of a point: the integer part of a binary logarithm.
    pub fn bin(&self, p: DVec3) -> usize {
        (((1.0 + self.middle.beyond(p) / self.size).to_bits() >> 52) as usize - 1023)
            .min(FACTORS - 1)
    }

    pub fn number(&self) -> usize {
        self.farthest + 1
    }

    /// Returns the first empty bin from the points of each, if few enough lie beyond to be strays.
    pub fn first_of_strays(&self, counts: &[u64]) -> Option<usize> {
        let gap = counts.iter().position(|&points| points == 0)?;
        let strays: u64 = counts[gap..].iter().sum();
        let few = (counts.iter().sum::<u64>() as f64).sqrt() as u64;
        (1..=few).contains(&strays).then_some(gap)
    }

    /// Returns the box around all points but strays, likewise.
    pub fn core(&self, counts: &[u64]) -> Option<RobustBounds> {
        let gap = self.first_of_strays(counts)?;
        let reach = self.size * (2f64.powi(gap as i32) - 1.0);
        let Bins { middle, .. } = self;
        Some(RobustBounds { low: middle.low - reach, high: middle.high + reach })
    }
}

/// Samples of the points of a part, chosen by [`scatter_steps`] from their lower corner: several
/// thousand, or all. The same points are chosen in any order.
#[derive(Clone, Debug)]
pub struct Samples {
    low: [i32; 3],
    /// Largest hash of a sample.
    most: u32,
    /// Points at each position.
    places: HashMap<[i32; 3], u64>,
}

impl Samples {
    /// Begins a sample of `count` points.
    pub fn of(low: [i32; 3], count: u64) -> Samples {
        let most = (chosen(count as usize) >> 32) as u32;
        Samples { low, most, places: HashMap::new() }
    }

    /// Tests whether these are the samples of `count` points from this corner on.
    pub fn are_of(&self, low: [i32; 3], count: u64) -> bool {
        self.low == low && self.most == Samples::of(low, count).most
    }

    pub fn add(&mut self, [x, y, z]: [&[i32]; 3]) {
        let [x, y, z] = [x, y, z].map(|column| column.chunks(BLOCK));
        for ((x, y), z) in x.zip(y).zip(z) {
            let places = || x.iter().zip(y).zip(z).map(|((&x, &y), &z)| [x, y, z]);
            let (low, most) = (self.low, self.most);
            let is_chosen = |place: &[i32; 3]| scatter_steps(*place, low) <= most;
            // Most blocks have no sample, which SIMD finds for several points at a time.
            if places().map(|place| u32::from(is_chosen(&place))).sum::<u32>() > 0 {
                for place in places().filter(is_chosen) {
                    *self.places.entry(place).or_default() += 1;
                }
            }
        }
    }

    /// Adds the samples of other points from the same corner on.
    pub fn join(&mut self, other: Samples) {
        for (place, points) in other.places {
            *self.places.entry(place).or_default() += points;
        }
    }

    /// Returns the positions whose hash is below a number.
    pub fn places_below(&self, hash: u64) -> impl Iterator<Item = [i32; 3]> {
        let is_below = move |place: &[i32; 3]| u64::from(scatter_steps(*place, self.low)) < hash;
        self.places.keys().copied().filter(is_below)
    }

    /// Returns the bins of `count` points within these corners `[lattice steps]`; `None` if there
    /// can be no strays.
    pub fn bins(&self, count: u64, [low, high]: [[i32; 3]; 2]) -> Option<Bins> {
        if count < FEWEST as u64 {
            return None;
        }
        let places = self.places.iter().map(|(place, points)| (steps(*place), *points)).collect();
        Bins::of(RobustBounds { low: steps(low), high: steps(high) }, places)
    }
}

/// Extent and samples of a part's points [lattice steps].
#[derive(Clone, Debug)]
pub struct Extent {
    pub low: [i32; 3],
    pub high: [i32; 3],
    pub samples: Samples,
    /// The box around all points but strays, if there are strays.
    pub core: Option<RobustBounds>,
}

impl Extent {
    /// Returns `None` where there is no point.
    pub fn of(columns: &Columns) -> Option<Extent> {
        let places = [&columns.x, &columns.y, &columns.z];
        let corners_of =
            |range: Range<usize>| Corners::of(places.map(|column| &column[range.clone()]));
        Some(Extent::within(
            tasks(columns.len()).map(corners_of).reduce_with(Corners::and)?,
            columns,
        ))
    }

    /// Returns the extent of points between these corners.
    fn within(Corners { low, high }: Corners, columns: &Columns) -> Extent {
        let count = columns.len();
        let none = || Samples::of(low, count as u64);
        let samples_of = |range: Range<usize>| {
            let mut samples = none();
            let places = [&columns.x, &columns.y, &columns.z];
            samples.add(places.map(|column| &column[range.clone()]));
            samples
        };
        let join = |mut all: Samples, own: Samples| {
            all.join(own);
            all
        };
        let samples = tasks(count).map(samples_of).reduce(none, join);
        let bins = samples.bins(count as u64, [low, high]);
        let core = bins.and_then(|bins| bins.core(&bins.count(count, |i| columns.place(i))));
        Extent { low, high, samples, core }
    }
}

/// Corners of a box around points [lattice steps].
#[derive(Clone, Copy, Debug)]
pub struct Corners {
    low: [i32; 3],
    high: [i32; 3],
}

impl Corners {
    pub fn of(places: [&[i32]; 3]) -> Corners {
        Corners {
            low: places.map(|column| column.iter().fold(i32::MAX, |low, &v| low.min(v))),
            high: places.map(|column| column.iter().fold(i32::MIN, |high, &v| high.max(v))),
        }
    }

    pub fn and(self, other: Corners) -> Corners {
        Corners {
            low: [0, 1, 2].map(|axis| self.low[axis].min(other.low[axis])),
            high: [0, 1, 2].map(|axis| self.high[axis].max(other.high[axis])),
        }
    }
}

/// An extent computed on first use.
#[derive(Clone, Debug, Default)]
pub struct Kept(OnceLock<Option<Extent>>);

/// Equal by positions, so the cache does not matter.
impl PartialEq for Kept {
    fn eq(&self, _: &Kept) -> bool {
        true
    }
}

impl Columns {
    /// Keeps the extent of all points, whose corners were found while they were read.
    pub fn keep_extent(&mut self, corners: Corners) {
        self.extent = Kept(Some(Extent::within(corners, self)).into());
    }

    /// Returns the box around the points, and around all but strays; `None` if there is no point.
    /// Places must not change after the first call.
    pub fn extent(&self) -> Option<&Extent> {
        self.extent.0.get_or_init(|| Extent::of(self)).as_ref()
    }

    /// Returns the box around all points but strays, if there are some: lattice steps.
    pub fn core(&self) -> Option<RobustBounds> {
        self.extent()?.core
    }

    /// Returns the position of a point [lattice steps].
    pub fn place(&self, i: usize) -> DVec3 {
        steps([self.x[i], self.y[i], self.z[i]])
    }
}

/// Returns the box between the first and the third quartile of every axis, of samples with their
/// numbers of points.
fn middle_half(mut samples: Vec<(DVec3, u64)>) -> Option<RobustBounds> {
    let count: u64 = samples.iter().map(|(_, points)| points).sum();
    if count < 4 {
        return None;
    }
    let [mut low, mut high] = [DVec3::ZERO; 2];
    for axis in 0..3 {
        samples.sort_unstable_by(|(a, _), (b, _)| a[axis].total_cmp(&b[axis]));
        let along = |k: u64| {
            let mut before = 0;
            let reached = |(_, points): &&(DVec3, u64)| {
                before += points;
                before > k
            };
            samples.iter().find(reached).expect("k is below the count").0[axis]
        };
        (low[axis], high[axis]) = (along(count / 4), along(count * 3 / 4));
    }
    Some(RobustBounds { low, high })
}

/// Returns a position as numbers.
pub fn steps(place: [i32; 3]) -> DVec3 {
    DVec3::from_array(place.map(f64::from))
}

/// Returns the ranges of points per task.
pub fn tasks(count: usize) -> impl IndexedParallelIterator<Item = Range<usize>> {
    let range = move |task: usize| task * AT_ONCE..count.min((task + 1) * AT_ONCE);
    (0..count.div_ceil(AT_ONCE)).into_par_iter().map(range)
}

/// Returns the largest hash of a sample.
fn chosen(count: usize) -> u64 {
    u64::MAX / (count / SAMPLES + 1) as u64
}

/// Points that lie far outside of their part.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Strays {
    pub points: u64,
    /// Positions of the first few, world.
    pub places: Vec<[f64; 3]>,
}

impl Strays {
    const LISTED: usize = 10;

    fn of(lattice: &Lattice, columns: &Columns) -> Strays {
        let Some(core) = columns.core() else { return Strays::default() };
        let outside: Vec<usize> = (0..columns.len())
            .into_par_iter()
            .with_min_len(AT_ONCE)
            .filter(|&i| !core.has(columns.place(i)))
            .collect();
        let place = |&i: &usize| {
            lattice.world([columns.x[i].into(), columns.y[i].into(), columns.z[i].into()])
        };
        Strays::listed(outside.len() as u64, outside.iter().map(place))
    }

    pub fn listed(points: u64, places: impl Iterator<Item = DVec3>) -> Strays {
        Strays { points, places: places.take(Strays::LISTED).map(|p| p.to_array()).collect() }
    }

    pub fn and(mut self, other: Strays) -> Strays {
        self.points += other.points;
        self.places.extend(other.places);
        self.places.truncate(Strays::LISTED);
        self
    }

    /// Returns a note for the user, if there are strays.
    pub fn note(&self) -> Option<String> {
        let first = self.places.first()?.map(number).join(" ");
        Some(match self.points {
            1 => format!("1 point lies far outside, at {first}"),
            points => format!("{points} points lie far outside, the first at {first}"),
        })
    }
}

impl Part {
    pub fn strays(&self) -> Strays {
        let columns = &self.columns;
        if self.header.strays {
            let places = (0..columns.len()).map(|i| {
                self.lattice.world([columns.x[i], columns.y[i], columns.z[i]].map(i64::from))
            });
            return Strays::listed(columns.len() as u64, places);
        }
        Strays::of(&self.lattice, columns)
    }

    /// Removes strays. Returns whether other points remain.
    pub fn hide_strays(&mut self) -> bool {
        if let Some(core) = self.columns.core() {
            let kept: Vec<u32> = (0..self.columns.len() as u32)
                .filter(|&i| core.has(self.columns.place(i as usize)))
                .collect();
            self.columns = self.columns.pick(&kept);
        }
        !self.header.strays
    }

    /// Returns the height range without strays, world.
    pub fn heights(&self, up: Up) -> Option<[f64; 2]> {
        let (columns, axis) = (&self.columns, up.index());
        let z = columns.along(axis);
        let (lo, hi) = match columns.extent()? {
            Extent { core: None, low, high, .. } => (low[axis], high[axis]),
            Extent { core: Some(core), .. } => {
                let inside = (0..z.len()).filter(|&i| core.has(columns.place(i))).map(|i| z[i]);
                inside.fold((i32::MAX, i32::MIN), |(lo, hi), v| (lo.min(v), hi.max(v)))
            }
        };
        let Lattice { step, offset } = self.lattice;
        let ends = [lo, hi].map(|z| offset[axis] + step[axis] * z as f64);
        Some([ends[0].min(ends[1]), ends[0].max(ends[1])])
    }
}

impl Cloud {
    pub fn strays(&self) -> Strays {
        self.parts.iter().map(Part::strays).fold(Strays::default(), Strays::and)
    }

    /// Returns the height range without strays, world.
    pub fn heights(&self) -> Option<[f64; 2]> {
        let parts = self.parts.iter().filter(|part| !part.header.strays);
        parts
            .filter_map(|part| part.heights(self.up))
            .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
    }
}

/// Returns a position relative to a corner, in steps that wrap around.
pub fn relative(place: [i32; 3], corner: [i32; 3]) -> [i32; 3] {
    [0, 1, 2].map(|axis| place[axis].wrapping_sub(corner[axis]))
}

/// Hashes a position in lattice steps, relative to a corner that moves with the points.
pub fn scatter_steps(place: [i32; 3], corner: [i32; 3]) -> u32 {
    let [x, y, z] = relative(place, corner);
    let h = (x as u32 ^ (y as u32).rotate_left(11) ^ (z as u32).rotate_left(22))
        .wrapping_mul(0x9E37_79B1);
    (h ^ h >> 15).wrapping_mul(0x85EB_CA77)
}

/// Hashes a position relative to a corner.
fn scatter(p: DVec3) -> u64 {
    let [x, y, z] = p.to_array().map(|v| (v + 0.0).to_bits());
    (x ^ y.rotate_left(21) ^ z.rotate_left(42)).wrapping_mul(0x9E37_79B9_7F4A_7C15)
}

/// Mixes the bits of a number (the finaliser of SplitMix64, Steele et al. 2014).
pub fn mix(mut h: u64) -> u64 {
    h = (h ^ h >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    h = (h ^ h >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    h ^ h >> 31
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet(points: usize) -> Vec<DVec3> {
        let place = |i: usize| {
            DVec3::new(
                (i * 7919 % 2003) as f64 / 100.0,
                (i * 104_729 % 1999) as f64 / 100.0,
                (i % 7) as f64,
            )
        };
        (0..points).map(place).collect()
    }

    fn strays(points: &[DVec3]) -> usize {
        RobustBounds::of(points.len(), |i| points[i])
            .map_or(0, |core| points.iter().filter(|&&p| !core.has(p)).count())
    }

    #[test]
    fn a_few_points_far_outside_are_strays_and_edges_are_not() {
        for count in [40, 5000, 200_000] {
            let points = sheet(count);
            assert_eq!(strays(&points), 0);
            for far in [
                DVec3::new(10.0, 10.0, 1000.0),
                DVec3::splat(-5e5),
                DVec3::new(1e30, 0.0, 0.0),
                DVec3::new(10.0, 80.0, 3.0),
            ] {
                let with: Vec<DVec3> = points.iter().copied().chain([far]).collect();
                assert_eq!(strays(&with), 1, "{far} beside {count}");
            }
            let tower =
                points.iter().copied().chain((0..40).map(|i| DVec3::new(10.0, 10.0, i as f64)));
            assert_eq!(strays(&tower.collect::<Vec<_>>()), 0);
        }
    }

    #[test]
    fn what_is_far_but_many_is_another_part_of_the_scene() {
        let points = sheet(5000);
        let both: Vec<DVec3> =
            points.iter().copied().chain(points[..200].iter().map(|&p| p + 1000.0)).collect();
        assert_eq!(strays(&both), 0);
    }

    #[test]
    fn a_scan_that_thins_out_has_none() {
        // Points around a scanner on a plain: as many within every factor of two of distance.
        let place = |i: usize| {
            let (along, angle) = ((i * 7919 % 10_007) as f64 / 10_007.0, i as f64);
            DVec3::new(angle.cos(), angle.sin(), 0.0) * 2f64.powf(10.0 * along)
        };
        assert_eq!(strays(&(0..10_007).map(place).collect::<Vec<_>>()), 0);
    }

    #[test]
    fn one_place_and_no_place_have_none() {
        assert_eq!(strays(&[]), 0);
        assert_eq!(strays(&[DVec3::ONE; 100]), 0);
    }
}
