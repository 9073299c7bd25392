//! The f64 twin of the filling passes: one step from a partly filled picture, with bounds (guide:
//! papers, Pintus, anisotropic filling).
//!
//! A pixel's colour is three codes of 8 bits, proportional to the roots of linear colour, on which
//! filling is defined. A median is one of the neighbours, exactly; a mean has an error. A mean that
//! would move a depth by less than a 16th of the tolerance divided by the kernel's width leaves it,
//! so that pictures come to rest; near that threshold, either is right. Steps are compared one by
//! one, each from the kernel's own result of the one before. Errors therefore do not add up, and a
//! tile that wrongly slept shows.

use super::{Bounded, ULP};
use crate::passes::TILE_PX;
use crate::passes::fill::Settings;
use crate::view::{Projection, View};
use std::ops::RangeInclusive;

/// The constant of glsl/fill/fill_median.comp.
const AT_REST: f64 = 16.0;
const CODES: [u32; 3] = [255; 3];
/// Widest kernel of visibility; the default tolerance is this many pixels.
const WIDEST_KERNEL: f64 = 31.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    pub depth: Option<f32>,
    pub codes: [u32; 3],
    /// True if visibility removed it, or filling added it.
    pub filling: bool,
}

impl Pixel {
    /// Returns a pixel as stored in the layers.
    pub fn new(depth: f32, color: [f32; 4], filling: bool) -> Pixel {
        Pixel {
            depth: depth.is_finite().then_some(depth),
            codes: [0, 1, 2].map(|c| code(color[c] as f64, c).round() as u32),
            filling,
        }
    }
}

/// Returns the code before rounding to an integer.
fn code(linear: f64, channel: usize) -> f64 {
    linear.clamp(0.0, 1.0).sqrt() * CODES[channel] as f64
}

fn linear(code: u32, channel: usize) -> Bounded {
    let root = Bounded::exact(code) / Bounded::exact(CODES[channel]);
    root * root
}

/// The possible results of a pixel.
#[derive(Clone, Debug)]
pub struct Next {
    /// Possible depths; empty if none.
    pub depths: Vec<Bounded>,
    pub codes: [RangeInclusive<u32>; 3],
    pub filling: bool,
}

impl Next {
    fn exactly(pixel: Pixel) -> Next {
        Next {
            depths: pixel.depth.map(Bounded::exact).into_iter().collect(),
            codes: pixel.codes.map(|code| code..=code),
            filling: pixel.filling,
        }
    }

    /// Tests whether the layers may contain this. Colours come back unpacked, and unreached pixels
    /// are background.
    pub fn holds(&self, depth: f32, color: [f32; 4]) -> bool {
        if self.depths.is_empty() {
            return depth == f32::INFINITY && color == [0.0; 4];
        }
        let channel = |c: usize| {
            let code = code(color[c] as f64, c).round() as u32;
            // A pixel that is not being filled keeps its colour, which is not a code.
            self.codes[c].contains(&code) && (!self.filling || linear(code, c).holds(color[c]))
        };
        self.depths.iter().any(|z| z.holds(depth)) && color[3] == 1.0 && (0..3).all(channel)
    }
}

/// Computes one step, for holes found with a kernel `kernel` pixels wide. Only tiles with pixels to
/// fill are visited.
pub fn step(view: &View, settings: &Settings, kernel: u32, pixels: &[Pixel]) -> Vec<Next> {
    let [width, height] = view.size.map(|side| side as i64);
    let tile = |i: usize| [i as i64 % width / TILE_PX as i64, i as i64 / width / TILE_PX as i64];
    let listed: std::collections::HashSet<_> =
        (0..pixels.len()).filter(|&i| pixels[i].filling).map(tile).collect();
    let next = |i: usize| {
        let (x, y, own) = (i as i64 % width, i as i64 / width, pixels[i]);
        let around =
            (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))).filter(|at| *at != (0, 0));
        let inside = around
            .filter(|(dx, dy)| (0..width).contains(&(x + dx)) && (0..height).contains(&(y + dy)));
        let valid: Vec<(f32, Pixel, bool)> = inside
            .filter_map(|(dx, dy)| {
                let pixel = pixels[((y + dy) * width + x + dx) as usize];
                pixel.depth.map(|z| (z, pixel, dx != 0 && dy != 0))
            })
            .collect();
        let surrounded = own.depth.is_none()
            && valid.len() >= settings.surrounded as usize
            && listed.contains(&tile(i));
        match own.depth {
            _ if !own.filling && !surrounded => Next::exactly(own),
            Some(z) => mean(view, settings, kernel, z, own, &valid),
            None => median(own, valid),
        }
    };
    (0..pixels.len()).map(next).collect()
}

/// Returns the lower median by depth; of equals the first, row by row.
fn median(own: Pixel, mut valid: Vec<(f32, Pixel, bool)>) -> Next {
    valid.sort_by(|a, b| a.0.total_cmp(&b.0));
    match valid.get(valid.len().saturating_sub(1) / 2) {
        Some((_, middle, _)) => Next::exactly(Pixel { filling: true, ..*middle }),
        None => Next::exactly(own),
    }
}

fn mean(
    view: &View,
    settings: &Settings,
    kernel: u32,
    z0: f32,
    own: Pixel,
    valid: &[(f32, Pixel, bool)],
) -> Next {
    let one = Bounded::exact(1.0);
    let tolerance = match settings.tolerance {
        0.0 if view.camera.projection == Projection::Perspective => {
            Bounded::exact((WIDEST_KERNEL / view.focal_px()) as f32) * Bounded::exact(z0)
        }
        0.0 => Bounded::exact((WIDEST_KERNEL / view.focal_px()) as f32),
        metres => Bounded::exact(metres as f32),
    };
    let (mut weights, mut rise, mut colors) =
        (one, Bounded::exact(0.0), [0, 1, 2].map(|c| linear(own.codes[c], c)));
    for &(z, pixel, corner) in valid {
        let difference = Bounded::exact(z) - Bounded::exact(z0);
        let apart = if difference.value < 0.0 { -difference } else { difference };
        let near = match tolerance.value > 0.0 {
            true => one - (apart * (one / tolerance)).min(1.0),
            false => Bounded::exact((z == z0) as u32),
        };
        let lateral =
            if corner { Bounded::constant(1.0 - 0.5f64.sqrt()) } else { Bounded::exact(0.5) };
        let weight = lateral * near;
        weights = weights + weight;
        rise = rise + weight * difference;
        colors = [0, 1, 2].map(|c| colors[c] + weight * linear(pixel.codes[c], c));
    }
    let share = one / weights;
    let codes = [0, 1, 2].map(|c| {
        let color = colors[c] * share;
        // The root is within 5 ulps; its multiple and the addition within 1 each.
        let rounding = 7.0 * ULP * (CODES[c] as f64 + 1.0);
        let [lo, hi] =
            [-1.0, 1.0].map(|way| code(color.value + way * color.error, c) + 0.5 + way * rounding);
        lo.max(0.0).floor() as u32..=(hi.floor() as u32).min(CODES[c])
    });
    let (own, step) = (Bounded::exact(z0), rise * share);
    let at_rest = |step: f64, tolerance: f64| step * AT_REST * (kernel as f64) < tolerance;
    let surely = at_rest(step.value.abs() + step.error, tolerance.value - tolerance.error);
    let possibly = at_rest(step.value.abs() - step.error, tolerance.value + tolerance.error);
    let depths = match (surely, possibly) {
        (true, _) => vec![own],
        (false, true) => vec![own, own + step],
        (false, false) => vec![own + step],
    };
    Next { depths, codes, filling: true }
}
