//! Point spacing of a node: what a pixel of its points stands for on the screen.
//!
//! Points are in Morton order, so that neighbours in space are mostly neighbours in the list: the
//! measure is that of [`cloud::spacing`](crate::cloud::spacing) within a window of the list around
//! sample points. It misses some neighbours, and is a fifth larger for that.

use crate::cloud::spacing::{NEIGHBOURS, apart};
use crate::config::BITS_PER_PLANE;
use glam::DVec3;

/// Sampled points, and the window on either side of them.
const ASKED: usize = 64;
const WINDOW: usize = 64;

/// Returns the spacing [cells of the coarsest plane], given that plane's words; 0 for a single
/// place. Of places that most points share, one point each is sampled.
pub fn spacing(places: &[u32]) -> f64 {
    let often = usual_run(places);
    let count = places.len().div_ceil(often);
    let place = |i: usize| {
        let word = places[i * often];
        let axis = |k: u32| (word >> (BITS_PER_PLANE * k) & ((1 << BITS_PER_PLANE) - 1)) as f64;
        DVec3::new(axis(0), axis(1), axis(2))
    };
    let mut spacings = Vec::with_capacity(ASKED);
    for k in 0..ASKED.min(count) {
        let own = (2 * k + 1) * count / (2 * ASKED.min(count));
        let window: Vec<DVec3> = (own.saturating_sub(WINDOW)..(own + WINDOW + 1).min(count))
            .filter(|&i| i != own)
            .map(place)
            .collect();
        let at = place(own);
        let mut squares: Vec<f64> = window.iter().map(|p| p.distance_squared(at)).collect();
        if squares.is_empty() {
            continue;
        }
        let eighth = NEIGHBOURS.min(squares.len()) - 1;
        let (_, square, _) = squares.select_nth_unstable_by(eighth, f64::total_cmp);
        spacings.push(apart(*square, eighth + 1));
    }
    spacings.sort_by(f64::total_cmp);
    spacings.get(spacings.len() * 3 / 4).copied().unwrap_or(0.0)
}

/// Returns the median length of runs of equal places; 1 if there is none.
fn usual_run(places: &[u32]) -> usize {
    // How often each length occurs; most runs are short.
    let mut lengths: Vec<usize> = Vec::new();
    let mut runs = 0;
    for run in places.chunk_by(|a, b| a == b) {
        if run.len() >= lengths.len() {
            lengths.resize(run.len() + 1, 0);
        }
        lengths[run.len()] += 1;
        runs += 1;
    }
    let mut shorter = 0;
    let reaches_middle = |count: &usize| {
        shorter += count;
        shorter > runs / 2
    };
    lengths.iter().position(reaches_middle).unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::index::format::morton;

    fn sorted(mut points: Vec<[u32; 3]>) -> Vec<u32> {
        points.sort_by_key(|&p| morton::code(p));
        points.iter().map(|[x, y, z]| x | y << 10 | z << 20).collect()
    }

    #[test]
    fn a_square_lattice_and_random_points_on_a_plane_are_as_far_apart_as_they_are() {
        let lattice = sorted((0..100 * 100).map(|i| [i % 100 * 10, i / 100 * 10, 500]).collect());
        let found = spacing(&lattice);
        assert!((8.0..16.0).contains(&found), "{found}");
        let mut state = 1u64;
        let mut random = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 54) as u32
        };
        let points = sorted((0..10_000).map(|_| [random(), random(), 3]).collect());
        let found = spacing(&points);
        assert!((8.0..16.0).contains(&found), "{found}");
    }

    #[test]
    fn one_place_has_no_spacing() {
        assert_eq!(spacing(&[0]), 0.0);
        assert_eq!(spacing(&[77; 1000]), 0.0);
        assert_eq!(spacing(&[]), 0.0);
    }
}
