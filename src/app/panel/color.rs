//! Colours: the attribute, its ramp and its ends, and brightness.

use super::ramp;
use super::state::UiState;
use super::text::{self, weak};
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::cloud::color_scale::{ColorScale, Ramp};
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
                for &attribute in Attribute::value_variants() {
                    ui.selectable_value(&mut scene.color, Some(attribute), attribute.name());
                }
            });
        if scene.color.is_none() && !state.why_shown.is_empty() {
            combo.response.on_hover_text(format!("because {}", state.why_shown));
        }
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            ui.color_edit_button_srgb(&mut scene.settings.background);
            weak(ui, "background");
        });
    });
    if let Some(shown) = &state.shown {
        let mut shown = *shown;
        shown.scale = scene.scale;
        ramp::show(ui, &shown, &state.categories.reference, &mut scene.scale.range);
        scale(ui, &shown, &mut scene.scale);
    }
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
            if ui.add_enabled(scale.range.is_some(), egui::Button::new("auto")).clicked() {
                scale.range = None;
            }
            let name = |ramp: Ramp| format!("{ramp:?}").to_lowercase();
            let list = ComboBox::from_id_salt("ramp").width(70.0).selected_text(name(shown.ramp()));
            list.show_ui(ui, |ui| {
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
