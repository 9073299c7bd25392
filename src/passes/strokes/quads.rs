//! Rasterises strokes: ground, and the nearest stroke of each pixel.
//!
//! Vertices are pulled from strokes on the screen, which a compute pass writes in the order of
//! their points. Of strokes at the same depth the first one drawn stays, which has the lowest
//! number, in every picture and all its pieces.

use super::surface::ENCLOSED_PX;
use super::{Painting, StrokeInputs};
use crate::error::Result;
use crate::graph::{Buffer, Graph, Image, ImageDesc, Vertices};
use crate::passes::project;
use crate::shader::{self, Canvas, stroke_quads, stroke_screen};

/// Bytes of a stroke on the screen.
pub const STROKE_BYTES: u64 = 64;

/// Results for a strip and its surroundings.
pub struct Quads {
    /// Two words per pixel.
    pub ground: Buffer,
    /// Keys, if strokes are painted.
    pub nearest: Image,
    /// Strokes drawn at once.
    pub at_once: u32,
}

impl Painting<'_> {
    /// Draws all strokes of a strip; only their ground unless `painted`.
    pub(super) fn draw(
        &mut self,
        g: &mut Graph,
        desk: &StrokeInputs,
        painted: bool,
    ) -> Result<Quads> {
        let strip = self.canvas(desk.strip, desk.paint);
        let (size, corner) = (
            strip.size.map(|side| side + 2 * ENCLOSED_PX),
            strip.corner.map(|at| at - ENCLOSED_PX as f32),
        );
        // A brush smaller than its ground still has that ground.
        let reach =
            strip.reach.map(|reach| if painted { reach.max(strip.ground) } else { strip.ground });
        let canvases = g.upload("canvas", &[Canvas { size, corner, reach, ..strip }])?;
        let mut ground = g.buffer("ground", 8 * size[0] as u64 * size[1] as u64);
        g.fill(&mut ground, 0);
        let mut targets =
            [ImageDesc::keys(size), ImageDesc::depth(size)].map(|desc| g.image_of("nearest", desc));
        let at_once = (self.room(g, 1) / STROKE_BYTES).clamp(1, u32::MAX as u64) as u32;
        for first in (0..desk.places.max(1)).step_by(at_once as usize) {
            let count = at_once.min(desk.places - first);
            let strokes = self.on_screen(g, desk, &canvases, [first, first + count])?;
            let quads = shader::StrokeQuads {
                strokes: &strokes,
                stroke_words: &strokes,
                canvases: &canvases,
                brushes: &desk.brushes,
                brush_words: &desk.brushes,
                ground: &mut ground,
                push: stroke_quads::Push { corner, size: size.map(|side| side as f32) },
                spec: stroke_quads::Spec {
                    perspective: self.is_perspective(),
                    texels: g.gpu.device.has_large_texel_buffers,
                    painted,
                },
            };
            g.draw(quads, Vertices::Squares(count), targets.each_mut(), first > 0);
        }
        let [nearest, _] = targets;
        Ok(Quads { ground, nearest, at_once })
    }

    /// Projects the strokes of points in a range of places.
    fn on_screen(
        &self,
        g: &mut Graph,
        desk: &StrokeInputs,
        canvases: &Buffer,
        places: [u32; 2],
    ) -> Result<Buffer> {
        let part = g.upload("part", &places)?;
        let mut strokes =
            g.buffer("strokes on the screen", STROKE_BYTES * (places[1] - places[0]).max(1) as u64);
        let StrokeInputs { drawn, homes, turns, paint, .. } = desk;
        for group in &drawn.groups {
            let project::Group { block, planes, filtered, first_chunk, chunk_count, .. } = *group;
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
            let pages = &drawn.pages[block];
            g.run(
                shader::StrokeScreen {
                    nodes: &drawn.nodes,
                    chunks: &drawn.chunks,
                    opacities: drawn.opacities(),
                    within: drawn.within(),
                    pages,
                    page_words: pages,
                    homes,
                    turns,
                    canvases,
                    part: &part,
                    strokes: &mut strokes,
                    push: stroke_screen::Push {
                        centre,
                        corner,
                        size,
                        near,
                        first_chunk,
                        chunk_count,
                    },
                    spec: stroke_screen::Spec {
                        lanes,
                        planes,
                        perspective,
                        texels,
                        points_per_chunk,
                        filtered,
                        by_kind: paint.kinds.is_some(),
                        slices_of_chunk: 1,
                    },
                },
                group.tiles(),
            );
        }
        Ok(strokes)
    }
}
