//! How points are drawn: style, colours, light, effects, and what is in the picture besides.

use super::state::UiState;
use super::text::{self, spaced_hyphens, weak};
use super::theme;
use super::{camera_path, color, effects, light, pace};
use crate::app::actions::Action;
use crate::names::Named;
use crate::output::annotations::no_north;
use crate::passes::splat::{self, PointSize};
use crate::passes::{Asked, Effects, Switch};
use crate::render::scene::Scene;
use crate::render::settings::{RenderSettings, Style};
use egui::{Button, Checkbox, CollapsingHeader, DragValue, ProgressBar, RichText, Ui};

/// Least share of the frame time that a pass needs to be listed.
const LEAST_SHARE: f64 = 0.01;

pub fn show(ui: &mut Ui, state: &mut UiState, scene: &mut Scene, actions: &mut Vec<Action>) {
    style(ui, &mut scene.settings.effects);
    point_size(ui, &mut scene.settings.effects.splat);
    color::show(ui, state, scene);
    light::choose(ui, &mut scene.settings.light, scene.camera.eye);
    effects::show(ui, &mut scene.settings, &state.decisions);
    in_the_picture(ui, state, scene);
    camera_path::show(ui, state, actions);
    pace::show(ui, &mut state.pace, actions);
    CollapsingHeader::new("what runs, and why").show(ui, |ui| reasons(ui, state, actions));
    CollapsingHeader::new(format!("picture, {:.1} ms", state.took.as_secs_f64() * 1e3))
        .id_salt("passes")
        .show(ui, |ui| passes(ui, state));
}

/// Chooses how points are drawn. Strokes need what is computed while a cloud is loaded, so they are
/// offered only where they are drawn.
fn style(ui: &mut Ui, effects: &mut Effects) {
    text::named(ui, "style", |ui| {
        let current = effects.style();
        for &style in Style::ALL {
            let is_offered = style != Style::Strokes || current == Some(Style::Strokes);
            if is_offered && ui.selectable_label(current == Some(style), style.name()).clicked() {
                effects.set_style(style);
            }
        }
    });
}

/// Sets the diameter of points, as `--point-size` does, where the style draws them round.
fn point_size(ui: &mut Ui, splat: &mut Asked<splat::Settings>) {
    let size = &mut splat.settings;
    let in_metres = size.pixels == 0.0 && size.metres > 0.0;
    let (mut number, unit, of): (_, _, fn(f64) -> PointSize) = match in_metres {
        true => (size.metres, " m", PointSize::Metres),
        false => (size.pixels, " px", PointSize::Pixels),
    };
    let said = |number: f64, _| match number {
        0.0 => "by spacing".to_string(),
        number => format!("{number}{unit}"),
    };
    let read = |text: &str| match text.trim() {
        "by spacing" => Some(0.0),
        text => text.trim_end_matches(unit.trim()).trim().parse().ok(),
    };
    let about = "diameter, for the styles that draw round points; auto: by their spacing";
    ui.add_enabled_ui(splat.switch != Switch::Off, |ui| {
        text::named(ui, "size", |ui| {
            let (speed, decimals) = if in_metres { (0.001, 4) } else { (0.05, 2) };
            let drag = DragValue::new(&mut number).range(0.0..=128.0).speed(speed);
            let drag = drag.max_decimals(decimals).custom_formatter(said).custom_parser(read);
            let changed = ui.add(drag).on_hover_text(about).changed();
            let is_auto = number == 0.0;
            if ui.add_enabled(!is_auto, Button::new("auto")).clicked() {
                size.set_size(PointSize::Auto);
            } else if changed {
                size.set_size(if is_auto { PointSize::Auto } else { of(number) });
            }
        });
    });
}

/// Chooses what is drawn besides points, as `--title` and its like do.
fn in_the_picture(ui: &mut Ui, state: &UiState, scene: &mut Scene) {
    let no_north = no_north(state.categories.up);
    let Scene { annotations: own, settings: RenderSettings { background, .. }, .. } = scene;
    CollapsingHeader::new("in the picture").show(ui, |ui| {
        ui.horizontal(|ui| {
            ui.color_edit_button_srgb(background);
            ui.label("background");
        });
        ui.horizontal(|ui| {
            let mut title = own.title.take().unwrap_or_default();
            ui.label("title");
            ui.text_edit_singleline(&mut title);
            own.title = Some(title).filter(|title| !title.is_empty());
        });
        ui.horizontal_wrapped(|ui| {
            ui.checkbox(&mut own.legend, "legend");
            ui.checkbox(&mut own.scale_bar, "scale bar");
            let arrow = Checkbox::new(&mut own.north_arrow, "north arrow");
            ui.add_enabled(no_north.is_none(), arrow);
            ui.checkbox(&mut own.axes, "axes");
        });
        if let Some(why) = no_north {
            weak(ui, format!("no north arrow: {why}"));
        }
    });
}

fn reasons(ui: &mut Ui, state: &UiState, actions: &mut Vec<Action>) {
    for (effect, reason) in &state.decisions.0 {
        let (switch, color) = if reason.runs { ("on", theme::RUNS) } else { ("off", theme::WEAK) };
        ui.horizontal_wrapped(|ui| {
            ui.label(RichText::new(format!("{} {switch}:", effect.name())).color(color));
            ui.label(spaced_hyphens(ui, &reason.why));
            if let Some(price) = state.prices.iter().find(|price| price.effect == *effect) {
                ui.label(RichText::new(price.words()).color(theme::STRONG));
            }
        });
    }
    let asks = ui.button("measure what each costs");
    if asks.on_hover_text("draws the picture twice with each effect the other way").clicked() {
        actions.push(Action::Prices);
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
    weak(ui, format!("from change to picture: {:.1} ms", state.latency.as_secs_f64() * 1e3));
}
