//! Computes the planar depth of a host's geometry from its depth image.

use crate::gpu::memory::RawBuffer;
use crate::graph::{Dispatch, Graph, Image, Kind};
use crate::shader::{self, occluder::Push, occluder::Spec};
use crate::view::{Projection, View};

/// A copy of a host's depth in the area of a view, row by row.
pub struct HostDepth {
    pub copy: RawBuffer,
    /// Bits of a depth: 16 of half a word, 24 of a word, or a float of 32.
    pub bits: u32,
    /// The host's depth, `a + b / z` with perspective, `a + b z` without, of planar depth z.
    pub form: [f32; 2],
    /// The host's depth of what is infinitely far.
    pub far: f32,
}

/// Returns the planar depth in each pixel, infinite where nothing is.
pub fn record(g: &mut Graph, view: &View, host: &HostDepth) -> Image {
    let HostDepth { copy, bits, form, far } = host;
    let stored = &g.import("host depth", copy);
    let mut occluder = g.image("occluder", view.size, Kind::R32f);
    let push = Push { size: view.size, form: *form, far: *far };
    let perspective = view.camera.projection == Projection::Perspective;
    let spec = Spec { bits: *bits, perspective };
    g.run(shader::Occluder { stored, occluder: &mut occluder, push, spec }, Dispatch::PerPixel);
    occluder
}
