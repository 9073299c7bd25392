//! Anti-aliasing: depth, and colour in its light, in; the same, blended at silhouettes, out (Dobrev, Rosenthal and Linsen 2010, sec. 3.5).
//!
//! Silhouettes are where the Laplacian of the depth is large. Blending is in linear light, of colour times coverage, so that it comes last of all effects and the background shows through in part.
//! Depth and point ids stay as they are.

use super::{Decided, Effects, Layers, Reason, Scene, Setting, Value};
use crate::graph::{Graph, Kind, Tiles};
use crate::shader::{self, antialias::Push, antialias::Spec};
use crate::view::View;

pub const SUMMARY: &str = "smooths the stairs of silhouettes, which are where the Laplacian of the depth is large";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    pub threshold: Threshold,
    pub laplacian: Laplacian,
    /// The low threshold: least Laplacian of a silhouette, parts of the depth.
    pub jump: f64,
}

/// Which silhouettes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Threshold {
    /// Against the background, and between surfaces.
    #[default]
    Low,
    /// Against the background only.
    High,
}

/// Of what.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Laplacian {
    /// Of 1 / depth, which bends on no plane.
    #[default]
    Inverse,
    /// Of the depth: the paper's.
    Depth,
}

impl Default for Settings {
    fn default() -> Self {
        Settings { threshold: Threshold::Low, laplacian: Laplacian::Inverse, jump: 0.03 }
    }
}

impl super::Settings for Settings {
    fn list(&mut self) -> Vec<Setting<'_>> {
        vec![
            Setting { name: "threshold", about: "low: between surfaces, too; high: against the background only", value: Value::Choice(&mut self.threshold) },
            Setting { name: "laplacian", about: "of 1 / depth, or of the depth", value: Value::Choice(&mut self.laplacian) },
            Setting { name: "jump", about: "least Laplacian of a silhouette, parts of the depth", value: Value::Number(&mut self.jump, 0.0..=4.0) },
        ]
    }

    fn grows_px(&self, _spacing_px: f64) -> f64 {
        1.0
    }
}

/// As [`super::Effects::reach_px`].
pub fn reach_px(_view: &View, _settings: &Settings) -> Option<u32> {
    Some(2)
}

pub fn called_for(_scene: &Scene, _asked: &Effects, before: &Decided) -> Reason {
    let (runs, why) = match before.runs("fill") {
        _ if before.runs("smooth") => (true, "what was smoothed ends in stairs against what lies behind"),
        true => (false, "pixels keep what they show, and nothing else was smoothed"),
        false => (false, "points have no silhouettes"),
    };
    Reason { runs, why: why.to_string() }
}

pub fn record(g: &mut Graph, scene: &Scene, settings: &Settings, layers: Layers) -> Layers {
    let size = scene.view.size;
    let mut blended = g.image("blended", size, Kind::Rgba32f);
    let mut left = g.image("left", size, Kind::R32f);
    // Without light there is nothing to read; a binding wants an image all the same.
    let lit = layers.lit.as_ref().unwrap_or(&layers.depth);
    let push = Push { size, jump: settings.jump as f32 };
    let spec =
        Spec { lit_by: layers.lit.is_some(), inverse: settings.laplacian == Laplacian::Inverse, high: settings.threshold == Threshold::High };
    g.run(shader::Antialias { depth: &layers.depth, color: &layers.color, lit, blended: &mut blended, left: &mut left, push, spec }, Tiles::All);
    Layers { color: blended, lit: Some(left), ..layers }
}
