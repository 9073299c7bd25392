//! The top of the panel: what is open, how much of it is drawn, navigation, and the tabs. Every row
//! is always there, so that nothing below moves.

use super::state::{Tab, UiState};
use super::text;
use crate::app::actions::Action;
use crate::app::navigation::{Input, Mode};
use crate::cloud::filter::grouped;
use crate::render::scene::Scene;
use egui::{Align, Layout, RichText, Ui};

pub fn show(ui: &mut Ui, state: &mut UiState, scene: &Scene, actions: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            if ui.button("hide").on_hover_text("N").clicked() {
                actions.push(Action::FoldPanel);
            }
            ui.menu_button("open", |ui| open(ui, state, actions));
            ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                let title = if state.title.is_empty() { "no file is open" } else { &state.title };
                text::line(ui, RichText::new(title).strong());
            });
        });
    });
    points(ui, state, scene);
    ui.horizontal(|ui| {
        for mode in Mode::ALL {
            let chosen = ui.selectable_label(state.mode == mode, mode.name());
            if chosen.on_hover_text("what a left drag does; M").clicked() && state.mode != mode {
                actions.push(Action::Navigate(Input::Drag { mode }));
            }
        }
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            if ui.button("keys").on_hover_text("H").clicked() {
                actions.push(Action::Help);
            }
            let [undone, redone] = state.steps;
            for (name, key, action, steps) in [
                ("redo", "Ctrl Shift Z", Action::Redo, redone),
                ("undo", "Ctrl Z", Action::Undo, undone),
            ] {
                let button = ui.add_enabled(steps > 0, egui::Button::new(name));
                if button.on_hover_text(key).clicked() {
                    actions.push(action);
                }
            }
        });
    });
    ui.add_space(2.0);
    ui.columns_const(|columns: &mut [Ui; 3]| {
        for (ui, (tab, name)) in columns.iter_mut().zip(Tab::ALL) {
            ui.vertical_centered_justified(|ui| {
                ui.selectable_value(&mut state.tab, tab, RichText::new(name).strong());
            });
        }
    });
    ui.separator();
}

/// Lists recent files, below the dialog.
pub fn open(ui: &mut Ui, state: &UiState, actions: &mut Vec<Action>) {
    if ui.button("choose files").on_hover_text("Ctrl O").clicked() {
        actions.push(Action::Open);
    }
    for (number, file) in state.recent.iter().enumerate() {
        let name = file.file_name().unwrap_or(file.as_os_str()).to_string_lossy();
        let path = file.display().to_string();
        if ui.button(name.into_owned()).on_hover_text(path).clicked() {
            actions.push(Action::OpenRecent(number));
        }
    }
}

/// Shows how many points are drawn, and without which.
fn points(ui: &mut Ui, state: &UiState, scene: &Scene) {
    let rules = scene.opacities.0.iter().filter(|rule| rule.opacity == 0.0);
    let hidden = rules.map(|rule| rule.what.to_string()).reduce(|all, one| format!("{all}, {one}"));
    let without = hidden.map_or(String::new(), |hidden| format!(", without {hidden}"));
    let at_most = if state.at_most { "at most " } else { "" };
    // A coarse picture counts nodes whole, of which filters and boxes leave less.
    let [drawn, all] = [state.drawn.min(state.points), state.points].map(grouped);
    text::weak(ui, format!("{at_most}{drawn} of {all} points{without}"));
}
