//! Filling by masks: each pixel keeps its own depth, index and colour or takes those of its nearest
//! neighbour (Dobrev, Rosenthal and Linsen 2010, sec. 3.2 and 3.3).
//!
//! ```text
//!     fill_mask_begin    depth -> depth; every pixel is its own source
//!     fill_mask          step: pixels without depth that no mask calls background, until no change
//!     fill_mask          step: pixels that no mask calls visible, until no change
//!     fill_mask_end      index and colour of the sources
//! ```
//! A hole n pixels wide closes in at most n steps. But steps also close notches of silhouettes, up
//! to the diagonal. So the values of a point travel at most one and a half of its spacings on the
//! screen, unless a number of steps is set.
//!
//! Masks see a hole where pixels with points surround it, that is if points are at most a pixel
//! apart ([`APART_PX`]). Sparser surfaces are full of pixels that masks call background or visible,
//! and hidden points shine through. There visibility looks farther ([`super::super::visibility`]):
//! the pixels that it has removed are filled whatever masks say; masks still find hidden pixels.

use super::Settings;
use crate::graph::{Buffer, Dispatch, Graph, Image, Kind};
use crate::passes::{FrameContext, GBuffer, TILE_PX, TileLists, shadows, tiles};
use crate::shader::{self, fill_mask, fill_mask_begin, fill_mask_end};
use crate::view::Projection;

/// Distance that a point's values travel [point spacings]. With one, gaps stay open in random
/// clouds; with two, notches between objects behind each other close.
const REACH: f64 = 1.5;

/// Adjacent pixels often share a point's depth; pixels farther apart seldom do.
const FLAT_PX: u32 = 2;

/// Largest point spacing that masks close `[px]`. Random points farther apart on one surface leave
/// here and there five adjacent pixels of a ring without a point, which masks take for a
/// silhouette. On a plane that fills the picture (300,000 and 480,000 pixels) 194 pixels stay open
/// if the sparser ones are 1.8 pixels apart, 131 at 1.7, 37 at 1.5 and none at 1.25. Hidden layers
/// of nested tori still show in some pixels at 1.25.
pub const APART_PX: f64 = 1.0;

/// Returns the largest number of steps of either kind: as the sparsest points need, at most the
/// widest kernel of visibility; or as set, if a pixel can count them.
pub(super) fn most_steps(settings: &Settings, spacing_px: f64) -> u32 {
    match settings.iterations {
        0.0 => (REACH * spacing_px).ceil().clamp(1.0, super::WIDEST) as u32,
        asked => asked.min(127.0) as u32,
    }
}

pub fn record(
    g: &mut Graph,
    context: &FrameContext,
    settings: &Settings,
    gbuffer: GBuffer,
) -> GBuffer {
    let (size, across) = (context.view.size, tiles(context.view.size));
    let texels = [TILE_PX * across[0], TILE_PX * across[1] / 4];
    let image = |g: &mut Graph, name: &str| g.image(name, texels, Kind::Rgba32f);
    let mut from = ["even depth", "even source"].map(|name| image(g, name));
    let mut to = ["odd depth", "odd source"].map(|name| image(g, name));
    let [opened, source] = &mut from;
    // Steps reach as far as the widest kernel that found holes has seen a point.
    let found = gbuffer
        .holes
        .as_ref()
        .filter(|_| settings.iterations == 0.0)
        .map_or(0, |holes| holes.widest.div_ceil(2).min(super::WIDEST as u32));
    let most = most_steps(settings, gbuffer.spacing_px[1]).max(found);
    let push = fill_mask_begin::Push {
        texels,
        px_per_unit: context.view.focal_px() as f32,
        reach: REACH as f32,
        most: most as f32,
        asked: (settings.iterations > 0.0) as u32,
    };
    let spec = fill_mask_begin::Spec {
        perspective: context.view.camera.projection == Projection::Perspective,
    };
    let GBuffer { depth, index, spacings, .. } = &gbuffer;
    g.run(
        shader::FillMaskBegin { depth, index, spacings, opened, source, push, spec },
        Dispatch::PerPackedTexel(texels),
    );

    let layer = context.layer_m(settings.layer) as f32;
    let mask_steps = [false, true].map(|occluded| {
        let spec = fill_mask::Spec {
            texels: g.gpu.device.has_large_texel_buffers,
            occluded,
            found: gbuffer.holes.is_some(),
        };
        steps(g, size, most, layer, spec, [&mut from, &mut to])
    });

    let [filled, source] = from;
    let mut depth = g.image("filled depth", size, Kind::R32f);
    let mut index = g.image("filled index", size, Kind::R32ui);
    let mut color = g.image("filled color", size, Kind::Rgba32f);
    let (to, push) = ((&mut depth, &mut index, &mut color), fill_mask_end::Push { size });
    g.run(
        shader::FillMaskEnd {
            filled: &filled,
            source: &source,
            index: &gbuffer.index,
            color: &gbuffer.color,
            filled_depth: to.0,
            filled_index: to.1,
            filled_color: to.2,
            push,
        },
        Dispatch::PerPackedTexel([size[0], size[1].div_ceil(4)]),
    );
    shadows::shadow_factor(
        g,
        size,
        GBuffer {
            depth,
            index,
            color,
            flat_px: FLAT_PX,
            depth_source: Some(source),
            holes: None,
            tile_lists: TileLists { mask_steps: Some(mask_steps), ..gbuffer.tile_lists },
            ..gbuffer
        },
    )
}

/// Depth with its source.
type Pair = [Image; 2];

/// Runs steps of one kind, which alternate between the pairs and leave their result in the first.
/// Returns the buffer that counts the steps.
fn steps(
    g: &mut Graph,
    size: [u32; 2],
    most: u32,
    layer: f32,
    spec: fill_mask::Spec,
    [from, to]: [&mut Pair; 2],
) -> Buffer {
    let tiles = tiles(size);
    let count = tiles[0] * tiles[1];
    let woken_at = 4 * (most + 2);
    let mut steps = g.buffer(
        if spec.occluded { "occluded steps" } else { "background steps" },
        4 * (woken_at + count) as u64,
    );
    g.fill(&mut steps, 0);
    for step in 1..=most {
        let push = fill_mask::Push {
            size,
            tiles,
            step,
            woken_at,
            layer,
            most_groups: g.gpu.device.max_workgroups,
        };
        let counted = steps.racy_alias();
        let run = if step == 1 {
            Dispatch::PerEightTiles(count)
        } else {
            Dispatch::Indirect(&counted, 4 * step)
        };
        let ([from_depth, from_source], [to_depth, to_source]) = (&*from, &mut *to);
        g.run(
            shader::FillMask {
                steps: &mut steps,
                step_words: &counted,
                from_depth,
                from_source,
                to_depth,
                to_source,
                push,
                spec,
            },
            run,
        );
        std::mem::swap(from, to);
    }
    steps
}
