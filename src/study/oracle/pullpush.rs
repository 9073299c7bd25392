//! The f64 twin of pull-push filling: from depths in the kernels' own f32 bits to filled depths
//! (glsl/fill/fill_pull.comp, fill_push.comp, fill_spread.comp, fill_correct.comp).
//!
//! Depths are averaged once a level, each time a few roundings off, so that a filled depth is
//! within [`BAND`] of the kernels'. Which cells are of one surface, and which place is the nearest,
//! is compared: where two are equal within that, either may win in f32, and all that follows from
//! it is unsure.

use crate::passes::fill::Settings;
use crate::view::{Projection, View};

/// Relative error of a depth: some roundings of f32.
pub const BAND: f64 = 2e-6;
/// Largest depth difference on one surface [cells of a level].
const MIXED_CELLS: f64 = 8.0;
/// Weights of a corner and a side of 3 x 3 cells, and of the middle.
const CORNER: f64 = 0.292_893_219;
const SIDE: f64 = 0.5;
const OWN: f64 = 0.2;

/// A pixel to fill from, or a filled one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    pub depth: Option<f64>,
    /// True if the kernels certainly have the same, within [`BAND`].
    pub sure: bool,
}

/// A cell before filling.
#[derive(Clone, Copy, Debug)]
struct Cell {
    depth: Option<f64>,
    /// The place of its points from its middle [cells].
    place: [f64; 2],
    /// Number of pixels of its surface.
    pixels: f64,
    sure: bool,
}

/// A filled cell, with the nearest known place.
#[derive(Clone, Copy, Debug)]
struct Filled {
    depth: Option<f64>,
    place: [f64; 2],
    /// Its own value, before filling.
    own: bool,
    /// How far its value lies from the mean it would take without one.
    missed: Option<f64>,
    sure: bool,
}

const NOTHING: Cell = Cell { depth: None, place: [0.0; 2], pixels: 0.0, sure: true };
const UNFILLED: Filled =
    Filled { depth: None, place: [0.0; 2], own: false, missed: None, sure: true };

struct Level<T> {
    size: [i64; 2],
    cells: Vec<T>,
}

impl<T: Copy> Level<T> {
    fn at(&self, [x, y]: [i64; 2]) -> Option<T> {
        let inside = (0..self.size[0]).contains(&x) && (0..self.size[1]).contains(&y);
        inside.then(|| self.cells[(y * self.size[0] + x) as usize])
    }

    fn map<U>(size: [i64; 2], cell: impl Fn([i64; 2]) -> U) -> Level<U> {
        let cells = (0..size[0] * size[1]).map(|i| cell([i % size[0], i / size[0]])).collect();
        Level { size, cells }
    }
}

/// Fills a picture, all of it or only the pixels in `unknown`.
pub fn fill(
    view: &View,
    settings: &Settings,
    depth: &[f32],
    unknown: Option<&[bool]>,
) -> Vec<Pixel> {
    let twin = Twin { view, settings, unknown };
    let size = view.size.map(i64::from);
    let picture = Level::<Cell>::map(size, |[x, y]| {
        let z = depth[(y * size[0] + x) as usize];
        let has = z.is_finite() && z > 0.0;
        if has { Cell { depth: Some(z as f64), pixels: 1.0, ..NOTHING } } else { NOTHING }
    });
    let mut levels = vec![picture];
    while levels.len() < settings.levels as usize && levels[levels.len() - 1].size != [1, 1] {
        levels.push(twin.pull(&levels[levels.len() - 1], levels.len() as i32));
    }
    let coarsest = levels.pop().expect("a picture");
    let mut filled = Level::<Cell>::map(coarsest.size, |at| {
        let Cell { depth, place, sure, .. } = coarsest.at(at).expect("inside");
        Filled { depth, place, own: depth.is_some(), missed: None, sure }
    });
    while let Some(level) = levels.pop() {
        let number = levels.len() as i32;
        let pushed = Level::<Cell>::map(level.size, |at| twin.push(&filled, &level, at, number));
        filled = twin.corrected(&pushed, number);
    }
    filled.cells.iter().map(|cell| Pixel { depth: cell.depth, sure: cell.sure }).collect()
}

struct Twin<'t> {
    view: &'t View,
    settings: &'t Settings,
    unknown: Option<&'t [bool]>,
}

impl Twin<'_> {
    fn perspective(&self) -> bool {
        self.view.camera.projection == Projection::Perspective
    }

    fn tolerance(&self, level: i32, z: f64) -> f64 {
        let automatic = MIXED_CELLS * 2f64.powi(level) / self.view.focal_px();
        match self.settings.tolerance {
            0.0 if self.perspective() => automatic * z,
            0.0 => automatic,
            metres => metres,
        }
    }

    /// Returns whether two depths are of one surface, and whether that is sure.
    fn alike(&self, level: i32, z: f64, other: f64) -> (bool, bool) {
        let tolerance = self.tolerance(level, z);
        let apart = (other - z).abs();
        (apart <= tolerance, (apart - tolerance).abs() > BAND * z)
    }

    /// Returns a mean of depths with weights; with perspective, of inverse depths.
    fn mean(&self, depths: &[(f64, f64)]) -> f64 {
        let weights: f64 = depths.iter().map(|(_, weight)| weight).sum();
        let sum = |value: fn(f64) -> f64| -> f64 {
            depths.iter().map(|(z, weight)| weight * value(*z)).sum()
        };
        if self.perspective() { weights / sum(|z| 1.0 / z) } else { sum(|z| z) / weights }
    }

    /// Returns the next coarser level: of 2 x 2 cells those of the surface of most pixels.
    fn pull(&self, fine: &Level<Cell>, number: i32) -> Level<Cell> {
        let size = fine.size.map(|side| (side + 1) / 2);
        Level::<Cell>::map(size, |[x, y]| {
            let four: Vec<([f64; 2], Cell)> = [[0, 0], [1, 0], [0, 1], [1, 1]]
                .into_iter()
                .filter_map(|[dx, dy]| {
                    let cell = fine.at([2 * x + dx, 2 * y + dy])?;
                    Some(([dx as f64 - 0.5, dy as f64 - 0.5], cell))
                })
                .collect();
            let mut sure = four.iter().all(|(_, cell)| cell.sure);
            let valued: Vec<([f64; 2], Cell, f64)> =
                four.into_iter().filter_map(|(at, cell)| Some((at, cell, cell.depth?))).collect();
            let mut best: Option<(f64, f64)> = None;
            for (_, _, z) in &valued {
                let pixels = valued.iter().filter(|(_, _, other)| {
                    let (alike, surely) = self.alike(number, *z, *other);
                    sure &= surely;
                    alike
                });
                let pixels: f64 = pixels.map(|(_, cell, _)| cell.pixels).sum();
                if best.is_none_or(|(most, like)| pixels > most || pixels == most && *z < like) {
                    best = Some((pixels, *z));
                }
            }
            let Some((pixels, like)) = best else { return Cell { sure, ..NOTHING } };
            let own: Vec<_> =
                valued.iter().filter(|(_, _, z)| self.alike(number, like, *z).0).collect();
            let depths: Vec<(f64, f64)> = own.iter().map(|(_, _, z)| (*z, 1.0)).collect();
            let place = [0, 1].map(|axis| {
                own.iter().map(|(at, cell, _)| 0.5 * (cell.place[axis] + at[axis])).sum::<f64>()
                    / own.len() as f64
            });
            Cell { depth: Some(self.mean(&depths)), place, pixels, sure }
        })
    }

    /// Returns the limited slope of a coarse level along an axis, in shares of inverse depth with
    /// perspective, and whether it is sure.
    fn slope(&self, coarse: &Level<Filled>, at: [i64; 2], axis: usize, level: i32) -> (f64, bool) {
        let z = coarse.at(at).and_then(|cell| cell.depth).expect("a value");
        let mut sure = true;
        let mut difference = |by: i64| {
            let mut beside = at;
            beside[axis] += by;
            let other = coarse.at(beside)?;
            sure &= other.sure;
            let other = other.depth?;
            let (alike, surely) = self.alike(level, z, other);
            sure &= surely;
            let rise = if self.perspective() { z / other - 1.0 } else { other - z };
            // With perspective the kernel's fall is relative to the other depth's inverse, too.
            alike.then_some(if by < 0 { -rise } else { rise })
        };
        let slope = match (difference(-1), difference(1)) {
            (Some(fall), Some(rise)) if fall * rise > 0.0 => 2.0 * fall * rise / (fall + rise),
            (Some(_), Some(_)) | (None, None) => 0.0,
            (Some(one), None) | (None, Some(one)) => one,
        };
        (slope, sure)
    }

    /// Returns a value carried to the middle of its cell.
    fn in_middle(
        &self,
        coarse: &Level<Filled>,
        parent: [i64; 2],
        cell: &Cell,
        own: f64,
        level: i32,
    ) -> (f64, bool) {
        let Some(z) = coarse.at(parent).and_then(|cell| cell.depth) else { return (own, true) };
        let [(along, sure_along), (down, sure_down)] =
            [0, 1].map(|axis| self.slope(coarse, parent, axis, level));
        let away = 0.5 * (along * cell.place[0] + down * cell.place[1]);
        let ratio = 1.0 - away * (own / z);
        let carried = match self.perspective() {
            true if ratio > 0.5 && ratio < 2.0 => own / ratio,
            true => own,
            false => own - away,
        };
        (carried, sure_along && sure_down)
    }

    /// Fills a cell of a level from the next coarser one.
    fn push(
        &self,
        coarse: &Level<Filled>,
        level: &Level<Cell>,
        at: [i64; 2],
        number: i32,
    ) -> Filled {
        let picture = number == 0;
        let cell = level.at(at).expect("inside");
        let parent = at.map(|x| x / 2);
        let mut sure = cell.sure;
        // The nearest known place: squared distance, depth, place and pixels.
        let mut nearest: Option<(f64, f64, [f64; 2], f64)> =
            cell.depth.map(|z| (0.0, z, cell.place, cell.pixels));
        let mut solid = 0;
        if cell.depth.is_none() {
            for [dx, dy] in around() {
                let beside = [at[0] + dx, at[1] + dy];
                let Some(found) = level.at(beside) else { continue };
                sure &= found.sure;
                solid += (found.depth.is_some() || picture && self.is_unknown(beside)) as i64;
                let Some(z) = found.depth else { continue };
                let to = [dx as f64 + found.place[0], dy as f64 + found.place[1]];
                let square = to[0] * to[0] + to[1] * to[1];
                if let Some((before, other, ..)) = nearest {
                    sure &= other == z || is_clear(square, before);
                }
                if nearest.is_none_or(|(before, ..)| square < before) {
                    nearest = Some((square, z, to, found.pixels));
                }
            }
        }
        let has_own = cell.depth.is_some();
        let mut filling = !has_own
            && (!picture
                || self.unknown.is_none()
                || self.is_unknown(at)
                || solid >= self.settings.surrounded as i64);
        if picture && has_own {
            let depth = cell.depth;
            let missed = self.missed(coarse, at, number, depth, depth, &mut sure);
            return Filled { depth, place: [0.0; 2], own: true, missed, sure };
        }
        if picture && !filling {
            return Filled { sure, ..UNFILLED };
        }
        let mut z = cell.depth;
        if let Some(own) = z {
            let (carried, surely) = self.in_middle(coarse, parent, &cell, own, number + 1);
            (z, sure) = (Some(carried), sure && surely);
        }
        // The nearest place of the four coarser cells, and their farthest surface.
        let four = four_around(at);
        let mut coarse_nearest: Option<(f64, f64, [f64; 2])> = None;
        let mut farthest: Option<f64> = None;
        for (beside, _) in four {
            let Some(found) = coarse.at(beside) else { continue };
            sure &= found.sure;
            let Some(depth) = found.depth else { continue };
            let to = [0, 1].map(|axis| {
                2.0 * (beside[axis] as f64 + 0.5 + found.place[axis]) - (at[axis] as f64 + 0.5)
            });
            let square = to[0] * to[0] + to[1] * to[1];
            if nearest.is_none()
                && let Some((before, other, _)) = coarse_nearest
            {
                sure &= other == depth || is_clear(square, before);
            }
            if coarse_nearest.is_none_or(|(before, ..)| square < before) {
                coarse_nearest = Some((square, depth, to));
            }
            farthest = Some(farthest.map_or(depth, |before| before.max(depth)));
        }
        let hidden = !picture
            && nearest.zip(farthest).is_some_and(|((_, like, _, pixels), farthest)| {
                let beyond = like - self.tolerance(number + 1, like) - farthest;
                sure &= pixels != 1.0 || beyond.abs() > BAND * like;
                pixels == 1.0 && beyond > 0.0
            });
        filling |= hidden;
        let (like, place) = match (nearest, coarse_nearest) {
            (Some((_, like, place, _)), _) if !hidden => (Some(like), place),
            (_, Some((_, like, place))) => (Some(like), place),
            _ => (None, [0.0; 2]),
        };
        let missed = match has_own && !hidden {
            true => self.missed(coarse, at, number, like, z, &mut sure),
            false => None,
        };
        if filling {
            z = like.map(|like| {
                self.mean_of_coarse(coarse, at, number, like, &mut sure).unwrap_or(like)
            });
        }
        Filled { depth: z, place, own: has_own && !hidden, missed, sure }
    }

    fn is_unknown(&self, [x, y]: [i64; 2]) -> bool {
        self.unknown.is_some_and(|unknown| unknown[(y * self.view.size[0] as i64 + x) as usize])
    }

    /// Returns the bilinear mean of those of the four coarser cells that are of a surface.
    fn mean_of_coarse(
        &self,
        coarse: &Level<Filled>,
        at: [i64; 2],
        number: i32,
        like: f64,
        sure: &mut bool,
    ) -> Option<f64> {
        let mut depths = Vec::new();
        for (beside, weight) in four_around(at) {
            let Some(found) = coarse.at(beside) else { continue };
            *sure &= found.sure;
            let Some(depth) = found.depth else { continue };
            let (alike, surely) = self.alike(number + 1, like, depth);
            *sure &= surely;
            if alike {
                depths.push((depth, weight));
            }
        }
        (!depths.is_empty()).then(|| self.mean(&depths))
    }

    /// Returns how far a value lies from the mean that it would take without.
    fn missed(
        &self,
        coarse: &Level<Filled>,
        at: [i64; 2],
        number: i32,
        like: Option<f64>,
        z: Option<f64>,
        sure: &mut bool,
    ) -> Option<f64> {
        let mean = self.mean_of_coarse(coarse, at, number, like?, sure)?;
        let z = z?;
        Some(if self.perspective() { mean / z - 1.0 } else { z - mean })
    }

    /// Moves cells without a value by what their neighbours have missed.
    fn corrected(&self, pushed: &Level<Filled>, number: i32) -> Level<Filled> {
        let near =
            |own: &Filled, at: [i64; 2], value: &dyn Fn([i64; 2], &Filled) -> Option<f64>| {
                let (mut weights, mut sum, mut sure) = (0.0, 0.0, own.sure);
                let Some(z) = own.depth else { return (0.0, 0.0, sure) };
                for [dx, dy] in around() {
                    let beside = [at[0] + dx, at[1] + dy];
                    let Some(found) = pushed.at(beside) else { continue };
                    sure &= found.sure;
                    let (Some(depth), Some(value)) = (found.depth, value(beside, &found)) else {
                        continue;
                    };
                    let lateral = if dx != 0 && dy != 0 { CORNER } else { SIDE };
                    let weight =
                        lateral * (1.0 - ((depth - z).abs() / self.tolerance(number, z)).min(1.0));
                    (weights, sum) = (weights + weight, sum + weight * value);
                }
                (weights, sum, sure)
            };
        let spread = Level::<Filled>::map(pushed.size, |at| {
            let own = pushed.at(at).expect("inside");
            let (weights, sum, sure) = near(&own, at, &|_, found| found.missed);
            let mean = if weights > 0.0 { sum / weights } else { 0.0 };
            (own.missed.unwrap_or(mean), sure || own.missed.is_some() && own.sure)
        });
        Level::<Filled>::map(pushed.size, |at| {
            let own = pushed.at(at).expect("inside");
            let (Some(z), false) = (own.depth, own.own) else { return own };
            let of = |at| spread.at(at).expect("inside");
            let (weights, sum, sure) = near(&own, at, &|beside, _| Some(of(beside).0));
            let all = around().filter_map(|[dx, dy]| spread.at([at[0] + dx, at[1] + dy]));
            let sure = sure && of(at).1 && all.into_iter().all(|(_, sure)| sure);
            let by = (OWN * of(at).0 + sum) / (OWN + weights);
            let depth = if self.perspective() { z / (1.0 + by) } else { z + by };
            Filled { depth: Some(depth), sure, ..own }
        })
    }
}

/// Tests whether the kernels find the same of two squared distances nearer. Most are sums of powers
/// of two, which are exact: of equals the first is taken, there and here.
fn is_clear(a: f64, b: f64) -> bool {
    a == b || (a - b).abs() > BAND * a.max(b)
}

/// Returns the offsets of the eight cells around one, row by row.
fn around() -> impl Iterator<Item = [i64; 2]> {
    (0..9).filter(|k| *k != 4).map(|k| [k % 3 - 1, k / 3 - 1])
}

/// Returns the four coarser cells around a cell, and their bilinear weights.
fn four_around(at: [i64; 2]) -> [([i64; 2], f64); 4] {
    let toward = at.map(|x| 2 * (x % 2) - 1);
    [([0, 0], 9.0), ([1, 0], 3.0), ([0, 1], 3.0), ([1, 1], 1.0)].map(|([dx, dy], weight)| {
        ([at[0] / 2 + dx * toward[0], at[1] / 2 + dy * toward[1]], weight)
    })
}
