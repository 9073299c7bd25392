//! Points in any order -> BUCKETS of points that lie together, in bounded memory.
//!
//! In: batches of columns, from any thread. Out: for each cell of a Morton-ordered grid its points as records of fixed width, in blocks. Blocks stay in
//! memory up to a limit; beyond it full blocks go to one nameless temporary file, which the system removes with the process, however that ends.
//! A batch is first sorted by cell, so that a bucket is locked once a batch and not once a point.

use super::morton;
use super::samples::{Cell, Samples};
use crate::cloud::color::to_8_bits;
use crate::cloud::{Columns, Wanted};
use crate::error::{Error, Result};
use crate::whole_file::scratch;
use rayon::prelude::*;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// A grid has 2^5 cells along each axis.
pub const GRID_BITS: u32 = 5;
const CELLS: usize = 1 << (3 * GRID_BITS);

/// A block in memory, or on the disk once memory is full.
const BLOCK_BYTES: usize = 64 << 10;
/// A page: every bucket of a grid may hold as much in memory, 128 MiB together.
const SPILLED_BYTES: usize = 4 << 10;

/// Where a record keeps what; columns that no file has take no room.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    pub has: Wanted,
    pub bytes: usize,
}

impl Layout {
    pub fn new(has: Wanted) -> Layout {
        let bytes = 12
            + 4 * has.rgb as usize
            + 2 * has.intensity as usize
            + has.class as usize
            + has.returns as usize
            + 2 * has.source as usize
            + 3 * has.normal as usize
            + 8 * has.gps_time as usize
            + 2;
        Layout { has, bytes }
    }

    /// Writes point `i` of a batch. What its file lacks is what a renderer would show for it: white, and 0 everywhere else.
    fn write(&self, record: &mut [u8], q: Cell, columns: &Columns, i: usize, wide: bool, part: u16) {
        let mut at = 0;
        let mut put = |bytes: &[u8]| {
            record[at..at + bytes.len()].copy_from_slice(bytes);
            at += bytes.len();
        };
        q.iter().for_each(|v| put(&v.to_le_bytes()));
        if self.has.rgb {
            let [r, g, b] = columns.rgb.as_ref().map_or([255; 3], |rgb| rgb[i]);
            put(&[r, g, b, wide as u8]);
        }
        if self.has.intensity {
            put(&columns.intensity.as_ref().map_or(0, |v| v[i]).to_le_bytes());
        }
        if self.has.class {
            put(&[columns.class.as_ref().map_or(0, |v| v[i])]);
        }
        if self.has.returns {
            put(&[columns.returns.as_ref().map_or(0, |v| v[i])]);
        }
        if self.has.source {
            put(&columns.source.as_ref().map_or(0, |v| v[i]).to_le_bytes());
        }
        if self.has.normal {
            put(&columns.normal.as_ref().map_or([0; 3], |v| v[i]).map(|v| v as u8));
        }
        if self.has.gps_time {
            put(&columns.gps_time.as_ref().map_or(0.0, |v| v[i]).to_le_bytes());
        }
        put(&part.to_le_bytes());
    }

    pub fn cell(record: &[u8]) -> Cell {
        let at = |at: usize| u32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]]);
        [at(0), at(4), at(8)]
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

    /// The points of settled records that follow each other. `station` numbers the station of a part and a source. A column at a time: the records fit the
    /// cache.
    pub fn read(&self, records: &[u8], keep: Wanted, station: &impl Fn(u16, u16) -> u16) -> Samples {
        let rows = || records.chunks_exact(self.bytes);
        let mut next = 12;
        let mut at = |there: bool, bytes: usize| {
            next += if there { bytes } else { 0 };
            there.then_some(next - bytes * there as usize)
        };
        let (rgb, intensity, class, returns) =
            (at(self.has.rgb, 4), at(self.has.intensity, 2), at(self.has.class, 1), at(self.has.returns, 1));
        let (source, normal, times) = (at(self.has.source, 2), at(self.has.normal, 3), at(self.has.gps_time, 8));
        let u16_at = |row: &[u8], at: usize| u16::from_le_bytes([row[at], row[at + 1]]);
        let part = |row: &[u8]| u16_at(row, self.bytes - 2);
        let color = |row: &[u8], at: usize| [row[at], row[at + 1], row[at + 2]];
        let time = |row: &[u8], at: usize| f64::from_le_bytes(row[at..at + 8].try_into().expect("eight bytes"));
        Samples {
            q: rows().map(Layout::cell).collect(),
            rgb: rgb.filter(|_| keep.rgb).map(|at| rows().map(|row| color(row, at)).collect()),
            intensity: intensity.map(|at| rows().map(|row| u16_at(row, at)).collect()),
            class: class.map(|at| rows().map(|row| row[at]).collect()),
            returns: returns.map(|at| rows().map(|row| row[at]).collect()),
            source: source.map(|at| rows().map(|row| station(part(row), u16_at(row, at))).collect()),
            normal: normal.map(|at| rows().map(|row| [row[at] as i8, row[at + 1] as i8, row[at + 2] as i8]).collect()),
            gps_time: times.map(|at| rows().map(|row| time(row, at)).collect()),
            weight: None,
        }
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

#[derive(Debug)]
enum Block {
    Memory(Vec<u8>),
    Disk { at: u64, bytes: u32 },
}

/// The points of one cell.
#[derive(Debug, Default)]
pub struct Bucket {
    pub points: u64,
    blocks: Vec<Block>,
    tail: Vec<u8>,
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

impl Bucket {
    /// The same on all threads, in pieces of about `bytes`; what they hold is forgotten as they are taken.
    pub fn par_drain(self, spill: &Spill, bytes: usize, take: &(dyn Fn(&[u8]) -> Result<()> + Sync)) -> Result<()> {
        let mut pieces: Vec<Bucket> = Vec::new();
        let mut room = 0;
        for block in self.blocks {
            if room == 0 {
                pieces.push(Bucket::default());
                room = bytes;
            }
            room = room.saturating_sub(match &block {
                Block::Memory(bytes) => bytes.len(),
                Block::Disk { bytes, .. } => *bytes as usize,
            });
            pieces.last_mut().expect("just pushed").blocks.push(block);
        }
        pieces.push(Bucket { tail: self.tail, ..Bucket::default() });
        pieces.into_par_iter().try_for_each(|piece| {
            let mut records = Vec::new();
            piece.drain(spill, &mut |block| {
                records.extend_from_slice(block);
                Ok(())
            })?;
            take(&records)
        })
    }
}

/// A grid of buckets over the cube of 2^`bits` steps at `corner`; the buckets in Morton order.
pub struct Grid {
    corner: Cell,
    bits: u32,
    stride: usize,
    buckets: Vec<Mutex<Bucket>>,
}

/// What a thread sorts its batches in.
#[derive(Default)]
pub struct Sorter {
    cells: Vec<u16>,
    starts: Vec<u32>,
    records: Vec<u8>,
}

impl Grid {
    pub fn new(corner: Cell, bits: u32, stride: usize) -> Grid {
        Grid { corner, bits, stride, buckets: (0..CELLS).map(|_| Mutex::default()).collect() }
    }

    /// Bits of the Morton code that a bucket's cell leaves open.
    pub fn cell_bits(&self) -> u32 {
        3 * self.bits.saturating_sub(GRID_BITS)
    }

    fn number(&self, q: Cell) -> u16 {
        let shift = self.bits.saturating_sub(GRID_BITS);
        morton::code([0, 1, 2].map(|axis| (q[axis] - self.corner[axis]) >> shift)) as u16
    }

    /// Distributes `count` points; `cell` and `write` say where the `i`th lies and what its record is.
    fn scatter(
        &self,
        count: usize,
        cell: impl Fn(usize) -> Cell,
        mut write: impl FnMut(usize, &mut [u8]),
        sorter: &mut Sorter,
        spill: &Spill,
    ) -> Result<()> {
        let Sorter { cells, starts, records } = sorter;
        starts.clear();
        starts.resize(CELLS + 1, 0);
        cells.clear();
        cells.extend((0..count).map(|i| self.number(cell(i))));
        cells.iter().for_each(|&cell| starts[cell as usize + 1] += 1);
        let mut occupied = Vec::new();
        for cell in 0..CELLS {
            if starts[cell + 1] > 0 {
                occupied.push(cell);
            }
            starts[cell + 1] += starts[cell];
        }
        let ends: Vec<(usize, usize, usize)> = occupied.iter().map(|&c| (c, starts[c] as usize, starts[c + 1] as usize)).collect();
        records.resize(count * self.stride, 0);
        for (i, &cell) in cells.iter().enumerate() {
            let slot = &mut starts[cell as usize];
            let at = *slot as usize * self.stride;
            write(i, &mut records[at..at + self.stride]);
            *slot += 1;
        }
        for (cell, start, end) in ends {
            let mut bucket = self.buckets[cell].lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            bucket.append(&records[start * self.stride..end * self.stride], self.stride, spill)?;
        }
        Ok(())
    }

    /// A batch of a file; `cells` are its points on the tree's lattice.
    pub fn add(
        &self,
        layout: &Layout,
        cells: &[Cell],
        columns: &Columns,
        wide: bool,
        part: u16,
        sorter: &mut Sorter,
        spill: &Spill,
    ) -> Result<()> {
        self.scatter(cells.len(), |i| cells[i], |i, record| layout.write(record, cells[i], columns, i, wide, part), sorter, spill)
    }

    /// Records of a bucket that was too full.
    pub fn add_records(&self, from: &[u8], sorter: &mut Sorter, spill: &Spill) -> Result<()> {
        let record = |i: usize| &from[i * self.stride..(i + 1) * self.stride];
        self.scatter(from.len() / self.stride, |i| Layout::cell(record(i)), |i, to| to.copy_from_slice(record(i)), sorter, spill)
    }

    pub fn into_buckets(self) -> Vec<Bucket> {
        self.buckets.into_iter().map(|bucket| bucket.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner())).collect()
    }
}
