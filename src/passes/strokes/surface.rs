//! Finds where a surface is, from the ground of strokes, for both ways of blending.
//!
//! Ends of strokes stand out from crests and claws; what only they cover is not painted. Near its
//! own point a stroke lies on the surface: near ground. Farther out
//! ([`Brush::ground`](super::brush::Brush::ground)) it counts only if near ground is close by in
//! half of all directions. So gaps between strokes are closed, but outlines do not grow, and
//! notches and holes stay open.

use super::Painting;
use super::quads::Quads;
use crate::error::Result;
use crate::graph::{Buffer, Dispatch, Graph};
use crate::passes::project::Strip;
use crate::passes::resolve;
use crate::shader::{self, stroke_surface};

/// Distance within which near ground is looked for `[px]`.
pub const ENCLOSED_PX: u32 = 2;
/// Number of the eight directions in which it must be found.
pub const DIRECTIONS: u32 = 4;
/// How much less far near ground reaches than all ground: a share of what exceeds a pixel, so that
/// small strokes have pixels; and at most this many pixels, so that large ones have no gaps wider
/// than are closed.
pub const NEARER: f64 = 0.6;
pub const NEARER_PX: f64 = 4.0;

/// Returns 1 for every pixel of a strip where a surface is, else 0, from the ground of the strip
/// and its surroundings.
pub fn surface(g: &mut Graph, ground: &Buffer, strip: Strip) -> Buffer {
    let [width, height] = strip.size;
    let mut surface = g.buffer("surface", 4 * width as u64 * height as u64);
    let push = stroke_surface::Push { width, enclosed: ENCLOSED_PX, directions: DIRECTIONS };
    g.run(
        shader::StrokeSurface { ground, surface: &mut surface, push },
        Dispatch::Groups([width.div_ceil(64), height, 1]),
    );
    surface
}

impl Painting<'_> {
    /// Returns the same, computed before the frame.
    pub(super) fn surface(&mut self, g: &mut Graph, strip: Strip) -> Result<Option<Vec<u32>>> {
        let found = self.ask(g, format!("surface {strip:?}"), |painting, before| {
            let paint = resolve::paint(before, painting.resident, &painting.request)?;
            let desk = painting.bind(before, strip, &paint)?;
            let Quads { ground, .. } = painting.draw(before, &desk, false)?;
            let surface = surface(before, &ground, strip);
            Ok([before.download_buffer(&surface)])
        })?;
        Ok(found.map(|[surface]| surface))
    }
}
