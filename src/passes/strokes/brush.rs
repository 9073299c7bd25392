//! Brushes: the parameters of the paper's equation 1, and the three of its figure 4 by name.

use super::Painting;
use super::settings::Settings;
use crate::error::Result;
use crate::graph::{Buffer, Dispatch, Graph};
use crate::shader::{self, stroke_brush};
use strum::{EnumString, IntoStaticStr, VariantArray};

/// Size as in glsl/strokes/stroke_brush.comp: 256 brushes of 32 x 32 words.
const WORDS: u32 = 256 * 32 * 32;

/// Distance from its point within which a stroke counts as lying on the surface [radii]: less
/// leaves holes, more stands out.
const GROUND_RADII: f64 = 0.85;

/// A named brush, whose parameters may be overridden one by one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Brush {
    /// Round and thick: one dab of paint (figure 4 b).
    #[default]
    Dabs,
    /// Three thin lines of hair, far apart (figure 4 c).
    Bristles,
    /// Wide and flat, frayed at one side (figure 4 d).
    Ribbons,
}

/// All parameters of a stroke. Lengths are shares of a stroke's side.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Bristles {
    /// Half a side [radii of the point].
    pub size: f64,
    pub amplitude: f64,
    pub gamma: f64,
    pub sigma_x: f64,
    pub sigma_y: f64,
    /// Distance between the grid's columns, and between its rows.
    pub dev: f64,
    /// Number of Gaussians, 6 to 9, of 3 x 3.
    pub gaussians: u32,
}

impl Brush {
    /// Returns the distance from its middle within which a stroke lies on the surface (`ground`),
    /// as a share of a side. Farther out, on crests and claws, it stands in the air, and what only
    /// such ends cover is not painted. Strokes larger than the brush's own take their ground with
    /// them.
    pub fn ground(self) -> f64 {
        GROUND_RADII / (2.0 * self.bristles().size)
    }

    /// Dabs fade towards their ends: they are large enough that one hides what is behind it until
    /// the next covers it.
    fn bristles(self) -> Bristles {
        match self {
            Brush::Dabs => Bristles {
                size: 2.0,
                amplitude: 8.0,
                gamma: 3.0,
                sigma_x: 0.114,
                sigma_y: 0.0989,
                dev: 0.03,
                gaussians: 9,
            },
            Brush::Bristles => Bristles {
                size: 1.6,
                amplitude: 1.0,
                gamma: 2.7,
                sigma_x: 0.142,
                sigma_y: 0.071,
                dev: 0.38,
                gaussians: 9,
            },
            Brush::Ribbons => Bristles {
                size: 1.6,
                amplitude: 2.27,
                gamma: 2.4,
                sigma_x: 0.099,
                sigma_y: 0.1259,
                dev: 0.3,
                gaussians: 6,
            },
        }
    }
}

impl Bristles {
    /// Returns the parameters: those of the settings, or those of the brush where 0.
    pub fn of(settings: &Settings) -> Bristles {
        let own = settings.brush.bristles();
        let or = |asked: f64, own: f64| if asked == 0.0 { own } else { asked };
        Bristles {
            size: or(settings.size, own.size),
            amplitude: or(settings.amplitude, own.amplitude),
            gamma: or(settings.gamma, own.gamma),
            sigma_x: or(settings.sigma_x, own.sigma_x),
            sigma_y: or(settings.sigma_y, own.sigma_y),
            dev: or(settings.dev, own.dev),
            gaussians: or(settings.gaussians, own.gaussians as f64) as u32,
        }
    }

    /// Returns the distance from its middle within which a brush, turned by `noise_degrees`, covers
    /// at least `least`: shares of a side, at most one half.
    pub fn reach(&self, least: f64, noise_degrees: f64) -> [f64; 2] {
        // An upper bound: all Gaussians at their middles together.
        let sigmas = (2.0 * (self.gaussians as f64 * self.amplitude / least).max(1.0).ln())
            .powf(1.0 / self.gamma);
        // The third column is turned twice more.
        let turn = (noise_degrees * 5.0 / 3.0).to_radians().min(std::f64::consts::FRAC_PI_2).sin();
        let [x, y] = [self.sigma_x, self.sigma_y].map(|sigma| sigma * sigmas);
        let [across, along] = [self.dev + x + turn * y, self.dev + y + turn * x];
        // A second layer lies across the first, two thirds as large.
        [across.max(along / 1.5).min(0.5), along.max(across / 1.5).min(0.5)]
    }

    /// Returns a bit for each used place of the grid, row by row: the middle row, the one above,
    /// the one below.
    pub fn places(&self) -> u32 {
        [3, 4, 5, 0, 1, 2, 7, 6, 8]
            .into_iter()
            .take(self.gaussians as usize)
            .map(|place| 1 << place)
            .sum()
    }
}

/// Returns cosines and sines of rotations: 16 of whole strokes and 4 from column to column, both
/// between bounds; 256 over half a circle.
pub fn turns(noise_degrees: f64) -> Vec<[f32; 2]> {
    let turn = |radians: f64| [radians.cos() as f32, radians.sin() as f32];
    let spread = |count: u32, bound: f64| {
        (0..count).map(move |k| turn(bound * ((2 * k + 1) as f64 / count as f64 - 1.0)))
    };
    let bound = noise_degrees.to_radians();
    let half = (0..256).map(|k| turn(k as f64 * std::f64::consts::PI / 256.0));
    spread(16, bound).chain(spread(4, bound / 3.0)).chain(half).collect()
}

impl Painting<'_> {
    /// Returns the words of all brushes, computed if the kept ones differ.
    pub(super) fn brushes(&self, g: &mut Graph, turns: &Buffer) -> Result<Buffer> {
        let bristles = Bristles::of(&self.settings);
        let cache_key = [
            bristles.amplitude,
            bristles.gamma,
            bristles.sigma_x,
            bristles.sigma_y,
            bristles.dev,
            self.settings.noise,
        ];
        let cache_key =
            cache_key.map(f64::to_bits).into_iter().chain([bristles.places() as u64]).collect();
        let (mut brushes, kept) = g.persistent("brushes", 4 * WORDS as u64, cache_key, |_| 1)?;
        if kept == 0 {
            let inverse = |sigma: f64| (1.0 / (sigma * sigma)) as f32;
            let push = stroke_brush::Push {
                amplitude: bristles.amplitude as f32,
                exponent: (bristles.gamma / 2.0) as f32,
                across: inverse(bristles.sigma_x),
                along: inverse(bristles.sigma_y),
                apart: bristles.dev as f32,
                gaussians: bristles.places(),
            };
            g.run(
                shader::StrokeBrush { turns, brushes: &mut brushes, push },
                Dispatch::Groups([WORDS / 64, 1, 1]),
            );
        }
        Ok(brushes)
    }
}
