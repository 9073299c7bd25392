//! The f64 twin of how kernels are chosen: depths in; out, of every tile, the kernel that the spacing of its points calls for (glsl/classify.comp, gaps.comp, assign.comp).
//!
//! ```text
//!     counted     points of the front in quarters of tiles all around which some are, or else in whole tiles; how far apart these are, by Poisson
//!     gap         of a tile, or a block of 2 x 2, that lies within a surface: by its own points, and by how many of them lie beside each other
//!     spacing     the widest of these, at least what the node says, and at most twice that
//! ```

use super::visibility::{BAND, Depths};
use crate::passes::TILE_PX;
use crate::passes::visibility::{FRONT_PX, Kernel, SPARSER, SPARSEST, Settings, WIDTHS};

/// Column and row of a tile, of a quarter, of a block, or of a pixel.
type Place = [i64; 2];

const TILE: i64 = TILE_PX as i64;

/// Where points are `spacing` metres apart everywhere, or as it is counted; none where rounding may choose another.
pub fn kernels(depths: Depths, settings: &Settings, spacing: f64) -> Vec<Option<Kernel>> {
    // Either rounding may go either way.
    let slacks = [1.0 - BAND, 1.0 + BAND];
    let widths = |slack: f64| {
        let tiles = Tiles { depths, spacing, slack };
        let [across, down] = tiles.count();
        let all = (0..across * down).map(|i| tiles.spacing([i % across, i / across]) * settings.reach);
        all.map(|px| slacks.map(|slack| of_extent(px * slack))).collect::<Vec<_>>()
    };
    let [least, most] = slacks.map(widths);
    least.into_iter().zip(most).map(|(least, most)| (least == most && least[0] == least[1]).then(|| Kernel::of_width(least[0]))).collect()
}

/// The least kernel that is so many pixels wide, or the widest.
fn of_extent(pixels: f64) -> u32 {
    WIDTHS.into_iter().find(|&width| width as f64 >= pixels).unwrap_or(WIDTHS[WIDTHS.len() - 1])
}

/// How far apart strewn points are, pixels, of which this share of the pixels holds some.
fn apart(share: f64) -> f64 {
    ((1.0 - share).max(0.0).sqrt() / share).sqrt()
}

/// Itself and those left, right, above and below.
fn cross([x, y]: Place) -> [Place; 5] {
    [[x, y], [x - 1, y], [x + 1, y], [x, y - 1], [x, y + 1]]
}

struct Tiles<'d> {
    depths: Depths<'d>,
    /// Of the node's points, metres.
    spacing: f64,
    /// By how much comparisons of depths may be off, as a factor.
    slack: f64,
}

impl Tiles<'_> {
    fn count(&self) -> Place {
        self.depths.size().map(|side| (side + TILE - 1) / TILE)
    }

    /// Of those beyond the edge, the one at the edge once more; of tiles, or of blocks of so many across and down.
    fn within(&self, at: Place, span: i64) -> Place {
        let last = self.count().map(|tiles| (tiles - 1) / span);
        [0, 1].map(|axis| at[axis].clamp(0, last[axis]))
    }

    fn around(&self, at: Place, span: i64) -> [Place; 9] {
        std::array::from_fn(|k| self.within([at[0] + k as i64 % 3 - 1, at[1] + k as i64 / 3 - 1], span))
    }

    fn pixels(&self, [tx, ty]: Place) -> impl Iterator<Item = Place> + use<> {
        let [width, height] = self.depths.size();
        let [xs, ys] = [(tx, width), (ty, height)].map(|(t, side)| t * TILE..((t + 1) * TILE).min(side));
        ys.flat_map(move |y| xs.clone().map(move |x| [x, y]))
    }

    fn nearest(&self, at: Place) -> Option<f64> {
        self.pixels(at).filter_map(|[x, y]| self.depths.at(x, y)).reduce(f64::min)
    }

    /// Whether a depth is of the surface whose nearest point is `first`, in so many tiles across.
    fn is_of(&self, z: f64, first: f64, span: i64) -> bool {
        (z - first) * self.depths.px_per_unit(first) <= FRONT_PX * self.slack * span as f64
    }

    /// The nearest depth of a tile, if it is of this surface.
    fn front(&self, at: Place, first: f64) -> Option<f64> {
        self.nearest(at).filter(|z| self.is_of(*z, first, 1))
    }

    /// Whether a pixel shows what is nearest in its tile.
    fn shows(&self, [x, y]: Place, nearest: f64) -> bool {
        self.depths.at(x, y).is_some_and(|z| self.is_of(z, nearest, 1))
    }

    /// Pixels of a quarter that show this surface; where the picture ends within it, none.
    fn in_quarter(&self, quarter: Place, first: f64) -> usize {
        let tile = quarter.map(|q| q.div_euclid(2));
        let size = self.depths.size();
        let is_whole = [0, 1].into_iter().all(|axis| (quarter[axis] + 1) * TILE / 2 <= size[axis]);
        let Some(nearest) = self.front(tile, first).filter(|_| is_whole) else { return 0 };
        self.pixels(tile).filter(|pixel| pixel.map(|side| side / (TILE / 2)) == quarter && self.shows(*pixel, nearest)).count()
    }

    fn in_tile(&self, [tx, ty]: Place, first: f64) -> usize {
        [[0, 0], [1, 0], [0, 1], [1, 1]].into_iter().map(|[x, y]| self.in_quarter([2 * tx + x, 2 * ty + y], first)).sum()
    }

    /// How far apart the points of the nearest surface around a tile are, pixels; none where the tile does not hold it, or too few do.
    fn counted(&self, at: Place) -> Option<f64> {
        let first = self.around(at, 1).into_iter().filter_map(|tile| self.nearest(tile)).reduce(f64::min)?;
        self.front(at, first)?;
        let held = |quarter: Place| {
            let tile = self.within(quarter.map(|q| q.div_euclid(2)), 1);
            self.in_quarter([0, 1].map(|axis| 2 * tile[axis] + quarter[axis].rem_euclid(2)), first)
        };
        let quarters = (0..16).map(|k| [2 * at[0] - 1 + k % 4, 2 * at[1] - 1 + k / 4]);
        let inner: Vec<usize> = quarters.filter(|quarter| cross(*quarter).into_iter().all(|q| held(q) > 0)).map(held).collect();
        let beside = cross(at).map(|tile| self.within(tile, 1));
        let whole = beside.map(|tile| self.in_tile(tile, first));
        let share = |held: &[usize], area: i64| held.iter().sum::<usize>() as f64 / (held.len() as i64 * area) as f64;
        let by_area = match inner.is_empty() {
            false => Some(apart(share(&inner, TILE * TILE / 4))),
            true => (!whole.contains(&0)).then(|| apart(share(&whole, TILE * TILE))),
        };
        let same = beside.into_iter().filter(|tile| self.front(*tile, first).is_some());
        by_area.into_iter().chain(same.filter_map(|tile| self.gap(tile, 1))).reduce(f64::max)
    }

    /// Tiles of a block, so many across and down.
    fn tiles_of(&self, [bx, by]: Place, span: i64) -> impl Iterator<Item = Place> + use<> {
        let [across, down] = self.count();
        (0..span * span).map(move |k| [span * bx + k % span, span * by + k / span]).filter(move |[x, y]| *x < across && *y < down)
    }

    fn least_of(&self, block: Place, span: i64) -> Option<f64> {
        self.tiles_of(block, span).filter_map(|tile| self.nearest(tile)).reduce(f64::min)
    }

    /// Of a block's nearest surface: pixels, and how many times two of them lie side by side, or one above the other, in one tile.
    fn front_of(&self, block: Place, span: i64) -> [usize; 2] {
        let (Some(first), size) = (self.least_of(block, span), self.depths.size()) else { return [0; 2] };
        let of_tile = |tile: Place| {
            let nearest = self.nearest(tile).filter(|z| self.is_of(*z, first, span))?;
            let beside = |[x, y]: Place| [[x + 1, y], [x, y + 1]].into_iter();
            let is_own = |pixel: &Place| {
                pixel.map(|side| side / TILE) == tile && (0..2).all(|axis| pixel[axis] < size[axis]) && self.shows(*pixel, nearest)
            };
            let pairs = self.pixels(tile).filter(is_own).map(|pixel| beside(pixel).filter(is_own).count()).sum();
            Some([self.in_tile(tile, nearest), pairs])
        };
        self.tiles_of(block, span).filter_map(of_tile).fold([0, 0], |sum, own| [sum[0] + own[0], sum[1] + own[1]])
    }

    /// How far apart points of a block that lies within a surface are, pixels.
    fn gap(&self, block: Place, span: i64) -> Option<f64> {
        let around = self.around(block, span);
        let first = around.into_iter().filter_map(|block| self.least_of(block, span)).reduce(f64::min)?;
        let holds =
            |block: Place| self.least_of(block, span).is_some_and(|z| self.is_of(z, first, span)) && self.front_of(block, span)[0] > 0;
        if !around.into_iter().all(holds) {
            return None;
        }
        let [front, pairs] = self.front_of(block, span).map(|count| count as f64);
        let pairs_of_all = (2 * (TILE - 1)) as f64 / TILE as f64;
        Some(apart((front / (span * TILE * span * TILE) as f64).max(pairs / (pairs_of_all * front))))
    }

    /// From point to point, pixels: as counted, but no less than the node says, and not much more.
    fn spacing(&self, at: Place) -> f64 {
        let own = |tile: Place| self.nearest(tile).map(|z| self.spacing * self.depths.px_per_unit(z));
        let of_node = own(at).unwrap_or_else(|| self.around(at, 1).into_iter().filter_map(own).reduce(f64::max).unwrap_or(0.0));
        let counted = self.counted(at).into_iter().chain(self.gap(at.map(|side| side / 2), 2)).reduce(f64::max).unwrap_or(0.0);
        (SPARSER * counted).clamp(of_node, SPARSEST * of_node)
    }
}
