//! LAYERS -> PICTURE: lit colour over the background, linear.

use super::Layers;
use crate::graph::{Dispatch, Graph, Image, Kind};
use crate::shader::{self, composite::Push, composite::Spec};
use crate::view::View;

pub fn record(g: &mut Graph, view: &View, background: [f32; 3], layers: &Layers) -> Image {
    let mut picture = g.image("picture", view.size, Kind::Rgba32f);
    // What several layers show together is lit already.
    let (color, lit) = layers
        .front
        .as_ref()
        .map_or((&layers.color, layers.lit.as_ref()), |front| (&front.color, None));
    // Without light there is nothing to read; a binding wants an image all the same.
    let (lit, spec) = (lit.unwrap_or(&layers.depth), Spec { lit_by: lit.is_some() });
    let push = Push { size: view.size, background };
    g.run(
        shader::Composite { color, lit, picture: &mut picture, push, spec },
        Dispatch::PerPixelInPlace,
    );
    picture
}
