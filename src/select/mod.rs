//! Which points of a cloud are drawn: clip boxes, opacities, slabs, and the nodes of an index.

pub mod clip;
pub mod lod;
pub mod opacity;
pub mod slab;
