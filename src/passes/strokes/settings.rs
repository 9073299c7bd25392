//! Settings of strokes.

use super::super::{Setting, Value};
use super::brush::Brush;
use strum::{EnumString, IntoStaticStr, VariantArray};

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    pub brush: Brush,
    pub blend: Blend,
    pub sort: Sort,
    pub order: Order,
    pub tangents: Tangents,
    /// Parameters of the brush; 0: those of the named [`Brush`].
    pub size: f64,
    pub amplitude: f64,
    pub gamma: f64,
    pub sigma_x: f64,
    pub sigma_y: f64,
    pub dev: f64,
    pub gaussians: f64,
    /// Largest rotation of a stroke from its tangent `[degrees]`.
    pub noise: f64,
    /// Lengthening of strokes on clusters twice as long as wide.
    pub long: f64,
    /// Opacity of the second, smaller stroke on small clusters.
    pub detail: f64,
    /// Largest half side on the screen, as a share of the picture's longer side.
    pub largest: f64,
    /// Passes of sort=bubble; 0: until everything is sorted.
    pub passes: f64,
    /// Memory of lists and fragments `[MiB]`.
    pub memory: f64,
    /// Radius of blend=blur `[px]`.
    pub radius: f64,
}

/// How overlapping strokes are blended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Blend {
    /// All strokes, each through what those before it leave uncovered.
    #[default]
    Abuffer,
    /// The nearest stroke, softened.
    Blur,
    /// The nearest stroke.
    Opaque,
}

/// How the fragments of a pixel are sorted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Sort {
    #[default]
    Exact,
    /// One fragment per pass, as a still picture is refined.
    Bubble,
}

/// The sort key of fragments.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Order {
    /// Their own depth: slanted strokes run through each other (the paper's second limitation).
    #[default]
    Pixel,
    /// The depth of the stroke's point: a stroke is above another everywhere.
    Stroke,
}

/// The direction of strokes. All but the last follow from the normal alone, in the axes of the
/// cloud (`index::attributes::axes`). In the axes of the file, the same surface turned there would
/// be painted along other lines (52 degrees away on average on a torus turned by a quarter). The
/// paper turns tangents with the cloud instead, which needs to know the rotation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Tangents {
    #[default]
    Householder,
    Eberly,
    Squareplate,
    /// The direction in which a point's neighbours spread most.
    Covariance,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            brush: Brush::default(),
            blend: Blend::default(),
            sort: Sort::default(),
            order: Order::default(),
            tangents: Tangents::default(),
            size: 0.0,
            amplitude: 0.0,
            gamma: 0.0,
            sigma_x: 0.0,
            sigma_y: 0.0,
            dev: 0.0,
            gaussians: 0.0,
            noise: 20.0,
            long: 0.5,
            detail: 1.0,
            largest: 0.5,
            passes: 0.0,
            memory: 512.0,
            radius: 2.0,
        }
    }
}

impl super::super::Settings for Settings {
    fn list_all(&mut self) -> Vec<Setting<'_>> {
        let number = Value::Number;
        vec![
            Setting::new("brush", "shape of a stroke", Value::Choice(&mut self.brush)),
            Setting::new(
                "blend",
                "abuffer: all strokes, by opacity; blur: the nearest, softened; opaque: the nearest",
                Value::Choice(&mut self.blend),
            ),
            Setting::new(
                "size",
                "half a side of a stroke, in radii of its point; 0: that of the brush",
                number(&mut self.size, 0.0..=64.0),
            ),
            Setting::new(
                "noise",
                "largest rotation of a stroke [degrees]",
                number(&mut self.noise, 0.0..=180.0),
            ),
            Setting::new(
                "long",
                "lengthening of strokes on elongated clusters",
                number(&mut self.long, 0.0..=1.0),
            ),
            Setting::new(
                "detail",
                "opacity of the second stroke on small clusters",
                number(&mut self.detail, 0.0..=1.0),
            ),
            Setting::new(
                "largest",
                "largest half side on the screen, as a fraction of the picture's longer side",
                number(&mut self.largest, 0.001..=4.0),
            ),
            // For studies.
            Setting::variant("sort", Value::Choice(&mut self.sort)),
            Setting::variant("order", Value::Choice(&mut self.order)),
            Setting::variant("tangents", Value::Choice(&mut self.tangents)),
            Setting::variant("amplitude", number(&mut self.amplitude, 0.0..=64.0)),
            Setting::variant("gamma", number(&mut self.gamma, 0.0..=16.0)),
            Setting::variant("sigma_x", number(&mut self.sigma_x, 0.0..=4.0)),
            Setting::variant("sigma_y", number(&mut self.sigma_y, 0.0..=4.0)),
            Setting::variant("dev", number(&mut self.dev, 0.0..=1.0)),
            Setting::variant(
                "gaussians",
                Value::OneOf(&mut self.gaussians, &[0.0, 6.0, 7.0, 8.0, 9.0]),
            ),
            Setting::variant("passes", Value::Whole(&mut self.passes, 0.0..=1e6)),
            Setting::variant("memory", number(&mut self.memory, 1.0..=65536.0)),
            Setting::variant("radius", Value::Whole(&mut self.radius, 1.0..=8.0)),
        ]
    }
}

impl Settings {
    /// Returns the largest half side on the screen `[px]`.
    pub fn largest_px(&self, size: [u32; 2]) -> f64 {
        self.largest * size[0].max(size[1]) as f64
    }

    /// Returns the number of fragments per pixel that are sorted before the rest is left out.
    pub fn last(&self) -> u32 {
        match (self.sort, self.passes as u32) {
            (Sort::Exact, _) | (Sort::Bubble, 0) => u32::MAX,
            (Sort::Bubble, passes) => passes,
        }
    }
}
