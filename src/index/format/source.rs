//! Where an index has its nodes from.

use super::schema::{NodeRecord, Plane};
use crate::error::Result;
use std::path::Path;

/// A file of nodes, which are read one at a time. Nothing else knows how they are stored.
pub trait NodeSource: Send + Sync {
    fn path(&self) -> &Path;

    /// Returns the length of the file `[bytes]`.
    fn bytes(&self) -> u64;

    /// Copies bytes of the file, unchecked.
    fn copy(&self, at: u64, into: &mut [u8]) -> Result<()>;

    /// Announces that planes of nodes will be read, so that a server is asked for many at a time.
    fn ahead(&self, nodes: &[NodeRecord], wanted: &[(usize, Vec<Plane>)]);

    /// Tests whether the file is on a server.
    fn is_remote(&self) -> bool;

    /// Reads a plane of a node, checked. `into` has [`NodeRecord::unpacked_bytes`]. Returns how
    /// many bytes of the file that took: none, if they were in memory.
    fn read(&self, node: usize, record: &NodeRecord, plane: Plane, into: &mut [u8]) -> Result<u64>;
}

/// What drawing the children of a node does to the node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Refinement {
    /// Its samples stand for the points of the children, which replace them.
    #[default]
    Replaces,
    /// Its points are in none of the children, and are drawn with theirs.
    Adds,
}
