//! HOW DENSELY POINTS SAMPLE A PICTURE: what is resident, and a view, in; out a few numbers, which effects decide by. A part of a picture goes by those of the whole.

use super::{Resident, ResidentNode};
use crate::view::{Projection, View};

/// Numbers of a picture, by the nodes that it shows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointDensity {
    /// As [`Resident::spacing_m`].
    pub spacing_m: f64,
    /// How wide a pixel is, metres: in the middle of the node that the middle point is in, from near nodes to far ones; 0 where there are none.
    pub pixel_m: f64,
    /// Points a pixel where the middle point is, from sparse nodes to dense ones; 0 where there are none.
    pub density: f64,
    /// How far apart points are on the screen, pixels: on nine tenths of what they cover no farther; 0 where there are none.
    pub apart_px: f64,
}

impl PointDensity {
    /// Of what the view sees.
    pub fn of(resident: &Resident, view: &View) -> PointDensity {
        let seen: Vec<Node> =
            resident.seen(view).map(|(depths, node)| Node::of(view, depths, node)).collect();
        let number = |of: fn(&Node) -> Option<f64>| {
            seen.iter().filter_map(|node| Some((of(node)?, node.count))).collect()
        };
        // Of points that are all in one place nobody knows how dense they are.
        let density = |node: &Node| (node.covered > 0.0).then(|| node.count as f64 / node.covered);
        PointDensity {
            spacing_m: resident.spacing_m(),
            pixel_m: weighted_median(number(|node| Some(node.pixel_m))),
            density: weighted_median(number(density)),
            apart_px: quantile(seen.iter().map(|node| (node.apart, node.covered)).collect(), 0.9),
        }
    }

    /// How far apart points are on the screen, pixels, where the middle one is; 0 where there are none.
    pub fn spacing_px(&self) -> f64 {
        if self.pixel_m > 0.0 { self.spacing_m / self.pixel_m } else { 0.0 }
    }
}

/// A node as the view sees it, at its middle.
struct Node {
    count: u64,
    /// Metres.
    pixel_m: f64,
    /// From point to point, pixels.
    apart: f64,
    /// Pixels.
    covered: f64,
}

impl Node {
    /// A node's points cover as much as their spacing says, and no more than its box does: of a tree, many points lie behind each other.
    fn of(view: &View, (near, far): (f64, f64), node: &ResidentNode) -> Node {
        let pixel_m = match view.camera.projection {
            Projection::Perspective => (near + far) / 2.0 / view.focal_px(),
            Projection::Orthographic => 1.0 / view.focal_px(),
        };
        let (way, extent) = (view.basis.forward.abs(), node.bounds().1 - node.bounds().0);
        let faces =
            extent.x * extent.y * way.z + extent.y * extent.z * way.x + extent.z * extent.x * way.y;
        let covered =
            (node.count as f64 * node.spacing * node.spacing).min(faces) / (pixel_m * pixel_m);
        Node { count: node.count as u64, pixel_m, apart: node.spacing / pixel_m, covered }
    }
}

/// Of numbers that so many points have each, the middle one; 0 of none.
pub fn weighted_median(numbers: Vec<(f64, u64)>) -> f64 {
    quantile(numbers.into_iter().map(|(number, points)| (number, points as f64)).collect(), 0.5)
}

/// Of numbers with their weights, the least that is no less than those of this share of the weight; 0 of none.
fn quantile(mut numbers: Vec<(f64, f64)>, share: f64) -> f64 {
    numbers.sort_by(|a, b| a.0.total_cmp(&b.0));
    let all: f64 = numbers.iter().map(|(_, weight)| weight).sum();
    let mut before = 0.0;
    let found = numbers.iter().find(|(_, weight)| {
        before += weight;
        before >= share * all
    });
    found.map_or(0.0, |(number, _)| *number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_by_weight() {
        assert_eq!(weighted_median(vec![]), 0.0);
        assert_eq!(weighted_median(vec![(3.0, 1), (1.0, 2), (2.0, 1)]), 1.0);
        let numbers = vec![(5.0, 2.0), (1.0, 7.0), (2.0, 1.0)];
        assert_eq!(
            [0.0, 0.7, 0.75, 0.8, 0.81, 1.0].map(|share| quantile(numbers.clone(), share)),
            [1.0, 1.0, 2.0, 2.0, 5.0, 5.0]
        );
    }
}
