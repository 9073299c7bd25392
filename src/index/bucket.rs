//! Points in any order -> BUCKETS of points that lie together, in bounded memory.
//!
//! In: batches of columns, from any thread. Out: for each cell of a Morton-ordered grid its points as records of fixed width, in blocks. Blocks stay in
//! memory up to a limit; beyond it full blocks go to one nameless temporary file, which the system removes with the process, however that ends.
//! A batch is first sorted by cell, so that a bucket is locked once a batch and not once a point. A bucket that gets more points than a chunk may have
//! becomes a grid of finer buckets there and then, so that hardly any point is moved twice.

use super::morton;
use super::samples::{Cell, Samples};
use crate::cloud::color::to_8_bits;
use crate::cloud::{Columns, Wanted};
use crate::error::{Error, Result};
use crate::whole_file::scratch;
use std::fs::File;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};

/// The first grid has 2^5 cells along each axis, those within a bucket that got too full 2^3: there may be many.
const FIRST_LEVELS: u32 = 5;
const FINER_LEVELS: u32 = 3;

/// A block in memory, or on the disk once memory is full.
const BLOCK_BYTES: usize = 64 << 10;
/// A page: every bucket of a grid may hold as much in memory, 128 MiB together.
const SPILLED_BYTES: usize = 4 << 10;

/// Points of one file, on their way into buckets.
pub struct Batch<'a> {
    /// Where they lie on the tree's lattice.
    pub cells: &'a [Cell],
    pub columns: &'a Columns,
    /// Their colours are rounded from 16 bits already.
    pub wide: bool,
    pub part: u16,
}

/// Where a record keeps what; columns that no file has take no room.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    pub has: Wanted,
    pub bytes: usize,
}

/// Bytes of a record before each column; none where it has none.
struct Offsets {
    rgb: Option<usize>,
    intensity: Option<usize>,
    class: Option<usize>,
    returns: Option<usize>,
    source: Option<usize>,
    normal: Option<usize>,
    gps_time: Option<usize>,
    part: usize,
    end: usize,
}

impl Offsets {
    fn new(has: Wanted) -> Offsets {
        let mut end = 12;
        let mut next = |there: bool, bytes: usize| {
            end += bytes * there as usize;
            there.then_some(end - bytes)
        };
        let rgb = next(has.rgb, 4);
        let (intensity, class, returns) = (next(has.intensity, 2), next(has.class, 1), next(has.returns, 1));
        let (source, normal, gps_time) = (next(has.source, 2), next(has.normal, 3), next(has.gps_time, 8));
        let part = next(true, 2).expect("every record has a part");
        Offsets { rgb, intensity, class, returns, source, normal, gps_time, part, end }
    }
}

impl Layout {
    pub fn new(has: Wanted) -> Layout {
        Layout { has, bytes: Offsets::new(has).end }
    }

    /// Writes a batch, point `i` as record `slots[i]`, a column at a time over as many points as the cache keeps. What a file lacks is what a renderer
    /// would show for it: white, and 0 everywhere else.
    fn write(&self, records: &mut [u8], slots: &[u32], batch: &Batch) {
        const POINTS: usize = 2048;
        let (at, columns) = (Offsets::new(self.has), batch.columns);
        for first in (0..slots.len()).step_by(POINTS) {
            let range = first..slots.len().min(first + POINTS);
            let mut rows = Rows { records, stride: self.bytes, slots: &slots[range.clone()] };
            rows.put(Some(0), batch.cells[range.clone()].iter().map(|&q| -> [u8; 12] { bytemuck::cast(q.map(u32::to_le)) }));
            let wide = batch.wide as u8;
            rows.put_column(at.rgb, &columns.rgb, &range, [255; 3], |[r, g, b]| [r, g, b, wide]);
            rows.put_column(at.intensity, &columns.intensity, &range, 0, u16::to_le_bytes);
            rows.put_column(at.class, &columns.class, &range, 0, |class| [class]);
            rows.put_column(at.returns, &columns.returns, &range, 0, |returns| [returns]);
            rows.put_column(at.source, &columns.source, &range, 0, u16::to_le_bytes);
            rows.put_column(at.normal, &columns.normal, &range, [0; 3], |normal| normal.map(|v| v as u8));
            rows.put_column(at.gps_time, &columns.gps_time, &range, 0.0, f64::to_le_bytes);
            rows.put(Some(at.part), range.map(|_| batch.part.to_le_bytes()));
        }
    }

    #[inline]
    pub fn cell(record: &[u8]) -> Cell {
        bytemuck::pod_read_unaligned::<Cell>(&record[..size_of::<Cell>()]).map(u32::from_le)
    }

    /// One of many records.
    #[inline]
    pub fn record<'a>(&self, records: &'a [u8], number: u32) -> &'a [u8] {
        &records[number as usize * self.bytes..][..self.bytes]
    }

    /// Everything behind the position, for an order by content.
    pub fn rest(record: &[u8]) -> &[u8] {
        &record[12..]
    }

    /// Brings the colours of records to what those of their whole part turned out to be. Which batch a point came in shows no longer then, so that records
    /// of equal points are equal.
    pub fn settle(&self, records: &mut [u8], found: &[Colors]) {
        if !self.has.rgb || found.iter().all(|&colors| colors == Colors::Bytes) {
            return;
        }
        for row in records.chunks_exact_mut(self.bytes) {
            let part = u16::from_le_bytes([row[self.bytes - 2], row[self.bytes - 1]]);
            let (color, wide) = row[12..16].split_at_mut(3);
            match found[part as usize] {
                // As if the file had no such field.
                Colors::Black => color.fill(255),
                Colors::Wide if wide[0] == 0 => color.iter_mut().for_each(|v| *v = to_8_bits(*v as u16)),
                Colors::Wide | Colors::Bytes => {}
            }
            wide[0] = 0;
        }
    }

    /// The points of some settled records, in this order. `station` numbers the station of a part and a source. A column at a time over as many records as
    /// the cache keeps.
    pub fn read(&self, records: &[u8], order: &[u32], keep: Wanted, station: &impl Fn(u16, u16) -> u16) -> Samples {
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
        fn first<const N: usize>(bytes: &[u8]) -> [u8; N] {
            *bytes.first_chunk().expect("a record has all its columns")
        }
        let at = Offsets::new(self.has);
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
        };
        for some in order.chunks(POINTS) {
            let rows = || some.iter().map(|&number| self.record(records, number));
            samples.q.extend(rows().map(Layout::cell));
            extend(&mut samples.rgb, at.rgb, rows(), first);
            extend(&mut samples.intensity, at.intensity, rows(), |row| u16::from_le_bytes(first(row)));
            extend(&mut samples.class, at.class, rows(), |row| row[0]);
            extend(&mut samples.returns, at.returns, rows(), |row| row[0]);
            extend(&mut samples.normal, at.normal, rows(), |row| first(row).map(|v| v as i8));
            extend(&mut samples.gps_time, at.gps_time, rows(), |row| f64::from_le_bytes(first(row)));
            if let (Some(column), Some(source)) = (&mut samples.source, at.source) {
                let u16_at = |row: &[u8], at: usize| u16::from_le_bytes(first(&row[at..]));
                column.extend(rows().map(|row| station(u16_at(row, at.part), u16_at(row, source))));
            }
        }
        samples
    }
}

/// What the colours of a part were found to be, once all were read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colors {
    Bytes,
    /// 16 bits; batches that held only low ones were taken for bytes.
    Wide,
    /// All 0, which is none.
    Black,
}

/// Records that a batch's points are written to.
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
        column: &Option<Vec<T>>,
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

#[derive(Debug)]
enum Block {
    Memory(Vec<u8>),
    Disk { at: u64, bytes: u32 },
}

/// The points of one cell.
#[derive(Debug, Default)]
pub struct Bucket {
    points: u64,
    blocks: Vec<Block>,
    tail: Vec<u8>,
    /// Where its points are once it has been too full.
    finer: Option<Arc<Grid>>,
}

/// Memory and disk that all buckets share.
pub struct Spill {
    /// That it lies beside, for errors.
    path: PathBuf,
    file: File,
    end: AtomicU64,
    used: AtomicU64,
    limit: u64,
}

impl Spill {
    /// A nameless file beside `output`, empty until `limit` bytes of memory are full.
    pub fn new(output: &Path, limit: u64) -> Result<Spill> {
        let (path, file) = (output.to_owned(), scratch(output)?);
        Ok(Spill { path, file, end: AtomicU64::new(0), used: AtomicU64::new(0), limit })
    }

    /// Forgets everything, once no bucket is left.
    pub fn reset(&self) {
        self.used.store(0, Relaxed);
        self.end.store(0, Relaxed);
    }

    pub fn bytes_on_disk(&self) -> u64 {
        self.end.load(Relaxed)
    }

    fn is_full(&self) -> bool {
        self.used.load(Relaxed) >= self.limit
    }

    /// Puts away a full tail.
    fn keep(&self, tail: &mut Vec<u8>) -> Result<Block> {
        if !self.is_full() {
            return Ok(Block::Memory(std::mem::take(tail)));
        }
        let bytes = tail.len();
        let at = self.end.fetch_add(bytes as u64, Relaxed);
        self.file.write_all_at(tail, at).map_err(|error| Error::io("write", &self.path, error))?;
        tail.clear();
        Ok(Block::Disk { at, bytes: bytes as u32 })
    }
}

impl Bucket {
    fn append(&mut self, mut records: &[u8], stride: usize, spill: &Spill) -> Result<()> {
        self.points += (records.len() / stride) as u64;
        while !records.is_empty() {
            let is_full = spill.is_full();
            let room = if is_full { SPILLED_BYTES } else { BLOCK_BYTES } / stride * stride;
            if self.tail.len() >= room {
                let block = spill.keep(&mut self.tail)?;
                self.blocks.push(block);
                continue;
            }
            let (now, later) = records.split_at(records.len().min(room - self.tail.len()));
            let before = self.tail.capacity();
            if is_full {
                // Not twice of it, as a vector grows by itself.
                self.tail.reserve_exact(room - self.tail.len());
            }
            self.tail.extend_from_slice(now);
            spill.used.fetch_add((self.tail.capacity() - before) as u64, Relaxed);
            records = later;
        }
        Ok(())
    }

    /// Hands every block's records to `take`, and forgets them.
    pub fn drain(self, spill: &Spill, take: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let mut read = Vec::new();
        for block in self.blocks {
            match block {
                Block::Memory(bytes) => {
                    take(&bytes)?;
                    spill.used.fetch_sub(bytes.capacity() as u64, Relaxed);
                }
                Block::Disk { at, bytes } => {
                    read.resize(bytes as usize, 0);
                    spill.file.read_exact_at(&mut read, at).map_err(|error| Error::io("read", &spill.path, error))?;
                    take(&read)?;
                }
            }
        }
        take(&self.tail)?;
        spill.used.fetch_sub(self.tail.capacity() as u64, Relaxed);
        Ok(())
    }
}

/// A grid of buckets over the cube of 2^`bits` steps at `corner`; the buckets in Morton order.
#[derive(Debug)]
pub struct Grid {
    corner: Cell,
    bits: u32,
    /// It has 2^levels cells along each axis.
    pub levels: u32,
    /// Points that a bucket may have.
    limit: u64,
    stride: usize,
    buckets: Vec<Mutex<Bucket>>,
}

/// What a thread sorts its batches in.
#[derive(Default)]
pub struct Sorter {
    numbers: Vec<u16>,
    starts: Vec<u32>,
    /// Where each point goes, as a record.
    slots: Vec<u32>,
    /// The bucket of each run of records.
    runs: Vec<(u16, Range<usize>)>,
    records: Vec<u8>,
}

impl Sorter {
    /// A counting sort by bucket, of so many.
    fn sort(&mut self, numbers: impl Iterator<Item = u16>, buckets: usize) {
        let Sorter { numbers: kept, starts, slots, runs, .. } = self;
        kept.clear();
        kept.extend(numbers);
        starts.clear();
        starts.resize(buckets, 0);
        kept.iter().for_each(|&number| starts[number as usize] += 1);
        runs.clear();
        let mut end = 0;
        for (number, start) in starts.iter_mut().enumerate() {
            let count = std::mem::replace(start, end);
            end += count;
            if count > 0 {
                runs.push((number as u16, *start as usize..end as usize));
            }
        }
        slots.clear();
        slots.extend(kept.iter().map(|&number| {
            let slot = &mut starts[number as usize];
            *slot += 1;
            *slot - 1
        }));
    }
}

impl Grid {
    /// Over a whole tree, whose lattice starts at 0.
    pub fn new(bits: u32, stride: usize, limit: u64) -> Grid {
        Grid::over([0; 3], bits, FIRST_LEVELS, stride, limit)
    }

    fn over(corner: Cell, bits: u32, levels: u32, stride: usize, limit: u64) -> Grid {
        let levels = levels.min(bits);
        Grid { corner, bits, levels, limit, stride, buckets: (0..1 << (3 * levels)).map(|_| Mutex::default()).collect() }
    }

    fn number(&self, q: Cell) -> u16 {
        let shift = self.bits - self.levels;
        let along = |axis: usize| (q[axis] - self.corner[axis]) >> shift;
        morton::code([along(0), along(1), along(2)]) as u16
    }

    /// Distributes a batch.
    pub fn add(&self, layout: &Layout, batch: &Batch, sorter: &mut Sorter, spill: &Spill) -> Result<()> {
        sorter.sort(batch.cells.iter().map(|&q| self.number(q)), self.buckets.len());
        sorter.records.resize(batch.cells.len() * self.stride, 0);
        layout.write(&mut sorter.records, &sorter.slots, batch);
        self.append_runs(sorter, spill)
    }

    /// Records that were in a coarser bucket.
    fn add_records(&self, from: &[u8], spill: &Spill) -> Result<()> {
        let mut sorter = Sorter::default();
        sorter.sort(from.chunks_exact(self.stride).map(|record| self.number(Layout::cell(record))), self.buckets.len());
        sorter.records.resize(from.len(), 0);
        for (record, &slot) in from.chunks_exact(self.stride).zip(&sorter.slots) {
            sorter.records[slot as usize * self.stride..][..self.stride].copy_from_slice(record);
        }
        self.append_runs(&sorter, spill)
    }

    fn append_runs(&self, sorter: &Sorter, spill: &Spill) -> Result<()> {
        sorter.runs.iter().try_for_each(|&(number, ref run)| {
            let records = &sorter.records[run.start * self.stride..run.end * self.stride];
            self.append(number, records, spill)
        })
    }

    fn append(&self, number: u16, records: &[u8], spill: &Spill) -> Result<()> {
        let mut bucket = self.buckets[number as usize].lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if let Some(finer) = bucket.finer.clone() {
            drop(bucket);
            return finer.add_records(records, spill);
        }
        bucket.append(records, self.stride, spill)?;
        if bucket.points <= self.limit || self.bits == self.levels {
            return Ok(());
        }
        let shift = self.bits - self.levels;
        let corner = std::array::from_fn(|axis| self.corner[axis] + (morton::axis(number as u32, axis, self.levels) << shift));
        let finer = Arc::new(Grid::over(corner, shift, FINER_LEVELS, self.stride, self.limit));
        let full = std::mem::replace(&mut *bucket, Bucket { finer: Some(finer.clone()), ..Bucket::default() });
        // Others may fill the finer grid while this thread moves what the bucket had.
        drop(bucket);
        full.drain(spill, &mut |records| finer.add_records(records, spill))
    }

    /// Points and contents of every bucket, in Morton order.
    pub fn into_buckets(self) -> Vec<(u64, Contents)> {
        let inner = |bucket: Mutex<Bucket>| bucket.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
        let contents = |mut bucket: Bucket| match bucket.finer.take().and_then(Arc::into_inner) {
            Some(finer) => (finer.points(), Contents::Finer(finer)),
            None => (bucket.points, Contents::Points(bucket)),
        };
        self.buckets.into_iter().map(inner).map(contents).collect()
    }

    fn points(&self) -> u64 {
        let of = |bucket: &Mutex<Bucket>| {
            let bucket = bucket.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            bucket.finer.as_ref().map_or(bucket.points, |finer| finer.points())
        };
        self.buckets.iter().map(of).sum()
    }
}

/// What a cell of a grid turned out to hold.
pub enum Contents {
    Points(Bucket),
    /// More than a chunk may have.
    Finer(Grid),
}
