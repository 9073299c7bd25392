//! Transparency: composites surfaces behind each other, peeled from front to back (Dobrev et al.
//! 2010, sec. 4 and 5).
//!
//! ```text
//!     each layer
//!         project, resolve   the nearest of the points behind the last layer    if a pixel is left
//!         all effects        as for a picture of its own                        where points were found
//!         transparency       color, shading -> front, in linear light
//!                            depth -> depth where the next layer begins, and whether a pixel is left
//! ```
//! A layer is everything within the layer distance of its surface. The next one begins behind that.
//! The distance is how far noise and filling may move a surface, and how deep a slanted one is
//! within a pixel. As many layers as allowed are recorded, and the device skips empty ones
//! ([`super::predicate`]).
//!
//! Behind a pixel without a point there are no layers. So each layer works only on tiles where the
//! one before had points, or where effects may have carried them (`grows_px`).

use super::project::{self, Strip};
use super::visibility::Looked;
use super::{
    Effect, EffectDecisions, Effects, FrameContext, GBuffer, Reason, Setting, Value, fill,
};
use crate::graph::{Buffer, Dispatch, Graph, Image, Kind};
use crate::shader::{self, peel_count, transparency::Push, transparency::Spec};
use crate::view::View;

pub const SUMMARY: &str = "transparent surfaces (--opacity): layers from front to back";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    /// Largest number of layers.
    pub layers: f64,
    /// Tiles where further layers are looked for.
    pub tiles: Looked,
    /// Distance behind a surface within which points belong to it `[m]`; 0: the layer distance of
    /// the picture, and at least the depth of the surface within a pixel.
    pub layer: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Settings { layers: 16.0, tiles: Looked::Needed, layer: 0.0 }
    }
}

impl super::Settings for Settings {
    fn list_all(&mut self) -> Vec<Setting<'_>> {
        vec![
            Setting::new(
                "layers",
                "largest number of surfaces behind each other",
                Value::Whole(&mut self.layers, 1.0..=64.0),
            ),
            // For studies.
            Setting::variant("tiles", Value::Choice(&mut self.tiles)),
            Setting::variant("layer", Value::Length(&mut self.layer, 0.0..=1e9)),
        ]
    }

    /// Pixels without a point do not change.
    fn grows_px(&self, _spacing_px: f64) -> f64 {
        if self.tiles == Looked::All { f64::INFINITY } else { 0.0 }
    }
}

/// See [`super::Effects::reach_px`]: the distance over which depths may have been carried.
pub fn reach_px(_view: &View, _settings: &Settings) -> Option<u32> {
    Some(fill::WIDEST as u32)
}

pub fn called_for(context: &FrameContext, asked: &Effects, before: &EffectDecisions) -> Reason {
    if before.runs(Effect::Strokes) {
        return Reason { runs: false, why: "strokes are blended by their own opacity".into() };
    }
    if !context.transparent {
        return Reason { runs: false, why: "all points are opaque; --opacity changes that".into() };
    }
    let Settings { layers, layer, .. } = asked.transparency.settings;
    let (layer, s) = (context.metres(context.layer_m(layer)), if layers == 1.0 { "" } else { "s" });
    Reason {
        runs: true,
        why: format!(
            "some points are not opaque: up to {layers} layer{s}, {layer} m apart at least"
        ),
    }
}

/// Factor on the depth of a surface within a pixel, beyond its slope: it may curve, have noise, and
/// be steeper on the other side.
const SLANT: f32 = 4.0;

/// Additional factor for each pixel that its depth was carried as the nearest of its neighbours
/// (Dobrev et al. 2010, sec. 3.2 and 3.3). Without it, the rest of a steep surface is a layer of
/// its own.
const UPHILL: f32 = 3.0;

/// All layers so far, composited.
pub struct Accumulation {
    /// Linear colour, premultiplied; alpha is how much they hide of the surfaces behind.
    pub color: Image,
    /// Number of surfaces of each pixel, for tests and studies.
    pub peeled: Image,
    /// Keys of the next layer for each strip, still empty, with the depths behind which it is
    /// looked for, which only grow.
    pub next: Vec<Buffer>,
    /// Not 0 if a pixel is unfinished.
    pub left: Buffer,
    /// Planar depth of a host's geometry, which hides the layers behind it; None without.
    occluder: Option<Image>,
    /// Number of layers so far.
    pub layers: u32,
}

/// Composites the layer under those in front of it, and finds where the next one begins.
pub fn record(
    g: &mut Graph,
    context: &FrameContext,
    settings: &Settings,
    mut gbuffer: GBuffer,
) -> GBuffer {
    let size = context.view.size;
    let strips = project::strips(size, project::KEY_BEHIND_BYTES, g.gathered_limit());
    let before = gbuffer
        .accumulation
        .take()
        .map(|front| (front.color, front.peeled, front.next, front.occluder, front.layers));
    let (mut front, mut peeled, mut next, occluder, number) = before.unwrap_or_else(|| {
        let occluder = gbuffer.occluder.take();
        let next = strips
            .iter()
            .map(|strip| g.buffer("next keys", project::KEY_BEHIND_BYTES * strip.pixels()))
            .collect();
        let (front, peeled) =
            (g.image("front", size, Kind::Rgba32f), g.image("peeled", size, Kind::R32f));
        (front, peeled, next, occluder, 0)
    });
    let mut left = g.buffer("left", 4);
    g.fill(&mut left, 0);
    // Unread bindings need an image, too.
    let shading = gbuffer.shading.as_ref().unwrap_or(&gbuffer.depth);
    // The first layer covers the whole picture and reads neither.
    let (front_before, peeled_before) = if number == 0 {
        (gbuffer.color.alias(), gbuffer.depth.alias())
    } else {
        (front.alias(), peeled.alias())
    };
    let (color, push, spec) =
        (&gbuffer.color, peel_count::Push { size }, peel_count::Spec { first: number == 0 });
    g.run(
        shader::PeelCount { color, before: &peeled_before, peeled: &mut peeled, push, spec },
        Dispatch::PerPixel,
    );
    let last = number + 1 == settings.layers as u32;
    let spec = Spec {
        has_shading: gbuffer.shading.is_some(),
        first: number == 0,
        last,
        texels: g.gpu.device.has_large_texel_buffers,
        taken: gbuffer.depth_source.is_some(),
        occluded: occluder.is_some(),
    };
    let [slant, uphill] = if settings.layer == 0.0 { [SLANT, UPHILL] } else { [0.0; 2] };
    let layer = context.layer_m(settings.layer) as f32;
    for (&Strip { top, size }, next) in strips.iter().zip(&mut next) {
        let push = Push {
            size,
            top,
            layer,
            slant,
            uphill,
            carried: (gbuffer.flat_px - 1) as f32,
            apart_px: gbuffer.flat_px as i32,
        };
        let source = gbuffer.depth_source.as_ref().unwrap_or(&gbuffer.color);
        let GBuffer { color, depth, projected_depth, .. } = &gbuffer;
        let any_left = &left.racy_alias();
        let keys = &if number == 0 { left.racy_alias() } else { next.racy_alias() };
        g.run(
            shader::Transparency {
                color,
                shading,
                depth,
                projected_depth,
                source,
                occluder: occluder.as_ref().unwrap_or(depth),
                front_before: &front_before,
                front: &mut front,
                keys,
                key_words: keys,
                next,
                any_left,
                left: &mut left,
                push,
                spec,
            },
            Dispatch::Groups([size[0].div_ceil(64), size[1], 1]),
        );
    }
    GBuffer {
        accumulation: Some(Accumulation {
            color: front,
            peeled,
            next,
            left,
            occluder,
            layers: number + 1,
        }),
        ..gbuffer
    }
}
