//! Of a point and those around it: normals, strokes, luminance, exposure.

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
