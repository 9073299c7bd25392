//! THE WINDOW: events in, messages to the drawing thread out.
//!
//! ```text
//!     events -> navigation -> camera --.
//!     keys, files dropped -------------+-> drawing thread -> window
//!     opening thread -> cloud ---------'         |
//!         ^--- what the picture shows, and how long it took
//! ```
//! This thread only reacts: it waits for events, and while nobody touches anything nothing is drawn.

pub mod drawing;
pub mod flight;
pub mod keys;
pub mod measure;
pub mod navigation;
pub mod opening;
pub mod pace;
pub mod panel;
pub mod seen;
pub mod statistics;

use crate::cloud::attribute::Further;
use crate::cut::Detail;
use crate::error::{Error, Result};
use crate::gpu::Wish;
use crate::graph::Gpu;
use crate::present::Present;
use crate::resident::Point;
use crate::scene::Scene;
use crate::source::Opening;
use crate::view::{Camera, Preset, View};
use crate::whole_file::whole_file;
use drawing::{Drawing, Drawn, Message, Report};
use flight::{Flight, Hands};
use glam::DVec2;
use keys::Act;
use navigation::{Button, Habit, Input, Modifiers, Navigation, Way};
use opening::{Opened, Watch};
use panel::{Deed, Facts, Panel};
use seen::Seen;
use statistics::Statistics;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::dpi::{PhysicalPosition, PhysicalSize};
use winit::event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::keyboard::PhysicalKey;
use winit::window::{Fullscreen, Window, WindowId};

/// What to show, and how.
#[derive(Clone, Debug)]
pub struct Options {
    pub files: Vec<PathBuf>,
    pub opening: Opening,
    /// What points bring because of how they are drawn.
    pub further: Further,
    /// What to draw, but for the camera.
    pub scene: Scene,
    /// Where from, when there is no camera.
    pub preset: Preset,
    pub camera: Option<Camera>,
    /// Of the window, pixels.
    pub size: [u32; 2],
    pub habit: Habit,
    pub wish: Wish,
    pub pool_bytes: u64,
    /// As asked for; what nobody asked for follows the picture's size.
    pub budget: Option<u64>,
    pub lod_px: Option<f64>,
    /// Nobody is there: fly ahead for so long, rest, and close.
    pub flight: Option<Duration>,
    /// When the program began.
    pub began: Instant,
}

impl Options {
    fn detail(&self) -> drawing::DetailOf {
        let (budget, lod_px) = (self.budget, self.lod_px);
        Box::new(move |size| {
            let usual = Detail::of(size);
            Detail { budget: budget.unwrap_or(usual.budget), lod_px: lod_px.unwrap_or(usual.lod_px), ..usual }
        })
    }
}

/// From the other threads.
enum Event {
    Progress(String),
    Opened(Result<Box<Opened>>),
    Report(Report),
}

/// Opens a window, and returns when it is closed.
pub fn run(options: Options) -> Result<Statistics> {
    let no_window = |error| Error::Device(format!("cannot open a window ({error}); `render` needs none"));
    let events = EventLoop::<Event>::with_user_event().build().map_err(no_window)?;
    let mut app = App {
        navigation: Navigation::new(options.habit, options.size),
        statistics: Statistics::new(options.began),
        events: events.create_proxy(),
        abandoned: Arc::new(AtomicBool::new(false)),
        openings: Vec::new(),
        files: options.files.clone(),
        facts: Facts::default(),
        panel: None,
        laid_out: None,
        scene: options.scene.clone(),
        window: None,
        drawing: None,
        waits: false,
        framed: false,
        seen: None,
        cursor: DVec2::ZERO,
        modifiers: Modifiers::default(),
        clicked: None,
        pressed: None,
        flight: options.flight.map(Flight::new),
        flew: None,
        ended: None,
        options,
    };
    events.run_app(&mut app).map_err(no_window)?;
    match app.ended {
        Some(error) => Err(error),
        None => Ok(Statistics { flight: app.flight.map(|flight| (flight.to_whole, flight.at_rest)), ..app.statistics }),
    }
}

/// Two clicks within this time, on one place, are one.
const DOUBLE: Duration = Duration::from_millis(400);

/// A hand that clicks moves the mouse no farther, pixels.
const CLICK_PX: f64 = 4.0;

/// A frame that took longer than this does not fly further than one that took as long.
const LONGEST_STEP: Duration = Duration::from_millis(200);
const FIRST_STEP: Duration = Duration::from_millis(16);

struct App {
    options: Options,
    events: EventLoopProxy<Event>,
    window: Option<Arc<Window>>,
    drawing: Option<Drawing>,
    navigation: Navigation,
    statistics: Statistics,
    /// Tells the opening thread that nobody waits for it.
    abandoned: Arc<AtomicBool>,
    openings: Vec<JoinHandle<()>>,
    /// All that are open, or are being opened.
    files: Vec<PathBuf>,
    facts: Facts,
    panel: Option<Panel>,
    /// When the panel is to be laid out again by itself.
    laid_out: Option<Instant>,
    scene: Scene,
    /// For the whole of what is being opened.
    waits: bool,
    /// Somebody has chosen where to look from.
    framed: bool,
    seen: Option<Arc<Seen>>,
    cursor: DVec2,
    modifiers: Modifiers,
    clicked: Option<(Instant, DVec2)>,
    /// Where the first button went down.
    pressed: Option<DVec2>,
    flight: Option<Flight>,
    /// When flying was last advanced.
    flew: Option<Instant>,
    ended: Option<Error>,
}

impl App {
    fn start(&mut self, events: &ActiveEventLoop) -> Result<()> {
        let [width, height] = self.options.size;
        let attributes =
            Window::default_attributes().with_title("pointillist").with_inner_size(PhysicalSize::new(width, height)).with_visible(true);
        let window = events.create_window(attributes).map_err(|error| Error::Device(format!("cannot open a window: {error}")))?;
        let window = Arc::new(window);
        let gpu = Gpu::open(&Wish { window: true, ..self.options.wish.clone() })?;
        let present = Present::open(&gpu, window.clone())?;
        let proxy = self.events.clone();
        // A window that is gone needs no reports.
        let report = move |report| drop(proxy.send_event(Event::Report(report)));
        self.drawing = Some(Drawing::start(gpu, present, self.options.detail(), report)?);
        self.panel = Some(Panel::new(&window));
        self.window = Some(window);
        self.resized();
        self.open()
    }

    /// Reads all files anew, in the background.
    fn open(&mut self) -> Result<()> {
        if self.files.is_empty() {
            return Ok(());
        }
        self.abandoned.store(true, Relaxed);
        self.abandoned = Arc::new(AtomicBool::new(false));
        self.facts.doing = Some("opening".into());
        self.facts.trouble = None;
        let (progress, opened) = (self.events.clone(), self.events.clone());
        let watch = Watch::new(self.abandoned.clone(), move |text| drop(progress.send_event(Event::Progress(text))));
        let done = move |result: Result<Opened>| drop(opened.send_event(Event::Opened(result.map(Box::new))));
        self.openings.push(opening::start(
            self.files.clone(),
            self.options.opening.clone(),
            self.scene.color,
            self.options.further,
            watch,
            done,
        )?);
        Ok(())
    }

    fn opened(&mut self, opened: Opened) {
        let Opened { source, shown, subject, kinds, is_whole } = opened;
        self.facts.points = source.points();
        self.facts.shows = Some(shown.attribute);
        self.facts.kinds = kinds;
        self.navigation.set_subject(subject);
        if !self.framed {
            self.framed = true;
            match self.options.camera {
                Some(camera) => self.navigation.camera = camera,
                None => self.navigation.handle(Input::Look { from: self.options.preset }),
            }
        }
        self.waits = !is_whole;
        let pool_bytes = self.options.pool_bytes;
        let progress = self.events.clone();
        let watch = Watch::new(self.abandoned.clone(), move |text| drop(progress.send_event(Event::Progress(text))));
        self.post(Message::Bring(Box::new(move |gpu| source.bring(gpu, shown, pool_bytes, &watch))));
        self.post_scene();
    }

    fn post(&self, message: Message) {
        if let Some(drawing) = &self.drawing {
            drawing.post(message);
        }
    }

    fn post_scene(&mut self) {
        self.scene.camera = self.navigation.camera;
        self.post(Message::Scene(Box::new(self.scene.clone())));
    }

    /// Lays the panel out, and does what was chosen there.
    fn lay_out(&mut self) {
        let (Some(window), Some(panel)) = (&self.window, &mut self.panel) else { return };
        let before = self.scene.clone();
        self.facts.mode = self.navigation.mode;
        let size = window.inner_size();
        let view = View::new(self.scene.camera, [size.width.max(1), size.height.max(1)]).ok();
        let laid_out = panel.lay_out(window, &self.facts, view.as_ref(), &mut self.scene);
        self.laid_out = laid_out.again_in.and_then(|wait| Instant::now().checked_add(wait));
        self.post(Message::Panel(Box::new(laid_out.overlay)));
        if self.scene.color != before.color
            && let Err(error) = self.open()
        {
            self.trouble(&error);
        }
        if self.scene != before {
            self.post_scene();
        }
        for deed in laid_out.deeds {
            self.deed(deed);
        }
    }

    fn deed(&mut self, deed: Deed) {
        match deed {
            Deed::Navigate(input) => self.navigate(input),
            Deed::SaveScene => {
                let path = unused_name("json");
                match self.scene.write(&path) {
                    Ok(()) => self.facts.doing = Some(format!("saved {}", path.display())),
                    Err(error) => self.trouble(&error),
                }
            }
            Deed::Forget => {
                self.facts.measure.points.clear();
                self.facts.picked = None;
            }
            Deed::Export(extension) => self.export(extension),
            Deed::Help => self.facts.help = !self.facts.help,
            Deed::SavePicture => self.post(Message::Save(unused_name("png"))),
        }
        self.ask_for_panel();
    }

    /// What was picked, and what lies between.
    fn export(&mut self, extension: &str) {
        let path = unused_name(extension);
        let text = match extension {
            "csv" => self.facts.measure.csv(),
            _ => format!("{:#}\n", self.facts.measure.geojson()),
        };
        let written = whole_file(&path, |partial| std::fs::write(partial, text).map_err(|error| Error::io("write", &path, error)));
        match written {
            Ok(()) => self.facts.doing = Some(format!("saved {}", path.display())),
            Err(error) => self.trouble(&error),
        }
    }

    /// Soon, and once however often it is asked for.
    fn ask_for_panel(&self) {
        if let Some(window) = &self.window {
            window.request_redraw();
        }
    }

    fn size(&self) -> [u32; 2] {
        self.window.as_ref().map_or(self.options.size, |window| {
            let size = window.inner_size();
            [size.width.max(1), size.height.max(1)]
        })
    }

    fn resized(&mut self) {
        self.navigation.set_size(self.size());
        self.post(Message::Exposed);
    }

    fn under_cursor(&self) -> Option<glam::DVec3> {
        self.seen.as_ref().and_then(|seen| seen.place(self.cursor, self.size()))
    }

    /// With shift one more point, without it another one.
    fn pick(&self) {
        if let Some(id) = self.seen.as_ref().and_then(|seen| seen.point(self.cursor, self.size())) {
            self.post(Message::Pick { id, adds: self.modifiers.shift });
        }
    }

    fn picked(&mut self, point: Point, adds: bool) {
        if !adds {
            self.facts.measure.points.clear();
        }
        self.facts.measure.points.push(point.position);
        self.facts.picked = Some(point);
    }

    fn navigate(&mut self, input: Input) {
        let before = self.navigation.camera;
        self.navigation.handle(input);
        if View::new(self.navigation.camera, self.size()).is_err() {
            // Farther or nearer than numbers go.
            self.navigation.camera = before;
        }
        if self.navigation.camera != before {
            self.post_scene();
        }
    }

    fn button(&mut self, button: MouseButton, state: ElementState) {
        let button = match button {
            MouseButton::Left => Button::Left,
            MouseButton::Middle => Button::Middle,
            MouseButton::Right => Button::Right,
            _ => return,
        };
        if state == ElementState::Released {
            let still = self.pressed.take().is_some_and(|at| at.distance(self.cursor) < CLICK_PX);
            if button == Button::Left && still {
                self.pick();
            }
            return self.navigate(Input::Release { button });
        }
        let under = self.under_cursor();
        if button == Button::Left {
            self.pressed = Some(self.cursor);
            let again = self.clicked.is_some_and(|(when, at)| when.elapsed() < DOUBLE && at.distance(self.cursor) < CLICK_PX);
            self.clicked = (!again).then(|| (Instant::now(), self.cursor));
            if let Some(on) = under.filter(|_| again) {
                return self.navigate(Input::Centre { on });
            }
        }
        self.navigate(Input::Press { button, modifiers: self.modifiers, at: self.cursor, under });
    }

    fn key(&mut self, events: &ActiveEventLoop, code: winit::keyboard::KeyCode, pressed: bool, repeated: bool) {
        match keys::find(code) {
            Some(Act::Fly(way)) => self.fly(way, pressed),
            Some(act) if pressed && !repeated => match act {
                Act::Navigate(input) => {
                    self.navigate(input);
                    self.ask_for_panel();
                }
                Act::Save => self.deed(Deed::SavePicture),
                Act::FullScreen => self.full_screen(),
                Act::Help => self.deed(Deed::Help),
                Act::Panel => {
                    self.facts.hidden = !self.facts.hidden;
                    self.ask_for_panel();
                }
                Act::Close => events.exit(),
                Act::Fly(_) => {}
            },
            _ => {}
        }
    }

    fn full_screen(&self) {
        if let Some(window) = &self.window {
            let now = window.fullscreen().is_none().then_some(Fullscreen::Borderless(None));
            window.set_fullscreen(now);
        }
    }

    /// The first step is taken at once; each picture that is drawn brings the next.
    fn fly(&mut self, way: Way, pressed: bool) {
        let flew = self.navigation.is_flying();
        self.navigation.handle(Input::Fly { way, pressed });
        if !flew && self.navigation.is_flying() {
            self.flew = Some(Instant::now());
            self.advance(FIRST_STEP);
        }
    }

    fn advance(&mut self, by: Duration) {
        self.navigation.advance(by.as_secs_f64());
        self.post_scene();
    }

    fn report(&mut self, events: &ActiveEventLoop, report: Report) {
        match report {
            Report::Drawn(drawn) => self.drawn(*drawn),
            Report::Brought if self.waits => {}
            Report::Brought => self.facts.doing = None,
            Report::Picked { point, adds } => self.picked(point, adds),
            Report::Saved(path) => self.facts.doing = Some(format!("saved {}", path.display())),
            Report::Failed(error) => self.trouble(&error),
            Report::Ended(error) => {
                self.ended = Some(error);
                events.exit();
            }
        }
        self.title();
    }

    fn drawn(&mut self, drawn: Drawn) {
        self.statistics.drawn(&drawn);
        let hands = self.flight.as_mut().and_then(|flight| flight.drawn(drawn.whole, Instant::now()));
        self.seen = Some(drawn.seen);
        self.facts.drawn = drawn.statistics.points_drawn;
        self.facts.latency = drawn.latency;
        self.facts.passes = drawn.passes;
        self.facts.decided = drawn.decided;
        // Who flies, flies on with every picture.
        if let Some(hands) = hands {
            self.fly(Way::Forward, matches!(hands, Hands::Start));
        } else if self.navigation.is_flying() {
            let by = self.flew.map_or(Duration::ZERO, |last| last.elapsed()).min(LONGEST_STEP);
            self.flew = Some(Instant::now());
            self.advance(by);
        }
    }

    fn trouble(&mut self, error: &Error) {
        eprintln!("pointillist: {error}");
        self.facts.trouble = Some(error.to_string());
    }

    /// Says what is open and what is going on.
    fn title(&mut self) {
        let Some(window) = &self.window else { return };
        let file = self.files.first().and_then(|file| file.file_name()).map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let more = if self.files.len() > 1 { format!(" and {} more", self.files.len() - 1) } else { String::new() };
        self.facts.title = format!("{file}{more}");
        let parts = [Some(self.facts.title.clone()), self.facts.doing.clone(), Some("pointillist".into())];
        window.set_title(&parts.into_iter().flatten().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" - "));
        self.ask_for_panel();
    }
}

/// A file in the folder that the program runs in, which does not exist yet.
fn unused_name(extension: &str) -> PathBuf {
    (1..).map(|number| PathBuf::from(format!("pointillist-{number}.{extension}"))).find(|path| !path.exists()).expect("numbers do not end")
}

impl ApplicationHandler<Event> for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.window.is_none()
            && let Err(error) = self.start(events)
        {
            self.ended = Some(error);
            events.exit();
        }
    }

    fn user_event(&mut self, events: &ActiveEventLoop, event: Event) {
        match event {
            Event::Progress(text) => self.facts.doing = Some(text),
            Event::Opened(Ok(opened)) => self.opened(*opened),
            // Another opening has taken its place.
            Event::Opened(Err(Error::Interrupted)) => {}
            Event::Opened(Err(error)) => {
                self.facts.doing = None;
                self.trouble(&error);
            }
            Event::Report(report) => return self.report(events, report),
        }
        self.title();
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _window: WindowId, event: WindowEvent) {
        if let (Some(window), Some(panel)) = (&self.window, &mut self.panel) {
            let heard = panel.hear(window, &event);
            if heard.repaint && !matches!(event, WindowEvent::RedrawRequested) {
                window.request_redraw();
            }
            if heard.taken {
                return;
            }
        }
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::Resized(_) | WindowEvent::ScaleFactorChanged { .. } => self.resized(),
            WindowEvent::RedrawRequested => self.lay_out(),
            WindowEvent::Occluded(false) => self.post(Message::Exposed),
            WindowEvent::CursorMoved { position: PhysicalPosition { x, y }, .. } => {
                self.cursor = DVec2::new(x, y);
                if self.navigation.is_dragging() {
                    self.navigate(Input::Move { to: self.cursor });
                }
            }
            WindowEvent::MouseInput { state, button, .. } => self.button(button, state),
            WindowEvent::MouseWheel { delta, .. } => {
                /// Pixels of a touchpad that are worth a notch.
                const PIXELS_PER_NOTCH: f64 = 40.0;
                let notches = match delta {
                    MouseScrollDelta::LineDelta(_, lines) => lines as f64,
                    MouseScrollDelta::PixelDelta(pixels) => pixels.y / PIXELS_PER_NOTCH,
                };
                let under = self.under_cursor();
                self.navigate(Input::Wheel { notches, at: self.cursor, under });
            }
            WindowEvent::ModifiersChanged(modifiers) => {
                let state = modifiers.state();
                self.modifiers = Modifiers { shift: state.shift_key(), control: state.control_key() };
            }
            WindowEvent::KeyboardInput { event, .. } => {
                if let PhysicalKey::Code(code) = event.physical_key {
                    self.key(events, code, event.state == ElementState::Pressed, event.repeat);
                }
            }
            WindowEvent::Focused(false) => self.navigation.let_go(),
            WindowEvent::DroppedFile(file) => {
                self.files.push(file);
                if let Err(error) = self.open() {
                    self.trouble(&error);
                }
                self.title();
            }
            _ => {}
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let now = Instant::now();
        if self.laid_out.is_some_and(|when| when <= now) {
            self.laid_out = None;
            self.ask_for_panel();
        }
        let over = self.flight.as_ref().and_then(Flight::over);
        if over.is_some_and(|when| when <= now) {
            events.exit();
        }
        events.set_control_flow(self.laid_out.into_iter().chain(over).min().map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
    }

    fn exiting(&mut self, _events: &ActiveEventLoop) {
        self.abandoned.store(true, Relaxed);
        if let Some(mut drawing) = self.drawing.take() {
            drawing.close();
        }
        // What they have half written they take away. A panic has been printed where it happened.
        self.openings.drain(..).for_each(|opening| drop(opening.join()));
    }
}
