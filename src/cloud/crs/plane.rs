//! A plane tangent to the ellipsoid in the middle of a cloud, to convert degrees to metres.
//!
//! Both axes are linear in the angles: a metre east is a constant longitude difference, a metre
//! north a constant latitude difference. Only the lattice changes, no point, and the conversion can
//! be undone. Ten kilometres from the middle an easting is off by up to two parts in a thousand at
//! middle latitudes.

use super::super::Lattice;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::fmt;

/// The tangent point `[degrees]`, and the length of a degree there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plane {
    pub longitude: f64,
    pub latitude: f64,
    pub metres_per_degree: [f64; 2],
}

/// The ellipsoid WGS 84: equatorial radius `[m]` and flattening.
const RADIUS: f64 = 6_378_137.0;
const FLATTENING: f64 = 1.0 / 298.257_223_563;

/// The tangent point is rounded to a millionth of a degree, for readability.
const PLACES: f64 = 1e6;

/// Tests whether these can be corners of longitudes and latitudes.
pub fn are_degrees(lo: DVec3, hi: DVec3) -> bool {
    let within = |v: DVec3| v.x.abs() <= 360.0 && v.y.abs() <= 90.0;
    within(lo) && within(hi)
}

impl Plane {
    /// Returns the plane around a point; `None` at the poles.
    pub fn about(middle: DVec3) -> Option<Plane> {
        let [longitude, latitude] = [middle.x, middle.y].map(|v| (v * PLACES).round() / PLACES);
        let (sine, cosine) = latitude.to_radians().sin_cos();
        let eccentricity = FLATTENING * (2.0 - FLATTENING);
        let along = 1.0 - eccentricity * sine * sine;
        let east = RADIUS / along.sqrt() * cosine;
        let north = RADIUS * (1.0 - eccentricity) / along.powf(1.5);
        let metres_per_degree = [east.to_radians(), north.to_radians()];
        (latitude.abs() < 89.999).then_some(Plane { longitude, latitude, metres_per_degree })
    }

    /// Converts a lattice of angles (`degrees` per unit) and heights (`metres` per unit).
    pub fn flatten(&self, lattice: Lattice, degrees: f64, metres: f64) -> Lattice {
        let [east, north] = self.metres_per_degree;
        let scale = DVec3::new(east * degrees, north * degrees, metres);
        let middle = DVec3::new(self.longitude / degrees, self.latitude / degrees, 0.0);
        Lattice { step: lattice.step * scale, offset: (lattice.offset - middle) * scale }
    }

    /// Converts longitude and latitude `[degrees]`.
    pub fn place(&self, lonlat: [f64; 2]) -> [f64; 2] {
        let [east, north] = self.metres_per_degree;
        [(lonlat[0] - self.longitude) * east, (lonlat[1] - self.latitude) * north]
    }

    pub fn lonlat(&self, place: DVec3) -> [f64; 2] {
        let [east, north] = self.metres_per_degree;
        [self.longitude + place.x / east, self.latitude + place.y / north]
    }

    /// Says what coordinates on the plane are.
    pub fn words(&self) -> String {
        let Plane { longitude, latitude, .. } = self;
        format!("in metres on a plane around longitude {longitude}, latitude {latitude}")
    }
}

impl fmt::Display for Plane {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "coordinates are degrees, drawn {}", self.words())
    }
}
