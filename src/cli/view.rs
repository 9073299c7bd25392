//! `pointillist view`: point clouds in a window.

use super::limits::LimitOptions;
use super::named::named;
use super::options::{DeviceOptions, PictureOptions};
use super::streams;
use super::tune;
use super::units::Size;
use crate::app::navigation::{Mode, NavigationStyle};
use crate::app::panel::SaveSize;
use crate::app::{self, Options, keys};
use crate::error::Result;
use crate::index::fault_injection::Fault;
use crate::names::Named;
use crate::progress::Progress;
use crate::render::scene::Scene;
use crate::render::source::OpenOptions;
use crate::tune::Limit;
use crate::tune::governor::TARGET;
use crate::view::Camera;
use crate::view::camera_path::CameraPath;
use std::io::Write;
use std::path::PathBuf;
use std::time::{Duration, Instant};

const EXAMPLES: &str = "\
Examples:
  pointillist view scan.laz
  pointillist view north.laz south.laz --color source --navigation blender
  pointillist view scan.laz --time 16ms                     moving pictures in 16 ms; see `tune`
  pointillist view https://example.org/site.copc.laz        in place, by the parts that are seen
  pointillist view site.pnti --effect edl=on                an index opens at once
  pointillist view site.pnti --path tour.json --flight 20 --timings    measures a scripted flight";

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = help())]
pub struct Arguments {
    /// Point clouds: LAS, LAZ, COPC, Potree 2, EPT, PLY, E57, OBJ, XYZ, CSV, TXT, PTS, PTX; or one
    /// index, PNTI
    #[arg(value_name = "FILE")]
    pub files: Vec<PathBuf>,
    #[command(flatten)]
    pub picture: PictureOptions,
    #[command(flatten)]
    pub limits: LimitOptions,
    #[command(flatten)]
    pub device: DeviceOptions,
    /// Mouse buttons as in this program
    #[arg(long, value_parser = named::<NavigationStyle>(), default_value = NavigationStyle::Potree.name())]
    pub navigation: NavigationStyle,
    /// Camera path to fly along, as the window saves it; Space plays it
    #[arg(long, value_name = "PATH.json")]
    pub path: Option<PathBuf>,
    /// Fly this many seconds along --path, or else straight ahead, then rest and close; for
    /// --timings
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u16).range(1..=3600))]
    pub flight: Option<u16>,
    /// Size of the pictures that the window saves: a multiple of its own, or pixels
    #[arg(long, value_name = "Nx|WxH", default_value = "1x", value_parser = save_size)]
    pub save_size: SaveSize,
    /// Print at the end how many ms pictures took: to standard error, or as JSON to standard
    /// output
    #[arg(long, value_name = "json", num_args = 0..=1, require_equals = true, default_missing_value = "text", value_parser = ["text", "json"])]
    pub timings: Option<String>,
    /// Treat the device as lost after this many submissions; for tests
    #[arg(long, hide = true, value_name = "SUBMISSIONS")]
    pub lose_device: Option<u64>,
    /// Treat the window's surface as lost after this many pictures; for tests
    #[arg(long, hide = true, value_name = "PICTURES")]
    pub lose_surface: Option<u64>,
    /// Fail to read an index at a node: panic:N, hang:N, end:N; for tests
    #[arg(long, hide = true, value_name = "FAULT")]
    pub fail_reading: Option<Fault>,
    /// Refuse a truncated, inconsistent or damaged file instead of keeping what is readable
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
            .map_err(|why| format!("{why}; nor is it a multiple of the window from 1x to 64x")),
    }
}

fn help() -> String {
    let keys: Vec<_> = keys::rows(NavigationStyle::default(), Mode::default())
        .into_iter()
        .map(|(name, about)| format!("  {name:<18} {about}"))
        .collect();
    format!("Mouse and keys:\n{}\n\n{EXAMPLES}", keys.join("\n"))
}

pub fn run(arguments: &Arguments, progress: &dyn Progress) -> Result<()> {
    let began = Instant::now();
    app::allocator::return_large_arrays();
    let picture = arguments.picture.with_scene()?;
    picture.detail.cache.use_for_servers(progress);
    let camera = picture.camera()?;
    let here = camera.unwrap_or(Camera::framing(picture.view, &[], picture.size.0));
    let scene = Scene {
        camera: here,
        color: picture.color,
        scale: picture.scale.scale()?,
        settings: picture.settings()?,
        opacities: picture.opacities(),
        filter: picture.filters.filter(),
        clips: picture.clips(),
        lod: picture.detail.lod(),
        annotations: picture.report.annotations(),
    };
    let options = Options {
        files: arguments.files.clone(),
        opening: OpenOptions { fault: arguments.fail_reading, ..picture.opening(arguments.strict) },
        further: picture.further(),
        scene,
        preset: picture.view,
        camera,
        size: picture.size.0,
        style: arguments.navigation,
        save_size: arguments.save_size,
        device_options: {
            let mut options = arguments.device.to_options();
            options.overrides.lost_after = arguments.lose_device;
            options.overrides.surface_lost_after = arguments.lose_surface;
            options
        },
        pool_bytes: picture.detail.pool_bytes(),
        limit: arguments.limits.limit().unwrap_or(Limit::Time(TARGET.as_secs_f64() * 1e3)),
        fronts: tune::place(&picture)?,
        path: arguments.path.as_deref().map(CameraPath::read).transpose()?.unwrap_or_default(),
        flight: arguments.flight.map(|seconds| Duration::from_secs(seconds as u64)),
        began,
    };
    let summary = app::run(options, progress)?;
    match arguments.timings.as_deref() {
        Some("json") => streams::print(&format!("{}\n", serde_json::json!(summary)))?,
        Some(_) => drop(write!(std::io::stderr(), "{summary}")),
        None => {}
    }
    Ok(())
}
