//! POINTS -> NODES.
//!
//! In memory: `organise` cuts a part's points into nodes along the Morton order; `pack` brings one node's points into the words that the GPU reads.
//! Out of core: `build` makes a file (`file`) of leaves and inner nodes, from `bucket`s that are `sort`ed and `grow`n into nodes; `merge` makes a parent's samples of
//! its children's. `spacing` says how far apart a node's points are.
//! Of a point and those around it: `neighbours` in a tree, and in a `forest` of those of all leaves (`surroundings`); `normals` of the surface through them, `clusters` of like colour, and of these
//! `strokes`, which are painted in the `axes` of all of them; `luminance` averaged over them. `exposure` says how bright stations are where they overlap. `derive` finds these for an index, whose nodes then keep them; `marks` of a light lie beside it.

pub mod axes;
mod bucket;
pub mod build;
pub mod cache;
pub mod clusters;
pub mod derive;
pub mod exposure;
pub mod fault;
pub mod file;
pub mod forest;
mod grow;
pub mod luminance;
mod map;
pub mod marks;
mod merge;
pub mod morton;
pub mod neighbours;
pub mod normals;
pub mod organise;
pub mod pack;
mod record;
mod samples;
mod sort;
pub mod spacing;
pub mod strokes;
pub mod surroundings;
mod unite;

pub use organise::{Arrangement, Node, Organised, organise, shuffle};
