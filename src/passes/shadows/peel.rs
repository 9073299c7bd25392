//! Index peeling: how deep light reaches and points in, the same marks as by comparing depths out (Dobrev et al. 2010, sec. 6).
//!
//! ```text
//!     shadow_peel   points, limits, keys of the last peel -> keys     of each texel the nearest point within the limit that is left; twice: its depth, then its id
//!     shadow_mark   keys -> marks, keys of the last peel, how many    again, until a peel marks nothing
//! ```
//! A peel takes one point of each texel, so there are as many as the fullest texel has points within its layer. All that are allowed are recorded; those after one that marks nothing end at once. Whether the last still marked something is counted (HARD_CASES 15).

use super::Tally;
use crate::graph::{Graph, Image, Tiles};
use crate::passes::project::{Band, Drawn, Group, Walk};
use crate::shader::{self, shadow_mark, shadow_peel};
use crate::view::View;

pub fn record(g: &mut Graph, camera: &View, drawn: &Drawn, limit: &Image, most: u32, tally: &mut Tally) {
    let size = camera.size;
    let bytes = 8 * size[0] as u64 * size[1] as u64;
    let (mut keys, mut last) = (g.buffer("peel keys", bytes), g.buffer("peel last", bytes));
    g.fill(&mut keys, u32::MAX);
    g.fill(&mut last, 0);
    let mut before = g.buffer("peeled", 4);
    g.fill(&mut before, 1);
    let Walk { centre, corner, size: across, near, lanes, perspective, texels, points_per_chunk } = Walk::new(g, camera, Band { top: 0, size });
    for peel in 1..=most {
        for step in [0, 1] {
            for group in &drawn.groups {
                let &Group { block, planes, filtered, first_chunk, chunk_count, .. } = group;
                let push = shadow_peel::Push { centre, corner, size: across, near, first_chunk, chunk_count };
                let spec = shadow_peel::Spec { lanes, planes, perspective, texels, points_per_chunk, step, filtered };
                let (nodes, chunks, pages) = (&drawn.nodes, &drawn.chunks, &drawn.pages[block]);
                let (opacities, within) = (drawn.opacities(), drawn.within());
                g.run(
                    shader::ShadowPeel { nodes, chunks, opacities, within, pages, page_words: pages, limit, peeled: &before, last: &last, keys: &mut keys, push, spec },
                    group.tiles(),
                );
            }
        }
        let mut peeled = g.buffer("peeled", 4);
        g.fill(&mut peeled, 0);
        // What the last one takes may not be the end.
        let counted = if peel == most { &mut tally.unpeeled } else { &mut peeled };
        let push = shadow_mark::Push { size };
        g.run(
            shader::ShadowMark { before: &before, peeled: counted, keys: &mut keys, last: &mut last, marks: &mut tally.marks, push },
            Tiles::Groups([size[0].div_ceil(64), size[1], 1]),
        );
        before = peeled;
    }
}
