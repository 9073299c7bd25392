//! Heights of points above the ground: above a coarse surface of cells.
//!
//! With points of class 2 (ground), a cell has the mean of their heights. Without, it has its lowest
//! point, and what is narrower than 30 metres is then taken away: a morphological opening, the
//! lowest of the cells around, then the highest of these. At the edges of a cloud that takes away
//! the upper ends of slopes, too. Empty cells have the mean of ever larger cells, interpolated.
//! Between the centres of cells heights are interpolated bilinearly.

use super::crs::Reference;
use super::scalar::Scalar;
use super::{Cloud, Part};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Side of a cell, unless that makes too many `[m]`.
const CELL: f64 = 2.0;
/// Most cells along a side.
const MOST_CELLS: f64 = 2048.0;
/// Width of buildings that are not taken for ground, without classes `[m]`.
const WIDEST: f64 = 30.0;

const GROUND: u8 = 2;
/// Classes of noise.
const NOISE: [u8; 2] = [7, 18];

/// Heights over a grid of square cells.
pub struct Surface {
    /// Corner of the first cell.
    low: DVec2,
    side: f64,
    size: [usize; 2],
    /// Rows of cells; NaN where empty.
    heights: Vec<f64>,
}

/// Fills [`super::Columns::scalar`] with the heights of all points. Returns a note on how the ground
/// was found; `None` without points.
pub fn heights(cloud: &mut Cloud) -> Option<String> {
    let surface = Surface::of(cloud)?;
    let (axes, up) = (across(cloud), cloud.up.index());
    for part in &mut cloud.parts {
        let height = |i| {
            let p = place(part, i);
            p[up] - surface.at(DVec2::new(p[axes[0]], p[axes[1]]))
        };
        let column = (0..part.columns.len()).into_par_iter().map(height).collect();
        part.columns.scalar = Some(column);
    }
    let how = if has_ground(cloud) {
        "a surface through points of class 2"
    } else {
        "the lowest points around, since no point is of class 2 (ground)"
    };
    Some(format!("{} is measured from {how}", Scalar::HeightAboveGround))
}

fn place(part: &Part, i: usize) -> DVec3 {
    let columns = &part.columns;
    part.lattice.world([columns.x[i], columns.y[i], columns.z[i]].map(i64::from))
}

/// Returns the two horizontal axes.
fn across(cloud: &Cloud) -> [usize; 2] {
    [0, 3 - cloud.up.index()]
}

fn has_ground(cloud: &Cloud) -> bool {
    let classes = cloud.parts.iter().filter_map(|part| part.columns.class.as_ref());
    classes.flatten().any(|&class| class == GROUND)
}

impl Surface {
    /// Finds the ground of a cloud; `None` without points.
    pub fn of(cloud: &Cloud) -> Option<Surface> {
        let (axes, up, by_class) = (across(cloud), cloud.up.index(), has_ground(cloud));
        let each = |sink: &mut dyn FnMut(DVec2, f64)| {
            for part in cloud.parts.iter().filter(|part| !part.header.strays) {
                let (core, classes) = (part.columns.core(), part.columns.class.as_ref());
                for i in 0..part.columns.len() {
                    let class = classes.map_or(0, |classes| classes[i]);
                    let is_ground =
                        if by_class { class == GROUND } else { !NOISE.contains(&class) };
                    if is_ground && core.is_none_or(|core| core.has(part.columns.place(i))) {
                        let p = place(part, i);
                        sink(DVec2::new(p[axes[0]], p[axes[1]]), p[up]);
                    }
                }
            }
        };
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        each(&mut |p, _| (low, high) = (low.min(p), high.max(p)));
        if !low.is_finite() {
            return None;
        }
        let metres = Reference::of(cloud.parts.iter().map(|part| (&part.header, part.lattice)))
            .unit()
            .metres;
        let longest = (high - low).max_element();
        let side = (CELL / metres).max(longest / MOST_CELLS);
        let size = [0, 1].map(|axis| ((high[axis] - low[axis]) / side) as usize + 1);
        let count = size[0] * size[1];
        let (mut heights, mut points) = (vec![f64::INFINITY; count], vec![0u32; count]);
        if by_class {
            heights.fill(0.0);
        }
        each(&mut |p, height| {
            let [column, row] = [0, 1].map(|axis| ((p[axis] - low[axis]) / side) as usize);
            let cell = row * size[0] + column;
            heights[cell] =
                if by_class { heights[cell] + height } else { heights[cell].min(height) };
            points[cell] += 1;
        });
        for (height, points) in heights.iter_mut().zip(points) {
            *height = match points {
                0 => f64::NAN,
                points if by_class => *height / points as f64,
                _ => *height,
            };
        }
        let mut surface = Surface { low, side, size, heights };
        surface.fill();
        if !by_class {
            let around = (WIDEST / metres / 2.0 / side).round() as usize;
            surface.spread(around, f64::min);
            surface.spread(around, f64::max);
        }
        Some(surface)
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
        let mut coarse = Surface { low: self.low, side: 2.0 * self.side, size, heights };
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
        let mut surface = Surface { low: DVec2::ZERO, side: 1.0, size, heights };
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
