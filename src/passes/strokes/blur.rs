//! Softens z-buffered strokes (dos Anjos et al. 2018, sec. 3.3.3): across, then down.

use super::settings::{Blend, Settings};
use crate::graph::{Dispatch, Graph, Kind};
use crate::passes::{FrameContext, GBuffer};
use crate::shader::{self, stroke_blur};

/// Softens strokes with blend=blur.
pub fn record(
    g: &mut Graph,
    context: &FrameContext,
    settings: &Settings,
    gbuffer: GBuffer,
) -> GBuffer {
    if settings.blend != Blend::Blur {
        return gbuffer;
    }
    let radius = settings.radius.round().min(8.0);
    // Falls to e^-2 at the radius.
    let weights = std::array::from_fn(|k| (-2.0 * (k as f64 / radius).powi(2)).exp() as f32);
    let mut color = gbuffer.color;
    for along in [[1, 0], [0, 1]] {
        let mut blurred = g.image("blurred", context.view.size, Kind::Rgba32f);
        let push =
            stroke_blur::Push { size: context.view.size, along, weights, radius_px: radius as i32 };
        g.run(
            shader::StrokeBlur { color: &color, blurred: &mut blurred, push },
            Dispatch::PerPixel,
        );
        color = blurred;
    }
    GBuffer { color, ..gbuffer }
}
