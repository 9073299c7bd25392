//! The pick buffer: depth and point ids of the last frame on the CPU, for picks without the device.

use crate::config::NO_POINT;
use crate::view::View;
use glam::{DVec2, DVec3};

/// Depth and point ids of the last frame.
pub struct PickBuffer {
    pub view: View,
    /// Planar depth `[m]`; not finite where nothing is.
    pub depth: Vec<f32>,
    /// Point ids; none where a surface hides the point.
    pub index: Vec<u32>,
    /// Mark of a picture in the window's size with all points and effects; others are coarse, and
    /// their surfaces hide less.
    pub is_exact: bool,
}

/// Largest distance from the cursor to a picked pixel `[px]`.
pub const MISS_PX: i64 = 6;

impl PickBuffer {
    /// Returns the place on the surface at or near a pixel of a window of this size (world); None
    /// if nothing is near.
    pub fn place(&self, at: DVec2, window: [u32; 2]) -> Option<DVec3> {
        let (pixel, depth) = self.nearest(at, window, |i| {
            Some(self.depth[i] as f64).filter(|depth| depth.is_finite() && *depth > 0.0)
        })?;
        let (origin, direction) = self.view.ray(pixel[0] as f64 + 0.5, pixel[1] as f64 + 0.5);
        Some(origin + direction * depth)
    }

    /// Returns the id of the visible point at or near a pixel; None if none is near.
    pub fn point(&self, at: DVec2, window: [u32; 2]) -> Option<u32> {
        self.nearest(at, window, |i| Some(self.index[i]).filter(|&id| id != NO_POINT))
            .map(|(_, id)| id)
    }

    /// Returns the nearest pixel that has a value, and that value.
    fn nearest<T>(
        &self,
        at: DVec2,
        window: [u32; 2],
        has: impl Fn(usize) -> Option<T>,
    ) -> Option<([i64; 2], T)> {
        // Moving pictures are smaller than their window.
        let [width, height] = self.view.size.map(|side| side as i64);
        let scale = DVec2::new(
            width as f64 / window[0].max(1) as f64,
            height as f64 / window[1].max(1) as f64,
        );
        let centre = (at * scale).floor();
        let (x, y) = (centre.x as i64, centre.y as i64);
        let mut around: Vec<[i64; 2]> = (-MISS_PX..=MISS_PX)
            .flat_map(|dy| (-MISS_PX..=MISS_PX).map(move |dx| [dx, dy]))
            .collect();
        around.sort_by_key(|[dx, dy]| dx * dx + dy * dy);
        around.into_iter().map(|[dx, dy]| [x + dx, y + dy]).find_map(|pixel| {
            let within = (0..width).contains(&pixel[0]) && (0..height).contains(&pixel[1]);
            within
                .then(|| has((pixel[1] * width + pixel[0]) as usize))
                .flatten()
                .map(|found| (pixel, found))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::{Camera, Preset};

    #[test]
    fn picks_the_nearest_visible_pixel_or_none() {
        let corners = [DVec3::splat(5e5), DVec3::splat(5e5) + 10.0];
        let view = View::new(Camera::framing(Preset::Fit, &corners, [40, 20]), [40, 20]).unwrap();
        let (mut depth, mut index) = (vec![f32::INFINITY; 800], vec![NO_POINT; 800]);
        // A point, and right of it a pixel that was filled: it has a depth, and no point.
        (depth[10 * 40 + 15], index[10 * 40 + 15]) = (7.5, 42);
        depth[10 * 40 + 16] = 8.5;
        depth[0] = f32::NEG_INFINITY;
        let buffer = PickBuffer { view, depth, index, is_exact: true };
        // The window is twice as large as the picture.
        let at = |x: f64, y: f64| DVec2::new(2.0 * x, 2.0 * y);
        assert_eq!(buffer.point(at(15.5, 10.5), [80, 40]), Some(42));
        assert_eq!(buffer.point(at(16.5, 10.5), [80, 40]), Some(42));
        let place = buffer.place(at(16.5, 10.5), [80, 40]).unwrap();
        let pixel = view.pixel(place).unwrap();
        assert!((pixel[0] - 16.5).abs() < 1e-6 && (pixel[1] - 10.5).abs() < 1e-6, "{pixel:?}");
        assert!(((place - view.camera.eye).dot(view.basis.forward) - 8.5).abs() < 1e-6);
        for far in [at(30.0, 10.0), at(0.5, 0.5), at(-500.0, 900.0)] {
            assert_eq!((buffer.point(far, [80, 40]), buffer.place(far, [80, 40])), (None, None));
        }
    }
}
