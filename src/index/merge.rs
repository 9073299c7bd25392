//! Merges children's samples into their parent's (Pintus, section 7; guide: papers), with a grid
//! that fits the data.
//!
//! ```text
//! merge(samples in Morton order):
//!   count, for all neighbours in the order, the highest bit in which their codes differ
//!   drop as few low bits of the codes as leave at most M different ones: the cells of the grid
//!   one sample per cell: mean position, mean colour in linear light, mean intensity, kinds by
//!     majority; weight = the sum of the weights
//! ```
//!
//! If several stations meet in a cell and their exposure gains are known, the colour is the mean of
//! the balanced colours, in the exposure of the station that the sample names: Sum w g c / (Sum w)
//! / g', with the gain g of each sample's station and g' of the named one. The gain of the named
//! station then shows the mean of all. The same holds for intensities, with gains of their own.
//!
//! A grid of M cells over the box would hold few samples of a surface (M^(2/3)); this one is as
//! fine as M samples allow, whatever the shape of the data. All sums are integers, so that the
//! result does not depend on any order of execution.

use super::format::morton;
use super::format::samples::{Cell, DerivedColumns, Samples};
use super::format::schema::Balance;
use crate::cloud::ColumnSet;
use crate::config::{BITS_PER_PLANE, POINTS_PER_PAGE, POSITION_PLANES};
use std::borrow::Cow;
use std::ops::Range;
use std::sync::LazyLock;

/// Merged positions are rounded to the cell's shortest side over 2^this: below half of what merging
/// itself moved them.
const BITS_WITHIN_CELL: u32 = 2;

/// Merged samples, the low code bits that their cells drop, and the rounding of positions as a
/// power of two.
pub struct Merged {
    pub samples: Samples,
    pub dropped: u32,
    pub coarser: u32,
}

/// Exposure gain of every station, of colours and of intensities; none if unknown.
pub struct Gains {
    colors: Vec<u32>,
    intensities: Vec<u32>,
}

impl Gains {
    /// Fraction bits: gains of 2^-4 to 2^4 become 2^8 to 2^16, whose products with 16 bits of light
    /// fit 32.
    const BITS: i32 = 12;
    /// Fraction bits of gains of intensities, whose means are of 16 bits.
    const INTENSITY_BITS: i32 = 24;

    pub fn new(colors: Option<&Balance>, intensities: Option<&Balance>) -> Gains {
        let fixed = |balance: Option<&Balance>, bits: i32| -> Vec<u32> {
            let gains = balance.map_or(&[][..], |balance| &balance.gains);
            gains.iter().map(|gain| (gain * 2f64.powi(bits)).round() as u32).collect()
        };
        Gains {
            colors: fixed(colors, Gains::BITS),
            intensities: fixed(intensities, Gains::INTENSITY_BITS),
        }
    }
}

/// Merges `samples`, which are in Morton order.
pub fn merge(samples: &Samples, has: ColumnSet, gains: Option<&Gains>) -> Merged {
    let (runs, dropped) = cut(samples);
    let coarser = (dropped / 3).saturating_sub(BITS_WITHIN_CELL);
    let weights = runs.sums();
    let rgb = samples.rgb.as_deref().unwrap_or_default();
    let source = has.source.then(|| runs.majorities(samples.source.as_deref().unwrap_or_default()));
    let stations = samples.source.as_deref().zip(source.as_deref());
    let known = |pick: fn(&Gains) -> &[u32]| {
        gains.map(pick).filter(|gains| !gains.is_empty()).zip(stations)
    };
    let colors = || match known(|gains| &gains.colors) {
        Some((gains, (of, named))) => runs.balanced_colors(rgb, &weights, of, named, gains),
        None => runs.colors(rgb, &weights),
    };
    let values = samples.intensity.as_deref().unwrap_or_default();
    let intensities = || match known(|gains| &gains.intensities) {
        Some((gains, (of, named))) => runs.balanced_means(values, &weights, of, named, gains),
        None => runs.means(values, &weights),
    };
    let merged = Samples {
        q: runs.positions(&weights, dropped, coarser),
        rgb: has.rgb.then(colors),
        intensity: has.intensity.then(intensities),
        class: has.class.then(|| runs.majorities(samples.class.as_deref().unwrap_or_default())),
        returns: has
            .returns
            .then(|| runs.majorities(samples.returns.as_deref().unwrap_or_default())),
        source,
        normal: has.normal.then(|| runs.normals(samples.normal.as_deref().unwrap_or_default())),
        gps_time: has.gps_time.then(|| runs.times(samples.gps_time.as_deref().unwrap_or_default())),
        weight: Some(weights.iter().map(|&weight| weight.min(u32::MAX as u64) as u32).collect()),
        derived: DerivedColumns::default(),
    };
    Merged { samples: merged, dropped, coarser }
}

/// Returns the runs of samples that [`merge`] makes one of each.
pub fn runs(samples: &Samples) -> Runs<'_> {
    cut(samples).0
}

/// Returns the runs, and the low code bits that their cells drop.
fn cut(samples: &Samples) -> (Runs<'_>, u32) {
    // For all neighbours the highest bit in which their codes differ, counted from 1; 0 if equal.
    let differ: Vec<u8> =
        samples.q.windows(2).map(|pair| morton::highest_difference(pair[0], pair[1])).collect();
    let mut pairs = [0usize; 97];
    differ.iter().for_each(|&bit| pairs[bit as usize] += 1);
    // With the lowest `dropped` bits gone, a new cell starts where neighbours differ in a higher
    // one.
    let mut cells = 1 + pairs[1..].iter().sum::<usize>();
    let mut dropped = 0u32;
    let least = least_dropped(&samples.q);
    while cells > POINTS_PER_PAGE as usize || dropped < least {
        dropped += 1;
        cells -= pairs[dropped as usize];
    }
    let mut starts = Vec::with_capacity(cells + 1);
    starts.push(0);
    starts.extend(
        differ.iter().enumerate().filter(|&(_, &bit)| bit as u32 > dropped).map(|(i, _)| i + 1),
    );
    starts.push(samples.len());
    let weights =
        samples.weight.as_deref().map_or_else(|| vec![1; samples.len()].into(), Cow::Borrowed);
    (Runs { samples, weights, starts }, dropped)
}

/// Returns the bits to drop so that positions, rounded as by [`merge`], fit their planes: none
/// unless samples lie 2^30 steps apart.
fn least_dropped(q: &[Cell]) -> u32 {
    let most = 1u32 << (BITS_PER_PLANE * POSITION_PLANES);
    let (mut low, mut high) = ([u32::MAX; 3], [0; 3]);
    q.iter().for_each(|q| {
        (0..3).for_each(|axis| {
            (low[axis], high[axis]) = (low[axis].min(q[axis]), high[axis].max(q[axis]))
        })
    });
    let coarser = |axis: usize| {
        (0..32)
            .find(|&coarser| (high[axis] >> coarser).saturating_sub(low[axis] >> coarser) < most)
            .unwrap_or(32)
    };
    match coarser(0).max(coarser(1)).max(coarser(2)) {
        0 => 0,
        coarser => 3 * (coarser + BITS_WITHIN_CELL),
    }
}

/// The runs of samples that become one each.
pub struct Runs<'a> {
    samples: &'a Samples,
    /// Weight of each sample.
    weights: Cow<'a, [u32]>,
    starts: Vec<usize>,
}

impl Runs<'_> {
    pub fn weight(&self, i: usize) -> u32 {
        self.weights[i]
    }

    /// Returns mean colours, averaged in linear light.
    pub fn mean_colors(&self, rgb: &[[u8; 3]]) -> Vec<[u8; 3]> {
        self.colors(rgb, &self.sums())
    }

    /// Returns the sum of weights of each run.
    fn sums(&self) -> Vec<u64> {
        self.each(|run| self.weights[run].iter().map(|&weight| weight as u64).sum())
    }

    pub fn each<T>(&self, one: impl FnMut(Range<usize>) -> T) -> Vec<T> {
        self.starts.windows(2).map(|ends| ends[0]..ends[1]).map(one).collect()
    }

    fn weighted<T>(&self, weights: &[u64], mut one: impl FnMut(Range<usize>, u64) -> T) -> Vec<T> {
        self.starts
            .windows(2)
            .zip(weights)
            .map(|(ends, &weight)| one(ends[0]..ends[1], weight))
            .collect()
    }

    /// Returns a weighted mean, rounded to nearest.
    fn mean<const N: usize>(
        &self,
        run: Range<usize>,
        total: u64,
        value: impl Fn(usize) -> [u32; N],
    ) -> [u64; N] {
        if run.len() == 1 {
            return value(run.start).map(u64::from);
        }
        let weighted = |i: usize| value(i).map(|v| self.weights[i] as u64 * v as u64);
        let half = total / 2;
        // Products of 32 bits by 32 fit 64 bits, and their sum does where the sum of the weights
        // fits 32.
        if total >> 32 == 0 {
            let mut sum = [half; N];
            run.for_each(|i| sum.iter_mut().zip(weighted(i)).for_each(|(sum, v)| *sum += v));
            return sum.map(|sum| quotient(sum, total));
        }
        let mut sum = [half as u128; N];
        run.for_each(|i| sum.iter_mut().zip(weighted(i)).for_each(|(sum, v)| *sum += v as u128));
        sum.map(|sum| (sum / total as u128) as u64)
    }

    /// Returns mean positions, rounded to the centres of 2^coarser steps, which lie within the
    /// cell: the samples stay in the order of their cells.
    fn positions(&self, weights: &[u64], dropped: u32, coarser: u32) -> Vec<Cell> {
        let bits = morton::axis_bits(dropped);
        let (q, middle) = (&self.samples.q, (1u32 << coarser) >> 1);
        self.weighted(weights, |run, total| {
            let first = q[run.start];
            let corner: Cell =
                std::array::from_fn(|axis| (first[axis] as u64 >> bits[axis] << bits[axis]) as u32);
            // Below the cell's side, which the mean cannot reach.
            let within: [u64; 3] =
                self.mean(run, total, |i| std::array::from_fn(|axis| q[i][axis] - corner[axis]));
            std::array::from_fn(|axis| {
                let within = within[axis].min((1u64 << bits[axis]) - 1) as u32;
                ((corner[axis] + within) >> coarser << coarser) + middle
            })
        })
    }

    fn colors(&self, rgb: &[[u8; 3]], weights: &[u64]) -> Vec<[u8; 3]> {
        let (decode, encode) = (&*DECODE, &**ENCODE);
        let linear = |i: usize| rgb[i].map(|v| decode[v as usize] as u32);
        self.weighted(weights, |run, total| {
            self.mean(run, total, linear).map(|mean| encode[mean as usize])
        })
    }

    /// Returns mean colours in the exposure of the station `named` for each run; `of` are those of
    /// the samples.
    fn balanced_colors(
        &self,
        rgb: &[[u8; 3]],
        weights: &[u64],
        of: &[u16],
        named: &[u16],
        gains: &[u32],
    ) -> Vec<[u8; 3]> {
        let (decode, encode) = (&*DECODE, &**ENCODE);
        let linear = |i: usize| rgb[i].map(|v| decode[v as usize] as u32);
        let mut named = named.iter();
        self.weighted(weights, |run, total| {
            let named = *named.next().expect("a station for every run");
            if of[run.clone()].iter().all(|&station| station == named) {
                return self.mean(run, total, linear).map(|mean| encode[mean as usize]);
            }
            let balanced = |i: usize| linear(i).map(|v| v * gains[of[i] as usize]);
            let own = gains[named as usize] as u64;
            // Rounded once, and clamped to the brightest value of this station.
            let shown = |mean: u64| encode[mean.min(u16::MAX as u64) as usize];
            // Products of 32 bits by 32 fit 64 bits, and their sum does where the sum of the
            // weights fits 32.
            if total >> 32 == 0 {
                let mut sum = [total * own / 2; 3];
                run.for_each(|i| {
                    sum.iter_mut()
                        .zip(balanced(i))
                        .for_each(|(sum, v)| *sum += self.weights[i] as u64 * v as u64)
                });
                return sum.map(|sum| shown(quotient(sum, total * own)));
            }
            let total = total as u128 * own as u128;
            let mut sum = [total / 2; 3];
            run.for_each(|i| {
                sum.iter_mut()
                    .zip(balanced(i))
                    .for_each(|(sum, v)| *sum += self.weights[i] as u128 * v as u128)
            });
            sum.map(|sum| shown((sum / total) as u64))
        })
    }

    fn means(&self, values: &[u16], weights: &[u64]) -> Vec<u16> {
        self.weighted(weights, |run, total| self.mean(run, total, |i| [values[i] as u32])[0] as u16)
    }

    /// Returns mean values in the exposure of the stations that runs name.
    fn balanced_means(
        &self,
        values: &[u16],
        weights: &[u64],
        of: &[u16],
        named: &[u16],
        gains: &[u32],
    ) -> Vec<u16> {
        let mut named = named.iter();
        self.weighted(weights, |run, total| {
            let named = *named.next().expect("a station for every run");
            if of[run.clone()].iter().all(|&station| station == named) {
                return self.mean(run, total, |i| [values[i] as u32])[0] as u16;
            }
            let gain = |station: u16| gains[station as usize] as u128;
            let balanced = |i: usize| self.weights[i] as u128 * values[i] as u128 * gain(of[i]);
            let total = total as u128 * gain(named);
            ((run.map(balanced).sum::<u128>() + total / 2) / total).min(u16::MAX.into()) as u16
        })
    }

    /// Returns the value with the greatest weight; of ties the least.
    fn majorities<T: Copy + Ord>(&self, values: &[T]) -> Vec<T> {
        let mut all: Vec<(T, u64)> = Vec::new();
        self.each(|run| {
            let first = values[run.start];
            if values[run.clone()].iter().all(|&value| value == first) {
                return first;
            }
            all.clear();
            all.extend(run.map(|i| (values[i], self.weights[i] as u64)));
            all.sort_unstable();
            let mut best = (first, 0);
            for run in all.chunk_by(|a, b| a.0 == b.0) {
                let weight = run.iter().map(|(_, weight)| weight).sum();
                if weight > best.1 {
                    best = (run[0].0, weight);
                }
            }
            best.0
        })
    }

    fn normals(&self, normals: &[[i8; 3]]) -> Vec<[i8; 3]> {
        self.each(|run| {
            let mut sum = [0i64; 3];
            for i in run {
                (0..3)
                    .for_each(|axis| sum[axis] += self.weights[i] as i64 * normals[i][axis] as i64);
            }
            let length = sum.map(|v| v as f64 * v as f64).iter().sum::<f64>().sqrt();
            if length > 0.0 {
                sum.map(|v| (v as f64 / length * 127.0).round() as i8)
            } else {
                [0; 3]
            }
        })
    }

    /// Returns the time of the heaviest sample, of ties the earliest: times of different passes
    /// have no meaningful mean.
    fn times(&self, times: &[f64]) -> Vec<f64> {
        let weight = |i: usize| self.weights[i];
        self.each(|run| {
            let heaviest =
                run.max_by(|&a, &b| weight(a).cmp(&weight(b)).then(times[b].total_cmp(&times[a])));
            times[heaviest.expect("a cell has samples")]
        })
    }
}

/// Divides, rounding down. For integers below 2^53 the f64 quotient is never rounded up to the next
/// integer, and is faster than integer division.
fn quotient(sum: u64, total: u64) -> u64 {
    if (sum | total) >> 53 == 0 {
        (sum as i64 as f64 / total as i64 as f64) as i64 as u64
    } else {
        sum / total
    }
}

/// sRGB to 16-bit linear light: finer than the steps of 8-bit sRGB everywhere.
static DECODE: LazyLock<[u16; 256]> = LazyLock::new(|| {
    std::array::from_fn(|v| {
        let encoded = v as f64 / 255.0;
        let linear = if encoded <= 0.04045 {
            encoded / 12.92
        } else {
            ((encoded + 0.055) / 1.055).powf(2.4)
        };
        (linear * 65535.0).round() as u16
    })
});

/// Linear light to the nearest sRGB value, so that a mean of equal colours is that colour.
static ENCODE: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let mut nearest = 0u8;
    let distance = |value: u8, linear: u16| (DECODE[value as usize] as i32 - linear as i32).abs();
    (0..=u16::MAX)
        .map(|linear| {
            while nearest < 255 && distance(nearest + 1, linear) < distance(nearest, linear) {
                nearest += 1;
            }
            nearest
        })
        .collect()
});

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::scalar::Scalars;
    use proptest::prelude::*;

    fn weighted(q: Vec<Cell>) -> Samples {
        let mut q = q;
        q.sort_by_key(|&q| morton::code_96(q));
        let n = q.len();
        Samples {
            q,
            rgb: Some(vec![[10, 200, 255]; n]),
            class: Some((0..n).map(|i| (i % 3) as u8).collect()),
            ..Samples::default()
        }
    }

    const HAS: ColumnSet = ColumnSet {
        rgb: true,
        class: true,
        intensity: false,
        returns: false,
        source: false,
        normal: false,
        gps_time: false,
        scalars: Scalars::NONE,
    };

    proptest! {
        #[test]
        fn weights_are_conserved_cells_come_once_and_a_mean_of_equal_colours_is_that_colour(
            q in prop::collection::vec(prop::array::uniform3(any::<u32>()), 1..300), scale in 0u32..31,
        ) {
            let samples = weighted(q.into_iter().map(|q| q.map(|v| v >> scale)).collect());
            let merged = merge(&samples, HAS, None);
            prop_assert_eq!(merged.samples.points(), samples.len() as u64);
            let cells: Vec<_> = merged.samples.q.iter().map(|&q| morton::code_96(q) >> merged.dropped).collect();
            prop_assert!(cells.windows(2).all(|pair| pair[0] < pair[1]), "in order, each cell once");
            prop_assert!(merged.samples.rgb.unwrap().iter().all(|&c| c == [10, 200, 255]));
        }
    }

    #[test]
    fn a_surface_fills_the_page() {
        // 512 x 512 points of a plane: a grid of M cells over its box would keep 40 x 40.
        let samples = weighted((0..1 << 18).map(|i| [(i % 512) * 8, (i / 512) * 8, 77]).collect());
        let merged = merge(&samples, HAS, None);
        assert!(
            merged.samples.len() > 30_000 && merged.samples.len() <= 65_536,
            "{}",
            merged.samples.len()
        );
        assert!(merged.samples.weight.unwrap().iter().all(|&w| w >= 4));
    }

    #[test]
    fn samples_all_over_32_bits_are_rounded_into_the_planes() {
        let merged = merge(&weighted(vec![[0; 3], [u32::MAX; 3], [1 << 31, 5, 7]]), HAS, None);
        assert_eq!((merged.samples.len(), merged.coarser), (3, 2));
        assert!(merged.samples.q.iter().all(|q| q.iter().all(|v| v % 4 == 2)));
    }

    #[test]
    fn a_million_coincident_points_are_one_sample() {
        let merged = merge(&weighted(vec![[5, 6, 7]; 1_000_000]), HAS, None);
        assert_eq!(
            (merged.samples.len(), merged.samples.points(), merged.samples.q[0]),
            (1, 1_000_000, [5, 6, 7])
        );
    }

    #[test]
    fn positions_of_few_samples_far_apart_fit_their_planes() {
        let ends =
            [0, 1, 15, 1 << 30, (1 << 30) + 1, (1 << 31) - 1, 1 << 31, u32::MAX - 1, u32::MAX];
        for (i, &low) in ends.iter().enumerate() {
            for &high in &ends[i..] {
                let merged = merge(&weighted(vec![[low, 7, low], [high, 7, low]]), HAS, None);
                let at = |q: &Cell| q[0] >> merged.coarser;
                let sides = merged.samples.q.iter().map(|q| at(q) - at(&merged.samples.q[0]));
                assert!(sides.max() < Some(1 << 30), "{low} {high}");
                assert!(high - low < 16 || merged.samples.len() == 2);
            }
        }
    }

    proptest! {
        #[test]
        fn quotients_are_those_of_integers(total in 1u64..1 << 40, quotient in any::<u64>(), rest in any::<u64>(), scale in 0u32..40) {
            let total = (total >> scale).max(1);
            let quotient = quotient % (u64::MAX / total);
            prop_assert_eq!(super::quotient(quotient * total + rest % total, total), quotient);
            prop_assert_eq!(super::quotient(quotient * total + (total - 1), total), quotient);
        }
    }

    /// Three stations that see the same, one with half the light of the second and a quarter of
    /// that of the third; and one that sees what is brighter than another can show.
    #[test]
    fn stations_meet_in_the_light_of_the_one_that_most_samples_are_of() {
        let has = ColumnSet { rgb: true, intensity: true, source: true, ..ColumnSet::default() };
        let balance = Balance { gains: vec![2.0, 1.0, 0.5, 0.25], uneven: 0.0 };
        let gains = Gains::new(Some(&balance), Some(&balance));
        let light = |part: u32| encode(part * 65_535 / 32);
        let merged = |all: &[(u16, u8)], gains| {
            let samples = Samples {
                q: vec![[9; 3]; all.len()],
                rgb: Some(all.iter().map(|(_, v)| [*v, 0, *v]).collect()),
                // Half of the light, in steps of 16 bits.
                intensity: Some(all.iter().map(|(_, v)| DECODE[*v as usize] / 2).collect()),
                source: Some(all.iter().map(|(station, _)| *station).collect()),
                ..Samples::default()
            };
            let Samples { rgb, intensity, source, .. } = merge(&samples, has, gains).samples;
            let (light, intensity) =
                (DECODE[rgb.as_ref().unwrap()[0][0] as usize] as f64, intensity.unwrap()[0]);
            let is_same = (2.0 * intensity as f64 / light - 1.0).abs() < 0.03;
            assert!(is_same || light == 65_535.0, "{light} {intensity}");
            (rgb.unwrap()[0], source.unwrap()[0])
        };
        let same = [(0, light(4)), (1, light(8)), (2, light(16)), (1, light(8))];
        assert_eq!(merged(&same, Some(&gains)), ([light(8), 0, light(8)], 1));
        assert_eq!(merged(&same, None), ([light(9), 0, light(9)], 1));
        let bright = [(3, 255), (3, 255), (0, 200)];
        assert_eq!(merged(&bright, Some(&gains)), ([255, 0, 255], 3));
        // A single sample is not multiplied.
        assert_eq!(merged(&same[..1], Some(&gains)), ([light(4), 0, light(4)], 0));
        fn encode(linear: u32) -> u8 {
            ENCODE[linear as usize]
        }
    }

    #[test]
    fn black_and_white_meet_in_linear_light() {
        let samples = Samples {
            q: vec![[0; 3]; 70_000],
            rgb: Some((0..70_000).map(|i| [(i % 2) as u8 * 255; 3]).collect()),
            ..Samples::default()
        };
        let merged = merge(&samples, ColumnSet { rgb: true, ..ColumnSet::default() }, None);
        assert_eq!(merged.samples.rgb.unwrap(), [[188; 3]]);
    }
}
