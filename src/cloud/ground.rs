//! Heights of points above the ground: above a coarse surface of cells.
//!
//! With points of class 2 (ground), a cell has the mean of their heights. Without, it has its
//! lowest point, and what is narrower than 30 metres is then taken away: a morphological opening,
//! the lowest of the cells around, then the highest of these. At the edges of a cloud that takes
//! away the upper ends of slopes, too. Empty cells have the mean of ever larger cells,
//! interpolated. Between the centres of cells heights are interpolated bilinearly.
//!
//! Points of any source are read twice, batch by batch: for the box around most of them, and for
//! the cells, which are at most 2048 along a side.

use super::crs::Reference;
use super::robust_bounds::scatter;
use super::scalar::{Scalar, ScalarColumn};
use super::strays::RobustBounds;
use super::up::Up;
use super::{Cloud, Columns, Lattice};
use crate::error::Result;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::sync::{Mutex, MutexGuard};

/// Side of a cell, unless that makes too many `[m]`.
pub const CELL: f64 = 2.0;
/// Most cells along a side.
const MOST_CELLS: f64 = 2048.0;
/// Width of buildings that are not taken for ground, without classes `[m]`.
const WIDEST: f64 = 30.0;
/// Approximate number of samples that say where most points are.
const SAMPLES: u64 = 1 << 14;
/// Heights are added up as whole numbers of this many to a unit, so that their order does not
/// matter.
const PARTS: f64 = 1024.0;

const GROUND: u8 = 2;
/// Classes of noise.
const NOISE: [u8; 2] = [7, 18];

/// Heights over a grid of square cells.
pub struct Surface {
    up: Up,
    /// Choice of points: those of class 2, or all.
    by_class: bool,
    /// Corner of the first cell.
    low: DVec2,
    side: f64,
    size: [usize; 2],
    /// Rows of cells; NaN where empty.
    heights: Vec<f64>,
}

/// Points of one lattice; their coordinates count from `shift` `[lattice steps]`.
#[derive(Clone, Copy)]
pub struct Batch<'b> {
    pub columns: &'b Columns,
    pub lattice: &'b Lattice,
    pub shift: [i64; 3],
    /// A corner that moves with the points, from which places are hashed.
    pub corner: [i32; 3],
}

impl Batch<'_> {
    fn steps(&self, i: usize) -> [i32; 3] {
        [self.columns.x[i], self.columns.y[i], self.columns.z[i]]
    }

    fn place(&self, i: usize) -> DVec3 {
        let own = self.steps(i);
        self.lattice.world([0, 1, 2].map(|axis| own[axis] as i64 + self.shift[axis]))
    }

    fn class(&self, i: usize) -> u8 {
        self.columns.class.as_ref().map_or(0, |classes| classes[i])
    }
}

/// Points in batches, the same at each call, on any thread and in any order.
pub trait Points {
    /// Returns about how many there are.
    fn count(&self) -> u64;

    fn each(&self, sink: &(dyn Fn(Batch) + Sync)) -> Result<()>;

    fn up(&self) -> Up;

    fn reference(&self) -> Reference;
}

impl Points for Cloud {
    fn count(&self) -> u64 {
        self.len()
    }

    fn each(&self, sink: &(dyn Fn(Batch) + Sync)) -> Result<()> {
        for part in self.parts.iter().filter(|part| !part.header.strays) {
            let corner = part.columns.extent().map_or([0; 3], |extent| extent.low);
            sink(Batch { columns: &part.columns, lattice: &part.lattice, shift: [0; 3], corner });
        }
        Ok(())
    }

    fn up(&self) -> Up {
        self.up
    }

    fn reference(&self) -> Reference {
        Reference::of(self.parts.iter().map(|part| (&part.header, part.lattice)))
    }
}

/// Adds the heights of all points to the columns. Returns a note on how the ground was found;
/// `None` without points.
pub fn heights(cloud: &mut Cloud) -> Option<String> {
    // Points in memory cannot fail to be read.
    let surface = Surface::of(cloud).ok().flatten()?;
    for part in &mut cloud.parts {
        let (shift, corner) = ([0; 3], [0; 3]);
        let batch = Batch { columns: &part.columns, lattice: &part.lattice, shift, corner };
        let column = surface.column(batch);
        part.columns.scalars.push(column);
    }
    Some(surface.note())
}

/// Where the points are that may be of the ground.
#[derive(Clone)]
struct Extent {
    low: DVec3,
    high: DVec3,
    samples: Vec<DVec3>,
}

impl Extent {
    const NONE: Extent =
        Extent { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY, samples: Vec::new() };

    fn add(&mut self, p: DVec3, is_sample: bool) {
        (self.low, self.high) = (self.low.min(p), self.high.max(p));
        if is_sample {
            self.samples.push(p);
        }
    }

    fn join(&mut self, other: Extent) {
        (self.low, self.high) = (self.low.min(other.low), self.high.max(other.high));
        self.samples.extend(other.samples);
    }

    /// Returns the box without points that lie farther from most than these lie apart.
    fn robust(self) -> [DVec3; 2] {
        let core = RobustBounds::of(self.samples.len(), |i| self.samples[i]);
        let near = self.samples.iter().filter(|p| core.is_none_or(|core| core.has(**p)));
        let ends = near.fold(None, |ends: Option<[DVec3; 2]>, &p| {
            let [low, high] = ends.unwrap_or([p; 2]);
            Some([low.min(p), high.max(p)])
        });
        let Some([low, high]) = ends else { return [self.low, self.high] };
        let size = (high - low).max_element();
        [self.low.max(low - size), self.high.min(high + size)]
    }
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

impl Surface {
    /// Finds the ground; `None` without points. Reads them twice.
    pub fn of(points: &dyn Points) -> Result<Option<Surface>> {
        let up = points.up();
        let axes = [0, 3 - up.index()];
        let every = points.count() / SAMPLES + 1;
        // Extents of the points of class 2, and of the others.
        let extents = Mutex::new([Extent::NONE, Extent::NONE]);
        points.each(&|batch| {
            let mut own = [Extent::NONE, Extent::NONE];
            for i in 0..batch.columns.len() {
                let class = batch.class(i);
                if !NOISE.contains(&class) {
                    let is_sample = scatter(batch.steps(i), batch.corner).is_multiple_of(every);
                    own[(class != GROUND) as usize].add(batch.place(i), is_sample);
                }
            }
            let mut extents = lock(&extents);
            extents.iter_mut().zip(own).for_each(|(extent, own)| extent.join(own));
        })?;
        let [ground, other] = extents.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
        let by_class = ground.low.is_finite();
        let [low, high] = if by_class { ground } else { other }.robust();
        if !low.is_finite() {
            return Ok(None);
        }
        let metres = points.reference().unit().metres;
        let flat = |p: DVec3| DVec2::new(p[axes[0]], p[axes[1]]);
        let longest = flat(high - low).max_element();
        let side = (CELL / metres).max(longest / MOST_CELLS);
        let size = flat(high - low).to_array().map(|extent| (extent / side) as usize + 1);
        let count = size[0] * size[1];
        let lowest = if by_class { 0.0 } else { f64::INFINITY };
        let cells = Mutex::new((vec![lowest; count], vec![0u32; count]));
        points.each(&|batch| {
            let mut own = Vec::new();
            for i in 0..batch.columns.len() {
                let class = batch.class(i);
                let p = batch.place(i);
                let is_ground = if by_class { class == GROUND } else { !NOISE.contains(&class) };
                if is_ground && p.cmpge(low).all() && p.cmple(high).all() {
                    let [column, row] =
                        (flat(p - low) / side).to_array().map(|place| place as usize);
                    own.push((row * size[0] + column, p[up.index()]));
                }
            }
            let mut cells = lock(&cells);
            let (heights, points) = &mut *cells;
            for (cell, height) in own {
                heights[cell] = match by_class {
                    true => heights[cell] + (height * PARTS).round(),
                    false => heights[cell].min(height),
                };
                points[cell] += 1;
            }
        })?;
        let (mut heights, points) =
            cells.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
        for (height, points) in heights.iter_mut().zip(points) {
            *height = match points {
                0 => f64::NAN,
                points if by_class => *height / PARTS / points as f64,
                _ => *height,
            };
        }
        let mut surface = Surface { up, by_class, low: flat(low), side, size, heights };
        surface.fill();
        if !by_class {
            let around = (WIDEST / metres / 2.0 / side).round() as usize;
            surface.spread(around, f64::min);
            surface.spread(around, f64::max);
        }
        Ok(Some(surface))
    }

    /// Says how the ground was found.
    pub fn note(&self) -> String {
        let how = match self.by_class {
            true => "a surface through points of class 2",
            false => "the lowest points around, since no point is of class 2 (ground)",
        };
        format!("{} is measured from {how}", Scalar::HeightAboveGround)
    }

    /// Returns the heights of points above it.
    pub fn column(&self, batch: Batch) -> ScalarColumn {
        let [a, b, up] = [0, 3 - self.up.index(), self.up.index()];
        let height = |i| {
            let p = batch.place(i);
            p[up] - self.at(DVec2::new(p[a], p[b]))
        };
        let count = batch.columns.len();
        let numbers = (0..count).into_par_iter().with_min_len(1 << 12).map(height).collect();
        ScalarColumn { scalar: Scalar::HeightAboveGround, numbers }
    }

    /// Returns the height of a place, or of the nearest place of the grid.
    pub fn at(&self, p: DVec2) -> f64 {
        let [(x, u), (y, v)] = [0, 1].map(|axis| {
            let last = self.size[axis] - 1;
            let place = ((p[axis] - self.low[axis]) / self.side - 0.5).clamp(0.0, last as f64);
            let cell = (place as usize).min(last.saturating_sub(1));
            (cell, place - cell as f64)
        });
        let cell = |x: usize, y: usize| {
            let [x, y] = [x.min(self.size[0] - 1), y.min(self.size[1] - 1)];
            self.heights[y * self.size[0] + x]
        };
        let between = |a: f64, b: f64, t: f64| if t == 0.0 { a } else { a + (b - a) * t };
        between(
            between(cell(x, y), cell(x + 1, y), u),
            between(cell(x, y + 1), cell(x + 1, y + 1), u),
            v,
        )
    }

    /// Fills empty cells from a grid of cells twice as large.
    fn fill(&mut self) {
        if !self.heights.iter().any(|height| height.is_nan()) {
            return;
        }
        let [width, height] = self.size;
        let size = self.size.map(|cells| cells.div_ceil(2));
        let mean = |cell: usize| {
            let (x, y) = (2 * (cell % size[0]), 2 * (cell / size[0]));
            let four = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)].into_iter();
            let inside = four.filter(|&(x, y)| x < width && y < height);
            let known = inside.map(|(x, y)| self.heights[y * width + x]).filter(|h| !h.is_nan());
            let (sum, count) = known.fold((0.0, 0.0), |(sum, count), h| (sum + h, count + 1.0));
            sum / count
        };
        let heights = (0..size[0] * size[1]).map(mean).collect();
        let mut coarse = Surface { side: 2.0 * self.side, size, heights, ..*self };
        coarse.fill();
        for (cell, height) in self.heights.iter_mut().enumerate().filter(|(_, h)| h.is_nan()) {
            let centre = DVec2::new((cell % width) as f64 + 0.5, (cell / width) as f64 + 0.5);
            *height = coarse.at(self.low + centre * self.side);
        }
    }

    /// Replaces each cell by the least or greatest of the square of cells around it.
    fn spread(&mut self, around: usize, pick: fn(f64, f64) -> f64) {
        let [width, height] = self.size;
        for (cells, stride, lines, step) in [(width, 1, height, width), (height, width, width, 1)] {
            for line in 0..lines {
                let at = |cell: usize| line * step + cell * stride;
                let old: Vec<f64> = (0..cells).map(|cell| self.heights[at(cell)]).collect();
                for cell in 0..cells {
                    let near = &old[cell.saturating_sub(around)..(cell + around + 1).min(cells)];
                    let one = near.iter().copied().reduce(pick);
                    self.heights[at(cell)] = one.unwrap_or(old[cell]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slope_with_a_hole_and_a_house_is_the_slope() {
        let size = [60, 40];
        let slope = |x: f64, y: f64| 100.0 + 0.2 * x - 0.1 * y;
        let cell = |i: usize| {
            let (x, y) = (i % size[0], i / size[0]);
            let house = if (20..28).contains(&x) && (10..18).contains(&y) { 6.0 } else { 0.0 };
            let hole = (40..46).contains(&x) && (20..26).contains(&y);
            if hole { f64::NAN } else { slope(x as f64 + 0.5, y as f64 + 0.5) + house }
        };
        let heights = (0..size[0] * size[1]).map(cell).collect();
        let (up, low) = (Up::Z, DVec2::ZERO);
        let mut surface = Surface { up, by_class: false, low, side: 1.0, size, heights };
        surface.fill();
        assert!(surface.heights.iter().all(|height| height.is_finite()));
        surface.spread(6, f64::min);
        surface.spread(6, f64::max);
        for i in 0..2400 {
            let p = DVec2::new((i % 60) as f64 + 0.3, (i / 60) as f64 + 0.8);
            let off = surface.at(p) - slope(p.x, p.y);
            // At the upper end of a slope the opening takes away 6 cells of 0.2 and 0.1.
            assert!(off.abs() < 2.0, "{p} {off}");
            if (8..52).contains(&(i % 60)) && (8..32).contains(&(i / 60)) && off.abs() > 0.8 {
                // Where the house stood, the ground is that at its lower side.
                panic!("{p} {off}");
            }
        }
    }
}
