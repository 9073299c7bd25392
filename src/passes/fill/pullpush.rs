//! Pull-push: depth and colour with holes in, without out, through a pyramid of means (Grossman and Dally 1998, sec. 7; Marroquim, Kraus and Cavalcanti 2008, sec. 4).
//!
//! ```text
//!     pull    level k -> k + 1   mean of those of 2 x 2 that have a value and are of the nearest surface among them, with its place
//!     push    level k + 1 -> k   what has no value is of the surface known nearest to it, and takes the bilinear mean of the coarser level there; what has one is carried to its cell's middle
//!     relax   level k            what has no value takes the mean of those around it, so that coarse cells leave no corners
//! ```
//! Leaves and branches are no surface (glsl/fill/fill_scattered.comp): there colours are those of the nearest point, and none is between two of them.
//!
//! Where visibility ran, its holes are filled and background gives and takes nothing. Where it did not, nobody knows which empty pixels are holes: all are filled, and the background is flooded.

use super::{Settings, tolerance};
use crate::graph::{Buffer, Dispatch, Graph, Image, Kind};
use crate::passes::{self, GBuffer, Scattered};
use crate::shader::{self, fill_pull, fill_push, fill_relax, fill_scattered};
use crate::view::{Projection, View};

/// A step leaves blocks of coarse cells where depths curve; with two they are gone, and with more surfaces flatten between their points (a fifth more pixels on a wrong layer after four).
const RELAXATIONS: u32 = 2;

/// Pixels: of every level, the coarser cells beside the one around it, and those that relaxing looks at.
pub(super) fn reach_px(settings: &Settings) -> u32 {
    (2 + RELAXATIONS) << settings.levels as u32
}

pub fn record(
    g: &mut Graph,
    view: &View,
    settings: &Settings,
    labels: bool,
    gbuffer: GBuffer,
) -> GBuffer {
    let flood = gbuffer.holes.is_none();
    let known = gbuffer
        .holes
        .as_ref()
        .and_then(|holes| holes.scattered.as_ref())
        .map(|scattered| rough(g, view, scattered));
    // Bindings want a buffer, whether it is read or not.
    let rough = known.as_ref().unwrap_or(&gbuffer.spacings);
    let mut pyramid = Pyramid {
        view,
        settings,
        flood,
        labels,
        rough,
        is_rough_known: known.is_some(),
        perspective: view.camera.projection == Projection::Perspective,
    };
    let (depth, color) = pyramid.filled(g, &gbuffer.depth, &gbuffer.color);
    pyramid.labels = false;
    let shadow_factor =
        gbuffer.shadow_factor.as_ref().map(|reached| pyramid.filled(g, &gbuffer.depth, reached).1);
    GBuffer { depth, color, shadow_factor, holes: None, ..gbuffer }
}

/// The part of the points around, one in eight, from which on scattered ones say that there is no surface.
const SCATTERED_PART: u32 = 8;

/// Finds the tiles whose surroundings are no surface: 1 in their words.
fn rough(
    g: &mut Graph,
    view: &View,
    Scattered { tiles, invisible, scattered }: &Scattered,
) -> Buffer {
    let across = passes::tiles(view.size);
    let count = across[0] * across[1];
    let mut rough = g.buffer("rough", 4 * count as u64);
    let push = fill_scattered::Push { tiles: across, part: SCATTERED_PART };
    g.run(
        shader::FillScattered { tiles, invisible, scattered, rough: &mut rough, push },
        Dispatch::Groups([count.div_ceil(64), 1, 1]),
    );
    rough
}

/// How a picture is filled.
struct Pyramid<'s> {
    view: &'s View,
    settings: &'s Settings,
    flood: bool,
    perspective: bool,
    /// Colours are labels, which are never mixed.
    labels: bool,
    /// A word for every tile of the picture: 1 where there is no surface.
    rough: &'s Buffer,
    is_rough_known: bool,
}

/// A level above the picture: depths with their places, and colours.
struct Level {
    places: Image,
    color: Image,
}

/// The same once it is filled: depths and colours; and its places before.
struct Filled {
    filled: (Image, Image),
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
            coarser = Some(Filled { filled, places });
        }
        self.push(g, coarser.as_ref(), depth, None, color, 0)
    }

    /// The next coarser level.
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

    /// A level, filled from the next coarser one; without places it is the picture.
    fn push(
        &self,
        g: &mut Graph,
        coarser: Option<&Filled>,
        depth: &Image,
        places: Option<&Image>,
        color: &Image,
        number: u32,
    ) -> (Image, Image) {
        let size = color.desc.size;
        let picture = places.is_none();
        // Bindings want an image, whether it is read or not.
        let places = places.unwrap_or(color);
        let (coarse_depth, coarse_color) =
            coarser.map_or((depth, color), |Filled { filled: (depth, color), .. }| (depth, color));
        let coarse_places = coarser.map_or(color, |coarser| &coarser.places);
        let mut filled =
            [g.image("filled depth", size, Kind::R32f), g.image("relaxed depth", size, Kind::R32f)];
        let mut filled_color = g.image("filled color", size, Kind::Rgba32f);
        let (coarse_tolerance, relative) = tolerance(self.view, self.settings, number + 1);
        let tiles_across = passes::tiles(self.view.size)[0];
        let (coarse_size, flood, surrounded) =
            (coarse_depth.desc.size, self.flood as u32, self.settings.surrounded as u32);
        let push = fill_push::Push {
            coarse_size,
            size,
            tolerance: coarse_tolerance,
            relative,
            flood,
            level: number,
            tiles_across,
            surrounded,
        };
        let spec = fill_push::Spec {
            perspective: self.perspective,
            coarsest: coarser.is_none(),
            picture,
            labels: self.labels,
            rough: self.is_rough_known,
        };
        let [filled_depth, _] = &mut filled;
        g.run(
            shader::FillPush {
                coarse_depth,
                coarse_color,
                coarse_places,
                depth,
                places,
                color,
                rough: self.rough,
                filled_depth,
                filled_color: &mut filled_color,
                push,
                spec,
            },
            Dispatch::PerPixel,
        );
        let (tolerance, relative) = tolerance(self.view, self.settings, number);
        for _ in 0..RELAXATIONS {
            let [from_depth, to_depth] = &mut filled;
            let push = fill_relax::Push { size, tolerance, relative };
            let spec = fill_relax::Spec { perspective: self.perspective, picture };
            g.run(
                shader::FillRelax { depth, places, from_depth, to_depth, push, spec },
                Dispatch::PerPixel,
            );
            filled.swap(0, 1);
        }
        let [filled_depth, _] = filled;
        (filled_depth, filled_color)
    }
}
