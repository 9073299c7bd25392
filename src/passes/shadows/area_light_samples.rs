//! Sample positions on the unit disc, from which an area light casts shadows (Dobrev et al. 2010,
//! sec. 6; guide: numerics, case 14).
//!
//! ```text
//!     unit square in rows of equal cells, one per sample
//!         -> a position in each, hashed from seed and sample
//!         -> the disc, preserving areas (Shirley and Chiu 1997)
//! ```
//! The error of the share of the disc that an edge leaves visible is n^-3/4; independent samples
//! have n^-1/2. Positions are the same in every run.

use std::f64::consts::FRAC_PI_4;
use strum::{EnumString, IntoStaticStr, VariantArray};

/// The distribution of samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Pattern {
    /// One sample in every cell of equal area.
    #[default]
    Stratified,
    /// Independent samples, as in the paper.
    Random,
}

/// Returns sample positions. A single one is the centre: a hard shadow.
pub fn places(samples: u32, pattern: Pattern, seed: u32) -> Vec<[f64; 2]> {
    if samples == 1 {
        return vec![[0.0; 2]];
    }
    let uniform = |sample: u32, axis: u32| hash(seed, sample, axis) as f64 / (1u64 << 53) as f64;
    let rows = (samples as f64).sqrt() as u32;
    let place = |sample: u32| {
        let jitter = [uniform(sample, 0), uniform(sample, 1)];
        on_disc(match pattern {
            Pattern::Random => jitter,
            Pattern::Stratified => {
                // Row r holds the samples from r n / rows on; its height is proportional to their
                // number.
                let row = (0..rows)
                    .rfind(|row| row * samples / rows <= sample)
                    .expect("row 0 begins with sample 0");
                let [first, end] = [row, row + 1].map(|row| row * samples / rows);
                let count = (end - first) as f64;
                [
                    ((sample - first) as f64 + jitter[0]) / count,
                    (first as f64 + jitter[1] * count) / samples as f64,
                ]
            }
        })
    };
    (0..samples).map(place).collect()
}

/// Returns the same positions in another order: first the one nearest to the middle, then always
/// the farthest from all before it, so that the first ones are spread over the disc as well.
pub fn spread(mut places: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let square = |[u, v]: [f64; 2], [x, y]: [f64; 2]| (u - x).powi(2) + (v - y).powi(2);
    for next in 0..places.len() {
        // The smallest rank is taken: the distance to the middle for the first, minus the distance
        // to the nearest one before for the others.
        let rank = |&at: &[f64; 2]| match next {
            0 => square(at, [0.0; 2]),
            _ => -places[..next]
                .iter()
                .map(|&before| square(at, before))
                .fold(f64::INFINITY, f64::min),
        };
        let ranks: Vec<f64> = places[next..].iter().map(rank).collect();
        let best =
            (0..ranks.len()).min_by(|&a, &b| ranks[a].total_cmp(&ranks[b])).expect("one is left");
        places.swap(next, next + best);
    }
    places
}

/// Maps the square to the disc; squares around the centre become circles.
fn on_disc(square: [f64; 2]) -> [f64; 2] {
    let [x, y] = square.map(|side| 2.0 * side - 1.0);
    let (radius, angle) = match x.abs() > y.abs() {
        true => (x, FRAC_PI_4 * (y / x)),
        false if y != 0.0 => (y, FRAC_PI_4 * (2.0 - x / y)),
        false => (0.0, 0.0),
    };
    [radius * angle.cos(), radius * angle.sin()]
}

/// Returns 53 hashed bits (the finaliser of SplitMix64: Steele, Lea and Flood 2014).
fn hash(seed: u32, sample: u32, axis: u32) -> u64 {
    let mut bits = ((seed as u64) << 32 | (sample as u64) << 1 | axis as u64)
        .wrapping_add(1)
        .wrapping_mul(0x9E37_79B9_7F4A_7C15);
    bits = (bits ^ bits >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ bits >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    (bits ^ bits >> 31) >> 11
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the share of the disc's area to the left of x.
    fn clipped(x: f64) -> f64 {
        (std::f64::consts::FRAC_PI_2 + x * (1.0 - x * x).sqrt() + x.asin()) / std::f64::consts::PI
    }

    /// Returns the root mean square error over edges in many directions and distances, and over
    /// seeds.
    fn error(samples: u32, pattern: Pattern) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for seed in 0..400u32 {
            let places = places(samples, pattern, seed);
            for edge in 0..20u32 {
                let angle = hash(seed, edge, 7) as f64;
                let x = 1.8 * (hash(seed, edge, 9) as f64 / (1u64 << 53) as f64) - 0.9;
                let behind =
                    places.iter().filter(|[u, v]| u * angle.cos() + v * angle.sin() < x).count();
                sum += (behind as f64 / samples as f64 - clipped(x)).powi(2);
                count += 1.0;
            }
        }
        (sum / count).sqrt()
    }

    /// Returns the slope of log error over log samples, by least squares.
    fn slope(pattern: Pattern) -> f64 {
        let points: Vec<[f64; 2]> = [4u32, 9, 16, 36, 64, 144, 256]
            .map(|n| [(n as f64).ln(), error(n, pattern).ln()])
            .to_vec();
        let mean =
            |k: usize| points.iter().map(|point| point[k]).sum::<f64>() / points.len() as f64;
        let (x, y) = (mean(0), mean(1));
        points.iter().map(|p| (p[0] - x) * (p[1] - y)).sum::<f64>()
            / points.iter().map(|p| (p[0] - x).powi(2)).sum::<f64>()
    }

    #[test]
    fn hard_14_errors_fall_as_derived() {
        let [random, stratified] = [Pattern::Random, Pattern::Stratified].map(slope);
        println!("slopes: random {random:.3}, stratified {stratified:.3}");
        assert!(
            (random + 0.5).abs() < 0.05 && (stratified + 0.75).abs() < 0.05,
            "random {random}, stratified {stratified}"
        );
    }

    #[test]
    fn places_in_another_order_are_the_same_and_the_first_few_lie_all_around() {
        for samples in [1, 2, 5, 16, 64] {
            let (before, after) = (
                places(samples, Pattern::Stratified, 0),
                spread(places(samples, Pattern::Stratified, 0)),
            );
            let sorted = |mut places: Vec<[f64; 2]>| {
                places.sort_by(|a, b| a.partial_cmp(b).unwrap());
                places
            };
            assert_eq!(sorted(before), sorted(after.clone()));
            let nearest = after.iter().map(|[u, v]| u.hypot(*v)).fold(f64::INFINITY, f64::min);
            assert_eq!(after[0][0].hypot(after[0][1]), nearest);
            let mean = |count: usize| {
                [0, 1].map(|k| {
                    after[..count].iter().map(|place| place[k]).sum::<f64>() / count as f64
                })
            };
            // One in the middle, and one in each quarter.
            assert!(
                (5..=samples as usize).all(|count| mean(count)[0].hypot(mean(count)[1]) < 0.3),
                "{samples}"
            );
        }
    }

    #[test]
    fn any_number_of_places_lies_on_the_disc_and_its_mean_in_the_middle() {
        for samples in 1..=255 {
            let places = places(samples, Pattern::Stratified, 0);
            assert_eq!(places.len(), samples as usize);
            assert!(places.iter().all(|[u, v]| u * u + v * v <= 1.0 + 1e-12), "{samples}");
            let mean =
                [0, 1].map(|k| places.iter().map(|place| place[k]).sum::<f64>() / samples as f64);
            assert!(
                mean[0].hypot(mean[1]) < 1.2 / samples as f64 + 0.4 / (samples as f64).sqrt(),
                "{samples}: {mean:?}"
            );
        }
    }
}
