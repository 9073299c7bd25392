//! Where the picture is taken from: the camera, in world coordinates, f64.
//!
//! Pixel (0, 0) is top left and pixel i covers [i, i + 1). Depth is the planar view-space distance in metres, positive in front,
//! for both projections (papers/README.md, conventions).

use crate::error::{Error, Result};
use glam::DVec3;
use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Projection {
    Perspective,
    Orthographic,
}

/// `cam.json`. Lengths in metres (the cloud's unit), angles in degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    pub eye: DVec3,
    pub target: DVec3,
    #[serde(default = "z_up")]
    pub up: DVec3,
    /// Vertical field of view of a perspective camera, degrees.
    #[serde(default = "default_fov_y")]
    pub fov_y: f64,
    #[serde(default = "perspective")]
    pub projection: Projection,
    /// Height of the picture in the world, for an orthographic camera, metres.
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

/// An orthonormal camera basis: right, up, forward, in world coordinates.
#[derive(Clone, Copy, Debug)]
pub struct Basis {
    pub right: DVec3,
    pub up: DVec3,
    pub forward: DVec3,
}

impl Camera {
    /// The camera's axes. An `up` parallel to the view direction is replaced by the world axis farthest from it.
    pub fn basis(&self) -> Result<Basis> {
        let forward = (self.target - self.eye).try_normalize();
        let Some(forward) = forward.filter(|_| self.eye.is_finite() && self.target.is_finite()) else {
            return Err(Error::Request(format!(
                "the camera has no direction: eye {} and target {} must be finite and apart",
                self.eye, self.target
            )));
        };
        let aside = |up: DVec3| forward.cross(up).try_normalize().filter(|_| forward.cross(up).length() > 1e-9 * up.length());
        let farthest = if forward.x.abs() < forward.y.abs() { DVec3::X } else { DVec3::Y };
        let right = aside(self.up).or_else(|| aside(farthest)).expect("one of two axes is not parallel to forward");
        Ok(Basis { right, up: right.cross(forward), forward })
    }
}

/// A camera and the size of its picture.
#[derive(Clone, Copy, Debug)]
pub struct View {
    pub camera: Camera,
    /// Pixels.
    pub size: [u32; 2],
    pub basis: Basis,
}

impl View {
    pub fn new(camera: Camera, size: [u32; 2]) -> Result<View> {
        let valid = match camera.projection {
            Projection::Perspective => camera.fov_y > 0.0 && camera.fov_y < 180.0,
            Projection::Orthographic => camera.ortho_height.is_some_and(|height| height > 0.0 && height.is_finite()),
        };
        if !valid {
            return Err(Error::Request(format!(
                "the camera needs 0 < fov_y < 180 degrees (perspective) or ortho_height > 0 metres (orthographic); it has fov_y {} and ortho_height {:?}",
                camera.fov_y, camera.ortho_height
            )));
        }
        Ok(View { camera, size, basis: camera.basis()? })
    }

    /// Pixels per unit of X/Z (perspective) or per metre (orthographic).
    pub fn focal_px(&self) -> f64 {
        let half = self.size[1] as f64 / 2.0;
        match self.camera.projection {
            Projection::Perspective => half / (self.camera.fov_y.to_radians() / 2.0).tan(),
            Projection::Orthographic => half / (self.camera.ortho_height.expect("checked by new") / 2.0),
        }
    }

    /// The ray through a pixel position (pixel centres at +0.5): origin and direction, world. The direction's component along
    /// `basis.forward` is 1, so the ray parameter **is** planar depth.
    pub fn ray(&self, x_px: f64, y_px: f64) -> (DVec3, DVec3) {
        let f = self.focal_px();
        let aside = self.basis.right * ((x_px - self.size[0] as f64 / 2.0) / f) - self.basis.up * ((y_px - self.size[1] as f64 / 2.0) / f);
        match self.camera.projection {
            Projection::Perspective => (self.camera.eye, self.basis.forward + aside),
            Projection::Orthographic => (self.camera.eye + aside, self.basis.forward),
        }
    }
}
