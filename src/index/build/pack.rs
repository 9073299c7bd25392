//! Packs a node's points into the words of its planes.
//!
//! Position planes hold 10 + 10 + 10 bits per point, the coarsest first: a node drawn small reads
//! one plane, a larger one the next, and the last plane makes it lossless. Points are in Morton
//! order of the coarse plane; within a coarse cell they are sorted by full position and then by
//! what they show, so that the same points give the same picture in any file order (guide:
//! numerics).

use super::morton_sort::radix_sort;
use super::partition::{Arrangement, PLACE_WORDS, Row, ends, place};
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

/// Returns the tight frame of points; at least one.
pub fn frame<const N: usize>(rows: &[Row<N>]) -> Frame {
    let [low, high] = ends(rows).map(|end| end.map(i64::from));
    let extent = [0, 1, 2].map(|axis| (high[axis] - low[axis]) as u32);
    let bits = (32 - extent.iter().max().expect("three axes").leading_zeros()).max(1);
    assert!(bits <= BITS_PER_PLANE * POSITION_PLANES, "organise splits wider nodes");
    Frame { origin: low, bits, extent, planes: bits.div_ceil(BITS_PER_PLANE) }
}

/// Points whose words are written together, in the cache.
const BLOCK: usize = 1 << 10;

/// Sorts the points, unless shuffled, and writes `frame.planes` pages of positions, then the pages
/// of what they show. Returns the words of the coarsest plane.
pub fn pack<const N: usize>(
    rows: &[Row<N>],
    frame: &Frame,
    arrangement: Arrangement,
    pages: &mut [&mut [u32]],
) -> Vec<u32> {
    let pad = BITS_PER_PLANE * frame.planes - frame.bits;
    let cells = |row: &Row<N>| {
        let q = place(row);
        [0, 1, 2].map(|axis| (q[axis] as u32).wrapping_sub(frame.origin[axis] as u32) << pad)
    };
    let coarse = BITS_PER_PLANE * (frame.planes - 1);
    let code = |row: &Row<N>| morton::code(cells(row).map(|c| c >> coarse)) as u64;
    let mut keys: Vec<u64> =
        rows.iter().zip(0u64..).map(|(row, number)| code(row) << 32 | number).collect();
    let row = |key: u64| &rows[key as u32 as usize];
    if arrangement == Arrangement::Morton {
        radix_sort(&mut keys, &mut Vec::new(), 32);
        for run in keys.chunk_by_mut(|a, b| a >> 32 == b >> 32).filter(|run| run.len() > 1) {
            run.sort_unstable_by(|&a, &b| {
                let shown = |key: u64| &row(key)[PLACE_WORDS..];
                place(row(a)).cmp(&place(row(b))).then_with(|| shown(a).cmp(shown(b)))
            });
        }
    }
    let word = |row: &Row<N>, shift: u32| {
        let [x, y, z] = cells(row).map(|c| c >> shift & MASK);
        x | y << BITS_PER_PLANE | z << (2 * BITS_PER_PLANE)
    };
    let mut words = Vec::with_capacity(rows.len());
    let (planes, shown) = pages.split_at_mut(frame.planes as usize);
    let mut block = [[0; N]; BLOCK];
    for (start, keys) in (0..).step_by(BLOCK).zip(keys.chunks(BLOCK)) {
        let block = &mut block[..keys.len()];
        block.iter_mut().zip(keys).for_each(|(place, &key)| *place = *row(key));
        for (k, plane) in (0..).zip(&mut *planes) {
            let shift = coarse - BITS_PER_PLANE * k;
            plane[start..].iter_mut().zip(&*block).for_each(|(to, row)| *to = word(row, shift));
        }
        for (k, page) in (PLACE_WORDS..).zip(&mut *shown) {
            page[start..].iter_mut().zip(&*block).for_each(|(to, row)| *to = row[k]);
        }
        // Not read back from the pages, since mapped device memory may be slow to read.
        words.extend(block.iter().map(|row| word(row, coarse)));
    }
    words
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
                let rows: Vec<Row<4>> = points.iter().map(|&([x, y, z], shown)| [x as u32, y as u32, z as u32, shown]).collect();
                let frame = frame(&rows);
                let mut pages = vec![vec![0u32; points.len()]; frame.planes as usize + 1];
                let mut to: Vec<&mut [u32]> = pages.iter_mut().map(Vec::as_mut_slice).collect();
                pack(&rows, &frame, Arrangement::Morton, &mut to);
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
