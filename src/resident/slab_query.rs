//! Resident points in a vertical slab, for profiles.
//!
//! Only drawn points count: those hidden by opacities or clip boxes are left out, and of an index
//! only the nodes of the last picture are searched.

use super::{Point, Resident, position, word_of};
use crate::config::POINTS_PER_PAGE;
use crate::error::Result;
use crate::graph::Gpu;
use crate::select::clip::Left;
use crate::select::slab::Slab;
use glam::DVec2;
use rayon::prelude::*;

/// A point in a slab.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlabPoint {
    pub point: Point,
    /// Value shown ([`crate::cloud::attribute::DisplayAttribute::word`]).
    pub shown: u32,
    /// Distance from the start along the slab, and to its left `[m]`.
    pub place: DVec2,
}

/// Points in a slab, in id order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SlabPoints {
    pub points: Vec<SlabPoint>,
    /// Points resident, and points of the whole cloud.
    pub resident: u64,
    pub all: u64,
}

impl Resident {
    pub fn section(&self, gpu: &mut Gpu, slab: &Slab) -> Result<SlabPoints> {
        let factors = self.opacities.table(&self.stations);
        let opaque = |kind: u32| {
            let [class, number, station] = [kind & 255, 256 + (kind >> 8 & 15), 272 + (kind >> 16)]
                .map(|at| factors.get(at as usize));
            [class, number, station].into_iter().flatten().all(|factor| *factor > 0.0)
        };
        let met: Vec<_> = self
            .nodes
            .iter()
            .filter(|node| {
                slab.meets(node.own_bounds()) && self.clips.left(node.own_bounds()) != Left::Nothing
            })
            .collect();
        let mut points = Vec::new();
        self.look_at(gpu, &met, |node, words| {
            let whole = self.clips.left(node.own_bounds()) == Left::Everything;
            let found = (0..node.count).into_par_iter().filter_map(|i| {
                let place = slab.place(position(node, word_of(words, i)))?;
                let point = self.point_of(node, word_of(words, i));
                let is_there =
                    (whole || self.clips.keep(point.position)) && point.kind.is_none_or(opaque);
                is_there.then(|| SlabPoint {
                    point,
                    shown: words[(node.planes * POINTS_PER_PAGE + i) as usize],
                    place,
                })
            });
            points.par_extend(found);
        })?;
        Ok(SlabPoints {
            points,
            resident: self.nodes.iter().map(|node| node.count as u64).sum(),
            all: self.points,
        })
    }
}
