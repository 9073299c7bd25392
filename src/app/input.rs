//! Input: mouse buttons and keys, turned into navigation, picks and actions.

use super::App;
use super::cancel::CancelToken;
use super::keys::{self, Binding};
use super::navigation::{Button, Input, Modifiers};
use super::render_thread::{Message, PickRequest};
use super::viewport::Viewport;
use crate::output::annotations::Shown;
use crate::view::{Covered, Preset};
use glam::DVec2;
use std::time::{Duration, Instant};
use winit::dpi::PhysicalSize;
use winit::event::{ElementState, MouseButton};
use winit::keyboard::KeyCode;

/// Longest time between the clicks of a double click.
const DOUBLE: Duration = Duration::from_millis(400);

/// Farthest that the mouse moves during a click `[px]`.
const CLICK_PX: f64 = 4.0;

/// State of the mouse and of the modifier keys.
#[derive(Default)]
pub(super) struct Mouse {
    /// Position of the cursor `[px]`.
    pub cursor: DVec2,
    pub modifiers: Modifiers,
    /// Time and position of the last click.
    pub last_click: Option<(Instant, DVec2)>,
    /// Where the left button was pressed.
    pub pressed: Option<DVec2>,
    /// Clicks on a sample of the files, which wait for all points.
    pub early_picks: Vec<PickRequest>,
    /// Token of clicks that are not answered yet.
    pub pick_token: CancelToken,
}

impl App {
    pub(super) fn resized(&mut self, size: PhysicalSize<u32>) {
        let viewport = self.fitting(size.into());
        self.set_viewport(viewport);
    }

    /// Folds or unfolds the panel as a window of this size `[px]` asks for. Returns what it leaves.
    pub(super) fn fitting(&mut self, size: [u32; 2]) -> Viewport {
        self.ui.panel.fit(self.panel_px() / f64::from(size[0].max(1)));
        self.viewport_of(size)
    }

    /// Returns the width of the panel while it is shown `[px]`.
    fn panel_px(&self) -> f64 {
        let shown = self.window.as_deref().zip(self.panel.as_ref());
        shown.map_or(0.0, |(window, panel)| panel.width_px(window))
    }

    /// Returns what the panel leaves of a window of this size `[px]`.
    pub(super) fn viewport_of(&self, size: [u32; 2]) -> Viewport {
        Viewport::new(size, if self.ui.panel.is_shown() { self.panel_px() } else { 0.0 })
    }

    pub(super) fn set_viewport(&mut self, viewport: Viewport) {
        self.viewport = viewport;
        self.navigation.set_viewport(viewport);
        self.post(Message::Exposed(viewport));
        self.frame_again();
    }

    /// Frames what clip boxes leave, beside annotations of what is `named`.
    pub(super) fn look(&mut self, from: Preset, named: Option<&Shown>) {
        self.navigation.clips = self.scene.clips.clone();
        self.navigation.covered = Covered::default();
        self.navigation.handle(Input::Look { from });
        let is_annotated = !self.scene.annotations.is_empty();
        self.framing.lacks_names = is_annotated && named.is_none();
        let Some(named) = named.filter(|_| is_annotated) else { return };
        // Coordinates along the edges are those of the view.
        if let Ok(view) = self.viewport.free_view(self.navigation.camera) {
            self.navigation.covered = self.scene.annotations.covered(&view, named);
            self.navigation.handle(Input::Look { from });
        }
    }

    /// Frames a view again that the user has not moved, since its room has changed.
    pub(super) fn frame_again(&mut self) {
        if let Some(from) = self.navigation.framed() {
            self.navigate(Input::Look { from });
        }
    }

    /// Returns the place of the surface under the cursor; None if nothing is there.
    pub(super) fn under_cursor(&self) -> Option<glam::DVec3> {
        self.pick_buffer
            .as_ref()
            .and_then(|buffer| buffer.place(self.mouse.cursor, self.viewport.size()))
    }

    /// Picks the point at a pixel of what is seen; it replaces the picked points, or with `adds`
    /// joins them.
    pub(super) fn pick(&mut self, at: DVec2, adds: bool) {
        let Some(buffer) = &self.pick_buffer else { return };
        let is_exact = buffer.is_exact && !self.shows_sample();
        let id = if is_exact { buffer.point(at, self.viewport.size()) } else { None };
        // The camera may be ahead of the picture.
        let Ok(view) = self.viewport.view(buffer.view.camera) else { return };
        // Where a surface is closed between its points, they are looked for at full density.
        if is_exact && id.is_none() && self.under_cursor().is_none() {
            return self.nothing_picked(adds);
        }
        let token = self.mouse.pick_token.clone();
        self.mouse.early_picks.push(PickRequest { view, at, id, adds, token });
        self.post_picks();
    }

    /// Returns whether a sample of the files is seen while the others are read.
    fn shows_sample(&self) -> bool {
        self.load.active && self.load.displayed.is_none()
    }

    /// Sends clicks on, unless all points are still to come.
    pub(super) fn post_picks(&mut self) {
        if self.shows_sample() {
            return;
        }
        for pick in std::mem::take(&mut self.mouse.early_picks) {
            self.post(Message::Pick(Box::new(pick)));
        }
    }

    /// Says that there is no point; only a click with shift surely meant one.
    pub(super) fn nothing_picked(&mut self, adds: bool) {
        if adds {
            self.ui.doing = Some("there is no point to pick".into());
            self.title();
        }
    }

    pub(super) fn navigate(&mut self, input: Input) {
        // Input that moves the camera stops the camera path.
        self.ui.plays &= matches!(
            input,
            Input::Move { .. }
                | Input::Release { .. }
                | Input::Fly { pressed: false, .. }
                | Input::Drag { .. }
                | Input::NextMode
        );
        let before = self.navigation.camera;
        let is_sample = self.framing.sample_camera == Some(before);
        let early = input.is_a_view() && (!self.framing.chosen || is_sample);
        match input {
            Input::Look { from } => {
                let named = self.ui.named(&self.scene);
                self.look(from, named.as_ref());
            }
            _ => self.navigation.handle(input),
        }
        if is_sample && self.navigation.framed().is_some() {
            // A click only changes what the camera turns about.
            self.framing.sample_camera = Some(self.navigation.camera);
        }
        if self.viewport.view(self.navigation.camera).is_err() {
            // The camera would be beyond what f64 can express.
            self.navigation.camera = before;
        }
        if early {
            self.framing.early_inputs.push(input);
            self.framing.sample_camera = self.framing.chosen.then_some(self.navigation.camera);
        }
        if self.navigation.camera != before {
            self.post_scene();
        }
    }

    pub(super) fn button(&mut self, button: MouseButton, state: ElementState) {
        let button = match button {
            MouseButton::Left => Button::Left,
            MouseButton::Middle => Button::Middle,
            MouseButton::Right => Button::Right,
            _ => return,
        };
        if state == ElementState::Released {
            let still = self
                .mouse
                .pressed
                .take()
                .is_some_and(|at| at.distance(self.mouse.cursor) < CLICK_PX);
            match (button, still) {
                (Button::Left, true) => self.pick(self.mouse.cursor, self.mouse.modifiers.shift),
                // A drag is no click, however soon the next follows it.
                (Button::Left, false) => self.mouse.last_click = None,
                _ => {}
            }
            return self.navigate(Input::Release { button });
        }
        let under = self.under_cursor();
        if button == Button::Left {
            self.mouse.pressed = Some(self.mouse.cursor);
            let again = self.mouse.last_click.is_some_and(|(when, at)| {
                when.elapsed() < DOUBLE && at.distance(self.mouse.cursor) < CLICK_PX
            });
            self.mouse.last_click = (!again).then(|| (Instant::now(), self.mouse.cursor));
            if let Some(on) = under.filter(|_| again) {
                return self.navigate(Input::Centre { on });
            }
        }
        self.navigate(Input::Press {
            button,
            modifiers: self.mouse.modifiers,
            at: self.mouse.cursor,
            under,
        });
    }

    pub(super) fn key(&mut self, code: KeyCode, pressed: bool, repeated: bool) {
        // A key that is released ends what it began, whatever else is held by then.
        let held = if pressed { self.mouse.modifiers } else { Modifiers::default() };
        match keys::find(code, held) {
            Some(Binding::Fly(direction)) => self.fly(direction, pressed),
            Some(Binding::Do(action)) if pressed && !repeated => self.perform(action),
            Some(Binding::Close) if pressed && !repeated => match self.ui.dismiss() {
                true => self.title(),
                false => self.close(),
            },
            Some(Binding::Confirm) if pressed && !self.ui.asks.is_empty() => self.closes = true,
            _ => {}
        }
    }
}
