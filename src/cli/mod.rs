//! The program: one file a subcommand, and the options that they share.

mod abort;
pub mod bench;
pub mod export;
mod files;
pub mod filters;
mod frames;
pub mod guide;
pub mod index;
pub mod indexed_info;
pub mod info;
mod limits;
mod named;
pub mod options;
pub mod profile;
pub mod raster;
pub mod renamed;
pub mod render;
pub mod shadows;
pub mod streams;
pub mod study;
pub mod suggestions;
pub mod synth;
pub mod terminal;
pub mod tune;
pub mod units;
pub mod view;
