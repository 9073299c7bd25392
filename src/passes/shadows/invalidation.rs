//! Finds the nodes that keep their visibility when nodes come and go, and those that must be cast
//! again.
//!
//! ```text
//!     arrived, gone       nodes in only one of the two frames
//!     again               nodes whose box overlaps one of those in some picture of the light
//!     casters of again    nodes whose box overlaps one of `again`: whatever else is in these texels
//! ```
//! Boxes are enlarged, since the limit of a texel depends on a few texels around it. So all inputs
//! of the other nodes are unchanged, and the result equals casting everything again, bit by bit.

use crate::resident::{IDENTITY_WORDS, Resident, ResidentNode, bounds_of};
use crate::view::{Projection, View};
use glam::{DVec2, DVec3};
use std::collections::HashMap;

/// Nodes by number.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Changed {
    /// Nodes that keep their visibility: old and new number.
    pub stay: Vec<[u32; 2]>,
    /// Nodes that are cast again.
    pub again: Vec<usize>,
}

/// Share of nodes from which everything is cast again.
const MOST: f64 = 0.7;

/// Compares nodes with those `before` (see [`Resident::nodes_identity`]), in pictures where depths
/// travel `travel_px` texels. None if all are to be cast again.
pub fn changed(
    before: &[u64],
    resident: &Resident,
    views: &[View],
    travel_px: f64,
) -> Option<Changed> {
    let now = resident.nodes_identity();
    let old: HashMap<&[u64], u32> = before.chunks_exact(IDENTITY_WORDS).zip(0..).collect();
    let new: HashMap<&[u64], u32> = now.chunks_exact(IDENTITY_WORDS).zip(0..).collect();
    let only =
        |some: &HashMap<&[u64], u32>, others: &HashMap<&[u64], u32>| -> Vec<(DVec3, DVec3)> {
            let only = some.keys().filter(|node| !others.contains_key(*node));
            only.map(|node| resident.map().bounds(bounds_of(node))).collect()
        };
    let others: Vec<(DVec3, DVec3)> =
        only(&new, &old).into_iter().chain(only(&old, &new)).collect();
    let shaded = Boxes::of(views, &others, travel_px);
    let (mut changed, most) = (Changed::default(), (MOST * resident.nodes.len() as f64) as usize);
    for (number, (node, identity)) in
        resident.nodes.iter().zip(now.chunks_exact(IDENTITY_WORDS)).enumerate()
    {
        match old.get(identity) {
            Some(&before) if !shaded.meet(node.bounds()) => {
                changed.stay.push([before, number as u32])
            }
            _ => changed.again.push(number),
        }
    }
    (changed.again.len() <= most).then_some(changed)
}

/// Returns the nodes that overlap one that is cast again in a picture of the light.
pub fn casters<'r>(
    view: &View,
    resident: &'r Resident,
    again: &[usize],
    travel_px: f64,
) -> Vec<&'r ResidentNode> {
    let again: Vec<_> = again.iter().map(|&number| resident.nodes[number].bounds()).collect();
    let receivers = Boxes::of(std::slice::from_ref(view), &again, travel_px);
    resident.nodes.iter().filter(|node| receivers.meet(node.bounds())).collect()
}

/// Boxes projected into pictures.
struct Boxes<'v> {
    views: &'v [View],
    /// Corners of each box in every view `[texels]`.
    seen: Vec<Vec<[DVec2; 2]>>,
    travel_px: f64,
}

impl<'v> Boxes<'v> {
    fn of(views: &'v [View], boxes: &[(DVec3, DVec3)], travel_px: f64) -> Boxes<'v> {
        let seen = views
            .iter()
            .map(|view| boxes.iter().filter_map(|&bounds| on(view, bounds)).collect())
            .collect();
        Boxes { views, seen, travel_px }
    }

    fn meet(&self, bounds: (DVec3, DVec3)) -> bool {
        self.views.iter().zip(&self.seen).any(|(view, seen)| {
            let Some([low, high]) = on(view, bounds) else { return false };
            let (low, high) = (low - self.travel_px, high + self.travel_px);
            seen.iter().any(|[other_low, other_high]| {
                low.cmple(*other_high).all() && high.cmpge(*other_low).all()
            })
        })
    }
}

/// Returns the rectangle that a box may cover in a picture `[texels]`; the whole plane if it is too
/// near.
fn on(view: &View, (min, max): (DVec3, DVec3)) -> Option<[DVec2; 2]> {
    let (near, _) = view.depths((min, max))?;
    let f = view.focal_px();
    let perspective = view.camera.projection == Projection::Perspective;
    if perspective && near <= 1e-3 * (max - min).length() {
        return Some([DVec2::NEG_INFINITY, DVec2::INFINITY]);
    }
    let corner = |k: u32| {
        let p = DVec3::from_array(
            [0, 1, 2].map(|axis| if k >> axis & 1 == 1 { max[axis] } else { min[axis] }),
        ) - view.camera.eye;
        let scale = if perspective { f / p.dot(view.basis.forward).max(near) } else { f };
        DVec2::new(p.dot(view.basis.right), p.dot(view.basis.up)) * scale
    };
    let corners = (0..8).map(corner);
    Some(
        corners
            .map(|at| [at, at])
            .reduce(|[low, high], [a, b]| [low.min(a), high.max(b)])
            .expect("eight corners"),
    )
}
