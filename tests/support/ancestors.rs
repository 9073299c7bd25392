//! The way from a node of an index to its root.

use pointillist::index::format::Index;

/// Returns the ancestors of a node, nearest first.
pub fn ancestors(index: &Index, node: usize) -> impl Iterator<Item = usize> + '_ {
    let above =
        |&node: &usize| Some(index.nodes()[node].parent as usize).filter(|&parent| parent != node);
    std::iter::successors(above(&node), above)
}
