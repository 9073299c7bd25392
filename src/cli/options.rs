//! The options that `view`, `render`, `bench` and `study` share: one definition.

use super::units::{Bytes, Size};
use crate::cloud::attribute::{Attribute, DisplayAttribute, ExtraAttributes};
use crate::cloud::color::RgbRange;
use crate::cloud::strays::Treatment;
use crate::cloud::table::{Columns, Delimiter, TextOptions};
use crate::cloud::{ColumnSet, ReadOptions};
use crate::config;
use crate::error::{Error, Result};
use crate::gpu;
use crate::index::cache;
use crate::passes::phong::Normals;
use crate::passes::project::Precision;
use crate::passes::{Effects, Switch};
use crate::render::scene::Scene;
use crate::render::settings::{Background, RenderSettings, Style};
use crate::render::source::{OpenOptions, Source};
use crate::select::clip::{Clip, Clips};
use crate::select::lod::LodOptions;
use crate::select::opacity::{Opacities, Rule};
use crate::view::light::Light;
use crate::view::{Camera, Preset, View};
use std::path::{Path, PathBuf};

const MIB: u64 = 1 << 20;

/// How files are read whose colours do not say what they count to.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub struct ColorOptions {
    /// What the colours of the files count to [default: as most points show it, which `info` tells]
    #[arg(long, value_name = "0..1|255|65535")]
    pub rgb_range: Option<RgbRange>,
}

#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Picture")]
pub struct PictureOptions {
    /// Size of the picture, pixels
    #[arg(long, value_name = "WxH", default_value_t = Size(config::SIZE))]
    pub size: Size,
    /// Camera file: eye, target, up (world), fov_y, projection (perspective|orthographic), ortho_height
    #[arg(long, value_name = "CAM.json", conflicts_with = "view")]
    pub camera: Option<PathBuf>,
    /// What a window has saved: camera, color, effects, opacity, clip boxes, light and background
    #[arg(long, value_name = "SCENE.json", conflicts_with_all = ["camera", "view", "color", "effect", "style", "light", "layer", "opacity", "clip", "background"])]
    pub scene: Option<PathBuf>,
    /// Where to look from, when there is no --camera
    #[arg(long, value_enum, default_value_t = Preset::Fit)]
    pub view: Preset,
    /// What the points show [default: rgb where there is any, else intensity that varies, else elevation]
    #[arg(long, value_enum)]
    pub color: Option<Attribute>,
    /// Switches an effect and sets its values; repeatable
    #[arg(long, value_name = "NAME=off|on|auto[,key=value...]", value_parser = effect)]
    pub effect: Vec<String>,
    /// How points become a picture
    #[arg(long, value_enum, default_value_t)]
    pub style: Style,
    /// Where light comes from: headlight; direction:X,Y,Z, the way in which it travels; position:X,Y,Z, metres; both in the world
    #[arg(long, value_name = "KIND[:X,Y,Z]", default_value_t, allow_hyphen_values = true)]
    pub light: Light,
    /// Layer distance: surfaces nearer to each other than this are one, for filling by masks, transparency and shadows alike [default: four spacings of the points, or of the pixels where those are wider; of shadows as little as keeps surfaces from shading themselves]
    #[arg(long, value_name = "METRES", value_parser = metres, allow_hyphen_values = true)]
    pub layer: Option<f64>,
    /// How opaque points are, 0 to 1: all, or those of a class, return number, station (its name, `source N`, or its number in the list of `info`) or file; what applies to a point is multiplied; 0 leaves it out. Repeatable
    #[arg(
        long,
        value_name = "[class:N|return:N|station:S|file:F=]OPACITY",
        allow_hyphen_values = true
    )]
    pub opacity: Vec<Rule>,
    /// Which part of the cloud is there: what lies in a box, given by two opposite corners in the world, or in one of several; or what lies outside:X0,... of each. Faces are part of a box; inf is a number. Repeatable
    #[arg(long, value_name = "box|outside|off:X0,Y0,Z0,X1,Y1,Z1", allow_hyphen_values = true)]
    pub clip: Vec<Clip>,
    /// Whether points far outside of all others are drawn; they decide nothing either way
    #[arg(long, value_enum, default_value_t)]
    pub strays: Treatment,
    /// Colour behind the points, sRGB
    #[arg(long, value_name = "RRGGBB", default_value_t = Background(config::BACKGROUND))]
    pub background: Background,
    /// Memory for lists and fragments of strokes [default: 512MiB, or as --effect strokes=memory= says]; a painting that needs more is made in parts, and says so
    #[arg(long, value_name = "BYTES", value_parser = abuffer)]
    pub abuffer_memory: Option<Bytes>,
    #[command(flatten)]
    pub colors: ColorOptions,
    #[command(flatten)]
    pub detail: DetailOptions,
    #[command(flatten)]
    pub text: TextArguments,
    /// That of --scene.
    #[arg(skip)]
    pub saved_camera: Option<Camera>,
}

/// How much of a cloud a picture shows.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Large clouds")]
pub struct DetailOptions {
    /// Points to draw at most [default: 4 for every pixel, a million at least]; what does not fit is drawn from coarser nodes, those that show it least first
    #[arg(long, alias = "budget", value_name = "POINTS")]
    pub point_budget: Option<u64>,
    /// Refine until samples lie this near to each other [default: 1]; 0 draws every point that the budget allows, 4 a sixteenth as many, with gaps
    #[arg(long, value_name = "PIXELS", value_parser = pixels)]
    pub lod: Option<f64>,
    /// Device memory for nodes [default: 1GiB]; a picture that needs more is coarser, and says so
    #[arg(long, alias = "pool", value_name = "BYTES")]
    pub gpu_memory: Option<Bytes>,
    /// Where indexes of files are kept that are too large to be drawn whole, or drawn with --point-budget or --lod [default: pointillist in the user's cache folder]
    #[arg(long, value_name = "FOLDER")]
    pub cache_dir: Option<PathBuf>,
    /// Keep no index: make it again each time
    #[arg(long, conflicts_with = "cache_dir")]
    pub no_cache: bool,
    /// Shadows of an index that `pointillist shadows` has saved, of the same --light
    #[arg(long, value_name = "FILE.shadows")]
    pub shadows: Option<PathBuf>,
}

/// How text files are read, where that is not to be found out.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
#[command(next_help_heading = "Text files")]
pub struct TextArguments {
    /// What the columns are, in their order, - to skip one: x,y,z,-,red,green,blue; also nx ny nz intensity class return returns source time [default: by their names, else by their order and values]
    #[arg(long, value_name = "NAME,...")]
    pub columns: Option<Columns>,
    /// What lies between fields: , ; tab space [default: found out]
    #[arg(long, value_name = "MARK", allow_hyphen_values = true)]
    pub delimiter: Option<Delimiter>,
    /// The column that intensities are read from, by its name or as "column 7": `--scalar "Illuminance (PCV)" --color intensity` shows it
    #[arg(long, value_name = "NAME", value_parser = lasting)]
    pub scalar: Option<&'static str>,
}

/// Keeps a name of the command line for as long as the process lives.
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

    pub fn opening(&self, read: ReadOptions, light: Light) -> OpenOptions {
        let chosen = self.point_budget.is_some() || self.lod.is_some();
        let index = chosen.then_some("--point-budget and --lod choose among the nodes of an index");
        let place = match &self.cache_dir {
            _ if self.no_cache => Some(cache::CacheLocation::Temporary),
            folder => folder.clone().map(cache::CacheLocation::Folder),
        };
        OpenOptions {
            read,
            index,
            place,
            shadows: self.shadows.clone().map(|path| (path, light)),
            fault: None,
        }
    }
}

/// What an effect is asked for is refused where it is said, whatever else is.
pub fn effect(text: &str) -> std::result::Result<String, String> {
    Effects::default().set(text).map(|()| text.to_string())
}

/// Of the setting's own limits.
fn abuffer(text: &str) -> std::result::Result<Bytes, String> {
    let bytes = text.parse::<Bytes>().map_err(|error| error.to_string())?;
    if (MIB..=65_536 * MIB).contains(&bytes.0) {
        Ok(bytes)
    } else {
        Err("from 1MiB to 64GiB".into())
    }
}

fn metres(text: &str) -> std::result::Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| *number > 0.0 && number.is_finite());
    number.ok_or(format!("{text:?} is not a number of metres above 0"))
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
    /// Run under the Vulkan validation layers; whatever they say is an error
    #[arg(long)]
    pub validate: bool,
    /// Treat the device as one most of whose memory the CPU cannot write to; for tests
    #[arg(long, hide = true)]
    pub unmapped: bool,
}

impl PictureOptions {
    /// The same with what a scene's file says in its place.
    pub fn with_scene(&self) -> Result<PictureOptions> {
        let Some(path) = &self.scene else { return Ok(self.clone()) };
        let Scene { camera, color, settings, opacities, clips, lod } = Scene::read(path)?;
        let effect = settings.effects.clone().list().iter().map(ToString::to_string).collect();
        let (light, background, layer) = (
            settings.light,
            Background(settings.background),
            Some(settings.layer_m).filter(|layer| *layer > 0.0),
        );
        let (opacity, clip) = (opacities.0, clips.0);
        let own = &self.detail;
        let detail = DetailOptions {
            point_budget: own.point_budget.or(lod.budget),
            lod: own.lod.or(lod.lod_px),
            ..own.clone()
        };
        Ok(PictureOptions {
            saved_camera: Some(camera),
            color,
            effect,
            light,
            background,
            layer,
            opacity,
            clip,
            detail,
            ..self.clone()
        })
    }

    pub fn settings(&self) -> Result<RenderSettings> {
        let mut effects = Effects::of(self.style);
        for text in &self.effect {
            effects.set(text).map_err(|why| Error::Request(format!("--effect {text}: {why}")))?;
        }
        if let Some(Bytes(bytes)) = self.abuffer_memory {
            effects.strokes.settings.memory = bytes as f64 / MIB as f64;
        }
        Ok(RenderSettings {
            effects,
            light: self.light,
            background: self.background.0,
            precision: Precision::Auto,
            layer_m: self.layer.unwrap_or(0.0),
        })
    }

    /// The columns to read for what the points are to show, and to tell stations apart where colours of several are shown together.
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

    /// What points bring to the device beside what they show.
    pub fn further(&self) -> ExtraAttributes {
        let asked = |asks: &dyn Fn(&Effects) -> bool| {
            self.settings().is_ok_and(|settings| asks(&settings.effects))
        };
        ExtraAttributes {
            kind: self.opacities().needs_kinds(),
            normal: asked(&|effects| effects.phong.wants_normals(self.light)),
            strokes: asked(&|effects| effects.strokes.switch == Switch::On),
            // That is up to the index.
            light: false,
        }
    }

    pub fn opacities(&self) -> Opacities {
        Opacities(self.opacity.clone())
    }

    pub fn clips(&self) -> Clips {
        Clips(self.clip.clone())
    }

    pub fn read_options(&self, strict: bool) -> ReadOptions {
        ReadOptions {
            text: self.text.options(),
            rgb_range: self.colors.rgb_range,
            strays: self.strays,
            ..ReadOptions::new(self.wanted(), strict)
        }
    }

    /// What the points show, and why.
    pub fn shown(&self, source: &Source) -> Result<(DisplayAttribute, String)> {
        if let Some(lost) = self.opacities().lost(source.stations()) {
            return Err(Error::Request(format!("--opacity: {lost}")));
        }
        let (mut shown, why) = source.shown(self.color)?;
        shown.further = ExtraAttributes { light: source.has_light(), ..self.further() };
        shown.coded &= self.settings()?.effects.exposure.switch != Switch::Off;
        if shown.further.normal && !source.has_normals() {
            if self.settings()?.effects.phong.settings.normals == Normals::File {
                return Err(Error::Request(format!(
                    "phong=normals=file: these points have none; {}",
                    source.how_to_find(Attribute::Normal)
                )));
            }
            shown.further.normal = false;
        }
        Ok((shown, why))
    }

    /// The one that is asked for.
    pub fn camera(&self) -> Result<Option<Camera>> {
        self.camera.as_deref().map(read_camera).transpose().map(|read| read.or(self.saved_camera))
    }

    pub fn view(&self, source: &Source) -> Result<View> {
        let camera = match self.camera()? {
            Some(camera) => camera,
            None => Camera::framing(self.view, &source.core_points(), self.size.0),
        };
        View::new(camera, self.size.0)
    }
}

impl DeviceOptions {
    pub fn wish(&self) -> gpu::DeviceOptions {
        gpu::DeviceOptions {
            device: self.device.clone(),
            validate: self.validate,
            unmapped: self.unmapped,
            ..gpu::DeviceOptions::default()
        }
    }
}

pub fn read_camera(path: &Path) -> Result<Camera> {
    let text = std::fs::read_to_string(path).map_err(|error| Error::io("read", path, error))?;
    serde_json::from_str(&text).map_err(|error| {
        Error::format(
            path,
            format!(
                "no camera ({error}); it needs at least {{\"eye\": [x,y,z], \"target\": [x,y,z]}}"
            ),
        )
    })
}
