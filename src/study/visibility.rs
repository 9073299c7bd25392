//! Study `visibility`: how well hidden points are told from visible ones, and holes from
//! background, against the cost.
//!
//! Parameters are levels, kernel, threshold and the opening, one at a time; and for a single level,
//! as in the paper, kernel, sectors, and how far in front something must be to hide. A point is
//! visible if it belongs to the first surface of its pixel (`truth`). Pixels without a point are
//! holes if inside of the silhouette.

use super::cases::Case;
use super::chart::{Chart, Mark, Panel};
use super::configurations::{self, AUTO, Configuration, Drawing, Experiment, Metric, Part};
use super::report::Section;
use super::{Plan, Row};
use crate::config::NO_POINT;
use crate::error::Result;
use crate::graph::Gpu;
use crate::progress::Progress;

pub const SUMMARY: &str = "levels, kernel, threshold and openings: hidden points told from visible ones, holes from background";

pub fn run(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    configurations::run::<Visibility>(gpu, plan, progress)
}

struct Visibility;

const METRICS: &[Metric] = &[
    Metric {
        name: "shown_hidden",
        axis: "1 - precision",
        about: "Hidden points that show: of the points taken for visible, the share that is not",
        root: false,
    },
    Metric {
        name: "lost_visible",
        axis: "1 - recall",
        about: "Visible points that are lost: of the visible points, the share that was taken for hidden",
        root: false,
    },
    Metric {
        name: "missed_holes",
        axis: "share of the silhouette",
        about: "Missed holes: pixels without a point inside of the silhouette that were taken for background",
        root: false,
    },
    Metric {
        name: "false_holes",
        axis: "share of the silhouette",
        about: "False holes: pixels more than 1 px outside of the silhouette that were taken for holes",
        root: false,
    },
];

impl Experiment for Visibility {
    const NAME: &'static str = "visibility";
    const TITLE: &'static str = "Visibility: levels, kernel, threshold, openings";
    const METRICS: &'static [Metric] = METRICS;
    const COUNTERS: &'static [&'static str] = &["tiles looked at", "taps", "tiles with holes"];
    const REFERENCE: &'static [&'static str] =
        &["visibility=off", "fill=off", "shape=off", "edl=off"];
    const AFTER: &'static [&'static str] = &["resolve"];
    const METHOD: &'static str = "Every row changes one setting of the default, which is <em>auto</em>. A single level has a kernel of 9 pixels and a threshold of 2.1 sr, except in rows that change it. Filling is off.";
    /// Depth as projected.
    type Reference = Vec<f32>;

    fn configurations(_case: &Case) -> Vec<Configuration> {
        let single = "levels=1,kernel=9,threshold=2.1";
        let own = |parameter: &'static str, value: &str| {
            let setting = match parameter.strip_prefix("single ") {
                _ if parameter == AUTO => "visibility=on".into(),
                Some(parameter) => format!("visibility=on,{single},{parameter}={value}"),
                None => format!("visibility=on,{parameter}={value}"),
            };
            Configuration::new(parameter, value, &["fill=off", "shape=off", "edl=off", &setting])
        };
        let parameters: [(&str, &[&str]); 8] = [
            (AUTO, &[AUTO]),
            ("levels", &["2", "3", "5", "8"]),
            ("kernel", &["3", "5", "9"]),
            ("expected", &["8", "16", "24", "48", "96"]),
            ("threshold", &["0.25", "0.5", "1", "1.5", "2.5", "3", "4", "5"]),
            ("single kernel", &["3", "5", "7", "9", "13", "15"]),
            ("single sectors", &["4", "16"]),
            ("single lead", &["0", "3.5", "14"]),
        ];
        parameters
            .into_iter()
            .flat_map(|(parameter, values)| values.iter().map(move |value| own(parameter, value)))
            .collect()
    }

    fn reference(_case: &Case, drawing: Drawing) -> Vec<f32> {
        drawing.depth
    }

    fn measure(case: &Case, projected: &Vec<f32>, drawing: &Drawing) -> (Vec<Part>, Vec<f64>) {
        let visible: Vec<bool> = drawing.index.iter().map(|point| *point != NO_POINT).collect();
        let errors = case.errors(projected, &drawing.depth, Some(&visible));
        let count = |of: &dyn Fn(usize) -> bool| {
            (0..projected.len()).filter(|&i| projected[i] == f32::INFINITY && of(i)).count() as f64
        };
        let is_hole = |i: usize| drawing.depth[i] == f32::NEG_INFINITY;
        let inside = errors.inside as f64;
        let ([seen, lost], [shown, _]) =
            (errors.visible.map(|count| count as f64), errors.hidden.map(|count| count as f64));
        let parts = vec![
            [shown, seen + shown],
            [lost, seen + lost],
            [count(&|i| case.truth.inside[i] && !is_hole(i)), inside],
            [count(&|i| case.truth.beyond[i] && is_hole(i)), inside],
        ];
        let counts = &drawing.counts;
        (parts, [counts.looked(), counts.taps, counts.holes].map(|count| count as f64).to_vec())
    }

    fn more_charts(rows: &[Row]) -> Vec<Chart> {
        vec![curve(rows)]
    }
}

/// Plots precision over recall, a mark per threshold: a threshold trades one for the other.
fn curve(rows: &[Row]) -> Chart {
    let mut panels: Vec<Panel> = Vec::new();
    let of = |metric: &'static str| {
        rows.iter()
            .filter(move |row| row.metric == metric && (row.auto || row.parameter == "threshold"))
    };
    for (shown, lost) in of("shown_hidden").zip(of("lost_visible")) {
        let title = format!("{}, {}", shown.scene, shown.view);
        if panels.last().is_none_or(|panel| panel.title != title) {
            panels.push(Panel { title, marks: Vec::new() });
        }
        let mark = Mark::new(shown.value.clone(), [lost.error; 3], shown.error, shown.auto);
        panels.last_mut().expect("pushed above").marks.push(mark);
    }
    Chart::new(
        "Threshold: hidden points that show over visible points that are lost, here without time",
        ["1 - recall", "1 - precision"],
        "lost",
        panels,
    )
}
