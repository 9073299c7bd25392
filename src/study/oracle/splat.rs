//! The f64 twin of the splat kernels: for each pixel the nearest disc, sought among all points.

use super::Bounded;
use crate::passes::splat::{Settings, Shape};
use crate::view::{Projection, View};

/// The disc of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splat {
    /// Depth of the disc `[m]`.
    pub depth: Bounded,
    /// Pixel of its point.
    pub source: usize,
}

/// Returns the disc that each pixel shows, `None` where there is none; an error where rounding
/// decides. `spacing_m` is that of the point in each pixel.
pub fn splats(
    view: &View,
    settings: &Settings,
    depth: &[f32],
    spacing_m: impl Fn(usize) -> f32,
) -> Vec<Result<Option<Splat>, ()>> {
    let [width, height] = view.size.map(|side| side as usize);
    let perspective = view.camera.projection == Projection::Perspective;
    let focal = Bounded::exact(view.focal_px() as f32);
    let half = |number: f64| Bounded::exact(0.5 * number as f32);
    // Each with the depth of its point and the distance from it.
    let mut found: Vec<Vec<(Splat, [f64; 2])>> = vec![Vec::new(); width * height];
    let mut unsure = vec![f64::INFINITY; width * height];
    for (source, &z) in depth.iter().enumerate().filter(|(_, z)| **z > 0.0 && z.is_finite()) {
        let z = Bounded::exact(z);
        let scale = if perspective { focal / z } else { focal };
        let radius = match (settings.pixels, settings.metres) {
            (0.0, 0.0) => {
                Bounded::exact(settings.cover as f32) * Bounded::exact(spacing_m(source)) * scale
                    + Bounded::exact(0.5)
            }
            (0.0, metres) => half(metres) * scale,
            (pixels, _) => half(pixels),
        };
        let radius = radius.max(0.5).min(0.5 * settings.largest as f32 as f64);
        let square = radius * radius;
        let bulge = match settings.shape {
            Shape::Disc => Bounded::exact(0.0),
            Shape::Paraboloid => Bounded::exact(1.0) * radius / (scale * square),
        };
        let (x, y) = ((source % width) as i64, (source / width) as i64);
        let reach = (radius.value + 1.0) as i64;
        for (to_x, to_y) in (y - reach..=y + reach)
            .flat_map(|to_y| (x - reach..=x + reach).map(move |to_x| (to_x, to_y)))
        {
            if !(0..width as i64).contains(&to_x) || !(0..height as i64).contains(&to_y) {
                continue;
            }
            let distance = ((to_x - x).pow(2) + (to_y - y).pow(2)) as f64;
            let pixel = to_y as usize * width + to_x as usize;
            let depth = z + bulge * Bounded::exact(distance);
            if (distance - square.value).abs() <= square.error && square.error > 0.0 {
                unsure[pixel] = unsure[pixel].min(depth.value - depth.error);
            } else if distance <= square.value {
                found[pixel].push((Splat { depth, source }, [z.value, distance]));
            }
        }
    }
    let nearest = |(discs, unsure): (Vec<(Splat, [f64; 2])>, f64)| {
        let nearer = |a, b| if depth_of(&b) < depth_of(&a) { b } else { a };
        let Some((first, own)) = discs.iter().copied().reduce(nearer) else {
            return if unsure.is_finite() { Err(()) } else { Ok(None) };
        };
        let most = first.depth.value + first.depth.error;
        let near = |(disc, _): &&(Splat, [f64; 2])| disc.depth.value - disc.depth.error <= most;
        // The same depth and distance are the same bits, and then the first point counts.
        let undecided = discs.iter().filter(near).any(|(_, other)| *other != own);
        if undecided || unsure <= most { Err(()) } else { Ok(Some(first)) }
    };
    found.into_iter().zip(unsure).map(nearest).collect()
}

fn depth_of((disc, _): &(Splat, [f64; 2])) -> f64 {
    disc.depth.value
}
