//! `pointillist raster`: files or an index in; a map of heights, intensities, counts or colours
//! out, complete or absent. No Vulkan device is opened.

use super::export;
use super::files::{check_extension, refuse_to_overwrite};
use super::filters::{ClipOptions, FilterOptions};
use super::named::named;
use super::options::{CacheOptions, ColorOptions, TextArguments};
use super::streams;
use super::units::{self, Bytes};
use crate::cloud::ReadOptions;
use crate::cloud::crs::Crs;
use crate::cloud::digits;
use crate::cloud::filter::grouped;
use crate::cloud::length::Length;
use crate::cloud::scalar::Scalar;
use crate::error::{Error, Result};
use crate::extract::Selection;
use crate::extract::extent::extent;
use crate::extract::raster::{self, Filled, NoData, Pick, Request, Value};
use crate::names::Named;
use crate::output::geotiff::{self, Map, Sample};
use crate::progress::Progress;
use crate::select::opacity::{Opacities, Rule};
use crate::view::map::{Extent, MapGrid};
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  pointillist raster scan.laz -o surface.tif --resolution 0.5 --only return=first    the highest first returns
  pointillist raster scan.laz -o ground.tif --resolution 1 --only ground --pick mean
  pointillist raster scan.laz -o lowest.tif --resolution 1 --only return=last --pick lowest
  pointillist raster scan.laz -o density.tif --resolution 1 --value count
  pointillist raster scan.laz -o ground.tif --resolution 1 --only ground --no-data nan
  pointillist raster scan.laz -o colors.tif --resolution 0.1 --value rgb
  pointillist raster scan.laz -o strips.tif --resolution 0.5 --value intensity --only source=706
  pointillist raster scan.laz -o canopy.tif --resolution 1 --value height-above-ground
  pointillist raster site.pnti -o part.tif --resolution 0.25 --extent 645000,5100000,645500,5100500

Cells are the points' own: nothing is filled between them. Pictures of filled, shaded surfaces as maps:
  pointillist render scan.laz -o map.tif --view top --resolution 0.25";

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Point clouds: LAS, LAZ, COPC, Potree 2, EPT, PLY, E57, OBJ, XYZ, CSV, TXT, PTS, PTX; or one
    /// index, PNTI
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// The GeoTIFF to write
    #[arg(short, long, value_name = "OUT.tif")]
    pub output: PathBuf,
    /// Side of a cell, in the files' unit, or such as 0.5m; metres for coordinates in degrees.
    /// Edges of cells are multiples of it
    #[arg(long, value_name = "LENGTH", value_parser = units::length, allow_hyphen_values = true)]
    pub resolution: Length,
    /// Values of the cells: heights, intensities or scalars as 32-bit floating point, numbers of
    /// points as 32-bit unsigned, colours as 8 bits a channel with an alpha of 0 where there are no
    /// points
    #[arg(long, value_name = "height|intensity|count|rgb|nir|scan-angle|height-above-ground|extra:NAME", default_value_t = Value::Height)]
    pub value: Value,
    /// Which of a cell's points gives the value
    #[arg(long, value_parser = named::<Pick>(), default_value = Pick::Highest.name())]
    pub pick: Pick,
    /// Value of cells without points, a number or nan, which the file states as GDAL_NODATA
    /// [default: -9999; counts have 0, which is not stated]. Colours have an alpha of 0 instead
    #[arg(long, value_name = "NUMBER|nan", allow_hyphen_values = true)]
    pub no_data: Option<NoData>,
    /// West, south, east and north of the map, in the coordinates of the files, widened to whole
    /// cells [default: around all points that are left, but strays]
    #[arg(long, value_name = "X0,Y0,X1,Y1", allow_hyphen_values = true)]
    pub extent: Option<Extent>,
    /// Memory for cells; larger maps read the files several times
    #[arg(long, value_name = "BYTES", default_value_t = MEMORY)]
    pub memory: Bytes,
    #[command(flatten)]
    pub filters: FilterOptions,
    #[command(flatten)]
    pub clips: ClipOptions,
    /// Leave out what has opacity 0, as `render --opacity` draws it. Repeatable
    #[arg(
        long,
        value_name = "[class:N|return:N|station:S|file:F=]OPACITY",
        allow_hyphen_values = true
    )]
    pub opacity: Vec<Rule>,
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

/// Memory for cells, unless it is set.
pub const MEMORY: Bytes = Bytes(1 << 30);

/// Most cells of a side, as other programs read them.
const LARGEST_SIDE: u32 = i32::MAX as u32;

/// Most cells of a map, as many as 262,144 on each side: 256 GiB of heights before compression.
const MOST_CELLS: u64 = 1 << 36;

/// Cells a point from which on a note asks whether the map is meant to be so large.
const SPARSE: u64 = 64;

pub fn run(arguments: &Arguments, progress: &dyn Progress) -> Result<()> {
    arguments.cache.use_for_servers(progress);
    let Arguments { output, resolution, value, pick, .. } = arguments;
    refuse_to_overwrite(output, &arguments.files)?;
    check_extension(output, &["tif", "tiff"])?;
    let no_data = value.no_data(arguments.no_data)?;
    let no_data_text = no_data.map(|own| own.text(*value));
    let (filter, clips) = (arguments.filters.filter(), arguments.clips.clips());
    let opacities = Opacities(arguments.opacity.clone());
    let selection = Selection { filter, clips, opacities, ..Selection::default() };
    let options = ReadOptions {
        text: arguments.text.options(),
        rgb_range: arguments.colors.rgb_range,
        ..ReadOptions::new(selection.wanted().and(value.wanted()), arguments.strict)
    };
    let input = export::open(&arguments.files, &options, progress)?;
    // The points' own extent, since headers may be wrong.
    let found = extent(&input, &selection, progress)?;
    let Some(found) = found else { return Err(selection.leaves_none(&input, progress)) };
    found.notes.iter().for_each(streams::note);
    let (parts, reference) = (input.parts(), input.reference());
    let resolution = units::counted("--resolution", *resolution, &reference.unit());
    let grid = match arguments.extent {
        Some(extent) => {
            let extent = extent.map(|corner| reference.drawn(corner));
            MapGrid::covering(extent, resolution, LARGEST_SIDE)?
        }
        None => {
            if found.strays > 0 {
                streams::note(format_args!(
                    "points far outside of all others, {} of {}, are left out of the map; --extent maps them too",
                    grouped(found.strays),
                    grouped(found.points)
                ));
            }
            let [low, high] = found.corners;
            MapGrid::around(low, high, resolution, LARGEST_SIDE)?
        }
    };
    if grid.cells() > MOST_CELLS {
        let [width, height] = grid.size;
        return Err(Error::Request(format!(
            "the map would have {} x {} cells, {resolution} wide, for {} points, more than {} cells in all; --extent, --clip or --not noise map a part of the points, --resolution {} all of them",
            grouped(width.into()),
            grouped(height.into()),
            grouped(found.points),
            grouped(MOST_CELLS),
            coarser(&grid)
        )));
    }
    if grid.cells() > SPARSE * found.points {
        streams::note(format_args!(
            "the map has {} x {} cells for {} points; where some points are far outside, --extent, --clip or --not noise leave them out",
            grid.size[0],
            grid.size[1],
            grouped(found.points)
        ));
    }
    let (unit, name) = (reference.height_unit(), value.to_string());
    let map = Map {
        grid,
        system: reference.system.as_ref(),
        text: parts.first().and_then(|part| Crs::text_of(&part.header)),
        sample: match value {
            Value::Height | Value::Intensity | Value::Scalar(_) => Sample::Float,
            Value::Count => Sample::Count,
            Value::Rgb => Sample::Byte,
        },
        bands: if *value == Value::Rgb { 4 } else { 1 },
        named: match value {
            Value::Height => Some(("height", unit.symbol())),
            Value::Intensity => Some(("intensity", "")),
            Value::Count => Some(("points", "")),
            Value::Scalar(Scalar::HeightAboveGround) => Some((name.as_str(), unit.symbol())),
            Value::Scalar(_) => Some((name.as_str(), "")),
            Value::Rgb => None,
        },
        no_data: no_data_text.as_deref(),
        has_heights: *value == Value::Height,
    };
    note_system(map.system);
    let memory = arguments.memory.0;
    let request = Request { grid, value: *value, pick: *pick, no_data, memory };
    let filled = geotiff::write(output, &map, |put| {
        raster::raster(&input, &selection, &request, progress, put)
    })?;
    if let (Some(text), 1..) = (&no_data_text, filled.ambiguous) {
        streams::note(format_args!(
            "{} cells with points have the value of those without, {text}; give another --no-data",
            grouped(filled.ambiguous)
        ));
    }
    streams::say(line(output, &grid, &filled));
    Ok(())
}

/// Returns a resolution of one digit at which a map has few enough cells.
fn coarser(grid: &MapGrid) -> f64 {
    // A cell more on each side, as edges may lie otherwise.
    let [width, height] = grid.size.map(|side| f64::from(side) + 2.0);
    let least = grid.resolution * (width * height / MOST_CELLS as f64).sqrt();
    let place = 10f64.powi(least.log10().floor() as i32);
    digits::round((least / place).ceil() * place, 9)
}

/// Says what a map cannot state of its coordinate system.
pub fn note_system(system: Option<&Crs>) {
    match system {
        None => streams::note(format_args!(
            "the files state no one coordinate system, so the map has none"
        )),
        Some(system) if system.epsg.is_none() => streams::note(format_args!(
            "the coordinate system \"{}\" has no EPSG number; the map has its name, and its definition where the files have it as text",
            system.title()
        )),
        Some(_) => {}
    }
}

fn line(output: &Path, grid: &MapGrid, filled: &Filled) -> String {
    let ([width, height], cells) = (grid.size, grid.cells());
    format!(
        "{}: {width} x {height} cells of {}, {:.1} % with points; {} points",
        output.display(),
        grid.resolution,
        100.0 * filled.cells as f64 / cells as f64,
        grouped(filled.points)
    )
}
