//! Study `ao`: the directions and samples that ambient occlusion needs, by its light against that
//! of many, and against the light of the true surface.
//!
//! Against `self`, the renderer's own picture with 64 directions of 16 samples, only the loss by
//! fewer shows. Against the truth, the operator's f64 twin with 32 directions of 8 on the ray-cast
//! depths, errors of points, visibility and filling show, too.

use super::Plan;
use super::cases::Case;
use super::configurations::{self, AUTO, Configuration, Drawing, Experiment, Metric, Part};
use super::oracle;
use super::report::Section;
use crate::error::Result;
use crate::graph::Gpu;
use crate::passes::ao;
use crate::progress::Progress;

pub const SUMMARY: &str =
    "directions, steps, bias: light against that of many, and against that of the surface itself";

pub fn run(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    configurations::run::<Ao>(gpu, plan, progress)
}

struct Ao;

/// The renderer's own light with many directions, and that of the true depths, except where the
/// twin is undecided.
struct Light {
    own: Vec<f32>,
    truth: Vec<Option<f64>>,
}

const METRICS: &[Metric] = &[
    Metric {
        name: "self_rms",
        axis: "RMS error of light",
        about: "Light against the renderer's own with 64 directions of 16 samples (self)",
        root: true,
    },
    Metric {
        name: "truth_rms",
        axis: "RMS error of light",
        about: "Light against that of the surface itself, f64",
        root: true,
    },
];

impl Experiment for Ao {
    const NAME: &'static str = "ao";
    const TITLE: &'static str = "Ambient occlusion: directions, steps, bias";
    const METRICS: &'static [Metric] = METRICS;
    const COUNTERS: &'static [&'static str] = &["pixels darkened"];
    const REFERENCE: &'static [&'static str] =
        &["visibility=on", "fill=on", "shape=off", "edl=off", "ao=on,directions=64,steps=16"];
    const AFTER: &'static [&'static str] = &["resolve", "visibility_apply", "fill"];
    const METHOD: &'static str = "Light is 0 to 1. Errors are root mean squares over interior pixels that have a depth. <em>Self</em> is the renderer's own light with 64 directions of 16 samples; the truth is the \
        operator with 32 of 8 on ray-cast depths, in f64. Visibility and filling run before, and are not timed here.";
    type Reference = Light;

    fn configurations(_case: &Case) -> Vec<Configuration> {
        let own = |parameter, value: &str, settings: &str| {
            Configuration::new(
                parameter,
                value,
                &["visibility=on", "fill=on", "shape=off", "edl=off", &format!("ao=on{settings}")],
            )
        };
        let parameter = |name: &'static str, values: &[&str]| {
            values
                .iter()
                .map(|value| own(name, value, &format!(",{name}={value}")))
                .collect::<Vec<_>>()
        };
        let auto = vec![own(AUTO, AUTO, "")];
        let parameters = [
            parameter("directions", &["2", "4", "6", "16", "32", "64"]),
            parameter("steps", &["1", "2", "8", "16"]),
            parameter("bias", &["0", "0.1", "0.4"]),
        ];
        auto.into_iter().chain(parameters.into_iter().flatten()).collect()
    }

    fn reference(case: &Case, drawing: Drawing) -> Light {
        let settings = ao::Settings { directions: 32.0, steps: 8.0, ..ao::Settings::default() };
        let depth: Vec<f32> = case.truth.depth.iter().map(|z| *z as f32).collect();
        let truth = oracle::ao::left(&case.view, &settings, &depth)
            .into_iter()
            .map(|left| left.map(|left| left.value))
            .collect();
        Light { own: drawing.shading, truth }
    }

    fn measure(case: &Case, reference: &Light, drawing: &Drawing) -> (Vec<Part>, Vec<f64>) {
        let counts = |i: &usize| case.truth.interior[*i] && drawing.depth[*i].is_finite();
        let part = |light: &dyn Fn(usize) -> Option<f64>| {
            let errors = (0..drawing.depth.len())
                .filter(counts)
                .filter_map(|i| Some((drawing.shading[i] as f64 - light(i)?).powi(2)));
            errors.fold([0.0; 2], |[sum, count], square| [sum + square, count + 1.0])
        };
        (
            vec![part(&|i| Some(reference.own[i] as f64)), part(&|i| reference.truth[i])],
            vec![drawing.shading.iter().filter(|factor| **factor < 1.0).count() as f64],
        )
    }
}
