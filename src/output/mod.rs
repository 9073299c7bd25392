//! Image files: PNG and EXR, pictures of any size, what is drawn over them, and the
//! layers of a frame.

#[cfg(feature = "app")]
pub mod annotations;
pub mod export;
pub mod image_io;
pub mod overlay;
pub mod tiled;
