//! Colours: the attribute, its ramp and its ends, and brightness.

use super::ramp;
use super::state::UiState;
use super::text;
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::cloud::color_scale::{ColorScale, Ramp};
use crate::cloud::crs::Reference;
use crate::render::scene::Scene;
use clap::ValueEnum;
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
    if let Some(shown) = &state.shown {
        let mut shown = *shown;
        shown.scale = scene.scale;
        let reference = &state.categories.reference;
        ramp::show(ui, &shown, &mut scene.scale.range);
        scale(ui, &shown, reference, &mut scene.scale);
    }
}

/// Chooses a ramp.
fn ramps(ui: &mut Ui, now: Ramp, chosen: &mut Option<Ramp>) {
    let name = |ramp: Ramp| format!("{ramp:?}").to_lowercase();
    let list = ComboBox::from_id_salt("ramp").width(70.0).selected_text(name(now));
    list.show_ui(ui, |ui| {
        for &ramp in Ramp::value_variants() {
            ui.selectable_value(chosen, Some(ramp), name(ramp));
        }
    });
}

/// Edits how numbers and channels become colours.
fn scale(ui: &mut Ui, shown: &DisplayAttribute, reference: &Reference, scale: &mut ColorScale) {
    if let Some(mut ends) = shown.ends() {
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
