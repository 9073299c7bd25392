//! Moving pictures: one control from faster to finer, the curve of time against error under it, and
//! what the last one took.

use super::heat_map;
use super::state::Pace;
use super::text::{line, weak};
use super::theme;
use crate::app::actions::Action;
use crate::app::render_thread::Moving;
use crate::tune::Limit;
use egui::{Pos2, Rect, Sense, Shape, Slider, Stroke, Ui, pos2, vec2};

/// Times that can be asked for `[ms]`.
const TIMES: [f64; 2] = [4.0, 1000.0];
/// Height of the curve `[points]`.
const HEIGHT: f32 = 44.0;
/// Least error of the curve `[px]`: smaller ones are at its bottom.
const LEAST_PX: f64 = 0.01;
/// Largest error of the curve `[px]`.
const MOST_PX: f64 = 4.0;

pub fn show(ui: &mut Ui, pace: &mut Pace, actions: &mut Vec<Action>) {
    let Some(limit) = pace.limit else { return };
    ui.separator();
    let mut ms = if let Limit::Time(ms) = limit { ms } else { TIMES[1] };
    ui.horizontal(|ui| {
        ui.label("faster");
        ui.spacing_mut().slider_width = 120.0;
        let slider = Slider::new(&mut ms, TIMES[0]..=TIMES[1]).logarithmic(true);
        let slider = ui.add(slider.suffix(" ms").max_decimals(0));
        ui.label("finer");
        if slider.on_hover_text(format!("time of a moving picture, by {}", pace.origin)).changed() {
            pace.limit = Some(Limit::Time(ms));
            actions.push(Action::Limit(Limit::Time(ms)));
        }
    });
    ui.checkbox(&mut pace.shows_errors, "show their errors").on_hover_text(
        "where the last moving picture differs from the one at rest, once that is there (T)",
    );
    if pace.shows_errors {
        heat_map::bar(ui);
    }
    let Some(moving) = &pace.moving else {
        // Leave the curve its room, so that no row moves when it comes.
        ui.allocate_exact_size(vec2(ui.available_width(), HEIGHT), Sense::hover());
        weak(ui, "nothing has moved yet");
        return;
    };
    curve(ui, moving, ms);
    let expected = moving.curve[moving.place][1];
    let measured = pace
        .measured
        .as_ref()
        .map_or("known at rest".into(), |own| format!("{:.3} px", own.errors.px));
    let expected_ms = moving.expected_ms.map(|ms| format!(" of {ms:.1} expected"));
    let said = format!("{:.1} ms{}; error {measured}", moving.ms, expected_ms.unwrap_or_default());
    let all = format!(
        "{}\n{:.3} px expected against the picture at rest, which is measured when it is there",
        moving.tuning, expected
    );
    line(ui, said).on_hover_text(all);
}

/// Draws errors against times, both logarithmic, with the time that was asked for and the last
/// picture's point.
fn curve(ui: &mut Ui, moving: &Moving, asked_ms: f64) {
    let size = vec2(ui.available_width(), HEIGHT);
    let (area, _) = ui.allocate_exact_size(size, Sense::hover());
    let at = |ms: f64, px: f64| place(area, ms, px);
    let points = moving.curve.iter().map(|&[ms, px]| at(ms, px)).collect();
    let stroke = Stroke::new(1.0, theme::WEAK);
    let asked = at(asked_ms, LEAST_PX).x;
    let painter = ui.painter();
    painter.line_segment([pos2(asked, area.top()), pos2(asked, area.bottom())], stroke);
    painter.add(Shape::line(points, Stroke::new(1.5, ui.visuals().text_color())));
    painter.circle_filled(at(moving.ms, moving.curve[moving.place][1]), 3.5, theme::BUSY);
}

/// Returns the place of a time and an error in an area; times and errors beyond are at its edges.
fn place(area: Rect, ms: f64, px: f64) -> Pos2 {
    let part = |value: f64, [low, high]: [f64; 2]| {
        ((value / low).ln() / (high / low).ln()).clamp(0.0, 1.0) as f32
    };
    let (x, y) = (part(ms, TIMES), part(px, [LEAST_PX, MOST_PX]));
    pos2(area.left() + x * area.width(), area.bottom() - y * area.height())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faster_is_at_the_left_and_finer_at_the_bottom() {
        let area = Rect::from_min_size(pos2(10.0, 20.0), vec2(100.0, 40.0));
        assert_eq!(place(area, 0.0, 9.0), pos2(10.0, 20.0));
        assert_eq!(place(area, 1e9, 0.0), pos2(110.0, 60.0));
        let middle = place(area, (TIMES[0] * TIMES[1]).sqrt(), (LEAST_PX * MOST_PX).sqrt());
        assert!((middle - pos2(60.0, 40.0)).length() < 1e-3);
    }
}
