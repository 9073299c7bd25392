//! Study `strokes`: the error of unfinished sorting of strokes against the cost of finishing it,
//! and the look and cost of other ways of blending strokes (dos Anjos et al. 2018, sec. 3.3.2 and
//! 4).

use super::configurations::AUTO;
use super::oracle::strokes as oracle;
use super::report::{self, Section, Table};
use super::{Plan, Row, mark_fronts, metrics, sweep};
use crate::cloud::attribute::DisplayAttribute;
use crate::error::{Error, Result};
use crate::graph::{Gpu, Graph};
use crate::index::attributes::strokes;
use crate::passes::Effects;
use crate::passes::strokes::{Order, Settings};
use crate::progress::Progress;
use crate::render::frame;
use crate::render::settings::{FrameConfig, RenderSettings, Style};
use crate::resident::Resident;
use crate::synth::{self, SceneKind};
use crate::view::{Camera, Preset, View};

pub const SUMMARY: &str =
    "passes of the A-buffer, blending, order, Gaussians: against all strokes sorted";

const SCENES: [(&str, SceneKind); 2] = [("torus", SceneKind::Torus), ("street", SceneKind::Street)];

const PARAMETERS: [(&str, &[(&str, &str)]); 5] = [
    (AUTO, &[(AUTO, "strokes=on")]),
    (
        "passes",
        &[
            ("1", "strokes=sort=bubble,passes=1"),
            ("2", "strokes=sort=bubble,passes=2"),
            ("4", "strokes=sort=bubble,passes=4"),
            ("8", "strokes=sort=bubble,passes=8"),
            ("16", "strokes=sort=bubble,passes=16"),
            ("32", "strokes=sort=bubble,passes=32"),
        ],
    ),
    ("blend", &[("opaque", "strokes=blend=opaque"), ("blur", "strokes=blend=blur")]),
    ("order", &[("stroke", "strokes=order=stroke")]),
    (
        "gaussians",
        &[
            ("6", "strokes=gaussians=6"),
            ("7", "strokes=gaussians=7"),
            ("8", "strokes=gaussians=8"),
            ("9", "strokes=gaussians=9"),
        ],
    ),
];

const METRICS: [(&str, &str); 1] =
    [("self_rms", "linear colour, RMS, of all strokes sorted (self)")];

/// Points for the twin, which visits every stroke in every pixel.
const FEW: u64 = 3000;
const SMALL: [u32; 2] = [96, 72];

struct Configuration {
    parameter: &'static str,
    value: &'static str,
    settings: RenderSettings,
}

pub fn run(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    let configurations = PARAMETERS
        .iter()
        .flat_map(|(parameter, values)| values.iter().map(move |value| (*parameter, *value)));
    let configurations = configurations.map(|(parameter, (value, effect))| {
        let mut settings =
            RenderSettings { effects: Effects::of(Style::Strokes), ..RenderSettings::default() };
        for effect in ["edl=off", effect] {
            settings.effects.set_any(effect).map_err(Error::Request)?;
        }
        Ok(Configuration { parameter, value, settings })
    });
    let configurations = configurations.collect::<Result<Vec<_>>>()?;
    let mut rows = Vec::new();
    let mut table = Table {
        title: "All configurations".into(),
        head: ["scene", "parameter", "value", "RMS", "ms", "fragments", "in a pixel at most"]
            .map(String::from)
            .to_vec(),
        rows: Vec::new(),
    };
    let mut crossings = Table {
        title: "Strokes that run through each other".into(),
        head: ["scene", "order", "pairs", "crossed", "%"].map(String::from).to_vec(),
        rows: Vec::new(),
    };
    for (name, scene) in SCENES {
        progress.tick(&format!("study strokes: {name}"), 0, 0)?;
        let cloud = synth::collect(
            name,
            &synth::build(scene, plan.seed, 0.0),
            plan.points,
            plan.seed,
            0.0,
            progress,
        )?;
        let view =
            View::new(Camera::framing(Preset::Fit, &cloud.core_points(), plan.size), plan.size)?;
        let (mut shown, _) = DisplayAttribute::automatic(&cloud);
        shown.further.strokes = true;
        let resident = Resident::fill(gpu, cloud, shown, progress)?;
        let drawings = configurations
            .iter()
            .map(|configuration| draw(gpu, &view, &resident, configuration))
            .collect::<Result<Vec<_>>>()?;
        let times = sweep::interleaved(&configurations, plan.repeat, |configuration| {
            progress.tick(&format!("study strokes: {name}"), 0, 0)?;
            Ok(draw(gpu, &view, &resident, configuration)?.ms)
        })?;
        for ((Configuration { parameter, value, .. }, drawing), times) in
            configurations.iter().zip(&drawings).zip(&times)
        {
            let error = rms(&drawing.picture, &drawings[0].picture);
            rows.extend(super::rows(
                [name, "fit"],
                [parameter, value],
                METRICS.map(|metric| metric.0),
                &[error],
                times,
            ));
            let numbers = [format!("{error:.5}"), format!("{:.2}", metrics::quartiles(times)[1])];
            let counts = [drawing.fragments.to_string(), drawing.deepest.to_string()];
            table.rows.push(
                [name, parameter, value]
                    .map(String::from)
                    .into_iter()
                    .chain(numbers)
                    .chain(counts)
                    .collect(),
            );
        }
        crossings.rows.extend(crossed(name, scene, plan, progress)?);
    }
    mark_fronts(&mut rows);
    let chart = |(metric, axis): (&str, &str)| {
        let label = |row: &Row| {
            if row.auto { AUTO.to_string() } else { format!("{} {}", row.parameter, row.value) }
        };
        report::chart(
            metric,
            ["milliseconds of a whole frame", axis],
            &format!("Strokes: {metric}"),
            &rows,
            &label,
        )
    };
    let charts = METRICS.map(chart).into_iter().collect();
    let method = format!(
        "{} points a scene. The reference is the renderer's own picture with every pixel's fragments sorted (self), which <em>auto</em> is; its difference to the f64 twin is a test. Blending, order and \
         Gaussians make another painting, not a wrong one; its error is the difference. Which strokes run through each other the twin counts, with {FEW} points. n = {} interleaved rounds after one that \
         is not counted.",
        plan.points, plan.repeat
    );
    Ok(Section {
        name: "strokes",
        title: "Strokes: sorting, blending, order, Gaussians".into(),
        method,
        rows,
        charts,
        tables: vec![table, crossings],
    })
}

struct Drawing {
    picture: Vec<[f32; 4]>,
    ms: f64,
    fragments: u64,
    deepest: u32,
}

fn draw(
    gpu: &mut Gpu,
    view: &View,
    resident: &Resident,
    configuration: &Configuration,
) -> Result<Drawing> {
    let mut g = Graph::new(gpu);
    let outcome = frame::record(
        &mut g,
        view,
        resident,
        &FrameConfig::new(&configuration.settings, view, resident),
    )?;
    let picture = g.download(&outcome.picture);
    let facts = outcome.strokes.map(|painted| painted.facts).unwrap_or_default();
    let frame = g.submit_and_wait(&[])?;
    let drawing = Drawing {
        picture: frame.read(&picture).to_vec(),
        ms: frame.ms("") + facts.counting_ms,
        fragments: facts.fragments,
        deepest: facts.deepest,
    };
    Ok(drawing)
}

fn rms(picture: &[[f32; 4]], reference: &[[f32; 4]]) -> f64 {
    let squares = picture
        .iter()
        .zip(reference)
        .map(|(a, b)| (0..3).map(|c| (a[c] as f64 - b[c] as f64).powi(2)).sum::<f64>());
    (squares.sum::<f64>() / (3 * reference.len().max(1)) as f64).sqrt()
}

/// Returns the rows of the table for both orders.
fn crossed(
    name: &str,
    scene: SceneKind,
    plan: &Plan,
    progress: &dyn Progress,
) -> Result<Vec<Vec<String>>> {
    let cloud =
        synth::collect(name, &synth::build(scene, plan.seed, 0.0), FEW, plan.seed, 0.0, progress)?;
    let view = View::new(Camera::framing(Preset::Fit, &cloud.core_points(), SMALL), SMALL)?;
    let part = &cloud.parts[0];
    let found = strokes::strokes(&part.columns, &part.lattice, progress)?;
    let row = |(order, word): (Order, &str)| {
        let [pairs, crossed] =
            oracle::crossings(&view, &Settings { order, ..Settings::default() }, part, &found);
        let share = 100.0 * crossed as f64 / pairs.max(1) as f64;
        vec![
            name.into(),
            word.into(),
            pairs.to_string(),
            crossed.to_string(),
            format!("{share:.2}"),
        ]
    };
    Ok([(Order::Pixel, "pixel"), (Order::Stroke, "stroke")].map(row).to_vec())
}
