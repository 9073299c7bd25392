//! Computes the depth that light reaches in each texel of its picture from its keys (Dobrev et al.
//! 2010, sec. 6; guide: numerics, case 13).
//!
//! ```text
//!     shadow_downsample    depths -> depths of the half-size picture, and all of this for it, if some
//!                          surfaces are sparse
//!     shadow_occupancy     depths -> tiles that hold points; the passes below keep to them and
//!                          their surroundings
//!     shadow_close_gaps    depths -> depths with gaps closed that light would fall through
//!     shadow_depth_limit   depths -> limits: depth + layer / <v, n>
//!     shadow_merge_mip     limits of the half-size picture -> limits, where this one is sparse
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

/// The distance behind a visible surface within which a point belongs to it.
#[derive(Clone, Copy, Debug)]
pub struct Layer {
    pub perspective: bool,
    /// Side of a texel `[m]`, or as a share of the depth with perspective.
    pub texel: f64,
    /// Thickness across the surface: metres, plus texels.
    pub metres: f64,
    pub texels: f64,
    /// Tangent of the steepest angle to the light.
    pub steepest: f64,
    /// Largest distance behind the nearest point of a texel that light reaches `[m]`.
    pub deepest: f64,
    pub fill: u32,
    /// See [`LightCamera`].
    pub margin: u32,
    pub halvings: u32,
    pub spacing_m: f64,
}

impl Layer {
    pub fn of(sight: &LightCamera, bounds: (DVec3, DVec3), settings: &Settings) -> Layer {
        let &LightCamera { ref view, margin, halvings, spacing_m } = sight;
        // Without closing of gaps no coarser pictures are needed.
        let halvings = if settings.fill > 0.0 { halvings } else { 0 };
        Layer { margin, halvings, spacing_m, ..Layer::new(view, bounds, settings) }
    }

    /// Returns the depth up to which points are so far apart that a coarser picture closes their
    /// gaps `[m]`.
    pub fn sparse_m(&self) -> f32 {
        let apart_px = self.spacing_m / self.texel / cameras::SPARSE;
        match self.perspective {
            true => apart_px as f32,
            false if apart_px > 1.0 => f32::INFINITY,
            false => 0.0,
        }
    }

    /// Returns the layer for a half-size picture.
    fn halved(&self) -> Layer {
        Layer { texel: 2.0 * self.texel, margin: 0, halvings: self.halvings - 1, ..*self }
    }

    /// Returns the layer of guide: numerics, case 13: sqrt(2) texels and a quantum, or twice the
    /// texels if masks fill from neighbours.
    pub fn new(camera: &View, bounds: (DVec3, DVec3), settings: &Settings) -> Layer {
        let fill = settings.fill as u32;
        let farthest = camera.depths(bounds).map_or(0.0, |(_, farthest)| farthest);
        // A depth has at most eight rounding errors, and two depths are compared; position
        // quantisation is far smaller.
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
        // Gaps are closed by nearer depths, and two quanta cover rounding on the way.
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

/// Depths and limits of the light's picture: f32 row by row.
pub struct Reached {
    /// Depths with gaps closed: infinite without points, undefined beyond the reach of closing.
    /// None if gaps are not closed: the depths are those of the keys.
    pub filled: Option<Buffer>,
    /// Depth that light reaches.
    pub limit: Buffer,
    /// The half-size picture that was merged, with its depths.
    pub coarser: Option<(Buffer, Box<Reached>)>,
    /// Tiles where both are defined.
    area: TileList,
}

/// Computes the limits from the keys of the light's picture, at points and beside them.
pub fn reach(g: &mut Graph, camera: &View, keys: &Buffer, layer: &Layer) -> Reached {
    reach_of(g, camera.size, (keys, true), layer, f32::INFINITY)
}

/// Computes the limits from keys or depths, for points nearer than `within` `[m]`; infinite
/// elsewhere.
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
    // All kernels have the same push constants.
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
