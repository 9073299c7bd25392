//! What a window is opened with.

use super::navigation::NavigationStyle;
use super::panel::SaveSize;
use crate::cloud::attribute::ExtraAttributes;
use crate::gpu::DeviceOptions;
use crate::render::scene::Scene;
use crate::render::source::OpenOptions;
use crate::view::camera_path::CameraPath;
use crate::view::{Camera, Preset};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// What to show, and how.
#[derive(Clone, Debug)]
pub struct Options {
    pub files: Vec<PathBuf>,
    pub opening: OpenOptions,
    /// What points bring because of how they are drawn.
    pub further: ExtraAttributes,
    /// What to draw, but for the camera.
    pub scene: Scene,
    /// Where from, when there is no camera.
    pub preset: Preset,
    pub camera: Option<Camera>,
    /// Of the window, pixels.
    pub size: [u32; 2],
    pub style: NavigationStyle,
    /// How large pictures are saved.
    pub save_size: SaveSize,
    pub wish: DeviceOptions,
    pub pool_bytes: u64,
    /// To be played.
    pub path: CameraPath,
    /// Nobody is there: fly along the path, or ahead where there is none, for so long, rest, and close.
    pub flight: Option<Duration>,
    /// When the program began.
    pub began: Instant,
}
