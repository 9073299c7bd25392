//! The f64 twin of `surface_normal.glsl` and `fit_normal.glsl`: from depths in the kernels' own f32
//! bits to the normal of a pixel with bounds.

use super::Bounded;
use crate::view::{Projection, View};

pub fn known(z: f32) -> bool {
    z.is_finite() && z > 0.0
}

/// Returns the normal as right, down, away, towards the camera; whether it may be absent; and
/// whether it may be present.
pub fn normal(view: &View, radius: i64, depth: &[f32], i: usize) -> ([Bounded; 3], bool, bool) {
    let [columns, rows] = view.size.map(|side| side as i64);
    let (x, y, z0) = (i as i64 % columns, i as i64 / columns, Bounded::exact(depth[i]));
    let perspective = view.camera.projection == Projection::Perspective;
    let f = Bounded::exact(view.focal_px() as f32);
    let reach = reach(view, z0);
    let zero = Bounded::exact(0.0);
    let [mut n, mut sx, mut sy, mut sxx, mut sxy, mut syy, mut sq, mut sxq, mut syq] = [zero; 9];
    for dy in -radius..=radius {
        for dx in -radius..=radius {
            let (u, v) = (x + dx, y + dy);
            let inside = (0..columns).contains(&u) && (0..rows).contains(&v);
            let Some(z) = inside.then(|| depth[(v * columns + u) as usize]).filter(|z| known(*z))
            else {
                continue;
            };
            let z = Bounded::exact(z);
            let difference = z0 - z;
            if difference.value.abs() >= reach.value {
                continue;
            }
            let part = difference / reach;
            let inner = Bounded::exact(1.0) - part * part;
            let w = inner * inner;
            let q = if perspective { difference / z } else { difference };
            let [dx, dy] = [dx as f64, dy as f64].map(Bounded::exact);
            (n, sx, sy, sq) = (n + w, sx + w * dx, sy + w * dy, sq + w * q);
            (sxx, sxy, syy) = (sxx + w * (dx * dx), sxy + w * (dx * dy), syy + w * (dy * dy));
            (sxq, syq) = (sxq + w * q * dx, syq + w * q * dy);
        }
    }
    let n = n.max(1.0);
    let (mx, my) = (sx / n, sy / n);
    let (xx, xy, yy) = (sxx - sx * mx, sxy - sx * my, syy - sy * my);
    let (xq, yq) = (sxq - sq * mx, syq - sq * my);
    let determinant = xx * yy - xy * xy;
    let least = 0.1f32 as f64;
    let (may_be_none, may_be) = (
        determinant.value - determinant.error <= least,
        determinant.value + determinant.error > least,
    );
    let share = Bounded::exact(1.0) / determinant;
    let a = (xq * yy - yq * xy) * share;
    let b = (yq * xx - xq * xy) * share;
    let [cx, cy] = from_centre(view, i);
    let away =
        if perspective { Bounded::exact(1.0) - (cx * a + cy * b) } else { Bounded::exact(1.0) };
    (unit([-(f * a), -(f * b), -away]), may_be_none, may_be)
}

/// Returns the largest depth difference on one surface: 31 pixels' widths, and with perspective at
/// most half of the depth.
pub fn reach(view: &View, z: Bounded) -> Bounded {
    let part = 31.0 / view.focal_px();
    match view.camera.projection {
        Projection::Perspective => Bounded::exact(part.min(0.5) as f32) * z,
        Projection::Orthographic => Bounded::exact(part as f32),
    }
}

/// Returns the distance from the principal point `[px]`, exact: halves.
pub fn from_centre(view: &View, i: usize) -> [Bounded; 2] {
    let [columns, rows] = view.size.map(|side| side as usize);
    [(i % columns, columns), (i / columns, rows)]
        .map(|(at, side)| Bounded::exact(at as f64 + 0.5 - side as f64 / 2.0))
}

pub fn dot(a: [Bounded; 3], b: [Bounded; 3]) -> Bounded {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub fn unit(v: [Bounded; 3]) -> [Bounded; 3] {
    let largest =
        v.into_iter().max_by(|a, b| a.value.abs().total_cmp(&b.value.abs())).expect("three");
    let largest = Bounded { value: largest.value.abs(), ..largest };
    // The kernel divides by its own largest component: that error cancels in the end, and must not
    // be counted twice.
    let near = v.map(|axis| axis / Bounded::exact(largest.value));
    let length = dot(near, near).sqrt();
    near.map(|axis| axis / length)
}
