//! Colours: the attribute, its ramp and its ends, and brightness.

use super::ramp;
use super::state::UiState;
use super::text;
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::cloud::color_scale::{ColorScale, Ramp};
use crate::cloud::crs::Reference;
use crate::names::Named;
use crate::render::scene::Scene;
use egui::{Align, CollapsingHeader, ComboBox, DragValue, Layout, Slider, Ui};

pub fn show(ui: &mut Ui, state: &UiState, scene: &mut Scene) {
    /// Height of the list of attributes `[points]`.
    const LIST: f32 = 300.0;
    let automatic =
        || state.shown.map_or("auto".into(), |shown| format!("auto: {}", shown.attribute.name()));
    text::named(ui, "color", |ui| {
        let combo = ComboBox::from_id_salt("color")
            .height(LIST)
            .selected_text(scene.color.map_or_else(automatic, Attribute::name))
            .show_ui(ui, |ui| {
                ui.selectable_value(&mut scene.color, None, "auto");
                for &attribute in &state.categories.attributes {
                    ui.selectable_value(&mut scene.color, Some(attribute), attribute.name());
                }
            });
        if scene.color.is_none() && !state.why_shown.is_empty() {
            combo.response.on_hover_text(format!("because {}", state.why_shown));
        }
        if let Some(shown) = state.shown.filter(|shown| shown.ends().is_some()) {
            let ramp = scene.scale.ramp.unwrap_or(shown.attribute.ramp());
            ramps(ui, ramp, &mut scene.scale.ramp);
        }
    });
    let shown = state.shown.map(|mut shown| {
        shown.scale = scene.scale;
        shown
    });
    // Rows are there for all colours, so that nothing below moves.
    match shown.and_then(|shown| Some((shown, shown.ends()?))) {
        Some((shown, now)) => {
            ramp::show(ui, &shown, &mut scene.scale.range);
            ends(ui, &shown, now, &state.categories.reference, &mut scene.scale);
        }
        None => {
            ramp::none(ui);
            ui.horizontal(|ui| text::weak(ui, "no ramp: only numbers have one"));
        }
    }
    let is_label = shown.is_none_or(|shown| shown.attribute.is_label());
    ui.add_enabled_ui(!is_label, |ui| tones(ui, &mut scene.scale));
}

/// Chooses a ramp.
fn ramps(ui: &mut Ui, now: Ramp, chosen: &mut Option<Ramp>) {
    let list = ComboBox::from_id_salt("ramp").width(70.0).selected_text(now.name());
    list.show_ui(ui, |ui| {
        for &ramp in Ramp::ALL {
            ui.selectable_value(chosen, Some(ramp), ramp.name());
        }
    });
}

/// Edits the numbers at the ends of the ramp.
fn ends(
    ui: &mut Ui,
    shown: &DisplayAttribute,
    mut ends: [f64; 2],
    reference: &Reference,
    scale: &mut ColorScale,
) {
    let [lo, hi] = ends;
    let speed = ((hi - lo) / 200.0).max(1e-6);
    let unit = match shown.attribute {
        Attribute::Elevation => format!(" {}", reference.height_unit().symbol()),
        _ => String::new(),
    };
    let [low, high] = &mut ends;
    let number = |value| DragValue::new(value).speed(speed).max_decimals(3).suffix(&unit);
    ui.horizontal(|ui| {
        ui.add(number(low).range(f64::MIN..=hi.next_down()));
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            ui.add(number(high).range(lo.next_up()..=f64::MAX));
            if ui.add_enabled(scale.range.is_some(), egui::Button::new("auto")).clicked() {
                scale.range = None;
            }
        });
    });
    if ends != [lo, hi] {
        scale.range = Some(ends);
    }
}

/// Edits brightness, contrast and gamma.
fn tones(ui: &mut Ui, scale: &mut ColorScale) {
    CollapsingHeader::new("brightness").show(ui, |ui| {
        ui.add(Slider::new(&mut scale.brightness, -1.0..=1.0).text("brightness"));
        ui.add(Slider::new(&mut scale.contrast, 0.0..=4.0).text("contrast"));
        ui.add(Slider::new(&mut scale.gamma, 0.2..=5.0).logarithmic(true).text("gamma"));
        if ui.button("reset").clicked() {
            *scale = ColorScale { ramp: scale.ramp, range: scale.range, ..ColorScale::default() };
        }
    });
}
