//! Warnings about settings that have no effect on a cloud.

use super::FrameConfig;
use crate::passes::fill::Method;
use crate::passes::phong::{Backfaces, Normals};
use crate::passes::shadows::{self, cameras::WIDEST_DEGREES};
use crate::passes::smooth::Pixels;
use crate::passes::{Effect, Effects, Setting, Settings, Switch, layer_m, significant, splat};
use crate::resident::Resident;
use crate::view::light::Light;

impl FrameConfig {
    pub fn warnings(&self, resident: &Resident) -> Vec<String> {
        let mut notes = resident.opacities.idle(&resident.known());
        if resident.opacities.hides_all(&resident.known()) {
            notes.push("--opacity hides all points".into());
        }
        if resident.is_transparent() && self.effects.transparency.switch == Switch::Off {
            notes.push("transparency=off: --opacity has no effect on points that are drawn".into());
        }
        notes.extend(self.unused());
        let phong = self.effects.phong.settings;
        if phong.backfaces == Backfaces::Drop
            && self.decisions.runs(Effect::Phong)
            && !self.drops_back_faces(resident)
        {
            let why = match phong.normals {
                Normals::Depth => {
                    "normals=depth does not read the files' normals, which tell the outside"
                }
                _ => "the files have no oriented normals",
            };
            notes.push(format!("phong=backfaces=drop has no effect: {why}"));
        }
        let smooth = &self.effects.smooth;
        if smooth.settings.pixels == Pixels::Filled
            && self.decisions.runs(Effect::Smooth)
            && !self.decisions.runs(Effect::Fill)
        {
            notes.push(
                "smooth has no effect: nothing is filled; smooth=pixels=all smooths points".into(),
            );
        }
        notes.extend(self.coarse(resident.unit_m()));
        notes.extend(self.narrowed());
        let fills_by_masks = self.effects.fill.settings.method == Method::Mask;
        let using = [
            self.decisions.runs(Effect::Fill) && fills_by_masks,
            self.decisions.runs(Effect::Transparency),
            self.decisions.runs(Effect::Shadows),
        ];
        if self.layer_m > 0.0 && using == [false; 3] {
            notes.push(format!(
                "a layer distance of {} m has no effect: fill=method=mask, transparency or shadows would use it",
                significant(self.layer_m * resident.unit_m())
            ));
        }
        if self.decisions.runs(Effect::Shadows) {
            notes.extend(self.of_shadows(resident));
        }
        notes
    }

    /// Returns a warning for each effect that does not run, is not switched off, and has changed
    /// settings.
    fn unused(&self) -> Vec<String> {
        let (mut asked, mut usual) = (self.effects.clone(), Effects::default());
        let pairs = asked.list().into_iter().zip(usual.list());
        pairs
            .filter(|(own, _)| *own.switch == Switch::Auto && !self.decisions.runs(own.effect))
            .filter_map(|(own, usual)| {
                let chosen = chosen(&own.settings, &usual.settings);
                let why =
                    self.decisions.reason(own.effect).map_or("", |reason| reason.why.as_str());
                (!chosen.is_empty()).then(|| {
                    format!(
                        "{}: {} {} no effect, since the effect does not run: {why}",
                        own.effect.name(),
                        chosen.join(" and "),
                        if chosen.len() == 1 { "has" } else { "have" }
                    )
                })
            })
            .collect()
    }

    /// Returns a warning if points are drawn narrower than they should be.
    pub fn narrowed(&self) -> Option<String> {
        let splat = &self.effects.splat.settings;
        let asked = self
            .decisions
            .runs(Effect::Splat)
            .then(|| splat.narrowed(self.sampling.finest_m))
            .flatten()?;
        let largest = splat.largest;
        let wider = asked.ceil().min(splat::WIDEST);
        let remedy = if largest < wider {
            format!("--effect splat=on,largest={wider} draws them wider, and slower")
        } else {
            "a smaller --point-size, or a view from farther away, shows them as they are".into()
        };
        let asked = asked.round();
        Some(format!(
            "points are drawn at most {largest} px wide, where they would be up to {asked} px: {remedy}"
        ))
    }

    /// Returns a warning if depths are coarser than the settings need (guide: numerics, case 4).
    fn coarse(&self, unit_m: f64) -> Option<String> {
        let layer = |of_effect: f64| layer_m([of_effect, self.layer_m], &self.sampling);
        let (fill, transparency) =
            (&self.effects.fill.settings, &self.effects.transparency.settings);
        let masks = (self.decisions.runs(Effect::Fill) && fill.method == Method::Mask)
            .then(|| layer(fill.layer));
        let peels = self.decisions.runs(Effect::Transparency).then(|| layer(transparency.layer));
        let quantum_m = significant(self.quantum_m * unit_m);
        if let Some(layer_m) = [masks, peels]
            .into_iter()
            .flatten()
            .reduce(f64::min)
            .filter(|layer_m| *layer_m < 2.0 * self.quantum_m)
        {
            let layer_m = significant(layer_m * unit_m);
            return Some(format!(
                "the layer distance {layer_m} m is too small for the depth resolution in view, {quantum_m} m: surfaces may merge; move closer, or use --layer {}m",
                significant(2.0 * self.quantum_m * unit_m)
            ));
        }
        // A surface that rises by a pixel's width per pixel is then a staircase.
        let surface = [Effect::Fill, Effect::Shape, Effect::Phong]
            .iter()
            .any(|effect| self.decisions.runs(*effect));
        let pixel_m = self.sampling.pixel_m;
        (surface && pixel_m > 0.0 && pixel_m < 2.0 * self.quantum_m)
            .then(|| format!("the depth resolution in view is {quantum_m} m, and pixels are {} m wide there: surfaces show steps and gaps; move closer", significant(pixel_m * unit_m)))
    }

    fn of_shadows(&self, resident: &Resident) -> Vec<String> {
        let mut notes = Vec::new();
        let settings = self.effects.shadows.settings;
        if self.decisions.runs(Effect::Phong)
            && settings.ambient != shadows::Settings::default().ambient
        {
            notes.push(
                "shadows=ambient has no effect, since phong runs: phong=ambient lights shadows"
                    .into(),
            );
        }
        if resident.saved_light().is_some_and(|saved| self.light.is_written(&saved.light)) {
            // Except for the darkness of shadows.
            let (mut own, mut usual) =
                (settings, shadows::Settings { ambient: settings.ambient, ..Default::default() });
            let idle = chosen(&own.list(), &usual.list());
            if !idle.is_empty() {
                notes.push(format!(
                    "saved shadows ignore {}; cast new ones with `pointillist shadows`",
                    idle.join(" and ")
                ));
            }
            if resident.hides() || resident.clips.active() > 0 {
                notes.push("saved shadows include points that --opacity or --clip remove".into());
            }
        } else if !matches!(self.light, Light::Position(_)) && settings.radius > WIDEST_DEGREES {
            notes.push(format!(
                "shadows=radius={} is limited to {WIDEST_DEGREES} degrees to each side, as a directional light allows no more",
                settings.radius
            ));
        }
        notes
    }
}

/// Returns the names of settings that differ from the default.
fn chosen(own: &[Setting], usual: &[Setting]) -> Vec<&'static str> {
    own.iter()
        .zip(usual)
        .filter(|(own, usual)| own.value.to_string() != usual.value.to_string())
        .map(|(own, _)| own.name)
        .collect()
}
