//! `pointillist bench`: times of passes against other ways of doing the same.

use super::options::{DeviceOptions, Size};
use crate::bench::{self, project};
use crate::error::{Error, Result};
use crate::progress::Progress;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  pointillist bench                                        all benchmarks
  pointillist bench project --points 1000000 --size 1024x1024
  pointillist bench --json > before.json                   keep the rows ...
  pointillist bench --baseline before.json                 ... and compare with them later";

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Which benchmarks to run [default: all]: project
    #[arg(value_name = "NAME", value_parser = ["project"])]
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
    let plan = project::Plan {
        points: arguments.points.clone(),
        sizes: arguments.size.iter().map(|size| size.0).collect(),
        repeat: arguments.repeat as usize,
        seed: arguments.seed,
    };
    let rows = project::run(&arguments.device.wish(), &plan, progress)?;
    if arguments.json {
        let text = serde_json::to_string_pretty(&rows).map_err(|error| Error::Request(error.to_string()))?;
        println!("{text}");
    } else {
        print!("{}", bench::table(&rows, &baseline));
    }
    Ok(())
}
