//! Windows beside the panel: errors, notes, keys, the question whether to close, and what to do
//! with an empty window.

use super::WIDTH;
use super::header;
use super::state::UiState;
use super::text::spaced_hyphens;
use super::theme;
use crate::app::actions::Action;
use crate::app::keys;
use egui::{Align2, Area, Context, Grid, Order, RichText, ScrollArea, Ui, Window};

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
    let tall = context.content_rect().height() - 80.0;
    let window = Window::new("keys").open(&mut shown).default_pos([WIDTH + 60.0, 8.0]);
    window.default_height(tall).show(context, |ui| {
        ScrollArea::vertical().max_height(tall).show(ui, |ui| rows(ui, state));
    });
    state.help = shown;
}

/// Says how to open files, while there are none.
pub fn hint(context: &Context, state: &UiState, actions: &mut Vec<Action>) {
    if !state.title.is_empty() || !state.asks.is_empty() {
        return;
    }
    let beside = if state.panel.is_shown() { WIDTH / 2.0 } else { 0.0 };
    let area = Area::new(egui::Id::new("hint")).anchor(Align2::CENTER_CENTER, [beside, 0.0]);
    area.show(context, |ui| {
        ui.vertical_centered(|ui| {
            ui.label(RichText::new("drop point clouds here").heading().color(theme::TEXT));
            ui.label(
                RichText::new(
                    "LAS, LAZ, COPC, Potree 2, EPT, PLY, E57, OBJ, XYZ, CSV, TXT, PTS, PTX, PNTI",
                )
                .color(theme::WEAK),
            );
            ui.add_space(8.0);
            header::open(ui, state, actions);
        });
    });
}

/// Asks whether to close though something would be lost.
pub fn question(context: &Context, state: &mut UiState, actions: &mut Vec<Action>) {
    if state.asks.is_empty() {
        return;
    }
    let mut stays = false;
    let window = Window::new("close the window?").collapsible(false).resizable(false);
    let window = window.order(Order::Foreground);
    window.anchor(Align2::CENTER_CENTER, [0.0, 0.0]).show(context, |ui| {
        ui.label("Not saved yet:");
        for lost in &state.asks {
            ui.label(RichText::new(lost).color(theme::NOTE));
        }
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            if ui.button("close").on_hover_text("Enter").clicked() {
                actions.push(Action::CloseAnyway);
            }
            stays = ui.button("stay").on_hover_text("Esc").clicked();
        });
    });
    if stays {
        state.asks.clear();
    }
}

fn rows(ui: &mut Ui, state: &UiState) {
    Grid::new("keys").show(ui, |ui| {
        for (name, about) in keys::rows(state.style, state.mode) {
            ui.label(RichText::new(name).strong());
            ui.label(spaced_hyphens(ui, about));
            ui.end_row();
        }
    });
}
