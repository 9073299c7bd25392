//! Frames of a resident cloud: settings, what a frame does with them, and the frame itself.

pub mod annotations;
pub mod frame;
pub mod gpu_cloud;
pub mod index_samples;
pub mod scene;
pub mod settings;
pub mod source;
