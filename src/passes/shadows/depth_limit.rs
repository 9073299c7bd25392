//! Keys of a light's picture in, how deep light reaches in each of its texels out (Dobrev et al. 2010, sec. 6; HARD_CASES 13).
//!
//! ```text
//!     light_halve   depths -> depths     of the picture half as wide and high, and all of this for it, where some surfaces are sparse
//!     light_cover   depths -> tiles      that hold points: those below keep to them and what lies around
//!     light_fill    depths -> depths     closes gaps that light would fall through
//!     light_limit   depths -> limits     depth + layer / <v, n>
//!     light_join    coarser limits -> limits, where the coarser picture shows what is sparse in this one
//! ```

use super::Settings;
use super::cameras::{self, LightCamera};
use crate::graph::{Buffer, Dispatch, Graph, TileList};
use crate::passes::{predicate, tiles};
use crate::shader::{
    self, shadow_close_gaps, shadow_depth_limit, shadow_downsample, shadow_merge_mip,
    shadow_occupancy,
};
use crate::view::{Projection, View};
use glam::DVec3;
use std::f64::consts::SQRT_2;

/// How far behind what the light sees a point still belongs to it.
#[derive(Clone, Copy, Debug)]
pub struct Layer {
    pub perspective: bool,
    /// Side of a texel: metres, or with perspective parts of the depth.
    pub texel: f64,
    /// Across the surface: metres, and sides of a texel.
    pub metres: f64,
    pub texels: f64,
    /// Tangent of the steepest angle to the light.
    pub steepest: f64,
    /// How far behind the nearest point of a texel light may reach at most, metres.
    pub deepest: f64,
    pub fill: u32,
    /// As of a [`Sight`].
    pub margin: u32,
    pub halvings: u32,
    pub spacing_m: f64,
}

impl Layer {
    pub fn of(sight: &LightCamera, bounds: (DVec3, DVec3), settings: &Settings) -> Layer {
        let &LightCamera { ref view, margin, halvings, spacing_m } = sight;
        // Who lets light through gaps lets it through wide ones, too.
        let halvings = if settings.fill > 0.0 { halvings } else { 0 };
        Layer { margin, halvings, spacing_m, ..Layer::new(view, bounds, settings) }
    }

    /// The depth up to which points of a surface lie so far apart in this picture that a coarser one closes the gaps between them, metres.
    pub fn sparse_m(&self) -> f32 {
        let apart_px = self.spacing_m / self.texel / cameras::SPARSE;
        match self.perspective {
            true => apart_px as f32,
            false if apart_px > 1.0 => f32::INFINITY,
            false => 0.0,
        }
    }

    /// Of a picture half as wide and high.
    fn halved(&self) -> Layer {
        Layer { texel: 2.0 * self.texel, margin: 0, halvings: self.halvings - 1, ..*self }
    }

    /// HARD_CASES 13: sqrt(2) sides of a texel and a quantum, twice the sides where masks fill from neighbours.
    pub fn new(camera: &View, bounds: (DVec3, DVec3), settings: &Settings) -> Layer {
        let fill = settings.fill as u32;
        let farthest = camera.depths(bounds).map_or(0.0, |(_, farthest)| farthest);
        // A depth is eight roundings off at most, and two depths are compared; positions are quantised far below.
        let quantum = 16.0 * f32::EPSILON as f64 * farthest;
        let perspective = camera.camera.projection == Projection::Perspective;
        let texel = 1.0 / camera.focal_px();
        let across = |(metres, texels): (f64, f64)| {
            metres + texels * texel * if perspective { farthest } else { 1.0 }
        };
        let theorem = (quantum, if fill > 0 { 2.0 * SQRT_2 } else { SQRT_2 });
        let (metres, texels) = match settings.layer {
            0.0 if across(theorem) < settings.least => (settings.least, 0.0),
            0.0 => theorem,
            metres => (metres, 0.0),
        };
        let steepest = (1.0 / (settings.limit * settings.limit) - 1.0).max(0.0).sqrt();
        let across = across((metres, texels));
        // Gaps are closed by what is nearer still; and two quanta for what is rounded on the way.
        let deepest = across * (1.0 + steepest * steepest).sqrt() + 2.0 * quantum;
        Layer {
            perspective,
            texel,
            metres,
            texels,
            steepest,
            deepest,
            fill,
            margin: 0,
            halvings: 0,
            spacing_m: 0.0,
        }
    }
}

/// Of every texel of a light's picture, f32, row by row.
pub struct Reached {
    /// What the light sees, gaps closed; infinite where nothing is, and anything farther from points than gaps are closed. None where nothing closes gaps: the depths of the keys.
    pub filled: Option<Buffer>,
    /// How deep it reaches; likewise.
    pub limit: Buffer,
    /// The halved picture that both were joined with, and its depths.
    pub coarser: Option<(Buffer, Box<Reached>)>,
    /// Where they are known.
    area: TileList,
}

/// Keys of the light's picture -> how deep it reaches, wherever points are and beside them.
pub fn reach(g: &mut Graph, camera: &View, keys: &Buffer, layer: &Layer) -> Reached {
    reach_of(g, camera.size, (keys, true), layer, f32::INFINITY)
}

/// The same of depths, where that is said; wherever points are that are nearer than `within`, metres, and infinite elsewhere.
fn reach_of(
    g: &mut Graph,
    size: [u32; 2],
    (depth, of_keys): (&Buffer, bool),
    layer: &Layer,
    within: f32,
) -> Reached {
    let across = tiles(size);
    let (count, bytes) = (across[0] * across[1], 4 * size[0] as u64 * size[1] as u64);
    let (perspective, texels) = (layer.perspective, g.gpu.device.has_large_texel_buffers);
    // All are told the same.
    macro_rules! push {
        ($module:ident, $filled:expr) => {
            $module::Push {
                size,
                texel: layer.texel as f32,
                layer: layer.metres as f32,
                layer_px: layer.texels as f32,
                steepest: layer.steepest as f32,
                filled: $filled as f32,
                within,
                margin: layer.margin,
            }
        };
    }
    let sparse = layer.sparse_m();
    let coarser = (layer.halvings > 0).then(|| {
        let half = size.map(|side| side.div_ceil(2));
        let mut halved = g.buffer("light halved", 4 * half[0] as u64 * half[1] as u64);
        let spec = shadow_downsample::Spec { perspective, texels, of_keys };
        let groups = Dispatch::Groups([half[0].div_ceil(64), half[1], 1]);
        g.run(
            shader::ShadowDownsample {
                depth,
                depth_words: depth,
                halved: &mut halved,
                push: push!(shadow_downsample, 0),
                spec,
            },
            groups,
        );
        let reached = reach_of(g, half, (&halved, false), &layer.halved(), sparse);
        (halved, Box::new(reached))
    });
    let mut covered = g.buffer("light covered", 4 * count as u64);
    g.fill(&mut covered, 0);
    let spec = shadow_occupancy::Spec { perspective, texels, of_keys };
    g.run(
        shader::ShadowOccupancy {
            depth,
            depth_words: depth,
            covered: &mut covered,
            push: push!(shadow_occupancy, 0),
            spec,
        },
        Dispatch::PerEightTiles(count),
    );
    let area = predicate::listed(g, &covered, across, layer.fill as f64);
    let everywhere = within == f32::INFINITY;
    let known = |g: &mut Graph, name: &str| {
        let mut buffer = g.buffer(name, bytes);
        if !everywhere {
            g.fill(&mut buffer, f32::INFINITY.to_bits());
        }
        buffer
    };
    let mut closed: Vec<Buffer> = (0..layer.fill).map(|_| known(g, "light filled")).collect();
    let mut limit = known(g, "light limit");
    g.within_tiles(Some(&area), |g| {
        for step in 0..layer.fill as usize {
            let spec =
                shadow_close_gaps::Spec { perspective, texels, of_keys: of_keys && step == 0 };
            let (before, after) = closed.split_at_mut(step);
            let depth = before.last().unwrap_or(depth);
            g.run(
                shader::ShadowCloseGaps {
                    depth,
                    depth_words: depth,
                    filled: &mut after[0],
                    push: push!(shadow_close_gaps, step),
                    spec,
                },
                Dispatch::PerEightTiles(count),
            );
        }
        let spec =
            shadow_depth_limit::Spec { perspective, texels, of_keys: of_keys && layer.fill == 0 };
        let seen = closed.last().unwrap_or(depth);
        g.run(
            shader::ShadowDepthLimit {
                depth: seen,
                depth_words: seen,
                limit: &mut limit,
                push: push!(shadow_depth_limit, layer.fill),
                spec,
            },
            Dispatch::PerEightTiles(count),
        );
    });
    let mut filled = closed.pop();
    if let (Some(front), Some((_, coarse))) = (&mut filled, &coarser) {
        let coarse_front =
            coarse.filled.as_ref().expect("pictures are halved where gaps are closed");
        let push = shadow_merge_mip::Push { size, within: sparse };
        let tiles = tiles(size.map(|side| side.div_ceil(2)));
        g.within_tiles(Some(&coarse.area), |g| {
            g.run(
                shader::ShadowMergeMip {
                    coarse_front,
                    coarse_limit: &coarse.limit,
                    front,
                    limit: &mut limit,
                    push,
                },
                Dispatch::PerEightTiles(tiles[0] * tiles[1]),
            );
        });
    }
    Reached { filled, limit, coarser, area }
}
