//! The twin of the kernel that sets points aside: pixels whose points lie on no surface, by the
//! clumps of nodes, from the list of nodes.

use crate::config::POINTS_PER_PAGE;
use crate::index::format::scatter::POINTS_PER_CLUMP;
use crate::resident::ResidentNode;

/// Returns whether the point of an id lies on no surface.
pub fn is_scattered(nodes: &[ResidentNode], id: u32) -> bool {
    let (node, point) = (id / POINTS_PER_PAGE, (id % POINTS_PER_PAGE) as usize);
    let clump = nodes.get(node as usize).and_then(|node| node.clumps.get(point / POINTS_PER_CLUMP));
    clump.is_some_and(|clump| clump.is_scattered())
}
