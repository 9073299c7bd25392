//! The f64 twin of visibility on a single level: from depths in the kernels' own f32 bits to the
//! empty solid angle of every pixel, and the verdict.
//!
//! It follows guide: papers (Pintus, visibility) literally: points in the camera's space, the
//! largest `v . c` of every sector, the sum of `2 pi / S (1 - max v . c)`; except that a neighbour
//! which the point's own surface may reach ([`own_slope`]) closes nothing. The kernels' sum is
//! within 2.1e-6 of that, relatively (guide: numerics, case 7), and the threshold is rounded to
//! f32, so pixels within [`BAND`] of it may be decided either way.

use crate::passes::visibility::{Kernel, Settings, own_slope};
use crate::view::{Projection, View};
use glam::DVec3;
use std::f64::consts::TAU;

/// Relative error of the sum (guide: numerics, case 7).
pub const BAND: f64 = 4e-6;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    Visible,
    Invisible,
    /// Too near to the threshold to decide.
    InBand,
}

/// Depths as a picture: those that hold a point are finite.
#[derive(Clone, Copy)]
pub struct Depths<'d> {
    pub view: &'d View,
    pub depth: &'d [f32],
}

impl Depths<'_> {
    fn size(&self) -> [i64; 2] {
        self.view.size.map(|side| side as i64)
    }

    fn at(&self, x: i64, y: i64) -> Option<f64> {
        let [width, height] = self.size();
        let z = self.depth[(mirrored(y, height) * width + mirrored(x, width)) as usize];
        z.is_finite().then_some(z as f64)
    }

    /// In the camera's space: right, down, forward.
    fn point(&self, x: i64, y: i64, z: f64) -> DVec3 {
        let [width, height] = self.size();
        let f = self.view.focal_px() as f32 as f64;
        let across = DVec3::new(
            (x as f64 + 0.5 - width as f64 / 2.0) / f,
            (y as f64 + 0.5 - height as f64 / 2.0) / f,
            0.0,
        );
        match self.view.camera.projection {
            Projection::Perspective => (across + DVec3::Z) * z,
            Projection::Orthographic => across + DVec3::Z * z,
        }
    }

    /// The empty solid angle of a pixel, steradians, at least and at most: they differ where a
    /// neighbour is within [`BAND`] of [`own_slope`], and f32 may say either. A pixel without a
    /// point lies beyond all neighbours: its cones are closed, or hemispheres.
    pub fn solid_angle(&self, [x, y]: [i64; 2], kernel: Kernel, settings: &Settings) -> [f64; 2] {
        let (sectors, own_slope) = (settings.sectors as usize, own_slope(settings, kernel));
        let own = self.at(x, y).map(|z| self.point(x, y, z));
        let mut most: Vec<Option<f64>> = vec![None; sectors];
        let radius = kernel.radius as i64;
        for dy in -radius..=radius {
            for dx in -radius..=radius {
                if (dx, dy) == (0, 0) {
                    continue;
                }
                let Some(pi) = self.at(x + dx, y + dy).map(|z| self.point(x + dx, y + dy, z))
                else {
                    continue;
                };
                let cos = match own {
                    None => 1.0,
                    Some(p0) => {
                        let v = match self.view.camera.projection {
                            Projection::Perspective => -p0.normalize(),
                            Projection::Orthographic => -DVec3::Z,
                        };
                        v.dot((pi - p0).normalize())
                    }
                };
                let sector = &mut most[sector(dx, dy, sectors)];
                *sector = Some(sector.map_or(cos, |most| most.max(cos)));
            }
        }
        let shares = |band: f64| {
            let closes = |cos: f64| {
                own.is_none()
                    || cos <= 0.0
                    || cos > own_slope * (1.0 + band) * (1.0 - cos * cos).max(0.0).sqrt()
            };
            let share = |cos: &Option<f64>| 1.0 - cos.filter(|&cos| closes(cos)).unwrap_or(0.0);
            TAU / sectors as f64 * most.iter().map(share).sum::<f64>()
        };
        [-BAND, BAND].map(shares)
    }

    pub fn verdict(&self, at: [i64; 2], kernel: Kernel, settings: &Settings) -> Verdict {
        let [least, most] = self.solid_angle(at, kernel, settings);
        let needed =
            if self.at(at[0], at[1]).is_some() { settings.threshold } else { settings.holes };
        if least - needed > BAND * least {
            Verdict::Visible
        } else if needed - most > BAND * most {
            Verdict::Invisible
        } else {
            Verdict::InBand
        }
    }
}

/// Beyond the edge the picture is seen as in a mirror, which stands in the middle of the last
/// pixel, and which ends where the picture does.
fn mirrored(x: i64, side: i64) -> i64 {
    let x = if x < 0 { -x } else { x };
    let x = if x > side - 1 { 2 * (side - 1) - x } else { x };
    x.clamp(0, side - 1)
}

/// 4, 8 or 16 sectors of a full turn, each with its first border; in integers. Turned by quarters
/// until it lies in the first one, an offset is beyond an eighth of a turn where y >= x, and beyond
/// a sixteenth where y / x >= sqrt(2) - 1, which no fraction equals.
pub fn sector(x: i64, y: i64, sectors: usize) -> usize {
    let (mut x, mut y, mut quarter) = (x, y, 0);
    while !(x > 0 && y >= 0) {
        (x, y, quarter) = (y, -x, quarter + 1);
    }
    let eighth = (y >= x) as usize;
    let sixteenth = match eighth {
        0 => (x + y) * (x + y) > 2 * x * x,
        _ => (y - x) * (y - x) > 2 * x * x,
    } as usize;
    match sectors {
        4 => quarter,
        8 => 2 * quarter + eighth,
        16 => 4 * quarter + 2 * eighth + sixteenth,
        _ => panic!("there are 4, 8 or 16 sectors, not {sectors}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No offset of a kernel lies within rounding of a border but those on the axes and diagonals,
    /// which f64 has exactly as eighths of a turn.
    #[test]
    fn sectors_are_those_of_the_angle() {
        for (x, y) in
            (-31..=31).flat_map(|y| (-31..=31).map(move |x| (x, y))).filter(|at| *at != (0, 0))
        {
            let turn = ((y as f64).atan2(x as f64) / TAU).rem_euclid(1.0);
            for sectors in [4, 8, 16] {
                let exact = (turn * sectors as f64 * (1.0 + 1e-12)).floor() as usize % sectors;
                assert_eq!(sector(x, y, sectors), exact, "({x}, {y}) of {sectors}");
            }
        }
    }

    #[test]
    fn mirrors_end_where_the_picture_does() {
        assert_eq!([-3, -1, 0, 4, 5, 6].map(|x| mirrored(x, 5)), [3, 1, 0, 4, 3, 2]);
        assert_eq!([-9, -1, 0, 1, 9].map(|x| mirrored(x, 1)), [0; 5]);
        assert_eq!([-9, 9].map(|x| mirrored(x, 3)), [0, 0]);
    }
}
