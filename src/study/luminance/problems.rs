//! The three test regions of averaging (Kanzok et al. 2012, sec. 5), each as a scene with two
//! stations on one wall, and the result of each method.
//!
//! ```text
//!     scattering   both stations everywhere, one of them with half the light      specks
//!     border       one station on the left, the other on the right, both between  lines at the
//!                                                                                 overlap's ends
//!     shadowing    both everywhere, and a shadow in the light of one              its outline, and a
//!                                                                                 dark patch
//! ```

use super::{REFERENCE, draw, render_settings, values};
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::cloud::colormap::linear_to_srgb;
use crate::cloud::{Cloud, Station};
use crate::error::Result;
use crate::graph::Gpu;
use crate::index::attributes::luminance::{NEIGHBOURS, correct};
use crate::progress::Progress;
use crate::resident::Resident;
use crate::study::Plan;
use crate::study::report::Table;
use crate::synth;
use crate::view::{Camera, Preset, View};
use glam::DVec2;

/// Exposure of the second station, and its light in the shadow.
const GAIN: f64 = 0.5;
const SHADOW: f64 = 0.35;
/// Range of the wall's width that both stations see, and the shadow's radius.
const OVERLAP: std::ops::Range<f64> = 0.4..0.6;
const RADIUS: f64 = 0.25;

/// A function of the place on the wall (0 to 1 both ways) and an alternating flag to station and
/// light.
type Light = fn(DVec2, bool) -> (u16, f64);

const REGIONS: [(&str, Light); 3] = [
    ("scattering", |_, second| (second as u16, if second { GAIN } else { 1.0 })),
    ("border", |at, second| {
        let second = if OVERLAP.contains(&at.x) { second } else { at.x >= OVERLAP.end };
        (second as u16, if second { GAIN } else { 1.0 })
    }),
    ("shadowing", |at, second| (second as u16, if second && is_shaded(at) { SHADOW } else { 1.0 })),
];

fn is_shaded(at: DVec2) -> bool {
    at.distance(DVec2::splat(0.5)) < RADIUS
}

/// Returns the albedo of soft stripes: details to lose, and no edges to mistake for borders.
fn albedo(at: DVec2) -> f64 {
    0.35 + 0.15 * (12.0 * at.x).sin() * (9.0 * at.y).cos()
}

pub fn table(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Table> {
    let head = ["region", "way", "specks, stops", "sharpest, stops", "uneven, stops"]
        .map(String::from)
        .to_vec();
    let wall = synth::collect(
        "wall",
        &synth::build(synth::SceneKind::Plane, plan.seed, 0.0),
        plan.points,
        plan.seed,
        0.0,
        progress,
    )?;
    let view = View::new(Camera::framing(Preset::Top, &wall.core_points(), plan.size), plan.size)?;
    let mut rows = Vec::new();
    let truth = lit(&wall, |_, second| (second as u16, 1.0));
    let picture = |gpu: &mut Gpu, cloud: Cloud, luminance: &str| {
        let shown = DisplayAttribute::new(Attribute::Rgb, &cloud);
        let resident = Resident::fill(gpu, cloud, shown, progress)?;
        let drawn = draw(gpu, &view, &resident, &render_settings(luminance)?)?;
        Ok((values(&drawn.color), drawn.depth))
    };
    let (truth, depth) = picture(gpu, truth, "off")?;
    for (region, light) in REGIONS {
        progress.tick(&format!("study luminance: {region}"), 0, 0)?;
        let cloud = lit(&wall, light);
        let mut reference = cloud.clone();
        correct(&mut reference, NEIGHBOURS, progress)?;
        let ways = [
            ("uncorrected", cloud.clone(), "off"),
            (REFERENCE, reference, "off"),
            ("exposure=on", cloud.clone(), "off exposure=on"),
            ("luminance=on", cloud.clone(), "on"),
            ("both", cloud, "on exposure=on"),
        ];
        for (way, cloud, luminance) in ways {
            let (values, _) = picture(gpu, cloud, luminance)?;
            let exposure: Vec<Option<f64>> = (0..values.len())
                .map(|i| {
                    (depth[i].is_finite() && truth[i] >= 8.0)
                        .then(|| (values[i].max(1.0) / truth[i]).log2())
                })
                .collect();
            let numbers =
                judged(&exposure, plan.size[0] as usize).map(|number| format!("{number:.4}"));
            rows.push([region, way].map(String::from).into_iter().chain(numbers).collect());
        }
    }
    Ok(Table {
        title: format!("The three problem regions: two stations, {NEIGHBOURS} neighbours offline"),
        head,
        rows,
    })
}

/// Returns the wall as two stations see it, every other point from the second.
fn lit(wall: &Cloud, light: Light) -> Cloud {
    let mut cloud = wall.clone();
    let part = &mut cloud.parts[0];
    let (lo, hi) = part.bounds().expect("a wall has points");
    let columns = &mut part.columns;
    let found: Vec<(u16, u8)> = (0..columns.len())
        .map(|i| {
            let at = part.lattice.world([columns.x[i], columns.y[i], columns.z[i]].map(i64::from));
            let at = ((at - lo) / (hi - lo)).truncate();
            // Points adjacent in the file or the world must not alternate regularly.
            let second = (i as u32).wrapping_mul(0x9E37_79B1) >> 31 == 1;
            let (station, share) = light(at, second);
            (station + 1, (255.0 * linear_to_srgb(albedo(at) * share)).round() as u8)
        })
        .collect();
    columns.rgb = Some(found.iter().map(|&(_, value)| [value; 3]).collect());
    columns.source = Some(found.iter().map(|&(station, _)| station).collect());
    let station = |source| Station {
        part: 0,
        source: Some(source),
        name: format!("wall source {source}"),
        points: found.iter().filter(|(own, _)| *own == source).count() as u64,
    };
    cloud.stations = [1, 2].map(station).to_vec();
    cloud
}

/// Returns mean and 99th percentile of exposure differences between neighbouring pixels, and the
/// standard deviation of exposure over the picture.
fn judged(exposure: &[Option<f64>], columns: usize) -> [f64; 3] {
    let differ = |i: usize, k: usize| Some(((*exposure.get(k)?)? - exposure[i]?).abs());
    let pairs = (0..exposure.len())
        .flat_map(|i| [(i % columns + 1 < columns).then_some((i, i + 1)), Some((i, i + columns))]);
    let mut steps: Vec<f64> = pairs.flatten().filter_map(|(i, k)| differ(i, k)).collect();
    steps.sort_by(f64::total_cmp);
    let mean = |numbers: &[f64]| numbers.iter().sum::<f64>() / numbers.len().max(1) as f64;
    let sharpest = steps.get(steps.len() * 99 / 100).copied().unwrap_or(0.0);
    let known: Vec<f64> = exposure.iter().flatten().copied().collect();
    let level = mean(&known);
    let spread = (known.iter().map(|own| (own - level).powi(2)).sum::<f64>()
        / known.len().max(1) as f64)
        .sqrt();
    [mean(&steps), sharpest, spread]
}
