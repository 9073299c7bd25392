//! Fragments in, the colours that they give in order out: as many passes as it takes.

use super::abuffer::Abuffer;
use super::settings::Sort;
use super::{Painting, groups};
use crate::error::{Error, Result};
use crate::graph::{Buffer, Graph};
use crate::passes::project::Band;
use crate::shader::{self, stroke_sort};
use std::ops::Range;

/// How often all loops of an invocation together may go round on lavapipe, less a margin.
const ROUNDS: u32 = 60_000;

impl Painting<'_> {
    /// Fragments of some tiles, so many in a pixel at most -> the colours that they give when as many are in order as shall be.
    pub(super) fn blend(
        &mut self,
        g: &mut Graph,
        [canvases, part]: [&Buffer; 2],
        band: Band,
        tiles: u32,
        abuffer: Abuffer,
        deepest: u32,
    ) -> Result<()> {
        let Some(color) = &mut self.blended else { return Ok(()) };
        let Abuffer { starts, mut fragments, ordered, kept } = abuffer;
        let wanted = ordered.end.min(deepest);
        // Where there are no more nobody asks whether they are in order.
        let is_last = !kept || wanted == self.settings.last().min(deepest);
        let mut unordered =
            if is_last { g.buffer("unordered", 4) } else { g.readback("unordered", 4) };
        g.fill(&mut unordered, 0);
        let spec = stroke_sort::Spec { bubble: kept || self.settings.sort == Sort::Bubble };
        for ordered in steps(ordered.start.min(wanted)..wanted, deepest, g.gpu.device.is_cpu)? {
            let (fragments, unordered) = (&mut fragments, &mut unordered);
            let push =
                stroke_sort::Push { top: band.top, ordered: ordered.start, wanted: ordered.end };
            g.run(
                shader::StrokeSort {
                    canvases,
                    part,
                    starts: &starts,
                    fragments,
                    color,
                    unordered,
                    push,
                    spec,
                },
                groups(tiles),
            );
        }
        self.unordered = (!is_last).then_some(unordered);
        Ok(())
    }
}

/// Fragments of a pixel that each pass brings into order, of so many at most: all of them, but on lavapipe, where a pass ends too early that would walk over them too often.
fn steps(wanted: Range<u32>, deepest: u32, is_cpu: bool) -> Result<Vec<Range<u32>>> {
    if !is_cpu {
        return Ok(vec![wanted]);
    }
    if deepest > ROUNDS - 2 {
        return Err(Error::Request(format!(
            "{deepest} strokes lie over each other in one pixel, and a software device brings {} into order at most; look at them from nearer, or with --effect strokes=blend=opaque",
            ROUNDS - 2
        )));
    }
    let mut steps = Vec::new();
    let mut start = wanted.start;
    loop {
        // Those in order are walked over once, the others once for each, and a round more.
        let more = ROUNDS.saturating_sub(start) / (deepest.saturating_sub(start) + 2);
        let end = start.saturating_add(more.max(1)).min(wanted.end);
        steps.push(start..end);
        if end >= wanted.end {
            return Ok(steps);
        }
        start = end;
    }
}
