//! THE WHOLE FRAME, top to bottom.

use crate::error::Result;
use crate::graph::{Graph, Image};
use crate::look::Look;
use crate::passes::{self, Layers, Scene, composite, normal, project, resolve, shadows};
use crate::resident::Resident;
use crate::view::View;

/// What a frame leaves behind.
pub struct Outcome {
    pub picture: Image,
    /// World normals of the surface, zero where it has none.
    pub normal: Image,
    pub layers: Layers,
    pub statistics: project::Statistics,
}

pub fn record(g: &mut Graph, view: &View, resident: &Resident, look: &Look) -> Result<Outcome> {
    let drawn = project::draw(g, view, resident, look.precision)?;
    let paint = resolve::paint(g, resident)?;
    let mut resolved = resolve::layers(g, view);
    for band in project::bands(view.size, g.binding_limit()) {
        let keys = project::record(g, view, &drawn, band);
        resolved = resolve::record(g, &keys, &paint, band, resolved);
    }
    let scene = Scene::of(view, resident, look.light);
    let marks = shadows::marks(g, &scene, resident, &look.effects, &look.decided)?;
    let layers = Layers { marks, ..resolved.layers(g, view, resident)? };
    let layers = passes::apply(g, &scene, &look.effects, &look.decided, layers);
    let normal = normal::record(g, view, &layers);
    let picture = composite::record(g, view, look.background, &layers);
    Ok(Outcome { picture, normal, layers, statistics: drawn.statistics })
}
