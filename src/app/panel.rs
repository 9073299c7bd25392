//! The panel: what is drawn and why, and all settings, from the registry of effects. UI state and a
//! scene in, triangles and actions out.

use super::actions::Action;
use super::keys::{self, KEYS};
use super::load_thread::Categories;
use super::measure::{self, Looked, Measure};
use super::navigation::{Input, Mode, NavigationStyle};
use super::profile::Profile;
use super::render_thread::Loading;
use super::{clip_box_widget, legend, light_widget};
use crate::cloud::Station;
use crate::cloud::attribute::{Attribute, DisplayAttribute, class_name};
use crate::cloud::color_scale::{ColorScale, Ramp};
use crate::cloud::histograms::Histograms;
use crate::output::annotations::{Annotations, Shown};
use crate::passes::{Choice, EffectDecisions, Effects, Listed, Setting, Switch, Value};
use crate::present::overlay::Overlay;
use crate::render::scene::Scene;
use crate::render::settings::Style;
use crate::select::lod::LodOptions;
use crate::select::opacity::{Opacities, Rule, What};
use crate::view::View;
use crate::view::camera_path::CameraPath;
use clap::ValueEnum;
use egui::text::{LayoutJob, TextFormat};
use egui::{
    CollapsingHeader, Color32, ComboBox, DragValue, ProgressBar, RichText, ScrollArea, Slider,
    TextStyle, Ui,
};
use glam::DVec3;
use std::time::Duration;
use winit::event::{ElementState, WindowEvent};
use winit::keyboard::{KeyCode, PhysicalKey};
use winit::window::Window;

/// State that the panel shows and edits, besides the scene.
#[derive(Default)]
pub struct UiState {
    /// What is drawn in the picture.
    pub annotations: Annotations,
    /// Names of the open files.
    pub title: String,
    /// Work in progress, or its last result.
    pub doing: Option<String>,
    /// The last errors, until dismissed.
    pub error: Option<String>,
    /// The error dismissed last; it is not shown again until the next action.
    pub dismissed_error: Option<String>,
    /// Points of the whole cloud.
    pub points: u64,
    /// Points of the last frame.
    pub drawn: u64,
    /// Whether filters may leave out some of these.
    pub at_most: bool,
    pub latency: Duration,
    pub took: Duration,
    /// Device time of every pass `[ms]`.
    pub passes: Vec<(String, f64)>,
    pub decisions: EffectDecisions,
    pub shown: Option<DisplayAttribute>,
    /// Reason for the displayed attribute.
    pub why_shown: String,
    /// Oddities of the files.
    pub notes: Vec<String>,
    /// Settings that have no effect on the last frame, and other notes on it.
    pub picture_notes: Vec<String>,
    /// Loading of an index; None for files.
    pub loading: Option<Loading>,
    /// Bytes read of the index.
    pub bytes_read: u64,
    pub categories: Categories,
    pub mode: Mode,
    pub style: NavigationStyle,
    /// The picked points.
    pub measure: Measure,
    /// Size of saved pictures.
    pub save_size: SaveSize,
    /// Width of profiles `[m]`; 0: by their length.
    pub width: f64,
    pub profile: Option<Profile>,
    /// The camera path.
    pub path: CameraPath,
    /// Whether the path is played.
    pub plays: bool,
    /// Whether the list of keys is shown.
    pub help: bool,
    /// Whether the panel is hidden.
    pub hidden: bool,
}

impl UiState {
    /// Dismisses the error, or else closes the profile; false if there is neither.
    pub fn dismiss(&mut self) -> bool {
        let was = self.error.take();
        if was.is_none() && self.profile.take().is_some() {
            return true;
        }
        let any = was.is_some();
        self.dismissed_error = was.or(self.dismissed_error.take());
        any
    }
}

/// Size of a saved picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SaveSize {
    /// A multiple of the window's size.
    Times(u32),
    /// A size `[px]`.
    To([u32; 2]),
}

impl Default for SaveSize {
    fn default() -> SaveSize {
        SaveSize::Times(1)
    }
}

impl SaveSize {
    /// Returns the size `[px]` for a window of this size.
    pub fn of(self, window: [u32; 2]) -> [u32; 2] {
        match self {
            SaveSize::Times(times) => window.map(|side| side * times),
            SaveSize::To(size) => size,
        }
    }
}

/// Result of laying out the panel.
pub struct PanelOutput {
    pub overlay: Overlay,
    pub actions: Vec<Action>,
    /// Time until animations need another layout.
    pub repaint_in: Option<Duration>,
}

/// How the panel took an event.
pub struct EventResponse {
    /// Whether the event was meant for the panel.
    pub consumed: bool,
    /// Whether the panel has to be laid out again.
    pub repaint: bool,
}

/// The panel, and its state in egui.
pub struct Panel {
    input: egui_winit::State,
    /// Position of the cursor `[px]`.
    cursor: egui::Pos2,
    /// Whether a drop-down list was open at the last layout.
    list_open: bool,
    /// Width of the window's left part that the panel covers `[px]`, at the last layout; 0 if it lies
    /// elsewhere or is folded.
    covers_px: f64,
}

/// Width of the panel `[points]`.
const WIDTH: f32 = 250.0;

/// Least share of the frame time that a pass needs to be listed.
const LEAST_SHARE: f64 = 0.01;

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
        Panel { input, cursor: egui::Pos2::ZERO, list_open: false, covers_px: 0.0 }
    }

    /// Returns a panel without textures, for another device; layout and open sections are kept.
    pub fn renewed(&self, window: &Window) -> Panel {
        let renewed = Panel { cursor: self.cursor, ..Panel::new(window) };
        let memory = self.input.egui_ctx().memory(Clone::clone);
        renewed.input.egui_ctx().memory_mut(|own| *own = memory);
        renewed
    }

    /// Passes an event to egui.
    pub fn handle_event(&mut self, window: &Window, event: &WindowEvent) -> EventResponse {
        if let WindowEvent::ScaleFactorChanged { scale_factor, .. } = event {
            // On some systems the event comes before the window, which egui asks, knows the new
            // factor.
            self.input.egui_ctx().set_zoom_factor((scale_factor / window.scale_factor()) as f32);
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

    /// Returns the width of the window's left part that the panel covers `[px]`.
    pub fn covers_px(&self, hidden: bool) -> f64 {
        if hidden { 0.0 } else { self.covers_px }
    }

    /// Lays out the panel, and everything over the picture.
    pub fn lay_out(
        &mut self,
        window: &Window,
        state: &mut UiState,
        view: Option<&View>,
        scene: &mut Scene,
    ) -> PanelOutput {
        let input = self.input.take_egui_input(window);
        let context = self.input.egui_ctx().clone();
        let (mut actions, mut covers) = (Vec::new(), 0.0);
        let output = context.run_ui(input, |ui| {
            if let Some(view) = view {
                measure_overlay(ui, &state.measure, view);
                if let Some(named) = state.named(scene).filter(|_| !state.annotations.is_empty()) {
                    let painter = ui.ctx().layer_painter(egui::LayerId::background());
                    state.annotations.draw(&painter, ui.ctx().content_rect(), view, &named);
                }
            }
            let tall = ui.ctx().content_rect().height() - 60.0;
            if let Some(view) = view.filter(|_| !state.hidden) {
                clip_box_widget::handles(ui, &mut scene.clips, view);
            }
            if !state.hidden {
                let shown = egui::Window::new("pointillist")
                    .default_pos([8.0, 8.0])
                    .default_size([WIDTH, tall])
                    .show(ui.ctx(), |ui| {
                        ScrollArea::vertical()
                            .show(ui, |ui| contents(ui, state, view, scene, &mut actions));
                    });
                let rect = shown.map_or(egui::Rect::NOTHING, |shown| shown.response.rect);
                let on_the_left = rect.left() < WIDTH / 4.0 && rect.height() > tall / 2.0;
                covers = if on_the_left { rect.right() } else { 0.0 };
            }
            if let Some(profile) = &mut state.profile {
                egui::Window::new("profile")
                    .default_pos([WIDTH + 60.0, 60.0])
                    .show(ui.ctx(), |ui| profile.show(ui, &state.measure.reference, &mut actions));
            }
            error_window(ui.ctx(), state);
            if state.help {
                egui::Window::new("keys")
                    .default_pos([WIDTH + 60.0, 8.0])
                    .show(ui.ctx(), |ui| keys(ui, state));
            }
        });
        self.covers_px = (covers * output.pixels_per_point).into();
        self.list_open = egui::Popup::is_any_open(&context);
        self.input.handle_platform_output(window, output.platform_output);
        let repaint_in =
            output.viewport_output.values().map(|viewport| viewport.repaint_delay).min();
        let overlay = Overlay {
            triangles: context.tessellate(output.shapes, output.pixels_per_point),
            pixels_per_point: output.pixels_per_point,
            textures: output.textures_delta,
        };
        PanelOutput { overlay, actions, repaint_in }
    }
}

fn contents(
    ui: &mut Ui,
    state: &mut UiState,
    view: Option<&View>,
    scene: &mut Scene,
    actions: &mut Vec<Action>,
) {
    if let Some(doing) = &state.doing {
        ui.label(RichText::new(doing).color(Color32::LIGHT_BLUE));
    }
    let hidden = scene
        .opacities
        .0
        .iter()
        .filter(|rule| rule.opacity == 0.0)
        .map(|rule| rule.what.to_string());
    let without = hidden
        .reduce(|all, one| format!("{all}, {one}"))
        .map_or(String::new(), |hidden| format!(", without {hidden}"));
    let at_most = if state.at_most { "at most " } else { "" };
    ui.label(format!(
        "{}\n{at_most}{} of {} points{without}",
        state.title,
        grouped(state.drawn),
        grouped(state.points)
    ));
    loading(ui, state, view, &mut scene.lod);
    notes(ui, state);
    ui.horizontal(|ui| {
        for mode in Mode::ALL {
            if ui.selectable_label(state.mode == mode, mode.name()).clicked() && state.mode != mode
            {
                actions.push(Action::Navigate(Input::Drag { mode }));
            }
        }
        if ui.button("keys").clicked() {
            actions.push(Action::Help);
        }
    });
    style(ui, &mut scene.settings.effects);
    picked(ui, state, actions);
    color(ui, state, scene);
    annotations(ui, &mut state.annotations);
    filters(ui, state, &mut scene.opacities);
    let mut added = false;
    clip_box_widget::list(ui, &mut scene.clips, &mut added);
    if added {
        actions.push(Action::AddBox);
    }
    light_widget::choose(ui, &mut scene.settings.light, scene.camera.eye);
    CollapsingHeader::new("effects").default_open(true).show(ui, |ui| {
        for listed in scene.settings.effects.list() {
            effect(ui, listed, &state.decisions);
        }
        layer_distance(ui, &mut scene.settings.layer_m);
    });
    CollapsingHeader::new("what runs, and why").show(ui, |ui| {
        for (effect, reason) in &state.decisions.0 {
            let title = RichText::new(format!(
                "{} {}:",
                effect.name(),
                if reason.runs { "on" } else { "off" }
            ));
            ui.horizontal_wrapped(|ui| {
                ui.label(title.color(if reason.runs {
                    Color32::LIGHT_GREEN
                } else {
                    Color32::GRAY
                }));
                ui.label(spaced_hyphens(ui, &reason.why));
            });
        }
    });
    camera_path(ui, state, actions);
    CollapsingHeader::new(format!("picture, {:.1} ms", state.took.as_secs_f64() * 1e3))
        .id_salt("passes")
        .show(ui, |ui| passes(ui, state));
    save_size_row(ui, &mut state.save_size, view);
    ui.horizontal(|ui| {
        if ui.button("save picture").on_hover_text("F9").clicked() {
            actions.push(Action::SavePicture);
        }
        if ui
            .button("save layers")
            .on_hover_text("L: depth, point ids, normals and more, as EXR")
            .clicked()
        {
            actions.push(Action::SaveLayers);
        }
    });
    ui.horizontal(|ui| {
        let for_render = spaced_hyphens(ui, "F8, for render --scene");
        if ui.button("save scene").on_hover_text(for_render).clicked() {
            actions.push(Action::SaveScene);
        }
        if ui
            .button("load scene")
            .on_hover_text("F6: the one saved last; others are dropped on the window")
            .clicked()
        {
            actions.push(Action::LoadScene);
        }
    });
}

/// Chooses how points are drawn. Strokes need what is computed while a cloud is loaded, so they are
/// offered only where they are drawn.
fn style(ui: &mut Ui, effects: &mut Effects) {
    ui.horizontal(|ui| {
        let current = effects.style();
        for &style in Style::value_variants() {
            let is_offered = style != Style::Strokes || current == Some(Style::Strokes);
            let name = style.to_possible_value().expect("no style is hidden");
            if is_offered && ui.selectable_label(current == Some(style), name.get_name()).clicked()
            {
                effects.set_style(style);
            }
        }
    });
}

/// Lists notes on the files and the picture; folded if there are many.
fn notes(ui: &mut Ui, state: &UiState) {
    const FEW: usize = 4;
    let noted = |text: &str| RichText::new(text).color(Color32::LIGHT_YELLOW);
    let notes: Vec<_> = state.notes.iter().chain(&state.picture_notes).collect();
    let all = |ui: &mut Ui| notes.iter().for_each(|note| drop(ui.label(noted(note))));
    if notes.len() <= FEW {
        all(ui);
    } else {
        CollapsingHeader::new(noted(&format!("{} notes", notes.len())))
            .id_salt("notes")
            .show(ui, all);
    }
}

/// Shows the last errors in a window, until it is closed.
fn error_window(context: &egui::Context, state: &mut UiState) {
    let Some(text) = &state.error else { return };
    let mut unread = true;
    let above = egui::Window::new("error")
        .open(&mut unread)
        .anchor(egui::Align2::CENTER_BOTTOM, [0.0, -20.0])
        .collapsible(false);
    above.show(context, |ui| ui.label(RichText::new(text).color(Color32::LIGHT_RED)));
    if !unread {
        state.dismiss();
    }
}

/// Chooses the size of saved pictures: a multiple of the window, or any size.
fn save_size_row(ui: &mut Ui, save_size: &mut SaveSize, view: Option<&View>) {
    const MOST: u32 = 262_144;
    let window = view.map_or([1, 1], |view| view.size);
    ui.horizontal(|ui| {
        for times in [1, 2, 4] {
            ui.selectable_value(save_size, SaveSize::Times(times), format!("{times}x"));
        }
        let is_other = matches!(save_size, SaveSize::To(_));
        if ui.selectable_label(is_other, "other").clicked() && !is_other {
            *save_size = SaveSize::To(save_size.of(window));
        }
        match save_size {
            SaveSize::To(sides) => {
                sides.iter_mut().for_each(|side| drop(ui.add(DragValue::new(side).range(1..=MOST))))
            }
            SaveSize::Times(_) => {
                drop(ui.label(save_size.of(window).map(|side| side.to_string()).join(" x ")))
            }
        }
    });
}

fn color(ui: &mut Ui, state: &UiState, scene: &mut Scene) {
    /// Height of the list of attributes `[points]`.
    const LIST: f32 = 300.0;
    let automatic =
        || state.shown.map_or("auto".into(), |shown| format!("auto: {}", shown.attribute.name()));
    let combo = ComboBox::from_label("color")
        .height(LIST)
        .selected_text(scene.color.map_or_else(automatic, Attribute::name))
        .show_ui(ui, |ui| {
            ui.selectable_value(&mut scene.color, None, "auto");
            for &attribute in &Attribute::NAMED {
                ui.selectable_value(&mut scene.color, Some(attribute), attribute.name());
            }
        });
    if scene.color.is_none() && !state.why_shown.is_empty() {
        combo.response.on_hover_text(format!("because {}", state.why_shown));
    }
    if let Some(shown) = &state.shown {
        let mut shown = *shown;
        shown.scale = scene.scale;
        legend::ramp(ui, &shown, &state.categories.reference);
        scale(ui, &shown, &mut scene.scale);
    }
    ui.horizontal(|ui| {
        ui.color_edit_button_srgb(&mut scene.settings.background);
        ui.label("background");
    });
}

impl UiState {
    /// Returns what annotations name of the displayed cloud, if there is one.
    pub fn named(&self, scene: &Scene) -> Option<Shown> {
        let mut attribute = self.shown?;
        attribute.scale = scene.scale;
        let Categories { classes, returns, stations, reference, up } = self.categories.clone();
        let counts = Histograms { classes, returns };
        Some(Shown { attribute, reference, up, counts, stations })
    }
}

/// Chooses what is drawn in the picture, as `--title` and its like do.
fn annotations(ui: &mut Ui, own: &mut Annotations) {
    CollapsingHeader::new("in the picture").show(ui, |ui| {
        ui.horizontal(|ui| {
            let mut title = own.title.take().unwrap_or_default();
            ui.label("title");
            ui.text_edit_singleline(&mut title);
            own.title = Some(title).filter(|title| !title.is_empty());
        });
        ui.horizontal_wrapped(|ui| {
            ui.checkbox(&mut own.legend, "legend");
            ui.checkbox(&mut own.scale_bar, "scale bar");
            ui.checkbox(&mut own.north_arrow, "north arrow");
            ui.checkbox(&mut own.axes, "axes");
        });
    });
}

/// Edits how numbers and channels become colours.
fn scale(ui: &mut Ui, shown: &DisplayAttribute, scale: &mut ColorScale) {
    if let Some(mut ends) = shown.ends() {
        let [lo, hi] = ends;
        let speed = ((hi - lo) / 200.0).max(1e-6);
        ui.horizontal(|ui| {
            let [low, high] = &mut ends;
            ui.add(DragValue::new(low).range(f64::MIN..=hi.next_down()).speed(speed));
            ui.add(DragValue::new(high).range(lo.next_up()..=f64::MAX).speed(speed));
            if ends != [lo, hi] {
                scale.range = Some(ends);
            }
            if scale.range.is_some() && ui.button("auto").clicked() {
                scale.range = None;
            }
            let name = |ramp: Ramp| format!("{ramp:?}").to_lowercase();
            ComboBox::from_id_salt("ramp").selected_text(name(shown.ramp())).show_ui(ui, |ui| {
                for &ramp in Ramp::value_variants() {
                    ui.selectable_value(&mut scale.ramp, Some(ramp), name(ramp));
                }
            });
        });
    }
    if shown.attribute.is_label() {
        return;
    }
    CollapsingHeader::new("brightness").show(ui, |ui| {
        ui.add(Slider::new(&mut scale.brightness, -1.0..=1.0).text("brightness"));
        ui.add(Slider::new(&mut scale.contrast, 0.0..=4.0).text("contrast"));
        ui.add(Slider::new(&mut scale.gamma, 0.2..=5.0).logarithmic(true).text("gamma"));
        if ui.button("reset").clicked() {
            *scale = ColorScale { ramp: scale.ramp, range: scale.range, ..ColorScale::default() };
        }
    });
}

/// Shows how much of an index is drawn and loaded, and edits the level of detail.
fn loading(ui: &mut Ui, state: &UiState, view: Option<&View>, options: &mut LodOptions) {
    let (
        Some(Loading {
            fitting, nodes, awaited, largest_error_px, pool_bytes: [pool, used], ..
        }),
        Some(view),
    ) = (state.loading, view)
    else {
        return;
    };
    let reading = if awaited > 0 {
        format!("{awaited} of {nodes} nodes loading")
    } else {
        format!("{nodes} nodes, all loaded")
    };
    let said = format!("index: {reading}, {:.1} MB read", state.bytes_read as f64 / 1e6);
    let fine = format!(
        "Largest projected error: {largest_error_px:.2} px. Pool: {} of at most {} MiB in use.",
        used >> 20,
        pool >> 20
    );
    ui.label(said).on_hover_text(fine);
    let asked = options.of(view.size);
    let (mut most, mut lod) = (asked.budget, asked.lod_px);
    ui.horizontal(|ui| {
        if ui
            .add(
                DragValue::new(&mut most)
                    .range(1_000..=u32::MAX as u64)
                    .clamp_existing_to_range(false)
                    .speed(10_000.0)
                    .suffix(" points at most"),
            )
            .changed()
        {
            options.budget = Some(most);
        }
        if ui
            .add(
                DragValue::new(&mut lod)
                    .range(0.0..=64.0)
                    .clamp_existing_to_range(false)
                    .speed(0.02)
                    .max_decimals(2)
                    .suffix(" px apart"),
            )
            .changed()
        {
            options.lod_px = Some(lod);
        }
        if *options != LodOptions::default() && ui.small_button("auto").clicked() {
            *options = LodOptions::default();
        }
    });
    if let Some(fitting) = fitting {
        ui.label(
            RichText::new(format!("{} points fit the device's memory", grouped(fitting))).weak(),
        );
    }
}

fn effect(ui: &mut Ui, listed: Listed, decisions: &EffectDecisions) {
    let Listed { effect, about, switch, settings } = listed;
    let (name, reason) = (effect.name(), decisions.reason(effect));
    ui.horizontal(|ui| {
        for choice in [Switch::Off, Switch::Auto, Switch::On] {
            ui.selectable_value(switch, choice, Choice::name(&choice));
        }
        let runs = reason.is_some_and(|reason| reason.runs);
        let title =
            RichText::new(name).color(if runs { Color32::LIGHT_GREEN } else { Color32::GRAY });
        let why = reason.map_or(String::new(), |reason| {
            format!("\n\n{}, because {}", if runs { "on" } else { "off" }, reason.why)
        });
        ui.label(title).on_hover_text(format!("{about}{why}"));
    });
    if !settings.is_empty() && *switch != Switch::Off {
        ui.indent(name, |ui| {
            CollapsingHeader::new("settings")
                .id_salt((name, "settings"))
                .show(ui, |ui| settings.into_iter().for_each(|one| setting(ui, one)));
        });
    }
}

/// Edits the layer distance `[m]` of all effects; 0: automatic.
fn layer_distance(ui: &mut Ui, layer_m: &mut f64) {
    let said = |layer_m: f64, _| {
        if layer_m == 0.0 { "automatic".to_string() } else { format!("{layer_m} m") }
    };
    let read = |text: &str| {
        if text.trim() == "automatic" {
            Some(0.0)
        } else {
            text.trim().trim_end_matches('m').trim().parse().ok()
        }
    };
    ui.horizontal(|ui| {
        ui.add(DragValue::new(layer_m).range(0.0..=1e9).speed(0.01).max_decimals(4).custom_formatter(said).custom_parser(read));
        ui.label("between layers")
            .on_hover_text("surfaces nearer to each other than this are one surface: for fill=method=mask, transparency and shadows");
    });
}

fn setting(ui: &mut Ui, setting: Setting) {
    let Setting { name, about, value, .. } = setting;
    let response = match value {
        Value::Number(number, range) => {
            // On a linear slider over decades, all small values would be at one end.
            let wide = range.end() - range.start() > 1000.0;
            ui.add(Slider::new(number, range).logarithmic(wide).text(name))
        }
        Value::Whole(number, range) => {
            let wide = range.end() - range.start() > 1000.0;
            ui.add(Slider::new(number, range).logarithmic(wide).integer().text(name))
        }
        Value::OneOf(number, of) => {
            let shown =
                ComboBox::from_label(name).selected_text(number.to_string()).show_ui(ui, |ui| {
                    of.iter()
                        .for_each(|one| drop(ui.selectable_value(number, *one, one.to_string())));
                });
            shown.response
        }
        Value::Choice(choice) => {
            let shown = ComboBox::from_label(name).selected_text(choice.name()).show_ui(ui, |ui| {
                for other in choice.names() {
                    if ui.selectable_label(other == choice.name(), &other).clicked() {
                        choice.choose(&other);
                    }
                }
            });
            shown.response
        }
    };
    response.on_hover_text(about);
}

/// Lists classes, returns and stations with their colours; unticked ones get a rule of opacity 0.
fn filters(ui: &mut Ui, state: &UiState, opacities: &mut Opacities) {
    let Categories { classes, returns, stations, .. } = &state.categories;
    let class = |&(number, count): &(u8, u64)| {
        let name = class_name(number).map_or(String::new(), |name| format!(" {name}"));
        (What::Class(number), number, format!("{number}{name}: {}", grouped(count)))
    };
    let returned = |&(number, count): &(u8, u64)| {
        (What::Return(number), number, format!("{number}: {}", grouped(count)))
    };
    // Colours are of the lower byte of the source.
    let station = |Station { name, source, points, .. }: &Station| {
        (
            What::Station(name.clone()),
            source.unwrap_or(0) as u8,
            format!("{name}: {}", grouped(*points)),
        )
    };
    let lists = [
        ("classes", Attribute::Class, classes.iter().map(class).collect::<Vec<_>>()),
        ("returns", Attribute::Return, returns.iter().map(returned).collect()),
        ("stations", Attribute::Source, stations.iter().map(station).collect()),
    ];
    for (title, attribute, list) in lists.into_iter().filter(|(.., list)| list.len() > 1) {
        let is_legend = state.shown.is_some_and(|shown| shown.attribute == attribute);
        CollapsingHeader::new(title).default_open(is_legend).show(ui, |ui| {
            for (what, number, text) in list {
                let hides = |rule: &Rule| rule.what == what && rule.opacity == 0.0;
                let mut drawn = !opacities.0.iter().any(hides);
                let changed = ui.horizontal(|ui| {
                    if is_legend {
                        legend::swatch(ui, attribute, number);
                    }
                    ui.checkbox(&mut drawn, text).changed()
                });
                if changed.inner {
                    opacities.0.retain(|rule| !hides(rule));
                    if !drawn {
                        opacities.0.push(Rule { what, opacity: 0.0 });
                    }
                }
            }
        });
    }
}

fn camera_path(ui: &mut Ui, state: &UiState, actions: &mut Vec<Action>) {
    let keys = state.path.keys.len();
    CollapsingHeader::new(format!("camera path, {keys} views, {:.1} s", state.path.duration()))
        .id_salt("camera path")
        .show(ui, |ui| {
            ui.horizontal(|ui| {
                let play = if state.plays { "stop" } else { "play" };
                for (name, key, action, useful) in [
                    ("add view", "K", Action::AddKey, true),
                    (play, "Space", Action::Play, keys > 0),
                    ("save", "F7, for render --path", Action::SavePath, keys > 0),
                    ("forget", "", Action::ForgetPath, keys > 0),
                ] {
                    let key = spaced_hyphens(ui, key);
                    if ui.add_enabled(useful, egui::Button::new(name)).on_hover_text(key).clicked()
                    {
                        actions.push(action);
                    }
                }
            });
        });
}

/// Shows the picked points: coordinates in all digits, records, and measures.
fn picked(ui: &mut Ui, state: &mut UiState, actions: &mut Vec<Action>) {
    let UiState { measure, width, .. } = state;
    let Some(measure::Picked { point, record }) = measure.points.last() else { return };
    CollapsingHeader::new("picked").default_open(true).show(ui, |ui| {
        let DVec3 { x, y, z } = measure.reference.digits.round(point.position);
        ui.label(format!(
            "x {x}\ny {y}\nz {z}{}",
            if point.exact { "" } else { "\napproximate: not all of its digits are loaded" }
        ));
        if let Some([class, number, station]) = measure::kind(point) {
            ui.label(format!("class {class}, return {number}, station {station}"));
        }
        ui.label(match record {
            Looked::Found(record) => record.to_string().replace(", ", "\n"),
            Looked::Underway => "being looked up in its file".into(),
            Looked::Nowhere => {
                "a sample that stands for several points of the file; zoom in to pick one of them"
                    .into()
            }
        });
        if measure.points.len() > 1 {
            let (unit, height) = (measure.reference.unit(), measure.reference.height_unit());
            let mut text = format!(
                "{} points\ndistance {}\nheight {}\nhorizontal {}",
                measure.points.len(),
                unit.length(measure.distance(), 4),
                height.length(measure.height(), 4),
                unit.length(measure.horizontal(), 4)
            );
            let length = || unit.length(measure.length(), 4);
            text += &measure
                .angle()
                .map_or(String::new(), |angle| format!("\nlength {}\nangle {angle:.3}°", length()));
            text += &measure
                .area()
                .map_or(String::new(), |area| format!("\narea {}", unit.area(area, 4)));
            ui.label(text);
            ui.horizontal(|ui| {
                if ui.button("profile").on_hover_text("X: of the points along the line").clicked() {
                    actions.push(Action::Profile);
                }
                let said = |width: f64, _| {
                    if width == 0.0 {
                        "automatic width".into()
                    } else {
                        format!("{width:.4} {} wide", unit.symbol())
                    }
                };
                let read = |text: &str| {
                    text.split_whitespace().next().and_then(|number| number.parse().ok())
                };
                ui.add(
                    DragValue::new(width)
                        .range(0.0..=f64::INFINITY)
                        .speed(0.01)
                        .custom_formatter(said)
                        .custom_parser(read),
                );
            });
        }
        ui.label(RichText::new("shift and click for one more").weak());
        ui.horizontal(|ui| {
            for extension in ["csv", "geojson"] {
                if ui.button(extension).clicked() {
                    actions.push(Action::Export(extension));
                }
            }
            if ui.button("forget").clicked() {
                actions.push(Action::Forget);
            }
        });
    });
}

/// Draws the picked points over the picture, with the line through them, lengths, angle and area.
fn measure_overlay(ui: &Ui, measure: &Measure, view: &View) {
    let painter = ui.ctx().layer_painter(egui::LayerId::background());
    let per_point = ui.ctx().pixels_per_point();
    let seen =
        |place: DVec3| view.pixel(place).map(|[x, y]| egui::pos2(x as f32, y as f32) / per_point);
    /// Distance of a label above its line or point `[points]`; that of the area is below.
    const ABOVE: f32 = 14.0;
    let stroke = egui::Stroke::new(2.0, Color32::YELLOW);
    let label = |place: DVec3, above: f32, text: String| {
        let Some(at) = seen(place) else { return };
        let text = painter.layout_no_wrap(text, egui::FontId::proportional(13.0), Color32::WHITE);
        let rect = egui::Rect::from_center_size(at - egui::vec2(0.0, above), text.size());
        painter.rect_filled(rect.expand(2.0), 2.0, Color32::from_black_alpha(160));
        painter.galley(rect.min, text, Color32::WHITE);
    };
    let (places, unit) = (measure.places(), measure.reference.unit());
    for pair in places.windows(2) {
        if let [Some(a), Some(b)] = [seen(pair[0]), seen(pair[1])] {
            painter.line_segment([a, b], stroke);
        }
    }
    for at in places.iter().filter_map(|&place| seen(place)) {
        painter.circle_stroke(at, 5.0, stroke);
    }
    for pair in places.windows(2) {
        label(pair[0].midpoint(pair[1]), ABOVE, unit.length(pair[0].distance(pair[1]), 3));
    }
    if let (Some(angle), &[.., corner, _]) = (measure.angle(), &places[..]) {
        label(corner, ABOVE, format!("{angle:.2}°"));
    }
    if let (Some(area), Some(&first)) = (measure.area(), places.first()) {
        let from_first: DVec3 = places.iter().map(|&place| place - first).sum();
        label(first + from_first / places.len() as f64, -ABOVE, unit.area(area, 3));
    }
}

fn passes(ui: &mut Ui, state: &UiState) {
    let total: f64 = state.passes.iter().map(|(_, ms)| ms).sum();
    let mut by_name: Vec<(&str, f64)> = Vec::new();
    for (name, ms) in &state.passes {
        match by_name.iter_mut().find(|(known, _)| known == name) {
            Some((_, sum)) => *sum += ms,
            None => by_name.push((name, *ms)),
        }
    }
    // Once a software device has rasterised a panel, its timestamps all come from the end of a
    // submission.
    if total < 0.5 * state.took.as_secs_f64() * 1e3 {
        ui.label(
            RichText::new("a software device cannot time passes under a panel; render can, with its option timings").weak(),
        );
    } else {
        for (name, ms) in by_name.into_iter().filter(|(_, ms)| *ms >= LEAST_SHARE * total) {
            ui.add(ProgressBar::new((ms / total) as f32).text(format!("{name} {ms:.2} ms")));
        }
    }
    ui.label(format!("from change to picture: {:.1} ms", state.latency.as_secs_f64() * 1e3));
}

/// Lists what the mouse and every key do.
fn keys(ui: &mut Ui, state: &UiState) {
    let keys = KEYS.iter().map(|key| (key.name, key.about));
    egui::Grid::new("keys").show(ui, |ui| {
        for (name, about) in keys::mouse(state.style, state.mode).into_iter().chain(keys) {
            ui.label(RichText::new(name).strong());
            ui.label(spaced_hyphens(ui, about));
            ui.end_row();
        }
    });
}

/// Lays out text with a gap between two hyphens, which would touch or become a dash.
fn spaced_hyphens(ui: &Ui, text: &str) -> LayoutJob {
    const ROOM: f32 = 1.5;
    let format = TextFormat::simple(TextStyle::Body.resolve(ui.style()), Color32::PLACEHOLDER);
    let mut job = LayoutJob::default();
    for (number, part) in text.split("--").enumerate() {
        if number > 0 {
            job.append("-", 0.0, format.clone());
            job.append("-", ROOM, format.clone());
        }
        job.append(part, 0.0, format.clone());
    }
    job
}

/// Formats a number with its digits in groups of three.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let threes: Vec<&str> = digits
        .as_bytes()
        .rchunks(3)
        .rev()
        .map(|three| std::str::from_utf8(three).expect("digits"))
        .collect();
    threes.join(",")
}

#[cfg(test)]
mod tests {
    #[test]
    fn digits_are_grouped_by_three() {
        assert_eq!(
            [0, 12, 999, 1000, 1_234_567].map(super::grouped),
            ["0", "12", "999", "1,000", "1,234,567"]
        );
    }
}
