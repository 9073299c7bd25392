//! `pointillist bench`: times of passes, against other ways of doing the same.

use super::options::{DetailOptions, DeviceOptions};
use super::streams;
use super::units::{Bytes, Size};
use crate::bench::{
    self, flight, index, layers, luminance, project, splat, strokes, surface, window,
};
use crate::error::{Error, Result};
use crate::progress::Progress;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use std::ffi::OsString;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  pointillist bench                                        the default benchmarks
  pointillist bench project --points 1000000 --size 1024x1024
  pointillist bench surface --size 1024x768                visibility, filling and shape, as plain 3 x 3 passes
  pointillist bench splat --size 1024x768                  round points, against one-pixel points that cover as much
  pointillist bench luminance --points 1000000,4000000,16000000,64000000 --size 1920x1080
                                                           frames with and without luminance correction
  pointillist bench strokes --points 14000000 --size 1000x1000 --model dragon.ply    paintings, against plain points of the same cloud: table 2 of the paper
  pointillist bench layers --points 6000000 --size 512x512,1024x1024 --model dragon.ply    layers and shadows, as in the paper's table 3
  pointillist bench --json > before.json                   keep the rows
  pointillist bench --baseline before.json                 compare with rows kept before
  pointillist bench index --points 20000000 --laz          time to build an index, and its lower bound
  pointillist bench flight --index site.pnti --gpu-memory 128MiB    a flight through more than fits the device
  pointillist bench window --index site.pnti --gpu-memory 64MiB --points 1000000 --size 1280x720
                                                           flights in a window: how regular its frames are";

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Which benchmarks to run [default: project, and with --index also flight]: project, surface,
    /// splat, layers, luminance, strokes, index, flight, window
    #[arg(value_name = "NAME", value_parser = names())]
    pub names: Vec<String>,
    /// Numbers of points
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_values_t = [1_000_000, 10_000_000], value_parser = clap::value_parser!(u64).range(1..=2_000_000_000))]
    pub points: Vec<u64>,
    /// Sizes of the picture, pixels
    #[arg(long, value_name = "WxH,...", value_delimiter = ',', default_values_t = [Size([1024, 1024]), Size([1920, 1080])])]
    pub size: Vec<Size>,
    /// Rounds [default: project 25, since shuffled points depend on the state of a shared cache;
    /// index 3]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub repeat: Option<u64>,
    /// Also on this cloud; repeatable
    #[arg(long, value_name = "FILE", help_heading = "Strokes, layers")]
    pub model: Vec<PathBuf>,
    /// Index LAZ instead of LAS
    #[arg(long, help_heading = "Index")]
    pub laz: bool,
    /// Memory for points, as of `index --memory`
    #[arg(long, value_name = "BYTES", default_value_t = Bytes(crate::config::INDEX_MEMORY), help_heading = "Index")]
    pub memory: Bytes,
    /// Folder for input and output [default: the system's temporary folder]
    #[arg(long, value_name = "FOLDER", help_heading = "Index")]
    pub folder: Option<PathBuf>,
    /// Index to fly through
    #[arg(long, value_name = "FILE.pnti", help_heading = "Flight")]
    pub index: Option<PathBuf>,
    /// Frames of the flight
    #[arg(long, default_value_t = 300, help_heading = "Flight", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub frames: u64,
    /// Length of the flights, in seconds
    #[arg(long, default_value_t = 10, help_heading = "Window", value_parser = clap::value_parser!(u64).range(1..=3600))]
    pub seconds: u64,
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

/// Parses the name of a benchmark; an old spelling becomes the new one.
fn names() -> impl TypedValueParser<Value = String> {
    let names = [
        "project",
        "surface",
        "splat",
        "layers",
        "luminance",
        "strokes",
        "index",
        "flight",
        "window",
    ];
    let values = names.map(|name| match name {
        "layers" => PossibleValue::new(name).alias("dobrev"),
        _ => PossibleValue::new(name),
    });
    PossibleValuesParser::new(values)
        .map(|name| if name == "dobrev" { "layers".to_string() } else { name })
}

pub fn run(arguments: &Arguments, progress: &dyn Progress) -> Result<()> {
    let baseline =
        arguments.baseline.as_deref().map(bench::read_baseline).transpose()?.unwrap_or_default();
    let asked = |name: &str, otherwise: bool| {
        if arguments.names.is_empty() {
            otherwise
        } else {
            arguments.names.iter().any(|n| n == name)
        }
    };
    let rows = if asked("project", true) { projections(arguments, progress)? } else { Vec::new() };
    let indexes = if asked("index", false) {
        index::run(&index_plan(arguments), progress)?
    } else {
        Vec::new()
    };
    let surfaces =
        if asked("surface", false) { surfaces(arguments, progress)? } else { Vec::new() };
    let splats = if asked("splat", false) { splats(arguments, progress)? } else { Vec::new() };
    let luminances =
        if asked("luminance", false) { luminances(arguments, progress)? } else { Vec::new() };
    let paintings =
        if asked("strokes", false) { paintings(arguments, progress)? } else { Vec::new() };
    let layer_rows =
        if asked("layers", false) { layer_rows(arguments, progress)? } else { Vec::new() };
    let flights = if asked("flight", arguments.index.is_some()) {
        flights(arguments, progress)?
    } else {
        Vec::new()
    };
    let windows = if asked("window", false) { windows(arguments, progress)? } else { Vec::new() };
    if arguments.json {
        let values =
            rows.iter().map(serde_json::to_value).chain(indexes.iter().map(serde_json::to_value));
        let values = values.chain(surfaces.iter().map(serde_json::to_value));
        let values = values.chain(splats.iter().map(serde_json::to_value));
        let values = values.chain(luminances.iter().map(serde_json::to_value));
        let values = values.chain(paintings.iter().map(serde_json::to_value));
        let values = values.chain(layer_rows.iter().map(serde_json::to_value));
        let values = values.chain(windows.iter().map(serde_json::to_value));
        let values = values
            .chain(flights.iter().map(serde_json::to_value))
            .collect::<std::result::Result<Vec<_>, _>>();
        streams::print(&format!(
            "{:#}\n",
            serde_json::Value::from(values.map_err(|error| Error::Request(error.to_string()))?)
        ))?;
        return Ok(());
    }
    if !rows.is_empty() {
        streams::print(&bench::table(&rows, &baseline))?;
    }
    if !indexes.is_empty() {
        streams::print(&index::table(&indexes))?;
    }
    if !surfaces.is_empty() {
        streams::print(&surface::table(&surfaces))?;
    }
    if !splats.is_empty() {
        streams::print(&splat::table(&splats))?;
    }
    if !luminances.is_empty() {
        streams::print(&luminance::table(&luminances))?;
    }
    if !paintings.is_empty() {
        streams::print(&strokes::table(&paintings))?;
    }
    if !layer_rows.is_empty() {
        streams::print(&layers::table(&layer_rows))?;
    }
    if !flights.is_empty() {
        streams::print(&flight::table(&flights))?;
    }
    if !windows.is_empty() {
        streams::print(&window::table(&windows))?;
    }
    Ok(())
}

fn sizes(arguments: &Arguments) -> Vec<[u32; 2]> {
    arguments.size.iter().map(|size| size.0).collect()
}

fn projections(arguments: &Arguments, progress: &dyn Progress) -> Result<Vec<bench::Row>> {
    let plan = project::Plan {
        points: arguments.points.clone(),
        sizes: sizes(arguments),
        repeat: arguments.repeat.unwrap_or(25) as usize,
        seed: arguments.seed,
    };
    project::run(&arguments.device.to_options(), &plan, progress)
}

fn index_plan(arguments: &Arguments) -> index::Plan {
    index::Plan {
        points: arguments.points.clone(),
        laz: arguments.laz,
        seed: arguments.seed,
        repeat: arguments.repeat.unwrap_or(3) as usize,
        memory: arguments.memory.to_string(),
        folder: arguments.folder.clone().unwrap_or_else(std::env::temp_dir),
    }
}

fn surfaces(arguments: &Arguments, progress: &dyn Progress) -> Result<Vec<surface::Row>> {
    let mut rows = Vec::new();
    for size in sizes(arguments) {
        let plan = surface::Plan {
            size,
            repeat: arguments.repeat.unwrap_or(9) as usize,
            seed: arguments.seed,
        };
        rows.extend(surface::run(&arguments.device.to_options(), &plan, progress)?);
    }
    Ok(rows)
}

fn splats(arguments: &Arguments, progress: &dyn Progress) -> Result<Vec<splat::Row>> {
    let mut rows = Vec::new();
    for size in sizes(arguments) {
        let plan = splat::Plan {
            size,
            repeat: arguments.repeat.unwrap_or(9) as usize,
            seed: arguments.seed,
        };
        rows.extend(splat::run(&arguments.device.to_options(), &plan, progress)?);
    }
    Ok(rows)
}

fn luminances(arguments: &Arguments, progress: &dyn Progress) -> Result<Vec<luminance::Row>> {
    let mut rows = Vec::new();
    for size in sizes(arguments) {
        let plan = luminance::Plan {
            points: arguments.points.clone(),
            size,
            repeat: arguments.repeat.unwrap_or(5) as usize,
            seed: arguments.seed,
        };
        rows.extend(luminance::run(&arguments.device.to_options(), &plan, progress)?);
    }
    Ok(rows)
}

fn paintings(arguments: &Arguments, progress: &dyn Progress) -> Result<Vec<strokes::Row>> {
    let plan = strokes::Plan {
        points: arguments.points.clone(),
        models: arguments.model.clone(),
        sizes: sizes(arguments),
        repeat: arguments.repeat.unwrap_or(5) as usize,
        seed: arguments.seed,
    };
    strokes::run(&arguments.device.to_options(), &plan, progress)
}

fn layer_rows(arguments: &Arguments, progress: &dyn Progress) -> Result<Vec<layers::Row>> {
    let mut rows = Vec::new();
    for (number, &points) in arguments.points.iter().enumerate() {
        // A model has a fixed number of points, so it is measured once.
        let models = if number == 0 { arguments.model.clone() } else { Vec::new() };
        let plan = layers::Plan {
            points,
            models,
            sizes: sizes(arguments),
            repeat: arguments.repeat.unwrap_or(5) as usize,
            seed: arguments.seed,
        };
        rows.extend(layers::run(&arguments.device.to_options(), &plan, progress)?);
    }
    Ok(rows)
}

fn flights(arguments: &Arguments, progress: &dyn Progress) -> Result<Vec<flight::Flight>> {
    let path = arguments.index.clone().ok_or_else(|| {
        Error::Request("bench flight needs an index: give --index FILE.pnti".into())
    })?;
    let detail = &arguments.detail;
    let plan = flight::Plan {
        index: path,
        sizes: sizes(arguments),
        frames: arguments.frames as usize,
        budget: detail.point_budget,
        lod_px: detail.lod.unwrap_or(crate::config::LOD_PX),
        pool_bytes: detail.gpu_memory.map(|bytes| bytes.0),
    };
    flight::run(&arguments.device.to_options(), &plan, progress)
}

fn windows(arguments: &Arguments, progress: &dyn Progress) -> Result<Vec<window::Row>> {
    let DetailOptions { point_budget, lod, gpu_memory, .. } = &arguments.detail;
    let mut options: Vec<OsString> = Vec::new();
    let mut word = |name: &str, value: Option<String>| {
        options.extend(value.into_iter().flat_map(|value| [name.into(), value.into()]))
    };
    word("--point-budget", point_budget.map(|points| points.to_string()));
    word("--lod", lod.map(|pixels| pixels.to_string()));
    word("--gpu-memory", gpu_memory.map(|bytes| bytes.to_string()));
    word("--device", arguments.device.device.clone());
    options.extend(arguments.device.validate.then(|| "--validate".into()));
    let plan = window::Plan {
        points: arguments.points.clone(),
        index: arguments.index.clone(),
        sizes: sizes(arguments),
        seconds: arguments.seconds,
        options,
        seed: arguments.seed,
        folder: arguments.folder.clone().unwrap_or_else(std::env::temp_dir),
    };
    window::run(&plan, progress)
}
