//! The f64 twin of `phong.comp`: depths and colours in, in the kernel's own f32 bits; lit colours out, with bounds.
//!
//! Where a comparison falls within its bound (whether neighbours are spread enough for a normal, whether the light stands above the surface) either colour is right.

use super::Bounded;
use crate::light::Light;
use crate::passes::phong::Settings;
use crate::view::{Projection, View};
use glam::DVec3;

/// Red, green and blue of every pixel: one colour, or any of several. Alpha is copied.
pub fn shade(view: &View, light: Light, settings: &Settings, depth: &[f32], color: &[[f32; 4]]) -> Vec<Vec<[Bounded; 3]>> {
    let [light, eye] = [light, Light::Headlight].map(|light| seen(view, light));
    let pixel = |i: usize| {
        let [r, g, b, alpha] = color[i].map(Bounded::exact);
        let [ambient, diffuse, specular] = [settings.ambient, settings.diffuse, settings.specular].map(|part| Bounded::exact(part as f32));
        let lit = |facing: Bounded, mirrored: Bounded| {
            let body = ambient + diffuse * facing.max(0.0);
            let highlight = specular * power(mirrored.max(0.0).min(1.0), settings.shininess as u32);
            [r, g, b].map(|channel| channel * body + highlight * alpha)
        };
        let unlit = lit(Bounded::exact(1.0), Bounded::exact(0.0));
        if !known(depth[i]) {
            return vec![unlit];
        }
        let (normal, may_be_none, may_be) = normal(view, settings.radius as i64, depth, i);
        let mut colors = Vec::new();
        if may_be_none {
            colors.push(unlit);
        }
        if may_be {
            let ray = ray(view, i, depth[i]);
            let [l, v] = [&light, &eye].map(|what| towards(what, ray, Bounded::exact(depth[i])));
            let facing = dot(normal, l);
            let r = [0, 1, 2].map(|axis| Bounded::exact(2.0) * facing * normal[axis] - l[axis]);
            if facing.value > -facing.error {
                colors.push(lit(facing, dot(r, v)));
            }
            if facing.value <= facing.error {
                colors.push(lit(facing, Bounded::exact(0.0)));
            }
        }
        colors
    };
    (0..depth.len()).map(pixel).collect()
}

fn known(z: f32) -> bool {
    z.is_finite() && z > 0.0
}

/// Towards the camera, right, down, away; whether it may count as none; and whether it may count.
fn normal(view: &View, radius: i64, depth: &[f32], i: usize) -> ([Bounded; 3], bool, bool) {
    let [columns, rows] = view.size.map(|side| side as i64);
    let (x, y, z0) = (i as i64 % columns, i as i64 / columns, Bounded::exact(depth[i]));
    let perspective = view.camera.projection == Projection::Perspective;
    let f = Bounded::exact(view.focal_px() as f32);
    // 31 pixels' widths, and with perspective no more than half of the depth.
    let part = 31.0 / view.focal_px();
    let reach = if perspective { Bounded::exact(part.min(0.5) as f32) * z0 } else { Bounded::exact(part as f32) };
    let zero = Bounded::exact(0.0);
    let [mut n, mut sx, mut sy, mut sxx, mut sxy, mut syy, mut sq, mut sxq, mut syq] = [zero; 9];
    for dy in -radius..=radius {
        for dx in -radius..=radius {
            let (u, v) = (x + dx, y + dy);
            let inside = (0..columns).contains(&u) && (0..rows).contains(&v);
            let Some(z) = inside.then(|| depth[(v * columns + u) as usize]).filter(|z| known(*z)) else { continue };
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
    let (may_be_none, may_be) = (determinant.value - determinant.error <= least, determinant.value + determinant.error > least);
    let share = Bounded::exact(1.0) / determinant;
    let a = (xq * yy - yq * xy) * share;
    let b = (yq * xx - xq * xy) * share;
    let [cx, cy] = from_centre(view, i);
    let away = if perspective { Bounded::exact(1.0) - (cx * a + cy * b) } else { Bounded::exact(1.0) };
    (unit([-(f * a), -(f * b), -away]), may_be_none, may_be)
}

/// Pixels, exact: halves.
fn from_centre(view: &View, i: usize) -> [Bounded; 2] {
    let [columns, rows] = view.size.map(|side| side as usize);
    [(i % columns, columns), (i / columns, rows)].map(|(at, side)| Bounded::exact(at as f64 + 0.5 - side as f64 / 2.0))
}

/// A pixel's place divided by its depth.
fn ray(view: &View, i: usize, z: f32) -> [Bounded; 3] {
    let aside = from_centre(view, i).map(|pixels| pixels / Bounded::exact(view.focal_px() as f32));
    let aside = if view.camera.projection == Projection::Perspective { aside } else { aside.map(|metres| metres / Bounded::exact(z)) };
    [aside[0], aside[1], Bounded::exact(1.0)]
}

/// Right, down and away of the camera: a place, or a way towards.
enum Seen {
    Place([Bounded; 3]),
    Way([Bounded; 3]),
}

fn seen(view: &View, light: Light) -> Seen {
    let axes = |world: DVec3| [view.basis.right, -view.basis.up, view.basis.forward].map(|axis| Bounded::constant(world.dot(axis)));
    match light {
        Light::Direction(travels) => Seen::Way(axes(-travels / travels.length())),
        Light::Position(world) => Seen::Place(axes(world - view.camera.eye)),
        Light::Headlight if view.camera.projection == Projection::Perspective => Seen::Place([Bounded::exact(0.0); 3]),
        Light::Headlight => Seen::Way([0.0, 0.0, -1.0].map(Bounded::exact)),
    }
}

fn towards(what: &Seen, ray: [Bounded; 3], z: Bounded) -> [Bounded; 3] {
    unit(match what {
        Seen::Place(place) => [0, 1, 2].map(|axis| place[axis] / z - ray[axis]),
        Seen::Way(way) => *way,
    })
}

fn dot(a: [Bounded; 3], b: [Bounded; 3]) -> Bounded {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(v: [Bounded; 3]) -> [Bounded; 3] {
    let largest = v.into_iter().max_by(|a, b| a.value.abs().total_cmp(&b.value.abs())).expect("three");
    let largest = Bounded { value: largest.value.abs(), ..largest };
    // The kernel divides by the largest as it finds it: what that is off cancels in the end, and must not be counted twice.
    let near = v.map(|axis| axis / Bounded::exact(largest.value));
    let length = dot(near, near).sqrt();
    near.map(|axis| axis / length)
}

fn power(x: Bounded, exponent: u32) -> Bounded {
    (0..8).fold((Bounded::exact(1.0), x), |(result, x), bit| (if exponent >> bit & 1 == 1 { result * x } else { result }, x * x)).0
}
