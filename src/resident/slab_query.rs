//! Resident points in a vertical slab, for profiles.
//!
//! Only drawn points count: those hidden by opacities or clip boxes are left out, and of an index
//! only the nodes of the last picture are searched.

use super::{Point, Resident, position};
use crate::config::POINTS_PER_PAGE;
use crate::error::Result;
use crate::graph::Gpu;
use crate::select::clip::Left;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// A strip of the map between two places, of a given width, at all heights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slab {
    start: DVec3,
    /// Unit vector on the map.
    along: DVec2,
    /// Length on the map `[m]`.
    pub length: f64,
    /// Full width `[m]`.
    pub width: f64,
}

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

impl Slab {
    /// Creates a slab; `None` if one place is above the other.
    pub fn new(start: DVec3, end: DVec3, width: f64) -> Option<Slab> {
        let across = (end - start).truncate();
        Some(Slab { start, along: across.try_normalize()?, length: across.length(), width })
    }

    /// Returns a point's position along and across the slab, if it is inside; borders count as
    /// inside.
    pub fn place(&self, p: DVec3) -> Option<DVec2> {
        let place = self.turned(p);
        (place.x >= 0.0 && place.x <= self.length && place.y.abs() <= self.width / 2.0)
            .then_some(place)
    }

    fn turned(&self, p: DVec3) -> DVec2 {
        let from_start = (p - self.start).truncate();
        DVec2::new(from_start.dot(self.along), from_start.dot(self.along.perp()))
    }

    /// Returns whether a box may have points in the slab.
    fn meets(&self, (min, max): (DVec3, DVec3)) -> bool {
        let corners = [(min.x, min.y), (max.x, min.y), (min.x, max.y), (max.x, max.y)]
            .map(|(x, y)| self.turned(DVec3::new(x, y, 0.0)));
        let [least, most] =
            [corners.into_iter().reduce(DVec2::min), corners.into_iter().reduce(DVec2::max)]
                .map(Option::unwrap_or_default);
        most.x >= 0.0
            && least.x <= self.length
            && most.y >= -self.width / 2.0
            && least.y <= self.width / 2.0
    }
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
                slab.meets(node.bounds()) && self.clips.left(node.bounds()) != Left::Nothing
            })
            .collect();
        let mut points = Vec::new();
        self.look_at(gpu, &met, |node, words| {
            let whole = self.clips.left(node.bounds()) == Left::Everything;
            let found = (0..node.count).into_par_iter().filter_map(|i| {
                let place = slab.place(position(node, words, i))?;
                let point = self.point_of(node, words, i);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slab_has_what_lies_beside_its_line_and_may_meet_boxes_that_have_some() {
        let start = DVec3::new(500_000.0, 5_000_000.0, 3.0);
        let slab = Slab::new(start, start + DVec3::new(3.0, 4.0, 100.0), 0.5).unwrap();
        assert_eq!(slab.length, 5.0);
        let at = |along: f64, left: f64| {
            start + DVec3::new(0.6 * along - 0.8 * left, 0.8 * along + 0.6 * left, -50.0)
        };
        let place = slab.place(at(2.0, 0.2)).unwrap();
        assert!((place - DVec2::new(2.0, 0.2)).length() < 1e-8);
        for outside in [at(-0.1, 0.0), at(5.1, 0.0), at(2.0, 0.26), at(2.0, -0.26)] {
            assert_eq!(slab.place(outside), None);
            assert!(slab.meets((outside - 1.0, outside + 1.0)));
        }
        assert!(
            !slab.meets((start - 3.0, start - 2.0))
                && !slab.meets((at(8.0, 0.0), at(8.0, 0.0) + 1.0))
        );
        assert_eq!(Slab::new(start, start + DVec3::Z, 1.0), None);
    }
}
