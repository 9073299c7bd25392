//! pointillist (crate docs to be written)
pub mod cli;
pub mod cloud;
pub mod config;
pub mod error;
pub mod frame;
pub mod gpu;
pub mod graph;
pub mod index;
pub mod look;
pub mod passes;
pub mod picture;
pub mod progress;
pub mod resident;
pub mod shader;
pub mod synth;
pub mod view;
