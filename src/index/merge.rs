//! Children's samples in, their parent's out: Pintus, section 7 (papers/README.md), with a grid that fits the data.
//!
//! ```text
//! merge(samples in Morton order):
//!   count, for every pair of neighbours in the order, the highest bit in which their codes differ
//!   drop as few low bits of the codes as leave at most M different ones: those are the grid's cells
//!   one sample a cell: mean position, mean colour in linear light, mean intensity, kinds by majority; weight = the sum of the weights
//! ```
//! A grid of M cells over the box would hold few samples of a surface (M^(2/3)); this one is as fine as M samples allow, whatever the shape of the
//! data. All sums are integers, so the result does not depend on any order of execution.

use super::morton;
use super::samples::{Cell, Samples};
use crate::cloud::Wanted;
use crate::config::POINTS_PER_PAGE;
use std::sync::LazyLock;

/// Positions of merged samples are kept to the cell's shortest side over 2^this: below half of what merging itself moved them.
const BITS_WITHIN_CELL: u32 = 2;

/// Merged samples, the low bits of codes that their cells drop, and how many steps, as a power of two, positions may be rounded to.
pub struct Merged {
    pub samples: Samples,
    pub dropped: u32,
    pub coarser: u32,
}

/// `parts` follow each other in Morton order; they have the same columns, but for weights.
pub fn merge(parts: &[Samples], has: Wanted) -> Merged {
    let codes: Vec<u128> = parts.iter().flat_map(|part| part.q.iter().map(|&q| morton::code_96(q))).collect();
    // How many neighbours differ in bit `k` and in none above.
    let mut differ = [0usize; 97];
    codes.windows(2).for_each(|pair| differ[128 - (pair[0] ^ pair[1]).leading_zeros() as usize] += 1);
    // With the lowest `dropped` bits gone, a new cell begins where neighbours differ in a higher one.
    let mut cells = 1 + differ[1..].iter().sum::<usize>();
    let mut dropped = 0u32;
    while cells > POINTS_PER_PAGE as usize {
        dropped += 1;
        cells -= differ[dropped as usize];
    }
    let coarser = (dropped / 3).saturating_sub(BITS_WITHIN_CELL);
    let mut samples = Samples::with_capacity(cells, has, true);
    let total: usize = parts.iter().map(Samples::len).sum();
    let mut at = Cursor { parts, part: 0, i: 0 };
    let mut start = 0;
    let mut members = Vec::new();
    while start < total {
        let end = start + codes[start..].iter().take_while(|&&code| code >> dropped == codes[start] >> dropped).count();
        members.clear();
        members.extend((start..end).map(|_| at.next()));
        one(&members, dropped, coarser, &mut samples);
        start = end;
    }
    Merged { samples, dropped, coarser }
}

struct Cursor<'a> {
    parts: &'a [Samples],
    part: usize,
    i: usize,
}

impl<'a> Cursor<'a> {
    fn next(&mut self) -> (&'a Samples, usize) {
        while self.i == self.parts[self.part].len() {
            (self.part, self.i) = (self.part + 1, 0);
        }
        self.i += 1;
        (&self.parts[self.part], self.i - 1)
    }
}

/// Appends the sample that stands for the members of one cell.
fn one(members: &[(&Samples, usize)], dropped: u32, coarser: u32, out: &mut Samples) {
    let weight = |&(samples, i): &(&Samples, usize)| samples.weight(i) as u64;
    let total: u64 = members.iter().map(weight).sum();
    let bits = morton::axis_bits(dropped);
    let (first, k) = members[0];
    let corner: Cell = [0, 1, 2].map(|axis| (first.q[k][axis] as u64 >> bits[axis] << bits[axis]) as u32);
    let mean = |value: &dyn Fn(&Samples, usize) -> u64| {
        let sum: u128 = members.iter().map(|m| weight(m) as u128 * value(m.0, m.1) as u128).sum();
        ((sum + total as u128 / 2) / total as u128) as u64
    };
    // Rounded to the middle of 2^coarser steps, which lie within the cell: the order of the samples stays that of their cells.
    let middle = (1u32 << coarser) >> 1;
    out.q.push([0, 1, 2].map(|axis| {
        let within = mean(&|samples, i| (samples.q[i][axis] - corner[axis]) as u64) as u32;
        ((corner[axis] + within.min(((1u64 << bits[axis]) - 1) as u32)) >> coarser << coarser) + middle
    }));
    if let Some(rgb) = &mut out.rgb {
        let channel = |c: usize| encode(mean(&|samples, i| DECODE[samples.rgb.as_ref().expect("same columns")[i][c] as usize] as u64));
        rgb.push([channel(0), channel(1), channel(2)]);
    }
    if let Some(intensity) = &mut out.intensity {
        intensity.push(mean(&|samples, i| samples.intensity.as_ref().expect("same columns")[i] as u64) as u16);
    }
    if let Some(class) = &mut out.class {
        class.push(majority(members, |samples, i| samples.class.as_ref().expect("same columns")[i]));
    }
    if let Some(returns) = &mut out.returns {
        returns.push(majority(members, |samples, i| samples.returns.as_ref().expect("same columns")[i]));
    }
    if let Some(source) = &mut out.source {
        source.push(majority(members, |samples, i| samples.source.as_ref().expect("same columns")[i]));
    }
    if let Some(normal) = &mut out.normal {
        let mut sum = [0i64; 3];
        for m in members {
            let n = m.0.normal.as_ref().expect("same columns")[m.1];
            (0..3).for_each(|axis| sum[axis] += weight(m) as i64 * n[axis] as i64);
        }
        let length = sum.map(|v| v as f64 * v as f64).iter().sum::<f64>().sqrt();
        normal.push(if length > 0.0 { sum.map(|v| (v as f64 / length * 127.0).round() as i8) } else { [0; 3] });
    }
    if let Some(times) = &mut out.gps_time {
        // Times of different passes have no meaningful mean: that of the heaviest sample, of equally heavy ones the earliest.
        let of = |m: &(&Samples, usize)| m.0.gps_time.as_ref().expect("same columns")[m.1];
        let heaviest = members.iter().max_by(|a, b| weight(a).cmp(&weight(b)).then(of(b).total_cmp(&of(a)))).expect("a cell has members");
        times.push(of(heaviest));
    }
    out.weight.as_mut().expect("merged samples have weights").push(total.min(u32::MAX as u64) as u32);
}

/// The value with the greatest weight; of equally heavy ones the least.
fn majority<T: Copy + Ord>(members: &[(&Samples, usize)], value: impl Fn(&Samples, usize) -> T) -> T {
    let first = value(members[0].0, members[0].1);
    if members.iter().all(|m| value(m.0, m.1) == first) {
        return first;
    }
    let mut all: Vec<(T, u64)> = members.iter().map(|m| (value(m.0, m.1), m.0.weight(m.1) as u64)).collect();
    all.sort_unstable();
    let mut best = (first, 0);
    for run in all.chunk_by(|a, b| a.0 == b.0) {
        let weight = run.iter().map(|(_, weight)| weight).sum();
        if weight > best.1 {
            best = (run[0].0, weight);
        }
    }
    best.0
}

/// sRGB to linear light of 16 bits: finer than the steps of 8-bit sRGB everywhere.
static DECODE: LazyLock<[u16; 256]> = LazyLock::new(|| {
    std::array::from_fn(|v| {
        let encoded = v as f64 / 255.0;
        let linear = if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) };
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

fn encode(linear: u64) -> u8 {
    ENCODE[linear as usize]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn weighted(q: Vec<Cell>) -> Samples {
        let mut q = q;
        q.sort_by_key(|&q| morton::code_96(q));
        let n = q.len();
        Samples { q, rgb: Some(vec![[10, 200, 255]; n]), class: Some((0..n).map(|i| (i % 3) as u8).collect()), ..Samples::default() }
    }

    const HAS: Wanted =
        Wanted { rgb: true, class: true, intensity: false, returns: false, source: false, normal: false, gps_time: false };

    proptest! {
        #[test]
        fn weights_are_conserved_cells_come_once_and_a_mean_of_equal_colours_is_that_colour(
            q in prop::collection::vec(prop::array::uniform3(any::<u32>()), 1..300), scale in 0u32..31,
        ) {
            let samples = weighted(q.into_iter().map(|q| q.map(|v| v >> scale)).collect());
            let merged = merge(std::slice::from_ref(&samples), HAS);
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
        let merged = merge(&[samples], HAS);
        assert!(merged.samples.len() > 30_000 && merged.samples.len() <= 65_536, "{}", merged.samples.len());
        assert!(merged.samples.weight.unwrap().iter().all(|&w| w >= 4));
    }

    #[test]
    fn a_million_coincident_points_are_one_sample() {
        let merged = merge(&[weighted(vec![[5, 6, 7]; 1_000_000])], HAS);
        assert_eq!((merged.samples.len(), merged.samples.points(), merged.samples.q[0]), (1, 1_000_000, [5, 6, 7]));
    }

    #[test]
    fn black_and_white_meet_in_linear_light() {
        let samples = Samples { q: vec![[0; 3]; 70_000], rgb: Some((0..70_000).map(|i| [(i % 2) as u8 * 255; 3]).collect()), ..Samples::default() };
        let merged = merge(&[samples], Wanted { rgb: true, ..Wanted::default() });
        assert_eq!(merged.samples.rgb.unwrap(), [[188; 3]]);
    }
}
