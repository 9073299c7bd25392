//! Study `shape`: the levels that shape depiction needs, by its light against that of many levels,
//! and against the light of the true surface.
//!
//! Against `self`, the renderer's own picture with 64 levels, only the loss by fewer levels shows.
//! Against the truth, the operator (Pintus et al. 2011, sec. 6) with 64 levels on the ray-cast
//! depths, in f64 and on every pixel, errors of points, visibility and filling show, too. One level
//! is the paper's single pass.

use super::Plan;
use super::cases::Case;
use super::configurations::{self, AUTO, Configuration, Drawing, Experiment, Metric, Part};
use super::report::Section;
use crate::error::Result;
use crate::graph::Gpu;
use crate::passes::shape;
use crate::progress::Progress;
use crate::view::{Projection, View};
use rayon::prelude::*;

pub const SUMMARY: &str =
    "levels: light against that of many levels, and against that of the surface itself";

const MANY: f64 = 64.0;

pub fn run(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    configurations::run::<Shape>(gpu, plan, progress)
}

struct Shape;

/// Light of 64 levels: the renderer's own, and of the true depths.
struct Light {
    own: Vec<f32>,
    truth: Vec<f64>,
}

const METRICS: &[Metric] = &[
    Metric {
        name: "self_rms",
        axis: "RMS error of light",
        about: "Light against the renderer's own with 64 levels (self)",
        root: true,
    },
    Metric {
        name: "truth_rms",
        axis: "RMS error of light",
        about: "Light against that of the surface itself, f64",
        root: true,
    },
];

impl Experiment for Shape {
    const NAME: &'static str = "shape";
    const TITLE: &'static str = "Shape depiction: levels";
    const METRICS: &'static [Metric] = METRICS;
    const COUNTERS: &'static [&'static str] =
        &["tiles of the first level", "tiles of deeper levels"];
    const REFERENCE: &'static [&'static str] =
        &["visibility=on", "fill=on", "shape=on,levels=64", "edl=off"];
    const AFTER: &'static [&'static str] = &["resolve", "visibility_apply", "fill"];
    const METHOD: &'static str = "Light is 0 to 1. Errors are root mean squares over interior pixels that have a depth. <em>Self</em> is the renderer's own light with 64 levels, which is 0 there by \
        definition; the truth is the operator with 64 levels on ray-cast depths, in f64. One level is the single pass of the paper. Visibility and filling run before, and are not timed here.";
    type Reference = Light;

    fn configurations(_case: &Case) -> Vec<Configuration> {
        let own = |parameter, value: &str, shape: &str| {
            Configuration::new(parameter, value, &["visibility=on", "fill=on", "edl=off", shape])
        };
        let levels = ["1", "2", "4", "6", "12", "16", "32", "64"]
            .map(|levels| own("levels", levels, &format!("shape=on,levels={levels}")));
        [own(AUTO, AUTO, "shape=on")].into_iter().chain(levels).collect()
    }

    fn reference(case: &Case, drawing: Drawing) -> Light {
        let settings = shape::Settings { levels: MANY, ..shape::Settings::default() };
        Light {
            own: drawing.shading,
            truth: light(&case.view, &settings, case.truth.depth.clone()),
        }
    }

    fn measure(case: &Case, reference: &Light, drawing: &Drawing) -> (Vec<Part>, Vec<f64>) {
        let counts = |i: &usize| case.truth.interior[*i] && drawing.depth[*i].is_finite();
        let pixels: Vec<usize> = (0..drawing.depth.len()).filter(counts).collect();
        let squares = |light: &dyn Fn(usize) -> f64| {
            pixels.iter().map(|&i| (drawing.shading[i] as f64 - light(i)).powi(2)).sum::<f64>()
        };
        let count = pixels.len() as f64;
        let parts = vec![
            [squares(&|i| reference.own[i] as f64), count],
            [squares(&|i| reference.truth[i]), count],
        ];
        (parts, [drawing.counts.tiles, drawing.counts.rough].map(|count| count as f64).to_vec())
    }
}

/// Applies the operator level by level; empty pixels have infinite depth.
fn light(view: &View, settings: &shape::Settings, mut depth: Vec<f64>) -> Vec<f64> {
    let [columns, rows] = view.size.map(|side| side as i64);
    let width = settings.softness / view.focal_px();
    let mut light = vec![0.0; depth.len()];
    for weight in shape::weights(settings) {
        let level = |i: usize| {
            let own = depth[i];
            if !own.is_finite() {
                return (1.0, own);
            }
            let (x, y) = (i as i64 % columns, i as i64 / columns);
            let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
            for y in (y - 1).max(0)..(y + 2).min(rows) {
                for x in (x - 1).max(0)..(x + 2).min(columns) {
                    let rise = depth[(y * columns + x) as usize] - own;
                    if rise.is_finite() {
                        (count, sum, squares) = (count + 1.0, sum + rise, squares + rise * rise);
                    }
                }
            }
            let mu: f64 = sum / count;
            let sigma = (squares / count - mu * mu).max(0.0).sqrt();
            let eps =
                if view.camera.projection == Projection::Perspective { width * own } else { width };
            let omega = (1.0 - (sigma - mu).abs() / (2.0 * sigma + eps)).clamp(0.0, 1.0);
            (omega, (own + mu - sigma / 2.0).max(own / 2.0))
        };
        let levels: Vec<(f64, f64)> = (0..depth.len()).into_par_iter().map(level).collect();
        light.iter_mut().zip(&levels).for_each(|(light, (omega, _))| *light += weight * omega);
        depth = levels.into_iter().map(|(_, next)| next).collect();
    }
    light
}
