//! A look and the cloud it is of -> what was asked for and changes nothing, in words, for whoever asked.

use super::Look;
use crate::passes::phong::Backfaces;
use crate::passes::smooth::Pixels;
use crate::passes::{Settings, Value, shadows};
use crate::resident::Resident;

impl Look {
    pub fn notes(&self, resident: &Resident) -> Vec<String> {
        let mut notes = resident.opacities.idle(&resident.known());
        let phong = self.effects.phong.settings;
        if phong.backfaces == Backfaces::Drop && !self.drops_back_faces(resident) {
            let why = if resident.oriented { "phong does not run" } else { "no normals of the files say which side is outside" };
            notes.push(format!("phong=backfaces=drop: {why}; points that face away are drawn, too"));
        }
        let smooth = &self.effects.smooth;
        if smooth.settings.pixels == Pixels::Filled && self.decided.runs("smooth") && !self.decided.runs("fill") {
            notes.push("smooth: nothing is filled, and so nothing is smoothed; smooth=pixels=all smooths points".into());
        }
        let saved = resident.light.as_ref().is_some_and(|saved| self.light.is_written(&saved.light)) && self.decided.runs("shadows");
        if saved {
            let idle = unlike_usual(self.effects.shadows.settings);
            if !idle.is_empty() {
                notes.push(format!(
                    "shadows are those that were saved, and take no account of {}; cast others with `pointillist shadows`",
                    idle.join(" and ")
                ));
            }
            if resident.hides() || resident.clips.active() > 0 {
                notes.push("shadows that were saved are those of all points, also of those that --opacity or --clip leave out".into());
            }
        }
        notes
    }
}

/// Settings of shadows that somebody has chosen, but for how dark shadows are.
fn unlike_usual(mut settings: shadows::Settings) -> Vec<&'static str> {
    let mut usual = shadows::Settings { ambient: settings.ambient, ..shadows::Settings::default() };
    let said = |value: &Value| match value {
        Value::Number(number, _) | Value::OneOf(number, _) => number.to_string(),
        Value::Choice(choice) => choice.name().to_string(),
    };
    let pairs = settings.list().into_iter().zip(usual.list());
    pairs.filter(|(own, usual)| said(&own.value) != said(&usual.value)).map(|(own, _)| own.name).collect()
}
