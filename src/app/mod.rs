//! THE WINDOW: events in, messages to the render thread out.
//!
//! ```text
//!     events -> navigation -> camera --.
//!     keys, files dropped -------------+-> render thread -> window
//!     load thread -> cloud ---------'         |
//!         ^--- what the picture shows, and how long it took
//! ```
//! This thread only reacts: it waits for events, and while nobody touches anything nothing is drawn.

pub mod actions;
mod animation;
pub mod cancel;
mod clip_box_widget;
pub mod dynamic_resolution;
mod events;
mod files;
pub mod frame_stats;
mod input;
pub mod keys;
mod legend;
mod light_widget;
pub mod load_thread;
pub mod measure;
pub mod navigation;
mod options;
pub mod panel;
pub mod pick_buffer;
mod point_lookup;
pub mod profile;
mod render_events;
pub mod render_thread;
pub mod scripted_flight;

use crate::cloud::find::Record;
use crate::error::{Error, Result};
use crate::index::attributes::strokes::StrokeCache;
use crate::progress::Progress;
use crate::render::scene::Scene;
use crate::view::Camera;
use cancel::CancelToken;
use frame_stats::{FrameStats, Summary};
use glam::{DVec2, DVec3};
use load_thread::{LoadRequest, LoadedCloud, ProgressReporter};
use navigation::{Input, Modifiers, Navigation};
pub use options::Options;
use panel::{Panel, UiState};
use pick_buffer::PickBuffer;
use render_thread::{Message, RenderEvent, RenderThread};
use scripted_flight::ScriptedFlight;
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use winit::event_loop::{EventLoop, EventLoopProxy};
use winit::window::Window;

/// From the other threads.
enum Event {
    Progress(String, CancelToken),
    Loaded(Result<Box<LoadedCloud>>, CancelToken),
    /// The record of the point in this place, where there is one.
    LookedUp(DVec3, Result<Option<Record>>, CancelToken),
    Render(RenderEvent),
    /// Ctrl-C in the terminal.
    Interrupted,
}

/// Opens a window, and returns when it is closed, from within or by `progress`.
pub fn run(options: Options, progress: &dyn Progress) -> Result<Summary> {
    let no_window =
        |error| Error::Device(format!("cannot open a window ({error}); `render` needs none"));
    let events = EventLoop::<Event>::with_user_event().build().map_err(no_window)?;
    let interrupted = events.create_proxy();
    progress.when_interrupted(Box::new(move || drop(interrupted.send_event(Event::Interrupted))));
    let mut app = App {
        navigation: Navigation::new(options.style, options.size),
        stats: FrameStats::new(options.began),
        events: events.create_proxy(),
        load_token: CancelToken::default(),
        lookup_token: CancelToken::default(),
        workers: Vec::new(),
        strokes: Arc::default(),
        origins: Vec::new(),
        files: options.files.clone(),
        last_loaded: None,
        whole: None,
        loading: false,
        ui: UiState {
            path: options.path.clone(),
            save_size: options.save_size,
            ..UiState::default()
        },
        window_title: String::new(),
        pending_saves: Vec::new(),
        panel: None,
        panel_due: None,
        scene: options.scene.clone(),
        window: None,
        size: options.size,
        render_thread: None,
        framed: false,
        glimpsed: None,
        views: Vec::new(),
        pick_buffer: None,
        cursor: DVec2::ZERO,
        modifiers: Modifiers::default(),
        clicked: None,
        picks_later: None,
        pressed: None,
        flight: options.flight.map(ScriptedFlight::new),
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
        None => Ok(app.stats.summary(app.flight.as_ref())),
    }
}

struct App {
    options: Options,
    events: EventLoopProxy<Event>,
    window: Option<Arc<Window>>,
    /// Pixels, as the system has told them: who asks a window that somebody else has destroyed ends the program.
    size: [u32; 2],
    render_thread: Option<RenderThread>,
    navigation: Navigation,
    stats: FrameStats,
    /// What the load thread is at, and those that look points up.
    load_token: CancelToken,
    lookup_token: CancelToken,
    workers: Vec<JoinHandle<()>>,
    /// Those that were found of the files that are open.
    strokes: Arc<StrokeCache>,
    /// The files that the points on the screen are from.
    origins: Vec<PathBuf>,
    /// All that are open, or are being opened.
    files: Vec<PathBuf>,
    /// What was, as a whole.
    last_loaded: Option<LoadRequest>,
    /// What the picture shows, where that is a whole.
    whole: Option<LoadRequest>,
    /// What is open is being read, or on its way to the device, and is not in the picture as a whole.
    loading: bool,
    ui: UiState,
    /// What the window's title says.
    window_title: String,
    /// Pictures that are on their way into files.
    pending_saves: Vec<PathBuf>,
    panel: Option<Panel>,
    /// When the panel is to be laid out again by itself.
    panel_due: Option<Instant>,
    scene: Scene,
    /// Somebody has chosen where to look from.
    framed: bool,
    /// From where a sample of what is being opened is seen, where nobody has chosen that.
    glimpsed: Option<Camera>,
    /// What hands have chosen of that before the whole is there.
    views: Vec<Input>,
    pick_buffer: Option<Arc<PickBuffer>>,
    cursor: DVec2,
    modifiers: Modifiers,
    clicked: Option<(Instant, DVec2)>,
    /// A click that the next picture answers, and whether it adds a point.
    picks_later: Option<(DVec2, bool)>,
    /// Where the first button went down.
    pressed: Option<DVec2>,
    flight: Option<ScriptedFlight>,
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

/// To be copied from the terminal. Where nobody reads it any more, the window goes on.
fn print_line(what: &str) {
    drop(writeln!(std::io::stdout(), "{what}"));
}

/// As [`print_line`], on standard error.
fn warn(what: &str) {
    drop(writeln!(std::io::stderr(), "pointillist: {what}"));
}

impl App {
    fn post(&self, message: Message) {
        if let Some(thread) = &self.render_thread {
            thread.post(message);
        }
    }

    fn post_scene(&mut self) {
        self.scene.camera = self.navigation.camera;
        self.post(Message::Scene { scene: Box::new(self.scene.clone()), asked: Instant::now() });
    }

    /// Soon, and once however often it is asked for.
    fn ask_for_panel(&self) {
        if let Some(window) = &self.window {
            window.request_redraw();
        }
    }

    /// Says in the window how far the work of a token is.
    fn watch(&self, token: CancelToken) -> ProgressReporter {
        let (events, of) = (self.events.clone(), token.clone());
        ProgressReporter::new(token, move |text| {
            drop(events.send_event(Event::Progress(text, of.clone())))
        })
    }

    /// Of the window, no side of it zero.
    fn size(&self) -> [u32; 2] {
        self.size.map(|side| side.max(1))
    }

    fn report_error(&mut self, error: &Error) {
        warn(&error.to_string());
        // Of several files each may be wrong in its own way.
        let before = self.ui.error.take().filter(|before| *before != error.to_string());
        self.ui.error =
            Some(before.map_or(error.to_string(), |before| format!("{before}\n{error}")));
    }
}
