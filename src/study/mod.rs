//! Studies: accuracy against time for every parameter.
//!
//! ```text
//!     registry of studies -> scenes with known truth (`synth`) -> `sweep` (interleaved runs)
//!                         -> `metrics` -> `report` (CSV, and one HTML page of `chart`s)
//! ```
//!
//! The reference of errors is never the renderer itself, except where a metric says so: `oracle`
//! has f64 twins.

pub mod ao;
pub mod cases;
pub mod chart;
pub mod compare;
pub mod configurations;
pub mod files;
pub mod fill;
pub mod flip;
pub mod index;
pub mod layers;
pub mod lod;
pub mod luminance;
pub mod mesh;
pub mod meshes;
pub mod metrics;
pub mod normals;
pub mod oracle;
pub mod popping;
pub mod precision;
pub mod report;
pub mod scan;
pub mod shadows;
pub mod shape;
pub mod smooth;
pub mod strokes;
pub mod surface;
pub mod sweep;
pub mod tangents;
pub mod truth;
pub mod tune;
pub mod tuner;
pub mod visibility;
pub mod yardstick;
pub mod zoom;

use crate::cloud::Cloud;
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::error::{Error, Result};
use crate::graph::Gpu;
use crate::progress::Progress;
use crate::resident::Resident;
use report::Section;
use std::path::PathBuf;

/// Size and repetitions of studies.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Points per scene.
    pub points: u64,
    pub seed: u64,
    /// Timed rounds.
    pub repeat: usize,
    /// Size of the pictures `[px]`.
    pub size: [u32; 2],
    /// Names of `cases` for studies of surfaces; each study's own if empty.
    pub scenes: Vec<String>,
    /// Files for the study `files`.
    pub files: Vec<PathBuf>,
}

/// One configuration under one metric: a line of the CSV.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    pub scene: &'static str,
    pub view: &'static str,
    pub parameter: &'static str,
    pub value: String,
    pub metric: &'static str,
    pub error: f64,
    /// Lower quartile, median, upper quartile `[ms]`.
    pub ms: [f64; 3],
    pub n: usize,
    /// True if it is the renderer's default.
    pub auto: bool,
    /// True if nothing else in its scene, view and metric beats it.
    pub front: bool,
}

/// Registry with one line per study: the name on the command line and the call.
macro_rules! studies {
    ($($name:ident),* $(,)?) => {
        /// Names of all studies and their questions.
        pub const STUDIES: &[(&str, &str)] = &[$((stringify!($name), $name::SUMMARY)),*];

        fn section(name: &str, gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
            match name {
                $(stringify!($name) => $name::run(gpu, plan, progress),)*
                _ => {
                    let names: Vec<&str> = STUDIES.iter().map(|(name, _)| *name).collect();
                    Err(Error::Request(format!("there is no study {name:?}; there are: {}", names.join(", "))))
                }
            }
        }
    };
}

studies! {
    precision, // bits of position
    index,     // what an index keeps
    lod,       // projected error of the cut
    surface,   // depth, layers, holes, contours
    meshes,    // the same for vertices of meshes
    visibility, // what is hidden, and what is a hole
    zoom,      // change from frame to frame
    fill,      // depths of holes
    smooth,    // filters
    shape,     // light without normals
    ao,        // light in corners
    luminance, // steps between stations, details
    shadows,   // which points the light reaches
    normals,   // planes through neighbours
    tangents,  // how evenly strokes flow
    strokes,   // strokes over each other
    layers,    // surfaces behind each other
    files,     // every knob on files of yours
    tune,      // times and errors that were asked for, on other scenes
}

/// Runs the named studies, or all.
pub fn run(
    names: &[String],
    gpu: &mut Gpu,
    plan: &Plan,
    progress: &dyn Progress,
) -> Result<Vec<Section>> {
    // Without files there is nothing to draw.
    let can_run = |name: &&str| *name != "files" || !plan.files.is_empty();
    let all = STUDIES.iter().map(|(name, _)| *name).filter(can_run);
    let all: Vec<String> = all.map(String::from).collect();
    let names = if names.is_empty() { &all } else { names };
    // Said before anything is measured.
    if names.iter().any(|name| name == "files") == plan.files.is_empty() {
        return Err(Error::Request(
            "the study files draws your files: name it, and them with --file".into(),
        ));
    }
    names.iter().map(|name| section(name, gpu, plan, progress)).collect()
}

/// Uploads a cloud whose points are white.
fn white(gpu: &mut Gpu, cloud: &Cloud, progress: &dyn Progress) -> Result<Resident> {
    let shown = DisplayAttribute::new(Attribute::White, cloud);
    Resident::fill(gpu, cloud.clone(), shown, progress)
}

/// Returns the rows of a configuration, one per metric.
fn rows(
    [scene, view]: [&'static str; 2],
    [parameter, value]: [&'static str; 2],
    metrics: impl IntoIterator<Item = &'static str>,
    errors: &[f64],
    times: &[f64],
) -> Vec<Row> {
    let (ms, n, auto) = (metrics::quartiles(times), times.len(), parameter == configurations::AUTO);
    let row = |(metric, &error)| Row {
        scene,
        view,
        parameter,
        value: value.to_string(),
        metric,
        error,
        ms,
        n,
        auto,
        front: false,
    };
    metrics.into_iter().zip(errors).map(row).collect()
}

/// Marks the rows that no other of their scene, view and metric beats.
pub fn mark_fronts(rows: &mut [Row]) {
    let group = |row: &Row| (row.scene, row.view, row.metric);
    for i in 0..rows.len() {
        let alike: Vec<usize> =
            (0..rows.len()).filter(|&k| group(&rows[k]) == group(&rows[i])).collect();
        let front = metrics::front(
            &alike.iter().map(|&k| (rows[k].error, rows[k].ms[1])).collect::<Vec<_>>(),
        );
        alike.into_iter().zip(front).for_each(|(k, front)| rows[k].front = front);
    }
}
