//! Views of a host: its matrices, or a camera of ours, as a [`View`] and a form of depth.

use crate::error::{Error, Result};
use crate::view::light::Light;
use crate::view::linear_map::LinearMap;
use crate::view::{Basis, Camera, Projection, View};
use glam::{DMat3, DMat4, DVec3};

/// A pair of matrices, each column by column: `clip = projection * view * (x, y, z, 1)`, in
/// Vulkan's clip space, where y points down and depth is within 0 and 1.
///
/// The view matrix is a rotation, possibly mirrored, a uniform scale and a translation. The
/// projection is a perspective, also off-centre, mirrored, infinite, or of reversed depth, or
/// orthographic and not mirrored. Depth must not depend on x and y, as with oblique near planes.
/// Pixels need not be square: lengths in space are then those of a world that is stretched as much.
/// Points before the near plane and behind the far one are drawn, too, at the depth of the plane.
///
/// A host that draws with a viewport of negative height negates the second row of its projection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Matrices {
    /// From the world to the view.
    pub view: [f64; 16],
    /// From the view to clip space.
    pub projection: [f64; 16],
}

impl Matrices {
    /// Returns matrices of a camera for a picture of this size `[px]`, with reversed depth: 1 at
    /// `near` and 0 at `far` `[m]`, which may be infinite for a perspective. Errors as
    /// [`View::new`].
    pub fn of(camera: &Camera, size: [u32; 2], near: f64, far: f64) -> Result<Matrices> {
        let view = View::new(*camera, size)?;
        let Basis { right, up, forward } = view.basis;
        let rotation = DMat3::from_cols(right, up, -forward).transpose();
        let from_world = DMat4::from_mat3(rotation) * DMat4::from_translation(-camera.eye);
        let [x, y] = size.map(|side| 2.0 * view.focal_px() / side as f64);
        let Depth { a, b, .. } = Depth::of(camera.projection, near, far)?;
        let mut projection = DMat4::ZERO;
        (projection.x_axis.x, projection.y_axis.y) = (x, -y);
        match camera.projection {
            Projection::Perspective => {
                (projection.z_axis.z, projection.w_axis.z, projection.z_axis.w) = (-a, b, -1.0);
            }
            Projection::Orthographic => {
                (projection.z_axis.z, projection.w_axis.z, projection.w_axis.w) = (-b, a, 1.0);
            }
        }
        Ok(Matrices { view: from_world.to_cols_array(), projection: projection.to_cols_array() })
    }
}

/// The camera of a view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ViewCamera {
    /// Matrices of the host.
    Matrices(Matrices),
    /// A camera of ours, with reversed depth as in [`Matrices::of`].
    Camera {
        /// Position, direction and field of view.
        camera: Camera,
        /// Least depth `[m]`.
        near: f64,
        /// Greatest depth `[m]`.
        far: f64,
    },
}

/// The host's depth: `a + b / z` of a perspective, `a + b z` of an orthographic projection, with
/// the planar depth z in a cloud's own units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Depth {
    pub a: f64,
    pub b: f64,
    pub perspective: bool,
    pub reversed: bool,
}

impl Depth {
    /// Reversed depth of an infinite perspective.
    pub const REVERSED: Depth = Depth { a: 0.0, b: 1.0, perspective: true, reversed: true };

    fn of(projection: Projection, near: f64, far: f64) -> Result<Depth> {
        let (perspective, reversed) = (projection == Projection::Perspective, true);
        let (least, most) = if perspective { (0.0, f64::INFINITY) } else { (-f64::MAX, f64::MAX) };
        let is_sound =
            near < far && far <= most && if perspective { near > least } else { near >= least };
        if !is_sound {
            return refused(format!(
                "depths from {near} to {far}; give a greater far than near, with perspective a near above 0, without it a finite far"
            ));
        }
        let (a, b) = match projection {
            Projection::Perspective if far.is_infinite() => (0.0, near),
            Projection::Perspective => (-near / (far - near), near * far / (far - near)),
            Projection::Orthographic => (far / (far - near), -1.0 / (far - near)),
        };
        Ok(Depth { a, b, perspective, reversed })
    }

    /// Returns the depth of what is infinitely far.
    pub fn far(&self) -> f32 {
        if self.reversed { 0.0 } else { 1.0 }
    }
}

/// Tolerance of ratios that matrices in f32 or f64 must meet.
const TOLERANCE: f64 = 1e-5;

fn refused<T>(what: String) -> Result<T> {
    Err(Error::Request(what))
}

/// Returns the view in the coordinates of a cloud with this transform, and the depth that the host
/// expects.
pub(super) fn view_of(
    camera: &ViewCamera,
    transform: &Transform,
    size: [u32; 2],
) -> Result<(View, Depth)> {
    match camera {
        ViewCamera::Camera { camera, near, far } => {
            let view = View::new(*camera, size)?;
            let depth = Depth::of(camera.projection, *near, *far)?;
            if transform.similarity == DMat4::IDENTITY {
                return Ok((view, depth));
            }
            let matrices = Matrices::of(camera, size, *near, *far)?;
            view_of(&ViewCamera::Matrices(matrices), transform, size)
        }
        ViewCamera::Matrices(matrices) => of_matrices(matrices, transform.similarity, size),
    }
}

fn of_matrices(matrices: &Matrices, transform: DMat4, size: [u32; 2]) -> Result<(View, Depth)> {
    let view = DMat4::from_cols_array(&matrices.view) * transform;
    let p = DMat4::from_cols_array(&matrices.projection);
    if !(view.is_finite() && p.is_finite()) {
        return refused("a matrix of the view has an infinite or undefined number".into());
    }
    let rows = DMat3::from_mat4(view).transpose();
    let scale = rows.x_axis.length();
    let [x, y, z] = [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| row / scale);
    let angles = [x.dot(y), y.dot(z), z.dot(x), y.length() - 1.0, z.length() - 1.0];
    if !(scale > 0.0 && angles.iter().all(|angle| angle.abs() < TOLERANCE)) {
        return refused(
            "the view matrix must be a rotation, a uniform scale and a translation".into(),
        );
    }
    let t = view.w_axis.truncate() / scale;
    let eye = -(x * t.x + y * t.y + z * t.z);
    let at = |row: usize, column: usize| p.col(column)[row];
    let perspective = at(3, 3) == 0.0;
    // Clip coordinates are homogeneous.
    let weight = if perspective { at(3, 2).abs() } else { at(3, 3) };
    let at = |row: usize, column: usize| at(row, column) / weight;
    let zero = [at(0, 1), at(1, 0), at(2, 0), at(2, 1), at(3, 0), at(3, 1)];
    let sheared = !perspective && (at(0, 2) != 0.0 || at(1, 2) != 0.0 || at(3, 2) != 0.0);
    if weight.is_nan() || weight <= 0.0 || zero.iter().any(|&entry| entry != 0.0) || sheared {
        return refused("the projection is neither a perspective nor orthographic".into());
    }
    let [width, height] = size.map(f64::from);
    let [wide, high] = [at(0, 0).abs() * width / 2.0, at(1, 1).abs() * height / 2.0];
    if !(wide > 0.0 && high > 0.0) {
        return refused(format!("the projection flattens the picture: {wide} x {high} pixels"));
    }
    // Pixels count as square within what matrices in f32 say.
    let square = (wide / high - 1.0).abs() < TOLERANCE;
    let focal = if square { high } else { wide.max(high) };
    let stretch = if square { [1.0, 1.0] } else { [wide / focal, high / focal] };
    let (right, up) = (x * at(0, 0).signum(), y * -at(1, 1).signum());
    // Without perspective a picture that is not mirrored tells where it looks.
    let sign = if perspective { at(3, 2).signum() } else { up.cross(right).dot(z).signum() };
    let forward = z * sign;
    let (eye, depth, middle) = if perspective {
        let (a, b) = (sign * at(2, 2), at(2, 3) / scale);
        (eye, Depth { a, b, perspective, reversed: b > 0.0 }, [sign * at(0, 2), sign * at(1, 2)])
    } else {
        // The eye is moved behind the near plane, since depths in front of an eye are positive.
        let (a, b) = (at(2, 3), at(2, 2) * sign * scale);
        let reversed = b < 0.0;
        let near = (if reversed { 1.0 } else { 0.0 } - a) / b;
        let moved = near - (1.0 / b).abs() * 1e-3;
        let depth = Depth { a: a + b * moved, b, perspective, reversed };
        (eye + forward * moved, depth, [at(0, 3), at(1, 3)])
    };
    let focal = if perspective { focal } else { focal * scale };
    let camera = Camera {
        eye,
        target: eye + forward,
        up,
        fov_y: 2.0 * (height / 2.0 / focal).atan().to_degrees(),
        projection: if perspective { Projection::Perspective } else { Projection::Orthographic },
        ortho_height: (!perspective).then_some(height / focal),
    };
    let mut view = View::new(camera, size)?;
    view.basis = Basis { right: right * stretch[0], up: up * stretch[1], forward };
    view.stretch = stretch;
    view.shift = [middle[0] * width / 2.0, middle[1] * height / 2.0];
    Ok((view, depth))
}

/// Tolerance within which a transform counts as a similarity, for rotations in f32.
const SIMILAR: f64 = 1e-6;

/// An affine transform from a cloud's own coordinates to the host's world, as a linear map that the
/// cloud is drawn through, and a similarity, by which views are brought to the cloud. A similarity
/// needs no map; of another transform, all but the translation is the map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Transform {
    pub map: LinearMap,
    similarity: DMat4,
}

impl Transform {
    /// Errors if the matrix is not affine, or has no inverse.
    pub fn of(columns: &[f64; 16]) -> Result<Transform> {
        let matrix = DMat4::from_cols_array(columns);
        let is_affine = matrix.is_finite() && matrix.row(3).to_array() == [0.0, 0.0, 0.0, 1.0];
        let linear = DMat3::from_mat4(matrix);
        let Some(map) = LinearMap::new(linear).filter(|_| is_affine) else {
            return refused(
                "a cloud's transform must be affine and finite, and must not flatten it".into(),
            );
        };
        let scale = linear.x_axis.length();
        let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis].map(|axis| axis / scale);
        let angles = [x.dot(y), y.dot(z), z.dot(x), y.length() - 1.0, z.length() - 1.0];
        let is_similarity = angles.iter().all(|angle| angle.abs() < SIMILAR);
        Ok(match is_similarity && linear.determinant() > 0.0 {
            true => Transform { map: LinearMap::default(), similarity: matrix },
            false => {
                Transform { map, similarity: DMat4::from_translation(matrix.w_axis.truncate()) }
            }
        })
    }

    /// Returns the position in the world of a position of the cloud.
    pub fn in_world(&self, own: DVec3) -> DVec3 {
        self.drawn_in_world(self.map.place(own))
    }

    /// Returns the position in the world of a position in the coordinates of the cloud's views.
    pub fn drawn_in_world(&self, drawn: DVec3) -> DVec3 {
        match self.similarity == DMat4::IDENTITY {
            true => drawn,
            false => self.similarity.transform_point3(drawn),
        }
    }

    /// Returns the length in the world of a unit in the coordinates of the cloud's views.
    pub fn unit(&self) -> f64 {
        self.similarity.x_axis.truncate().length()
    }

    /// Returns the axes in the world of the coordinates of the cloud's views, of length 1.
    pub fn axes(&self) -> [DVec3; 3] {
        let DMat4 { x_axis, y_axis, z_axis, .. } = self.similarity;
        [x_axis, y_axis, z_axis].map(|axis| axis.truncate().normalize())
    }

    /// Returns a camera of the world in the coordinates of the cloud's views.
    pub fn camera(&self, camera: Camera) -> Camera {
        if self.similarity == DMat4::IDENTITY {
            return camera;
        }
        let inverse = self.similarity.inverse();
        Camera {
            eye: inverse.transform_point3(camera.eye),
            target: inverse.transform_point3(camera.target),
            up: DVec3::from_array(self.axes().map(|axis| axis.dot(camera.up))),
            ortho_height: camera.ortho_height.map(|height| height / self.unit()),
            ..camera
        }
    }

    /// Returns a light of the world in the coordinates of the cloud's views.
    pub fn light(&self, light: Light) -> Light {
        if self.similarity == DMat4::IDENTITY {
            return light;
        }
        match light {
            Light::Headlight => light,
            Light::Direction(travels) => {
                Light::Direction(DVec3::from_array(self.axes().map(|axis| axis.dot(travels))))
            }
            Light::Position(place) => {
                Light::Position(self.similarity.inverse().transform_point3(place))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::Preset;

    fn points() -> Vec<DVec3> {
        let place =
            |i: i32| DVec3::new((i * 37 % 101) as f64, (i * 53 % 211) as f64, (i % 7) as f64);
        (0..200).map(|i| place(i) + 5e5).collect()
    }

    /// Projects a point as Vulkan does: pixels and depth.
    fn vulkan(matrices: &Matrices, point: DVec3, size: [u32; 2]) -> [f64; 3] {
        let [view, projection] =
            [matrices.view, matrices.projection].map(|m| DMat4::from_cols_array(&m));
        let clip = projection * (view * point.extend(1.0));
        let ndc = clip.truncate() / clip.w;
        [(ndc.x + 1.0) / 2.0 * size[0] as f64, (ndc.y + 1.0) / 2.0 * size[1] as f64, ndc.z]
    }

    fn agree(matrices: &Matrices, transform: DMat4, size: [u32; 2], cloud: &[DVec3]) {
        let camera = ViewCamera::Matrices(*matrices);
        let split = Transform::of(&transform.to_cols_array()).unwrap();
        let (view, depth) = view_of(&camera, &split, size).unwrap();
        for &point in cloud {
            let place = transform.transform_point3(point);
            assert!((split.in_world(point) - place).length() < 1e-8);
            let [x, y, z] = vulkan(matrices, place, size);
            let point = split.map.place(point);
            let [own_x, own_y] = view.pixel(point).unwrap();
            let planar = (point - view.camera.eye).dot(view.basis.forward);
            let own_z = if depth.perspective {
                depth.a + depth.b / planar
            } else {
                depth.a + depth.b * planar
            };
            assert!(
                (x - own_x).abs() < 1e-4 && (y - own_y).abs() < 1e-4,
                "{x} {y}, {own_x} {own_y}"
            );
            assert!((z - own_z).abs() < 1e-6, "{z}, {own_z}");
        }
    }

    #[test]
    fn a_view_of_matrices_projects_as_vulkan_does() {
        let (points, size) = (points(), [640, 480]);
        for preset in [Preset::Fit, Preset::Top, Preset::Side] {
            let camera = Camera::framing(preset, &points, size);
            let matrices = Matrices::of(&camera, size, 0.1, 5000.0).unwrap();
            agree(&matrices, DMat4::IDENTITY, size, &points);
            // Off-centre, and of a host that looks along +z with depth that grows.
            let mut other = matrices;
            let mirrored = DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0));
            let [view, mut p] = [other.view, other.projection].map(|m| DMat4::from_cols_array(&m));
            match camera.projection {
                Projection::Perspective => (p.z_axis.x, p.z_axis.y) = (0.3, -0.2),
                Projection::Orthographic => (p.w_axis.x, p.w_axis.y) = (0.3, -0.2),
            }
            let forwards = DMat4::from_cols(
                DVec3::X.extend(0.0),
                DVec3::Y.extend(0.0),
                DVec3::new(0.0, 0.0, -1.0).extend(0.0),
                DVec3::Z.extend(1.0),
            );
            other.projection = (forwards * p * mirrored).to_cols_array();
            other.view = (mirrored * view).to_cols_array();
            agree(&other, DMat4::IDENTITY, size, &points);
            let transform = DMat4::from_scale_rotation_translation(
                DVec3::splat(2.0),
                glam::DQuat::from_rotation_z(0.5),
                DVec3::new(10.0, 20.0, 30.0),
            );
            // Pixels that are not square, and with perspective also mirrored.
            let mut distorted = matrices;
            (distorted.projection[5], distorted.projection[0]) =
                (0.4 * matrices.projection[5], 1.3 * matrices.projection[0]);
            agree(&distorted, DMat4::IDENTITY, size, &points);
            if camera.projection == Projection::Perspective {
                distorted.projection[0] *= -1.0;
                agree(&distorted, DMat4::IDENTITY, size, &points);
            }
            // Sheared and stretched, about the middle; mirrored.
            let (middle, mut sheared) = (DMat4::from_translation(camera.target), transform);
            (sheared.y_axis.x, sheared.z_axis) = (0.4, sheared.z_axis * -3.0);
            for transform in [transform, middle * sheared * middle.inverse()] {
                let own: Vec<_> =
                    points.iter().map(|&p| transform.inverse().transform_point3(p)).collect();
                agree(&other, transform, size, &own);
            }
        }
    }

    #[test]
    fn what_cannot_be_drawn_is_refused_in_words() {
        let camera = Camera::framing(Preset::Fit, &points(), [640, 480]);
        let good = Matrices::of(&camera, [640, 480], 0.1, f64::INFINITY).unwrap();
        let wrong = |change: fn(&mut Matrices)| {
            let mut matrices = good;
            change(&mut matrices);
            let camera = ViewCamera::Matrices(matrices);
            view_of(&camera, &Transform::default(), [640, 480]).unwrap_err().to_string()
        };
        assert!(wrong(|m| m.projection[0] = 0.0).contains("flattens"));
        assert!(wrong(|m| m.view[0] *= 3.0).contains("uniform scale"));
        assert!(wrong(|m| m.projection[4] = 0.1).contains("neither"));
        assert!(wrong(|m| m.view[12] = f64::NAN).contains("undefined"));
        for [near, far] in [[0.0, 1.0], [2.0, 1.0], [f64::NAN, 1.0], [1.0, f64::NAN]] {
            assert!(Matrices::of(&camera, [640, 480], near, far).is_err(), "{near} {far}");
        }
        let flat = DMat4::from_scale(DVec3::new(1.0, 1.0, 0.0)).to_cols_array();
        assert!(Transform::of(&flat).unwrap_err().to_string().contains("flatten"));
        assert!(Transform::of(&good.projection).unwrap_err().to_string().contains("affine"));
    }
}
