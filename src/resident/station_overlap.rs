//! Where on the screen several stations have seen something: only there can they disagree.

use super::{Resident, ResidentNode};
use crate::view::View;
use glam::DVec3;
use std::ops::Range;

/// Side of a tile, pixels (glsl/luminance.comp).
pub const OVERLAP_PX: u32 = 64;

/// Tiles of a whole picture, and in which of them points of several stations may be seen; whether they lie behind each other is not asked.
#[derive(Clone, Debug, PartialEq)]
pub struct StationOverlap {
    /// Across and down.
    pub size: [u32; 2],
    /// Row by row.
    pub several: Vec<bool>,
    /// Of them, those of several.
    pub count: usize,
    /// Tiles with any point.
    pub seen: usize,
}

impl Resident {
    pub fn overlap(&self, view: &View) -> StationOverlap {
        let (view, size) = (view.entire(), tiles_of(view.whole));
        // Of every tile that shows something: its station, if it is one.
        let mut stations: Vec<Option<Option<u32>>> = vec![None; (size[0] * size[1]) as usize];
        // Points of other stations are there, and not drawn.
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
    /// As if there were several all over a picture of so many pixels.
    pub fn everywhere(size_px: [u32; 2]) -> StationOverlap {
        let size = tiles_of(size_px);
        let several = vec![true; (size[0] * size[1]) as usize];
        StationOverlap { size, seen: several.len(), count: several.len(), several }
    }

    /// Whether no tile shows one station alone.
    pub fn is_everywhere(&self) -> bool {
        self.count == self.seen
    }

    /// Whether a node may have points in a tile of several stations, or in one beside it.
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

/// Rows of tiles that a node may have points in.
fn tiles(view: &View, size: [u32; 2], node: &ResidentNode) -> impl Iterator<Item = Range<usize>> {
    let (low, high) =
        extent_px(view, node.bounds()).unwrap_or(([0.0; 2], view.size.map(f64::from)));
    // Points are placed in f32, so a pixel more. What is beyond an edge is as good as on it.
    let end = |axis: usize, px: f64| {
        ((px / OVERLAP_PX as f64).floor().max(0.0) as u32).min(size[axis] - 1)
    };
    let [columns, rows] =
        [0, 1].map(|axis| [end(axis, low[axis] - 1.0), end(axis, high[axis] + 1.0)]);
    (rows[0]..=rows[1]).map(move |row| {
        (row * size[0] + columns[0]) as usize..(row * size[0] + columns[1] + 1) as usize
    })
}

/// The rectangle that a box is seen in, pixels; none where a part of it is behind the camera.
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
