//! Counts the points in the picture: those that opacity, back-face removal and clip boxes leave,
//! within its sides. It is one more loop over the points (glsl/lib/point_loop.glsl).

use super::project::{self, Drawn, Strip, Walk};
use crate::graph::{Buffer, CompletedSubmission, Graph};
use crate::shader::{self, count_visible};
use crate::view::View;

/// A count that is read back with the frame.
pub struct Tally(Buffer);

pub fn record(g: &mut Graph, view: &View, drawn: &Drawn) -> Tally {
    let Walk { centre, corner, size, near, lanes, perspective, texels, points_per_chunk } =
        Walk::new(g, view, Strip { top: 0, size: view.size });
    let mut counted = g.buffer("tally", 8);
    g.fill(&mut counted, 0);
    for group in &drawn.groups {
        let project::Group { block, first_chunk, chunk_count, planes, filtered, .. } = *group;
        let push = count_visible::Push { centre, corner, size, near, first_chunk, chunk_count };
        let spec =
            count_visible::Spec { lanes, planes, perspective, texels, points_per_chunk, filtered };
        let (pages, opacities, within) = (&drawn.pages[block], drawn.opacities(), drawn.within());
        let (nodes, chunks, tally) = (&drawn.nodes, &drawn.chunks, &mut counted);
        g.run(
            shader::CountVisible {
                nodes,
                chunks,
                opacities,
                within,
                pages,
                page_words: pages,
                tally,
                push,
                spec,
            },
            group.tiles(),
        );
    }
    Tally(g.download_buffer(&counted))
}

impl Tally {
    pub fn points(&self, frame: &CompletedSubmission) -> u64 {
        let words = frame.read::<u32>(&self.0);
        words[0] as u64 | (words[1] as u64) << 32
    }
}
