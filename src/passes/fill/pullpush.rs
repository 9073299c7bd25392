//! Pull-push: depth and colour with holes in, without out, through a pyramid of means (Grossman and Dally 1998, sec. 7; Marroquim, Kraus and Cavalcanti 2008, sec. 4).
//!
//! ```text
//!     pull   level k -> k + 1   mean of those of 2 x 2 that have a value and are of the nearest surface among them, until one pixel is left
//!     push   level k + 1 -> k   pixels without a value take the bilinear mean of the coarser level
//! ```
//! Where visibility ran, its holes are filled and background gives and takes nothing. Where it did not, nobody knows which empty pixels are holes: all are filled, and the background is flooded.

use super::{Settings, tolerance};
use crate::graph::{Graph, Image, Kind, Tiles};
use crate::passes::Layers;
use crate::shader::{self, fill_pull, fill_push};
use crate::view::View;

pub fn record(g: &mut Graph, view: &View, settings: &Settings, layers: Layers) -> Layers {
    let flood = layers.holes.is_none();
    let Layers { depth, color, reached, .. } = layers;
    let reached = reached.map(|reached| {
        let depth = g.copy("depth", &depth);
        filled(g, view, settings, flood, depth, reached).1
    });
    let (depth, color) = filled(g, view, settings, flood, depth, color);
    Layers { depth, color, reached, holes: None, ..layers }
}

fn filled(g: &mut Graph, view: &View, settings: &Settings, flood: bool, depth: Image, color: Image) -> (Image, Image) {
    let (tolerance, relative) = tolerance(view, settings);
    let mut pyramid: Vec<(Image, Image)> = vec![(depth, color)];
    while pyramid.len() == 1 || pyramid[pyramid.len() - 1].0.desc.size != [1, 1] {
        let (fine_depth, fine_color) = &pyramid[pyramid.len() - 1];
        let fine_size = fine_depth.desc.size;
        let size = fine_size.map(|side| side.div_ceil(2));
        let mut depth = g.image("pulled depth", size, Kind::R32f);
        let mut color = g.image("pulled color", size, Kind::Rgba32f);
        let push = fill_pull::Push { fine_size, size, tolerance, relative };
        g.run(shader::FillPull { fine_depth, fine_color, depth: &mut depth, color: &mut color, push }, Tiles::All);
        pyramid.push((depth, color));
    }
    let mut filled = pyramid.pop().expect("one level at least");
    while let Some((mut depth, mut color)) = pyramid.pop() {
        let (coarse_depth, coarse_color) = &filled;
        let push = fill_push::Push { coarse_size: coarse_depth.desc.size, size: depth.desc.size, tolerance, relative, flood: flood as u32 };
        g.run(shader::FillPush { coarse_depth, coarse_color, depth: &mut depth, color: &mut color, push }, Tiles::All);
        filled = (depth, color);
    }
    filled
}
