//! Trees on lattices of their own in, what stands above them out: one lattice for all, and which of them get a parent together.
//!
//! Leaves stay on the lattices of their files, to the last bit. Above the trees nothing is exact: samples are means of many points. So there a lattice will do that spans all of
//! the cloud in 2^30 steps, finer than anything that is drawn from so far away, and whatever stands above the trees is made as inner nodes are. Without it a view of a thousand files
//! that were each given an offset of their own shows a thousand roots, however small it is.
//!
//! ```text
//! roots in the Morton order of the middles of their boxes; as many of them, one after the other, as hold G samples get a parent; the same of those parents, until there is one
//! ```

use super::build_chunk::{self, OpenNode, TreeSpec};
use crate::cloud::{ColumnSet, Lattice};
use crate::config::{BITS_PER_PLANE, POSITION_PLANES};
use crate::index::format::morton;
use crate::index::format::samples::{Cell, DerivedPlanes};
use crate::index::format::schema::{self, Contents, NodeRecord, Plane};
use glam::DVec3;

/// Steps of the common lattice, as a power of two: samples of all of the cloud fit their planes.
const BITS: u32 = BITS_PER_PLANE * POSITION_PLANES;

/// What nodes above these roots are like, but for the number of their lattice and what their stations have in common, and the order of the roots; none where there is one root, or where no lattice of finite numbers holds them all.
pub fn over(
    roots: &[&NodeRecord],
    contents: &Contents,
    derive: DerivedPlanes,
) -> Option<(TreeSpec, Vec<usize>)> {
    // Without what lies far outside, which has roots of its own.
    let boxes = || roots.iter().map(|root| schema::bounds(root, &contents.lattices));
    let (low, high) = boxes()
        .reduce(|(low, high), (a, b)| (low.min(a), high.max(b)))
        .filter(|_| roots.len() > 1)?;
    let widest =
        contents.lattices.iter().map(|[step, _]| step.abs().max_element()).fold(0.0, f64::max);
    // Without an extent of its own a cloud has at least a step of its files.
    let side = (high - low).max_element().max(widest);
    // A step more than the cloud is wide, so that what is rounded up is still below 2^30.
    let step = side / ((1u64 << BITS) - 2) as f64;
    if !step.is_normal() || !(low.abs().max(high.abs()) + side).is_finite() {
        return None;
    }
    let lattice = Lattice { step: DVec3::splat(step), offset: low };
    let middle = |root: &NodeRecord| -> Cell {
        let (a, b) = schema::bounds(root, &contents.lattices);
        (((a / 2.0 + b / 2.0) - low) / step).to_array().map(|v| v as u32)
    };
    let middles: Vec<Cell> = roots.iter().map(|root| middle(root)).collect();
    let mut order: Vec<usize> = (0..roots.len()).collect();
    order.sort_by(|&a, &b| morton::order(middles[a], middles[b]).then(a.cmp(&b)));
    let some = |plane: Plane| roots.iter().any(|root| root.has(plane));
    let has = ColumnSet {
        rgb: some(Plane::Rgb),
        intensity: some(Plane::Intensity),
        class: some(Plane::Class),
        returns: some(Plane::Returns),
        source: Plane::STATIONS.into_iter().any(some),
        normal: some(Plane::Normal),
        gps_time: some(Plane::GpsTime),
    };
    // Nobody knows the luminance of what has no colours.
    let derive = DerivedPlanes {
        luminance: derive.luminance && roots.iter().all(|root| root.has(Plane::Corrected)),
        ..derive
    };
    Some((
        TreeSpec {
            has,
            derive,
            corner: [0; 3],
            bits: BITS,
            lattice,
            lattice_number: 0,
            gains: None,
        },
        order,
    ))
}

/// OpenNode nodes, in their order, that are to get a parent together.
pub fn lists(open: Vec<OpenNode>) -> Vec<Vec<OpenNode>> {
    let mut lists: Vec<Vec<OpenNode>> = vec![Vec::new()];
    for open in open {
        if build_chunk::has_enough_samples(lists.last().expect("one is open")) {
            lists.push(Vec::new());
        }
        lists.last_mut().expect("one is open").push(open);
    }
    lists
}
