//! Ambient occlusion: the share of ambient light that reaches each pixel, from depth (Bavoil, Sainz
//! and Dimitrov 2008; Kanzok, Linsen and Rosenthal 2012, Fig. 8).
//!
//! Horizons are measured above a pixel's tangent plane. Normals fitted to the depths, as for
//! `phong`, keep steep planes from darkening. The effect runs after filling and smoothing, and
//! multiplies the factor of shape depiction.

use super::{EffectDecisions, Effects, FrameContext, GBuffer, Reason, Setting, Value, phong};
use crate::graph::{Dispatch, Graph, Kind};
use crate::shader::{self, ao::Push, ao::Spec};
use crate::view::{Projection, View};

pub const SUMMARY: &str = "ambient occlusion: darkens corners and gaps";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    /// Distance beyond which nothing occludes `[m]`; 0: a twelfth of the picture's height at every
    /// depth.
    pub radius: f64,
    /// Share of light that a full horizon removes. 1 is physical for ambient light, but hardly
    /// visible on coloured surfaces.
    pub strength: f64,
    /// Number of directions around a pixel, evenly spaced.
    pub directions: f64,
    /// Samples per direction.
    pub steps: f64,
    /// Sine of the horizon up to which a surface counts as rough only.
    pub bias: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Settings { radius: 0.0, strength: 2.0, directions: 8.0, steps: 4.0, bias: 0.2 }
    }
}

impl super::Settings for Settings {
    fn list_all(&mut self) -> Vec<Setting<'_>> {
        let number = Value::Number;
        vec![
            Setting::new(
                "radius",
                "distance beyond which nothing occludes [m]; 0: a twelfth of the picture's height",
                Value::Length(&mut self.radius, 0.0..=1e6),
            ),
            Setting::new(
                "strength",
                "darkening by a fully occluded horizon; 1 is physical",
                number(&mut self.strength, 0.0..=16.0),
            ),
            // For studies.
            Setting::variant("directions", Value::Whole(&mut self.directions, 2.0..=64.0)),
            Setting::variant("steps", Value::Whole(&mut self.steps, 1.0..=64.0)),
            Setting::variant("bias", number(&mut self.bias, 0.0..=1.0)),
        ]
    }

    /// Pixels without a point do not change.
    fn grows_px(&self, _spacing_px: f64) -> f64 {
        0.0
    }
}

/// Radius of the window that a normal is fitted to `[px]`, as in `phong`.
pub const WINDOW_PX: i32 = 3;

/// Default radius, as a share of the picture's height.
const SHARE: f64 = 1.0 / 12.0;

/// See [`super::Effects::reach_px`]; None for a radius in metres with perspective, which may be any
/// number of pixels.
pub fn reach_px(view: &View, settings: &Settings) -> Option<u32> {
    let in_metres = settings.radius > 0.0 && view.camera.projection == Projection::Perspective;
    (!in_metres)
        .then(|| (radius(view, settings) * view.focal_px()).ceil() as u32 + WINDOW_PX as u32 + 1)
}

pub fn called_for(context: &FrameContext, _asked: &Effects, _before: &EffectDecisions) -> Reason {
    let why = match context.points {
        0 => "there are no points",
        _ => "it adds to other shading, and runs only with --effect ao=on",
    };
    Reason { runs: false, why: why.to_string() }
}

/// Returns the radius `[m]`, or as a share of the depth with perspective if it is automatic.
pub fn radius(view: &View, settings: &Settings) -> f64 {
    if settings.radius > 0.0 {
        settings.radius
    } else {
        SHARE * view.whole[1] as f64 / view.focal_px()
    }
}

/// Returns cosine and sine of the angle between directions.
pub fn turn(settings: &Settings) -> [f32; 2] {
    let angle = std::f64::consts::TAU / settings.directions.floor();
    [angle.cos() as f32, angle.sin() as f32]
}

pub fn record(
    g: &mut Graph,
    context: &FrameContext,
    settings: &Settings,
    gbuffer: GBuffer,
) -> GBuffer {
    let view = context.view;
    let mut occluded_shading = g.image("occluded shading", view.size, Kind::R32f);
    let push = Push {
        size: view.size,
        centre: view.centre().map(|at| at as f32),
        px_per_unit: view.focal_px() as f32,
        reach: phong::reach(view) as f32,
        radius_px: WINDOW_PX,
        radius: radius(view, settings) as f32,
        strength: settings.strength as f32,
        least: (settings.bias * settings.bias) as f32,
        directions: settings.directions as i32,
        steps: settings.steps as i32,
        turn: turn(settings),
    };
    let perspective = view.camera.projection == Projection::Perspective;
    let spec = Spec {
        perspective,
        has_shading: gbuffer.shading.is_some(),
        metres: perspective && settings.radius > 0.0,
    };
    // Unread bindings need an image, too.
    let shading = gbuffer.shading.as_ref().unwrap_or(&gbuffer.depth);
    g.run(
        shader::Ao {
            depth: &gbuffer.depth,
            shading,
            occluded_shading: &mut occluded_shading,
            push,
            spec,
        },
        Dispatch::PerPixel,
    );
    GBuffer { shading: Some(occluded_shading), ..gbuffer }
}
