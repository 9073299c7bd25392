//! RENDER THREAD: the newest that the window wants in, pictures on the screen and reports of them
//! out.
//!
//! The window's thread never waits for the device: it posts what it wants, and goes on. This one
//! drains what was posted, keeps the newest, and
//!   draws where that is another picture than the last: smaller while it keeps changing
//!   (dynamic_resolution.rs), and once as large as the window when it has stopped; brings a cloud
//!   that was opened to the device, a few milliseconds of it between two pictures, so that the old
//!   one is flown through until the new one is there; draws again while nodes of an index arrive,
//!   and while a picture at rest is refined ([`FrameConfig::progressive`]); then sleeps until
//!   something is posted. A picture that nobody looks at any more is not drawn twice.
//! One picture at a time is on the device. As soon as it is there the window's thread is told,
//! which moves the camera on: where that is by then is drawn next. So whatever hands do is on the
//! screen after what is left of one picture and one more; a second one waiting on the device would
//! show where the camera was before.
//!
//! How long a picture takes is what passes until it is there. Timestamps of passes do not tell:
//! those of a software device are all taken at the end once anything has been rasterised, as panels
//! are.

mod saving;

use super::cancel::CancelToken;
use super::dynamic_resolution::{ResolutionScale, divided};
use super::load_thread::{CloudInfo, ProgressReporter};
use super::pick_buffer::PickBuffer;
use super::profile::Profile;
use crate::error::{Error, Result};
use crate::graph::{Gpu, Graph, Handle};
use crate::passes::counts::Warned;
use crate::passes::encode::{self, Screen};
use crate::passes::project::{self, Statistics};
use crate::passes::{Decided, Switch, shadows, tally};
use crate::present::Present;
use crate::present::overlay::Overlay;
use crate::progress::Progress;
use crate::render::frame;
use crate::render::scene::Scene;
use crate::render::settings::{FrameConfig, RenderSettings};
use crate::render::source::{GpuCloud, PreparedCloud};
use crate::resident::residency::Update;
use crate::resident::slab_query::Slab;
use crate::resident::{Point, Resident};
use crate::view::View;
use glam::DVec2;
use saving::{PendingSave, RetiredCloud};
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A cloud that is to go to the device, some of it between two pictures, what is to be said of it
/// then, and who is told how far it is.
pub struct Upload {
    pub prepared: PreparedCloud,
    pub info: CloudInfo,
    pub pool_bytes: u64,
    pub watch: ProgressReporter,
}

/// From the window's thread.
pub enum Message {
    Scene {
        scene: Box<Scene>,
        /// When hands wanted it.
        asked: Instant,
    },
    /// The window has another size, or was uncovered; pixels.
    Exposed([u32; 2]),
    /// What lies over the picture.
    Panel(Box<Overlay>),
    /// Takes the place of the cloud that there is, once it is on the device.
    Upload(Box<Upload>),
    /// The point of an id in the last picture.
    Pick {
        id: u32,
        at: DVec2,
        adds: bool,
    },
    /// The points of a slab.
    Section(Slab),
    /// The picture as it is asked for now, of so many pixels, to a file: PNG, or with all its
    /// layers EXR.
    Save {
        path: PathBuf,
        size: [u32; 2],
        layers: bool,
    },
    Close,
}

impl Message {
    /// Whether it makes a picture that is being drawn an old one.
    fn is_newer(&self) -> bool {
        !matches!(self, Message::Panel(_))
    }
}

/// To the window's thread.
pub enum RenderEvent {
    /// A picture is on its way: what moves by itself may move on.
    FrameStarted,
    FrameDone(Box<FrameReport>),
    /// Points in the last picture, where filters or clip boxes leave some out.
    Counted(u64),
    /// A cloud is on the device, of which this is to be said.
    Uploaded(Box<CloudInfo>, CancelToken),
    /// It is not, and why.
    UploadFailed(Error, CancelToken),
    Picked {
        point: Point,
        adds: bool,
    },
    /// Nodes have come since the picture that was picked from; the next one shows what is there.
    PickLater {
        at: DVec2,
        adds: bool,
    },
    Profile(Box<Profile>),
    /// What is being done, and how far it is.
    Status(String),
    Saved(PathBuf),
    /// What is not there, and why.
    SaveFailed(PathBuf, Error),
    /// Work goes on without it.
    Failed(Error),
    /// This thread has ended.
    Ended(Error),
}

/// A picture on the screen.
pub struct FrameReport {
    pub pick_buffer: Arc<PickBuffer>,
    pub decided: Decided,
    /// What was asked for and changes nothing, or was more than there is room for.
    pub notes: Vec<String>,
    pub statistics: Statistics,
    /// Filters or clip boxes may leave some of its points out.
    pub leaves_out: bool,
    /// Milliseconds on the device of every pass.
    pub passes: Vec<(String, f64)>,
    /// As large as the window, and all that the view shows of the cloud, and no other one on its
    /// way.
    pub whole: bool,
    /// Of an index.
    pub loading: Option<Loading>,
    /// What the time went into, until it was on the screen.
    pub times: FrameTimes,
    /// From when it was wanted to when it was there.
    pub latency: Duration,
    /// Of that, drawing it.
    pub took: Duration,
    /// Messages that were handled before it was begun ([`RenderThread::is_newest`]).
    pub handled: u64,
}

/// What a picture of an index waited for, and did not wait for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loading {
    /// Points of a cut at most, where the device has too little memory for what was asked for.
    pub fitting: Option<u64>,
    /// Nodes of the cut; on their way, or on their way with more planes.
    pub nodes: usize,
    pub awaited: usize,
    /// How far apart, pixels, what is drawn and what there is lie at most.
    pub largest_error_px: f64,
    /// Of the pool: all of it, and what is in use.
    pub pool_bytes: [u64; 2],
    /// Read since the picture before.
    pub bytes_read: u64,
    /// How long the loader has had a core since the start, when the picture was on the screen.
    pub worked: Duration,
}

/// On a picture, step by step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameTimes {
    /// Making the swapchain fit the window.
    pub fitting: Duration,
    /// Taking in nodes that had come, and asking for others: all that the loader costs whoever
    /// draws.
    pub taking_in: Duration,
    /// Deciding and recording what is to be drawn.
    pub recording: Duration,
    /// Waiting for the device.
    pub drawing: Duration,
    /// Copying what people point at.
    pub reading_back: Duration,
    /// Bringing it to the screen.
    pub showing: Duration,
}

impl FrameReport {
    /// Whether nodes are still on their way.
    pub fn is_loading(&self) -> bool {
        self.loading.is_some_and(|loading| loading.awaited > 0)
    }
}

/// The thread, as the window's thread has it.
pub struct RenderThread {
    posts: Sender<Message>,
    posted: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

impl RenderThread {
    pub fn start(
        gpu: Gpu,
        present: Present,
        report: impl Fn(RenderEvent) + Send + Sync + 'static,
    ) -> Result<RenderThread> {
        let (posts, posted) = channel();
        let count = Arc::new(AtomicU64::new(0));
        let thread = RenderLoop {
            gpu,
            present: Some(present),
            window: [0, 0],
            posted,
            count: count.clone(),
            handled: 0,
            report: Box::new(report),
            uploading: None,
            cloud: None,
            scene: None,
            changed: Instant::now(),
            asked: Instant::now(),
            redraw: Redraw::Nothing,
            show_due: false,
            scale: ResolutionScale::default(),
            last_drawn: Vec::new(),
            saves: VecDeque::new(),
            retired: VecDeque::new(),
            filters_replaced: false,
            count_due: None,
        };
        let thread = std::thread::Builder::new().name("render".into()).spawn(move || thread.run());
        let thread = thread
            .map_err(|error| Error::Device(format!("cannot start a thread to draw: {error}")))?;
        Ok(RenderThread { posts, posted: count, thread: Some(thread) })
    }

    pub fn post(&self, message: Message) {
        self.posted.fetch_add(message.is_newer() as u64, Relaxed);
        // A thread that has ended has reported why.
        let _ = self.posts.send(message);
    }

    /// Whether all that was posted had been handled then.
    pub fn is_newest(&self, handled: u64) -> bool {
        self.posted.load(Relaxed) == handled
    }

    /// Waits until everything on the device is given back.
    pub fn close(&mut self) {
        self.post(Message::Close);
        if let Some(thread) = self.thread.take() {
            // A panic has been printed where it happened.
            let _ = thread.join();
        }
    }
}

/// What is still to be drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Redraw {
    Nothing,
    /// The same as on the screen, larger, once nothing has changed for a while.
    FullResolution,
    /// Nodes are on their way.
    NodesArriving,
    /// Something else than on the screen.
    Changed,
}

/// Who lets go of the mouse for so long has stopped.
const IDLE_DELAY: Duration = Duration::from_millis(150);

/// Between two looks at what the loader has brought.
const LOAD_POLL: Duration = Duration::from_millis(10);

struct RenderLoop {
    gpu: Gpu,
    /// Taken at the end.
    present: Option<Present>,
    /// The window's size, pixels, as the system has told it.
    window: [u32; 2],
    posted: Receiver<Message>,
    /// Messages posted that want another picture, and those handled.
    count: Arc<AtomicU64>,
    handled: u64,
    report: Box<dyn Fn(RenderEvent) + Send + Sync>,
    /// On its way to the device.
    uploading: Option<Box<Upload>>,
    cloud: Option<GpuCloud>,
    scene: Option<Scene>,
    /// When what is to be seen last changed.
    changed: Instant,
    /// When that was wanted.
    asked: Instant,
    redraw: Redraw,
    /// The picture on the screen is to be shown again, under another panel.
    show_due: bool,
    scale: ResolutionScale,
    /// What the last picture was drawn from ([`crate::resident::Resident::identity`]).
    last_drawn: Vec<u64>,
    /// Pictures on their way into files, one after the other.
    saves: VecDeque<PendingSave>,
    /// What the first of them are of, where the window shows another cloud by now.
    retired: VecDeque<RetiredCloud>,
    /// What is to be seen of the window's cloud is what a picture that is being saved shows, not
    /// the window's.
    filters_replaced: bool,
    /// Filters or clip boxes leave points out of the picture on the screen, and nobody has counted
    /// the others; whether those that face away are not there.
    count_due: Option<bool>,
}

/// Stops a whole picture on a software device, where it takes long, when something newer is wanted.
struct Superseded<'t> {
    count: &'t AtomicU64,
    handled: u64,
}

impl Progress for Superseded<'_> {
    fn tick(&self, _doing: &str, _done: u64, _total: u64) -> Result<()> {
        if self.count.load(Relaxed) > self.handled { Err(Error::Interrupted) } else { Ok(()) }
    }
}

/// Samples of the light cast in a row at most, while a picture of those before is on the screen.
const REFINE_BUDGET: Duration = Duration::from_millis(100);

/// Adds samples of the light to those that shadows are made of, until something newer is wanted; in
/// submissions of their own, so that what has been cast stays when the picture gives way.
fn refine_shadows(
    gpu: &mut Gpu,
    view: &View,
    resident: &Resident,
    config: &FrameConfig,
    newer: &Superseded,
) -> Result<()> {
    let (scene, began) = (config.frame_context(view, resident), Instant::now());
    loop {
        let mut g = Graph::new(gpu);
        let marks = match shadows::light_visibility(
            &mut g,
            &scene,
            resident,
            &config.effects,
            &config.decided,
            Some(1),
        ) {
            Ok(marks) => marks,
            Err(error) => {
                g.discard();
                // The picture says so.
                return if let Error::Request(_) = error { Ok(()) } else { Err(error) };
            }
        };
        let Some(shadows::LightVisibility { counts, saved: None, facts, .. }) = marks else {
            return Ok(());
        };
        g.submit_and_wait(&[counts.resource()])?.recycle(gpu);
        if facts.cast == facts.samples
            || began.elapsed() >= REFINE_BUDGET
            || newer.tick("", 0, 0).is_err()
        {
            return Ok(());
        }
    }
}

/// What is asked for of a picture of a cloud; until its strokes are found it is drawn without.
fn settings(scene: &Scene, resident: &Resident) -> RenderSettings {
    let mut settings = scene.settings.clone();
    if strokes_missing(scene, resident) {
        settings.effects.strokes.switch = Switch::Off;
    }
    settings
}

/// Whether it is to be painted, and what brushes need is not known yet.
fn strokes_missing(scene: &Scene, resident: &Resident) -> bool {
    scene.settings.effects.strokes.switch == Switch::On && resident.shown.strokes().is_none()
}

impl RenderLoop {
    fn run(mut self) {
        let ended = match catch_unwind(AssertUnwindSafe(|| self.serve())) {
            Ok(ended) => ended,
            // It has been printed where it happened. What the device may still be at work with
            // stays.
            Err(_panic) => {
                (self.report)(RenderEvent::Ended(Error::Device(
                    "drawing has ended by a mistake in this program, which is said above".into(),
                )));
                return std::mem::forget(self);
            }
        };
        self.cancel_saves();
        self.cancel_upload();
        let present = self.present.take().expect("taken here only");
        present.free(&mut self.gpu);
        if let Some(cloud) = self.cloud.take() {
            cloud.free(&mut self.gpu);
        }
        if let Err(error) = ended.and_then(|()| self.gpu.device.take_validation_errors()) {
            (self.report)(RenderEvent::Ended(error));
        }
    }

    /// Until it is to close.
    fn serve(&mut self) -> Result<()> {
        loop {
            let first = match self.idle_timeout() {
                Some(wait) => match self.posted.recv_timeout(wait) {
                    Ok(message) => Some(message),
                    Err(RecvTimeoutError::Timeout) => None,
                    Err(RecvTimeoutError::Disconnected) => return Ok(()),
                },
                None => match self.posted.recv() {
                    Ok(message) => Some(message),
                    Err(_) => return Ok(()),
                },
            };
            let mut next = first;
            while let Some(message) = next {
                self.handled += message.is_newer() as u64;
                if matches!(message, Message::Close) {
                    return Ok(());
                }
                self.handle(message)?;
                next = self.posted.try_recv().ok();
            }
            self.step()?;
            self.upload_step()?;
        }
    }

    /// How long there is nothing to do, if nothing is posted; none: for ever.
    fn idle_timeout(&self) -> Option<Duration> {
        let by_wanted = match self.redraw {
            Redraw::Changed => Some(Duration::ZERO),
            Redraw::NodesArriving => Some(LOAD_POLL),
            Redraw::FullResolution => Some(IDLE_DELAY.saturating_sub(self.changed.elapsed())),
            Redraw::Nothing if self.count_due.is_some() => {
                Some(IDLE_DELAY.saturating_sub(self.changed.elapsed()))
            }
            Redraw::Nothing if !self.saves.is_empty() => Some(Duration::ZERO),
            Redraw::Nothing => None,
        };
        if self.show_due || self.uploading.is_some() { Some(Duration::ZERO) } else { by_wanted }
    }

    fn handle(&mut self, message: Message) -> Result<()> {
        match message {
            Message::Scene { scene, asked } => {
                if self.scene.as_ref() != Some(&*scene) {
                    self.scene = Some(*scene);
                    self.change(asked);
                }
            }
            Message::Exposed(size) => {
                self.window = size;
                self.change(Instant::now());
            }
            Message::Panel(overlay) => {
                self.present.as_mut().expect("taken at the end").lay_over(&self.gpu, *overlay)?;
                self.show_due = true;
            }
            Message::Upload(upload) => {
                // Nobody waits any more for another one.
                self.cancel_upload();
                self.uploading = Some(upload);
            }
            Message::Pick { id, at, adds } => {
                self.restore_filters()?;
                // Ids are of the picture that was drawn last; where nodes have come since, they are
                // others.
                let resident = self
                    .cloud
                    .as_ref()
                    .map(GpuCloud::resident)
                    .filter(|resident| resident.identity() == self.last_drawn);
                match resident {
                    Some(resident) => {
                        let point = resident.point(&mut self.gpu, id)?;
                        point
                            .into_iter()
                            .for_each(|point| (self.report)(RenderEvent::Picked { point, adds }));
                    }
                    None => (self.report)(RenderEvent::PickLater { at, adds }),
                }
            }
            Message::Section(slab) => {
                self.restore_filters()?;
                if let Some(resident) = self.cloud.as_ref().map(GpuCloud::resident) {
                    (self.report)(RenderEvent::Profile(Box::new(Profile::new(
                        slab,
                        resident.section(&mut self.gpu, &slab)?,
                        resident.shown,
                    ))));
                }
            }
            Message::Save { path, size, layers } => self.save(path, size, layers)?,
            Message::Close => {}
        }
        Ok(())
    }

    /// Some more of the cloud that is on its way; beside the one in the window, and one at most
    /// that pictures are saved of.
    fn upload_step(&mut self) -> Result<()> {
        let Some(mut upload) = self.uploading.take_if(|_| self.retired.is_empty()) else {
            return Ok(());
        };
        let uploaded = match upload.prepared.step(&mut self.gpu, &upload.watch) {
            Ok(true) => {
                self.uploading = Some(upload);
                return Ok(());
            }
            Ok(false) => upload.prepared.finish(&mut self.gpu, upload.pool_bytes),
            Err(error) => {
                upload.prepared.free(&mut self.gpu);
                Err(error)
            }
        };
        match uploaded {
            Ok(cloud) => {
                if let Some(old) = self.cloud.replace(cloud) {
                    self.retire(old);
                }
                (self.report)(RenderEvent::Uploaded(Box::new(upload.info), upload.watch.token));
                self.change(Instant::now());
            }
            // Nobody waits for it any more.
            Err(Error::Interrupted) => {}
            Err(error) if error.is_lost_device() => return Err(error),
            Err(error) => {
                (self.report)(RenderEvent::UploadFailed(error, upload.watch.token));
                self.change(Instant::now());
            }
        }
        Ok(())
    }

    fn cancel_upload(&mut self) {
        self.uploading.take().into_iter().for_each(|upload| upload.prepared.free(&mut self.gpu));
    }

    fn change(&mut self, asked: Instant) {
        // What has not been drawn yet waits since it was first asked for.
        if self.redraw != Redraw::Changed {
            self.asked = asked;
        }
        self.changed = Instant::now();
        self.redraw = Redraw::Changed;
    }

    /// One thing that is to be done.
    fn step(&mut self) -> Result<()> {
        let due = match self.redraw {
            Redraw::Changed | Redraw::NodesArriving => true,
            Redraw::FullResolution => self.changed.elapsed() >= IDLE_DELAY,
            Redraw::Nothing => false,
        };
        if due && self.draw()? {
            return Ok(());
        }
        match self.redraw {
            _ if self.show_due => self.show_again(),
            Redraw::Nothing if self.count_due.is_some() && self.changed.elapsed() >= IDLE_DELAY => {
                self.count()
            }
            Redraw::Nothing => self.save_step(),
            _ => Ok(()),
        }
    }

    /// The points of the picture on the screen, once it rests: a moving one has no time for another
    /// walk over them.
    fn count(&mut self) -> Result<()> {
        let Some(one_sided) = self.count_due.take() else { return Ok(()) };
        self.restore_filters()?;
        // Where nodes are on their way, the picture that has them is counted.
        if self.redraw != Redraw::Nothing {
            return Ok(());
        }
        let (Some(scene), Some(cloud), Some(present)) = (&self.scene, &self.cloud, &self.present)
        else {
            return Ok(());
        };
        let view = View::new(scene.camera, present.size())?;
        let mut g = Graph::new(&mut self.gpu);
        let Ok(points) = project::draw(&mut g, &view, cloud.resident(), scene.settings.precision)
        else {
            // Whoever draws them says so.
            g.discard();
            return Ok(());
        };
        let points = points.one_sided(one_sided);
        let counted = tally::record(&mut g, &view, &points);
        let frame = g.submit_and_wait(&[])?;
        (self.report)(RenderEvent::Counted(counted.points(&frame)));
        frame.recycle(&mut self.gpu);
        Ok(())
    }

    /// The same picture, under another panel.
    fn show_again(&mut self) -> Result<()> {
        self.show_due = false;
        let present = self.present.as_mut().expect("taken at the end");
        if !present.fit(&mut self.gpu, self.window)? || !present.show(&self.gpu)? {
            self.change(Instant::now());
        }
        Ok(())
    }

    /// One picture; false where there is nothing new to show.
    fn draw(&mut self) -> Result<bool> {
        let present = self.present.as_mut().expect("taken at the end");
        let (mut times, fitting) = (FrameTimes::default(), Instant::now());
        if !present.fit(&mut self.gpu, self.window)? {
            // Whoever uncovers the window says so.
            (self.redraw, self.show_due) = (Redraw::Nothing, false);
            return Ok(false);
        }
        let (Some(scene), Some(cloud)) = (&self.scene, &mut self.cloud) else {
            self.redraw = Redraw::Nothing;
            return self.blank().map(|()| true);
        };
        cloud.set_filters(scene.opacities.clone(), scene.clips.clone());
        self.filters_replaced = false;
        times.fitting = fitting.elapsed();
        let divisor = if self.redraw == Redraw::Changed { self.scale.divisor } else { 1 };
        let size = divided(present.size(), divisor);
        let view = View::new(scene.camera, size)?;
        let (mut loading, taking_in) = (None, Instant::now());
        if let GpuCloud::Parts(residency) = cloud {
            let detail = scene.lod.of(size);
            let update = match self.redraw {
                Redraw::Changed => residency.update_moving(&mut self.gpu, &view, &detail)?,
                _ => residency.update(&mut self.gpu, &view, &detail)?,
            };
            let Update { cut, budget, missing, coarse, bytes_read, errors, .. } = update;
            loading = Some(Loading {
                fitting: (budget < detail.budget).then_some(budget),
                nodes: cut.nodes.len(),
                awaited: missing + coarse,
                largest_error_px: cut.largest_error_px,
                pool_bytes: residency.pool_bytes(),
                bytes_read,
                worked: Duration::ZERO,
            });
            errors
                .into_iter()
                .for_each(|error| (self.report)(RenderEvent::Failed(Error::Request(error))));
        }
        let complete = loading.is_none_or(|loading| loading.awaited == 0);
        times.taking_in = taking_in.elapsed();
        let recording = Instant::now();
        let resident = cloud.resident();
        let identity = resident.identity();
        if self.redraw == Redraw::NodesArriving
            && identity == self.last_drawn
            && !complete
            && !present.is_blank()
        {
            return Ok(false);
        }
        let newer = Superseded { count: &self.count, handled: self.handled };
        // What is only a finer picture of the same gives way.
        let gives_way = self.redraw != Redraw::Changed;
        // By the whole picture: a smaller one has more points a pixel, and would call for other
        // effects.
        let mut config = FrameConfig::new(
            &settings(scene, resident),
            &View::new(scene.camera, present.size())?,
            resident,
        );
        if strokes_missing(scene, resident) {
            config.decided.explain("strokes", "what brushes need to know is still being found");
        }
        let mut drawn = if gives_way { config.progressive() } else { config.interactive(divisor) };
        if divisor > 1 && !drawn.overlap.is_everywhere() {
            drawn.overlap = Arc::new(resident.overlap(&view));
        }
        if gives_way {
            refine_shadows(&mut self.gpu, &view, resident, &config, &newer)?;
        }
        let mut g = Graph::new(&mut self.gpu);
        if gives_way {
            g = g.with_progress(&newer);
        }
        let outcome = match frame::record(&mut g, &view, resident, &drawn) {
            Ok(outcome) => outcome,
            Err(error) => {
                g.discard();
                return match error {
                    // Something newer is wanted, which is handled next.
                    Error::Interrupted => Ok(true),
                    // What was asked for cannot be drawn; the picture that is there stays until
                    // something else is asked for.
                    Error::Request(_) => {
                        (self.report)(RenderEvent::Failed(error));
                        self.redraw = Redraw::Nothing;
                        let nothing_is_there = self.present.as_ref().is_some_and(Present::is_blank);
                        if nothing_is_there { self.blank().map(|()| true) } else { Ok(false) }
                    }
                    _ => Err(error),
                };
            }
        };
        let mut screen = Screen {
            words: g.import("screen", present.screen()),
            blue_first: present.blue_first(),
        };
        encode::record(&mut g, &outcome.picture, &mut screen)?;
        let warned = Warned::ask(&mut g, &drawn.effects);
        let [depth, index] =
            [&outcome.gbuffer.depth, &outcome.gbuffer.index].map(|layer| g.download(layer));
        times.recording = recording.elapsed();
        let (began, handled) = (Instant::now(), self.handled);
        let running = match g.submit_async(&[screen.words.resource()]) {
            Ok(running) => running,
            // Something newer is wanted, which is handled next.
            Err(Error::Interrupted) => return Ok(true),
            Err(error) => return Err(error),
        };
        (self.report)(RenderEvent::FrameStarted);
        let frame = running.finish(&mut self.gpu)?;
        let took = began.elapsed();
        let reading_back = Instant::now();
        present.holds(&mut self.gpu, size)?;
        let pick_buffer = Arc::new(PickBuffer {
            view,
            depth: frame.read(&depth).to_vec(),
            index: frame.read(&index).to_vec(),
        });
        let passes = frame.passes.clone();
        let unordered = outcome.strokes.as_ref().and_then(|painted| painted.unordered.as_ref());
        let ordered = unordered.is_none_or(|unordered| frame.read::<u32>(unordered)[0] == 0);
        let mut notes = config.warnings(cloud.resident());
        notes.extend(
            warned
                .note(&frame)
                .into_iter()
                .chain(outcome.strokes.as_ref().and_then(|painted| painted.facts.note())),
        );
        frame.recycle(&mut self.gpu);
        self.scale = self.scale.after(divisor, took);
        self.last_drawn = identity;
        let lit = outcome
            .gbuffer
            .light_visibility
            .as_ref()
            .is_none_or(|marks| marks.facts.cast == marks.facts.samples);
        let finest = divisor == 1 && drawn.effects == config.effects && lit && ordered;
        self.redraw = match (finest, complete) {
            (true, true) => Redraw::Nothing,
            (true, false) => Redraw::NodesArriving,
            _ => Redraw::FullResolution,
        };
        self.show_due = false;
        self.count_due =
            cloud.resident().leaves_out().then(|| config.drops_back_faces(cloud.resident()));
        (times.drawing, times.reading_back) = (took, reading_back.elapsed());
        let showing = Instant::now();
        if !present.show(&self.gpu)? {
            self.redraw = Redraw::Changed;
        }
        times.showing = showing.elapsed();
        if let (Some(loading), GpuCloud::Parts(residency)) = (&mut loading, cloud) {
            loading.worked = residency.loader_worked();
        }
        let (decided, statistics, latency) =
            (config.decided, outcome.statistics, self.asked.elapsed());
        let (whole, leaves_out) =
            (finest && complete && self.uploading.is_none(), self.count_due.is_some());
        (self.report)(RenderEvent::FrameDone(Box::new(FrameReport {
            pick_buffer,
            decided,
            notes,
            statistics,
            leaves_out,
            passes,
            whole,
            loading,
            times,
            latency,
            took,
            handled,
        })));
        Ok(true)
    }

    /// Shows the background alone.
    fn blank(&mut self) -> Result<()> {
        let present = self.present.as_mut().expect("taken at the end");
        let [red, green, blue] = self
            .scene
            .as_ref()
            .map_or(crate::config::BACKGROUND, |scene| scene.settings.background)
            .map(u32::from);
        let word = if present.blue_first() {
            blue | green << 8 | red << 16
        } else {
            red | green << 8 | blue << 16
        };
        let mut g = Graph::new(&mut self.gpu);
        let mut screen = g.import("screen", present.screen());
        g.fill(&mut screen, word | 255 << 24);
        g.submit_and_wait(&[screen.resource()])?.recycle(&mut self.gpu);
        present.holds(&mut self.gpu, present.size())?;
        self.show_due = false;
        if !present.show(&self.gpu)? {
            self.redraw = Redraw::Changed;
        }
        Ok(())
    }
}
