//! How many samples in, places on the unit disc out: where on a light shadows are cast from (Dobrev et al. 2010, sec. 6; HARD_CASES 14).
//!
//! ```text
//!     the unit square in rows of equal cells, a cell a sample -> a place in each, hashed from seed and sample -> the disc, areas kept (Shirley and Chiu 1997)
//! ```
//! Error of what an edge leaves visible of the disc: n^-3/4, where independent places leave n^-1/2. The same places every time: nothing here knows the hour.

use std::f64::consts::FRAC_PI_4;

/// How places are spread.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Pattern {
    /// One in every cell of equal area.
    #[default]
    Stratified,
    /// Independent, as the paper has them.
    Random,
}

/// A single sample is the disc's centre: a hard shadow.
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
                // Row r has the samples from r n / rows on, and is as high as it has samples.
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

/// The same places in another order: from the one next to the middle on each the farthest from all before it, so that those that come first are spread over the disc as well.
pub fn spread(mut places: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let square = |[u, v]: [f64; 2], [x, y]: [f64; 2]| (u - x).powi(2) + (v - y).powi(2);
    for next in 0..places.len() {
        // The least is taken: of the first the distance to the middle, of the others minus that to the nearest before.
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

/// Squares around the centre become circles.
fn on_disc(square: [f64; 2]) -> [f64; 2] {
    let [x, y] = square.map(|side| 2.0 * side - 1.0);
    let (radius, angle) = match x.abs() > y.abs() {
        true => (x, FRAC_PI_4 * (y / x)),
        false if y != 0.0 => (y, FRAC_PI_4 * (2.0 - x / y)),
        false => (0.0, 0.0),
    };
    [radius * angle.cos(), radius * angle.sin()]
}

/// 53 bits (the finaliser of SplitMix64: Steele, Lea and Flood 2014).
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

    /// What lies to the left of x on the unit disc, as a share of its area.
    fn clipped(x: f64) -> f64 {
        (std::f64::consts::FRAC_PI_2 + x * (1.0 - x * x).sqrt() + x.asin()) / std::f64::consts::PI
    }

    /// Root mean square error over edges in many directions and distances, and seeds.
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

    /// Of a line through log error over log samples, by least squares.
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
            // The one in the middle, and one in each quarter.
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
