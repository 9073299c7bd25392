//! Shape depiction: depth and colour in, colour times a shade out that shows shape without normals (Pintus et al. 2011, sec. 6).
//!
//! Every level compares a pixel's depth with mean and deviation of its 3 x 3, and hands a smoother depth to the next: fine levels draw lines, coarse ones light whole surfaces.

use super::{Decided, Layers, Reason, Scene, Setting, Value};
use crate::graph::{Graph, Kind, Tiles};
use crate::shader::{self, shade, shape};
use crate::view::{Projection, View};

pub const SUMMARY: &str = "shades by shape: lines at creases, light on what faces the viewer, without normals";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    /// Levels; 1 is the paper's single pass: sharp, lines only.
    pub levels: f64,
    /// Level k weighs 1 / (k + 1)^xi.
    pub xi: f64,
    /// The first level's weight is that of all others together (Fig. 8 d): 1 yes, 0 no.
    pub first: f64,
    /// How much a surface may rise from pixel to pixel and still face the viewer, pixels' widths.
    pub softness: f64,
    pub base: Base,
}

/// What is shaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Base {
    /// The points' colours.
    #[default]
    Color,
    /// White: the shade alone.
    White,
}

impl Default for Settings {
    fn default() -> Self {
        Settings { levels: 8.0, xi: 1.5, first: 0.0, softness: 1.0, base: Base::Color }
    }
}

impl super::Settings for Settings {
    fn list(&mut self) -> Vec<Setting<'_>> {
        let number = Value::Number;
        vec![
            Setting { name: "levels", about: "levels of smoothing; 1: single pass", value: number(&mut self.levels, 1.0..=64.0) },
            Setting { name: "xi", about: "level k weighs 1 / (k + 1)^xi", value: number(&mut self.xi, 0.0..=16.0) },
            Setting { name: "first", about: "1: the first level weighs as much as all others", value: number(&mut self.first, 0.0..=1.0) },
            Setting { name: "softness", about: "rise from pixel to pixel that still faces the viewer, pixels' widths", value: number(&mut self.softness, 0.0..=1e3) },
            Setting { name: "base", about: "what is shaded; --color elevation makes it a ramp of heights", value: Value::Choice(&mut self.base) },
        ]
    }
}

pub fn called_for(scene: &Scene, _settings: &Settings, _before: &Decided) -> Reason {
    match scene.points {
        0 => Reason { runs: false, why: "there is nothing to shade".to_string() },
        _ => Reason { runs: true, why: "points have no normals to be lit by; depth alone shows their shape".to_string() },
    }
}

/// Of every level, so that they add up to 1.
pub fn weights(settings: &Settings) -> Vec<f64> {
    let mut weights: Vec<f64> = (0..settings.levels as u32).map(|k| ((k + 1) as f64).powf(-settings.xi)).collect();
    if settings.first >= 0.5 && weights.len() > 1 {
        weights[0] += weights[1..].iter().sum::<f64>();
    }
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|weight| weight / sum).collect()
}

pub fn record(g: &mut Graph, view: &View, settings: &Settings, layers: Layers) -> Layers {
    let perspective = view.camera.projection == Projection::Perspective;
    let width = (settings.softness / view.focal_px()) as f32;
    let mut level: Option<(crate::graph::Image, crate::graph::Image)> = None;
    for (k, weight) in weights(settings).into_iter().enumerate() {
        let mut next = g.image("next", view.size, Kind::R32f);
        let mut shade = g.image("shade", view.size, Kind::R32f);
        let (depth, shade_before) = level.as_ref().map_or((&layers.depth, &layers.depth), |(depth, shade)| (depth, shade));
        let push = shape::Push { size: view.size, width, weight: weight as f32 };
        let spec = shape::Spec { perspective, first: k == 0 };
        g.run(shader::Shape { depth, shade_before, next: &mut next, shade: &mut shade, push, spec }, Tiles::All);
        level = Some((next, shade));
    }
    let (_, shade) = level.expect("one level at least");
    let mut shaded = g.image("shaded", view.size, Kind::Rgba32f);
    let keep = if settings.base == Base::Color { 1.0 } else { 0.0 };
    let push = shade::Push { size: view.size, keep };
    g.run(shader::Shade { color: &layers.color, shade: &shade, shaded: &mut shaded, push }, Tiles::All);
    Layers { color: shaded, ..layers }
}
