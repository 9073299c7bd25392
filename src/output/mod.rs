//! Image files: PNG, EXR and GeoTIFF, pictures of any size, what is drawn over them, and the
//! layers of a frame.

#[cfg(feature = "app")]
pub mod annotations;
pub mod export;
#[cfg(feature = "cli")]
pub mod geotiff;
pub mod image_io;
pub mod overlay;
pub mod tiled;
#[cfg(feature = "cli")]
pub mod world_file;
