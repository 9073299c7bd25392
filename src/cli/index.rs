//! `pointillist index`: files in, one index out, complete or absent; or a plan, and its jobs.

use super::files::{check_extension, refuse_to_overwrite};
use super::options::{CacheOptions, ColorOptions, TextArguments};
use super::streams;
use super::units::Bytes;
use crate::cloud::ColumnSet;
use crate::cloud::attribute::Attribute;
use crate::cloud::filter::grouped;
use crate::cloud::scalar::Scalar;
use crate::config;
use crate::error::{Error, Result};
use crate::index::build::plan::{self, Plan, PlanSummary};
use crate::index::build::{self, DerivedPlanes, JobSummary, Options, Summary};
use crate::progress::Progress;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  pointillist index scan.laz -o scan.pnti
  pointillist index north.laz south.laz -o site.pnti         one cloud, two stations
  pointillist index huge.las -o huge.pnti --memory 512MiB    slower, in as little memory
  pointillist index scan.laz -o scan.pnti --normals          planes fitted to the points around each
  pointillist render scan.pnti -o out.png

On several machines, which share the files (tools/cluster has them as a workflow):
  pointillist index tiles/*.laz --plan site.json             cuts the work into jobs and says how many
  pointillist index --plan site.json --job 3                 does one of them: site.3.part
  pointillist index --plan site.json --merge -o site.pnti    once all parts are there

The folder of OUT.pnti needs room for the index, about 16 bytes a point, and while it is built about 24 more for points beyond --memory.";

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Point clouds: LAS, LAZ, COPC, Potree 2, EPT, PLY, E57, OBJ, XYZ, CSV, TXT, PTS, PTX
    #[arg(required_unless_present_any = ["job", "merge"], value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// The index to write
    #[arg(short, long, value_name = "OUT.pnti", required_unless_present = "plan")]
    pub output: Option<PathBuf>,
    /// Cut the work into jobs that know nothing of each other, and write what they have in common;
    /// with --job or --merge, read it
    #[arg(long, value_name = "PLAN.json")]
    pub plan: Option<PathBuf>,
    /// Do one job of the plan, of 1 to as many as it has; writes PLAN.N.part, or --output
    #[arg(long, value_name = "N", requires = "plan", conflicts_with_all = PLANNED)]
    pub job: Option<usize>,
    /// Merge the parts of all jobs, PLAN.N.part or FILE..., into the index
    #[arg(long, requires_all = ["plan", "output"], conflicts_with_all = PLANNED)]
    pub merge: bool,
    /// Most points of a job
    #[arg(long, value_name = "N", requires = "plan", default_value_t = JOB_POINTS)]
    pub job_points: u64,
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

/// Options that a plan has settled.
const PLANNED: [&str; 11] = [
    "job_points",
    "rgb_range",
    "gps_time",
    "keep",
    "normals",
    "luminance",
    "strokes",
    "strict",
    "columns",
    "delimiter",
    "scalar",
];

const JOB_POINTS: u64 = 50_000_000;

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
    let Arguments { files, output, .. } = arguments;
    match (&arguments.plan, output) {
        (Some(plan), _) if arguments.job.is_some() || arguments.merge => {
            run_planned(arguments, plan, progress)
        }
        (Some(_), Some(output)) => Err(Error::Request(format!(
            "--plan writes no index; leave out -o {}, and give it to --merge",
            output.display()
        ))),
        (Some(plan), None) => run_plan(arguments, plan, progress),
        (None, Some(output)) => {
            refuse_to_overwrite(output, files)?;
            check_extension(output, &["pnti"])?;
            report(arguments, output, build::build(files, output, &arguments.options()?, progress)?)
        }
        (None, None) => Err(Error::Request("name the index to write with -o".into())),
    }
}

/// Plans jobs.
fn run_plan(arguments: &Arguments, plan: &Path, progress: &dyn Progress) -> Result<()> {
    refuse_to_overwrite(plan, &arguments.files)?;
    check_extension(plan, &["json"])?;
    let options = arguments.options()?;
    let planned = plan::plan(&arguments.files, plan, &options, arguments.job_points, progress)?;
    if arguments.json {
        return print_json(&planned);
    }
    let PlanSummary { jobs, points, most_points } = planned;
    let name = plan.display();
    streams::say(format_args!(
        "{name}: {} points in {jobs} jobs of at most {}; run `pointillist index --plan {name} --job N` for every N from 1 to {jobs}, then `pointillist index --plan {name} --merge -o OUT.pnti`",
        grouped(points),
        grouped(most_points)
    ));
    Ok(())
}

/// Does a job of a plan, or merges the parts of all.
fn run_planned(arguments: &Arguments, path: &Path, progress: &dyn Progress) -> Result<()> {
    let Arguments { files, output, .. } = arguments;
    let plan = Plan::read(path)?;
    let options = arguments.options()?;
    let mut inputs: Vec<PathBuf> = plan.files.iter().map(|file| file.path.clone()).collect();
    inputs.push(path.to_owned());
    let Some(number) = arguments.job else {
        let made = |number| plan::part_path(path, number);
        let parts: Vec<PathBuf> = match files.is_empty() {
            true => (1..=plan.summary().jobs).map(made).collect(),
            false => files.clone(),
        };
        let output = output.as_deref().expect("required by --merge");
        inputs.extend_from_slice(&parts);
        refuse_to_overwrite(output, &inputs)?;
        check_extension(output, &["pnti"])?;
        return report(arguments, output, build::merge(&plan, &parts, output, &options, progress)?);
    };
    if !files.is_empty() {
        return Err(Error::Request("the files of a job are in its plan; leave them out".into()));
    }
    let output = output.clone().unwrap_or_else(|| plan::part_path(path, number));
    refuse_to_overwrite(&output, &inputs)?;
    check_extension(&output, &["part"])?;
    let done = build::job(&plan, number, &output, &options, progress)?;
    if arguments.json {
        return print_json(&done);
    }
    let JobSummary { points, nodes, bytes, seconds } = done;
    streams::say(format_args!(
        "{}: {} points in {nodes} nodes, {} MiB, {seconds:.1} s",
        output.display(),
        grouped(points),
        bytes >> 20
    ));
    Ok(())
}

fn print_json(summary: &impl serde::Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(summary);
    streams::print(&format!("{}\n", text.map_err(|error| Error::Request(error.to_string()))?))
}

/// Prints the summary of an index.
fn report(arguments: &Arguments, output: &Path, summary: Summary) -> Result<()> {
    summary.notes.iter().for_each(streams::note);
    if arguments.json {
        return print_json(&summary);
    }
    let Summary { points, nodes, leaves, bytes, seconds, derive_seconds, spilled_bytes, .. } =
        summary;
    let per_point = |bytes: u64| bytes as f64 / points.max(1) as f64;
    streams::say(format_args!(
        "{}: {points} points in {leaves} leaves and {} inner nodes, {} MiB ({:.1} bytes a point), {seconds:.1} s ({:.1} M points/s){}{}",
        output.display(),
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
