//! The bottom of the panel: what is saved, notes, and work in progress. Every row is always there.

use super::state::{SaveSize, UiState};
use super::text::{self, spaced_hyphens};
use super::theme;
use crate::app::actions::Action;
use crate::view::View;
use egui::{DragValue, RichText, Sense, Ui};

pub fn show(ui: &mut Ui, state: &mut UiState, view: Option<&View>, actions: &mut Vec<Action>) {
    ui.separator();
    ui.horizontal(|ui| {
        for (name, hint, action) in [
            ("picture", "F9: save the picture", Action::SavePicture),
            ("layers", "L: save depth, point ids, normals and more, as EXR", Action::SaveLayers),
            ("scene", "F8: save the scene, for render --scene", Action::SaveScene),
        ] {
            let hint = spaced_hyphens(ui, hint);
            if ui.button(format!("save {name}")).on_hover_text(hint).clicked() {
                actions.push(action);
            }
        }
    });
    ui.horizontal(|ui| {
        let load = ui.button("load scene");
        let hint = "F6: the one saved last; others are dropped on the window";
        if load.on_hover_text(hint).clicked() {
            actions.push(Action::LoadScene);
        }
        save_size(ui, &mut state.save_size, view);
    });
    notes(ui, state);
    let doing = state.doing.as_deref().unwrap_or("ready");
    text::line(ui, RichText::new(doing).color(theme::BUSY));
}

/// Shows the first note in one line; a click shows all.
fn notes(ui: &mut Ui, state: &mut UiState) {
    let mut notes = state.notes.iter().chain(&state.picture_notes);
    let count = state.notes.len() + state.picture_notes.len();
    let said = match (count, notes.next()) {
        (_, None) => {
            text::weak(ui, "no notes");
            return;
        }
        (1, Some(note)) => format!("1 note: {note}"),
        (_, Some(note)) => format!("{count} notes: {note}"),
    };
    let row = egui::Label::new(RichText::new(said).color(theme::NOTE)).truncate();
    if ui.add(row.sense(Sense::click())).on_hover_text("click to read").clicked() {
        state.reads_notes = !state.reads_notes;
    }
}

/// Chooses the size of saved pictures: a multiple of the window, or any size.
fn save_size(ui: &mut Ui, save_size: &mut SaveSize, view: Option<&View>) {
    const MOST: u32 = 262_144;
    let window = view.map_or([1, 1], |view| view.size);
    let said = save_size.of(window).map(|side| side.to_string()).join(" x ");
    ui.menu_button(said, |ui| {
        for times in [1, 2, 4] {
            let said = SaveSize::Times(times).of(window).map(|side| side.to_string()).join(" x ");
            ui.selectable_value(save_size, SaveSize::Times(times), format!("{times}x: {said}"));
        }
        let mut sides = save_size.of(window);
        ui.horizontal(|ui| {
            let [wide, high] =
                sides.each_mut().map(|side| ui.add(DragValue::new(side).range(1..=MOST)).changed());
            if wide || high {
                *save_size = SaveSize::To(sides);
            }
        });
    })
    .response
    .on_hover_text("size of saved pictures");
}
