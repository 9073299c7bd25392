//! The camera, in world coordinates, f64; camera paths and the light.
//!
//! Pixel (0, 0) is top left and pixel i covers [i, i + 1). Depth is the planar view-space distance
//! `[m]`, positive in front of the camera, for both projections.

pub mod camera_path;
pub mod light;
pub mod linear_map;
pub mod map;

use crate::error::{Error, Result};
use crate::small_file::{ONE_PICTURE, read_text};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::path::Path;
use strum::{EnumString, IntoStaticStr, VariantArray};

/// How depth becomes size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Projection {
    /// What is farther is smaller.
    Perspective,
    /// What is farther is as large.
    Orthographic,
}

/// A camera as in `cam.json`. Lengths in metres (the cloud's unit), angles in degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Position, world.
    pub eye: DVec3,
    /// Position that is looked at, in the middle of the picture, world.
    pub target: DVec3,
    /// Direction that points up in the picture, world; need not be of length 1.
    #[serde(default = "z_up")]
    pub up: DVec3,
    /// Vertical field of view of a perspective camera `[degrees]`.
    #[serde(default = "default_fov_y")]
    pub fov_y: f64,
    /// Perspective if a file has none.
    #[serde(default = "perspective")]
    pub projection: Projection,
    /// Height of the picture in the world of an orthographic camera `[m]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ortho_height: Option<f64>,
}

fn z_up() -> DVec3 {
    DVec3::Z
}

fn default_fov_y() -> f64 {
    60.0
}

fn perspective() -> Projection {
    Projection::Perspective
}

/// A camera basis, in world coordinates: right, up, forward; that of a camera is orthonormal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Basis {
    pub right: DVec3,
    pub up: DVec3,
    pub forward: DVec3,
}

impl Camera {
    /// Reads a camera file.
    pub fn read(path: &Path) -> Result<Camera> {
        let text = read_text(path, ONE_PICTURE)?;
        serde_json::from_str(&text).map_err(|error| {
            Error::format(
                path,
                format!(
                    "it is not a camera ({error}); a camera has at least {{\"eye\": [x,y,z], \"target\": [x,y,z]}}"
                ),
            )
        })
    }

    /// Returns the camera's axes. An `up` parallel to the view direction is replaced by the world
    /// axis farthest from it. Errors if eye and target coincide.
    #[doc(hidden)]
    pub fn basis(&self) -> Result<Basis> {
        let Some(forward) =
            (self.target - self.eye).try_normalize().filter(|forward| forward.is_finite())
        else {
            return Err(Error::Request(format!(
                "the camera has no direction: eye {} and target {} must be two different, finite positions",
                self.eye, self.target
            )));
        };
        let aside = |up: DVec3| {
            forward
                .cross(up)
                .try_normalize()
                .filter(|_| forward.cross(up).length() > 1e-9 * up.length())
        };
        let farthest = if forward.x.abs() < forward.y.abs() { DVec3::X } else { DVec3::Y };
        let right = aside(self.up)
            .or_else(|| aside(farthest))
            .expect("one of two axes is not parallel to forward");
        Ok(Basis { right, up: right.cross(forward), forward })
    }
}

/// A camera and the size of its picture, or a window of that picture, drawn as if cut out of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    pub camera: Camera,
    /// Size of the window `[px]`.
    pub size: [u32; 2],
    /// Size of the whole picture `[px]`.
    pub whole: [u32; 2],
    /// Top left pixel of the window in the whole picture.
    pub corner: [i32; 2],
    /// Axes in the world by which points are projected: right and up times `stretch`. Right is on
    /// the other side in mirrored pictures.
    pub basis: Basis,
    /// Pixels across and along the picture for the same length, as shares of those of `focal_px`;
    /// both 1 but for a host's matrices.
    pub stretch: [f64; 2],
    /// Principal point from the middle of the whole picture `[px]`, for off-centre projections.
    pub shift: [f64; 2],
}

/// Least field of view `[degrees]`: a metre at a distance of 57,000 km. Less would make pixels
/// infinite.
const LEAST_FOV_Y: f64 = 1e-6;

/// Heights of a picture without perspective `[m]`. Their squares are finite and no zeros.
const ORTHO_HEIGHTS: std::ops::RangeInclusive<f64> = 1e-150..=1e150;

impl View {
    pub fn new(camera: Camera, size: [u32; 2]) -> Result<View> {
        let needs = |what: &str| Err(Error::Request(format!("the camera needs {what}")));
        match (camera.projection, camera.ortho_height) {
            (Projection::Perspective, _) if camera.fov_y >= LEAST_FOV_Y && camera.fov_y < 180.0 => {
            }
            (Projection::Perspective, _) => {
                return needs(&format!(
                    "a fov_y of at least {LEAST_FOV_Y} and below 180 degrees; it has {:e}",
                    camera.fov_y
                ));
            }
            (Projection::Orthographic, Some(height)) if ORTHO_HEIGHTS.contains(&height) => {}
            (Projection::Orthographic, Some(height)) => {
                let (least, most) = (ORTHO_HEIGHTS.start(), ORTHO_HEIGHTS.end());
                return needs(&format!(
                    "an ortho_height from {least:e} to {most:e} metres; it has {height}"
                ));
            }
            (Projection::Orthographic, None) => {
                return needs("an ortho_height, metres, as it is orthographic; it has none");
            }
        }
        let basis = camera.basis()?;
        let (stretch, shift) = ([1.0, 1.0], [0.0, 0.0]);
        Ok(View { camera, size, whole: size, corner: [0, 0], basis, stretch, shift })
    }

    /// Returns a window of the whole picture, which may extend beyond it. Depths and pixels are
    /// those of the whole.
    pub fn window(&self, corner: [i32; 2], size: [u32; 2]) -> View {
        View { corner, size, ..*self }
    }

    /// Returns the whole picture.
    pub fn entire(&self) -> View {
        self.window([0, 0], self.whole)
    }

    /// Returns the principal point `[px]`, from the window's top left.
    pub fn centre(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.middle()[axis] - self.corner[axis] as f64)
    }

    /// Returns the principal point `[px]`, from the whole picture's top left.
    pub fn middle(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.whole[axis] as f64 / 2.0 + self.shift[axis])
    }

    /// Returns pixels per unit of X/Z (perspective) or per metre (orthographic).
    pub fn focal_px(&self) -> f64 {
        let half = self.whole[1] as f64 / 2.0;
        match self.camera.projection {
            Projection::Perspective => half / (self.camera.fov_y.to_radians() / 2.0).tan(),
            Projection::Orthographic => {
                half / (self.camera.ortho_height.expect("checked by new") / 2.0)
            }
        }
    }

    /// Returns the ray through a pixel position (pixel centres at +0.5): origin and direction,
    /// world. The direction's component along `basis.forward` is 1, so the ray parameter **is**
    /// planar depth.
    pub fn ray(&self, x_px: f64, y_px: f64) -> (DVec3, DVec3) {
        let (f, [x, y], [right, up, _]) = (self.focal_px(), self.centre(), self.normal_axes());
        let aside = right * ((x_px - x) / f) - up * ((y_px - y) / f);
        match self.camera.projection {
            Projection::Perspective => (self.camera.eye, self.basis.forward + aside),
            Projection::Orthographic => (self.camera.eye + aside, self.basis.forward),
        }
    }

    /// Returns the axes by which normals are projected, so that a normal and a vector have the same
    /// product before and after.
    pub fn normal_axes(&self) -> [DVec3; 3] {
        let ([across, along], Basis { right, up, forward }) = (self.stretch, self.basis);
        [right / (across * across), up / (along * along), forward]
    }

    /// Tests whether pictures are mirrored, or their pixels are not square.
    pub fn is_distorted(&self) -> bool {
        let Basis { right, up, forward } = self.basis;
        self.stretch != [1.0, 1.0] || right.cross(forward).dot(up) < 0.0
    }

    /// Projects a point to pixels; `None` if it is behind the camera.
    pub fn pixel(&self, point: DVec3) -> Option<[f64; 2]> {
        self.pixels()(point)
    }

    /// Returns [`View::pixel`] for many points.
    pub fn pixels(&self) -> impl Fn(DVec3) -> Option<[f64; 2]> {
        let (focal, middle) = (self.focal_px(), self.centre());
        move |point| {
            let from_eye = point - self.camera.eye;
            let depth = from_eye.dot(self.basis.forward);
            let scale = match self.camera.projection {
                Projection::Perspective => focal / depth,
                Projection::Orthographic => focal,
            };
            (depth > 0.0).then(|| {
                [
                    middle[0] + from_eye.dot(self.basis.right) * scale,
                    middle[1] - from_eye.dot(self.basis.up) * scale,
                ]
            })
        }
    }

    /// Returns the planes through the left, right, upper and lower edge of the window: an outward
    /// normal, where it is along that from the eye `[m]`, and how much the normal magnifies errors.
    fn edges(&self) -> [(DVec3, f64, f64); 4] {
        let (f, [x, y], basis) = (self.focal_px(), self.centre(), &self.basis);
        let [width, height] = self.size.map(f64::from);
        // Extent of the window to each side of the principal point.
        let sides =
            [(-basis.right, x), (basis.right, width - x), (basis.up, y), (-basis.up, height - y)];
        sides.map(|(side, extent)| match self.camera.projection {
            Projection::Perspective => {
                let slope = extent / f;
                (side - basis.forward * slope, 0.0, 1.0 + slope.abs())
            }
            Projection::Orthographic => (side, extent / f, 1.0),
        })
    }

    /// Returns beyond which edges of the window points lie: left, right, upper, lower. `farthest`
    /// returns the largest product of a point, world, with a vector.
    pub fn crossed(&self, farthest: impl Fn(DVec3) -> f64) -> [bool; 4] {
        self.edges().map(|(normal, at, _)| farthest(normal) - self.camera.eye.dot(normal) > at)
    }

    /// Returns the least planar depth `[m]` of a world box in front of the camera; `None` if no
    /// point of the box is in view.
    pub fn least_depth(&self, bounds: (DVec3, DVec3)) -> Option<f64> {
        self.depths(bounds).map(|(least, _)| least)
    }

    /// Returns the least and the greatest planar depth of a box; see [`View::least_depth`].
    pub fn depths(&self, (min, max): (DVec3, DVec3)) -> Option<(f64, f64)> {
        let centre = (min + max) / 2.0 - self.camera.eye;
        let half = (max - min) / 2.0;
        let reach = |axis: DVec3| half.dot(axis.abs());
        let basis = &self.basis;
        let depth = centre.dot(basis.forward);
        // Slightly larger than the box, against rounding.
        let slack = 1e-9 * (centre.length() + half.length());
        if depth + reach(basis.forward) + slack <= 0.0 {
            return None;
        }
        let outside = |(normal, at, scale): (DVec3, f64, f64)| {
            centre.dot(normal) - reach(normal) > at + slack * scale
        };
        if self.edges().into_iter().any(outside) {
            return None;
        }
        let reach = reach(basis.forward);
        // A box that is behind the eye by no more than rounding ends at the eye.
        Some(((depth - reach).max(0.0), (depth + reach).max(0.0)))
    }
}

/// The presets of `--view`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum Preset {
    /// From above, north up, without perspective
    Top,
    /// From the south, without perspective
    Front,
    /// From the east, without perspective
    Side,
    /// From a corner, without perspective
    Iso,
    /// Oblique, with perspective, near enough to fill the picture
    Fit,
}

/// Covered edges of a picture, in parts of its width or height.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Covered {
    pub left: f64,
    pub right: f64,
    pub top: f64,
    pub bottom: f64,
}

/// Largest part of a picture that counts as covered, so that some room is left to frame in.
const MOST_COVERED: f64 = 0.6;

impl Covered {
    /// Returns the free part of the width, and where its middle is: from -1 at the left to 1.
    fn across(&self) -> [f64; 2] {
        Covered::free(self.left, self.right)
    }

    /// Returns the free part of the height, and where its middle is: from -1 at the bottom to 1.
    fn upward(&self) -> [f64; 2] {
        Covered::free(self.bottom, self.top)
    }

    fn free(before: f64, after: f64) -> [f64; 2] {
        let fits = (MOST_COVERED / (before + after)).min(1.0);
        [1.0 - fits * (before + after), fits * (before - after)]
    }
}

/// Sides of [`Preset::Fit`], by the signs of its direction along x and y; the customary one first.
const SIDES: [[f64; 2]; 4] = [[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]];
/// How much more than the customary side another must show to be chosen.
const WORTH: f64 = 1.25;
/// Cells across the longer side of a picture in which points are sought.
const CELLS: f64 = 64.0;

/// Returns the share of a picture's cells with points. A sheet seen edge-on is in few of them.
fn seen_share(camera: &Camera, points: &[DVec3], size: [u32; 2]) -> f64 {
    let long = size[0].max(size[1]) as f64;
    let cells = size.map(|side| (side as f64 * CELLS / long).ceil() as usize);
    let Ok(view) = View::new(*camera, size) else { return 0.0 };
    let mut seen = vec![false; cells[0] * cells[1]];
    let pixel = view.pixels();
    for [x, y] in points.iter().filter_map(|&p| pixel(p)) {
        let [x, y] = [x, y].map(|at| (at * CELLS / long) as usize);
        if x < cells[0] && y < cells[1] {
            seen[y * cells[0] + x] = true;
        }
    }
    seen.iter().filter(|&&seen| seen).count() as f64 / seen.len() as f64
}

impl Camera {
    /// Returns a camera for which the points just fill the picture. No or one point is seen from a
    /// metre away.
    ///
    /// Perspective, in the camera's axes: every point needs |x - ex| <= t (z - ez), and the same
    /// for y. With a = max(x - t z) and b = max(-x - t z) that is a - ex <= -t ez and b + ex <= -t
    /// ez, so the nearest eye is ex = (a - b) / 2, ez = -(a + b) / 2t; of the two ez the farther
    /// serves both.
    pub fn framing(preset: Preset, points: &[DVec3], size: [u32; 2]) -> Camera {
        Camera::framing_beside(preset, points, size, Covered::default(), DVec3::Z)
    }

    /// Returns the camera after a turn around an axis through a point, anticlockwise seen from
    /// above `[rad]`.
    #[doc(hidden)]
    pub fn turned(&self, axis: DVec3, through: DVec3, angle: f64) -> Camera {
        let turn = DMat3::from_axis_angle(axis, angle);
        let turned = |place: DVec3| through + turn * (place - through);
        Camera { eye: turned(self.eye), target: turned(self.target), up: turn * self.up, ..*self }
    }

    /// Returns the places of points during a turn around an axis through the middle of their box,
    /// and this middle: a camera that frames them shows all points while it turns.
    #[doc(hidden)]
    pub fn swept(points: &[DVec3], axis: DVec3) -> (Vec<DVec3>, DVec3) {
        /// Places of a turn: between them a point leaves their hull by less than a margin.
        const PLACES: u32 = 24;
        let bounds = points.iter().map(|&p| (p, p));
        let bounds = bounds.reduce(|(low, high), (p, _)| (low.min(p), high.max(p)));
        let middle = bounds.map_or(DVec3::ZERO, |(low, high)| low / 2.0 + high / 2.0);
        let turn = |k| DMat3::from_axis_angle(axis, TAU * f64::from(k) / f64::from(PLACES));
        let turns = (0..PLACES).map(turn);
        let swept =
            turns.flat_map(|turn| points.iter().map(move |&p| middle + turn * (p - middle)));
        (swept.collect(), middle)
    }

    /// Returns the camera as [`Camera::framing`] for a picture of which a part is covered, of
    /// points whose y or z axis points `up`.
    #[doc(hidden)]
    pub fn framing_beside(
        preset: Preset,
        points: &[DVec3],
        size: [u32; 2],
        covered: Covered,
        up: DVec3,
    ) -> Camera {
        // Exchanges and changes of signs are exact.
        let turn = match up {
            DVec3::Y => DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y),
            _ => DMat3::IDENTITY,
        };
        let points: Vec<DVec3> = points.iter().map(|&p| turn.transpose() * p).collect();
        let of_side = |side: [f64; 2]| Camera::framing_side(preset, &points, size, covered, side);
        let chosen = match preset {
            Preset::Fit if !points.is_empty() => {
                let shown = |&side: &[f64; 2]| {
                    let camera = of_side(side);
                    (seen_share(&camera, &points, size), camera)
                };
                let shown: Vec<(f64, Camera)> = SIDES.par_iter().map(shown).collect();
                let (customary, camera) = shown[0];
                shown[1..]
                    .iter()
                    .filter(|(share, _)| *share > WORTH * customary)
                    .max_by(|(a, _), (b, _)| a.total_cmp(b))
                    .map_or(camera, |(_, camera)| *camera)
            }
            _ => of_side(SIDES[0]),
        };
        Camera {
            eye: turn * chosen.eye,
            target: turn * chosen.target,
            up: turn * chosen.up,
            ..chosen
        }
    }

    /// Returns the camera of one side, by the signs of its direction along x and y; z is up. The
    /// left and right planes then have different slopes, so ex = a + t_right ez = -b - t_left ez,
    /// or the middle of the range that the farther ez allows.
    fn framing_side(
        preset: Preset,
        points: &[DVec3],
        size: [u32; 2],
        covered: Covered,
        side: [f64; 2],
    ) -> Camera {
        let (min, max) =
            points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), &p| {
                (min.min(p), max.max(p))
            });
        let centre = if points.is_empty() { DVec3::ZERO } else { (min + max) / 2.0 };
        let half = if points.is_empty() { DVec3::ZERO } else { (max - min) / 2.0 };
        let flat = half.z < 0.3 * half.x.max(half.y);
        let (forward, up) = match preset {
            Preset::Top => (-DVec3::Z, DVec3::Y),
            Preset::Front => (DVec3::Y, DVec3::Z),
            Preset::Side => (-DVec3::X, DVec3::Z),
            Preset::Iso => (DVec3::new(-1.0, 1.0, -0.816_496_580_927_726).normalize(), DVec3::Z),
            // The longer side lies across the picture; land is seen from higher up than objects.
            Preset::Fit => {
                let [x, y] = if half.y > half.x { [0.9, 0.436] } else { [0.436, 0.9] };
                let along = DVec3::new(x * side[0], y * side[1], 0.0);
                let down = if flat { 0.7 } else { 0.36 };
                ((along.normalize() - DVec3::Z * down).normalize(), DVec3::Z)
            }
        };
        // Points are drawn as wide as they lie apart, and few ones lie far apart.
        let margin = (1.0 + 2.4 / (points.len().max(16) as f64).sqrt()).max(1.06);
        // Eye and target are two places even where f64 cannot tell places a metre apart.
        let least = centre.abs().max_element() * f64::EPSILON * 1024.0;
        let apart = least.max(1.0);
        let mut camera = Camera {
            eye: centre - forward * apart,
            target: centre,
            up,
            fov_y: 40.0,
            projection: Projection::Perspective,
            ortho_height: None,
        };
        let Basis { right, up, .. } = camera.basis().expect("eye and target are two places");
        let aspect = size[0] as f64 / size[1] as f64;
        // The maximum of a linear form over the points, relative to their centre.
        let most = |form: DVec3| {
            points.iter().map(|&p| (p - centre).dot(form)).fold(f64::NEG_INFINITY, f64::max)
        };
        if half == DVec3::ZERO {
            return camera;
        }
        if preset == Preset::Fit {
            let diagonal = half.length();
            let tangent = (camera.fov_y.to_radians() / 2.0).tan();
            let slope = tangent / margin;
            // The margin is relative to the uncovered part.
            let side = |axis: DVec3, aspect: f64, [free, middle]: [f64; 2]| {
                let (half, middle) = (slope * aspect * free, tangent * aspect * middle);
                let (before, after) = (half - middle, half + middle);
                let (a, b) = (most(axis - forward * after), most(-axis - forward * before));
                (a - b, middle, -(a + b) / (before + after))
            };
            let (wide, across, z_by_width) = side(right, aspect, covered.across());
            let (high, upward, z_by_height) = side(up, 1.0, covered.upward());
            let z = z_by_width.min(z_by_height).min(-1e-3 * diagonal).min(-least);
            let x = wide / 2.0 + across * z;
            let y = high / 2.0 + upward * z;
            camera.eye = centre + right * x + up * y + forward * z;
            camera.target = camera.eye - forward * z;
        } else {
            let (left, width) = ((most(right) - most(-right)) / 2.0, most(right) + most(-right));
            let (low, height) = ((most(up) - most(-up)) / 2.0, most(up) + most(-up));
            let ([wide, across], [high, upward]) = (covered.across(), covered.upward());
            let fitting = (height / high).max(width / (aspect * wide)) * margin;
            let fitting = if fitting > 0.0 { fitting } else { half.length() };
            let [across, upward] = [across * aspect, upward].map(|part| part / 2.0 * fitting);
            camera.target = centre + right * (left - across) + up * (low - upward);
            camera.eye = camera.target - forward * (2.0 * half.length()).max(least);
            camera.projection = Projection::Orthographic;
            camera.ortho_height = Some(fitting);
        }
        camera
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_frames_every_point_and_leaves_little_margin() {
        let points: Vec<_> = (0..500)
            .map(|i| {
                DVec3::new((i * 37 % 101) as f64, (i * 53 % 211) as f64 * 2.0, (i % 7) as f64) + 5e6
            })
            .collect();
        for preset in [Preset::Top, Preset::Front, Preset::Side, Preset::Iso, Preset::Fit] {
            for size in [[1920, 1080], [300, 900]] {
                let view = View::new(Camera::framing(preset, &points, size), size).unwrap();
                let (mut fill, f) = ([0.0f64; 2], view.focal_px());
                for p in &points {
                    let d = *p - view.camera.eye;
                    let z = d.dot(view.basis.forward);
                    assert!(z > 0.0);
                    let scale =
                        if view.camera.projection == Projection::Perspective { f / z } else { f };
                    let pixel = [
                        d.dot(view.basis.right) * scale / size[0] as f64 * 2.0,
                        d.dot(view.basis.up) * scale / size[1] as f64 * 2.0,
                    ];
                    fill = [fill[0].max(pixel[0].abs()), fill[1].max(pixel[1].abs())];
                }
                assert!(
                    fill[0] < 1.0 && fill[1] < 1.0 && fill[0].max(fill[1]) > 0.9,
                    "{preset:?} {size:?}: {fill:?}"
                );
            }
        }
    }

    #[test]
    fn clouds_far_from_zero_are_framed() {
        for far in [1e12, 1e17, 1e40, 1e100] {
            for width in [0.0, far / 2f64.powi(50), far / 2f64.powi(30), far] {
                let points = [DVec3::splat(far), DVec3::splat(far) + DVec3::X * width];
                for preset in [Preset::Top, Preset::Front, Preset::Side, Preset::Iso, Preset::Fit] {
                    let camera = Camera::framing(preset, &points, [320, 180]);
                    let view = View::new(camera, [320, 180]);
                    assert!(view.is_ok(), "{far:e} {width:e} {preset:?}: {camera:?}");
                }
            }
        }
    }

    #[test]
    fn beside_what_is_covered_every_point_is_seen_and_little_room_is_left() {
        let points: Vec<_> = (0..500)
            .map(|i| {
                DVec3::new((i * 37 % 101) as f64, (i * 53 % 211) as f64 * 2.0, (i % 7) as f64) + 5e6
            })
            .collect();
        for preset in [Preset::Top, Preset::Front, Preset::Side, Preset::Iso, Preset::Fit] {
            for (size, [left, right, top, bottom], up) in [
                ([1920, 1080], [0.2, 0.0, 0.0, 0.0], DVec3::Z),
                ([300, 900], [0.3, 0.0, 0.1, 0.0], DVec3::Y),
                ([800, 600], [0.6, 0.0, 0.0, 0.3], DVec3::Z),
                ([800, 600], [0.1, 0.3, 0.2, 0.1], DVec3::Z),
                ([900, 300], [0.0, 0.2, 0.0, 0.4], DVec3::Y),
            ] {
                let covered = Covered { left, right, top, bottom };
                let beside = Camera::framing_beside(preset, &points, size, covered, up);
                let view = View::new(beside, size).unwrap();
                let pixels: Vec<_> = points.iter().map(|&p| view.pixel(p).unwrap()).collect();
                let free = [[left, 1.0 - right], [top, 1.0 - bottom]];
                let free = [0, 1].map(|axis| free[axis].map(|part| part * size[axis] as f64));
                let mut most = 0.0f64;
                for axis in 0..2 {
                    let [least, greatest] = [f64::min, f64::max]
                        .map(|of| pixels.iter().map(|pixel| pixel[axis]).reduce(of).unwrap());
                    let [from, to] = free[axis];
                    assert!(
                        from < least && greatest < to,
                        "{preset:?} {size:?} {covered:?}: {least} to {greatest} of {from} to {to}"
                    );
                    most = most.max((greatest - least) / (to - from));
                }
                assert!(most > 0.85, "{preset:?} {size:?} {covered:?}: {most}");
            }
        }
        let whole = [0.0, 0.2].map(|covered| {
            let covered = Covered { left: covered, ..Covered::default() };
            Camera::framing_beside(Preset::Fit, &points, [640, 480], covered, DVec3::Z)
        });
        assert!(
            whole[0] == Camera::framing(Preset::Fit, &points, [640, 480]) && whole[0] != whole[1]
        );
    }

    #[test]
    fn a_slope_that_would_be_seen_edge_on_is_seen_from_another_side() {
        let slope = |toward: DVec3| -> Vec<DVec3> {
            (0..2500)
                .map(|i| DVec3::new((i % 50) as f64, (i / 50) as f64, 0.0))
                .map(|p| p + DVec3::Z * 0.7 * p.dot(toward))
                .collect()
        };
        let side = |toward: DVec3| {
            let camera = Camera::framing(Preset::Fit, &slope(toward), [640, 480]);
            camera.eye - camera.target
        };
        // It rises away from the customary eye, or towards it.
        assert!(side(DVec3::new(-0.44, 0.9, 0.0)).y < 0.0);
        assert!(side(DVec3::new(0.44, -0.9, 0.0)).y > 0.0);
    }

    #[test]
    fn points_with_y_up_are_framed_like_the_same_points_with_z_up() {
        let none = Covered::default();
        let points: Vec<_> =
            (0..99).map(|i| DVec3::new((i % 9) as f64, (i % 7) as f64, (i % 11) as f64)).collect();
        let turned: Vec<_> = points.iter().map(|p| DVec3::new(p.x, p.z, -p.y)).collect();
        for preset in [Preset::Top, Preset::Front, Preset::Side, Preset::Iso, Preset::Fit] {
            let camera = Camera::framing(preset, &points, [64, 48]);
            let up = Camera::framing_beside(preset, &turned, [64, 48], none, DVec3::Y);
            assert_eq!(up.eye, DVec3::new(camera.eye.x, camera.eye.z, -camera.eye.y));
            assert_eq!(up.up, DVec3::new(camera.up.x, camera.up.z, -camera.up.y));
        }
    }

    #[test]
    fn windows_together_see_what_the_whole_sees_where_the_whole_sees_it() {
        let points: Vec<_> = (0..400)
            .map(|i| {
                DVec3::new((i * 37 % 101) as f64, (i * 53 % 211) as f64, (i % 17) as f64) + 5e6
            })
            .collect();
        for preset in [Preset::Top, Preset::Fit] {
            let whole =
                View::new(Camera::framing(preset, &points[..100], [100, 60]), [100, 60]).unwrap();
            let windows = [[0, 0], [48, 0], [0, 24], [48, 24]].map(|corner: [i32; 2]| {
                whole.window(
                    corner,
                    [0, 1].map(|axis| {
                        if corner[axis] == 0 {
                            [48, 24][axis]
                        } else {
                            whole.whole[axis] - corner[axis] as u32
                        }
                    }),
                )
            });
            for &p in &points {
                let bounds = (p - 0.01, p + 0.01);
                let seen: Vec<_> =
                    windows.iter().filter_map(|window| window.depths(bounds)).collect();
                assert_eq!(seen.first().copied(), whole.depths(bounds), "{p}");
                for window in &windows {
                    let (a, b) = (whole.pixel(p).unwrap(), window.pixel(p).unwrap());
                    assert!(
                        (0..2)
                            .all(|axis| (a[axis] - window.corner[axis] as f64 - b[axis]).abs()
                                < 1e-9)
                    );
                    assert!((whole.ray(a[0], a[1]).1 - window.ray(b[0], b[1]).1).length() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn nothing_and_one_point_are_framed_too() {
        for points in [vec![], vec![DVec3::splat(5e6)]] {
            for preset in [Preset::Top, Preset::Front, Preset::Iso, Preset::Fit] {
                View::new(Camera::framing(preset, &points, [64, 64]), [64, 64]).unwrap();
            }
        }
    }
}
