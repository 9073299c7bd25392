//! A view and a surface in, what is truly seen in every pixel out, f64; and how far a depth image is from it.
//!
//! Rays are cast half a pixel apart, at centres, corners and the middles of sides, because a point may lie anywhere in its pixel: what lies between the least and the greatest
//! true depth of a pixel is no error there. The numbers are those of STUDIES.md, "Numbers to match or beat".
//!
//! ```text
//!     ray(x / 2, y / 2) -> depths -> edge: |1/a - 2/b + 1/c| b^2 > 1 % of b and of the scene's depth range, over a pixel to both sides (inverse depth is affine on planes)
//!     interior: no edge within 2 px      inside: every ray of the pixel hits      beyond: no ray within 1 px of the pixel hits
//! ```

use crate::view::{Projection, View};
use glam::DVec3;
use rayon::prelude::*;

/// What a ray may meet, and whether a scan could have met it.
pub trait Surface: Sync {
    /// How far the first surface is, in units of the direction's length.
    fn first(&self, origin: DVec3, direction: DVec3) -> Option<f64>;

    /// Whether a point of the surface is one that points are taken from: what no scanner saw cannot be drawn.
    fn scanned(&self, _point: DVec3) -> bool {
        true
    }
}

/// Planar depths, metres; a pixel a value, row by row.
pub struct Truth {
    pub view: View,
    /// Of pixel centres; infinite where nothing is.
    pub depth: Vec<f64>,
    /// Least and greatest in the pixel; greatest is infinite where a part of it sees nothing.
    pub within: Vec<[f64; 2]>,
    /// Least and greatest of what is hit within a pixel of the centre: its 3x3.
    pub around: Vec<[f64; 2]>,
    /// No edge crosses the pixel.
    pub smooth: Vec<bool>,
    /// More than 2 px from every edge, and from what was not scanned.
    pub interior: Vec<bool>,
    /// Wholly in the silhouette, and scanned.
    pub inside: Vec<bool>,
    /// More than 1 px outside of the silhouette.
    pub beyond: Vec<bool>,
}

/// A kink or jump of the depth is an edge where it is more than this share of the depth, and of the depth range of all that is seen.
const EDGE: f64 = 0.01;

/// Of the depth.
const DEPTH_TOLERANCE: f64 = 0.005;
const LAYER_TOLERANCE: f64 = 0.0005;

/// Noise is cut off here: beyond it nothing is excused.
pub const NOISE_SIGMAS: f64 = 3.0;

/// True depths half a pixel apart: pixel (x, y) has its centre at (2 x + 1, 2 y + 1).
struct Grid {
    size: [usize; 2],
    depth: Vec<f64>,
}

impl Grid {
    fn at(&self, x: usize, y: usize) -> f64 {
        self.depth[y * self.size[0] + x]
    }

    /// What lies so many half pixels around a pixel's centre.
    fn around(&self, [x, y]: [usize; 2], reach: usize) -> impl Iterator<Item = usize> + use<> {
        let [columns, rows] = self.size;
        let span = |centre: usize, end: usize| {
            (2 * centre + 1).saturating_sub(reach)..(2 * centre + 2 + reach).min(end)
        };
        let across = span(x, columns);
        span(y, rows).flat_map(move |row| across.clone().map(move |column| row * columns + column))
    }

    fn range(&self, pixel: [usize; 2], reach: usize) -> [f64; 2] {
        let hits =
            self.around(pixel, reach).map(|i| self.depth[i]).filter(|depth| depth.is_finite());
        hits.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], depth| {
            [lo.min(depth), hi.max(depth)]
        })
    }

    /// Where the surface bends or breaks between a pixel before and a pixel after.
    fn edges(&self) -> Vec<bool> {
        let hits = || self.depth.par_iter().copied().filter(|depth| depth.is_finite());
        let extent = hits().reduce(|| f64::NEG_INFINITY, f64::max)
            - hits().reduce(|| f64::INFINITY, f64::min);
        let [columns, rows] = self.size;
        let bends = |[x, y]: [usize; 2], [right, down]: [usize; 2]| {
            if x < right || y < down || x + right >= columns || y + down >= rows {
                return false;
            }
            let (before, own, after) =
                (self.at(x - right, y - down), self.at(x, y), self.at(x + right, y + down));
            (1.0 / before - 2.0 / own + 1.0 / after).abs() * own * own > EDGE * own.min(extent)
        };
        let edge = |i: usize| {
            let at = [i % columns, i / columns];
            self.depth[i].is_finite() && (bends(at, [2, 0]) || bends(at, [0, 2]))
        };
        (0..self.depth.len()).into_par_iter().map(edge).collect()
    }
}

impl Truth {
    pub fn cast(view: &View, surface: &dyn Surface) -> Truth {
        let [width, height] = view.size.map(|side| side as usize);
        let size = [2 * width + 1, 2 * height + 1];
        let cast = |i: usize| {
            let (origin, direction) =
                view.ray((i % size[0]) as f64 / 2.0, (i / size[0]) as f64 / 2.0);
            surface.first(origin, direction).unwrap_or(f64::INFINITY)
        };
        let grid = Grid { size, depth: (0..size[0] * size[1]).into_par_iter().map(cast).collect() };
        let mut edges = grid.edges();
        let pixels = || (0..width * height).into_par_iter().map(|i| [i % width, i / width]);
        let centre = |[x, y]: [usize; 2]| (2 * y + 1) * size[0] + 2 * x + 1;
        let depth: Vec<f64> = pixels().map(|pixel| grid.depth[centre(pixel)]).collect();
        let whole = |pixel| grid.around(pixel, 1).all(|i| grid.depth[i].is_finite());
        let smooth = pixels().map(|pixel| !grid.around(pixel, 1).any(|i| edges[i])).collect();
        let scanned = |[x, y]: [usize; 2]| {
            let (origin, direction) = view.ray(x as f64 + 0.5, y as f64 + 0.5);
            let depth = depth[y * width + x];
            depth.is_finite() && surface.scanned(origin + direction * depth)
        };
        let scanned: Vec<bool> = pixels().map(scanned).collect();
        scanned
            .iter()
            .enumerate()
            .filter(|(_, scanned)| !**scanned)
            .for_each(|(i, _)| edges[centre([i % width, i / width])] = true);
        let inside: Vec<bool> =
            pixels().zip(&scanned).map(|(pixel, scanned)| *scanned && whole(pixel)).collect();
        Truth {
            view: *view,
            within: pixels()
                .map(|pixel| {
                    let [least, greatest] = grid.range(pixel, 1);
                    [least, if whole(pixel) { greatest } else { f64::INFINITY }]
                })
                .collect(),
            around: pixels().map(|pixel| grid.range(pixel, 2)).collect(),
            smooth,
            interior: pixels()
                .zip(&inside)
                .map(|(pixel, inside)| *inside && !grid.around(pixel, 4).any(|i| edges[i]))
                .collect(),
            inside,
            beyond: pixels()
                .map(|pixel| !grid.around(pixel, 3).any(|i| grid.depth[i].is_finite()))
                .collect(),
            depth,
        }
    }

    /// A pixel's side at a depth, metres.
    pub fn pixel_m(&self, depth: f64) -> f64 {
        match self.view.camera.projection {
            Projection::Perspective => depth / self.view.focal_px(),
            Projection::Orthographic => 1.0 / self.view.focal_px(),
        }
    }

    /// Whether a point at this depth belongs to the first surface of its pixel; `None` where the pixel sees several and the depth lies between them.
    pub fn is_visible(&self, pixel: usize, depth: f64, noise_px: f64) -> Option<bool> {
        let slack = self.layer_slack(depth, noise_px);
        let [least, greatest] = self.within[pixel];
        if depth > greatest + slack {
            Some(false)
        } else {
            (depth <= least + slack || self.smooth[pixel] && greatest.is_finite()).then_some(true)
        }
    }

    fn layer_slack(&self, depth: f64, noise_px: f64) -> f64 {
        LAYER_TOLERANCE * depth + NOISE_SIGMAS * noise_px * self.pixel_m(depth)
    }
}

/// Counts of pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Errors {
    /// Interior pixels that have a depth.
    pub interior: u64,
    /// Of them: farther than 0.5 % of the depth from all true depths of the pixel.
    pub misplaced: u64,
    /// Of them: farther than 0.05 % of the depth, and the noise, from all true depths of the pixel's 3x3.
    pub wrong_layer: u64,
    /// Wholly in the silhouette.
    pub inside: u64,
    /// Of them: without a depth.
    pub holes: u64,
    /// With a depth, more than 1 px outside of the silhouette.
    pub spilled: u64,
    /// With a point of the first surface that was taken for visible, and for hidden.
    pub visible: [u64; 2],
    /// With a point behind it that was taken for visible, and for hidden.
    pub hidden: [u64; 2],
}

fn share(part: u64, whole: u64) -> f64 {
    part as f64 / whole.max(1) as f64
}

impl Errors {
    /// Of the interior pixels with a depth.
    pub fn misplaced_share(&self) -> f64 {
        share(self.misplaced, self.interior)
    }

    /// Of the interior pixels with a depth.
    pub fn wrong_layer_share(&self) -> f64 {
        share(self.wrong_layer, self.interior)
    }

    /// Of the pixels in the silhouette.
    pub fn hole_share(&self) -> f64 {
        share(self.holes, self.inside)
    }

    /// Of as many pixels as the silhouette has.
    pub fn spilled_share(&self) -> f64 {
        share(self.spilled, self.inside)
    }

    /// Of what was taken for visible, the share that is.
    pub fn precision(&self) -> f64 {
        share(self.visible[0], self.visible[0] + self.hidden[0])
    }

    /// Of what is visible, the share that was taken for it.
    pub fn recall(&self) -> f64 {
        share(self.visible[0], self.visible[0] + self.visible[1])
    }
}

impl std::iter::Sum for Errors {
    fn sum<I: Iterator<Item = Errors>>(all: I) -> Errors {
        let pair = |[a, b]: [u64; 2], [c, d]: [u64; 2]| [a + c, b + d];
        all.fold(Errors::default(), |a, b| Errors {
            interior: a.interior + b.interior,
            misplaced: a.misplaced + b.misplaced,
            wrong_layer: a.wrong_layer + b.wrong_layer,
            inside: a.inside + b.inside,
            holes: a.holes + b.holes,
            spilled: a.spilled + b.spilled,
            visible: pair(a.visible, b.visible),
            hidden: pair(a.hidden, b.hidden),
        })
    }
}

/// `raw` is depth as projected, of points with `noise_px` pixels of noise; `depth` is what became of it; both infinite where nothing is. `visible` is what was taken for visible
/// of the raw points; everything where it is not said.
pub fn compare(
    truth: &Truth,
    noise_px: f64,
    raw: &[f32],
    depth: &[f32],
    visible: Option<&[bool]>,
) -> Errors {
    let pixel = |i: usize| {
        let mut errors = Errors::default();
        let own = depth[i] as f64;
        let covered = own.is_finite();
        if truth.interior[i] && covered {
            let outside = |[least, greatest]: [f64; 2]| (least - own).max(own - greatest);
            errors.interior = 1;
            errors.misplaced = (outside(truth.within[i]) > DEPTH_TOLERANCE * truth.depth[i]) as u64;
            errors.wrong_layer =
                (outside(truth.around[i]) > truth.layer_slack(truth.depth[i], noise_px)) as u64;
        }
        errors.inside = truth.inside[i] as u64;
        errors.holes = (truth.inside[i] && !covered) as u64;
        errors.spilled = (truth.beyond[i] && covered) as u64;
        let found =
            raw[i].is_finite().then(|| truth.is_visible(i, raw[i] as f64, noise_px)).flatten();
        let taken = visible.is_none_or(|visible| visible[i]);
        match found {
            Some(true) => errors.visible[!taken as usize] = 1,
            Some(false) => errors.hidden[!taken as usize] = 1,
            None => {}
        }
        errors
    };
    (0..depth.len()).into_par_iter().map(pixel).sum()
}
