//! Filters: which points are left, by their attributes, in one grammar for all commands.
//!
//! ```text
//! --only class=ground,6        a class; a comma means or
//! --only ground                names of classes need no `class=`
//! --where intensity=100..2000  a range, both ends included; `100..` and `..2000` have one end
//! --not return=last            what does not match
//! ```
//!
//! A point is left if it matches every `--only` (`--where` is another word for it) and no `--not`.
//! A point without an attribute matches no value of it.
//!
//! A filter is compiled for one part ([`Compiled`]): attributes of few values become tables by the
//! stored value, so that a point costs one look-up a condition.

use super::attribute::{Attribute, class_name};
use super::digits::{number, round};
use super::histograms::CLASSES;
use super::scalar::{Scalar, ScalarColumn};
use super::{Cloud, ColumnSet, Columns, Lattice, Part, input, intensity_of, stations};
use crate::error::{Error, Result};
use crate::similar::did_you_mean;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::fmt;

/// What a condition looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Quantity {
    Class,
    /// Return number, or whether it is the first or last.
    Return,
    /// Number of returns of the pulse.
    Returns,
    /// LAS point source id.
    Source,
    File,
    Scan,
    Intensity,
    /// World coordinate along an axis.
    Coordinate(usize),
    GpsTime,
    Scalar(Scalar),
}

const QUANTITIES: &[(&str, Quantity)] = &[
    ("class", Quantity::Class),
    ("return", Quantity::Return),
    ("returns", Quantity::Returns),
    ("source", Quantity::Source),
    ("file", Quantity::File),
    ("scan", Quantity::Scan),
    ("intensity", Quantity::Intensity),
    ("x", Quantity::Coordinate(0)),
    ("y", Quantity::Coordinate(1)),
    ("z", Quantity::Coordinate(2)),
    ("elevation", Quantity::Coordinate(2)),
    ("gps-time", Quantity::GpsTime),
    ("nir", Quantity::Scalar(Scalar::NearInfrared)),
    ("scan-angle", Quantity::Scalar(Scalar::ScanAngle)),
    ("height-above-ground", Quantity::Scalar(Scalar::HeightAboveGround)),
];

/// Returns what a name before `=` stands for. Names of extra attributes are the files' own.
fn quantity(name: &str) -> std::result::Result<Quantity, String> {
    let own = name.to_lowercase().replace('_', "-");
    let known = QUANTITIES.iter().find(|(known, _)| *known == own).map(|(_, quantity)| *quantity);
    let extra = || name.parse().ok().map(Quantity::Scalar);
    known.or_else(extra).ok_or_else(|| {
        let names: Vec<&str> = QUANTITIES.iter().map(|(name, _)| *name).collect();
        format!(
            "there is no attribute {own:?}{}; there are {}, and extra:NAME, which `pointillist info` lists",
            did_you_mean(&own, &names),
            names.join(", ")
        )
    })
}

/// Names of classes beside those of ASPRS, and of groups of them.
const CLASS_NAMES: &[(&str, &[u8])] = &[
    ("vegetation", &[3, 4, 5]),
    ("noise", &[7, 18]),
    ("low-noise", &[7]),
    ("key-point", &[8]),
    ("road", &[11]),
    ("bridge", &[17]),
];

#[derive(Clone, Debug, PartialEq)]
enum Value {
    /// Both ends included.
    Range([f64; 2]),
    First,
    Last,
    Single,
    Name(String),
}

/// One condition, written `ATTRIBUTE=VALUE[,VALUE...]`, or as names of classes alone.
#[derive(Clone, Debug, PartialEq)]
pub struct Condition {
    quantity: Quantity,
    values: Vec<Value>,
    text: String,
}

impl fmt::Display for Condition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl std::str::FromStr for Condition {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Condition, String> {
        let (name, values) = text.split_once('=').unwrap_or(("class", text));
        let quantity = quantity(name.trim())?;
        let values = match quantity {
            // Names may contain commas.
            Quantity::File | Quantity::Scan => vec![Value::Name(values.into())],
            _ => {
                let of_all = values.split(',').map(|value| values_of(quantity, value.trim(), text));
                of_all.collect::<std::result::Result<Vec<_>, _>>()?.concat()
            }
        };
        Ok(Condition { quantity, values, text: text.into() })
    }
}

fn values_of(
    quantity: Quantity,
    text: &str,
    whole: &str,
) -> std::result::Result<Vec<Value>, String> {
    let word = text.to_lowercase().replace(['_', ' '], "-");
    match (quantity, word.as_str()) {
        (Quantity::Return, "first") => return Ok(vec![Value::First]),
        (Quantity::Return, "last") => return Ok(vec![Value::Last]),
        (Quantity::Return, "single") => return Ok(vec![Value::Single]),
        (Quantity::Class, _) if !whole.contains('=') || word.contains(char::is_alphabetic) => {
            return classes_of(&word).ok_or_else(|| not_a_class(text));
        }
        _ => {}
    }
    let wrong = || match quantity {
        Quantity::Class => not_a_class(text),
        Quantity::Return => {
            let meant = did_you_mean(text, ["first", "last", "single"]);
            format!(
                "{text:?} is not a return{meant}; give first, last, single, a number, or a range"
            )
        }
        _ => format!("{text:?} is not a number, nor a range such as 10..20, 10.. or ..20"),
    };
    let of_number = |text: &str, open: f64| {
        if text.is_empty() { Some(open) } else { text.trim().parse().ok() }
    };
    let ends = match text.split_once("..") {
        Some(("", "")) => None,
        Some((low, high)) => of_number(low, f64::NEG_INFINITY).zip(of_number(high, f64::INFINITY)),
        None => of_number(text, f64::NAN).map(|v| (v, v)),
    };
    let (low, high) =
        ends.filter(|(low, high)| !low.is_nan() && !high.is_nan()).ok_or_else(wrong)?;
    if low > high {
        return Err(format!("the range {text:?} is empty: its first end is the larger one"));
    }
    Ok(vec![Value::Range([low, high])])
}

/// Returns the values of a class name or group.
fn classes_of(word: &str) -> Option<Vec<Value>> {
    let group = CLASS_NAMES.iter().find(|(name, _)| *name == word).map(|(_, classes)| *classes);
    let is_own = |class: &u8| class_name(*class).is_some_and(|name| name.replace(' ', "-") == word);
    let of = |class: u8| Value::Range([class.into(), class.into()]);
    match group {
        Some(classes) => Some(classes.iter().copied().map(of).collect()),
        None => (0..=u8::MAX).find(is_own).map(|class| vec![of(class)]),
    }
}

fn not_a_class(text: &str) -> String {
    let own = (0..=u8::MAX).filter_map(class_name).map(|name| name.replace(' ', "-"));
    let names: Vec<String> =
        own.chain(CLASS_NAMES.iter().map(|(name, _)| name.to_string())).collect();
    let meant = did_you_mean(text, &names);
    let names = names.join(", ");
    format!("{text:?} is not a class{meant}; give class=N, class=N..M, or a name: {names}")
}

impl Condition {
    fn wanted(&self) -> ColumnSet {
        let mut wanted = ColumnSet::default();
        match self.quantity {
            Quantity::Class => wanted.class = true,
            Quantity::Return | Quantity::Returns => wanted.returns = true,
            // Indexes have their files and scans as stations.
            Quantity::Source | Quantity::File | Quantity::Scan => wanted.source = true,
            Quantity::Intensity => wanted.intensity = true,
            Quantity::GpsTime => wanted.gps_time = true,
            Quantity::Scalar(scalar) => wanted = Attribute::Scalar(scalar).wanted(),
            Quantity::Coordinate(_) => {}
        }
        wanted
    }

    fn attribute(&self) -> String {
        match self.quantity {
            Quantity::Scalar(scalar) => scalar.to_string(),
            named => {
                let known = QUANTITIES.iter().find(|(_, quantity)| *quantity == named);
                known.map_or("", |own| own.0).into()
            }
        }
    }

    fn has(&self, number: f64) -> bool {
        self.values.iter().any(
            |value| matches!(value, Value::Range([low, high]) if *low <= number && number <= *high),
        )
    }

    fn has_name(&self, name: &str) -> bool {
        self.values.iter().any(|value| matches!(value, Value::Name(own) if own == name))
    }

    /// Tests return number and number of returns, as stored. A point without them is the only
    /// return of its pulse.
    fn has_return(&self, packed: u8) -> bool {
        let (number, of) = ((packed & 15).max(1), (packed >> 4).max(1));
        self.has((packed & 15).into())
            || self.values.iter().any(|value| match value {
                Value::First => number == 1,
                Value::Last => number >= of,
                Value::Single => of == 1,
                _ => false,
            })
    }

    fn has_source(&self, origin: &Origin) -> bool {
        match self.quantity {
            Quantity::Source => origin.source.is_some_and(|id| self.has(id.into())),
            Quantity::File => self.has_name(&origin.file),
            _ => origin.scan.as_deref().is_some_and(|scan| self.has_name(scan)),
        }
    }
}

/// Where points with one value of [`Columns::source`] come from.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    /// Name of the file, without folders.
    pub file: String,
    /// The scan's own name in its file.
    pub scan: Option<String>,
    /// LAS point source id.
    pub source: Option<u16>,
}

/// All conditions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Filter {
    /// All of these match.
    pub only: Vec<Condition>,
    /// None of these match.
    pub not: Vec<Condition>,
}

impl std::str::FromStr for Filter {
    type Err = String;

    /// Parses conditions as on the command line. Words before the first option are of an `--only`.
    fn from_str(text: &str) -> std::result::Result<Filter, String> {
        let mut conditions = vec![(true, Vec::new())];
        for word in text.split_whitespace() {
            let (option, value) = match word.split_once('=') {
                Some((option, value)) if word.starts_with("--") => (option, Some(value)),
                _ => (word, None),
            };
            match option {
                "--only" | "--where" => conditions.push((true, value.into_iter().collect())),
                "--not" => conditions.push((false, value.into_iter().collect())),
                _ if option.starts_with("--") => {
                    return Err(format!("{option} is none of --only, --where, --not"));
                }
                _ => conditions.last_mut().expect("there is one").1.push(word),
            }
        }
        let first = conditions.remove(0);
        let mut filter = Filter::default();
        for (keeps, words) in
            Some(first).filter(|(_, words)| !words.is_empty()).into_iter().chain(conditions)
        {
            let condition = words.join(" ").parse()?;
            if keeps { filter.only.push(condition) } else { filter.not.push(condition) }
        }
        Ok(filter)
    }
}

/// The meaning of stored numbers, which differs between parts.
pub struct Meaning<'m> {
    /// Range of stored intensities ([`Part::intensity_range`]).
    pub intensity_range: [f64; 2],
    /// Number of values of [`Columns::source`].
    pub sources: usize,
    /// Origin of points with this value; that of 0 if there is no such column.
    pub origin: &'m dyn Fn(usize) -> Origin,
}

/// A filter for the columns of one part.
pub struct Compiled {
    tests: Vec<Test>,
    /// Columns that it looks at.
    pub wanted: ColumnSet,
}

struct Test {
    /// True if matching points are left.
    keeps: bool,
    by: By,
}

enum By {
    Class(Vec<bool>),
    Returns(Vec<bool>),
    Source(Vec<bool>),
    Intensity(Vec<bool>),
    Coordinate(usize, Condition),
    GpsTime(Condition),
    Scalar(Scalar, Condition),
}

impl Compiled {
    /// Returns whether every point is left.
    pub fn has_all(&self) -> bool {
        self.tests.is_empty()
    }

    /// Returns which points are left. Coordinates count from `shift` `[lattice steps]`.
    pub fn left(&self, columns: &Columns, lattice: &Lattice, shift: [i64; 3]) -> Vec<bool> {
        let mut left = vec![true; columns.len()];
        for Test { keeps, by } in &self.tests {
            let mut join = |has: &dyn Fn(usize) -> bool| {
                left.iter_mut().enumerate().for_each(|(i, left)| *left &= has(i) == *keeps);
            };
            fn number<T: Copy + Into<u32>>(column: &Option<Vec<T>>, i: usize) -> Option<usize> {
                column.as_ref().map(|column| column[i].into() as usize)
            }
            let listed = |table: &[bool], value: Option<usize>| {
                value.and_then(|value| table.get(value)).is_some_and(|has| *has)
            };
            match by {
                By::Class(table) => join(&|i| listed(table, number(&columns.class, i))),
                By::Returns(table) => join(&|i| listed(table, number(&columns.returns, i))),
                By::Source(table) => {
                    join(&|i| listed(table, number(&columns.source, i).or(Some(0))))
                }
                By::Intensity(table) => join(&|i| listed(table, number(&columns.intensity, i))),
                By::Coordinate(axis, condition) => {
                    let steps = [&columns.x, &columns.y, &columns.z][*axis];
                    // As `Lattice::world` does, so that clip boxes and filters agree.
                    let (step, offset) = (lattice.step[*axis], lattice.offset[*axis]);
                    let world = |i: usize| offset + step * (steps[i] as i64 + shift[*axis]) as f64;
                    join(&|i| condition.has(world(i)));
                }
                By::GpsTime(condition) => {
                    let times = columns.gps_time.as_ref();
                    join(&|i| times.is_some_and(|times| condition.has(times[i])));
                }
                By::Scalar(scalar, condition) => {
                    let numbers = columns.scalar(*scalar);
                    join(&|i| numbers.is_some_and(|numbers| condition.has(numbers[i])));
                }
            }
        }
        left
    }
}

impl Filter {
    pub fn is_empty(&self) -> bool {
        self.only.is_empty() && self.not.is_empty()
    }

    fn conditions(&self) -> impl Iterator<Item = (bool, &Condition)> {
        let (only, not) = (self.only.iter(), self.not.iter());
        only.map(|condition| (true, condition)).chain(not.map(|condition| (false, condition)))
    }

    /// Returns the columns that conditions look at.
    pub fn wanted(&self) -> ColumnSet {
        self.conditions().fold(ColumnSet::default(), |set, (_, own)| set.and(own.wanted()))
    }

    pub fn compile(&self, meaning: &Meaning) -> Compiled {
        let test = |(keeps, condition): (bool, &Condition)| {
            let table = |count: usize, has: &dyn Fn(usize) -> bool| (0..count).map(has).collect();
            let by = match condition.quantity {
                Quantity::Class => By::Class(table(CLASSES, &|v| condition.has(v as f64))),
                Quantity::Return => By::Returns(table(256, &|v| condition.has_return(v as u8))),
                Quantity::Returns => By::Returns(table(256, &|v| condition.has((v >> 4) as f64))),
                Quantity::Source | Quantity::File | Quantity::Scan => {
                    let origin = meaning.origin;
                    By::Source(table(meaning.sources, &|v| condition.has_source(&origin(v))))
                }
                Quantity::Intensity => {
                    let value = |v: usize| match meaning.intensity_range {
                        super::las::INTENSITY_RANGE => v as f64,
                        range => intensity_of(v as u16, range),
                    };
                    By::Intensity(table(1 << 16, &|v| condition.has(value(v))))
                }
                Quantity::Coordinate(axis) => By::Coordinate(axis, condition.clone()),
                Quantity::GpsTime => By::GpsTime(condition.clone()),
                Quantity::Scalar(scalar) => By::Scalar(scalar, condition.clone()),
            };
            Test { keeps, by }
        };
        Compiled { tests: self.conditions().map(test).collect(), wanted: self.wanted() }
    }

    /// Compiles for a part whose points have source ids of their file, if any.
    pub fn compile_for(
        &self,
        path: &std::path::Path,
        scan: Option<&str>,
        intensity_range: [f64; 2],
        has_source: bool,
    ) -> Compiled {
        let (file, scan) = (input::name_of(path), scan.map(str::to_owned));
        let origin = |id: usize| Origin {
            file: file.clone(),
            scan: scan.clone(),
            source: has_source.then_some(id as u16),
        };
        let sources = if has_source { 1 << 16 } else { 1 };
        self.compile(&Meaning { intensity_range, sources, origin: &origin })
    }

    /// Returns whether no point of these classes and return numbers can be left.
    pub fn leaves_none_of(&self, classes: &[(u8, u64)], returns: &[(u8, u64)]) -> bool {
        self.only.iter().any(|condition| match condition.quantity {
            Quantity::Class => !classes.iter().any(|(class, _)| condition.has((*class).into())),
            // True if a return is the last is not counted.
            Quantity::Return if condition.values.iter().all(|v| matches!(v, Value::Range(_))) => {
                !returns.iter().any(|(number, _)| condition.has((*number).into()))
            }
            _ => false,
        })
    }

    /// Returns an error if a condition looks at an attribute that no point has. `how` says how to
    /// get it.
    pub fn check(&self, available: ColumnSet, how: &dyn Fn(&str) -> String) -> Result<()> {
        let lacks = |condition: &Condition| match condition.quantity {
            Quantity::Class => !available.class,
            Quantity::Return | Quantity::Returns => !available.returns,
            Quantity::Source => !available.source,
            Quantity::Intensity => !available.intensity,
            Quantity::GpsTime => !available.gps_time,
            Quantity::Scalar(scalar) => !available.scalars.has(scalar),
            Quantity::File | Quantity::Scan | Quantity::Coordinate(_) => false,
        };
        match self.conditions().find(|(_, condition)| lacks(condition)) {
            Some((_, condition)) => {
                let name = condition.attribute();
                Err(Error::Request(format!(
                    "{}: no point has {name}; {}",
                    self.word(condition),
                    how(&name)
                )))
            }
            None => Ok(()),
        }
    }

    /// Returns a condition as on the command line.
    fn word(&self, condition: &Condition) -> String {
        let option = if self.only.contains(condition) { "--only" } else { "--not" };
        format!("{option} {condition}")
    }

    /// Returns all conditions as on the command line.
    pub fn words(&self) -> String {
        let words: Vec<String> =
            self.conditions().map(|(_, condition)| self.word(condition)).collect();
        words.join(" ")
    }
}

/// Values that occur, for the message that a filter leaves nothing.
#[derive(Clone, Debug, Default)]
pub struct Present {
    points: u64,
    classes: BTreeSet<u8>,
    /// Packed as stored.
    returns: BTreeSet<u8>,
    sources: BTreeSet<u16>,
    intensity: Option<[f64; 2]>,
    gps_time: Option<[f64; 2]>,
    scalars: Vec<(Scalar, [f64; 2])>,
    coordinates: [Option<[f64; 2]>; 3],
}

fn widen(ends: Option<[f64; 2]>, other: Option<[f64; 2]>) -> Option<[f64; 2]> {
    ends.into_iter().chain(other).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
}

/// Returns the least and the greatest number of a column.
fn ends_of(own: &ScalarColumn) -> Option<(Scalar, [f64; 2])> {
    let numbers = own.numbers.iter().filter(|number| !number.is_nan());
    let ends = numbers.fold(None, |ends, &number| widen(ends, Some([number; 2])));
    ends.map(|ends| (own.scalar, ends))
}

impl Present {
    pub fn of(
        columns: &Columns,
        lattice: &Lattice,
        shift: [i64; 3],
        intensity_range: [f64; 2],
    ) -> Present {
        fn set<T: Copy + Ord>(column: &Option<Vec<T>>) -> BTreeSet<T> {
            column.iter().flatten().copied().collect()
        }
        let times = columns.gps_time.iter().flatten().filter(|time| !time.is_nan());
        let coordinate = |axis: usize| {
            let steps = super::range([&columns.x, &columns.y, &columns.z][axis])?;
            let at = |q: i32| lattice.world([q as i64 + shift[axis]; 3])[axis];
            Some([at(steps.0), at(steps.1)])
        };
        Present {
            points: columns.len() as u64,
            classes: set(&columns.class),
            returns: set(&columns.returns),
            sources: set(&columns.source),
            intensity: columns
                .intensity
                .as_ref()
                .and_then(|column| super::range(column))
                .map(|(low, high)| [low, high].map(|v| intensity_of(v, intensity_range))),
            gps_time: times.fold(None, |ends, &time| widen(ends, Some([time; 2]))),
            scalars: columns.scalars.iter().filter_map(ends_of).collect(),
            coordinates: [0, 1, 2].map(coordinate),
        }
    }

    pub fn and(mut self, other: Present) -> Present {
        self.points += other.points;
        self.classes.extend(other.classes);
        self.returns.extend(other.returns);
        self.sources.extend(other.sources);
        self.intensity = widen(self.intensity, other.intensity);
        self.gps_time = widen(self.gps_time, other.gps_time);
        for (scalar, ends) in other.scalars {
            match self.scalars.iter_mut().find(|(own, _)| *own == scalar) {
                Some((_, own)) => *own = [own[0].min(ends[0]), own[1].max(ends[1])],
                None => self.scalars.push((scalar, ends)),
            }
        }
        for axis in 0..3 {
            self.coordinates[axis] = widen(self.coordinates[axis], other.coordinates[axis]);
        }
        self
    }

    /// Returns the message that these options leave none of these points. `boxed`: clip boxes are
    /// among them.
    pub fn leaves_none(&self, words: &str, filter: &Filter, boxed: bool) -> String {
        let mut said = format!("{words} leaves none of {} points", grouped(self.points));
        let mut seen = Vec::new();
        for (_, condition) in filter.conditions() {
            let there = self.there(condition);
            if !there.is_empty() && !seen.contains(&there) {
                said += &format!("; {there}");
                seen.push(there);
            }
        }
        let [Some(x), Some(y), Some(z)] = self.coordinates else { return said };
        if boxed {
            let corner = |end: usize| [x, y, z].map(|ends| number(round(ends[end], 3))).join(" ");
            said += &format!("; the points lie in {} to {}", corner(0), corner(1));
        }
        said
    }

    fn there(&self, condition: &Condition) -> String {
        fn listed<T: fmt::Display>(what: &str, values: impl Iterator<Item = T>) -> String {
            const MOST: usize = 16;
            let all: Vec<String> = values.map(|value| value.to_string()).collect();
            match all.len() {
                0 => format!("{what} present: none"),
                count if count > MOST => format!("{what} present: {}, ...", all[..MOST].join(", ")),
                _ => format!("{what} present: {}", all.join(", ")),
            }
        }
        let ends = |what: &str, ends: Option<[f64; 2]>| {
            ends.map_or(String::new(), |[low, high]| {
                format!("{what} present: {}..{}", number(low), number(high))
            })
        };
        let numbers = |shift: u8| {
            let all: BTreeSet<u8> =
                self.returns.iter().map(|packed| packed >> shift & 15).collect();
            all.into_iter()
        };
        match condition.quantity {
            Quantity::Class => listed("classes", self.classes.iter()),
            Quantity::Return => listed("returns", numbers(0)),
            Quantity::Returns => listed("numbers of returns", numbers(4)),
            Quantity::Source => listed("sources", self.sources.iter()),
            Quantity::Intensity => ends("intensities", self.intensity),
            Quantity::GpsTime => ends("gps times", self.gps_time),
            Quantity::Scalar(scalar) => {
                let own = self.scalars.iter().find(|(own, _)| *own == scalar);
                ends(&scalar.to_string(), own.map(|(_, ends)| *ends))
            }
            Quantity::Coordinate(axis) => ends(["x", "y", "z"][axis], self.coordinates[axis]),
            Quantity::File | Quantity::Scan => "`info` lists files and scans".into(),
        }
    }
}

/// Formats a number with commas between thousands.
pub fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let comma = |(i, digit): (usize, char)| {
        let comma = (i > 0 && (digits.len() - i).is_multiple_of(3)).then_some(',');
        comma.into_iter().chain([digit])
    };
    digits.chars().enumerate().flat_map(comma).collect()
}

impl Part {
    fn compiled(&self, filter: &Filter) -> Compiled {
        let has_source = self.columns.source.is_some();
        filter.compile_for(&self.path, self.name.as_deref(), self.intensity_range, has_source)
    }

    fn keep(&mut self, left: Vec<bool>) {
        let kept: Vec<u32> = (0..).zip(left).filter(|(_, left)| *left).map(|(i, _)| i).collect();
        if kept.len() < self.columns.len() {
            self.columns = self.columns.pick(&kept);
        }
    }
}

impl Cloud {
    /// Leaves the points of a filter. Errors if these are none.
    pub fn filter(&mut self, filter: &Filter) -> Result<()> {
        if filter.is_empty() || self.is_empty() {
            return Ok(());
        }
        let sets = self.parts.iter().map(|part| part.columns.available());
        filter.check(sets.fold(ColumnSet::default(), ColumnSet::and), &|_| {
            "`pointillist info` lists their attributes".into()
        })?;
        let left = |part: &Part| part.compiled(filter).left(&part.columns, &part.lattice, [0; 3]);
        self.chosen = true;
        self.leave(&filter.words(), filter, &left)
    }

    /// Leaves the points at some world positions. `words` are the options that say which.
    pub fn keep(&mut self, words: &str, keep: &(dyn Fn(DVec3) -> bool + Sync)) -> Result<()> {
        let left = |part: &Part| {
            let Columns { x, y, z, .. } = &part.columns;
            let place = |i: usize| part.lattice.world([x[i], y[i], z[i]].map(i64::from));
            (0..x.len()).into_par_iter().map(|i| keep(place(i))).collect()
        };
        self.leave(words, &Filter::default(), &left)
    }

    fn leave(
        &mut self,
        words: &str,
        filter: &Filter,
        left: &(dyn Fn(&Part) -> Vec<bool> + Sync),
    ) -> Result<()> {
        let of = self.len();
        let masks: Vec<Vec<bool>> = self.parts.par_iter().map(left).collect();
        if !masks.iter().flatten().any(|left| *left) {
            let present = |part: &Part| {
                Present::of(&part.columns, &part.lattice, [0; 3], part.intensity_range)
            };
            let present = self.parts.par_iter().map(present).reduce(Present::default, Present::and);
            return Err(Error::Request(present.leaves_none(words, filter, filter.is_empty())));
        }
        self.parts.par_iter_mut().zip(masks).for_each(|(part, left)| part.keep(left));
        self.parts.retain(|part| !part.columns.is_empty());
        self.stations =
            (0..).zip(&self.parts).flat_map(|(index, part)| stations(part, index)).collect();
        let left = self.len();
        self.notes.push(format!("{words} leaves {} of {} points", grouped(left), grouped(of)));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn filter(only: &[&str], not: &[&str]) -> Filter {
        let of = |texts: &[&str]| texts.iter().map(|text| text.parse().unwrap()).collect();
        Filter { only: of(only), not: of(not) }
    }

    fn columns() -> Columns {
        Columns {
            x: vec![0, 1, 2, 3],
            y: vec![0; 4],
            z: vec![10, 20, 30, 40],
            class: Some(vec![2, 5, 6, 18]),
            returns: Some(vec![0x11, 0x21, 0x22, 0]),
            intensity: Some(vec![0, 100, 2000, 2001]),
            source: Some(vec![7, 7, 8, 9]),
            gps_time: Some(vec![1.5, 2.5, f64::NAN, 4.0]),
            ..Columns::default()
        }
    }

    fn left(only: &[&str], not: &[&str]) -> Vec<usize> {
        let lattice = Lattice { step: DVec3::splat(0.1), offset: DVec3::ZERO };
        let filter = filter(only, not);
        let compiled =
            filter.compile_for("a/b.las".as_ref(), Some("north, 2"), [0.0, 65535.0], true);
        let left = compiled.left(&columns(), &lattice, [0; 3]);
        (0..4).filter(|&i| left[i]).collect()
    }

    #[test]
    fn conditions_are_joined_by_and_and_values_by_or() {
        assert_eq!(left(&[], &[]), [0, 1, 2, 3]);
        assert_eq!(left(&["ground"], &[]), [0]);
        assert_eq!(left(&["class=ground,6"], &[]), [0, 2]);
        assert_eq!(left(&["vegetation,building"], &[]), [1, 2]);
        assert_eq!(left(&["class=3..6"], &["high-vegetation"]), [2]);
        assert_eq!(left(&["High Vegetation"], &[]), [1]);
        assert_eq!(left(&[], &["noise"]), [0, 1, 2]);
        assert_eq!(left(&["return=first"], &[]), [0, 1, 3]);
        assert_eq!(left(&["return=last"], &[]), [0, 2, 3]);
        assert_eq!(left(&["return=single,2"], &[]), [0, 2, 3]);
        assert_eq!(left(&["return=0"], &[]), [3]);
        assert_eq!(left(&["returns=2.."], &[]), [1, 2]);
        assert_eq!(left(&["intensity=100..2000"], &[]), [1, 2]);
        assert_eq!(left(&["z=..2"], &[]), [0, 1]);
        assert_eq!(left(&["elevation=2..3", "class=6"], &[]), [2]);
        assert_eq!(left(&["gps-time=2..4"], &[]), [1, 3]);
        assert_eq!(left(&["source=8..9"], &["source=9"]), [2]);
        assert_eq!(left(&["file=b.las", "scan=north, 2"], &[]), [0, 1, 2, 3]);
        assert_eq!(left(&["file=c.las"], &[]), [] as [usize; 0]);
    }

    #[test]
    fn what_is_no_condition_is_refused_with_its_words() {
        for (text, said) in [
            ("grund", "low-vegetation"),
            ("2", "class=N"),
            ("class=x", "\"x\" is not a class"),
            ("class=", "\"\" is not"),
            ("colour=3", "gps-time"),
            ("z=3..2", "empty"),
            ("z=..", "10..20"),
            ("z=nan", "nan"),
            ("return=none", "first, last, single"),
        ] {
            let error = text.parse::<Condition>().unwrap_err();
            assert!(error.contains(said), "{text}: {error}");
        }
    }

    #[test]
    fn a_line_is_read_as_the_command_line_is() {
        let filter = filter(&["ground", "file=a b.las", "z=0..2"], &["return=last"]);
        let read = |text: &str| text.parse::<Filter>();
        assert_eq!(read(&filter.words()).unwrap(), filter);
        assert_eq!(
            read("ground --only=file=a b.las --where z=0..2 --not return=last").unwrap(),
            filter
        );
        assert_eq!(read("  ").unwrap(), Filter::default());
        for (text, said) in
            [("--without 3", "--not"), ("--only", "class"), ("--not grund", "grund")]
        {
            assert!(read(text).unwrap_err().contains(said), "{text}");
        }
    }

    #[test]
    fn what_leaves_nothing_says_what_there_is() {
        let lattice = Lattice { step: DVec3::splat(0.1), offset: DVec3::ZERO };
        let present = Present::of(&columns(), &lattice, [0; 3], [0.0, 65535.0]);
        let present = Present { points: 1234, ..present };
        let filter = filter(&["class=9", "z=50.."], &["ground"]);
        let said = present.leaves_none(&filter.words(), &filter, false);
        assert_eq!(
            said,
            "--only class=9 --only z=50.. --not ground leaves none of 1,234 points; classes present: 2, 5, 6, 18; z present: 1..4"
        );
        let said = present.leaves_none("--clip", &Filter::default(), true);
        assert_eq!(said, "--clip leaves none of 1,234 points; the points lie in 0 0 1 to 0.3 0 4");
        assert_eq!(grouped(1_000_000), "1,000,000");
        assert_eq!(grouped(12), "12");
    }

    #[test]
    fn attributes_that_no_point_has_are_refused() {
        let filter = filter(&["gps-time=1.."], &[]);
        let error = filter.check(ColumnSet::default(), &|name| format!("find {name}")).unwrap_err();
        assert_eq!(error.to_string(), "--only gps-time=1..: no point has gps-time; find gps-time");
        assert!(filter.check(ColumnSet::ALL, &|_| String::new()).is_ok());
        assert!(!filter.leaves_none_of(&[], &[]));
        let only = |text: &str| self::filter(&[text], &[]);
        assert!(only("class=9").leaves_none_of(&[(2, 5)], &[(1, 5)]));
        assert!(!only("return=last").leaves_none_of(&[(2, 5)], &[(1, 5)]));
    }
}
