//! Buckets of neighbouring points, from points in any order, in bounded memory.
//!
//! Batches of columns come from any thread. Each cell of a Morton-ordered grid collects its points
//! as `point_record`s, in blocks. Blocks stay in memory up to a limit; beyond it full blocks go to
//! one unnamed temporary file, which the system removes with the process. A batch is first sorted
//! by cell, so that a bucket is locked once per batch. A bucket with more points than a chunk may
//! have turns into a grid of finer buckets at once, so that hardly any point is moved twice. A
//! bucket of more points in one place is cut into pieces by an external merge sort.

use super::point_record::{Batch, Colors, Layout};
use crate::atomic_file::temporary_file;
use crate::error::{Error, Result};
use crate::index::format::morton;
use crate::index::format::samples::Cell;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::fs::File;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};

/// The first grid has 2^5 cells per axis, those within a full bucket 2^3: there may be many.
const FIRST_LEVELS: u32 = 5;
const FINER_LEVELS: u32 = 3;

/// Block size in memory, or on the disk once memory is full.
const BLOCK_BYTES: usize = 64 << 10;
/// Block size once memory is full, a page: every bucket of a grid may hold one, 128 MiB together.
const SPILLED_BYTES: usize = 4 << 10;

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
    /// The finer grid that has its points once it has been full.
    finer: Option<Arc<Grid>>,
}

/// Memory and disk of all buckets.
pub struct Spill {
    /// Path of the output, for errors.
    path: PathBuf,
    file: File,
    end: AtomicU64,
    used: AtomicU64,
    limit: u64,
}

impl Spill {
    /// Creates an unnamed file beside `output`, empty until `limit` bytes of memory are full.
    pub fn new(output: &Path, limit: u64) -> Result<Spill> {
        let (path, file) = (output.to_owned(), temporary_file(output)?);
        Ok(Spill { path, file, end: AtomicU64::new(0), used: AtomicU64::new(0), limit })
    }

    /// Returns the used bytes of disk and memory.
    pub fn taken(&self) -> [u64; 2] {
        [&self.end, &self.used].map(|taken| taken.load(Relaxed))
    }

    /// Resets the used bytes, once no bucket is left that used more.
    pub fn forget(&self, [end, used]: [u64; 2]) {
        self.end.store(end, Relaxed);
        self.used.store(used, Relaxed);
    }

    pub fn bytes_on_disk(&self) -> u64 {
        self.end.load(Relaxed)
    }

    fn is_full(&self) -> bool {
        self.used.load(Relaxed) >= self.limit
    }

    /// Stores a full tail.
    fn keep(&self, tail: &mut Vec<u8>) -> Result<Block> {
        if !self.is_full() {
            return Ok(Block::Memory(std::mem::take(tail)));
        }
        let block = self.write(tail)?;
        tail.clear();
        Ok(block)
    }

    fn write(&self, records: &[u8]) -> Result<Block> {
        let at = self.end.fetch_add(records.len() as u64, Relaxed);
        self.file
            .write_all_at(records, at)
            .map_err(|error| Error::io("write", &self.path, error))?;
        Ok(Block::Disk { at, bytes: records.len() as u32 })
    }

    fn read(&self, at: u64, into: &mut [u8]) -> Result<()> {
        self.file.read_exact_at(into, at).map_err(|error| Error::io("read", &self.path, error))
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
                // Exactly, where a vector would double.
                self.tail.reserve_exact(room - self.tail.len());
            }
            self.tail.extend_from_slice(now);
            spill.used.fetch_add((self.tail.capacity() - before) as u64, Relaxed);
            records = later;
        }
        Ok(())
    }

    /// Ends adding points. If memory is full, moves the tail to the disk, so that waiting grids use
    /// no memory.
    pub fn close(&mut self, spill: &Spill) -> Result<()> {
        if spill.is_full() && !self.tail.is_empty() {
            let tail = std::mem::take(&mut self.tail);
            self.blocks.push(spill.write(&tail)?);
            spill.used.fetch_sub(tail.capacity() as u64, Relaxed);
        }
        Ok(())
    }

    /// Cuts points of one place into buckets of `piece` points, in the order of their contents.
    /// `colors` are those of every part.
    pub fn pieces(
        self,
        layout: &Layout,
        colors: &[Colors],
        piece: usize,
        spill: &Spill,
    ) -> Result<Vec<Bucket>> {
        let mut runs = Vec::new();
        let mut records: Vec<u8> = Vec::new();
        let mut sort = |records: &mut Vec<u8>| -> Result<()> {
            layout.settle(records, colors);
            let mut rows: Vec<&[u8]> = records.chunks_exact(layout.bytes).collect();
            rows.sort_unstable_by_key(|row| layout.rest(row));
            let mut run = Bucket::default();
            rows.iter().try_for_each(|row| run.append(row, layout.bytes, spill))?;
            run.close(spill)?;
            records.clear();
            runs.push(run);
            Ok(())
        };
        self.drain(spill, &mut |own| {
            records.extend_from_slice(own);
            if records.len() >= piece * layout.bytes { sort(&mut records) } else { Ok(()) }
        })?;
        sort(&mut records)?;
        drop(records);
        let mut runs: Vec<Run> =
            runs.into_iter().map(|run| Run::of(run, spill)).collect::<Result<_>>()?;
        let first = |run: &Run| run.row(layout.bytes).map(|row| layout.rest(row).to_vec());
        let mut next: BinaryHeap<Reverse<(Vec<u8>, usize)>> = runs
            .iter()
            .enumerate()
            .filter_map(|(k, run)| Some(Reverse((first(run)?, k))))
            .collect();
        let mut pieces: Vec<Bucket> = Vec::new();
        while let Some(Reverse((_, k))) = next.pop() {
            if pieces.last().is_none_or(|last| last.points == piece as u64) {
                pieces.iter_mut().last().map_or(Ok(()), |last| last.close(spill))?;
                pieces.push(Bucket::default());
            }
            let run = &mut runs[k];
            let (row, last) = (run.row(layout.bytes), pieces.last_mut());
            let (Some(row), Some(last)) = (row, last) else { continue };
            last.append(row, layout.bytes, spill)?;
            run.advance(layout.bytes, spill)?;
            next.extend(first(run).map(|row| Reverse((row, k))));
        }
        pieces.iter_mut().last().map_or(Ok(()), |last| last.close(spill))?;
        Ok(pieces)
    }

    /// Passes every block's records to `look`.
    pub fn look(&self, spill: &Spill, look: &mut dyn FnMut(&[u8])) -> Result<()> {
        let mut read = Vec::new();
        for block in &self.blocks {
            match block {
                Block::Memory(bytes) => look(bytes),
                &Block::Disk { at, bytes } => {
                    read.resize(bytes as usize, 0);
                    spill.read(at, &mut read)?;
                    look(&read);
                }
            }
        }
        look(&self.tail);
        Ok(())
    }

    /// Passes every block's records to `take`, and frees them.
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
                    spill.read(at, &mut read)?;
                    take(&read)?;
                }
            }
        }
        take(&self.tail)?;
        spill.used.fetch_sub(self.tail.capacity() as u64, Relaxed);
        Ok(())
    }
}

/// A sorted bucket that is read from its beginning, a block at a time.
struct Run {
    blocks: std::vec::IntoIter<Block>,
    tail: Vec<u8>,
    /// The block that is read, and the offset of its next record.
    block: Vec<u8>,
    at: usize,
}

impl Run {
    fn of(bucket: Bucket, spill: &Spill) -> Result<Run> {
        let (block, blocks) = (Vec::new(), bucket.blocks.into_iter());
        let mut run = Run { blocks, tail: bucket.tail, block, at: 0 };
        run.load(spill)?;
        Ok(run)
    }

    /// Returns the next record; `None` after the last one.
    fn row(&self, stride: usize) -> Option<&[u8]> {
        self.block.get(self.at..self.at + stride)
    }

    fn advance(&mut self, stride: usize, spill: &Spill) -> Result<()> {
        self.at += stride;
        if self.at < self.block.len() { Ok(()) } else { self.load(spill) }
    }

    /// Replaces the block by the next one.
    fn load(&mut self, spill: &Spill) -> Result<()> {
        self.at = 0;
        match self.blocks.next() {
            Some(Block::Memory(bytes)) => {
                spill.used.fetch_sub(bytes.capacity() as u64, Relaxed);
                self.block = bytes;
            }
            Some(Block::Disk { at, bytes }) => {
                self.block.resize(bytes as usize, 0);
                spill.read(at, &mut self.block)?;
            }
            None => {
                spill.used.fetch_sub(self.tail.capacity() as u64, Relaxed);
                self.block = std::mem::take(&mut self.tail);
            }
        }
        Ok(())
    }
}

/// A grid of buckets over the cube of 2^`bits` steps at `corner`, in Morton order.
#[derive(Debug)]
pub struct Grid {
    corner: Cell,
    bits: u32,
    /// It has 2^levels cells per axis.
    pub levels: u32,
    /// Most points of a bucket.
    limit: u64,
    layout: Layout,
    buckets: Vec<Mutex<Bucket>>,
}

/// Memory in which a thread sorts its batches.
#[derive(Default)]
pub struct Sorter {
    numbers: Vec<u16>,
    starts: Vec<u32>,
    /// Record number of each point.
    slots: Vec<u32>,
    /// Bucket of each run of records.
    runs: Vec<(u16, Range<usize>)>,
    records: Vec<u8>,
}

impl Sorter {
    /// Sorts by bucket (counting sort).
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
    /// Creates the grid of a whole tree, whose lattice starts at 0.
    pub fn new(bits: u32, layout: Layout, limit: u64) -> Grid {
        Grid::over([0; 3], bits, FIRST_LEVELS, layout, limit)
    }

    fn over(corner: Cell, bits: u32, levels: u32, layout: Layout, limit: u64) -> Grid {
        let levels = levels.min(bits);
        Grid {
            corner,
            bits,
            levels,
            limit,
            layout,
            buckets: (0..1 << (3 * levels)).map(|_| Mutex::default()).collect(),
        }
    }

    fn number(&self, q: Cell) -> u16 {
        let shift = self.bits - self.levels;
        let along = |axis: usize| (q[axis] - self.corner[axis]) >> shift;
        morton::code([along(0), along(1), along(2)]) as u16
    }

    /// Distributes a batch.
    pub fn add(&self, batch: &Batch, sorter: &mut Sorter, spill: &Spill) -> Result<()> {
        sorter.sort(batch.cells.iter().map(|&q| self.number(q)), self.buckets.len());
        sorter.records.resize(batch.cells.len() * self.layout.bytes, 0);
        self.layout.write(&mut sorter.records, &sorter.slots, batch);
        self.append_runs(sorter, spill)
    }

    /// Distributes records of a coarser bucket.
    fn add_records(&self, from: &[u8], spill: &Spill) -> Result<()> {
        let mut sorter = Sorter::default();
        sorter.sort(
            from.chunks_exact(self.layout.bytes)
                .map(|record| self.number(self.layout.cell(record))),
            self.buckets.len(),
        );
        sorter.records.resize(from.len(), 0);
        for (record, &slot) in from.chunks_exact(self.layout.bytes).zip(&sorter.slots) {
            sorter.records[slot as usize * self.layout.bytes..][..self.layout.bytes]
                .copy_from_slice(record);
        }
        self.append_runs(&sorter, spill)
    }

    fn append_runs(&self, sorter: &Sorter, spill: &Spill) -> Result<()> {
        sorter.runs.iter().try_for_each(|&(number, ref run)| {
            let records =
                &sorter.records[run.start * self.layout.bytes..run.end * self.layout.bytes];
            self.append(number, records, spill)
        })
    }

    fn append(&self, number: u16, records: &[u8], spill: &Spill) -> Result<()> {
        let mut bucket =
            self.buckets[number as usize].lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if let Some(finer) = bucket.finer.clone() {
            drop(bucket);
            return finer.add_records(records, spill);
        }
        bucket.append(records, self.layout.bytes, spill)?;
        if bucket.points <= self.limit || self.is_finest() {
            return Ok(());
        }
        let shift = self.bits - self.levels;
        let corner = std::array::from_fn(|axis| {
            self.corner[axis] + (morton::axis(number as u32, axis, self.levels) << shift)
        });
        let finer = Arc::new(Grid::over(corner, shift, FINER_LEVELS, self.layout, self.limit));
        let full = std::mem::replace(
            &mut *bucket,
            Bucket { finer: Some(finer.clone()), ..Bucket::default() },
        );
        // Other threads may fill the finer grid while this one moves the bucket's records.
        drop(bucket);
        full.drain(spill, &mut |records| finer.add_records(records, spill))
    }

    /// Returns whether its buckets hold one place each.
    pub fn is_finest(&self) -> bool {
        self.bits == self.levels
    }

    /// Returns points and contents of every bucket, in Morton order.
    pub fn into_buckets(self) -> Vec<(u64, Contents)> {
        let inner = |bucket: Mutex<Bucket>| {
            bucket.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner())
        };
        let contents = |mut bucket: Bucket| match bucket.finer.take().and_then(Arc::into_inner) {
            Some(finer) => (finer.points(), Contents::Finer(finer)),
            None => (bucket.points, Contents::Points(bucket)),
        };
        self.buckets.into_iter().map(inner).map(contents).collect()
    }

    pub fn points(&self) -> u64 {
        let of = |bucket: &Mutex<Bucket>| {
            let bucket = bucket.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            bucket.finer.as_ref().map_or(bucket.points, |finer| finer.points())
        };
        self.buckets.iter().map(of).sum()
    }
}

/// Contents of a grid's cell.
pub enum Contents {
    Points(Bucket),
    /// More points than a chunk may have.
    Finer(Grid),
}
