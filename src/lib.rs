//! Draws raw, unstructured point clouds with Vulkan: no normals, no radii, no waiting.
//!
//! ```text
//! file on disk -> columns -> nodes ---------------------> resident pages -> project -> resolve -> effects -> composite -> image file
//!                 cloud      index -> file -> cut, loader  resident          passes ------------------------------------> picture
//! ```
//!
//! The modules, in the order of the flow; each uses only what stands before it, which `tests/imports.rs` checks.
//!
//! - [`cloud`]: files to columns of points, on the files' own integer lattices. [`synth`]: files with known truth, from analytic scenes.
//! - [`index`]: points to nodes of at most 65,536 points in Morton order, their positions in planes of bits; and what the points around tell of each.
//! - [`view`]: the camera, f64. [`camera_path`]: the camera at any time, from key views. [`light`]: where light comes from. [`opacity`]: how much of it points let through. [`clip`]: which part of a cloud is there. [`cut`]: the nodes of an index that a view is drawn from.
//! - [`gpu`]: Vulkan, and nothing about points. [`graph`]: passes in order, with the barriers that they need. [`shader`]: the shaders as
//!   Rust structs, generated from their SPIR-V.
//! - [`loader`]: a thread that reads nodes of an index. [`resident`]: the nodes on the device, in pages of one size.
//! - [`passes`]: one file a pass, and the registry of effects. [`look`]: which effects run, and why. [`frame`]: the whole frame, top to bottom.
//! - [`source`]: files or an index, brought to the device. [`scene`]: what a picture is of, as a file.
//! - [`picture`]: PNG and EXR. [`tiled`]: a picture of any size. [`layers`]: all that a frame knows of its pixels. [`present`]: a window's swapchain. [`app`]: the window: navigation, panel, picking. [`bench`](mod@bench): what passes take. [`study`]: what accuracy costs in time. [`cli`]: the
//!   program, one file a subcommand.
//! - For all: [`config`] (every limit and default), [`error`], [`progress`], [`whole_file`].
//!
//! A picture, from a file, without the program:
//!
//! ```no_run
//! use pointillist::{cloud, frame, gpu, graph, look, passes::encode, picture, progress::Silent, resident::Resident, view};
//!
//! # fn main() -> pointillist::error::Result<()> {
//! let options = cloud::ReadOptions { wanted: cloud::Wanted { rgb: true, ..Default::default() }, strict: false, rgb_range: None };
//! let cloud = cloud::read(&["scan.laz".into()], &options, &Silent)?;
//! let camera = view::Camera::framing(view::Preset::Fit, &cloud.core_points(), [1920, 1080]);
//! let view = view::View::new(camera, [1920, 1080])?;
//! let (shown, _why) = cloud::attribute::Shown::automatic(&cloud);
//!
//! let mut gpu = graph::Gpu::open(&gpu::Wish::default())?;
//! let resident = Resident::fill(&mut gpu, cloud, shown, &Silent)?;
//! let look = look::decide(&look::Wishes::default(), &view, &resident);
//!
//! let mut g = graph::Graph::new(&mut gpu);
//! let outcome = frame::record(&mut g, &view, &resident, &look)?;
//! let encoded = encode::download(&mut g, &outcome.picture)?;
//! let frame = g.submit(&[])?;
//! picture::write_png("out.png".as_ref(), view.size, &encoded.read(&frame))?;
//! frame.shelve(&mut gpu);
//! resident.free(&mut gpu);
//! # Ok(())
//! # }
//! ```

pub mod app;
pub mod bench;
pub mod camera_path;
pub mod cli;
pub mod clip;
pub mod cloud;
pub mod config;
pub mod cut;
pub mod error;
pub mod frame;
pub mod gpu;
pub mod graph;
pub mod index;
pub mod layers;
pub mod light;
pub mod loader;
pub mod look;
pub mod opacity;
pub mod passes;
pub mod picture;
pub mod present;
pub mod progress;
pub mod resident;
pub mod scene;
pub mod shader;
pub mod source;
pub mod study;
pub mod synth;
pub mod tiled;
pub mod view;
pub mod whole_file;
