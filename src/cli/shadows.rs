//! `pointillist shadows`: an index and a light in, the light that reaches every point out, complete
//! or absent.

use super::files::refuse_to_overwrite;
use super::options::{DeviceOptions, effect};
use super::streams;
use super::units::Bytes;
use crate::config;
use crate::error::{Error, Result};
use crate::graph::Gpu;
use crate::index::format::Index;
use crate::passes::Effects;
use crate::passes::shadows::bake_index::{self, Summary};
use crate::progress::Progress;
use crate::view::light::Light;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  pointillist shadows site.pnti -o site.shadows --light direction:0.3,0.8,-0.8
  pointillist shadows site.pnti -o site.shadows --light direction:0.3,0.8,-0.8 --effect shadows=samples=16,radius=2
  pointillist render site.pnti -o out.png --light direction:0.3,0.8,-0.8 --shadows site.shadows

All points of the index cast shadows, whatever a view shows of them; drawing with --shadows then casts none. The file has one byte a point.";

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// An index, PNTI
    #[arg(value_name = "FILE.pnti")]
    pub file: PathBuf,
    /// The shadows to write
    #[arg(short, long, value_name = "OUT.shadows")]
    pub output: PathBuf,
    /// Light: direction:X,Y,Z in which it travels; position:X,Y,Z; world coordinates;
    /// headlight: a sun from behind the left shoulder
    #[arg(long, value_name = "KIND[:X,Y,Z]", default_value_t, allow_hyphen_values = true)]
    pub light: Light,
    /// Settings of shadows, as for `render`: shadows=samples=16,radius=2
    #[arg(long, value_name = "shadows=key=value[,...]", value_parser = shadows)]
    pub effect: Vec<String>,
    /// Device memory for points and pictures of the light; with less, points are read more often
    #[arg(long, alias = "memory", value_name = "BYTES", default_value_t = Bytes(config::POOL_BYTES))]
    pub gpu_memory: Bytes,
    #[command(flatten)]
    pub device: DeviceOptions,
}

fn shadows(text: &str) -> std::result::Result<String, String> {
    match text.strip_prefix("shadows=") {
        Some(settings) if settings.split(',').any(|setting| setting == "off") => {
            Err("this command casts shadows, so they cannot be off".into())
        }
        Some(_) => effect(text),
        None => Err("only settings of shadows apply: shadows=KEY=VALUE".into()),
    }
}

pub fn run(arguments: &Arguments, progress: &dyn Progress) -> Result<()> {
    refuse_to_overwrite(&arguments.output, std::slice::from_ref(&arguments.file))?;
    let mut effects = Effects::default();
    for text in &arguments.effect {
        effects.set(text).map_err(|why| Error::Request(format!("--effect {text}: {why}")))?;
    }
    let index = Index::open(&arguments.file)?;
    let mut gpu = Gpu::open(&arguments.device.to_options())?;
    let settings = &effects.shadows.settings;
    let Summary { facts, leaves, readings, bytes } = bake_index::cast(
        &mut gpu,
        &index,
        arguments.light,
        settings,
        arguments.gpu_memory.0,
        &arguments.output,
        progress,
    )?;
    streams::say(format_args!(
        "{}: {} points in {leaves} leaves, read {}; {facts}; {} KiB",
        arguments.output.display(),
        index.directory.contents.points,
        if readings == 1 { "once".to_string() } else { format!("{readings} times") },
        bytes >> 10
    ));
    Ok(())
}
