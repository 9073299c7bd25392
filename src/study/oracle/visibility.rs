//! The f64 twin of the visibility passes: depths in, in the kernels' own f32 bits; of every pixel the empty solid angle out, and what follows from it.
//!
//! papers/README.md (Pintus, visibility), word for word: points in the camera's space, the largest `v . c` of every sector, the sum of `2 pi / S (1 - max v . c)`.
//! The kernels' sum is within 2.1e-6 of that, relatively (HARD_CASES 7), and the threshold is rounded to f32, so that pixels within [`BAND`] of it may be decided either way.

use crate::passes::TILE_PX;
use crate::passes::visibility::{FRONT_PX, Kernel, SPARSER, SPARSEST, Settings, WIDTHS};
use crate::view::{Projection, View};
use glam::DVec3;
use std::f64::consts::TAU;

/// Of the sum (HARD_CASES 7).
pub const BAND: f64 = 4e-6;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    Visible,
    Invisible,
    /// Too near to the threshold to say.
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

    /// The point of a neighbour, if it holds one, at the middle of a pixel.
    fn neighbour(&self, x: i64, y: i64, step: i64) -> Option<DVec3> {
        let block = (0..step).flat_map(|dy| (0..step).map(move |dx| (dx, dy)));
        let nearest = block.filter_map(|(dx, dy)| self.at(x + dx, y + dy)).fold(f64::INFINITY, f64::min);
        nearest.is_finite().then(|| self.point(x, y, nearest))
    }

    /// In the camera's space: right, down, forward.
    fn point(&self, x: i64, y: i64, z: f64) -> DVec3 {
        let [width, height] = self.size();
        let f = self.view.focal_px() as f32 as f64;
        let across = DVec3::new((x as f64 + 0.5 - width as f64 / 2.0) / f, (y as f64 + 0.5 - height as f64 / 2.0) / f, 0.0);
        match self.view.camera.projection {
            Projection::Perspective => (across + DVec3::Z) * z,
            Projection::Orthographic => across + DVec3::Z * z,
        }
    }

    /// The empty solid angle of a pixel, steradians. One without a point lies beyond all neighbours: its cones are closed, or hemispheres.
    pub fn solid_angle(&self, [x, y]: [i64; 2], kernel: Kernel, sectors: usize) -> f64 {
        let own = self.at(x, y).map(|z| self.point(x, y, z));
        let mut most: Vec<Option<f64>> = vec![None; sectors];
        let [radius, span] = [kernel.radius, kernel.span].map(i64::from);
        for dy in -radius..=radius {
            for dx in -radius..=radius {
                let (dx, dy) = (dx * span, dy * span);
                if (dx, dy) == (0, 0) {
                    continue;
                }
                let Some(pi) = self.neighbour(x + dx, y + dy, span) else { continue };
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
        most.iter().map(|cos| TAU / sectors as f64 * (1.0 - cos.unwrap_or(0.0))).sum()
    }

    pub fn verdict(&self, at: [i64; 2], kernel: Kernel, settings: &Settings) -> Verdict {
        let sum = self.solid_angle(at, kernel, settings.sectors as usize);
        let needed = if self.at(at[0], at[1]).is_some() { settings.threshold } else { settings.holes };
        match sum - needed {
            apart if apart.abs() <= BAND * sum => Verdict::InBand,
            apart if apart >= 0.0 => Verdict::Visible,
            _ => Verdict::Invisible,
        }
    }

    /// Of every tile the kernel that the spacing of its points calls for: `spacing` metres, the same everywhere, or what is counted; none where rounding may choose another.
    pub fn kernels(&self, settings: &Settings, spacing: f64) -> Vec<Option<Kernel>> {
        let [width, height] = self.size();
        let tile = TILE_PX as i64;
        let [across, down] = [width, height].map(|side| (side + tile - 1) / tile);
        let pixels = |[tx, ty]: [i64; 2]| {
            let [xs, ys] = [(tx, width), (ty, height)].map(|(t, side)| t * tile..((t + 1) * tile).min(side));
            ys.flat_map(move |y| xs.clone().map(move |x| [x, y]))
        };
        let nearest = |at: [i64; 2]| pixels(at).filter_map(|[x, y]| self.at(x, y)).reduce(f64::min);
        let own = |at: [i64; 2]| nearest(at).map(|z| spacing * self.px_per_unit(z));
        let is_front = |z: f64, first: f64, slack: f64| (z - first) * self.px_per_unit(first) <= FRONT_PX * slack;
        // Beyond the edge, the tile at the edge once more.
        let around = |at: [i64; 2]| {
            let all = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| [dx, dy]));
            all.map(move |by| [(at[0] + by[0]).clamp(0, across - 1), (at[1] + by[1]).clamp(0, down - 1)])
        };
        let first_of = |at: [i64; 2]| around(at).filter_map(nearest).reduce(f64::min);
        // Whether a pixel shows what is nearest in its tile, if that is of the surface whose nearest point is `first`.
        let shows = |tile_at: [i64; 2], first: f64, slack: f64| {
            let least = nearest(tile_at).filter(|z| is_front(*z, first, slack));
            move |[x, y]: [i64; 2]| least.is_some_and(|least| self.at(x, y).is_some_and(|z| is_front(z, least, slack)))
        };
        // Quarters in which the picture ends hold none.
        let whole_quarter = |q: [i64; 2]| [(q[0], width), (q[1], height)].into_iter().all(|(q, side)| (q + 1) * tile / 2 <= side);
        let in_quarter = |q: [i64; 2], first: f64, slack: f64| {
            let tile_at = q.map(|q| q.div_euclid(2));
            let shows = shows(tile_at, first, slack);
            let own = pixels(tile_at).filter(|pixel| pixel.map(|side| side / (tile / 2)) == q && shows(*pixel));
            if whole_quarter(q) { own.count() } else { 0 }
        };
        let in_tile = |[tx, ty]: [i64; 2], first: f64, slack: f64| -> usize {
            [[0, 0], [1, 0], [0, 1], [1, 1]].into_iter().map(|[x, y]| in_quarter([2 * tx + x, 2 * ty + y], first, slack)).sum()
        };
        let apart = |share: f64| ((1.0 - share).max(0.0).sqrt() / share).sqrt();
        // Of a tile's nearest surface: pixels, and how many of two of them lie side by side or one above the other.
        let front_of = |at: [i64; 2], slack: f64| {
            let least = nearest(at).expect("it holds points");
            let shows = shows(at, least, slack);
            let within = |[x, y]: [i64; 2]| [x / tile, y / tile] == at && x < width && y < height;
            let pair = |[x, y]: [i64; 2]| [[x + 1, y], [x, y + 1]].into_iter().filter(|beside| within(*beside) && shows(*beside)).count();
            [in_tile(at, least, slack), pixels(at).filter(|pixel| shows(*pixel)).map(pair).sum()]
        };
        // Of a block of tiles that lies within a surface, so many across and down, by its own points.
        let gap = |at: [i64; 2], span: i64, slack: f64| {
            let of_surface = |z: f64, first: f64| is_front(z, first, slack * span as f64);
            let tiles_of = |[bx, by]: [i64; 2]| {
                (0..span * span).map(move |k| [span * bx + k % span, span * by + k / span]).filter(|[x, y]| *x < across && *y < down)
            };
            let least_of = |block: [i64; 2]| tiles_of(block).filter_map(nearest).reduce(f64::min);
            let front_of = |block: [i64; 2]| {
                let least = least_of(block);
                let same = tiles_of(block).filter(|tile_at| nearest(*tile_at).zip(least).is_some_and(|(z, least)| of_surface(z, least)));
                same.map(|tile_at| front_of(tile_at, slack)).fold([0, 0], |sum, own| [sum[0] + own[0], sum[1] + own[1]])
            };
            let last = [across, down].map(|tiles| (tiles - 1) / span);
            let around = (0..9).map(|k| [(at[0] + k % 3 - 1).clamp(0, last[0]), (at[1] + k / 3 - 1).clamp(0, last[1])]);
            let first = around.clone().filter_map(least_of).reduce(f64::min)?;
            if !around.clone().all(|block| least_of(block).is_some_and(|z| of_surface(z, first)) && front_of(block)[0] > 0) {
                return None;
            }
            let [front, pairs] = front_of(at).map(|count| count as f64);
            let most = (2 * (tile - 1)) as f64 / tile as f64;
            Some(apart((front / (span * tile * span * tile) as f64).max(pairs / (most * front))))
        };
        let kernel = |i: i64| {
            let at = [i % across, i / across];
            let counted = |slack: f64| {
                let first = first_of(at)?;
                nearest(at).filter(|z| is_front(*z, first, slack))?;
                let held = |q: [i64; 2]| {
                    // Beyond the edge, the tile at the edge once more.
                    let tile_at = [(q[0].div_euclid(2), across), (q[1].div_euclid(2), down)].map(|(t, most)| t.clamp(0, most - 1));
                    in_quarter([2 * tile_at[0] + q[0].rem_euclid(2), 2 * tile_at[1] + q[1].rem_euclid(2)], first, slack)
                };
                let mut areas = Vec::new();
                let quarters = (0..4).flat_map(|y| (0..4).map(move |x| [x, y])).map(|[x, y]| [2 * at[0] - 1 + x, 2 * at[1] - 1 + y]);
                let inner = quarters
                    .filter(|[x, y]| [[*x, *y], [x - 1, *y], [x + 1, *y], [*x, y - 1], [*x, y + 1]].into_iter().all(|q| held(q) > 0));
                let inner: Vec<usize> = inner.map(held).collect();
                let beside: Vec<[i64; 2]> =
                    around(at).enumerate().filter(|(k, _)| k % 2 == 1 || *k == 4).map(|(_, tile_at)| tile_at).collect();
                let whole: Vec<usize> = beside.iter().map(|tile_at| in_tile(*tile_at, first, slack)).collect();
                if !inner.is_empty() {
                    areas.push(apart(inner.iter().sum::<usize>() as f64 / (inner.len() as i64 * tile * tile / 4) as f64));
                } else if !whole.contains(&0) {
                    areas.push(apart(whole.iter().sum::<usize>() as f64 / (5 * tile * tile) as f64));
                }
                let same = beside.iter().filter(|tile_at| nearest(**tile_at).is_some_and(|z| is_front(z, first, slack)));
                areas.extend(same.filter_map(|tile_at| gap(*tile_at, 1, slack)));
                areas.into_iter().reduce(f64::max)
            };
            let spacing = |slack: f64| {
                let counted = counted(slack).into_iter().chain(gap(at.map(|side| side / 2), 2, slack)).reduce(f64::max).unwrap_or(0.0);
                let of_node = own(at).unwrap_or_else(|| around(at).filter_map(own).reduce(f64::max).unwrap_or(0.0));
                (SPARSER * counted).clamp(of_node, SPARSEST * of_node)
            };
            // Either rounding may go either way.
            let slacks = [1.0 - BAND, 1.0 + BAND];
            let [first, others @ ..] = [0, 1, 2, 3].map(|i| of_extent(spacing(slacks[i / 2]) * settings.reach * slacks[i % 2]));
            (others == [first; 3]).then(|| Kernel::of_width(first))
        };
        (0..across * down).map(kernel).collect()
    }

    /// Pixels that a metre across is wide at a depth.
    fn px_per_unit(&self, z: f64) -> f64 {
        match self.view.camera.projection {
            Projection::Perspective => self.view.focal_px() / z,
            Projection::Orthographic => self.view.focal_px(),
        }
    }
}

/// The least kernel that is so many pixels wide, or the widest.
fn of_extent(pixels: f64) -> u32 {
    WIDTHS.into_iter().find(|&width| width as f64 >= pixels).unwrap_or(WIDTHS[WIDTHS.len() - 1])
}

/// Beyond the edge the picture is seen as in a mirror, which stands in the middle of the last pixel, and which ends where the picture does.
fn mirrored(x: i64, side: i64) -> i64 {
    let x = if x < 0 { -x } else { x };
    let x = if x > side - 1 { 2 * (side - 1) - x } else { x };
    x.clamp(0, side - 1)
}

/// 4, 8 or 16 sectors of a full turn, each with its first border; in integers. Turned by quarters until it lies in the first one, an offset is beyond an eighth of a turn where y >= x, and beyond a
/// sixteenth where y / x >= sqrt(2) - 1, which no fraction equals.
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

    /// No offset of a kernel lies within rounding of a border but those on the axes and diagonals, which f64 has exactly as eighths of a turn.
    #[test]
    fn sectors_are_those_of_the_angle() {
        for (x, y) in (-31..=31).flat_map(|y| (-31..=31).map(move |x| (x, y))).filter(|at| *at != (0, 0)) {
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
