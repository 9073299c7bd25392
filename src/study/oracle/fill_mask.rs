//! The exact twin of filling by masks: from depths to depths, and the source pixel of each (guide:
//! papers, Dobrev). Its only arithmetic is one difference.

/// Offsets right and down, clockwise from the upper left.
const RING: [(i64, i64); 8] =
    [(-1, -1), (0, -1), (1, -1), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0)];

/// A pixel's depth, its source pixel, and the steps it may still spread.
type Taken = (f32, usize, u32);

/// Fills with at most this many steps of either kind. `layer` is in metres. `reach` is the number
/// of steps that values of a pixel of this depth may spread. `found`: holes are known (depth minus
/// infinity) and take values from any distance. Returns `None` for empty pixels.
pub fn fill(
    size: [u32; 2],
    depth: &[f32],
    layer: f32,
    most: u32,
    found: bool,
    reach: impl Fn(f32) -> u32,
) -> Vec<Option<Taken>> {
    let known = |(i, &z): (usize, &f32)| (z.is_finite() && z > 0.0).then(|| (z, i, reach(z)));
    let mut pixels: Vec<_> = depth.iter().enumerate().map(known).collect();
    for occluded in [false, true] {
        for _ in 0..most {
            let next = (0..pixels.len())
                .map(|i| {
                    step(
                        size,
                        &pixels,
                        layer,
                        occluded,
                        found.then(|| depth[i] == f32::NEG_INFINITY),
                        i,
                    )
                })
                .collect();
            if next == pixels {
                break;
            }
            pixels = next;
        }
    }
    pixels
}

fn step(
    size: [u32; 2],
    pixels: &[Option<Taken>],
    layer: f32,
    occluded: bool,
    hole: Option<bool>,
    i: usize,
) -> Option<Taken> {
    let [columns, rows] = size.map(|side| side as i64);
    let (x, y) = (i as i64 % columns, i as i64 / columns);
    let at = |(u, v): (i64, i64)| {
        let (x, y) = (x + u, y + v);
        let inside = (0..columns).contains(&x) && (0..rows).contains(&y);
        inside.then(|| pixels[(y * columns + x) as usize]).flatten()
    };
    let own = pixels[i];
    let behind = |neighbour: Option<Taken>| match (own, neighbour) {
        (_, None) => true,
        (None, Some(_)) => false,
        (Some((own, ..)), Some((z, ..))) => z as f64 > own as f64 - layer as f64 || z >= own,
    };
    let mask = |first: usize| (first..first + 5).all(|k| behind(at(RING[k % 8])));
    let stays = match hole {
        Some(hole) => {
            (occluded || !hole) && RING.iter().filter(|&&aside| behind(at(aside))).count() > 3
        }
        None => (0..8).any(mask),
    };
    if own.is_some() != occluded || stays {
        return own;
    }
    let found = !occluded && hole.is_some();
    // Row by row; the first of equals.
    let around =
        (-1..=1).flat_map(|v| (-1..=1).map(move |u| (u, v))).filter(|aside| *aside != (0, 0));
    let taken = around
        .filter(|&aside| !behind(at(aside)))
        .filter_map(at)
        .filter(|(_, _, left)| *left > 0 || found)
        .min_by(|a, b| a.0.total_cmp(&b.0));
    taken.map(|(z, from, left)| (z, from, left.saturating_sub(1))).or(own)
}
