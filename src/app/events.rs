//! The window, and its events: from the system and from the other threads.

use super::navigation::{Input, Modifiers};
use super::panel::Panel;
use super::profile::Profile;
use super::render_thread::{Message, RenderThread};
use super::scripted_flight::ScriptedFlight;
use super::{App, Event};
use crate::error::{Error, Result};
use crate::gpu::DeviceOptions;
use crate::index::cache;
use crate::network;
use crate::present::Present;
use crate::renderer::{Renderer, RendererOptions};
use crate::tune::Governor;
use crate::tune::store::{self, Found, Subject};
use glam::DVec2;
use std::sync::Arc;
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::dpi::{PhysicalPosition, PhysicalSize};
use winit::event::{ElementState, KeyEvent, MouseScrollDelta, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow};
use winit::keyboard::{Key, KeyCode, PhysicalKey};
use winit::window::{Window, WindowId};

impl App {
    fn start(&mut self, events: &ActiveEventLoop) -> Result<()> {
        let [width, height] = self.options.size;
        let attributes = Window::default_attributes()
            .with_title("pointillist")
            .with_inner_size(PhysicalSize::new(width, height))
            .with_visible(true);
        let window = events
            .create_window(attributes)
            .map_err(|error| Error::Device(format!("cannot open a window: {error}")))?;
        let window = Arc::new(window);
        self.panel = Some(Panel::new(&window));
        self.window = Some(window.clone());
        self.draw_in(window)
    }

    /// Opens a device and a render thread, and loads all open files.
    fn draw_in(&mut self, window: Arc<Window>) -> Result<()> {
        let device = DeviceOptions { window: true, ..self.options.device_options.clone() };
        let options = RendererOptions {
            memory_budget: self.options.pool_bytes,
            ..RendererOptions::default()
        };
        let renderer = Renderer::open_device(&device, options)?;
        let gpu = &renderer.gpu;
        self.stats.device = format!("{} ({})", gpu.device.name, gpu.device.driver);
        let size = window.inner_size();
        let present = Present::open(gpu, window)?;
        let proxy = self.events.clone();
        // If the window is gone, its events are dropped.
        let report = move |event| drop(proxy.send_event(Event::Render(event)));
        let front = Subject {
            device: gpu.device.name.clone(),
            driver: gpu.device.driver.clone(),
            is_cpu: gpu.device.is_cpu,
            switches: store::switches(&self.options.scene.settings.effects),
            cloud: cache::key_of_files(&self.load.files).ok(),
        };
        let Found { front, origin } = front.find(&self.options.fronts)?;
        let limit = self.ui.pace.limit.unwrap_or(self.options.limit);
        (self.ui.pace.limit, self.ui.pace.origin) = (Some(limit), origin);
        let governor = Governor::new(&front, limit);
        self.render_thread = Some(RenderThread::start(renderer, present, governor, report)?);
        self.resized(size);
        self.open()
    }

    /// Reopens a lost device, and loads the files again. Returns any other error, and a loss soon
    /// after another one.
    pub(super) fn rebuild(&mut self, error: Error) -> Result<()> {
        /// Time within which a second loss is final.
        const SOON: Duration = Duration::from_secs(10);
        let again = self.device_lost.is_some_and(|when| when.elapsed() < SOON);
        let (true, false, Some(window), Some(panel)) =
            (error.is_lost_device(), again, self.window.clone(), &mut self.panel)
        else {
            return Err(error);
        };
        self.device_lost = Some(Instant::now());
        *panel = panel.renewed(&window);
        if let Some(mut thread) = self.render_thread.take() {
            thread.close();
        }
        self.ui.profile.iter_mut().for_each(Profile::forget_texture);
        self.ui.pace.texture = None;
        self.pending_saves.clear();
        // Nothing is on the screen, like at the start.
        (self.load.displayed, self.pick_buffer, self.ui.shown, self.ui.loading) =
            (None, None, None, None);
        let overrides = &mut self.options.device_options.overrides;
        (overrides.lost_after, overrides.surface_lost_after) = (None, None);
        self.draw_in(window)?;
        self.report_error(&Error::Device(format!(
            "{error}; the device was opened again, and files are loaded again"
        )));
        Ok(())
    }
}

/// Returns the key of an event, by its place; with control by its letter, as other programs do.
fn code(event: &KeyEvent, control: bool) -> Option<KeyCode> {
    let letter = match &event.logical_key {
        Key::Character(text) if control => text.to_lowercase(),
        _ => String::new(),
    };
    match (letter.as_str(), event.physical_key) {
        ("z", _) => Some(KeyCode::KeyZ),
        ("y", _) => Some(KeyCode::KeyY),
        ("o", _) => Some(KeyCode::KeyO),
        (_, PhysicalKey::Code(code)) => Some(code),
        _ => None,
    }
}

impl ApplicationHandler<Event> for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.window.is_none()
            && let Err(error) = self.start(events)
        {
            self.exit_error = Some(error);
            events.exit();
        }
    }

    fn user_event(&mut self, events: &ActiveEventLoop, event: Event) {
        match event {
            // Its work was cancelled; other work may have taken its place.
            Event::Progress(_, token) | Event::Loaded(_, token) | Event::LookedUp(_, _, token)
                if token.is_cancelled() =>
            {
                return;
            }
            Event::Progress(text, _) => self.ui.doing = Some(text),
            Event::Loaded(Ok(opened), _) => self.loaded(*opened),
            Event::Loaded(Err(error), _) => self.load_failed(&error),
            Event::LookedUp(place, looked, _) => self.looked_up(place, looked),
            Event::Written(path, written) => self.table_written(&path, written),
            Event::Chosen(files) => self.chosen(files),
            Event::Render(event) => return self.render_event(events, event),
            Event::Interrupted => {
                self.exit_error = Some(Error::Interrupted);
                return events.exit();
            }
        }
        self.title();
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _window: WindowId, event: WindowEvent) {
        if matches!(event, WindowEvent::Destroyed) {
            // Destroyed by another program: asking or closing it would end this one.
            self.window = None;
            return events.exit();
        }
        if let (Some(window), Some(panel)) = (&self.window, &mut self.panel) {
            let response = panel.handle_event(window, &event);
            if response.repaint && !matches!(event, WindowEvent::RedrawRequested) {
                self.answers = true;
                window.request_redraw();
            }
            if response.consumed {
                return;
            }
        }
        match event {
            WindowEvent::CloseRequested => self.close(),
            WindowEvent::Resized(size) => self.resized(size),
            WindowEvent::ScaleFactorChanged { .. } => {
                let size = self.window.as_ref().map(|window| window.inner_size());
                size.into_iter().for_each(|size| self.resized(size));
            }
            WindowEvent::RedrawRequested => self.lay_out(),
            WindowEvent::Occluded(false) => self.post(Message::Exposed(self.viewport)),
            WindowEvent::CursorMoved { position: PhysicalPosition { x, y }, .. } => {
                self.mouse.cursor = DVec2::new(x, y);
                if self.navigation.is_dragging() {
                    self.navigate(Input::Move { to: self.mouse.cursor });
                }
            }
            WindowEvent::MouseInput { state, button, .. } => self.button(button, state),
            WindowEvent::MouseWheel { delta, .. } => {
                /// Touchpad pixels per wheel notch.
                const PIXELS_PER_NOTCH: f64 = 40.0;
                let notches = match delta {
                    MouseScrollDelta::LineDelta(_, lines) => lines as f64,
                    MouseScrollDelta::PixelDelta(pixels) => pixels.y / PIXELS_PER_NOTCH,
                };
                let under = self.under_cursor();
                self.navigate(Input::Wheel { notches, at: self.mouse.cursor, under });
            }
            WindowEvent::ModifiersChanged(modifiers) => {
                let state = modifiers.state();
                self.mouse.modifiers =
                    Modifiers { shift: state.shift_key(), control: state.control_key() };
            }
            WindowEvent::KeyboardInput { event, .. } => {
                if let Some(code) = code(&event, self.mouse.modifiers.control) {
                    self.key(code, event.state == ElementState::Pressed, event.repeat);
                }
            }
            WindowEvent::Focused(false) => self.navigation.release_all(),
            WindowEvent::DroppedFile(file) => self.take(file),
            _ => {}
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        if self.closes {
            return events.exit();
        }
        let now = Instant::now();
        if self.panel_due.is_some_and(|when| when <= now) {
            self.panel_due = None;
            self.request_panel();
        }
        if self.animation.next_step.is_some_and(|when| when <= now) {
            self.move_on();
        }
        if self.flight.as_mut().is_some_and(|flight| flight.wake(now)) {
            return events.exit();
        }
        let wakes = self.flight.as_ref().and_then(ScriptedFlight::wakes);
        events.set_control_flow(
            self.panel_due
                .into_iter()
                .chain(self.animation.next_step)
                .chain(wakes)
                .min()
                .map_or(ControlFlow::Wait, ControlFlow::WaitUntil),
        );
    }

    fn exiting(&mut self, _events: &ActiveEventLoop) {
        self.load.token.cancel();
        self.load.lookup_token.cancel();
        self.load.table_token.cancel();
        network::stop();
        if let Some(mut thread) = self.render_thread.take() {
            thread.close();
        }
        // Workers remove their half-written files.
        self.load.join_workers();
    }
}
