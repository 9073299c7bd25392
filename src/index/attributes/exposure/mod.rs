//! Exposure of stations: brightness of each, differences where they overlap, and gains that
//! equalise them.
//!
//! Returned are, for every two overlapping stations, the step between their mean values and the
//! gain that would remove it; and one gain per station that best removes
//! all steps. Stations overlap in cells, some spacings wide, that hold points of both. A gain is a
//! factor on light, so ratios are of linear values; the median over the cells rejects those that a
//! shadow, a passer-by or a wall's other side made different (after Kanzok, Linsen and Rosenthal
//! 2012, sec. 1 and 6; factors that best agree with all overlaps, as in panorama stitching: Brown
//! and Lowe 2007, sec. 6).

mod sample;

use crate::cloud::colormap::srgb_to_linear;
use crate::cloud::{Cloud, Station};
use crate::index::format::{Balance, MAX_STOPS};
use glam::DVec3;
use sample::{AXIS_BITS, Point, hash_of};
pub use sample::{Sample, Values, greys, point, value};
use serde::Serialize;
use std::collections::BTreeMap;

#[derive(Debug, PartialEq, Serialize)]
pub struct Exposures {
    /// Mean V of HSV of each station's points, 0 to 255; `None` without colours.
    pub values: Vec<Option<f64>>,
    pub overlaps: Vec<Overlap>,
    /// Points among which overlaps were sought, if these are not all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub compared: Option<u64>,
    /// `None` if no two stations overlap.
    pub balance: Option<Balance>,
}

#[derive(Debug, PartialEq, Serialize)]
pub struct Overlap {
    /// Numbers of the two stations.
    pub stations: [usize; 2],
    /// Number of common cells.
    pub cells: u64,
    /// Mean difference of V there, second minus first, of 255.
    pub step: f64,
    /// Gain on the second's light that gives it the first's.
    pub gain: f64,
}

/// Mean number of points per occupied cell: of a station that sees a cell well, dozens. In larger
/// cells stations see different things.
const POINTS_PER_CELL: usize = 16;
/// Number of times that cells are doubled until all stations are connected: far from a station its
/// points are sparse.
const MAX_DOUBLINGS: u32 = 4;
/// Fewest points of a station in a common cell.
const MIN_POINTS: u32 = 4;
/// Fewest common cells of two stations.
const MIN_CELLS: usize = 16;
/// Visible step `[stops]`, and tolerance in standard errors.
const UNEVEN_STOPS: f64 = 0.25;
const SIGMAS: f64 = 3.0;

/// Statistics of one station in one cell.
#[derive(Clone, Copy, Default)]
struct StationStats {
    count: u32,
    value: f64,
    light: f64,
    /// Sum of squared light.
    squares: f64,
}

impl StationStats {
    fn with(self, v: u8, light: f64) -> StationStats {
        StationStats {
            count: self.count.saturating_add(1),
            value: self.value + v as f64,
            light: self.light + light,
            squares: self.squares + light * light,
        }
    }

    fn and(self, other: StationStats) -> StationStats {
        let StationStats { count, value, light, squares } = other;
        StationStats {
            count: self.count.saturating_add(count),
            value: self.value + value,
            light: self.light + light,
            squares: self.squares + squares,
        }
    }

    /// Returns the variance of the mean light, relative to its square.
    fn relative_variance(self) -> f64 {
        let (count, mean) = (self.count as f64, self.light / self.count as f64);
        ((self.squares / count - mean * mean) / (count - 1.0)).max(0.0) / (mean * mean)
    }
}

/// Difference of two stations in a common cell.
#[derive(Clone, Copy)]
struct SharedCell {
    /// Difference of V, second minus first.
    step: f64,
    /// Ratio of the first's light to the second's, and its standard error `[stops]`.
    stops: f64,
    error: f64,
}

type Pairs = BTreeMap<[usize; 2], Vec<SharedCell>>;

/// Most points whose overlaps are measured; of more, those of some blocks of space.
pub const MOST_COMPARED: usize = 1 << 22;

/// Exposures of stations whose points come in any order, from any thread.
pub struct Comparison {
    /// Points whose overlaps are measured.
    all: Sample,
    /// Points that [`balance`] looks at.
    some: Sample,
}

impl Comparison {
    /// Begins with a number of points within a box.
    pub fn new(bounds: (DVec3, DVec3), points: u64) -> Comparison {
        let all = Sample::of(bounds, u64::MAX, MOST_COMPARED);
        Comparison { all, some: Sample::new(bounds, points) }
    }

    /// Adds points: places, stations and colours.
    pub fn add(&self, points: impl Iterator<Item = (DVec3, u16, [u8; 3])>) {
        let [mut all, mut some] = [self.all.begin(), self.some.begin()];
        for (place, station, color) in points {
            // Both samples have the same cells.
            if let Some(point) = point(self.all.cell_of(place), station, color) {
                let block = hash_of(point);
                all.add(point, block);
                some.add(point, block);
            }
        }
        self.all.keep(all.points);
        self.some.keep(some.points);
    }

    /// Returns the exposures of stations whose mean values are these.
    pub fn exposures(self, stations: &[Station], values: Vec<Option<f64>>) -> Exposures {
        let is_sample = self.all.is_thinned();
        let points = self.all.into_points();
        let compared = is_sample.then_some(points.len() as u64);
        let pairs = compare(&points, dropped_bits(&points), stations.len()).1;
        drop(points);
        let overlap = |(stations, cells): (&[usize; 2], &Vec<SharedCell>)| {
            let step = cells.iter().map(|shared| shared.step).sum::<f64>() / cells.len() as f64;
            let gain = median(cells).exp2();
            Overlap { stations: *stations, cells: cells.len() as u64, step, gain }
        };
        let overlaps = pairs.iter().map(overlap).collect();
        Exposures { values, overlaps, compared, balance: of_sample(self.some, stations) }
    }
}

/// Finds the gains from a sample of the points that is quick to process and independent of their
/// order. `None` if no two stations overlap.
pub fn balance(cloud: &Cloud) -> Option<Balance> {
    balance_of(cloud, &Values::Colors)
}

/// Finds the gains of what points show.
pub fn balance_of(cloud: &Cloud, values: &Values) -> Option<Balance> {
    (cloud.stations.len() > 1).then(|| of_points(&sample::some(cloud, values)?, &cloud.stations))?
}

/// Returns the balance from points that came in any order.
pub fn of_sample(sample: Sample, stations: &[Station]) -> Option<Balance> {
    of_points(&sample.into_points(), stations)
}

fn of_points(points: &[Point], stations: &[Station]) -> Option<Balance> {
    let finest = dropped_bits(points);
    let mut groups = Groups::new(stations.len());
    let mut used = Pairs::new();
    for dropped in (0..=MAX_DOUBLINGS).map(|wider| finest + 3 * wider) {
        let (totals, mut pairs) = compare(points, dropped, stations.len());
        pairs.retain(|stations, cells| cells.len() >= MIN_CELLS && !used.contains_key(stations));
        pairs.keys().for_each(|&[a, b]| groups.join(a, b));
        used.append(&mut pairs);
        let mut coloured = (0..stations.len()).filter(|&station| totals[station].count > 0);
        let first = groups.of(coloured.next()?);
        if coloured.all(|station| groups.of(station) == first) {
            break;
        }
    }
    if used.is_empty() {
        return None;
    }
    let counts: Vec<u64> = stations.iter().map(|station| station.points).collect();
    let gains = gains(&used, &mut groups, &counts);
    let differ = |([a, b], cells): (&[usize; 2], &Vec<SharedCell>)| {
        let gain = (gains[*b] / gains[*a]).log2();
        cells
            .iter()
            .filter(|shared| (shared.stops - gain).abs() > UNEVEN_STOPS + SIGMAS * shared.error)
            .count()
    };
    let uneven = used.iter().map(differ).sum::<usize>() as f64
        / used.values().map(Vec::len).sum::<usize>() as f64;
    Some(Balance { gains, uneven })
}

/// Returns the median of the differences `[stops]`.
fn median(cells: &[SharedCell]) -> f64 {
    let mut stops: Vec<f64> = cells.iter().map(|shared| shared.stops).collect();
    stops.sort_by(f64::total_cmp);
    stops[stops.len() / 2]
}

/// Returns the low code bits that cells drop so that occupied ones have enough points.
fn dropped_bits(points: &[Point]) -> u32 {
    // For all neighbours the highest bit in which their codes differ, counted from 1.
    let mut differ = [0usize; 65];
    points
        .windows(2)
        .for_each(|pair| differ[(64 - (pair[0].0 ^ pair[1].0).leading_zeros()) as usize] += 1);
    let cells = |dropped: u32| 1 + differ[dropped as usize + 1..].iter().sum::<usize>();
    (0..AXIS_BITS)
        .map(|level| 3 * level)
        .find(|&dropped| points.len() >= POINTS_PER_CELL * cells(dropped))
        .unwrap_or(3 * AXIS_BITS)
}

/// Returns the statistics of stations, in total and for pairs in common cells.
fn compare(points: &[Point], dropped: u32, stations: usize) -> (Vec<StationStats>, Pairs) {
    let light: Vec<f64> = (0..256).map(|v| srgb_to_linear(v as f64 / 255.0)).collect();
    let cell = |point: &Point| point.0.checked_shr(dropped).unwrap_or(0);
    let mut totals = vec![StationStats::default(); stations];
    let mut pairs = Pairs::new();
    let mut here: Vec<(usize, StationStats)> = Vec::new();
    for cell in points.chunk_by(|a, b| cell(a) == cell(b)) {
        here.clear();
        for &(_, station, v) in cell {
            let known = here.iter().position(|(own, _)| *own == station as usize);
            let place = known.unwrap_or_else(|| {
                here.push((station as usize, StationStats::default()));
                here.len() - 1
            });
            here[place].1 = here[place].1.with(v, light[v as usize]);
        }
        here.sort_unstable_by_key(|(station, _)| *station);
        here.iter().for_each(|&(station, seen)| totals[station] = totals[station].and(seen));
        here.retain(|(_, seen)| seen.count >= MIN_POINTS && seen.light > 0.0);
        for (k, (a, one)) in here.iter().enumerate() {
            for (b, two) in &here[k + 1..] {
                let [one_count, two_count] = [one.count, two.count].map(f64::from);
                let step = two.value / two_count - one.value / one_count;
                let stops = ((one.light / one_count) / (two.light / two_count)).log2();
                let error = (one.relative_variance() + two.relative_variance()).sqrt()
                    / std::f64::consts::LN_2;
                pairs.entry([*a, *b]).or_default().push(SharedCell { step, stops, error });
            }
        }
    }
    (totals, pairs)
}

/// Groups of stations connected by overlaps.
struct Groups(Vec<usize>);

impl Groups {
    fn new(count: usize) -> Groups {
        Groups((0..count).collect())
    }

    fn of(&mut self, mut station: usize) -> usize {
        while self.0[station] != station {
            self.0[station] = self.0[self.0[station]];
            station = self.0[station];
        }
        station
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.of(a), self.of(b));
        self.0[a.max(b)] = a.min(b);
    }
}

/// Returns the gains whose logarithms x best agree with the overlaps: least sum over overlaps of
/// cells * (x_b - x_a - gain)^2. The overlaps leave the mean brightness of a group open: its mean
/// logarithm, weighted by `points`, is 0.
fn gains(pairs: &Pairs, groups: &mut Groups, points: &[u64]) -> Vec<f64> {
    let overlaps: Vec<([usize; 2], f64, f64)> = pairs
        .iter()
        .map(|(stations, cells)| (*stations, cells.len() as f64, median(cells)))
        .collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    // The normal equations, whose matrix is the Laplacian of the overlaps, by conjugate gradients
    // (Hestenes and Stiefel 1952).
    let mut rest = vec![0.0; points.len()];
    for &([a, b], cells, gain) in &overlaps {
        rest[a] -= cells * gain;
        rest[b] += cells * gain;
    }
    let (mut x, mut way, mut square) = (vec![0.0; points.len()], rest.clone(), dot(&rest, &rest));
    let enough = 1e-24 * square;
    for _ in 0..4 * points.len() {
        if square <= enough {
            break;
        }
        let mut applied = vec![0.0; x.len()];
        for &([a, b], cells, _) in &overlaps {
            applied[a] += cells * (way[a] - way[b]);
            applied[b] += cells * (way[b] - way[a]);
        }
        let step = square / dot(&way, &applied);
        x.iter_mut().zip(&way).for_each(|(x, way)| *x += step * way);
        rest.iter_mut().zip(&applied).for_each(|(rest, applied)| *rest -= step * applied);
        let before = std::mem::replace(&mut square, dot(&rest, &rest));
        way.iter_mut().zip(&rest).for_each(|(way, rest)| *way = rest + square / before * *way);
    }
    let mut means = vec![(0.0, 0.0); points.len()];
    for (number, (x, points)) in x.iter().zip(points).enumerate() {
        let (sum, count) = &mut means[groups.of(number)];
        (*sum, *count) = (*sum + *points as f64 * x, *count + *points as f64);
    }
    let own = |(number, x): (usize, &f64)| {
        let (sum, count) = means[groups.of(number)];
        (x - sum / count.max(1.0)).clamp(-MAX_STOPS, MAX_STOPS).exp2()
    };
    x.iter().enumerate().map(own).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{Columns, Header, Lattice, Part};

    /// Two stations of two square metres each, 0.8 of them shared, the second with half the light.
    /// Fewer than half of all points have a point of the other station beside them, so that the
    /// spacing is a station's own.
    #[test]
    fn half_the_light_is_a_gain_of_two() {
        let mut columns = Columns::default();
        let (mut rgb, mut source) = (Vec::new(), Vec::new());
        for station in 0..2 {
            for i in 0..20_000 {
                columns.x.push((i % 200) * 10 + 1200 * station + station);
                columns.y.push((i / 200) * 10 + station);
                columns.z.push(0);
                rgb.push(if station == 0 { [188, 100, 50] } else { [10, 137, 90] });
                source.push(station as u16);
            }
        }
        let columns = Columns { rgb: Some(rgb), source: Some(source), ..columns };
        let part = Part {
            path: "memory".into(),
            name: None,
            header: Header::default(),
            lattice: Lattice { step: DVec3::splat(0.001), offset: DVec3::new(5e5, 5e6, 0.0) },
            columns,
            intensity_range: [0.0, 65_535.0],
            rgb_scale: Default::default(),
        };
        let stations = [0, 1]
            .map(|source| Station {
                part: 0,
                source: Some(source),
                name: String::new(),
                points: 20_000,
            })
            .to_vec();
        let comparison = Comparison::new(part.bounds().unwrap(), 40_000);
        let Columns { x, y, z, rgb: Some(rgb), source: Some(source), .. } = &part.columns else {
            panic!("columns that were made above")
        };
        let place = |i: usize| part.lattice.world([x[i], y[i], z[i]].map(i64::from));
        comparison.add((0..40_000).map(|i| (place(i), source[i], rgb[i])));
        let found = comparison.exposures(&stations, vec![Some(188.0), Some(137.0)]);
        let cloud = Cloud { parts: vec![part], stations, ..Cloud::default() };
        assert_eq!(found.balance, balance(&cloud));
        let Balance { gains, uneven } = found.balance.clone().unwrap();
        assert!(
            (gains[0] - 0.5f64.sqrt()).abs() < 0.01
                && (gains[1] / gains[0] - 2.0).abs() < 0.03
                && uneven < 0.01,
            "{gains:?} {uneven}"
        );
        let [Overlap { stations: [0, 1], cells, step, gain }] = found.overlaps[..] else {
            panic!("{found:?}")
        };
        // 188 is half of white's light, 137 a quarter.
        assert!(cells > 100 && step == -51.0 && (gain - 2.0).abs() < 0.03, "{found:?}");
    }
    /// Overlaps with contradictory noise, a station without overlaps, and two that overlap only
    /// with each other.
    #[test]
    fn gains_best_agree_with_all_overlaps() {
        let truth: [f64; 6] = [0.3, -0.9, 1.1, -0.5, 0.7, 0.2];
        let overlap = |a: usize, b: usize, cells: usize, noise: f64| {
            (
                [a, b],
                vec![
                    SharedCell { step: 0.0, stops: truth[b] - truth[a] + noise, error: 0.0 };
                    cells
                ],
            )
        };
        let pairs = Pairs::from([
            overlap(0, 1, 100, 0.01),
            overlap(1, 2, 100, 0.01),
            overlap(0, 2, 100, -0.01),
            overlap(3, 4, 20, 0.0),
        ]);
        let mut groups = Groups::new(6);
        pairs.keys().for_each(|&[a, b]| groups.join(a, b));
        let found: Vec<f64> = gains(&pairs, &mut groups, &[100, 100, 200, 10, 10, 5])
            .iter()
            .map(|gain| gain.log2())
            .collect();
        let mean = [(0.3 - 0.9 + 2.0 * 1.1) / 4.0, 0.1];
        for (number, expected) in
            [0.3 - mean[0], -0.9 - mean[0], 1.1 - mean[0], -0.5 - mean[1], 0.7 - mean[1], 0.0]
                .into_iter()
                .enumerate()
        {
            assert!(
                (found[number] - expected).abs() < 0.02,
                "{number}: {} {expected}",
                found[number]
            );
        }
        assert!((found[4] - found[3] - 1.2).abs() < 1e-9 && found[5] == 0.0, "{found:?}");
    }
}
