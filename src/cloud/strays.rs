//! Strays: points so far from all others that they are no part of what was scanned: a bird, a phantom at the origin, a failed match of photogrammetry.
//!
//! In: places. Out: the box around all points but strays.
//! Distances outwards from the middle half of the points are told apart by factors of two of its longest side. Beyond the first factor within which no point lies, points are strays, if they are few:
//! no more than the root of the number of points. Only places count, not their order.

use super::digits::number;
use super::{Cloud, Columns, Lattice, Part};
use glam::DVec3;
use rayon::prelude::*;

/// Points below which none is called a stray.
const FEWEST: usize = 32;
/// About as many points are asked for the middle half.
const SAMPLES: usize = 4096;
/// Factors of two between the least and the greatest distance that f64 can tell apart from a side.
const FACTORS: usize = 2048;
/// Points that one task looks at.
const AT_ONCE: usize = 1 << 15;

/// What is to become of strays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Treatment {
    /// They are drawn where they lie.
    #[default]
    Show,
    /// They are left out.
    Hide,
}

/// A box around all points but strays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Core {
    pub low: DVec3,
    pub high: DVec3,
}

impl Core {
    /// Returns the box where some of so many places are strays, and nothing where none is.
    pub fn of(count: usize, place: impl Fn(usize) -> DVec3 + Sync) -> Option<Core> {
        if count < FEWEST {
            return None;
        }
        // One of so many points is asked for the middle half, by its place alone.
        let chosen = u64::MAX / (count / SAMPLES + 1) as u64;
        let look = |start: usize| {
            let mut seen = Seen::default();
            for i in start..count.min(start + AT_ONCE) {
                let p = place(i);
                seen.all = Core { low: seen.all.low.min(p), high: seen.all.high.max(p) };
                if scatter(p) <= chosen {
                    seen.samples.push(p);
                }
            }
            seen
        };
        let starts = (0..count.div_ceil(AT_ONCE)).into_par_iter().map(|task| task * AT_ONCE);
        let seen = starts.map(look).reduce(Seen::default, Seen::and);
        let middle = middle_half(seen.samples.clone())?;
        let size = (middle.high - middle.low).max_element();
        if !(size > 0.0 && size.is_finite()) {
            return None;
        }
        // The whole part of the binary logarithm.
        let factor = |p: DVec3| {
            (((1.0 + middle.beyond(p) / size).to_bits() >> 52) as usize - 1023).min(FACTORS - 1)
        };
        // Where some of the samples lie within each factor there is no gap, and nothing to count.
        let farthest = factor(seen.all.low).max(factor(seen.all.high));
        let mut met = vec![false; farthest + 1];
        seen.samples.iter().for_each(|&p| met[factor(p)] = true);
        if met[..farthest].iter().all(|&met| met) {
            return None;
        }
        let count_one = |mut counts: Vec<u64>, i: usize| {
            counts[factor(place(i))] += 1;
            counts
        };
        let add = |a: Vec<u64>, b: Vec<u64>| a.into_iter().zip(b).map(|(a, b)| a + b).collect();
        let none = || vec![0; FACTORS];
        let counts = (0..count)
            .into_par_iter()
            .with_min_len(AT_ONCE)
            .fold(none, count_one)
            .reduce(none, add);
        let gap = counts.iter().position(|&points| points == 0)?;
        let strays: u64 = counts[gap..].iter().sum();
        let few = (count as f64).sqrt() as u64;
        let reach = size * (2f64.powi(gap as i32) - 1.0);
        (1..=few)
            .contains(&strays)
            .then(|| Core { low: middle.low - reach, high: middle.high + reach })
    }

    /// Returns the box of a part where some of its points are strays: lattice steps.
    pub fn in_steps(columns: &Columns) -> Option<Core> {
        Core::of(columns.len(), |i| steps(columns, i))
    }

    pub fn has(&self, p: DVec3) -> bool {
        p.cmpge(self.low).all() && p.cmple(self.high).all()
    }

    /// Returns how far outside a point lies along the axis where that is most.
    fn beyond(&self, p: DVec3) -> f64 {
        (self.low - p).max(p - self.high).max_element().max(0.0)
    }
}

/// What a first look at all points finds: a box around them, and samples.
struct Seen {
    all: Core,
    samples: Vec<DVec3>,
}

impl Default for Seen {
    fn default() -> Seen {
        Seen { all: Core { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY }, samples: Vec::new() }
    }
}

impl Seen {
    fn and(mut self, other: Seen) -> Seen {
        self.samples.extend(other.samples);
        Seen {
            all: Core {
                low: self.all.low.min(other.all.low),
                high: self.all.high.max(other.all.high),
            },
            samples: self.samples,
        }
    }
}

/// Returns the box between the first and the third quartile of every axis.
fn middle_half(mut samples: Vec<DVec3>) -> Option<Core> {
    let (first, third) = (samples.len() / 4, samples.len() * 3 / 4);
    let [mut low, mut high] = [DVec3::ZERO; 2];
    for axis in 0..3 {
        if samples.len() < 4 {
            return None;
        }
        let mut along = |k: usize| {
            samples.select_nth_unstable_by(k, |a, b| a[axis].total_cmp(&b[axis])).1[axis]
        };
        (low[axis], high[axis]) = (along(first), along(third));
    }
    Some(Core { low, high })
}

/// Returns where a point of a part lies, lattice steps.
pub fn steps(columns: &Columns, i: usize) -> DVec3 {
    DVec3::new(columns.x[i].into(), columns.y[i].into(), columns.z[i].into())
}

/// Points that lie far outside of their part.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Strays {
    pub points: u64,
    /// Where the first few lie, world.
    pub places: Vec<[f64; 3]>,
}

impl Strays {
    const LISTED: usize = 10;

    fn of(lattice: &Lattice, columns: &Columns) -> Strays {
        let Some(core) = Core::in_steps(columns) else { return Strays::default() };
        let outside = (0..columns.len())
            .into_par_iter()
            .with_min_len(AT_ONCE)
            .filter(|&i| !core.has(steps(columns, i)));
        let outside: Vec<usize> = outside.collect();
        let place = |&i: &usize| {
            lattice.world([columns.x[i].into(), columns.y[i].into(), columns.z[i].into()])
        };
        Strays::listed(outside.len() as u64, outside.iter().map(place))
    }

    pub fn listed(points: u64, places: impl Iterator<Item = DVec3>) -> Strays {
        Strays { points, places: places.take(Strays::LISTED).map(|p| p.to_array()).collect() }
    }

    fn and(mut self, other: Strays) -> Strays {
        self.points += other.points;
        self.places.extend(other.places);
        self.places.truncate(Strays::LISTED);
        self
    }

    /// Returns a line for the user, where there are any.
    pub fn said(&self) -> Option<String> {
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

    /// Leaves strays out, and returns whether the part has other points.
    pub fn hide_strays(&mut self) -> bool {
        if let Some(core) = Core::in_steps(&self.columns) {
            let kept: Vec<u32> = (0..self.columns.len() as u32)
                .filter(|&i| core.has(steps(&self.columns, i as usize)))
                .collect();
            self.columns = self.columns.pick(&kept);
        }
        !self.header.strays
    }

    /// Returns the least and the greatest height of points that are no strays, world.
    pub fn heights(&self) -> Option<[f64; 2]> {
        let z = &self.columns.z;
        let (lo, hi) = match Core::in_steps(&self.columns) {
            None => super::range(z)?,
            Some(core) => {
                let inside =
                    (0..z.len()).filter(|&i| core.has(steps(&self.columns, i))).map(|i| z[i]);
                inside.fold((i32::MAX, i32::MIN), |(lo, hi), v| (lo.min(v), hi.max(v)))
            }
        };
        let ends = [lo, hi].map(|z| self.lattice.offset.z + self.lattice.step.z * z as f64);
        Some([ends[0].min(ends[1]), ends[0].max(ends[1])])
    }
}

impl Cloud {
    pub fn strays(&self) -> Strays {
        self.parts.iter().map(Part::strays).fold(Strays::default(), Strays::and)
    }

    /// Returns the least and the greatest height of points that are no strays, world.
    pub fn heights(&self) -> Option<[f64; 2]> {
        let parts = self.parts.iter().filter(|part| !part.header.strays);
        parts.filter_map(Part::heights).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
    }
}

/// Returns a number that looks random and depends on a place alone.
fn scatter(p: DVec3) -> u64 {
    let [x, y, z] = p.to_array().map(|v| (v + 0.0).to_bits());
    (x ^ y.rotate_left(21) ^ z.rotate_left(42)).wrapping_mul(0x9E37_79B9_7F4A_7C15)
}

/// Scatters the bits of a number (the finaliser of SplitMix64, Steele et al. 2014).
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
        Core::of(points.len(), |i| points[i])
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
        // Points as a scanner in the middle of a plain has them: as many within every factor of two of distance.
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
