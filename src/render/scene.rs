//! The scene file: camera, colour, settings, filters. The window saves it, `render --scene` draws
//! it.
//!
//! Its values are written as on the command line, so that both accept the same words.

use crate::atomic_file::write_atomically;
use crate::cloud::attribute::Attribute;
use crate::cloud::color_scale::ColorScale;
use crate::cloud::filter::Filter;
use crate::cloud::length::Length;
use crate::error::{Error, Result};
use crate::names::parse_list;
use crate::passes::Effects;
use crate::render::annotations::Annotations;
use crate::render::settings::{Background, RenderSettings};
use crate::select::clip::Clips;
use crate::select::lod::LodOptions;
use crate::select::opacity::Opacities;
use crate::small_file::{ONE_PICTURE, read_text};
use crate::view::Camera;
use crate::view::light::Light;
use serde::{Deserialize, Serialize};
use std::path::Path;

#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    pub camera: Camera,
    /// Attribute to show; chosen by the points' attributes if `None`.
    pub color: Option<Attribute>,
    pub settings: RenderSettings,
    /// How numbers and channels become colours.
    pub scale: ColorScale,
    pub opacities: Opacities,
    pub filter: Filter,
    pub clips: Clips,
    /// LOD limits, for an index.
    pub lod: LodOptions,
    /// What is drawn over the picture.
    pub annotations: Annotations,
}

/// The JSON of `scene.json`.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Words {
    camera: Camera,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    color: Option<String>,
    /// Ramp, range, brightness, contrast and gamma; those not named have their defaults.
    #[serde(default, skip_serializing_if = "ColorScale::is_neutral")]
    scale: ColorScale,
    /// Effects as after `--effect`; those not named have their defaults.
    #[serde(default)]
    effects: Vec<String>,
    #[serde(default)]
    opacity: Vec<String>,
    /// Conditions as after `--only` and `--not`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    only: Vec<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    not: Vec<String>,
    /// Boxes as after `--clip`.
    #[serde(default)]
    clip: Vec<String>,
    /// Limits as after `--point-budget` and `--lod`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    budget: Option<u64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    lod: Option<f64>,
    /// Layer distance as after `--layer`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    layer: Option<LayerWords>,
    #[serde(default)]
    light: Option<String>,
    #[serde(default)]
    background: Option<String>,
    /// Title, legend, scale bar, north arrow and axes.
    #[serde(default, skip_serializing_if = "Annotations::is_empty")]
    annotations: Annotations,
}

/// A layer distance: a number of the coordinates' unit, or a text such as `0.1m`.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum LayerWords {
    Number(f64),
    Text(String),
}

impl Scene {
    pub fn write(&self, path: &Path) -> Result<()> {
        let words = Words {
            camera: self.camera,
            color: self.color.map(Attribute::name),
            scale: self.scale,
            effects: self.settings.effects.clone().list().iter().map(ToString::to_string).collect(),
            opacity: self.opacities.0.iter().map(ToString::to_string).collect(),
            only: self.filter.only.iter().map(ToString::to_string).collect(),
            not: self.filter.not.iter().map(ToString::to_string).collect(),
            clip: self.clips.0.iter().map(ToString::to_string).collect(),
            budget: self.lod.budget,
            lod: self.lod.lod_px,
            layer: match self.settings.layer {
                layer if layer.number() == 0.0 => None,
                Length::OfCoordinates(length) => Some(LayerWords::Number(length)),
                Length::Metres(_) => Some(LayerWords::Text(self.settings.layer.to_string())),
            },
            light: Some(self.settings.light.to_string()),
            background: Some(Background(self.settings.background).to_string()),
            annotations: self.annotations.clone(),
        };
        let text = serde_json::to_string_pretty(&words).expect("words are JSON");
        write_atomically(path, |partial| {
            std::fs::write(partial, text).map_err(|error| Error::io("write", path, error))
        })
    }

    pub fn read(path: &Path) -> Result<Scene> {
        let text = read_text(path, ONE_PICTURE)?;
        let words: Words = serde_json::from_str(&text)
            .map_err(|error| Error::format(path, format!("not a scene file: {error}")))?;
        Scene::of(words).map_err(|why| Error::format(path, why))
    }

    fn of(words: Words) -> std::result::Result<Scene, String> {
        let mut settings = RenderSettings::default();
        for effect in &words.effects {
            Effects::set(&mut settings.effects, effect)
                .map_err(|why| format!("effect {effect}: {why}"))?;
        }
        if let Some(light) = &words.light {
            settings.light = light.parse::<Light>()?;
        }
        if let Some(background) = &words.background {
            settings.background = background.parse::<Background>()?.0;
        }
        if let Some(layer) = &words.layer {
            settings.layer = match layer {
                LayerWords::Number(length) => Length::OfCoordinates(*length),
                LayerWords::Text(text) => text.parse::<Length>()?,
            };
            let number = settings.layer.number();
            if !(number.is_finite() && number > 0.0) {
                return Err("layer must be a length above 0".into());
            }
        }
        let color = words.color.as_deref().map(str::parse::<Attribute>);
        let rules = parse_list(&words.opacity)?;
        let filter = Filter { only: parse_list(&words.only)?, not: parse_list(&words.not)? };
        let clips = parse_list(&words.clip)?;
        if words.lod.is_some_and(|lod| !(lod.is_finite() && lod >= 0.0)) {
            return Err("lod must be a number of pixels, at least 0".into());
        }
        let lod = LodOptions { budget: words.budget, lod_px: words.lod };
        Ok(Scene {
            camera: words.camera,
            color: color.transpose()?,
            scale: words.scale.checked()?,
            settings,
            opacities: Opacities(rules),
            filter,
            clips: Clips(clips),
            lod,
            annotations: words.annotations,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::color_scale::Ramp;
    use crate::view::Preset;

    #[test]
    fn a_scene_is_what_was_written() {
        let mut settings = RenderSettings {
            light: "direction:1,-2.5,-0.125".parse().unwrap(),
            background: [1, 200, 30],
            layer: Length::Metres(0.1),
            ..RenderSettings::default()
        };
        for effect in [
            "edl=on,strength=0.30000000000000004",
            "fill=off,method=mask",
            "shadows=auto,samples=7",
        ] {
            settings.effects.set(effect).unwrap();
        }
        let opacities = Opacities(
            ["class:6=0.5", "0.25", "station:north=0"].map(|rule| rule.parse().unwrap()).into(),
        );
        let clips = Clips(
            ["box:500000.1,-1,0.30000000000000004,500010,inf,5", "off:0,0,0,1,1,1"]
                .map(|clip| clip.parse().unwrap())
                .into(),
        );
        let lod = LodOptions { budget: Some(123_456), lod_px: Some(1.5) };
        let corners =
            [glam::DVec3::splat(5e6), glam::DVec3::new(5e6 + 0.1, 5e6 + 1.0 / 3.0, 5e6 + 7.0)];
        let scene = Scene {
            camera: Camera::framing(Preset::Fit, &corners, [640, 480]),
            color: Some(Attribute::Class),
            scale: ColorScale {
                ramp: Some(Ramp::Viridis),
                range: Some([0.1, 1.0 / 3.0]),
                gamma: 1.1,
                ..ColorScale::default()
            },
            settings,
            opacities,
            filter: Filter {
                only: vec!["ground".parse().unwrap(), "z=0..2.5".parse().unwrap()],
                not: vec!["return=last".parse().unwrap()],
            },
            clips,
            lod,
            annotations: Annotations {
                title: Some("Plot \"7\"".into()),
                scale_bar: true,
                ..Annotations::default()
            },
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.json");
        scene.write(&path).unwrap();
        assert_eq!(Scene::read(&path).unwrap(), scene);
        std::fs::write(
            &path,
            "{\"camera\": {\"eye\": [0,0,1], \"target\": [0,0,0]}, \"effects\": [\"edl=perhaps\"]}",
        )
        .unwrap();
        assert!(Scene::read(&path).unwrap_err().to_string().contains("edl=perhaps"));
        std::fs::write(
            &path,
            "{\"camera\": {\"eye\": [0,0,1], \"target\": [0,0,0]}, \"scale\": {\"gamma\": 0}}",
        )
        .unwrap();
        assert!(Scene::read(&path).unwrap_err().to_string().contains("gamma"));
    }
}
