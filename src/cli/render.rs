//! `pointillist render`: files in, one picture out; no window system is touched.

use super::files::{check_extension, refuse_to_overwrite};
use super::frames;
use super::limits::{Chosen, LimitOptions, Target};
use super::options::{DeviceOptions, PictureOptions};
use super::raster::{self, note_system};
use super::streams;
use super::tune;
use super::units::{self, LARGEST_SIDE};
use crate::atomic_file::{AtomicFile, STANDARD_OUTPUT};
use crate::cloud::ReadOptions;
use crate::cloud::crs::Crs;
use crate::cloud::length::Length;
use crate::cloud::up::Up;
use crate::error::{Error, Result};
use crate::extract::Selection;
use crate::extract::count::count;
use crate::extract::input::Input;
use crate::extract::raster::{NoData, Pick, Value};
use crate::graph::{CompletedSubmission, Gpu, Graph};
use crate::output::export::Downloads;
use crate::output::film;
use crate::output::geotiff::{self, Map, Sample};
use crate::output::part::Part;
use crate::output::tiled::{self, PictureRequest};
use crate::output::world_file;
use crate::passes::encode::Channels;
use crate::passes::phong::{self, Backfaces};
use crate::passes::project::{self, Statistics};
use crate::passes::tile_stats::{self, Counts};
use crate::passes::{Effect, Effects, count_visible, shadows, strokes};
use crate::prices;
use crate::progress::Progress;
use crate::render::gpu_cloud::SelectionReport;
use crate::render::index_samples::core_of;
use crate::render::settings::{Background, FrameConfig};
use crate::render::source::{OpenOptions, Source, bounds_of};
use crate::renderer::{CloudId, Done, Renderer};
use crate::resident::Resident;
use crate::select::clip::Clip;
use crate::view::map::{Extent, MapGrid};
use crate::view::{Preset, View};
use glam::DVec3;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

const EXAMPLES: &str = "\
Examples:
  pointillist render scan.laz -o out.png
  pointillist render huge.las -o out.png                   indexed first; the index is kept
  pointillist render scan.laz -o out.png --effect edl=on,strength=0.5 --background ffffff
  pointillist render scan.laz -o out.png --only ground --not noise --where intensity=100..2000
  pointillist render scan.laz -o map.tif --view top --resolution 0.25 --legend
  pointillist render scan.laz -o turn.mp4 --turntable 120
  pointillist render scan.laz -o out.png --time 50ms       the most accurate in this time
  pointillist render scan.laz -o - | magick - out.jpg      a picture to standard output
More: `pointillist guide command_line`";

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Point clouds: LAS, LAZ, COPC, Potree 2, EPT, PLY, E57, OBJ, XYZ, CSV, TXT, PTS, PTX; or one
    /// index, PNTI
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// The picture: PNG, - for standard output; a map, with --resolution: GeoTIFF or PNG; a film,
    /// with --path or --turntable: MP4, WebM or APNG
    ///
    /// PNG maps have a world file beside them; MP4 and WebM are written by ffmpeg
    #[arg(short, long, value_name = "OUT.png|tif|mp4|webm|apng", required_unless_present = "exr")]
    pub output: Option<PathBuf>,
    /// Also (or only) write layers: linear colour, depth, ids, coverage, normals
    ///
    /// R G B A, depth.Z, index.V, coverage.V, normal.X Y Z, lit.V, raw.Z
    #[arg(long, value_name = "OUT.exr")]
    pub exr: Option<PathBuf>,
    /// Draw every frame of a camera path: OUT-0001.png, OUT-0001.exr and so on
    #[arg(long, value_name = "PATH.json", conflicts_with_all = ["camera", "view", "explain", "timings"])]
    pub path: Option<PathBuf>,
    /// Draw this many frames on a level circle around the cloud, or --camera's target
    ///
    /// All of the cloud is in view; the circle runs anticlockwise seen from above
    #[arg(long, value_name = "FRAMES", value_parser = clap::value_parser!(u64).range(1..=100_000), conflicts_with_all = ["path", "explain", "timings"])]
    pub turntable: Option<u64>,
    /// Frames per second of a film [default: those of the camera path, 25]
    #[arg(long, hide_short_help = true, value_name = "NUMBER", value_parser = frames::per_second)]
    pub fps: Option<f64>,
    /// Keep frames of --path or --turntable that exist already; a note counts them
    #[arg(long, hide_short_help = true)]
    pub resume: bool,
    /// Draw one part of --path or --turntable, or of the rows of a picture, as one of many jobs
    #[arg(long, hide_short_help = true, value_name = "PART/PARTS")]
    pub part: Option<Part>,
    /// Draw in pieces of at most this many pixels a side [default: whole up to 33 million pixels
    /// and the device's largest image]
    #[arg(long, hide_short_help = true, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(8..), conflicts_with_all = ["path", "turntable"])]
    pub piece: Option<u32>,
    /// Draw a map, north up, of pixels of this size, in the files' unit or such as 0.5m; rasters of
    /// heights and counts: `pointillist raster`
    ///
    /// With --view top; metres for coordinates in degrees; edges of pixels are multiples of it;
    /// transparent where nothing is drawn
    #[arg(long, value_name = "LENGTH", value_parser = units::length, allow_hyphen_values = true, requires = "output", conflicts_with_all = ["part", "size", "camera", "scene", "path", "turntable", "exr", "explain", "timings"])]
    pub resolution: Option<Length>,
    /// West, south, east and north of the map, in the coordinates of the files, widened to whole
    /// pixels [default: around all points but strays]
    #[arg(
        long,
        hide_short_help = true,
        value_name = "X0,Y0,X1,Y1",
        allow_hyphen_values = true,
        requires = "resolution"
    )]
    pub extent: Option<Extent>,
    /// Write a raster of the points' own values with --resolution, instead of a picture.
    /// `pointillist raster` also picks the lowest, the mean or the last
    #[arg(long, hide_short_help = true, value_name = "height|intensity|count|rgb", requires_all = ["output", "resolution"], conflicts_with_all = ["style", "color", "effect", "point_size", "title", "legend", "scale_bar", "north_arrow", "axes"])]
    pub raster: Option<Value>,
    /// Value of cells of --raster without points, a number or nan [default: -9999]
    #[arg(
        long,
        hide_short_help = true,
        value_name = "NUMBER|nan",
        allow_hyphen_values = true,
        requires = "raster"
    )]
    pub no_data: Option<NoData>,
    #[command(flatten)]
    pub picture: PictureOptions,
    #[command(flatten)]
    pub limits: LimitOptions,
    #[command(flatten)]
    pub device: DeviceOptions,
    /// Print which passes run and why; json: to standard output; prices: also what each effect
    /// costs or would cost
    ///
    /// Prices are measured by pictures without and with the effect; both: json,prices
    #[arg(long, value_name = "json|prices", num_args = 0..=1, require_equals = true, default_missing_value = "text", value_delimiter = ',', value_parser = ["text", "json", "prices"])]
    pub explain: Option<Vec<String>>,
    /// Print how long every stage and pass took, in ms
    #[arg(long, hide_short_help = true)]
    pub timings: bool,
    /// Refuse a damaged file instead of keeping what is readable
    #[arg(long)]
    pub strict: bool,
    /// List the effects and their settings, as `--help effects` does
    #[arg(long, exclusive = true, hide = true)]
    pub help_effects: bool,
}

impl Arguments {
    /// Tests whether this is explained.
    fn explains(&self, what: &str) -> bool {
        self.explain.iter().flatten().any(|asked| asked == what)
    }
}

pub fn run(arguments: &Arguments, progress: &dyn Progress) -> Result<()> {
    if arguments.help_effects {
        streams::print(&format!("{}\n", Effects::help()))?;
        return Ok(());
    }
    if let (Some(value), Some(output), Some(resolution)) =
        (arguments.raster, &arguments.output, arguments.resolution)
    {
        if !matches!(arguments.picture.view, Preset::Fit | Preset::Top) {
            return Err(Error::Request("--raster is a map; leave --view out, or give top".into()));
        }
        let raster = raster::Arguments {
            files: arguments.files.clone(),
            output: output.clone(),
            resolution,
            value,
            pick: Pick::Highest,
            no_data: arguments.no_data,
            extent: arguments.extent,
            memory: raster::MEMORY,
            filters: arguments.picture.filters.clone(),
            clips: arguments.picture.clips.clone(),
            opacity: arguments.picture.opacity.clone(),
            strict: arguments.strict,
            colors: arguments.picture.colors,
            text: arguments.picture.text,
            cache: arguments.picture.detail.cache.clone(),
        };
        return raster::run(&raster, progress);
    }
    if let (Some(png), Some(exr)) = (&arguments.output, &arguments.exr)
        && png == exr
    {
        return Err(Error::Request(format!(
            "-o and --exr both name {}; name two different files",
            png.display()
        )));
    }
    arguments.picture.detail.cache.use_for_servers(progress);
    let pictures = [&arguments.output, &arguments.exr].into_iter().flatten();
    let to_output = pictures.filter(|path| path.as_path() == Path::new(STANDARD_OUTPUT)).count();
    if to_output > 0 && (arguments.explains("json") || to_output > 1) {
        return Err(Error::Request(
            "standard output takes one picture, and no --explain=json beside it; name a file"
                .into(),
        ));
    }
    if arguments.path.is_some() || arguments.turntable.is_some() {
        if to_output > 0 {
            return Err(Error::Request("frames and films are files; name one with -o".into()));
        }
        return frames::run(arguments, progress);
    }
    if arguments.resume || arguments.fps.is_some() {
        return Err(Error::Request(
            "--resume and --fps are for --path and --turntable, which draw many frames".into(),
        ));
    }
    let mut picture = arguments.picture.with_scene()?;
    arguments.check_map()?;
    if arguments.channels() == Channels::Rgba {
        // Colours times alpha.
        picture.background = Some(Background([0; 3]));
    }
    let endings: &[&str] = if arguments.resolution.is_some() { &MAPS } else { &["png"] };
    for (output, endings) in [(&arguments.output, endings), (&arguments.exr, &["exr"])] {
        let Some(output) = output else { continue };
        refuse_to_overwrite(output, &arguments.inputs())?;
        if film::ending(output).is_some() {
            return Err(Error::Request(format!(
                "{} is a film, of many frames; give --turntable 120, or --path",
                output.display()
            )));
        }
        check_extension(output, endings)?;
        // Fails early if the folder is not writable.
        drop(AtomicFile::create(output)?);
    }
    // Wrong numbers are refused before anything is read.
    picture.settings()?;
    let mut stages = Stages::new();
    let limit = arguments.limits.limit();
    let opening = match limit {
        None => picture.opening(arguments.strict),
        Some(_) => tune::opening(&picture, arguments.strict),
    };
    let opening = match arguments.resolution {
        Some(_) => OpenOptions {
            index: opening.index.or(Some(MAPS_OF_INDEXES)),
            indexes_octrees: true,
            ..opening
        },
        None => opening,
    };
    let mut source = Source::open(&arguments.files, &opening, progress)?;
    source.find(picture.color, progress)?;
    source.notes(picture.further()).iter().for_each(streams::note);
    source.check_clips(&picture.clips())?;
    stages.done("read");
    let grid = arguments.grid(&picture, &source, progress)?;
    let (shown, why_shown) = picture.shown(&source)?;
    picture.note_meanings(&source, &shown);
    let named = picture.named(&source, shown)?;
    let view = match &grid {
        Some(grid) => grid.view(heights(&picture, &source))?,
        None => picture.view(&source, &named)?,
    };
    let placed = grid.map(|grid| Placed::new(grid, &source));
    let annotations = picture.report.annotations();
    annotations.note(&view, &named).iter().for_each(streams::note);
    let over = annotations.overlay(&view, &named);
    let mut facts = Facts {
        points: source.points(),
        files: arguments.files.len(),
        nodes: source.nodes(),
        shows: shown.attribute.name(),
        why_shown,
        view,
        taken: None,
        left: None,
        shadows: None,
        strokes: None,
    };
    let index = if let Source::Index(index) = &source { Some(index.clone()) } else { None };
    stages.done("settings");
    let mut renderer = picture.renderer(&arguments.device)?;
    stages.done("open device");
    let cloud = renderer.add_source(source, shown, progress)?;
    stages.done("organise");
    let rows = arguments.rows(view.size)?;
    if placed.is_some()
        || arguments.part.is_some()
        || tiled::needs_pieces(&renderer.gpu, view.size, arguments.piece)
    {
        let mut lod = picture.detail.lod();
        if placed.is_some() {
            lod.lod_px = lod.lod_px.or(Some(0.0));
        }
        if let Some((limit, index)) = limit.zip(index) {
            let mut target =
                Target { renderer: &mut renderer, cloud, view: &view, picture: &picture, progress };
            let chosen = Chosen::settle_pieces(limit, &mut target, &arguments.files, &index)?;
            streams::note(chosen.line(None));
            lod = chosen.cut;
        }
        let (piece, channels) = (arguments.piece, arguments.channels());
        let wanted = PictureRequest { view, lod, rows, piece, over, channels };
        return in_pieces(arguments, wanted, placed, &mut renderer, cloud, progress);
    }
    let chosen = match limit.zip(index) {
        None => None,
        Some((limit, index)) => {
            let mut target =
                Target { renderer: &mut renderer, cloud, view: &view, picture: &picture, progress };
            Some(Chosen::settle(limit, &mut target, &arguments.files, &index)?)
        }
    };
    if chosen.is_some() {
        stages.done("choose");
    }
    let cut = chosen.as_ref().map_or(picture.detail.lod(), |chosen| chosen.cut);
    facts.taken = renderer.load(cloud, &view, &cut.of(view.size), progress)?;
    for note in facts.taken.iter().flat_map(|taken| &taken.notes) {
        if arguments.strict {
            return Err(Error::Request(note.clone()));
        }
        streams::note(note);
    }
    stages.done("load");
    let config = renderer.config(cloud, &view)?;
    // Warnings concern what was asked for, not what a front has chosen.
    let asked = match &chosen {
        None => config.clone(),
        Some(_) => FrameConfig { effects: picture.settings()?.effects, ..config.clone() },
    };
    asked.warnings(renderer.cloud(cloud)?.1.resident()).iter().for_each(streams::note);

    let [png, exr] = [&arguments.output, &arguments.exr].map(Option::is_some);
    let Done { frame, asked, notes } =
        renderer.draw(cloud, &view, &config, progress, |g, outcome| {
            facts.strokes = outcome.strokes.as_ref().map(|painted| painted.facts);
            facts.shadows =
                outcome.gbuffer.light_visibility.as_ref().map(|visibility| visibility.facts);
            let counts =
                arguments.explain.is_some().then(|| tile_stats::Asked::of(g, &outcome.gbuffer));
            Ok((Downloads::ask(g, outcome, png, exr)?, counts, outcome.statistics))
        })?;
    let (downloads, counts, statistics) = asked;
    stages.done("draw");
    notes.iter().for_each(streams::note);
    let [png, exr] = [&arguments.output, &arguments.exr].map(Option::as_deref);
    downloads.write(&frame, view.size, png, exr, over)?;
    stages.done("write");

    let got = match &chosen {
        None => None,
        Some(chosen) => {
            let asked = arguments.explain.is_some() || arguments.timings;
            let mut target =
                Target { renderer: &mut renderer, cloud, view: &view, picture: &picture, progress };
            let got = chosen.got(&mut target, &frame.passes, asked)?;
            streams::note(chosen.line(Some(got.ms)));
            Some((chosen, got))
        }
    };
    let prices = match arguments.explains("prices") {
        true => prices::of(&mut renderer, cloud, &view, &config, progress)?,
        false => Vec::new(),
    };
    if let Some(counts) = counts {
        let (gpu, cloud) = renderer.cloud(cloud)?;
        let resident = cloud.resident();
        facts.left = left(gpu, &view, resident, &config)?;
        let counts = counts.counts(&frame, view.size, &config.effects);
        match arguments.explains("json") {
            true => {
                let mut explained =
                    explain_json(&facts, gpu, resident, &config, &statistics, &counts, &frame);
                explained["chosen"] = got.as_ref().map(|(chosen, got)| chosen.json(got)).into();
                if !prices.is_empty() {
                    explained["prices"] = prices::json(&prices);
                }
                streams::print(&format!("{explained}\n"))?
            }
            false => {
                let text = explain(&facts, gpu, resident, &config, &statistics, &counts, &frame);
                let columns = got.iter().map(|(chosen, got)| chosen.columns(got));
                streams::say(columns.chain([text]).collect::<String>().trim_end());
                if !prices.is_empty() {
                    streams::say(prices::table(&prices).trim_end());
                }
            }
        }
    }
    if arguments.timings {
        stages.print(&frame);
        got.iter().for_each(|(chosen, got)| streams::say(chosen.columns(got).trim_end()));
    }
    Ok(())
}

/// Counts the points in the picture that filters, opacities and clip boxes leave, if there are
/// any of these.
fn left(
    gpu: &mut Gpu,
    view: &View,
    resident: &Resident,
    config: &FrameConfig,
) -> Result<Option<u64>> {
    if !resident.leaves_out() {
        return Ok(None);
    }
    let mut g = Graph::new(gpu);
    let points = project::draw(&mut g, view, resident, config.precision)?
        .one_sided(config.drops_back_faces(resident));
    let counted = count_visible::record(&mut g, view, &points);
    let frame = g.submit_and_wait(&[])?;
    Ok(Some(counted.points(&frame)))
}

/// Draws the picture in pieces; errors if anything besides the picture is asked for.
fn in_pieces(
    arguments: &Arguments,
    wanted: PictureRequest,
    placed: Option<Placed>,
    renderer: &mut Renderer,
    cloud: CloudId,
    progress: &dyn Progress,
) -> Result<()> {
    let (Some(output), None, None, false) =
        (&arguments.output, &arguments.exr, &arguments.explain, arguments.timings)
    else {
        return Err(Error::Request(format!(
            "{}x{} pixels are drawn in pieces, without --exr, --explain and --timings; leave these out, or draw a smaller --size",
            wanted.view.size[0], wanted.view.size[1]
        )));
    };
    let notes = match placed {
        None => tiled::write(renderer, cloud, wanted, output, progress)?,
        Some(placed) => placed.write(renderer, cloud, wanted, output, progress)?,
    };
    for note in notes {
        streams::note(note);
    }
    Ok(())
}

/// The reason to draw maps from an index of the files: where points lie on surfaces is found node
/// by node, so that maps of files and of their indexes are the same, bit by bit.
const MAPS_OF_INDEXES: &str = "maps are drawn from an index";

/// Ends of names of maps.
const MAPS: [&str; 3] = ["tif", "tiff", "png"];

impl Arguments {
    /// Returns all files that are read.
    pub fn inputs(&self) -> Vec<PathBuf> {
        let PictureOptions { camera, scene, detail, .. } = &self.picture;
        let more = [camera, scene, &detail.shadows, &self.path].into_iter().flatten();
        self.files.iter().chain(more).cloned().collect()
    }

    /// Returns the rows of the picture that are drawn; errors if that is none.
    fn rows(&self, [_, height]: [u32; 2]) -> Result<Range<u32>> {
        let Some(part) = self.part else { return Ok(0..height) };
        let rows = part.rows(height).ok_or_else(|| {
            Error::Request(format!(
                "part {part} has none of the {height} rows; parts are made of blocks of rows, so ask for fewer"
            ))
        })?;
        streams::note(format_args!(
            "part {part} is rows {} to {} of {height}, from the top",
            rows.start + 1,
            rows.end
        ));
        Ok(rows)
    }

    /// Returns what pixels have. A map is transparent where nothing is drawn, unless a background
    /// is asked for.
    fn channels(&self) -> Channels {
        match self.resolution.is_some() && self.picture.background.is_none() {
            true => Channels::Rgba,
            false => Channels::Rgb,
        }
    }

    /// Errors if a map lacks what makes it one.
    fn check_map(&self) -> Result<()> {
        let is_tiff = |path: &PathBuf| {
            path.extension()
                .is_some_and(|own| MAPS[..2].iter().any(|tif| own.eq_ignore_ascii_case(tif)))
        };
        let is_geotiff = self.output.as_ref().is_some_and(is_tiff);
        if is_geotiff && !self.picture.report.annotations().is_empty() {
            return Err(Error::Request(
                "a GeoTIFF has pixels of the map alone: leave --title, --legend, --scale-bar, --north-arrow and --axes out, or write a .png".into(),
            ));
        }
        if self.resolution.is_some() && self.picture.view != Preset::Top {
            return Err(Error::Request("--resolution draws a map; give --view top with it".into()));
        }
        if self.resolution.is_none() && is_geotiff {
            return Err(Error::Request(
                "a GeoTIFF is a map; give --view top and --resolution with it, or name a .png"
                    .into(),
            ));
        }
        Ok(())
    }

    /// Returns the pixels of a map; `None` if the picture is none.
    fn grid(
        &self,
        picture: &PictureOptions,
        source: &Source,
        progress: &dyn Progress,
    ) -> Result<Option<MapGrid>> {
        let Some(resolution) = self.resolution else { return Ok(None) };
        if source.up() != Up::Z {
            return Err(Error::Request(
                "--resolution draws maps, and these files have y up; give --up z with it".into(),
            ));
        }
        let resolution = units::counted("--resolution", resolution, &source.reference().unit());
        let grid = match self.extent {
            Some(extent) => {
                let reference = source.reference();
                let extent = extent.map(|corner| reference.drawn(corner));
                let Extent([from, to]) = extent;
                if let Some(found) = bounds_of(&source.framed_points(&picture.clips())) {
                    let [low, high] = found.map(|corner| corner.truncate());
                    if from.cmpgt(high).any() || to.cmplt(low).any() {
                        return Err(Error::Request(format!(
                            "--extent {},{} lies beside the points, which lie between {} and {}",
                            reference.words(from),
                            reference.words(to),
                            reference.words(low),
                            reference.words(high)
                        )));
                    }
                }
                MapGrid::covering(extent, resolution, LARGEST_SIDE)?
            }
            None => {
                let [low, high] = self
                    .corners(picture, source, progress)?
                    .ok_or_else(|| Error::Request("there are no points to map".into()))?;
                MapGrid::around(low.truncate(), high.truncate(), resolution, LARGEST_SIDE)?
            }
        };
        Ok(Some(grid))
    }

    /// Returns the corners of the box around the points that are drawn, but strays. Samples of an
    /// index do not reach all corners, so that its points are read, unless they are on a server.
    fn corners(
        &self,
        picture: &PictureOptions,
        source: &Source,
        progress: &dyn Progress,
    ) -> Result<Option<[DVec3; 2]>> {
        let mut clips = picture.clips();
        match source {
            Source::Index(index) if !index.is_remote() => {
                clips.0.extend(core_of(index).iter().flat_map(Clip::around));
            }
            _ => return Ok(bounds_of(&source.framed_points(&clips))),
        }
        let selection =
            Selection { filter: picture.filters.filter(), clips, ..Selection::default() };
        let options =
            ReadOptions { wanted: selection.wanted(), ..picture.read_options(self.strict) };
        let input = Input::open(&self.files, &options, progress)?;
        Ok(count(&input, &selection, progress)?.bounds)
    }
}

/// Returns the least and the greatest height of points that a camera should frame.
fn heights(picture: &PictureOptions, source: &Source) -> [f64; 2] {
    let heights = source.framed_points(&picture.clips()).into_iter().map(|p| p.z);
    let [low, high] = heights
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], z| [low.min(z), high.max(z)]);
    if low <= high { [low, high] } else { [0.0, 0.0] }
}

/// A map, and what the files say about its place.
struct Placed {
    grid: MapGrid,
    system: Option<Crs>,
    text: Option<String>,
}

impl Placed {
    fn new(grid: MapGrid, source: &Source) -> Placed {
        let header = match source {
            Source::Files(cloud) => cloud.parts.first().map(|part| &part.header),
            Source::Index(index) => index.directory.contents.parts.first().map(|part| &part.header),
        };
        let text = header.and_then(Crs::text_of).map(str::to_owned);
        let system = source.reference().system;
        note_system(system.as_ref());
        Placed { grid, system, text }
    }

    fn write(
        &self,
        renderer: &mut Renderer,
        cloud: CloudId,
        request: PictureRequest,
        output: &Path,
        progress: &dyn Progress,
    ) -> Result<Vec<String>> {
        let map = Map {
            grid: self.grid,
            system: self.system.as_ref(),
            text: self.text.as_deref(),
            sample: Sample::Byte,
            bands: request.channels.bytes(),
            named: None,
            no_data: None,
            has_heights: false,
        };
        if output.extension().is_some_and(|own| own.eq_ignore_ascii_case("png")) {
            let world = world_file::create(&world_file::beside(output), &map)?;
            return tiled::write_map(renderer, cloud, request, output, world, progress);
        }
        geotiff::write(output, &map, |put| tiled::draw(renderer, cloud, request, progress, put))
    }
}

/// Facts for `--explain`, which outlive the source.
struct Facts {
    points: u64,
    files: usize,
    /// Nodes of the index, if it is one.
    nodes: Option<usize>,
    shows: String,
    why_shown: String,
    view: View,
    taken: Option<SelectionReport>,
    /// Points in the picture that are left; None if nothing is left out.
    left: Option<u64>,
    /// None if no shadows are cast.
    shadows: Option<shadows::Facts>,
    /// None if no strokes are painted.
    strokes: Option<strokes::Facts>,
}

fn explain(
    facts: &Facts,
    gpu: &Gpu,
    resident: &Resident,
    config: &FrameConfig,
    drawn: &Statistics,
    counts: &Counts,
    frame: &CompletedSubmission,
) -> String {
    let mut text = format!(
        "device: {} ({}), 64-bit atomics: {}\n",
        gpu.device.name, gpu.device.driver, gpu.device.int64_atomics
    );
    text += &format!(
        "cloud: {} points of {} files in {} nodes, {} MiB resident\n",
        facts.points,
        facts.files,
        facts.nodes.unwrap_or(resident.nodes.len()),
        resident.bytes() >> 20
    );
    text += &facts.taken.as_ref().map_or(String::new(), SelectionReport::to_string);
    text += &format!(
        "memory: {} MiB in buffers and images of the device\n",
        gpu.memory.allocated >> 20
    );
    text += &format!("color: {}, because {}\n", facts.shows, facts.why_shown);
    text += &format!(
        "drawn: {} points of {} nodes, {} nodes outside of the view; {:.1} position bytes a point, quantised by at most {:.6} px\n",
        drawn.points_drawn,
        drawn.nodes_drawn,
        drawn.nodes_outside,
        drawn.position_bytes as f64 / drawn.points_drawn.max(1) as f64,
        drawn.quantisation_px,
    );
    if let Some(left) = facts.left {
        text +=
            &format!("left: {left} points in the picture, by filters, opacities and clip boxes\n");
    }
    if resident.clips.active() > 0 {
        text += &format!(
            "clip: {} box{}; of {} nodes nothing is left\n",
            resident.clips.active(),
            if resident.clips.active() == 1 { "" } else { "es" },
            drawn.nodes_clipped + facts.taken.as_ref().map_or(0, |taken| taken.nodes_clipped),
        );
    }
    let scene = config.frame_context(&facts.view, resident);
    text += &format!(
        "spacing: {} m between points, and {} m between layers, {}; depths are known to {} m\n",
        scene.metres(scene.sampling.spacing_m),
        scene.metres(scene.layer_m(0.0)),
        if config.layer_m > 0.0 { "as asked for" } else { "by the spacing of points or pixels" },
        scene.metres(config.quantum_m),
    );
    text += &format!("light: {}\n", config.light);
    for (effect, reason) in &config.decisions.0 {
        text += &format!(
            "{}: {}, because {}\n",
            effect.name(),
            if reason.runs { "on" } else { "off" },
            reason.why
        );
    }
    if config.decisions.runs(Effect::Phong) {
        text += &format!("normals: {}\n", phong::source(&scene, &config.effects.phong.settings));
        let back =
            match (config.effects.phong.settings.backfaces, config.drops_back_faces(resident)) {
                (Backfaces::Keep, _) => "drawn",
                (_, true) => "left out",
                (_, false) => "drawn, since the files have no oriented normals",
            };
        text += &format!("back faces: {back}\n");
    }
    text += &facts.shadows.map_or(String::new(), |shadows| format!("shadows: {shadows}\n"));
    text += &facts.strokes.map_or(String::new(), |strokes| format!("strokes: {strokes}\n"));
    text += &format!("tiles: {counts}\n");
    text + &format!("plan:\n{}", frame.plan)
}

fn explain_json(
    facts: &Facts,
    gpu: &Gpu,
    resident: &Resident,
    config: &FrameConfig,
    drawn: &Statistics,
    counts: &Counts,
    frame: &CompletedSubmission,
) -> serde_json::Value {
    let effects: serde_json::Map<_, _> = config
        .decisions
        .0
        .iter()
        .map(|(effect, reason)| (effect.name().to_string(), serde_json::json!(reason)))
        .collect();
    let (scene, unit_m) = (config.frame_context(&facts.view, resident), resident.unit_m());
    serde_json::json!({
        "device": { "name": gpu.device.name, "driver": gpu.device.driver, "int64_atomics": gpu.device.int64_atomics, "bytes": gpu.memory.allocated },
        "cloud": { "points": facts.points, "files": facts.files, "nodes": facts.nodes.unwrap_or(resident.nodes.len()), "resident_bytes": resident.bytes() },
        "color": { "shows": facts.shows, "why": facts.why_shown },
        "clip": resident.clips,
        "left": facts.left,
        "camera": facts.view.camera,
        "size": facts.view.size,
        "drawn": drawn,
        "index": facts.taken,
        "spacing_m": resident.spacing_m() * unit_m,
        "layer_m": scene.layer_m(0.0) * unit_m,
        "quantum_m": config.quantum_m * unit_m,
        "light": config.light,
        "shadows": facts.shadows,
        "strokes": facts.strokes,
        "effects": effects,
        "tiles": counts,
        "settings": config.effects.counted_in(1.0 / unit_m),
        "passes": frame.passes.iter().map(|(name, _)| name).collect::<Vec<_>>(),
        "barriers": frame.plan.barriers(),
        "transient_bytes": frame.plan.bytes(),
    })
}

/// Wall-clock milliseconds of the program's stages.
struct Stages {
    last: Instant,
    done: Vec<(&'static str, f64)>,
}

impl Stages {
    fn new() -> Stages {
        Stages { last: Instant::now(), done: Vec::new() }
    }

    fn done(&mut self, name: &'static str) {
        let now = Instant::now();
        self.done.push((name, (now - self.last).as_secs_f64() * 1e3));
        self.last = now;
    }

    fn print(&self, frame: &CompletedSubmission) {
        for (name, ms) in &self.done {
            streams::say(format_args!("{name:<16} {ms:>9.1} ms"));
            if *name == "draw" {
                frame.passes.iter().for_each(|(pass, ms)| {
                    streams::say(format_args!("  {pass:<14} {ms:>9.1} ms on the device"))
                });
            }
        }
        streams::say(format_args!(
            "{:<16} {:>9.1} ms",
            "total",
            self.done.iter().map(|(_, ms)| ms).sum::<f64>()
        ));
    }
}
