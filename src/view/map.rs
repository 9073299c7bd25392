//! North-up maps: pixels or cells on a grid over the world, aligned to multiples of their size.

use super::{Camera, Projection, View};
use crate::error::{Error, Result};
use glam::{DVec2, DVec3};

/// Cells of one size. Columns count from west to east, rows from north to south.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapGrid {
    /// Side of a cell `[m]`.
    pub resolution: f64,
    /// The western edge and the northern one, in cells from the world's origin.
    pub corner: [i64; 2],
    /// Columns and rows.
    pub size: [u32; 2],
}

/// Two corners of a map, as X0,Y0,X1,Y1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent(pub [DVec2; 2]);

impl Extent {
    /// Returns the extent with its corners in other coordinates.
    pub fn map(self, convert: impl FnMut(DVec2) -> DVec2) -> Extent {
        Extent(self.0.map(convert))
    }
}

impl std::str::FromStr for Extent {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Extent, String> {
        let numbers: Vec<f64> =
            text.split(',').filter_map(|number| number.trim().parse().ok()).collect();
        match numbers[..] {
            [x0, y0, x1, y1] if x0 < x1 && y0 < y1 && numbers.iter().all(|v| v.is_finite()) => {
                Ok(Extent([DVec2::new(x0, y0), DVec2::new(x1, y1)]))
            }
            _ => Err(format!("{text:?} is not west,south,east,north, such as 100,200,180,260")),
        }
    }
}

/// An edge is met within this share of a cell, since coordinates such as 0.3 are not binary.
const EDGE: f64 = 1e-6;

/// Returns the number of the cell at a coordinate in cells. An edge belongs to the cell after it.
fn cell(at: f64) -> i64 {
    let near = at.round();
    (if (at - near).abs() < EDGE { near } else { at.floor() }) as i64
}

impl MapGrid {
    /// Returns the least grid around all points between two corners. Errors if a side has more
    /// than `most` cells.
    pub fn around(low: DVec2, high: DVec2, resolution: f64, most: u32) -> Result<MapGrid> {
        MapGrid::between(low, high, resolution, most, |at| cell(at).saturating_add(1))
    }

    /// Returns the least grid that covers an extent, whose own edges need no cells beyond.
    pub fn covering(extent: Extent, resolution: f64, most: u32) -> Result<MapGrid> {
        let [low, high] = extent.0;
        MapGrid::between(low, high, resolution, most, |at| cell(-at).saturating_neg())
    }

    fn between(
        low: DVec2,
        high: DVec2,
        resolution: f64,
        most: u32,
        end: impl Fn(f64) -> i64,
    ) -> Result<MapGrid> {
        let (low, high) = (low / resolution, high / resolution);
        let ([west, south], [east, north]) =
            ([cell(low.x), cell(low.y)], [end(high.x), end(high.y)]);
        let sides = [east.saturating_sub(west), north.saturating_sub(south)];
        if sides.iter().any(|side| *side > most as i64) {
            return Err(Error::Request(format!(
                "the map would have {} x {} pixels of {resolution}, more than {most} a side; give a larger --resolution or a smaller --extent",
                sides[0], sides[1]
            )));
        }
        let size = sides.map(|side| side.max(1) as u32);
        Ok(MapGrid { resolution, corner: [west, north], size })
    }

    /// Returns the column and the row of a position; `None` if it is outside.
    pub fn cell(&self, x: f64, y: f64) -> Option<[u32; 2]> {
        let [west, north] = self.corner;
        let column = cell(x / self.resolution).checked_sub(west)?;
        let row = north.checked_sub(1)?.checked_sub(cell(y / self.resolution))?;
        let within = |at: i64, side: u32| u32::try_from(at).ok().filter(|at| *at < side);
        Some([within(column, self.size[0])?, within(row, self.size[1])?])
    }

    pub fn cells(&self) -> u64 {
        self.size[0] as u64 * self.size[1] as u64
    }

    /// Returns the world position of the north-west corner.
    pub fn north_west(&self) -> DVec2 {
        DVec2::new(self.corner[0] as f64, self.corner[1] as f64) * self.resolution
    }

    /// Returns the view from above whose pixels are the cells, to a 256th of a pixel, for points
    /// between two heights.
    pub fn view(&self, [low, high]: [f64; 2]) -> Result<View> {
        let sides = DVec2::new(self.size[0] as f64, self.size[1] as f64) * self.resolution;
        let middle = self.north_west() + DVec2::new(sides.x, -sides.y) / 2.0;
        // A point on an edge belongs to the cell east or north of it, after rounding as well.
        let target = (middle - SHIFT * self.resolution).extend((low + high) / 2.0);
        let above = (high - low).max(self.resolution);
        let camera = Camera {
            eye: target + DVec3::Z * above,
            target,
            up: DVec3::Y,
            fov_y: super::default_fov_y(),
            projection: Projection::Orthographic,
            ortho_height: Some(sides.y),
        };
        View::new(camera, self.size)
    }
}

/// Distance by which a map's view is shifted to the west and south `[px]`.
const SHIFT: f64 = 1.0 / 256.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_belong_to_the_cell_after_them_in_any_resolution() {
        for resolution in [0.1, 0.25, 0.3, 0.01, 2.0] {
            for k in [-7i64, 0, 3, 4_500_001, 50_000_003] {
                let edge = k as f64 * resolution;
                let [low, high] = [DVec2::splat(edge), DVec2::splat(edge + 2.5 * resolution)];
                let grid = MapGrid::around(low, high, resolution, 10).unwrap();
                assert_eq!((grid.corner, grid.size), ([k, k + 3], [3, 3]), "{k} {resolution}");
                assert_eq!(grid.cell(edge, edge), Some([0, 2]));
                assert_eq!(grid.cell(high.x, high.y), Some([2, 0]));
                assert_eq!(grid.cell(edge - 0.4 * resolution, edge), None);
                let extent = Extent([low, DVec2::splat(edge + 2.0 * resolution)]);
                assert_eq!(MapGrid::covering(extent, resolution, 10).unwrap().size, [2, 2]);
            }
        }
        let far = MapGrid::around(DVec2::ZERO, DVec2::splat(1e300), 0.1, u32::MAX);
        assert!(far.is_err_and(|error| error.to_string().contains("--extent")));
    }

    #[test]
    fn a_view_has_the_cells_as_pixels() {
        let [low, high] = [DVec2::new(645_000.1, 5_100_000.2), DVec2::new(645_030.0, 5_100_011.0)];
        let grid = MapGrid::around(low, high, 0.25, 1000).unwrap();
        let view = grid.view([100.0, 130.0]).unwrap();
        for (x, y) in [(645_001.3, 5_100_004.4), (645_029.9, 5_100_010.7)] {
            let [column, row] = grid.cell(x, y).unwrap();
            for z in [100.0, 130.0 - 1e-6] {
                let pixel = view.pixel(DVec3::new(x, y, z)).unwrap();
                assert_eq!(pixel.map(|at| at.floor() as u32), [column, row]);
            }
        }
    }
}
