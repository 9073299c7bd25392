//! Index peeling: the same visibility as by comparing depths (Dobrev et al. 2010, sec. 6).
//!
//! ```text
//!     shadow_peel         points, limits, keys of the last peel -> keys    nearest remaining point of
//!                         each texel within the limit; first its depth, then its id
//!     shadow_peel_apply   keys -> visibility, keys of the last peel, count
//!     again until a peel reaches nothing
//! ```
//! A peel takes one point of each texel, so there are as many peels as the fullest texel has points
//! within its layer. They are recorded in blocks; the device skips those after a block that has
//! reached nothing ([`predicate`]). A count tells whether the last one still reached something
//! (guide: numerics, case 15).

use super::Tally;
use crate::error::Result;
use crate::graph::MAX_PREDICATED_PASSES;
use crate::graph::{Buffer, Dispatch, Graph};
use crate::passes::predicate;
use crate::passes::project::{Drawn, Group, Strip, Walk};
use crate::shader::{self, shadow_peel, shadow_peel_apply};
use crate::view::View;

/// Recorded peels if no number is given: more points than hardly any texel has.
const PEELS: u32 = 512;

/// Peels that are skipped together.
const BLOCK: u32 = 8;

pub fn record(
    g: &mut Graph,
    camera: &View,
    drawn: &Drawn,
    limit: &Buffer,
    asked: u32,
    tally: &mut Tally,
) -> Result<()> {
    let size = camera.size;
    let bytes = 8 * size[0] as u64 * size[1] as u64;
    let (mut keys, mut last) = (g.buffer("peel keys", bytes), g.buffer("peel last", bytes));
    g.fill(&mut keys, u32::MAX);
    g.fill(&mut last, 0);
    let most = if asked == 0 { PEELS } else { asked };
    let of_a_peel = 2 * drawn.groups.len() + 1;
    // More groups than fit one predicate: every peel is recorded to run.
    let is_gated = of_a_peel <= MAX_PREDICATED_PASSES;
    let of_a_block = (MAX_PREDICATED_PASSES / of_a_peel).clamp(1, BLOCK as usize) as u32;
    let mut before: Option<Buffer> = None;
    for first in (0..most).step_by(of_a_block as usize) {
        let mut peeled = g.buffer("peeled", 4);
        g.fill(&mut peeled, 0);
        let mut block = |g: &mut Graph| {
            for peel in first..most.min(first + of_a_block) {
                // The last peel may not be the end.
                let counted = if peel + 1 == most { &mut tally.unpeeled } else { &mut peeled };
                one(
                    g,
                    camera,
                    drawn,
                    limit,
                    [&mut keys, &mut last],
                    counted,
                    &mut tally.light_visibility,
                );
            }
            Ok(())
        };
        match before.filter(|_| is_gated) {
            Some(before) => predicate::only_where(g, &before, block)?,
            None => block(g)?,
        }
        before = Some(peeled);
    }
    Ok(())
}

/// Records a peel: the next point of each texel.
fn one(
    g: &mut Graph,
    camera: &View,
    drawn: &Drawn,
    limit: &Buffer,
    [keys, last]: [&mut Buffer; 2],
    peeled: &mut Buffer,
    light_visibility: &mut Buffer,
) {
    let size = camera.size;
    let Walk { centre, corner, size: across, near, lanes, perspective, texels, points_per_chunk } =
        Walk::new(g, camera, Strip { top: 0, size });
    for step in [0, 1] {
        for group in &drawn.groups {
            let &Group { block, planes, filtered, first_chunk, chunk_count, .. } = group;
            let push =
                shadow_peel::Push { centre, corner, size: across, near, first_chunk, chunk_count };
            let spec = shadow_peel::Spec {
                lanes,
                planes,
                perspective,
                texels,
                points_per_chunk,
                step,
                filtered,
            };
            let (nodes, chunks, pages) = (&drawn.nodes, &drawn.chunks, &drawn.pages[block]);
            let (opacities, within) = (drawn.opacities(), drawn.within());
            g.run(
                shader::ShadowPeel {
                    nodes,
                    chunks,
                    opacities,
                    within,
                    pages,
                    page_words: pages,
                    limit,
                    limit_words: limit,
                    last,
                    keys,
                    push,
                    spec,
                },
                group.tiles(),
            );
        }
    }
    let push = shadow_peel_apply::Push { size };
    g.run(
        shader::ShadowPeelApply { peeled, keys, last, light_visibility, push },
        Dispatch::Groups([size[0].div_ceil(64), size[1], 1]),
    );
}
