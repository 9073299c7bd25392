//! Messages to the render thread, and its events.

use super::PickRequest;
use crate::app::cancel::CancelToken;
use crate::app::load_thread::{CloudInfo, ProgressReporter};
use crate::app::pick_buffer::PickBuffer;
use crate::app::profile::Profile;
use crate::app::viewport::Viewport;
use crate::error::Error;
use crate::output::overlay as triangles;
use crate::passes::EffectDecisions;
use crate::passes::project::Statistics;
use crate::present::overlay::Overlay;
use crate::prices::Price;
use crate::render::gpu_cloud::PreparedCloud;
use crate::render::scene::Scene;
use crate::resident::Point;
use crate::select::slab::Slab;
use crate::tune::{Errors, Limit, Tuning};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A loaded cloud to upload, between frames.
pub struct Upload {
    pub prepared: PreparedCloud,
    pub info: CloudInfo,
    pub watch: ProgressReporter,
}

/// A message from the window.
pub enum Message {
    Scene {
        scene: Box<Scene>,
        /// Time of the input that changed it.
        asked: Instant,
    },
    /// The window has another size or panel, or was uncovered.
    Exposed(Viewport),
    /// Sets what moving pictures keep.
    Limit(Limit),
    /// Sets what is drawn over the picture.
    Panel {
        overlay: Box<Overlay>,
        /// True if it answers the user: then a refinement of the picture waits.
        answers: bool,
    },
    /// Uploads a cloud, which then replaces the current one.
    Upload(Box<Upload>),
    /// Finds the point under a click.
    Pick(Box<PickRequest>),
    /// Measures what each effect costs.
    Prices,
    /// Reads the points of a slab, for a profile.
    Section(Slab),
    /// Saves the current picture with this size `[px]`: as PNG, or its layers as EXR.
    Save {
        path: PathBuf,
        size: [u32; 2],
        layers: bool,
        /// Drawn over the picture.
        over: Box<triangles::Overlay>,
    },
    Close,
}

impl Message {
    /// Returns whether it changes the picture, so that a frame in progress is superseded.
    pub fn changes_picture(&self) -> bool {
        !matches!(self, Message::Panel { .. } | Message::Limit(_) | Message::Prices)
    }

    /// Returns whether a refinement of the picture is interrupted for it.
    pub fn is_urgent(&self) -> bool {
        !matches!(self, Message::Panel { answers: false, .. } | Message::Limit(_) | Message::Prices)
    }
}

/// An event for the window.
pub enum RenderEvent {
    /// A frame has started: animations may take their next step.
    FrameStarted,
    FrameDone(Box<FrameReport>),
    /// Errors of the last moving frame against the picture that the window has settled on.
    Measured(Arc<Measured>),
    /// Costs of the effects in the picture at rest.
    Priced(Vec<Price>),
    /// Number of points in the last frame, if filters or clip boxes leave some out.
    Counted(u64),
    /// A cloud is on the device.
    Uploaded(Box<CloudInfo>, CancelToken),
    UploadFailed(Error, CancelToken),
    Picked {
        point: Point,
        adds: bool,
        token: CancelToken,
    },
    /// There is no point under a click.
    NothingPicked {
        adds: bool,
    },
    Profile(Box<Profile>),
    /// Progress of work, to show.
    Status(String),
    Saved(PathBuf),
    SaveFailed(PathBuf, Error),
    /// An error that does not end the thread.
    Failed(Error),
    /// An earlier error that no longer holds.
    Resolved(String),
    /// The thread has ended.
    Ended(Error),
}

/// A frame on the screen.
pub struct FrameReport {
    pub pick_buffer: Arc<PickBuffer>,
    pub decisions: EffectDecisions,
    /// Settings without effect, and limits that were reached.
    pub notes: Vec<String>,
    pub statistics: Statistics,
    /// True if filters or clip boxes may leave some of its points out.
    pub leaves_out: bool,
    /// Device time of every pass `[ms]`.
    pub passes: Vec<(String, f64)>,
    /// True if it has the window's size and all points of the view, and no other cloud is being
    /// uploaded.
    pub whole: bool,
    /// Loading of an index; None for files.
    pub loading: Option<Loading>,
    /// Tuning of a moving frame; None at rest.
    pub moving: Option<Moving>,
    /// Times of the steps until it was on the screen.
    pub times: FrameTimes,
    /// Time from its request until it was done.
    pub latency: Duration,
    /// Time on the device.
    pub took: Duration,
    /// Number of messages handled before it started ([`super::RenderThread::is_newest`]).
    pub handled: u64,
}

/// How much of an index a frame shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loading {
    /// Number of points that fit the device's memory, if that is less than the point budget.
    pub fitting: Option<u64>,
    /// Nodes of the LOD cut.
    pub nodes: usize,
    /// Nodes of the cut that are being loaded, or have planes that are.
    pub awaited: usize,
    /// Largest distance on the screen between samples that are drawn `[px]`.
    pub largest_error_px: f64,
    /// Size of the pool, and bytes in use.
    pub pool_bytes: [u64; 2],
    /// Bytes read since the last frame.
    pub bytes_read: u64,
    /// Processor time of the loader thread until the frame was on the screen.
    pub worked: Duration,
}

/// How far a moving frame is from the picture that the window has settled on.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    pub errors: Errors,
    /// Size of the picture `[px]`.
    pub size: [u32; 2],
    /// Error of each of its pixels `[px]`.
    pub map: Vec<f32>,
}

/// The tuning of a moving frame, among those that no other beats.
#[derive(Clone, Debug, PartialEq)]
pub struct Moving {
    pub tuning: Tuning,
    /// Expected times `[ms]` and errors `[px]` of all, the fastest first.
    pub curve: Vec<[f64; 2]>,
    /// Place of the frame's tuning among them.
    pub place: usize,
    /// Expected time of the frame `[ms]`; `None` for the first one.
    pub expected_ms: Option<f64>,
    /// Its time `[ms]`.
    pub ms: f64,
}

/// Times of the steps of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameTimes {
    /// Making the swapchain fit the window.
    pub fitting: Duration,
    /// Uploading loaded nodes and requesting others: the loader's cost to this thread.
    pub taking_in: Duration,
    /// Choosing effects and recording passes.
    pub recording: Duration,
    /// Waiting for the device.
    pub drawing: Duration,
    /// Copying the pick buffer.
    pub reading_back: Duration,
    /// Presenting.
    pub showing: Duration,
}

impl FrameReport {
    /// Returns whether nodes are still being loaded.
    pub fn is_loading(&self) -> bool {
        self.loading.is_some_and(|loading| loading.awaited > 0)
    }
}
