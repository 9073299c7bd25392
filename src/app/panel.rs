//! The panel: what is drawn and why, and everything that people may choose, from the registry of effects. UiState and a scene in, triangles and actions out.

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
use crate::passes::{Choice, Decided, Listed, Setting, Switch, Value};
use crate::present::overlay::Overlay;
use crate::render::scene::Scene;
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

/// What the panel says.
#[derive(Default)]
pub struct UiState {
    /// What is open.
    pub title: String,
    /// What is going on besides.
    pub doing: Option<String>,
    /// The last thing that went wrong, until somebody puts it away; and that.
    pub error: Option<String>,
    pub dismissed_error: Option<String>,
    /// Of the whole cloud.
    pub points: u64,
    /// Of the last picture; some of them may be left out.
    pub drawn: u64,
    pub at_most: bool,
    pub latency: Duration,
    pub took: Duration,
    /// Milliseconds on the device of every pass.
    pub passes: Vec<(String, f64)>,
    pub decided: Decided,
    pub shown: Option<DisplayAttribute>,
    /// Why they show that.
    pub why_shown: String,
    /// What is odd about the files, and what was asked for of the picture and changes nothing.
    pub notes: Vec<String>,
    pub picture_notes: Vec<String>,
    /// Of an index, and all that has been read of it.
    pub loading: Option<Loading>,
    pub bytes_read: u64,
    pub categories: Categories,
    pub mode: Mode,
    pub style: NavigationStyle,
    /// All that was picked.
    pub measure: Measure,
    /// How large pictures are saved.
    pub save_size: SaveSize,
    /// Of profiles, metres; 0: by their length.
    pub width: f64,
    pub profile: Option<Profile>,
    /// Key views, and whether the camera flies along them.
    pub path: CameraPath,
    pub plays: bool,
    /// The keys are shown.
    pub help: bool,
    /// Nothing but the picture is shown.
    pub hidden: bool,
}

impl UiState {
    /// Whether there was anything to put away: what went wrong, or else a profile.
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

/// The size of a picture that is saved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SaveSize {
    /// The window's, so many times.
    Times(u32),
    /// Pixels.
    To([u32; 2]),
}

impl Default for SaveSize {
    fn default() -> SaveSize {
        SaveSize::Times(1)
    }
}

impl SaveSize {
    pub fn of(self, window: [u32; 2]) -> [u32; 2] {
        match self {
            SaveSize::Times(times) => window.map(|side| side * times),
            SaveSize::To(size) => size,
        }
    }
}

pub struct PanelOutput {
    pub overlay: Overlay,
    pub actions: Vec<Action>,
    /// Something in it moves by itself.
    pub repaint_in: Option<Duration>,
}

/// What became of an event.
pub struct EventResponse {
    /// It was the panel's.
    pub consumed: bool,
    /// The panel may look different now.
    pub repaint: bool,
}

pub struct Panel {
    input: egui_winit::State,
    /// Where the cursor is, pixels.
    cursor: egui::Pos2,
    /// A list to choose from is open, as it was laid out last.
    unfolded: bool,
    /// As far to the right as it reaches from the window's left side, pixels, as it was laid out last; 0 where it lies elsewhere, or is folded.
    reaches_px: f64,
}

/// Points; passes that took less are too many to show.
const WIDTH: f32 = 250.0;
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
        Panel { input, cursor: egui::Pos2::ZERO, unfolded: false, reaches_px: 0.0 }
    }

    /// The same for a device that has none of its textures: what is open where in it stays.
    pub fn renewed(&self, window: &Window) -> Panel {
        let renewed = Panel { cursor: self.cursor, ..Panel::new(window) };
        let memory = self.input.egui_ctx().memory(Clone::clone);
        renewed.input.egui_ctx().memory_mut(|own| *own = memory);
        renewed
    }

    pub fn handle_event(&mut self, window: &Window, event: &WindowEvent) -> EventResponse {
        if let WindowEvent::ScaleFactorChanged { scale_factor, .. } = event {
            // Some systems say so before their windows know of it, which egui asks.
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
            // Who clicks as soon as the cursor is there clicks before the panel has been laid out with the cursor over it.
            WindowEvent::MouseInput { .. } | WindowEvent::MouseWheel { .. } => {
                response.consumed || self.is_over()
            }
            // It closes what is unfolded, and not the window.
            WindowEvent::KeyboardInput { event, .. }
                if event.physical_key == PhysicalKey::Code(KeyCode::Escape) =>
            {
                response.consumed || self.unfolded
            }
            _ => response.consumed,
        };
        EventResponse { consumed, repaint: response.repaint }
    }

    /// Whether the cursor is over something that was laid out last.
    fn is_over(&self) -> bool {
        let context = self.input.egui_ctx();
        let layer = context.layer_id_at(self.cursor / context.pixels_per_point());
        layer.is_some_and(|layer| layer.order != egui::Order::Background)
    }

    /// So much of the window's left side lies under it, pixels.
    pub fn covers_px(&self, hidden: bool) -> f64 {
        if hidden { 0.0 } else { self.reaches_px }
    }

    pub fn lay_out(
        &mut self,
        window: &Window,
        state: &mut UiState,
        view: Option<&View>,
        scene: &mut Scene,
    ) -> PanelOutput {
        let input = self.input.take_egui_input(window);
        let context = self.input.egui_ctx().clone();
        let (mut actions, mut reaches) = (Vec::new(), 0.0);
        let output = context.run_ui(input, |ui| {
            if let Some(view) = view {
                measure_overlay(ui, &state.measure, view);
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
                let at_the_left = rect.left() < WIDTH / 4.0 && rect.height() > tall / 2.0;
                reaches = if at_the_left { rect.right() } else { 0.0 };
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
        self.reaches_px = (reaches * output.pixels_per_point).into();
        self.unfolded = egui::Popup::is_any_open(&context);
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
        .map_or(String::new(), |hidden| format!(", but for those of {hidden}"));
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
    picked(ui, state, actions);
    color(ui, state, scene);
    filters(ui, state, &mut scene.opacities);
    let mut added = false;
    clip_box_widget::list(ui, &mut scene.clips, &mut added);
    if added {
        actions.push(Action::AddBox);
    }
    light_widget::choose(ui, &mut scene.settings.light, scene.camera.eye);
    CollapsingHeader::new("effects").default_open(true).show(ui, |ui| {
        for listed in scene.settings.effects.list() {
            effect(ui, listed, &state.decided);
        }
        layer_distance(ui, &mut scene.settings.layer_m);
    });
    CollapsingHeader::new("what runs, and why").show(ui, |ui| {
        for (name, reason) in &state.decided.0 {
            let title =
                RichText::new(format!("{name} {}:", if reason.runs { "on" } else { "off" }));
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

/// What is odd about the files and the picture; folded where it would push everything else away.
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

/// The last thing that went wrong, until somebody has read it.
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

/// How large pictures are saved: as the window, or of any size, drawn in pieces.
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
    /// As high as a list of all that points may show, points.
    const LIST: f32 = 300.0;
    let automatic =
        || state.shown.map_or("auto".into(), |shown| format!("auto: {}", shown.attribute.name()));
    let combo = ComboBox::from_label("color")
        .height(LIST)
        .selected_text(scene.color.map_or_else(automatic, Attribute::name))
        .show_ui(ui, |ui| {
            ui.selectable_value(&mut scene.color, None, "auto");
            for &attribute in Attribute::value_variants() {
                ui.selectable_value(&mut scene.color, Some(attribute), attribute.name());
            }
        });
    if scene.color.is_none() && !state.why_shown.is_empty() {
        combo.response.on_hover_text(format!("because {}", state.why_shown));
    }
    if let Some(shown) = &state.shown {
        legend::ramp(ui, shown, &state.categories.reference);
    }
    ui.horizontal(|ui| {
        ui.color_edit_button_srgb(&mut scene.settings.background);
        ui.label("background");
    });
}

/// How much of an index is drawn, and what is being read of it.
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
        format!("{awaited} of {nodes} nodes to come")
    } else {
        format!("{nodes} nodes, all there")
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

fn effect(ui: &mut Ui, listed: Listed, decided: &Decided) {
    let Listed { name, about, switch, settings } = listed;
    let reason = decided.0.iter().find(|(effect, _)| *effect == name).map(|(_, reason)| reason);
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

/// Of all effects that tell surfaces apart; 0: automatic.
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
            .on_hover_text("surfaces nearer to each other than this are one: for filling by masks, transparency and shadows");
    });
}

fn setting(ui: &mut Ui, setting: Setting) {
    let Setting { name, about, value } = setting;
    let response = match value {
        Value::Number(number, range) => {
            // Whole decades apart, small values would all be at one end.
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

/// What is not ticked is not drawn: a rule of opacity 0. Beside it the colour that it is drawn in.
fn filters(ui: &mut Ui, state: &UiState, opacities: &mut Opacities) {
    let Categories { classes, returns, stations, .. } = &state.categories;
    let class = |&(number, count): &(u8, u64)| {
        let name = class_name(number).map_or(String::new(), |name| format!(" {name}"));
        (What::Class(number), number, format!("{number}{name}: {}", grouped(count)))
    };
    let returned = |&(number, count): &(u8, u64)| {
        (What::Return(number), number, format!("{number}: {}", grouped(count)))
    };
    // Points show the lower byte of their source.
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

/// Coordinates in full: f64 tells a micrometre at ten million metres.
fn picked(ui: &mut Ui, state: &mut UiState, actions: &mut Vec<Action>) {
    let UiState { measure, width, .. } = state;
    let Some(measure::Picked { point, record }) = measure.points.last() else { return };
    CollapsingHeader::new("picked").default_open(true).show(ui, |ui| {
        let DVec3 { x, y, z } = measure.reference.digits.round(point.position);
        ui.label(format!(
            "x {x}\ny {y}\nz {z}{}",
            if point.exact { "" } else { "\nabout: the rest of its digits is not loaded" }
        ));
        if let Some([class, number, station]) = measure::kind(point) {
            ui.label(format!("class {class}, return {number}, station {station}"));
        }
        ui.label(match record {
            Looked::Found(record) => record.to_string().replace(", ", "\n"),
            Looked::Underway => "being looked up in its file".into(),
            Looked::Nowhere => {
                "a sample that stands for several points of the file; nearer by there are these"
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
                        "wide by its length".into()
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

/// Picked points and the line through them, over the picture, with lengths, the last angle and the area.
fn measure_overlay(ui: &Ui, measure: &Measure, view: &View) {
    let painter = ui.ctx().layer_painter(egui::LayerId::background());
    let per_point = ui.ctx().pixels_per_point();
    let seen =
        |place: DVec3| view.pixel(place).map(|[x, y]| egui::pos2(x as f32, y as f32) / per_point);
    /// Of a line or a point, points; what is said of all of them stands below.
    const ABOVE: f32 = 14.0;
    let stroke = egui::Stroke::new(2.0, Color32::YELLOW);
    let say = |place: DVec3, above: f32, text: String| {
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
        say(pair[0].midpoint(pair[1]), ABOVE, unit.length(pair[0].distance(pair[1]), 3));
    }
    if let (Some(angle), &[.., corner, _]) = (measure.angle(), &places[..]) {
        say(corner, ABOVE, format!("{angle:.2}°"));
    }
    if let (Some(area), Some(&first)) = (measure.area(), places.first()) {
        let from_first: DVec3 = places.iter().map(|&place| place - first).sum();
        say(first + from_first / places.len() as f64, -ABOVE, unit.area(area, 3));
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
    // Once its driver has rasterised a panel it takes all timestamps at the end of a submission.
    if total < 0.5 * state.took.as_secs_f64() * 1e3 {
        ui.label(
            RichText::new("a device that is software times no passes under a panel; render tells them with its option timings").weak(),
        );
    } else {
        for (name, ms) in by_name.into_iter().filter(|(_, ms)| *ms >= LEAST_SHARE * total) {
            ui.add(ProgressBar::new((ms / total) as f32).text(format!("{name} {ms:.2} ms")));
        }
    }
    ui.label(format!("from change to picture: {:.1} ms", state.latency.as_secs_f64() * 1e3));
}

/// The mouse first, then every key.
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

/// The font has one sign for two hyphens, which is a dash, and without it they touch: there is a little room between them.
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

/// Digits in threes.
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
    fn digits_come_in_threes() {
        assert_eq!(
            [0, 12, 999, 1000, 1_234_567].map(super::grouped),
            ["0", "12", "999", "1,000", "1,234,567"]
        );
    }
}
