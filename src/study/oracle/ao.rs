//! The f64 twin of `ao.comp`: from depths in the kernel's own f32 bits to the remaining light with
//! bounds.
//!
//! If a comparison falls within its bound (the pixel of a sample, whether it counts, whether there
//! is a normal), the twin returns no result.

use super::Bounded;
use super::surface::{dot, from_centre, known, normal};
use crate::passes::ao::{self, Settings};
use crate::view::{Projection, View};
use rayon::prelude::*;

/// Returns the light of every pixel; `None` if it depends on a comparison within its bound.
pub fn left(view: &View, settings: &Settings, depth: &[f32]) -> Vec<Option<Bounded>> {
    (0..depth.len())
        .into_par_iter()
        .map(|i| {
            if known(depth[i]) {
                pixel(view, settings, depth, i)
            } else {
                Some(Bounded::exact(1.0))
            }
        })
        .collect()
}

fn pixel(view: &View, settings: &Settings, depth: &[f32], i: usize) -> Option<Bounded> {
    let [columns, rows] = view.size.map(|side| side as i64);
    let perspective = view.camera.projection == Projection::Perspective;
    let f = Bounded::exact(view.focal_px() as f32);
    let (zero, one, z) = (Bounded::exact(0.0), Bounded::exact(1.0), Bounded::exact(depth[i]));
    let unit_m = if perspective { z } else { one };
    let asked = Bounded::exact(ao::radius(view, settings) as f32);
    let radius = if perspective && settings.radius > 0.0 { asked / unit_m } else { asked };
    let steps = settings.steps.floor();
    let step_px = radius * f / Bounded::exact(steps);
    let share = one / (radius * radius);
    let least = Bounded::exact((settings.bias * settings.bias) as f32);
    let [cosine, sine] = ao::turn(settings).map(Bounded::exact);
    let (n, may_be_none, may_be) = normal(view, ao::WINDOW_PX as i64, depth, i);
    if !may_be {
        return Some(one);
    }
    if may_be_none {
        return None;
    }
    let [cx, cy] = from_centre(view, i);
    let mut hidden = zero;
    let mut way = [one, zero];
    for _ in 0..settings.directions as u32 {
        let mut highest = zero;
        for step in 0..steps as u32 {
            let far = step_px * Bounded::exact(step as f64 + 0.5);
            let [dx, dy] = [whole(way[0] * far)?, whole(way[1] * far)?];
            let (x, y) = (i as i64 % columns + dx, i as i64 / columns + dy);
            let inside = (0..columns).contains(&x) && (0..rows).contains(&y);
            let Some(other) = inside
                .then(|| depth[(y * columns + x) as usize])
                .filter(|other| known(*other) && (dx, dy) != (0, 0))
            else {
                continue;
            };
            let rise = (Bounded::exact(other) - z) / unit_m;
            let size = Bounded { value: rise.value.abs(), ..rise };
            if !less(size, radius)? {
                continue;
            }
            let [dx, dy] = [dx as f64, dy as f64].map(Bounded::exact);
            let lean = if perspective { [(cx + dx) / f, (cy + dy) / f] } else { [zero; 2] };
            let v = [dx / f + lean[0] * rise, dy / f + lean[1] * rise, rise];
            let above = dot(v, n);
            let square = dot(v, v);
            // Below either of these nothing is added, and near the threshold either answer is
            // within the bound.
            let height = (above.max(0.0) * above.max(0.0) / square - least).max(0.0);
            let near = (one - square * share).max(0.0);
            highest = larger(highest, height * near);
        }
        hidden = hidden + highest;
        way = [way[0] * cosine - way[1] * sine, way[0] * sine + way[1] * cosine];
    }
    let strength = Bounded::exact(settings.strength as f32);
    Some((one - strength * (hidden / Bounded::exact(settings.directions.floor()))).max(0.0))
}

/// Returns the pixel at a distance; `None` if in doubt.
fn whole(px: Bounded) -> Option<i64> {
    let near = (px + Bounded::exact(0.5)).value;
    let error = (px + Bounded::exact(0.5)).error;
    ((near - error).floor() == (near + error).floor()).then_some(near.floor() as i64)
}

fn less(a: Bounded, b: Bounded) -> Option<bool> {
    ((a.value - b.value).abs() > a.error + b.error).then_some(a.value < b.value)
}

fn larger(a: Bounded, b: Bounded) -> Bounded {
    let (lo, hi) =
        ((a.value - a.error).max(b.value - b.error), (a.value + a.error).max(b.value + b.error));
    let value = a.value.max(b.value);
    Bounded { value, error: (hi - value).max(value - lo) }
}
