//! Scattered points: sets aside points that lie on no surface, such as leaves and wires.
//!
//! Clumps of points know how they lie ([`crate::index::format::scatter`]). Visibility and filling
//! then see surfaces alone, and close them also behind leaves. [`splat`](super::splat) draws what
//! was set aside, where it is nearer than the closed surface: keys are minima, so there is no seam.

use super::{
    Effect, EffectDecisions, Effects, FrameContext, GBuffer, Reason, Setting, Switch, significant,
};
use crate::graph::{Dispatch, Graph, Image, Kind};
use crate::index::format::scatter::SCATTERED;
use crate::shader::{self, scattered};
use crate::view::View;

pub const SUMMARY: &str =
    "sets aside points that lie on no surface, such as leaves; splat draws them as round points";

#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Settings {}

impl super::Settings for Settings {
    fn list_all(&mut self) -> Vec<Setting<'_>> {
        Vec::new()
    }

    fn grows_px(&self, _spacing_px: f64) -> f64 {
        0.0
    }
}

/// Points that were set aside.
pub struct Aside {
    /// Planar depth of the scattered points `[m]`; infinite for other pixels.
    pub depth: Image,
    /// Ids and colours of all points, and their light as [`GBuffer::shadow_factor`].
    pub index: Image,
    pub color: Image,
    pub shadow_factor: Option<Image>,
}

pub fn called_for(context: &FrameContext, asked: &Effects, before: &EffectDecisions) -> Reason {
    let share = context.sampling.scattered;
    let (runs, why) = match share {
        _ if asked.splat.switch == Switch::Off => (false, "splats are switched off".to_string()),
        _ if before.runs(Effect::Strokes) => (false, "strokes show all points".to_string()),
        _ if share > 0.0 => {
            (true, format!("{} % of the points in view lie on no surface", percent(share)))
        }
        _ => (false, "the points in view lie on surfaces".to_string()),
    };
    Reason { runs, why }
}

/// Writes a share in percent, not 0 of some and not 100 of not all.
fn percent(share: f64) -> f64 {
    let most = if share < 1.0 { 99.9 } else { 100.0 };
    significant((100.0 * share).clamp(0.01, most))
}

pub fn reach_px(_view: &View, _settings: &Settings) -> Option<u32> {
    Some(0)
}

pub fn record(
    g: &mut Graph,
    context: &FrameContext,
    _settings: &Settings,
    gbuffer: GBuffer,
) -> GBuffer {
    let size = context.view.size;
    let scatter = if context.sampling.scattered < 1.0 { SCATTERED } else { 0.0 };
    let mut surface_depth = g.image("surface depth", size, Kind::R32f);
    let mut surface_index = g.image("surface index", size, Kind::R32ui);
    let mut surface_color = g.image("surface color", size, Kind::Rgba32f);
    let mut scattered_depth = g.image("scattered depth", size, Kind::R32f);
    let GBuffer { depth, index, color, clumps, .. } = &gbuffer;
    g.run(
        shader::Scattered {
            depth,
            index,
            color,
            clumps,
            surface_depth: &mut surface_depth,
            surface_index: &mut surface_index,
            surface_color: &mut surface_color,
            scattered_depth: &mut scattered_depth,
            push: scattered::Push { size, scatter: scatter as f32 },
        },
        Dispatch::PerPixel,
    );
    // Filling changes the factor in place.
    let shadow_factor =
        gbuffer.shadow_factor.as_ref().map(|factor| g.copy("scattered factor", factor));
    let GBuffer { index, color, .. } = gbuffer;
    GBuffer {
        depth: surface_depth,
        index: surface_index,
        color: surface_color,
        aside: Some(Aside { depth: scattered_depth, index, color, shadow_factor }),
        ..gbuffer
    }
}
