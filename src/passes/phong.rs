//! Phong lighting: depth and colour in, colour in the light of `--light` out (Phong 1975; Dobrev, Rosenthal and Linsen 2010, sec. 3.1).
//!
//! ```text
//!     facing   index, normals of points -> those of pixels        where points have brought any
//!     phong    depth, color, normals of pixels -> color
//! ```
//! A pixel whose point has a normal takes it; one that filling has made takes the mean of those around it on the same surface; and where there are none the normal is fitted to the depths on the screen
//! (glsl/lib/fit_normal.glsl). All are turned towards the camera. Shape depiction, and shadows, multiply what is left of the light; this colours what they multiply.

use super::{
    Asked, Decided, Effect, Effects, FrameContext, GBuffer, Reason, Setting, Switch, Value, fill,
};
use crate::graph::{Dispatch, Graph, Image, Kind};
use crate::shader::{self, phong::Push, phong::Spec, point_normals};
use crate::view::light::Light;
use crate::view::{Projection, View};
use glam::DVec3;

pub const SUMMARY: &str =
    "Phong lighting of the surface on the screen by --light: ambient, diffuse, specular";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    /// Part of the colour that shows without light; with `diffuse` it should be 1.
    pub ambient: f64,
    /// Part of the colour that shows where a surface faces the light.
    pub diffuse: f64,
    /// White that a mirror would add.
    pub specular: f64,
    /// How narrow highlights are: the exponent, whole.
    pub shininess: f64,
    pub normals: Normals,
    pub backfaces: Backfaces,
    /// Of the neighbourhood that a normal is fitted to, pixels.
    pub radius: f64,
}

/// Where normals come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Normals {
    /// From the points, where they have any.
    #[default]
    Auto,
    /// From the points, which must have some: of a file, or of an index.
    File,
    /// From the depths on the screen.
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

    /// What holds no point stays as it is.
    fn grows_px(&self, _spacing_px: f64) -> f64 {
        0.0
    }
}

/// As [`super::Effects::reach_px`].
pub fn reach_px(_view: &View, settings: &Settings) -> Option<u32> {
    Some(settings.radius as u32 + 1)
}

pub fn called_for(context: &FrameContext, _asked: &Effects, before: &Decided) -> Reason {
    let (runs, why) = match context.light {
        _ if context.points == 0 => (false, "there is nothing to shade"),
        Light::Direction(_) | Light::Position(_) => (true, "a light was asked for with --light"),
        Light::Headlight if before.runs(Effect::Shape) => {
            (false, "shape depiction shades already, and no light was asked for with --light")
        }
        Light::Headlight => (false, "no light was asked for with --light"),
    };
    Reason { runs, why: why.to_string() }
}

impl Asked<Settings> {
    /// Whether points should bring their normals, if they have any.
    pub fn wants_normals(&self, light: Light) -> bool {
        let may_run =
            self.switch == Switch::On || self.switch == Switch::Auto && light != Light::Headlight;
        may_run && self.settings.normals != Normals::Depth
    }
}

/// Where normals come from, in words.
pub fn source(context: &FrameContext, settings: &Settings) -> &'static str {
    match (settings.normals, context.normals) {
        (Normals::Depth, _) => {
            "fitted to the depths on the screen, as asked for with normals=depth"
        }
        (_, true) => {
            "those of the points; of pixels that filling has made, the mean of those around"
        }
        (_, false) => "fitted to the depths on the screen, since points have brought none",
    }
}

/// What becomes of points that face away from the camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Backfaces {
    /// They are the surface's other side.
    #[default]
    Keep,
    /// They are not drawn, where normals say which side is outside (Dobrev et al. 2010, sec. 3.1).
    Drop,
}

/// What differs by more parts of its depth is another surface, whatever the camera.
const MOST_REACH: f64 = 0.5;

/// As seen by the camera, right, down and away: a place and 1, or the way towards something infinitely far and 0.
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

/// Difference in depth from which pixels are of other surfaces, as for filling: metres, or with perspective parts of the depth.
pub fn reach(view: &View) -> f64 {
    let reach = fill::WIDEST / view.focal_px();
    if view.camera.projection == Projection::Perspective { reach.min(MOST_REACH) } else { reach }
}

/// Of every pixel whose point has a normal, that: right, down and away from the camera, which it is turned towards, and 1; 0 of others. None where points have brought none.
pub fn facing(g: &mut Graph, view: &View, gbuffer: &GBuffer) -> Option<Image> {
    let facings = gbuffer.normal_pages.as_ref()?;
    let mut facing = g.image("facing", view.size, Kind::Rgba32f);
    let axis = |axis: DVec3| axis.as_vec3().to_array();
    let basis = &view.basis;
    let push = point_normals::Push {
        size: view.size,
        centre: view.centre().map(|at| at as f32),
        px_per_unit: view.focal_px() as f32,
        right: axis(basis.right),
        down: axis(-basis.up),
        forward: axis(basis.forward),
    };
    let spec =
        point_normals::Spec { perspective: view.camera.projection == Projection::Perspective };
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
    let mut lit = g.image("lit", view.size, Kind::Rgba32f);
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
    let GBuffer { depth, color, shadow_factor: reached, .. } = &gbuffer;
    let spec = Spec {
        perspective: view.camera.projection == Projection::Perspective,
        of_points: facing.is_some(),
        shadowed: reached.is_some(),
    };
    // What is not looked at wants a binding all the same.
    let [facing, reached] = [facing.as_ref(), reached.as_ref()].map(|image| image.unwrap_or(color));
    g.run(
        shader::Phong { depth, color, facing, reached, lit: &mut lit, push, spec },
        Dispatch::PerPixel,
    );
    GBuffer { color: lit, shadow_factor: None, ..gbuffer }
}
