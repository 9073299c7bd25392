//! POINTS -> NODES.
//!
//! In memory: `organise` cuts a part's points into nodes along the Morton order; `pack` brings one node's points into the words that the GPU reads.
//! Out of core: `build` makes a file (`file`) of leaves and inner nodes, from `bucket`s that are `sort`ed and `grow`n into nodes; `merge` makes a parent's samples of
//! its children's. `spacing` says how far apart a node's points are.
//! Of a point and those around it: `neighbours` in a tree, and in a `forest` of those of all leaves (`surroundings`); `normals` of the surface through them, `clusters` of like colour, and of these
//! `strokes`, which are painted in the `axes` of all of them; `luminance` averaged over them. `exposure` says how bright stations are where they overlap. `derive` finds these for an index, whose nodes then keep them; `marks` of a light lie beside it.

pub mod attributes;
pub mod build;
pub mod cache;
pub mod format;

pub use build::partition::{Arrangement, Node, Partition, partition, shuffled_partition};
