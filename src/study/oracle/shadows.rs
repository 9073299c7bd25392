//! The f64 twins of the light's passes: depths in, in the kernels' own f32 bits; what closing gaps may make of them, and how deep light reaches, with bounds (papers/README.md, Dobrev, shadows).
//!
//! Whether a neighbour is in front, or of the same surface, is a comparison of numbers with errors: where it is in doubt, either answer is right.

use super::{Bounded, ULP};
use crate::passes::shadows::Layer;

/// Once around, clockwise from the upper left.
const AROUND: [[i64; 2]; 8] = [[-1, -1], [0, -1], [1, -1], [1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0]];

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

/// Across a surface, and then along the light.
fn layer_at(layer: &Layer, z: f32, tangent: Bounded) -> Bounded {
    let across = Bounded::exact(layer.metres as f32) + Bounded::exact(layer.texels as f32) * texel_at(layer, z);
    across * root(Bounded::exact(1.0) + tangent * tangent)
}

/// Of what is at least 1. The derivative is at most a half; a root is 1 / inversesqrt: 2 ulps, and 2.5 of the division.
fn root(square: Bounded) -> Bounded {
    let value = square.value.sqrt();
    Bounded { value, error: square.error / 2.0 + 5.0 * ULP * (value + square.error) }
}

/// What a texel may hold after one step of filling.
pub fn fill(size: [u32; 2], layer: &Layer, depth: &[f32], i: usize) -> Vec<f32> {
    let own = depth[i];
    let around = neighbours(size, depth, i);
    let filled = |slack: f64| {
        let before = around.map(|other| {
            other.filter(|&other| {
                if !own.is_finite() {
                    return true;
                }
                let front = Bounded::exact(own) - layer_at(layer, own, Bounded::exact(layer.steepest as f32));
                (other as f64) < front.value + slack * front.error
            })
        });
        let stays = (0..8).any(|first| (first..first + 5).all(|k| before[k % 8].is_none()));
        if stays { own } else { before.into_iter().flatten().fold(f32::INFINITY, f32::min) }
    };
    [-1.0, 1.0].map(filled).to_vec()
}

/// How deep light reaches in a texel: one of these; nothing where the light sees nothing.
pub fn limit(size: [u32; 2], layer: &Layer, depth: &[f32], i: usize) -> Vec<Bounded> {
    let own = depth[i];
    if !own.is_finite() {
        return Vec::new();
    }
    let run = texel_at(layer, own);
    let slopes: Vec<Bounded> = neighbours(size, depth, i)
        .iter()
        .enumerate()
        .filter_map(|(k, other)| {
            let rise = Bounded::exact((*other)?) - Bounded::exact(own);
            let rise = if rise.value < 0.0 { -rise } else { rise };
            Some(rise / if k % 2 == 0 { Bounded::constant(2f64.sqrt()) * run } else { run })
        })
        .collect();
    let steepest = layer.steepest as f32 as f64;
    let end = Bounded::constant(1.0 + 2f64.sqrt()) * Bounded::exact(steepest);
    let with = |slack: f64| {
        let same = slopes.iter().filter(|slope| slope.value <= end.value + slack * (end.error + slope.error));
        let tangent = same.copied().fold(Bounded::exact(0.0), |a, b| Bounded { value: a.value.max(b.value), error: a.error.max(b.error) });
        let reach = Bounded::exact(own) + layer_at(layer, own, tangent.min(steepest));
        reach.max(f32::from_bits(own.to_bits() + 1) as f64)
    };
    [-1.0, 1.0].map(with).to_vec()
}
