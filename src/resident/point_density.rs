//! Point density of a view, by which effects decide, and the edges that points reach. Parts of a
//! picture use those of the whole.

use super::{Resident, ResidentNode, either};
use crate::index::format::scatter::{AROUND, POINTS_PER_CLUMP};
use crate::view::{Projection, View};
use glam::DVec3;

/// Density of a view, from its visible nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointDensity {
    /// Point spacing `[m]`, see [`Resident::spacing_m`].
    pub spacing_m: f64,
    /// Pixel size `[m]` at the centre of the node of the median point, from near nodes to far ones; 0
    /// if there are none.
    pub pixel_m: f64,
    /// Least pixel size `[m]` at the centre of a node; 0 if there are none.
    pub finest_m: f64,
    /// Points per pixel at the median point, from sparse nodes to dense ones; 0 if there are none.
    pub density: f64,
    /// Point spacing on the screen `[px]` that 90% of the covered area does not exceed; 0 if there
    /// are none.
    pub apart_px: f64,
    /// Share of the points that lie on no surface ([`scatter`](crate::index::format::scatter)).
    pub scattered: f64,
    /// Edges of the picture beyond which nodes in view reach: left, right, upper, lower.
    pub crossed: [bool; 4],
}

impl PointDensity {
    /// Measures the nodes in view.
    pub fn of(resident: &Resident, view: &View) -> PointDensity {
        let seen: Vec<Node> =
            resident.seen(view).map(|(depths, node)| Node::of(view, depths, node)).collect();
        let number = |of: fn(&Node) -> Option<f64>| {
            seen.iter().filter_map(|node| Some((of(node)?, node.count))).collect()
        };
        // Points in one place have no known density.
        let density = |node: &Node| (node.covered > 0.0).then(|| node.count as f64 / node.covered);
        PointDensity {
            spacing_m: resident.spacing_m(),
            pixel_m: weighted_median(number(|node| Some(node.pixel_m))),
            finest_m: seen.iter().map(|node| node.pixel_m).reduce(f64::min).unwrap_or(0.0),
            density: weighted_median(number(density)),
            scattered: scattered(resident, view),
            apart_px: quantile(
                resident.seen(view).flat_map(|(depths, node)| apart(view, depths, node)).collect(),
                0.9,
            ),
            crossed: resident
                .seen(view)
                .map(|(_, node)| node.crosses(view))
                .fold([false; 4], either),
        }
    }

    /// Returns the point spacing on the screen `[px]` at the median point; 0 if there are none.
    pub fn spacing_px(&self) -> f64 {
        if self.pixel_m > 0.0 { self.spacing_m / self.pixel_m } else { 0.0 }
    }
}

/// Returns the share of the points of nodes in view whose clumps lie on no surface: all of a cloud
/// of few points.
fn scattered(resident: &Resident, view: &View) -> f64 {
    if resident.points <= AROUND as u64 {
        return 1.0;
    }
    let mut points = [0, 0];
    for (_, node) in resident.seen(view) {
        let mut left = node.count as u64;
        for clump in node.clumps.iter() {
            let own = left.min(POINTS_PER_CLUMP as u64);
            points[clump.is_scattered() as usize] += own;
            left -= own;
        }
    }
    points[1] as f64 / (points[0] + points[1]).max(1) as f64
}

/// Returns the point spacing on the screen `[px]` and the covered area in pixels of a node, or of its
/// clumps where it is near and far at once: the size of pixels in it differs by more than two.
fn apart(view: &View, depths: (f64, f64), node: &ResidentNode) -> Vec<(f64, f64)> {
    let spacing = node.spacing();
    let of = |count, depths, bounds| {
        let pixel_m = pixel_m(view, depths);
        let covered = covered_m2(view, count, spacing, bounds) / (pixel_m * pixel_m);
        (pixel_m > 0.0).then_some((spacing / pixel_m, covered))
    };
    let has_one_size =
        view.camera.projection == Projection::Orthographic || depths.1 <= 2.0 * depths.0;
    if has_one_size {
        return Vec::from_iter(of(node.count as u64, depths, node.bounds()));
    }
    node.boxed_clumps()
        .filter_map(|(count, bounds)| of(count, view.depths(bounds)?, bounds))
        .collect()
}

/// Returns the pixel size at the middle of a range of depths `[m]`.
fn pixel_m(view: &View, (near, far): (f64, f64)) -> f64 {
    match view.camera.projection {
        Projection::Perspective => (near + far) / 2.0 / view.focal_px(),
        Projection::Orthographic => 1.0 / view.focal_px(),
    }
}

/// Returns how much points cover `[m2]`: as much as their spacing implies, but no more than their
/// box, since in a tree many points lie behind each other.
fn covered_m2(view: &View, count: u64, spacing: f64, (min, max): (DVec3, DVec3)) -> f64 {
    let (way, extent) = (view.basis.forward.abs(), max - min);
    let faces =
        extent.x * extent.y * way.z + extent.y * extent.z * way.x + extent.z * extent.x * way.y;
    (count as f64 * spacing * spacing).min(faces)
}

/// A node as seen at its centre.
struct Node {
    count: u64,
    /// Metres.
    pixel_m: f64,
    /// Pixels.
    covered: f64,
}

impl Node {
    /// Measures a node.
    fn of(view: &View, depths: (f64, f64), node: &ResidentNode) -> Node {
        let (count, pixel_m) = (node.count as u64, pixel_m(view, depths));
        let covered = covered_m2(view, count, node.spacing(), node.bounds());
        Node { count, pixel_m, covered: covered / (pixel_m * pixel_m) }
    }
}

/// Returns the median of numbers weighted by points; 0 if empty.
pub fn weighted_median(numbers: Vec<(f64, u64)>) -> f64 {
    quantile(numbers.into_iter().map(|(number, points)| (number, points as f64)).collect(), 0.5)
}

/// Returns the smallest number that reaches this share of the weight; 0 if empty.
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
