//! POINTS -> NODES.
//!
//! `organise` cuts a part's points into nodes along the Morton order; `pack` brings one node's points into the words that the GPU reads.

pub mod file;
mod map;
pub mod morton;
pub mod organise;
pub mod pack;

pub use organise::{Arrangement, Node, Organised, organise, shuffle};
