//! One file a pass: from handles to handles. The trunk (project, resolve, composite) and the registry of effects.

pub mod antialias;
pub mod ao;
pub mod composite;
pub mod count_visible;
pub mod edl;
pub mod encode;
pub mod exposure;
pub mod fill;
pub mod luminance;
pub mod phong;
pub mod predicate;
pub mod project;
pub mod resolve;
pub mod shadows;
pub mod shape;
pub mod smooth;
pub mod strokes;
pub mod surface_normal;
pub mod tile_stats;
pub mod transparency;
pub mod visibility;

use crate::cloud::attribute::Attribute;
use crate::graph::{Buffer, Graph, Image};
use crate::index::format::Balance;
use crate::resident::{PointDensity, Resident, StationOverlap};
use crate::view::View;
use crate::view::light::Light;
use std::sync::Arc;

/// What the screen-space passes hand on.
pub struct GBuffer {
    /// Planar depth, metres; infinite where nothing is, minus infinite where something is that is not known yet.
    pub depth: Image,
    /// Planar depth as the points were projected.
    pub projected_depth: Image,
    /// Point ids; of pixels that were filled with one point's values, that one's.
    pub index: Image,
    /// Point ids as the points were projected.
    pub projected_index: Image,
    /// Linear colour multiplied by its alpha, which is how opaque a surface is, and 0 where none is.
    pub color: Image,
    /// Layers before this one and with it, where they let light through.
    pub accumulation: Option<transparency::Accumulation>,
    /// For every node by its number, the address of the page with its points' normals, where they have brought any.
    pub normal_pages: Option<Buffer>,
    /// How much of a light reaches each point, where shadows are cast.
    pub light_visibility: Option<shadows::LightVisibility>,
    /// How much of the light reaches each pixel's surface, where lighting is to take that into account: red, green and blue alike. What fills colours fills it like them.
    pub shadow_factor: Option<Image>,
    /// What each pixel's points add up to, where luminance is corrected.
    pub luminance_sums: Option<luminance::Sums>,
    /// What is left of the light, which multiplies the colour; all of it where no effect takes any.
    pub shading: Option<Image>,
    /// Of every node of the frame, how far apart its points are, metres; f32.
    pub spacings: Buffer,
    /// The least and the most that may be on the screen, pixels; infinite where the camera is within a node.
    pub spacing_px: [f64; 2],
    /// How far apart pixels are whose depths are not those of one point, pixels; 1 where each is its own or lies between those around.
    pub flat_px: u32,
    /// Where each pixel's depth was taken from, if from others: four rows a texel (glsl/lib/depth_source.glsl).
    pub depth_source: Option<Image>,
    /// Tiles with pixels of unknown depth, where a pass has looked for them.
    pub holes: Option<Holes>,
}

impl GBuffer {
    /// What is filled alike: colours, and how much of the light reaches them.
    pub fn colors(&self) -> impl Iterator<Item = &Image> {
        [Some(&self.color), self.shadow_factor.as_ref()].into_iter().flatten()
    }
}

/// A list of tiles of 8 x 8 pixels, made on the device (glsl/lib/tile.glsl).
pub struct Holes {
    pub list: Buffer,
    /// Of every tile, the width of the kernel that has found some, pixels; u32.
    pub kernels: Buffer,
    /// Of the widest kernel that has looked for them.
    pub widest: u32,
    /// Where that was found.
    pub scattered: Option<Scattered>,
}

/// What visibility knows of points that lie on no surface.
pub struct Scattered {
    /// What tiles hold (glsl/lib/tile.glsl).
    pub tiles: Buffer,
    /// Two words a tile, a bit a pixel: points that are hidden.
    pub invisible: Buffer,
    /// The same: points that are led from all sides, and may be seen all the same.
    pub scattered: Buffer,
}

/// Of what is no effect: normals look at neighbours.
const OTHERS_REACH_PX: u32 = 2;

/// Tiles across and down a picture.
pub fn tiles(size: [u32; 2]) -> [u32; 2] {
    size.map(|side| side.div_ceil(TILE_PX))
}

/// As in glsl/lib/tile.glsl.
pub const TILE_PX: u32 = 8;
/// Cells of the coarsest level of any pyramid: a part of a picture begins and ends with whole ones, but at the picture's own edges.
pub const BLOCK_PX: u32 = 1 << (MOST_LEVELS - 1);
/// Of a pyramid over the picture, with the picture itself.
pub const MOST_LEVELS: u32 = 8;
pub const LIST_HEADER: u32 = 4;

/// Off, on, or where the scene calls for it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Switch {
    Off,
    On,
    #[default]
    Auto,
}

/// What effects decide by, and work on.
pub struct FrameContext<'s> {
    pub view: &'s View,
    pub light: Light,
    pub points: u64,
    /// How densely points sample the picture.
    pub sampling: PointDensity,
    pub stations: usize,
    /// What points show.
    pub shown: Attribute,
    /// Some points let through what is behind them.
    pub transparent: bool,
    /// The layer distance that somebody has asked for, metres; 0: nobody has.
    pub asked_layer_m: f64,
    /// Points have brought normals.
    pub normals: bool,
    /// Points have brought how much of this light reaches them.
    pub lit: bool,
    /// What gives all stations one exposure, where that is known.
    pub balance: Option<&'s Balance>,
    /// Where in the picture several stations have seen something.
    pub overlap: Arc<StationOverlap>,
}

impl<'s> FrameContext<'s> {
    pub fn of(view: &'s View, resident: &'s Resident, light: Light) -> FrameContext<'s> {
        FrameContext {
            view,
            light,
            points: resident.points,
            sampling: PointDensity::of(resident, &view.entire()),
            stations: resident.stations.len(),
            shown: resident.shown.attribute,
            transparent: resident.is_transparent(),
            asked_layer_m: 0.0,
            normals: resident.shown.normal().is_some(),
            lit: resident.light.as_ref().is_some_and(|saved| light.is_written(&saved.light)),
            balance: resident.balance.as_ref(),
            overlap: Arc::new(resident.overlap(view)),
        }
    }

    /// As [`layer_m`], of an effect that has its own.
    pub fn layer_m(&self, of_effect: f64) -> f64 {
        layer_m([of_effect, self.asked_layer_m], &self.sampling)
    }
}

/// The layer distance: surfaces nearer to each other than this are taken for one, metres: as asked for, of an effect or else of the picture. Where nobody asks, four spacings of the points, or of the pixels
/// where those are wider, which holds what neighbours on one surface differ by unless it is steep (papers/README.md, Dobrev).
pub fn layer_m(asked: [f64; 2], &PointDensity { spacing_m, pixel_m, .. }: &PointDensity) -> f64 {
    asked.into_iter().find(|asked| *asked > 0.0).unwrap_or(4.0 * spacing_m.max(pixel_m))
}

/// A number to three digits, for people to read.
pub fn significant(number: f64) -> f64 {
    format!("{number:.2e}").parse().expect("a number as it was written")
}

/// Why an effect runs, or does not.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Reason {
    pub runs: bool,
    pub why: String,
}

/// For every effect in order: whether it runs, and why.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Decided(pub Vec<(Effect, Reason)>);

impl Decided {
    /// Whether an effect runs; an effect may ask for those before it.
    pub fn runs(&self, effect: Effect) -> bool {
        self.reason(effect).is_some_and(|reason| reason.runs)
    }

    /// Returns why an effect runs or does not; None before it is decided.
    pub fn reason(&self, effect: Effect) -> Option<&Reason> {
        self.0.iter().find(|(other, _)| *other == effect).map(|(_, reason)| reason)
    }

    /// Why an effect runs or does not, for who knows better.
    pub fn explain(&mut self, effect: Effect, why: &str) {
        self.0
            .iter_mut()
            .filter(|(other, _)| *other == effect)
            .for_each(|(_, reason)| reason.why = why.into());
    }
}

/// Returns how colours are looked up where these effects run.
pub fn color_request(resident: &Resident, decided: &Decided) -> resolve::ColorRequest {
    resolve::ColorRequest {
        gains: exposure::gains(resident, decided),
        averaged: luminance::averages(resident.shown.attribute, decided),
    }
}

/// The registry: one line an effect, in the order in which they run. It yields the settings, the name on the command line, the switch and the call.
macro_rules! effects {
    ($($name:ident $effect:ident),* $(,)?) => {
        /// The effects, in the order in which they run.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Effect {
            $($effect,)*
        }

        impl Effect {
            /// Returns the name on the command line.
            pub fn name(self) -> &'static str {
                match self {
                    $(Effect::$effect => stringify!($name),)*
                }
            }
        }

        /// Names of all effects, in the order in which they run.
        pub const EFFECTS: &[&str] = &[$(stringify!($name)),*];

        /// Of every effect: whether the user wants it, and its settings.
        #[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
        pub struct Effects {
            $(pub $name: Asked<$name::Settings>,)*
        }

        impl Effects {
            /// `NAME=off|on|auto[,key=value...]`.
            pub fn set(&mut self, text: &str) -> Result<(), String> {
                self.set_from(text, false)
            }

            /// Sets the same, and also the settings that only studies and tests use.
            pub fn set_any(&mut self, text: &str) -> Result<(), String> {
                self.set_from(text, true)
            }

            fn set_from(&mut self, text: &str, any: bool) -> Result<(), String> {
                let (name, rest) = text.split_once('=').ok_or(format!("{text:?} is not NAME=off|on|auto[,key=value...]"))?;
                match name {
                    $(stringify!($name) => self.$name.set(rest, any),)*
                    _ => Err(format!("there is no effect {name:?}; there are: {}", EFFECTS.join(", "))),
                }
            }

            /// Whether each effect runs in this scene, and why.
            pub fn decide(&self, context: &FrameContext) -> Decided {
                let mut decided = Decided::default();
                $(let reason = self.$name.decide(stringify!($name), $name::called_for(context, self, &decided));
                decided.0.push((Effect::$effect, reason));)*
                decided
            }

            /// How many pixels around one what is drawn there depends on; none where on the whole picture.
            pub fn reach_px(&self, view: &View, decided: &Decided) -> Option<u32> {
                let mut reach = OTHERS_REACH_PX;
                $(if decided.runs(Effect::$effect) {
                    reach += $name::reach_px(view, &self.$name.settings)?;
                })*
                Some(reach)
            }

            /// Every effect in order, for who shows them and lets people choose.
            pub fn list(&mut self) -> Vec<Listed<'_>> {
                vec![$(Listed {
                    effect: Effect::$effect,
                    about: $name::SUMMARY,
                    switch: &mut self.$name.switch,
                    settings: self.$name.settings.list(),
                }),*]
            }

            /// A line of help for every effect and its settings.
            pub fn help() -> String {
                [$(format!("{}: {}\n{}", stringify!($name), $name::SUMMARY, Asked::<$name::Settings>::help())),*].join("\n")
            }
        }

        impl Effects {
            /// How far from a pixel that holds a point those that run may change a picture, pixels; points are at most so far apart on the screen.
            pub fn grows_px(&self, decided: &Decided, spacing_px: f64) -> f64 {
                let mut grows_px = 0.0;
                $(if decided.runs(Effect::$effect) {
                    grows_px += self.$name.settings.grows_px(spacing_px);
                })*
                grows_px
            }
        }

        /// Every effect that runs, in order.
        pub fn apply(g: &mut Graph, context: &FrameContext, effects: &Effects, decided: &Decided, mut gbuffer: GBuffer) -> GBuffer {
            $(if decided.runs(Effect::$effect) {
                gbuffer = $name::record(g, context, &effects.$name.settings, gbuffer);
            })*
            gbuffer
        }
    };
}

effects! {
    exposure Exposure,   // the table that colours are looked up in
    luminance Luminance,  // sums, values -> color
    strokes Strokes,    // keys and color in place of projected points; color -> color
    shadows Shadows,    // marks, index, color -> color, or reached
    visibility Visibility, // depth, index, color -> the same without what is hidden; holes
    fill Fill,       // depth, color, reached, holes -> depth, color, reached
    smooth Smooth,     // depth, color -> depth, color; all of it: reached, too
    shape Shape,      // depth -> lit
    phong Phong,      // depth, color, reached, index, normals of points -> color
    edl Edl,        // depth, color -> color
    ao Ao,         // depth, lit -> lit
    antialias Antialias,  // depth, color, lit -> color, lit
    transparency Transparency, // color, lit -> front
}

/// A setting of an effect as the command line knows it: name, unit and meaning, and its value.
pub struct Setting<'s> {
    pub name: &'static str,
    pub about: &'static str,
    pub value: Value<'s>,
    /// Whether only studies and tests use it: a variant of a paper, or a baseline.
    pub is_variant: bool,
}

/// What a setting can be.
pub enum Value<'s> {
    Number(&'s mut f64, std::ops::RangeInclusive<f64>),
    /// Without a fraction.
    Whole(&'s mut f64, std::ops::RangeInclusive<f64>),
    /// One of a few numbers.
    OneOf(&'s mut f64, &'static [f64]),
    Choice(&'s mut dyn Choice),
}

/// One of a few names.
pub trait Choice {
    fn name(&self) -> String;
    fn names(&self) -> Vec<String>;
    /// Whether there is one of this name.
    fn choose(&mut self, name: &str) -> bool;
}

impl<E: clap::ValueEnum> Choice for E {
    fn name(&self) -> String {
        self.to_possible_value().expect("no choice is hidden").get_name().to_string()
    }

    fn names(&self) -> Vec<String> {
        E::value_variants().iter().map(Choice::name).collect()
    }

    fn choose(&mut self, name: &str) -> bool {
        E::from_str(name, false).map(|chosen| *self = chosen).is_ok()
    }
}

impl<'s> Setting<'s> {
    /// Returns a setting of users.
    pub fn new(name: &'static str, about: &'static str, value: Value<'s>) -> Setting<'s> {
        Setting { name, about, value, is_variant: false }
    }

    /// Returns a setting that only studies and tests use.
    pub fn variant(name: &'static str, value: Value<'s>) -> Setting<'s> {
        Setting { name, about: "", value, is_variant: true }
    }

    fn set(&mut self, text: &str) -> Result<(), String> {
        let name = self.name;
        match &mut self.value {
            Value::Choice(choice) => match choice.choose(text) {
                true => Ok(()),
                false => Err(format!(
                    "there is no {name}={text}; there are: {}",
                    choice.names().join(", ")
                )),
            },
            Value::Number(value, range) => {
                number_within(name, text, range).map(|number| **value = number)
            }
            Value::Whole(value, range) => match number_within(name, text, range)? {
                number if number.fract() == 0.0 => {
                    **value = number;
                    Ok(())
                }
                _ => Err(format!("{name}={text} is not a whole number")),
            },
            Value::OneOf(value, of) => match of.iter().find(|one| text.parse() == Ok(**one)) {
                Some(one) => {
                    **value = *one;
                    Ok(())
                }
                None => Err(format!("there is no {name}={text}; there are: {}", numbers(of))),
            },
        }
    }

    fn help(&self) -> String {
        match &self.value {
            Value::Number(value, range) | Value::Whole(value, range) => {
                format!(
                    "    {}={}  {} ({} to {})",
                    self.name,
                    value,
                    self.about,
                    range.start(),
                    range.end()
                )
            }
            Value::OneOf(value, of) => {
                format!("    {}={}  {} ({})", self.name, value, self.about, numbers(of))
            }
            Value::Choice(choice) => format!(
                "    {}={}  {} ({})",
                self.name,
                choice.name(),
                self.about,
                choice.names().join(", ")
            ),
        }
    }
}

fn number_within(
    name: &str,
    text: &str,
    range: &std::ops::RangeInclusive<f64>,
) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| format!("{name}={text:?} is not a number"))?;
    if range.contains(&number) {
        Ok(number)
    } else {
        Err(format!("{name}={text} is not between {} and {}", range.start(), range.end()))
    }
}

fn numbers(of: &[f64]) -> String {
    of.iter().map(f64::to_string).collect::<Vec<_>>().join(", ")
}

/// An effect: its name, what it does, and what people may choose of it.
pub struct Listed<'s> {
    pub effect: Effect,
    pub about: &'static str,
    pub switch: &'s mut Switch,
    pub settings: Vec<Setting<'s>>,
}

impl std::fmt::Display for Value<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Value::Number(number, _) | Value::Whole(number, _) | Value::OneOf(number, _) => {
                write!(f, "{number}")
            }
            Value::Choice(choice) => write!(f, "{}", choice.name()),
        }
    }
}

impl std::fmt::Display for Listed<'_> {
    /// As [`Effects::set`] takes it.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}={}", self.effect.name(), Choice::name(self.switch))?;
        self.settings
            .iter()
            .try_for_each(|setting| write!(f, ",{}={}", setting.name, setting.value))
    }
}

/// What an effect's settings can say of themselves.
pub trait Settings: Default {
    /// Lists what users may set.
    fn list(&mut self) -> Vec<Setting<'_>> {
        self.list_all().into_iter().filter(|setting| !setting.is_variant).collect()
    }

    /// Lists all settings, including those that only studies and tests use.
    fn list_all(&mut self) -> Vec<Setting<'_>>;

    /// How far from a pixel that holds a point the effect may change the picture, pixels, where points are at most so far apart; nobody knows where nothing is said. Layers behind others are drawn no
    /// farther from their points than all effects together carry them.
    fn grows_px(&self, _spacing_px: f64) -> f64 {
        f64::INFINITY
    }
}

/// A switch and settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Asked<S> {
    pub switch: Switch,
    #[serde(flatten)]
    pub settings: S,
}

impl<S: Settings> Asked<S> {
    fn set(&mut self, text: &str, any: bool) -> Result<(), String> {
        for item in text.split(',') {
            match item {
                "off" => self.switch = Switch::Off,
                "on" => self.switch = Switch::On,
                "auto" => self.switch = Switch::Auto,
                _ => {
                    let (key, value) = item
                        .split_once('=')
                        .ok_or(format!("{item:?} is neither off, on, auto nor key=value"))?;
                    let mut settings =
                        if any { self.settings.list_all() } else { self.settings.list() };
                    let names =
                        settings.iter().map(|setting| setting.name).collect::<Vec<_>>().join(", ");
                    let setting = settings.iter_mut().find(|setting| setting.name == key);
                    setting
                        .ok_or(format!("there is no setting {key:?}; there are: {names}"))?
                        .set(value)?;
                }
            }
        }
        Ok(())
    }

    fn decide(&self, name: &str, called_for: Reason) -> Reason {
        match self.switch {
            Switch::Auto => called_for,
            Switch::On => Reason { runs: true, why: format!("asked for with --effect {name}=on") },
            Switch::Off => {
                Reason { runs: false, why: format!("switched off with --effect {name}=off") }
            }
        }
    }

    fn help() -> String {
        let mut settings = S::default();
        settings.list().iter().map(Setting::help).collect::<Vec<_>>().join("\n")
    }
}
