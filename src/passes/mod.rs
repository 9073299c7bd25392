//! Passes, one file each, from graph handles to graph handles: the core (project, resolve,
//! composite) and the registry of effects.

pub mod antialias;
pub mod ao;
pub mod composite;
pub mod count_visible;
pub mod edl;
pub mod encode;
pub mod exposure;
pub mod fill;
pub mod luminance;
pub mod occluder;
pub mod phong;
pub mod picked;
pub mod predicate;
pub mod project;
pub mod resolve;
pub mod scattered;
pub mod shadows;
pub mod shape;
pub mod smooth;
pub mod splat;
pub mod strokes;
pub mod surface_normal;
pub mod tile_stats;
pub mod transparency;
pub mod visibility;

use crate::cloud::attribute::Attribute;
use crate::cloud::length::Length;
use crate::graph::{Buffer, Graph, Image};
use crate::index::format::Balance;
use crate::names::Named;
use crate::resident::{PointDensity, Resident, StationOverlap};
use crate::similar::did_you_mean;
use crate::view::View;
use crate::view::light::Light;
use crate::view::linear_map::LinearMap;
use std::sync::Arc;
use strum::{EnumString, IntoStaticStr, VariantArray};

/// The images and buffers that screen-space passes read and write.
pub struct GBuffer {
    /// Planar depth `[m]`; infinite for background, minus infinite if unknown.
    pub depth: Image,
    /// Planar depth of the projected points `[m]`.
    pub projected_depth: Image,
    /// Point ids. A pixel that was filled from one point has the id of that point.
    pub index: Image,
    /// Point ids of the projected points.
    pub projected_index: Image,
    /// Linear colour, premultiplied by alpha. Alpha is the opacity of the surface, 0 for
    /// background.
    pub color: Image,
    /// Planar depth of a host's geometry `[m]`, which hides layers behind it; None without.
    pub occluder: Option<Image>,
    /// Transparent layers up to this one, composited.
    pub accumulation: Option<transparency::Accumulation>,
    /// Address of the page with the normals of each node's points, by node number, if points have
    /// any.
    pub normal_pages: Option<(Buffer, LinearMap)>,
    /// Visibility of the light from each point, if shadows are cast.
    pub light_visibility: Option<shadows::LightVisibility>,
    /// Visibility of the light from each pixel's surface, the same in red, green and blue, if
    /// lighting takes it into account. It is filled like the colour.
    pub shadow_factor: Option<Image>,
    /// Sums of each pixel's points, if luminance is corrected.
    pub luminance_sums: Option<luminance::Sums>,
    /// Factor on the light, which multiplies the colour; None is 1.
    pub shading: Option<Image>,
    /// Point spacing of every node of the frame `[m]`, f32.
    pub spacings: Buffer,
    /// How the points of every node lie, clump by clump (glsl/lib/clump.glsl).
    pub clumps: Buffer,
    /// Points that lie on no surface, if they were set aside.
    pub aside: Option<scattered::Aside>,
    /// Smallest and largest point spacing on the screen `[px]`; infinite if the camera is within a
    /// node.
    pub spacing_px: [f64; 2],
    /// Distance of pixels whose depths come from different points `[px]`: 1 if each pixel has its
    /// own depth or one interpolated from its neighbours.
    pub flat_px: u32,
    /// Origin of each pixel's depth, if copied from another pixel: four rows per texel
    /// (glsl/lib/depth_source.glsl).
    pub depth_source: Option<Image>,
    /// Tiles with pixels of unknown depth, if a pass has looked for them.
    pub holes: Option<Holes>,
    /// Lists of tiles, for statistics.
    pub tile_lists: TileLists,
}

impl GBuffer {
    /// Returns the images that are filled alike: colour and light visibility.
    pub fn colors(&self) -> impl Iterator<Item = &Image> {
        [Some(&self.color), self.shadow_factor.as_ref()].into_iter().flatten()
    }
}

/// Buffers that passes fill on the device and [`tile_stats`] counts; None for passes that do not
/// run.
#[derive(Default)]
pub struct TileLists {
    /// Tiles where points may be hidden, a list per level.
    pub looked_at: Option<Buffer>,
    /// Tiles with pixels to fill.
    pub holes: Option<Buffer>,
    /// Steps of filling by medians (glsl/lib/tile_steps.glsl).
    pub median_steps: Option<Buffer>,
    /// Steps of filling background and hidden pixels by masks, likewise.
    pub mask_steps: Option<[Buffer; 2]>,
    /// Tiles that deeper levels of shape depiction shade.
    pub rough: Option<Buffer>,
    /// Tiles that are smoothed.
    pub smoothed: Option<Buffer>,
    /// Tiles with silhouettes.
    pub silhouettes: Option<Buffer>,
}

/// A list of 8 x 8 pixel tiles, made on the device (glsl/lib/tile.glsl).
pub struct Holes {
    pub list: Buffer,
    /// Width of the kernel that found unknown pixels, for each tile `[px]`, u32.
    pub kernels: Buffer,
    /// Width of the widest kernel that looked for them `[px]`.
    pub widest: u32,
}

/// Reach of passes that are no effects `[px]`: normals look at neighbours.
const OTHERS_REACH_PX: u32 = 2;

/// Returns the number of tiles across and down a picture.
pub fn tiles(size: [u32; 2]) -> [u32; 2] {
    size.map(|side| side.div_ceil(TILE_PX))
}

/// Side of a tile `[px]`, as in glsl/lib/tile.glsl.
pub const TILE_PX: u32 = 8;
/// Least side of the blocks that a piece of a picture is made of `[px]`
/// ([`FrameConfig::block_px`](crate::render::settings::FrameConfig::block_px)).
pub const LEAST_BLOCK_PX: u32 = 128;
/// Largest number of levels of a pyramid over the picture, including the picture itself.
pub const MOST_LEVELS: u32 = 10;
pub const LIST_HEADER: u32 = 4;

/// Off, on, or as the frame calls for it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Switch {
    Off,
    On,
    #[default]
    Auto,
}

/// The inputs of effects and of their decisions.
pub struct FrameContext<'s> {
    pub view: &'s View,
    pub light: Light,
    pub points: u64,
    /// Density of points on the screen.
    pub sampling: PointDensity,
    pub stations: usize,
    /// Attribute that points show.
    pub shown: Attribute,
    /// True if that is a number on a ramp that is not grey.
    pub is_ramped: bool,
    /// True if some points are transparent.
    pub transparent: bool,
    /// Layer distance of the user, in the coordinates of views; 0: automatic.
    pub asked_layer_m: f64,
    /// Metres in a unit of the coordinates of views.
    pub unit_m: f64,
    /// True if points have normals.
    pub normals: bool,
    /// True if points have saved shadows of this light.
    pub has_saved_shadows: bool,
    /// Exposure of the stations, if known.
    pub balance: Option<&'s Balance>,
    /// Screen tiles that may show several stations.
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
            is_ramped: resident.shown.is_ramped(),
            transparent: resident.is_transparent(),
            asked_layer_m: 0.0,
            unit_m: resident.unit_m(),
            normals: resident.shown.normal().is_some(),
            has_saved_shadows: resident
                .saved_light()
                .is_some_and(|saved| light.is_written(&saved.light)),
            balance: resident.balance.as_ref(),
            overlap: Arc::new(resident.overlap(view)),
        }
    }

    /// Returns the [`layer_m`] of an effect that may have its own.
    pub fn layer_m(&self, of_effect: f64) -> f64 {
        layer_m([of_effect, self.asked_layer_m], &self.sampling)
    }

    /// Returns a length of the coordinates of views in metres, for people.
    pub fn metres(&self, length: f64) -> f64 {
        significant(length * self.unit_m)
    }
}

/// Returns the layer distance `[m]`: surfaces nearer to each other count as one. It is the first
/// number asked for that is not 0, else four spacings of the points, or of the pixels if those are
/// wider. That is the depth difference of neighbours on one surface unless it is steep (guide:
/// papers).
pub fn layer_m(asked: [f64; 2], &PointDensity { spacing_m, pixel_m, .. }: &PointDensity) -> f64 {
    asked.into_iter().find(|asked| *asked > 0.0).unwrap_or(4.0 * spacing_m.max(pixel_m))
}

/// Rounds a number to three significant digits.
pub fn significant(number: f64) -> f64 {
    format!("{number:.2e}").parse().expect("a number as it was written")
}

/// Decision on an effect, and its reason.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Reason {
    pub runs: bool,
    pub why: String,
}

/// The decision for every effect, in order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EffectDecisions(pub Vec<(Effect, Reason)>);

impl EffectDecisions {
    /// Returns whether an effect runs. An effect may ask about those before it.
    pub fn runs(&self, effect: Effect) -> bool {
        self.reason(effect).is_some_and(|reason| reason.runs)
    }

    /// Returns the decision about an effect; None before it is made.
    pub fn reason(&self, effect: Effect) -> Option<&Reason> {
        self.0.iter().find(|(other, _)| *other == effect).map(|(_, reason)| reason)
    }

    /// Replaces the reason of a decision.
    pub fn explain(&mut self, effect: Effect, why: &str) {
        self.0
            .iter_mut()
            .filter(|(other, _)| *other == effect)
            .for_each(|(_, reason)| reason.why = why.into());
    }
}

/// Returns how colours are looked up if these effects run.
pub fn color_request(resident: &Resident, decisions: &EffectDecisions) -> resolve::ColorRequest {
    resolve::ColorRequest {
        gains: exposure::gains(resident, decisions),
        averaged: luminance::averages(&resident.shown, decisions),
    }
}

/// The registry: one line per effect, in the order in which they run. It yields the settings, the
/// command line name, the switch and the call.
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

        /// Switch and settings of every effect.
        #[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
        pub struct Effects {
            $(pub $name: Asked<$name::Settings>,)*
        }

        impl Effects {
            /// Parses `NAME=off|on|auto[,key=value...]`.
            pub fn set(&mut self, text: &str) -> Result<(), String> {
                self.set_from(text, false)
            }

            /// Parses the same, including the settings that only studies and tests use.
            pub fn set_any(&mut self, text: &str) -> Result<(), String> {
                self.set_from(text, true)
            }

            fn set_from(&mut self, text: &str, any: bool) -> Result<(), String> {
                let (name, rest) = text.split_once('=').ok_or(format!("{text:?} is not NAME=off|on|auto[,key=value...]"))?;
                match name {
                    $(stringify!($name) => self.$name.set(rest, any),)*
                    _ => {
                        let meant = did_you_mean(name, EFFECTS);
                        Err(format!("there is no effect {name:?}{meant}; there are: {}", EFFECTS.join(", ")))
                    }
                }
            }

            /// Decides whether each effect runs in this frame.
            pub fn decide(&self, context: &FrameContext) -> EffectDecisions {
                let mut decisions = EffectDecisions::default();
                $(let reason = self.$name.decide(stringify!($name), $name::called_for(context, self, &decisions));
                decisions.0.push((Effect::$effect, reason));)*
                decisions
            }

            /// Returns the distance within which a pixel depends on others `[px]`; None if on the
            /// whole picture.
            pub fn reach_px(&self, view: &View, decisions: &EffectDecisions) -> Option<u32> {
                let mut reach = OTHERS_REACH_PX;
                $(if decisions.runs(Effect::$effect) {
                    reach += $name::reach_px(view, &self.$name.settings)?;
                })*
                Some(reach)
            }

            /// Lists every effect in order, for user interfaces.
            pub fn list(&mut self) -> Vec<Listed<'_>> {
                vec![$(Listed {
                    effect: Effect::$effect,
                    about: $name::SUMMARY,
                    switch: &mut self.$name.switch,
                    settings: self.$name.settings.list(),
                }),*]
            }

            /// Returns the settings with lengths counted in units of this many metres.
            pub fn counted_in(&self, unit_m: f64) -> Effects {
                let mut counted = self.clone();
                $(for setting in counted.$name.settings.list_all() {
                    if let Value::Length(length, _) = setting.value {
                        *length /= unit_m;
                    }
                })*
                counted
            }

            /// Returns the help text of all effects and their settings.
            pub fn help() -> String {
                [$(format!("{}: {}\n{}", stringify!($name), $name::SUMMARY, Asked::<$name::Settings>::help())),*].join("\n")
            }
        }

        impl Effects {
            /// Returns the distance from the nearest point within which the running effects may
            /// change a pixel `[px]`, if points are at most `spacing_px` apart.
            pub fn grows_px(&self, decisions: &EffectDecisions, spacing_px: f64) -> f64 {
                let mut grows_px = 0.0;
                $(if decisions.runs(Effect::$effect) {
                    grows_px += self.$name.settings.grows_px(spacing_px);
                })*
                grows_px
            }
        }

        /// Runs the effects in order.
        pub fn apply(g: &mut Graph, context: &FrameContext, effects: &Effects, decisions: &EffectDecisions, mut gbuffer: GBuffer) -> GBuffer {
            $(if decisions.runs(Effect::$effect) {
                gbuffer = $name::record(g, context, &effects.$name.settings, gbuffer);
            })*
            gbuffer
        }
    };
}

effects! {
    exposure Exposure,         // the table that colours are looked up in
    luminance Luminance,       // sums, values -> color
    strokes Strokes,           // keys and color in place of projected points; color -> color
    shadows Shadows,           // light visibility, index, color -> color, or shadow factor
    scattered Scattered,       // depth, index, color -> the same of surfaces; the others aside
    visibility Visibility,     // depth, index, color -> the same without what is hidden; holes
    fill Fill,                 // depth, color, shadow factor, holes -> depth, color, shadow factor
    splat Splat,               // what was set aside, or all -> depth, index, color of discs
    smooth Smooth,             // depth, color -> depth, color; all of it: shadow factor, too
    shape Shape,               // depth -> shading
    phong Phong,               // depth, color, shadow factor, index, normals of points -> color
    edl Edl,                   // depth, color -> color
    ao Ao,                     // depth, shading -> shading
    antialias Antialias,       // depth, color, shading -> color, shading
    transparency Transparency, // color, shading -> front
}

/// A setting of an effect: name, help text with unit, and value.
pub struct Setting<'s> {
    pub name: &'static str,
    pub about: &'static str,
    pub value: Value<'s>,
    /// True if only studies and tests use it: a variant of a paper or a baseline.
    pub is_variant: bool,
}

/// The value of a setting, with its limits.
pub enum Value<'s> {
    Number(&'s mut f64, std::ops::RangeInclusive<f64>),
    /// A length `[m]`.
    Length(&'s mut f64, std::ops::RangeInclusive<f64>),
    /// A number without a fraction.
    Whole(&'s mut f64, std::ops::RangeInclusive<f64>),
    /// One of a few numbers.
    OneOf(&'s mut f64, &'static [f64]),
    Choice(&'s mut dyn Choice),
}

/// One of a few names.
pub trait Choice {
    fn name(&self) -> String;
    fn names(&self) -> Vec<String>;
    /// Chooses by name; returns false if there is none of this name.
    fn choose(&mut self, name: &str) -> bool;
}

impl<E: Named> Choice for E {
    fn name(&self) -> String {
        Named::name(*self).to_string()
    }

    fn names(&self) -> Vec<String> {
        E::ALL.iter().map(Choice::name).collect()
    }

    fn choose(&mut self, name: &str) -> bool {
        E::named(name).map(|chosen| *self = chosen).is_ok()
    }
}

impl<'s> Setting<'s> {
    /// Creates a setting for users.
    pub fn new(name: &'static str, about: &'static str, value: Value<'s>) -> Setting<'s> {
        Setting { name, about, value, is_variant: false }
    }

    /// Creates a setting that only studies and tests use.
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
            Value::Length(value, range) => {
                let metres = text.parse::<Length>().map(|length| length.number());
                let metres = metres.map_err(|why| format!("{name}: {why}"))?;
                within(name, text, metres, range).map(|metres| **value = metres)
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
            Value::Number(value, range)
            | Value::Whole(value, range)
            | Value::Length(value, range) => {
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
    let number = text.parse().map_err(|_| format!("{name}={text:?} is not a number"))?;
    within(name, text, number, range)
}

fn within(
    name: &str,
    text: &str,
    number: f64,
    range: &std::ops::RangeInclusive<f64>,
) -> Result<f64, String> {
    if range.contains(&number) {
        Ok(number)
    } else {
        Err(format!("{name}={text} is not between {} and {}", range.start(), range.end()))
    }
}

fn numbers(of: &[f64]) -> String {
    of.iter().map(f64::to_string).collect::<Vec<_>>().join(", ")
}

/// An effect with its help text, switch and settings.
pub struct Listed<'s> {
    pub effect: Effect,
    pub about: &'static str,
    pub switch: &'s mut Switch,
    pub settings: Vec<Setting<'s>>,
}

impl std::fmt::Display for Value<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Value::Number(number, _)
            | Value::Whole(number, _)
            | Value::Length(number, _)
            | Value::OneOf(number, _) => {
                write!(f, "{number}")
            }
            Value::Choice(choice) => write!(f, "{}", choice.name()),
        }
    }
}

impl std::fmt::Display for Listed<'_> {
    /// Formats as [`Effects::set`] parses it.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}={}", self.effect.name(), Choice::name(self.switch))?;
        self.settings
            .iter()
            .try_for_each(|setting| write!(f, ",{}={}", setting.name, setting.value))
    }
}

/// The settings of an effect, described at run time.
pub trait Settings: Default {
    /// Lists the settings for users.
    fn list(&mut self) -> Vec<Setting<'_>> {
        self.list_all().into_iter().filter(|setting| !setting.is_variant).collect()
    }

    /// Lists all settings, including those that only studies and tests use.
    fn list_all(&mut self) -> Vec<Setting<'_>>;

    /// Returns the distance from the nearest point within which the effect may change a pixel
    /// `[px]`, if points are at most `spacing_px` apart; infinite if unknown. Layers behind others
    /// are drawn no farther from their points than this sum over all effects.
    fn grows_px(&self, _spacing_px: f64) -> f64 {
        f64::INFINITY
    }
}

/// A switch with the settings of an effect.
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
                    let names: Vec<&str> = settings.iter().map(|setting| setting.name).collect();
                    let meant = did_you_mean(key, &names);
                    let wrong = format!(
                        "there is no setting {key:?}{meant}; there are: {}",
                        names.join(", ")
                    );
                    let setting = settings.iter_mut().find(|setting| setting.name == key);
                    setting.ok_or(wrong)?.set(value)?;
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
