//! Windows beside the panel: errors, notes, and the list of keys.

use super::WIDTH;
use super::state::UiState;
use super::text::spaced_hyphens;
use super::theme;
use crate::app::keys::{self, KEYS};
use egui::{Align2, Context, Grid, RichText, ScrollArea, Ui, Window};

/// Shows the last errors, until the window is closed.
pub fn error(context: &Context, state: &mut UiState) {
    let Some(text) = &state.error else { return };
    let mut unread = true;
    let above = Window::new("error")
        .open(&mut unread)
        .anchor(Align2::CENTER_BOTTOM, [0.0, -20.0])
        .collapsible(false);
    above.show(context, |ui| ui.label(RichText::new(text).color(theme::ERROR)));
    if !unread {
        state.dismiss();
    }
}

/// Shows all notes on the files and on the picture.
pub fn notes(context: &Context, state: &mut UiState) {
    let mut reads = state.reads_notes;
    let window = Window::new("notes").open(&mut reads).default_pos([WIDTH + 60.0, 60.0]);
    window.show(context, |ui| {
        ScrollArea::vertical().show(ui, |ui| {
            for note in state.notes.iter().chain(&state.picture_notes) {
                ui.label(RichText::new(note).color(theme::NOTE));
            }
        });
    });
    state.reads_notes = reads;
}

/// Lists what the mouse and every key do.
pub fn help(context: &Context, state: &mut UiState) {
    let mut shown = state.help;
    let window = Window::new("keys").open(&mut shown).default_pos([WIDTH + 60.0, 8.0]);
    window.show(context, |ui| {
        ScrollArea::vertical().show(ui, |ui| rows(ui, state));
    });
    state.help = shown;
}

fn rows(ui: &mut Ui, state: &UiState) {
    let keys = KEYS.iter().map(|key| (key.name, key.about));
    Grid::new("keys").show(ui, |ui| {
        for (name, about) in keys::mouse(state.style, state.mode).into_iter().chain(keys) {
            ui.label(RichText::new(name).strong());
            ui.label(spaced_hyphens(ui, about));
            ui.end_row();
        }
    });
}
