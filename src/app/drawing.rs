//! DRAWING THREAD: the newest that the window wants in, pictures on the screen and reports of them out.
//!
//! The window's thread never waits for the device: it posts what it wants, and goes on. This one drains what was posted, keeps the newest, and
//!   draws where that is another picture than the last: smaller while it keeps changing (pace.rs), and once as large as the window when it has stopped;
//!   draws again while nodes of an index arrive; then sleeps until something is posted. A picture that nobody looks at any more is not drawn twice.
//! While one picture is drawn the next is recorded ([`crate::graph::Running`]), and no more, so that what is seen is not far behind the hand.

use super::pace::{Pace, divided};
use super::seen::Seen;
use crate::cut::Detail;
use crate::error::{Error, Result};
use crate::frame;
use crate::graph::{Buffer, Gpu, Graph, Handle, Running};
use crate::look;
use crate::passes::encode::{self, Screen};
use crate::passes::{Decided, project::Statistics};
use crate::present::overlay::Overlay;
use crate::present::{Present, UNDER_WAY};
use crate::progress::Progress;
use crate::resident::Point;
use crate::scene::Scene;
use crate::source::Brought;
use crate::view::View;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Brings a cloud to the device.
pub type Bring = Box<dyn FnOnce(&mut Gpu) -> Result<Brought> + Send>;

/// From the window's thread.
pub enum Message {
    Scene(Box<Scene>),
    /// The window has another size, or was uncovered.
    Exposed,
    /// What lies over the picture.
    Panel(Box<Overlay>),
    /// Work that needs the device, such as bringing an opened cloud to it; what it brings replaces what there was.
    Bring(Bring),
    /// The point of an id in the last picture.
    Pick {
        id: u32,
        adds: bool,
    },
    /// The picture as it is asked for now, to a file.
    Save(PathBuf),
    Close,
}

/// To the window's thread.
pub enum Report {
    Drawn(Box<Drawn>),
    /// A cloud is on the device.
    Brought,
    Picked {
        point: Point,
        adds: bool,
    },
    Saved(PathBuf),
    /// Work goes on without it.
    Failed(Error),
    /// This thread has ended.
    Ended(Error),
}

/// A picture on the screen.
pub struct Drawn {
    pub seen: Arc<Seen>,
    pub decided: Decided,
    pub statistics: Statistics,
    /// Milliseconds on the device of every pass.
    pub passes: Vec<(String, f64)>,
    /// As large as the window, and all that the view shows of the cloud.
    pub whole: bool,
    /// From posting what it shows to the end of drawing it.
    pub latency: Duration,
}

/// The thread, as the window's thread has it.
pub struct Drawing {
    posts: Sender<Message>,
    posted: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

impl Drawing {
    pub fn start(gpu: Gpu, present: Present, detail: DetailOf, report: impl Fn(Report) + Send + 'static) -> Result<Drawing> {
        let (posts, posted) = channel();
        let count = Arc::new(AtomicU64::new(0));
        let thread = Thread {
            gpu,
            present: Some(present),
            detail,
            posted,
            count: count.clone(),
            heard: 0,
            report: Box::new(report),
            cloud: None,
            scene: None,
            changed: Instant::now(),
            wanted: Wanted::Nothing,
            again: false,
            pace: Pace::default(),
            flights: VecDeque::new(),
            last_drawn: Vec::new(),
        };
        let thread = std::thread::Builder::new().name("drawing".into()).spawn(move || thread.run());
        let thread = thread.map_err(|error| Error::Device(format!("cannot start a thread to draw: {error}")))?;
        Ok(Drawing { posts, posted: count, thread: Some(thread) })
    }

    pub fn post(&self, message: Message) {
        self.posted.fetch_add(1, Relaxed);
        // A thread that has ended has reported why.
        let _ = self.posts.send(message);
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

/// How fine a picture of a size is to be.
pub type DetailOf = Box<dyn Fn([u32; 2]) -> Detail + Send>;

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

/// A frame under way.
struct Flight {
    running: Running,
    view: View,
    decided: Decided,
    statistics: Statistics,
    depth: Buffer,
    index: Buffer,
    divisor: u32,
    whole: bool,
    asked: Instant,
}

struct Thread {
    gpu: Gpu,
    /// Taken at the end.
    present: Option<Present>,
    detail: DetailOf,
    posted: Receiver<Message>,
    /// Messages posted, and those heard.
    count: Arc<AtomicU64>,
    heard: u64,
    report: Box<dyn Fn(Report) + Send>,
    cloud: Option<Brought>,
    scene: Option<Scene>,
    /// When what is to be seen last changed.
    changed: Instant,
    wanted: Wanted,
    /// The picture on the screen is to be shown again, under another panel.
    again: bool,
    pace: Pace,
    flights: VecDeque<Flight>,
    /// What the last picture was drawn from ([`crate::resident::Resident::identity`]).
    last_drawn: Vec<u64>,
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

impl Thread {
    fn run(mut self) {
        let ended = self.serve();
        let landed = self.land(0);
        let present = self.present.take().expect("taken here only");
        present.free(&mut self.gpu);
        if let Some(cloud) = self.cloud.take() {
            cloud.free(&mut self.gpu);
        }
        if let Err(error) = ended.and(landed).and_then(|()| self.gpu.device.objections()) {
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
                self.heard += 1;
                if matches!(message, Message::Close) {
                    return Ok(());
                }
                self.hear(message)?;
                next = self.posted.try_recv().ok();
            }
            self.step()?;
        }
    }

    /// How long there is nothing to do, if nothing is posted; none: for ever.
    fn rest(&self) -> Option<Duration> {
        let by_wanted = match self.wanted {
            Wanted::Now => Some(Duration::ZERO),
            Wanted::More => Some(LOADING),
            Wanted::Whole => Some(STILL.saturating_sub(self.changed.elapsed())),
            Wanted::Nothing => None,
        };
        if self.flights.is_empty() && !self.again { by_wanted } else { Some(Duration::ZERO) }
    }

    fn hear(&mut self, message: Message) -> Result<()> {
        match message {
            Message::Scene(scene) => {
                if self.scene.as_ref() != Some(&*scene) {
                    self.scene = Some(*scene);
                    self.change();
                }
            }
            Message::Exposed => self.change(),
            Message::Panel(overlay) => {
                self.present.as_mut().expect("taken at the end").lay_over(&self.gpu, *overlay)?;
                self.again = true;
            }
            Message::Bring(bring) => {
                self.land(0)?;
                match bring(&mut self.gpu) {
                    Ok(cloud) => {
                        if let Some(old) = self.cloud.replace(cloud) {
                            old.free(&mut self.gpu);
                        }
                        (self.report)(Report::Brought);
                        self.change();
                    }
                    // Nobody waits for it any more.
                    Err(Error::Interrupted) => {}
                    Err(error) => (self.report)(Report::Failed(error)),
                }
            }
            Message::Pick { id, adds } => {
                self.land(0)?;
                // Ids are of the picture that was drawn last; where nodes have come since, they are others.
                let resident = self.cloud.as_ref().map(Brought::resident).filter(|resident| resident.identity() == self.last_drawn);
                if let Some(point) = resident.and_then(|resident| resident.point(id)) {
                    (self.report)(Report::Picked { point, adds });
                }
            }
            Message::Save(path) => self.save(path)?,
            Message::Close => {}
        }
        Ok(())
    }

    fn change(&mut self) {
        self.changed = Instant::now();
        self.wanted = Wanted::Now;
    }

    /// One thing that is to be done.
    fn step(&mut self) -> Result<()> {
        // What is only finer waits until the coarser picture is reported.
        let due = match self.wanted {
            Wanted::Now => self.flights.len() < UNDER_WAY,
            Wanted::More => self.flights.is_empty(),
            Wanted::Whole => self.flights.is_empty() && self.changed.elapsed() >= STILL,
            Wanted::Nothing => false,
        };
        if due {
            return self.draw();
        }
        if self.again {
            let present = self.present.as_mut().expect("taken at the end");
            let before = present.size();
            if present.fit(&mut self.gpu)? && present.size() == before && present.show(&self.gpu)? {
                self.again = false;
                return Ok(());
            }
            self.again = false;
            self.change();
        }
        self.land(self.flights.len().saturating_sub(1))
    }

    fn draw(&mut self) -> Result<()> {
        let present = self.present.as_mut().expect("taken at the end");
        if !present.fit(&mut self.gpu)? {
            // Whoever uncovers the window says so.
            (self.wanted, self.again) = (Wanted::Nothing, false);
            return Ok(());
        }
        let (Some(scene), Some(cloud)) = (&self.scene, &mut self.cloud) else {
            self.wanted = Wanted::Nothing;
            return self.blank();
        };
        cloud.resident_mut().opacities = scene.opacities.clone();
        let divisor = if self.wanted == Wanted::Now { self.pace.divisor } else { 1 };
        let size = divided(present.size(), divisor);
        let view = View::new(scene.camera, size)?;
        let mut complete = true;
        if let Brought::Parts(residency) = cloud {
            let update = residency.update(&mut self.gpu, &view, &(self.detail)(size))?;
            complete = update.is_complete();
            update.errors.into_iter().for_each(|error| (self.report)(Report::Failed(Error::Request(error))));
        }
        let resident = cloud.resident();
        let identity = resident.identity();
        if self.wanted == Wanted::More && identity == self.last_drawn && !complete {
            return Ok(());
        }
        let newer = Newer { count: &self.count, heard: self.heard };
        // What is only a finer picture of the same gives way.
        let gives_way = self.wanted != Wanted::Now;
        let look = look::decide(&scene.wishes, &view, resident);
        let mut g = Graph::new(&mut self.gpu);
        if gives_way {
            g = g.watched(&newer);
        }
        let outcome = frame::record(&mut g, &view, resident, &look)?;
        let mut screen = Screen { words: g.import("screen", present.screen()), size: present.size(), blue_first: present.blue_first() };
        encode::record(&mut g, &outcome.picture, &mut screen)?;
        let [depth, index] = [&outcome.layers.depth, &outcome.layers.index].map(|layer| g.download(layer));
        let running = match g.launch(&[screen.words.resource()]) {
            Ok(running) => running,
            // Something newer is wanted, which is heard next.
            Err(Error::Interrupted) => return Ok(()),
            Err(error) => return Err(error),
        };
        let whole = divisor == 1 && complete;
        self.last_drawn = identity;
        self.flights.push_back(Flight {
            running,
            view,
            decided: look.decided,
            statistics: outcome.statistics,
            depth,
            index,
            divisor,
            whole,
            asked: self.changed,
        });
        self.wanted = match (divisor, complete) {
            (1, true) => Wanted::Nothing,
            (1, false) => Wanted::More,
            _ => Wanted::Whole,
        };
        self.again = false;
        if !present.show(&self.gpu)? {
            self.wanted = Wanted::Now;
        }
        Ok(())
    }

    /// Shows the background alone.
    fn blank(&mut self) -> Result<()> {
        let present = self.present.as_mut().expect("taken at the end");
        let [red, green, blue] = self.scene.as_ref().map_or(crate::config::BACKGROUND, |scene| scene.wishes.background).map(u32::from);
        let word = if present.blue_first() { blue | green << 8 | red << 16 } else { red | green << 8 | blue << 16 };
        let mut g = Graph::new(&mut self.gpu);
        let mut screen = g.import("screen", present.screen());
        g.fill(&mut screen, word | 255 << 24);
        g.submit(&[screen.resource()])?.shelve(&mut self.gpu);
        present.show(&self.gpu)?;
        Ok(())
    }

    /// Waits until no more than so many frames are under way.
    fn land(&mut self, most: usize) -> Result<()> {
        while self.flights.len() > most {
            let Flight { running, view, decided, statistics, depth, index, divisor, whole, asked } =
                self.flights.pop_front().expect("counted");
            let frame = running.finish(&mut self.gpu)?;
            let seen = Seen { view, depth: frame.read(&depth).to_vec(), index: frame.read(&index).to_vec() };
            let passes = frame.passes.clone();
            frame.shelve(&mut self.gpu);
            self.pace = self.pace.after(divisor, passes.iter().map(|(_, ms)| ms).sum());
            let latency = asked.elapsed();
            (self.report)(Report::Drawn(Box::new(Drawn { seen: Arc::new(seen), decided, statistics, passes, whole, latency })));
        }
        Ok(())
    }

    /// By the same steps as `render`, so to the same bytes.
    fn save(&mut self, path: PathBuf) -> Result<()> {
        self.land(0)?;
        let (Some(scene), Some(cloud), Some(present)) = (&self.scene, &mut self.cloud, &self.present) else { return Ok(()) };
        let view = View::new(scene.camera, present.size())?;
        cloud.resident_mut().opacities = scene.opacities.clone();
        cloud.settle(&mut self.gpu, &view, &(self.detail)(view.size), &crate::progress::Silent)?;
        let look = look::decide(&scene.wishes, &view, cloud.resident());
        let mut g = Graph::new(&mut self.gpu);
        let outcome = frame::record(&mut g, &view, cloud.resident(), &look)?;
        let picture = encode::download(&mut g, &outcome.picture)?;
        let frame = g.submit(&[])?;
        let written = crate::picture::write_png(&path, view.size, &picture.read(&frame));
        frame.shelve(&mut self.gpu);
        (self.report)(match written {
            Ok(()) => Report::Saved(path),
            Err(error) => Report::Failed(error),
        });
        Ok(())
    }
}
