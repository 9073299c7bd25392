//! `pointillist view`: files in a window.

use super::options::{DeviceOptions, PictureOptions};
use super::units::Size;
use crate::app::{self, Options, keys, navigation::NavigationStyle, panel::SaveSize};
use crate::error::Result;
use crate::gpu;
use crate::index::format::fault_injection::Fault;
use crate::progress::Progress;
use crate::render::scene::Scene;
use crate::render::source::OpenOptions;
use crate::view::Camera;
use crate::view::camera_path::CameraPath;
use std::io::Write;
use std::path::PathBuf;
use std::time::{Duration, Instant};

const EXAMPLES: &str = "\
Examples:
  pointillist view scan.laz
  pointillist view north.laz south.laz --color source --navigation blender
  pointillist view site.pnti --effect edl=on                an index: there at once
  pointillist view site.pnti --path tour.json --flight 20 --timings    how long pictures take, without hands";

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = help())]
pub struct Arguments {
    /// Point clouds: LAS, LAZ, COPC, PLY, E57, OBJ, XYZ, CSV, TXT, PTS, PTX; or one index, PNTI
    #[arg(value_name = "FILE")]
    pub files: Vec<PathBuf>,
    #[command(flatten)]
    pub picture: PictureOptions,
    #[command(flatten)]
    pub device: DeviceOptions,
    /// Whose mouse buttons
    #[arg(long, value_enum, default_value_t)]
    pub navigation: NavigationStyle,
    /// Key views to fly along, as the window saves them; Space plays them
    #[arg(long, value_name = "PATH.json")]
    pub path: Option<PathBuf>,
    /// Fly for so many seconds without hands, along --path or else ahead, rest, and close; for --timings
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u16).range(1..=3600))]
    pub flight: Option<u16>,
    /// How large pictures are that the window saves: so many times as large as it, or so many pixels
    #[arg(long, value_name = "Nx|WxH", default_value = "1x", value_parser = save_size)]
    pub save_size: SaveSize,
    /// Say at the end how long pictures took, milliseconds: to standard error, or as JSON to standard output
    #[arg(long, value_name = "json", num_args = 0..=1, require_equals = true, default_missing_value = "text", value_parser = ["text", "json"])]
    pub timings: Option<String>,
    /// Treat the device as lost after so many submissions; for tests
    #[arg(long, hide = true, value_name = "SUBMISSIONS")]
    pub lose_device: Option<u64>,
    /// Treat the window's surface as lost after so many pictures; for tests
    #[arg(long, hide = true, value_name = "PICTURES")]
    pub lose_surface: Option<u64>,
    /// Let the reading of an index go wrong at a node: panic:N, hang:N, end:N; for tests
    #[arg(long, hide = true, value_name = "FAULT")]
    pub fail_reading: Option<Fault>,
    /// Refuse a truncated, lying or damaged file instead of keeping what is readable
    #[arg(long)]
    pub strict: bool,
}

fn save_size(text: &str) -> std::result::Result<SaveSize, String> {
    let times = text
        .strip_suffix('x')
        .and_then(|times| times.parse().ok())
        .filter(|times| (1..=64).contains(times));
    match times {
        Some(times) => Ok(SaveSize::Times(times)),
        None => text
            .parse()
            .map(|Size(size)| SaveSize::To(size))
            .map_err(|why| format!("{why}, nor 1x to 64x")),
    }
}

fn help() -> String {
    let keys: Vec<_> =
        keys::KEYS.iter().map(|key| format!("  {:<4} {}", key.name, key.about)).collect();
    format!("Keys:\n{}\n\n{EXAMPLES}", keys.join("\n"))
}

pub fn run(arguments: &Arguments, progress: &dyn Progress) -> Result<()> {
    let began = Instant::now();
    let picture = arguments.picture.with_scene()?;
    let camera = picture.camera()?;
    let here = camera.unwrap_or(Camera::framing(picture.view, &[], picture.size.0));
    let scene = Scene {
        camera: here,
        color: picture.color,
        settings: picture.settings()?,
        opacities: picture.opacities(),
        clips: picture.clips(),
        lod: picture.detail.lod(),
    };
    let options = Options {
        files: arguments.files.clone(),
        opening: OpenOptions {
            fault: arguments.fail_reading,
            ..picture.detail.opening(picture.read_options(arguments.strict), picture.light)
        },
        further: picture.further(),
        scene,
        preset: picture.view,
        camera,
        size: picture.size.0,
        style: arguments.navigation,
        save_size: arguments.save_size,
        wish: gpu::DeviceOptions {
            lost_after: arguments.lose_device,
            surface_lost_after: arguments.lose_surface,
            ..arguments.device.wish()
        },
        pool_bytes: picture.detail.pool_bytes(),
        path: arguments.path.as_deref().map(CameraPath::read).transpose()?.unwrap_or_default(),
        flight: arguments.flight.map(|seconds| Duration::from_secs(seconds as u64)),
        began,
    };
    let summary = app::run(options, progress)?;
    match arguments.timings.as_deref() {
        // Where nobody reads it any more, the window was closed all the same.
        Some("json") => drop(writeln!(std::io::stdout(), "{}", serde_json::json!(summary))),
        Some(_) => drop(write!(std::io::stderr(), "{summary}")),
        None => {}
    }
    Ok(())
}
