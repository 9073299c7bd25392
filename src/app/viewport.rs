//! The part of the window that the picture has for itself: what the panel leaves.
//!
//! The picture fills the window, also below the panel, but its middle is that of the free part: the
//! projection is off-centre. So a camera looks at its subject whether the panel is there or not,
//! and in every picture that is drawn from it later.

use crate::error::Result;
use crate::view::{Camera, View};

/// Largest share of the width that counts as covered, so that some room is left.
const MOST_COVERED: f64 = 0.6;

/// A window, and how much of its left side is covered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Viewport {
    /// Size of the window `[px]`; 0 if it is minimised.
    pub reported: [u32; 2],
    /// The size, at least 1 x 1.
    size: [u32; 2],
    /// Width of the part that is covered `[px]`.
    covered: u32,
}

impl Viewport {
    pub fn new(size: [u32; 2], covered_px: f64) -> Viewport {
        let (reported, size) = (size, size.map(|side| side.max(1)));
        let covered = covered_px.min(MOST_COVERED * f64::from(size[0])) as u32;
        Viewport { reported, size, covered }
    }

    /// Returns the size of the window `[px]`, at least 1 x 1.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Returns the size of the free part `[px]`.
    pub fn free(&self) -> [u32; 2] {
        [self.size[0] - self.covered, self.size[1]]
    }

    /// Returns the view that fills the window.
    pub fn view(&self, camera: Camera) -> Result<View> {
        self.view_of(camera, self.size)
    }

    /// Returns the view that fills the window, as a picture of another size `[px]`.
    pub fn view_of(&self, camera: Camera, size: [u32; 2]) -> Result<View> {
        let covered = f64::from(self.covered) / f64::from(self.size[0]);
        let view = View::new(camera, size)?;
        Ok(View { shift: [covered * f64::from(size[0]) / 2.0, 0.0], ..view })
    }

    /// Returns the view of the free part alone.
    pub fn free_view(&self, camera: Camera) -> Result<View> {
        View::new(camera, self.free())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::Preset;
    use glam::DVec3;

    #[test]
    fn the_free_part_shows_what_a_picture_of_its_size_shows() {
        let corners = [DVec3::splat(5e5), DVec3::splat(5e5) + 10.0];
        for (covered, width) in [(0.0, 640), (276.0, 364), (1e9, 256)] {
            let viewport = Viewport::new([640, 480], covered);
            assert_eq!(viewport.free(), [width, 480]);
            for preset in [Preset::Fit, Preset::Top] {
                let camera = Camera::framing(preset, &corners, viewport.free());
                let [whole, free] = [viewport.view(camera), viewport.free_view(camera)]
                    .map(|view| view.unwrap().pixel(corners[1]).unwrap());
                assert!((whole[0] - free[0] - f64::from(640 - width)).abs() < 1e-6);
                assert!((whole[1] - free[1]).abs() < 1e-6);
                let half = viewport.view_of(camera, [320, 240]).unwrap();
                let half = half.pixel(corners[1]).unwrap().map(|at| 2.0 * at);
                assert!((half[0] - whole[0]).hypot(half[1] - whole[1]) < 1e-6);
            }
        }
    }
}
