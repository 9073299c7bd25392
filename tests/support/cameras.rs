//! Cameras.

use glam::DVec3;
use pointillist::view::{Camera, Projection};

pub fn perspective(eye: DVec3, target: DVec3, fov_y: f64) -> Camera {
    Camera {
        eye,
        target,
        up: DVec3::Z,
        fov_y,
        projection: Projection::Perspective,
        ortho_height: None,
    }
}

pub fn orthographic(eye: DVec3, target: DVec3, height: f64) -> Camera {
    Camera {
        projection: Projection::Orthographic,
        ortho_height: Some(height),
        ..perspective(eye, target, 60.0)
    }
}
