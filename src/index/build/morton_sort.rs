//! Sorts a bucket's records in Morton order, and those at one place by content.
//!
//! ```text
//! key = the 11 highest bits of each axis in which positions differ, interleaved (in a bucket of a
//!   surface hardly two points share one)
//! radix sort of key and record number, together one u64, 11 bits at a time
//! runs of equal keys: by full code, then by content
//! ```
//!
//! So the order depends on the points alone, not on their arrival. Buckets are sorted one at a
//! time, because most fit the cache, where a chunk of many buckets does not.

use super::point_record::Layout;
use crate::error::{Error, Result};
use crate::index::format::morton;
use crate::index::format::samples::Cell;
use std::cmp::Ordering;

/// Key bits per axis; three axes and 31 bits of record number make a u64.
const AXIS_BITS: u32 = 11;
const NUMBER_BITS: u32 = 64 - 3 * AXIS_BITS;
const DIGIT_BITS: u32 = 11;
/// Counting 2^11 digits takes longer than comparing this few.
const MIN_RADIX: usize = 256;

/// Memory that a thread reuses for every bucket.
#[derive(Default)]
pub struct RadixSorter {
    items: Vec<u64>,
    other: Vec<u64>,
}

impl RadixSorter {
    /// Appends the order of `records`, the first of which has the number `first`.
    pub fn sort(
        &mut self,
        layout: &Layout,
        records: &[u8],
        first: u32,
        order: &mut Vec<u32>,
    ) -> Result<()> {
        let rows = || records.chunks_exact(layout.bytes);
        let Some(one) = rows().next().map(|row| layout.cell(row)) else { return Ok(()) };
        if rows().len() > 1 << NUMBER_BITS {
            return Err(Error::Request(format!(
                "{} points at one place are more than the 2^31 that can be sorted",
                rows().len()
            )));
        }
        let mut differ: Cell = [0; 3];
        rows()
            .map(|row| layout.cell(row))
            .for_each(|q| (0..3).for_each(|axis| differ[axis] |= q[axis] ^ one[axis]));
        let bits = 32 - (differ[0] | differ[1] | differ[2]).leading_zeros();
        let dropped = bits.saturating_sub(AXIS_BITS);
        let key = |q: Cell| morton::code_63(q.map(|v| v >> dropped & ((1 << AXIS_BITS) - 1)));
        self.items.clear();
        self.items.extend(
            rows()
                .map(|row| layout.cell(row))
                .zip(0..)
                .map(|(q, number)| key(q) << NUMBER_BITS | number),
        );
        radix_sort(&mut self.items, &mut self.other, NUMBER_BITS);
        let number = |item: u64| (item & ((1 << NUMBER_BITS) - 1)) as u32;
        let record = |item: u64| layout.record(records, number(item));
        for run in self
            .items
            .chunk_by_mut(|a, b| a >> NUMBER_BITS == b >> NUMBER_BITS)
            .filter(|run| run.len() > 1)
        {
            run.sort_unstable_by(|&a, &b| compare(layout, record(a), record(b)));
        }
        order.extend(self.items.iter().map(|&item| first + number(item)));
        Ok(())
    }
}

/// Compares by code, then by content.
fn compare(layout: &Layout, a: &[u8], b: &[u8]) -> Ordering {
    morton::order(layout.cell(a), layout.cell(b)).then_with(|| layout.rest(a).cmp(layout.rest(b)))
}

/// Sorts by the bits from `from` on, least significant digit first.
pub fn radix_sort(items: &mut Vec<u64>, other: &mut Vec<u64>, from: u32) {
    if items.len() < MIN_RADIX {
        return items.sort_unstable();
    }
    other.resize(items.len(), 0);
    for shift in (from..u64::BITS).step_by(DIGIT_BITS as usize) {
        let digit = |item: u64| (item >> shift) as usize & ((1 << DIGIT_BITS) - 1);
        let mut next = [0u32; 1 << DIGIT_BITS];
        items.iter().for_each(|&item| next[digit(item)] += 1);
        if next[digit(items[0])] as usize == items.len() {
            continue;
        }
        let mut sum = 0;
        next.iter_mut().for_each(|count| sum += std::mem::replace(count, sum));
        for &item in items.iter() {
            let slot = &mut next[digit(item)];
            other[*slot as usize] = item;
            *slot += 1;
        }
        std::mem::swap(items, other);
    }
}

#[cfg(test)]
mod tests {
    use super::super::point_record::Batch;
    use super::*;
    use crate::cloud::{ColumnSet, Columns};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn records_are_sorted_by_code_and_content_whatever_their_order(
            points in prop::collection::vec((prop::array::uniform3(any::<u32>()), 0u8..3), 0..600), scale in 0u32..32, seed in any::<u64>(),
        ) {
            let has = ColumnSet { class: true, ..ColumnSet::default() };
            let layout = Layout::new(has, 32 - scale, &[0]);
            let sorted = |points: &[(Cell, u8)]| {
                let (cells, class): (Vec<Cell>, Vec<u8>) = points.iter().copied().unzip();
                let columns = Columns { class: Some(class), ..Columns::default() };
                let mut records = vec![0; points.len() * layout.bytes];
                let slots: Vec<u32> = (0..points.len() as u32).collect();
                layout.write(&mut records, &slots, &Batch { cells: &cells, columns: &columns, part: 0 });
                let mut order = Vec::new();
                RadixSorter::default().sort(&layout, &records, 0, &mut order).unwrap();
                let samples = layout.read(&records, &order, has, &|_, _| 0);
                samples.q.into_iter().zip(samples.class.unwrap()).collect::<Vec<_>>()
            };
            let mut points: Vec<_> = points.into_iter().map(|(q, class)| (q.map(|v| v >> scale), class)).collect();
            let found = sorted(&points);
            points.sort_by_key(|(q, class)| (q[0] as u64 ^ seed.rotate_left(*class as u32)).wrapping_mul(0x9E37_79B9_7F4A_7C15));
            prop_assert_eq!(&found, &sorted(&points));
            points.sort_by_key(|&(q, class)| (morton::code_96(q), class));
            prop_assert_eq!(found, points);
        }
    }
}
