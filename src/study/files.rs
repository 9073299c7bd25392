//! Study `files`: what each value of each knob costs and loses on files of yours.
//!
//! The truth of a file is not known, so the reference is the finest picture of the same view (kind
//! *self*): errors are what a setting loses, not what is wrong with the points. Each file is drawn
//! from three views: as a whole, from half as far, and from another side.

use super::chart::Chart;
use super::configurations::AUTO;
use super::report::{self, Section};
use super::tuner::{Subject, Tuner, views};
use super::{Plan, Row, mark_fronts, rows};
use crate::cloud::filter::Filter;
use crate::cloud::{ColumnSet, ReadOptions};
use crate::error::Result;
use crate::graph::Gpu;
use crate::progress::Progress;
use crate::render::settings::RenderSettings;
use crate::render::source::{OpenOptions, Source};
use crate::select::lod::LodOptions;
use crate::tune::KNOBS;
use crate::view::{Camera, Covered, Preset};
use std::path::Path;

pub const SUMMARY: &str =
    "every knob on files of yours (--file), against the finest picture of the same view";

const METRICS: [(&str, &str); 2] = [
    ("self_px", "error against the finest picture (self), px"),
    ("self_depth", "error of depth against the finest picture (self)"),
];
/// Names of the views of a file.
const VIEWS: [&str; 3] = ["whole", "nearer", "another side"];
/// Largest side of a picture `[px]`: a study draws thousands.
const MOST_SIDE: u32 = 512;
const MOST_ROUNDS: usize = 5;

pub fn run(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    let size = plan.size.map(|side| side.min(MOST_SIDE));
    let rounds = plan.repeat.min(MOST_ROUNDS);
    let mut all: Vec<Row> = Vec::new();
    let names: Vec<&'static str> = plan.files.iter().map(|path| name(path)).collect();
    for (path, &name) in plan.files.iter().zip(&names) {
        let index = Some("study files draws what an index chooses");
        let options = OpenOptions {
            read: ReadOptions::new(ColumnSet::ALL, false),
            filter: Filter::default(),
            index,
            indexes_octrees: false,
            strokes: false,
            place: None,
            shadows: None,
            fault: None,
        };
        let source = Source::open(std::slice::from_ref(path), &options, progress)?;
        let points = source.framed_points(&Default::default());
        let none = Covered::default();
        let camera = Camera::framing_beside(Preset::Fit, &points, size, none, source.up().axis());
        let views = views(camera, source.up().axis(), size)?;
        let (shown, _) = source.shown(None)?;
        let cloud = source.upload(gpu, shown, u64::MAX, progress)?;
        let subject = Subject { name: name.into(), cloud, views };
        let settings = RenderSettings::default();
        let mut tuner = Tuner::new(gpu, vec![subject], settings, LodOptions::default(), progress)?;
        let singles = tuner.singles(progress)?;
        tuner.measure(&singles, rounds, progress)?;
        for (view, view_name) in VIEWS.into_iter().enumerate() {
            for tuning in &singles {
                let own = &tuner.get(tuning).expect("measured").views[view];
                let usual = tuner.usual_ms(view);
                let times: Vec<f64> =
                    own.parts.iter().map(|parts| parts.iter().sum::<f64>() * usual).collect();
                let words = tuning.words();
                let own_words = match words.as_slice() {
                    [] => [AUTO, AUTO],
                    [word] => knob(word),
                    _ => ["finest", "finest"],
                };
                let errors = [own.errors.px, own.errors.depth];
                let metrics = METRICS.map(|metric| metric.0);
                all.extend(rows([name, view_name], own_words, metrics, &errors, &times));
            }
        }
    }
    mark_fronts(&mut all);
    let label = |row: &Row| row.value.clone();
    let of = |title: &str, (metric, axis): (&str, &str), rows: &[Row]| -> Chart {
        report::chart(metric, ["milliseconds a picture", axis], title, rows, &label)
    };
    let mut charts = METRICS.map(|metric| of("Every value of every knob", metric, &all)).to_vec();
    for knob in &KNOBS {
        let own = |row: &&Row| row.parameter == knob.name;
        // Files where it can change a picture.
        let acts: Vec<&str> = all.iter().filter(own).map(|row| row.scene).collect();
        let shown = |row: &&Row| own(row) || row.auto && acts.contains(&row.scene);
        let shown: Vec<Row> = all.iter().filter(shown).cloned().collect();
        if !shown.is_empty() {
            charts.push(of(&format!("Knob {}", knob.name), METRICS[0], &shown));
        }
    }
    let method = format!(
        "{} at {} x {} pixels, each as a whole, from half as far and from another side; n = {rounds} rounds in turn, in parts of the default's time, which is drawn with them. The reference is the \
         finest picture of the same view (kind <em>self</em>): errors are what a setting loses, never what is wrong with the points. Knobs that change no picture are left out.",
        names.join(", "),
        size[0],
        size[1],
    );
    let title = "Files: every knob, against the finest picture (self)".into();
    Ok(Section { name: "files", title, method, rows: all, charts, tables: Vec::new() })
}

/// Returns the name of a file. Rows name scenes that stay, and a study is run once a program.
fn name(path: &Path) -> &'static str {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned().leak()
}

/// Returns the knob that a value belongs to, and the value.
fn knob(word: &str) -> [&'static str; 2] {
    let all = KNOBS.iter().flat_map(|knob| knob.values.iter().map(|value| [knob.name, value]));
    all.into_iter().find(|[_, value]| *value == word).expect("a value of a knob")
}
