//! Options that a window is opened with.

use super::navigation::NavigationStyle;
use super::panel::SaveSize;
use crate::cloud::attribute::ExtraAttributes;
use crate::gpu::DeviceOptions;
use crate::index::cache::CacheLocation;
use crate::render::scene::Scene;
use crate::render::source::OpenOptions;
use crate::tune::Limit;
use crate::view::camera_path::CameraPath;
use crate::view::{Camera, Preset};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The contents of the window, and how they are shown.
#[derive(Clone, Debug)]
pub struct Options {
    pub files: Vec<PathBuf>,
    pub opening: OpenOptions,
    /// Attributes to load besides the displayed one.
    pub further: ExtraAttributes,
    /// The scene to draw, apart from the camera.
    pub scene: Scene,
    /// View if there is no camera.
    pub preset: Preset,
    pub camera: Option<Camera>,
    /// Size of the window `[px]`.
    pub size: [u32; 2],
    pub style: NavigationStyle,
    /// Size of saved pictures.
    pub save_size: SaveSize,
    pub device_options: DeviceOptions,
    pub pool_bytes: u64,
    /// Limit of moving pictures.
    pub limit: Limit,
    /// Place of fronts.
    pub fronts: CacheLocation,
    /// Camera path to play.
    pub path: CameraPath,
    /// Length of a scripted flight: along the path, or ahead if there is none; then the window
    /// closes.
    pub flight: Option<Duration>,
    /// Start of the program.
    pub began: Instant,
}
