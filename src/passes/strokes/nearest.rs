//! Draws the nearest stroke of each pixel, z-buffered, where a surface is.

use super::Painting;
use super::quads::{Quads, STROKE_BYTES};
use super::surface::{self, ENCLOSED_PX};
use crate::error::Result;
use crate::graph::{Buffer, Dispatch, Graph};
use crate::passes::project::Strip;
use crate::passes::resolve::ColorLookup;
use crate::shader::{self, stroke_keys};

impl Painting<'_> {
    /// Returns the keys of a strip.
    pub(super) fn nearest(
        &mut self,
        g: &mut Graph,
        paint: &ColorLookup,
        strip: Strip,
    ) -> Result<Buffer> {
        let desk = self.bind(g, strip, paint)?;
        let Quads { ground, nearest, at_once } = self.draw(g, &desk, true)?;
        self.facts.listed += desk.places as u64;
        self.facts.parts += desk.places.max(1).div_ceil(at_once);
        self.facts.bytes = self.facts.bytes.max(STROKE_BYTES * at_once.min(desk.places) as u64);
        let surface = surface::surface(g, &ground, strip);
        let mut around = g.buffer("keys around", nearest.desc.bytes());
        g.copy_out(&nearest, &mut around);
        let [width, height] = strip.size;
        let mut keys = g.buffer("keys", 8 * width as u64 * height as u64);
        let push = stroke_keys::Push { width, border: ENCLOSED_PX };
        g.run(
            shader::StrokeKeys { surface: &surface, around: &around, keys: &mut keys, push },
            Dispatch::Groups([width.div_ceil(64), height, 1]),
        );
        Ok(keys)
    }
}
