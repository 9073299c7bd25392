//! The f64 twin of luminance correction: from points, front depths and uncorrected colours to
//! corrected colours with bounds, by way of HSV.
//!
//! Which points count depends on f32 depths and pixels. If a point's footprint leaves that open,
//! the pixels it may be in are in doubt.

use super::project::Footprint;
use super::{Bounded, ULP};
use crate::cloud::colormap::srgb_to_linear;
use crate::passes::luminance::{Settings, Space};

/// Relative error of the arithmetic on encoded values (guide: numerics, case 22).
const RELATIVE: f64 = 4.0 * ULP;

/// A point's possible positions, and its colour in the file.
pub type Point = (Footprint, [u8; 3]);

/// Returns linear red, green and blue of every pixel; `None` if in doubt.
pub fn colors(
    size: [u32; 2],
    settings: &Settings,
    epsilon: f32,
    front: &[f32],
    uncorrected: &[[f32; 4]],
    points: &[Point],
) -> Vec<Option<[Bounded; 3]>> {
    let [columns, rows] = size.map(|side| side as i64);
    let mut sums = vec![([0u64; 3], 0u64); front.len()];
    let mut doubtful = vec![false; front.len()];
    for (footprint, bytes) in points {
        let [xs, ys] = [footprint.x, footprint.y].map(|range| range.map(|end| end.floor() as i64));
        for (x, y) in (ys[0].max(0)..=ys[1].min(rows - 1))
            .flat_map(|y| (xs[0].max(0)..=xs[1].min(columns - 1)).map(move |x| (x, y)))
        {
            let i = (y * columns + x) as usize;
            let reach = (front[i] + epsilon) as f64;
            let [may, must] =
                [footprint.z[0] <= reach * (1.0 + ULP), footprint.z[1] <= reach * (1.0 - ULP)];
            if may && !(must && xs[0] == xs[1] && ys[0] == ys[1]) {
                doubtful[i] = true;
            } else if may {
                let value = *bytes.iter().max().expect("three") as u64;
                let values =
                    if settings.space == Space::Rgb { bytes.map(u64::from) } else { [value; 3] };
                sums[i].0.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
                sums[i].1 += 1;
            }
        }
    }
    let around = if settings.neighbourhood >= 2.0 { 1 } else { 0 };
    let pixel = |i: usize| {
        if !front[i].is_finite() {
            return Some(uncorrected_of(uncorrected[i]));
        }
        let (x, y) = (i as i64 % columns, i as i64 / columns);
        let (mut sum, mut count) = ([0u64; 3], 0);
        for (dx, dy) in (-around..=around).flat_map(|dy| (-around..=around).map(move |dx| (dx, dy)))
        {
            let (u, v) = (x + dx, y + dy);
            let k = (v * columns + u) as usize;
            if !(0..columns).contains(&u)
                || !(0..rows).contains(&v)
                || (front[k] - front[i]).abs() > epsilon
            {
                continue;
            }
            if doubtful[k] {
                return None;
            }
            let weight = ((2 - dx.abs()) * (2 - dy.abs())) as u64;
            (0..3).for_each(|c| sum[c] += weight * sums[k].0[c]);
            count += weight * sums[k].1;
        }
        if count == 0 {
            return Some(uncorrected_of(uncorrected[i]));
        }
        let mean = sum.map(|sum| sum as f64 / count as f64);
        let [r, g, b, _] = uncorrected[i];
        let encoded = if settings.space == Space::Rgb {
            mean
        } else {
            with_value([r, g, b].map(byte), mean[0])
        };
        Some(encoded.map(linear))
    };
    (0..front.len()).map(pixel).collect()
}

fn uncorrected_of([r, g, b, _]: [f32; 4]) -> [Bounded; 3] {
    [r, g, b].map(Bounded::exact)
}

/// Returns the encoded value, of 256, with this linear value.
fn byte(linear: f32) -> u8 {
    let (mut lo, mut hi) = (0u8, 255u8);
    while lo < hi {
        let middle = lo + (hi - lo) / 2;
        if (srgb_to_linear(middle as f64 / 255.0) as f32) < linear {
            lo = middle + 1
        } else {
            hi = middle
        }
    }
    lo
}

/// Replaces V of an HSV colour in 0 to 255: into hue, saturation and value, and back (Smith 1978).
pub fn with_value(rgb: [u8; 3], value: f64) -> [f64; 3] {
    let [r, g, b] = rgb.map(f64::from);
    let (most, least) = (r.max(g).max(b), r.min(g).min(b));
    if most == least {
        return [value; 3];
    }
    let saturation = (most - least) / most;
    let sixths = if most == r {
        ((g - b) / (most - least)).rem_euclid(6.0)
    } else if most == g {
        (b - r) / (most - least) + 2.0
    } else {
        (r - g) / (most - least) + 4.0
    };
    [5.0, 3.0, 1.0].map(|shift| {
        let k: f64 = (shift + sixths) % 6.0;
        value - value * saturation * k.min(4.0 - k).clamp(0.0, 1.0)
    })
}

/// Decodes a value to linear, interpolating between the 256 entries.
pub fn linear(encoded: f64) -> Bounded {
    let entry = encoded.floor().min(254.0);
    let [below, above] =
        [entry, entry + 1.0].map(|entry| srgb_to_linear(entry / 255.0) as f32 as f64);
    let value = below + (above - below) * (encoded - entry);
    // Near an entry the slope may be that of the next interval.
    let steepest = (above - below).max(srgb_to_linear(((entry + 2.0) / 255.0).min(1.0)) - above);
    Bounded {
        value,
        error: steepest * RELATIVE * encoded + 3.0 * ULP * value.max(above - below) + super::FLUSH,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_is_found_from_its_linear_value() {
        assert!((0..=255).all(|b| byte(srgb_to_linear(b as f64 / 255.0) as f32) == b));
    }

    /// Tests for two hundred thousandths of white: far less than half a code of an 8-bit picture,
    /// even where the curve is flattest.
    #[test]
    fn the_straight_way_is_near_the_curve() {
        let off = (0..=25500)
            .map(|i| (linear(i as f64 / 100.0).value - srgb_to_linear(i as f64 / 25500.0)).abs());
        assert!(off.fold(0.0, f64::max) < 1e-5);
    }
}
