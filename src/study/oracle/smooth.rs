//! The f64 twin of `smooth.comp`: from depths and colours in the kernel's own f32 bits to their
//! weighted means with bounds (guide: papers, Dobrev, smoothing).

use super::Bounded;
use crate::passes::smooth::Filter;

/// Returns depth and colour of every smoothed pixel; `None` if unchanged, which applies to empty
/// pixels and to those without a `filled` pixel in their 3 x 3.
pub fn means(
    size: [u32; 2],
    filter: Filter,
    filled: &[bool],
    depth: &[f32],
    color: &[[f32; 4]],
) -> Vec<Option<(Bounded, [Bounded; 3])>> {
    let [columns, rows] = size.map(|side| side as i64);
    let known = |i: usize| depth[i].is_finite() && depth[i] > 0.0;
    let around = |i: usize| {
        let (x, y) = (i as i64 % columns, i as i64 / columns);
        let within =
            move |&(u, v): &(i64, i64)| (0..columns).contains(&u) && (0..rows).contains(&v);
        let all = (y - 1..=y + 1).flat_map(move |v| (x - 1..=x + 1).map(move |u| (u, v)));
        all.filter(within)
            .map(move |(u, v)| ((v * columns + u) as usize, (u - x).abs() + (v - y).abs()))
    };
    let pixel = |i: usize| {
        let zero = Bounded::exact(0.0);
        let (mut weights, mut rise, mut change) = (0.0, zero, [zero; 3]);
        for (k, aside) in around(i).filter(|&(k, _)| known(k)) {
            let weight = match (filter, aside) {
                (Filter::Box, _) | (_, 2) => 1.0,
                (_, 1) => 2.0,
                (Filter::Gaussian, _) => 4.0,
                (Filter::Auto | Filter::Alleviated, _) => 16.0,
            };
            weights += weight;
            rise = rise
                + Bounded::exact(weight) * (Bounded::exact(depth[k]) - Bounded::exact(depth[i]));
            change = [0, 1, 2].map(|c| {
                change[c]
                    + Bounded::exact(weight)
                        * (Bounded::exact(color[k][c]) - Bounded::exact(color[i][c]))
            });
        }
        let share = Bounded::exact(1.0) / Bounded::exact(weights);
        (
            Bounded::exact(depth[i]) + rise * share,
            [0, 1, 2].map(|c| Bounded::exact(color[i][c]) + change[c] * share),
        )
    };
    (0..depth.len())
        .map(|i| (known(i) && around(i).any(|(k, _)| filled[k])).then(|| pixel(i)))
        .collect()
}
