//! `pointillist study`: accuracy against time, as a folder of CSV and one HTML page.

use super::options::DeviceOptions;
use super::streams;
use super::units::Size;
use crate::error::Result;
use crate::graph::Gpu;
use crate::progress::Progress;
use crate::study::{self, Plan, STUDIES, cases, compare, report};
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  pointillist study                                   all studies, into the folder study/
  pointillist study precision -o /tmp/precision       one study; open /tmp/precision/study.html
  pointillist study precision --points 100000 --size 640x360 --repeat 3
                                                      a quick look: smaller, and noisier times
  pointillist study files --file a.laz --file b.laz   every knob on your files
  pointillist study lod -o now --compare before       what moved since an older report";

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = help())]
pub struct Arguments {
    /// Studies to run [default: all]
    #[arg(value_name = "NAME")]
    pub names: Vec<String>,
    /// Folder for NAME.csv and study.html
    #[arg(short, long, value_name = "FOLDER", default_value = "study")]
    pub output: PathBuf,
    /// Points per scene
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u64).range(1..))]
    pub points: u64,
    /// Seed of the scenes
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Timed rounds over all settings, after a warm-up round
    #[arg(long, value_name = "N", default_value_t = 15, value_parser = clap::value_parser!(u64).range(1..))]
    pub repeat: u64,
    /// Size of the pictures, pixels
    #[arg(long, value_name = "WxH", default_value_t = Size([1280, 720]))]
    pub size: Size,
    /// Scenes of the studies surface, visibility, fill, smooth and shape [default: each study's
    /// own]
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', value_parser = clap::builder::PossibleValuesParser::new(cases::NAMES))]
    pub scenes: Vec<String>,
    /// File that the study `files` draws with every knob; repeatable
    #[arg(long = "file", value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Folder of an older report: print which points of the front moved since, with 95 % intervals
    #[arg(long, value_name = "FOLDER")]
    pub compare: Option<PathBuf>,
    #[command(flatten)]
    pub device: DeviceOptions,
}

fn help() -> String {
    let studies: Vec<String> =
        STUDIES.iter().map(|(name, about)| format!("  {name:<14} {about}")).collect();
    format!("Studies:\n{}\n\n{EXAMPLES}", studies.join("\n"))
}

pub fn run(arguments: &Arguments, progress: &dyn Progress) -> Result<()> {
    let plan = Plan {
        points: arguments.points,
        seed: arguments.seed,
        repeat: arguments.repeat as usize,
        size: arguments.size.0,
        scenes: arguments.scenes.clone(),
        files: arguments.files.clone(),
    };
    // Said before anything is measured.
    if let Some(old) = &arguments.compare {
        arguments
            .names
            .iter()
            .try_for_each(|name| compare::read(&compare::path(old, name)).map(drop))?;
    }
    let mut gpu = Gpu::open(&arguments.device.to_options())?;
    let mut sections = study::run(&arguments.names, &mut gpu, &plan, progress)?;
    for section in &mut sections {
        let old = arguments.compare.as_ref();
        let Some(old) = old.filter(|old| compare::path(old, section.name).is_file()) else {
            continue;
        };
        let (table, moved) = compare::table(section, old, plan.seed)?;
        section.tables.insert(0, table);
        let said =
            if moved.is_empty() { vec![format!("{}: nothing moved", section.name)] } else { moved };
        streams::print(&format!("{}\n", said.join("\n")))?;
    }
    report::write(&arguments.output, &sections, &plan, &report::Origin::here(&gpu))?;
    streams::print(&format!("{}\n", arguments.output.join("study.html").display()))?;
    Ok(())
}
