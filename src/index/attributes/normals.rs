//! Fits a plane to a point's neighbours: its normal, and the direction of largest spread (dos Anjos
//! et al. 2018, sec. 3.2.2: least squares within 3 r).
//!
//! ```text
//! radius: mean distance to the nearest eight others plus its standard deviation; larger if eight
//!   lie so close together that strokes of that size would leave a gap
//! differences to the point within three radii, in whole lattice steps; their sums, and those of
//!   their products
//! covariance about the mean; its eigenvectors by Jacobi's rotations: the smallest is the normal,
//!   the largest lies along
//! ```
//!
//! Sums of integers below 2^53 are exact, and so the same in any order: neighbours may come from
//! any trees. As the differences are to a point among its neighbours, subtracting their mean loses
//! little.
//!
//! If the points do not determine a plane there is none, never a guess (guide: numerics, case 18):
//! fewer than three points, all on a line, or thinner than the lattice resolves.

use super::clusters::NEAREST;
use super::kd_tree::Neighbour;
use super::knn_query::KnnQuery;
use super::linear_algebra::eigen;
use crate::error::Result;
use glam::DVec3;
use std::sync::LazyLock;

/// Eigenvalues closer than this part of the largest count as equal: the direction between them is
/// arbitrary.
const DEGENERATE: f64 = 1e-6;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Unit normal of either sign.
    pub normal: DVec3,
    /// Unit vector of largest spread in the plane.
    pub along: DVec3,
}

/// Neighbours used for a fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// Points whose distances determine the radius.
    pub near: usize,
    /// Size of the neighbourhood `[radii]`.
    pub reach: f64,
}

/// The paper's three radii, of the nearest eight.
pub const FIT: Fit = Fit { near: NEAREST, reach: 3.0 };

/// Local geometry of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// Mean distance to the nearest others plus its standard deviation, at least half a step;
    /// larger if that leaves a gap to surrounding points `[m]`.
    pub radius_m: f64,
    /// Isolated, relative to the density of its neighbours: a bird above the ground, not a surface.
    pub lonely: bool,
    pub plane: Option<Plane>,
}

/// Scratch memory of a search.
#[derive(Default)]
pub struct Scratch {
    pub found: Vec<Neighbour>,
    steps: Vec<DVec3>,
}

/// Fits a point of the own tree. `near` gets its nearest neighbours.
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
    Ok(Patch { radius_m: radius_m.max(GAP_FACTOR * gap), lonely, plane })
}

/// Stroke radius over gap width: a dab covers 0.73 of its radius, and a gap's corners lie between
/// the sampled directions.
const GAP_FACTOR: f64 = 1.5;
/// Sampled directions in the plane.
const DIRECTIONS: usize = 32;
/// Largest RMS distance from the plane, as a part of the reach, for which strokes are enlarged:
/// rougher neighbourhoods are edges, crests, claws or leaves.
const MAX_ROUGHNESS: f64 = 0.14;

static COSINES: LazyLock<[[f64; 2]; DIRECTIONS]> = LazyLock::new(|| {
    std::array::from_fn(|k| {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / DIRECTIONS as f64).sin_cos();
        [cos, sin]
    })
});

/// Returns the distance to the farthest corner of the point's Voronoi cell in the plane. `None` if
/// neighbours do not surround it, as at the border of a surface, which is to stay in place.
///
/// Along a direction w the cell ends at t = |q|^2 / (2 q.w), for the neighbour q with the least t:
/// the inverse of twice the largest (q / |q|^2).w, which does not depend on the order. Points of
/// another sheet have hardly any q in the plane, so that they bound little.
fn gap(plane: &Plane, differences: &[DVec3], step: DVec3, reach: f64) -> Option<f64> {
    let across = plane.normal.cross(plane.along);
    let mut most = [0.0f64; DIRECTIONS];
    // Sums of integers, because a decision must not depend on the order of summation.
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
    let flat = thick <= (MAX_ROUGHNESS * reach).powi(2) * differences.len() as f64;
    let gap = 0.5 / most.into_iter().fold(f64::INFINITY, f64::min);
    // Beyond half the reach another point may be nearer that is not among the neighbours.
    (flat && gap <= reach / 2.0).then_some(gap)
}

/// Returns the sum of mean and standard deviation of distances; 0 if there are none.
fn spread(distances: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = distances.clone().count().max(1) as f64;
    let mean = distances.clone().sum::<f64>() / count;
    mean + (distances.map(|distance| (distance - mean).powi(2)).sum::<f64>() / count).sqrt()
}

/// Fits a plane to a point and its neighbours, given as differences in steps of size `step`.
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
    // The point itself counts, at 0.
    let count = differences.len() as f64 + 1.0;
    let (means, scale) = (outer(sum / count, sum / count), outer(step, step));
    let [(least, normal), (middle, _), (most, along)] =
        eigen(std::array::from_fn(|k| (products[k] / count - means[k]) * scale[k]));
    let flat = middle <= step.max_element().powi(2) || middle - least < DEGENERATE * most;
    (!flat).then_some(Plane { normal, along })
}

/// Returns the upper triangle: xx, xy, xz, yy, yz, zz.
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

    /// By the theorem of Davis and Kahan (guide: numerics, case 18): the sine of the angle is at
    /// most |E| / (l2 - l1).
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
            // |E| of covariances: twice the largest deviation times the largest distance, and its
            // square.
            let error = 2.0 * size * 0.5 * 4.0 + size * size;
            assert!(
                found.normal.cross(DVec3::Z).length() <= error / 2.0,
                "{size}: {}",
                found.normal
            );
        }
    }
}
