//! What a legend says: the numbers of a ramp, or the labels that occur, with their colours.
//! Pictures and profiles draw it, each in its own way.

use super::ticks::{multiples, number, round_above};
use crate::cloud::Station;
use crate::cloud::attribute::{Attribute, DisplayAttribute, class_name};
use crate::cloud::colormap;
use crate::cloud::crs::Reference;
use crate::cloud::histograms::Histograms;
use crate::cloud::scalar::Scalar;

/// Rows of a legend of labels at most.
pub const ROWS: usize = 16;

/// A label that occurs.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    pub color: [u8; 3],
    pub name: String,
    /// Number of points with it.
    points: u64,
}

#[derive(Clone, Debug)]
pub enum Legend {
    Ramp {
        heading: String,
        /// Values at the ends.
        ends: [f64; 2],
        shown: DisplayAttribute,
    },
    Labels(Vec<Row>),
}

impl Legend {
    /// Returns the legend of an attribute; None if its colours stand for nothing else.
    pub fn of(
        shown: &DisplayAttribute,
        reference: &Reference,
        counts: &Histograms,
        stations: &[Station],
    ) -> Option<Legend> {
        match shown.ends() {
            Some(ends) if ends[1] > ends[0] => Some(Legend::Ramp {
                heading: heading(shown.attribute, reference),
                ends,
                shown: *shown,
            }),
            _ if shown.attribute.is_label() => {
                Some(Legend::Labels(rows(shown.attribute, counts, stations)))
            }
            _ => None,
        }
    }
}

/// Names the numbers of a ramp, and their unit.
fn heading(attribute: Attribute, reference: &Reference) -> String {
    let unit = reference.height_unit();
    match attribute {
        Attribute::Elevation => format!("elevation [{}]", unit.symbol()),
        Attribute::Time => "GPS time [s]".into(),
        Attribute::Scalar(Scalar::HeightAboveGround) => {
            format!("height above ground [{}]", unit.symbol())
        }
        Attribute::Scalar(scalar) => scalar.title(),
        other => other.name(),
    }
}

fn rows(attribute: Attribute, counts: &Histograms, stations: &[Station]) -> Vec<Row> {
    let row = |code: u8, name: String, points: u64| {
        let color = colormap::code_color(attribute, code);
        Row { color, name, points }
    };
    match attribute {
        Attribute::Class => {
            let name = |class| class_name(class).map_or(format!("class {class}"), str::to_owned);
            counts.classes.iter().map(|&(class, points)| row(class, name(class), points)).collect()
        }
        Attribute::Return => {
            let name = |number: u8| format!("return {number}");
            counts
                .returns
                .iter()
                .map(|&(number, points)| row(number, name(number), points))
                .collect()
        }
        _ => {
            let code = |station: &Station| (station.source.unwrap_or(0) & 255) as u8;
            let own = |station: &Station| row(code(station), station.name.clone(), station.points);
            stations.iter().map(own).collect()
        }
    }
}

/// Returns the most frequent labels, in their own order, and how many are left out.
pub fn most_frequent(rows: &[Row], most: usize) -> (Vec<Row>, usize) {
    let most = most.min(ROWS);
    let mut counts: Vec<u64> = rows.iter().map(|row| row.points).collect();
    counts.sort_unstable_by(|a, b| b.cmp(a));
    let fewest = most.checked_sub(1).and_then(|last| counts.get(last)).copied().unwrap_or(0);
    let frequent = rows.iter().filter(|row| row.points >= fewest);
    let kept: Vec<Row> = frequent.take(most).cloned().collect();
    let left_out = rows.len() - kept.len();
    (kept, left_out)
}

/// Returns round values on a ramp, about as many as asked for: their places from 0 to 1, and
/// labels.
pub fn ticks([lo, hi]: [f64; 2], most: f64) -> Vec<(f64, String)> {
    let step = round_above((hi - lo) / most);
    let tick = |tick: f64| ((tick - lo) / (hi - lo), number(tick, step));
    multiples(step, [lo, hi]).into_iter().map(tick).collect()
}

/// Returns colours of a ramp, from its lower to its upper end.
pub fn colors(shown: &DisplayAttribute, parts: u32) -> impl Iterator<Item = [u8; 3]> {
    let [low, high] = shown.ramp_words();
    let word = move |part: u32| low + (high - low) * f64::from(part) / f64::from(parts - 1);
    (0..parts).map(move |part| colormap::ramp_color(shown, word(part)))
}
