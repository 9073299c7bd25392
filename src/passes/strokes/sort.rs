//! Sorts fragments and blends their colours, in as many passes as needed.

use super::abuffer::Abuffer;
use super::settings::Sort;
use super::{Painting, groups};
use crate::error::{Error, Result};
use crate::graph::{Buffer, Graph};
use crate::passes::project::Strip;
use crate::shader::{self, stroke_sort};
use std::ops::Range;

/// Loop iterations per invocation that lavapipe allows, less a margin.
const ROUNDS: u32 = 60_000;

impl Painting<'_> {
    /// Sorts the fragments of some tiles, at most `deepest` per pixel, and blends them when enough
    /// are in order.
    pub(super) fn blend(
        &mut self,
        g: &mut Graph,
        [canvases, part]: [&Buffer; 2],
        strip: Strip,
        tiles: u32,
        abuffer: Abuffer,
        deepest: u32,
    ) -> Result<()> {
        let Some(color) = &mut self.blended else { return Ok(()) };
        let Abuffer { starts, mut fragments, ordered, kept } = abuffer;
        let wanted = ordered.end.min(deepest);
        // If all are sorted, the flag is not read.
        let is_last = !kept || wanted == self.settings.last().min(deepest);
        let mut unordered =
            if is_last { g.buffer("unordered", 4) } else { g.readback("unordered", 4) };
        g.fill(&mut unordered, 0);
        let spec = stroke_sort::Spec { bubble: kept || self.settings.sort == Sort::Bubble };
        for ordered in steps(ordered.start.min(wanted)..wanted, deepest, g.gpu.device.is_cpu)? {
            let (fragments, unordered) = (&mut fragments, &mut unordered);
            let push =
                stroke_sort::Push { top: strip.top, ordered: ordered.start, wanted: ordered.end };
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

/// Returns the ranges of fragments that each pass sorts: all at once, except on lavapipe, which
/// ends a pass with too many iterations early. Errors if a pixel has too many fragments for it.
fn steps(wanted: Range<u32>, deepest: u32, is_cpu: bool) -> Result<Vec<Range<u32>>> {
    if !is_cpu {
        return Ok(vec![wanted]);
    }
    if deepest > ROUNDS - 2 {
        return Err(Error::Request(format!(
            "{deepest} strokes overlap in one pixel, but a software device sorts at most {}; move closer, or use --effect strokes=blend=opaque",
            ROUNDS - 2
        )));
    }
    let mut steps = Vec::new();
    let mut start = wanted.start;
    loop {
        // Sorted ones are passed once, each other one once per step, and one more round.
        let more = ROUNDS.saturating_sub(start) / (deepest.saturating_sub(start) + 2);
        let end = start.saturating_add(more.max(1)).min(wanted.end);
        steps.push(start..end);
        if end >= wanted.end {
            return Ok(steps);
        }
        start = end;
    }
}
