//! Points as records of fixed width, for buckets.
//!
//! Records can be moved as a whole, in memory or through a file, and converted back to columns in
//! any order. They have no room for columns that no file has.

use crate::cloud::{ColumnSet, Columns};
use crate::index::format::samples::{Cell, DerivedColumns, Samples};
use std::ops::Range;

/// A batch of points of one file.
pub struct Batch<'a> {
    /// Positions on the tree's lattice.
    pub cells: &'a [Cell],
    pub columns: &'a Columns,
    pub part: u16,
}

/// Layout of a record; columns that no file has take no room.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    pub bytes: usize,
    at: Offsets,
    /// Part of all points, if records name none.
    part: u16,
}

/// Offset of each column in a record; `None` if it has none.
#[derive(Clone, Copy, Debug)]
struct Offsets {
    /// Offset behind the position.
    rest: usize,
    rgb: Option<usize>,
    intensity: Option<usize>,
    class: Option<usize>,
    returns: Option<usize>,
    source: Option<usize>,
    normal: Option<usize>,
    gps_time: Option<usize>,
    part: Option<usize>,
}

/// Bits of three coordinates that fit a u64.
const PACKED_BITS: u32 = 21;
const PACKED_BYTES: usize = size_of::<u64>();

impl Layout {
    /// Creates the layout for points of these parts in a cube of 2^`bits` steps.
    pub fn new(has: ColumnSet, bits: u32, parts: &[u16]) -> Layout {
        let rest = if bits <= PACKED_BITS { PACKED_BYTES } else { size_of::<Cell>() };
        let mut bytes = rest;
        let mut next = |there: bool, width: usize| {
            bytes += width * there as usize;
            there.then_some(bytes - width)
        };
        let rgb = next(has.rgb, 3);
        let (intensity, class, returns) =
            (next(has.intensity, 2), next(has.class, 1), next(has.returns, 1));
        let (source, normal, gps_time) =
            (next(has.source, 2), next(has.normal, 3), next(has.gps_time, 8));
        let part = next(parts.len() > 1, 2);
        let at = Offsets { rest, rgb, intensity, class, returns, source, normal, gps_time, part };
        Layout { bytes, at, part: parts.first().copied().unwrap_or_default() }
    }

    fn is_packed(&self) -> bool {
        self.at.rest == PACKED_BYTES
    }

    /// Writes a batch, point `i` as record `slots[i]`, a column at a time over as many points as
    /// fit the cache. Missing columns get what a renderer would show: white, and 0 for all else.
    pub fn write(&self, records: &mut [u8], slots: &[u32], batch: &Batch) {
        const POINTS: usize = 2048;
        let (at, columns) = (self.at, batch.columns);
        for first in (0..slots.len()).step_by(POINTS) {
            let range = first..slots.len().min(first + POINTS);
            let mut rows = Rows { records, stride: self.bytes, slots: &slots[range.clone()] };
            let cells = batch.cells[range.clone()].iter();
            if self.is_packed() {
                rows.put(
                    Some(0),
                    cells.map(|q| {
                        (0..3)
                            .fold(0, |bits, axis| bits << PACKED_BITS | q[axis] as u64)
                            .to_le_bytes()
                    }),
                );
            } else {
                rows.put(
                    Some(0),
                    cells
                        .map(|&q| -> [u8; size_of::<Cell>()] { bytemuck::cast(q.map(u32::to_le)) }),
                );
            }
            rows.put_column(at.rgb, columns.rgb.as_ref(), &range, [255; 3], |color| color);
            rows.put_column(at.intensity, columns.intensity.as_ref(), &range, 0, u16::to_le_bytes);
            rows.put_column(at.class, columns.class.as_ref(), &range, 0, |class| [class]);
            rows.put_column(at.returns, columns.returns.as_ref(), &range, 0, |returns| [returns]);
            rows.put_column(at.source, columns.source.as_ref(), &range, 0, u16::to_le_bytes);
            rows.put_column(at.normal, columns.normal.as_ref(), &range, [0; 3], |normal| {
                normal.map(|v| v as u8)
            });
            let scalar = columns.scalars.first().map(|own| &own.numbers);
            let number = scalar.or(columns.gps_time.as_ref());
            rows.put_column(at.gps_time, number, &range, 0.0, f64::to_le_bytes);
            rows.put(at.part, range.map(|_| batch.part.to_le_bytes()));
        }
    }

    #[inline]
    pub fn cell(&self, record: &[u8]) -> Cell {
        if self.is_packed() {
            let bits = u64::from_le_bytes(first(record));
            let at =
                |axis: u32| (bits >> (PACKED_BITS * (2 - axis))) as u32 & ((1 << PACKED_BITS) - 1);
            return [at(0), at(1), at(2)];
        }
        let cell: [u8; size_of::<Cell>()] = first(record);
        bytemuck::cast::<_, Cell>(cell).map(u32::from_le)
    }

    /// Returns one of many records.
    #[inline]
    pub fn record<'a>(&self, records: &'a [u8], number: u32) -> &'a [u8] {
        &records[number as usize * self.bytes..][..self.bytes]
    }

    /// Returns everything behind the position, for an order by content.
    pub fn rest<'a>(&self, record: &'a [u8]) -> &'a [u8] {
        &record[self.at.rest..]
    }

    #[inline]
    pub fn part(&self, record: &[u8]) -> u16 {
        self.at.part.map_or(self.part, |at| u16::from_le_bytes(first(&record[at..])))
    }

    /// Returns the source as the file names it, or 0.
    pub fn source(&self, record: &[u8]) -> u16 {
        self.at.source.map_or(0, |at| u16::from_le_bytes(first(&record[at..])))
    }

    /// Returns the intensity, or 0.
    pub fn intensity(&self, record: &[u8]) -> u16 {
        self.at.intensity.map_or(0, |at| u16::from_le_bytes(first(&record[at..])))
    }

    /// Returns a colour as after [`Layout::settle`].
    pub fn color(&self, record: &[u8], found: &[Colors]) -> [u8; 3] {
        let color = self.at.rgb.map_or([255; 3], |at| first(&record[at..]));
        found[self.part(record) as usize].settled(color)
    }

    /// Corrects colours once those of their whole part are known.
    pub fn settle(&self, records: &mut [u8], found: &[Colors]) {
        let Some(at) = self.at.rgb.filter(|_| found.iter().any(|&colors| colors != Colors::Bytes))
        else {
            return;
        };
        for row in records.chunks_exact_mut(self.bytes) {
            let color = found[self.part(row) as usize].settled(first(&row[at..]));
            row[at..at + 3].copy_from_slice(&color);
        }
    }

    /// Returns the points of settled records, in this order, a column at a time over as many
    /// records as fit the cache. `station` numbers the station of a part and a source.
    pub fn read(
        &self,
        records: &[u8],
        order: &[u32],
        keep: ColumnSet,
        station: &impl Fn(u16, u16) -> u16,
    ) -> Samples {
        const POINTS: usize = 1024;
        fn column<T>(there: bool, points: usize) -> Option<Vec<T>> {
            there.then(|| Vec::with_capacity(points))
        }
        fn extend<'a, T>(
            column: &mut Option<Vec<T>>,
            at: Option<usize>,
            rows: impl Iterator<Item = &'a [u8]>,
            value: impl Fn(&'a [u8]) -> T,
        ) {
            if let (Some(column), Some(at)) = (column, at) {
                column.extend(rows.map(|row| value(&row[at..])));
            }
        }
        let at = self.at;
        let points = order.len();
        let mut samples = Samples {
            q: Vec::with_capacity(points),
            rgb: column(keep.rgb, points),
            intensity: column(keep.intensity, points),
            class: column(keep.class, points),
            returns: column(keep.returns, points),
            source: column(keep.source, points),
            normal: column(keep.normal, points),
            gps_time: column(keep.gps_time, points),
            weight: None,
            derived: DerivedColumns::default(),
        };
        for some in order.chunks(POINTS) {
            let rows = || some.iter().map(|&number| self.record(records, number));
            samples.q.extend(rows().map(|row| self.cell(row)));
            extend(&mut samples.rgb, at.rgb, rows(), first);
            extend(&mut samples.intensity, at.intensity, rows(), |row| {
                u16::from_le_bytes(first(row))
            });
            extend(&mut samples.class, at.class, rows(), |row| row[0]);
            extend(&mut samples.returns, at.returns, rows(), |row| row[0]);
            extend(&mut samples.normal, at.normal, rows(), |row| first(row).map(|v| v as i8));
            extend(&mut samples.gps_time, at.gps_time, rows(), |row| {
                f64::from_le_bytes(first(row))
            });
            if let (Some(column), Some(source)) = (&mut samples.source, at.source) {
                column.extend(
                    rows().map(|row| {
                        station(self.part(row), u16::from_le_bytes(first(&row[source..])))
                    }),
                );
            }
        }
        samples
    }
}

/// Kind of a part's colours, known once all were read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colors {
    Bytes,
    /// All 0, which counts as no colours.
    Black,
}

impl Colors {
    /// Returns the colour to store.
    fn settled(self, color: [u8; 3]) -> [u8; 3] {
        match self {
            // White stands for no colours.
            Colors::Black => [255; 3],
            Colors::Bytes => color,
        }
    }
}

/// Records to which a batch is written.
struct Rows<'a> {
    records: &'a mut [u8],
    stride: usize,
    slots: &'a [u32],
}

impl Rows<'_> {
    fn put<const N: usize>(&mut self, at: Option<usize>, values: impl Iterator<Item = [u8; N]>) {
        let Some(at) = at else { return };
        for (&slot, value) in self.slots.iter().zip(values) {
            let start = slot as usize * self.stride + at;
            self.records[start..start + N].copy_from_slice(&value);
        }
    }

    fn put_column<T: Copy, const N: usize>(
        &mut self,
        at: Option<usize>,
        column: Option<&Vec<T>>,
        range: &Range<usize>,
        lacking: T,
        bytes: impl Fn(T) -> [u8; N],
    ) {
        match column {
            Some(column) => self.put(at, column[range.clone()].iter().map(|&value| bytes(value))),
            None => self.put(at, range.clone().map(|_| bytes(lacking))),
        }
    }
}

fn first<const N: usize>(bytes: &[u8]) -> [u8; N] {
    *bytes.first_chunk().expect("a record has all its columns")
}
