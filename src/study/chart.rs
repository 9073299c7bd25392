//! Charts of a report: error over cost, as data. `page/page.js` draws them.
//!
//! A chart has one panel for all scenes together and one for each of them. A setting on the front
//! is one that no other beats in both. One sentence, made from the numbers, says how the automatic
//! setting stands.

use super::metrics;
use serde::Serialize;

/// Panels of pooled cases begin with this; they do not count again where all panels are pooled.
pub const ALL: &str = "all scenes";

/// Ratios nearer to 1 are not told apart.
const TOLD_APART: f64 = 0.02;

/// A setting.
#[derive(Clone, Debug, Serialize)]
pub struct Mark {
    /// Name of the setting, one of its kind in a panel.
    pub label: String,
    /// Lower quartile, median, upper quartile of the cost.
    pub x: [f64; 3],
    /// Error.
    pub y: f64,
    /// True if it is the renderer's default.
    pub auto: bool,
    /// True if nothing else in its panel beats it.
    pub front: bool,
}

impl Mark {
    pub fn new(label: String, x: [f64; 3], y: f64, auto: bool) -> Mark {
        Mark { label, x, y, auto, front: false }
    }

    fn is_known(&self) -> bool {
        self.y.is_finite() && self.x.iter().all(|x| x.is_finite())
    }
}

/// One plot of a chart.
#[derive(Clone, Debug, Serialize)]
pub struct Panel {
    pub title: String,
    pub marks: Vec<Mark>,
}

impl Panel {
    fn mark_front(&mut self) {
        let both: Vec<(f64, f64)> = self.marks.iter().map(|mark| (mark.y, mark.x[1])).collect();
        let fronts = metrics::front(&both);
        self.marks.iter_mut().zip(fronts).for_each(|(mark, front)| mark.front = front);
    }

    fn auto(&self) -> Option<&Mark> {
        self.marks.iter().find(|mark| mark.auto)
    }

    /// Returns the setting that comes nearest to beating the automatic one: the larger of its two
    /// ratios is the smallest.
    fn alternative(&self) -> Option<&Mark> {
        let auto = self.auto()?;
        let worse = |mark: &Mark| ratio(mark.y, auto.y).max(ratio(mark.x[1], auto.x[1]));
        let others = self.marks.iter().filter(|mark| !mark.auto);
        others.min_by(|a, b| worse(a).total_cmp(&worse(b)))
    }
}

/// A figure of a report.
#[derive(Clone, Debug, Serialize)]
pub struct Chart {
    pub title: String,
    /// One sentence.
    pub conclusion: String,
    /// Descriptions of cost and error.
    pub axes: [String; 2],
    /// Unit of costs.
    pub unit: String,
    /// Means over all scenes and views.
    pub pooled: Panel,
    /// Label of the setting that comes nearest to beating the automatic one, all in all.
    pub alternative: Option<String>,
    /// Panels by scene and view; empty if there is but one.
    pub apart: Vec<Panel>,
}

impl Chart {
    /// Returns a chart of the panels of all scenes, whose marks with equal labels belong together.
    pub fn new(title: &str, axes: [&str; 2], unit: &str, mut panels: Vec<Panel>) -> Chart {
        for panel in &mut panels {
            panel.marks.retain(Mark::is_known);
            panel.mark_front();
        }
        let pooled = pool(&panels);
        let mut chart = Chart {
            title: title.into(),
            conclusion: String::new(),
            axes: axes.map(String::from),
            unit: unit.into(),
            alternative: pooled.alternative().map(|mark| mark.label.clone()),
            pooled,
            apart: if panels.len() > 1 { panels } else { Vec::new() },
        };
        chart.conclusion = chart.conclude();
        chart
    }

    /// Returns how the automatic setting stands against the others or, if there is none, what the
    /// front has.
    fn conclude(&self) -> String {
        let costs = |mark: &Mark| match mark.x[1] {
            0.0 => "nothing".into(),
            cost => format!("{} {}", number(cost), self.unit),
        };
        let of = |mark: &Mark| format!("an error of {} for {}", number(mark.y), costs(mark));
        let Some(auto) = self.pooled.auto() else {
            let mut front: Vec<&Mark> =
                self.pooled.marks.iter().filter(|mark| mark.front).collect();
            front.sort_by(|a, b| a.x[1].total_cmp(&b.x[1]));
            let [first, .., last] = front[..] else {
                return front.first().map_or("Nothing could be measured.".into(), |only| {
                    format!("{} beats all others: {}.", capital(&only.label), of(only))
                });
            };
            return format!(
                "{} of {} settings are beaten by none, from {} ({}) to {} ({}).",
                front.len(),
                self.pooled.marks.len(),
                first.label,
                of(first),
                last.label,
                of(last)
            );
        };
        let own = format!("By this measure the automatic setting has {}", of(auto));
        let Some(other) = self.pooled.alternative() else { return format!("{own}.") };
        let [error, cost] = [ratio(other.y, auto.y), ratio(other.x[1], auto.x[1])];
        // Times whose quartiles overlap are not told apart.
        let cost = match auto.x[0] <= other.x[2] && other.x[0] <= auto.x[2] {
            true => 1.0,
            false => cost,
        };
        let worse = |ratio: f64| ratio > 1.0 + TOLD_APART;
        let better = |ratio: f64| ratio < 1.0 - TOLD_APART;
        let name = &other.label;
        let stands = match [error, cost] {
            [error, cost] if worse(error) || worse(cost) => {
                format!("nothing beats it, and {name} comes nearest")
            }
            [error, cost] if better(error) || better(cost) => format!("{name} beats it"),
            _ => format!("nothing beats it, and {name} is not told apart from it"),
        };
        let places = self.apart.iter().filter(|panel| !panel.title.starts_with(ALL));
        let kept: Vec<bool> =
            places.filter_map(|panel| panel.auto()).map(|mark| mark.front).collect();
        let scenes = match kept.len() {
            0 => String::new(),
            all => format!(
                "; it is on the front in {} of {all} scenes and views",
                kept.iter().filter(|front| **front).count()
            ),
        };
        format!(
            "{own}; {stands}, with {} error for {} cost{scenes}.",
            times(ratio(other.y, auto.y)),
            times(ratio(other.x[1], auto.x[1]))
        )
    }
}

/// Returns the means of errors and costs of the settings that are in all panels.
fn pool(panels: &[Panel]) -> Panel {
    let own: Vec<&Panel> = match panels {
        [only] => vec![only],
        _ => panels.iter().filter(|panel| !panel.title.starts_with(ALL)).collect(),
    };
    let mean = |label: &str| {
        let of = |panel: &&Panel| panel.marks.iter().find(|mark| mark.label == label).cloned();
        let marks: Vec<Mark> = own.iter().filter_map(of).collect();
        (marks.len() == own.len()).then(|| {
            let mean = |of: &dyn Fn(&Mark) -> f64| metrics::mean(marks.iter().map(of));
            let x = std::array::from_fn(|k| mean(&|mark| mark.x[k]));
            Mark::new(label.into(), x, mean(&|mark| mark.y), marks[0].auto)
        })
    };
    let labels = own.first().map_or(&[][..], |panel| &panel.marks).iter();
    let marks: Vec<Mark> = labels.filter_map(|mark| mean(&mark.label)).collect();
    let most = own.iter().map(|panel| panel.marks.len()).max().unwrap_or(0);
    let title = match own[..] {
        [only] => only.title.clone(),
        _ if marks.len() == most => format!("mean of {} scenes and views", own.len()),
        _ => format!(
            "mean of {} scenes and views, of the {} settings (of {most}) that are in all",
            own.len(),
            marks.len()
        ),
    };
    let mut pooled = Panel { title, marks };
    pooled.mark_front();
    pooled
}

/// Returns a quotient; nothing in parts of nothing is all of it.
pub fn ratio(value: f64, of: f64) -> f64 {
    if value == of { 1.0 } else { value / of }
}

fn times(ratio: f64) -> String {
    match ratio {
        0.0 => "none of the".into(),
        1.0 => "the same".into(),
        _ if ratio.is_infinite() => "infinitely many times the".into(),
        _ => format!("{} times the", number(ratio)),
    }
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

/// Formats three digits: 0.512, 20, or 1.2·10⁻⁷.
pub fn number(value: f64) -> String {
    if value == 0.0 {
        return "exactly 0".into();
    }
    let power = value.abs().log10().floor() as i32;
    let digits = |value: f64, power: i32| {
        let text = format!("{value:.*}", (2 - power).max(0) as usize);
        if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').into()
        } else {
            text
        }
    };
    if (-3..5).contains(&power) {
        return digits(value, power);
    }
    let power_text = power.to_string();
    let raised = power_text.chars().map(|c| {
        c.to_digit(10).map_or('⁻', |digit| {
            ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][digit as usize]
        })
    });
    let raised: String = raised.collect();
    format!("{}·10{raised}", digits(value / 10f64.powi(power), 0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn panel(title: &str, marks: &[(&str, f64, f64)]) -> Panel {
        let mark =
            |&(label, x, y): &(&str, f64, f64)| Mark::new(label.into(), [x; 3], y, label == "auto");
        Panel { title: title.into(), marks: marks.iter().map(mark).collect() }
    }

    fn chart(panels: Vec<Panel>) -> Chart {
        Chart::new("Depth", ["time", "error"], "ms", panels)
    }

    #[test]
    fn numbers_have_three_digits() {
        let texts = [0.5, 20.0, 1.24e-7, 1e5, 0.0, 0.00512, 1999.6].map(number);
        assert_eq!(texts, ["0.5", "20", "1.24·10⁻⁷", "1·10⁵", "exactly 0", "0.00512", "2000"]);
    }

    #[test]
    fn scenes_are_pooled_and_their_own_pool_does_not_count_again() {
        let panels = vec![
            panel("all scenes, far", &[("auto", 99.0, 99.0)]),
            panel("a", &[("auto", 1.0, 4.0), ("b", 2.0, 1.0), ("of a", 1.0, 1.0)]),
            panel("b", &[("auto", 3.0, 0.0), ("b", 2.0, 2.0), ("lost", 1.0, f64::NAN)]),
        ];
        let Chart { pooled, apart, conclusion, .. } = chart(panels);
        let marks: Vec<_> =
            pooled.marks.iter().map(|mark| (&*mark.label, mark.x[1], mark.y)).collect();
        assert_eq!(marks, [("auto", 2.0, 2.0), ("b", 2.0, 1.5)]);
        assert_eq!(
            pooled.title,
            "mean of 2 scenes and views, of the 2 settings (of 3) that are in all"
        );
        assert_eq!([apart.len(), apart[2].marks.len()], [3, 2]);
        assert!(conclusion.ends_with("it is on the front in 1 of 2 scenes and views."));
    }

    #[test]
    fn the_sentence_follows_the_numbers() {
        let of = |marks: &[(&str, f64, f64)]| chart(vec![panel("a", marks)]).conclusion;
        let sentence = of(&[("auto", 10.0, 1.0), ("b", 5.0, 1.0), ("c", 100.0, 0.1)]);
        assert_eq!(
            sentence,
            "By this measure the automatic setting has an error of 1 for 10 ms; b beats it, with the same error for 0.5 times the cost."
        );
        let sentence = of(&[("auto", 10.0, 0.0), ("b", 5.0, 1.0), ("c", 20.0, 0.0)]);
        assert_eq!(
            sentence,
            "By this measure the automatic setting has an error of exactly 0 for 10 ms; nothing beats it, and c comes nearest, with the same error for 2 times the cost."
        );
        let sentence = of(&[("auto", 10.0, 1.0), ("b", 10.0, 1.01)]);
        assert!(sentence.contains("b is not told apart from it"), "{sentence}");
        let sentence = of(&[("a", 1.0, 2.0), ("b", 2.0, 1.0), ("c", 3.0, 3.0)]);
        assert_eq!(
            sentence,
            "2 of 3 settings are beaten by none, from a (an error of 2 for 1 ms) to b (an error of 1 for 2 ms)."
        );
    }
}
