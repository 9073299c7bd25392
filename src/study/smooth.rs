//! Study `smooth`: the effect of smoothing filters on the depths of a filled surface, against their
//! cost.
//!
//! Filling by masks leaves patches of one depth, which need smoothing; filling by medians and means
//! is smoothed, too, for comparison. A rougher surface makes shading from its slopes worse; but a
//! filter that blurs details, or mixes surfaces at edges, is farther from the truth than the
//! filling.

use super::Plan;
use super::cases::Case;
use super::configurations::{self, AUTO, Configuration, Drawing, Experiment, Metric, Part};
use super::report::Section;
use crate::error::Result;
use crate::graph::Gpu;
use crate::progress::Progress;

pub const SUMMARY: &str =
    "filters: depths and roughness of smoothed surfaces, against the surface itself";

pub fn run(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    configurations::run::<Smooth>(gpu, plan, progress)
}

struct Smooth;

/// Largest relative depth error. Larger ones are on another surface and count as this, since a few
/// such pixels would hide all others.
const MOST: f64 = 0.005;

const METRICS: &[Metric] = &[
    Metric {
        name: "depth_rms",
        axis: "RMS error, parts of the depth",
        about: "Depth of interior pixels against that of the surface in their middle, errors of 0.5 % at most",
        root: true,
    },
    Metric {
        name: "roughness_rms",
        axis: "RMS, parts of the depth",
        about: "Roughness: how far a pixel's error is from the mean error of the four beside it, 0.5 % at most",
        root: true,
    },
];

impl Experiment for Smooth {
    const NAME: &'static str = "smooth";
    const TITLE: &'static str = "Smoothing: filters";
    const METRICS: &'static [Metric] = METRICS;
    const COUNTERS: &'static [&'static str] = &["pixels with a depth"];
    const REFERENCE: &'static [&'static str] = &[
        "visibility=off",
        "fill=on,method=mask",
        "smooth=off",
        "antialias=off",
        "shape=off",
        "edl=off",
    ];
    const AFTER: &'static [&'static str] = &["resolve", "visibility_apply", "fill"];
    const METHOD: &'static str = "Surfaces are filled by masks, in rows named <em>median</em> by medians and means. <em>auto</em> is the default after filling by masks: the \
        alleviated Gaussian, once, where points are about a pixel apart, and the box as often as it takes where they are more, of pixels that were filled and those beside them. Filters run as often \
        as points lie apart, too. In rows named <em>all</em> or <em>median</em> the other pixels are smoothed, too. Filling runs before, and is not timed here.";
    type Reference = ();

    fn configurations(_case: &Case) -> Vec<Configuration> {
        let after = |visibility: &'static str, fill: &'static str| {
            move |parameter, value: String, smooth: &str| {
                Configuration::new(
                    parameter,
                    value,
                    &[visibility, fill, smooth, "antialias=off", "shape=off", "edl=off"],
                )
            }
        };
        let (masks, medians) =
            (after("visibility=off", "fill=on,method=mask"), after("visibility=on", "fill=on"));
        let filters = ["none", "alleviated", "gaussian", "box"].map(|filter| match filter {
            "none" => (filter, "smooth=off".to_string()),
            _ => (filter, format!("smooth=on,filter={filter}")),
        });
        let all = |smooth: &str| {
            if smooth == "smooth=off" { smooth.to_string() } else { format!("{smooth},pixels=all") }
        };
        let measured_too = filters[1..]
            .iter()
            .map(|(filter, smooth)| masks("pixels", format!("all, {filter}"), &all(smooth)));
        let filter =
            filters.iter().map(|(filter, smooth)| masks("filter", filter.to_string(), smooth));
        let iterations = ["2", "4", "8"].map(|often| {
            masks("iterations", often.to_string(), &format!("smooth=on,iterations={often}"))
        });
        let others = filters
            .iter()
            .map(|(filter, smooth)| medians("median", format!("median, {filter}"), &all(smooth)));
        [masks(AUTO, AUTO.to_string(), "smooth=auto")]
            .into_iter()
            .chain(filter)
            .chain(measured_too)
            .chain(iterations)
            .chain(others)
            .collect()
    }

    fn reference(_case: &Case, _drawing: Drawing) {}

    fn measure(case: &Case, _known: &(), drawing: &Drawing) -> (Vec<Part>, Vec<f64>) {
        let width = case.view.size[0] as usize;
        let error = |i: usize| {
            let counts = case.truth.interior.get(i).is_some_and(|interior| *interior)
                && drawing.depth[i].is_finite();
            counts.then(|| drawing.depth[i] as f64 / case.truth.depth[i] - 1.0)
        };
        let square = |error: f64| error.clamp(-MOST, MOST).powi(2);
        let roughness = |i: usize| {
            let beside: Vec<f64> = [i.wrapping_sub(1), i + 1, i.wrapping_sub(width), i + width]
                .into_iter()
                .filter_map(error)
                .collect();
            let mean = beside.iter().sum::<f64>() / 4.0;
            error(i).filter(|_| beside.len() == 4).map(|own| own - mean)
        };
        let mean = |errors: &dyn Fn(usize) -> Option<f64>| {
            let squares = (0..drawing.depth.len()).filter_map(errors).map(square);
            squares.fold([0.0; 2], |[sum, count], square| [sum + square, count + 1.0])
        };
        let parts = vec![mean(&error), mean(&roughness)];
        (parts, vec![drawing.depth.iter().filter(|z| z.is_finite()).count() as f64])
    }
}
