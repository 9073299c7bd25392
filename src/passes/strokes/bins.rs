//! Finds the strokes that may touch each tile: first their number, which sizes the lists.

use super::{PLACE_BYTES, Painting, StrokeInputs};
use crate::error::Result;
use crate::graph::{Buffer, Graph};
use crate::passes::project::{self, Strip};
use crate::passes::resolve;
use crate::shader::{self, stroke_bins};
use std::ops::Range;

/// Workgroups that share a chunk, so that 16 consecutive points may touch thousands of tiles each.
const SLICES: u32 = 32;

/// Consecutive tiles with the list of their strokes.
pub struct Bins {
    pub part: Buffer,
    pub strokes: Buffer,
    /// Largest number of strokes of a tile.
    pub longest: u32,
}

impl Painting<'_> {
    /// Returns the number of strokes that may touch each tile of a strip, in several turns over
    /// parts of the points if a single tile has more than a list may hold.
    pub(super) fn listed(&mut self, g: &mut Graph, strip: Strip) -> Result<Option<Vec<Vec<u32>>>> {
        let room = self.room(g, 2) / PLACE_BYTES;
        let mut turns = 1;
        loop {
            let listed = (0..turns)
                .map(|turn| self.tally(g, strip, [turn, turns]))
                .collect::<Result<Option<Vec<_>>>>()?;
            let Some(listed) = listed else { return Ok(None) };
            let most = listed.iter().flatten().copied().max().unwrap_or(0) as u64;
            if most <= room || turns as u64 > most {
                return Ok(Some(listed));
            }
            // Turns are of about equal length.
            turns = (turns + 1).max((turns as u64 * most * 9 / 8).div_ceil(room) as u32);
        }
    }

    /// Returns the number of strokes of one turn that may touch each tile of a strip.
    fn tally(&mut self, g: &mut Graph, strip: Strip, turn: [u32; 2]) -> Result<Option<Vec<u32>>> {
        let found = self.ask(g, format!("tally {strip:?} {turn:?}"), |painting, counting| {
            let paint = resolve::paint(counting, painting.resident, &painting.request)?;
            let desk = painting.bind(counting, strip, &paint)?;
            let count = desk.tiles[0] * desk.tiles[1];
            let part = counting.upload("part", &[0, count, turn[0], turn[1]])?;
            let (mut tallies, mut strokes) = (
                counting.buffer("tallies", 4 * count as u64),
                counting.buffer("stroke list", PLACE_BYTES),
            );
            counting.fill(&mut tallies, 0);
            painting.walk(counting, &desk, &part, &mut tallies, &mut strokes, 0);
            Ok([counting.download_buffer(&tallies)])
        })?;
        Ok(found.map(|[tallies]| tallies))
    }

    /// Lists the strokes of one turn that may touch each of some tiles.
    pub(super) fn bins(
        &self,
        g: &mut Graph,
        desk: &StrokeInputs,
        listed: &[u32],
        tiles: &Range<u32>,
        turn: [u32; 2],
    ) -> Result<Bins> {
        let starts = super::abuffer::sums(&listed[tiles.start as usize..tiles.end as usize]);
        let part =
            g.upload("part", &[&[tiles.start, tiles.end], &turn[..], &starts[..]].concat())?;
        let mut cursors = g.upload("cursors", &starts)?;
        let mut strokes = g.buffer("stroke list", PLACE_BYTES * starts[tiles.len()].max(1) as u64);
        self.walk(g, desk, &part, &mut cursors, &mut strokes, 1);
        Ok(Bins {
            part,
            strokes,
            longest: starts.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap_or(0),
        })
    }

    fn walk(
        &self,
        g: &mut Graph,
        desk: &StrokeInputs,
        part: &Buffer,
        tallies: &mut Buffer,
        strokes: &mut Buffer,
        step: u32,
    ) {
        let project::Walk {
            centre,
            corner,
            size,
            near,
            lanes,
            perspective,
            texels,
            points_per_chunk,
        } = self.walked(g, desk);
        let slices_of_chunk = if g.gpu.device.is_cpu { SLICES } else { 1 };
        for group in &desk.drawn.groups {
            let project::Group { block, planes, filtered, first_chunk, chunk_count, .. } = *group;
            let push = stroke_bins::Push { centre, corner, size, near, first_chunk, chunk_count };
            let StrokeInputs { drawn, homes, canvas, turns, paint, .. } = desk;
            let (mode, transparent, by_kind) =
                (paint.mode, paint.opacities.is_some(), paint.kinds.is_some());
            let spec = stroke_bins::Spec {
                lanes,
                planes,
                perspective,
                texels,
                points_per_chunk,
                filtered,
                step,
                mode,
                transparent,
                by_kind,
                slices_of_chunk,
            };
            let pages = &drawn.pages[block];
            g.run(
                shader::StrokeBins {
                    nodes: &drawn.nodes,
                    chunks: &drawn.chunks,
                    opacities: paint.opacities.as_ref().unwrap_or(drawn.opacities()),
                    within: drawn.within(),
                    pages,
                    page_words: pages,
                    homes,
                    turns,
                    canvases: canvas,
                    part,
                    tallies,
                    strokes,
                    table: &paint.table,
                    push,
                    spec,
                },
                group.slices(slices_of_chunk),
            );
        }
    }
}
