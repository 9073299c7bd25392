//! The whole frame, top to bottom.

use crate::error::Result;
use crate::graph::{Buffer, Graph, Image, ReusedImages, TileList};
use crate::passes::project::{Behind, Drawn, Strip};
use crate::passes::resolve::ColorLookup;
use crate::passes::shadows::LightVisibility;
use crate::passes::strokes::Painting;
use crate::passes::transparency::Accumulation;
use crate::passes::{
    self, FrameContext, GBuffer, composite, luminance, predicate, project, resolve, shadows,
    strokes, surface_normal,
};
use crate::render::settings::FrameConfig;
use crate::resident::Resident;
use crate::view::View;

/// The results of a frame.
pub struct Outcome {
    pub picture: Image,
    /// World normals of the surface, zero where it has none.
    pub normal: Image,
    /// G-buffer of the nearest surface.
    pub gbuffer: GBuffer,
    pub statistics: project::Statistics,
    /// Statistics of strokes, if drawn.
    pub strokes: Option<strokes::Painted>,
}

pub fn record(
    g: &mut Graph,
    view: &View,
    resident: &Resident,
    config: &FrameConfig,
) -> Result<Outcome> {
    record_behind(g, view, resident, config, None)
}

/// Records a frame whose layers a host's geometry hides, by its planar depth, each by itself.
pub fn record_behind(
    g: &mut Graph,
    view: &View,
    resident: &Resident,
    config: &FrameConfig,
    occluder: Option<Image>,
) -> Result<Outcome> {
    let key_bytes =
        if config.layers() > 1 { project::KEY_BEHIND_BYTES } else { project::KEY_BYTES };
    let strips = project::strips(view.size, key_bytes, g.gathered_limit());
    let drawn = project::draw_again(g, view, resident, config.precision, |node| {
        config.overlap.touches(view, node)
    })?;
    let drawn = drawn.one_sided(config.drops_back_faces(resident));
    let paint = resolve::paint(g, resident, &passes::color_request(resident, &config.decisions))?;
    let context = config.frame_context(view, resident);
    let points = Points {
        context: &context,
        config,
        resident,
        strips: &strips,
        drawn: &drawn,
        paint: &paint,
    };
    let light_visibility = shadows::light_visibility(
        g,
        &context,
        resident,
        &config.effects,
        &config.decisions,
        config.light_at_once,
    )?;
    let mut images = ReusedImages::default();
    let (gbuffer, strokes) = g.reusing(&mut images, |g| {
        let (nearest, strokes) = match strokes::begin(
            g,
            view,
            resident,
            &config.effects,
            &config.decisions,
            config.strokes_at_once,
        )? {
            Some(painting) => points.painted(g, painting)?,
            None => (points.nearest(g, None)?, None),
        };
        Ok((
            passes::apply(
                g,
                &context,
                &config.effects,
                &config.decisions,
                GBuffer { light_visibility, occluder, ..nearest },
            ),
            strokes,
        ))
    })?;
    let gbuffer = behind(g, &points, gbuffer, images)?;
    let normal = surface_normal::record(g, view, &gbuffer);
    let picture = composite::record(g, view, config.background, &gbuffer);
    Ok(Outcome { picture, normal, gbuffer, statistics: drawn.statistics, strokes })
}

/// Draws the layers behind the nearest one: the middle of the frame again for each, until the
/// device finds nothing more to draw. A layer that shows nothing ends the sequence, so each layer
/// is drawn into the images of the one before, and only where that showed something.
fn behind(
    g: &mut Graph,
    points: &Points,
    mut nearest: GBuffer,
    mut images: ReusedImages,
) -> Result<GBuffer> {
    let config = points.config;
    if config.layers() == 1 {
        return Ok(nearest);
    }
    let grows_px = config.effects.grows_px(&config.decisions, nearest.spacing_px[1]);
    let mut alive = points.drawn.alive(g);
    let mut before = predicate::occupied_tiles(g, &nearest.projected_depth, grows_px);
    nearest = kept(g, nearest);
    for layer in 1..config.layers() {
        let accumulation =
            nearest.accumulation.take().expect("transparency runs where there are several layers");
        let (light_visibility, behind) = (
            nearest.light_visibility.take(),
            Next { accumulation, alive: &mut alive, layer, grows_px },
        );
        let (next, covered) =
            g.reusing(&mut images, |g| points.next(g, behind, light_visibility, &before))?;
        (nearest.light_visibility, nearest.accumulation, before) =
            (next.light_visibility, next.accumulation, covered);
    }
    Ok(nearest)
}

/// Copies the images that later layers overwrite; unread copies are culled.
fn kept(g: &mut Graph, gbuffer: GBuffer) -> GBuffer {
    let images = [
        ("depth", &gbuffer.depth),
        ("projected depth", &gbuffer.projected_depth),
        ("index", &gbuffer.index),
        ("projected index", &gbuffer.projected_index),
        ("color", &gbuffer.color),
    ];
    let [depth, projected_depth, index, projected_index, color] =
        images.map(|(name, image)| g.copy(name, image));
    let shading = gbuffer.shading.as_ref().map(|shading| g.copy("shading", shading));
    GBuffer { depth, projected_depth, index, projected_index, color, shading, ..gbuffer }
}

/// A layer to draw behind others.
struct Next<'b> {
    accumulation: Accumulation,
    /// State of the walks over points, kept from layer to layer.
    alive: &'b mut Buffer,
    /// Number of the layer, from 1.
    layer: u32,
    /// Distance from its points within which a layer may show something `[px]`.
    grows_px: f64,
}

/// The inputs of every layer.
struct Points<'p> {
    context: &'p FrameContext<'p>,
    config: &'p FrameConfig,
    resident: &'p Resident,
    strips: &'p [Strip],
    drawn: &'p Drawn,
    paint: &'p ColorLookup,
}

impl Points<'_> {
    /// Resolves the nearest point of each pixel, of all points or of those behind earlier layers.
    /// `behind` has the keys of each strip, the state of the walks, and the layer's number.
    fn nearest(
        &self,
        g: &mut Graph,
        mut behind: Option<(&mut [Buffer], &mut Buffer, u32)>,
    ) -> Result<GBuffer> {
        let view = self.context.view;
        let mut resolved = resolve::begin(g, view);
        let averaged = &self.config.effects.luminance.settings;
        let mut shallow = luminance::shallow(g, self.context, averaged, self.drawn, self.paint);
        for (number, &strip) in self.strips.iter().enumerate() {
            let behind = behind.as_mut().map(|(keys, alive, layer)| Behind {
                keys: &mut keys[number],
                alive,
                layer: *layer,
            });
            let keys = project::record(g, view, self.drawn, behind, shallow.as_mut(), strip);
            resolved = resolve::record(g, &keys, self.paint, strip, resolved);
        }
        let gbuffer = resolved.gbuffer(g, view, self.resident)?;
        let luminance_sums = match &shallow {
            Some(shallow) => Some(luminance::sums(
                g,
                self.context,
                averaged,
                self.drawn,
                shallow,
                self.paint,
                &gbuffer.projected_depth,
            )?),
            None => None,
        };
        Ok(GBuffer { luminance_sums, ..gbuffer })
    }

    /// Draws the next layer where the one before showed something. Returns it with the area where
    /// it shows something itself.
    fn next(
        &self,
        g: &mut Graph,
        next: Next,
        light_visibility: Option<LightVisibility>,
        before: &TileList,
    ) -> Result<(GBuffer, TileList)> {
        let Next { mut accumulation, alive, layer, grows_px } = next;
        let bounded = grows_px.is_finite();
        let left = predicate::area_where(g, &accumulation.left, before);
        let (gbuffer, covered) = predicate::only_where(g, &accumulation.left, |g| {
            g.within_tiles(bounded.then_some(&left), |g| {
                let gbuffer = self.nearest(g, Some((&mut accumulation.next, alive, layer)))?;
                let covered = predicate::occupied_tiles(g, &gbuffer.projected_depth, grows_px);
                Ok((gbuffer, covered))
            })
        })?;
        let shown = predicate::area_where(g, &covered.list, &left);
        let gbuffer = GBuffer { light_visibility, accumulation: Some(accumulation), ..gbuffer };
        let gbuffer = predicate::only_where(g, &covered.list, |g| {
            Ok(g.within_tiles(bounded.then_some(&shown), |g| {
                passes::apply(
                    g,
                    self.context,
                    &self.config.effects,
                    &self.config.decisions,
                    gbuffer,
                )
            }))
        })?;
        Ok((gbuffer, covered))
    }

    /// Draws all points as strokes.
    fn painted(
        &self,
        g: &mut Graph,
        mut painting: Painting,
    ) -> Result<(GBuffer, Option<strokes::Painted>)> {
        let mut resolved = resolve::begin(g, self.context.view);
        for strip in painting.strips(g.gathered_limit()) {
            let keys = painting.record(g, self.paint, strip)?;
            resolved = resolve::record(g, &keys, self.paint, strip, resolved);
        }
        let painted = painting.cover(&mut resolved);
        Ok((resolved.gbuffer(g, self.context.view, self.resident)?, Some(painted)))
    }
}
