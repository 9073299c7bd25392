//! Smoothing: weighted means of depth and colour over 3 x 3 pixels (Dobrev, Rosenthal and Linsen
//! 2010, sec. 3.4).
//!
//! ```text
//!     smooth_tiles   projected_depth, depth -> filled pixels, and the list of tiles with some in reach
//!     smooth         depth, color -> smooth depth, smooth color    in these tiles, repeatedly
//!     smooth_end     smooth depth, smooth color -> depth, color
//! ```
//! Filling from the nearest neighbour leaves patches of one depth and colour; smoothing removes the
//! steps between them. They lie where the projected depth jumps: in gaps, and at points that shine
//! through. A measured pixel stays as it is if all around it were measured. Background neither
//! gives nor takes, so outlines stay.
//!
//! Patches are as wide as points lie apart. One iteration is enough if that is a pixel. If it is
//! more, the number of iterations is the one that spreads a pixel's value over a patch.

use super::{
    Effect, EffectDecisions, Effects, FrameContext, GBuffer, LIST_HEADER, Reason, Setting, TILE_PX,
    TileLists, Value, fill, tiles,
};
use crate::graph::{Dispatch, Graph, Kind};
use crate::names::Named;
use crate::shader::{self, smooth, smooth_end, smooth_tiles};
use crate::view::View;
use strum::{EnumString, IntoStaticStr, VariantArray};

pub const SUMMARY: &str =
    "smooths steps between pixels of one surface: means of depth and colour over 3 x 3";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    pub filter: Filter,
    /// Number of iterations; 0: by the point spacing on the screen.
    pub iterations: f64,
    /// Pixels that are smoothed.
    pub pixels: Pixels,
}

/// Pixels that are smoothed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Pixels {
    /// Filled pixels and their neighbours.
    #[default]
    Filled,
    /// Measured pixels, too, as in the paper.
    All,
}

/// Weights of the pixel, its four sides and its corners.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Filter {
    /// Alleviated if points are about a pixel apart; else box, which reaches as far in less than
    /// half as many iterations.
    #[default]
    Auto,
    /// 16, 2, 1: that of the paper, which hardly blurs.
    Alleviated,
    /// 4, 2, 1.
    Gaussian,
    /// 1, 1, 1.
    Box,
}

impl std::fmt::Display for Filter {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        self.name().fmt(f)
    }
}

impl Filter {
    /// Returns the weights of the pixel, each side and each corner.
    pub fn weights(self) -> [f32; 3] {
        match self {
            Filter::Auto | Filter::Alleviated => [16.0, 2.0, 1.0],
            Filter::Gaussian => [4.0, 2.0, 1.0],
            Filter::Box => [1.0; 3],
        }
    }

    /// Returns how far it spreads a value across, or down: variance [px^2].
    fn variance(self) -> f64 {
        let [own, side, corner] = self.weights().map(f64::from);
        (2.0 * side + 4.0 * corner) / (own + 4.0 * side + 4.0 * corner)
    }
}

impl Default for Settings {
    fn default() -> Self {
        Settings { filter: Filter::Auto, iterations: 0.0, pixels: Pixels::Filled }
    }
}

impl super::Settings for Settings {
    fn list_all(&mut self) -> Vec<Setting<'_>> {
        vec![
            Setting::new(
                "iterations",
                "number of iterations; 0: from the point spacing",
                Value::Whole(&mut self.iterations, 0.0..=MOST),
            ),
            Setting::new(
                "pixels",
                "filled pixels and their neighbours, or all",
                Value::Choice(&mut self.pixels),
            ),
            // For studies.
            Setting::variant("filter", Value::Choice(&mut self.filter)),
        ]
    }

    /// Pixels without a point do not change.
    fn grows_px(&self, _spacing_px: f64) -> f64 {
        0.0
    }
}

/// Largest number of iterations.
const MOST: f64 = 64.0;

/// Returns the filter and the number of iterations. Automatic: until values have spread by half the
/// point spacing, as a standard deviation.
fn chosen(settings: &Settings, spacing_px: f64) -> (Filter, u32) {
    let wanted = 0.25 * spacing_px * spacing_px;
    let often = |filter: Filter| (wanted / filter.variance()).round().clamp(1.0, MOST / 2.0) as u32;
    let filter = match settings.filter {
        Filter::Auto if often(Filter::Alleviated) > 1 => Filter::Box,
        Filter::Auto => Filter::Alleviated,
        asked => asked,
    };
    (filter, if settings.iterations > 0.0 { settings.iterations as u32 } else { often(filter) })
}

/// See [`super::Effects::reach_px`].
pub fn reach_px(_view: &View, settings: &Settings) -> Option<u32> {
    Some(if settings.iterations > 0.0 { settings.iterations } else { MOST / 2.0 } as u32)
}

pub fn called_for(context: &FrameContext, asked: &Effects, before: &EffectDecisions) -> Reason {
    let (filter, often) = chosen(&asked.smooth.settings, context.sampling.spacing_px());
    let often = if often == 1 { "once".to_string() } else { format!("{often} times") };
    let (runs, why) = match (before.runs(Effect::Fill), asked.fill.settings.method) {
        _ if context.shown.is_label() => {
            (false, "points show labels, which are not mixed".to_string())
        }
        (false, _) => (false, "no surface was filled".to_string()),
        (true, fill::Method::Mask) => (
            true,
            format!(
                "filling from the nearest neighbour leaves patches of one depth and colour: {filter}, {often}; tiles in which nothing was filled are skipped"
            ),
        ),
        (true, _) => (false, "filling leaves no patches, so details stay as they are".to_string()),
    };
    Reason { runs, why }
}

pub fn record(
    g: &mut Graph,
    context: &FrameContext,
    settings: &Settings,
    gbuffer: GBuffer,
) -> GBuffer {
    let size = context.view.size;
    let tiles = tiles(size);
    let count = tiles[0] * tiles[1];
    let all = settings.pixels == Pixels::All;
    let mut pixels = g.buffer("smoothed pixels", 4 * (TILE_PX * count) as u64);
    let (mut found, mut lists) = (
        g.buffer("found", 4 * count as u64),
        g.buffer("smoothed tiles", 4 * (LIST_HEADER + count) as u64),
    );
    [&mut pixels, &mut found, &mut lists].into_iter().for_each(|words| g.fill(words, 0));
    let push = smooth_tiles::Push { tiles, all: all as u32 };
    let GBuffer { projected_depth, mut depth, mut color, mut shadow_factor, .. } = gbuffer;
    g.run(
        shader::SmoothTiles {
            projected_depth: &projected_depth,
            filled: &depth,
            pixels: &mut pixels,
            found: &mut found,
            lists: &mut lists,
            push,
        },
        Dispatch::PerEightTiles(count),
    );

    let mut smooth_depth = g.image("smooth depth", size, Kind::R32f);
    let mut smooth_color = g.image("smooth color", size, Kind::Rgba32f);
    // Depth and colour have steps wherever pixels were filled, light only at its edges; noise in it
    // is removed with all else. Unread bindings need an image, too.
    let shadowed = all && shadow_factor.is_some();
    let mut nowhere = g.image("nowhere", [1, 1], Kind::Rgba32f);
    let mut smooth_shadow_factor =
        g.image("smooth shadow factor", if shadowed { size } else { [1, 1] }, Kind::Rgba32f);
    let (filter, iterations) = chosen(settings, context.sampling.spacing_px());
    for _ in 0..iterations {
        let light = shadow_factor.as_ref().filter(|_| shadowed).unwrap_or(&color);
        let to = (&mut smooth_depth, &mut smooth_color, &mut smooth_shadow_factor);
        let (push, spec) =
            (smooth::Push { tiles, weights: filter.weights() }, smooth::Spec { shadowed });
        g.run(
            shader::Smooth {
                lists: &lists,
                pixels: &pixels,
                depth: &depth,
                color: &color,
                shadow_factor: light,
                smooth_depth: to.0,
                smooth_color: to.1,
                smooth_shadow_factor: to.2,
                push,
                spec,
            },
            Dispatch::Indirect(&lists, 0),
        );
        let light = shadow_factor.as_mut().filter(|_| shadowed).unwrap_or(&mut nowhere);
        let (push, spec) =
            (smooth_end::Push { tiles_across: tiles[0] }, smooth_end::Spec { shadowed });
        g.run(
            shader::SmoothEnd {
                lists: &lists,
                smooth_depth: &smooth_depth,
                smooth_color: &smooth_color,
                smooth_shadow_factor: &smooth_shadow_factor,
                depth: &mut depth,
                color: &mut color,
                shadow_factor: light,
                push,
                spec,
            },
            Dispatch::Indirect(&lists, 0),
        );
    }
    let tile_lists = TileLists { smoothed: Some(lists), ..gbuffer.tile_lists };
    GBuffer { projected_depth, depth, color, shadow_factor, tile_lists, ..gbuffer }
}
