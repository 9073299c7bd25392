//! FLIP: the visible difference between two alternating pictures (Andersson et al., "FLIP: A
//! Difference Evaluator for Alternating Images", 2020).
//!
//! From linear colours to a value per pixel, from 0 (invisible) to 1 (the greatest difference).
//!
//! ```text
//! colour    to an opponent space, filtered by contrast sensitivity at these pixels per degree,
//!           to CIELAB, Hunt-adjusted; distance HyAB, raised to 0.7,
//!           and compressed above 0.4 of the greatest
//! feature   differences of edges and of points, whichever is greater, at the resolution of the eye
//! FLIP      colour ^ (1 - feature)
//! ```
//! Filters are separable and repeat the border's pixels, as in the authors' program, against which
//! this one is tested. The part that depends on one picture only is computed once ([`Seen`]), since
//! a study compares one picture with many.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// Pixels per degree of a 0.7 m wide 4K display seen from 0.7 m, as the authors assume; all studies
/// use it.
pub const PIXELS_PER_DEGREE: f64 = 67.0206;

/// Contrast sensitivity of the three opponent channels: heights and widths of up to two Gaussians.
const SENSITIVITY: [[(f64, f64); 2]; 3] =
    [[(1.0, 0.0047), (0.0, 1e-5)], [(1.0, 0.0053), (0.0, 1e-5)], [(34.1, 0.04), (13.5, 0.025)]];

/// Width of an edge or point feature `[degrees]`.
const FEATURE_DEGREES: f64 = 0.082;

const COLOR_POWER: f64 = 0.7;
const FEATURE_POWER: f64 = 0.5;
/// Differences above the first share of the greatest colour difference are compressed into the
/// range above the second.
const KNEE: (f64, f64) = (0.4, 0.95);

/// Rec. 709 primaries, D65.
const TO_XYZ: [[f64; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];

/// The part of FLIP that depends on one picture only.
pub struct Seen {
    /// Colours, filtered, CIELAB, Hunt-adjusted.
    color: Vec<[f32; 3]>,
    /// Strength of edges and of points.
    feature: Vec<[f32; 2]>,
}

impl Seen {
    /// Prepares a picture. `linear` holds R G B A row by row, clamped to 0..=1 as a display does.
    pub fn new(linear: &[[f32; 4]], size: [u32; 2], pixels_per_degree: f64) -> Seen {
        let opponent: Vec<[f32; 3]> = linear
            .par_iter()
            .map(|&[r, g, b, _]| opponent([r, g, b].map(|v| v.clamp(0.0, 1.0) as f64)))
            .collect();
        let width = size[0] as usize;
        let [y, cx, cz] =
            [0, 1, 2].map(|channel| blurred(&opponent, width, channel, pixels_per_degree));
        let to_rgb = DMat3::from_cols_array_2d(&TO_XYZ).transpose().inverse();
        let color = (0..opponent.len())
            .into_par_iter()
            .map(|i| adjusted([y[i], cx[i], cz[i]], &to_rgb))
            .collect();
        let grey: Vec<f32> = opponent.iter().map(|c| (c[0] + 16.0) / 116.0).collect();
        Seen { color, feature: features(&grey, width, pixels_per_degree) }
    }
}

/// Returns FLIP of every pixel.
pub fn difference(a: &Seen, b: &Seen) -> Vec<f32> {
    let greatest = greatest();
    let knee = KNEE.0 * greatest;
    let pixel = |i: usize| {
        let (p, q) = (a.color[i], b.color[i]);
        let far = hyab(p, q).powf(COLOR_POWER);
        let color = if far < knee {
            far * KNEE.1 / knee
        } else {
            KNEE.1 + (far - knee) / (greatest - knee) * (1.0 - KNEE.1)
        };
        let change = |k: usize| (a.feature[i][k] - b.feature[i][k]).abs() as f64;
        let feature =
            (change(0).max(change(1)) * std::f64::consts::FRAC_1_SQRT_2).powf(FEATURE_POWER);
        color.powf(1.0 - feature) as f32
    };
    (0..a.color.len()).into_par_iter().map(pixel).collect()
}

fn multiplied(m: [[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// Returns XYZ of white.
fn white() -> [f64; 3] {
    multiplied(TO_XYZ, [1.0; 3])
}

/// Converts linear RGB to YCxCz, which is CIELAB without its cube roots.
fn opponent(rgb: [f64; 3]) -> [f32; 3] {
    let (xyz, white) = (multiplied(TO_XYZ, rgb), white());
    let [x, y, z] = [0, 1, 2].map(|k| xyz[k] / white[k]);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)].map(|v| v as f32)
}

/// Converts back to displayable RGB, then to Hunt-adjusted CIELAB.
fn adjusted(ycxcz: [f32; 3], to_rgb: &DMat3) -> [f32; 3] {
    let y = (ycxcz[0] as f64 + 16.0) / 116.0;
    let white = white();
    let xyz = [
        (y + ycxcz[1] as f64 / 500.0) * white[0],
        y * white[1],
        (y - ycxcz[2] as f64 / 200.0) * white[2],
    ];
    hunt((*to_rgb * DVec3::from_array(xyz)).clamp(DVec3::ZERO, DVec3::ONE).to_array())
}

/// Converts linear RGB to CIELAB with chroma that fades in the dark.
fn hunt(rgb: [f64; 3]) -> [f32; 3] {
    const D: f64 = 6.0 / 29.0;
    let (xyz, white) = (multiplied(TO_XYZ, rgb), white());
    let [x, y, z] = [0, 1, 2].map(|k| {
        let t = xyz[k] / white[k];
        if t > D * D * D { t.cbrt() } else { t / (3.0 * D * D) + 4.0 / 29.0 }
    });
    let l = 116.0 * y - 16.0;
    [l, 0.01 * l * 500.0 * (x - y), 0.01 * l * 200.0 * (y - z)].map(|v| v as f32)
}

fn hyab(a: [f32; 3], b: [f32; 3]) -> f64 {
    let d = [0, 1, 2].map(|k| a[k] as f64 - b[k] as f64);
    d[0].abs() + d[1].hypot(d[2])
}

/// Returns the difference of green and blue, the greatest of a display.
fn greatest() -> f64 {
    hyab(hunt([0.0, 1.0, 0.0]), hunt([0.0, 0.0, 1.0])).powf(COLOR_POWER)
}

/// Filters one opponent channel by contrast sensitivity.
fn blurred(
    opponent: &[[f32; 3]],
    width: usize,
    channel: usize,
    pixels_per_degree: f64,
) -> Vec<f32> {
    use std::f64::consts::PI;
    let widest = SENSITIVITY.iter().flatten().fold(0f64, |widest, &(_, b)| widest.max(b));
    let radius = (3.0 * (widest / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as i32;
    let plane: Vec<f32> = opponent.iter().map(|c| c[channel]).collect();
    let mut sum = vec![0.0; plane.len()];
    let mut total = 0.0;
    for (a, b) in SENSITIVITY[channel].into_iter().filter(|(a, _)| *a > 0.0) {
        let kernel: Vec<f64> = (-radius..=radius)
            .map(|x| (-(PI * x as f64 / pixels_per_degree).powi(2) / b).exp())
            .collect();
        let weight = a * (PI / b).sqrt();
        total += weight * kernel.iter().sum::<f64>().powi(2);
        let one = filtered(&plane, width, &kernel, &kernel);
        sum.iter_mut().zip(one).for_each(|(sum, v)| *sum += weight * v as f64);
    }
    sum.into_iter().map(|v| (v / total) as f32).collect()
}

/// Returns strengths of edges and points: first and second derivative of a Gaussian along x and y.
fn features(grey: &[f32], width: usize, pixels_per_degree: f64) -> Vec<[f32; 2]> {
    let sigma = 0.5 * FEATURE_DEGREES * pixels_per_degree;
    let radius = (3.0 * sigma).ceil() as i32;
    let kernel = |weigh: &dyn Fn(f64) -> f64| -> Vec<f64> {
        let raw: Vec<f64> = (-radius..=radius)
            .map(|x| weigh(x as f64) * (-(x * x) as f64 / (2.0 * sigma * sigma)).exp())
            .collect();
        // Positive and negative weights are normalised to 1 and -1 separately.
        let [up, down] =
            [1.0, -1.0].map(|sign| raw.iter().map(|v| (v * sign).max(0.0)).sum::<f64>());
        raw.into_iter()
            .map(|v| if v > 0.0 { v / up } else { v / down.max(f64::MIN_POSITIVE) })
            .collect()
    };
    let smooth = kernel(&|_| 1.0);
    let strength = |along: &[f64]| -> Vec<f32> {
        let (x, y) = (filtered(grey, width, along, &smooth), filtered(grey, width, &smooth, along));
        x.into_iter().zip(y).map(|(x, y)| x.hypot(y)).collect()
    };
    let (edges, points) =
        (strength(&kernel(&|x| -x)), strength(&kernel(&|x| x * x / (sigma * sigma) - 1.0)));
    edges.into_iter().zip(points).map(|(edge, point)| [edge, point]).collect()
}

/// Convolves with one kernel along x and one along y.
fn filtered(plane: &[f32], width: usize, along_x: &[f64], along_y: &[f64]) -> Vec<f32> {
    let height = plane.len() / width;
    let (kx, ky): (Vec<f32>, Vec<f32>) =
        (along_x.iter().map(|&v| v as f32).collect(), along_y.iter().map(|&v| v as f32).collect());
    let mut rows = vec![0f32; plane.len()];
    rows.par_chunks_mut(width).zip(plane.par_chunks(width)).for_each(|(out, row)| {
        let radius = kx.len() / 2;
        let mut padded = vec![row[0]; radius];
        padded.extend_from_slice(row);
        padded.resize(width + 2 * radius, row[width - 1]);
        for (k, weight) in kx.iter().enumerate() {
            out.iter_mut().zip(&padded[k..]).for_each(|(out, v)| *out += weight * v);
        }
    });
    let mut both = vec![0f32; plane.len()];
    both.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        for (k, weight) in ky.iter().enumerate() {
            let from = (y + k).saturating_sub(ky.len() / 2).min(height - 1);
            out.iter_mut().zip(&rows[from * width..]).for_each(|(out, v)| *out += weight * v);
        }
    });
    both
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::colormap::srgb_to_linear;

    const SIZE: [u32; 2] = [96, 64];

    fn picture(color: impl Fn(u32, u32) -> [u8; 3]) -> Vec<[f32; 4]> {
        let pixel = |i: u32| {
            let [r, g, b] =
                color(i % SIZE[0], i / SIZE[0]).map(|v| srgb_to_linear(v as f64 / 255.0) as f32);
            [r, g, b, 1.0]
        };
        (0..SIZE[0] * SIZE[1]).map(pixel).collect()
    }

    fn mean(a: &[[f32; 4]], b: &[[f32; 4]], pixels_per_degree: f64) -> f64 {
        let [a, b] = [a, b].map(|picture| Seen::new(picture, SIZE, pixels_per_degree));
        let map = difference(&a, &b);
        assert!(map.iter().all(|v| (0.0..=1.0).contains(v)));
        map.iter().map(|&v| v as f64).sum::<f64>() / map.len() as f64
    }

    /// Returns checks with noise from a fixed sequence.
    fn noisy(k: u32) -> Vec<[f32; 4]> {
        let state = std::cell::Cell::new(k.wrapping_mul(2_654_435_761).wrapping_add(1));
        picture(|x, y| {
            state.set(state.get().wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
            let (noise, check) = ((state.get() >> 27) as u8, ((x / 9 + y / 7) % 2) as u8);
            [
                check * 120 + noise + 40,
                (x * 255 / SIZE[0]) as u8 / 2 + noise,
                200 - check * 90 - noise + k as u8 * 3,
            ]
        })
    }

    /// Compares with the authors' program (C++, through the crate nv-flip 0.1.2) on the same
    /// pictures, at 67.0206 and 30 pixels per degree.
    #[test]
    fn means_are_those_of_the_authors_program() {
        let flat = |color: [u8; 3]| picture(|_, _| color);
        let edge = |at: u32| picture(|x, _| [if x < at { 30 } else { 220 }; 3]);
        let line = picture(|_, y| if y == 32 { [255, 0, 0] } else { [128; 3] });
        let cases = [
            ("noise", noisy(0), noisy(1), [0.102291, 0.167906]),
            ("black and white", flat([0; 3]), flat([255; 3]), [0.967386, 0.967384]),
            ("green and blue", flat([0, 255, 0]), flat([0, 0, 255]), [1.0, 1.0]),
            ("greys", flat([100; 3]), flat([110; 3]), [0.153489, 0.153485]),
            ("an edge that moves", edge(48), edge(50), [0.046473, 0.034546]),
            ("a red line", flat([128; 3]), line, [0.030807, 0.023036]),
        ];
        for (name, a, b, expected) in cases {
            for (pixels_per_degree, expected) in [67.0206, 30.0].into_iter().zip(expected) {
                let found = mean(&a, &b, pixels_per_degree);
                println!("{name} {pixels_per_degree}: {found:.6}, expected {expected:.6}");
                assert!(
                    (found - expected).abs() <= 2e-4,
                    "{name} at {pixels_per_degree} pixels per degree: {found}, expected {expected}"
                );
            }
        }
    }

    #[test]
    fn a_picture_does_not_differ_from_itself_and_order_does_not_matter() {
        let (a, b) = (noisy(0), noisy(7));
        assert_eq!(mean(&a, &a, PIXELS_PER_DEGREE), 0.0);
        assert_eq!(mean(&a, &b, PIXELS_PER_DEGREE), mean(&b, &a, PIXELS_PER_DEGREE));
    }
}
