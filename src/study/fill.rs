//! Study `fill`: the error of filled depths against their cost, and against baselines.
//!
//! Parameters are levels and tolerance, one at a time, iterations of the median method and the
//! neighbours from which background is filled; and the method: fixed-size splats of the points, and
//! pull-push with and without visibility. Baselines get sizes that suit them: splats are drawn with
//! several radii.

use super::cases::Case;
use super::configurations::{self, AUTO, Configuration, Drawing, Experiment, Metric, Part};
use super::report::Section;
use super::{Plan, metrics};
use crate::config::NO_POINT;
use crate::error::Result;
use crate::graph::Gpu;
use crate::progress::Progress;

pub const SUMMARY: &str =
    "levels, tolerance, and methods: depths of filled pixels against the surface itself";

pub fn run(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    configurations::run::<Fill>(gpu, plan, progress)
}

struct Fill;

const METRICS: &[Metric] = &[
    Metric {
        name: "layer_share",
        axis: "share of pixels",
        about: "Layers: interior pixels outside of the true depths of their 3x3, by more than 0.05 % of the depth",
        root: false,
    },
    Metric {
        name: "depth_share",
        axis: "share of pixels",
        about: "Depth: interior pixels farther than 0.5 % of the depth from the surface in them",
        root: false,
    },
    Metric {
        name: "holes",
        axis: "share of pixels",
        about: "Holes: pixels of the silhouette without a depth",
        root: false,
    },
    Metric {
        name: "spilled",
        axis: "share of pixels",
        about: "Spilled: pixels with a depth more than 1 px outside of the silhouette",
        root: false,
    },
];

impl Experiment for Fill {
    const NAME: &'static str = "fill";
    const TITLE: &'static str = "Filling: levels, tolerance, methods";
    const METRICS: &'static [Metric] = METRICS;
    const COUNTERS: &'static [&'static str] = &["tiles with holes", "pixels filled"];
    const REFERENCE: &'static [&'static str] =
        &["visibility=off", "fill=off", "shape=off", "edl=off"];
    const AFTER: &'static [&'static str] = &["resolve"];
    const METHOD: &'static str = "Every row changes one setting of the default, which is <em>auto</em>. <em>Splats</em> are discs of that many pixels' radius around \
        points as they are; <em>mask</em> fills them by masks; <em>median</em> fills step by step; <em>pullpush</em> without visibility fills every empty pixel, the background too; <em>points</em> are the input of all methods. \
        Milliseconds are those of visibility and filling together, since splats need none. Tolerance is in widths of a pixel at the scene's depth.";
    type Reference = ();

    fn configurations(case: &Case) -> Vec<Configuration> {
        let own = |parameter, value: &str, fill: &str| {
            Configuration::new(parameter, value, &["visibility=on", "shape=off", "edl=off", fill])
        };
        let bare = |value: &str, fill: &str| {
            Configuration::new("method", value, &["visibility=off", "shape=off", "edl=off", fill])
        };
        let hits: Vec<f64> =
            case.truth.depth.iter().copied().filter(|depth| depth.is_finite()).collect();
        let pixel_m = case.truth.pixel_m(metrics::quartiles(&hits)[1]);
        let tolerance = |px: f64| {
            own("tolerance", &format!("{px} px"), &format!("fill=on,tolerance={}", px * pixel_m))
        };
        let masks = [
            "visibility=off",
            "fill=on,method=mask",
            "smooth=off",
            "antialias=off",
            "shape=off",
            "edl=off",
        ];
        [
            own(AUTO, AUTO, "fill=on"),
            bare("points", "fill=off"),
            Configuration::new("method", "mask", &masks),
        ]
        .into_iter()
        .chain(["1", "2", "3", "4", "6", "9"].map(|radius| {
            bare(&format!("splat {radius} px"), &format!("fill=on,method=splat,radius={radius}"))
        }))
        .chain([
            own("method", "median", "fill=on,method=median"),
            own("method", "pullpush", "fill=on,method=pullpush"),
            bare("pullpush, no visibility", "fill=on,method=pullpush"),
        ])
        .chain(["2", "4", "8", "16", "32"].map(|steps| {
            own("iterations", steps, &format!("fill=on,method=median,iterations={steps}"))
        }))
        .chain(["3", "5", "8"].map(|levels| {
            own("levels", levels, &format!("fill=on,method=pullpush,levels={levels}"))
        }))
        .chain([2.0, 4.0, 8.0, 16.0, 64.0, 128.0].map(tolerance))
        .chain(["3", "4", "6", "7", "9"].map(|around| {
            own("surrounded", around, &format!("fill=on,method=median,surrounded={around}"))
        }))
        .collect()
    }

    fn reference(_case: &Case, _drawing: Drawing) {}

    fn measure(case: &Case, _known: &(), drawing: &Drawing) -> (Vec<Part>, Vec<f64>) {
        let errors = case.errors(&drawing.depth, &drawing.depth, None);
        let part = |part: u64, whole: u64| [part as f64, whole as f64];
        let parts = vec![
            part(errors.wrong_layer, errors.interior),
            part(errors.misplaced, errors.interior),
            part(errors.holes, errors.inside),
            part(errors.spilled, errors.inside),
        ];
        let filled = drawing
            .depth
            .iter()
            .zip(&drawing.index)
            .filter(|(depth, index)| depth.is_finite() && **index == NO_POINT)
            .count();
        (parts, vec![drawing.counts.holes as f64, filled as f64])
    }
}
