//! Image files: PNG, EXR and GeoTIFF, pictures of any size, and the layers of a frame.

pub mod export;
#[cfg(feature = "cli")]
pub mod geotiff;
pub mod image_io;
pub mod tiled;
#[cfg(feature = "cli")]
pub mod world_file;
