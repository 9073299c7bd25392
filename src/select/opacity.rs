//! Opacity rules, and the tables that they make for classes, return numbers and stations.

use crate::cloud::Station;
use crate::cloud::attribute::station_left_out;
use crate::cloud::histograms::{CLASSES, Histograms, RETURNS};
use serde::Serialize;

/// The points a rule applies to.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum What {
    /// All points.
    All,
    /// Points of an ASPRS class.
    Class(u8),
    /// Points of a number of return.
    Return(u8),
    /// A station: its name, `source N` (LAS point source id N of every file), or its number in the
    /// list of `info`, from 1.
    Station(String),
    /// All stations of the file with this name.
    File(String),
}

/// One rule, written `[WHAT=]OPACITY`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rule {
    /// Points that it applies to.
    pub what: What,
    /// Opacity from 0 (not drawn) to 1 (hides what is behind).
    pub opacity: f64,
}

/// The facts about a cloud that rules are checked against.
#[derive(Clone, Copy, Debug)]
pub struct Known<'c> {
    pub stations: &'c [Station],
    pub points: u64,
    /// Histograms of classes and returns, if counted.
    pub counts: Option<&'c Histograms>,
}

/// All rules. A point's opacity is the product of those of its matching rules.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Opacities(pub Vec<Rule>);

impl std::str::FromStr for Rule {
    type Err = String;

    fn from_str(text: &str) -> Result<Rule, String> {
        let (what, number) = text.rsplit_once('=').unwrap_or(("all", text));
        let opacity = number.parse().ok().filter(|opacity| (0.0..=1.0).contains(opacity));
        let opacity = opacity.ok_or(format!("{number:?} is not an opacity from 0 to 1"))?;
        let what = match what.split_once(':') {
            None if what == "all" => What::All,
            Some(("class", class)) => What::Class(
                class.parse().map_err(|_| format!("{class:?} is not a class from 0 to 255"))?,
            ),
            Some(("return", number)) => {
                let valid = number.parse().ok().filter(|number| (*number as usize) < RETURNS);
                What::Return(valid.ok_or(format!(
                    "{number:?} is not a return number from 0 to {}",
                    RETURNS - 1
                ))?)
            }
            Some(("station", name)) => What::Station(name.into()),
            Some(("file", name)) => What::File(name.into()),
            _ => {
                return Err(format!(
                    "{what:?} is not a rule; give class:N, return:N, station:NAME or file:NAME"
                ));
            }
        };
        Ok(Rule { what, opacity })
    }
}

impl std::fmt::Display for Rule {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.what {
            What::All => write!(f, "{}", self.opacity),
            what => write!(f, "{what}={}", self.opacity),
        }
    }
}

impl std::fmt::Display for What {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            What::All => write!(f, "all"),
            What::Class(class) => write!(f, "class:{class}"),
            What::Return(number) => write!(f, "return:{number}"),
            What::Station(name) => write!(f, "station:{name}"),
            What::File(name) => write!(f, "file:{name}"),
        }
    }
}

impl What {
    fn is_of(&self, number: usize, station: &Station) -> bool {
        match self {
            What::Station(name) => {
                let source = name.strip_prefix("source ").and_then(|id| id.parse().ok());
                station.name == *name
                    || name.parse() == Ok(number + 1)
                    || source.is_some() && source == station.source
            }
            // A station is named after its file, or after its scan in the file.
            What::File(name) => {
                station.name == *name || station.name.starts_with(&format!("{name} "))
            }
            _ => false,
        }
    }

    /// Tests whether a file's rule is about a station.
    pub fn has(&self, station: &Station) -> bool {
        matches!(self, What::File(_)) && self.is_of(usize::MAX, station)
    }

    /// Tests whether the rule may match any point.
    fn is_of_some(&self, known: &Known) -> bool {
        // A point without class or return number has 0.
        let counted = |list: &[(u8, u64)], wanted: u8| {
            let silent = || list.iter().map(|(_, count)| count).sum::<u64>() < known.points;
            list.iter().any(|(kind, _)| *kind == wanted) || wanted == 0 && silent()
        };
        match self {
            What::All => true,
            What::Class(class) => {
                known.counts.is_none_or(|counts| counted(&counts.classes, *class))
            }
            What::Return(number) => {
                known.counts.is_none_or(|counts| counted(&counts.returns, *number))
            }
            What::Station(_) | What::File(_) => known
                .stations
                .iter()
                .enumerate()
                .any(|(number, station)| self.is_of(number, station)),
        }
    }

    fn names_stations(&self) -> bool {
        matches!(self, What::Station(_) | What::File(_))
    }
}

/// Most names that a message lists.
const MOST_NAMES: usize = 8;

/// Returns the file name of a station; a station that shares its file carries both names.
fn file_of(station: &Station) -> &str {
    let source = station.source.map_or(String::new(), |source| format!(" source {source}"));
    station.name.strip_suffix(&source).unwrap_or(&station.name)
}

impl Opacities {
    /// Tests whether some points let light through.
    pub(crate) fn is_transparent(&self, known: &Known) -> bool {
        self.0
            .iter()
            .any(|rule| rule.opacity > 0.0 && rule.opacity < 1.0 && rule.what.is_of_some(known))
    }

    /// Tests whether some points are not drawn at all.
    pub(crate) fn hides(&self, known: &Known) -> bool {
        self.0.iter().any(|rule| rule.opacity == 0.0 && rule.what.is_of_some(known))
    }

    /// Tests whether no point is drawn.
    pub(crate) fn hides_all(&self, known: &Known) -> bool {
        let table = self.table(known.stations);
        table[..CLASSES].iter().all(|factor| *factor == 0.0)
            || table[CLASSES + RETURNS..].iter().all(|factor| *factor == 0.0)
    }

    /// Returns a message for each rule that matches no point.
    pub(crate) fn idle(&self, known: &Known) -> Vec<String> {
        let list = |kinds: &[(u8, u64)]| {
            let numbers: Vec<_> = kinds.iter().take(16).map(|(kind, _)| kind.to_string()).collect();
            if numbers.is_empty() {
                "none".into()
            } else {
                numbers.join(", ") + if kinds.len() > 16 { ", ..." } else { "" }
            }
        };
        let said = |rule: &Rule| {
            let counts = known.counts.filter(|_| !rule.what.is_of_some(known))?;
            let (kind, there) = match rule.what {
                What::Class(class) => (format!("of class {class}"), list(&counts.classes)),
                What::Return(number) => (format!("of return {number}"), list(&counts.returns)),
                _ => return None,
            };
            Some(format!("--opacity {rule}: no point is {kind}; there are: {there}"))
        };
        self.0.iter().filter_map(said).collect()
    }

    /// Returns the numbers of stations with points that may be drawn.
    pub(crate) fn drawn_stations(&self, stations: &[Station]) -> Vec<u32> {
        let factors = self.table(stations).into_iter().skip(CLASSES + RETURNS).take(stations.len());
        (0..).zip(factors).filter(|&(_, factor)| factor > 0.0).map(|(number, _)| number).collect()
    }

    /// Tests whether opacity depends on a point's kind.
    #[doc(hidden)]
    pub fn needs_kinds(&self) -> bool {
        self.0.iter().any(|rule| rule.what != What::All)
    }

    /// Tests whether some rule names a station or a file.
    pub(crate) fn name_stations(&self) -> bool {
        self.0.iter().any(|rule| rule.what.names_stations())
    }

    /// Returns a message for the first rule whose station does not exist.
    pub(crate) fn lost(&self, stations: &[Station]) -> Option<String> {
        let known = Known { stations, points: 0, counts: None };
        let is_lost = |rule: &&Rule| rule.what.names_stations() && !rule.what.is_of_some(&known);
        let (kind, name, mut names): (_, _, Vec<&str>) = match &self.0.iter().find(is_lost)?.what {
            What::Station(name) => {
                ("station", name, stations.iter().map(|station| station.name.as_str()).collect())
            }
            What::File(name) => ("file", name, stations.iter().map(file_of).collect()),
            _ => return None,
        };
        names.dedup();
        let more = if names.len() > MOST_NAMES { ", ..." } else { "" };
        names.truncate(MOST_NAMES);
        Some(format!("no {kind} {name:?}; there are: {}{more}", names.join(", ")))
    }

    /// Returns the factors: 256 for classes, 16 for return numbers, one per station, and 0 for
    /// points that a filter leaves out ([`station_left_out`]). A point's opacity is the product of
    /// its three (`glsl/lib/point_kind.glsl`).
    pub(crate) fn table(&self, stations: &[Station]) -> Vec<f32> {
        let mut table = vec![1.0; CLASSES + RETURNS + station_left_out(stations.len()) as usize];
        table.push(0.0);
        let (classes, others) = table.split_at_mut(CLASSES);
        let (returns, places) = others.split_at_mut(RETURNS);
        for Rule { what, opacity } in &self.0 {
            let opacity = *opacity as f32;
            match what {
                What::All => classes.iter_mut().for_each(|factor| *factor *= opacity),
                What::Class(class) => classes[*class as usize] *= opacity,
                What::Return(number) => returns[*number as usize] *= opacity,
                What::Station(_) | What::File(_) => {
                    let about = stations
                        .iter()
                        .enumerate()
                        .map(|(number, station)| what.is_of(number, station));
                    places
                        .iter_mut()
                        .zip(about)
                        .filter(|(_, about)| *about)
                        .for_each(|(factor, _)| *factor *= opacity);
                }
            }
        }
        table
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stations() -> Vec<Station> {
        let station =
            |part, source, name: &str| Station { part, source, name: name.into(), points: 1 };
        vec![
            station(0, Some(3), "a.las source 3"),
            station(0, Some(7), "a.las source 7"),
            station(1, None, "b.ply"),
        ]
    }

    #[test]
    fn opacities_of_a_point_multiply() {
        let rules = [
            "0.5",
            "class:6=0.5",
            "return:2=0",
            "station:2=0.25",
            "station:source 3=0.5",
            "file:a.las=0.5",
            "station:b.ply=0.75",
        ];
        let opacities = Opacities(rules.iter().map(|rule| rule.parse().unwrap()).collect());
        let table = opacities.table(&stations());
        assert_eq!([table[5], table[6], table[256 + 1], table[256 + 2]], [0.5, 0.25, 1.0, 0.0]);
        assert_eq!(table[272..], [0.25, 0.125, 0.75, 0.0]);
        let stations = stations();
        let known = Known { stations: &stations, points: 3, counts: None };
        assert!(
            opacities.is_transparent(&known) && opacities.hides(&known) && opacities.needs_kinds()
        );
        assert_eq!(opacities.lost(&stations), None);
        let leaves_none = |rules: &[&str]| {
            Opacities(rules.iter().map(|rule| rule.parse().unwrap()).collect()).hides_all(&known)
        };
        assert!(leaves_none(&["0.5", "0"]) && leaves_none(&["file:a.las=0", "station:b.ply=0"]));
        assert!(
            !leaves_none(&[])
                && !leaves_none(&["file:a.las=0"])
                && !leaves_none(&["class:6=0", "return:1=0"])
        );
    }

    /// Rules about absent points peel no layers and remove nothing; points without a class are of
    /// class 0.
    #[test]
    fn rules_about_no_point_there_is_change_nothing_and_say_so() {
        let of = |rule: &str| Opacities(vec![rule.parse().unwrap()]);
        let counts = Histograms { classes: vec![(2, 5), (6, 4)], returns: vec![(1, 10)] };
        let known = Known { stations: &[], points: 10, counts: Some(&counts) };
        assert!(
            ["0.5", "class:2=0.5", "class:0=0.5", "return:1=0.5"]
                .iter()
                .all(|rule| of(rule).is_transparent(&known))
        );
        assert!(
            ["class:99=0.5", "return:0=0.5", "return:2=0.5", "station:a=0.5"]
                .iter()
                .all(|rule| !of(rule).is_transparent(&known))
        );
        assert!(of("class:6=0").hides(&known) && !of("class:7=0").hides(&known));
        assert_eq!(
            of("class:99=0.3").idle(&known),
            ["--opacity class:99=0.3: no point is of class 99; there are: 2, 6"]
        );
        assert!(of("class:0=0.3").idle(&known).is_empty() && of("0.3").idle(&known).is_empty());
        let nobody_counted = Known { counts: None, ..known };
        assert!(
            of("class:99=0.5").is_transparent(&nobody_counted)
                && of("class:99=0.5").idle(&nobody_counted).is_empty()
        );
    }

    #[test]
    fn what_is_no_rule_is_refused_with_its_words() {
        for text in [
            "",
            "2",
            "-0.1",
            "nan",
            "class:256=1",
            "class:x=0.5",
            "return:16=1",
            "wall=0.5",
            "class:6",
            "=1",
        ] {
            assert!(text.parse::<Rule>().is_err(), "{text}");
        }
        let lost = Opacities(vec!["file:c.las=0.5".parse().unwrap()]).lost(&stations()).unwrap();
        assert!(lost.contains("\"c.las\"") && lost.contains("b.ply"), "{lost}");
    }
}
