//! Attributes derived from a point's neighbours: normals, strokes and luminance; and the exposure
//! of stations.
//!
//! `kd_tree` searches one tree, `leaf_cache` holds the trees of an index's leaves, `knn_query`
//! searches across them. `normals`, `clusters`, `strokes` and `luminance` use these; `axes` are
//! those of the whole cloud; `derive` fills the planes of an index; `shadow_writer` saves shadows.

pub mod axes;
pub mod clusters;
pub mod derive;
pub mod exposure;
pub mod kd_tree;
pub mod knn_query;
pub mod leaf_cache;
mod linear_algebra;
pub mod luminance;
pub mod normals;
pub mod shadow_writer;
pub mod strokes;
