//! The user's settings, and the configuration of one frame that they and the cloud lead to.

mod warnings;

use crate::cloud::colormap::srgb_to_linear;
use crate::cloud::length::Length;
use crate::config::WHOLE_PIXELS;
use crate::names::Named;
use crate::passes::phong::Backfaces;
use crate::passes::project::Precision;
use crate::passes::{
    Effect, EffectDecisions, Effects, FrameContext, LEAST_BLOCK_PX, Switch, fill, resolve, strokes,
    visibility,
};
use crate::resident::{PointDensity, Resident, StationOverlap};
use crate::view::View;
use crate::view::light::Light;
use std::sync::Arc;
use strum::{EnumString, IntoStaticStr, VariantArray};

/// A set of effects that run by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum Style {
    /// A surface, and splats where points lie on no surface, such as leaves
    #[default]
    Auto,
    /// A surface: what is hidden is hidden, holes are filled, shape is shaded
    Surface,
    /// Every point one pixel
    Points,
    /// Every point a round splat, with eye-dome lighting
    Splats,
    /// Every point a brush stroke along its surface
    Strokes,
}

impl Effects {
    pub fn of(style: Style) -> Effects {
        let mut effects = Effects::default();
        if style != Style::Auto {
            effects.scattered.switch = Switch::Off;
            effects.splat.switch = Switch::Off;
        }
        if !matches!(style, Style::Auto | Style::Surface) {
            effects.visibility.switch = Switch::Off;
            effects.fill.switch = Switch::Off;
            effects.shape.switch = Switch::Off;
        }
        match style {
            Style::Auto | Style::Surface | Style::Points => {}
            Style::Splats => {
                effects.splat.switch = Switch::On;
                effects.edl.switch = Switch::On;
            }
            Style::Strokes => effects.strokes.switch = Switch::On,
        }
        effects
    }

    /// Returns the switches that a style sets.
    fn switches(&mut self) -> [&mut Switch; 7] {
        let Effects { scattered, visibility, fill, shape, splat, edl, strokes, .. } = self;
        [
            &mut scattered.switch,
            &mut visibility.switch,
            &mut fill.switch,
            &mut shape.switch,
            &mut splat.switch,
            &mut edl.switch,
            &mut strokes.switch,
        ]
    }

    /// Returns the style that these switches are of, if there is one.
    pub fn style(&self) -> Option<Style> {
        let of = |effects: &Effects| effects.clone().switches().map(|switch| *switch);
        Style::ALL.iter().copied().find(|style| of(&Effects::of(*style)) == of(self))
    }

    /// Sets the switches of a style; settings stay.
    pub fn set_style(&mut self, style: Style) {
        for (to, from) in self.switches().into_iter().zip(Effects::of(style).switches()) {
            *to = *from;
        }
    }
}

/// An sRGB colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Background(pub [u8; 3]);

impl std::str::FromStr for Background {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Background, String> {
        let digits = text.strip_prefix('#').unwrap_or(text);
        let number = u32::from_str_radix(digits, 16).ok().filter(|_| digits.len() == 6);
        let number =
            number.ok_or(format!("{text:?} is not a colour; give RRGGBB in hexadecimal digits"))?;
        Ok(Background([(number >> 16) as u8, (number >> 8) as u8, number as u8]))
    }
}

impl std::fmt::Display for Background {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [r, g, b] = self.0;
        write!(f, "{r:02x}{g:02x}{b:02x}")
    }
}

/// The user's settings, independent of cloud and view.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderSettings {
    /// Effects, each with its switch and settings.
    pub effects: Effects,
    /// Light that shades and casts shadows, world.
    pub light: Light,
    /// Background, sRGB.
    pub background: [u8; 3],
    /// Precision of depth.
    pub precision: Precision,
    /// Layer distance: nearer surfaces count as one. 0: derived from the spacing of points and
    /// pixels.
    pub layer: Length,
}

impl RenderSettings {
    /// Returns settings that draw every point as one pixel.
    pub fn points() -> RenderSettings {
        RenderSettings { effects: Effects::of(Style::Points), ..RenderSettings::default() }
    }
}

/// Strokes of a pixel that each further frame sorts. Little light passes this many (`study
/// strokes`), so the first such frame already shows nearly the whole picture.
const STROKES_AT_ONCE: u32 = 8;

/// Directions of ambient occlusion while the camera moves: enough for corners to stay dark.
const HURRIED_DIRECTIONS: f64 = 2.0;

impl Default for RenderSettings {
    fn default() -> Self {
        let (effects, light, background) =
            (Effects::default(), Light::default(), crate::config::BACKGROUND);
        let layer = Length::default();
        RenderSettings { effects, light, background, precision: Precision::Auto, layer }
    }
}

/// The configuration of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameConfig {
    pub effects: Effects,
    pub decisions: EffectDecisions,
    pub light: Light,
    /// Background, linear.
    pub background: [f32; 3],
    pub precision: Precision,
    /// Most light samples this frame adds to the shadows; all if `None`.
    pub light_at_once: Option<u32>,
    /// Most overlapping strokes of a pixel that this frame sorts in addition to those already
    /// sorted; all if `None`.
    pub strokes_at_once: Option<u32>,
    /// Point density of the whole picture; its parts use the same.
    pub sampling: PointDensity,
    /// Layer distance as in [`RenderSettings`], in the coordinates of views.
    pub layer_m: f64,
    /// Depth resolution at the farthest depth in view `[m]` (guide: numerics, case 4).
    pub quantum_m: f64,
    /// Tiles where luminance is corrected.
    pub overlap: Arc<StationOverlap>,
}

impl FrameConfig {
    pub fn new(settings: &RenderSettings, view: &View, resident: &Resident) -> FrameConfig {
        let unit_m = resident.unit_m();
        let layer_m = settings.layer.counted_in(unit_m);
        let context = FrameContext {
            asked_layer_m: layer_m,
            ..FrameContext::of(view, resident, settings.light)
        };
        let asked = settings.effects.counted_in(unit_m);
        let decisions = asked.decide(&context);
        // If switched on explicitly, luminance is averaged everywhere.
        let partly =
            decisions.runs(Effect::Luminance) && settings.effects.luminance.switch == Switch::Auto;
        let mut effects =
            settled(&asked, resolve::spacing_px(&view.entire(), resident)[1], &context);
        if !decisions.runs(Effect::Fill) {
            // Warnings are of what was asked for.
            effects.fill.settings.method = settings.effects.fill.settings.method;
        }
        let mut config = FrameConfig {
            effects,
            decisions,
            sampling: context.sampling,
            layer_m,
            quantum_m: quantum_m(view, resident),
            overlap: if partly {
                context.overlap
            } else {
                Arc::new(StationOverlap::everywhere(view.whole))
            },
            light: settings.light,
            background: settings
                .background
                .map(|channel| srgb_to_linear(channel as f64 / 255.0) as f32),
            precision: settings.precision,
            light_at_once: None,
            strokes_at_once: None,
        };
        if let (Some(narrowed), Some(splats)) =
            (config.narrowed(), config.decisions.reason(Effect::Splat))
        {
            let why = format!("{}; {narrowed}", splats.why);
            config.decisions.explain(Effect::Splat, &why);
        }
        config
    }

    /// Returns the context of effects for a picture or a part of it.
    pub fn frame_context<'v>(&self, view: &'v View, resident: &'v Resident) -> FrameContext<'v> {
        FrameContext {
            sampling: self.sampling,
            asked_layer_m: self.layer_m,
            overlap: self.overlap.clone(),
            ..FrameContext::of(view, resident, self.light)
        }
    }

    /// Returns the side of the blocks that a piece of a picture is made of `[px]`, except at the
    /// picture's edges: of the coarsest cells of its pyramids.
    pub fn block_px(&self) -> u32 {
        let levels = self.effects.visibility.settings.levels.max(self.effects.fill.settings.levels);
        LEAST_BLOCK_PX.max(1 << (levels as u32 - 1))
    }

    /// Returns how far effects look `[px]`, as [`Effects::reach_px`] times the layers, since each
    /// layer depends on those before it.
    pub fn reach_px(&self, view: &View) -> Option<u32> {
        self.effects.reach_px(view, &self.decisions).map(|reach| reach * self.layers())
    }

    /// Tests whether back-facing points are dropped: if Phong lighting is set to, and normals are
    /// oriented.
    pub fn drops_back_faces(&self, resident: &Resident) -> bool {
        self.decisions.runs(Effect::Phong)
            && self.effects.phong.settings.backfaces == Backfaces::Drop
            && resident.oriented
    }

    /// Returns the most surfaces drawn behind each other.
    pub fn layers(&self) -> u32 {
        if self.decisions.runs(Effect::Transparency) {
            self.effects.transparency.settings.layers as u32
        } else {
            1
        }
    }

    /// Returns the configuration of frames at rest, which add a little each until nothing is left
    /// to add. A new light gets one sample, and others between frames (Dobrev et al. 2010, sec. 6).
    /// Overlapping strokes are sorted a few more each frame, nearest first (dos Anjos et al. 2018,
    /// sec. 3.3.3).
    pub fn progressive(&self) -> FrameConfig {
        FrameConfig {
            light_at_once: Some(0),
            strokes_at_once: Some(STROKES_AT_ONCE),
            ..self.clone()
        }
    }

    /// Returns the configuration for a view of fewer pixels. Effects stay as decided for the full
    /// size: a smaller picture has more points per pixel, and would call for others.
    pub fn for_view(mut self, view: &View, resident: &Resident) -> FrameConfig {
        if !self.overlap.is_everywhere() {
            self.overlap = Arc::new(resident.overlap(view));
        }
        self
    }

    /// Returns the configuration while the camera moves, for a picture `smaller` times smaller:
    /// only the nearest of overlapping strokes, softened; less occlusion; fewer levels of shape.
    pub fn interactive(&self, smaller: u32) -> FrameConfig {
        let mut hurried = self.progressive();
        let Effects { strokes, ao, shape, .. } = &mut hurried.effects;
        // A level looks one pixel farther, and pixels are wider.
        if self.decisions.runs(Effect::Shape) {
            shape.settings.levels = (shape.settings.levels / smaller as f64).ceil();
        }
        if self.decisions.runs(Effect::Strokes) && strokes.settings.blend == strokes::Blend::Abuffer
        {
            strokes.settings.blend = strokes::Blend::Blur;
        }
        if self.decisions.runs(Effect::Ao) {
            ao.settings.directions = ao.settings.directions.min(HURRIED_DIRECTIONS);
        }
        hurried
    }
}

/// Fills in settings that depend on the picture, the same for all its parts. `widest_px` is the
/// spacing of the sparsest points.
fn settled(asked: &Effects, widest_px: f64, context: &FrameContext) -> Effects {
    let (mut effects, transparent) = (asked.clone(), context.transparent);
    let widest_px =
        if is_large(context.view.whole) { widest_px.min(WIDEST_OF_LARGE_PX) } else { widest_px };
    effects.visibility.settings =
        visibility::settled(&asked.visibility.settings, widest_px, context.sampling.apart_px);
    let floods = asked.visibility.switch == Switch::Off;
    effects.fill.settings = fill::settled(&asked.fill.settings, transparent, floods, widest_px);
    effects
}

/// Spacing that levels of large pictures are made for `[px]`. These are drawn in pieces, and the
/// borders of pieces are as wide as the coarsest level looks.
const WIDEST_OF_LARGE_PX: f64 = 16.0;

/// Tests whether a picture is so large that it may be drawn in pieces.
fn is_large([width, height]: [u32; 2]) -> bool {
    width.max(height) > 8192 || u64::from(width) * u64::from(height) > WHOLE_PIXELS
}

/// Returns the resolution of f32 at the farthest depth in view `[m]`.
fn quantum_m(view: &View, resident: &Resident) -> f64 {
    let farthest =
        resident.seen(&view.entire()).map(|((_, farthest), _)| farthest).fold(0.0, f64::max) as f32;
    (farthest.next_up() - farthest) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::passes::Reason;

    #[test]
    fn what_is_hurried_is_cheaper_where_it_runs_and_nothing_else() {
        let mut effects = Effects::of(Style::Strokes);
        effects.set("shadows=on,samples=16,radius=2").unwrap();
        let config = |running: &[Effect]| FrameConfig {
            effects: effects.clone(),
            decisions: EffectDecisions(
                running
                    .iter()
                    .map(|effect| (*effect, Reason { runs: true, why: String::new() }))
                    .collect(),
            ),
            light: Light::default(),
            background: [0.0; 3],
            precision: Precision::Auto,
            light_at_once: None,
            strokes_at_once: None,
            sampling: PointDensity::default(),
            layer_m: 0.0,
            quantum_m: 0.0,
            overlap: Arc::new(StationOverlap::everywhere([1, 1])),
        };
        assert_eq!(
            config(&[Effect::Phong]).interactive(1).effects,
            config(&[Effect::Phong]).effects
        );
        let all = config(&[Effect::Strokes, Effect::Shadows]);
        let hurried = all.interactive(1);
        assert_eq!(
            (hurried.light_at_once, &hurried.effects.shadows),
            (Some(0), &all.effects.shadows)
        );
        assert_eq!(hurried.effects.strokes.settings.blend, strokes::Blend::Blur);
        assert_eq!(hurried.interactive(1), hurried);
        let levels =
            |smaller| config(&[Effect::Shape]).interactive(smaller).effects.shape.settings.levels;
        assert_eq!([1, 2, 4].map(levels), [8.0, 4.0, 2.0]);
    }
}
