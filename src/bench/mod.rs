//! Timings of passes at fixed views and sizes, as rows of a table, JSON and a saved baseline.

pub mod flight;
pub mod index;
pub mod layers;
pub mod luminance;
pub mod project;
pub mod splat;
pub mod strokes;
pub mod surface;
pub mod window;

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::path::Path;

/// The time of a configuration. Milliseconds are device timestamps, or wall-clock time if `way` is
/// `cpu`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    pub way: String,
    pub points: u64,
    pub order: String,
    pub size: String,
    pub ms_median: f64,
    pub ms_q1: f64,
    pub ms_q3: f64,
    pub mpts_per_s: f64,
    pub device: String,
    pub driver: String,
}

impl Row {
    fn is_of(&self, other: &Row) -> bool {
        let name = |row: &Row| (row.way.clone(), row.points, row.order.clone(), row.size.clone());
        name(self) == name(other)
    }
}

/// Returns lower quartile, median and upper quartile: the values nearest to those ranks.
pub fn quartiles(times: &mut [f64]) -> [f64; 3] {
    times.sort_by(f64::total_cmp);
    [0.25, 0.5, 0.75].map(|share| times[((times.len() - 1) as f64 * share).round() as usize])
}

/// Formats the rows as a table, with the speedup against a baseline.
pub fn table(rows: &[Row], baseline: &[Row]) -> String {
    let mut text = format!(
        "{:<12} {:>10}  {:<8} {:>10} {:>10} {:>10} {:>10} {:>10}{}\n",
        "way",
        "points",
        "order",
        "size",
        "ms",
        "q1",
        "q3",
        "M points/s",
        if baseline.is_empty() { "" } else { "  against baseline" }
    );
    for row in rows {
        write!(
            text,
            "{:<12} {:>10}  {:<8} {:>10} {:>10.2} {:>10.2} {:>10.2} {:>10.1}",
            row.way,
            row.points,
            row.order,
            row.size,
            row.ms_median,
            row.ms_q1,
            row.ms_q3,
            row.mpts_per_s
        )
        .expect("writing to a string");
        if let Some(before) = baseline.iter().find(|before| before.is_of(row)) {
            write!(text, "  {:.2} x", before.ms_median / row.ms_median)
                .expect("writing to a string");
        }
        text.push('\n');
    }
    if let Some(row) = rows.first() {
        writeln!(text, "device: {} ({})", row.device, row.driver).expect("writing to a string");
    }
    text
}

pub fn read_baseline(path: &Path) -> Result<Vec<Row>> {
    let text = std::fs::read_to_string(path).map_err(|error| Error::io("read", path, error))?;
    let wrong = |error| Error::format(path, format!("is not output of `bench --json`: {error}"));
    let rows: Vec<serde_json::Value> = serde_json::from_str(&text).map_err(wrong)?;
    // Flights are not compared.
    let rows = rows.into_iter().filter(|row| row.get("bench").is_none());
    rows.map(|row| serde_json::from_value(row).map_err(wrong)).collect()
}
