//! `pointillist export`: files or an index in; the points that filters, boxes and opacities leave
//! out, complete or absent. No Vulkan device is opened.

use super::files::refuse_to_overwrite;
use super::filters::{ClipOptions, FilterOptions};
use super::options::{CacheOptions, ColorOptions, TextArguments};
use super::streams;
use super::units;
use crate::cloud::length::Length;
use crate::cloud::scalar::{Scalar, Scalars};
use crate::cloud::{ColumnSet, ReadOptions};
use crate::error::{Error, Result};
use crate::extract::input::Input;
use crate::extract::{self, Format, Selection, Thinning};
use crate::index::format::Index;
use crate::progress::Progress;
use crate::render::scene::Scene;
use crate::render::source;
use crate::select::opacity::{Opacities, Rule};
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  pointillist export scan.laz -o ground.laz --only ground
  pointillist export scan.laz -o roofs.las --only building --where z=210..
  pointillist export scan.laz -o last.laz --where return=last --not noise
  pointillist export north.laz south.laz -o both.laz                        one file of two
  pointillist export north.laz south.laz -o site.copc.laz                   COPC, for maps in a browser
  pointillist export scan.e57 -o room.csv --clip box:10,-5,0,14,5,3         a table with a line of names
  pointillist export scan.laz -o thin.laz --thin 0.05                       one point a cell of 5 cm
  pointillist export site.pnti -o part.ply --every 10                       an index, every tenth point
  pointillist export scan.laz -o low.laz --where height-above-ground=0.2..2 --add height-above-ground
  pointillist export scan.laz -o shown.laz --scene scene.json               what a scene of the window shows

Points of LAS files keep their records bit for bit in .las and .laz: positions, all attributes, extra
bytes, coordinate system. What a format cannot hold is named in a note.";

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Point clouds: LAS, LAZ, COPC, Potree 2, EPT, PLY, E57, OBJ, XYZ, CSV, TXT, PTS, PTX; or one
    /// index, PNTI
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// The file to write: its name says the format
    #[arg(short, long, value_name = "OUT.laz|copc.laz|las|ply|csv")]
    pub output: PathBuf,
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
    /// Filters, clip boxes and opacities of a scene file, as the window saves it
    #[arg(long, value_name = "SCENE.json", conflicts_with_all = ["only", "not", "clip", "opacity"])]
    pub scene: Option<PathBuf>,
    /// Keep one point in each cell of a grid of this side, in the files' unit, or such as 0.05m:
    /// the first in the order of the files
    #[arg(long, value_name = "LENGTH", value_parser = units::length, allow_hyphen_values = true)]
    pub thin: Option<Length>,
    /// Keep every N-th of the points that are left, from the first on
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..), hide_default_value = true)]
    pub every: u64,
    /// Add heights above a coarse surface of the ground to each point. Scalars of the files are
    /// kept without being asked for
    #[arg(long, value_name = "height-above-ground", value_parser = added)]
    pub add: Option<Scalar>,
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

/// Parses `--add`.
fn added(text: &str) -> std::result::Result<Scalar, String> {
    let height = Scalar::HeightAboveGround;
    let is_it = text == height.to_string();
    is_it.then_some(height).ok_or(format!("only {height} can be added"))
}

/// Returns how inputs are read: all attributes, those that are `wanted`, and LAS records as they
/// are.
pub fn reading(
    text: &TextArguments,
    colors: &ColorOptions,
    wanted: ColumnSet,
    strict: bool,
) -> ReadOptions {
    let all = ColumnSet { scalars: Scalars::ALL, ..ColumnSet::ALL };
    ReadOptions {
        text: text.options(),
        rgb_range: colors.rgb_range,
        records: true,
        ..ReadOptions::new(all.and(wanted), strict)
    }
}

/// Opens files or one index; errors where an option has no effect on an index.
pub fn open(files: &[PathBuf], options: &ReadOptions, progress: &dyn Progress) -> Result<Input> {
    match files.iter().find(|path| Index::is_one(path)) {
        Some(path) if files.len() > 1 => Err(Error::Request(format!(
            "{} is an index; pass it alone, without other files",
            path.display()
        ))),
        Some(path) => {
            source::refuse_rgb_range(path, options.rgb_range)?;
            Input::open(files, options, progress)
        }
        None => Input::open(files, options, progress),
    }
}

impl Arguments {
    fn selection(&self) -> Result<Selection> {
        if let Some(path) = &self.scene {
            let Scene { filter, clips, opacities, .. } = Scene::read(path)?;
            return Ok(Selection { filter, clips, opacities, slab: None });
        }
        let opacities = Opacities(self.opacity.clone());
        let (filter, clips) = (self.filters.filter(), self.clips.clips());
        Ok(Selection { filter, clips, opacities, slab: None })
    }
}

pub fn run(arguments: &Arguments, progress: &dyn Progress) -> Result<()> {
    arguments.cache.use_for_servers(progress);
    let output: &Path = &arguments.output;
    refuse_to_overwrite(output, &arguments.files)?;
    Format::of(output)?;
    let selection = arguments.selection()?;
    let added: Scalars = arguments.add.into_iter().collect();
    let wanted = selection.wanted();
    let wanted = ColumnSet { scalars: wanted.scalars.and(added), ..wanted };
    let options = reading(&arguments.text, &arguments.colors, wanted, arguments.strict);
    let input = open(&arguments.files, &options, progress)?;
    let unit = input.reference().unit();
    let cell = arguments.thin.map(|side| units::counted("--thin", side, &unit));
    let thinning = Thinning { cell, every: arguments.every, ..Thinning::default() };
    let exported = extract::export(&input, &selection, &thinning, added, output, progress)?;
    exported.notes.iter().for_each(streams::note);
    streams::say(exported.line(output));
    Ok(())
}
