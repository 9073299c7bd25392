//! The f64 twin of the shape passes: from depths in the kernels' own f32 bits to the remaining
//! light with bounds (guide: papers, Pintus, shape depiction).
//!
//! Depths of deeper levels carry errors E. For a 3 x 3 whose depths differ from the centre's by at
//! most M, an f32 kernel finds, in any order of summation: each difference within an ulp of M,
//! their sum within 9 more, the mean within 2.5 more: mu within 13 ulps of M, and 2 E; sigma, which
//! moves by at most the largest deviation, within E and 16 ulps of M; its squares, sum, mean and
//! root 12 ulps of itself more; the next depth: the pixel's own error cancels in z0 + mu, so that E
//! counts once, and half of the error of sigma.
//!
//! On tiles that are planes, the kernels take deeper levels to be like the first one. This twin
//! does not.

use super::{Bounded, ULP};
use crate::passes::shape::Settings;
use crate::view::{Projection, View};

pub fn light(view: &View, settings: &Settings, depth: &[f32]) -> Vec<Bounded> {
    let width = (settings.softness / view.focal_px()) as f32 as f64;
    let mut depths: Vec<Option<Bounded>> =
        depth.iter().map(|&z| (z.is_finite() && z > 0.0).then(|| Bounded::exact(z))).collect();
    let mut light = vec![Bounded::exact(0.0); depth.len()];
    for weight in weights(settings) {
        let levels: Vec<_> = (0..depth.len()).map(|i| level(view, &depths, i, width)).collect();
        for (light, (omega, _)) in light.iter_mut().zip(&levels) {
            *light = *light + Bounded::constant(weight) * *omega;
        }
        depths = levels.into_iter().map(|(_, next)| next).collect();
    }
    light
}

/// Returns the weights 1 / (k + 1)^xi, normalised to 1; the first as large as all others together
/// if requested.
fn weights(settings: &Settings) -> Vec<f64> {
    let mut weights: Vec<f64> =
        (1..=settings.levels as u32).map(|k| (k as f64).powf(-settings.xi)).collect();
    let deeper: f64 = weights[1..].iter().sum();
    if settings.first >= 0.5 {
        weights[0] += deeper;
    }
    let sum = weights[0] + deeper;
    weights.into_iter().map(|weight| weight / sum).collect()
}

/// Returns omega, and the depth of the next level; light if empty.
fn level(
    view: &View,
    depths: &[Option<Bounded>],
    i: usize,
    width: f64,
) -> (Bounded, Option<Bounded>) {
    let Some(own) = depths[i] else { return (Bounded::exact(1.0), None) };
    let [columns, rows] = view.size.map(|side| side as i64);
    let (x, y) = (i as i64 % columns, i as i64 / columns);
    let around = (y - 1..=y + 1).flat_map(|y| (x - 1..=x + 1).map(move |x| (x, y)));
    let inside = around.filter(|(x, y)| (0..columns).contains(x) && (0..rows).contains(y));
    let known: Vec<Bounded> =
        inside.filter_map(|(x, y)| depths[(y * columns + x) as usize]).collect();

    let most = |of: &dyn Fn(&Bounded) -> f64| known.iter().map(of).fold(0.0, f64::max);
    let mean = |of: &dyn Fn(f64) -> f64| {
        known.iter().map(|z| of(z.value)).sum::<f64>() / known.len() as f64
    };
    let before = most(&|z| z.error);
    let apart = most(&|z| (z.value - own.value).abs()) + 2.0 * before;
    let mu = mean(&|z| z - own.value);
    let sigma = mean(&|z| (z - own.value - mu).powi(2)).sqrt();
    let mu_rounding = 13.0 * ULP * apart;
    let sigma_error = before + 28.0 * ULP * apart;

    let from_dmin = Bounded {
        value: (sigma - mu).abs(),
        error: sigma_error + 2.0 * before + mu_rounding + ULP * apart,
    };
    let quantum = 8.0 * ULP;
    let part = if view.camera.projection == Projection::Perspective {
        width.max(quantum)
    } else {
        quantum
    };
    let part = Bounded { value: part, error: 0.0 } * own;
    let eps =
        if view.camera.projection == Projection::Perspective { part } else { part.max(width) };
    let spread = Bounded { value: 2.0 * sigma, error: 2.0 * sigma_error } + eps;
    let omega = (Bounded::exact(1.0) - from_dmin / spread).through(|omega| omega.clamp(0.0, 1.0));

    let next = (own.value + (mu - sigma / 2.0)).max(own.value / 2.0);
    let error = before + mu_rounding + sigma_error / 2.0 + ULP * apart + ULP * (own.value + apart);
    (omega, Some(Bounded { value: next, error }))
}
