//! The ramp of colours, with its two ends as handles, and swatches.

use super::theme;
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::cloud::colormap;
use egui::{Color32, CursorIcon, Rect, Sense, Shape, Stroke, Ui, pos2, vec2};

/// Side of a swatch, and height of a ramp and of its handles `[points]`.
const SIDE: f32 = 12.0;
const HANDLE: f32 = 8.0;
/// Rectangles that a ramp is drawn of.
const PARTS: u32 = 96;
/// Room beside the automatic ends, as a share of their distance: an end may be dragged there.
const BESIDE: f64 = 0.25;

/// Keeps the place of the ramp.
pub fn none(ui: &mut Ui) {
    let (all, _) =
        ui.allocate_exact_size(vec2(ui.available_width(), SIDE + HANDLE), Sense::hover());
    let bar =
        Rect::from_min_max(all.min, all.max - vec2(0.0, HANDLE)).shrink2(vec2(HANDLE / 2.0, 0.0));
    ui.painter().rect_filled(bar, 0.0, theme::BUTTON);
}

/// Draws the colour ramp of the displayed attribute, if that is a number; its ends follow drags.
pub fn show(ui: &mut Ui, shown: &DisplayAttribute, range: &mut Option<[f64; 2]>) {
    let mut automatic = *shown;
    automatic.scale.range = None;
    let (Some(ends), Some([lo, hi])) = (shown.ends(), automatic.ends()) else { return };
    let left = lo - BESIDE * (hi - lo);
    let span = (1.0 + 2.0 * BESIDE) * (hi - lo).max(f64::MIN_POSITIVE);
    let (all, _) =
        ui.allocate_exact_size(vec2(ui.available_width(), SIDE + HANDLE), Sense::hover());
    // A handle at an end is all there.
    let bar =
        Rect::from_min_max(all.min, all.max - vec2(0.0, HANDLE)).shrink2(vec2(HANDLE / 2.0, 0.0));
    let x = |value: f64| bar.left() + bar.width() * ((value - left) / span).clamp(0.0, 1.0) as f32;
    let words = shown.ramp_words();
    for part in 0..PARTS {
        let [from, to] = [part, part + 1].map(|part| left + span * part as f64 / PARTS as f64);
        let along = ((from + to) / 2.0 - ends[0]) / (ends[1] - ends[0]).max(f64::MIN_POSITIVE);
        let word = words[0] + (words[1] - words[0]) * along.clamp(0.0, 1.0);
        let [r, g, b] = colormap::ramp_color(shown, word);
        let rect = Rect::from_min_max(pos2(x(from), bar.top()), pos2(x(to), bar.bottom()));
        ui.painter().rect_filled(rect, 0.0, Color32::from_rgb(r, g, b));
    }
    let mut dragged = ends;
    for (end, name) in [(0, "low"), (1, "high")] {
        let tip = pos2(x(ends[end]), bar.bottom());
        let around =
            Rect::from_min_max(tip - vec2(HANDLE / 2.0, SIDE), tip + vec2(HANDLE / 2.0, HANDLE));
        let response = ui.interact(around, ui.id().with(("end", name)), Sense::drag());
        let visuals = ui.style().interact(&response);
        let [a, b] = [-1.0, 1.0].map(|side| tip + vec2(side * HANDLE / 2.0, HANDLE));
        let color = visuals.fg_stroke.color;
        ui.painter().add(Shape::convex_polygon(vec![tip, b, a], color, Stroke::NONE));
        dragged[end] += response.drag_delta().x as f64 / bar.width() as f64 * span;
        response.on_hover_cursor(CursorIcon::ResizeHorizontal);
    }
    if dragged != ends && dragged[0] < dragged[1] {
        *range = Some(dragged);
    }
}

/// Draws the colour of points with this number.
pub fn swatch(ui: &mut Ui, attribute: Attribute, number: u8) {
    let [r, g, b] = colormap::code_color(attribute, number);
    let (square, _) = ui.allocate_exact_size(egui::Vec2::splat(SIDE), Sense::hover());
    ui.painter().rect_filled(square, 0.0, Color32::from_rgb(r, g, b));
}
