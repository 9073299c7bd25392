//! Points in, their colours with the mean luminance of their neighbourhoods out: the offline correction that the one on the screen is judged by (Kanzok, Linsen and Rosenthal 2012, sec. 4).
//!
//! V of HSV, of the values as they are stored, is averaged over a point and those nearest to it; hue and saturation stay. All points of all stations count, and all cores work.

use super::knn_query::KnnQuery;
use super::leaf_cache::Leaf;
use crate::cloud::{Cloud, Columns, Lattice};
use crate::error::Result;
use crate::progress::Progress;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Points of a mean, the paper's.
pub const NEIGHBOURS: usize = 40;

/// Points between two looks at whether the work is still wanted.
const BATCH: usize = 1 << 14;

/// Roundings of a distance.
const SLACK: f64 = 1.0 + 1e-12;

/// Corrects the colours of a cloud; parts without colours neither give nor take.
pub fn correct(cloud: &mut Cloud, neighbours: usize, progress: &dyn Progress) -> Result<()> {
    let Some((mut columns, lattice)) = together(cloud) else { return Ok(()) };
    let colors: Vec<[u8; 3]> = cloud
        .parts
        .iter()
        .filter_map(|part| part.columns.rgb.as_ref())
        .flatten()
        .copied()
        .collect();
    progress.tick("finding neighbours", 0, colors.len() as u64)?;
    columns.rgb = Some(colors);
    let leaf = Leaf::of(&columns, &lattice, [0; 3], true);
    let tree = &leaf.tree;
    let done = AtomicU64::new(0);
    let batches: Vec<usize> = (0..tree.len()).step_by(BATCH).collect();
    let corrected = batches.into_par_iter().map(|first| {
        let places = first..(first + BATCH).min(tree.len());
        let count = places.len() as u64;
        let own = average(&mut KnnQuery::alone(&leaf), places, neighbours)?;
        progress.tick("averaging luminance", done.fetch_add(count, Relaxed), tree.len() as u64)?;
        Ok(own)
    });
    let corrected = corrected.collect::<Result<Vec<_>>>()?;
    let mut all = columns.rgb.take().expect("colours");
    corrected
        .into_iter()
        .flatten()
        .enumerate()
        .for_each(|(place, color)| all[tree.number(place)] = color);
    let mut rest = all.as_slice();
    for colors in cloud.parts.iter_mut().filter_map(|part| part.columns.rgb.as_mut()) {
        let (own, after) = rest.split_at(colors.len());
        colors.copy_from_slice(own);
        rest = after;
    }
    Ok(())
}

/// Corrected colours of some places of the own tree, in their order: neighbours there are mostly neighbours in space, and share what is in the cache.
pub fn average(
    around: &mut KnnQuery,
    places: Range<usize>,
    neighbours: usize,
) -> Result<Vec<[u8; 3]>> {
    let own = around.own();
    let others = neighbours.saturating_sub(1);
    let mut found = Vec::with_capacity(2 * neighbours);
    // Of the place before, which is mostly near: the neighbours of this one are no farther than those of that one and the way to it.
    let mut before: Option<(usize, f64)> = None;
    let mut corrected = Vec::with_capacity(places.len());
    for place in places {
        let known = before.map_or(f64::INFINITY, |(last, farthest)| {
            (farthest + own.tree.between(last, place).length()).powi(2) * SLACK
        });
        let mut squared = around.nearest_in_any_order(place, others, known, &mut found)?;
        // Where several are where this one is, they were neighbours of that one, and are none of its own.
        if found.len() < others && known.is_finite() {
            squared = around.nearest_in_any_order(place, others, f64::INFINITY, &mut found)?;
        }
        before = (found.len() == others).then(|| (place, squared.sqrt()));
        let color = own.colors[place];
        let sum: u64 = found.iter().map(|neighbour| value(around.color(neighbour)) as u64).sum();
        let mean = (sum + value(color) as u64) as f64 / (found.len() + 1) as f64;
        corrected.push(with_value(color, mean));
    }
    Ok(corrected)
}

/// V of HSV.
fn value([r, g, b]: [u8; 3]) -> u8 {
    r.max(g).max(b)
}

/// Setting V keeps hue and saturation where all channels are scaled alike; black becomes grey (HARD_CASES 22).
fn with_value(color: [u8; 3], mean: f64) -> [u8; 3] {
    match value(color) {
        0 => [mean.round() as u8; 3],
        own => color.map(|channel| (channel as f64 * mean / own as f64).round() as u8),
    }
}

/// Positions of all coloured parts on one lattice: their own where it is the same, else a common one whose steps are as fine as 32 bits allow.
fn together(cloud: &Cloud) -> Option<(Columns, Lattice)> {
    let parts: Vec<_> = cloud
        .parts
        .iter()
        .filter(|part| part.columns.rgb.is_some() && !part.columns.is_empty())
        .collect();
    let first = parts.first()?.lattice;
    let same = parts.iter().all(|part| part.lattice == first);
    let bounds = parts
        .iter()
        .filter_map(|part| part.bounds())
        .reduce(|(a, b), (c, d)| (a.min(c), b.max(d)))?;
    let lattice = if same {
        first
    } else {
        Lattice {
            step: ((bounds.1 - bounds.0) / i32::MAX as f64).max(DVec3::splat(f64::MIN_POSITIVE)),
            offset: bounds.0,
        }
    };
    let mut columns = Columns::default();
    for part in parts {
        let Columns { x, y, z, .. } = &part.columns;
        if same {
            columns.x.extend(x);
            columns.y.extend(y);
            columns.z.extend(z);
            continue;
        }
        for i in 0..x.len() {
            let steps = ((part.lattice.world([x[i], y[i], z[i]].map(i64::from)) - lattice.offset)
                / lattice.step)
                .round();
            columns.x.push(steps.x as i32);
            columns.y.push(steps.y as i32);
            columns.z.push(steps.z as i32);
        }
    }
    Some((columns, lattice))
}
