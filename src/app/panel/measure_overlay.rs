//! Picked points over the picture.

use crate::app::measure::Measure;
use crate::view::View;
use egui::{Color32, Ui};
use glam::DVec3;

/// Draws the picked points over the picture, with the line through them, lengths, angle and area.
pub fn show(ui: &Ui, measure: &Measure, view: &View) {
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
