//! What the samples of an index's roots tell of its points: colours, bounds and strays.

use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::cloud::robust_bounds::{chosen_samples, without_strays};
use crate::cloud::strays::{RobustBounds, Strays};
use crate::cloud::up::Up;
use crate::error::Result;
use crate::index::format::{Index, Plane};
use crate::select::clip::{Clips, Left};
use glam::DVec3;

/// Returns a display attribute for the points of an index.
pub fn shown(index: &Index, attribute: Attribute) -> DisplayAttribute {
    let contents = &index.directory.contents;
    let stretch = match attribute {
        Attribute::Intensity => contents.intensity_stretch,
        _ => [0, 255],
    };
    let mut shown = match attribute {
        Attribute::Elevation => elevation(index),
        Attribute::Time | Attribute::Scalar(_) => {
            DisplayAttribute::of_numbers(attribute, numbers(index, attribute))
        }
        _ => DisplayAttribute::indexed(attribute, [0.0; 2], stretch),
    };
    // Without exposures, the station codes are not needed.
    shown.coded = contents.balance_of(attribute).is_some();
    shown
}

/// Returns the numbers of the roots' samples, each with the points it stands for. A root that
/// cannot be read has none, and is reported when drawn.
fn numbers(index: &Index, attribute: Attribute) -> Vec<(f64, u64)> {
    let read = |node: usize| {
        let root = &index.nodes()[node];
        let mut weights = vec![1u32; root.count as usize];
        let columns = index.columns(node, attribute.wanted()).ok()?;
        let numbers = attribute.numbers_of(&columns)?.clone();
        if root.has(Plane::Weight) {
            index.read(node, Plane::Weight, bytemuck::cast_slice_mut(&mut weights)).ok()?;
        }
        Some(numbers.into_iter().zip(weights))
    };
    let numbers = (0..index.directory.roots as usize).filter_map(read).flatten();
    numbers.filter(|(v, _)| v.is_finite()).map(|(v, weight)| (v, weight as u64)).collect()
}

/// Returns elevation over the heights of all points; if there are strays or y is up, over those of
/// the roots' other samples.
fn elevation(index: &Index) -> DisplayAttribute {
    let contents = &index.directory.contents;
    let (samples, core) = root_samples(index);
    let axis = index.up.index();
    if core.is_none() && index.up == Up::Z {
        let heights = contents.bounds.map_or([0.0, 0.0], |[lo, hi]| [lo.z, hi.z]);
        return DisplayAttribute::indexed(
            Attribute::Elevation,
            heights,
            contents.elevation_stretch,
        );
    }
    let heights = samples
        .into_iter()
        .filter(|(p, _)| core.is_none_or(|core| core.has(*p)))
        .map(|(p, weight)| (p[axis], weight as u64));
    let mut shown = DisplayAttribute::of_numbers(Attribute::Elevation, heights.collect());
    shown.up = index.up;
    shown
}

/// Returns samples of the roots with the number of points each stands for, and the box without
/// strays, if there are strays.
fn root_samples(index: &Index) -> (Vec<(DVec3, u32)>, Option<RobustBounds>) {
    let mut samples = Vec::new();
    for root in 0..index.directory.roots as usize {
        // An unreadable root is reported when drawn; until then its box is used.
        let left = left_samples(index, root).and_then(|left| match left.is_empty() {
            true => index.samples(root),
            false => Ok(left),
        });
        samples.extend(left.unwrap_or_else(|_| {
            let (lo, hi) = index.bounds(&index.nodes()[root]);
            vec![(lo, 1), (hi, 1)]
        }));
    }
    let core = RobustBounds::of_samples(&samples);
    (samples, core)
}

/// Returns the samples of a node that the index's filter leaves.
fn left_samples(index: &Index, node: usize) -> Result<Vec<(DVec3, u32)>> {
    let samples = index.samples(node)?;
    let Some(filter) = &index.filter else { return Ok(samples) };
    let left = index.left(node, filter)?;
    Ok(samples.into_iter().zip(left).filter(|(_, left)| *left).map(|(sample, _)| sample).collect())
}

/// Returns the strays of an index among the samples of its roots.
pub fn strays(index: &Index) -> Strays {
    let (samples, core) = root_samples(index);
    let Some(core) = core else { return Strays::default() };
    let outside: Vec<(DVec3, u32)> = samples.into_iter().filter(|(p, _)| !core.has(*p)).collect();
    Strays::listed(
        outside.iter().map(|&(_, weight)| weight as u64).sum(),
        outside.iter().map(|(p, _)| *p),
    )
}

/// Returns the box beyond which points of an index are strays, if there are some.
pub fn core_of(index: &Index) -> Option<RobustBounds> {
    root_samples(index).1
}

/// Returns the points to frame as [`Cloud::core_points`], from the roots' samples.
pub(super) fn core_samples(index: &Index) -> Vec<DVec3> {
    let (samples, _) = root_samples(index);
    if index.filter.is_some() { chosen_samples(samples) } else { without_strays(samples) }
}

/// Samples that describe what clip boxes leave of an index, if there are as many; and most nodes
/// that are read for them.
const FRAMED_SAMPLES: usize = 50_000;
const FRAMED_NODES: usize = 64;

/// Returns samples that clip boxes leave: of the roots, or of nodes below while these leave few.
pub(super) fn samples_left(index: &Index, clips: &Clips) -> Vec<(DVec3, u32)> {
    let meets = |&node: &usize| clips.left(index.bounds(&index.nodes()[node])) != Left::Nothing;
    let mut nodes: Vec<usize> = (0..index.directory.roots as usize).filter(meets).collect();
    loop {
        let mut kept = Vec::new();
        for &node in &nodes {
            // A sample stands for points as far as this, which boxes may leave without it.
            let reach = index.nodes()[node].spacing;
            let ways = DVec3::AXES.map(|axis| [axis * reach, -axis * reach]);
            for (p, weight) in left_samples(index, node).unwrap_or_default() {
                kept.extend(Some((p, weight)).filter(|_| clips.keep(p)));
                if reach > 0.0 {
                    let around = ways.iter().flatten().map(|&way| (p + way, 1));
                    kept.extend(around.filter(|&(p, _)| clips.keep(p)));
                }
            }
        }
        let below: Vec<usize> = nodes
            .iter()
            .flat_map(|&node| match index.nodes()[node].children() {
                children if children.is_empty() => node..node + 1,
                children => children,
            })
            .filter(meets)
            .collect();
        if kept.len() >= FRAMED_SAMPLES || below.len() > FRAMED_NODES || below == nodes {
            return kept;
        }
        nodes = below;
    }
}
