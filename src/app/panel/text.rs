//! Pieces of text.

use super::theme;
use egui::text::{LayoutJob, TextFormat};
use egui::{Color32, Label, Response, RichText, TextStyle, Ui};

/// Lays out text with a gap between two hyphens, which would touch or become a dash.
pub fn spaced_hyphens(ui: &Ui, text: &str) -> LayoutJob {
    const ROOM: f32 = 1.5;
    let format = TextFormat::simple(TextStyle::Body.resolve(ui.style()), Color32::PLACEHOLDER);
    let mut job = LayoutJob::default();
    for (number, part) in text.split("--").enumerate() {
        if number > 0 {
            job.append("-", 0.0, format.clone());
            job.append("-", ROOM, format.clone());
        }
        job.append(part, 0.0, format.clone());
    }
    job
}

/// Shows one line, which ends where there is no more room; all of it is shown under the cursor.
pub fn line(ui: &mut Ui, text: impl Into<RichText>) -> Response {
    ui.add(Label::new(text.into()).truncate())
}

/// Shows one line of less importance.
pub fn weak(ui: &mut Ui, text: impl Into<String>) -> Response {
    line(ui, RichText::new(text).color(theme::WEAK))
}
