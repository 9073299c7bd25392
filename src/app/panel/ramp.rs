//! The ramp of colours with its two ends, and swatches.

use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::cloud::colormap;
use crate::cloud::crs::Reference;
use egui::{Color32, Rect, Sense, Ui, pos2, vec2};

/// Side of a swatch and height of a ramp `[points]`.
const SIDE: f32 = 12.0;
/// Rectangles that a ramp is drawn of.
const PARTS: u32 = 64;

/// Draws the colour ramp of the displayed attribute, if that is a number.
pub fn show(ui: &mut Ui, shown: &DisplayAttribute, reference: &Reference) {
    let Some(ends) = shown.ends() else { return };
    let (all, _) = ui.allocate_exact_size(vec2(ui.available_width(), SIDE), Sense::hover());
    let [lo, hi] = shown.ramp_words();
    let x = |part: u32| all.left() + all.width() * part as f32 / PARTS as f32;
    for part in 0..PARTS {
        let word = lo + (hi - lo) * part as f64 / (PARTS - 1) as f64;
        let [r, g, b] = colormap::ramp_color(shown, word);
        let rect = Rect::from_min_max(pos2(x(part), all.top()), pos2(x(part + 1), all.bottom()));
        ui.painter().rect_filled(rect, 0.0, Color32::from_rgb(r, g, b));
    }
    let unit = reference.height_unit();
    let said = |end: f64| {
        if shown.attribute == Attribute::Elevation {
            unit.length(end, 2)
        } else {
            format!("{end:.2}")
        }
    };
    ui.horizontal(|ui| {
        ui.label(said(ends[0]));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.label(said(ends[1]))
        });
    });
}

/// Draws the colour of points with this number.
pub fn swatch(ui: &mut Ui, attribute: Attribute, number: u8) {
    let [r, g, b] = colormap::code_color(attribute, number);
    let (square, _) = ui.allocate_exact_size(egui::Vec2::splat(SIDE), Sense::hover());
    ui.painter().rect_filled(square, 0.0, Color32::from_rgb(r, g, b));
}
