//! THE WHOLE FRAME, top to bottom.

use crate::error::Result;
use crate::graph::{Buffer, Graph, Image};
use crate::look::Look;
use crate::passes::project::{Band, Behind, Drawn};
use crate::passes::resolve::Paint;
use crate::passes::strokes::Painting;
use crate::passes::{self, Layers, Scene, composite, gate, luminance, normal, project, resolve, shadows, strokes};
use crate::resident::Resident;
use crate::view::View;

/// What a frame leaves behind.
pub struct Outcome {
    pub picture: Image,
    /// World normals of the surface, zero where it has none.
    pub normal: Image,
    /// Of the nearest surface.
    pub layers: Layers,
    pub statistics: project::Statistics,
    /// Where points are painted.
    pub strokes: Option<strokes::Facts>,
}

pub fn record(g: &mut Graph, view: &View, resident: &Resident, look: &Look) -> Result<Outcome> {
    let bands = project::bands(view.size, g.binding_limit());
    let drawn = project::draw(g, view, resident, look.precision)?.one_sided(look.drops_back_faces(resident));
    let paint = resolve::paint(g, resident, &look.decided)?;
    let scene = look.scene(view, resident);
    let points = Points { scene: &scene, look, resident, bands: &bands, drawn: &drawn, paint: &paint };
    let marks = shadows::marks(g, &scene, resident, &look.effects, &look.decided)?;
    let (nearest, strokes) = match strokes::begin(g, view, resident, &look.effects, &look.decided)? {
        Some(painting) => points.painted(g, painting)?,
        None => (points.nearest(g, None)?, None),
    };
    let layers = passes::apply(g, &scene, &look.effects, &look.decided, Layers { marks, ..nearest });
    let layers = behind(g, &points, &scene, look, layers)?;
    let normal = normal::record(g, view, &layers);
    let picture = composite::record(g, view, look.background, &layers);
    Ok(Outcome { picture, normal, layers, statistics: drawn.statistics, strokes })
}

/// The layers behind the nearest one: the middle of the frame again for each, until the device finds nothing more to draw.
fn behind(g: &mut Graph, points: &Points, scene: &Scene, look: &Look, mut nearest: Layers) -> Result<Layers> {
    let mut alive = points.drawn.alive(g);
    for layer in 1..look.layers() {
        let front = nearest.front.take().expect("transparency runs where there are several layers");
        let next = gate::only_where(g, &front.left, |g| points.nearest(g, Some((&front.behind, &mut alive, layer))))?;
        let covered = gate::covered(g, &next);
        let next = Layers { marks: nearest.marks.take(), front: Some(front), ..next };
        let next = gate::only_where(g, &covered, |g| Ok(passes::apply(g, scene, &look.effects, &look.decided, next)))?;
        (nearest.marks, nearest.front) = (next.marks, next.front);
    }
    Ok(nearest)
}

/// What layers are drawn from.
struct Points<'p> {
    scene: &'p Scene<'p>,
    look: &'p Look,
    resident: &'p Resident,
    bands: &'p [Band],
    drawn: &'p Drawn,
    paint: &'p Paint,
}

impl Points<'_> {
    /// Of all points, or of those behind the depths of each band, the nearest of each pixel; with what walks over them keep from layer to layer, and which layer it is.
    fn nearest(&self, g: &mut Graph, mut behind: Option<(&[Buffer], &mut Buffer, u32)>) -> Result<Layers> {
        let view = self.scene.view;
        let mut resolved = resolve::layers(g, view);
        for (number, &band) in self.bands.iter().enumerate() {
            let behind = behind.as_mut().map(|(bands, alive, layer)| Behind { depths: &bands[number], alive, layer: *layer });
            let keys = project::record(g, view, self.drawn, behind, band);
            resolved = resolve::record(g, &keys, self.paint, band, resolved);
        }
        let layers = resolved.layers(g, view, self.resident)?;
        let settings = &self.look.effects.luminance.settings;
        let sums = match self.look.decided.runs("luminance") {
            true => luminance::sums(g, self.scene, settings, self.drawn, self.paint, &layers.raw)?,
            false => None,
        };
        Ok(Layers { sums, ..layers })
    }

    /// All points, as strokes.
    fn painted(&self, g: &mut Graph, mut painting: Painting) -> Result<(Layers, Option<strokes::Facts>)> {
        let mut resolved = resolve::layers(g, self.scene.view);
        for &band in self.bands {
            let keys = painting.record(g, band)?;
            resolved = resolve::record(g, &keys, self.paint, band, resolved);
        }
        let facts = painting.cover(&mut resolved);
        Ok((resolved.layers(g, self.scene.view, self.resident)?, Some(facts)))
    }
}
