//! Shape depiction: a factor on the light that shows shape without normals, from depth (Pintus et
//! al. 2011, sec. 6).
//!
//! Every level compares a pixel's depth with mean and deviation of its 3 x 3 neighbourhood, and
//! passes a smoother depth to the next: fine levels draw lines, coarse ones shade whole surfaces.
//! Levels after the first run where the surface is not planar: on a plane every level gives the
//! same factor (to 1/256).

use super::{
    EffectDecisions, Effects, FrameContext, GBuffer, LIST_HEADER, Reason, Setting, TILE_PX,
    TileLists, Value, tiles,
};
use crate::graph::{Dispatch, Graph, Kind};
use crate::shader::{self, base_white, pack_depth, shape, shape_level, shape_unpack};
use crate::view::{Projection, View};
use strum::{EnumString, IntoStaticStr, VariantArray};

pub const SUMMARY: &str =
    "shape depiction: lines at creases, light on surfaces that face the viewer, without normals";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    /// Number of levels; 1 is the paper's single pass: sharp, lines only.
    pub levels: f64,
    /// Exponent of the weights: level k weighs 1 / (k + 1)^xi.
    pub xi: f64,
    /// 1 if the first level weighs as much as all others (Fig. 8 d), else 0.
    pub first: f64,
    /// Rise from pixel to pixel up to which a surface still faces the viewer, in pixel widths.
    pub softness: f64,
    pub base: Base,
}

/// The colour that is shaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Base {
    /// The colours of points.
    #[default]
    Color,
    /// White: the factor alone.
    White,
}

impl Default for Settings {
    fn default() -> Self {
        Settings { levels: 8.0, xi: 1.5, first: 0.0, softness: 1.0, base: Base::Color }
    }
}

impl super::Settings for Settings {
    fn list_all(&mut self) -> Vec<Setting<'_>> {
        let number = Value::Number;
        vec![
            Setting::new(
                "levels",
                "levels of smoothing: more shade larger forms; 1: lines only",
                Value::Whole(&mut self.levels, 1.0..=64.0),
            ),
            Setting::new(
                "base",
                "what is shaded: the colours of points, or white",
                Value::Choice(&mut self.base),
            ),
            // For studies.
            Setting::variant("xi", number(&mut self.xi, 0.0..=16.0)),
            Setting::variant("first", number(&mut self.first, 0.0..=1.0)),
            Setting::variant("softness", number(&mut self.softness, 0.0..=1e3)),
        ]
    }

    /// Pixels without a point do not change.
    fn grows_px(&self, _spacing_px: f64) -> f64 {
        0.0
    }
}

/// See [`super::Effects::reach_px`]: one pixel per level, and the tiles around a tile decide which
/// levels it has.
pub fn reach_px(_view: &View, settings: &Settings) -> Option<u32> {
    Some(settings.levels as u32 + TILE_PX * (rings(settings.levels as u32)[1] as u32 + 2))
}

pub fn called_for(context: &FrameContext, _asked: &Effects, _before: &EffectDecisions) -> Reason {
    match context.points {
        0 => Reason { runs: false, why: "there are no points".to_string() },
        _ => Reason {
            runs: true,
            why: "depths show the shape of surfaces without normals".to_string(),
        },
    }
}

/// Returns the weight of every level; they add up to 1.
pub fn weights(settings: &Settings) -> Vec<f64> {
    let mut weights: Vec<f64> =
        (0..settings.levels as u32).map(|k| ((k + 1) as f64).powf(-settings.xi)).collect();
    if settings.first >= 0.5 && weights.len() > 1 {
        weights[0] += weights[1..].iter().sum::<f64>();
    }
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|weight| weight / sum).collect()
}

/// Returns the rings of tiles around a tile that is not planar: those shaded by deeper levels,
/// since each level looks a pixel farther; and those whose depths they need, since outdated depths
/// come a pixel nearer with each level.
fn rings(levels: u32) -> [i32; 2] {
    let shaded = levels.saturating_sub(1).div_ceil(TILE_PX);
    [shaded, shaded + levels.saturating_sub(2).div_ceil(TILE_PX)].map(|rings| rings as i32)
}

pub fn record(
    g: &mut Graph,
    context: &FrameContext,
    settings: &Settings,
    gbuffer: GBuffer,
) -> GBuffer {
    let view = context.view;
    let (size, across) = (view.size, tiles(view.size));
    let count = across[0] * across[1];
    let perspective = view.camera.projection == Projection::Perspective;
    let width = (settings.softness / view.focal_px()) as f32;
    let weights = weights(settings);

    // Whole tiles, so that the kernel has no special case at the edge.
    let packed = [TILE_PX * across[0], TILE_PX * across[1] / 4];
    let [mut from, mut to, mut shade] =
        ["smooth", "smoother", "shade"].map(|name| g.image(name, packed, Kind::Rgba32f));
    let mut lists = g.buffer("rough tiles", 4 * (LIST_HEADER + count) as u64);
    let mut wanted = g.buffer("wanted", 4 * count as u64);
    g.fill(&mut lists, 0);
    g.fill(&mut wanted, 0);
    let push = pack_depth::Push { size, packed_size: packed, margin: 0, mirror: 0 };
    g.run(
        shader::PackDepth { depth: &gbuffer.depth, packed_depth: &mut to, push },
        Dispatch::PerPixel,
    );
    let [shaded, rings] = rings(weights.len() as u32);
    let push = shape::Push { size, tiles: across, width, shaded, rings };
    g.run(
        shader::Shape {
            depth: &to,
            next: &mut from,
            shade: &mut shade,
            lists: &mut lists,
            wanted: &mut wanted,
            push,
            spec: shape::Spec { perspective },
        },
        Dispatch::Groups([count.div_ceil(8).min(65_535), 1, 1]),
    );
    for (k, &weight) in weights.iter().enumerate().skip(1) {
        let before = if k == 1 { weights[0] } else { 1.0 } as f32;
        let push =
            shape_level::Push { tiles_across: across[0], width, before, weight: weight as f32 };
        let spec = shape_level::Spec { perspective, texels: g.gpu.device.has_large_texel_buffers };
        g.run(
            shader::ShapeLevel {
                from: &from,
                to: &mut to,
                shade: &mut shade,
                lists: &lists,
                listed_words: &lists,
                wanted: &wanted,
                wanted_words: &wanted,
                push,
                spec,
            },
            Dispatch::Indirect(&lists, 0),
        );
        std::mem::swap(&mut from, &mut to);
    }
    let mut shading = g.image("shading", size, Kind::R32f);
    g.run(
        shader::ShapeUnpack {
            shade: &shade,
            shading: &mut shading,
            push: shape_unpack::Push { size },
        },
        Dispatch::Groups([size[0].div_ceil(64), size[1].div_ceil(4), 1]),
    );
    let color = match settings.base {
        Base::Color => gbuffer.color,
        Base::White => {
            let mut white = g.image("white", size, Kind::Rgba32f);
            g.run(
                shader::BaseWhite {
                    color: &gbuffer.color,
                    white: &mut white,
                    push: base_white::Push { size },
                },
                Dispatch::PerPixel,
            );
            white
        }
    };
    let tile_lists = TileLists { rough: Some(lists), ..gbuffer.tile_lists };
    GBuffer { color, shading: Some(shading), tile_lists, ..gbuffer }
}
