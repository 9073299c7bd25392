//! Effects: one row each, those that are used most first, with their settings folded.

use super::theme;
use crate::cloud::length::Length;
use crate::passes::{Choice, Effect, EffectDecisions, Listed, Setting, Switch, Value};
use crate::render::settings::RenderSettings;
use egui::collapsing_header::{CollapsingState, paint_default_icon};
use egui::{Align, CollapsingHeader, ComboBox, DragValue, Layout, RichText, Slider, Ui};

/// Returns an effect's place in the list: what changes the look most comes first, and what suits
/// few clouds last.
fn rank(effect: Effect) -> u8 {
    match effect {
        Effect::Edl => 0,
        Effect::Splat => 1,
        Effect::Fill => 2,
        Effect::Visibility => 3,
        Effect::Shape => 4,
        Effect::Shadows => 5,
        Effect::Ao => 6,
        Effect::Phong => 7,
        Effect::Smooth => 8,
        Effect::Antialias => 9,
        Effect::Exposure => 10,
        Effect::Luminance => 11,
        Effect::Transparency => 12,
        Effect::Strokes => 13,
        Effect::Scattered => 14,
    }
}

pub fn show(ui: &mut Ui, settings: &mut RenderSettings, decisions: &EffectDecisions) {
    CollapsingHeader::new("effects").show(ui, |ui| {
        let mut effects = settings.effects.list();
        effects.sort_by_key(|listed| rank(listed.effect));
        effects.into_iter().for_each(|listed| row(ui, listed, decisions));
        layer_distance(ui, &mut settings.layer);
    });
}

fn row(ui: &mut Ui, listed: Listed, decisions: &EffectDecisions) {
    let Listed { effect, about, switch, settings } = listed;
    let (name, reason) = (effect.name(), decisions.reason(effect));
    let id = ui.make_persistent_id(("effect", name));
    let mut folded = CollapsingState::load_with_default_open(ui.ctx(), id, false);
    let row = ui.horizontal(|ui| {
        ui.add_enabled_ui(!settings.is_empty(), |ui| {
            folded.show_toggle_button(ui, paint_default_icon);
        });
        let runs = reason.is_some_and(|reason| reason.runs);
        let title = RichText::new(name).color(if runs { theme::RUNS } else { theme::WEAK });
        let why = reason.map_or(String::new(), |reason| {
            format!("\n\n{}, because {}", if runs { "on" } else { "off" }, reason.why)
        });
        ui.label(title).on_hover_text(format!("{about}{why}"));
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            for choice in [Switch::On, Switch::Auto, Switch::Off] {
                ui.selectable_value(switch, choice, Choice::name(&choice));
            }
        });
    });
    folded.show_body_indented(&row.response, ui, |ui| {
        settings.into_iter().for_each(|one| setting(ui, one));
    });
}

/// Edits the layer distance of all effects; 0: automatic. One that is not in metres stays in the
/// unit of the coordinates.
fn layer_distance(ui: &mut Ui, layer: &mut Length) {
    let of = match *layer {
        Length::OfCoordinates(length) if length > 0.0 => Length::OfCoordinates,
        _ => Length::Metres,
    };
    let said = |number: f64, _| match of(number) {
        _ if number == 0.0 => "automatic".to_string(),
        Length::Metres(metres) => format!("{metres} m"),
        Length::OfCoordinates(length) => format!("{length}"),
    };
    let read = |text: &str| {
        if text.trim() == "automatic" {
            Some(0.0)
        } else {
            text.trim().trim_end_matches('m').trim().parse().ok()
        }
    };
    let mut number = layer.number();
    ui.horizontal(|ui| {
        let drag = DragValue::new(&mut number).range(0.0..=1e9).speed(0.01).max_decimals(4);
        if ui.add(drag.custom_formatter(said).custom_parser(read)).changed() {
            *layer = if number == 0.0 { Length::default() } else { of(number) };
        }
        ui.label("between layers")
            .on_hover_text("surfaces nearer to each other than this are one surface: for fill=method=mask, transparency and shadows");
    });
}

fn setting(ui: &mut Ui, setting: Setting) {
    let Setting { name, about, value, .. } = setting;
    let response = match value {
        Value::Length(metres, range) => {
            ui.add(Slider::new(metres, range).logarithmic(true).suffix(" m").text(name))
        }
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
            let list = ComboBox::from_label(name).selected_text(number.to_string());
            let shown = list.show_ui(ui, |ui| {
                of.iter().for_each(|one| drop(ui.selectable_value(number, *one, one.to_string())));
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
