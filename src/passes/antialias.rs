//! Anti-aliasing: blends depth and shaded colour at silhouettes (Dobrev, Rosenthal and Linsen 2010,
//! sec. 3.5).
//!
//! ```text
//!     antialias_tiles   depth -> list of tiles with silhouettes
//!     antialias         depth, color, shading -> blended, remaining_shading   in these tiles
//!     antialias_end     blended, remaining_shading -> color, shading
//! ```
//! A silhouette is where the Laplacian of the depth is large. Blending works on premultiplied
//! linear colour, so the effect is the last before layers are composited, and the background shows
//! through in part. Depth and point ids do not change, nor do tiles without jumps in depth.

use super::smooth::Pixels;
use super::visibility::Looked;
use super::{
    Effect, EffectDecisions, Effects, FrameContext, GBuffer, LIST_HEADER, Reason, Setting,
    TileLists, Value, tiles,
};
use crate::graph::{Dispatch, Graph, Kind};
use crate::shader::{self, antialias, antialias_end, antialias_tiles};
use crate::view::View;
use strum::{EnumString, IntoStaticStr, VariantArray};

pub const SUMMARY: &str =
    "anti-aliasing: blends the stairs of silhouettes, found by the Laplacian of the depth";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    pub threshold: Threshold,
    pub laplacian: Laplacian,
    /// Low threshold: smallest Laplacian of a silhouette, as a share of the depth.
    pub jump: f64,
    /// Tiles that are blended.
    pub tiles: Looked,
}

/// The silhouettes that are blended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Threshold {
    /// Against the background and between surfaces.
    #[default]
    Low,
    /// Against the background only.
    High,
}

/// The quantity whose Laplacian finds silhouettes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Laplacian {
    /// 1 / depth, which is affine on every plane.
    #[default]
    Inverse,
    /// The depth, as in the paper.
    Depth,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            threshold: Threshold::Low,
            laplacian: Laplacian::Inverse,
            jump: 0.03,
            tiles: Looked::Needed,
        }
    }
}

impl super::Settings for Settings {
    fn list_all(&mut self) -> Vec<Setting<'_>> {
        let number = Value::Number;
        vec![
            Setting::new(
                "jump",
                "smallest Laplacian of a silhouette, as a fraction of the depth",
                number(&mut self.jump, 0.0..=4.0),
            ),
            // For studies.
            Setting::variant("threshold", Value::Choice(&mut self.threshold)),
            Setting::variant("laplacian", Value::Choice(&mut self.laplacian)),
            Setting::variant("tiles", Value::Choice(&mut self.tiles)),
        ]
    }

    fn grows_px(&self, _spacing_px: f64) -> f64 {
        1.0
    }
}

/// See [`super::Effects::reach_px`].
pub fn reach_px(_view: &View, _settings: &Settings) -> Option<u32> {
    Some(2)
}

pub fn called_for(_scene: &FrameContext, asked: &Effects, before: &EffectDecisions) -> Reason {
    let smooths = before.runs(Effect::Smooth)
        && (before.runs(Effect::Fill) || asked.smooth.settings.pixels == Pixels::All);
    let (runs, why) = match before.runs(Effect::Fill) {
        _ if smooths => {
            (true, "smoothed surfaces end in stairs; tiles without silhouettes are skipped")
        }
        true => (false, "nothing was smoothed, so pixels stay as they are"),
        false => (false, "points have no silhouettes"),
    };
    Reason { runs, why: why.to_string() }
}

pub fn record(
    g: &mut Graph,
    context: &FrameContext,
    settings: &Settings,
    gbuffer: GBuffer,
) -> GBuffer {
    let size = context.view.size;
    let across = tiles(size);
    let count = across[0] * across[1];
    let (inverse, high) =
        (settings.laplacian == Laplacian::Inverse, settings.threshold == Threshold::High);
    let jump = settings.jump as f32;
    let (mut found, mut lists) = (
        g.buffer("found", 4 * count as u64),
        g.buffer("silhouettes", 4 * (LIST_HEADER + count) as u64),
    );
    g.fill(&mut found, 0);
    g.fill(&mut lists, 0);
    let push = antialias_tiles::Push {
        size,
        tiles: across,
        jump,
        all: (settings.tiles == Looked::All) as u32,
    };
    let spec = antialias_tiles::Spec { inverse, high };
    g.run(
        shader::AntialiasTiles {
            depth: &gbuffer.depth,
            found: &mut found,
            lists: &mut lists,
            push,
            spec,
        },
        Dispatch::PerEightTiles(count),
    );

    let GBuffer { depth, mut color, mut shading, .. } = gbuffer;
    let mut blended = g.image("blended", size, Kind::Rgba32f);
    // Unread bindings need an image, too.
    let has_shading = shading.is_some();
    let mut remaining_shading =
        g.image("remaining shading", if has_shading { size } else { [1, 1] }, Kind::R32f);
    let light = shading.as_ref().unwrap_or(&depth);
    let push = antialias::Push { size, tiles_across: across[0], jump };
    let spec = antialias::Spec { inverse, high, has_shading };
    let run = Dispatch::Indirect(&lists, 0);
    g.run(
        shader::Antialias {
            lists: &lists,
            depth: &depth,
            color: &color,
            shading: light,
            blended: &mut blended,
            remaining_shading: &mut remaining_shading,
            push,
            spec,
        },
        run,
    );
    let mut nowhere = shading.is_none().then(|| g.image("nowhere", [1, 1], Kind::R32f));
    let light = shading.as_mut().or(nowhere.as_mut()).expect("one of them");
    let (push, spec) =
        (antialias_end::Push { tiles_across: across[0] }, antialias_end::Spec { has_shading });
    g.run(
        shader::AntialiasEnd {
            lists: &lists,
            blended: &blended,
            remaining_shading: &remaining_shading,
            color: &mut color,
            shading: light,
            push,
            spec,
        },
        Dispatch::Indirect(&lists, 0),
    );
    let tile_lists = TileLists { silhouettes: Some(lists), ..gbuffer.tile_lists };
    GBuffer { depth, color, shading, tile_lists, ..gbuffer }
}
