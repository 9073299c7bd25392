//! The f64 twin of visibility on a pyramid: from depths in the kernels' own f32 bits to a verdict
//! per pixel: visible, hidden, or a hole.
//!
//! The rule is that of glsl/visibility/visibility_levels.comp, level by level, two rounds for
//! points and one for empty pixels. Where f32 may decide either way, everything that depends on it
//! is [`Verdict::InBand`].

use super::visibility::{Verdict, sector};
use crate::passes::visibility::{
    SPARSEST, STEEPEST, Settings, fewest_around_openings, least_density, reach,
};
use crate::view::{Projection, View};
use std::f64::consts::{PI, TAU};

/// Relative error of every comparison: a dozen roundings of f32.
const BAND: f64 = 4e-6;
const SECTORS: usize = 8;
const MOST_SHARE: f64 = 0.93;
/// How much higher a density may be than 2 x 2 cells at an edge say.
const AT_EDGE: f64 = 4.0;

/// A pixel, or the nearest point of a cell.
#[derive(Clone, Copy, Debug)]
struct Cell {
    /// Depth and position `[px]`.
    point: Option<(f64, [f64; 2])>,
    /// Number of pixels with a point.
    points: u32,
    /// Number of those whose point is of the nearest surface.
    front: u32,
    /// True if the kernels certainly have the same.
    sure: bool,
}

struct Level {
    size: [i64; 2],
    cells: Vec<Cell>,
}

impl Level {
    fn at(&self, x: i64, y: i64) -> Cell {
        self.cells[(y * self.size[0] + x) as usize]
    }

    /// Returns the next coarser level, whose number is `number`. Depths are compared as the kernel
    /// does, in f32.
    fn coarser(&self, view: &View, number: usize) -> Level {
        let reach = reach(view, number);
        let farthest = |nearest: f64| match view.camera.projection {
            Projection::Perspective => nearest as f32 * reach,
            Projection::Orthographic => nearest as f32 + reach,
        };
        let size = self.size.map(|side| (side + 1) / 2);
        let cell = |i: i64| {
            let (x, y) = (i % size[0], i / size[0]);
            let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| (2 * x + dx, 2 * y + dy));
            let inside = four
                .into_iter()
                .filter(|&(x, y)| x < self.size[0] && y < self.size[1])
                .map(|(x, y)| self.at(x, y));
            let none = Cell { point: None, points: 0, front: 0, sure: true };
            let mut nearest = inside.clone().fold(none, |nearest, cell| {
                let nearer = match (nearest.point, cell.point) {
                    (Some((a, _)), Some((b, _))) => b < a,
                    (before, after) => before.is_none() && after.is_some(),
                };
                Cell {
                    point: if nearer { cell.point } else { nearest.point },
                    points: nearest.points + cell.points,
                    front: 0,
                    sure: nearest.sure && cell.sure,
                }
            });
            let of_nearest = |cell: &Cell| match (nearest.point, cell.point) {
                (Some((least, _)), Some((z, _))) => z as f32 <= farthest(least),
                _ => false,
            };
            nearest.front = inside.filter(of_nearest).map(|cell| cell.front).sum();
            nearest
        };
        Level { size, cells: (0..size[0] * size[1]).map(cell).collect() }
    }
}

/// The verdict of a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Said {
    TooFew,
    Undecided,
    Open,
    Closed,
    Either,
}

/// The pixels to judge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Subject {
    Points,
    Empty,
}

/// Returns the verdicts of all pixels, row by row, for points with this spacing `[m]`. `crossed`
/// has the edges beyond which surfaces continue: left, right, upper, lower.
pub fn verdicts(
    view: &View,
    settings: &Settings,
    spacing_m: f64,
    crossed: [bool; 4],
    depth: &[f32],
) -> Vec<Verdict> {
    let size = view.size.map(i64::from);
    let place = |i: usize| [(i as i64 % size[0]) as f64 + 0.5, (i as i64 / size[0]) as f64 + 0.5];
    let cell = |(i, z): (usize, &f32)| Cell {
        point: z.is_finite().then(|| (*z as f64, place(i))),
        points: z.is_finite() as u32,
        front: z.is_finite() as u32,
        sure: true,
    };
    let mut picture: Vec<Cell> = depth.iter().enumerate().map(cell).collect();
    let spacings = Spacings::of(view, spacing_m, depth);
    let projected = Pyramid::of(view, crossed, picture.clone(), settings);
    let mut verdicts = vec![Verdict::Visible; depth.len()];
    // Pixels without leading points at first are not judged again.
    let mut candidates = vec![true; depth.len()];
    for _ in 0..2 {
        let pyramid = Pyramid::of(view, crossed, picture.clone(), settings);
        for i in (0..depth.len())
            .filter(|&i| picture[i].point.is_some() && std::mem::take(&mut candidates[i]))
            .collect::<Vec<_>>()
        {
            let (said, led) = pyramid.judge_point(view, settings, &spacings, i);
            candidates[i] = led;
            match said {
                Said::Closed => {
                    (verdicts[i], picture[i]) =
                        (Verdict::Invisible, Cell { point: None, points: 0, front: 0, sure: true })
                }
                Said::Either => {
                    let unsure = Cell { point: None, points: 0, front: 0, sure: false };
                    (verdicts[i], picture[i]) = (Verdict::InBand, unsure)
                }
                _ => {}
            }
        }
    }
    // A hidden point still covers its pixel.
    let empty = (0..depth.len()).map(|i| match depth[i].is_finite() {
        true => None,
        false => Some(projected.judge_empty(view, settings, i)),
    });
    let empty: Vec<_> = empty.collect();
    for i in (0..depth.len()).filter(|&i| !depth[i].is_finite()) {
        verdicts[i] = match vote(&empty, size, i) {
            Said::Closed => Verdict::Invisible,
            Said::Either => Verdict::InBand,
            _ => Verdict::Visible,
        };
    }
    verdicts
}

/// Returns the side of the squares of empty pixels that a level judges [px].
fn across(level: usize) -> i64 {
    if level > 0 { ((1i64 << level) / 2).clamp(2, 8) } else { 1 }
}

/// Returns the verdict of the majority around an empty pixel, within three quarters of the side of
/// its square. `said` has verdicts and the levels that decided; None for pixels with a point.
fn vote(said: &[Option<(Said, usize)>], size: [i64; 2], i: usize) -> Said {
    let Some((own, level)) = said[i] else { return Said::TooFew };
    if level == 0 || own == Said::Either {
        return own;
    }
    let (x, y) = (i as i64 % size[0], i as i64 / size[0]);
    let reach = 3 * across(level) / 4;
    let range = |at: i64, end: i64| (at - reach).max(0)..=(at + reach).min(end - 1);
    // How many more vote against it than for it, at least and at most.
    let (mut least, mut most) = (0, 0);
    for y in range(y, size[1]) {
        for x in range(x, size[0]) {
            match said[(y * size[0] + x) as usize] {
                None | Some((Said::Closed, 0)) => {}
                Some((Said::Either, _)) => (least, most) = (least - 1, most + 1),
                Some((verdict, _)) => {
                    let agrees = (verdict == Said::Closed) == (own == Said::Closed);
                    let against = if agrees { -1 } else { 1 };
                    (least, most) = (least + against, most + against);
                }
            }
        }
    }
    let other = if own == Said::Closed { Said::Open } else { Said::Closed };
    match (least > 0, most > 0) {
        (true, _) => other,
        (false, true) => Said::Either,
        (false, false) => own,
    }
}

const TILE: usize = 8;

/// Spacings of a tile `[px]`: that of its nearest point's node, or if empty the widest around it; 0
/// if all are empty.
struct Spacings {
    across: [usize; 2],
    around: Vec<f64>,
}

impl Spacings {
    /// Computes the spacings for points with this spacing `[m]`.
    fn of(view: &View, spacing_m: f64, depth: &[f32]) -> Spacings {
        let [width, height] = view.size.map(|side| side as usize);
        let across = [width, height].map(|side| side.div_ceil(TILE));
        let spacing = |tile: [usize; 2]| {
            let rows = TILE * tile[1]..(TILE * (tile[1] + 1)).min(height);
            let pixels = rows.flat_map(|y| {
                (TILE * tile[0]..(TILE * (tile[0] + 1)).min(width)).map(move |x| y * width + x)
            });
            let nearest = pixels.map(|i| depth[i]).fold(f32::INFINITY, f32::min);
            let scale = if view.camera.projection == Projection::Perspective {
                nearest as f64
            } else {
                1.0
            };
            if nearest.is_finite() { spacing_m * view.focal_px() / scale } else { 0.0 }
        };
        let own: Vec<f64> =
            (0..across[0] * across[1]).map(|i| spacing([i % across[0], i / across[0]])).collect();
        let widest = |i: usize| {
            let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))).map(
                |(dx, dy): (i64, i64)| {
                    let [x, y] = [
                        ((i % across[0]) as i64 + dx, across[0]),
                        ((i / across[0]) as i64 + dy, across[1]),
                    ]
                    .map(|(at, side)| at.clamp(0, side as i64 - 1) as usize);
                    own[y * across[0] + x]
                },
            );
            if own[i] > 0.0 { own[i] } else { around.fold(0.0, f64::max) }
        };
        let around = (0..own.len()).map(widest).collect();
        Spacings { across, around }
    }

    /// Tests whether a level judges a point: if it is as dense as a surface.
    fn let_judge(&self, [x, y]: [i64; 2], number: usize) -> bool {
        let tile = y as usize / TILE * self.across[0] + x as usize / TILE;
        number == 0 || (1u64 << number) as f64 <= SPARSEST * self.around[tile]
    }
}

/// Returns the number of leading points that close a pixel: each closes at most one sector.
fn fewest(closed: f64) -> usize {
    ((SECTORS as f64 - closed).floor() + 1.0).clamp(1.0, SECTORS as f64) as usize
}

/// Levels, and one beyond the coarsest, which has densities.
struct Pyramid {
    levels: Vec<Level>,
    crossed: [bool; 4],
}

impl Pyramid {
    fn of(view: &View, crossed: [bool; 4], cells: Vec<Cell>, settings: &Settings) -> Pyramid {
        let mut levels = vec![Level { size: view.size.map(i64::from), cells }];
        while levels.len() <= settings.levels as usize {
            levels.push(levels[levels.len() - 1].coarser(view, levels.len()));
        }
        Pyramid { levels, crossed }
    }

    /// Returns the verdict of the first level that decides on a point, and whether enough points
    /// lead to judge again.
    fn judge_point(
        &self,
        view: &View,
        settings: &Settings,
        spacings: &Spacings,
        i: usize,
    ) -> (Said, bool) {
        let width = view.size[0] as i64;
        let pixel = [i as i64 % width, i as i64 / width];
        let mut led = false;
        let may = |&number: &usize| spacings.let_judge(pixel, number);
        for level in (0..self.levels.len() - 1).filter(may) {
            let said = self.at_level(view, settings, pixel, level, Subject::Points);
            led |= said != Said::TooFew;
            if said != Said::TooFew && said != Said::Undecided {
                return (said, led);
            }
        }
        (Said::Undecided, led)
    }

    /// Returns the verdict of the first level that decides on a pixel without a point, and the
    /// level.
    fn judge_empty(&self, view: &View, settings: &Settings, i: usize) -> (Said, usize) {
        let width = view.size[0] as i64;
        let pixel = [i as i64 % width, i as i64 / width];
        (0..self.levels.len() - 1)
            .map(|level| (self.at_level(view, settings, pixel, level, Subject::Empty), level))
            .find(|(said, _)| !matches!(said, Said::TooFew | Said::Undecided))
            .unwrap_or((Said::Undecided, self.levels.len() - 2))
    }

    fn at_level(
        &self,
        view: &View,
        settings: &Settings,
        [x, y]: [i64; 2],
        number: usize,
        subject: Subject,
    ) -> Said {
        let level = &self.levels[number];
        let own = self.levels[0].at(x, y).point;
        // Coarser levels judge empty pixels by squares of half a cell, at most a tile, from the
        // middle.
        let across = if subject == Subject::Empty { across(number) } else { 1 };
        let [x, y] = [x, y].map(|at| at / across * across);
        let at = [x, y].map(|at| at as f64 + across as f64 / 2.0);
        let perspective = view.camera.projection == Projection::Perspective;
        let f = view.focal_px() as f32 as f64;
        let ray = [0, 1].map(|axis| (at[axis] - view.size[axis] as f64 / 2.0) / f);
        let (side, radius) = (1i64 << number, settings.kernel as i64 / 2);
        let rim = (radius as f64 + 0.5) * side as f64;
        let (mut most, mut nearest) = ([None::<f64>; SECTORS], [rim; SECTORS]);
        // Squared distances of the nearest, their cells, and pixels of the nearest surface there.
        let mut closest: [Option<(f64, [i64; 2], u32)>; SECTORS] = [None; SECTORS];
        let mut leads = std::collections::HashSet::new();
        for (dx, dy) in (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| (dx, dy)))
        {
            if number == 0 && (dx, dy) == (0, 0) {
                continue;
            }
            let cell = [x / side + dx, y / side + dy];
            let inside = [0, 1].map(|axis| cell[axis].clamp(0, level.size[axis] - 1));
            let before = [0, 1].map(|axis| cell[axis] < 0 && !self.crossed[2 * axis]);
            let after =
                [0, 1].map(|axis| cell[axis] >= level.size[axis] && !self.crossed[2 * axis + 1]);
            // The finest level sees only a few pixels beyond the edge.
            if number > 0 && [before, after].concat().contains(&true) {
                continue;
            }
            let Cell { point, front, sure, .. } = level.at(inside[0], inside[1]);
            if !sure {
                return Said::Either;
            }
            let Some((z, place)) = point else { continue };
            let offset = [0, 1]
                .map(|axis| place[axis] + ((cell[axis] - inside[axis]) * side) as f64 - at[axis]);
            let distance = offset[0].hypot(offset[1]);
            let mut ratio = 0.0;
            if let Some((z0, _)) = own {
                let (rr, aside) = match perspective {
                    true => (
                        1.0 + ray[0] * ray[0] + ray[1] * ray[1],
                        z * (offset[0] * ray[0] + offset[1] * ray[1]),
                    ),
                    false => (1.0, 0.0),
                };
                let twist = if perspective { offset[0] * ray[1] - offset[1] * ray[0] } else { 0.0 };
                let along = (z0 - z) * f * rr - aside;
                let across = if perspective { z } else { 1.0 } * distance.hypot(twist);
                let error = BAND * (((z0 - z) * f * rr).abs() + aside.abs() + across);
                if z < z0 && (along - STEEPEST * across).abs() <= error {
                    return Said::Either;
                }
                if distance == 0.0 {
                    continue;
                }
                ratio = along / across;
            }
            // In half pixels, which are integers.
            let [to_x, to_y] = offset.map(|along| (2.0 * along) as i64);
            let sector = sector(to_x, to_y, SECTORS);
            let leading = own.is_none_or(|(z0, _)| z < z0 && ratio > STEEPEST);
            let lean = if leading { ratio } else { ratio.min(0.0) };
            most[sector] = Some(most[sector].map_or(lean, |most| most.max(lean)));
            if !leading {
                continue;
            }
            leads.insert((dx, dy));
            nearest[sector] = nearest[sector].min(distance);
            let square = offset[0] * offset[0] + offset[1] * offset[1];
            if closest[sector].is_none_or(|(before, ..)| square < before) {
                closest[sector] = Some((square, inside, front));
            }
        }
        let closed =
            if own.is_some() { settings.threshold } else { settings.holes } * SECTORS as f64 / TAU;
        let around_point = fewest_around_openings(settings) as usize;
        if own.is_some() && leads.len() < fewest(closed).min(around_point) {
            return Said::TooFew;
        }
        let near = |a: f64, b: f64| (a - b).abs() <= BAND * a.abs().max(b.abs());
        let found: Vec<_> = closest.into_iter().flatten().collect();
        if subject == Subject::Empty {
            let coarser = &self.levels[number + 1];
            let density = |[x, y]: [i64; 2]| {
                let inside = [(x, 0), (y, 1)].map(|(cell, axis)| {
                    (2 * side).min(view.size[axis] as i64 - cell / 2 * 2 * side)
                });
                let share = coarser.at(x / 2, y / 2).points as f64 / (inside[0] * inside[1]) as f64;
                share.min(MOST_SHARE) / (1.0 - share.min(MOST_SHARE)).sqrt()
            };
            let mut densities: Vec<f64> = found.iter().map(|(_, cell, _)| density(*cell)).collect();
            densities.sort_by(f64::total_cmp);
            let highest = densities.get(2).map_or(f64::MAX, |third| AT_EDGE * third);
            let expected: Vec<f64> = found
                .iter()
                .map(|(square, cell, _)| {
                    density(*cell).min(highest).max(least_density(settings)) * PI / 8.0 * square
                })
                .collect();
            let widest = expected.iter().copied().fold(0.0, f64::max);
            let is_whole = found.len() == SECTORS;
            let expected = expected.iter().sum::<f64>() - if is_whole { widest } else { 0.0 };
            return match expected >= settings.expected {
                _ if found.len() < fewest(closed) => Said::Undecided,
                // The kernel of the finest level is too small for openings.
                _ if number == 0 => Said::Closed,
                _ if near(expected, settings.expected) => Said::Either,
                true => Said::Open,
                false => Said::Closed,
            };
        }
        let around =
            (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))).filter(|at| *at != (0, 0));
        let in_kernel = |at: &(i64, i64)| at.0.abs() <= radius && at.1.abs() <= radius;
        let neighbours = leads
            .iter()
            .flat_map(|(x, y)| around.clone().map(move |(dx, dy)| (x + dx, y + dy)))
            .filter(in_kernel);
        let (count, leading) = neighbours
            .fold((0, 0), |(count, leading), at| (count + 1, leading + leads.contains(&at) as u32));
        let share = (leading as f64 / count.max(1) as f64).min(MOST_SHARE);
        let area = nearest.iter().map(|d| PI / 8.0 * d * d).sum::<f64>() / (side * side) as f64;
        let areas = found.iter().map(|(.., front)| 1.0 / *front as f64).sum::<f64>();
        let density = (1.0 / (1.0 - share).sqrt()).max(found.len() as f64 / areas);
        let (there, needed) = (share * area * density, settings.expected);
        let cone = |most: &Option<f64>| match (most, own) {
            (None, _) => 1.0,
            (Some(_), None) => 0.0,
            (Some(cotangent), _) => 1.0 - cotangent / (1.0 + cotangent * cotangent).sqrt(),
        };
        let cones: f64 = most.iter().map(cone).sum();
        match (there >= needed, cones < closed) {
            _ if near(there, needed) => Said::Either,
            (true, _) => Said::Open,
            _ if near(cones, closed) => Said::Either,
            (false, true) => Said::Closed,
            (false, false) => Said::Undecided,
        }
    }
}
