//! Cameras of a light, for one sample position on it.
//!
//! A directional light has one orthographic camera. A light with a position has one perspective
//! camera if the cloud lies within a right angle of it, else the sides of a cube that see
//! something, each a little wider than its side, so that gaps at borders are closed as well. Texels
//! are square. `size` is the longer side of a picture, or of a cube.

use super::Settings;
use crate::config::SUN;
use crate::error::Result;
use crate::resident::Resident;
use crate::view::light::Light;
use crate::view::{Camera, Projection, View};
use glam::DVec3;

/// Factor by which the sides of a cube overlap: a point on a border belongs to at least one.
const OVERLAP: f64 = 1.0 + 1.0 / (1 << 20) as f64;

/// The inputs of cameras.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    /// World bounds of the cloud.
    pub bounds: (DVec3, DVec3),
    /// Point spacing `[m]`.
    pub spacing_m: f64,
    /// Radius of the light's disc: half its angle if directional `[degrees]`, else in the
    /// coordinates of the cloud.
    pub radius: f64,
    /// Longer side of a picture `[texels]`; 0: a texel is two spacings wide. For a light with a
    /// position that holds where the cloud is nearest to it, or half as near as its middle.
    pub size: u32,
}

impl Wanted {
    /// Creates the inputs. If nodes come and go, bounds are snapped to a grid of an eighth of their
    /// width and the spacing to quarters of an octave, so that they rarely change and the
    /// visibility of other nodes can be kept.
    pub fn around(
        resident: &Resident,
        bounds: (DVec3, DVec3),
        spacing_m: f64,
        settings: &Settings,
        light: Light,
    ) -> Wanted {
        let unit = if let Light::Position(_) = light { resident.unit_m() } else { 1.0 };
        let (radius, size) = (settings.radius / unit, settings.size as u32);
        let ((min, max), side) = (bounds, (bounds.1 - bounds.0).max_element());
        if !resident.comes_and_goes || side == 0.0 {
            return Wanted { bounds, spacing_m, radius, size };
        }
        let cell = (side / 8.0).log2().ceil().exp2();
        let spacing_m =
            if spacing_m > 0.0 { ((4.0 * spacing_m.log2()).ceil() / 4.0).exp2() } else { 0.0 };
        Wanted {
            bounds: ((min / cell).floor() * cell, (max / cell).ceil() * cell),
            spacing_m,
            radius,
            size,
        }
    }
}

/// A camera of the light.
#[derive(Clone, Copy, Debug)]
pub struct LightCamera {
    pub view: View,
    /// Width of the border that belongs to another side of the cube `[texels]`.
    pub margin: u32,
    /// How often the picture is halved: until points of the nearest surface are at most [`SPARSE`]
    /// texels apart.
    pub halvings: u32,
    /// Point spacing `[m]`.
    pub spacing_m: f64,
}

/// Distance of points up to which gaps are closed `[texels]`; wider ones are closed in a coarser
/// picture.
pub const SPARSE: f64 = 0.75;

/// Smallest side of the coarsest picture `[texels]`, and the largest number of halvings: gaps of 24
/// texels, with margins of a seventh of a picture of 860.
const COARSEST: f64 = 4.0;
const MOST_HALVINGS: f64 = 5.0;

impl LightCamera {
    fn of(view: View, margin: u32, wanted: &Wanted) -> LightCamera {
        let (side, focal) = (view.size[0].max(view.size[1]) - 2 * margin, view.focal_px());
        let nearest = match view.camera.projection {
            Projection::Orthographic => 1.0,
            Projection::Perspective => least_depth(
                wanted,
                view.camera.eye,
                view.size.map(|side| side as f64 / 2.0 / focal),
            ),
        };
        LightCamera {
            view,
            margin,
            halvings: halvings(wanted.spacing_m * focal / nearest, side as f64),
            spacing_m: wanted.spacing_m,
        }
    }
}

/// Returns the smallest distance of the cloud's box from the eye along the view axis `[m]`, for a
/// picture with these half extents as shares of the depth.
fn least_depth(wanted: &Wanted, eye: DVec3, [u, v]: [f64; 2]) -> f64 {
    let (min, max) = wanted.bounds;
    eye.clamp(min, max).distance(eye) / (1.0 + u * u + v * v).sqrt()
}

/// Returns how often to halve a picture with sides of `side` texels and points `apart_px` texels
/// apart.
pub fn halvings(apart_px: f64, side: f64) -> u32 {
    let [wanted, most] = [apart_px / SPARSE, side / COARSEST].map(f64::log2);
    // Points without a spacing have no gaps.
    if apart_px > 0.0 {
        wanted.ceil().min(most.floor()).clamp(0.0, MOST_HALVINGS) as u32
    } else {
        0
    }
}

/// Margin of the coarsest picture `[texels]`: gaps at a border are closed like those in the middle.
const BEYOND: u32 = 1;

/// Half the angle of the largest directional light `[degrees]`.
pub const WIDEST_DEGREES: f64 = 45.0;
const LEAST: f64 = 16.0;
const MOST: f64 = 4096.0;
const SPACINGS_PER_TEXEL: f64 = 2.0;

/// Returns the cameras of a light for a position on the unit disc.
pub fn cameras(light: Light, wanted: &Wanted, place: [f64; 2]) -> Result<Vec<LightCamera>> {
    let (min, max) = wanted.bounds;
    let (centre, half) = ((min + max) / 2.0, (max - min) / 2.0);
    match light {
        Light::Headlight => far(SUN, wanted, place, centre, half),
        Light::Direction(direction) => far(direction, wanted, place, centre, half),
        Light::Position(position) => near(position, wanted, place, centre, half),
    }
}

fn texels(asked: u32, extent: f64, texel: f64) -> f64 {
    match asked {
        // Coincident points have no spacing.
        0 if texel > 0.0 => (extent / texel).ceil().clamp(LEAST, MOST),
        0 => LEAST,
        size => size as f64,
    }
}

/// Rounds a vector to a 2^20th of its length. Places of a cloud can be moved by it without
/// rounding, so that shadows are the same wherever cloud and light are (guide: numerics, M2).
fn rounded(v: DVec3) -> DVec3 {
    let longest = v.abs().max_element();
    // The power of two up to it, which has no mantissa.
    let unit = f64::from_bits(longest.to_bits() >> 52 << 52) / (1u64 << 20) as f64;
    if unit.is_normal() { (v / unit).round() * unit } else { v }
}

/// Returns a camera with this view direction.
fn looking(eye: DVec3, forward: DVec3) -> Camera {
    Camera {
        eye,
        target: eye + rounded(forward),
        up: DVec3::Z,
        fov_y: 90.0,
        projection: Projection::Perspective,
        ortho_height: None,
    }
}

fn far(
    direction: DVec3,
    wanted: &Wanted,
    [u, v]: [f64; 2],
    centre: DVec3,
    half: DVec3,
) -> Result<Vec<LightCamera>> {
    let middle = looking(centre, direction.normalize()).basis()?;
    let tangent = wanted.radius.min(WIDEST_DEGREES).to_radians().tan();
    let forward = (middle.forward + (middle.right * u + middle.up * v) * tangent).normalize();
    let reach = |axis: DVec3| half.dot(axis.abs());
    // A single point has a picture, too; and large coordinates need a margin for rounding.
    let rounding = 16.0 * f64::EPSILON * centre.length();
    let least = (1e-6 * half.length()).max(rounding) + f64::MIN_POSITIVE;
    // All samples of a light have pictures of one size: an axis turns by the light's half angle,
    // twice, and its end moves by as much.
    let turned = 1.5 * tangent * half.length();
    let extent = [middle.right, middle.up].map(|axis| 2.0 * (reach(axis) + turned).max(least));
    let longer = extent[0].max(extent[1]);
    let size = texels(wanted.size, longer, SPACINGS_PER_TEXEL * wanted.spacing_m);
    // One spare texel on either side.
    let texel = longer / (size - 2.0).max(1.0);
    let size = extent.map(|side| (side / texel - 1e-6).ceil().max(1.0) as u32 + 2);
    let camera = Camera {
        projection: Projection::Orthographic,
        ortho_height: Some(size[1] as f64 * texel),
        // The same roll for all samples.
        up: middle.up,
        ..looking(centre - rounded(forward * (1.01 * reach(forward) + 2.0 * least)), forward)
    };
    Ok(vec![LightCamera::of(View::new(camera, size)?, 0, wanted)])
}

fn near(
    position: DVec3,
    wanted: &Wanted,
    [u, v]: [f64; 2],
    centre: DVec3,
    half: DVec3,
) -> Result<Vec<LightCamera>> {
    let middle =
        looking(position, if centre == position { DVec3::NEG_Z } else { centre - position })
            .basis()?;
    let eye = position + rounded((middle.right * u + middle.up * v) * wanted.radius);
    // Measured from the middle of the light, so that all samples have pictures of one size.
    let corner = |k: u32| {
        centre
            + half
                * DVec3::from_array(
                    [0, 1, 2].map(|axis| if k >> axis & 1 == 1 { 1.0 } else { -1.0 }),
                )
    };
    let tangents = |axis: DVec3| {
        let tangent = |p: DVec3| {
            (p.dot(axis).abs() + wanted.radius) / p.dot(middle.forward).max(1e-9 * half.length())
        };
        (0..8).map(|k| tangent(corner(k) - position)).fold(0.0, f64::max)
    };
    let across = [middle.right, middle.up].map(|axis| tangents(axis).max(1e-6));
    // Near points are sparse in the light's picture.
    let nearest = (position.clamp(centre - half, centre + half) - position).length();
    let distance = nearest.max((centre - position).length().max(half.length()) / 2.0);
    let texel = SPACINGS_PER_TEXEL * wanted.spacing_m / distance;
    if across[0].max(across[1]) <= 1.0 {
        let longer = across[0].max(across[1]);
        let focal = (texels(wanted.size, 2.0 * longer, texel) - 2.0).max(1.0) / (2.0 * longer);
        let size = across.map(|tangent| (2.0 * tangent * focal - 1e-6).ceil().max(1.0) as u32 + 2);
        let fov_y = 2.0 * (size[1] as f64 / 2.0 / focal).atan().to_degrees();
        return Ok(vec![LightCamera::of(
            View::new(Camera { fov_y, ..looking(eye, middle.forward) }, size)?,
            0,
            wanted,
        )]);
    }
    let side = texels(wanted.size, 2.0, texel);
    // From the middle of the light, then from the nearest sample.
    let nearest = least_depth(wanted, position, [2.0; 2]) - wanted.radius;
    let margin = BEYOND << halvings(wanted.spacing_m * side / 2.0 / nearest.max(0.0), side);
    let fov_y = 2.0 * (OVERLAP * (side + 2.0 * margin as f64) / side).atan().to_degrees();
    let axes = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
    let sides = axes.map(|axis| {
        View::new(Camera { fov_y, ..looking(eye, axis) }, [side as u32 + 2 * margin; 2])
    });
    let sides = sides.into_iter().collect::<Result<Vec<_>>>()?.into_iter();
    Ok(sides
        .filter(|view| view.least_depth(wanted.bounds).is_some())
        .map(|view| LightCamera::of(view, margin, wanted))
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns whether a point is in the picture and not in its margin.
    fn sees(sight: &LightCamera, p: DVec3) -> bool {
        let view = &sight.view;
        let (d, f) = (p - view.camera.eye, view.focal_px());
        let z = d.dot(view.basis.forward);
        let scale = if view.camera.projection == Projection::Perspective { f / z } else { f };
        let at = [
            d.dot(view.basis.right) * scale / view.size[0] as f64,
            d.dot(view.basis.up) * scale / view.size[1] as f64,
        ];
        let half = [0, 1].map(|axis| 0.5 - sight.margin as f64 / view.size[axis] as f64);
        z > 0.0 && at[0].abs() < half[0] && at[1].abs() < half[1]
    }

    #[test]
    fn lights_see_the_whole_cloud_from_every_place_on_them() {
        let min = DVec3::new(500_000.0, 5_000_000.0, 90.0);
        let bounds = (min, min + DVec3::new(40.0, 7.0, 11.0));
        let lights = [
            Light::Headlight,
            Light::Direction(DVec3::NEG_Z),
            Light::Direction(DVec3::new(3.0, -1.0, 0.2)),
            Light::Position(min + DVec3::new(20.0, 3.0, 70.0)),
            Light::Position(min + DVec3::new(-200.0, 3.0, 5.0)),
            Light::Position(min + DVec3::new(20.0, 3.0, 5.0)),
            Light::Position(min + DVec3::new(20.0, -0.1, 5.0)),
            Light::Position((bounds.0 + bounds.1) / 2.0),
        ];
        for light in lights {
            for place in [[0.0, 0.0], [1.0, 0.0], [-0.6, 0.8], [0.0, -1.0]] {
                for size in [0, 100, 1000] {
                    let wanted = Wanted { bounds, spacing_m: 0.02, radius: 0.7, size };
                    let views = cameras(light, &wanted, place).unwrap();
                    for k in 0..1331 {
                        let at =
                            DVec3::new((k % 11) as f64, (k / 11 % 11) as f64, (k / 121) as f64)
                                / 10.0;
                        let p = bounds.0 + (bounds.1 - bounds.0) * at;
                        let apart = views
                            .iter()
                            .map(|sight| sight.view.camera.eye.distance(p))
                            .fold(f64::INFINITY, f64::min);
                        assert!(
                            apart < 1e-9 || views.iter().any(|sight| sees(sight, p)),
                            "{light} {place:?} {size}: {p}"
                        );
                    }
                    let most = if size == 0 { MOST as u32 } else { size };
                    assert!(
                        views.iter().all(|sight| sight
                            .view
                            .size
                            .iter()
                            .all(|side| side - 2 * sight.margin <= most)),
                        "{:?}",
                        views[0]
                    );
                }
            }
        }
    }

    #[test]
    fn a_single_point_is_seen() {
        let wanted = Wanted {
            bounds: (DVec3::splat(5e6), DVec3::splat(5e6)),
            spacing_m: 0.0,
            radius: 1.0,
            size: 0,
        };
        for light in [Light::Headlight, Light::Position(DVec3::ZERO)] {
            let views = cameras(light, &wanted, [0.3, 0.4]).unwrap();
            assert!(views.iter().any(|sight| sees(sight, DVec3::splat(5e6))), "{light}");
        }
    }
}
