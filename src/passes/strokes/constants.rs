//! Constants that all strokes of a frame share, and the cache key of a kept A-buffer.

use super::brush::Bristles;
use super::settings::{Blend, Settings};
use super::surface::{NEARER, NEARER_PX};
use super::{HIDES, LEAST_PX, Painting};
use crate::passes::project::Strip;
use crate::passes::resolve::ColorLookup;
use crate::passes::tiles;
use crate::shader::Canvas;
use crate::view::{Camera, View};

impl Painting<'_> {
    pub(super) fn canvas(&self, strip: Strip, paint: &ColorLookup) -> Canvas {
        let Settings { brush, long, detail, tangents, blend, noise, .. } = self.settings;
        let (bristles, ground) = (Bristles::of(&self.settings), brush.ground());
        let basis = &self.view.basis;
        let axes = self.resident.axes.0.map(|axis| axis.as_vec3().to_array());
        // Smaller coverage leaves no trace.
        let least = if blend == Blend::Abuffer { 0.4 / 255.0 } else { HIDES as f64 };
        Canvas {
            size: strip.size,
            tiles: tiles(strip.size),
            middle: self.view.middle().map(|at| at as f32),
            corner: self.corner(strip),
            focal: self.wide.focal_px() as f32,
            right: basis.right.as_vec3().to_array(),
            down: (-basis.up).as_vec3().to_array(),
            forward: basis.forward.as_vec3().to_array(),
            axis_x: axes[0],
            axis_y: axes[1],
            axis_z: axes[2],
            scale: bristles.size as f32,
            ground: ground as f32,
            nearer: NEARER as f32,
            nearer_px: NEARER_PX as f32,
            least_px: LEAST_PX,
            largest_px: self.settings.largest_px(self.view.whole) as f32,
            lengthen: long as f32,
            detail: detail as f32,
            reach: bristles.reach(least, noise).map(|reach| reach as f32),
            word: self.resident.shown.strokes().expect("begin has looked"),
            kind: self.resident.shown.kind().unwrap_or(0),
            tangents: tangents as u32,
            hides: HIDES,
            lo: paint.ramp[0],
            ramp: paint.ramp[1],
        }
    }

    /// Returns all that fragments depend on.
    pub(super) fn cache_key(&self, paint: &ColorLookup) -> Vec<u64> {
        let Settings {
            brush,
            blend,
            sort: _,
            order,
            tangents,
            size: _,
            amplitude: _,
            gamma: _,
            sigma_x: _,
            sigma_y: _,
            dev: _,
            gaussians: _,
            noise,
            long,
            detail,
            largest,
            passes: _,
            memory: _,
            radius: _,
        } = self.settings;
        let Bristles { size, amplitude, gamma, sigma_x, sigma_y, dev, gaussians } =
            Bristles::of(&self.settings);
        let View { camera, size: pixels, whole, corner, basis: _, stretch: _, shift } = self.view;
        let Camera { eye, target, up, fov_y, projection, ortho_height } = camera;
        let numbers = [
            size,
            amplitude,
            gamma,
            sigma_x,
            sigma_y,
            dev,
            brush.ground(),
            noise,
            long,
            detail,
            largest,
            *fov_y,
            ortho_height.unwrap_or(0.0),
        ];
        let places = [eye, target, up].map(|place| place.to_array()).concat();
        let numbers = numbers.into_iter().chain(*shift);
        let of_points = self
            .resident
            .opacities
            .table(&self.resident.stations)
            .into_iter()
            .map(f64::from)
            .chain(paint.gains.iter().copied())
            .chain([paint.scale.brightness, paint.scale.contrast, paint.scale.gamma])
            .chain([self.resident.shown.toned(0.5)])
            .chain(paint.scale.ramp.map(|ramp| ramp as u8 as f64));
        let factors: Vec<u64> =
            of_points.chain(paint.ramp.map(f64::from)).map(f64::to_bits).collect();
        let choices = [
            blend as u64,
            order as u64,
            tangents as u64,
            gaussians as u64,
            *projection as u64,
            paint.mode as u64,
            factors.len() as u64,
        ];
        let shape = [*pixels, *whole, corner.map(|at| at as u32)].concat();
        let numbers = numbers.chain(places).map(f64::to_bits);
        choices
            .into_iter()
            .chain(shape.into_iter().map(u64::from))
            .chain(numbers)
            .chain(factors)
            .chain(self.resident.identity())
            .collect()
    }
}
