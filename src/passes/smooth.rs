//! Smoothing: depth and colour in, the weighted means of their 3 x 3 out (Dobrev, Rosenthal and Linsen 2010, sec. 3.4).
//!
//! Filling by the nearest neighbour leaves patches of one depth and colour; this takes the steps between them away. They lie where the depth of what was projected jumps: in gaps, and at what shows through. What was
//! measured stays as it is where all around it was. Background neither gives nor takes, so that outlines stay.

use super::{Decided, Effects, Layers, Reason, Scene, Setting, Value, fill};
use crate::graph::{Graph, Image, Kind, Tiles};
use crate::shader::{self, smooth::Push, smooth::Spec};
use crate::view::View;

pub const SUMMARY: &str = "takes away steps between pixels of one surface: means of depth and colour over 3 x 3";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    pub filter: Filter,
    /// How often.
    pub iterations: f64,
    /// Which pixels.
    pub pixels: Pixels,
}

/// What is smoothed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Pixels {
    /// Those that were filled, and those beside them.
    #[default]
    Filled,
    /// Measured ones, too, as in the paper.
    All,
}

/// Weights of the pixel itself, of its four sides and of its corners.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Filter {
    /// 16, 2, 1: the paper's own, which hardly blurs.
    #[default]
    Alleviated,
    /// 4, 2, 1.
    Gaussian,
    /// 1, 1, 1.
    Box,
}

impl Filter {
    pub fn weights(self) -> [f32; 3] {
        match self {
            Filter::Alleviated => [16.0, 2.0, 1.0],
            Filter::Gaussian => [4.0, 2.0, 1.0],
            Filter::Box => [1.0; 3],
        }
    }
}

impl Default for Settings {
    fn default() -> Self {
        Settings { filter: Filter::Alleviated, iterations: 1.0, pixels: Pixels::Filled }
    }
}

impl super::Settings for Settings {
    fn list(&mut self) -> Vec<Setting<'_>> {
        vec![
            Setting { name: "filter", about: "weights: 16 2 1, 4 2 1 or 1 1 1 of the pixel, sides and corners", value: Value::Choice(&mut self.filter) },
            Setting { name: "iterations", about: "how often", value: Value::Whole(&mut self.iterations, 1.0..=64.0) },
            Setting { name: "pixels", about: "filled: these and those beside them; all: the others, too", value: Value::Choice(&mut self.pixels) },
        ]
    }

    /// What holds no point stays as it is.
    fn grows_px(&self, _spacing_px: f64) -> f64 {
        0.0
    }
}

/// As [`super::Effects::reach_px`].
pub fn reach_px(_view: &View, settings: &Settings) -> Option<u32> {
    Some(settings.iterations as u32)
}

pub fn called_for(_scene: &Scene, asked: &Effects, before: &Decided) -> Reason {
    let (runs, why) = match (before.runs("fill"), asked.fill.settings.method) {
        (false, _) => (false, "points are not smoothed, and no surface was filled"),
        (true, fill::Method::Dobrev) => (true, "filling from the nearest neighbour leaves patches of one depth and colour; where none were filled, pixels stay as they were measured"),
        (true, _) => (false, "filling leaves no patches of one depth and colour, and details stay as they are"),
    };
    Reason { runs, why: why.to_string() }
}

pub fn record(g: &mut Graph, scene: &Scene, settings: &Settings, layers: Layers) -> Layers {
    let size = scene.view.size;
    let (push, all) = (Push { size, weights: settings.filter.weights() }, settings.pixels == Pixels::All);
    let smoothed = |g: &mut Graph, color: &Image| {
        let Layers { raw, depth: filled, .. } = &layers;
        let mut smoothed: Option<(Image, Image)> = None;
        for _ in 0..settings.iterations as u32 {
            let mut smooth_depth = g.image("smooth depth", size, Kind::R32f);
            let mut smooth_color = g.image("smooth color", size, Kind::Rgba32f);
            let (depth, color) = smoothed.as_ref().map_or((filled, color), |(depth, color)| (depth, color));
            let (spec, to) = (Spec { all, again: smoothed.is_some() }, (&mut smooth_depth, &mut smooth_color));
            g.run(shader::Smooth { raw, filled, depth, color, smooth_depth: to.0, smooth_color: to.1, push, spec }, Tiles::All);
            smoothed = Some((smooth_depth, smooth_color));
        }
        smoothed.expect("once at least")
    };
    // Steps of depth and colour are everywhere that something was filled, those of the light only where its edges are; noise in it is taken away with all else.
    let reached = if all { layers.reached.as_ref().map(|reached| smoothed(g, reached).1) } else { None };
    let (depth, color) = smoothed(g, &layers.color);
    Layers { depth, color, reached: reached.or(layers.reached), ..layers }
}
