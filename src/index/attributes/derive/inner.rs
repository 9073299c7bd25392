//! Derived attributes of an inner node's samples, from those of its children.
//!
//! ```text
//! normal      oriented: mean; otherwise the axis nearest to all (Sum n n^T, its largest eigenvector)
//! stroke      covers what the merged strokes cover: root of the sum of squared radii; along the
//!             heaviest one, whose brush it keeps
//! luminance   mean in linear light, as other colours
//! ```

use super::super::leaf_cache::LeafCache;
use super::super::linear_algebra::eigen;
use super::super::strokes;
use crate::cloud::octahedral;
use crate::error::Result;
use crate::index::format::samples::DerivedColumns;
use crate::index::format::{NodeRecord, Plane};
use crate::index::merge::{self, Runs};
use glam::DVec3;
use std::ops::Range;

/// Derives a node's attributes. `corners` has the corner of the tree of every lattice `[steps]`.
pub fn node(
    leaf_cache: &LeafCache,
    node: usize,
    corners: &[[i64; 3]],
    planes: &[Plane],
    oriented: bool,
) -> Result<DerivedColumns> {
    let wanted: Vec<Plane> = planes.iter().copied().chain([Plane::Weight]).collect();
    let corner_of = |record: &NodeRecord| corners[record.lattice as usize];
    let below = leaf_cache.below(node, &corner_of, &wanted, &|_, _| Ok(()))?;
    let runs = merge::runs(&below);
    // The pseudo-random bits are the heaviest one's, too: it is the same stroke, wherever rounding
    // has put it.
    let facing = below.derived.facing.as_deref().map(|below| {
        runs.each(|run| {
            normal(&runs, below, run.clone(), oriented)
                | below[heaviest(&runs, run)] & !octahedral::UNKNOWN
        })
    });
    let brush = match (&facing, below.derived.facing.as_deref(), below.derived.brush.as_deref()) {
        (Some(own), Some(facing), Some(brush)) => {
            let mut own = own.iter();
            Some(runs.each(|run| {
                joined(&runs, *own.next().expect("a normal for every run"), facing, brush, run)
            }))
        }
        _ => None,
    };
    let corrected = below.derived.corrected.as_deref().map(|colors| runs.mean_colors(colors));
    Ok(DerivedColumns { facing, brush, corrected })
}

/// Axes with eigenvalues closer than this are undetermined.
const DEGENERATE: f64 = 1e-6;

fn normal(runs: &Runs, facing: &[u32], run: Range<usize>, oriented: bool) -> u32 {
    if run.len() == 1 {
        return facing[run.start] & octahedral::UNKNOWN;
    }
    let known = run.filter_map(|i| Some((octahedral::unpack(facing[i])?, runs.weight(i) as f64)));
    if oriented {
        let sum: DVec3 = known.map(|(normal, weight)| normal * weight).sum();
        return if sum == DVec3::ZERO { octahedral::UNKNOWN } else { octahedral::pack(sum) };
    }
    let mut products = [0.0; 6];
    let mut first = None;
    for (n, weight) in known {
        first = first.or(Some(n));
        let own = [n.x * n.x, n.x * n.y, n.x * n.z, n.y * n.y, n.y * n.z, n.z * n.z];
        (0..6).for_each(|k| products[k] += weight * own[k]);
    }
    let Some(first) = first else { return octahedral::UNKNOWN };
    let [_, (second, _), (most, axis)] = eigen(products);
    if most - second < DEGENERATE * most {
        return octahedral::UNKNOWN;
    }
    octahedral::pack(if axis.dot(first) < 0.0 { -axis } else { axis })
}

/// Returns the heaviest of a run; of ties the first.
fn heaviest(runs: &Runs, mut run: Range<usize>) -> usize {
    let first = run.next().expect("a cell has samples");
    run.fold(first, |most, i| if runs.weight(i) > runs.weight(most) { i } else { most })
}

fn joined(runs: &Runs, own: u32, facing: &[u32], brush: &[u32], run: Range<usize>) -> u32 {
    let heaviest = heaviest(runs, run.clone());
    if run.len() == 1 {
        return brush[heaviest];
    }
    let square: f64 = run.map(|i| (strokes::radius_m(brush[i]) as f64).powi(2)).sum();
    strokes::turned(brush[heaviest], facing[heaviest], own, square.sqrt())
}
