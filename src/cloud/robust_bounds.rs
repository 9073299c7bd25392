//! Robust framing: the points that a camera should show, without strays. A single return from a
//! bird would push the rest into a corner. Of what the user has chosen, by filters or clip boxes,
//! all but the strays of files is shown.

use super::strays::{RobustBounds, mix};
use super::{Cloud, Lattice, Part};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::HashMap;
use std::ops::RangeInclusive;

/// A point and the number of points for which it stands.
type Weighted = (DVec3, u32);

/// Approximate number of sampled points. They are chosen by coordinates, not by their place in the
/// file, so that the camera does not depend on the order.
const SAMPLES: u64 = 100_000;
/// Share of points beyond each side of a box that no stray determines.
const BEYOND: f64 = 0.002;
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
                let is_core = core.is_none_or(|core| core.has(DVec3::from(q.map(f64::from))));
                !is_stray && is_core && (0..3).any(|axis| !inside[axis].contains(&q[axis]))
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
                move |q| (0..3).any(|axis| !inside[axis].contains(&q[axis]))
            },
        );
        core.extend(certain.tied(outside));
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
        let every = count / SAMPLES + 1;
        let samples: Vec<_> = self
            .places(keeps, |_| |q| scatter(q).is_multiple_of(every))
            .into_iter()
            .map(|p| (p, 1))
            .collect();
        let samples = near(samples);
        let certain = Certain::of(samples.clone());
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
            let columns = &part.columns;
            let steps = |i: usize| [columns.x[i], columns.y[i], columns.z[i]];
            let wants = wants(part);
            let wanted = (0..columns.len()).into_par_iter().map(steps).filter(|&q| wants(q));
            let world = |q: [i32; 3]| part.lattice.world(q.map(i64::from));
            places.par_extend(wanted.map(world).filter(|&p| keeps(p)));
        }
        places
    }
}

/// Returns samples without strays, each repeated by its weight.
pub fn without_strays(samples: Vec<(DVec3, u32)>) -> Vec<DVec3> {
    let samples = near(samples);
    let certain = Certain::of(samples.clone());
    let (mut core, outside): (Vec<DVec3>, Vec<DVec3>) =
        samples.into_iter().map(|(p, _)| p).partition(|&p| certain.beyond(p) == 0.0);
    core.extend(certain.tied(outside));
    core
}

/// Returns samples of points that the user has chosen, without far ones.
pub fn chosen_samples(samples: Vec<(DVec3, u32)>) -> Vec<DVec3> {
    near(samples).into_iter().map(|(p, _)| p).collect()
}

/// Removes far samples: one of few is more than the share that percentiles cut off.
fn near(mut samples: Vec<(DVec3, u32)>) -> Vec<(DVec3, u32)> {
    let Some(core) = RobustBounds::of(samples.len(), |i| samples[i].0) else { return samples };
    let points = |keeps: &dyn Fn(DVec3) -> bool| {
        samples.iter().filter(|(p, _)| keeps(*p)).map(|&(_, weight)| weight as f64).sum::<f64>()
    };
    if points(&|p| !core.has(p)) <= points(&|_| true).sqrt() {
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
    fn of(mut samples: Vec<(DVec3, u32)>) -> Certain {
        let few = BEYOND * samples.iter().map(|&(_, weight)| weight as f64).sum::<f64>();
        let [mut low, mut high] = [DVec3::NEG_INFINITY, DVec3::INFINITY];
        for axis in 0..3 {
            samples.par_sort_unstable_by(|(a, _), (b, _)| a[axis].total_cmp(&b[axis]));
            low[axis] = within(samples.iter(), axis, few).unwrap_or(low[axis]);
            high[axis] = within(samples.iter().rev(), axis, few).unwrap_or(high[axis]);
        }
        Certain { low, high, size: (high - low).max_element() }
    }

    /// Returns the largest distance outside the box along an axis `[m]`.
    fn beyond(&self, p: DVec3) -> f64 {
        (p - p.clamp(self.low, self.high)).abs().max_element()
    }

    /// Returns the steps of a lattice that are inside, whatever the rounding.
    fn steps(&self, lattice: &Lattice) -> [RangeInclusive<i32>; 3] {
        let [a, b] = [self.low, self.high].map(|corner| (corner - lattice.offset) / lattice.step);
        let (least, most) = (a.min(b).ceil() + 1.0, a.max(b).floor() - 1.0);
        [0, 1, 2].map(|axis| least[axis] as i32..=most[axis] as i32)
    }

    /// Returns outside points that are connected with the inside: a spire or an outstretched arm
    /// may hold fewer points than strays do, but no gap separates it.
    fn tied(&self, outside: Vec<DVec3>) -> Vec<DVec3> {
        let step = STEP * self.size;
        let mut cells: HashMap<[i64; 3], Vec<DVec3>> = HashMap::new();
        let mut reached = Vec::new();
        for p in outside
            .into_iter()
            .filter(|&p| self.beyond(p) > 0.0 && self.beyond(p) <= WAY * self.size)
        {
            let cell = ((p - self.low) / step).floor().to_array().map(|c| c as i64);
            cells.entry(cell).or_default().push(p);
            if self.beyond(p) <= step {
                reached.push(cell);
            }
        }
        let mut tied = Vec::new();
        while let Some([x, y, z]) = reached.pop() {
            if let Some(points) = cells.remove(&[x, y, z]) {
                tied.extend(points);
                reached.extend((0..27).map(|k| [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1]));
            }
        }
        tied
    }
}

/// Returns the first coordinate with more than `beyond` points up to it.
fn within<'s>(
    samples: impl Iterator<Item = &'s (DVec3, u32)>,
    axis: usize,
    beyond: f64,
) -> Option<f64> {
    let mut sums = samples.scan(0.0, |sum, (p, weight)| {
        *sum += *weight as f64;
        Some((*sum, p[axis]))
    });
    sums.find(|(sum, _)| *sum > beyond).map(|(_, at)| at)
}

/// Hashes a point's lattice coordinates.
pub fn scatter(q: [i32; 3]) -> u64 {
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
    fn few_points_are_all_kept() {
        assert_eq!(without_strays(vec![]), []);
        let points = [DVec3::ZERO, DVec3::splat(1e6)];
        assert_eq!(without_strays(points.map(|p| (p, 1)).to_vec()), points);
    }
}
