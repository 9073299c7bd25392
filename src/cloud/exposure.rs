//! How bright stations are, and how much brighter one is than another where both have seen the same.
//!
//! In: a cloud with colours. Out: the mean value of each station's points; and of every two that overlap the step between them and the gain that would remove it.
//! Both have seen the same in cells of a few spacings that hold points of both. A gain is a factor on light, so ratios are of linear values; the median over the cells leaves out those that a
//! shadow, a passer-by or a wall's other side made different (after Kanzok, Linsen and Rosenthal 2012, sec. 1 and 6).

use super::color::srgb_to_linear;
use super::{Cloud, Part, Station, spacing};
use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;

#[derive(Debug, PartialEq, Serialize)]
pub struct Exposures {
    /// By number of the station, the mean V of HSV of its points, 0 to 255; none of one without colours.
    pub values: Vec<Option<f64>>,
    pub overlaps: Vec<Overlap>,
}

#[derive(Debug, PartialEq, Serialize)]
pub struct Overlap {
    /// Numbers of two stations.
    pub stations: [usize; 2],
    /// Cells that both have points in.
    pub cells: u64,
    /// By how much the second's V is above the first's there, of 255; mean.
    pub step: f64,
    /// The factor on the second's light that gives it the first's.
    pub gain: f64,
}

/// Sides of a cell, in spacings: dozens of points of a station that sees it well.
const CELL: f64 = 8.0;
/// Points of a station that say how bright it is in a cell.
const ENOUGH: u32 = 4;
/// Cells a side that a key has room for.
const MOST_CELLS: f64 = (1u64 << 21) as f64;

/// What one station has in one cell.
#[derive(Clone, Copy, Default)]
struct Seen {
    count: u32,
    value: f64,
    light: f64,
}

/// None where fewer than two stations have colours.
pub fn exposures(cloud: &Cloud) -> Option<Exposures> {
    let (lo, hi) = cloud.bounds()?;
    let side = (CELL * spacing::spacing(cloud)?).max((hi - lo).max_element() / MOST_CELLS * 1.001);
    let light: Vec<f64> = (0..256).map(|v| srgb_to_linear(v as f64 / 255.0)).collect();
    let mut points: Vec<(u64, u16, u8)> = Vec::new();
    for (number, part) in cloud.parts.iter().enumerate() {
        let first = cloud.stations.partition_point(|station| station.part < number);
        let stations = &cloud.stations[first..cloud.stations.partition_point(|station| station.part <= number)];
        points.par_extend(coloured(part, first, stations, lo, side));
    }
    points.par_sort_unstable();
    let mut totals = vec![Seen::default(); cloud.stations.len()];
    let mut pairs: BTreeMap<[usize; 2], Vec<(f64, f64)>> = BTreeMap::new();
    for cell in points.chunk_by(|a, b| a.0 == b.0) {
        let mut here: Vec<(usize, Seen)> = Vec::new();
        for own in cell.chunk_by(|a, b| a.1 == b.1) {
            let mut seen = Seen { count: own.len() as u32, ..Seen::default() };
            own.iter().for_each(|(.., v)| (seen.value, seen.light) = (seen.value + *v as f64, seen.light + light[*v as usize]));
            let total = &mut totals[own[0].1 as usize];
            *total =
                Seen { count: total.count.saturating_add(seen.count), value: total.value + seen.value, light: total.light + seen.light };
            if seen.count >= ENOUGH && seen.light > 0.0 {
                let count = seen.count as f64;
                here.push((own[0].1 as usize, Seen { value: seen.value / count, light: seen.light / count, ..seen }));
            }
        }
        for (k, (a, one)) in here.iter().enumerate() {
            for (b, two) in &here[k + 1..] {
                pairs.entry([*a, *b]).or_default().push((two.value - one.value, one.light / two.light));
            }
        }
    }
    let values: Vec<_> = totals.iter().map(|total| (total.count > 0).then(|| total.value / total.count as f64)).collect();
    let overlap = |(stations, mut cells): ([usize; 2], Vec<(f64, f64)>)| {
        cells.sort_by(|a, b| a.1.total_cmp(&b.1));
        let step = cells.iter().map(|(step, _)| step).sum::<f64>() / cells.len() as f64;
        Overlap { stations, cells: cells.len() as u64, step, gain: cells[cells.len() / 2].1 }
    };
    let overlaps = pairs.into_iter().map(overlap).collect();
    (values.iter().flatten().count() > 1).then_some(Exposures { values, overlaps })
}

/// Cell, station and value of every coloured point of a part.
fn coloured<'p>(
    part: &'p Part,
    first: usize,
    stations: &'p [Station],
    lo: DVec3,
    side: f64,
) -> impl ParallelIterator<Item = (u64, u16, u8)> + 'p {
    let columns = &part.columns;
    let point = move |i: usize| {
        let [r, g, b] = columns.rgb.as_ref()?[i];
        let source = columns.source.as_ref().map(|column| column[i]);
        let station = first + stations.binary_search_by_key(&source, |station| station.source).unwrap_or(0);
        let cell = ((part.lattice.world([columns.x[i], columns.y[i], columns.z[i]].map(i64::from)) - lo) / side).floor().max(DVec3::ZERO);
        let [x, y, z] = cell.to_array().map(|axis| axis as u64);
        Some((x << 42 | y << 21 | z, station as u16, r.max(g).max(b)))
    };
    (0..columns.len()).into_par_iter().filter_map(point)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{Columns, Header, Lattice};

    /// Two stations of two square metres each, 0.8 of them the same, the second with half the light. Fewer than half of all points have one of the other station beside them, so that the spacing is a station's own.
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
            rgb_bits: 8,
        };
        let stations = [0, 1].map(|source| Station { part: 0, source: Some(source), name: String::new(), points: 20_000 }).to_vec();
        let found = exposures(&Cloud { parts: vec![part], stations, notes: Vec::new() }).unwrap();
        assert_eq!(found.values, [Some(188.0), Some(137.0)]);
        let [Overlap { stations: [0, 1], cells, step, gain }] = found.overlaps[..] else { panic!("{found:?}") };
        // 188 is half of white's light, 137 a quarter.
        assert!(cells > 100 && step == -51.0 && (gain - 2.0).abs() < 0.03, "{found:?}");
    }
}
