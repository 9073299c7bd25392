//! Camera paths: eye and target follow centripetal Catmull-Rom splines through key views, f64.
//!
//! The splines pass through every key without loops or cusps, whatever the distances between keys
//! (Yuksel, Schaefer and Keyser 2011). Knots are spaced by the square root of the joint distance of
//! eye and target, so that both reach a key at the same time. Evaluated by Barry and Goldman's
//! pyramid.

use crate::atomic_file::write_atomically;
use crate::error::{Error, Result};
use crate::small_file::{MANY_PICTURES, read_text};
use crate::view::{Camera, Projection, View};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A camera at a time `[s]`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Key {
    pub time: f64,
    pub camera: Camera,
}

/// A camera path as in `path.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPath {
    #[serde(default = "frames_per_second")]
    pub frames_per_second: f64,
    /// Keys in the order of their times.
    pub keys: Vec<Key>,
}

fn frames_per_second() -> f64 {
    25.0
}

/// Default time between two keys `[s]`.
pub const STEP: f64 = 2.0;

/// Field of view of a view that stands for one without perspective `[degrees]`.
const FLAT: f64 = 2.0;

impl Default for CameraPath {
    fn default() -> CameraPath {
        CameraPath { frames_per_second: frames_per_second(), keys: Vec::new() }
    }
}

impl CameraPath {
    pub fn read(path: &Path) -> Result<CameraPath> {
        let text = read_text(path, MANY_PICTURES)?;
        let words = "it needs at least {\"keys\": [{\"time\": 0, \"camera\": {\"eye\": [x,y,z], \"target\": [x,y,z]}}]}";
        let read: CameraPath = serde_json::from_str(&text)
            .map_err(|error| Error::format(path, format!("not a camera path: {error}; {words}")))?;
        read.check().map_err(|why| Error::format(path, why)).map(|()| read)
    }

    pub fn write(&self, path: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self).expect("cameras are JSON");
        write_atomically(path, |partial| {
            std::fs::write(partial, text).map_err(|error| Error::io("write", path, error))
        })
    }

    fn check(&self) -> std::result::Result<(), String> {
        if self.keys.is_empty() {
            return Err("a camera path needs at least one key".into());
        }
        if !(self.frames_per_second > 0.0 && self.frames_per_second.is_finite()) {
            return Err(format!(
                "frames_per_second must be above 0, not {}",
                self.frames_per_second
            ));
        }
        for (number, key) in self.keys.iter().enumerate() {
            let wrong = |why: &str| Err(format!("key {} of the camera path: {why}", number + 1));
            if !key.time.is_finite() || number > 0 && key.time <= self.keys[number - 1].time {
                return wrong("its time must be after the one before");
            }
            if let Err(error) = View::new(key.camera, [1, 1]) {
                return wrong(&error.to_string());
            }
        }
        Ok(())
    }

    /// Appends a key [`STEP`] after the last.
    pub fn add(&mut self, camera: Camera) {
        let time = self.keys.last().map_or(0.0, |last| last.time + STEP);
        self.keys.push(Key { time, camera });
    }

    /// Returns the time from the first key to the last `[s]`.
    pub fn duration(&self) -> f64 {
        self.keys.last().map_or(0.0, |last| last.time - self.keys[0].time)
    }

    /// Returns the number of frames from the first key to the last, both included where a frame
    /// falls on them.
    pub fn frames(&self) -> u64 {
        // A small addition, since tenths of seconds are not binary numbers.
        ((self.duration() * self.frames_per_second + 1e-6) as u64).saturating_add(1)
    }

    pub fn frame(&self, number: u64) -> Camera {
        self.camera(number as f64 / self.frames_per_second)
    }

    /// Returns the camera after this time `[s]`; that of the first or last key outside the path.
    pub fn camera(&self, seconds: f64) -> Camera {
        let time = self.keys[0].time + seconds;
        let next = self.keys.partition_point(|key| key.time <= time);
        if next == 0 {
            return self.keys[0].camera;
        }
        if next == self.keys.len() {
            return self.keys[next - 1].camera;
        }
        let (from, to) = (self.keys[next - 1], self.keys[next]);
        let share = (time - from.time) / (to.time - from.time);
        if from.camera.projection != to.camera.projection {
            return between_projections(&from.camera, &to.camera, share);
        }
        let at = |number: Option<usize>| {
            number.and_then(|number| self.keys.get(number)).map(|key| key.camera)
        };
        between(
            [at(next.checked_sub(2)), Some(from.camera), Some(to.camera), at(Some(next + 1))],
            share,
        )
    }
}

/// Interpolates between a camera with perspective and one without, which is as one from far away
/// with a narrow field of view. The height of what is seen at the target, and the field of view,
/// change by ratios, and the movement rests at both ends.
fn between_projections(from: &Camera, to: &Camera, share: f64) -> Camera {
    let ends = [from, to].map(|camera| {
        let away = camera.eye - camera.target;
        let (fov_y, height) = match camera.projection {
            Projection::Perspective => {
                let slope = (camera.fov_y.to_radians() / 2.0).tan();
                (camera.fov_y, 2.0 * away.length() * slope)
            }
            Projection::Orthographic => (FLAT, camera.ortho_height.unwrap_or(1.0)),
        };
        let slope = (fov_y.to_radians() / 2.0).tan();
        (camera.target, away.normalize(), camera.up.normalize(), height.ln(), slope.ln())
    });
    let [a, b] = ends;
    let share = share * share * (3.0 - 2.0 * share);
    let mix = |a: f64, b: f64| a + (b - a) * share;
    let (height, slope) = (mix(a.3, b.3).exp(), mix(a.4, b.4).exp());
    // Relative to the start, since coordinates are large.
    let target = a.0 + (b.0 - a.0) * share;
    Camera {
        eye: target + a.1.slerp(b.1, share) * height / (2.0 * slope),
        target,
        up: a.2.slerp(b.2, share),
        fov_y: (2.0 * slope.atan()).to_degrees(),
        ortho_height: None,
        projection: Projection::Perspective,
    }
}

/// Returns the square root of the distance between two cameras.
fn apart(a: &Camera, b: &Camera) -> f64 {
    (a.eye.distance_squared(b.eye) + a.target.distance_squared(b.target)).powf(0.25)
}

/// Interpolates between the second camera and the third; `share` in 0..1.
fn between([before, from, to, after]: [Option<Camera>; 4], share: f64) -> Camera {
    let (from, to) = (from.expect("a path has both"), to.expect("a path has both"));
    let step = apart(&from, &to);
    // A missing or coincident neighbour is mirrored to the other side.
    let reach = |other: &Option<Camera>, end: &Camera| {
        other.as_ref().map(|other| apart(other, end)).filter(|apart| *apart > 0.0)
    };
    let (left, right) = (reach(&before, &from), reach(&after, &to));
    let knots = [-left.unwrap_or(step), 0.0, step, step + right.unwrap_or(step)];
    let along = |of: fn(&Camera) -> DVec3| {
        // Relative to the start, since coordinates are large.
        let start = of(&from);
        let way = of(&to) - start;
        let first = left.and(before.as_ref()).map_or(-way, |camera| of(camera) - start);
        let last = right.and(after.as_ref()).map_or(2.0 * way, |camera| of(camera) - start);
        let there = if step > 0.0 {
            spline([first, DVec3::ZERO, way, last], knots, share * step)
        } else {
            way * share
        };
        start + there
    };
    // Sizes stay between those of the two keys.
    let lens =
        |camera: &Camera| DVec3::new(camera.fov_y, camera.ortho_height.unwrap_or(1.0).ln(), 0.0);
    let sizes = along(lens).clamp(lens(&from).min(lens(&to)), lens(&from).max(lens(&to)));
    Camera {
        eye: along(|camera| camera.eye),
        target: along(|camera| camera.target),
        up: along(|camera| camera.up),
        fov_y: sizes.x,
        ortho_height: from.ortho_height.and(to.ortho_height).map(|_| sizes.y.exp()),
        projection: from.projection,
    }
}

/// Evaluates the spline through `points` at `knots`, at `t` between the second and the third.
fn spline(points: [DVec3; 4], knots: [f64; 4], t: f64) -> DVec3 {
    let mut level = points.to_vec();
    let mix =
        |a: DVec3, b: DVec3, from: f64, to: f64| (a * (to - t) + b * (t - from)) / (to - from);
    for span in 1..=2 {
        level = (0..level.len() - 1)
            .map(|i| mix(level[i], level[i + 1], knots[i], knots[i + span]))
            .collect();
    }
    mix(level[0], level[1], knots[1], knots[2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::Projection;

    fn camera(eye: [f64; 3], target: [f64; 3]) -> Camera {
        let origin = DVec3::new(500_000.0, 5_000_000.0, 100.0);
        let (eye, target) = (origin + DVec3::from_array(eye), origin + DVec3::from_array(target));
        Camera {
            eye,
            target,
            up: DVec3::Z,
            fov_y: 50.0,
            projection: Projection::Perspective,
            ortho_height: None,
        }
    }

    fn path(cameras: &[Camera]) -> CameraPath {
        let mut path = CameraPath::default();
        cameras.iter().for_each(|&camera| path.add(camera));
        path.check().unwrap();
        path
    }

    #[test]
    fn a_path_passes_through_its_keys_and_bends_without_a_kink() {
        let cameras = [
            camera([0.0, 0.0, 10.0], [0.0, 10.0, 0.0]),
            camera([30.0, 0.0, 10.0], [10.0, 10.0, 0.0]),
            camera([31.0, 1.0, 3.0], [10.0, 12.0, 0.0]),
            camera([0.0, 60.0, 40.0], [0.0, 10.0, 0.0]),
        ];
        let path = path(&cameras);
        for (number, camera) in cameras.iter().enumerate() {
            let at = path.camera(STEP * number as f64);
            assert!(
                at.eye.distance(camera.eye) < 1e-6 && at.target.distance(camera.target) < 1e-6,
                "key {number}"
            );
        }
        // The direction is the same on both sides of a key.
        for key in [1.0, 2.0] {
            let heading =
                |from: f64, to: f64| (path.camera(to).eye - path.camera(from).eye).normalize();
            let (before, after) =
                (heading(STEP * key - 1e-5, STEP * key), heading(STEP * key, STEP * key + 1e-5));
            assert!(before.dot(after) > 1.0 - 1e-6, "key {key}: {before} and {after}");
        }
        assert_eq!((path.camera(-1.0), path.camera(99.0)), (cameras[0], cameras[3]));
    }

    /// Checks the pyramid against the cubic of a uniform spline.
    #[test]
    fn evenly_spaced_keys_on_a_line_are_passed_evenly_and_a_rest_is_a_rest() {
        let on = |x: f64| camera([x, 0.0, 10.0], [x, 10.0, 0.0]);
        let line = path(&[on(0.0), on(4.0), on(8.0), on(12.0)]);
        for step in 0..60 {
            let time = step as f64 * 0.1;
            assert!((line.camera(time).eye.x - on(2.0 * time).eye.x).abs() < 1e-6, "{time}");
        }
        let rest = path(&[on(0.0), on(4.0), on(4.0), on(8.0)]);
        assert!((0..=20).all(|step| rest.camera(STEP + 0.1 * step as f64).eye == on(4.0).eye));
        assert!(rest.camera(1.0).eye.is_finite() && rest.camera(5.0).eye.is_finite());
    }

    #[test]
    fn without_perspective_the_height_changes_by_ratios_and_never_beyond_its_keys() {
        let flat = |x: f64, height: f64| Camera {
            projection: Projection::Orthographic,
            ortho_height: Some(height),
            ..camera([x, 0.0, 10.0], [x, 10.0, 0.0])
        };
        let path = path(&[flat(0.0, 1.0), flat(1.0, 100.0), flat(2.0, 1.0)]);
        let heights: Vec<f64> =
            (0..=40).map(|step| path.camera(0.1 * step as f64).ortho_height.unwrap()).collect();
        assert!(heights.iter().all(|height| (0.999..=100.001).contains(height)), "{heights:?}");
        assert!((heights[20] - 100.0).abs() < 1e-9);
    }

    /// What is seen at the target keeps its size, and nothing jumps.
    #[test]
    fn a_path_goes_from_perspective_to_none_and_back() {
        let flat = Camera {
            projection: Projection::Orthographic,
            ortho_height: Some(8.0),
            up: DVec3::Y,
            ..camera([0.0, 10.0, 50.0], [0.0, 10.0, 0.0])
        };
        let path = path(&[camera([0.0, 0.0, 10.0], [0.0, 10.0, 0.0]), flat, flat]);
        let seen = |camera: Camera| {
            let view = View::new(camera, [400, 300]).unwrap();
            let beside = camera.target + view.basis.right;
            let [a, b] = [camera.target, beside].map(|place| view.pixel(place).unwrap());
            (a[0] - b[0]).hypot(a[1] - b[1])
        };
        let sizes: Vec<f64> = (0..=40).map(|step| seen(path.camera(0.05 * step as f64))).collect();
        assert!((sizes[40] - 300.0 / 8.0).abs() < 1e-6, "{sizes:?}");
        assert!(sizes.windows(2).all(|pair| (pair[1] / pair[0] - 1.0).abs() < 0.1), "{sizes:?}");
        let last = path.camera(STEP - 1e-6);
        assert!((last.eye - last.target).normalize().distance(DVec3::Z) < 1e-6);
    }

    #[test]
    fn a_path_is_what_was_written_and_what_is_none_is_refused_with_its_key() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("path.json");
        let written = path(&[
            camera([0.1, 1.0 / 3.0, 10.0], [0.0, 10.0, 0.0]),
            camera([3.0, 0.0, 1.0], [0.0, 10.0, 0.0]),
        ]);
        written.write(&file).unwrap();
        assert_eq!(CameraPath::read(&file).unwrap(), written);
        assert_eq!(written.frames(), 51);
        let still = Camera { target: written.keys[0].camera.eye, ..written.keys[0].camera };
        for (camera, time, said) in
            [(still, 2.0, "direction"), (written.keys[1].camera, 0.0, "after the one")]
        {
            let wrong =
                CameraPath { keys: vec![written.keys[0], Key { time, camera }], ..written.clone() };
            wrong.write(&file).unwrap();
            let error = CameraPath::read(&file).unwrap_err().to_string();
            assert!(error.contains("key 2") && error.contains(said), "{error}");
        }
        std::fs::write(&file, "{\"keys\": []}").unwrap();
        assert!(CameraPath::read(&file).unwrap_err().to_string().contains("at least one key"));
    }
}
