//! Points in, of each pixel the nearest stroke out: z-buffered, through the rasteriser.
//!
//! Vertices are pulled from strokes on the screen, which a compute pass leaves in the order of their points: of strokes of the same depth the first one drawn stays, which is that of the lowest number, in every picture and in all its pieces.

use super::{Desk, Painting};
use crate::error::Result;
use crate::graph::{Buffer, Graph, Image, ImageDesc, Tiles, Vertices};
use crate::passes::project::{self, Band};
use crate::passes::resolve::Paint;
use crate::shader::{self, stroke_ground, stroke_quads, stroke_screen};

/// Of a stroke on the screen.
const STROKE_BYTES: u64 = 64;
/// Pixels.
const GROUP: u32 = 64;

impl Painting<'_> {
    /// Keys of a band.
    pub(super) fn nearest(&mut self, g: &mut Graph, paint: &Paint, band: Band) -> Result<Buffer> {
        let desk = self.lay(g, band, paint)?;
        let at_once = (self.room(g, 1) / STROKE_BYTES).clamp(1, u32::MAX as u64) as u32;
        let pixels = band.size[0] * band.size[1];
        let mut ground = g.buffer("ground", 4 * pixels as u64);
        g.fill(&mut ground, 0);
        let mut targets = [ImageDesc::keys(band.size), ImageDesc::depth(band.size)].map(|desc| g.image_of("nearest", desc));
        self.facts.listed += desk.places as u64;
        for first in (0..desk.places.max(1)).step_by(at_once as usize) {
            let count = at_once.min(desk.places - first);
            let strokes = self.on_screen(g, &desk, [first, first + count])?;
            self.draw(g, &desk, (&strokes, count), &mut ground, &mut targets, first > 0);
            self.facts.parts += 1;
            self.facts.bytes = self.facts.bytes.max(STROKE_BYTES * count as u64);
        }
        let [nearest, _] = targets;
        let mut keys = g.buffer("keys", nearest.desc.bytes());
        g.copy_out(&nearest, &mut keys);
        let rows = pixels.div_ceil(GROUP * super::GROUPS_A_ROW);
        let groups = Tiles::Groups([pixels.div_ceil(GROUP * rows), rows, 1]);
        g.run(shader::StrokeGround { ground: &ground, keys: &mut keys, push: stroke_ground::Push { pixels } }, groups);
        Ok(keys)
    }

    /// Strokes of points by their places, from one to before another.
    fn on_screen(&self, g: &mut Graph, desk: &Desk, places: [u32; 2]) -> Result<Buffer> {
        let part = g.upload("part", &places)?;
        let mut strokes = g.buffer("strokes on the screen", STROKE_BYTES * (places[1] - places[0]).max(1) as u64);
        let Desk { drawn, homes, canvas, turns, .. } = desk;
        for group in &drawn.groups {
            let project::Group { block, planes, filtered, first_chunk, chunk_count, .. } = *group;
            let project::Walk { centre, corner, size, near, lanes, perspective, texels, points_per_chunk } = self.walked(g, desk);
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
                    canvases: canvas,
                    part: &part,
                    strokes: &mut strokes,
                    push: stroke_screen::Push { centre, corner, size, near, first_chunk, chunk_count },
                    spec: stroke_screen::Spec { lanes, planes, perspective, texels, points_per_chunk, filtered, slices_of_chunk: 1 },
                },
                group.tiles(),
            );
        }
        Ok(strokes)
    }

    fn draw(&self, g: &mut Graph, desk: &Desk, (strokes, count): (&Buffer, u32), ground: &mut Buffer, targets: &mut [Image; 2], keeps: bool) {
        let (corner, size) = (self.corner(desk.band), desk.band.size.map(|side| side as f32));
        let quads = shader::StrokeQuads {
            strokes,
            stroke_words: strokes,
            canvases: &desk.canvas,
            brushes: &desk.brushes,
            brush_words: &desk.brushes,
            ground,
            push: stroke_quads::Push { corner, size },
            spec: stroke_quads::Spec { perspective: self.is_perspective(), texels: g.gpu.device.texels },
        };
        g.draw(quads, Vertices::Squares(count), targets.each_mut(), keeps);
    }
}
