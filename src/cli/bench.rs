//! `pointillist bench`: times of passes against other ways of doing the same.

use super::options::{DetailOptions, DeviceOptions, Size};
use crate::bench::{self, flight, project};
use crate::error::{Error, Result};
use crate::progress::Progress;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  pointillist bench                                        all that need no file
  pointillist bench project --points 1000000 --size 1024x1024
  pointillist bench --json > before.json                   keep the rows ...
  pointillist bench --baseline before.json                 ... and compare with them later
  pointillist bench flight --index site.pnti --pool 128MiB a camera flight through more than the device may hold";

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Which benchmarks to run [default: project, and with --index also flight]: project, flight
    #[arg(value_name = "NAME", value_parser = ["project", "flight"])]
    pub names: Vec<String>,
    /// Numbers of points
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_values_t = [1_000_000, 10_000_000], value_parser = clap::value_parser!(u64).range(1..=2_000_000_000))]
    pub points: Vec<u64>,
    /// Sizes of the picture, pixels
    #[arg(long, value_name = "WxH,...", value_delimiter = ',', default_values_t = [Size([1024, 1024]), Size([1920, 1080])])]
    pub size: Vec<Size>,
    /// Rounds; in each, every way draws once. Shuffled order depends on how full the shared cache is, so few rounds scatter
    #[arg(long, default_value_t = 9, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub repeat: u64,
    /// What to fly through
    #[arg(long, value_name = "FILE.pnti", help_heading = "Flight")]
    pub index: Option<PathBuf>,
    /// Frames of the flight
    #[arg(long, default_value_t = 300, help_heading = "Flight", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub frames: u64,
    #[command(flatten)]
    pub detail: DetailOptions,
    /// Seed of the points
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print the rows as JSON
    #[arg(long)]
    pub json: bool,
    /// Compare with rows that --json printed before
    #[arg(long, value_name = "ROWS.json")]
    pub baseline: Option<PathBuf>,
    #[command(flatten)]
    pub device: DeviceOptions,
}

pub fn run(arguments: &Arguments, progress: &dyn Progress) -> Result<()> {
    let baseline = arguments.baseline.as_deref().map(bench::read_baseline).transpose()?.unwrap_or_default();
    let sizes: Vec<_> = arguments.size.iter().map(|size| size.0).collect();
    let asked =
        |name: &str, otherwise: bool| if arguments.names.is_empty() { otherwise } else { arguments.names.iter().any(|n| n == name) };
    let wish = arguments.device.wish();
    let mut rows = Vec::new();
    if asked("project", true) {
        let plan = project::Plan {
            points: arguments.points.clone(),
            sizes: sizes.clone(),
            repeat: arguments.repeat as usize,
            seed: arguments.seed,
        };
        rows = project::run(&wish, &plan, progress)?;
    }
    let mut flights = Vec::new();
    if asked("flight", arguments.index.is_some()) {
        let index = arguments.index.clone().ok_or_else(|| Error::Request("bench flight needs an index: --index FILE.pnti".into()))?;
        let detail = &arguments.detail;
        let plan = flight::Plan {
            index,
            sizes,
            frames: arguments.frames as usize,
            budget: detail.budget,
            lod_px: detail.lod,
            pool_bytes: detail.pool.map(|bytes| bytes.0),
        };
        flights = flight::run(&wish, &plan, progress)?;
    }
    if arguments.json {
        let values = rows.iter().map(serde_json::to_value).chain(flights.iter().map(serde_json::to_value));
        let values = values.collect::<std::result::Result<Vec<_>, _>>().map_err(|error| Error::Request(error.to_string()))?;
        println!("{:#}", serde_json::Value::from(values));
        return Ok(());
    }
    if !rows.is_empty() {
        print!("{}", bench::table(&rows, &baseline));
    }
    if !flights.is_empty() {
        print!("{}", flight::table(&flights));
    }
    Ok(())
}
