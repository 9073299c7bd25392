//! Filling: closes holes in depth and colour.
//!
//! `median` (Pintus et al. 2011, sec. 5): step by step, pixels without a value take the median of
//! their neighbours, and filled ones the weighted mean. It works on the tiles that `visibility` has
//! listed, alternates between two images, and stops when nothing changes.
//!
//! `pullpush` fills from means of ever coarser pictures: holes of any width cost the same, and
//! surfaces are smooth, but contours are less exact.
//!
//! `mask` (Dobrev et al. 2010, sec. 3.2 and 3.3) needs no visibility: masks tell holes from
//! background, and hidden pixels from visible ones.
//!
//! `splat` is the baseline of comparisons.
//!
//! The visibility of a light, if lighting follows, is filled like the colour: by the same passes if
//! they average, and looked up again for the new point if values come from one point.

mod mask;
mod pullpush;
mod splat;

pub use mask::APART_PX;

use super::{
    Effect, EffectDecisions, Effects, FrameContext, GBuffer, Holes, MOST_LEVELS, Reason, Setting,
    TILE_PX, TileLists, Value, tiles, visibility,
};
use crate::graph::{Buffer, Dispatch, Graph, Image, Kind};
use crate::shader::{self, fill_median, fill_median_begin, fill_median_end};
use crate::view::{Projection, View};
use strum::{EnumString, IntoStaticStr, VariantArray};

pub const SUMMARY: &str = "fills holes from the surfaces around them";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    pub method: Method,
    /// Levels of pullpush, including the picture itself.
    pub levels: f64,
    /// Largest number of steps; 0: the width of the kernel that looked for holes, or for each kind
    /// of `mask` one and a half point spacings on the screen. `mask` counts to 127.
    pub iterations: f64,
    /// Depth difference of different surfaces, which are not averaged `[m]`; 0: as wide as eight
    /// cells of a level at that depth, or 31 pixels for `median`.
    pub tolerance: f64,
    /// Number of filled neighbours, of eight, from which background is filled, too; 9: never.
    pub surrounded: f64,
    /// Radius of splats `[px]`; 0: 2.
    pub radius: f64,
    /// Layer distance of `mask` `[m]`: nearer points than this are another surface; 0: that of the
    /// picture.
    pub layer: f64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// `median` if points are dense or transparent, else `pullpush` ([`settled`]).
    #[default]
    Auto,
    /// Step by step from the rim of a hole inwards.
    #[strum(to_string = "median", serialize = "pintus")]
    Median,
    /// From the nearest neighbour, where masks find a hole or a hidden pixel.
    #[strum(to_string = "mask", serialize = "dobrev")]
    Mask,
    /// Discs of one size; plain splats with visibility=off.
    Splat,
    /// From means of ever coarser pictures.
    Pullpush,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            method: Method::Auto,
            levels: MOST_LEVELS as f64,
            iterations: 0.0,
            tolerance: 0.0,
            surrounded: 5.0,
            radius: 0.0,
            layer: 0.0,
        }
    }
}

impl super::Settings for Settings {
    fn list_all(&mut self) -> Vec<Setting<'_>> {
        let number = Value::Number;
        vec![
            Setting::new(
                "method",
                "median: step by step from the rim; mask: nearest neighbour; pullpush: from coarser levels; splat: discs of one size; auto: median if points are dense or transparent, else pullpush",
                Value::Choice(&mut self.method),
            ),
            Setting::new(
                "radius",
                "radius of method=splat [px]; 0: 2",
                number(&mut self.radius, 0.0..=31.0),
            ),
            // For studies.
            Setting::variant("levels", Value::Whole(&mut self.levels, 1.0..=MOST_LEVELS as f64)),
            Setting::variant("iterations", Value::Whole(&mut self.iterations, 0.0..=1000.0)),
            Setting::variant("tolerance", number(&mut self.tolerance, 0.0..=1e9)),
            Setting::variant("surrounded", Value::Whole(&mut self.surrounded, 1.0..=9.0)),
            Setting::variant("layer", Value::Length(&mut self.layer, 0.0..=1e9)),
        ]
    }

    fn grows_px(&self, spacing_px: f64) -> f64 {
        match self.method {
            Method::Median if self.iterations == 0.0 => WIDEST,
            Method::Median => self.iterations,
            Method::Mask => mask::most_steps(self, spacing_px) as f64,
            Method::Splat => splat::radius(self),
            Method::Auto | Method::Pullpush => pullpush::reach_px(self) as f64,
        }
    }
}

/// See [`super::Effects::reach_px`]: one pixel per step, of two kinds with masks, and tiles wake
/// their neighbours.
pub fn reach_px(_view: &View, settings: &Settings) -> Option<u32> {
    let steps = settings.iterations.max(WIDEST) as u32;
    match settings.method {
        Method::Median => Some(steps + TILE_PX),
        Method::Mask => Some(2 * steps + TILE_PX),
        Method::Splat => Some(settings.radius.max(splat::RADIUS_PX).ceil() as u32),
        Method::Auto | Method::Pullpush => Some(pullpush::reach_px(settings)),
    }
}

pub fn called_for(context: &FrameContext, asked: &Effects, before: &EffectDecisions) -> Reason {
    let settings = &asked.fill.settings;
    match settings.method {
        Method::Auto | Method::Median => {}
        _ if context.points == 0 => {
            return Reason { runs: false, why: "there are no points".to_string() };
        }
        Method::Mask => {
            let layer_m = context.layer_m(settings.layer);
            return Reason {
                runs: true,
                why: format!(
                    "masks find holes and hidden pixels; surfaces are at least {} m apart",
                    context.metres(layer_m)
                ),
            };
        }
        Method::Splat => {
            return Reason {
                runs: true,
                why: "splats cover gaps without looking for them".to_string(),
            };
        }
        Method::Pullpush if before.runs(Effect::Visibility) => {}
        Method::Pullpush => {
            return Reason {
                runs: true,
                why: "without visibility, every pixel without a point is filled, also background"
                    .to_string(),
            };
        }
    }
    match before.runs(Effect::Visibility) {
        true => Reason {
            runs: true,
            why: "visibility leaves holes; tiles without holes are skipped".to_string(),
        },
        false => Reason {
            runs: false,
            why: "holes are unknown, since visibility does not run".to_string(),
        },
    }
}

/// Spacing of the sparsest node in view up to which holes are filled step by step `[px]`. Contours
/// are then slightly more exact. With larger spacings both methods are equal there (`study
/// surface`), but steps leave visible facets, take longer, and miss the middle of wide holes.
const STEPS_PX: f64 = 2.0;

/// Smallest number of levels: their cells always hold points to fill from.
const LEAST_LEVELS: f64 = 4.0;

/// Returns the settings for the spacing of the sparsest points `[px]`. Layers behind others begin
/// behind the depth of a nearby surface, not behind a distant mean, so these are filled by steps.
pub fn settled(asked: &Settings, transparent: bool, floods: bool, widest_px: f64) -> Settings {
    let method = match asked.method {
        Method::Auto if transparent || widest_px <= STEPS_PX => Method::Median,
        Method::Auto => Method::Pullpush,
        asked => asked,
    };
    // A flood reaches as far as the background.
    let enough =
        if floods { f64::INFINITY } else { visibility::levels_for(widest_px).max(LEAST_LEVELS) };
    Settings { method, levels: asked.levels.min(enough), ..*asked }
}

/// Largest distance over which steps carry depths `[px]`.
pub(super) const WIDEST: f64 = 31.0;

pub fn record(
    g: &mut Graph,
    context: &FrameContext,
    settings: &Settings,
    gbuffer: GBuffer,
) -> GBuffer {
    let view = context.view;
    match settings.method {
        Method::Median => {}
        Method::Mask => return mask::record(g, context, settings, gbuffer),
        Method::Splat => return splat::record(g, view, settings, gbuffer),
        Method::Auto | Method::Pullpush => {
            return pullpush::record(g, view, settings, context.shown.is_label(), gbuffer);
        }
    }
    let Some(holes) = &gbuffer.holes else { return gbuffer };
    let labels = [context.shown.is_label(), false];
    let filled: Vec<_> = gbuffer
        .colors()
        .zip(labels)
        .map(|(color, labels)| median(g, view, settings, holes, &gbuffer.depth, color, labels))
        .collect();
    let median_steps = filled.first().map(|(_, steps)| steps.alias());
    let GBuffer { mut depth, mut color, mut shadow_factor, .. } = gbuffer;
    for (color, ([filled_depth, filled_color], _)) in
        [Some(&mut color), shadow_factor.as_mut()].into_iter().flatten().zip(&filled)
    {
        let push = fill_median_end::Push { size: view.size, tiles_across: tiles(view.size)[0] };
        let listed = Dispatch::Indirect(&holes.list, 0);
        g.run(
            shader::FillMedianEnd {
                lists: &holes.list,
                filled_depth,
                filled_color,
                depth: &mut depth,
                color,
                push,
            },
            listed,
        );
    }
    let tile_lists = TileLists { median_steps, ..gbuffer.tile_lists };
    GBuffer { depth, color, shadow_factor, holes: None, tile_lists, ..gbuffer }
}

/// Returns depth and colour with filled pixels, in the packed form that steps alternate between;
/// and the steps.
fn median(
    g: &mut Graph,
    view: &View,
    settings: &Settings,
    holes: &Holes,
    depth: &Image,
    color: &Image,
    labels: bool,
) -> ([Image; 2], Buffer) {
    let Holes { list: lists, kernels, widest, .. } = holes;
    let across = tiles(view.size);
    let count = across[0] * across[1];

    let packed = [TILE_PX * across[0], TILE_PX * across[1] / 4];
    let pair = |g: &mut Graph, name: &str| {
        ["depth", "color"].map(|what| g.image(&format!("{name} {what}"), packed, Kind::Rgba32f))
    };
    let ([mut from_depth, mut from_color], [mut to_depth, mut to_color]) =
        (pair(g, "even"), pair(g, "odd"));
    let push = fill_median_begin::Push { tiles_across: across[0] };
    let (even, odd) = ((&mut from_depth, &mut from_color), (&mut to_depth, &mut to_color));
    g.run(
        shader::FillMedianBegin {
            lists,
            depth,
            color,
            even_depth: even.0,
            even_color: even.1,
            odd_depth: odd.0,
            odd_color: odd.1,
            push,
        },
        Dispatch::Indirect(lists, 0),
    );

    let texels = g.gpu.device.has_large_texel_buffers;
    let most = if settings.iterations == 0.0 {
        (*widest).min(WIDEST as u32)
    } else {
        settings.iterations as u32
    };
    let woken_at = 4 * (most + 2);
    let mut steps = g.buffer("steps", 4 * (woken_at + count) as u64);
    g.fill(&mut steps, 0);
    let (tolerance, relative) = tolerance_px(view, settings, WIDEST);
    for step in 1..=most {
        let push = fill_median::Push {
            tiles: across,
            step,
            woken_at,
            tolerance,
            relative,
            surrounded: settings.surrounded as u32,
            most_groups: g.gpu.device.max_workgroups,
        };
        let counted = steps.racy_alias();
        let listed = if step == 1 {
            Dispatch::Indirect(lists, 0)
        } else {
            Dispatch::Indirect(&counted, 4 * step)
        };
        g.run(
            shader::FillMedian {
                lists,
                listed_words: lists,
                kernel_words: kernels,
                kernels,
                step_words: &counted,
                steps: &mut steps,
                from_depth: &from_depth,
                from_color: &from_color,
                to_depth: &mut to_depth,
                to_color: &mut to_color,
                push,
                spec: fill_median::Spec { texels, labels },
            },
            listed,
        );
        std::mem::swap(&mut from_depth, &mut to_depth);
        std::mem::swap(&mut from_color, &mut to_color);
    }
    ([from_depth, from_color], steps)
}

/// Largest depth difference on one surface [cells of a level].
const MIXED_CELLS: f64 = 8.0;

/// Returns the tolerance of a level of pullpush.
fn tolerance(view: &View, settings: &Settings, level: u32) -> (f32, u32) {
    tolerance_px(view, settings, MIXED_CELLS * 2f64.powi(level as i32))
}

/// Returns the depth difference of different surfaces, by default as wide as `px` pixels, and 1 if
/// it is a share of the depth.
fn tolerance_px(view: &View, settings: &Settings, px: f64) -> (f32, u32) {
    let automatic = settings.tolerance == 0.0;
    let relative = automatic && view.camera.projection == Projection::Perspective;
    (if automatic { px / view.focal_px() } else { settings.tolerance } as f32, relative as u32)
}

/// Returns the number of steps until nothing changed, from a buffer of steps after the frame
/// (glsl/lib/tile_steps.glsl); 0 without one.
pub fn steps_taken(steps: &[u32], tiles: u32) -> u32 {
    let most = (steps.len().saturating_sub(tiles as usize) / 4).saturating_sub(2);
    (1..=most).take_while(|step| steps[4 * step + 4] > 0).count() as u32
}
