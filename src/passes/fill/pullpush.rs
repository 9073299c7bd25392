//! Pull-push filling through a pyramid of means (Grossman and Dally 1998, sec. 7; Marroquim, Kraus
//! and Cavalcanti 2008, sec. 4).
//!
//! ```text
//!     pull    level k -> k + 1    mean and place of the values in 2 x 2 of the nearest surface
//!     push    level k + 1 -> k    pixels without a value belong to the surface of the nearest
//!                                 known place and take the bilinear mean of the coarser level;
//!                                 values are carried to the middle of their cell
//!     correct level k             pixels without a value are moved by what the coarser level has
//!                                 missed in their neighbours, so that surfaces bend between points
//! ```
//! If visibility ran, its holes are filled, and background neither gives nor takes. If not, holes
//! are unknown: all empty pixels are filled, including the background.

use super::{Settings, tolerance};
use crate::graph::{Dispatch, Graph, Image, Kind};
use crate::passes::GBuffer;
use crate::shader::{self, fill_correct, fill_pull, fill_push, fill_spread};
use crate::view::{Projection, View};

/// Reach of every level `[px]`: three cells up to the ends of adjacent coarser ones, and one that
/// corrections read.
pub(super) fn reach_px(settings: &Settings) -> u32 {
    4 << settings.levels as u32
}

pub fn record(
    g: &mut Graph,
    view: &View,
    settings: &Settings,
    labels: bool,
    gbuffer: GBuffer,
) -> GBuffer {
    let flood = gbuffer.holes.is_none();
    let mut pyramid = Pyramid {
        view,
        settings,
        flood,
        labels,
        perspective: view.camera.projection == Projection::Perspective,
    };
    let (depth, color) = pyramid.filled(g, &gbuffer.depth, &gbuffer.color);
    pyramid.labels = false;
    let shadow_factor =
        gbuffer.shadow_factor.as_ref().map(|factor| pyramid.filled(g, &gbuffer.depth, factor).1);
    GBuffer { depth, color, shadow_factor, holes: None, ..gbuffer }
}

/// The inputs of filling a picture.
struct Pyramid<'s> {
    view: &'s View,
    settings: &'s Settings,
    flood: bool,
    perspective: bool,
    /// True if colours are labels, which are never mixed.
    labels: bool,
}

/// A level above the picture: depths with their places, and colours.
struct Level {
    places: Image,
    color: Image,
}

/// A filled level: depths, colours, and the nearest known place of every cell.
struct Filled {
    depth: Image,
    color: Image,
    places: Image,
}

impl Pyramid<'_> {
    fn filled(&self, g: &mut Graph, depth: &Image, color: &Image) -> (Image, Image) {
        let mut levels: Vec<Level> = Vec::new();
        for number in 1..self.settings.levels as u32 {
            let (places, fine_color) =
                levels.last().map_or((color, color), |level| (&level.places, &level.color));
            if places.desc.size == [1, 1] {
                break;
            }
            let level = self.pull(g, depth, places, fine_color, number);
            levels.push(level);
        }
        let mut coarser = None;
        while let Some(Level { places, color }) = levels.pop() {
            let number = levels.len() as u32 + 1;
            let filled = self.push(g, coarser.as_ref(), depth, Some(&places), &color, number);
            coarser = Some(filled);
        }
        let Filled { depth, color, .. } = self.push(g, coarser.as_ref(), depth, None, color, 0);
        (depth, color)
    }

    /// Computes the next coarser level.
    fn pull(
        &self,
        g: &mut Graph,
        depth: &Image,
        fine_places: &Image,
        fine_color: &Image,
        number: u32,
    ) -> Level {
        let fine_size = fine_color.desc.size;
        let size = fine_size.map(|side| side.div_ceil(2));
        let mut level = Level {
            places: g.image("pulled places", size, Kind::Rgba32f),
            color: g.image("pulled color", size, Kind::Rgba32f),
        };
        let (tolerance, relative) = tolerance(self.view, self.settings, number);
        let push = fill_pull::Push { fine_size, size, tolerance, relative };
        let spec = fill_pull::Spec {
            perspective: self.perspective,
            first: number == 1,
            labels: self.labels,
        };
        let Level { places, color } = &mut level;
        g.run(
            shader::FillPull { depth, fine_places, fine_color, places, color, push, spec },
            Dispatch::PerPixel,
        );
        level
    }

    /// Fills a level from the next coarser one; without places it is the picture.
    fn push(
        &self,
        g: &mut Graph,
        coarser: Option<&Filled>,
        depth: &Image,
        places: Option<&Image>,
        color: &Image,
        number: u32,
    ) -> Filled {
        let size = color.desc.size;
        let picture = places.is_none();
        // Unread bindings need an image, too.
        let places = places.unwrap_or(color);
        let (coarse_depth, coarse_color) =
            coarser.map_or((depth, color), |Filled { depth, color, .. }| (depth, color));
        let coarse_places = coarser.map_or(color, |coarser| &coarser.places);
        let mut depths = ["filled depth", "missed", "correction", "corrected depth"]
            .map(|name| g.image(name, size, Kind::R32f));
        let [filled_depth, missed, correction, corrected_depth] = &mut depths;
        let mut filled_color = g.image("filled color", size, Kind::Rgba32f);
        let places_size = if picture { [1, 1] } else { size };
        let mut filled_places = g.image("filled places", places_size, Kind::Rgba32f);
        let (coarse_tolerance, relative) = tolerance(self.view, self.settings, number + 1);
        let (coarse_size, flood, surrounded) =
            (coarse_depth.desc.size, self.flood as u32, self.settings.surrounded as u32);
        let push = fill_push::Push {
            coarse_size,
            size,
            tolerance: coarse_tolerance,
            relative,
            flood,
            surrounded,
        };
        let spec = fill_push::Spec {
            perspective: self.perspective,
            coarsest: coarser.is_none(),
            picture,
            labels: self.labels,
        };
        g.run(
            shader::FillPush {
                coarse_depth,
                coarse_color,
                coarse_places,
                depth,
                places,
                color,
                filled_depth,
                filled_color: &mut filled_color,
                filled_places: &mut filled_places,
                missed,
                push,
                spec,
            },
            Dispatch::PerPixel,
        );
        let (tolerance, relative) = tolerance(self.view, self.settings, number);
        let push = fill_spread::Push { size, tolerance, relative };
        g.run(shader::FillSpread { filled_depth, missed, correction, push }, Dispatch::PerPixel);
        let push = fill_correct::Push { size, tolerance, relative };
        let spec = fill_correct::Spec { perspective: self.perspective };
        g.run(
            shader::FillCorrect { filled_depth, missed, correction, corrected_depth, push, spec },
            Dispatch::PerPixel,
        );
        let [_, _, _, depth] = depths;
        Filled { depth, color: filled_color, places: filled_places }
    }
}
