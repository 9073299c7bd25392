//! Options that `view`, `render`, `bench` and `study` share.

use super::filters::{ClipOptions, FilterOptions};
use super::named::named;
use super::streams;
use super::units::{self, Bytes, Size, note_length};
use crate::cloud::attribute::{Attribute, DisplayAttribute, ExtraAttributes};
use crate::cloud::color_scale::{self, ColorScale, Ramp, number};
use crate::cloud::filter::Filter;
use crate::cloud::length::Length;
use crate::cloud::rgb_range::RgbRange;
use crate::cloud::strays::Treatment;
use crate::cloud::table::{Columns, Delimiter, TextOptions};
use crate::cloud::up::UpOption;
use crate::cloud::{ColumnSet, ReadOptions};
use crate::config;
use crate::error::{Error, Result};
use crate::gpu;
use crate::index::cache::CacheLocation;
use crate::names::Named;
use crate::network;
use crate::output::annotations::{Shown, no_north};
use crate::passes::phong::Normals;
use crate::passes::project::Precision;
use crate::passes::splat::PointSize;
use crate::passes::{Effects, Switch};
use crate::progress::Progress;
use crate::render::annotations::Annotations;
use crate::render::scene::Scene;
use crate::render::settings::{Background, RenderSettings, Style};
use crate::render::source::{OpenOptions, Source, bounds_of};
use crate::renderer::{Renderer, RendererOptions};
use crate::select::clip::Clips;
use crate::select::lod::LodOptions;
use crate::select::opacity::{Opacities, Rule};
use crate::view::light::Light;
use crate::view::{Camera, Covered, Preset, View};
use glam::DVec3;
use std::path::PathBuf;

const MIB: u64 = 1 << 20;

/// How colours are read from files that do not state their range.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub struct ColorOptions {
    /// Largest value of a colour channel in the files [default: found from most points; `info`
    /// prints it]
    #[arg(long, hide_short_help = true, value_name = "0..1|255|65535")]
    pub rgb_range: Option<RgbRange>,
}

/// How numbers and channels of colours become colours.
#[derive(clap::Args, Clone, Copy, Debug)]
#[command(next_help_heading = "Colours")]
pub struct ScaleOptions {
    /// Ramp of heights and intensities [default: terrain, grey]
    #[arg(long, value_parser = named::<Ramp>())]
    pub ramp: Option<Ramp>,
    /// Values at its ends [default: 2nd and 98th percentile]
    ///
    /// Channels of colours up to 255
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true)]
    pub range: Option<Range>,
    /// Added to colours and places on the ramp, -1 to 1
    #[arg(long, value_name = "NUMBER", default_value_t = 0.0, value_parser = number, allow_hyphen_values = true)]
    pub brightness: f64,
    /// Slope of colours about the middle grey
    #[arg(long, value_name = "NUMBER", default_value_t = 1.0, value_parser = number, allow_hyphen_values = true)]
    pub contrast: f64,
    /// Above 1 brightens what is dark
    ///
    /// Black and white stay
    #[arg(long, value_name = "NUMBER", default_value_t = 1.0, value_parser = number, allow_hyphen_values = true)]
    pub gamma: f64,
}

/// What a report needs in a picture; never in --exr.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "In the picture, for reports")]
pub struct ReportOptions {
    /// Title at the top
    #[arg(long, value_name = "TEXT")]
    pub title: Option<String>,
    /// Colours of the numbers or labels that points show
    #[arg(long)]
    pub legend: bool,
    /// Bar of a round length
    ///
    /// In perspective, at the depth of the points in the middle
    #[arg(long)]
    pub scale_bar: bool,
    /// Arrow to the north
    #[arg(long)]
    pub north_arrow: bool,
    /// Coordinates along the edges of maps, in other views the axes
    #[arg(long)]
    pub axes: bool,
}

impl From<Annotations> for ReportOptions {
    fn from(own: Annotations) -> ReportOptions {
        let Annotations { title, legend, scale_bar, north_arrow, axes } = own;
        ReportOptions { title, legend, scale_bar, north_arrow, axes }
    }
}

impl ReportOptions {
    pub fn annotations(&self) -> Annotations {
        let ReportOptions { title, legend, scale_bar, north_arrow, axes } = self.clone();
        Annotations { title, legend, scale_bar, north_arrow, axes }
    }
}

/// The ends of a ramp.
#[derive(Clone, Copy, Debug)]
pub struct Range(pub [f64; 2]);

fn range(text: &str) -> std::result::Result<Range, String> {
    color_scale::range(text).map(Range)
}

impl ScaleOptions {
    pub fn scale(&self) -> Result<ColorScale> {
        let ScaleOptions { ramp, range, brightness, contrast, gamma } = *self;
        let range = range.map(|Range(ends)| ends);
        let scale = ColorScale { ramp, range, brightness, contrast, gamma };
        scale.checked().map_err(|why| Error::Request(format!("--{why}")))
    }
}

impl From<ColorScale> for ScaleOptions {
    fn from(scale: ColorScale) -> ScaleOptions {
        let ColorScale { ramp, range, brightness, contrast, gamma } = scale;
        ScaleOptions { ramp, range: range.map(Range), brightness, contrast, gamma }
    }
}

#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Picture")]
pub struct PictureOptions {
    /// Size of the picture, pixels
    #[arg(long, value_name = "WxH", default_value_t = Size(config::SIZE))]
    pub size: Size,
    /// Camera file: eye, target, up, fov_y, projection, ortho_height
    ///
    /// World coordinates (of files in degrees metres on a plane, as `info` says); projection is
    /// perspective or orthographic
    #[arg(long, value_name = "CAM.json", conflicts_with = "view")]
    pub camera: Option<PathBuf>,
    /// Scene file, as the window saves it, in place of --camera and of looks
    #[arg(long, value_name = "SCENE.json", conflicts_with_all = ["camera", "view", "color", "effect", "style", "point_size", "light", "layer", "opacity", "only", "not", "clip", "background", "ramp", "range", "brightness", "contrast", "gamma"])]
    pub scene: Option<PathBuf>,
    /// Where to look from if no --camera is given
    #[arg(long, value_parser = named::<Preset>(), default_value = Preset::Fit.name())]
    pub view: Preset,
    /// Axis of the coordinates that points up
    #[arg(long, hide_short_help = true, value_parser = named::<UpOption>(), default_value = UpOption::Auto.name())]
    pub up: UpOption,
    /// What the points show [default: rgb, else intensity, else elevation]
    ///
    /// Intensity only if it varies
    #[arg(long, value_name = "rgb|intensity|elevation|class|return|time|...|extra:NAME")]
    pub color: Option<Attribute>,
    /// Switch an effect and set its values; repeatable
    #[arg(long, value_name = "NAME=off|on|auto[,key=value...]", value_parser = effect)]
    pub effect: Vec<String>,
    /// How points are drawn [default: auto; splats with --point-size]
    #[arg(long, value_parser = named::<Style>())]
    pub style: Option<Style>,
    /// Diameter of points, for --style splats and points: 3, 0.05m or 0.2ft; auto: by their spacing
    #[arg(long, value_name = "PIXELS|LENGTHm|auto", allow_hyphen_values = true)]
    pub point_size: Option<PointSize>,
    /// Light: headlight, the direction in which it travels, or its position, in the world
    #[arg(
        long,
        value_name = "headlight|direction:X,Y,Z|position:X,Y,Z",
        default_value_t,
        allow_hyphen_values = true
    )]
    pub light: Light,
    /// Layer distance: surfaces nearer to each other are one, for fill=method=mask, transparency
    /// and shadows, in the files' unit, or such as 0.1m [default: four spacings of points or
    /// pixels]
    #[arg(long, hide_short_help = true, value_name = "LENGTH", value_parser = units::length, allow_hyphen_values = true)]
    pub layer: Option<Length>,
    /// Opacity, 0 to 1, of all points or these; 0 hides. Repeatable
    ///
    /// Stations are those of `info`; opacities multiply
    #[arg(
        long,
        value_name = "[class:N|return:N|station:S|file:F=]OPACITY",
        allow_hyphen_values = true
    )]
    pub opacity: Vec<Rule>,
    /// Show or hide points far outside of all others
    #[arg(long, hide_short_help = true, value_parser = named::<Treatment>(), default_value = Treatment::Show.name())]
    pub strays: Treatment,
    /// Colour behind the points, sRGB [default: 181b20; none in maps]
    #[arg(long, value_name = "RRGGBB")]
    pub background: Option<Background>,
    /// Memory for fragments of strokes [default: 512MiB]; beyond it a picture is painted in parts
    #[arg(long, hide_short_help = true, value_name = "BYTES", value_parser = abuffer)]
    pub abuffer_memory: Option<Bytes>,
    #[command(flatten)]
    pub colors: ColorOptions,
    #[command(flatten)]
    pub filters: FilterOptions,
    #[command(flatten)]
    pub clips: ClipOptions,
    #[command(flatten)]
    pub scale: ScaleOptions,
    #[command(flatten)]
    pub report: ReportOptions,
    #[command(flatten)]
    pub detail: DetailOptions,
    #[command(flatten)]
    pub text: TextArguments,
    /// The camera of `--scene`.
    #[arg(skip)]
    pub saved_camera: Option<Camera>,
}

/// How finely a large cloud is drawn.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Large clouds")]
pub struct DetailOptions {
    /// Most points to draw [default: 4 a pixel, at least a million]; beyond it, nodes are coarser
    #[arg(long, hide_short_help = true, alias = "budget", value_name = "POINTS")]
    pub point_budget: Option<u64>,
    /// Refine until samples are this near to each other [default: 1, and 0 for maps]; 0 draws all
    /// points within
    /// --point-budget
    #[arg(long, hide_short_help = true, value_name = "PIXELS", value_parser = pixels)]
    pub lod: Option<f64>,
    /// Device memory for nodes of an index [default: 1GiB]; beyond it a picture is coarser
    #[arg(long, hide_short_help = true, alias = "pool", value_name = "BYTES")]
    pub gpu_memory: Option<Bytes>,
    #[command(flatten)]
    pub cache: CacheOptions,
    /// Shadows of the index, as `pointillist shadows` saved them for the same --light
    #[arg(long, hide_short_help = true, value_name = "FILE.shadows")]
    pub shadows: Option<PathBuf>,
}

/// What is kept on the disk for the next time.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "Large clouds")]
pub struct CacheOptions {
    /// Folder for indexes of large files, and for what servers have sent [default: pointillist in
    /// the user's cache folder]
    #[arg(long, hide_short_help = true, value_name = "FOLDER")]
    pub cache_dir: Option<PathBuf>,
    /// Keep neither; build and fetch again each time
    #[arg(long, hide_short_help = true, conflicts_with = "cache_dir")]
    pub no_cache: bool,
    /// Most bytes to keep of what servers have sent [default: 4GiB]
    #[arg(long, hide_short_help = true, value_name = "BYTES")]
    pub cache_size: Option<Bytes>,
}

impl CacheOptions {
    /// Returns the place; `None` for the default one.
    pub fn place(&self) -> Option<CacheLocation> {
        match &self.cache_dir {
            _ if self.no_cache => Some(CacheLocation::Temporary),
            folder => folder.clone().map(CacheLocation::Folder),
        }
    }

    /// Sets where answers of servers are kept, and lets signals end the waiting for them.
    pub fn use_for_servers(&self, progress: &dyn Progress) {
        let folder = match self.place().map_or_else(CacheLocation::user_folder, Ok) {
            Ok(CacheLocation::Folder(folder)) => Some(folder.join("network")),
            // Without a home folder, clouds on servers are drawn all the same.
            Ok(CacheLocation::Temporary) | Err(_) => None,
        };
        let most = self.cache_size.map_or(network::CACHE_BYTES, |bytes| bytes.0);
        network::set_cache(network::Cache { folder, most });
        progress.when_interrupted(Box::new(network::stop));
    }
}

/// How text files are read where detection would fail.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
#[command(next_help_heading = "Text files")]
pub struct TextArguments {
    /// The columns in order, - for one to skip: x,y,z,-,red,green,blue; also nx ny nz intensity
    /// class return returns source time [default: by names, else by order and values]
    #[arg(long, hide_short_help = true, value_name = "NAME,...")]
    pub columns: Option<Columns>,
    /// Separator of fields: , ; tab space [default: detected]
    #[arg(long, hide_short_help = true, value_name = "MARK", allow_hyphen_values = true)]
    pub delimiter: Option<Delimiter>,
    /// Column to read intensities from, by its name or as "column 7": `--scalar "Illuminance (PCV)"
    /// --color intensity` shows it
    #[arg(long, hide_short_help = true, value_name = "NAME", value_parser = lasting)]
    pub scalar: Option<&'static str>,
}

/// Leaks a name of the command line, so that it lives as long as the process.
fn lasting(name: &str) -> std::result::Result<&'static str, String> {
    Ok(name.to_owned().leak())
}

impl TextArguments {
    pub fn options(&self) -> TextOptions {
        TextOptions { delimiter: self.delimiter, columns: self.columns, scalar: self.scalar }
    }
}

impl DetailOptions {
    pub fn lod(&self) -> LodOptions {
        LodOptions { budget: self.point_budget, lod_px: self.lod }
    }

    pub fn pool_bytes(&self) -> u64 {
        self.gpu_memory.map_or(config::POOL_BYTES, |bytes| bytes.0)
    }

    /// Returns how files are opened, to be painted as strokes or not.
    pub fn opening(
        &self,
        read: ReadOptions,
        filter: Filter,
        light: Light,
        strokes: bool,
    ) -> OpenOptions {
        let (index, place) = (self.lod().index_for(), self.cache.place());
        OpenOptions {
            read,
            filter,
            index,
            indexes_octrees: false,
            strokes,
            place,
            shadows: self.shadows.clone().map(|path| (path, light)),
            fault: None,
        }
    }
}

/// Checks one `--effect`, so that errors name the option that is wrong.
pub fn effect(text: &str) -> std::result::Result<String, String> {
    Effects::default().set(text).map(|()| text.to_string())
}

/// Parses `--abuffer-memory` within its limits.
fn abuffer(text: &str) -> std::result::Result<Bytes, String> {
    let bytes = text.parse::<Bytes>().map_err(|error| error.to_string())?;
    if (MIB..=65_536 * MIB).contains(&bytes.0) {
        Ok(bytes)
    } else {
        Err("it must be from 1MiB to 64GiB".into())
    }
}

fn pixels(text: &str) -> std::result::Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| *number >= 0.0 && number.is_finite());
    number.ok_or(format!("{text:?} is not a number of pixels, 0 or more"))
}

#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "Device")]
pub struct DeviceOptions {
    /// Vulkan device: part of its name, or its index
    #[arg(long, value_name = "NAME|INDEX")]
    pub device: Option<String>,
    /// Run under the Vulkan validation layers; each of their messages is an error
    #[arg(long, hide_short_help = true)]
    pub validate: bool,
    /// Treat the device as one whose memory the CPU cannot map; for tests
    #[arg(long, hide = true)]
    pub unmapped: bool,
}

impl PictureOptions {
    /// Returns the options with those that `--scene` holds in their place.
    pub fn with_scene(&self) -> Result<PictureOptions> {
        let Some(path) = &self.scene else { return Ok(self.clone()) };
        let Scene { camera, color, scale, settings, opacities, filter, clips, lod, annotations } =
            Scene::read(path)?;
        let effect = settings.effects.clone().list().iter().map(ToString::to_string).collect();
        let (light, background, layer) = (
            settings.light,
            Some(Background(settings.background)),
            Some(settings.layer).filter(|layer| layer.number() > 0.0),
        );
        let (opacity, filters) = (opacities.0, FilterOptions::from(filter));
        let clips = ClipOptions { clip: clips.0 };
        let own = &self.detail;
        let detail = DetailOptions {
            point_budget: own.point_budget.or(lod.budget),
            lod: own.lod.or(lod.lod_px),
            ..own.clone()
        };
        Ok(PictureOptions {
            saved_camera: Some(camera),
            color,
            scale: scale.into(),
            effect,
            light,
            background,
            layer,
            opacity,
            filters,
            clips,
            detail,
            report: self.report.annotations().or(annotations).into(),
            ..self.clone()
        })
    }

    pub fn settings(&self) -> Result<RenderSettings> {
        // Wrong numbers are refused before anything is read.
        self.scale.scale()?;
        let usual = if self.point_size.is_some() { Style::Splats } else { Style::Auto };
        let style = self.style.unwrap_or(usual);
        let mut effects = Effects::of(style);
        if let Some(size) = self.point_size {
            if !matches!(style, Style::Points | Style::Splats) {
                return Err(Error::Request(
                    "--point-size is for --style points and splats; the others find their own sizes".into(),
                ));
            }
            effects.splat.switch = Switch::On;
            effects.splat.settings.set_size(size);
        }
        for text in &self.effect {
            effects.set(text).map_err(|why| Error::Request(format!("--effect {text}: {why}")))?;
        }
        if let Some(Bytes(bytes)) = self.abuffer_memory {
            effects.strokes.settings.memory = bytes as f64 / MIB as f64;
        }
        Ok(RenderSettings {
            effects,
            light: self.light,
            background: self.background.map_or(config::BACKGROUND, |Background(color)| color),
            precision: Precision::Auto,
            layer: self.layer.unwrap_or_default(),
        })
    }

    /// Returns the columns to read: those that points show, and the station if colours of several
    /// stations may be shown together.
    pub fn wanted(&self) -> ColumnSet {
        let shown = match self.color {
            Some(attribute) => {
                ColumnSet { source: attribute.has_luminance(), ..ColumnSet::default() }
                    .and(attribute.wanted())
            }
            None => ColumnSet { rgb: true, intensity: true, source: true, ..ColumnSet::default() },
        };
        shown.and(self.further().wanted())
    }

    /// Returns what points bring to the device besides the displayed attribute.
    pub fn further(&self) -> ExtraAttributes {
        let asked = |asks: &dyn Fn(&Effects) -> bool| {
            self.settings().is_ok_and(|settings| asks(&settings.effects))
        };
        ExtraAttributes {
            kind: self.opacities().needs_kinds(),
            normal: asked(&|effects| effects.phong.wants_normals(self.light)),
            strokes: asked(&|effects| effects.strokes.switch == Switch::On),
            // The index decides.
            light: false,
        }
    }

    pub fn opacities(&self) -> Opacities {
        Opacities(self.opacity.clone())
    }

    pub fn clips(&self) -> Clips {
        self.clips.clips()
    }

    pub fn read_options(&self, strict: bool) -> ReadOptions {
        ReadOptions {
            text: self.text.options(),
            rgb_range: self.colors.rgb_range,
            strays: self.strays,
            up: self.up,
            ..ReadOptions::new(self.wanted(), strict)
        }
    }

    /// Returns how files are opened.
    pub fn opening(&self, strict: bool) -> OpenOptions {
        let (read, filter) = (self.read_options(strict), self.filters.filter());
        self.detail.opening(read, filter, self.light, self.further().strokes)
    }

    /// Returns what the points show, and why.
    pub fn shown(&self, source: &Source) -> Result<(DisplayAttribute, String)> {
        if let Some(lost) = self.opacities().lost(source.stations()) {
            return Err(Error::Request(format!("--opacity: {lost}")));
        }
        let (mut shown, why) = source.shown(self.color)?;
        let further = self.further();
        let kind = further.kind || source.is_filtered();
        shown.further = ExtraAttributes { kind, light: source.has_light(), ..further };
        shown.coded &= self.settings()?.effects.exposure.switch != Switch::Off;
        if shown.further.normal && !source.has_normals() {
            if self.settings()?.effects.phong.settings.normals == Normals::File {
                return Err(Error::Request(format!(
                    "phong=normals=file: the points have no normals; {}",
                    source.how_to_find(Attribute::Normal)
                )));
            }
            shown.further.normal = false;
        }
        Ok((shown, why))
    }

    /// Returns the camera of `--camera` or `--scene`; None if neither is given.
    pub fn camera(&self) -> Result<Option<Camera>> {
        self.camera.as_deref().map(Camera::read).transpose().map(|read| read.or(self.saved_camera))
    }

    /// Opens a device, and a renderer with these settings.
    pub fn renderer(&self, device: &DeviceOptions) -> Result<Renderer> {
        let options = RendererOptions {
            memory_budget: self.detail.pool_bytes(),
            ..RendererOptions::default()
        };
        let mut renderer = Renderer::open_device(&device.to_options(), options)?;
        self.apply(&mut renderer)?;
        Ok(renderer)
    }

    /// Says what has another meaning for these files than it may seem to have: lengths that are not
    /// in metres, and tones of labels, which have none.
    pub fn note_meanings(&self, source: &Source, shown: &DisplayAttribute) {
        let unit = source.reference().unit();
        if let Some(PointSize::Metres(metres)) = self.point_size {
            note_length("--point-size", Length::Metres(metres), &unit);
        }
        if let Some(layer) = self.layer {
            note_length("--layer", layer, &unit);
        }
        let is_toned = self.scale.scale().is_ok_and(|scale| !scale.is_neutral());
        if shown.attribute.is_label() && is_toned {
            streams::note(format_args!(
                "{} has labels, whose colours --ramp, --range, --brightness, --contrast and --gamma leave as they are",
                shown.attribute.name()
            ));
        }
    }

    /// Gives a renderer these settings, filters and colours.
    pub fn apply(&self, renderer: &mut Renderer) -> Result<()> {
        renderer.set_settings(self.settings()?);
        renderer.set_filters(self.opacities(), self.clips());
        renderer.set_color_scale(self.scale.scale()?);
        Ok(())
    }

    /// Returns what annotations name of a picture.
    pub fn named(&self, source: &Source, mut attribute: DisplayAttribute) -> Result<Shown> {
        let up = source.up();
        if let Some(why) = no_north(up).filter(|_| self.report.north_arrow) {
            return Err(Error::Request(format!(
                "--north-arrow: {why}; leave it out, or give --up z"
            )));
        }
        attribute.scale = self.scale.scale()?;
        Ok(Shown {
            attribute,
            reference: source.reference(),
            up,
            bounds: if self.report.scale_bar { bounds_of(&source.core_points()) } else { None },
            counts: source.counts().unwrap_or_default(),
            stations: source.stations().to_vec(),
        })
    }

    /// Returns the view: from the given camera, or one that frames the cloud beside annotations.
    pub fn view(&self, source: &Source, shown: &Shown) -> Result<View> {
        self.view_of(&source.framed_points(&self.clips()), source.up().axis(), shown)
    }

    /// Returns the first view of a turn around an axis, from the given camera, or one that frames
    /// the cloud all around; and a point on the axis.
    pub fn turning_view(&self, source: &Source, shown: &Shown) -> Result<(View, DVec3)> {
        if let Some(camera) = self.camera()? {
            return Ok((self.view(source, shown)?, camera.target));
        }
        let up = source.up().axis();
        let (points, middle) = Camera::swept(&source.framed_points(&self.clips()), up);
        Ok((self.view_of(&points, up, shown)?, middle))
    }

    /// Returns the view: from the given camera, or one that frames the cloud, whatever is drawn
    /// over it.
    pub fn plain_view(&self, source: &Source) -> Result<View> {
        let points = source.framed_points(&self.clips());
        self.framing(&points, source.up().axis(), Covered::default())
    }

    fn framing(&self, points: &[DVec3], up: DVec3, covered: Covered) -> Result<View> {
        let size = self.size.0;
        let framing = || Camera::framing_beside(self.view, points, size, covered, up);
        View::new(self.camera()?.unwrap_or_else(framing), size)
    }

    fn view_of(&self, points: &[DVec3], up: DVec3, shown: &Shown) -> Result<View> {
        let beside = |covered| self.framing(points, up, covered);
        // Coordinates along the edges are those of the view.
        let whole = beside(Covered::default())?;
        match self.report.annotations().covered(&whole, shown) {
            covered if covered == Covered::default() => Ok(whole),
            covered => beside(covered),
        }
    }
}

impl DeviceOptions {
    pub fn to_options(&self) -> gpu::DeviceOptions {
        gpu::DeviceOptions {
            device: self.device.clone(),
            validate: self.validate,
            overrides: gpu::TestOverrides { unmapped: self.unmapped, ..Default::default() },
            ..gpu::DeviceOptions::default()
        }
    }
}
