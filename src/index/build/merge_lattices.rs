//! Common nodes above trees on different lattices: one lattice for all, and which trees get a
//! parent together.
//!
//! Leaves stay on the lattices of their files, to the last bit. Above the trees nothing is exact,
//! since samples are means of many points: a lattice that spans the cloud in 2^30 steps is finer
//! than anything drawn from so far away. Without common nodes, a view of a thousand files with
//! different offsets shows a thousand roots, however small it is.
//!
//! ```text
//! roots in the Morton order of their boxes' centres; consecutive ones that hold G samples together
//! get a parent; the same for those parents, until there is one
//! ```

use super::build_chunk::{self, OpenNode, TreeSpec};
use crate::cloud::scalar::Scalars;
use crate::cloud::{ColumnSet, Lattice};
use crate::config::{BITS_PER_PLANE, POSITION_PLANES};
use crate::index::format::morton;
use crate::index::format::samples::{Cell, DerivedPlanes};
use crate::index::format::schema::{self, Contents, NodeRecord, Plane};
use glam::DVec3;

/// Bits of the common lattice: samples of the whole cloud fit their planes.
const BITS: u32 = BITS_PER_PLANE * POSITION_PLANES;

/// Returns the properties of nodes above these roots, except the number of their lattice and the
/// gains, and the order of the roots. `None` if there is one root, or if no finite lattice holds
/// them all.
pub fn over(
    roots: &[&NodeRecord],
    contents: &Contents,
    derive: DerivedPlanes,
) -> Option<(TreeSpec, Vec<usize>)> {
    // Without strays, which have roots of their own.
    let boxes = || roots.iter().map(|root| schema::bounds(root, &contents.lattices));
    let (low, high) = boxes()
        .reduce(|(low, high), (a, b)| (low.min(a), high.max(b)))
        .filter(|_| roots.len() > 1)?;
    let widest =
        contents.lattices.iter().map(|[step, _]| step.abs().max_element()).fold(0.0, f64::max);
    // A cloud without extent is at least a step of its files wide.
    let side = (high - low).max_element().max(widest);
    // A step more than the cloud is wide, so that values rounded up are still below 2^30.
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
        scalars: Scalars::NONE,
    };
    // Without colours there is no luminance.
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

/// Groups open nodes, in their order, that get a parent together.
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
