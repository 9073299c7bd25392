//! The options that `view`, `render`, `bench` and `study` share: one definition.

use super::index::Bytes;
use super::source::Source;
use crate::cloud::attribute::{Attribute, Shown};
use crate::cloud::{ReadOptions, Wanted};
use crate::config;
use crate::cut::Detail;
use crate::error::{Error, Result};
use crate::gpu::Wish;
use crate::index::cache;
use crate::light::Light;
use crate::look::{Style, Wishes};
use crate::passes::Effects;
use crate::passes::project::Precision;
use crate::view::{Camera, Preset, View};
use std::path::{Path, PathBuf};

#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Picture")]
pub struct PictureOptions {
    /// Size of the picture, pixels
    #[arg(long, value_name = "WxH", default_value_t = Size(config::SIZE))]
    pub size: Size,
    /// Camera file: eye, target, up (world), fov_y, projection (perspective|orthographic), ortho_height
    #[arg(long, value_name = "CAM.json", conflicts_with = "view")]
    pub camera: Option<PathBuf>,
    /// Where to look from, when there is no --camera
    #[arg(long, value_enum, default_value_t = Preset::Fit)]
    pub view: Preset,
    /// What the points show [default: rgb where there is any, else intensity that varies, else elevation]
    #[arg(long, value_enum)]
    pub color: Option<Attribute>,
    /// Switches an effect and sets its values; repeatable
    #[arg(long, value_name = "NAME=off|on|auto[,key=value...]")]
    pub effect: Vec<String>,
    /// How points become a picture
    #[arg(long, value_enum, default_value_t)]
    pub style: Style,
    /// Where light comes from: headlight; direction:X,Y,Z, the way in which it travels; position:X,Y,Z, metres; both in the world
    #[arg(long, value_name = "KIND[:X,Y,Z]", default_value_t, allow_hyphen_values = true)]
    pub light: Light,
    /// Colour behind the points, sRGB
    #[arg(long, value_name = "RRGGBB", default_value_t = Background(config::BACKGROUND))]
    pub background: Background,
    #[command(flatten)]
    pub detail: DetailOptions,
}

/// How much of a cloud a picture shows.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Large clouds")]
pub struct DetailOptions {
    /// Points to draw at most [default: 4 for every pixel, a million at least]; what does not fit is drawn from coarser nodes, those that show it least first
    #[arg(long, value_name = "POINTS")]
    pub budget: Option<u64>,
    /// Refine until samples lie this near to each other [default: 1]; 0 draws every point that the budget allows, 4 a sixteenth as many, with gaps
    #[arg(long, value_name = "PIXELS", value_parser = pixels)]
    pub lod: Option<f64>,
    /// Device memory for nodes [default: 1GiB]; a picture that needs more is coarser, and says so
    #[arg(long, value_name = "BYTES")]
    pub pool: Option<Bytes>,
    /// Where indexes of files are kept that are too large to be drawn whole, or drawn with --budget or --lod [default: pointillist in the user's cache folder]
    #[arg(long, value_name = "FOLDER")]
    pub cache_dir: Option<PathBuf>,
    /// Keep no index: make it again each time
    #[arg(long, conflicts_with = "cache_dir")]
    pub no_cache: bool,
}

impl DetailOptions {
    pub fn of(&self, size: [u32; 2]) -> Detail {
        let usual = Detail::of(size);
        Detail { budget: self.budget.unwrap_or(usual.budget), lod_px: self.lod.unwrap_or(usual.lod_px), ..usual }
    }

    pub fn pool_bytes(&self) -> u64 {
        self.pool.map_or(config::POOL_BYTES, |bytes| bytes.0)
    }

    /// Whether files have to be indexed before they are drawn, and why.
    pub fn needs_index(&self, files: &[PathBuf]) -> Result<Option<String>> {
        if self.budget.is_some() || self.lod.is_some() {
            return Ok(Some("--budget and --lod choose among the nodes of an index".into()));
        }
        let points = crate::cloud::stream::about(files)?;
        let many = points > config::WHOLE_POINTS;
        Ok(many.then(|| format!("{points} points are more than are drawn whole ({})", config::WHOLE_POINTS)))
    }

    pub fn place(&self) -> Result<cache::Place> {
        match &self.cache_dir {
            _ if self.no_cache => Ok(cache::Place::Nowhere),
            Some(folder) => Ok(cache::Place::Folder(folder.clone())),
            None => cache::Place::usual(),
        }
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
    /// Run under the Vulkan validation layers; whatever they say is an error
    #[arg(long)]
    pub validate: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size(pub [u32; 2]);

/// No device has larger images.
const LARGEST_SIDE: u32 = 32_768;

impl std::str::FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Size, String> {
        let sides = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
        let valid = sides.filter(|sides: &[u32; 2]| sides.iter().all(|side| (1..=LARGEST_SIDE).contains(side)));
        valid.map(Size).ok_or(format!("{text:?} is not WIDTHxHEIGHT in pixels, 1 to {LARGEST_SIDE} each"))
    }
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{}", self.0[0], self.0[1])
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Background(pub [u8; 3]);

impl std::str::FromStr for Background {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Background, String> {
        let digits = text.strip_prefix('#').unwrap_or(text);
        let number = u32::from_str_radix(digits, 16).ok().filter(|_| digits.len() == 6);
        let number = number.ok_or(format!("{text:?} is not RRGGBB in hexadecimal digits"))?;
        Ok(Background([(number >> 16) as u8, (number >> 8) as u8, number as u8]))
    }
}

impl std::fmt::Display for Background {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [r, g, b] = self.0;
        write!(f, "{r:02x}{g:02x}{b:02x}")
    }
}

impl PictureOptions {
    pub fn wishes(&self) -> Result<Wishes> {
        let mut effects = Effects::of(self.style);
        for text in &self.effect {
            effects.set(text).map_err(|why| Error::Request(format!("--effect {text}: {why}")))?;
        }
        Ok(Wishes { effects, light: self.light, background: self.background.0, precision: Precision::Auto })
    }

    /// The columns to read for what the points are to show.
    pub fn wanted(&self) -> Wanted {
        match self.color {
            Some(attribute) => attribute.wanted(),
            None => Wanted { rgb: true, intensity: true, ..Wanted::default() },
        }
    }

    pub fn read_options(&self, strict: bool) -> ReadOptions {
        ReadOptions { wanted: self.wanted(), strict }
    }

    /// What the points show, and why.
    pub fn shown(&self, source: &Source) -> Result<(Shown, String)> {
        source.shown(self.color)
    }

    pub fn view(&self, source: &Source) -> Result<View> {
        let camera = match &self.camera {
            Some(path) => read_camera(path)?,
            None => Camera::framing(self.view, &source.core_points(), self.size.0),
        };
        View::new(camera, self.size.0)
    }
}

impl DeviceOptions {
    pub fn wish(&self) -> Wish {
        Wish { device: self.device.clone(), validate: self.validate, no_int64_atomics: false }
    }
}

pub fn read_camera(path: &Path) -> Result<Camera> {
    let text = std::fs::read_to_string(path).map_err(|error| Error::io("read", path, error))?;
    serde_json::from_str(&text)
        .map_err(|error| Error::format(path, format!("no camera ({error}); it needs at least {{\"eye\": [x,y,z], \"target\": [x,y,z]}}")))
}

pub fn name(attribute: Attribute) -> String {
    format!("{attribute:?}").to_lowercase()
}
