//! A COUNT -> whether passes run, and where: what the device finds empty costs it one look, and the CPU need not wait to hear of it.

use super::{LIST_HEADER, TILE_PX, tiles};
use crate::graph::{Buffer, Dispatch, Graph, Image, TileList};
use crate::shader::{self, predicate::Push, tile_dilate, tile_occupancy};

/// Passes that run only where the count, the buffer's first word, is not 0.
pub fn only_where<T>(g: &mut Graph, count: &Buffer, record: impl FnOnce(&mut Graph) -> T) -> T {
    let decide = |g: &mut Graph, wanted: &Buffer, groups: &mut Buffer, words: u32| {
        g.run(
            shader::Predicate { count, wanted, groups, push: Push { words } },
            Dispatch::Groups([words.div_ceil(64), 1, 1]),
        );
    };
    g.predicated(decide, record)
}

/// The same tiles where the count is not 0, else none.
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

/// Tiles within so many pixels of those that hold points, by their depths as they were projected. Its first word is 0 where there are none.
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

/// The same of tiles that are known to hold points, by a word each.
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
