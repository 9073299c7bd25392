//! The f64 twin of `edl.comp`: from depths and colours in the kernel's own f32 bits to shaded
//! colours with bounds.
//!
//! Whether a neighbour is in front is a comparison of two f32 that the kernel compares too, so
//! nothing is undecided.

use super::Bounded;
use crate::passes::edl::Settings;
use crate::view::{Projection, View};

/// Shades red, green and blue of every pixel. Alpha is copied, so it needs no bound.
pub fn shade(
    view: &View,
    settings: &Settings,
    depth: &[f32],
    color: &[[f32; 4]],
) -> Vec<[Bounded; 3]> {
    let [width, height] = view.size.map(|side| side as i64);
    let radius = settings.radius.round() as i64;
    let [px_per_unit, strength] =
        [view.focal_px() as f32, settings.strength as f32].map(Bounded::exact);
    let pixel = |i: usize| {
        let (x, y) = (i as i64 % width, i as i64 / width);
        let z = depth[i];
        let [r, g, b, alpha] = color[i];
        let mut sum = Bounded::exact(0.0);
        for (dx, dy) in [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)] {
            let (qx, qy) = (x + dx * radius, y + dy * radius);
            let inside = (0..width).contains(&qx) && (0..height).contains(&qy);
            let slope = match inside.then(|| depth[(qy * width + qx) as usize]) {
                Some(neighbour) if alpha != 0.0 && neighbour < z => {
                    let rise = Bounded::exact(z) - Bounded::exact(neighbour);
                    let run =
                        if view.camera.projection == Projection::Perspective { z } else { 1.0 };
                    rise / Bounded::exact(run) * px_per_unit / Bounded::exact(radius as f64)
                }
                _ => Bounded::exact(0.0),
            };
            sum = sum + slope.min(settings.cap as f32 as f64);
        }
        let shade = exp2(-strength * (sum / Bounded::exact(8.0)));
        [r, g, b].map(|channel| Bounded::exact(channel) * shade)
    };
    (0..depth.len()).map(pixel).collect()
}

/// Computes 2^x for x <= 0 by Horner's rule on the Taylor series of e^f, |f| <= ln(2) / 2, as
/// `exact_exp2` does.
fn exp2(x: Bounded) -> Bounded {
    // Results below 2^-126 are flushed to 0, which differs from 2^x by at most 2^-126.
    if x.value < -126.0 {
        return Bounded { value: x.value.exp2(), error: super::FLUSH };
    }
    // The kernel's nearest integer may differ where x is near a half: f is then slightly beyond
    // ln(2) / 2, by the error of x.
    let whole = (x.value + 0.5).floor();
    let limit = std::f64::consts::LN_2 * (0.5 + x.error);
    let f = Bounded { value: x.value - whole, ..x } * Bounded::constant(std::f64::consts::LN_2);
    let one = Bounded::exact(1.0);
    let series = [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0].map(Bounded::constant);
    let p = series.into_iter().reduce(|p, coefficient| coefficient + f * p).expect("six terms") * f
        + one;
    // The omitted terms: f^7/7! (1 + f/8 + ...).
    let left_out = limit.powi(7) / 5040.0 / (1.0 - limit / 8.0);
    let scale = whole.exp2();
    Bounded {
        value: x.value.exp2(),
        error: (p.error + (p.value - f.value.exp()).abs() + left_out) * scale + super::FLUSH,
    }
}
