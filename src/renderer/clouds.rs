//! Clouds of a renderer: loaded on a thread of their own, uploaded some nodes a frame.

use super::projection::transform_of;
use crate::cloud::attribute::{Attribute, ExtraAttributes};
use crate::cloud::filter::Filter;
use crate::cloud::points::Points;
use crate::cloud::{Cloud, ColumnSet, ReadOptions};
use crate::error::{Error, Result};
use crate::graph::Gpu;
use crate::index::attributes::strokes::StrokeCache;
use crate::progress::Progress;
use crate::render::source::{GpuCloud, OpenOptions, PreparedCloud, Source};
use crate::resident::Resident;
use crate::select::clip::Clips;
use crate::select::opacity::Opacities;
use glam::{DMat4, DVec3};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// A cloud of a renderer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CloudId(pub u64);

/// State of a cloud.
#[derive(Clone, Debug, PartialEq)]
pub enum CloudState {
    /// Files are being read; what is being done, and the share that is done.
    Loading {
        /// Such as "reading".
        doing: String,
        /// From 0 to 1.
        done: f64,
    },
    /// Points are being uploaded, some with each frame.
    Uploading,
    /// The cloud is drawn; of an index, nodes still come and go.
    Ready,
    /// The files cannot be read, or memory is exhausted.
    Failed(String),
}

/// What is loaded: a prepared cloud, and the points to frame.
struct Loaded {
    prepared: PreparedCloud,
    core_points: Vec<DVec3>,
    notes: Vec<String>,
}

enum Stage {
    Loading(Loading),
    Uploading(PreparedCloud),
    Ready(GpuCloud),
    Failed(String),
}

/// A cloud, and how it is shown.
pub(super) struct Entry {
    pub id: CloudId,
    pub visible: bool,
    pub transform: DMat4,
    pub core_points: Vec<DVec3>,
    pub notes: Vec<String>,
    stage: Stage,
}

/// Progress of a load thread, and its end.
struct Watch {
    cancelled: AtomicBool,
    done: AtomicU64,
    doing: Mutex<String>,
}

impl Progress for Watch {
    fn tick(&self, doing: &str, done: u64, total: u64) -> Result<()> {
        if self.cancelled.load(Relaxed) {
            return Err(Error::Interrupted);
        }
        let share = done as f64 / total.max(1) as f64;
        self.done.store(share.min(1.0).to_bits(), Relaxed);
        let mut name = self.doing.lock().unwrap_or_else(PoisonError::into_inner);
        if *name != doing {
            *name = doing.to_string();
        }
        Ok(())
    }

    fn note(&self, _line: &str) {}
}

struct Loading {
    watch: Arc<Watch>,
    loaded: Receiver<Result<Loaded>>,
    thread: Option<JoinHandle<()>>,
}

impl Loading {
    /// Starts a thread that loads and prepares.
    fn start(
        load: impl FnOnce(&dyn Progress) -> Result<Loaded> + Send + 'static,
    ) -> Result<Loading> {
        let watch = Arc::new(Watch {
            cancelled: AtomicBool::new(false),
            done: AtomicU64::new(0),
            doing: Mutex::default(),
        });
        let (send, loaded) = channel();
        let own = watch.clone();
        let thread = std::thread::Builder::new()
            .name("pointillist load".into())
            .spawn(move || drop(send.send(load(&*own))))
            .map_err(|error| Error::Request(format!("cannot start a thread: {error}")))?;
        Ok(Loading { watch, loaded, thread: Some(thread) })
    }
}

impl Drop for Loading {
    /// Cancels the thread and waits for its end: no thread outlives the renderer.
    fn drop(&mut self) {
        self.watch.cancelled.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Options of opening files.
#[derive(Clone, Debug, Default)]
pub struct OpenSettings {
    /// Attribute to show by its name on the command line, such as `rgb`; chosen automatically if
    /// `None`.
    pub color: Option<String>,
    /// Whether every loss and guess is an error.
    pub strict: bool,
}

/// Attributes that filters and lighting may need later.
const FURTHER: ExtraAttributes =
    ExtraAttributes { kind: true, normal: true, strokes: false, light: false };

fn prepare(
    mut source: Source,
    color: Option<Attribute>,
    progress: &dyn Progress,
) -> Result<Loaded> {
    source.find(color, progress)?;
    let (mut shown, _) = source.shown(color)?;
    shown.further =
        ExtraAttributes { normal: source.has_normals(), light: source.has_light(), ..FURTHER };
    let (core_points, notes) = (source.core_points(), source.notes(shown.further));
    let prepared = source.prepare(shown, &Arc::<StrokeCache>::default(), progress)?;
    Ok(Loaded { prepared, core_points, notes })
}

impl Entry {
    fn new(id: CloudId, loading: Loading) -> Entry {
        Entry {
            id,
            visible: true,
            transform: DMat4::IDENTITY,
            core_points: Vec::new(),
            notes: Vec::new(),
            stage: Stage::Loading(loading),
        }
    }

    /// Opens files, or one index, on a thread of its own.
    pub fn open(id: CloudId, files: Vec<PathBuf>, settings: &OpenSettings) -> Result<Entry> {
        let color = settings.color.as_deref().map(|name| {
            <Attribute as clap::ValueEnum>::from_str(name, false)
                .map_err(|_| Error::Request(format!("there is no attribute {name:?}")))
        });
        let color = color.transpose()?;
        let wanted = color.map_or(
            ColumnSet { rgb: true, intensity: true, ..ColumnSet::default() },
            Attribute::wanted,
        );
        let opening = OpenOptions {
            read: ReadOptions::new(wanted.and(FURTHER.wanted()), settings.strict),
            filter: Filter::default(),
            index: None,
            place: None,
            shadows: None,
            fault: None,
        };
        let load = move |progress: &dyn Progress| {
            prepare(Source::open(&files, &opening, progress)?, color, progress)
        };
        Ok(Entry::new(id, Loading::start(load)?))
    }

    /// Takes points of the host's memory, which are copied; they are prepared on a thread.
    pub fn of_points(id: CloudId, points: &Points) -> Result<Entry> {
        let cloud = Cloud::of_points(points)?;
        let load = move |progress: &dyn Progress| prepare(Source::Files(cloud), None, progress);
        Ok(Entry::new(id, Loading::start(load)?))
    }

    /// Uploads some of what is loaded.
    pub fn advance(&mut self, gpu: &mut Gpu, memory_budget: u64) {
        let waiting = Stage::Failed(String::new());
        self.stage = match std::mem::replace(&mut self.stage, waiting) {
            Stage::Loading(loading) => match loading.loaded.try_recv() {
                Ok(Ok(loaded)) => {
                    (self.core_points, self.notes) = (loaded.core_points, loaded.notes);
                    Stage::Uploading(loaded.prepared)
                }
                Ok(Err(error)) => Stage::Failed(error.to_string()),
                Err(TryRecvError::Empty) => Stage::Loading(loading),
                Err(TryRecvError::Disconnected) => {
                    Stage::Failed("reading ended unexpectedly".into())
                }
            },
            stage => stage,
        };
        let waiting = Stage::Failed(String::new());
        self.stage = match std::mem::replace(&mut self.stage, waiting) {
            Stage::Uploading(mut prepared) => match prepared.step(gpu, &crate::progress::Silent) {
                Ok(true) => Stage::Uploading(prepared),
                Ok(false) => match prepared.finish(gpu, memory_budget) {
                    Ok(cloud) => Stage::Ready(cloud),
                    Err(error) => Stage::Failed(error.to_string()),
                },
                Err(error) => Stage::Failed(error.to_string()),
            },
            stage => stage,
        };
    }

    pub fn state(&self) -> CloudState {
        match &self.stage {
            Stage::Loading(Loading { watch, .. }) => CloudState::Loading {
                doing: watch.doing.lock().unwrap_or_else(PoisonError::into_inner).clone(),
                done: f64::from_bits(watch.done.load(Relaxed)),
            },
            Stage::Uploading(_) => CloudState::Uploading,
            Stage::Ready(_) => CloudState::Ready,
            Stage::Failed(why) => CloudState::Failed(why.clone()),
        }
    }

    /// Returns the cloud if it is ready and shown.
    pub fn shown(&mut self) -> Option<&mut GpuCloud> {
        match &mut self.stage {
            Stage::Ready(cloud) if self.visible => Some(cloud),
            _ => None,
        }
    }

    pub fn resident(&self) -> Option<&Resident> {
        match &self.stage {
            Stage::Ready(cloud) => Some(cloud.resident()),
            _ => None,
        }
    }

    pub fn set_filters(&mut self, opacities: &Opacities, clips: &Clips) {
        if let Stage::Ready(cloud) = &mut self.stage {
            cloud.set_filters(opacities.clone(), clips.clone());
        }
    }

    pub fn set_transform(&mut self, columns: &[f64; 16]) -> Result<()> {
        self.transform = transform_of(columns)?;
        Ok(())
    }
}
