//! Image files: PNG and EXR, pictures of any size, and the layers of a frame.

pub mod export;
pub mod image_io;
pub mod tiled;
