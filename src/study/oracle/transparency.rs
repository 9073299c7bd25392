//! The twin of transparency: all surfaces on a ray, front to back, blended in f64.

use crate::synth::World;
use crate::view::View;

/// A surface hit by a ray.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// Planar depth `[m]`.
    pub depth: f64,
    /// ASPRS class.
    pub class: u8,
}

/// Distance below which surfaces are one `[m]`: no ray of a study grazes two.
const APART: f64 = 1e-9;

/// Returns the surfaces on the ray through a position of the picture `[px]`.
pub fn surfaces(world: &World, view: &View, x_px: f64, y_px: f64) -> Vec<Surface> {
    let (origin, direction) = view.ray(x_px, y_px);
    let beyond =
        |last: &Surface| world.trace_beyond(origin - world.offset, direction, last.depth + APART);
    let surface = |hit: crate::synth::Hit| Surface { depth: hit.t, class: hit.class };
    let first = world.trace(origin - world.offset, direction).map(surface);
    std::iter::successors(first, |last| beyond(last).map(surface)).collect()
}

/// Returns the layers at a pixel's middle; `None` at contours, where they differ within two pixels
/// around or are closer than twice the layer distance.
pub fn layers(world: &World, view: &View, layer_m: f64, [x, y]: [f64; 2]) -> Option<Vec<Surface>> {
    let own = surfaces(world, view, x, y);
    let is_alike = |k: i32| {
        let found = surfaces(world, view, x + (k % 5 - 2) as f64, y + (k / 5 - 2) as f64);
        let apart = found.windows(2).all(|pair| pair[1].depth - pair[0].depth > 2.0 * layer_m);
        apart
            && found.iter().map(|surface| surface.class).eq(own.iter().map(|surface| surface.class))
    };
    (0..25).all(is_alike).then_some(own)
}

/// The blend of some layers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Over {
    /// Linear colour over black.
    pub color: [f64; 3],
    /// Share of the light from behind.
    pub through: f64,
    /// Number of layers until the remaining light is negligible (guide: numerics, case 15).
    pub layers: u32,
}

/// Blends colours with opacities, front to back, in linear light.
pub fn over(layers: impl Iterator<Item = ([f64; 3], f64)>) -> Over {
    let mut sum = Over { through: 1.0, ..Over::default() };
    for (color, opacity) in layers {
        (0..3).for_each(|c| sum.color[c] += sum.through * opacity * color[c]);
        sum.through *= 1.0 - opacity;
        sum.layers += 1;
        if sum.through < 1.0 / 512.0 {
            break;
        }
    }
    sum
}
