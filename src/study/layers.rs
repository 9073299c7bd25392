//! Study `layers`: the difference between peeled transparent surfaces and all surfaces on each ray,
//! exactly sorted, against the cost of peeling.
//!
//! The scene is nested tori of one colour each, half transparent, without shading. Parameters are
//! the number of layers, the layer distance, and the filling, one at a time.

use super::configurations::AUTO;
use super::oracle::transparency::{self as oracle, Over};
use super::report::{self, Section, Table};
use super::{Plan, Row, mark_fronts, metrics, sweep};
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::cloud::colormap::srgb_to_linear;
use crate::error::{Error, Result};
use crate::graph::{Gpu, Graph, Handle};
use crate::passes::FrameContext;
use crate::progress::Progress;
use crate::render::frame;
use crate::render::settings::{FrameConfig, RenderSettings};
use crate::resident::Resident;
use crate::select::opacity::{Opacities, Rule, What};
use crate::synth;
use crate::view::{Camera, Preset, View};
use rayon::prelude::*;

pub const SUMMARY: &str =
    "number of layers, layer distance, filling: transparent surfaces against all surfaces sorted";

/// Colours of classes 1, 2 and 3, sRGB: the tori from the inside out.
const COLORS: [[u8; 3]; 3] = [[250, 40, 30], [40, 220, 60], [30, 60, 240]];
const OPACITY: f64 = 0.5;

/// A value and its settings; a layer distance is a multiple of the automatic one.
type Value = (&'static str, &'static str, f64);

const PARAMETERS: [(&str, &[Value]); 4] = [
    (AUTO, &[(AUTO, "transparency=auto", 0.0)]),
    (
        "layers",
        &[
            ("1", "transparency=layers=1", 0.0),
            ("2", "transparency=layers=2", 0.0),
            ("4", "transparency=layers=4", 0.0),
            ("6", "transparency=layers=6", 0.0),
            ("8", "transparency=layers=8", 0.0),
        ],
    ),
    (
        "distance",
        &[("1/8", "", 0.125), ("1/4", "", 0.25), ("1/2", "", 0.5), ("2", "", 2.0), ("4", "", 4.0)],
    ),
    ("fill", &[("mask", "fill=method=mask", 0.0), ("off", "fill=off", 0.0)]),
];

/// RMS error of linear colours; share of pixels with a different number of layers.
const METRICS: [(&str, &str); 2] =
    [("color_rms", "linear colour, RMS"), ("miscounted", "share of pixels")];

struct Configuration {
    parameter: &'static str,
    value: &'static str,
    settings: RenderSettings,
}

pub fn run(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    let world = synth::build(synth::SceneKind::NestedTori, plan.seed, 0.0);
    let mut cloud = synth::collect("nested tori", &world, plan.points, plan.seed, 0.0, progress)?;
    for part in &mut cloud.parts {
        part.columns.rgb = part
            .columns
            .class
            .as_ref()
            .map(|classes| classes.iter().map(|&class| COLORS[class as usize - 1]).collect());
    }
    let view = View::new(Camera::framing(Preset::Fit, &cloud.core_points(), plan.size), plan.size)?;
    let mut resident = Resident::fill(
        gpu,
        cloud.clone(),
        DisplayAttribute::new(Attribute::Rgb, &cloud),
        progress,
    )?;
    resident.opacities = Opacities(vec![Rule { what: What::All, opacity: OPACITY }]);
    let layer_m = FrameContext::of(&view, &resident, RenderSettings::default().light).layer_m(0.0);
    let configurations = PARAMETERS
        .iter()
        .flat_map(|(parameter, values)| values.iter().map(move |value| (*parameter, *value)));
    let configurations = configurations.map(|(parameter, (value, effect, distance))| {
        let mut settings = RenderSettings::default();
        let distance =
            (distance > 0.0).then(|| format!("transparency=layer={}", distance * layer_m));
        let effects = ["shape=off", "edl=off", effect]
            .into_iter()
            .chain(distance.as_deref())
            .filter(|effect| !effect.is_empty());
        effects
            .into_iter()
            .try_for_each(|effect| settings.effects.set_any(effect))
            .map_err(Error::Request)?;
        Ok(Configuration { parameter, value, settings })
    });
    let configurations = configurations.collect::<Result<Vec<_>>>()?;
    let colors = COLORS.map(|color| color.map(|channel| srgb_to_linear(channel as f64 / 255.0)));
    let [width, height] = plan.size.map(|side| side as usize);
    let truth: Vec<Option<Over>> = (0..width * height)
        .into_par_iter()
        .map(|i| {
            let surfaces = oracle::layers(
                &world,
                &view,
                layer_m,
                [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5],
            )?;
            Some(oracle::over(
                surfaces.iter().map(|surface| (colors[surface.class as usize - 1], OPACITY)),
            ))
        })
        .collect();
    let found = configurations
        .iter()
        .map(|configuration| errors(gpu, &view, &resident, configuration, &truth))
        .collect::<Result<Vec<_>>>()?;
    let times = sweep::interleaved(&configurations, plan.repeat, |configuration| {
        progress.tick("study layers", 0, 0)?;
        let mut g = Graph::new(gpu);
        let outcome = frame::record(
            &mut g,
            &view,
            &resident,
            &FrameConfig::new(&configuration.settings, &view, &resident),
        )?;
        let frame = g.submit_and_wait(&[outcome.picture.resource()])?;
        let ms = frame.ms("");
        Ok(ms)
    })?;
    let mut rows = Vec::new();
    let mut table = Table {
        title: "All configurations".into(),
        head: ["parameter", "value", "colour, RMS", "miscounted, %", "ms"]
            .map(String::from)
            .to_vec(),
        rows: Vec::new(),
    };
    for ((Configuration { parameter, value, .. }, errors), times) in
        configurations.iter().zip(&found).zip(&times)
    {
        let ms = metrics::quartiles(times);
        rows.extend(super::rows(
            ["nested tori", "fit"],
            [parameter, value],
            METRICS.map(|metric| metric.0),
            errors,
            times,
        ));
        let numbers = [
            format!("{:.5}", errors[0]),
            format!("{:.3}", 100.0 * errors[1]),
            format!("{:.2}", ms[1]),
        ];
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
            ["milliseconds of a whole frame", axis],
            &format!("Layers: {metric}"),
            &rows,
            &label,
        )
    };
    let charts = METRICS.map(chart).into_iter().collect();
    let pixels = truth.iter().flatten().count();
    let method = format!(
        "Nested tori of {} points in all, each of one colour and opacity {OPACITY}, unshaded; {pixels} of {} pixels, those two pixels away from contours and where surfaces are twice the automatic \
         layer distance of {layer_m:.4} m apart. Truth is every surface on the ray through the pixel's middle. <em>auto</em> peels up to 16 layers, and the device leaves out what is empty. n = {} \
         interleaved rounds after one that is not counted.",
        cloud.len(),
        width * height,
        plan.repeat
    );
    Ok(Section {
        name: "layers",
        title: "Layers: number, distance, filling".into(),
        method,
        rows,
        charts,
        tables: vec![table],
    })
}

fn errors(
    gpu: &mut Gpu,
    view: &View,
    resident: &Resident,
    configuration: &Configuration,
    truth: &[Option<Over>],
) -> Result<[f64; 2]> {
    let mut g = Graph::new(gpu);
    let outcome = frame::record(
        &mut g,
        view,
        resident,
        &FrameConfig::new(&configuration.settings, view, resident),
    )?;
    let front =
        outcome.gbuffer.accumulation.ok_or(Error::Request("study layers needs points".into()))?;
    let (color, peeled) = (g.download(&front.color), g.download(&front.peeled));
    let frame = g.submit_and_wait(&[])?;
    let (colors, layers): (&[[f32; 4]], &[f32]) = (frame.read(&color), frame.read(&peeled));
    let (mut squares, mut miscounted, mut pixels) = (0.0, 0.0, 0.0f64);
    for ((over, color), &layers) in truth.iter().zip(colors).zip(layers) {
        let Some(over) = over else { continue };
        squares += (0..3).map(|c| (color[c] as f64 - over.color[c]).powi(2)).sum::<f64>() / 3.0;
        miscounted += (layers != over.layers as f32) as u32 as f64;
        pixels += 1.0;
    }
    Ok([(squares / pixels.max(1.0)).sqrt(), miscounted / pixels.max(1.0)])
}
