//! The LOD cut: the nodes of an index to draw for a view, or for several at once. Pure functions.
//!
//! A node's projected error is the side of the cells its samples were merged in, in pixels at the
//! least depth of its box, in the view where that is most. A leaf has all its points and error 0.
//! Refinement is greedy: the inner node with the greatest error is replaced by its visible
//! children, while that error is above `lod_px` and the cut stays within its point budget. Where
//! children add to a node, it stays in the cut with them ([`Refinement`]). A node that the budget
//! keeps is drawn as it is, and nodes with smaller errors are still refined. The sequence does not
//! depend on `lod_px`, which only ends it, so a smaller `lod_px` never makes any part coarser.
//!
//! Only refined nodes are visited: the cost follows the picture, not the cloud.

use crate::cloud::Lattice;
use crate::config::{BITS_PER_PLANE, BUDGET_LEAST, BUDGET_PER_PIXEL, LOD_PX, QUANTISATION_PX};
use crate::index::build::pack::Frame;
use crate::index::format::{Index, NodeRecord, Refinement};
use crate::select::clip::{Clips, Left};
use crate::view::linear_map::LinearMap;
use crate::view::{Projection, View};
use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashSet};
use std::ops::Range;

/// The limits of a cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detail {
    /// Most points of a cut; only the roots may exceed it.
    pub budget: u64,
    /// Least projected error `[px]` at which nodes are refined.
    pub lod_px: f64,
    pub precision: Precision,
}

impl Detail {
    /// Returns the default for a picture of this size `[px]`.
    pub fn of(size: [u32; 2]) -> Detail {
        let budget =
            ((size[0] as f64 * size[1] as f64 * BUDGET_PER_PIXEL) as u64).max(BUDGET_LEAST);
        Detail { budget, lod_px: LOD_PX, precision: Precision::Auto }
    }
}

/// The user's limits; the picture's size decides those that are `None`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LodOptions {
    pub budget: Option<u64>,
    pub lod_px: Option<f64>,
}

impl LodOptions {
    /// Returns why files are indexed before they are drawn, if the limits are the user's.
    pub fn index_for(self) -> Option<&'static str> {
        (self != LodOptions::default())
            .then_some("--point-budget and --lod choose among the nodes of an index")
    }

    /// Returns the limits for a picture of this size `[px]`.
    pub fn of(self, size: [u32; 2]) -> Detail {
        let usual = Detail::of(size);
        Detail {
            budget: self.budget.unwrap_or(usual.budget),
            lod_px: self.lod_px.unwrap_or(usual.lod_px),
            ..usual
        }
    }
}

/// A node of a cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutNode {
    pub node: usize,
    /// Projected error `[px]`.
    pub error_px: f64,
    /// Projected error of its parent `[px]`, which may stand in for it: the greater, the sooner the
    /// node is needed. Infinite for a root.
    pub gain_px: f64,
    /// Least planar depth of its box in any view `[m]`.
    pub distance: f64,
}

/// Nodes that show everything in view exactly once; with them those that they add to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cut {
    /// Nodes in order of need, most needed first.
    pub nodes: Vec<CutNode>,
    pub points: u64,
    /// Largest projected error of the nodes that are not refined `[px]`; 0 if all are leaves.
    pub largest_error_px: f64,
    /// Visited nodes outside the view.
    pub nodes_outside: usize,
    /// Nodes in view that clip boxes remove entirely.
    pub nodes_clipped: usize,
}

/// Chooses the cut for views of what clip boxes leave. A node in `unreadable` is replaced by its
/// children, else by its parent, else by nothing.
pub fn choose(
    index: &Index,
    views: &[View],
    clips: &Clips,
    detail: &Detail,
    unreadable: &HashSet<usize>,
) -> Cut {
    choose_through(&LinearMap::default(), index, views, clips, detail, unreadable)
}

/// Does the same for a cloud that is drawn through a linear map, in whose coordinates views are.
pub fn choose_through(
    map: &LinearMap,
    index: &Index,
    views: &[View],
    clips: &Clips,
    detail: &Detail,
    unreadable: &HashSet<usize>,
) -> Cut {
    let mut cut = Cut::default();
    let mut open = BinaryHeap::new();
    let all = Seen { index, views, clips, unreadable, map, stretch: map.largest_stretch() };
    let roots = all.of(0..index.directory.roots as usize, f64::INFINITY);
    cut.nodes_outside += roots.outside;
    cut.nodes_clipped += roots.clipped;
    cut.points = roots.points;
    open.extend(roots.nodes.into_iter().map(Open));
    while let Some(Open(wanted)) = open.pop() {
        let node = &index.nodes()[wanted.node];
        if !node.is_leaf() && wanted.error_px > detail.lod_px {
            let finer = all.of(node.children(), wanted.error_px);
            let stays = index.refinement == Refinement::Adds;
            let points = cut.points + finer.points - if stays { 0 } else { node.count as u64 };
            if (finer.complete || stays) && points <= detail.budget {
                cut.points = points;
                cut.nodes.extend(stays.then_some(wanted));
                cut.nodes_outside += finer.outside;
                cut.nodes_clipped += finer.clipped;
                open.extend(finer.nodes.into_iter().map(Open));
                continue;
            }
        }
        cut.largest_error_px = cut.largest_error_px.max(wanted.error_px);
        cut.nodes.push(wanted);
    }
    cut.nodes.sort_by(|a, b| {
        b.gain_px
            .total_cmp(&a.gain_px)
            .then(a.distance.total_cmp(&b.distance))
            .then(a.node.cmp(&b.node))
    });
    cut
}

/// A node that may be refined, ordered by error; the lower node index first among equals.
struct Open(CutNode);

impl Ord for Open {
    fn cmp(&self, other: &Open) -> Ordering {
        self.0.error_px.total_cmp(&other.0.error_px).then(other.0.node.cmp(&self.0.node))
    }
}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Open) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Open {
    fn eq(&self, other: &Open) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Open {}

struct Seen<'a> {
    index: &'a Index,
    views: &'a [View],
    clips: &'a Clips,
    unreadable: &'a HashSet<usize>,
    map: &'a LinearMap,
    /// Factor by which it lengthens errors at most.
    stretch: f64,
}

/// The visible nodes that stand for a range of siblings.
struct Siblings {
    nodes: Vec<CutNode>,
    points: u64,
    outside: usize,
    clipped: usize,
    /// True if nothing visible is missing.
    complete: bool,
}

impl Seen<'_> {
    fn of(&self, siblings: Range<usize>, gain_px: f64) -> Siblings {
        let mut found =
            Siblings { nodes: Vec::new(), points: 0, outside: 0, clipped: 0, complete: true };
        let mut ranges = vec![siblings];
        while let Some(range) = ranges.pop() {
            for node in range {
                let record = &self.index.nodes()[node];
                let Some((distance, error_px)) = self.nearest(record) else {
                    found.outside += 1;
                    continue;
                };
                if self.clips.left(self.index.bounds(record)) == Left::Nothing {
                    found.clipped += 1;
                    continue;
                }
                if self.unreadable.contains(&node) {
                    found.complete &= !record.is_leaf();
                    ranges.push(record.children());
                    continue;
                }
                found.points += record.count as u64;
                found.nodes.push(CutNode { node, error_px, gain_px, distance });
            }
        }
        found
    }

    /// Returns the least planar depth of a node in any view, and its largest projected error;
    /// `None` if no view sees it.
    fn nearest(&self, record: &NodeRecord) -> Option<(f64, f64)> {
        let (bounds, apart) =
            (self.map.bounds(self.index.bounds(record)), record.spacing * self.stretch);
        let seen = |view: &View| {
            let distance = view.least_depth(bounds)?;
            let error_px = match view.camera.projection {
                _ if record.is_leaf() => 0.0,
                // Infinite if the camera may be inside the node.
                Projection::Perspective => apart * view.focal_px() / distance,
                Projection::Orthographic => apart * view.focal_px(),
            };
            Some((distance, error_px))
        };
        let least = |a: (f64, f64), b: (f64, f64)| (a.0.min(b.0), a.1.max(b.1));
        self.views.iter().filter_map(seen).reduce(least)
    }
}

/// The number of position planes to read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// The fewest planes that keep the quantisation below `QUANTISATION_PX`.
    Auto,
    /// At most this many planes of ten bits.
    Planes(u32),
}

impl Precision {
    /// Returns the number of planes to draw a node with, given its least depth `[m]`.
    pub fn planes(
        self,
        view: &View,
        map: &LinearMap,
        lattice: &Lattice,
        frame: &Frame,
        distance: f64,
    ) -> u32 {
        match self {
            Precision::Planes(most) => most.clamp(1, frame.planes),
            Precision::Auto => (1..frame.planes)
                .find(|&planes| {
                    quantisation_px(view, map, lattice, frame, distance, planes) <= QUANTISATION_PX
                })
                .unwrap_or(frame.planes),
        }
    }
}

/// Returns the lattice steps a cell of a node spans with this many planes; below 1 if the planes
/// hold more bits than the node has.
pub fn cell_steps(frame: &Frame, planes: u32) -> f64 {
    (2f64).powi(frame.bits as i32 - (BITS_PER_PLANE * planes) as i32)
}

/// Returns a bound `[px]` on how far quantisation may displace a drawn point, at the node's least
/// depth. With perspective, a displacement d moves a point's pixel by at most |d| f / depth, times
/// the secant of its angle from the axis: f (dx - tan dz) / depth, by Cauchy and Schwarz.
pub fn quantisation_px(
    view: &View,
    map: &LinearMap,
    lattice: &Lattice,
    frame: &Frame,
    distance: f64,
    planes: u32,
) -> f64 {
    if planes >= frame.planes {
        return 0.0;
    }
    let half_cell = 0.5 * cell_steps(frame, planes) * map.diagonal(lattice.step);
    match view.camera.projection {
        Projection::Perspective => {
            let f = view.focal_px();
            let corner = 0.5 * (view.whole[0] as f64).hypot(view.whole[1] as f64);
            half_cell * f.hypot(corner) / distance
        }
        Projection::Orthographic => half_cell * view.focal_px(),
    }
}
