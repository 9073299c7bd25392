//! `pointillist tune`: what accuracy costs in time on this device, and this cloud.

use super::files::{check_extension, refuse_to_overwrite};
use super::options::{DeviceOptions, PictureOptions};
use super::streams;
use crate::atomic_file::write_atomically;
use crate::error::{Error, Result};
use crate::graph::Gpu;
use crate::index::cache::{self, CacheLocation};
use crate::progress::Progress;
use crate::render::source::{OpenOptions, Source};
use crate::study::tuner::{self, Effort, Subject, Tuner};
use crate::tune::store::{self, switches};
use crate::view::View;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  pointillist tune                                 this device, on simulated scenes
  pointillist tune --quick                         the same in less than 20 s, with fewer pictures
  pointillist tune scan.laz -o tuned.html          this cloud on this device, and a chart
  pointillist tune scan.laz --camera cam.json --effect shadows=on --light direction:0.3,0.8,-0.8
                                                   in this view, with these effects
  pointillist render scan.laz -o out.png --time 50ms
  pointillist render scan.laz -o out.png --error 0.5px";

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Point clouds, or one index [default: simulated scenes, for any cloud]
    #[arg(value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Draw fewer and smaller pictures
    #[arg(long)]
    pub quick: bool,
    /// Also write a chart, error against milliseconds, or the front itself; repeatable
    #[arg(short, long, value_name = "OUT.html|json")]
    pub output: Vec<PathBuf>,
    #[command(flatten)]
    pub picture: PictureOptions,
    #[command(flatten)]
    pub device: DeviceOptions,
    /// Seed of simulated scenes
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Refuse a truncated, inconsistent or damaged file instead of keeping what is readable
    #[arg(long)]
    pub strict: bool,
}

/// Returns the place of fronts: that of indexes.
pub fn place(picture: &PictureOptions) -> Result<CacheLocation> {
    picture.detail.cache.place().map_or_else(CacheLocation::user_folder, Ok)
}

/// Returns what a front of these settings on this device is of.
pub fn subject(gpu: &Gpu, picture: &PictureOptions, files: &[PathBuf]) -> Result<store::Subject> {
    Ok(store::Subject {
        device: gpu.device.name.clone(),
        driver: gpu.device.driver.clone(),
        is_cpu: gpu.device.is_cpu,
        switches: switches(&picture.settings()?.effects),
        cloud: (!files.is_empty()).then(|| cache::key_of_files(files)).transpose()?,
    })
}

/// Returns how files are opened: an index of them, since its cut is among what is tuned.
pub fn opening(picture: &PictureOptions, strict: bool) -> OpenOptions {
    let index = Some("--time, --error and tune choose among the nodes of an index");
    OpenOptions { index, ..picture.opening(strict) }
}

pub fn run(arguments: &Arguments, progress: &dyn Progress) -> Result<()> {
    let picture = arguments.picture.with_scene()?;
    picture.detail.cache.use_for_servers(progress);
    for output in &arguments.output {
        refuse_to_overwrite(output, &arguments.files)?;
        check_extension(output, &["html", "json"])?;
    }
    if arguments.files.is_empty() && (picture.camera.is_some() || picture.scene.is_some()) {
        return Err(Error::Request(
            "--camera and --scene are of a cloud; name its files, too".into(),
        ));
    }
    let settings = picture.settings()?;
    let place = place(&picture)?;
    let mut gpu = Gpu::open(&arguments.device.to_options())?;
    let effort = if arguments.quick { Effort::QUICK } else { Effort::FULL };
    let effort = effort.on(gpu.device.is_cpu);
    let subjects = if arguments.files.is_empty() {
        tuner::scenes(&mut gpu, &effort, arguments.seed, progress)?
    } else {
        let source =
            Source::open(&arguments.files, &opening(&picture, arguments.strict), progress)?;
        source.notes(picture.further()).into_iter().for_each(streams::note);
        let views = views(&picture, &source, &effort)?;
        let (shown, _) = picture.shown(&source)?;
        let mut cloud = source.upload(&mut gpu, shown, picture.detail.pool_bytes(), progress)?;
        cloud.set_filters(picture.opacities(), picture.clips());
        cloud.set_scale(picture.scale.scale()?);
        let name = arguments.files[0].file_name().unwrap_or_default();
        vec![Subject { name: name.to_string_lossy().into_owned(), cloud, views }]
    };
    let subject = subject(&gpu, &picture, &arguments.files)?;
    let mut tuner = Tuner::new(&mut gpu, subjects, settings, picture.detail.lod(), progress)?;
    let front = tuner.search(&effort, progress)?;
    let kept = subject.keep(&place, &front)?;
    for output in &arguments.output {
        let is_page = output.extension().is_some_and(|own| own.eq_ignore_ascii_case("html"));
        if is_page {
            write(output, &tuner::page(&front))?;
        } else {
            store::write(output, &front)?;
        }
    }
    streams::print(&tuner::table(&front))?;
    if let Some(path) = kept {
        streams::say(format_args!("kept: {}", path.display()));
    }
    Ok(())
}

fn write(path: &Path, text: &str) -> Result<()> {
    write_atomically(path, |partial| {
        std::fs::write(partial, text).map_err(|error| Error::io("write", path, error))
    })
}

/// Returns the views to measure: the camera that was given, or the whole cloud, half as far, and
/// from another side.
fn views(picture: &PictureOptions, source: &Source, effort: &Effort) -> Result<Vec<View>> {
    let sized = PictureOptions { size: super::units::Size(effort.size), ..picture.clone() };
    let whole = sized.plain_view(source)?;
    if picture.camera()?.is_some() {
        return Ok(vec![whole]);
    }
    tuner::views(whole.camera, source.up().axis(), effort.size)
}
