//! Evaluates the strokes of tiles, a chunk of each tile at a time: the nearest of each pixel, and
//! its fragments or their number.

use super::bins::Bins;
use super::settings::Order;
use super::{Found, Painting, StrokeInputs, TILE_PIXELS, groups};
use crate::error::Result;
use crate::graph::{Buffer, Graph};
use crate::passes::project::Strip;
use crate::passes::resolve;
use crate::shader;
use std::ops::Range;

/// Strokes of each tile per pass, as in glsl/strokes/stroke_fragments.comp.
const STROKES_AT_ONCE: usize = 8192;

impl Painting<'_> {
    /// Returns the number of fragments of every pixel of some tiles, tile by tile, before known
    /// hiders, and the depth of the nearest that covers the pixel completely.
    pub(super) fn count(
        &mut self,
        g: &mut Graph,
        strip: Strip,
        found: &Found,
        tiles: Range<u32>,
        hiders: Option<&[u32]>,
    ) -> Result<Option<[Vec<u32>; 2]>> {
        let name = format!("count {strip:?} {tiles:?} {}", hiders.is_some());
        let pixels = tiles.len() * TILE_PIXELS;
        let found = self.ask(g, name, |painting, counting| {
            painting.record_count(counting, strip, found, tiles, hiders)
        })?;
        Ok(found.map(|counts| counts.map(|words| words[..pixels].to_vec())))
    }

    fn record_count(
        &mut self,
        counting: &mut Graph,
        strip: Strip,
        found: &Found,
        tiles: Range<u32>,
        hiders: Option<&[u32]>,
    ) -> Result<[Buffer; 2]> {
        let paint = resolve::paint(counting, self.resident, &self.request)?;
        let desk = self.bind(counting, strip, &paint)?;
        let starts = counting.upload("starts", &[0u32])?;
        let bytes = 4 * tiles.len() as u64 * TILE_PIXELS as u64;
        let (mut keys, mut fragments, mut counts) = (
            counting.buffer("keys", 8),
            counting.buffer("fragments", 8),
            counting.buffer("counts", bytes),
        );
        [&mut keys, &mut counts].into_iter().for_each(|words| counting.fill(words, 0));
        let what = (false, hiders.is_some());
        let mut hiders = match hiders {
            Some(hiders) => counting.upload("hiders", hiders)?,
            None => {
                let mut hiders = counting.buffer("hiders", bytes);
                counting.fill(&mut hiders, u32::MAX);
                hiders
            }
        };
        let surface = counting.upload("surface", &found.surface)?;
        self.strokes(
            counting,
            &desk,
            (&found.listed, &surface, &tiles),
            &starts,
            what,
            [&mut keys, &mut counts, &mut fragments, &mut hiders],
        )?;
        Ok([&counts, &hiders].map(|words| counting.download_buffer(words)))
    }

    /// Evaluates the strokes of some tiles turn by turn, a chunk of each tile at a time.
    pub(super) fn strokes(
        &self,
        g: &mut Graph,
        desk: &StrokeInputs,
        (listed, surface, tiles): (&[Vec<u32>], &Buffer, &Range<u32>),
        starts: &Buffer,
        (kept, before_hiders): (bool, bool),
        [keys, counts, fragments, hiders]: [&mut Buffer; 4],
    ) -> Result<()> {
        let (perspective, by_stroke, texels) = (
            self.is_perspective(),
            self.settings.order == Order::Stroke,
            g.gpu.device.has_large_texel_buffers,
        );
        let spec =
            shader::stroke_fragments::Spec { perspective, kept, texels, by_stroke, before_hiders };
        for (turn, of_turn) in listed.iter().enumerate() {
            let Bins { part, strokes, longest } =
                &self.bins(g, desk, of_turn, tiles, [turn as u32, listed.len() as u32])?;
            for before in (0..(*longest).max(1)).step_by(STROKES_AT_ONCE) {
                let (keys, counts, fragments, hiders) =
                    (&mut *keys, &mut *counts, &mut *fragments, &mut *hiders);
                g.run(
                    shader::StrokeFragments {
                        canvases: &desk.canvas,
                        part,
                        strokes,
                        stroke_words: strokes,
                        brushes: &desk.brushes,
                        brush_words: &desk.brushes,
                        starts,
                        surface,
                        keys,
                        counts,
                        fragments,
                        hiders,
                        push: shader::stroke_fragments::Push { before },
                        spec,
                    },
                    groups(tiles.len() as u32),
                );
            }
        }
        Ok(())
    }
}
