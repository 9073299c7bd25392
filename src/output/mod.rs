//! Image files: PNG and EXR, pictures of any size, and the layers of a frame; films, and pictures
//! of profiles.

pub mod export;
pub mod film;
pub mod image_io;
pub mod section;
pub mod ticks;
pub mod tiled;
