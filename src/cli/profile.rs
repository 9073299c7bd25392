//! `pointillist profile`: the points of a vertical slab between two places, as SVG and CSV. No
//! Vulkan device is opened.
//!
//! The points are read twice, for their ranges and for their picture and table, so that memory does
//! not grow with them.

use super::export;
use super::files::refuse_to_overwrite;
use super::filters::{ClipOptions, FilterOptions};
use super::options::{CacheOptions, ColorOptions, TextArguments};
use super::streams;
use super::units::{self, Size};
use crate::atomic_file::AtomicFile;
use crate::cloud::attribute::{Attribute, DisplayAttribute, percentiles};
use crate::cloud::colormap;
use crate::cloud::crs::Reference;
use crate::cloud::digits::Digits;
use crate::cloud::histograms::Histograms;
use crate::cloud::length::Length;
use crate::cloud::{ColumnSet, Station};
use crate::error::{Error, Result};
use crate::extract::Selection;
use crate::extract::input::{Batch, Input};
use crate::extract::profile::Table;
use crate::output::legend::Legend;
use crate::output::section::{self, Axes, Beside, Canvas, SectionPoint};
use crate::progress::Progress;
use crate::select::opacity::Opacities;
use crate::select::slab::Slab;
use glam::DVec2;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  pointillist profile scan.laz --from 500010,5000020 --to 500060,5000020 --width 1 -o p.svg
  pointillist profile scan.laz --from 0,0 --to 25,10 --width 0.2 -o p.svg -o p.csv
  pointillist profile site.pnti --from 0,0 --to 900,0 --width 5 --exaggeration 2 --color class --legend -o p.svg
  pointillist profile scan.laz --from 0,0 --to 50,0 --width 1 --only ground -o ground.csv";

/// A place on the map.
#[derive(Clone, Copy, Debug)]
pub struct Place(DVec2);

impl std::str::FromStr for Place {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Place, String> {
        let numbers: Vec<f64> = text.split(',').filter_map(|v| v.trim().parse().ok()).collect();
        match numbers[..] {
            [x, y] if x.is_finite() && y.is_finite() && text.matches(',').count() == 1 => {
                Ok(Place(DVec2::new(x, y)))
            }
            _ => Err(format!("{text:?} is not a place x,y")),
        }
    }
}

fn above_zero(text: &str) -> std::result::Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| *number > 0.0 && number.is_finite());
    number.ok_or(format!("{text:?} is not a number above 0"))
}

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Point clouds: LAS, LAZ, COPC, Potree 2, EPT, PLY, E57, OBJ, XYZ, CSV, TXT, PTS, PTX; or one
    /// index, PNTI
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Where the profile begins, in the coordinates of the files: degrees stay degrees
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true)]
    pub from: Place,
    /// Where it ends
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true)]
    pub to: Place,
    /// Width of the slab, in the files' unit, or such as 0.5m; metres for coordinates in degrees.
    /// Half of it lies on either side
    #[arg(long, value_name = "LENGTH", default_value = "1", value_parser = units::length, allow_hyphen_values = true)]
    pub width: Length,
    /// The files to write: a picture with axes, a table with a line a point. Repeatable
    #[arg(short, long, required = true, value_name = "OUT.svg|csv")]
    pub output: Vec<PathBuf>,
    /// How much larger heights are drawn than distances [default: a round number that fills the
    /// picture]
    #[arg(long, value_name = "FACTOR", value_parser = above_zero, allow_hyphen_values = true)]
    pub exaggeration: Option<f64>,
    /// Largest size of the picture, pixels. In a small one the legend is left out first, then parts
    /// of the words above and below
    #[arg(long, value_name = "WxH", default_value_t = Size(section::SIZE))]
    pub size: Size,
    /// What the points show [default: rgb if the files have it, else intensity, else elevation];
    /// ramps are those of the profile's points. The table has the files' own colours, intensities
    /// and times, and the numbers that the points show
    #[arg(
        long,
        value_name = "rgb|intensity|elevation|class|time|nir|height-above-ground|extra:NAME|..."
    )]
    pub color: Option<Attribute>,
    /// Colours of the numbers or labels that points show, beside the picture
    #[arg(long)]
    pub legend: bool,
    #[command(flatten)]
    pub filters: FilterOptions,
    #[command(flatten)]
    pub clips: ClipOptions,
    /// Refuse a truncated or inconsistent file instead of keeping what is readable
    #[arg(long)]
    pub strict: bool,
    #[command(flatten)]
    pub colors: ColorOptions,
    #[command(flatten)]
    pub text: TextArguments,
    #[command(flatten)]
    pub cache: CacheOptions,
}

/// Most pixels of a picture.
const PIXELS: f64 = 64e6;

/// Ranges of the points of a profile.
struct Ranges {
    points: u64,
    heights: [f64; 2],
    /// Times or scalars, if the points show these.
    numbers: [f64; 2],
    /// Points of each intensity.
    intensities: Vec<u64>,
    /// True if a point has a colour other than black; a file of black points has none.
    has_colors: bool,
    /// Points of each class, of each return number and of each source.
    labels: [BTreeMap<u16, u64>; 3],
}

/// A file that is written.
struct Output {
    path: PathBuf,
    whole: AtomicFile,
}

impl Arguments {
    fn outputs(&self, ending: &str) -> Result<Vec<Output>> {
        let is_one =
            |path: &&PathBuf| path.extension().is_some_and(|own| own.eq_ignore_ascii_case(ending));
        let create =
            |path: &PathBuf| Ok(Output { path: path.clone(), whole: AtomicFile::create(path)? });
        self.output.iter().filter(is_one).map(create).collect()
    }

    /// Returns what the points show.
    fn shown(&self, has: ColumnSet, ranges: &Ranges) -> Result<DisplayAttribute> {
        let stretch = percentiles(&ranges.intensities);
        let varies = has.intensity && stretch[1] > stretch[0];
        let usual = match () {
            () if has.rgb && ranges.has_colors => Attribute::Rgb,
            () if varies => Attribute::Intensity,
            () => Attribute::Elevation,
        };
        let attribute = self.color.unwrap_or(usual);
        let name = attribute.name();
        if attribute == Attribute::Corrected {
            return Err(Error::Request(format!(
                "--color {name} is not drawn in profiles; use another, such as rgb"
            )));
        }
        let is_there = match attribute {
            Attribute::Scalar(scalar) => has.scalars.has(scalar),
            _ => has.and(attribute.wanted()) == has,
        };
        if !is_there {
            return Err(Error::Request(format!(
                "--color {name}: the points do not have it; `pointillist info` lists their attributes"
            )));
        }
        Ok(match attribute {
            Attribute::Elevation => {
                DisplayAttribute::indexed(attribute, ranges.heights, [0, u16::MAX.into()])
            }
            Attribute::Intensity => DisplayAttribute::indexed(attribute, [0.0; 2], stretch),
            _ if attribute.is_spread() => {
                DisplayAttribute::indexed(attribute, ranges.numbers, [0, u16::MAX.into()])
            }
            _ => DisplayAttribute::indexed(attribute, [0.0; 2], [0, 255]),
        })
    }
}

pub fn run(arguments: &Arguments, progress: &dyn Progress) -> Result<()> {
    arguments.cache.use_for_servers(progress);
    for output in &arguments.output {
        refuse_to_overwrite(output, &arguments.files)?;
        let ending = output.extension().map(|own| own.to_string_lossy().to_lowercase());
        if !matches!(ending.as_deref(), Some("svg" | "csv")) {
            return Err(Error::Request(format!(
                "cannot write {}: its name must end in .svg or .csv",
                output.display()
            )));
        }
    }
    let ends = [arguments.from, arguments.to].map(|Place(place)| place);
    if ends[0] == ends[1] {
        return Err(Error::Request("--from and --to are the same place".into()));
    }
    let widest = f64::from(arguments.size.0[0]);
    let most = section::room(arguments.size.0);
    if most.min_element() < 50.0 || most.x * most.y > PIXELS {
        return Err(Error::Request(format!(
            "--size {}: a profile needs 250x200 pixels at least, and {} million at most",
            arguments.size,
            PIXELS / 1e6
        )));
    }
    let (pictures, tables) = (arguments.outputs("svg")?, arguments.outputs("csv")?);
    let filter = arguments.filters.filter();
    let wanted = arguments.color.map(Attribute::wanted).unwrap_or_default().and(filter.wanted());
    let options = export::reading(&arguments.text, &arguments.colors, wanted, arguments.strict);
    let input = export::open(&arguments.files, &options, progress)?;
    let reference = input.reference();
    let width = units::counted("--width", arguments.width, &reference.unit());
    let [from, to] = ends.map(|end| reference.drawn(end).extend(0.0));
    let slab = Slab::new(from, to, width)
        .ok_or_else(|| Error::Request("--from and --to are nearly the same place".into()))?;
    let selection = Selection {
        filter,
        clips: arguments.clips.clips(),
        opacities: Opacities::default(),
        slab: Some(slab),
    };
    input.check(&selection.filter)?;
    let (ranges, notes) = ranges(&input, &selection, arguments.color, progress)?;
    notes.iter().for_each(streams::note);
    if ranges.points == 0 {
        return Err(Error::Request(nothing(&input, arguments, &slab)));
    }
    let parts = input.parts();
    let has = parts.iter().fold(ColumnSet::default(), |has, part| has.and(part.available));
    let shown = arguments.shown(has, &ranges)?;
    let legend = if arguments.legend { ranges.legend(&shown, &reference) } else { None };
    let has_legend = legend.is_some();
    let legend = legend.and_then(|legend| Beside::fitting(legend, most));
    if has_legend && legend.is_none() && !pictures.is_empty() {
        streams::note(format_args!(
            "--size {} has no room for the legend, which is left out",
            arguments.size
        ));
    }
    let most = most - DVec2::new(legend.as_ref().map_or(0.0, Beside::width), 0.0);
    let axes = Axes::fitting(slab.length, ranges.heights, arguments.exaggeration, most, &reference);
    let mut canvas = (!pictures.is_empty()).then(|| Canvas::new(&axes));
    let wrote = |path: &Path| {
        let path = path.to_owned();
        move |error| Error::io("write", &path, error)
    };
    let table = Table::new(&input, slab, Some(shown.attribute));
    let mut files = Vec::new();
    for Output { path, whole } in &tables {
        let file = File::create(whole.partial()).map_err(wrote(path))?;
        let mut file = BufWriter::new(file);
        file.write_all(table.head().as_bytes()).map_err(wrote(path))?;
        files.push(file);
    }
    let side = section::side(&axes, ranges.points);
    let map = |batch: &Batch| {
        let lines = if tables.is_empty() { String::new() } else { table.lines(batch) };
        Ok((points(&input, batch, &slab, &shown), lines))
    };
    let mut take = |(points, lines): (Vec<SectionPoint>, String)| {
        canvas
            .iter_mut()
            .for_each(|canvas| points.iter().for_each(|point| canvas.draw(&axes, point, side)));
        files.iter_mut().zip(&tables).try_for_each(|(file, table)| {
            file.write_all(lines.as_bytes()).map_err(wrote(&table.path))
        })
    };
    input.each(&selection, progress, &map, &mut take)?;
    let unit = reference.unit();
    let said = format!(
        "profile: {} points, {} long, {} wide",
        ranges.points,
        unit.length(slab.length, 3),
        unit.length(slab.width, 3)
    );
    if let Some(canvas) = canvas {
        let count = format!("{} points", ranges.points);
        let titles = [said.clone(), format!("{count}, {}", unit.length(slab.length, 3)), count];
        let svg = section::svg(&axes, &titles, &canvas, legend.as_ref(), widest);
        for Output { path, whole } in pictures {
            std::fs::write(whole.partial(), &svg).map_err(wrote(&path))?;
            whole.finish()?;
        }
    }
    for (mut file, Output { path, whole }) in files.into_iter().zip(tables) {
        file.flush().map_err(wrote(&path))?;
        whole.finish()?;
    }
    streams::say(said);
    Ok(())
}

/// Returns the points of a batch that are left.
fn points(
    input: &Input,
    batch: &Batch,
    slab: &Slab,
    shown: &DisplayAttribute,
) -> Vec<SectionPoint> {
    let (lattice, columns) = (&input.parts()[batch.part].lattice, batch.columns);
    let point = |&i: &u32| {
        let i = i as usize;
        let position = lattice.world(batch.steps(i));
        let word = match shown.attribute {
            Attribute::Elevation => shown.place(position.z),
            _ => shown.word_of(columns, lattice, i),
        };
        Some(SectionPoint {
            place: slab.place(position)?,
            height: position.z,
            color: colormap::color_of(shown, word),
        })
    };
    batch.left.iter().filter_map(point).collect()
}

/// Height, intensity, and time or scalar of a point.
type Numbers = (f64, u16, f64);

/// Returns the class of a point, its return number and its source.
fn labels(batch: &Batch, i: usize) -> [u16; 3] {
    let byte = |column: &Option<Vec<u8>>| column.as_ref().map_or(0, |column| column[i]);
    let columns = batch.columns;
    [byte(&columns.class).into(), (byte(&columns.returns) & 15).into(), batch.source(i)]
}

impl Ranges {
    /// Returns the legend of what the points show.
    fn legend(&self, shown: &DisplayAttribute, reference: &Reference) -> Option<Legend> {
        let [classes, returns, sources] = &self.labels;
        let bytes = |counts: &BTreeMap<u16, u64>| {
            counts.iter().map(|(&label, &points)| (label as u8, points)).collect()
        };
        let counts = Histograms { classes: bytes(classes), returns: bytes(returns) };
        let station = |(&source, &points): (&u16, &u64)| Station {
            part: 0,
            source: Some(source),
            name: format!("source {source}"),
            points,
        };
        let stations: Vec<Station> = sources.iter().map(station).collect();
        Legend::of(shown, reference, &counts, &stations)
    }
}

fn ranges(
    input: &Input,
    selection: &Selection,
    color: Option<Attribute>,
    progress: &dyn Progress,
) -> Result<(Ranges, Vec<String>)> {
    let mut ranges = Ranges {
        points: 0,
        heights: [f64::INFINITY, f64::NEG_INFINITY],
        numbers: [f64::INFINITY, f64::NEG_INFINITY],
        intensities: vec![0; 1 << 16],
        has_colors: false,
        labels: Default::default(),
    };
    let map = |batch: &Batch| {
        let lattice = &input.parts()[batch.part].lattice;
        let numbers = color.and_then(|color| color.numbers_of(batch.columns));
        let of = |&i: &u32| {
            let i = i as usize;
            let number = numbers.map_or(f64::NAN, |numbers| numbers[i]);
            let intensity = batch.columns.intensity.as_ref().map_or(0, |column| column[i]);
            (lattice.world(batch.steps(i)).z, intensity, number)
        };
        let colors = batch.columns.rgb.as_ref();
        let has_color = |&i: &u32| colors.is_some_and(|colors| colors[i as usize] != [0; 3]);
        let points = batch.left.iter().map(of).collect::<Vec<_>>();
        let labels = batch.left.iter().map(|&i| labels(batch, i as usize)).collect::<Vec<_>>();
        Ok((points, labels, batch.left.iter().any(has_color)))
    };
    let mut take = |(points, labels, has_colors): (Vec<Numbers>, Vec<[u16; 3]>, bool)| {
        ranges.has_colors |= has_colors;
        for of_point in labels {
            let counts = ranges.labels.iter_mut().zip(of_point);
            counts.for_each(|(counts, label)| *counts.entry(label).or_default() += 1);
        }
        ranges.points += points.len() as u64;
        for (height, intensity, number) in points {
            // Neither end becomes NaN.
            let [least, most] = ranges.numbers;
            ranges.numbers = [least.min(number), most.max(number)];
            let [lo, hi] = ranges.heights;
            ranges.heights = [lo.min(height), hi.max(height)];
            ranges.intensities[intensity as usize] += 1;
        }
        Ok(())
    };
    let notes = input.each(selection, progress, &map, &mut take)?;
    Ok((ranges, notes))
}

/// Describes a profile without points, and where there are some.
fn nothing(input: &Input, arguments: &Arguments, slab: &Slab) -> String {
    // On the lattices of the files.
    let bounds = input.parts().iter().filter_map(|part| Some((part.bounds?, part.own)));
    let rounded = bounds.map(|((low, high), own)| {
        let digits = Digits::of([own]);
        [low, high].map(|corner| digits.round(corner))
    });
    let whole = rounded.reduce(|[low, high], [a, b]| [low.min(a), high.max(b)]);
    let there = whole.map_or(String::new(), |[low, high]| {
        format!("; the points lie between {},{} and {},{}", low.x, low.y, high.x, high.y)
    });
    let [from, to] = [arguments.from.0, arguments.to.0];
    format!(
        "no point is left within {} of the line from {},{} to {},{}{there}",
        input.reference().unit().length(slab.width / 2.0, 3),
        from.x,
        from.y,
        to.x,
        to.y
    )
}
