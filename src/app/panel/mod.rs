//! The panel: what is drawn and why, and all settings, from the registry of effects. UI state and a
//! scene in, triangles and actions out.
//!
//! ```text
//! header     what is open, navigation, tabs
//! look       how points are drawn      | measures   picked points | layers   which points are drawn
//! footer     saving, notes, work in progress
//! ```
//! Header and footer have the same rows at all times, and tabs scroll between them, so that no row
//! moves under the cursor.

mod camera_path;
mod color;
mod detail;
mod effects;
mod filters;
mod footer;
mod header;
mod heat_map;
mod layers;
mod light;
mod look;
mod measure_overlay;
mod measures;
mod pace;
mod ramp;
mod state;
mod text;
mod theme;
mod windows;

use super::actions::Action;
use super::clip_box_widget;
use crate::app::viewport::Viewport;
use crate::present::overlay::Overlay;
use crate::render::scene::Scene;
use crate::view::View;
use egui::{Area, Frame, Margin, Order, ScrollArea, Ui, vec2};
pub use state::{SaveSize, Tab, UiState, named_of};
use std::time::Duration;
use winit::event::{ElementState, WindowEvent};
use winit::keyboard::{KeyCode, PhysicalKey};
use winit::window::Window;

/// Result of laying out the panel.
pub struct PanelOutput {
    pub overlay: Overlay,
    pub actions: Vec<Action>,
    /// Mark that a drag or typing goes on: what follows is part of this change.
    pub continues: bool,
    /// Time until animations need another layout.
    pub repaint_in: Option<Duration>,
}

/// How the panel took an event.
pub struct EventResponse {
    /// Mark that the event was meant for the panel.
    pub consumed: bool,
    /// Mark that the panel has to be laid out again.
    pub repaint: bool,
}

/// The panel, and its state in egui.
pub struct Panel {
    input: egui_winit::State,
    /// Position of the cursor `[px]`.
    cursor: egui::Pos2,
    /// True if a drop-down list was open at the last layout.
    list_open: bool,
    /// Factor on the size of everything, besides the user's: of large windows without a scale.
    enlarged: f32,
}

/// Returns how much larger everything is drawn in a window of this size `[px]` than the system's
/// scale says. Systems that know no scale say 1: then text stays as large beside the window as in
/// 1920 x 1080.
fn enlarged([width, height]: [u32; 2], scale: f64) -> f32 {
    /// Steps of a half, so that dragging the window's edge seldom changes it.
    const STEPS: f64 = 2.0;
    let times = (f64::from(width) / 1920.0).min(f64::from(height) / 1080.0);
    if scale == 1.0 { ((times * STEPS).floor() / STEPS).max(1.0) as f32 } else { 1.0 }
}

/// Width of the panel, and its margin `[points]`.
const WIDTH: f32 = 276.0;
const MARGIN: f32 = 8.0;

impl Panel {
    pub fn new(window: &Window) -> Panel {
        let context = egui::Context::default();
        let input = egui_winit::State::new(
            context,
            egui::ViewportId::ROOT,
            window,
            None,
            window.theme(),
            None,
        );
        theme::set(input.egui_ctx());
        let mut panel = Panel { input, cursor: egui::Pos2::ZERO, list_open: false, enlarged: 1.0 };
        panel.fit(window.inner_size().into(), window.scale_factor());
        panel
    }

    /// Fits the size of everything to a window, and keeps what the user has changed it by.
    fn fit(&mut self, size: [u32; 2], scale: f64) {
        let before = std::mem::replace(&mut self.enlarged, enlarged(size, scale));
        if self.enlarged != before {
            let context = self.input.egui_ctx();
            context.set_zoom_factor(context.zoom_factor() * self.enlarged / before);
        }
    }

    /// Returns a panel without textures, for another device; layout and open sections are kept.
    pub fn renewed(&self, window: &Window) -> Panel {
        let renewed = Panel { cursor: self.cursor, enlarged: self.enlarged, ..Panel::new(window) };
        let memory = self.input.egui_ctx().memory(Clone::clone);
        renewed.input.egui_ctx().memory_mut(|own| *own = memory);
        renewed
    }

    /// Passes an event to egui.
    pub fn handle_event(&mut self, window: &Window, event: &WindowEvent) -> EventResponse {
        match event {
            WindowEvent::Resized(size) => self.fit((*size).into(), window.scale_factor()),
            WindowEvent::ScaleFactorChanged { scale_factor, .. } => {
                self.fit(window.inner_size().into(), *scale_factor);
                // On some systems the event comes before the window, which egui asks, knows the new
                // factor.
                let unknown = (scale_factor / window.scale_factor()) as f32;
                self.input.egui_ctx().set_zoom_factor(self.enlarged * unknown);
            }
            _ => {}
        }
        let response = self.input.on_window_event(window, event);
        let consumed = match event {
            WindowEvent::CursorMoved { position, .. } => {
                self.cursor = egui::pos2(position.x as f32, position.y as f32);
                response.consumed
            }
            // Drags that began on the picture end there.
            WindowEvent::MouseInput { state: ElementState::Released, .. } => false,
            // A click may come before the panel has been laid out with the cursor over it.
            WindowEvent::MouseInput { .. } | WindowEvent::MouseWheel { .. } => {
                response.consumed || self.is_over()
            }
            // Escape closes an open list, not the window.
            WindowEvent::KeyboardInput { event, .. }
                if event.physical_key == PhysicalKey::Code(KeyCode::Escape) =>
            {
                response.consumed || self.list_open
            }
            _ => response.consumed,
        };
        EventResponse { consumed, repaint: response.repaint }
    }

    /// Returns whether the cursor is over the panel of the last layout.
    fn is_over(&self) -> bool {
        let context = self.input.egui_ctx();
        let layer = context.layer_id_at(self.cursor / context.pixels_per_point());
        layer.is_some_and(|layer| layer.order != egui::Order::Background)
    }

    /// Returns the width of the window's left part that the panel covers while it is shown `[px]`.
    pub fn width_px(&self, window: &Window) -> f64 {
        (WIDTH * egui_winit::pixels_per_point(self.input.egui_ctx(), window)).into()
    }

    /// Lays out the panel, and everything over the picture.
    pub fn lay_out(
        &mut self,
        window: &Window,
        state: &mut UiState,
        viewport: &Viewport,
        scene: &mut Scene,
    ) -> PanelOutput {
        let view = viewport.view(scene.camera).ok();
        let view = view.as_ref();
        let input = self.input.take_egui_input(window);
        let context = self.input.egui_ctx().clone();
        let resets = input.events.iter().any(resets_size);
        let mut actions = Vec::new();
        let output = context.run_ui(input, |ui| {
            heat_map::show(ui, &mut state.pace);
            if let Some(view) = view {
                measure_overlay::show(ui, &state.measure, view);
                annotate(ui, state, viewport, scene);
                if state.panel.is_shown() {
                    clip_box_widget::handles(ui, &mut scene.clips, view);
                }
            }
            if state.panel.is_shown() {
                panel(ui, state, view, scene, &mut actions);
            } else if state.panel.is_folded() {
                folded(ui, &mut actions);
            }
            if let Some(profile) = &mut state.profile {
                let (reference, stations) = (&state.measure.reference, &state.categories.stations);
                let legend = scene.annotations.legend.then(|| profile.legend(reference, stations));
                let legend = legend.flatten();
                let window = egui::Window::new("profile").default_pos([WIDTH + 60.0, 60.0]);
                let show = |ui: &mut Ui| profile.show(ui, reference, legend.as_ref(), &mut actions);
                window.show(ui.ctx(), show);
            }
            windows::notes(ui.ctx(), state);
            windows::help(ui.ctx(), state);
            windows::error(ui.ctx(), state);
            windows::hint(ui.ctx(), state, &mut actions);
            windows::question(ui.ctx(), state, &mut actions);
        });
        if resets {
            context.set_zoom_factor(self.enlarged);
        }
        let continues =
            context.input(|input| input.pointer.any_down()) || context.text_edit_focused();
        self.list_open = egui::Popup::is_any_open(&context);
        self.input.handle_platform_output(window, output.platform_output);
        let repaint_in =
            output.viewport_output.values().map(|viewport| viewport.repaint_delay).min();
        let overlay = Overlay {
            triangles: context.tessellate(output.shapes, output.pixels_per_point),
            pixels_per_point: output.pixels_per_point,
            textures: output.textures_delta,
        };
        PanelOutput { overlay, actions, continues, repaint_in }
    }
}

/// Returns whether it is the key that resets the size of everything, which egui sets to 1.
fn resets_size(event: &egui::Event) -> bool {
    let egui::Event::Key { key, pressed: true, modifiers, .. } = event else { return false };
    let reset = egui::gui_zoom::kb_shortcuts::ZOOM_RESET;
    *key == reset.logical_key && modifiers.matches_logically(reset.modifiers)
}

/// Draws annotations over the viewport's free part.
fn annotate(ui: &Ui, state: &UiState, viewport: &Viewport, scene: &Scene) {
    let named = state.named(scene).filter(|_| !scene.annotations.is_empty());
    let (Some(named), Ok(view)) = (named, viewport.free_view(scene.camera)) else { return };
    let mut rect = ui.ctx().content_rect();
    rect.min.x = rect.max.x - rect.width() * viewport.free()[0] as f32 / viewport.size()[0] as f32;
    let painter = ui.ctx().layer_painter(egui::LayerId::background());
    scene.annotations.draw(&painter, rect, &view, &named);
}

/// Shows a button in place of the panel.
fn folded(ui: &Ui, actions: &mut Vec<Action>) {
    let corner = ui.ctx().content_rect().min + vec2(MARGIN, MARGIN);
    Area::new(egui::Id::new("folded panel")).fixed_pos(corner).show(ui.ctx(), |ui| {
        let hint = "N: shows or hides the panel";
        if ui.button("panel").on_hover_text(hint).clicked() {
            actions.push(Action::FoldPanel);
        }
    });
}

/// Shows the panel on the left, as high as the window.
fn panel(
    ui: &Ui,
    state: &mut UiState,
    view: Option<&View>,
    scene: &mut Scene,
    actions: &mut Vec<Action>,
) {
    let all = ui.ctx().content_rect();
    let area = Area::new(egui::Id::new("panel")).fixed_pos(all.min).order(Order::Middle);
    area.constrain(false).show(ui.ctx(), |ui| {
        let frame = Frame::NONE.fill(theme::FILL).inner_margin(Margin::same(MARGIN as i8));
        frame.show(ui, |ui| {
            let size = vec2(WIDTH, all.height()) - vec2(2.0 * MARGIN, 2.0 * MARGIN);
            ui.set_min_size(size);
            ui.set_max_size(size);
            let bare = |panel: egui::Panel| {
                panel.frame(Frame::NONE).resizable(false).show_separator_line(false)
            };
            bare(egui::Panel::top("header")).show(ui, |ui| header::show(ui, state, scene, actions));
            bare(egui::Panel::bottom("footer"))
                .show(ui, |ui| footer::show(ui, state, view, actions));
            egui::CentralPanel::no_frame().show(ui, |ui| {
                let tab = state.tab;
                ScrollArea::vertical().id_salt(tab as u8).auto_shrink(false).show(
                    ui,
                    |ui| match tab {
                        Tab::Look => look::show(ui, state, scene, actions),
                        Tab::Measure => measures::show(ui, state, actions),
                        Tab::Layers => layers::show(ui, state, view, scene, actions),
                    },
                );
            });
        });
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_in_large_windows_without_a_scale_is_as_large_as_on_smaller_monitors() {
        let sizes = [[640, 480], [1920, 1080], [2560, 1440], [3840, 2160], [3840, 1080]];
        assert_eq!(sizes.map(|size| enlarged(size, 1.0)), [1.0, 1.0, 1.0, 2.0, 1.0]);
        assert_eq!(enlarged([3840, 2160], 1.5), 1.0);
    }
}
