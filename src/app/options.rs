//! What a window is opened with.

use super::drawing::DetailOf;
use super::navigation::Habit;
use crate::camera_path::CameraPath;
use crate::cloud::attribute::Further;
use crate::cut::Detail;
use crate::gpu::Wish;
use crate::scene::Scene;
use crate::source::Opening;
use crate::view::{Camera, Preset};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// What to show, and how.
#[derive(Clone, Debug)]
pub struct Options {
    pub files: Vec<PathBuf>,
    pub opening: Opening,
    /// What points bring because of how they are drawn.
    pub further: Further,
    /// What to draw, but for the camera.
    pub scene: Scene,
    /// Where from, when there is no camera.
    pub preset: Preset,
    pub camera: Option<Camera>,
    /// Of the window, pixels.
    pub size: [u32; 2],
    pub habit: Habit,
    pub wish: Wish,
    pub pool_bytes: u64,
    /// As asked for; what nobody asked for follows the picture's size.
    pub budget: Option<u64>,
    pub lod_px: Option<f64>,
    /// To be played.
    pub path: CameraPath,
    /// Nobody is there: fly along the path, or ahead where there is none, for so long, rest, and close.
    pub flight: Option<Duration>,
    /// When the program began.
    pub began: Instant,
}

impl Options {
    pub(super) fn detail(&self) -> DetailOf {
        let (budget, lod_px) = (self.budget, self.lod_px);
        Box::new(move |size| {
            let usual = Detail::of(size);
            Detail { budget: budget.unwrap_or(usual.budget), lod_px: lod_px.unwrap_or(usual.lod_px), ..usual }
        })
    }
}
