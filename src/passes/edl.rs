//! Eye-dome lighting: darkens the colour where neighbours lie in front (Boucheny 2009, ch. 5).

use super::{Effect, EffectDecisions, Effects, FrameContext, GBuffer, Reason, Setting, Value};
use crate::graph::{Dispatch, Graph, Kind};
use crate::shader::{self, edl::Push, edl::Spec};
use crate::view::{Projection, View};

pub const SUMMARY: &str = "eye-dome lighting: darkens pixels behind their neighbours, so that shape shows without normals";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    /// Halvings of the light per unit of mean slope towards the viewer.
    pub strength: f64,
    /// Distance of the neighbours `[px]`.
    pub radius: f64,
    /// Steepest slope that counts: a jump in depth darkens no more than this.
    pub cap: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Settings { strength: 0.35, radius: 1.0, cap: 8.0 }
    }
}

impl super::Settings for Settings {
    fn list_all(&mut self) -> Vec<Setting<'_>> {
        let number = Value::Number;
        vec![
            Setting::new(
                "strength",
                "halvings of the light per unit of mean slope",
                number(&mut self.strength, 0.0..=100.0),
            ),
            Setting::new(
                "radius",
                "distance of the neighbours [px]",
                Value::Whole(&mut self.radius, 1.0..=64.0),
            ),
            // For studies.
            Setting::variant("cap", number(&mut self.cap, 0.0..=1e6)),
        ]
    }

    /// Pixels without a point do not change.
    fn grows_px(&self, _spacing_px: f64) -> f64 {
        0.0
    }
}

/// See [`super::Effects::reach_px`].
pub fn reach_px(_view: &View, settings: &Settings) -> Option<u32> {
    Some(settings.radius.round() as u32)
}

pub fn called_for(context: &FrameContext, _asked: &Effects, before: &EffectDecisions) -> Reason {
    match context.points {
        0 => Reason { runs: false, why: "there are no points".to_string() },
        _ if before.runs(Effect::Phong) => {
            Reason { runs: false, why: "Phong lighting shades already".to_string() }
        }
        _ if before.runs(Effect::Shape) => {
            Reason { runs: false, why: "shape depiction shades already".to_string() }
        }
        _ => Reason {
            runs: true,
            why: "depths show the shape of surfaces without normals".to_string(),
        },
    }
}

pub fn record(
    g: &mut Graph,
    context: &FrameContext,
    settings: &Settings,
    gbuffer: GBuffer,
) -> GBuffer {
    let view = context.view;
    let mut shaded = g.image("shaded", view.size, Kind::Rgba32f);
    let push = Push {
        size: view.size,
        strength: settings.strength as f32,
        slope_cap: settings.cap as f32,
        px_per_unit: view.focal_px() as f32,
        radius_px: settings.radius.round() as i32,
    };
    let spec = Spec { perspective: view.camera.projection == Projection::Perspective };
    g.run(
        shader::Edl {
            depth: &gbuffer.depth,
            color: &gbuffer.color,
            shaded: &mut shaded,
            push,
            spec,
        },
        Dispatch::PerPixel,
    );
    GBuffer { color: shaded, ..gbuffer }
}
