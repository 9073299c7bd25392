//! LAYERS -> PICTURE: colour over the background, linear.

use super::Layers;
use crate::graph::{Graph, Image, Kind, Tiles};
use crate::shader::{self, composite::Push};
use crate::view::View;

pub fn record(g: &mut Graph, view: &View, background: [f32; 3], layers: &Layers) -> Image {
    let mut picture = g.image("picture", view.size, Kind::Rgba32f);
    g.run(shader::Composite { color: &layers.color, picture: &mut picture, push: Push { size: view.size, background } }, Tiles::All);
    picture
}
