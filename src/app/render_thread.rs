//! The render thread: messages from the window in, frames on the screen and events out.
//!
//! The window's thread never waits for the device; it sends messages and goes on. This thread
//! handles all messages that have come, keeps the newest state, and then takes one step:
//!
//! - It draws if the frame would differ from the last one: faster while the scene keeps changing
//!   ([`crate::tune::governor`]), and as it was asked for once it has stopped; again while nodes
//!   of an index arrive, and while a picture at rest is refined ([`FrameConfig::progressive`]).
//! - It uploads a loaded cloud, a few milliseconds at a time, while the old one is still drawn.
//! - It answers clicks that the last picture cannot answer.
//! - It saves pictures, piece by piece, when there is nothing to draw.
//!
//! Otherwise it sleeps until a message comes. A frame that is superseded is not finished.
//!
//! On a software device a frame that takes long is submitted in parts. Between them a panel that
//! has come is drawn over the last frame, so that buttons answer while a picture is in progress.
//!
//! One frame at a time is on the device. As soon as it starts, the window's thread is told and
//! moves the camera on; where the camera is when the frame is done is drawn next. So input is on
//! the screen after the rest of one frame and one more. A second frame queued on the device would
//! show an older camera.
//!
//! Frame times are measured until the frame is done. Timestamps of passes do not tell: a software
//! device takes all of them at the end of a submission that rasterises, as panels do.

mod draw_frame;
mod messages;
mod picking;
mod saving;

use super::load_thread::{CloudInfo, ProgressReporter};
use super::profile::Profile;
use super::viewport::Viewport;
use crate::error::{Error, Result};
use crate::graph::Graph;
use crate::passes::{count_visible, project};
use crate::present::Present;
use crate::prices;
use crate::render::scene::Scene;
#[cfg(doc)]
use crate::render::settings::FrameConfig;
use crate::renderer::{CloudId, Renderer};
use crate::tune::Governor;
use draw_frame::{Moved, Superseded};
pub use messages::{
    FrameReport, FrameTimes, Loading, Measured, Message, Moving, RenderEvent, Upload,
};
pub use picking::PickRequest;
use saving::SaveQueue;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The window's handle to the thread.
pub struct RenderThread {
    messages: Sender<Message>,
    /// Number of messages sent that change the picture.
    posted: Arc<AtomicU64>,
    /// Number of messages sent that are urgent.
    urgent: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

impl RenderThread {
    /// Starts the thread, which reports its events through `report`.
    pub fn start(
        renderer: Renderer,
        present: Present,
        governor: Governor,
        report: impl Fn(RenderEvent) + Send + Sync + 'static,
    ) -> Result<RenderThread> {
        let (sender, messages) = channel();
        let [posted, urgent] = [(); 2].map(|()| Arc::new(AtomicU64::new(0)));
        let thread = RenderLoop {
            renderer,
            present: Some(present),
            viewport: Viewport::new([0, 0], 0.0),
            inbox: Inbox {
                messages,
                waiting: VecDeque::new(),
                posted: posted.clone(),
                handled: 0,
                urgent: urgent.clone(),
                urgent_handled: 0,
            },
            report: Arc::new(report),
            uploading: None,
            cloud: None,
            scene: None,
            schedule: Schedule::new(Instant::now()),
            governor,
            moved: None,
            last_drawn: Vec::new(),
            saves: SaveQueue::default(),
            picks: VecDeque::new(),
        };
        let thread = std::thread::Builder::new().name("render".into()).spawn(move || thread.run());
        let thread = thread
            .map_err(|error| Error::Device(format!("cannot start a thread to draw: {error}")))?;
        Ok(RenderThread { messages: sender, posted, urgent, thread: Some(thread) })
    }

    /// Sends a message; never waits.
    pub fn post(&self, message: Message) {
        self.posted.fetch_add(message.changes_picture() as u64, Relaxed);
        self.urgent.fetch_add(message.is_urgent() as u64, Relaxed);
        // A thread that has ended has reported why.
        let _ = self.messages.send(message);
    }

    /// Returns whether no message that changes the picture was sent after this many.
    pub fn is_newest(&self, handled: u64) -> bool {
        self.posted.load(Relaxed) == handled
    }

    /// Ends the thread, and waits until it has freed everything on the device.
    pub fn close(&mut self) {
        self.post(Message::Close);
        if let Some(thread) = self.thread.take() {
            // A panic has been printed where it happened.
            let _ = thread.join();
        }
    }
}

/// The drawing still to be done, by urgency.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Redraw {
    Nothing,
    /// The last frame in full resolution, once nothing has changed for a while.
    FullResolution,
    /// The last frame with the nodes that arrive.
    NodesArriving,
    /// Another frame.
    Changed,
}

/// Time without changes after which the scene is at rest.
const IDLE_DELAY: Duration = Duration::from_millis(150);

/// Time on the device from which on a picture is too slow for the panel to wait for it.
const SLOW: Duration = Duration::from_millis(30);

/// Time between two checks for loaded nodes.
const LOAD_POLL: Duration = Duration::from_millis(10);

/// Messages from the window.
struct Inbox {
    messages: Receiver<Message>,
    /// Messages that have come while a frame was drawn.
    waiting: VecDeque<Message>,
    /// Number of messages sent that change the picture.
    posted: Arc<AtomicU64>,
    /// Number of these that have been handled.
    handled: u64,
    /// Number of messages sent that are urgent.
    urgent: Arc<AtomicU64>,
    /// Number of these that have been handled.
    urgent_handled: u64,
}

impl Inbox {
    /// Returns the next message that has come.
    fn next(&mut self) -> Option<Message> {
        self.waiting.pop_front().or_else(|| self.messages.try_recv().ok())
    }

    fn superseded(&self) -> Superseded<'_> {
        Superseded { posted: &self.urgent, handled: self.urgent_handled }
    }

    /// Interrupts saving: by changes of the picture alone, since a piece that is begun again at
    /// every answer of the panel would never be done.
    fn picture_superseded(&self) -> Superseded<'_> {
        Superseded { posted: &self.posted, handled: self.handled }
    }
}

/// The work that is due, and when.
struct Schedule {
    /// Time of the last change.
    changed: Instant,
    /// Time at which the change that is not drawn yet was first requested.
    asked: Instant,
    redraw: Redraw,
    /// True if the last frame has to be shown again, under another panel.
    show_due: bool,
    /// Set if the points of the last frame have to be counted, since filters leave some out; true
    /// if back faces are left out, too.
    count_due: Option<bool>,
    /// Time that the last frame took on the device.
    took: Duration,
}

impl Schedule {
    fn new(now: Instant) -> Schedule {
        let redraw = Redraw::Nothing;
        let took = Duration::ZERO;
        Schedule { changed: now, asked: now, redraw, show_due: false, count_due: None, took }
    }

    /// Schedules another frame, requested at `asked`.
    fn change(&mut self, asked: Instant) {
        // A change that is not drawn yet keeps the time of its first request.
        if self.redraw != Redraw::Changed {
            self.asked = asked;
        }
        self.changed = Instant::now();
        self.redraw = Redraw::Changed;
    }
}

/// A cloud that is being uploaded, which then replaces the window's.
struct Uploading {
    cloud: CloudId,
    info: CloudInfo,
    watch: ProgressReporter,
}

/// The thread's state.
struct RenderLoop {
    renderer: Renderer,
    /// None once the thread has ended.
    present: Option<Present>,
    /// The window, as last reported.
    viewport: Viewport,
    inbox: Inbox,
    report: Arc<dyn Fn(RenderEvent) + Send + Sync>,
    uploading: Option<Uploading>,
    cloud: Option<CloudId>,
    scene: Option<Scene>,
    schedule: Schedule,
    governor: Governor,
    /// The last moving frame.
    moved: Option<Moved>,
    /// Nodes of the last frame ([`crate::resident::Resident::identity`]).
    last_drawn: Vec<u64>,
    saves: SaveQueue,
    /// Clicks that are not answered yet.
    picks: VecDeque<PickRequest>,
}

impl RenderLoop {
    fn run(mut self) {
        let ended = match catch_unwind(AssertUnwindSafe(|| self.serve())) {
            Ok(ended) => ended,
            // It has been printed where it happened. Objects that the device may use are leaked.
            Err(_panic) => {
                (self.report)(RenderEvent::Ended(Error::Device(
                    "drawing has ended by an error in this program, which is printed above".into(),
                )));
                return std::mem::forget(self);
            }
        };
        self.cancel_saves();
        self.cancel_upload();
        self.present = None;
        self.renderer.remove_all();
        if let Err(error) = ended.and_then(|()| self.renderer.gpu.device.take_validation_errors()) {
            (self.report)(RenderEvent::Ended(error));
        }
    }

    /// Handles messages and takes steps, until the window closes.
    fn serve(&mut self) -> Result<()> {
        loop {
            let waiting = self.inbox.waiting.pop_front();
            let first = match self.idle_timeout() {
                _ if waiting.is_some() => waiting,
                Some(wait) => match self.inbox.messages.recv_timeout(wait) {
                    Ok(message) => Some(message),
                    Err(RecvTimeoutError::Timeout) => None,
                    Err(RecvTimeoutError::Disconnected) => return Ok(()),
                },
                None => match self.inbox.messages.recv() {
                    Ok(message) => Some(message),
                    Err(_) => return Ok(()),
                },
            };
            let mut next = first;
            while let Some(message) = next {
                self.inbox.handled += message.changes_picture() as u64;
                self.inbox.urgent_handled += message.is_urgent() as u64;
                if matches!(message, Message::Close) {
                    return Ok(());
                }
                self.handle(message)?;
                next = self.inbox.next();
            }
            self.pick_step()?;
            self.step()?;
            self.upload_step()?;
        }
    }

    /// Returns the time until the next step if no message comes; None if there is nothing to do.
    fn idle_timeout(&self) -> Option<Duration> {
        let by_wanted = match self.schedule.redraw {
            Redraw::Changed => Some(Duration::ZERO),
            Redraw::NodesArriving => Some(LOAD_POLL),
            Redraw::FullResolution => {
                Some(IDLE_DELAY.saturating_sub(self.schedule.changed.elapsed()))
            }
            Redraw::Nothing if self.schedule.count_due.is_some() => {
                Some(IDLE_DELAY.saturating_sub(self.schedule.changed.elapsed()))
            }
            Redraw::Nothing if !self.saves.queue.is_empty() => Some(Duration::ZERO),
            Redraw::Nothing => None,
        };
        if self.schedule.show_due || self.uploading.is_some() || !self.picks.is_empty() {
            Some(Duration::ZERO)
        } else {
            by_wanted
        }
    }

    /// Handles one message.
    fn handle(&mut self, message: Message) -> Result<()> {
        match message {
            Message::Scene { scene, asked } => {
                if self.scene.as_ref() != Some(&*scene) {
                    self.scene = Some(*scene);
                    self.schedule.change(asked);
                }
            }
            Message::Exposed(viewport) => {
                self.viewport = viewport;
                self.schedule.change(Instant::now());
            }
            Message::Limit(limit) => self.governor.set_limit(limit),
            Message::Panel { overlay, .. } => {
                self.present
                    .as_mut()
                    .expect("taken at the end")
                    .set_overlay(&self.renderer.gpu, *overlay)?;
                self.schedule.show_due = true;
            }
            Message::Upload(upload) => {
                // A newer upload replaces one in progress.
                self.cancel_upload();
                let Upload { prepared, info, watch } = *upload;
                let cloud = self.renderer.add_prepared(prepared);
                self.uploading = Some(Uploading { cloud, info, watch });
            }
            Message::Pick(pick) => self.pick(*pick)?,
            Message::Prices => self.price()?,
            Message::Section(slab) => {
                self.restore_scene()?;
                if let Some(cloud) = self.cloud {
                    let (gpu, cloud) = self.renderer.cloud(cloud)?;
                    let resident = cloud.resident();
                    let points = resident.section(gpu, &slab)?;
                    let profile = Profile::new(slab, points, resident.shown);
                    (self.report)(RenderEvent::Profile(Box::new(profile)));
                }
            }
            Message::Save { path, size, layers, over } => self.save(path, size, layers, *over)?,
            Message::Close => {}
        }
        Ok(())
    }

    /// Measures what each effect costs, until the picture changes.
    fn price(&mut self) -> Result<()> {
        self.restore_scene()?;
        let (Some(scene), Some(cloud), Some(present)) = (&self.scene, self.cloud, &self.present)
        else {
            return Ok(());
        };
        let view = self.viewport.view_of(scene.camera, present.size())?;
        let config = self.renderer.config(cloud, &view)?;
        let newer = self.inbox.picture_superseded();
        match prices::of(&mut self.renderer, cloud, &view, &config, &newer) {
            Ok(prices) => (self.report)(RenderEvent::Priced(prices)),
            Err(Error::Interrupted) => {}
            Err(error @ Error::Request(_)) => (self.report)(RenderEvent::Failed(error)),
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// Uploads some more of a loaded cloud. Besides the window's cloud, at most one cloud whose
    /// pictures are being saved is on the device.
    fn upload_step(&mut self) -> Result<()> {
        if self.saves.of_other_clouds(self.cloud) {
            return Ok(());
        }
        let Some(upload) = self.uploading.take() else { return Ok(()) };
        match self.renderer.upload_step(upload.cloud, &upload.watch) {
            Ok(true) => self.uploading = Some(upload),
            Ok(false) => {
                if let Some(old) = self.cloud.replace(upload.cloud) {
                    self.remove_unused(old)?;
                }
                self.governor.restart();
                (self.report)(RenderEvent::Uploaded(Box::new(upload.info), upload.watch.token));
                self.schedule.change(Instant::now());
            }
            // Its token was cancelled.
            Err(Error::Interrupted) => {}
            Err(error) if error.is_lost_device() => return Err(error),
            Err(error) => {
                (self.report)(RenderEvent::UploadFailed(error, upload.watch.token));
                self.schedule.change(Instant::now());
            }
        }
        Ok(())
    }

    fn cancel_upload(&mut self) {
        if let Some(upload) = self.uploading.take() {
            let _ = self.renderer.remove(upload.cloud);
        }
    }

    /// Takes the next step that is due.
    fn step(&mut self) -> Result<()> {
        let due = match self.schedule.redraw {
            Redraw::Changed | Redraw::NodesArriving => true,
            Redraw::FullResolution => self.schedule.changed.elapsed() >= IDLE_DELAY,
            Redraw::Nothing => false,
        };
        if due && self.schedule.show_due && self.schedule.took > SLOW {
            self.show_again()?;
        }
        if due && self.draw()? {
            return Ok(());
        }
        match self.schedule.redraw {
            _ if self.schedule.show_due => self.show_again(),
            Redraw::Nothing
                if self.schedule.count_due.is_some()
                    && self.schedule.changed.elapsed() >= IDLE_DELAY =>
            {
                self.count_points()
            }
            Redraw::Nothing => self.save_step(),
            _ => Ok(()),
        }
    }

    /// Counts the points of the last frame, once it is at rest: while moving there is no time for
    /// another pass over them.
    fn count_points(&mut self) -> Result<()> {
        let Some(one_sided) = self.schedule.count_due.take() else { return Ok(()) };
        self.restore_scene()?;
        // If nodes are arriving, the frame that has them is counted.
        if self.schedule.redraw != Redraw::Nothing {
            return Ok(());
        }
        let (Some(scene), Some(cloud), Some(present)) = (&self.scene, self.cloud, &self.present)
        else {
            return Ok(());
        };
        let view = self.viewport.view_of(scene.camera, present.size())?;
        let (gpu, cloud) = self.renderer.cloud(cloud)?;
        let mut g = Graph::new(gpu);
        let Ok(points) = project::draw(&mut g, &view, cloud.resident(), scene.settings.precision)
        else {
            // Drawing reports the same error.
            return Ok(());
        };
        let points = points.one_sided(one_sided);
        let counted = count_visible::record(&mut g, &view, &points);
        let frame = g.submit_and_wait(&[])?;
        (self.report)(RenderEvent::Counted(counted.points(&frame)));
        Ok(())
    }
}
