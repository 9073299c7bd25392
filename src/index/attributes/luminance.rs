//! Offline luminance correction: colours with the mean luminance of their neighbourhoods, the
//! reference for the screen-space one (Kanzok, Linsen and Rosenthal 2012, sec. 4).
//!
//! V of HSV, of the stored values, is averaged over a point and its nearest neighbours; hue and
//! saturation stay. All points of all stations count.

use super::knn_query::KnnQuery;
use super::leaf_cache::Leaf;
use crate::cloud::{Cloud, Columns, Lattice};
use crate::error::Result;
use crate::progress::Progress;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Points per mean, as in the paper.
pub const NEIGHBOURS: usize = 40;

/// Points between checks for cancellation.
const BATCH: usize = 1 << 14;

/// Tolerance for rounding of a distance.
const SLACK: f64 = 1.0 + 1e-12;

/// Corrects the colours of a cloud; parts without colours are ignored.
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

/// Returns corrected colours of some places of the own tree, in their order: consecutive places
/// share cached neighbours.
pub fn average(
    around: &mut KnnQuery,
    places: Range<usize>,
    neighbours: usize,
) -> Result<Vec<[u8; 3]>> {
    let own = around.own();
    let others = neighbours.saturating_sub(1);
    let mut found = Vec::with_capacity(2 * neighbours);
    // The previous place is mostly near: neighbours of this place are no farther than those of that
    // one plus the distance between them.
    let mut before: Option<(usize, f64)> = None;
    let mut corrected = Vec::with_capacity(places.len());
    for place in places {
        let known = before.map_or(f64::INFINITY, |(last, farthest)| {
            (farthest + own.tree.between(last, place).length()).powi(2) * SLACK
        });
        let mut squared = around.nearest_in_any_order(place, others, known, &mut found)?;
        // Points that coincide with this place were neighbours of the previous one, but are not its
        // own.
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

/// Returns V of HSV.
fn value([r, g, b]: [u8; 3]) -> u8 {
    r.max(g).max(b)
}

/// Sets V. Scaling all channels alike keeps hue and saturation; black becomes grey (guide:
/// numerics, case 22).
fn with_value(color: [u8; 3], mean: f64) -> [u8; 3] {
    match value(color) {
        0 => [mean.round() as u8; 3],
        own => color.map(|channel| (channel as f64 * mean / own as f64).round() as u8),
    }
}

/// Joins positions of all coloured parts on one lattice: their own if they share one, else a common
/// one with steps as fine as 32 bits allow.
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
