//! Study `strokes`: how far a painting is from one whose fragments are all in order, by passes of the A-buffer's bubble sort and by ways of blending; and by how many Gaussians a brush has, against what it costs.
//!
//! What paintings are compared with is a painting, by the exact sort and with nine Gaussians: this says what settings change, not whether strokes are where they should be, which tests do against an f64 painter.

use super::configurations::AUTO;
use super::report::{Figure, Section, Table};
use super::{Plan, Row, mark_fronts, metrics, sweep};
use crate::cloud::attribute::{Attribute, Shown};
use crate::error::{Error, Result};
use crate::frame;
use crate::graph::{Gpu, Graph};
use crate::look::{self, Style, Wishes};
use crate::passes::Effects;
use crate::progress::Progress;
use crate::resident::Resident;
use crate::synth::{self, Scene};
use crate::view::{Camera, Preset, View};

pub const SUMMARY: &str = "passes of the A-buffer, ways of blending, number of Gaussians: paintings against the exact sort";

/// A value, and what is asked for.
type Value = (&'static str, &'static str);

const KNOBS: [(&str, &[Value]); 4] = [
    (AUTO, &[(AUTO, "strokes=on")]),
    (
        "passes",
        &[
            ("1", "strokes=on,sort=bubble,passes=1"),
            ("2", "strokes=on,sort=bubble,passes=2"),
            ("4", "strokes=on,sort=bubble,passes=4"),
            ("8", "strokes=on,sort=bubble,passes=8"),
            ("16", "strokes=on,sort=bubble,passes=16"),
            ("32", "strokes=on,sort=bubble,passes=32"),
            ("all", "strokes=on,sort=bubble"),
        ],
    ),
    ("blend", &[("opaque", "strokes=on,blend=opaque"), ("blur", "strokes=on,blend=blur")]),
    ("gaussians", &[("6", "strokes=on,gaussians=6"), ("7", "strokes=on,gaussians=7"), ("8", "strokes=on,gaussians=8")]),
];

const METRICS: [(&str, &str); 2] = [("color_rms", "linear colour, RMS"), ("uncovered", "share of the pixels that auto covers")];

const SCENES: [(&str, Scene); 2] = [("torus", Scene::Torus), ("street", Scene::Street)];

struct Painting {
    picture: Vec<[f32; 4]>,
    ms: f64,
    fragments: u64,
    deepest: u32,
}

pub fn run(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    let configurations: Vec<(&str, Value)> = KNOBS.iter().flat_map(|(knob, values)| values.iter().map(move |value| (*knob, *value))).collect();
    let mut rows = Vec::new();
    let head = ["scene", "knob", "value", "colour, RMS", "uncovered, %", "ms"];
    let mut table = Table { title: "All configurations".into(), head: head.map(String::from).to_vec(), rows: Vec::new() };
    let mut facts = Vec::new();
    for (name, scene) in SCENES {
        let world = synth::build(scene, plan.seed, 0.0);
        let cloud = synth::collect(name, &world, plan.points, plan.seed, scene.default_noise(), progress)?;
        let view = View::new(Camera::framing(Preset::Fit, &cloud.core_points(), plan.size), plan.size)?;
        let mut shown = Shown::new(Attribute::Rgb, &cloud);
        shown.further.strokes = true;
        let resident = Resident::fill(gpu, cloud, shown, progress)?;
        let reference = paint(gpu, &view, &resident, "strokes=on")?;
        facts.push(format!("{name}: {} fragments, {} in a pixel at most", reference.fragments, reference.deepest));
        let mut errors = vec![[0.0; 2]; configurations.len()];
        for ((_, (_, effect)), errors) in configurations.iter().zip(&mut errors) {
            *errors = compare(&reference.picture, &paint(gpu, &view, &resident, effect)?.picture);
        }
        let times = sweep::interleaved(&configurations, plan.repeat, |(_, (_, effect))| {
            progress.tick("study strokes", 0, 0)?;
            Ok(paint(gpu, &view, &resident, effect)?.ms)
        })?;
        resident.free(gpu);
        for (((knob, (value, _)), errors), times) in configurations.iter().zip(&errors).zip(&times) {
            rows.extend(super::rows([name, "fit"], [knob, value], METRICS.map(|metric| metric.0), errors, times));
            let numbers = [format!("{:.5}", errors[0]), format!("{:.3}", 100.0 * errors[1]), format!("{:.1}", metrics::quartiles(times)[1])];
            table.rows.push([name, knob, value].map(String::from).into_iter().chain(numbers).collect());
        }
    }
    mark_fronts(&mut rows);
    let figure = |(metric, axis): (&str, &str)| {
        let label = |row: &Row| if row.auto { AUTO.to_string() } else { format!("{} {}", row.knob, row.value) };
        Figure::of("strokes", metric, ["milliseconds of all passes (bars: quartiles)", axis], &format!("Strokes: {metric}"), &rows, &label)
    };
    let figures = METRICS.map(figure).into_iter().collect();
    let how = format!(
        "{} points a scene ({}). The reference is what <em>auto</em> paints: dabs of nine Gaussians, blended in order by the exact sort. Times are of all passes, those that only count included; n = {} \
         interleaved rounds after one that is not counted.",
        plan.points,
        facts.join("; "),
        plan.repeat
    );
    Ok(Section { name: "strokes", title: "Strokes: order, blending, brush".into(), how, rows, figures, tables: vec![table] })
}

fn paint(gpu: &mut Gpu, view: &View, resident: &Resident, effect: &str) -> Result<Painting> {
    let mut wishes = Wishes { effects: Effects::of(Style::Strokes), background: [0; 3], ..Wishes::default() };
    [effect, "edl=off"].iter().try_for_each(|effect| wishes.effects.set(effect)).map_err(Error::Request)?;
    let look = look::decide(&wishes, view, resident);
    let mut g = Graph::new(gpu);
    let outcome = frame::record(&mut g, view, resident, &look)?;
    let picture = g.download(&outcome.picture);
    let frame = g.submit(&[])?;
    let facts = outcome.strokes.unwrap_or_default();
    let ms = frame.ms("") + facts.counting_ms;
    let picture = frame.read(&picture).to_vec();
    frame.shelve(gpu);
    Ok(Painting { picture, ms, fragments: facts.fragments, deepest: facts.deepest })
}

/// Covered by half or more.
fn covered(pixel: &[f32; 4]) -> bool {
    pixel[3] >= 0.5
}

/// Root of the mean square over the pixels that either covers; the share of those of the reference that are not covered.
fn compare(reference: &[[f32; 4]], picture: &[[f32; 4]]) -> [f64; 2] {
    let both = || reference.iter().zip(picture);
    let off = both().filter(|(a, b)| covered(a) || covered(b)).flat_map(|(a, b)| (0..3).map(|c| (a[c] - b[c]) as f64));
    let lost = both().filter(|(a, b)| covered(a) && !covered(b)).count();
    let there = reference.iter().filter(|pixel| covered(pixel)).count();
    [metrics::errors(off).rms, lost as f64 / there.max(1) as f64]
}
