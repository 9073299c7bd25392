//! The f64 twin of `antialias.comp`: from depths, colours and light in the kernel's own f32 bits to
//! blended colours with bounds (guide: numerics, cases 12 and 17).
//!
//! Where the Laplacian is within its bound of the threshold, a pixel may be blended or not.

use super::Bounded;
use crate::passes::antialias::{Laplacian, Settings, Threshold};

/// The possible results of a pixel.
pub struct Blended {
    /// Linear colour times coverage, and coverage; `None` if the pixel certainly stays unchanged.
    pub blended: Option<[Bounded; 4]>,
    pub may_stay: bool,
}

/// Blends silhouettes. `shading` is 1 everywhere if no effect darkens.
pub fn blend(
    size: [u32; 2],
    settings: &Settings,
    depth: &[f32],
    color: &[[f32; 4]],
    shading: &[f32],
) -> Vec<Blended> {
    let [columns, rows] = size.map(|side| side as i64);
    // Outside the picture, the nearest pixel is used.
    let at = |x: i64, y: i64| (y.clamp(0, rows - 1) * columns + x.clamp(0, columns - 1)) as usize;
    let pixel = |i: usize| {
        let (x, y) = (i as i64 % columns, i as i64 / columns);
        let cross = [at(x, y), at(x - 1, y), at(x + 1, y), at(x, y - 1), at(x, y + 1)];
        let edge = laplacian(settings.laplacian, cross.map(|k| depth[k]));
        let background = cross.iter().any(|&k| !known(depth[k]));
        let asked = settings.threshold == Threshold::Low || background;
        let jump = settings.jump as f32 as f64;
        let (mut may, mut may_stay) = (false, true);
        if let Some(edge) = edge.filter(|_| asked) {
            may = edge.value.abs() + edge.error > jump;
            may_stay = edge.value.abs() - edge.error <= jump;
        }
        let weighted = |channel: usize| {
            let sum = (0..9).fold(Bounded::exact(0.0), |sum, k| {
                let (u, v) = (k % 3 - 1, k / 3 - 1);
                let from = at(x + u, y + v);
                let light =
                    if channel < 3 { Bounded::exact(shading[from]) } else { Bounded::exact(1.0) };
                sum + Bounded::exact(((2 - u.abs()) * (2 - v.abs())) as f64)
                    * (Bounded::exact(color[from][channel]) * light)
            });
            sum * Bounded::exact(0.0625)
        };
        Blended { blended: may.then(|| [0, 1, 2, 3].map(weighted)), may_stay }
    };
    (0..depth.len()).map(pixel).collect()
}

fn known(z: f32) -> bool {
    z.is_finite() && z > 0.0
}

/// Returns the Laplacian of the pixel and its four neighbours, relative to or times the least
/// depth; `None` if all are empty.
fn laplacian(of: Laplacian, z: [f32; 5]) -> Option<Bounded> {
    let least = z.into_iter().filter(|z| known(*z)).reduce(f32::min)?;
    let ratio = |z: f32| match of {
        _ if !known(z) => Bounded::exact(0.0),
        Laplacian::Inverse => Bounded::exact(least) / Bounded::exact(z),
        // Depths above a million times the nearest are clamped to that.
        Laplacian::Depth if z > least * 1e6 => Bounded::exact(1e6),
        Laplacian::Depth => Bounded::exact(z) / Bounded::exact(least),
    };
    let around = z[1..].iter().fold(Bounded::exact(4.0) * ratio(z[0]), |sum, &z| sum - ratio(z));
    Some(around)
}
