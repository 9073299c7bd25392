//! `pointillist index`: files in, one index out, complete or absent.

use super::files::{check_extension, refuse_to_overwrite};
use super::options::{CacheOptions, ColorOptions, TextArguments};
use super::streams;
use super::units::Bytes;
use crate::cloud::ColumnSet;
use crate::cloud::attribute::Attribute;
use crate::cloud::scalar::Scalar;
use crate::config;
use crate::error::{Error, Result};
use crate::index::build::{self, DerivedPlanes, Options, Summary};
use crate::progress::Progress;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  pointillist index scan.laz -o scan.pnti
  pointillist index north.laz south.laz -o site.pnti         one cloud, two stations
  pointillist index huge.las -o huge.pnti --memory 512MiB    slower, in as little memory
  pointillist index scan.laz -o scan.pnti --normals          planes fitted to the points around each
  pointillist render scan.pnti -o out.png

The folder of OUT.pnti needs room for the index, about 16 bytes a point, and while it is built about 24 more for points beyond --memory.";

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Point clouds: LAS, LAZ, COPC, Potree 2, EPT; also PLY, E57, OBJ, XYZ, CSV, TXT, PTS, PTX, which are read
    /// into memory whole
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// The index to write
    #[arg(short, long, value_name = "OUT.pnti")]
    pub output: PathBuf,
    /// Memory for points while building, at least 64MiB; what does not fit goes to a temporary file
    /// beside the index
    #[arg(long, value_name = "BYTES", default_value_t = Bytes(config::INDEX_MEMORY))]
    pub memory: Bytes,
    /// Threads [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub threads: Option<u32>,
    /// Keep GPS times, 8 bytes a point
    #[arg(long)]
    pub gps_time: bool,
    /// Keep a number of each point for --color, 8 bytes a point: nir, scan-angle, extra:NAME; or
    /// time, as --gps-time does
    #[arg(long, value_name = "NAME", value_parser = kept, conflicts_with = "gps_time")]
    pub keep: Option<Attribute>,
    /// Compute normals where files have none, from a plane through the points around each: for
    /// `phong` and `--color normal`; 4 bytes a point
    #[arg(long)]
    pub normals: bool,
    /// Compute colours whose luminance agrees between stations, V averaged over the 40 nearest
    /// points, for `--color corrected`; 3 bytes a point
    #[arg(long)]
    pub luminance: bool,
    /// Compute strokes for `--style strokes`; with normals 8 bytes a point
    #[arg(long)]
    pub strokes: bool,
    /// Refuse a truncated or inconsistent file instead of keeping what is readable
    #[arg(long)]
    pub strict: bool,
    #[command(flatten)]
    pub colors: ColorOptions,
    /// Print a summary as JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub text: TextArguments,
    #[command(flatten)]
    pub cache: CacheOptions,
}

/// The least `--memory`: a chunk of the least size has to fit.
const LEAST_MEMORY: u64 = 64 << 20;

impl Arguments {
    pub fn options(&self) -> Result<Options> {
        if self.memory.0 < LEAST_MEMORY {
            return Err(Error::Request(format!(
                "--memory {} is too little; give at least 64MiB",
                self.memory
            )));
        }
        let usual = Options::usual(self.strict);
        let threads = self.threads.map_or(usual.threads, |threads| threads as usize);
        let derive = DerivedPlanes {
            normals: self.normals,
            strokes: self.strokes,
            luminance: self.luminance,
        };
        let kept = self.keep.map(Attribute::wanted).unwrap_or_default();
        let gps_time = self.gps_time || kept.gps_time;
        let wanted = ColumnSet { gps_time, scalars: kept.scalars, ..usual.wanted };
        let (text, rgb_range) = (self.text.options(), self.colors.rgb_range);
        Ok(Options { memory: self.memory.0, threads, wanted, text, rgb_range, derive, ..usual })
    }
}

/// Parses `--keep`.
fn kept(text: &str) -> std::result::Result<Attribute, String> {
    match text.parse()? {
        Attribute::Scalar(Scalar::HeightAboveGround) => {
            Err("heights above ground are not kept: they are found of any index".into())
        }
        kept @ (Attribute::Time | Attribute::Scalar(_)) => Ok(kept),
        other => Err(format!("{} is kept without being asked for", other.name())),
    }
}

pub fn run(arguments: &Arguments, progress: &dyn Progress) -> Result<()> {
    arguments.cache.use_for_servers(progress);
    refuse_to_overwrite(&arguments.output, &arguments.files)?;
    check_extension(&arguments.output, &["pnti"])?;
    let summary =
        build::build(&arguments.files, &arguments.output, &arguments.options()?, progress)?;
    summary.notes.iter().for_each(streams::note);
    if arguments.json {
        streams::print(&format!(
            "{}\n",
            serde_json::to_string_pretty(&summary)
                .map_err(|error| Error::Request(error.to_string()))?
        ))?;
        return Ok(());
    }
    let Summary { points, nodes, leaves, bytes, seconds, derive_seconds, spilled_bytes, .. } =
        summary;
    let per_point = |bytes: u64| bytes as f64 / points.max(1) as f64;
    streams::say(format_args!(
        "{}: {points} points in {leaves} leaves and {} inner nodes, {} MiB ({:.1} bytes a point), {seconds:.1} s ({:.1} M points/s){}{}",
        arguments.output.display(),
        nodes - leaves,
        bytes >> 20,
        per_point(bytes),
        points as f64 / seconds / 1e6,
        if derive_seconds > 0.0 {
            format!(", {derive_seconds:.1} s of these for normals, strokes and luminance")
        } else {
            String::new()
        },
        if spilled_bytes > 0 {
            format!(", {} MiB through a temporary file", spilled_bytes >> 20)
        } else {
            String::new()
        }
    ));
    Ok(())
}
