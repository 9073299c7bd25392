//! Nodes of a cloud: how they are stored, built and annotated.
//!
//! - [`format`](mod@format): the files NAME.pnti and NAME.shadows, and the samples, planes and node
//!   records in them
//! - [`attributes`]: what is derived from a point's neighbours: normals, strokes, luminance; and
//!   the exposure of stations
//! - [`merge`](mod@merge): a parent's samples of its children's
//! - `ground`: the ground, from which heights count
//! - [`build`]: from points to nodes, in memory or out of core
//! - [`octree`]: octrees of other programs, whose nodes are drawn in place
//! - [`cache`]: indexes kept in the user's cache folder
//! - [`fault_injection`]: faults of reading nodes, for tests

pub mod attributes;
pub mod build;
pub mod cache;
pub mod fault_injection;
pub mod format;
mod ground;
pub mod merge;
pub mod octree;

pub use build::partition::{Arrangement, Node, Partition, Row, partition};
