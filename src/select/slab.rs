//! Vertical slabs, whose points profiles show.

use glam::{DVec2, DVec3};

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
    pub fn meets(&self, (min, max): (DVec3, DVec3)) -> bool {
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
