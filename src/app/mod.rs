//! THE WINDOW: events in, messages to the drawing thread out.
//!
//! ```text
//!     events -> navigation -> camera --.
//!     keys, files dropped -------------+-> drawing thread -> window
//!     opening thread -> cloud ---------'         |
//!         ^--- what the picture shows, and how long it took
//! ```
//! This thread only reacts: it waits for events, and while nobody touches anything nothing is drawn.

mod boxes;
pub mod deeds;
pub mod drawing;
mod events;
mod files;
pub mod flight;
mod hands;
pub mod keys;
mod lamp;
mod legend;
mod looking_up;
pub mod measure;
mod motion;
pub mod navigation;
pub mod opening;
mod options;
pub mod pace;
pub mod panel;
pub mod profile;
mod reports;
pub mod seen;
pub mod statistics;

use crate::cloud::attribute::Attribute;
use crate::cloud::find::Record;
use crate::error::{Error, Result};
use crate::passes::Switch;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::view::Camera;
use drawing::{Drawing, Message, Report};
use flight::Flight;
use glam::{DVec2, DVec3};
use navigation::{Modifiers, Navigation};
use opening::{Opened, Said};
pub use options::Options;
use panel::{Facts, Panel};
use seen::Seen;
use statistics::{Statistics, Summary};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use winit::event_loop::{EventLoop, EventLoopProxy};
use winit::window::Window;

/// From the other threads.
enum Event {
    Progress(String),
    Opened(Result<Box<Opened>>),
    /// The record of the point in this place, where there is one.
    LookedUp(DVec3, Result<Option<Record>>),
    Report(Report),
    /// Ctrl-C in the terminal.
    Interrupted,
}

/// Opens a window, and returns when it is closed, from within or by `progress`.
pub fn run(mut options: Options, progress: &dyn Progress) -> Result<Summary> {
    options.further.strokes = false;
    let no_window = |error| Error::Device(format!("cannot open a window ({error}); `render` needs none"));
    let events = EventLoop::<Event>::with_user_event().build().map_err(no_window)?;
    let interrupted = events.create_proxy();
    progress.when_interrupted(Box::new(move || drop(interrupted.send_event(Event::Interrupted))));
    let mut app = App {
        navigation: Navigation::new(options.habit, options.size),
        statistics: Statistics::new(options.began),
        events: events.create_proxy(),
        abandoned: Arc::new(AtomicBool::new(false)),
        forgotten: Arc::new(AtomicBool::new(false)),
        openings: Vec::new(),
        origins: Vec::new(),
        coming: None,
        files: options.files.clone(),
        last_opened: None,
        facts: Facts { path: options.path.clone(), enlarged: options.enlarged, ..Facts::default() },
        titled: String::new(),
        promised: Vec::new(),
        panel: None,
        laid_out: None,
        scene: options.scene.clone(),
        window: None,
        size: options.size,
        drawing: None,
        waits: false,
        framed: false,
        glimpsed: None,
        seen: None,
        cursor: DVec2::ZERO,
        modifiers: Modifiers::default(),
        clicked: None,
        picks_later: None,
        pressed: None,
        flight: options.flight.map(Flight::new),
        moved: options.began,
        moves: None,
        played: Duration::ZERO,
        lost: None,
        ended: None,
        options,
    };
    events.run_app(&mut app).map_err(no_window)?;
    match app.ended {
        Some(error) => Err(error),
        None => Ok(app.statistics.summary(app.flight.as_ref())),
    }
}

struct App {
    options: Options,
    events: EventLoopProxy<Event>,
    window: Option<Arc<Window>>,
    /// Pixels, as the system has told them: who asks a window that somebody else has destroyed ends the program.
    size: [u32; 2],
    drawing: Option<Drawing>,
    navigation: Navigation,
    statistics: Statistics,
    /// Tells the opening thread that nobody waits for it.
    abandoned: Arc<AtomicBool>,
    /// Tells threads that look points up that nobody waits for them.
    forgotten: Arc<AtomicBool>,
    openings: Vec<JoinHandle<()>>,
    /// The files that the points on the screen are from.
    origins: Vec<PathBuf>,
    /// What is to be said of the cloud on its way to the device.
    coming: Option<Said>,
    /// All that are open, or are being opened.
    files: Vec<PathBuf>,
    /// Those that were, as a whole, and what they were to show.
    last_opened: Option<(Vec<PathBuf>, Option<Attribute>)>,
    facts: Facts,
    /// What the window's title says.
    titled: String,
    /// Pictures that are on their way into files.
    promised: Vec<PathBuf>,
    panel: Option<Panel>,
    /// When the panel is to be laid out again by itself.
    laid_out: Option<Instant>,
    scene: Scene,
    /// For the whole of what is being opened.
    waits: bool,
    /// Somebody has chosen where to look from.
    framed: bool,
    /// From where a sample of what is being opened is seen, where nobody has chosen that.
    glimpsed: Option<Camera>,
    seen: Option<Arc<Seen>>,
    cursor: DVec2,
    modifiers: Modifiers,
    clicked: Option<(Instant, DVec2)>,
    /// A click that the next picture answers, and whether it adds a point.
    picks_later: Option<(DVec2, bool)>,
    /// Where the first button went down.
    pressed: Option<DVec2>,
    flight: Option<Flight>,
    /// When what moves by itself last did.
    moved: Instant,
    /// When it does again, where no picture asks for it.
    moves: Option<Instant>,
    /// How much of the path has been played.
    played: Duration,
    /// When the device was, last.
    lost: Option<Instant>,
    ended: Option<Error>,
}

impl App {
    fn post(&self, message: Message) {
        if let Some(drawing) = &self.drawing {
            drawing.post(message);
        }
    }

    fn post_scene(&mut self) {
        self.scene.camera = self.navigation.camera;
        let mut scene = Box::new(self.scene.clone());
        // Until its strokes are there, a cloud is drawn without.
        if self.paints_later() {
            scene.wishes.effects.strokes.switch = Switch::Off;
        }
        self.post(Message::Scene { scene, asked: Instant::now() });
    }

    /// Soon, and once however often it is asked for.
    fn ask_for_panel(&self) {
        if let Some(window) = &self.window {
            window.request_redraw();
        }
    }

    /// Of the window, no side of it zero.
    fn size(&self) -> [u32; 2] {
        self.size.map(|side| side.max(1))
    }

    fn trouble(&mut self, error: &Error) {
        eprintln!("pointillist: {error}");
        self.facts.trouble = Some(error.to_string());
    }
}
