//! Study `shadows`: the error of light visibility at points, against the cost of casting shadows.
//!
//! The scene is a plate above a floor (`step`) with a round light straight above: a floor point
//! sees a disc cut by a line, whose area is known. Points of the plate see all of it. Parameters
//! are the size of the shadow map, the number of samples, stratified and random, and the method,
//! one at a time.

use super::configurations::AUTO;
use super::report::{self, Section, Table};
use super::{Plan, Row, mark_fronts, metrics, sweep, white};
use crate::config::POINTS_PER_PAGE;
use crate::error::{Error, Result};
use crate::graph::{Gpu, Graph, Handle};
use crate::passes::shadows::{self, Facts};
use crate::passes::{Effects, FrameContext};
use crate::progress::Progress;
use crate::resident::Resident;
use crate::synth;
use crate::view::light::Light;
use crate::view::{Camera, Preset, View};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI};

pub const SUMMARY: &str = "size of the light's picture, samples, method: light visibility against the light that truly reaches points";

/// Height of the plate above the floor `[m]`; half the light's angle `[degrees]`: half shadows are
/// 21 cm wide.
const HEIGHT: f64 = 1.0;
const RADIUS: f64 = 6.0;
const MOST_POINTS: u64 = 400_000;

const PARAMETERS: [(&str, &[(&str, &str)]); 5] = [
    (AUTO, &[(AUTO, "samples=16")]),
    (
        "size",
        &[
            ("128", "samples=16,size=128"),
            ("256", "samples=16,size=256"),
            ("1024", "samples=16,size=1024"),
        ],
    ),
    ("samples", &[("1", "samples=1"), ("4", "samples=4"), ("64", "samples=64")]),
    (
        "pattern",
        &[
            ("random 4", "samples=4,pattern=random"),
            ("random 16", "samples=16,pattern=random"),
            ("random 64", "samples=64,pattern=random"),
        ],
    ),
    ("method", &[("index 4", "samples=4,method=index")]),
];

/// RMS error of light visibility; share of points more than half a sample of 16 off.
const METRICS: [(&str, &str); 2] = [("rms", "share of the light"), ("off", "share of points")];

struct Configuration {
    parameter: &'static str,
    value: &'static str,
    effects: Effects,
}

pub fn run(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    let configurations = PARAMETERS
        .iter()
        .flat_map(|(parameter, values)| values.iter().map(move |value| (*parameter, *value)));
    let configurations = configurations.map(|(parameter, (value, settings))| {
        let mut effects = Effects::default();
        effects
            .set_any(&format!("shadows=on,radius={RADIUS},{settings}"))
            .map_err(Error::Request)?;
        Ok(Configuration { parameter, value, effects })
    });
    let configurations = configurations.collect::<Result<Vec<_>>>()?;
    let mut world = synth::build(synth::SceneKind::Step, plan.seed, HEIGHT);
    world.offset = DVec3::ZERO;
    let cloud =
        synth::collect("step", &world, plan.points.min(MOST_POINTS), plan.seed, 0.0, progress)?;
    let view = View::new(Camera::framing(Preset::Fit, &cloud.core_points(), [64, 64]), [64, 64])?;
    let resident = white(gpu, &cloud, progress)?;
    let mut found: Vec<([f64; 2], Facts)> = Vec::new();
    for configuration in &configurations {
        found.push(error(gpu, &view, &resident, configuration)?);
    }
    // Each differs from the one before, so that none finds cached shadows.
    let times = sweep::interleaved(&configurations, plan.repeat, |configuration| {
        progress.tick("study shadows", 0, 0)?;
        let mut g = Graph::new(gpu);
        let visibility = cast(&mut g, &view, &resident, configuration)?;
        let frame = g.submit_and_wait(&[visibility.counts.resource()])?;
        let ms = frame.ms("");
        Ok(ms)
    })?;
    let mut rows = Vec::new();
    let mut table = Table {
        title: "All configurations".into(),
        head: [
            "parameter",
            "value",
            "rms, %",
            "off, %",
            "texel, mm",
            "shadow begins behind a surface, mm",
            "ms",
        ]
        .map(String::from)
        .to_vec(),
        rows: Vec::new(),
    };
    for ((configuration, (errors, facts)), times) in configurations.iter().zip(&found).zip(&times) {
        let Configuration { parameter, value, .. } = configuration;
        let ms = metrics::quartiles(times);
        rows.extend(super::rows(
            ["step", "plate over floor"],
            [parameter, value],
            METRICS.map(|metric| metric.0),
            errors,
            times,
        ));
        let numbers =
            [100.0 * errors[0], 100.0 * errors[1], 1e3 * facts.texel_m, 1e3 * facts.layer_m, ms[1]]
                .map(|number| format!("{number:.3}"));
        table
            .rows
            .push([parameter.to_string(), value.to_string()].into_iter().chain(numbers).collect());
    }
    mark_fronts(&mut rows);
    let chart = |(metric, axis): (&str, &str)| {
        let label = |row: &Row| {
            if row.auto { AUTO.to_string() } else { format!("{} {}", row.parameter, row.value) }
        };
        report::chart(
            metric,
            ["milliseconds of all light passes", axis],
            &format!("Light visibility: {metric}"),
            &rows,
            &label,
        )
    };
    let charts = METRICS.map(chart).into_iter().collect();
    let method = format!(
        "A plate {HEIGHT} m above a floor, {} points in all, under a round light of {} degrees. Truth is the area of the light's disc that the plate's edge leaves, in closed form. \
         <em>rms</em> is over floor points within the half shadow, <em>off</em> the share of all points whose visibility is more than 1/16 off. <em>auto</em> has 16 stratified samples and a picture that \
         suits the points' spacing. n = {} interleaved rounds after one that is not counted.",
        cloud.len(),
        2.0 * RADIUS,
        plan.repeat
    );
    Ok(Section {
        name: "shadows",
        title: "Shadows: picture, samples, method".into(),
        method,
        rows,
        charts,
        tables: vec![table],
    })
}

fn cast(
    g: &mut Graph,
    view: &View,
    resident: &Resident,
    configuration: &Configuration,
) -> Result<shadows::LightVisibility> {
    let scene = FrameContext::of(view, resident, Light::Direction(DVec3::NEG_Z));
    let effects = &configuration.effects;
    let visibility =
        shadows::light_visibility(g, &scene, resident, effects, &effects.decide(&scene), None)?;
    visibility.ok_or(Error::Request("study shadows needs points".into()))
}

fn error(
    gpu: &mut Gpu,
    view: &View,
    resident: &Resident,
    configuration: &Configuration,
) -> Result<([f64; 2], Facts)> {
    let mut g = Graph::new(gpu);
    let shadows::LightVisibility { counts, facts, .. } =
        cast(&mut g, view, resident, configuration)?;
    let counts = g.download_buffer(&counts);
    let frame = g.submit_and_wait(&[])?;
    let visibility: &[u8] = frame.read(&counts);
    let ids = resident
        .nodes
        .iter()
        .flat_map(|node| (0..node.count).map(|i| (node.number * POINTS_PER_PAGE + i) as usize));
    let (mut squares, mut half_shadows, mut off, mut all) = (0.0, 0.0f64, 0.0, 0.0f64);
    for (p, id) in resident.positions(gpu)?.into_iter().zip(ids) {
        // At the ends of the edge it is not a line.
        if p.x.abs() > 1.5 || p.y.abs() > 1.5 {
            continue;
        }
        let truth = if p.z > HEIGHT / 2.0 {
            1.0
        } else {
            left_of(-p.x / (HEIGHT * RADIUS.to_radians().tan()))
        };
        let error =
            (visibility[id].min(facts.samples as u8) as f64 / facts.samples as f64 - truth).abs();
        if truth > 0.0 && truth < 1.0 {
            squares += error * error;
            half_shadows += 1.0;
        }
        off += (error > 1.0 / 16.0) as u32 as f64;
        all += 1.0;
    }
    Ok(([(squares / half_shadows.max(1.0)).sqrt(), off / all.max(1.0)], facts))
}

/// Returns the share of the unit disc's area left of x.
fn left_of(x: f64) -> f64 {
    let x = x.clamp(-1.0, 1.0);
    (FRAC_PI_2 + x * (1.0 - x * x).sqrt() + x.asin()) / PI
}
