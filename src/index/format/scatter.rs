//! How the points of a node lie: on surfaces or scattered, how far apart, and where, clump by
//! clump.
//!
//! Points are in Morton order, so a run of them lies together, and neighbours in space are mostly
//! neighbours in the list. Around seeds of a clump the covariance of the nearest places, with
//! eigenvalues a <= b <= c, tells how they lie. Its invariants give a measure without eigenvalues:
//!
//! ```text
//! scatter = det trace / minors^2 = abc (a + b + c) / (ab + bc + ca)^2
//! ```
//! It is 0 on a plane, near a / b on a narrow one, 1/4 around a line, and at most 1/3, where points
//! lie in all directions alike. Noise of a surface is small beside the extent of many neighbours.

use crate::cloud::spacing::{NEIGHBOURS, apart};
use crate::config::BITS_PER_PLANE;
use glam::DVec3;
use std::ops::Range;

/// Points of a clump.
pub const POINTS_PER_CLUMP: usize = 1024;

/// Scatter from which points lie on no surface: half of what points in all directions have.
/// Surfaces with noise, and rough ones, have less; crowns and undergrowth have more.
pub const SCATTERED: f64 = 1.0 / 6.0;

/// How the points of a clump lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clump {
    /// Point spacing `[m]`.
    pub spacing: f64,
    /// Median scatter of its seeds and, with less weight, of those of the clumps before and after
    /// it: 0 to 1/3; 0 if too few points tell.
    pub scatter: f64,
    /// How far its cells reach in the directions of [`signs`], from the node's origin [cells of its
    /// coarsest plane].
    reach: [i16; SIGNS],
}

impl Default for Clump {
    fn default() -> Self {
        Clump { spacing: 0.0, scatter: 0.0, reach: [0; SIGNS] }
    }
}

impl Clump {
    /// Tests whether the points lie on no surface.
    pub fn is_scattered(&self) -> bool {
        self.scatter >= SCATTERED
    }

    /// Returns the share of the spacing that splats cover: all of it on a surface, half of it where
    /// points lie in all directions alike, since gaps between them show others behind.
    pub fn covered(&self) -> f64 {
        1.0 - 1.5 * self.scatter
    }

    /// Returns the corners of the box of its points, from the node's origin `[cells]`.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let most = [1, 3, 9].map(|digit| self.reach[SIGNS / 2 + digit] as f64);
        let least = [1, 3, 9].map(|digit| -self.reach[SIGNS / 2 - digit] as f64);
        (least.into(), most.into())
    }

    /// Returns how far its points reach along a direction, at most, given that in cells. The
    /// direction is a sum of three with signs alone: of its longest axis, of its two longest, of
    /// all.
    pub fn reach_along(&self, direction: DVec3) -> f64 {
        let mut axes = [0, 1, 2].map(|axis| (direction[axis].abs(), axis));
        axes.sort_by(|a, b| b.0.total_cmp(&a.0));
        let (mut number, mut reach) = (1 + 3 + 9, 0.0);
        for (k, (length, axis)) in axes.into_iter().enumerate() {
            let digit = [1, 3, 9][axis];
            number = if direction[axis] < 0.0 { number - digit } else { number + digit };
            let shorter = axes.get(k + 1).map_or(0.0, |next| next.0);
            reach += (length - shorter) * self.reach[number] as f64;
        }
        reach
    }
}

/// Breadth over length of neighbours up to which they lie along a line, which may be bent.
const NARROWEST: f64 = 0.2;

/// Seeds of a clump.
const SEEDS: usize = 8;
/// Places whose covariance is computed, among a window of the list. A cloud of no more points has
/// no surface that could be told.
pub const AROUND: usize = 32;
const WINDOW: usize = 64;

/// Returns the clumps of a node, given the words of its coarsest plane, the bits of its longest
/// side and a lattice step `[m]`. Cells count once, however many points they hold. Points that are
/// joined by faces lie on surfaces, however thin the object is.
pub fn clumps(words: &[u32], bits: u32, step: DVec3, faces: bool) -> Vec<Clump> {
    // In units of the longest side of a cell, whose powers neither overflow nor vanish.
    let longest = step.abs().max_element();
    let cell = step.abs() / longest;
    let unit = longest * (2f64).powi(bits as i32 - BITS_PER_PLANE as i32);
    let place = |word: u32| {
        let axis = |k: u32| (word >> (BITS_PER_PLANE * k) & ((1 << BITS_PER_PLANE) - 1)) as f64;
        DVec3::new(axis(0), axis(1), axis(2)) * cell
    };
    let is_new = |i: &usize| *i == 0 || words[*i] != words[*i - 1];
    let firsts: Vec<u32> = (0..words.len()).filter(is_new).map(|i| i as u32).collect();
    let places = |range: Range<usize>| firsts[range].iter().map(|&i| place(words[i as usize]));
    let seeds = |start: usize| -> Vec<Clump> {
        let [first, end] = [start, start + POINTS_PER_CLUMP]
            .map(|point| firsts.partition_point(|&i| (i as usize) < point));
        let seeds = SEEDS.min(end - first);
        (0..seeds)
            .map(|k| first + (2 * k + 1) * (end - first) / (2 * seeds))
            .map(|own| {
                let window = own.saturating_sub(WINDOW)..(own + WINDOW + 1).min(firsts.len());
                around(place(words[firsts[own] as usize]), places(window))
            })
            .collect()
    };
    let seeds: Vec<Vec<Clump>> = (0..words.len()).step_by(POINTS_PER_CLUMP).map(seeds).collect();
    let clump = |k: usize| {
        // Its own seeds decide if they agree, else those beside them as well.
        let beside = &seeds[k.saturating_sub(1)..(k + 2).min(seeds.len())];
        let all = beside.iter().chain([&seeds[k], &seeds[k]]).flatten();
        let points = &words[k * POINTS_PER_CLUMP..((k + 1) * POINTS_PER_CLUMP).min(words.len())];
        Clump {
            reach: reach(points),
            // Sparser areas have the larger gaps.
            spacing: unit * quantile(seeds[k].iter().map(|seed| seed.spacing), 0.75),
            scatter: if faces { 0.0 } else { quantile(all.map(|seed| seed.scatter), 0.5) },
        }
    };
    (0..seeds.len()).map(clump).collect()
}

/// Returns how far points reach, as [`Clump::reach`].
fn reach(words: &[u32]) -> [i16; SIGNS] {
    // Opposite directions have opposite numbers: the least and the most along half of them tell.
    let mut ends = [[i16::MAX, i16::MIN]; SIGNS / 2 + 1];
    let mut cells = [[0; POINTS_PER_CLUMP]; 3];
    for words in words.chunks(POINTS_PER_CLUMP) {
        for (axis, cells) in (0..).zip(&mut cells) {
            cells.iter_mut().zip(words).for_each(|(to, &word)| *to = cell(word, axis));
        }
        let [xs, ys, zs] = cells.each_ref().map(|cells| &cells[..words.len()]);
        for (number, [least, most]) in ends.iter_mut().enumerate() {
            let [x, y, z] = signs(number);
            for ((&a, &b), &c) in xs.iter().zip(ys).zip(zs) {
                let along = x * a + y * b + z * c;
                (*least, *most) = ((*least).min(along), (*most).max(along));
            }
        }
    }
    let mut reach = [0; SIGNS];
    for (number, [least, most]) in ends.into_iter().enumerate().filter(|_| !words.is_empty()) {
        // A cell ends one cell after it begins.
        let cell =
            |sign: i16| signs(number).into_iter().filter(|own| own * sign > 0).count() as i16;
        (reach[SIGNS - 1 - number], reach[number]) = (cell(-1) - least, most + cell(1));
    }
    reach
}

fn cell(word: u32, axis: u32) -> i16 {
    (word >> (BITS_PER_PLANE * axis) & ((1 << BITS_PER_PLANE) - 1)) as i16
}

/// Directions of [`Clump::reach`]: every combination of signs of the three axes.
const SIGNS: usize = 27;

/// Returns the signs of a direction, by its number in base 3.
fn signs(number: usize) -> [i16; 3] {
    [number % 3, number / 3 % 3, number / 9].map(|digit| digit as i16 - 1)
}

/// Returns the value at this share of all; 0 if there is none.
fn quantile(values: impl Iterator<Item = f64>, share: f64) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get((share * values.len() as f64) as usize).copied().unwrap_or(0.0)
}

/// Measures the places around one, which is among them, in their unit.
fn around(at: DVec3, window: impl Iterator<Item = DVec3>) -> Clump {
    let mut near: Vec<(f64, DVec3)> =
        window.map(|place| (place.distance_squared(at), place - at)).collect();
    // The place itself is the nearest.
    let by_distance = |a: &(f64, DVec3), b: &(f64, DVec3)| a.0.total_cmp(&b.0);
    if near.len() > AROUND {
        near.select_nth_unstable_by(AROUND, by_distance);
        near.truncate(AROUND + 1);
    }
    let neighbours = NEIGHBOURS.min(near.len() - 1);
    near.select_nth_unstable_by(neighbours, by_distance);
    near[..=neighbours].sort_by(by_distance);
    let spacing = typical(&near[1..=neighbours]);
    let scatter = if near.len() > AROUND { scatter(&near) } else { 0.0 };
    Clump { spacing, scatter, ..Clump::default() }
}

/// Returns the median of the spacings by the nearest neighbour, by the nearest two, and so on: few
/// points beside each other are as far apart as they are, however far off the next ones lie.
fn typical(nearest: &[(f64, DVec3)]) -> f64 {
    quantile(nearest.iter().zip(1..).map(|((square, _), count)| apart(*square, count)), 0.5)
}

/// Returns the scatter of places; that of a line if they lie on one.
fn scatter(places: &[(f64, DVec3)]) -> f64 {
    let mean = places.iter().map(|(_, place)| *place).sum::<DVec3>() / places.len() as f64;
    let [mut xx, mut yy, mut zz, mut xy, mut yz, mut zx] = [0.0; 6];
    for (_, place) in places {
        let d = *place - mean;
        (xx, yy, zz) = (xx + d.x * d.x, yy + d.y * d.y, zz + d.z * d.z);
        (xy, yz, zx) = (xy + d.x * d.y, yz + d.y * d.z, zx + d.z * d.x);
    }
    let trace = xx + yy + zz;
    let minors = xx * yy - xy * xy + yy * zz - yz * yz + zz * xx - zx * zx;
    let det = xx * (yy * zz - yz * yz) + xy * (yz * zx - xy * zz) + zx * (xy * yz - yy * zx);
    if minors <= NARROWEST * NARROWEST * trace * trace {
        0.25
    } else {
        (det * trace / (minors * minors)).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::index::format::morton;

    /// Returns the coarsest plane of points in a box of this many cells.
    fn node(side: [f64; 3], count: usize, bend: impl Fn([f64; 3]) -> [f64; 3]) -> Vec<u32> {
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let mut points: Vec<[u32; 3]> = (0..count)
            .map(|_| bend(side.map(|side| side * random())).map(|at| at.clamp(0.0, 1023.0) as u32))
            .collect();
        points.sort_by_key(|&p| morton::code(p));
        points.iter().map(|[x, y, z]| x | y << 10 | z << 20).collect()
    }

    fn medians(words: &[u32]) -> [f64; 2] {
        let clumps = clumps(words, BITS_PER_PLANE, DVec3::ONE, false);
        assert_eq!(clumps.len(), words.len().div_ceil(POINTS_PER_CLUMP));
        [|clump: &Clump| clump.spacing, |clump: &Clump| clump.scatter].map(|of| {
            let mut values: Vec<f64> = clumps.iter().map(of).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        })
    }

    #[test]
    fn planes_and_spheres_are_surfaces_and_crowns_and_wires_are_not() {
        let plane =
            node([1023.0, 1023.0, 4.0], 40_000, |p| [p[0], p[1], 300.0 + 0.3 * p[0] + p[2]]);
        let [spacing, scatter] = medians(&plane);
        assert!((4.0..8.0).contains(&spacing) && scatter < 0.05, "{spacing} {scatter}");
        let sphere = node([2.0, 6.3, 1.0], 40_000, |[z, turn, _]| {
            let around = (1.0 - (z - 1.0) * (z - 1.0)).max(0.0).sqrt();
            [around * turn.cos(), around * turn.sin(), z - 1.0].map(|at| 500.0 + 480.0 * at)
        });
        assert!(medians(&sphere)[1] < 0.05, "{:?}", medians(&sphere));
        let crown = node([1023.0; 3], 40_000, |p| p);
        let [spacing, scatter] = medians(&crown);
        assert!((20.0..60.0).contains(&spacing) && scatter > 0.22, "{spacing} {scatter}");
        let mesh = clumps(&crown, BITS_PER_PLANE, DVec3::ONE, true);
        assert!(!mesh.iter().any(Clump::is_scattered));
        let wire = node([1023.0, 3.0, 3.0], 900, |p| p);
        assert!(medians(&wire)[1] > 0.2, "{:?}", medians(&wire));
    }

    #[test]
    fn no_point_lies_beyond_the_reach_of_its_clump_and_some_nearly_reach_it() {
        let ball = node([2.0, 6.3, 1.0], 3000, |[z, turn, _]| {
            let around = (1.0 - (z - 1.0) * (z - 1.0)).max(0.0).sqrt();
            [around * turn.cos(), around * turn.sin(), z - 1.0].map(|at| 500.0 + 480.0 * at)
        });
        let clump = Clump { reach: reach(&ball), ..Clump::default() };
        for k in 0..500 {
            let turn = k as f64;
            let direction = DVec3::new(turn.sin(), (1.7 * turn).cos(), (0.3 * turn).sin());
            let middle =
                |word: u32| DVec3::from([0, 1, 2].map(|axis| cell(word, axis) as f64 + 0.5));
            let half_cell = 0.5 * direction.abs().element_sum();
            let most = ball.iter().map(|&word| middle(word).dot(direction) + half_cell);
            let slack = clump.reach_along(direction) - most.fold(f64::MIN, f64::max);
            let allowed = -1e-9..0.09 * 960.0 * direction.length();
            assert!(allowed.contains(&slack), "{direction} {slack}");
        }
    }

    #[test]
    fn rows_far_apart_have_the_spacing_of_their_points() {
        let mut rows: Vec<[u32; 3]> = (0..60).map(|i| [2 * (i % 6), 100 * (i / 6), 0]).collect();
        rows.sort_by_key(|&p| morton::code(p));
        let words: Vec<u32> = rows.iter().map(|[x, y, z]| x | y << 10 | z << 20).collect();
        let [spacing, _] = medians(&words);
        assert!((2.0..9.0).contains(&spacing), "{spacing}");
    }

    #[test]
    fn few_points_tell_nothing_and_a_line_is_no_surface() {
        assert_eq!(clumps(&[], 1, DVec3::ONE, false), []);
        let one = Clump { reach: reach(&[7]), ..Clump::default() };
        assert_eq!(clumps(&[7; 3000], 1, DVec3::ONE, false), [one; 3]);
        let [spacing, scatter] = medians(&node([9.0; 3], AROUND, |p| p));
        assert!(spacing > 0.0 && scatter == 0.0);
        let line: Vec<u32> = (0..1000).collect();
        assert_eq!(medians(&line)[1], 0.25);
    }
}
