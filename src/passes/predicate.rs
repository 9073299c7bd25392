//! Predication by a count on the device: whether passes run, and on which tiles. The CPU does not
//! wait for the count; empty work costs one check.

use super::{LIST_HEADER, TILE_PX, tiles};
use crate::graph::{Buffer, Dispatch, Graph, Image, TileList};
use crate::shader::{self, predicate::Push, tile_dilate, tile_occupancy};

/// Records passes that run only if the count, the buffer's first word, is not 0.
pub fn only_where<T>(g: &mut Graph, count: &Buffer, record: impl FnOnce(&mut Graph) -> T) -> T {
    let decide = |g: &mut Graph, wanted: &Buffer, groups: &mut Buffer, words: u32| {
        g.run(
            shader::Predicate { count, wanted, groups, push: Push { words } },
            Dispatch::Groups([words.div_ceil(64), 1, 1]),
        );
    };
    g.predicated(decide, record)
}

/// Returns the same tiles if the count is not 0, else none.
pub fn area_where(g: &mut Graph, count: &Buffer, area: &TileList) -> TileList {
    let mut groups = g.buffer("area groups", 4 * LIST_HEADER as u64);
    g.run(
        shader::Predicate {
            count,
            wanted: &area.groups,
            groups: &mut groups,
            push: Push { words: LIST_HEADER },
        },
        Dispatch::Groups([1, 1, 1]),
    );
    TileList { groups, list: area.list.alias() }
}

/// Returns the tiles within `grows_px` of tiles that hold points, by projected depth. The first
/// word is 0 if there are none.
pub fn occupied_tiles(g: &mut Graph, raw: &Image, grows_px: f64) -> TileList {
    let across = tiles(raw.desc.size);
    let count = across[0] * across[1];
    let mut covered = g.buffer("covered", 4 * count as u64);
    g.fill(&mut covered, 0);
    g.run(
        shader::TileOccupancy {
            depth: raw,
            covered: &mut covered,
            push: tile_occupancy::Push { tiles: across },
        },
        Dispatch::PerEightTiles(count),
    );
    listed(g, &covered, across, grows_px)
}

/// Returns the tiles within `grows_px` of those marked in `covered`, one word per tile.
pub fn listed(g: &mut Graph, covered: &Buffer, across: [u32; 2], grows_px: f64) -> TileList {
    let count = across[0] * across[1];
    let mut list = g.buffer("area", 4 * (LIST_HEADER + count) as u64);
    g.fill(&mut list, 0);
    let push =
        tile_dilate::Push { tiles: across, rings: (grows_px / TILE_PX as f64).ceil() as i32 };
    g.run(
        shader::TileDilate { covered, lists: &mut list, push },
        Dispatch::Groups([count.div_ceil(64), 1, 1]),
    );
    TileList { groups: list.alias(), list }
}
