//! Point density of a view, by which effects decide, and the edges that points reach. Parts of a
//! picture use those of the whole.

use super::{Resident, ResidentNode, either};
use crate::index::format::scatter::{AROUND, Clump, POINTS_PER_CLUMP};
use crate::select::clip::Left;
use crate::view::{Projection, View};
use glam::DVec3;

/// Density of a view, from its visible nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointDensity {
    /// Point spacing `[m]`, see [`Resident::spacing_m`].
    pub spacing_m: f64,
    /// Pixel size `[m]` at the centre of the node of the median point, from near nodes to far ones;
    /// 0 if there are none.
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
        let seen = parts(resident, view);
        let number = |of: fn(&Seen) -> Option<f64>| {
            let sizes = seen.iter().map(|part| Seen::of(view, part));
            sizes.filter_map(|seen| Some((of(&seen)?, seen.count))).collect()
        };
        // Points in one place have no known density.
        let density = |seen: &Seen| (seen.covered > 0.0).then(|| seen.count as f64 / seen.covered);
        let pixels = seen.iter().map(|part| pixel_m(view, part.depths));
        PointDensity {
            spacing_m: resident.spacing_m(),
            pixel_m: weighted_median(number(|seen| Some(seen.pixel_m))),
            finest_m: pixels.reduce(f64::min).unwrap_or(0.0),
            density: weighted_median(number(density)),
            scattered: scattered(resident, &seen),
            apart_px: weighted_quantile(
                seen.iter().flat_map(|part| apart(view, part)).collect(),
                0.9,
            ),
            crossed: seen.iter().map(|part| part.crosses(view)).fold([false; 4], either),
        }
    }

    /// Returns the point spacing on the screen `[px]` at the median point; 0 if there are none.
    pub fn spacing_px(&self) -> f64 {
        if self.pixel_m > 0.0 { self.spacing_m / self.pixel_m } else { 0.0 }
    }
}

/// What clip boxes leave of a node: all of it, or a part of one of its clumps.
struct Part<'r> {
    node: &'r ResidentNode,
    clump: Option<&'r Clump>,
    count: u64,
    /// Corners of its box, in the cloud's own coordinates.
    own_bounds: (DVec3, DVec3),
    /// Least and greatest depth.
    depths: (f64, f64),
}

impl Part<'_> {
    fn bounds(&self) -> (DVec3, DVec3) {
        self.node.map.bounds(self.own_bounds)
    }

    fn clumps(&self) -> &[Clump] {
        self.clump.map_or(&self.node.clumps, std::slice::from_ref)
    }

    /// Returns beyond which edges of a window its points may lie: left, right, upper, lower.
    fn crosses(&self, view: &View) -> [bool; 4] {
        match self.clump {
            None => self.node.crosses(view),
            Some(_) => self.node.box_crosses(view, self.own_bounds),
        }
    }
}

/// Returns what clip boxes leave of the nodes in view.
fn parts<'r>(resident: &'r Resident, view: &'r View) -> Vec<Part<'r>> {
    let mut parts = Vec::new();
    for (depths, node) in resident.seen(view) {
        let own_bounds = node.own_bounds();
        if resident.clips.left(own_bounds) == Left::Everything {
            let count = node.count as u64;
            parts.push(Part { node, clump: None, count, own_bounds, depths });
            continue;
        }
        parts.extend(node.boxed_clumps().filter_map(|(clump, count, whole)| {
            let own_bounds = resident.clips.cut(whole)?;
            let depths = view.depths(node.map.bounds(own_bounds))?;
            let count = (count as f64 * share(own_bounds, whole)).ceil() as u64;
            Some(Part { node, clump: Some(clump), count, own_bounds, depths })
        }));
    }
    parts
}

/// Returns the share of a box that another one within it takes.
fn share((min, max): (DVec3, DVec3), (least, most): (DVec3, DVec3)) -> f64 {
    let axis = |axis: usize| match most[axis] - least[axis] {
        whole if whole > 0.0 => (max[axis] - min[axis]) / whole,
        _ => 1.0,
    };
    axis(0) * axis(1) * axis(2)
}

/// Returns the share of the points in view whose clumps lie on no surface: all of a cloud of few
/// points.
fn scattered(resident: &Resident, seen: &[Part]) -> f64 {
    if resident.points <= AROUND as u64 {
        return 1.0;
    }
    let mut points = [0, 0];
    for part in seen {
        let mut left = part.count;
        for clump in part.clumps() {
            let own = left.min(POINTS_PER_CLUMP as u64);
            points[clump.is_scattered() as usize] += own;
            left -= own;
        }
    }
    points[1] as f64 / (points[0] + points[1]).max(1) as f64
}

/// Returns the point spacing on the screen `[px]` and the covered area in pixels of a part, or of
/// its clumps where it is near and far at once: the size of pixels in it differs by more than two.
fn apart(view: &View, part: &Part) -> Vec<(f64, f64)> {
    let (node, spacing) = (part.node, part.node.spacing());
    let of = |count, depths, bounds| {
        let pixel_m = pixel_m(view, depths);
        let covered = covered_m2(view, count, spacing, bounds) / (pixel_m * pixel_m);
        (pixel_m > 0.0).then_some((spacing / pixel_m, covered))
    };
    let has_one_size =
        view.camera.projection == Projection::Orthographic || part.depths.1 <= 2.0 * part.depths.0;
    if has_one_size || part.clump.is_some() {
        return Vec::from_iter(of(part.count, part.depths, part.bounds()));
    }
    let clumps = node.boxed_clumps().map(|(_, count, bounds)| (count, node.map.bounds(bounds)));
    clumps.filter_map(|(count, bounds)| of(count, view.depths(bounds)?, bounds)).collect()
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

/// A part as seen at its centre.
struct Seen {
    count: u64,
    /// Metres.
    pixel_m: f64,
    /// Pixels.
    covered: f64,
}

impl Seen {
    fn of(view: &View, part: &Part) -> Seen {
        let (count, pixel_m) = (part.count, pixel_m(view, part.depths));
        let covered = covered_m2(view, count, part.node.spacing(), part.bounds());
        Seen { count, pixel_m, covered: covered / (pixel_m * pixel_m) }
    }
}

/// Returns the median of numbers weighted by points; 0 if empty.
pub fn weighted_median(numbers: Vec<(f64, u64)>) -> f64 {
    weighted_quantile(
        numbers.into_iter().map(|(number, points)| (number, points as f64)).collect(),
        0.5,
    )
}

/// Returns the smallest number that reaches this share of the weight; 0 if empty.
pub fn weighted_quantile(mut numbers: Vec<(f64, f64)>, share: f64) -> f64 {
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
            [0.0, 0.7, 0.75, 0.8, 0.81, 1.0].map(|share| weighted_quantile(numbers.clone(), share)),
            [1.0, 1.0, 2.0, 2.0, 5.0, 5.0]
        );
    }
}
