//! The f64 twins of the shadow passes: from depths in the kernels' own f32 bits to filled gaps and
//! depth limits of light, with bounds (guide: papers, Dobrev, shadows).
//!
//! Whether a neighbour is in front, or on the same surface, is a comparison of numbers with errors:
//! if in doubt, either answer is right.

use super::{Bounded, ULP};
use crate::passes::shadows::Layer;

/// Offsets clockwise from the upper left.
const AROUND: [[i64; 2]; 8] =
    [[-1, -1], [0, -1], [1, -1], [1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0]];

fn neighbours(size: [u32; 2], depth: &[f32], i: usize) -> [Option<f32>; 8] {
    let [width, height] = size.map(|side| side as i64);
    let (x, y) = (i as i64 % width, i as i64 / width);
    AROUND.map(|[dx, dy]| {
        let inside = (0..width).contains(&(x + dx)) && (0..height).contains(&(y + dy));
        inside.then(|| depth[((y + dy) * width + x + dx) as usize]).filter(|z| z.is_finite())
    })
}

fn texel_at(layer: &Layer, z: f32) -> Bounded {
    let texel = Bounded::exact(layer.texel as f32);
    if layer.perspective { Bounded::exact(z) * texel } else { texel }
}

/// Returns the layer distance across a surface, then along the light.
fn layer_at(layer: &Layer, z: f32, tangent: Bounded) -> Bounded {
    let across = Bounded::exact(layer.metres as f32)
        + Bounded::exact(layer.texels as f32) * texel_at(layer, z);
    across * root(Bounded::exact(1.0) + tangent * tangent)
}

/// Returns the root of a number of at least 1. The derivative is at most a half; a root is 1 /
/// inversesqrt: 2 ulps, and 2.5 of the division.
fn root(square: Bounded) -> Bounded {
    let value = square.value.sqrt();
    Bounded { value, error: square.error / 2.0 + 5.0 * ULP * (value + square.error) }
}

/// Returns the tangent of the angle at which a surface rises from one texel to another; `None` if
/// they are on two surfaces, in doubt near the limit.
fn tangent(layer: &Layer, [from, to]: [f32; 2], run: Bounded, slack: f64) -> Option<Bounded> {
    let rise = Bounded::exact(to) - Bounded::exact(from);
    let slope = if rise.value < 0.0 { -rise } else { rise } / run;
    let end = Bounded::constant(1.0 + 2f64.sqrt()) * Bounded::exact(layer.steepest as f32);
    (slope.value <= end.value + slack * (end.error + slope.error)).then_some(slope)
}

fn run_to(neighbour: usize, texel: Bounded) -> Bounded {
    if neighbour.is_multiple_of(2) { Bounded::constant(2f64.sqrt()) * texel } else { texel }
}

fn steepest_of(slopes: impl Iterator<Item = Bounded>, layer: &Layer) -> Bounded {
    let steepest = slopes.fold(Bounded::exact(0.0), |a, b| Bounded {
        value: a.value.max(b.value),
        error: a.error.max(b.error),
    });
    steepest.min(layer.steepest as f32 as f64)
}

/// Returns the possible contents of each texel after one more step of filling.
pub fn fill(size: [u32; 2], layer: &Layer, steps: u32, depth: &[f32], i: usize) -> Vec<f32> {
    let own = depth[i];
    let around = neighbours(size, depth, i);
    let behind = |front: Option<Bounded>, slack: f64| {
        around.map(|z| {
            z.filter(|&z| front.is_none_or(|front| (z as f64) < front.value + slack * front.error))
        })
    };
    let filled = |[first, same, second]: [f64; 3]| {
        let front = own.is_finite().then(|| {
            let texel = texel_at(layer, own);
            let reach = |tangent: Bounded, layers: f64| {
                let layers = Bounded::exact(layers) * layer_at(layer, own, tangent);
                let most = layer_at(layer, own, Bounded::exact(layer.steepest as f32));
                let least = if layers.value < most.value { layers } else { most };
                Bounded::exact(own) - Bounded { error: layers.error.max(most.error), ..least }
            };
            let layers = steps as f64 + 1.0;
            let before = behind(Some(reach(Bounded::exact(0.0), layers)), first);
            let among = (0..8)
                .filter_map(|k| tangent(layer, [before[k]?, before[(k + 1) % 8]?], texel, same));
            let aside = (0..8).filter_map(|k| {
                tangent(
                    layer,
                    [own, around[k].filter(|_| before[k].is_none())?],
                    run_to(k, texel),
                    same,
                )
            });
            let is_rim = around.iter().filter(|z| z.is_none()).count() >= 3;
            let tangent = if is_rim {
                Bounded::exact(layer.steepest as f32)
            } else {
                steepest_of(among.chain(aside), layer)
            };
            reach(tangent, layers)
        });
        let before = behind(front, second);
        let stays = (0..8).any(|first| (first..first + 5).all(|k| before[k % 8].is_none()));
        if stays { own } else { before.into_iter().flatten().fold(f32::INFINITY, f32::min) }
    };
    (0..8)
        .map(|k| filled([0, 1, 2].map(|bit| if k >> bit & 1 == 1 { 1.0 } else { -1.0 })))
        .collect()
}

/// Returns the possible depth limits of light in each texel; none where the light sees nothing.
pub fn limit(size: [u32; 2], layer: &Layer, depth: &[f32], i: usize) -> Vec<Bounded> {
    let own = depth[i];
    if !own.is_finite() {
        return Vec::new();
    }
    let texel = texel_at(layer, own);
    let around = neighbours(size, depth, i);
    let with = |slack: f64| {
        let slopes =
            (0..8).filter_map(|k| tangent(layer, [own, around[k]?], run_to(k, texel), slack));
        let reach = Bounded::exact(own) + layer_at(layer, own, steepest_of(slopes, layer));
        reach.max(f32::from_bits(own.to_bits() + 1) as f64)
    };
    [-1.0, 1.0].map(with).to_vec()
}
