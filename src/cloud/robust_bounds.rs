//! Robust framing: the points that a camera should show, without strays. A single return from a
//! bird would push the rest into a corner. Of what the user has chosen, by filters or clip boxes,
//! all but the strays of files is shown.

use super::strays::{RobustBounds, mix, relative};
use super::{Cloud, Lattice, Part};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::HashMap;

/// A point and the number of points for which it stands.
type Weighted = (DVec3, u32);

/// Approximate number of sampled points. They are chosen by coordinates from the lower corner,
/// not by their place in the file, so that the camera does not depend on the order.
const SAMPLES: u64 = 100_000;
/// Share of points beyond each side of a box that no stray determines.
const BEYOND: f64 = 0.002;
/// Points per task.
const TASK: usize = 1 << 15;
/// Connectivity of points beyond the box, relative to its longest side: the size of adjacent
/// occupied cells, and the distance they may lead. Tree tops are this sparse.
const STEP: f64 = 1.0 / 25.0;
const WAY: f64 = 0.25;

impl Cloud {
    /// Returns a sample of the points, and all points connected with most of them, without strays;
    /// world.
    pub fn core_points(&self) -> Vec<DVec3> {
        if self.chosen { self.chosen_points(|_| true) } else { self.core_points_of(self.len()) }
    }

    /// Returns a sample of the points that are kept, and all of them beyond its middle, without the
    /// strays of files.
    pub fn chosen_points(&self, keeps: impl Fn(DVec3) -> bool + Sync) -> Vec<DVec3> {
        let world = |part: &Part, q: [i32; 3]| part.lattice.world(q.map(i64::from));
        let count = |part: &Part| {
            let columns = &part.columns;
            let steps = |i: usize| [columns.x[i], columns.y[i], columns.z[i]];
            (0..columns.len()).into_par_iter().filter(|&i| keeps(world(part, steps(i)))).count()
                as u64
        };
        let (mut inside, certain) =
            self.inside(self.parts.iter().map(count).sum(), &keeps, &|samples| samples);
        let mut outside = self.places(&keeps, |part| {
            let (inside, core) = (certain.steps(&part.lattice), part.columns.core());
            let is_stray = part.header.strays;
            move |q| {
                let is_core = || core.is_none_or(|core| core.has(DVec3::from(q.map(f64::from))));
                !is_stray && is_beyond(inside, q) && is_core()
            }
        });
        inside.append(&mut outside);
        inside
    }

    fn core_points_of(&self, count: u64) -> Vec<DVec3> {
        let (mut core, certain) = self.inside(count, &|_| true, &near);
        // A sample would miss the tip of a spire.
        let outside = self.places(
            |_| true,
            |part| {
                let inside = certain.steps(&part.lattice);
                move |q| is_beyond(inside, q)
            },
        );
        core.extend(certain.tied(&outside));
        core
    }

    /// Returns a sample of `count` points, as far as they are in the box that no stray determines,
    /// and that box.
    fn inside(
        &self,
        count: u64,
        keeps: &(impl Fn(DVec3) -> bool + Sync),
        near: &dyn Fn(Vec<Weighted>) -> Vec<Weighted>,
    ) -> (Vec<DVec3>, Certain) {
        let every = Divisor::new(count / SAMPLES + 1);
        let samples: Vec<_> = self
            .places(keeps, |part| {
                let low = part.columns.extent().map_or([0; 3], |extent| extent.low);
                move |q| every.divides(scatter(q, low))
            })
            .into_iter()
            .map(|p| (p, 1))
            .collect();
        let samples = near(samples);
        let certain = Certain::of(&samples);
        let places = samples.into_iter().map(|(p, _)| p);
        (places.filter(|&p| certain.beyond(p) == 0.0).collect(), certain)
    }

    /// Returns the positions of each part that are kept and whose steps are accepted.
    fn places<W: Fn([i32; 3]) -> bool + Sync>(
        &self,
        keeps: impl Fn(DVec3) -> bool + Sync,
        wants: impl Fn(&Part) -> W,
    ) -> Vec<DVec3> {
        let mut places = Vec::new();
        for part in &self.parts {
            let (wants, keeps) = (&wants(part), &keeps);
            let [x, y, z] = [0, 1, 2].map(|axis| part.columns.along(axis).par_chunks(TASK));
            let wanted = x.zip(y).zip(z).flat_map_iter(move |((x, y), z)| {
                let steps = x.iter().zip(y).zip(z).map(|((&x, &y), &z)| [x, y, z]);
                let world = move |q: [i32; 3]| part.lattice.world(q.map(i64::from));
                steps.filter(move |&q| wants(q)).map(world).filter(move |&p| keeps(p))
            });
            places.par_extend(wanted);
        }
        places
    }
}

/// Returns samples without strays, each repeated by its weight.
pub fn without_strays(samples: Vec<(DVec3, u32)>) -> Vec<DVec3> {
    let samples = near(samples);
    let certain = Certain::of(&samples);
    let (mut core, outside): (Vec<DVec3>, Vec<DVec3>) =
        samples.into_iter().map(|(p, _)| p).partition(|&p| certain.beyond(p) == 0.0);
    core.extend(certain.tied(&outside));
    core
}

/// Returns samples of points that the user has chosen, without far ones.
pub fn chosen_samples(samples: Vec<(DVec3, u32)>) -> Vec<DVec3> {
    near(samples).into_iter().map(|(p, _)| p).collect()
}

/// Removes far samples: one of few is more than the share that percentiles cut off.
fn near(mut samples: Vec<Weighted>) -> Vec<Weighted> {
    if let Some(core) = RobustBounds::of_samples(&samples) {
        samples.retain(|(p, _)| core.has(*p));
    }
    samples
}

/// The box between the 0.2nd and the 99.8th percentile of every axis, unaffected by strays.
struct Certain {
    low: DVec3,
    high: DVec3,
    /// The longest side `[m]`.
    size: f64,
}

impl Certain {
    fn of(samples: &[Weighted]) -> Certain {
        let few = BEYOND * samples.iter().map(|&(_, weight)| weight as f64).sum::<f64>();
        let ends = |axis: usize| {
            let mut along: Vec<_> = samples.iter().map(|(p, weight)| (p[axis], *weight)).collect();
            along.par_sort_unstable_by(|(a, _), (b, _)| a.total_cmp(b));
            let low = within(along.iter(), few).unwrap_or(f64::NEG_INFINITY);
            [low, within(along.iter().rev(), few).unwrap_or(f64::INFINITY)]
        };
        let ends = [0, 1, 2].map(ends);
        let [low, high] = [0, 1].map(|end| DVec3::from_array(ends.map(|ends| ends[end])));
        Certain { low, high, size: (high - low).max_element() }
    }

    /// Returns the largest distance outside the box along an axis `[m]`.
    fn beyond(&self, p: DVec3) -> f64 {
        (p - p.clamp(self.low, self.high)).abs().max_element()
    }

    /// Returns the first and the last steps of a lattice that are inside, whatever the rounding.
    fn steps(&self, lattice: &Lattice) -> [[i32; 3]; 2] {
        let [a, b] = [self.low, self.high].map(|corner| (corner - lattice.offset) / lattice.step);
        let (least, most) = (a.min(b).ceil() + 1.0, a.max(b).floor() - 1.0);
        [least, most].map(|end| end.to_array().map(|step| step as i32))
    }

    /// Returns outside points that are connected with the inside: a spire or an outstretched arm
    /// may hold fewer points than strays do, but no gap separates it.
    fn tied(&self, outside: &[DVec3]) -> Vec<DVec3> {
        let step = STEP * self.size;
        // Numbers of the points of each cell.
        let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
        let mut reached = Vec::new();
        for (number, &p) in (0..).zip(outside) {
            let beyond = self.beyond(p);
            if !(beyond > 0.0 && beyond <= WAY * self.size) {
                continue;
            }
            let cell = ((p - self.low) / step).floor().to_array().map(|c| c as i64);
            cells.entry(cell).or_default().push(number);
            if beyond <= step {
                reached.push(cell);
            }
        }
        let mut tied = Vec::new();
        while let Some([x, y, z]) = reached.pop() {
            if let Some(points) = cells.remove(&[x, y, z]) {
                tied.extend(points.into_iter().map(|number| outside[number as usize]));
                reached.extend((0..27).map(|k| [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1]));
            }
        }
        tied
    }
}

/// Tests whether steps are outside a box, given its first and its last ones.
#[inline]
fn is_beyond([low, high]: [[i32; 3]; 2], q: [i32; 3]) -> bool {
    // Without branches.
    (0..3).fold(false, |beyond, axis| beyond | (q[axis] < low[axis]) | (q[axis] > high[axis]))
}

/// A divisor for tests that cost a multiplication.
#[derive(Clone, Copy)]
struct Divisor {
    /// Inverse of its odd part, modulo 2^64.
    inverse: u64,
    twos: u32,
    /// Largest quotient of 64 bits.
    largest: u64,
}

impl Divisor {
    fn new(divisor: u64) -> Divisor {
        let twos = divisor.trailing_zeros();
        let odd = divisor >> twos;
        // Newton's iteration doubles the right bits, of which there are 3 at first.
        let newton =
            |inverse: u64, _| inverse.wrapping_mul(2u64.wrapping_sub(odd.wrapping_mul(inverse)));
        Divisor { inverse: (0..5).fold(odd, newton), twos, largest: u64::MAX / divisor }
    }

    /// Tests whether a number is a multiple (Granlund and Montgomery 1994, section 9).
    #[inline]
    fn divides(self, number: u64) -> bool {
        number.wrapping_mul(self.inverse).rotate_right(self.twos) <= self.largest
    }
}

/// Returns the first coordinate with more than `beyond` points up to it.
fn within<'s>(samples: impl Iterator<Item = &'s (f64, u32)>, beyond: f64) -> Option<f64> {
    let mut sums = samples.scan(0.0, |sum, (at, weight)| {
        *sum += *weight as f64;
        Some((*sum, *at))
    });
    sums.find(|(sum, _)| *sum > beyond).map(|(_, at)| at)
}

/// Hashes a point's lattice coordinates, relative to a corner that moves with the points.
pub fn scatter(q: [i32; 3], corner: [i32; 3]) -> u64 {
    let q = relative(q, corner);
    mix((q[0] as u32 as u64)
        ^ (q[1] as u32 as u64).rotate_left(21)
        ^ (q[2] as u32 as u64).rotate_left(42))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall of 200 x 200 points over 10 x 10 m.
    fn wall() -> Vec<(DVec3, u32)> {
        (0..40_000)
            .map(|i| (DVec3::new((i % 200) as f64 * 0.05, 0.0, (i / 200) as f64 * 0.05), 1))
            .collect()
    }

    fn top(points: &[DVec3]) -> f64 {
        points.iter().map(|p| p.z).fold(f64::NEG_INFINITY, f64::max)
    }

    #[test]
    fn a_spire_of_few_points_is_kept_and_strays_are_not() {
        let spire = (0..20).map(|i| (DVec3::new(5.0, 0.0, 10.0 + 0.1 * i as f64), 1));
        let strays = (1..20).map(|i| (DVec3::new(5.0, 0.0, 12.5 * i as f64), 1));
        let points = without_strays(wall().into_iter().chain(spire).chain(strays).collect());
        assert_eq!(top(&points), 11.9);
        assert_eq!(points.len(), 40_020);
    }

    #[test]
    fn what_leads_on_and_on_is_followed_for_a_quarter_of_the_size() {
        let road = (0..60).map(|i| (DVec3::new(5.0, 0.0, 10.0 + 0.1 * i as f64), 1));
        let reached = top(&without_strays(wall().into_iter().chain(road).collect()));
        assert!((12.3..=12.5).contains(&reached), "{reached}");
    }

    #[test]
    fn a_sample_counts_as_often_as_it_stands_for_points() {
        let far = DVec3::new(0.0, 0.0, 100.0);
        let with = |weight| without_strays(wall().into_iter().chain([(far, weight)]).collect());
        assert!(top(&with(1)) < 10.0);
        assert_eq!(top(&with(1000)), 100.0);
    }

    #[test]
    fn divisors_divide_their_multiples_and_no_other_number() {
        for divisor in [1, 2, 3, 8, 101, 1000, 12_345_678_912, u64::MAX] {
            let own = Divisor::new(divisor);
            for k in 0..2000u64 {
                for number in [k, u64::MAX - k, divisor.wrapping_mul(k), mix(k)] {
                    assert_eq!(own.divides(number), number.is_multiple_of(divisor));
                }
            }
        }
    }

    #[test]
    fn few_points_are_all_kept() {
        assert_eq!(without_strays(vec![]), []);
        let points = [DVec3::ZERO, DVec3::splat(1e6)];
        assert_eq!(without_strays(points.map(|p| (p, 1)).to_vec()), points);
    }
}
