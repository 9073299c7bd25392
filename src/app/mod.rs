//! The window: events in, messages to the render thread out.
//!
//! ```text
//!     events -> navigation -> camera --.
//!     keys, files dropped -------------+-> render thread -> window
//!     load thread -> cloud ------------'        |
//!         ^--- facts and times of the frame
//! ```
//! The window's thread only reacts to events. Without input nothing is drawn.

pub mod actions;
pub mod allocator;
mod animation;
pub mod cancel;
mod clip_box_widget;
mod events;
mod files;
pub mod frame_stats;
mod history;
mod input;
pub mod keys;
pub mod load_thread;
pub mod measure;
pub mod navigation;
mod open_dialog;
mod options;
pub mod panel;
pub mod pick_buffer;
mod point_lookup;
pub mod profile;
mod recent;
mod render_events;
pub mod render_thread;
pub mod scripted_flight;
mod unsaved;
pub mod viewport;

use crate::cloud::point_lookup::Record;
use crate::error::{Error, Result};
use crate::extract::Selection;
use crate::network;
use crate::progress::Progress;
use crate::render::annotations::Annotations;
use crate::render::scene::Scene;
use animation::Animation;
use cancel::CancelToken;
use files::{Framing, LoadState};
use frame_stats::{FrameStats, Summary};
use glam::DVec3;
use history::History;
use input::Mouse;
use load_thread::{LoadedCloud, ProgressReporter};
use navigation::Navigation;
pub use options::Options;
use panel::{Panel, UiState};
use pick_buffer::PickBuffer;
use render_thread::{Message, RenderEvent, RenderThread};
use scripted_flight::ScriptedFlight;
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;
use unsaved::Saved;
use viewport::Viewport;
use winit::error::EventLoopError;
use winit::event_loop::{EventLoop, EventLoopProxy};
use winit::window::Window;

/// An event from another thread.
enum Event {
    Progress(String, CancelToken),
    Loaded(Result<Box<LoadedCloud>>, CancelToken),
    /// The record of the point at a place (world); None if it is a sample of an index.
    LookedUp(DVec3, Result<Option<Record>>, CancelToken),
    /// The table of a profile, and its number of points.
    Written(PathBuf, Result<u64>),
    Render(RenderEvent),
    /// Files that the user chose; None if the system has no dialog, or none was chosen.
    Chosen(Option<Vec<PathBuf>>),
    /// Ctrl-C in the terminal.
    Interrupted,
}

/// Opens a window, and returns when it is closed or `progress` interrupts it.
pub fn run(options: Options, progress: &dyn Progress) -> Result<Summary> {
    network::resume();
    let events = EventLoop::<Event>::with_user_event().build().map_err(no_window)?;
    let interrupted = events.create_proxy();
    progress.when_interrupted(Box::new(move || drop(interrupted.send_event(Event::Interrupted))));
    let mut app = App {
        navigation: Navigation::new(options.style, options.size),
        stats: FrameStats::new(options.began),
        events: events.create_proxy(),
        load: LoadState { files: options.files.clone(), ..LoadState::default() },
        framing: Framing::default(),
        ui: UiState {
            path: options.path.clone(),
            save_size: options.save_size,
            recent: recent::read(),
            ..UiState::default()
        },
        window_title: String::new(),
        profiled: None,
        pending_saves: Vec::new(),
        panel: None,
        panel_due: None,
        answers: false,
        scene: options.scene.clone(),
        history: History::default(),
        saved: Saved {
            scene: options.scene.clone(),
            points: Vec::new(),
            path: options.path.clone(),
        },
        closes: false,
        is_choosing: false,
        window: None,
        viewport: Viewport::new(options.size, 0.0),
        render_thread: None,
        pick_buffer: None,
        mouse: Mouse::default(),
        animation: Animation::new(options.began),
        flight: options.flight.map(ScriptedFlight::new),
        device_lost: None,
        exit_error: None,
        options,
    };
    events.run_app(&mut app).map_err(no_window)?;
    match app.exit_error {
        Some(error) => Err(error),
        None => Ok(app.stats.summary(app.flight.as_ref())),
    }
}

struct App {
    options: Options,
    events: EventLoopProxy<Event>,
    window: Option<Arc<Window>>,
    /// The window, as last reported: asking a window that another program has destroyed would end
    /// this one.
    viewport: Viewport,
    render_thread: Option<RenderThread>,
    navigation: Navigation,
    scene: Scene,
    history: History,
    /// State that is in files already.
    saved: Saved,
    /// Request to close the window.
    closes: bool,
    /// State of the dialog that asks for files: true while it is open.
    is_choosing: bool,
    load: LoadState,
    framing: Framing,
    mouse: Mouse,
    animation: Animation,
    flight: Option<ScriptedFlight>,
    stats: FrameStats,
    ui: UiState,
    panel: Option<Panel>,
    /// Time of the next layout of the panel without input.
    panel_due: Option<Instant>,
    /// Mark that the next layout of the panel answers input.
    answers: bool,
    window_title: String,
    /// The points of the profile that was asked for last.
    profiled: Option<Selection>,
    /// Pictures and tables that are being saved.
    pending_saves: Vec<PathBuf>,
    pick_buffer: Option<Arc<PickBuffer>>,
    /// Time of the last loss of the device.
    device_lost: Option<Instant>,
    exit_error: Option<Error>,
}

/// Says why there is no window.
fn no_window(error: EventLoopError) -> Error {
    let has = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    if cfg!(target_os = "linux")
        && !["WAYLAND_DISPLAY", "WAYLAND_SOCKET", "DISPLAY"].map(has).contains(&true)
    {
        return Error::Device(
            "no display: neither WAYLAND_DISPLAY nor DISPLAY is set; `render` draws without one"
                .into(),
        );
    }
    // The message of the window library begins with a place in its source.
    let text = error.to_string();
    let why = text.split_once(": ").filter(|_| matches!(error, EventLoopError::Os(_)));
    let why = why.map_or(&text[..], |(_, why)| why);
    Error::Device(format!("cannot open a window ({why}); `render` draws without one"))
}

/// Prints to standard output; the window goes on if that is closed.
fn print_line(what: &str) {
    drop(writeln!(std::io::stdout(), "{what}"));
}

/// Prints to standard error; the window goes on if that is closed.
fn warn(what: &str) {
    drop(writeln!(std::io::stderr(), "pointillist: {what}"));
}

impl App {
    /// Sends a message to the render thread.
    fn post(&self, message: Message) {
        if let Some(thread) = &self.render_thread {
            thread.post(message);
        }
    }

    /// Sends the scene, from the current camera, to the render thread.
    fn post_scene(&mut self) {
        self.scene.camera = self.navigation.camera;
        // These are drawn with the panel, and change nothing below it.
        let annotations = Annotations::default();
        let scene = Box::new(Scene { annotations, ..self.scene.clone() });
        self.post(Message::Scene { scene, asked: Instant::now() });
    }

    /// Requests a layout of the panel; requests before the next one are merged.
    fn request_panel(&self) {
        if let Some(window) = &self.window {
            window.request_redraw();
        }
    }

    /// Returns a listener that shows the progress of a token's work in the window.
    fn progress_reporter(&self, token: CancelToken) -> ProgressReporter {
        let (events, of) = (self.events.clone(), token.clone());
        ProgressReporter::new(token, move |text| {
            drop(events.send_event(Event::Progress(text, of.clone())))
        })
    }

    /// Prints an error, and adds it to those that the panel shows.
    fn report_error(&mut self, error: &Error) {
        warn(&error.to_string());
        // Several files may each have an error.
        let before = self.ui.error.take().filter(|before| *before != error.to_string());
        self.ui.error =
            Some(before.map_or(error.to_string(), |before| format!("{before}\n{error}")));
    }
}
