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

/// Shows a row with a name at the left, as wide as those of the other rows.
pub fn named<R>(ui: &mut Ui, name: &str, row: impl FnOnce(&mut Ui) -> R) -> R {
    /// Width of the names `[points]`.
    const WIDTH: f32 = 34.0;
    let height = ui.spacing().interact_size.y;
    let shown = ui.horizontal(|ui| {
        let (rect, _) = ui.allocate_exact_size(egui::vec2(WIDTH, height), egui::Sense::hover());
        let at = rect.left_center();
        let font = TextStyle::Body.resolve(ui.style());
        ui.painter().text(at, egui::Align2::LEFT_CENTER, name, font, theme::WEAK);
        row(ui)
    });
    shown.inner
}

/// Shows one line of less importance.
pub fn weak(ui: &mut Ui, text: impl Into<String>) -> Response {
    line(ui, RichText::new(text).color(theme::WEAK))
}
