//! Comparison with an older report: which points of the front moved.
//!
//! Errors and times of a setting are in parts of the older ones, as the quotient of sums over the
//! scenes and views that both reports have. Its 95 % interval is by bootstrap: scenes and views are
//! drawn again, with replacement, and then their times, by the standard error that quartiles tell
//! of a median (McGill et al. 1978). What moved has an interval without 1, and by 2 % or more.

use super::report::{Section, Table};
use super::{Row, chart, metrics};
use crate::error::{Error, Result};
use crate::synth::noise::Random;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Least change that counts.
const LEAST: f64 = 0.02;
const SAMPLES: u64 = 1000;

/// Names of a row: scene, view, parameter, value, metric.
type Key = [String; 5];

/// What a report has of one row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kept {
    pub error: f64,
    /// Lower quartile, median, upper quartile `[ms]`.
    pub ms: [f64; 3],
    pub n: usize,
    pub front: bool,
}

/// Returns the table of a study in the folder of a report.
pub fn path(report: &Path, study: &str) -> PathBuf {
    report.join(format!("{study}.csv"))
}

/// Reads the table of a study.
pub fn read(path: &Path) -> Result<BTreeMap<Key, Kept>> {
    let text = std::fs::read_to_string(path).map_err(|error| Error::io("read", path, error))?;
    let mut lines = text.lines();
    if lines.next() != Some(super::report::COLUMNS) {
        return Err(Error::format(path, "this is no table of a study"));
    }
    let line = |(number, line): (usize, &str)| {
        parse(line)
            .ok_or_else(|| Error::format(path, format!("line {} is no row of a study", number + 2)))
    };
    lines.enumerate().map(line).collect()
}

fn parse(line: &str) -> Option<(Key, Kept)> {
    // Commas within quotes part nothing; every second piece is within them.
    let mut fields = vec![String::new()];
    for (piece, text) in line.split('"').enumerate() {
        if piece % 2 == 1 {
            fields.last_mut()?.push_str(text);
            continue;
        }
        let mut parts = text.split(',');
        fields.last_mut()?.push_str(parts.next()?);
        fields.extend(parts.map(String::from));
    }
    let [_, scene, view, parameter, value, metric, error, median, q1, q3, n, _, front, _] =
        <[String; 14]>::try_from(fields).ok()?;
    let number = |text: String| text.parse::<f64>().ok();
    let ms = [number(q1)?, number(median)?, number(q3)?];
    let kept = Kept { error: number(error)?, ms, n: n.parse().ok()?, front: front == "true" };
    Some(([scene, view, parameter, value, metric], kept))
}

/// What became of a setting under a metric.
#[derive(Clone, Debug)]
pub struct Change {
    pub metric: &'static str,
    pub setting: String,
    /// New errors and times in parts of the older ones: ends of the interval, with the quotient
    /// between.
    pub error: [f64; 3],
    pub ms: [f64; 3],
    /// In how many scenes and views it was on the front, is, and could be.
    pub fronts: [usize; 3],
}

impl Change {
    /// Returns what moved; empty if nothing did.
    pub fn words(&self) -> String {
        let moved = |[low, ratio, high]: [f64; 3], words: [&'static str; 2]| match ratio {
            _ if high < 1.0 && ratio <= 1.0 - LEAST => Some(words[0]),
            _ if low > 1.0 && ratio >= 1.0 + LEAST => Some(words[1]),
            _ => None,
        };
        let fronts = match self.fronts {
            [0, now, _] if now > 0 => Some("joined the front"),
            [before, 0, _] if before > 0 => Some("left the front"),
            _ => None,
        };
        let all = [
            moved(self.error, ["more accurate", "less accurate"]),
            moved(self.ms, ["faster", "slower"]),
            fronts,
        ];
        all.into_iter().flatten().collect::<Vec<_>>().join(", ")
    }
}

/// Returns what became of all settings that are on a front, or were.
pub fn compare(rows: &[Row], old: &BTreeMap<Key, Kept>, seed: u64) -> Vec<Change> {
    let mut pairs: Vec<(&'static str, String, Vec<[Kept; 2]>)> = Vec::new();
    for row in rows {
        let key = [row.scene, row.view, row.parameter, &row.value, row.metric].map(String::from);
        let Some(before) = old.get(&key) else { continue };
        let now = Kept { error: row.error, ms: row.ms, n: row.n, front: row.front };
        let setting = match row.auto {
            true => "auto".to_string(),
            false => format!("{} {}", row.parameter, row.value),
        };
        let place = pairs.iter().position(|pair| pair.0 == row.metric && pair.1 == setting);
        let place = place.unwrap_or_else(|| {
            pairs.push((row.metric, setting, Vec::new()));
            pairs.len() - 1
        });
        pairs[place].2.push([*before, now]);
    }
    let change = |(number, (metric, setting, pairs)): (usize, _)| {
        let pairs: Vec<[Kept; 2]> = pairs;
        let on = |k: usize| pairs.iter().filter(|pair| pair[k].front).count();
        let fronts = [on(0), on(1), pairs.len()];
        let mut random = Random::new(seed, 2, number as u64);
        let [error, ms] = ratios(&pairs, &mut random);
        Change { metric, setting, error, ms, fronts }
    };
    let changes = pairs.into_iter().enumerate().map(change);
    changes.filter(|change| change.fronts[..2] != [0, 0]).collect()
}

/// Returns the quotients of errors and of times, with their intervals.
fn ratios(pairs: &[[Kept; 2]], random: &mut Random) -> [[f64; 3]; 2] {
    let sums = |chosen: &[[f64; 4]]| {
        let sum = |k: usize| chosen.iter().map(|values| values[k]).sum::<f64>();
        [chart::ratio(sum(1), sum(0)), chart::ratio(sum(3), sum(2))]
    };
    let values = |[before, now]: &[Kept; 2]| [before.error, now.error, before.ms[1], now.ms[1]];
    let middle = sums(&pairs.iter().map(values).collect::<Vec<_>>());
    let mut drawn: [Vec<f64>; 2] = Default::default();
    for _ in 0..SAMPLES {
        let mut one = || {
            let place = (random.unit() * pairs.len() as f64) as usize;
            let pair = &pairs[place];
            let mut time = |kept: &Kept| {
                let deviation = 1.25 * (kept.ms[2] - kept.ms[0]) / (1.35 * (kept.n as f64).sqrt());
                (kept.ms[1] + random.normal() * deviation).max(0.0)
            };
            [pair[0].error, pair[1].error, time(&pair[0]), time(&pair[1])]
        };
        let chosen: Vec<[f64; 4]> = (0..pairs.len()).map(|_| one()).collect();
        drawn.iter_mut().zip(sums(&chosen)).for_each(|(drawn, ratio)| drawn.push(ratio));
    }
    std::array::from_fn(|k| {
        let [low, high] = metrics::quantiles(&drawn[k], [0.025, 0.975]);
        [low, middle[k], high]
    })
}

/// Returns a table of the changes of a section, those that moved first, and a line for each of
/// those.
pub fn table(section: &Section, old: &Path, seed: u64) -> Result<(Table, Vec<String>)> {
    let kept = read(&path(old, section.name))?;
    let mut changes = compare(&section.rows, &kept, seed);
    changes.sort_by_key(|change| change.words().is_empty());
    let ratio = |[low, ratio, high]: [f64; 3]| {
        let [low, ratio, high] = [low, ratio, high].map(chart::number);
        format!("{ratio} ({low} to {high})")
    };
    let row = |change: &Change| {
        let [before, now, of] = change.fronts;
        vec![
            change.metric.into(),
            change.setting.clone(),
            change.words(),
            ratio(change.error),
            ratio(change.ms),
            format!("{before} of {of}"),
            format!("{now} of {of}"),
        ]
    };
    let head = ["metric", "setting", "moved", "error", "time", "on the front then", "now"];
    let moved = changes.iter().filter(|change| !change.words().is_empty());
    let line = |change: &Change| {
        format!(
            "{} {}, {}: {}; {} of the error, {} of the time",
            section.name,
            change.metric,
            change.setting,
            change.words(),
            ratio(change.error),
            ratio(change.ms)
        )
    };
    let table = Table {
        title: format!("since {}, in parts of what it was (95 % intervals)", old.display()),
        head: head.map(String::from).to_vec(),
        rows: changes.iter().map(row).collect(),
    };
    Ok((table, moved.map(line).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept(error: f64, ms: f64, spread: f64) -> Kept {
        Kept { error, ms: [ms * (1.0 - spread), ms, ms * (1.0 + spread)], n: 9, front: true }
    }

    fn change(pairs: &[[Kept; 2]]) -> Change {
        let [error, ms] = ratios(pairs, &mut Random::new(1, 2, 3));
        Change { metric: "m", setting: "s".into(), error, ms, fronts: [1, 1, 1] }
    }

    #[test]
    fn lines_are_read_back_with_their_quotes() {
        let line = "s,street,far,knob,\"levels=1,kernel=9\",m,2.5e-1,3,2,5,7,false,true,\"a, b\"";
        let (key, kept) = parse(line).unwrap();
        assert_eq!(key, ["street", "far", "knob", "levels=1,kernel=9", "m"]);
        assert_eq!(kept, Kept { error: 0.25, ms: [2.0, 3.0, 5.0], n: 7, front: true });
        assert_eq!(parse("a,b"), None);
    }

    #[test]
    fn what_is_within_noise_has_not_moved() {
        let own = [kept(1.0, 10.0, 0.1), kept(1.0, 10.3, 0.1)];
        assert_eq!(change(&[own; 4]).words(), "");
        // Sure, but too little.
        let own = [kept(1.0, 10.0, 1e-4), kept(1.0, 10.1, 1e-4)];
        assert_eq!(change(&[own; 4]).words(), "");
    }

    #[test]
    fn what_is_faster_and_less_accurate_is_told() {
        let own = [kept(1.0, 10.0, 0.05), kept(1.5, 5.0, 0.05)];
        let change = change(&[own; 4]);
        assert_eq!(change.words(), "less accurate, faster");
        let [low, ratio, high] = change.ms;
        assert!(low < ratio && ratio < high && (ratio - 0.5).abs() < 1e-12, "{:?}", change.ms);
        assert_eq!(change.error, [1.5; 3]);
    }

    #[test]
    fn scenes_that_disagree_widen_the_interval() {
        let pairs = [
            [kept(1.0, 1.0, 0.0), kept(3.0, 1.0, 0.0)],
            [kept(1.0, 1.0, 0.0), kept(0.5, 1.0, 0.0)],
        ];
        let [low, ratio, high] = change(&pairs).error;
        assert_eq!([low, ratio, high], [0.5, 1.75, 3.0]);
    }
}
