//! LAYERS -> what they show together: surfaces behind each other, peeled off from front to back (Dobrev et al. 2010, sec. 4 and 5).
//!
//! ```text
//!     each layer
//!         project, resolve   of the points that lie behind the last layer, the nearest    only where a pixel is left
//!         all effects        as of a picture of its own                                   only where that found points
//!         transparency       color, lit -> front, in linear light; depth -> how deep the next layer begins, and whether a pixel is left
//! ```
//! A layer is everything within the layer distance of its surface. The next one begins behind that; the distance is what noise and filling may have moved a surface by, and how deep a slanted one is
//! within a pixel. Layers are recorded as often as is allowed, and the device skips those that are empty ([`super::gate`]).
//!
//! Behind a pixel without a point there are none, so of every layer only the tiles are worked on where the one before it had points, or effects may have carried what these show (`grows_px`).

use super::project::{self, Band};
use super::visibility::Looked;
use super::{
    Decided, Effect, Effects, FrameContext, GBuffer, Reason, Setting, Value, fill, significant,
};
use crate::graph::{Buffer, Dispatch, Graph, Image, Kind};
use crate::shader::{self, peel_count, transparency::Push, transparency::Spec};
use crate::view::View;

pub const SUMMARY: &str =
    "surfaces that let through what is behind them: layers, from front to back (--opacity)";

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    /// Layers at most.
    pub layers: f64,
    /// Where layers behind others are looked for.
    pub tiles: Looked,
    /// Points this near behind a surface are of it, metres; 0: the layer distance of the picture, and at least as deep as the surface is within a pixel.
    pub layer: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Settings { layers: 16.0, tiles: Looked::Needed, layer: 0.0 }
    }
}

impl super::Settings for Settings {
    fn list_all(&mut self) -> Vec<Setting<'_>> {
        let number = Value::Number;
        vec![
            Setting::new(
                "layers",
                "largest number of surfaces behind each other",
                Value::Whole(&mut self.layers, 1.0..=64.0),
            ),
            // For studies.
            Setting::variant("tiles", Value::Choice(&mut self.tiles)),
            Setting::variant("layer", number(&mut self.layer, 0.0..=1e9)),
        ]
    }

    /// What holds no point stays as it is.
    fn grows_px(&self, _spacing_px: f64) -> f64 {
        if self.tiles == Looked::All { f64::INFINITY } else { 0.0 }
    }
}

/// As [`super::Effects::reach_px`]: how far depths may have been carried.
pub fn reach_px(_view: &View, _settings: &Settings) -> Option<u32> {
    Some(fill::WIDEST as u32)
}

pub fn called_for(context: &FrameContext, asked: &Effects, before: &Decided) -> Reason {
    if before.runs(Effect::Strokes) {
        return Reason {
            runs: false,
            why: "strokes lie over each other by themselves, each as opaque as its point".into(),
        };
    }
    if !context.transparent {
        return Reason {
            runs: false,
            why: "all points that are drawn are opaque; --opacity says otherwise".into(),
        };
    }
    let Settings { layers, layer, .. } = asked.transparency.settings;
    let (layer, s) = (significant(context.layer_m(layer)), if layers == 1.0 { "" } else { "s" });
    Reason {
        runs: true,
        why: format!(
            "some points are not opaque: up to {layers} layer{s}, {layer} m apart at least"
        ),
    }
}

/// A surface is this much deeper within a pixel than its slope says, which curves, has noise, and is steeper on the other side.
const SLANT: f32 = 4.0;

/// And this much for each pixel that its depth was carried, as the nearest of those around (Dobrev et al. 2010, sec. 3.2 and 3.3): without it, what is left of a steep surface is a layer of its own.
const UPHILL: f32 = 3.0;

/// All layers so far.
pub struct Accumulation {
    /// What they show: linear, multiplied by its opacity; alpha is what they hide of what is behind them.
    pub color: Image,
    /// How many surfaces that is, for whoever asks.
    pub peeled: Image,
    /// Of every band, the keys of the next layer, still empty, and the depths that it is looked for behind, which only grow.
    pub next: Vec<Buffer>,
    /// Not 0 where a pixel is not finished.
    pub left: Buffer,
    /// How many layers there have been.
    pub layers: u32,
}

/// The layer under those in front of it, and where the next one begins.
pub fn record(
    g: &mut Graph,
    context: &FrameContext,
    settings: &Settings,
    mut gbuffer: GBuffer,
) -> GBuffer {
    let size = context.view.size;
    let bands = project::bands(size, project::KEY_BEHIND_BYTES, g.gathered_limit());
    let before = gbuffer
        .accumulation
        .take()
        .map(|front| (front.color, front.peeled, front.next, front.layers));
    let (mut front, mut peeled, mut next, number) = before.unwrap_or_else(|| {
        let next = bands
            .iter()
            .map(|band| g.buffer("next keys", project::KEY_BEHIND_BYTES * band.pixels()))
            .collect();
        (g.image("front", size, Kind::Rgba32f), g.image("peeled", size, Kind::R32f), next, 0)
    });
    let mut left = g.buffer("left", 4);
    g.fill(&mut left, 0);
    // Without light there is nothing to read; a binding wants an image all the same.
    let lit = gbuffer.shading.as_ref().unwrap_or(&gbuffer.depth);
    // The first layer is of the whole picture, and reads neither.
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
        lit_by: gbuffer.shading.is_some(),
        first: number == 0,
        last,
        texels: g.gpu.device.has_large_texel_buffers,
        taken: gbuffer.depth_source.is_some(),
    };
    let [slant, uphill] = if settings.layer == 0.0 { [SLANT, UPHILL] } else { [0.0; 2] };
    let layer = context.layer_m(settings.layer) as f32;
    for (&Band { top, size }, next) in bands.iter().zip(&mut next) {
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
        let GBuffer { color, depth, projected_depth: raw, .. } = &gbuffer;
        let any_left = &left.racy_alias();
        let keys = &if number == 0 { left.racy_alias() } else { next.racy_alias() };
        g.run(
            shader::Transparency {
                color,
                lit,
                depth,
                raw,
                source,
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
        accumulation: Some(Accumulation { color: front, peeled, next, left, layers: number + 1 }),
        ..gbuffer
    }
}
