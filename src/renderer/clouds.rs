//! Clouds of a renderer: loaded on a thread of their own, uploaded some nodes a frame.

use super::device_points::PointBuffer;
use super::projection::Transform;
use crate::cloud::attribute::{Attribute, ExtraAttributes};
use crate::cloud::filter::Filter;
use crate::cloud::points::Points;
use crate::cloud::{Cloud, ColumnSet, ReadOptions};
use crate::error::{Error, Result};
use crate::gpu::memory::RawBuffer;
use crate::graph::Gpu;
use crate::index::attributes::strokes::StrokeCache;
use crate::progress::{Progress, Silent};
use crate::render::gpu_cloud::{Allowance, GpuCloud, PreparedCloud};
use crate::render::source::{OpenOptions, Source};
use crate::resident::Resident;
use crate::resident::pool::Pool;
use crate::select::lod::{Detail, LodOptions};
use crate::thread_pool::Workers;
use crate::view::View;
use glam::DVec3;
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

/// Settings of the renderer that hold for clouds added from then on.
#[derive(Clone, Default)]
pub(super) struct Reading {
    /// True if points can be drawn as strokes.
    pub strokes: bool,
    /// Which points are left.
    pub filter: Filter,
    /// Limits of the cut.
    pub lod: LodOptions,
}

/// Where a cloud is from.
enum Origin {
    /// Files, which can be read again.
    Files(Vec<PathBuf>, OpenSettings),
    /// Points that are on the device alone.
    Device,
}

enum Stage {
    /// Points on the device, to be copied by the next frame.
    OnDevice(PointBuffer),
    /// Their copy, and the frame that makes it.
    Copying(PointBuffer, RawBuffer, u64),
    Loading(Loading),
    Uploading(PreparedCloud),
    Ready(GpuCloud),
    Failed(String),
}

/// A cloud, and how it is shown.
pub(super) struct Entry {
    pub id: CloudId,
    pub visible: bool,
    pub transform: Transform,
    pub core_points: Vec<DVec3>,
    pub notes: Vec<String>,
    reading: Reading,
    origin: Origin,
    /// Nodes that the views call for, and that are missing or coarser.
    pub missing: usize,
    /// Data that has come to the device since the last frame `[bytes]`.
    pub streamed: u64,
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
    /// Starts a thread that loads and prepares, with others that it divides the work among.
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
            .spawn(move || {
                // Threads of its own: those of frames are free while files are read.
                let loaded = Workers::start().and_then(|workers| workers.run(|| load(&*own)));
                // A cancelled load has no receiver.
                drop(send.send(loaded));
            })
            .map_err(|error| Error::Request(format!("cannot start a thread: {error}")))?;
        Ok(Loading { watch, loaded, thread: Some(thread) })
    }
}

impl Loading {
    /// Takes points, filters and prepares them on a thread.
    fn of_cloud(
        cloud: impl FnOnce() -> Result<Cloud> + Send + 'static,
        reading: &Reading,
    ) -> Result<Loading> {
        let Reading { strokes, filter, .. } = reading.clone();
        Loading::start(move |progress: &dyn Progress| {
            let mut cloud = cloud()?;
            cloud.filter(&filter)?;
            prepare(Source::Files(cloud), None, strokes, progress)
        })
    }
}

impl Drop for Loading {
    /// Cancels the thread and waits for its end: none outlives the renderer.
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
    /// True if every loss and guess is an error.
    pub strict: bool,
}

/// Attributes that filters and lighting may need later.
const FURTHER: ExtraAttributes =
    ExtraAttributes { kind: true, normal: true, strokes: false, light: false };

fn prepare(
    mut source: Source,
    color: Option<Attribute>,
    strokes: bool,
    progress: &dyn Progress,
) -> Result<Loaded> {
    source.find(color, progress)?;
    let (mut shown, _) = source.shown(color)?;
    shown.further = ExtraAttributes {
        normal: source.has_normals(),
        light: source.has_light(),
        strokes,
        ..FURTHER
    };
    let (core_points, notes) = (source.core_points(), source.notes(shown.further));
    let prepared = source.prepare(shown, &Arc::<StrokeCache>::default(), progress)?;
    Ok(Loaded { prepared, core_points, notes })
}

impl Entry {
    fn new(id: CloudId, origin: Origin, stage: Stage, reading: Reading) -> Entry {
        Entry {
            id,
            visible: true,
            transform: Transform::default(),
            core_points: Vec::new(),
            notes: Vec::new(),
            missing: 0,
            streamed: 0,
            reading,
            origin,
            stage,
        }
    }

    /// Opens files, or one index, on a thread of its own.
    pub fn open(
        id: CloudId,
        files: Vec<PathBuf>,
        settings: &OpenSettings,
        reading: Reading,
    ) -> Result<Entry> {
        let strokes = reading.strokes;
        let color = settings.color.as_deref().map(str::parse::<Attribute>);
        let color = color.transpose().map_err(Error::Request)?;
        let wanted = color.map_or(
            ColumnSet { rgb: true, intensity: true, ..ColumnSet::default() },
            Attribute::wanted,
        );
        let opening = OpenOptions {
            read: ReadOptions::new(
                wanted.and(ExtraAttributes { strokes, ..FURTHER }.wanted()),
                settings.strict,
            ),
            filter: reading.filter.clone(),
            index: reading.lod.index_for(),
            indexes_octrees: false,
            strokes,
            place: None,
            shadows: None,
            fault: None,
        };
        let origin = Origin::Files(files.clone(), settings.clone());
        let load = move |progress: &dyn Progress| {
            prepare(Source::open(&files, &opening, progress)?, color, strokes, progress)
        };
        Ok(Entry::new(id, origin, Stage::Loading(Loading::start(load)?), reading))
    }

    /// Returns the cloud for another device: of files, which are read again.
    pub fn again(&self) -> Result<Entry> {
        let (id, reading) = (self.id, self.reading.clone());
        let entry = match &self.origin {
            Origin::Files(files, settings) => Entry::open(id, files.clone(), settings, reading)?,
            Origin::Device => {
                let why = "its points were in the memory of another device; remove it, and add them again";
                Entry::new(id, Origin::Device, Stage::Failed(why.into()), reading)
            }
        };
        Ok(Entry { visible: self.visible, transform: self.transform, ..entry })
    }

    /// Takes points of the host's memory, which are copied; they are prepared on a thread.
    pub fn of_points(
        id: CloudId,
        points: &Points,
        reading: Reading,
        workers: &Workers,
    ) -> Result<Entry> {
        let cloud = workers.run(|| Cloud::of_points(points))?;
        let stage = Stage::Loading(Loading::of_cloud(|| Ok(cloud), &reading)?);
        Ok(Entry::new(id, Origin::Device, stage, reading))
    }

    /// Takes a cloud that is on the device.
    pub fn of_cloud(id: CloudId, cloud: GpuCloud) -> Entry {
        Entry::new(id, Origin::Device, Stage::Ready(cloud), Reading::default())
    }

    /// Takes a prepared cloud.
    pub fn of_prepared(id: CloudId, prepared: PreparedCloud) -> Entry {
        Entry::new(id, Origin::Device, Stage::Uploading(prepared), Reading::default())
    }

    /// Takes points of a buffer of the host's device, which the next frame copies.
    pub fn of_buffer(id: CloudId, points: PointBuffer, reading: Reading) -> Result<Entry> {
        points.check()?;
        Ok(Entry::new(id, Origin::Device, Stage::OnDevice(points), reading))
    }

    fn pool_mut(&mut self) -> Option<&mut Pool> {
        match &mut self.stage {
            Stage::Uploading(prepared) => prepared.pool_mut(),
            Stage::Ready(cloud) => Some(cloud.pool_mut()),
            _ => None,
        }
    }

    /// Goes back to before a frame that was dropped: what it copied is to be copied again. Returns
    /// the copy that it made of the host's points.
    pub fn drop_frame(&mut self, frame: u64) -> Option<RawBuffer> {
        self.pool_mut().into_iter().for_each(|pool| pool.copy_again(frame));
        let Stage::Copying(points, _, by) = &self.stage else { return None };
        if *by != frame {
            return None;
        }
        let before = Stage::OnDevice(*points);
        match std::mem::replace(&mut self.stage, before) {
            Stage::Copying(_, copy, _) => Some(copy),
            _ => None,
        }
    }

    /// Records the copies of frames that were dropped.
    pub fn copy_again(&mut self, gpu: &mut Gpu) -> Result<()> {
        self.pool_mut().map_or(Ok(()), |pool| pool.submit_copies(gpu))
    }

    /// Uploads some of what is loaded. A cloud fails by itself; errors only if the device is lost.
    pub fn advance(
        &mut self,
        gpu: &mut Gpu,
        memory_budget: u64,
        allowance: &mut Allowance,
    ) -> Result<()> {
        self.streamed = 0;
        let mut lost = None;
        let mut failed = |error: Error| {
            let why = error.to_string();
            lost = Some(error).filter(Error::is_lost_device);
            Stage::Failed(why)
        };
        let waiting = Stage::Failed(String::new());
        self.stage = match std::mem::replace(&mut self.stage, waiting) {
            Stage::OnDevice(points) => match points.record_copy(gpu) {
                Ok(copy) => Stage::Copying(points, copy, gpu.last_reader()),
                Err(error) => failed(error),
            },
            Stage::Copying(points, copy, frame)
                if gpu.completed().is_ok_and(|safe| safe >= frame) =>
            {
                let cloud = move || points.read(&copy, Cloud::of_points);
                Loading::of_cloud(cloud, &self.reading).map_or_else(&mut failed, Stage::Loading)
            }
            Stage::Loading(loading) => match loading.loaded.try_recv() {
                Ok(Ok(loaded)) => {
                    (self.core_points, self.notes) = (loaded.core_points, loaded.notes);
                    Stage::Uploading(loaded.prepared)
                }
                Ok(Err(error)) => failed(error),
                Err(TryRecvError::Empty) => Stage::Loading(loading),
                Err(TryRecvError::Disconnected) => {
                    Stage::Failed("reading ended unexpectedly".into())
                }
            },
            stage => stage,
        };
        if let Err(error) = self.upload(gpu, memory_budget, allowance, &Silent) {
            self.stage = failed(error);
        }
        lost.map_or(Ok(()), Err)
    }

    /// Uploads some of a prepared cloud. Returns whether more remains.
    pub fn upload(
        &mut self,
        gpu: &mut Gpu,
        memory_budget: u64,
        allowance: &mut Allowance,
        progress: &dyn Progress,
    ) -> Result<bool> {
        let Stage::Uploading(prepared) = &mut self.stage else { return Ok(false) };
        let (remains, bytes) = prepared.step(gpu, allowance, progress)?;
        self.streamed += bytes;
        if remains {
            return Ok(true);
        }
        let waiting = Stage::Failed(String::new());
        if let Stage::Uploading(prepared) = std::mem::replace(&mut self.stage, waiting) {
            self.stage = Stage::Ready(prepared.finish(gpu, memory_budget)?);
        }
        Ok(false)
    }

    pub fn state(&self) -> CloudState {
        match &self.stage {
            Stage::OnDevice(_) | Stage::Copying(..) => {
                CloudState::Loading { doing: "copying".into(), done: 0.0 }
            }
            Stage::Loading(Loading { watch, .. }) => CloudState::Loading {
                doing: watch.doing.lock().unwrap_or_else(PoisonError::into_inner).clone(),
                done: f64::from_bits(watch.done.load(Relaxed)),
            },
            Stage::Uploading(_) => CloudState::Uploading,
            Stage::Ready(_) => CloudState::Ready,
            Stage::Failed(why) => CloudState::Failed(why.clone()),
        }
    }

    /// Tests whether nodes come and go.
    pub fn is_index(&self) -> bool {
        matches!(&self.stage, Stage::Ready(GpuCloud::Parts(_)))
    }

    /// Sets the device memory of nodes that come and go `[bytes]`. Returns whether the cloud is to
    /// be updated.
    pub fn set_memory(&mut self, gpu: &Gpu, bytes: u64) -> Result<bool> {
        match &mut self.stage {
            Stage::Ready(GpuCloud::Parts(residency)) => residency.set_pool_bytes(gpu, bytes),
            _ => Ok(false),
        }
    }

    /// Loads what views call for, one cut for all of them; at most this many bytes are on their way
    /// at a time, unless one node is larger. Returns what could not be read.
    pub fn update(
        &mut self,
        gpu: &mut Gpu,
        views: &[View],
        limits: &impl Fn([u32; 2]) -> LodOptions,
        most_in_flight: u64,
    ) -> Result<Vec<String>> {
        let Stage::Ready(GpuCloud::Parts(residency)) = &mut self.stage else {
            return Ok(Vec::new());
        };
        let details = views.iter().map(|view| limits(view.size).of(view.size));
        let Some(detail) = details.reduce(|a, b| Detail { budget: a.budget + b.budget, ..a })
        else {
            return Ok(Vec::new());
        };
        let update = residency.update_views(gpu, views, &detail, most_in_flight)?;
        self.missing = update.missing + update.coarse;
        self.streamed += update.bytes_read;
        Ok(update.errors)
    }

    /// Returns the cloud if it is ready and shown.
    pub fn shown(&self) -> Option<&Resident> {
        self.resident().filter(|_| self.visible)
    }

    pub fn resident(&self) -> Option<&Resident> {
        match &self.stage {
            Stage::Ready(cloud) => Some(cloud.resident()),
            _ => None,
        }
    }

    pub fn cloud_mut(&mut self) -> Option<&mut GpuCloud> {
        match &mut self.stage {
            Stage::Ready(cloud) => Some(cloud),
            _ => None,
        }
    }

    pub fn set_transform(&mut self, columns: &[f64; 16]) -> Result<()> {
        self.transform = Transform::of(columns)?;
        Ok(())
    }
}
