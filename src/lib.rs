//! Draws raw, unstructured point clouds with Vulkan: no normals, no radii, no waiting.
//!
//! ```text
//! file -> columns -> nodes ------------------> resident pages -> G-buffer -> effects -> image file
//!         cloud      index -> select, loader   resident          passes      passes     output
//! ```
//!
//! The modules follow the data. Each uses only those before it; `tests/cpu/imports.rs` checks that.
//!
//! - [`network`]: files on servers, read by ranges.
//! - [`cloud`]: readers of files, and filters. Points become columns on the files' own lattices.
//!   [`synth`]: files with known truth, from analytic scenes.
//! - [`index`]: nodes of at most 65,536 points in Morton order, with bit-plane positions and
//!   attributes derived from neighbouring points.
//! - [`view`]: the camera in f64, camera paths, and the light.
//! - [`select`]: which points are drawn: clip boxes, opacities, and the LOD cut of an index.
//! - [`extract`]: points that filters, boxes and opacities leave: counts, statistics, files.
//! - [`gpu`]: Vulkan without any notion of points. [`graph`]: the render graph, which derives all
//!   barriers. [`shader`]: Rust structs generated from the shaders' SPIR-V.
//! - [`loader`]: the thread that reads nodes of an index. [`resident`]: nodes in device memory.
//! - [`passes`]: one file a pass, and the registry of effects.
//! - [`render`]: files or an index as a source, settings, the scene file, and the whole frame.
//! - [`tune`]: settings that trade accuracy for time, and the choice of one for a time or an error.
//! - [`renderer`]: clouds, drawn into the images of another Vulkan application or on a device of
//!   our own, as the programs here do. [`c`]: the same for C.
//!   These two are the interface that stays; the other modules change with the program.
//! - [`prices`]: what each effect costs in a picture, or would cost.
//! - [`output`]: PNG and EXR files, and pictures larger than a device's images.
//! - [`present`]: a window's swapchain. [`app`]: the window with its panel and navigation.
//! - [`bench`](mod@bench): timings of passes. [`study`]: accuracy against time. [`cli`]: the
//!   program, one file a subcommand.
//! - [`guide`]: the pages of the guide, from the window to the numerics.
//! - For all: [`config`] (limits and defaults), [`error`], [`progress`], [`atomic_file`],
//!   [`small_file`], [`names`], [`similar`] names, [`thread_pool`].
//!
//! A picture of a file, without the program:
//!
//! ```no_run
//! use pointillist::gpu::DeviceOptions;
//! use pointillist::output::image_io::write_png;
//! use pointillist::renderer::{OpenSettings, Preset, Renderer, RendererOptions};
//!
//! # fn main() -> pointillist::error::Result<()> {
//! let mut renderer =
//!     Renderer::open_device(&DeviceOptions::default(), RendererOptions::default())?;
//! let cloud = renderer.open(&["scan.laz".into()], &OpenSettings::default())?;
//! renderer.wait(cloud)?;
//! let size = [1920, 1080];
//! if let Some(camera) = renderer.framing(Preset::Fit, size) {
//!     write_png("scan.png".as_ref(), size, &[&renderer.picture(cloud, camera, size)?])?;
//! }
//! # Ok(())
//! # }
//! ```

/// The README's example, compiled with the others.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

#[cfg(feature = "app")]
pub mod app;
pub mod atomic_file;
#[cfg(feature = "study")]
pub mod bench;
#[cfg(feature = "c")]
pub mod c;
#[cfg(feature = "cli")]
pub mod cli;
pub mod cloud;
pub mod config;
pub mod error;
pub mod extract;
pub mod gpu;
pub mod graph;
pub mod guide;
pub mod index;
pub mod loader;
pub mod names;
pub mod network;
pub mod output;
pub mod passes;
#[cfg(feature = "app")]
pub mod present;
pub mod prices;
pub mod progress;
pub mod render;
pub mod renderer;
pub mod resident;
pub mod select;
pub mod shader;
pub mod similar;
pub mod small_file;
#[cfg(feature = "study")]
pub mod study;
#[cfg(feature = "study")]
pub mod synth;
pub mod thread_pool;
pub mod tune;
pub mod view;
