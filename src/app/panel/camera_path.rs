//! The camera path: adding views, and playing.

use super::state::UiState;
use super::text::spaced_hyphens;
use crate::app::actions::Action;
use egui::{CollapsingHeader, Ui};

pub fn show(ui: &mut Ui, state: &UiState, actions: &mut Vec<Action>) {
    let keys = state.path.keys.len();
    CollapsingHeader::new(format!("camera path, {keys} views, {:.1} s", state.path.duration()))
        .id_salt("camera path")
        .show(ui, |ui| {
            ui.horizontal(|ui| {
                let play = if state.plays { "stop" } else { "play" };
                for (name, key, action, useful) in [
                    ("add view", "K", Action::AddKey, true),
                    (play, "Space", Action::Play, keys > 0),
                    ("save", "F7, for render --path", Action::SavePath, keys > 0),
                    ("forget", "", Action::ForgetPath, keys > 0),
                ] {
                    let key = spaced_hyphens(ui, key);
                    if ui.add_enabled(useful, egui::Button::new(name)).on_hover_text(key).clicked()
                    {
                        actions.push(action);
                    }
                }
            });
        });
}
