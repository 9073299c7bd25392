//! Popping: visible changes when nodes of a moving picture are replaced by finer ones (guide:
//! numerics, case 31).
//!
//! Measured is the mean FLIP over the foreground between consecutive frames of a dolly so slow that
//! little but level changes should differ: points at the target's distance at the picture's edge
//! move by 0.1 px a frame. The path is searched for the first cut that differs in levels from the
//! one before, and the frames lie around it. Single points flicker also without level changes,
//! whenever they cross into another pixel; frames without a change, and frames ten apart, which
//! have moved by one pixel, are the comparison.

use super::flip::{self, Seen};
use super::lod::{covered, draw};
use super::metrics;
use crate::error::Result;
use crate::graph::Gpu;
use crate::index::format::Index;
use crate::progress::Progress;
use crate::resident::Residency;
use crate::select::clip::Clips;
use crate::select::lod::{self, Cut, Detail};
use crate::view::{Camera, View};
use std::collections::HashSet;

/// Movement between frames `[px]`.
pub const STEP_PX: f64 = 0.1;
/// Frames that together move by a pixel.
const APART: usize = 10;
/// Distance to the target, relative to the beginning, where the search for a level change ends.
const NEAREST: f64 = 1.0 / 64.0;

/// Results of a dolly.
#[derive(Clone, Debug, Default)]
pub struct Popping {
    /// Consecutive frames whose nodes differ in level.
    pub changes: usize,
    /// The largest mean FLIP between consecutive frames.
    pub max: f64,
    /// The median between consecutive frames without a level change.
    pub median: f64,
    /// The median between frames that have moved by one pixel, without a level change between them.
    pub moved: f64,
    /// Device time of each frame's projecting `[ms]`.
    pub ms: Vec<f64>,
}

/// Draws `frames` frames around the first level change between the camera and its target.
pub fn watch(
    gpu: &mut Gpu,
    residency: &mut Residency,
    camera: Camera,
    size: [u32; 2],
    detail: &Detail,
    frames: usize,
    progress: &dyn Progress,
) -> Result<Popping> {
    let shrink = 1.0 - STEP_PX / (size[0] as f64 / 2.0);
    let view = |step: usize| {
        View::new(
            Camera {
                eye: camera.target + (camera.eye - camera.target) * shrink.powi(step as i32),
                ..camera
            },
            size,
        )
    };
    let change =
        first_change(residency.index(), detail, (NEAREST.ln() / shrink.ln()) as usize, &view)?;
    let first = change.saturating_sub(frames / 2);
    let mut popping = Popping::default();
    let (mut seen, mut cuts, mut near, mut far) =
        (Vec::<(Seen, Vec<bool>)>::new(), Vec::<Cut>::new(), Vec::new(), Vec::new());
    for number in 0..frames {
        progress.tick("dolly", number as u64, frames as u64)?;
        let view = view(first + number)?;
        cuts.push(residency.wait_until_resident(gpu, &view, detail, progress)?.cut);
        let drawing = draw(gpu, &view, residency.resident())?;
        popping.ms.push(drawing.ms);
        seen.push((
            Seen::new(&drawing.picture, size, flip::PIXELS_PER_DEGREE),
            covered(&drawing.depth),
        ));
        let level_changes = |back: usize| {
            cuts[number - back..]
                .windows(2)
                .any(|pair| changes_level(residency.index(), &pair[0], &pair[1]))
        };
        if number >= 1 {
            let mean = mean_flip(&seen[number - 1], &seen[number]);
            let changes = level_changes(1);
            popping.changes += changes as usize;
            popping.max = popping.max.max(mean);
            near.extend((!changes).then_some(mean));
        }
        if number >= APART && !level_changes(APART) {
            far.push(mean_flip(&seen[number - APART], &seen[number]));
        }
    }
    popping.median = metrics::quartiles(&near)[1];
    popping.moved = metrics::quartiles(&far)[1];
    Ok(popping)
}

/// Returns the first step whose cut has other levels than the one before; 0 if none. Steps are
/// tested eight at a time, since a changed level stays so.
fn first_change(
    index: &Index,
    detail: &Detail,
    steps: usize,
    view: &dyn Fn(usize) -> Result<View>,
) -> Result<usize> {
    const STRIDE: usize = 8;
    let choose = |step: usize| {
        Ok::<_, crate::error::Error>(lod::choose(
            index,
            &[view(step)?],
            &Clips::default(),
            detail,
            &HashSet::new(),
        ))
    };
    let mut before = choose(0)?;
    for step in (STRIDE..=steps).step_by(STRIDE) {
        let now = choose(step)?;
        if changes_level(index, &before, &now) {
            for fine in step - STRIDE + 1..step {
                let cut = choose(fine)?;
                if changes_level(index, &before, &cut) {
                    return Ok(fine);
                }
            }
            return Ok(step);
        }
        before = now;
    }
    Ok(0)
}

/// Tests whether a node of one cut is an ancestor of a node of the other: nodes that leave or enter
/// the picture change no level.
fn changes_level(index: &Index, a: &Cut, b: &Cut) -> bool {
    let nodes = |cut: &Cut| cut.nodes.iter().map(|wanted| wanted.node).collect::<HashSet<_>>();
    let (a, b) = (nodes(a), nodes(b));
    let above = |nodes: &HashSet<usize>, others: &HashSet<usize>| {
        nodes.difference(others).any(|&node| {
            let parent = |&node: &usize| {
                Some(index.nodes()[node].parent as usize).filter(|&parent| parent != node)
            };
            std::iter::successors(parent(&node), parent).any(|node| others.contains(&node))
        })
    };
    above(&a, &b) || above(&b, &a)
}

/// Returns the mean over the pixels that either covers.
pub fn mean_flip((a, a_covers): &(Seen, Vec<bool>), (b, b_covers): &(Seen, Vec<bool>)) -> f64 {
    let map = flip::difference(a, b);
    metrics::mean(
        map.iter()
            .zip(a_covers.iter().zip(b_covers))
            .filter(|(_, (a, b))| **a || **b)
            .map(|(v, _)| *v as f64),
    )
}
