//! The f64 twin of `phong.comp`: from depths and colours in the kernel's own f32 bits to lit
//! colours with bounds.
//!
//! If a comparison falls within its bound (whether neighbours are spread enough for a normal,
//! whether the light is above the surface), either colour is right.

use super::Bounded;
use super::surface::{dot, from_centre, known, normal, reach, unit};
use crate::passes::phong::Settings;
use crate::view::light::Light;
use crate::view::{Projection, View};
use glam::DVec3;

/// Returns the possible colours of every pixel. Alpha is copied. `facing` has the points' normals
/// as returned by [`facing`], if present; `reached` is the share of light that reaches each pixel,
/// if shadows are cast.
pub fn shade(
    view: &View,
    light: Light,
    settings: &Settings,
    depth: &[f32],
    color: &[[f32; 4]],
    facing: Option<&[[f32; 4]]>,
    reached: Option<&[[f32; 4]]>,
) -> Vec<Vec<[Bounded; 3]>> {
    let [light, eye] = [light, Light::Headlight].map(|light| seen(view, light));
    let pixel = |i: usize| {
        let [r, g, b, alpha] = color[i].map(Bounded::exact);
        let [ambient, diffuse, specular] = [settings.ambient, settings.diffuse, settings.specular]
            .map(|part| Bounded::exact(part as f32));
        let lit = |facing: Bounded, mirrored: Bounded| {
            let highlight = specular * power(mirrored.max(0.0).min(1.0), settings.shininess as u32);
            [0, 1, 2].map(|c| {
                let reached = Bounded::exact(reached.map_or(1.0, |reached| reached[i][c]));
                [r, g, b][c] * (ambient + reached * (diffuse * facing.max(0.0)))
                    + reached * (highlight * alpha)
            })
        };
        let unlit = lit(Bounded::exact(1.0), Bounded::exact(0.0));
        if !known(depth[i]) {
            return vec![unlit];
        }
        let of_points =
            facing.and_then(|facing| of_points(view, settings.radius as i64, depth, facing, i));
        let fitted = || normal(view, settings.radius as i64, depth, i);
        let (normal, may_be_none, may_be) =
            of_points.map_or_else(fitted, |normal| (normal, false, true));
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

/// Returns the normal of a pixel's point; if it has none, the mean of those around it on the same
/// surface.
fn of_points(
    view: &View,
    radius: i64,
    depth: &[f32],
    facing: &[[f32; 4]],
    i: usize,
) -> Option<[Bounded; 3]> {
    let exact = |[x, y, z, _]: [f32; 4]| [x, y, z].map(Bounded::exact);
    if facing[i][3] > 0.0 {
        return Some(exact(facing[i]));
    }
    let [columns, rows] = view.size.map(|side| side as i64);
    let (x, y, z0) = (i as i64 % columns, i as i64 / columns, Bounded::exact(depth[i]));
    let reach = reach(view, z0);
    let mut sum = None;
    for (u, v) in
        (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| (x + dx, y + dy)))
    {
        let inside = (0..columns).contains(&u) && (0..rows).contains(&v);
        let Some(k) = inside
            .then_some((v * columns + u) as usize)
            .filter(|&k| known(depth[k]) && facing[k][3] > 0.0)
        else {
            continue;
        };
        let difference = z0 - Bounded::exact(depth[k]);
        if difference.value.abs() >= reach.value {
            continue;
        }
        let part = difference / reach;
        let inner = Bounded::exact(1.0) - part * part;
        let n = exact(facing[k]).map(|axis| inner * inner * axis);
        sum = Some(sum.map_or(n, |sum: [Bounded; 3]| [0, 1, 2].map(|axis| sum[axis] + n[axis])));
    }
    sum.map(unit)
}

/// Returns a point's world normal as right, down and away, turned towards the camera, with bounds.
pub fn facing(view: &View, i: usize, normal: DVec3) -> [Bounded; 3] {
    let seen = [view.basis.right, -view.basis.up, view.basis.forward].map(|axis| {
        // Three products of f32, of vectors that are rounded themselves.
        let value = normal.dot(axis);
        Bounded { value, error: 12.0 * super::ULP }
    });
    let ray = ray(view, i, 1.0);
    let away = dot(
        seen,
        if view.camera.projection == Projection::Perspective {
            ray
        } else {
            [0.0, 0.0, 1.0].map(Bounded::exact)
        },
    );
    if away.value > 0.0 { seen.map(|axis| -axis) } else { seen }
}

/// Returns a pixel's position divided by its depth.
fn ray(view: &View, i: usize, z: f32) -> [Bounded; 3] {
    let aside = from_centre(view, i).map(|pixels| pixels / Bounded::exact(view.focal_px() as f32));
    let aside = if view.camera.projection == Projection::Perspective {
        aside
    } else {
        aside.map(|metres| metres / Bounded::exact(z))
    };
    [aside[0], aside[1], Bounded::exact(1.0)]
}

/// A place or a direction in the camera's axes: right, down, away.
enum Seen {
    Place([Bounded; 3]),
    Way([Bounded; 3]),
}

fn seen(view: &View, light: Light) -> Seen {
    let axes = |world: DVec3| {
        [view.basis.right, -view.basis.up, view.basis.forward]
            .map(|axis| Bounded::constant(world.dot(axis)))
    };
    match light {
        Light::Direction(travels) => Seen::Way(axes(-travels / travels.length())),
        Light::Position(world) => Seen::Place(axes(world - view.camera.eye)),
        Light::Headlight if view.camera.projection == Projection::Perspective => {
            Seen::Place([Bounded::exact(0.0); 3])
        }
        Light::Headlight => Seen::Way([0.0, 0.0, -1.0].map(Bounded::exact)),
    }
}

fn towards(what: &Seen, ray: [Bounded; 3], z: Bounded) -> [Bounded; 3] {
    unit(match what {
        Seen::Place(place) => [0, 1, 2].map(|axis| place[axis] / z - ray[axis]),
        Seen::Way(way) => *way,
    })
}

fn power(x: Bounded, exponent: u32) -> Bounded {
    (0..8)
        .fold((Bounded::exact(1.0), x), |(result, x), bit| {
            (if exponent >> bit & 1 == 1 { result * x } else { result }, x * x)
        })
        .0
}
