//! Nodes of a cloud: how they are stored, built and annotated.
//!
//! - [`format`](mod@format): the files NAME.pnti and NAME.shadows, and the samples, planes and node
//!   records in them
//! - [`attributes`]: what is derived from a point's neighbours: normals, strokes, luminance; and
//!   the exposure of stations
//! - [`build`]: from points to nodes, in memory or out of core
//! - [`cache`]: indexes kept in the user's cache folder

pub mod attributes;
pub mod build;
pub mod cache;
pub mod format;

pub use build::partition::{Arrangement, Node, Partition, partition, shuffled_partition};
