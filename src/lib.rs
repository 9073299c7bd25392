//! Draws raw, unstructured point clouds with Vulkan: no normals, no radii, no waiting.
//!
//! ```text
//! file -> columns -> nodes ------------------> resident pages -> G-buffer -> effects -> image file
//!         cloud      index -> select, loader   resident          passes      passes     output
//! ```
//!
//! The modules follow the data. Each uses only those before it; `tests/cpu/imports.rs` checks that.
//!
//! - `network`: files on servers, read by ranges.
//! - `cloud`: readers of files, and filters. Points become columns on the files' own lattices.
//!   `synth`: files with known truth, from analytic scenes.
//! - `index`: nodes of at most 65,536 points in Morton order, with bit-plane positions and
//!   attributes derived from neighbouring points.
//! - `view`: the camera in f64, camera paths, and the light.
//! - `select`: which points are drawn: clip boxes, opacities, and the LOD cut of an index.
//! - `extract`: points that filters, boxes and opacities leave: counts, statistics, files.
//! - `gpu`: Vulkan without any notion of points. `graph`: the render graph, which derives all
//!   barriers. `shader`: Rust structs generated from the shaders' SPIR-V.
//! - `loader`: the thread that reads nodes of an index. `resident`: nodes in device memory.
//! - `passes`: one file a pass, and the registry of effects.
//! - `render`: files or an index as a source, settings, the scene file, and the whole frame.
//! - `tune`: settings that trade accuracy for time, and the choice of one for a time or an error.
//! - [`renderer`]: clouds, drawn into the images of another Vulkan application or on a device of
//!   our own, as the programs here do. `c`: the same for C.
//!   These two, with [`error`] and the guide, are the interface that stays. The other modules are
//!   public for the program and its tests alone, and change with them.
//! - `prices`: what each effect costs in a picture, or would cost.
//! - `output`: PNG and EXR files, and pictures larger than a device's images.
//! - `present`: a window's swapchain. `app`: the window with its panel and navigation.
//! - `bench`: timings of passes. `study`: accuracy against time. `cli`: the
//!   program, one file a subcommand.
//! - [`guide`]: the pages of the guide, from the window to the numerics.
//! - For all: `config` (limits and defaults), [`error`], `progress`, `atomic_file`,
//!   `small_file`, `names`, `similar` names, `thread_pool`.
//!
//! A picture of a file, without the program:
//!
//! ```no_run
//! use pointillist::{DeviceOptions, OpenSettings, Preset, write_png};
//! use pointillist::{Renderer, RendererOptions};
//!
//! # fn main() -> pointillist::Result<()> {
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

pub use error::{Error, Result};
/// The crate whose vectors positions and directions are.
pub use glam;
pub use gpu::DeviceOptions;
pub use output::image_io::write_png;
pub use renderer::{
    Camera, CloudId, OpenSettings, Points, Positions, Preset, RenderSettings, Renderer,
    RendererOptions,
};

#[doc(hidden)]
#[cfg(feature = "app")]
pub mod app;
#[doc(hidden)]
pub mod atomic_file;
#[doc(hidden)]
#[cfg(feature = "study")]
pub mod bench;
#[cfg(feature = "c")]
pub mod c;
#[doc(hidden)]
#[cfg(feature = "cli")]
pub mod cli;
#[doc(hidden)]
pub mod cloud;
#[doc(hidden)]
pub mod config;
pub mod error;
#[doc(hidden)]
pub mod extract;
#[doc(hidden)]
pub mod gpu;
#[doc(hidden)]
pub mod graph;
pub mod guide;
#[doc(hidden)]
pub mod index;
#[doc(hidden)]
pub mod loader;
#[doc(hidden)]
pub mod names;
#[doc(hidden)]
pub mod network;
#[doc(hidden)]
pub mod output;
#[doc(hidden)]
pub mod passes;
#[doc(hidden)]
#[cfg(feature = "app")]
pub mod present;
#[doc(hidden)]
pub mod prices;
#[doc(hidden)]
pub mod progress;
#[doc(hidden)]
pub mod render;
pub mod renderer;
#[doc(hidden)]
pub mod resident;
#[doc(hidden)]
pub mod select;
#[doc(hidden)]
pub mod shader;
#[doc(hidden)]
pub mod similar;
#[doc(hidden)]
pub mod small_file;
#[doc(hidden)]
#[cfg(feature = "study")]
pub mod study;
#[doc(hidden)]
#[cfg(feature = "study")]
pub mod synth;
#[doc(hidden)]
pub mod thread_pool;
#[doc(hidden)]
pub mod tune;
#[doc(hidden)]
pub mod view;
