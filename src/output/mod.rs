//! Image files: PNG, EXR and GeoTIFF, pictures of any size, what is drawn over them, and the layers
//! of a frame; films, and pictures of profiles.

#[cfg(feature = "app")]
pub mod annotations;
pub mod export;
pub mod film;
#[cfg(feature = "cli")]
pub mod geotiff;
pub mod image_io;
pub mod legend;
pub mod overlay;
pub mod part;
pub mod section;
pub mod ticks;
pub mod tiled;
#[cfg(feature = "cli")]
pub mod world_file;
