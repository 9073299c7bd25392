//! Phong lighting: shades the colour by `--light` (Phong 1975; Dobrev, Rosenthal and Linsen 2010,
//! sec. 3.1).
//!
//! ```text
//!     point_normals   index, normals of points -> normals of pixels    if points have any
//!     phong           depth, color, normals of pixels -> color
//! ```
//! A pixel uses the normal of its point. A filled pixel uses the mean of its neighbours on the same
//! surface. Without point normals, they are fitted to the depths on the screen
//! (glsl/lib/fit_normal.glsl). All are turned towards the camera. Shape depiction and shadows
//! multiply the light; this pass computes the colour that they multiply.

use super::{
    Asked, Effect, EffectDecisions, Effects, FrameContext, GBuffer, Reason, Setting, Switch, Value,
    fill,
};
use crate::graph::{Dispatch, Graph, Image, Kind};
use crate::shader::{self, phong::Push, phong::Spec, point_normals};
use crate::view::light::Light;
use crate::view::{Projection, View};
use glam::DVec3;
use strum::{EnumString, IntoStaticStr, VariantArray};

pub const SUMMARY: &str = "Phong lighting by --light: ambient, diffuse and specular";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    /// Share of the colour without light; with `diffuse` it should add up to 1.
    pub ambient: f64,
    /// Share of the colour added where a surface faces the light.
    pub diffuse: f64,
    /// White added by a perfect reflection.
    pub specular: f64,
    /// Exponent of highlights, a whole number: larger is narrower.
    pub shininess: f64,
    pub normals: Normals,
    pub backfaces: Backfaces,
    /// Radius of the neighbourhood that a normal is fitted to `[px]`.
    pub radius: f64,
}

/// Source of normals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Normals {
    /// The points, if they have any.
    #[default]
    Auto,
    /// The points, which must have normals from a file or an index.
    File,
    /// The depths on the screen.
    Depth,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            ambient: 0.2,
            diffuse: 0.8,
            specular: 0.08,
            shininess: 24.0,
            normals: Normals::Auto,
            backfaces: Backfaces::Keep,
            radius: 3.0,
        }
    }
}

impl super::Settings for Settings {
    fn list_all(&mut self) -> Vec<Setting<'_>> {
        let number = Value::Number;
        vec![
            Setting::new(
                "ambient",
                "fraction of the colour without light",
                number(&mut self.ambient, 0.0..=100.0),
            ),
            Setting::new(
                "diffuse",
                "fraction of the colour added where the surface faces the light",
                number(&mut self.diffuse, 0.0..=100.0),
            ),
            Setting::new(
                "specular",
                "brightness of highlights",
                number(&mut self.specular, 0.0..=100.0),
            ),
            Setting::new(
                "shininess",
                "exponent of highlights: larger is narrower",
                Value::Whole(&mut self.shininess, 1.0..=255.0),
            ),
            Setting::new(
                "normals",
                "source of normals: the points (file), the depths on the screen (depth), or the points if they have any (auto)",
                Value::Choice(&mut self.normals),
            ),
            Setting::new(
                "backfaces",
                "points that face away from the camera; drop needs oriented normals from files",
                Value::Choice(&mut self.backfaces),
            ),
            // For studies.
            Setting::variant("radius", Value::Whole(&mut self.radius, 1.0..=15.0)),
        ]
    }

    /// Pixels without a point do not change.
    fn grows_px(&self, _spacing_px: f64) -> f64 {
        0.0
    }
}

/// See [`super::Effects::reach_px`].
pub fn reach_px(_view: &View, settings: &Settings) -> Option<u32> {
    Some(settings.radius as u32 + 1)
}

pub fn called_for(context: &FrameContext, _asked: &Effects, before: &EffectDecisions) -> Reason {
    let (runs, why) = match context.light {
        _ if context.points == 0 => (false, "there are no points"),
        Light::Direction(_) | Light::Position(_) => (true, "a light was asked for with --light"),
        Light::Headlight if before.runs(Effect::Shape) => {
            (false, "shape depiction shades already, and no light was asked for with --light")
        }
        Light::Headlight => (false, "no light was asked for with --light"),
    };
    Reason { runs, why: why.to_string() }
}

impl Asked<Settings> {
    /// Returns whether points should bring their normals.
    pub fn wants_normals(&self, light: Light) -> bool {
        let may_run =
            self.switch == Switch::On || self.switch == Switch::Auto && light != Light::Headlight;
        may_run && self.settings.normals != Normals::Depth
    }
}

/// Describes the source of normals.
pub fn source(context: &FrameContext, settings: &Settings) -> &'static str {
    match (settings.normals, context.normals) {
        (Normals::Depth, _) => "fitted to the depths on the screen, because of normals=depth",
        (_, true) => "those of the points; filled pixels use the mean of their neighbours",
        (_, false) => "fitted to the depths on the screen, since points have none",
    }
}

/// Treatment of points that face away from the camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Backfaces {
    /// Draws them as the other side of the surface.
    #[default]
    Keep,
    /// Removes them, if normals tell the outside (Dobrev et al. 2010, sec. 3.1).
    Drop,
}

/// Depth difference of different surfaces, as a share of the depth, whatever the camera.
const MOST_REACH: f64 = 0.5;

/// Returns the light in camera axes (right, down, away): a position and 1, or the direction to an
/// infinitely distant light and 0.
pub fn seen(view: &View, light: Light) -> [f32; 4] {
    let axes = |world: DVec3| {
        [view.basis.right, -view.basis.up, view.basis.forward].map(|axis| axis.dot(world) as f32)
    };
    let (place, w) = match light {
        Light::Direction(travels) => (axes(-travels.normalize()), 0.0),
        Light::Position(world) => (axes(world - view.camera.eye), 1.0),
        Light::Headlight => match view.camera.projection {
            Projection::Perspective => ([0.0; 3], 1.0),
            Projection::Orthographic => ([0.0, 0.0, -1.0], 0.0),
        },
    };
    [place[0], place[1], place[2], w]
}

/// Returns the depth difference from which pixels belong to different surfaces, as for filling:
/// metres, or a share of the depth with perspective.
pub fn reach(view: &View) -> f64 {
    let reach = fill::WIDEST / view.focal_px();
    if view.camera.projection == Projection::Perspective { reach.min(MOST_REACH) } else { reach }
}

/// Returns the normal of each pixel's point: right, down and away from the camera, turned towards
/// it, and 1; 0 for other pixels. None if points have no normals.
pub fn facing(g: &mut Graph, view: &View, gbuffer: &GBuffer) -> Option<Image> {
    let (facings, map) = gbuffer.normal_pages.as_ref()?;
    let mut facing = g.image("facing", view.size, Kind::Rgba32f);
    let axis = |axis: DVec3| map.pulled_by_normals(axis).as_vec3().to_array();
    let [right, up, forward] = view.normal_axes();
    let push = point_normals::Push {
        size: view.size,
        centre: view.centre().map(|at| at as f32),
        px_per_unit: view.focal_px() as f32,
        right: axis(right),
        down: axis(-up),
        forward: axis(forward),
    };
    let spec = point_normals::Spec {
        perspective: view.camera.projection == Projection::Perspective,
        mapped: !map.is_identity() || view.is_distorted(),
    };
    g.run(
        shader::PointNormals { index: &gbuffer.index, facings, facing: &mut facing, push, spec },
        Dispatch::PerPixel,
    );
    Some(facing)
}

pub fn record(
    g: &mut Graph,
    context: &FrameContext,
    settings: &Settings,
    gbuffer: GBuffer,
) -> GBuffer {
    let view = context.view;
    let facing = if settings.normals == Normals::Depth { None } else { facing(g, view, &gbuffer) };
    let mut shaded = g.image("shaded", view.size, Kind::Rgba32f);
    let push = Push {
        size: view.size,
        centre: view.centre().map(|at| at as f32),
        px_per_unit: view.focal_px() as f32,
        reach: reach(view) as f32,
        radius_px: settings.radius as i32,
        light: seen(view, context.light),
        eye: seen(view, Light::Headlight),
        ambient: settings.ambient as f32,
        diffuse: settings.diffuse as f32,
        specular: settings.specular as f32,
        shininess: settings.shininess as u32,
    };
    let GBuffer { depth, color, shadow_factor, .. } = &gbuffer;
    let spec = Spec {
        perspective: view.camera.projection == Projection::Perspective,
        of_points: facing.is_some(),
        shadowed: shadow_factor.is_some(),
    };
    // Unread bindings need an image, too.
    let [facing, shadow_factor] =
        [facing.as_ref(), shadow_factor.as_ref()].map(|image| image.unwrap_or(color));
    g.run(
        shader::Phong { depth, color, facing, shadow_factor, shaded: &mut shaded, push, spec },
        Dispatch::PerPixel,
    );
    GBuffer { color: shaded, shadow_factor: None, ..gbuffer }
}
