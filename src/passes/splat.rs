//! Splats: draws every point as a disc or paraboloid with a size, the nearest in front.
//!
//! Discs are drawn of the projected points, which are at most one a pixel, by the same atomics as
//! points: the cost follows the covered pixels, not the cloud. A list of the points gives every
//! lane a disc, also where points are sparse. Of points that were set aside
//! ([`super::scattered`]) they are drawn before and behind the surface of the others, else of all.

use super::project::{KEY_BYTES, strips};
use super::{
    Effect, EffectDecisions, Effects, FrameContext, GBuffer, Reason, Setting, TILE_PX, Value,
};
use crate::cloud::length::{self, Length};
use crate::graph::{Dispatch, Graph, Image, Kind};
use crate::shader::{self, splat_points, splat_resolve, splat32, splat64};
use crate::view::{Projection, View};
use strum::{EnumString, IntoStaticStr, VariantArray};

pub const SUMMARY: &str = "round points with a size (--style splats, --point-size)";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    pub shape: Shape,
    /// Diameter `[px]`; 0: by `metres`.
    pub pixels: f64,
    /// Diameter `[m]`; 0: by the spacing of the points.
    pub metres: f64,
    /// Radius of a point whose size follows the spacing `[spacings]`.
    pub cover: f64,
    /// Largest diameter `[px]`.
    pub largest: f64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Shape {
    /// Bent away from the viewer, so that neighbours meet halfway.
    #[default]
    Paraboloid,
    /// Flat.
    Disc,
}

/// Diameter of points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PointSize {
    /// By the spacing of the points.
    Auto,
    Pixels(f64),
    Metres(f64),
}

impl std::str::FromStr for PointSize {
    type Err = String;

    fn from_str(text: &str) -> Result<PointSize, String> {
        if text == "auto" {
            return Ok(PointSize::Auto);
        }
        let size = match text.strip_suffix("px").unwrap_or(text).parse() {
            Ok(Length::OfCoordinates(pixels)) => PointSize::Pixels(pixels),
            Ok(Length::Metres(metres)) if !text.ends_with("px") => PointSize::Metres(metres),
            _ => PointSize::Pixels(0.0),
        };
        match size {
            PointSize::Pixels(pixels) if pixels > 0.0 && pixels < 1.0 => {
                Err(format!("{pixels} pixels are less than one; {pixels}m is a length"))
            }
            PointSize::Pixels(pixels) if pixels > WIDEST => {
                Err(format!("{pixels} pixels are more than {WIDEST}; {pixels}m is a length"))
            }
            PointSize::Pixels(number) | PointSize::Metres(number) if number > 0.0 => Ok(size),
            _ => Err(format!(
                "{text:?} is not a size; give pixels such as 3, a length such as 0.05m, or auto; units are {}",
                length::units()
            )),
        }
    }
}

impl Settings {
    /// Returns how wide points are in pixels of a size `[m]`, where that is wider than they are
    /// drawn.
    pub fn narrowed(&self, pixel_m: f64) -> Option<f64> {
        let asked = if self.pixels == 0.0 { self.metres / pixel_m } else { self.pixels };
        (asked.is_finite() && asked > self.largest).then_some(asked)
    }

    pub fn set_size(&mut self, size: PointSize) {
        (self.pixels, self.metres) = match size {
            PointSize::Auto => (0.0, 0.0),
            PointSize::Pixels(pixels) => (pixels, 0.0),
            PointSize::Metres(metres) => (0.0, metres),
        };
        // A given size holds nearby, too. Another limit that was asked for stays.
        self.largest = match size {
            PointSize::Auto if self.largest == LARGEST_IN_METRES => Settings::default().largest,
            PointSize::Auto => self.largest,
            PointSize::Pixels(pixels) => self.largest.max(pixels),
            PointSize::Metres(_) => self.largest.max(LARGEST_IN_METRES),
        };
    }
}

/// Largest diameter that can be asked for `[px]`.
pub const WIDEST: f64 = 1024.0;

/// Largest diameter of a size in metres by default `[px]`. Pieces of large pictures overlap by half
/// of it, for every layer.
const LARGEST_IN_METRES: f64 = 256.0;

/// Depth of a paraboloid's rim behind its point `[radii]`.
const BULGE: f64 = 1.0;

impl Default for Settings {
    fn default() -> Self {
        Settings { shape: Shape::Paraboloid, pixels: 0.0, metres: 0.0, cover: 0.7, largest: 64.0 }
    }
}

impl super::Settings for Settings {
    fn list_all(&mut self) -> Vec<Setting<'_>> {
        let number = Value::Number;
        vec![
            Setting::new(
                "shape",
                "paraboloid: neighbours meet halfway; disc: flat",
                Value::Choice(&mut self.shape),
            ),
            Setting::new(
                "pixels",
                "diameter [px]; 0: by metres",
                number(&mut self.pixels, 0.0..=WIDEST),
            ),
            Setting::new(
                "metres",
                "diameter [m]; 0: by the spacing of the points",
                Value::Length(&mut self.metres, 0.0..=1e6),
            ),
            Setting::new(
                "largest",
                "largest diameter [px]; the time to draw grows with its square",
                number(&mut self.largest, 1.0..=WIDEST),
            ),
            // For studies.
            Setting::variant("cover", number(&mut self.cover, 0.0..=16.0)),
        ]
    }

    fn grows_px(&self, spacing_px: f64) -> f64 {
        let by_size = match (self.pixels, self.metres) {
            (0.0, 0.0) if spacing_px == 0.0 => f64::INFINITY,
            (0.0, 0.0) => self.cover * spacing_px + 0.5,
            (0.0, _) => f64::INFINITY,
            (pixels, _) => 0.5 * pixels,
        };
        by_size.clamp(0.5, 0.5 * self.largest)
    }
}

/// See [`super::Effects::reach_px`].
pub fn reach_px(view: &View, settings: &Settings) -> Option<u32> {
    let everywhere = match (settings.pixels, view.camera.ortho_height) {
        _ if settings.pixels > 0.0 => settings.pixels,
        (_, Some(height)) if settings.metres > 0.0 => {
            settings.metres * f64::from(view.whole[1]) / height
        }
        _ => f64::INFINITY,
    };
    Some((0.5 * everywhere.min(settings.largest)).ceil() as u32)
}

pub fn called_for(_context: &FrameContext, _asked: &Effects, before: &EffectDecisions) -> Reason {
    match before.runs(Effect::Scattered) {
        true => Reason { runs: true, why: "points on no surface were set aside".to_string() },
        false => Reason { runs: false, why: "no points were set aside".to_string() },
    }
}

pub fn record(
    g: &mut Graph,
    context: &FrameContext,
    settings: &Settings,
    gbuffer: GBuffer,
) -> GBuffer {
    let view = context.view;
    let perspective = view.camera.projection == Projection::Perspective;
    let by_size = settings.pixels > 0.0 || settings.metres > 0.0;
    // Points in a single place have no spacing.
    let by_spacing = !by_size && context.sampling.spacing_m > 0.0;
    let pixels = if by_size { settings.pixels } else { settings.largest };
    let largest = 0.5 * settings.largest as f32;
    let reach = largest as u32;
    let aside = gbuffer.aside.as_ref();
    let depth = aside.map_or(&gbuffer.depth, |aside| &aside.depth);
    let index = aside.map_or(&gbuffer.index, |aside| &aside.index);
    let clumps = &gbuffer.clumps;
    // Colours of points and of the surface; and their light, if lighting follows.
    let factor = aside.map_or(gbuffer.shadow_factor.as_ref(), |aside| aside.shadow_factor.as_ref());
    let shown: Vec<(&Image, &Image)> =
        [Some(aside.map_or(&gbuffer.color, |aside| &aside.color)), factor]
            .into_iter()
            .flatten()
            .zip(gbuffer.colors())
            .collect();
    let mut splats: Vec<[Image; 3]> = Vec::new();
    for _ in &shown {
        splats.push([
            g.image("splat depth", view.size, Kind::R32f),
            g.image("splat index", view.size, Kind::R32ui),
            g.image("splat color", view.size, Kind::Rgba32f),
        ]);
    }
    for strip in strips(view.size, KEY_BYTES, g.binding_limit()) {
        let [width, rows] = strip.size;
        let mut keys = g.buffer("splat keys", KEY_BYTES * strip.pixels());
        g.fill(&mut keys, u32::MAX);
        let first = strip.top.saturating_sub(reach);
        let last = (strip.top + rows + reach).min(view.size[1]);
        let mut counts = g.buffer("splat counts", 16);
        g.fill(&mut counts, 0);
        let mut points = g.buffer("splat points", 4 * (width * (last - first)) as u64);
        g.run(
            shader::SplatPoints {
                depth,
                counts: &mut counts,
                points: &mut points,
                push: splat_points::Push { size: view.size, first, last },
            },
            Dispatch::Groups([width.div_ceil(64), (last - first).div_ceil(TILE_PX), 1]),
        );
        let (counts, points) = (&counts, &points);
        // Both kernels have the same bindings and constants.
        macro_rules! run {
            ($($kernel:ident)::+, $module:ident $(, $step:ident)?) => {{
                let push = $module::Push {
                    size: view.size,
                    top: strip.top,
                    rows,
                    px_per_m: view.focal_px() as f32,
                    cover: if by_spacing { settings.cover as f32 } else { 0.0 },
                    metres: if settings.pixels == 0.0 { 0.5 * settings.metres as f32 } else { 0.0 },
                    pixels: 0.5 * pixels as f32,
                    largest,
                    bulge: if settings.shape == Shape::Disc { 0.0 } else { BULGE as f32 },
                };
                let spec = $module::Spec { perspective $(, $step)? };
                let keys = &mut keys;
                g.run($($kernel)::+ { depth, index, clumps, counts, points, keys, push, spec }, Dispatch::Indirect(counts, 0));
            }};
        }
        if g.gpu.device.int64_atomics {
            run!(shader::Splat64, splat64);
        } else {
            for step in [0, 1] {
                run!(shader::Splat32, splat32, step);
            }
        }
        for ((color, surface_color), [splat_depth, splat_index, splat_color]) in
            shown.iter().zip(&mut splats)
        {
            g.run(
                shader::SplatResolve {
                    keys: &keys,
                    index,
                    color,
                    surface_depth: &gbuffer.depth,
                    surface_index: &gbuffer.index,
                    surface_color,
                    splat_depth,
                    splat_index,
                    splat_color,
                    push: splat_resolve::Push { size: strip.size, top: strip.top },
                    spec: splat_resolve::Spec { over: aside.is_some() },
                },
                Dispatch::Groups([width.div_ceil(64), rows, 1]),
            );
        }
    }
    let mut splats = splats.into_iter();
    let [depth, index, color] = splats.next().expect("colours");
    GBuffer {
        depth,
        index,
        color,
        shadow_factor: splats.next().map(|[_, _, factor]| factor),
        flat_px: if settings.shape == Shape::Disc { reach.max(1) } else { gbuffer.flat_px },
        holes: None,
        aside: None,
        ..gbuffer
    }
}
