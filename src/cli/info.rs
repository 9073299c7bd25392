//! `pointillist info`: what is in files, as measured, next to what their headers say.
//!
//! In: paths. Out: text, or one JSON object, on standard output. Histograms, bounds and ranges are
//! recomputed from every point; the header's own are shown beside them, and where the two differ a
//! note says so.
//!
//! The JSON object is stable; fields may be added: `points` · `bounds` {`min`, `max`} or null ·
//! `unit` {`name`, `metres`} of all lengths · `unit_is_stated` · `spacing` {`value` or null, `how`}
//! · `strays` {`points`, `places` [[x, y, z]] of the first few}, which lie far outside of all
//! others · `parts` [{`path`, `name`, `format`, `points`, `header` {`format`, `points`, `bounds`
//! [min, max], `facts` [[what, text]], `system` {`name`, `epsg`, `kind` (`projected`, `geographic`,
//! `geocentric`, `local`), `unit`, `height_unit`, `degrees`, `proj`, `plane` {`longitude`,
//! `latitude`, `metres_per_degree`}}}, `bounds`, `step`, `offset`, `attributes` {`rgb` {`bits`,
//! `full` (1, 255, 65535 or as stated), `by` (`file`, `values`, `request`), `min`, `max`},
//! `intensity` {`min`, `max`}, `class` [{`class`, `points`}], `returns` {`most`, `impossible`},
//! `source` {`ids`}, `gps_time` {`min`, `max`, `nan`, `nan_share`}, `normal` {`zero_share`},
//! `extra` [{`name`, `min`, `max`, `missing`}] of columns of text that are none of these},
//! `colors` \[`name`\] for `--color`}] ·
//! `stations` [{`part`, `source`, `name`, `points`}] · `exposures` {`values`, `overlaps`
//! [{`stations`, `cells`, `step`, `gain`}], `compared`, `balance` {`gains`, `uneven`}} where two
//! stations have colours · `notes` [`line`]. An attribute that a part lacks is absent. `compared`
//! is the number of points among which overlaps were sought; it is absent where these are all: up
//! to four million.
//!
//! Files of more than four million points, or those that may have as many, are read a batch at a
//! time: LAS twice or a few times, others once into a temporary file.
//!
//! `--count` reads a batch at a time and gives `points` · `of` · `bounds` · `classes` [{`class`,
//! `points`}] · `returns` [{`return`, `points`}] · `notes` [`line`].

use super::export;
use super::filters::{ClipOptions, FilterOptions};
use super::indexed_info::{self, Returned};
use super::options::{CacheOptions, ColorOptions, TextArguments};
use crate::cloud::attribute::Attribute;
use crate::cloud::crs::{Crs, Reference, Unit};
use crate::cloud::digits::{self, Digits};
use crate::cloud::filter::grouped;
use crate::cloud::histograms::Histograms;
use crate::cloud::input::Input;
use crate::cloud::rgb_range::Scale;
use crate::cloud::scalar;
use crate::cloud::strays::Strays;
use crate::cloud::{self, ColumnSet, Extra, Header, ReadOptions, Station, stream};
use crate::error::{Error, Result};
use crate::extract::count::{self, Count};
use crate::extract::statistics::{PartStatistics, Statistics, statistics};
use crate::extract::{self, Selection};
use crate::index::attributes::exposure::Exposures;
use crate::index::format::{Balance, Index};
use crate::network;
use crate::progress::Progress;
use crate::render::source;
use glam::DVec3;
use serde::Serialize;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  pointillist info scan.laz                  counts, bounds, attributes, stations, spacing
  pointillist info --json a.las b.e57        both as one cloud, one JSON object
  pointillist info site.pnti                 an index: what went into it, and the tree
  pointillist info s3://bucket/a.copc.laz    an octree on a server: its header and tree
  pointillist info scan.laz --only ground --clip box:0,0,0,10,10,5 --count    exactly how many points
  pointillist info --strict found.las       exit code 1 if anything is cut off or the header lies")]
pub struct Arguments {
    /// Point clouds: LAS, LAZ, COPC, Potree 2, EPT, PLY, E57, OBJ, XYZ, CSV, TXT, PTS, PTX; or one
    /// index, PNTI
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,

    /// Print one JSON object
    #[arg(long)]
    pub json: bool,

    /// Only count the points that filters and clip boxes leave, exactly, with their box, classes
    /// and returns; reads files larger than memory
    #[arg(long)]
    pub count: bool,

    #[command(flatten)]
    pub filters: FilterOptions,

    #[command(flatten)]
    pub clips: ClipOptions,

    /// Refuse a truncated or inconsistent file instead of keeping what is readable
    #[arg(long)]
    pub strict: bool,

    #[command(flatten)]
    pub text: TextArguments,

    #[command(flatten)]
    pub colors: ColorOptions,

    #[command(flatten)]
    pub cache: CacheOptions,
}

pub fn run(arguments: &Arguments, progress: &dyn Progress) -> Result<()> {
    arguments.cache.use_for_servers(progress);
    for path in arguments.files.iter().filter(|path| network::is_address(path)) {
        Input::open_slowly(path, progress)?;
    }
    let is_index = arguments.files.iter().any(|path| Index::is_one(path));
    let selects = !arguments.filters.filter().is_empty() || !arguments.clips.clip.is_empty();
    let is_remote_octree = |path: &Path| network::is_address(path) && Index::is_octree(path);
    let mut text = match arguments.files.iter().find(|path| Index::is_one(path)) {
        // An index has no ranges of attributes, of all points or of some.
        _ if arguments.count || is_index && selects => counted(arguments, progress)?,
        Some(path) if arguments.files.len() == 1 => {
            source::refuse_rgb_range(path, arguments.colors.rgb_range)?;
            indexed_info::report(&Index::open(path)?, arguments.json)?
        }
        Some(path) => {
            return Err(Error::Request(format!(
                "{} is an index; pass it alone, without other files",
                path.display()
            )));
        }
        // Ranges of all points would have to be fetched.
        None if arguments.files.len() == 1 && !selects && is_remote_octree(&arguments.files[0]) => {
            let range = arguments.colors.rgb_range;
            let index = Index::open_octree(&arguments.files[0], range, arguments.strict)?;
            indexed_info::report(&index, arguments.json)?
        }
        None => of_files(arguments, progress)?,
    };
    text.push('\n');
    super::streams::print(&text)
}

/// Most points that are read whole, which takes less than 200 MB. Of more, a batch a thread is in
/// memory, and files are read again for what all points tell together.
const WHOLE: u64 = 4_000_000;

fn of_files(arguments: &Arguments, progress: &dyn Progress) -> Result<String> {
    let (text, rgb_range) = (arguments.text.options(), arguments.colors.rgb_range);
    let (filter, clips) = (arguments.filters.filter(), arguments.clips.clips());
    let options = ReadOptions {
        text,
        rgb_range,
        extras: true,
        ..ReadOptions::new(ColumnSet::ALL.and(filter.wanted()), arguments.strict)
    };
    let is_large = stream::summary(&arguments.files)?.points > WHOLE;
    let (mut input, selection, mut notes) = if is_large {
        let selection = Selection { filter, clips, ..Selection::default() };
        (extract::input::Input::open(&arguments.files, &options, progress)?, selection, Vec::new())
    } else {
        let mut cloud = cloud::read(&arguments.files, &options, progress)?;
        cloud.filter(&filter)?;
        if clips.active() > 0 {
            cloud.keep("--clip", &|place| clips.keep(place))?;
        }
        let notes = std::mem::take(&mut cloud.notes);
        (extract::input::Input::of_cloud(cloud), Selection::default(), notes)
    };
    let found = statistics(&mut input, &selection, progress)?;
    if is_large {
        notes.extend(found.notes.iter().cloned());
    }
    let report = Report::new(&input, &found, &notes);
    if arguments.json {
        return serde_json::to_string_pretty(&report).map_err(|error| {
            Error::Request(format!("the report cannot be written as JSON: {error}"))
        });
    }
    Ok(report.text())
}

/// Counts the points that are left, a batch at a time.
fn counted(arguments: &Arguments, progress: &dyn Progress) -> Result<String> {
    let (filter, clips) = (arguments.filters.filter(), arguments.clips.clips());
    let options = ReadOptions {
        records: false,
        ..export::reading(&arguments.text, &arguments.colors, filter.wanted(), arguments.strict)
    };
    let input = export::open(&arguments.files, &options, progress)?;
    let selection = Selection { filter, clips, ..Selection::default() };
    let Count { points, of, bounds, histograms, notes } =
        count::count(&input, &selection, progress)?;
    if arguments.json {
        let report = serde_json::json!({
            "points": points,
            "of": of,
            "bounds": bounds.map(|[min, max]| Bounds { min, max }),
            "classes": Class::list(&histograms),
            "returns": Returned::list(&histograms),
            "notes": notes,
        });
        return Ok(format!("{report:#}"));
    }
    let mut out = format!("{} of {} points\n", grouped(points), grouped(of));
    let bounds = bounds.map(|[min, max]| Bounds { min, max });
    write_bounds(
        &mut |what, value| push(&mut out, what, &value),
        &bounds,
        input.reference().system.as_ref(),
    );
    if points == 0 && of > 0 {
        push(&mut out, "note", &selection.leaves_none(&input, progress).to_string());
    }
    let kinds = [("classes", histograms.classes), ("returns", histograms.returns)];
    for (what, kinds) in kinds.into_iter().filter(|(_, kinds)| !kinds.is_empty()) {
        push(&mut out, what, &listed(kinds.into_iter()));
    }
    notes.iter().for_each(|note| push(&mut out, "note", note));
    out.truncate(out.trim_end().len());
    Ok(out)
}

const HOW_SPACING: &str = "the root of the area that each of the eight nearest places has, the upper quartile of about 2000 places";

#[derive(Serialize)]
struct Report<'a> {
    points: u64,
    bounds: Option<Bounds>,
    /// The coordinate system of all parts.
    #[serde(skip)]
    system: Option<Crs>,
    /// Unit of lengths.
    unit: Unit,
    /// True if a file names it; metres are assumed where none does.
    unit_is_stated: bool,
    spacing: Spacing,
    /// Points that lie far outside of their part.
    strays: Strays,
    parts: Vec<PartReport<'a>>,
    stations: &'a [Station],
    #[serde(skip_serializing_if = "Option::is_none")]
    exposures: Option<&'a Exposures>,
    notes: &'a [String],
}

/// A box in the world.
#[derive(Serialize)]
pub struct Bounds {
    pub min: DVec3,
    pub max: DVec3,
}

#[derive(Serialize)]
pub struct Spacing {
    pub value: Option<f64>,
    pub how: &'static str,
}

#[derive(Serialize)]
struct PartReport<'a> {
    path: String,
    name: Option<&'a str>,
    format: &'a str,
    points: u64,
    header: &'a Header,
    bounds: Option<Bounds>,
    step: DVec3,
    offset: DVec3,
    attributes: Attributes,
    /// What `--color` can show.
    colors: Vec<String>,
}

#[derive(Serialize)]
struct Attributes {
    #[serde(skip_serializing_if = "Option::is_none")]
    rgb: Option<Rgb>,
    #[serde(skip_serializing_if = "Option::is_none")]
    intensity: Option<Range>,
    #[serde(skip_serializing_if = "Option::is_none")]
    class: Option<Vec<Class>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    returns: Option<Returns>,
    #[serde(skip_serializing_if = "Option::is_none")]
    source: Option<Sources>,
    #[serde(skip_serializing_if = "Option::is_none")]
    gps_time: Option<Times>,
    #[serde(skip_serializing_if = "Option::is_none")]
    normal: Option<Normals>,
    /// Attributes that a cloud has no column for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    extra: Vec<Extra>,
}

#[derive(Serialize)]
struct Rgb {
    /// Bits per channel in the file.
    bits: u8,
    /// Largest value of the file's channels, and where that is known from.
    #[serde(flatten)]
    scale: Scale,
    /// Least and largest colours, of 255.
    min: [u8; 3],
    max: [u8; 3],
}

/// A range of the file's own values.
#[derive(Serialize)]
struct Range {
    min: f64,
    max: f64,
}

#[derive(Serialize)]
pub struct Class {
    pub class: u8,
    pub points: u64,
}

impl Class {
    pub fn list(counts: &Histograms) -> Vec<Class> {
        counts.classes.iter().map(|&(class, points)| Class { class, points }).collect()
    }
}

#[derive(Serialize)]
struct Returns {
    /// The largest number of returns.
    most: u8,
    /// Points whose return number is 0 or above their number of returns.
    impossible: u64,
}

#[derive(Serialize)]
struct Sources {
    ids: usize,
}

#[derive(Serialize)]
struct Times {
    min: Option<f64>,
    max: Option<f64>,
    /// Points without a time.
    nan: u64,
    nan_share: f64,
}

#[derive(Serialize)]
struct Normals {
    zero_share: f64,
}

impl<'a> Report<'a> {
    fn new(input: &'a extract::input::Input, found: &'a Statistics, notes: &'a [String]) -> Self {
        let reference = Reference::of(found.parts.iter().map(|own| {
            let part = &input.parts()[own.part];
            (&part.header, part.lattice)
        }));
        let all = found.parts.iter().filter_map(|part| part.bounds);
        let all = all.reduce(|(low, high), (a, b)| (low.min(a), high.max(b)));
        let sources =
            |part: usize| found.stations.iter().filter(|station| station.part == part).count();
        Self {
            points: found.parts.iter().map(|part| part.points).sum(),
            bounds: bounds(all, &reference.digits),
            system: reference.system.clone(),
            unit: reference.unit(),
            unit_is_stated: reference.says_unit(),
            spacing: Spacing { value: found.spacing, how: HOW_SPACING },
            parts: found
                .parts
                .iter()
                .enumerate()
                .map(|(number, own)| {
                    PartReport::new(&input.parts()[own.part], own, sources(number))
                })
                .collect(),
            strays: found.strays.clone(),
            stations: &found.stations,
            exposures: found.exposures.as_ref(),
            notes,
        }
    }

    fn text(&self) -> String {
        let mut out = String::new();
        for part in &self.parts {
            part.write(&mut out);
        }
        let mut line = |what: &str, value: String| push(&mut out, what, &value);
        if self.parts.len() > 1 {
            line("all", format!("{} points in {} parts", self.points, self.parts.len()));
            write_bounds(&mut line, &self.bounds, self.system.as_ref());
        }
        line("unit", unit_words(&self.unit, self.unit_is_stated));
        let value = self
            .spacing
            .value
            .map_or("unknown, fewer than two places".into(), |value| self.unit.length(value, 6));
        line("spacing", format!("{value} ({})", self.spacing.how));
        line("stations", self.stations.len().to_string());
        let exposures = self.exposures;
        for (number, station) in self.stations.iter().enumerate().take(LISTED) {
            let value = exposures
                .and_then(|exposures| exposures.values[number])
                .map_or(String::new(), |value| format!(", luminance {value:.1} of 255"));
            let balance = exposures.and_then(|exposures| exposures.balance.as_ref());
            let gain = gain(balance, number);
            line("", format!("{}: {} points{value}{gain}", station.name, station.points));
        }
        if let Some(balance) = exposures.and_then(|exposures| exposures.balance.as_ref()) {
            line("balance", uneven(balance));
        }
        if self.stations.len() > LISTED {
            line("", format!("and {} more; --json lists them all", self.stations.len() - LISTED));
        }
        for overlap in exposures.iter().flat_map(|exposures| &exposures.overlaps).take(LISTED) {
            let [one, two] = overlap.stations.map(|number| &self.stations[number].name);
            line(
                "overlap",
                format!(
                    "{two} is {:+.1} of 255 above {one} in {} cells; a gain of {:.3} removes that",
                    overlap.step, overlap.cells, overlap.gain
                ),
            );
        }
        if let Some(compared) = exposures.and_then(|exposures| exposures.compared) {
            let (compared, points) = (grouped(compared), grouped(self.points));
            line("overlaps", format!("of a sample of {compared} of {points} points"));
        }
        self.strays.note().into_iter().for_each(|said| line("strays", said));
        for note in self.notes {
            line("note", note.clone());
        }
        out.truncate(out.trim_end().len());
        out
    }
}

/// Formats a station's gain as the end of its line; empty if there is no balance.
pub fn gain(balance: Option<&Balance>, station: usize) -> String {
    balance.map_or(String::new(), |balance| format!(", gain {:.3}", balance.gains[station]))
}

/// Formats how far stations still differ after the balance.
pub fn uneven(balance: &Balance) -> String {
    format!(
        "with these gains stations differ by more than a quarter of a stop in {:.1} % of the cells that they share",
        100.0 * balance.uneven
    )
}

/// Formats the number of kinds, and the points of each.
pub fn listed(counts: impl ExactSizeIterator<Item = (u8, u64)>) -> String {
    let (kinds, more) = (counts.len(), if counts.len() > LISTED { ", ..." } else { "" });
    let listed: Vec<String> =
        counts.take(LISTED).map(|(kind, points)| format!("{kind} ({points})")).collect();
    format!("{kinds}: {}{more}", listed.join(", "))
}

/// Most stations, classes and return numbers that text lists.
pub const LISTED: usize = 16;

impl<'a> PartReport<'a> {
    fn new(part: &'a extract::input::Part, own: &PartStatistics, stations: usize) -> Self {
        Self {
            path: part.path.to_string_lossy().into_owned(),
            name: part.name.as_deref(),
            format: &part.header.format,
            points: own.points,
            header: &part.header,
            bounds: bounds(own.bounds, &Digits::of([part.lattice])),
            step: part.lattice.step,
            offset: part.lattice.offset,
            attributes: Attributes::new(part, own, stations),
            colors: Attribute::names_of(&part.header, own.available),
        }
    }

    fn write(&self, out: &mut String) {
        let _ = writeln!(
            out,
            "{}{}",
            self.path,
            self.name.map(|name| format!(", {name}")).unwrap_or_default()
        );
        let mut line = |what: &str, value: String| push(out, what, &value);
        line("format", self.format.into());
        let promised = self.header.points.filter(|&points| points != self.points);
        line(
            "points",
            format!(
                "{}{}",
                self.points,
                promised.map(|points| format!(" (header says {points})")).unwrap_or_default()
            ),
        );
        write_bounds(&mut line, &self.bounds, self.header.system.as_ref());
        if let Some([min, max]) = self.header.bounds {
            line("header", words(&Some(Bounds { min: min.into(), max: max.into() })));
        }
        line(
            "lattice",
            format!(
                "steps of {}, from {}",
                self.step.to_array().map(significant).join(" "),
                triple(self.offset)
            ),
        );
        self.attributes.write(&mut line);
        line("--color", scalar::listed(&self.colors));
        if let Some(system) = &self.header.system {
            line("crs", system_words(system));
        }
        for (what, value) in &self.header.facts {
            line(what, value.clone());
        }
        out.push('\n');
    }
}

impl Attributes {
    fn new(part: &extract::input::Part, own: &PartStatistics, stations: usize) -> Self {
        let share = |count: u64| count as f64 / own.points.max(1) as f64;
        let has = own.available;
        // Without points, the least and the largest colour are the wrong way round.
        let [rgb_min, rgb_max] = own.rgb.unwrap_or([[255; 3], [0; 3]]);
        Self {
            rgb: has.rgb.then(|| Rgb {
                bits: own.rgb_scale.bits(),
                scale: own.rgb_scale,
                min: rgb_min,
                max: rgb_max,
            }),
            intensity: own.intensity.filter(|_| has.intensity).map(|ends| {
                let [min, max] = ends.map(|end| cloud::intensity_of(end, part.intensity_range));
                Range { min, max }
            }),
            class: has.class.then(|| Class::list(&own.histograms)),
            returns: has
                .returns
                .then_some(Returns { most: own.most_returns, impossible: own.impossible_returns }),
            source: has.source.then_some(Sources { ids: stations }),
            gps_time: has.gps_time.then(|| Times {
                min: own.gps_time.map(|[min, _]| min),
                max: own.gps_time.map(|[_, max]| max),
                nan: own.no_time,
                nan_share: share(own.no_time),
            }),
            normal: has.normal.then(|| Normals { zero_share: share(own.no_normal) }),
            extra: part.header.extras.clone(),
        }
    }

    fn write(&self, line: &mut impl FnMut(&str, String)) {
        if let Some(Rgb { bits, scale, min, max }) = &self.rgb {
            line(
                "rgb",
                format!(
                    "{bits} bits, {scale}; red {}..{}, green {}..{}, blue {}..{} of 255",
                    min[0], max[0], min[1], max[1], min[2], max[2]
                ),
            );
        }
        if let Some(Range { min, max }) = &self.intensity {
            line("intensity", format!("{}..{}", digits::number(*min), digits::number(*max)));
        }
        if let Some(classes) = &self.class {
            line("classes", listed(classes.iter().map(|class| (class.class, class.points))));
        }
        if let Some(Returns { most, impossible }) = &self.returns {
            let odd = if *impossible > 0 {
                format!("; {impossible} points with an impossible return number")
            } else {
                String::new()
            };
            line("returns", format!("up to {most}{odd}"));
        }
        if let Some(Sources { ids }) = &self.source {
            line("sources", format!("{ids} point source ids"));
        }
        if let Some(Times { min, max, nan, .. }) = &self.gps_time {
            let nan = if *nan > 0 { format!("; {nan} are NaN") } else { String::new() };
            let range = min.zip(*max).map_or("none".into(), |(min, max)| {
                format!("{}..{}", digits::number(min), digits::number(max))
            });
            line("gps time", format!("{range}{nan}"));
        }
        if let Some(Normals { zero_share }) = &self.normal {
            line("normals", format!("{:.1} % are zero", zero_share * 100.0));
        }
        for Extra { name, min, max, missing } in &self.extra {
            let range =
                min.zip(*max).map_or("no number".into(), |(min, max)| format!("{min} to {max}"));
            let missing =
                if *missing > 0 { format!(", missing in {missing}") } else { String::new() };
            line("extra", format!("\"{name}\": {range}{missing}"));
        }
    }
}

fn push(out: &mut String, what: &str, value: &str) {
    let _ = writeln!(out, "  {what:<18} {value}");
}

fn bounds(bounds: Option<(DVec3, DVec3)>, digits: &Digits) -> Option<Bounds> {
    bounds.map(|(min, max)| Bounds { min: digits.round(min), max: digits.round(max) })
}

/// Formats a coordinate system, its units, and the plane its degrees are drawn in.
pub fn system_words(system: &Crs) -> String {
    let unit = match &system.unit {
        _ if system.plane.is_some() && system.degrees == Some(1.0) => ", in degrees".into(),
        Some(unit) if unit.is_metre() => ", in metres".into(),
        Some(unit) => format!(", in {} ({} m)", unit.name, unit.metres),
        None => ", in a unit that it does not name".into(),
    };
    let heights = system
        .height_unit
        .as_ref()
        .map(|unit| format!(", heights in {} ({} m)", unit.name, unit.metres))
        .unwrap_or_default();
    let plane = system.plane.map(|plane| format!("; {plane}")).unwrap_or_default();
    format!("{system}{unit}{heights}{plane}")
}

/// Writes two corners, and where they lie on the Earth if the files' degrees are drawn on a plane.
pub fn write_bounds(
    line: &mut dyn FnMut(&str, String),
    bounds: &Option<Bounds>,
    system: Option<&Crs>,
) {
    let (Some(plane), Some(Bounds { min, max })) = (system.and_then(|own| own.plane), bounds)
    else {
        return line("bounds", words(bounds));
    };
    line("bounds", format!("{}, in metres on a plane", words(bounds)));
    let degrees = |corner: DVec3| {
        plane.lonlat(corner).map(|angle| digits::number(digits::round(angle, 9))).join(" ")
    };
    line("in degrees", format!("{} to {}", degrees(*min), degrees(*max)));
}

/// Formats the unit of lengths.
pub fn unit_words(unit: &Unit, is_stated: bool) -> String {
    if unit.is_none() {
        return "unknown: these formats have none".into();
    }
    if is_stated { unit.name.clone() } else { format!("{}, assumed: no file states it", unit.name) }
}

/// Formats two corners.
pub fn words(bounds: &Option<Bounds>) -> String {
    bounds.as_ref().map_or("none".into(), |Bounds { min, max }| {
        format!("{} to {}", triple(*min), triple(*max))
    })
}

/// Formats a lattice step with nine significant digits, which hide the last bit of `f64`. A step
/// may be far below a nanometre.
fn significant(step: f64) -> String {
    let rounded: f64 = format!("{step:.8e}").parse().expect("a number as it was written");
    digits::number(rounded)
}

/// Formats a vector to nine decimals, which is finer than any scanner.
fn triple(v: DVec3) -> String {
    v.to_array().map(|v| digits::number(digits::round(v, 9))).join(" ")
}
