//! A COUNT -> whether passes run: what the device finds empty costs it one look, and the CPU need not wait to hear of it.

use crate::error::Result;
use crate::graph::{Buffer, Graph, Tiles};
use crate::passes::Layers;
use crate::shader::{self, cover, gate::Push};

/// Passes that run only where the count, the buffer's first word, is not 0.
pub fn only_where<T>(g: &mut Graph, count: &Buffer, record: impl FnOnce(&mut Graph) -> Result<T>) -> Result<T> {
    let decide = |g: &mut Graph, wanted: &Buffer, groups: &mut Buffer, words: u32| {
        g.run(shader::Gate { count, wanted, groups, push: Push { words } }, Tiles::Groups([words.div_ceil(64), 1, 1]));
    };
    g.gated(decide, record)
}

/// Not 0 where a pixel holds a point.
pub fn covered(g: &mut Graph, layers: &Layers) -> Buffer {
    let mut covered = g.buffer("covered", 4);
    g.fill(&mut covered, 0);
    let size = layers.depth.desc.size;
    let groups = Tiles::Groups([size[0].div_ceil(64), size[1], 1]);
    g.run(shader::Cover { depth: &layers.depth, covered: &mut covered, push: cover::Push { size } }, groups);
    covered
}
