//! Packs a node's points into the words of its planes.
//!
//! Position planes hold 10 + 10 + 10 bits per point, the coarsest first: a node drawn small reads
//! one plane, a larger one the next, and the last plane makes it lossless. Points are in Morton
//! order of the coarse plane; within a coarse cell they are sorted by full position and then by
//! what they show, so that the same points give the same picture in any file order (guide:
//! numerics).

use super::partition::Arrangement;
use crate::cloud::Columns;
use crate::cloud::attribute::Words;
use crate::config::{BITS_PER_PLANE, POSITION_PLANES};
use crate::index::format::morton;

const MASK: u32 = (1 << BITS_PER_PLANE) - 1;

/// A node's own lattice: a point at cells q of the finest plane lies at `origin + q * 2^(bits - 10
/// * planes)` lattice steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Least coordinates, in lattice steps of the part.
    pub origin: [i64; 3],
    /// Bits of the longest side.
    pub bits: u32,
    /// Extent in lattice steps, inclusive.
    pub extent: [u32; 3],
    /// Number of position planes.
    pub planes: u32,
}

/// Returns the tight frame of the points `order` of `columns`; at least one point.
pub fn frame(columns: &Columns, order: &[u32]) -> Frame {
    let side = |column: &[i32]| {
        let mut values = order.iter().map(|&i| column[i as usize] as i64);
        let first = values.next().expect("a node has points");
        let (lo, hi) = values.fold((first, first), |(lo, hi), v| (lo.min(v), hi.max(v)));
        (lo, (hi - lo) as u32)
    };
    let sides = [side(&columns.x), side(&columns.y), side(&columns.z)];
    let extent = sides.map(|(_, extent)| extent);
    let bits = (32 - extent.iter().max().expect("three axes").leading_zeros()).max(1);
    assert!(bits <= BITS_PER_PLANE * POSITION_PLANES, "organise splits wider nodes");
    Frame { origin: sides.map(|(lo, _)| lo), bits, extent, planes: bits.div_ceil(BITS_PER_PLANE) }
}

/// Sorts the points, unless shuffled, and writes `frame.planes` pages of positions, then the pages
/// of their attribute words. Returns the words of the coarsest plane.
pub fn pack(
    columns: &Columns,
    frame: &Frame,
    order: &[u32],
    arrangement: Arrangement,
    words: impl Fn(usize) -> Words,
    pages: &mut [&mut [u32]],
) -> Vec<u32> {
    let pad = BITS_PER_PLANE * frame.planes - frame.bits;
    let cells = |i: u32| {
        let i = i as usize;
        let q = [columns.x[i], columns.y[i], columns.z[i]];
        [0, 1, 2].map(|axis| ((q[axis] as i64 - frame.origin[axis]) as u32) << pad)
    };
    let coarse = BITS_PER_PLANE * (frame.planes - 1);
    let mut keys: Vec<u64> = order
        .iter()
        .map(|&i| (morton::code(cells(i).map(|c| c >> coarse)) as u64) << 32 | i as u64)
        .collect();
    if arrangement == Arrangement::Morton {
        keys.sort_unstable();
        for run in keys.chunk_by_mut(|a, b| a >> 32 == b >> 32).filter(|run| run.len() > 1) {
            run.sort_by_cached_key(|&key| (cells(key as u32), words(key as u32 as usize)));
        }
    }
    let word = |key: u64, shift: u32| {
        let [x, y, z] = cells(key as u32).map(|c| c >> shift & MASK);
        x | y << BITS_PER_PLANE | z << (2 * BITS_PER_PLANE)
    };
    let (planes, others) = pages.split_at_mut(frame.planes as usize);
    for (k, plane) in planes.iter_mut().enumerate() {
        let shift = coarse - BITS_PER_PLANE * k as u32;
        plane.iter_mut().zip(&keys).for_each(|(place, &key)| *place = word(key, shift));
    }
    for (k, page) in others.iter_mut().enumerate() {
        page.iter_mut().zip(&keys).for_each(|(place, &key)| *place = words(key as u32 as usize)[k]);
    }
    // Not read back from the pages, since mapped device memory may be slow to read.
    keys.iter().map(|&key| word(key, coarse)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// All planes together restore the lattice points, whatever their order.
        #[test]
        fn planes_are_lossless_and_their_order_is_by_content(
            points in prop::collection::vec((prop::array::uniform3(-(1i32 << 28)..1 << 28), any::<u32>()), 1..200),
            scale in 0u32..28, seed in any::<u64>(),
        ) {
            let points: Vec<_> = points.iter().map(|(p, shown)| (p.map(|v| v >> scale), shown % 3)).collect();
            let mut shuffled = points.clone();
            shuffled.sort_by_key(|(p, shown)| (p[0] as u64 ^ seed.rotate_left(*shown)).wrapping_mul(0x9E37_79B9_7F4A_7C15));
            let unpacked: Vec<_> = [points, shuffled].iter().map(|points| {
                let column = |axis: usize| points.iter().map(|(p, _)| p[axis]).collect();
                let columns = Columns { x: column(0), y: column(1), z: column(2), ..Columns::default() };
                let order: Vec<u32> = (0..points.len() as u32).collect();
                let frame = frame(&columns, &order);
                let mut pages = vec![vec![0u32; points.len()]; frame.planes as usize + 1];
                let mut to: Vec<&mut [u32]> = pages.iter_mut().map(Vec::as_mut_slice).collect();
                pack(&columns, &frame, &order, Arrangement::Morton, |i| [points[i].1, 0, 0, 0, 0], &mut to);
                let shown = pages.pop().expect("the page of what points show");
                (0..points.len()).map(|i| {
                    let cells = pages.iter().fold([0u64; 3], |cells, page| {
                        [0, 1, 2].map(|axis| cells[axis] << 10 | (page[i] >> (10 * axis) & 1023) as u64)
                    });
                    let pad = 10 * frame.planes - frame.bits;
                    ([0, 1, 2].map(|axis| frame.origin[axis] + (cells[axis] >> pad) as i64), shown[i])
                }).collect::<Vec<_>>()
            }).collect();
            prop_assert_eq!(&unpacked[0], &unpacked[1]);
        }
    }
}
