//! Composites the shaded colour over the background, linear.

use super::GBuffer;
use crate::graph::{Dispatch, Graph, Image, Kind};
use crate::shader::{self, composite::Push, composite::Spec};
use crate::view::View;

pub fn record(g: &mut Graph, view: &View, background: [f32; 3], gbuffer: &GBuffer) -> Image {
    let mut picture = g.image("picture", view.size, Kind::Rgba32f);
    // The accumulated colour of several layers is shaded already.
    let (color, shading) = gbuffer
        .accumulation
        .as_ref()
        .map_or((&gbuffer.color, gbuffer.shading.as_ref()), |layers| (&layers.color, None));
    // Unread bindings need an image, too.
    let (shading, spec) =
        (shading.unwrap_or(&gbuffer.depth), Spec { has_shading: shading.is_some() });
    let push = Push { size: view.size, background };
    g.run(
        shader::Composite { color, shading, picture: &mut picture, push, spec },
        Dispatch::PerPixelInPlace,
    );
    picture
}
