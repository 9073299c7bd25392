//! DRAWING THREAD: the newest that the window wants in, pictures on the screen and reports of them out.
//!
//! The window's thread never waits for the device: it posts what it wants, and goes on. This one drains what was posted, keeps the newest, and
//!   draws where that is another picture than the last: smaller while it keeps changing (dynamic_resolution.rs), and once as large as the window when it has stopped;
//!   brings a cloud that was opened to the device, a few milliseconds of it between two pictures, so that the old one is flown through until the new one is there;
//!   draws again while nodes of an index arrive, and while a picture at rest is refined ([`FrameConfig::progressive`]); then sleeps until something is posted. A picture that nobody looks at any more is not drawn twice.
//! One picture at a time is on the device. As soon as it is there the window's thread is told, which moves the camera on: where that is by then is drawn next. So whatever hands do is on
//! the screen after what is left of one picture and one more; a second one waiting on the device would show where the camera was before.
//!
//! How long a picture takes is what passes until it is there. Timestamps of passes do not tell: those of a software device are all taken at the end once anything has been rasterised, as panels are.

mod saving;

use super::cancel::CancelToken;
use super::dynamic_resolution::{ResolutionScale, divided};
use super::opening::{Said, Watch};
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
use crate::resident::residency::Update;
use crate::resident::section::Slab;
use crate::resident::{Point, Resident};
use crate::source::{Brought, Prepared};
use crate::view::View;
use glam::DVec2;
use saving::{Former, Saving};
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A cloud that is to go to the device, some of it between two pictures, what is to be said of it then, and who is told how far it is.
pub struct Bring {
    pub prepared: Prepared,
    pub said: Said,
    pub pool_bytes: u64,
    pub watch: Watch,
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
    Bring(Box<Bring>),
    /// The point of an id in the last picture.
    Pick {
        id: u32,
        at: DVec2,
        adds: bool,
    },
    /// The points of a slab.
    Section(Slab),
    /// The picture as it is asked for now, of so many pixels, to a file: PNG, or with all its layers EXR.
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
pub enum Report {
    /// A picture is on its way: what moves by itself may move on.
    Begun,
    Drawn(Box<Drawn>),
    /// Points in the last picture, where filters or clip boxes leave some out.
    Counted(u64),
    /// A cloud is on the device, of which this is to be said.
    Brought(Box<Said>, CancelToken),
    /// It is not, and why.
    NotBrought(Error, CancelToken),
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
    Doing(String),
    Saved(PathBuf),
    /// What is not there, and why.
    NotSaved(PathBuf, Error),
    /// Work goes on without it.
    Failed(Error),
    /// This thread has ended.
    Ended(Error),
}

/// A picture on the screen.
pub struct Drawn {
    pub pick_buffer: Arc<PickBuffer>,
    pub decided: Decided,
    /// What was asked for and changes nothing, or was more than there is room for.
    pub notes: Vec<String>,
    pub statistics: Statistics,
    /// Filters or clip boxes may leave some of its points out.
    pub leaves_out: bool,
    /// Milliseconds on the device of every pass.
    pub passes: Vec<(String, f64)>,
    /// As large as the window, and all that the view shows of the cloud, and no other one on its way.
    pub whole: bool,
    /// Of an index.
    pub loading: Option<Loading>,
    /// What the time went into, until it was on the screen.
    pub spent: Spent,
    /// From when it was wanted to when it was there.
    pub latency: Duration,
    /// Of that, drawing it.
    pub took: Duration,
    /// Messages that were heard before it was begun ([`Drawing::is_newest`]).
    pub heard: u64,
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
pub struct Spent {
    /// Making the swapchain fit the window.
    pub fitting: Duration,
    /// Taking in nodes that had come, and asking for others: all that the loader costs whoever draws.
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

impl Drawn {
    /// Whether nodes are still on their way.
    pub fn is_loading(&self) -> bool {
        self.loading.is_some_and(|loading| loading.awaited > 0)
    }
}

/// The thread, as the window's thread has it.
pub struct Drawing {
    posts: Sender<Message>,
    posted: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

impl Drawing {
    pub fn start(
        gpu: Gpu,
        present: Present,
        report: impl Fn(Report) + Send + Sync + 'static,
    ) -> Result<Drawing> {
        let (posts, posted) = channel();
        let count = Arc::new(AtomicU64::new(0));
        let thread = Thread {
            gpu,
            present: Some(present),
            window: [0, 0],
            posted,
            count: count.clone(),
            heard: 0,
            report: Box::new(report),
            bringing: None,
            cloud: None,
            scene: None,
            changed: Instant::now(),
            asked: Instant::now(),
            wanted: Wanted::Nothing,
            again: false,
            scale: ResolutionScale::default(),
            last_drawn: Vec::new(),
            saving: VecDeque::new(),
            former: VecDeque::new(),
            elsewhere: false,
            uncounted: None,
        };
        let thread = std::thread::Builder::new().name("drawing".into()).spawn(move || thread.run());
        let thread = thread
            .map_err(|error| Error::Device(format!("cannot start a thread to draw: {error}")))?;
        Ok(Drawing { posts, posted: count, thread: Some(thread) })
    }

    pub fn post(&self, message: Message) {
        self.posted.fetch_add(message.is_newer() as u64, Relaxed);
        // A thread that has ended has reported why.
        let _ = self.posts.send(message);
    }

    /// Whether all that was posted had been heard then.
    pub fn is_newest(&self, heard: u64) -> bool {
        self.posted.load(Relaxed) == heard
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
enum Wanted {
    Nothing,
    /// The same as on the screen, larger, once nothing has changed for a while.
    Whole,
    /// Nodes are on their way.
    More,
    /// Something else than on the screen.
    Now,
}

/// Who lets go of the mouse for so long has stopped.
const STILL: Duration = Duration::from_millis(150);

/// Between two looks at what the loader has brought.
const LOADING: Duration = Duration::from_millis(10);

struct Thread {
    gpu: Gpu,
    /// Taken at the end.
    present: Option<Present>,
    /// The window's size, pixels, as the system has told it.
    window: [u32; 2],
    posted: Receiver<Message>,
    /// Messages posted that want another picture, and those heard.
    count: Arc<AtomicU64>,
    heard: u64,
    report: Box<dyn Fn(Report) + Send + Sync>,
    /// On its way to the device.
    bringing: Option<Box<Bring>>,
    cloud: Option<Brought>,
    scene: Option<Scene>,
    /// When what is to be seen last changed.
    changed: Instant,
    /// When that was wanted.
    asked: Instant,
    wanted: Wanted,
    /// The picture on the screen is to be shown again, under another panel.
    again: bool,
    scale: ResolutionScale,
    /// What the last picture was drawn from ([`crate::resident::Resident::identity`]).
    last_drawn: Vec<u64>,
    /// Pictures on their way into files, one after the other.
    saving: VecDeque<Saving>,
    /// What the first of them are of, where the window shows another cloud by now.
    former: VecDeque<Former>,
    /// What is to be seen of the window's cloud is what a picture that is being saved shows, not the window's.
    elsewhere: bool,
    /// Filters or clip boxes leave points out of the picture on the screen, and nobody has counted the others; whether those that face away are not there.
    uncounted: Option<bool>,
}

/// Stops a whole picture on a software device, where it takes long, when something newer is wanted.
struct Newer<'t> {
    count: &'t AtomicU64,
    heard: u64,
}

impl Progress for Newer<'_> {
    fn tick(&self, _doing: &str, _done: u64, _total: u64) -> Result<()> {
        if self.count.load(Relaxed) > self.heard { Err(Error::Interrupted) } else { Ok(()) }
    }
}

/// Samples of the light cast in a row at most, while a picture of those before is on the screen.
const REFINING: Duration = Duration::from_millis(100);

/// Adds samples of the light to those that shadows are made of, until something newer is wanted; in submissions of their own, so that what has been cast stays when the picture gives way.
fn refine_shadows(
    gpu: &mut Gpu,
    view: &View,
    resident: &Resident,
    config: &FrameConfig,
    newer: &Newer,
) -> Result<()> {
    let (scene, began) = (config.scene(view, resident), Instant::now());
    loop {
        let mut g = Graph::new(gpu);
        let marks = match shadows::marks(
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
        let Some(shadows::Marks { counts, saved: None, facts, .. }) = marks else { return Ok(()) };
        g.submit_and_wait(&[counts.resource()])?.recycle(gpu);
        if facts.cast == facts.samples
            || began.elapsed() >= REFINING
            || newer.tick("", 0, 0).is_err()
        {
            return Ok(());
        }
    }
}

/// What is asked for of a picture of a cloud; until its strokes are found it is drawn without.
fn settings(scene: &Scene, resident: &Resident) -> RenderSettings {
    let mut settings = scene.settings.clone();
    if brushes_lack(scene, resident) {
        settings.effects.strokes.switch = Switch::Off;
    }
    settings
}

/// Whether it is to be painted, and what brushes need is not known yet.
fn brushes_lack(scene: &Scene, resident: &Resident) -> bool {
    scene.settings.effects.strokes.switch == Switch::On && resident.shown.strokes().is_none()
}

impl Thread {
    fn run(mut self) {
        let ended = match catch_unwind(AssertUnwindSafe(|| self.serve())) {
            Ok(ended) => ended,
            // It has been printed where it happened. What the device may still be at work with stays.
            Err(_panic) => {
                (self.report)(Report::Ended(Error::Device(
                    "drawing has ended by a mistake in this program, which is said above".into(),
                )));
                return std::mem::forget(self);
            }
        };
        self.give_up_saving();
        self.give_up_bringing();
        let present = self.present.take().expect("taken here only");
        present.free(&mut self.gpu);
        if let Some(cloud) = self.cloud.take() {
            cloud.free(&mut self.gpu);
        }
        if let Err(error) = ended.and_then(|()| self.gpu.device.take_validation_errors()) {
            (self.report)(Report::Ended(error));
        }
    }

    /// Until it is to close.
    fn serve(&mut self) -> Result<()> {
        loop {
            let first = match self.rest() {
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
                self.heard += message.is_newer() as u64;
                if matches!(message, Message::Close) {
                    return Ok(());
                }
                self.hear(message)?;
                next = self.posted.try_recv().ok();
            }
            self.step()?;
            self.bring_on()?;
        }
    }

    /// How long there is nothing to do, if nothing is posted; none: for ever.
    fn rest(&self) -> Option<Duration> {
        let by_wanted = match self.wanted {
            Wanted::Now => Some(Duration::ZERO),
            Wanted::More => Some(LOADING),
            Wanted::Whole => Some(STILL.saturating_sub(self.changed.elapsed())),
            Wanted::Nothing if self.uncounted.is_some() => {
                Some(STILL.saturating_sub(self.changed.elapsed()))
            }
            Wanted::Nothing if !self.saving.is_empty() => Some(Duration::ZERO),
            Wanted::Nothing => None,
        };
        if self.again || self.bringing.is_some() { Some(Duration::ZERO) } else { by_wanted }
    }

    fn hear(&mut self, message: Message) -> Result<()> {
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
                self.again = true;
            }
            Message::Bring(bring) => {
                // Nobody waits any more for another one.
                self.give_up_bringing();
                self.bringing = Some(bring);
            }
            Message::Pick { id, at, adds } => {
                self.look_back()?;
                // Ids are of the picture that was drawn last; where nodes have come since, they are others.
                let resident = self
                    .cloud
                    .as_ref()
                    .map(Brought::resident)
                    .filter(|resident| resident.identity() == self.last_drawn);
                match resident {
                    Some(resident) => {
                        let point = resident.point(&mut self.gpu, id)?;
                        point
                            .into_iter()
                            .for_each(|point| (self.report)(Report::Picked { point, adds }));
                    }
                    None => (self.report)(Report::PickLater { at, adds }),
                }
            }
            Message::Section(slab) => {
                self.look_back()?;
                if let Some(resident) = self.cloud.as_ref().map(Brought::resident) {
                    (self.report)(Report::Profile(Box::new(Profile::new(
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

    /// Some more of the cloud that is on its way; beside the one in the window, and one at most that pictures are saved of.
    fn bring_on(&mut self) -> Result<()> {
        let Some(mut bring) = self.bringing.take_if(|_| self.former.is_empty()) else {
            return Ok(());
        };
        let brought = match bring.prepared.step(&mut self.gpu, &bring.watch) {
            Ok(true) => {
                self.bringing = Some(bring);
                return Ok(());
            }
            Ok(false) => bring.prepared.finish(&mut self.gpu, bring.pool_bytes),
            Err(error) => {
                bring.prepared.free(&mut self.gpu);
                Err(error)
            }
        };
        match brought {
            Ok(cloud) => {
                if let Some(old) = self.cloud.replace(cloud) {
                    self.leave(old);
                }
                (self.report)(Report::Brought(Box::new(bring.said), bring.watch.token));
                self.change(Instant::now());
            }
            // Nobody waits for it any more.
            Err(Error::Interrupted) => {}
            Err(error) if error.is_lost_device() => return Err(error),
            Err(error) => {
                (self.report)(Report::NotBrought(error, bring.watch.token));
                self.change(Instant::now());
            }
        }
        Ok(())
    }

    fn give_up_bringing(&mut self) {
        self.bringing.take().into_iter().for_each(|bring| bring.prepared.free(&mut self.gpu));
    }

    fn change(&mut self, asked: Instant) {
        // What has not been drawn yet waits since it was first asked for.
        if self.wanted != Wanted::Now {
            self.asked = asked;
        }
        self.changed = Instant::now();
        self.wanted = Wanted::Now;
    }

    /// One thing that is to be done.
    fn step(&mut self) -> Result<()> {
        let due = match self.wanted {
            Wanted::Now | Wanted::More => true,
            Wanted::Whole => self.changed.elapsed() >= STILL,
            Wanted::Nothing => false,
        };
        if due && self.draw()? {
            return Ok(());
        }
        match self.wanted {
            _ if self.again => self.show_again(),
            Wanted::Nothing if self.uncounted.is_some() && self.changed.elapsed() >= STILL => {
                self.count()
            }
            Wanted::Nothing => self.save_on(),
            _ => Ok(()),
        }
    }

    /// The points of the picture on the screen, once it rests: a moving one has no time for another walk over them.
    fn count(&mut self) -> Result<()> {
        let Some(one_sided) = self.uncounted.take() else { return Ok(()) };
        self.look_back()?;
        // Where nodes are on their way, the picture that has them is counted.
        if self.wanted != Wanted::Nothing {
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
        (self.report)(Report::Counted(counted.points(&frame)));
        frame.recycle(&mut self.gpu);
        Ok(())
    }

    /// The same picture, under another panel.
    fn show_again(&mut self) -> Result<()> {
        self.again = false;
        let present = self.present.as_mut().expect("taken at the end");
        if !present.fit(&mut self.gpu, self.window)? || !present.show(&self.gpu)? {
            self.change(Instant::now());
        }
        Ok(())
    }

    /// One picture; false where there is nothing new to show.
    fn draw(&mut self) -> Result<bool> {
        let present = self.present.as_mut().expect("taken at the end");
        let (mut spent, fitting) = (Spent::default(), Instant::now());
        if !present.fit(&mut self.gpu, self.window)? {
            // Whoever uncovers the window says so.
            (self.wanted, self.again) = (Wanted::Nothing, false);
            return Ok(false);
        }
        let (Some(scene), Some(cloud)) = (&self.scene, &mut self.cloud) else {
            self.wanted = Wanted::Nothing;
            return self.blank().map(|()| true);
        };
        cloud.leave_out(scene.opacities.clone(), scene.clips.clone());
        self.elsewhere = false;
        spent.fitting = fitting.elapsed();
        let divisor = if self.wanted == Wanted::Now { self.scale.divisor } else { 1 };
        let size = divided(present.size(), divisor);
        let view = View::new(scene.camera, size)?;
        let (mut loading, taking_in) = (None, Instant::now());
        if let Brought::Parts(residency) = cloud {
            let detail = scene.fineness.of(size);
            let update = match self.wanted {
                Wanted::Now => residency.update_moving(&mut self.gpu, &view, &detail)?,
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
                .for_each(|error| (self.report)(Report::Failed(Error::Request(error))));
        }
        let complete = loading.is_none_or(|loading| loading.awaited == 0);
        spent.taking_in = taking_in.elapsed();
        let recording = Instant::now();
        let resident = cloud.resident();
        let identity = resident.identity();
        if self.wanted == Wanted::More
            && identity == self.last_drawn
            && !complete
            && !present.is_blank()
        {
            return Ok(false);
        }
        let newer = Newer { count: &self.count, heard: self.heard };
        // What is only a finer picture of the same gives way.
        let gives_way = self.wanted != Wanted::Now;
        // By the whole picture: a smaller one has more points a pixel, and would call for other effects.
        let mut config = FrameConfig::new(
            &settings(scene, resident),
            &View::new(scene.camera, present.size())?,
            resident,
        );
        if brushes_lack(scene, resident) {
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
                    // Something newer is wanted, which is heard next.
                    Error::Interrupted => Ok(true),
                    // What was asked for cannot be drawn; the picture that is there stays until something else is asked for.
                    Error::Request(_) => {
                        (self.report)(Report::Failed(error));
                        self.wanted = Wanted::Nothing;
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
            [&outcome.layers.depth, &outcome.layers.index].map(|layer| g.download(layer));
        spent.recording = recording.elapsed();
        let (began, heard) = (Instant::now(), self.heard);
        let running = match g.submit_async(&[screen.words.resource()]) {
            Ok(running) => running,
            // Something newer is wanted, which is heard next.
            Err(Error::Interrupted) => return Ok(true),
            Err(error) => return Err(error),
        };
        (self.report)(Report::Begun);
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
            .layers
            .marks
            .as_ref()
            .is_none_or(|marks| marks.facts.cast == marks.facts.samples);
        let finest = divisor == 1 && drawn.effects == config.effects && lit && ordered;
        self.wanted = match (finest, complete) {
            (true, true) => Wanted::Nothing,
            (true, false) => Wanted::More,
            _ => Wanted::Whole,
        };
        self.again = false;
        self.uncounted =
            cloud.resident().leaves_out().then(|| config.drops_back_faces(cloud.resident()));
        (spent.drawing, spent.reading_back) = (took, reading_back.elapsed());
        let showing = Instant::now();
        if !present.show(&self.gpu)? {
            self.wanted = Wanted::Now;
        }
        spent.showing = showing.elapsed();
        if let (Some(loading), Brought::Parts(residency)) = (&mut loading, cloud) {
            loading.worked = residency.loader_worked();
        }
        let (decided, statistics, latency) =
            (config.decided, outcome.statistics, self.asked.elapsed());
        let (whole, leaves_out) =
            (finest && complete && self.bringing.is_none(), self.uncounted.is_some());
        (self.report)(Report::Drawn(Box::new(Drawn {
            pick_buffer,
            decided,
            notes,
            statistics,
            leaves_out,
            passes,
            whole,
            loading,
            spent,
            latency,
            took,
            heard,
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
        self.again = false;
        if !present.show(&self.gpu)? {
            self.wanted = Wanted::Now;
        }
        Ok(())
    }
}
