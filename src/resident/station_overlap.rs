//! Screen tiles covered by more than one scan station, the only places where stations can disagree.

use super::{Resident, ResidentNode};
use crate::view::View;
use glam::DVec3;
use std::ops::Range;

/// Side of a tile `[px]` (glsl/luminance/luminance.comp).
pub const OVERLAP_PX: u32 = 64;

/// Tiles of a whole picture that may show points of several stations, regardless of depth.
#[derive(Clone, Debug, PartialEq)]
pub struct StationOverlap {
    /// Tiles across and down.
    pub size: [u32; 2],
    /// True where a tile may show several stations, row by row.
    pub several: Vec<bool>,
    /// Number of tiles of several stations.
    pub count: usize,
    /// Number of tiles with any point.
    pub seen: usize,
}

impl Resident {
    pub fn overlap(&self, view: &View) -> StationOverlap {
        let (view, size) = (view.entire(), tiles_of(view.whole));
        // Station of every tile that shows something, if it is one.
        let mut stations: Vec<Option<Option<u32>>> = vec![None; (size[0] * size[1]) as usize];
        // Points of other stations are resident but not drawn.
        let drawn = self.opacities.drawn_stations(&self.stations);
        let only = if let [one] = drawn[..] { Some(one) } else { None };
        for (_, node) in self.seen(&view) {
            let station = node.station.or(only);
            if station.is_some_and(|station| !drawn.contains(&station)) {
                continue;
            }
            for tile in tiles(&view, size, node).flatten() {
                let own = &mut stations[tile];
                *own = Some(station.filter(|_| own.is_none_or(|own| own == station)));
            }
        }
        let several: Vec<bool> = stations.iter().map(|own| *own == Some(None)).collect();
        let count = several.iter().filter(|several| **several).count();
        StationOverlap { size, several, count, seen: stations.iter().flatten().count() }
    }
}

impl StationOverlap {
    /// Returns an overlap of several stations everywhere in a picture of this size `[px]`.
    pub fn everywhere(size_px: [u32; 2]) -> StationOverlap {
        let size = tiles_of(size_px);
        let several = vec![true; (size[0] * size[1]) as usize];
        StationOverlap { size, seen: several.len(), count: several.len(), several }
    }

    /// Returns whether no tile shows a single station.
    pub fn is_everywhere(&self) -> bool {
        self.count == self.seen
    }

    /// Returns whether a node may have points in a tile of several stations, or in a tile beside
    /// one.
    pub fn touches(&self, view: &View, node: &ResidentNode) -> bool {
        let [across, down] = self.size;
        self.is_everywhere()
            || tiles(&view.entire(), self.size, node).flatten().any(|tile| {
                let [x, y] = [tile as u32 % across, tile as u32 / across];
                let around = |at: u32, end: u32| at.saturating_sub(1)..(at + 2).min(end);
                around(y, down)
                    .any(|y| around(x, across).any(|x| self.several[(y * across + x) as usize]))
            })
    }
}

fn tiles_of(size_px: [u32; 2]) -> [u32; 2] {
    size_px.map(|side| side.div_ceil(OVERLAP_PX))
}

/// Returns the tiles that a node may have points in, row by row.
fn tiles(view: &View, size: [u32; 2], node: &ResidentNode) -> impl Iterator<Item = Range<usize>> {
    let (low, high) =
        extent_px(view, node.bounds()).unwrap_or(([0.0; 2], view.size.map(f64::from)));
    // Points are placed in f32, so a pixel more. What lies beyond an edge is clamped to it.
    let end = |axis: usize, px: f64| {
        ((px / OVERLAP_PX as f64).floor().max(0.0) as u32).min(size[axis] - 1)
    };
    let [columns, rows] =
        [0, 1].map(|axis| [end(axis, low[axis] - 1.0), end(axis, high[axis] + 1.0)]);
    (rows[0]..=rows[1]).map(move |row| {
        (row * size[0] + columns[0]) as usize..(row * size[0] + columns[1] + 1) as usize
    })
}

/// Returns the bounding rectangle of a box on the screen `[px]`; `None` if part of it is behind the
/// camera.
fn extent_px(view: &View, (min, max): (DVec3, DVec3)) -> Option<([f64; 2], [f64; 2])> {
    let corner = |k: usize| {
        DVec3::from_array(
            [0, 1, 2].map(|axis| if k >> axis & 1 == 0 { min[axis] } else { max[axis] }),
        )
    };
    let all = (0..8).map(|k| view.pixel(corner(k)).map(|at| (at, at)));
    all.reduce(|all, own| {
        let ((low, high), (at, _)) = (all?, own?);
        Some((
            [0, 1].map(|axis| low[axis].min(at[axis])),
            [0, 1].map(|axis| high[axis].max(at[axis])),
        ))
    })?
}
