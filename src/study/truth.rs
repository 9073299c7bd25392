//! Ray-cast truth of a view of a surface in f64, and the errors of a depth image against it.
//!
//! Rays are cast half a pixel apart, at centres, corners and the middles of sides, because a point
//! may lie anywhere in its pixel: depths between the least and the greatest true depth of a pixel
//! are not errors.
//!
//! ```text
//!     ray(x / 2, y / 2) -> depths
//!     edge: |1/a - 2/b + 1/c| b^2 > 1 % of b and of the scene's depth range, over a pixel to both
//!           sides (inverse depth is affine on planes)
//!     interior: no edge within 2 px
//!     inside: every ray of the pixel hits
//!     beyond: no ray within 1 px of the pixel hits
//! ```

use crate::view::{Projection, View};
use glam::DVec3;
use rayon::prelude::*;

/// A surface for rays, with the part that a scan could reach.
pub trait Surface: Sync {
    /// Returns the distance to the first surface, in units of the direction's length.
    fn first(&self, origin: DVec3, direction: DVec3) -> Option<f64>;

    /// Tests whether points are sampled at this place: unscanned parts cannot be drawn.
    fn scanned(&self, _point: DVec3) -> bool {
        true
    }
}

/// Planar depths `[m]` and masks, one value per pixel, row by row.
pub struct Truth {
    pub view: View,
    /// Depth at pixel centres; infinite where empty.
    pub depth: Vec<f64>,
    /// Least and greatest depth in the pixel; the greatest is infinite if part of it is empty.
    pub within: Vec<[f64; 2]>,
    /// Least and greatest depth in the 3x3 pixels around.
    pub around: Vec<[f64; 2]>,
    /// True if no edge crosses the pixel.
    pub smooth: Vec<bool>,
    /// True if it is more than 2 px from every edge and from unscanned parts.
    pub interior: Vec<bool>,
    /// True if it is entirely in the silhouette, and scanned.
    pub inside: Vec<bool>,
    /// True if it is more than 1 px outside of the silhouette.
    pub beyond: Vec<bool>,
}

/// A kink or jump of the depth is an edge above this share of the depth, and of the depth range in
/// view.
const EDGE: f64 = 0.01;

/// Tolerance relative to the depth.
const DEPTH_TOLERANCE: f64 = 0.005;
const LAYER_TOLERANCE: f64 = 0.0005;

/// Noise is cut off at this many standard deviations; errors beyond are counted.
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

    /// Returns the depths within `reach` half pixels around a pixel's centre.
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

    /// Tests where the surface bends or breaks between a pixel before and a pixel after.
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

    /// Returns a pixel's side at a depth `[m]`.
    pub fn pixel_m(&self, depth: f64) -> f64 {
        match self.view.camera.projection {
            Projection::Perspective => depth / self.view.focal_px(),
            Projection::Orthographic => 1.0 / self.view.focal_px(),
        }
    }

    /// Tests whether a point at this depth belongs to the first surface of its pixel; `None` if the
    /// pixel sees several and the depth lies between them.
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
    /// Interior pixels with a depth.
    pub interior: u64,
    /// Interior pixels farther than 0.5 % of the depth from all true depths of the pixel.
    pub misplaced: u64,
    /// Interior pixels farther than 0.05 % of the depth, plus the noise, from all true depths of
    /// the 3x3 pixels around.
    pub wrong_layer: u64,
    /// Pixels entirely in the silhouette.
    pub inside: u64,
    /// Pixels of `inside` without a depth.
    pub holes: u64,
    /// Pixels with a depth more than 1 px outside of the silhouette.
    pub spilled: u64,
    /// Points of the first surface classified as visible, and as hidden.
    pub visible: [u64; 2],
    /// Points behind it classified as visible, and as hidden.
    pub hidden: [u64; 2],
}

fn share(part: u64, whole: u64) -> f64 {
    part as f64 / whole.max(1) as f64
}

impl Errors {
    /// Returns the share of interior pixels with a depth.
    pub fn misplaced_share(&self) -> f64 {
        share(self.misplaced, self.interior)
    }

    /// Returns the share of interior pixels with a depth.
    pub fn wrong_layer_share(&self) -> f64 {
        share(self.wrong_layer, self.interior)
    }

    /// Returns the share of the pixels in the silhouette.
    pub fn hole_share(&self) -> f64 {
        share(self.holes, self.inside)
    }

    /// Returns the number relative to the pixels in the silhouette.
    pub fn spilled_share(&self) -> f64 {
        share(self.spilled, self.inside)
    }

    /// Returns the share of points classified as visible that are visible.
    pub fn precision(&self) -> f64 {
        share(self.visible[0], self.visible[0] + self.hidden[0])
    }

    /// Returns the share of visible points classified as visible.
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

/// Compares a depth image with the truth. `raw` is depth as projected, of points with `noise_px`
/// pixels of noise; `depth` is the processed one; both are infinite where empty. `visible` marks
/// the raw points classified as visible; all if empty.
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
