//! Study `luminance`: remaining steps between stations, lost details, and the cost; compared with
//! the offline reference.
//!
//! A street is scanned from five stations with exposures from a half to twice, adjacent ones
//! different. The same points with equal exposures give the truth in every pixel. Parameters are
//! epsilon, neighbourhood and space, one at a time, and the points per pixel, by the size of the
//! picture.

pub mod problems;

use super::configurations::AUTO;
use super::report::{self, Section, Table};
use super::{Plan, Row, mark_fronts, metrics, sweep};
use crate::cloud::Cloud;
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::cloud::colormap::linear_to_srgb;
use crate::error::{Error, Result};
use crate::graph::{Gpu, Graph, Handle};
use crate::index::attributes::luminance::{NEIGHBOURS, correct};
use crate::passes::{EFFECTS, FrameContext};
use crate::progress::Progress;
use crate::render::frame;
use crate::render::settings::{FrameConfig, RenderSettings};
use crate::resident::Resident;
use crate::synth::{self, Method};
use crate::view::light::Light;
use crate::view::{Camera, Projection, View};
use glam::DVec3;

pub const SUMMARY: &str = "epsilon, neighbourhood, space, points a pixel: steps between stations, details, against the offline reference";

/// Exposures of the stations along the street.
const GAINS: [f64; 5] = [1.0, 0.5, 2.0, 0.7, 1.4];

/// Divisors of the picture's sides.
const SIZES: [u32; 3] = [1, 2, 4];
const LEAST_SIDE: u32 = 16;

/// Settings of `luminance`, with further settings behind. Epsilon is in spacings of the points.
const CONFIGURATIONS: [(&str, &str, &str); 16] = [
    ("none", "uncorrected", "off"),
    ("none", REFERENCE, "off"),
    (AUTO, AUTO, "auto exposure=auto"),
    ("exposure", "with averages", "on exposure=on"),
    ("averages", "alone", "on"),
    ("epsilon", "0.5", "on"),
    ("epsilon", "1", "on"),
    ("epsilon", "2", "on"),
    ("epsilon", "4", "on"),
    ("epsilon", "8", "on"),
    ("epsilon", "32", "on"),
    ("neighbourhood", "1", "on,neighbourhood=1"),
    ("neighbourhood", "3", "on,neighbourhood=3"),
    ("space", "rgb", "on,space=rgb"),
    ("space", "rgb 1", "on,space=rgb,neighbourhood=1"),
    ("epsilon", "1000", "on"),
];
const REFERENCE: &str = "reference";

const METRICS: [(&str, &str, &str); 3] = [
    (
        "step",
        "binary orders of magnitude",
        "Step: how much the exposure differs between neighbouring pixels of different stations, mean",
    ),
    (
        "detail_lost",
        "share",
        "Detail lost: of what the truth shows within 3 x 3 pixels, the part that the picture does not",
    ),
    ("rms", "codes of 255", "Difference to the truth, root mean square of V"),
];

/// Largest distance of neighbours on one surface, in spacings of the points.
const LAYER: f64 = 4.0;

struct Sight {
    view: View,
    /// V of every pixel with equal exposures, 0 to 255, and the station of its front point.
    truth: Vec<f64>,
    station: Vec<[u32; 4]>,
    depth: Vec<f32>,
    /// Layer distance `[m]`.
    layer_m: f64,
}

pub fn run(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    let mut world = synth::build(synth::SceneKind::Street, plan.seed, 0.0);
    let viewpoint = world.camera();
    let camera = Camera {
        eye: viewpoint.eye,
        target: viewpoint.target,
        up: DVec3::Z,
        fov_y: viewpoint.fov_y,
        projection: Projection::Perspective,
        ortho_height: None,
    };
    let mut scan = |gains: [f64; 5]| {
        if let Method::Stations(stations) = &mut world.method {
            stations
                .iter_mut()
                .zip(gains)
                .for_each(|(station, gain)| station.gain = DVec3::splat(gain));
        }
        synth::collect(
            "street",
            &world,
            plan.points,
            plan.seed,
            synth::SceneKind::Street.default_noise(),
            progress,
        )
    };
    let (even, uneven) = (scan([1.0; 5])?, scan(GAINS)?);
    let mut reference = uneven.clone();
    let began = std::time::Instant::now();
    correct(&mut reference, NEIGHBOURS, progress)?;
    let reference_s = began.elapsed().as_secs_f64();
    let fill = |gpu: &mut Gpu, cloud: &Cloud, shown| {
        Resident::fill(gpu, cloud.clone(), DisplayAttribute::new(shown, cloud), progress)
    };
    let (truth, stations) =
        (fill(gpu, &even, Attribute::Rgb)?, fill(gpu, &even, Attribute::Source)?);
    let (uneven, reference) =
        (fill(gpu, &uneven, Attribute::Rgb)?, fill(gpu, &reference, Attribute::Rgb)?);
    let mut rows = Vec::new();
    let mut table = Table {
        title: "All configurations".into(),
        head: [
            "points a pixel",
            "parameter",
            "value",
            "step, stops",
            "detail lost, %",
            "rms, codes",
            "PSNR, dB",
            "ms",
        ]
        .map(String::from)
        .to_vec(),
        rows: Vec::new(),
    };
    for part in SIZES {
        let size = plan.size.map(|side| (side / part).max(LEAST_SIDE));
        let view = View::new(camera, size)?;
        let off = render_settings("off")?;
        let plain = draw(gpu, &view, &truth, &off)?;
        let scene = FrameContext::of(&view, &truth, Light::default());
        let (layer_m, density) = (LAYER * scene.sampling.spacing_m, scene.sampling.density);
        let sight = Sight {
            view,
            truth: values(&plain.color),
            station: draw(gpu, &view, &stations, &off)?
                .color
                .iter()
                .map(|c| c.map(f32::to_bits))
                .collect(),
            depth: plain.depth,
            layer_m,
        };
        let configurations = CONFIGURATIONS
            .iter()
            .map(|&(parameter, value, luminance)| {
                let epsilon = value
                    .parse::<f64>()
                    .ok()
                    .filter(|_| parameter == "epsilon")
                    .map_or(String::new(), |spacings| {
                        format!(",epsilon={}", spacings * scene.sampling.spacing_m)
                    });
                Ok((parameter, value, render_settings(&format!("{luminance}{epsilon}"))?))
            })
            .collect::<Result<Vec<_>>>()?;
        let of = |value: &str| if value == REFERENCE { &reference } else { &uneven };
        let mut errors = Vec::new();
        for (_, value, settings) in &configurations {
            errors.push(sight.errors(&values(&draw(gpu, &view, of(value), settings)?.color)));
        }
        let times = sweep::interleaved(&configurations, plan.repeat, |(_, value, settings)| {
            progress.tick("study luminance", 0, 0)?;
            Ok(draw(gpu, &view, of(value), settings)?.ms)
        })?;
        let view_name = ["full size", "half", "quarter"]
            [SIZES.iter().position(|own| *own == part).expect("one of them")];
        for (((parameter, value, _), errors), times) in
            configurations.iter().zip(&errors).zip(&times)
        {
            let ms = metrics::quartiles(times);
            rows.extend(super::rows(
                ["street", view_name],
                [parameter, value],
                METRICS.map(|metric| metric.0),
                errors,
                times,
            ));
            let psnr = 20.0 * (255.0 / errors[2]).log10();
            let numbers = [errors[0], 100.0 * errors[1], errors[2], psnr, ms[1]]
                .map(|number| format!("{number:.3}"));
            table.rows.push(
                [format!("{density:.1}"), parameter.to_string(), value.to_string()]
                    .into_iter()
                    .chain(numbers)
                    .collect(),
            );
        }
    }
    mark_fronts(&mut rows);
    let label = |row: &Row| {
        if row.auto {
            AUTO.to_string()
        } else if row.parameter == "none" {
            row.value.clone()
        } else {
            format!("{} {}", row.parameter, row.value)
        }
    };
    let charts = METRICS
        .map(|(metric, axis, about)| {
            report::chart(
                metric,
                ["milliseconds of the sums and the correction", axis],
                about,
                &rows,
                &label,
            )
        })
        .into_iter()
        .collect();
    let method = format!(
        "A street of {} points, scanned by five stations with exposures of {GAINS:?}; every point one pixel. Truth: the same points, all exposures 1. Exposure in a pixel is V over that of the truth; \
         <em>step</em> is its ratio between neighbouring pixels of one surface whose front points are of different stations, as the mean of |log2|. Details are what V differs from the mean of the 3 x 3, \
         divided by the exposure there; what is lost of them is 1 - &lt;picture, truth&gt; / &lt;truth, truth&gt;. Epsilon is in spacings of the points. The reference is V averaged over {NEIGHBOURS} \
         neighbours, offline, in {reference_s:.1} s. n = {} interleaved rounds after one that is not counted.",
        plan.points, plan.repeat
    );
    Ok(Section {
        name: "luminance",
        title: "Luminance correction: steps and details".into(),
        method,
        rows,
        charts,
        tables: vec![table, problems::table(gpu, plan, progress)?],
    })
}

/// Returns settings with no other effect.
fn render_settings(luminance: &str) -> Result<RenderSettings> {
    let mut settings = RenderSettings::default();
    let off = EFFECTS.iter().map(|effect| format!("{effect}=off"));
    off.chain(format!("luminance={luminance}").split(' ').map(String::from))
        .try_for_each(|text| settings.effects.set_any(&text))
        .map_err(Error::Request)?;
    Ok(settings)
}

struct Drawn {
    color: Vec<[f32; 4]>,
    depth: Vec<f32>,
    /// Time of the luminance passes `[ms]`.
    ms: f64,
}

fn draw(
    gpu: &mut Gpu,
    view: &View,
    resident: &Resident,
    settings: &RenderSettings,
) -> Result<Drawn> {
    let config = FrameConfig::new(settings, view, resident);
    let mut g = Graph::new(gpu);
    let layers = frame::record(&mut g, view, resident, &config)?.gbuffer;
    let [color, depth] = [&layers.color, &layers.depth].map(|image| g.download(image));
    let frame = g.submit_and_wait(&[layers.color.resource()])?;
    let drawn = Drawn {
        color: frame.read(&color).to_vec(),
        depth: frame.read(&depth).to_vec(),
        ms: frame.ms("luminance"),
    };
    Ok(drawn)
}

/// Returns V of stored values, 0 to 255.
fn values(color: &[[f32; 4]]) -> Vec<f64> {
    color.iter().map(|[r, g, b, _]| 255.0 * linear_to_srgb(r.max(*g).max(*b) as f64)).collect()
}

impl Sight {
    fn columns(&self) -> usize {
        self.view.size[0] as usize
    }

    /// Tests whether two pixels are on one surface with known, non-black luminance.
    fn same(&self, i: usize, k: usize) -> bool {
        let known = |i: usize| self.depth[i].is_finite() && self.truth[i] >= 8.0;
        known(i) && known(k) && ((self.depth[i] - self.depth[k]) as f64).abs() <= self.layer_m
    }

    /// Returns the error of every metric.
    fn errors(&self, values: &[f64]) -> [f64; 3] {
        let (columns, rows) = (self.columns(), self.truth.len() / self.columns());
        let exposure = |i: usize| (values[i].max(1.0) / self.truth[i]).log2();
        let (mut steps, mut borders) = (0.0, 0.0f64);
        let (mut kept, mut all) = (0.0, 0.0f64);
        for i in (0..rows - 1).flat_map(|y| (0..columns - 1).map(move |x| y * columns + x)) {
            for k in [i + 1, i + columns] {
                if self.same(i, k) && self.station[i] != self.station[k] {
                    steps += (exposure(i) - exposure(k)).abs();
                    borders += 1.0;
                }
            }
        }
        for i in (1..rows - 1).flat_map(|y| (1..columns - 1).map(move |x| y * columns + x)) {
            let around: Vec<usize> = [
                i - columns - 1,
                i - columns,
                i - columns + 1,
                i - 1,
                i,
                i + 1,
                i + columns - 1,
                i + columns,
                i + columns + 1,
            ]
            .into_iter()
            .filter(|&k| self.same(i, k))
            .collect();
            if around.len() < 9 {
                continue;
            }
            let mean = |values: &[f64]| around.iter().map(|&k| values[k]).sum::<f64>() / 9.0;
            let (own, true_mean) = (mean(values).max(1.0), mean(&self.truth));
            let detail = self.truth[i] - true_mean;
            kept += detail * (values[i] - own) * true_mean / own;
            all += detail * detail;
        }
        let covered = |i: &usize| self.depth[*i].is_finite();
        let squares =
            metrics::errors((0..values.len()).filter(covered).map(|i| values[i] - self.truth[i]));
        // Noise added to details does not count.
        [steps / borders.max(1.0), (1.0 - kept / all.max(1.0)).max(0.0), squares.rms]
    }
}
