//! Picked points: coordinates in all digits, records, measures between them, and the profile.

use super::state::UiState;
use super::text::weak;
use super::theme;
use crate::app::actions::Action;
use crate::app::measure::{self, Looked, Measure, Picked};
use egui::{DragValue, Grid, Label, RichText, Ui};
use glam::DVec3;

pub fn show(ui: &mut Ui, state: &mut UiState, actions: &mut Vec<Action>) {
    let UiState { measure, width, .. } = state;
    let count = measure.points.len();
    ui.horizontal(|ui| {
        for (name, key, action) in [
            (
                "csv",
                "C: save the picked points, and the profile also as SVG",
                Action::Export("csv"),
            ),
            ("geojson", "G: save the picked points", Action::Export("geojson")),
            ("forget", "Del: forget the picked points", Action::Forget),
        ] {
            let button = ui.add_enabled(count > 0, egui::Button::new(name));
            if button.on_hover_text(key).clicked() {
                actions.push(action);
            }
        }
    });
    profile(ui, measure, width, actions);
    ui.separator();
    let hint = ["click on a point to pick it", "shift and click for one more"];
    weak(ui, format!("{count} picked; {}", hint[count.min(1)]));
    if count > 1 {
        between(ui, measure);
        ui.separator();
    }
    if let Some(last) = measure.points.last() {
        picked(ui, measure, last);
    }
}

/// Asks for a profile along the picked points, of a width.
fn profile(ui: &mut Ui, measure: &Measure, width: &mut f64, actions: &mut Vec<Action>) {
    let unit = measure.reference.unit();
    let said = |width: f64, _| {
        if width == 0.0 {
            "automatic width".into()
        } else {
            format!("{width:.4} {} wide", unit.symbol())
        }
    };
    let read = |text: &str| text.split_whitespace().next().and_then(|number| number.parse().ok());
    ui.horizontal(|ui| {
        let button = ui.add_enabled(measure.points.len() > 1, egui::Button::new("profile"));
        if button.on_hover_text("X: of the points along the line").clicked() {
            actions.push(Action::Profile);
        }
        ui.add(
            DragValue::new(width)
                .range(0.0..=f64::INFINITY)
                .speed(0.01)
                .custom_formatter(said)
                .custom_parser(read),
        );
    });
}

/// Shows the measures from the first to the last point.
fn between(ui: &mut Ui, measure: &Measure) {
    let (unit, height) = (measure.reference.unit(), measure.reference.height_unit());
    let mut rows = vec![
        ("distance", unit.length(measure.distance(), 4)),
        ("height", height.length(measure.height(), 4)),
        ("horizontal", unit.length(measure.horizontal(), 4)),
    ];
    if let Some(angle) = measure.angle() {
        rows.push(("length", unit.length(measure.length(), 4)));
        rows.push(("angle", format!("{angle:.3}°")));
    }
    rows.extend(measure.area().map(|area| ("area", unit.area(area, 4))));
    table(ui, "measures", rows);
}

/// Shows a point and its record.
fn picked(ui: &mut Ui, measure: &Measure, Picked { point, record }: &Picked) {
    let DVec3 { x, y, z } = measure.reference.digits.round(point.position);
    let mut rows =
        [("x", x), ("y", y), ("z", z)].map(|(name, number)| (name, number.to_string())).to_vec();
    if let Some(labels) = measure::kind(point) {
        let names = ["class", "return", "station"];
        rows.extend(names.into_iter().zip(labels.map(|label| label.to_string())));
    }
    table(ui, "picked", rows);
    if !point.exact {
        weak(ui, "approximate: not all of its digits are loaded");
    }
    ui.add_space(4.0);
    ui.add(Label::new(match record {
        Looked::Found(record) => record.to_string().replace(", ", "\n"),
        Looked::Underway => "being looked up in its file".into(),
        Looked::Nowhere => {
            "a sample that stands for several points of the file; zoom in to pick one of them"
                .into()
        }
    }));
}

fn table(ui: &mut Ui, name: &str, rows: Vec<(&str, String)>) {
    Grid::new(name).num_columns(2).show(ui, |ui| {
        for (name, value) in rows {
            ui.label(RichText::new(name).color(theme::WEAK));
            ui.label(value);
            ui.end_row();
        }
    });
}
