//! Which points of a cloud are drawn: clip boxes, opacities, and the nodes of an index.

pub mod clip;
pub mod lod;
pub mod opacity;
