//! The line of filters, in the words of the command line.

use super::state::{FilterLine, UiState};
use super::text::{self, spaced_hyphens, weak};
use super::theme;
use crate::cloud::filter::Filter;
use egui::{Key, RichText, TextEdit, Ui};

/// Edits the filter; it is applied when the line is left, or with Enter.
pub fn show(ui: &mut Ui, state: &mut UiState, filter: &mut Filter) {
    let UiState { filter: FilterLine { text: words, of, error }, notes, .. } = state;
    if of != filter {
        (*words, *error) = (filter.words(), None);
        *of = filter.clone();
    }
    ui.horizontal(|ui| {
        ui.label("filters");
        let hint = spaced_hyphens(ui, "such as --only ground --not noise");
        let line = TextEdit::singleline(words).hint_text(hint);
        let about = "--only and --where: what every point must be; --not: what none may be. Classes by name; class=2,6, return=last, intensity=100..2000, z=..50, gps-time, source, file";
        let line = ui.add(line.desired_width(f32::INFINITY)).on_hover_text(about);
        if line.lost_focus() {
            match words.parse::<Filter>() {
                Ok(typed) => {
                    *error = None;
                    (*of, *filter) = (typed.clone(), typed);
                }
                Err(why) => {
                    *error = Some(why);
                    // Keys that follow correct it, and are none of the window.
                    if ui.input(|input| input.key_pressed(Key::Enter)) {
                        line.request_focus();
                    }
                }
            }
        }
    });
    let words = format!("{} leaves ", filter.words());
    let left = notes.iter().find_map(|note| note.strip_prefix(&words));
    match (&error, left) {
        // One line, as the others, so that nothing below moves.
        (Some(why), _) => drop(text::line(ui, RichText::new(why).color(theme::ERROR))),
        (None, Some(left)) => drop(weak(ui, format!("leaves {left}"))),
        (None, None) if filter.is_empty() => drop(weak(ui, "leaves all points")),
        (None, None) => drop(weak(ui, "the points of the view are counted above")),
    }
}
