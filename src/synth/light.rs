//! Illumination baked into simulated points: sun, sky and ground.
//!
//! Lambert's law under one sun and a sky of constant colour. The part of the sky seen from a street
//! canyon has a closed form, which is smooth where a few sampling rays would band or sparkle.

use glam::{DVec2, DVec3};

/// Linear RGB irradiance over pi, of a surface that faces it.
#[derive(Clone, Debug)]
pub struct Light {
    /// Direction towards the sun, unit.
    pub sun_direction: DVec3,
    pub sun: DVec3,
    pub sky: DVec3,
    /// Light reflected by the ground.
    pub bounce: DVec3,
    /// True if shadow rays are cast.
    pub shadows: bool,
    /// Two rows of houses along y: half the distance between them, and their height.
    pub canyon: Option<(f64, f64)>,
    /// Objects that hide the sky from the ground below.
    pub covers: Vec<Cover>,
}

/// A low object above the ground, such as a car: a rectangle seen from above.
#[derive(Clone, Copy, Debug)]
pub struct Cover {
    pub centre: DVec2,
    /// Direction of its length, unit.
    pub along: DVec2,
    pub half: DVec2,
}

impl Cover {
    /// Returns 1 in the open, less below and beside it.
    fn open(&self, at: DVec2) -> f64 {
        let p = at - self.centre;
        let out = DVec2::new(p.dot(self.along).abs(), p.perp_dot(self.along).abs()) - self.half;
        let away = out.max(DVec2::ZERO).length() + out.max_element().min(0.0);
        let near = (1.0 - (away + 0.45) / 0.95).clamp(0.0, 1.0);
        1.0 - 0.85 * near * near * (3.0 - 2.0 * near)
    }
}

impl Light {
    pub fn studio() -> Light {
        Light {
            sun_direction: DVec3::new(-0.45, -0.55, 0.70).normalize(),
            sun: DVec3::new(0.72, 0.68, 0.62),
            sky: DVec3::new(0.24, 0.27, 0.31),
            bounce: DVec3::new(0.10, 0.09, 0.08),
            shadows: false,
            canyon: None,
            covers: Vec::new(),
        }
    }

    /// Returns the light of sky and ground, without the sun.
    pub fn ambient(&self, point: DVec3, normal: DVec3) -> DVec3 {
        let up = 0.5 + 0.5 * normal.z;
        let mut open =
            self.canyon.map_or(1.0, |(half, height)| canyon_sky(half, height, point, normal));
        if point.z < 0.2 {
            open *= self.covers.iter().map(|cover| cover.open(point.truncate())).product::<f64>();
        }
        self.sky * (up * open) + self.bounce * ((1.0 - up) * (0.4 + 0.6 * open))
    }
}

/// Returns the visible share of the sky inside the canyon, in [0, 1]: by the angles under which the
/// two eaves are seen, weighted by which of them the surface faces.
fn canyon_sky(half: f64, height: f64, point: DVec3, normal: DVec3) -> f64 {
    let above = (height - point.z).max(0.0);
    let free = |away: f64| {
        let away = away.max(0.05);
        1.0 - above / above.hypot(away)
    };
    let (east, west) = (free(half - point.x), free(half + point.x));
    let towards_east = (0.5 + 0.5 * normal.x).clamp(0.0, 1.0);
    let seen = east * towards_east + west * (1.0 - towards_east);
    // Behind the fronts (arcades) it gets darker; on the roofs it does not.
    let inside = (point.x.abs() - half - 0.05).max(0.0) * (above / height).min(1.0);
    // Opposite facades are lit themselves, so that no place is quite dark.
    (0.30 + 0.70 * seen).min(1.0) / (1.0 + 0.9 * inside.min(3.0))
}
