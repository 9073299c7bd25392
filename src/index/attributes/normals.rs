//! A point's neighbours in, the plane through them out: its normal, and the way in which they spread most (dos Anjos et al. 2018, sec. 3.2.2: least squares within 3 r).
//!
//! ```text
//! radius: mean distance to the nearest eight others and its standard deviation; more where eight lie so close together that strokes of that size would leave a gap to those around
//! differences to the point itself within three radii, whole steps of the lattice; their sums, and those of their products
//! covariance about the mean; its eigenvectors by Jacobi's rotations: the least is the normal, the largest lies along
//! ```
//! Sums of whole numbers below 2^53 are exact, and so the same in any order: neighbours may come from any trees. As the differences are to a point among its neighbours, little is lost by taking their mean away.
//!
//! A plane that the points do not determine is none, never a guess (HARD_CASES 18): fewer than three points, all on a line, or thinner than the lattice can say.

use super::clusters::NEAREST;
use super::kd_tree::Neighbour;
use super::knn_query::KnnQuery;
use super::linear_algebra::eigen;
use crate::error::Result;
use glam::DVec3;
use std::sync::LazyLock;

/// Eigenvalues nearer to each other than this part of the largest are the same: the direction between them is anyone's.
const SAME: f64 = 1e-6;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Unit; either of the two.
    pub normal: DVec3,
    /// Unit, in the plane: where the points spread most.
    pub along: DVec3,
}

/// Which neighbours a plane is fitted to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// Points whose distances make up the radius.
    pub near: usize,
    /// Of the neighbourhood, radii.
    pub reach: f64,
}

/// The paper's three radii, of the nearest eight.
pub const FIT: Fit = Fit { near: NEAREST, reach: 3.0 };

/// What a point's neighbours tell of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// Mean distance to the nearest others, and its standard deviation; half a step at least. Larger where that leaves a gap between those that lie around.
    pub radius_m: f64,
    /// Far from those that are nearest to it, for how densely they lie: a bird over the ground, not a surface.
    pub lonely: bool,
    pub plane: Option<Plane>,
}

/// What a search needs room for, from point to point.
#[derive(Default)]
pub struct Scratch {
    pub found: Vec<Neighbour>,
    steps: Vec<DVec3>,
}

/// Of a point of the own tree. Those nearest to it are in `near`, as many as it has room for.
pub fn patch(
    around: &mut KnnQuery,
    place: usize,
    fit: Fit,
    scratch: &mut Scratch,
    near: &mut dyn FnMut(&[Neighbour]),
) -> Result<Patch> {
    let step = around.own().tree.step();
    around.nearest(place, fit.near, &mut scratch.found)?;
    near(&scratch.found);
    let radius_m = spread(scratch.found.iter().map(|neighbour| neighbour.squared.sqrt()))
        .max(step.max_element() / 2.0);
    let reach = fit.reach * radius_m;
    let lonely = around.within(place, reach, &mut scratch.found)? < reach;
    scratch.steps.clear();
    scratch.steps.extend(scratch.found.iter().map(|neighbour| around.steps_to(place, neighbour)));
    let plane = plane(&scratch.steps, step);
    let gap = plane
        .filter(|_| !lonely)
        .and_then(|plane| gap(&plane, &scratch.steps, step, reach))
        .unwrap_or(0.0);
    Ok(Patch { radius_m: radius_m.max(CLOSES * gap), lonely, plane })
}

/// Radii of a stroke that close a gap as wide as one: a dab hides what is behind it to 0.73 of its point's radius, and the corners of a gap lie between the ways that are looked along.
const CLOSES: f64 = 1.5;
/// Ways from a point, in its plane, along which it is asked where the next point takes over.
const WAYS: usize = 32;
/// Points farther from their plane than this part of the reach, in the mean of squares, are no surface that is known well enough to lay a larger stroke on: edges of right angles, crests, claws, leaves.
const FLAT: f64 = 0.14;

static COSINES: LazyLock<[[f64; 2]; WAYS]> = LazyLock::new(|| {
    std::array::from_fn(|k| {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / WAYS as f64).sin_cos();
        [cos, sin]
    })
});

/// How far the farthest place of a plane is that is nearer to its point than to all others. None where the neighbours do not lie all around, as at the border of a surface, which is to stay where it is.
///
/// Along a way w what is nearer to the point ends at t = |q|^2 / (2 q.w), of the neighbour q for which that is least: the inverse of twice the largest (q / |q|^2).w, the same in any order. Of points of
/// another sheet q is hardly in the plane, so that they bound little.
fn gap(plane: &Plane, differences: &[DVec3], step: DVec3, reach: f64) -> Option<f64> {
    let across = plane.normal.cross(plane.along);
    let mut most = [0.0f64; WAYS];
    // Of sums in an order that is any, a decision would be, too: sums of whole numbers are not.
    let mut products = [0.0; 6];
    for &d in differences {
        let own = outer(d, d);
        (0..6).for_each(|k| products[k] += own[k]);
        let q = d * step;
        let [x, y] = [plane.along, across].map(|axis| q.dot(axis) / q.length_squared());
        most.iter_mut()
            .zip(&*COSINES)
            .for_each(|(most, way)| *most = most.max(x * way[0] + y * way[1]));
    }
    let [xx, xy, xz, yy, yz, zz] = products;
    let n = plane.normal * step;
    let thick = (n.x * n.x * xx
        + n.y * n.y * yy
        + n.z * n.z * zz
        + 2.0 * (n.x * n.y * xy + n.x * n.z * xz + n.y * n.z * yz))
        .max(0.0);
    let flat = thick <= (FLAT * reach).powi(2) * differences.len() as f64;
    let gap = 0.5 / most.into_iter().fold(f64::INFINITY, f64::min);
    // What lies beyond half the reach another point may be nearer to that is not among the neighbours.
    (flat && gap <= reach / 2.0).then_some(gap)
}

/// Mean and standard deviation of distances, together; 0 of none.
fn spread(distances: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = distances.clone().count().max(1) as f64;
    let mean = distances.clone().sum::<f64>() / count;
    mean + (distances.map(|distance| (distance - mean).powi(2)).sum::<f64>() / count).sqrt()
}

/// The plane through a point and its neighbours, given as differences to it in steps of a lattice, each as wide as `step` says.
pub fn plane(differences: &[DVec3], step: DVec3) -> Option<Plane> {
    if differences.len() < 2 {
        return None;
    }
    let (mut sum, mut products) = (DVec3::ZERO, [0.0; 6]);
    for &d in differences {
        sum += d;
        let own = outer(d, d);
        (0..6).for_each(|k| products[k] += own[k]);
    }
    // The point itself is one of them, at 0.
    let count = differences.len() as f64 + 1.0;
    let (means, scale) = (outer(sum / count, sum / count), outer(step, step));
    let [(least, normal), (middle, _), (most, along)] =
        eigen(std::array::from_fn(|k| (products[k] / count - means[k]) * scale[k]));
    let flat = middle <= step.max_element().powi(2) || middle - least < SAME * most;
    (!flat).then_some(Plane { normal, along })
}

/// Upper triangle: xx, xy, xz, yy, yz, zz.
fn outer(a: DVec3, b: DVec3) -> [f64; 6] {
    [a.x * b.x, a.x * b.y, a.x * b.z, a.y * b.y, a.y * b.z, a.z * b.z]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A square patch of points around the origin, in the plane of two vectors.
    fn patch(u: DVec3, v: DVec3) -> Vec<DVec3> {
        (0..25)
            .filter(|k| *k != 12)
            .map(|k| u * (k % 5 - 2) as f64 + v * 1.5 * (k / 5 - 2) as f64)
            .collect()
    }

    proptest! {
        #[test]
        fn a_plane_is_found_at_any_angle_and_any_scale(x in -1.0f64..1.0, y in -1.0f64..1.0, z in -1.0f64..1.0, power in -30i32..30) {
            let normal = DVec3::new(x, y, z).normalize_or(DVec3::Z);
            let (u, v) = normal.any_orthonormal_pair();
            let scale = 2f64.powi(power);
            let found = plane(&patch(u * 1e3, v * 1e3), DVec3::splat(scale * 1e-3)).expect("a plane");
            prop_assert!(found.normal.cross(normal).length() < 1e-12);
            prop_assert!(found.along.cross(v).length() < 1e-7, "{} {}", found.along, v);
        }
    }

    #[test]
    fn hard_18_what_determines_no_plane_gives_none() {
        let step = DVec3::splat(1e-3);
        assert_eq!(plane(&[], step), None);
        assert_eq!(plane(&[DVec3::X], step), None);
        assert_eq!(plane(&[DVec3::ZERO; 9], step), None);
        let line: Vec<DVec3> = (1..9).map(|k| DVec3::new(1e3, 2e3, 3e3) * k as f64).collect();
        assert_eq!(plane(&line, step), None);
        let ball: Vec<DVec3> = [DVec3::X, DVec3::Y, DVec3::Z]
            .into_iter()
            .flat_map(|axis| [axis * 1e3, -axis * 1e3])
            .collect();
        assert_eq!(plane(&ball, step), None, "every direction is as good");
        assert_eq!(
            plane(&patch(DVec3::X / 10.0, DVec3::Y / 10.0), step),
            None,
            "smaller than the lattice can say"
        );
        assert!(plane(&patch(DVec3::X, DVec3::Y), step).is_some());
    }

    #[test]
    fn a_gap_is_as_far_as_the_corners_of_what_is_nearest_to_a_point_and_none_at_a_border() {
        let (step, reach) = (DVec3::splat(1e-3), 4.0);
        let plane = Plane { normal: DVec3::Z, along: DVec3::X };
        let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z) * 1e3;
        let grid: Vec<DVec3> = (0..49)
            .filter(|k| *k != 24)
            .map(|k| at((k % 7 - 3) as f64, (k / 7 - 3) as f64, 0.0))
            .collect();
        let of = |points: &[DVec3]| gap(&plane, points, step, reach);
        assert!((of(&grid).unwrap() - 0.5f64.sqrt()).abs() < 1e-12);
        let reversed: Vec<DVec3> = grid.iter().rev().copied().collect();
        assert_eq!(of(&reversed), of(&grid));
        // A row is missing on one side: the place between is as far as the row after it says.
        let without: Vec<DVec3> = grid.iter().copied().filter(|d| d.x != 1e3).collect();
        let truth = (0.5f64.powi(2) + 1.0).sqrt();
        assert!((of(&without).unwrap() / truth - 1.0).abs() < 0.1, "{:?}", of(&without));
        let half: Vec<DVec3> = grid.iter().copied().filter(|d| d.x <= 0.0).collect();
        assert_eq!(of(&half), None, "a border");
        let rough: Vec<DVec3> = grid
            .iter()
            .enumerate()
            .map(|(k, d)| *d + at(0.0, 0.0, if k % 2 == 0 { 1.0 } else { -1.0 }))
            .collect();
        assert_eq!(of(&rough), None, "no plane");
        // Another sheet behind the first bounds nothing.
        let sheets: Vec<DVec3> = grid.iter().copied().chain([at(0.0, 0.0, 0.1)]).collect();
        assert!((of(&sheets).unwrap() - 0.5f64.sqrt()).abs() < 1e-12);
    }

    /// By the theorem of Davis and Kahan, as HARD_CASES 18 has it: the sine of the angle is at most |E| / (l2 - l1).
    #[test]
    fn hard_18_noise_turns_the_normal_no_further_than_it_may() {
        let mut state = 0x5EEDu64;
        let mut noise = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        for size in [1e-3, 1e-2, 1e-1] {
            let flat = patch(DVec3::X, DVec3::Y);
            let bumpy: Vec<DVec3> = flat.iter().map(|d| *d + DVec3::Z * size * noise()).collect();
            let steps: Vec<DVec3> = bumpy.iter().map(|d| *d * 1e6).collect();
            let found = plane(&steps, DVec3::splat(1e-6)).expect("a plane");
            // |E| of covariances: twice the largest deviation times the largest distance, and its square.
            let error = 2.0 * size * 0.5 * 4.0 + size * size;
            assert!(
                found.normal.cross(DVec3::Z).length() <= error / 2.0,
                "{size}: {}",
                found.normal
            );
        }
    }
}
