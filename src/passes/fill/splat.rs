//! Fixed-size splats: draws each point as a disc, the nearest in front. This is the baseline that
//! filling is compared with.
//!
//! It does not need visibility, since a disc hides what lies behind it. If visibility ran, discs
//! are drawn of what it left. One size is wrong nearly everywhere: too small where points are
//! sparse, and silhouettes grow by the radius.

use super::Settings;
use crate::graph::{Dispatch, Graph, Kind};
use crate::passes::{GBuffer, shadows};
use crate::shader::{self, fill_splat};
use crate::view::View;

/// Default radius `[px]`: fixed, so independent of the points.
pub const RADIUS_PX: f64 = 2.0;

/// Returns the radius `[px]`.
pub fn radius(settings: &Settings) -> f64 {
    if settings.radius == 0.0 { RADIUS_PX } else { settings.radius }
}

pub fn record(g: &mut Graph, view: &View, settings: &Settings, gbuffer: GBuffer) -> GBuffer {
    let radius = radius(settings) as f32;
    let mut splat_depth = g.image("splat depth", view.size, Kind::R32f);
    let mut splat_index = g.image("splat index", view.size, Kind::R32ui);
    let mut splat_color = g.image("splat color", view.size, Kind::Rgba32f);
    let GBuffer { depth, index, color, .. } = &gbuffer;
    let push = fill_splat::Push { size: view.size, radius };
    let (of_depth, of_index, of_color) = (&mut splat_depth, &mut splat_index, &mut splat_color);
    g.run(
        shader::FillSplat {
            depth,
            index,
            color,
            splat_depth: of_depth,
            splat_index: of_index,
            splat_color: of_color,
            push,
        },
        Dispatch::PerPixel,
    );
    let splats = GBuffer {
        depth: splat_depth,
        index: splat_index,
        color: splat_color,
        flat_px: radius.ceil() as u32,
        holes: None,
        ..gbuffer
    };
    shadows::shadow_factor(g, view.size, splats)
}
