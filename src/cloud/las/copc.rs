//! COPC files of packed records: LAZ 1.4 whose chunks are the nodes of an octree. They are complete
//! or absent.
//!
//! A node has the first point of each cell of a grid of 128 x 128 x 128, and its eight children
//! have the rest, so a coarse picture needs few nodes. A node of few points has them all. Records
//! that are in no node yet are in memory. Where that is full, they are in unnamed files beside the
//! output, and are written there once a level of the tree.

use super::header::{Vlr, array_at};
use super::write::{Count, Head, field, io_error};
use crate::atomic_file::{AtomicFile, temporary_file};
use crate::error::{Error, Result};
use crate::progress::Progress;
use laz::laszip::ChunkTable;
use laz::{LazVlr, ParLasZipCompressor};
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Most records that are in memory and in no node yet `[bytes]`.
pub const IN_MEMORY: usize = 128 << 20;

/// Records of one node that are written to a file at a time `[bytes]`.
const BLOCK: usize = 1 << 20;

/// Nodes that wait for compression, on all threads together `[bytes]`.
const WAITING: usize = 32 << 20;

/// Cells of a node's grid along an axis: 2^7.
const CELL_BITS: u32 = 7;

/// Most points of a node that is not divided.
const WHOLE: u64 = 65_536;

/// Children of fewer points stay with their parent.
const FEWEST: u64 = 1024;

/// A file being written. Dropping it before [`CopcWriter::finish`] leaves nothing.
pub struct CopcWriter {
    whole: AtomicFile,
    head: Head,
    count: Count,
    times: [f64; 2],
    records: Records,
    memory: Memory,
}

/// Level of a node, and its number along each axis.
type Key = [i32; 4];

impl CopcWriter {
    /// Creates a file of points of format 6, 7 or 8, with this many bytes of records in memory.
    pub fn create(path: &Path, head: Head, most: usize) -> Result<CopcWriter> {
        Ok(CopcWriter {
            whole: AtomicFile::create(path)?,
            head,
            count: Count::default(),
            times: [f64::INFINITY, f64::NEG_INFINITY],
            records: Records::default(),
            memory: Memory { path: path.to_owned(), held: 0, most },
        })
    }

    /// Takes records of the header's point format.
    pub fn write(&mut self, records: &[u8]) -> Result<()> {
        for record in records.chunks_exact(self.head.width() as usize) {
            self.count.add(record, 15);
            let time = f64::from_le_bytes(array_at(record, TIME_AT));
            self.times = [self.times[0].min(time), self.times[1].max(time)];
        }
        self.records.push(records, &mut self.memory)
    }

    /// Divides the points among nodes, writes these, and renames the file to its final name.
    pub fn finish(self, progress: &dyn Progress) -> Result<()> {
        let CopcWriter { whole, mut head, count, times, records, memory } = self;
        let path = memory.path.clone();
        let wrote = |error| Error::io("write", &path, error);
        let laszip = head.compress(true).map_err(|error| wrote(io_error(error)))?;
        head.records.insert(0, info(Vec::new()));
        let cube = Cube::around(&head, &count);
        // Times that are no numbers have no range.
        let times = if times[0] <= times[1] { times } else { [0.0; 2] };
        head.records[0].data = cube.info(times, [0; 2]);
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .open(whole.partial())
            .map_err(|error| Error::io("create", &path, error))?;
        let mut file = BufWriter::with_capacity(BLOCK, file);
        head.write(&count, 0, &mut file).map_err(wrote)?;
        let points_at = file.stream_position().map_err(wrote)?;
        let mut packed = ParLasZipCompressor::new(file, laszip.clone())
            .map_err(|error| wrote(io_error(error)))?;
        packed.reserve_offset_to_chunk_table().map_err(wrote)?;
        let mut tree = Tree {
            cube,
            width: head.width() as usize,
            packed,
            waiting: Vec::new(),
            keys: Vec::new(),
            done: 0,
            total: count.points,
            memory,
            progress,
        };
        tree.divide([0; 4], records)?;
        tree.compress()?;
        let Tree { mut packed, keys, .. } = tree;
        packed.done().map_err(|error| wrote(io_error(error)))?;
        let end = || {
            let mut file = packed.into_inner().into_inner()?;
            let tree_at = file.seek(SeekFrom::End(0))?;
            let hierarchy = hierarchy(&mut file, points_at, &laszip, &keys)?;
            file.seek(SeekFrom::End(0))?;
            file.write_all(&extended(&hierarchy))?;
            head.records[0].data =
                cube.info(times, [tree_at + EXTENDED_BYTES as u64, hierarchy.len() as u64]);
            file.seek(SeekFrom::Start(0))?;
            head.write(&count, tree_at, &mut file)
        };
        end().map_err(wrote)?;
        whole.finish()
    }
}

/// Place of the time in records of formats 6 to 8.
const TIME_AT: usize = 22;

const EXTENDED_BYTES: usize = 60;

/// Returns the record that every COPC file begins with.
fn info(data: Vec<u8>) -> Vlr {
    Vlr { user: "copc".into(), record: 1, description: "COPC info VLR".into(), data }
}

/// Returns the extended record of all nodes.
fn extended(hierarchy: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0; 2];
    bytes.extend(field::<16>("copc"));
    bytes.extend(1000u16.to_le_bytes());
    bytes.extend((hierarchy.len() as u64).to_le_bytes());
    bytes.extend(field::<32>("EPT Hierarchy"));
    bytes.extend(hierarchy);
    bytes
}

/// Lists the nodes with their chunks, by the table of chunks that was written.
fn hierarchy(
    file: &mut File,
    points_at: u64,
    laszip: &LazVlr,
    keys: &[Key],
) -> io::Result<Vec<u8>> {
    file.seek(SeekFrom::Start(points_at))?;
    let table = ChunkTable::read_from(&mut *file, laszip).map_err(io_error)?;
    let mut at = points_at + ChunkTable::OFFSET_SIZE as u64;
    let (mut bytes, narrow) = (Vec::new(), |v: u64| i32::try_from(v).map_err(io::Error::other));
    for (k, key) in keys.iter().enumerate() {
        let chunk = table[k];
        key.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        bytes.extend(at.to_le_bytes());
        bytes.extend(narrow(chunk.byte_count)?.to_le_bytes());
        bytes.extend(narrow(chunk.point_count)?.to_le_bytes());
        at += chunk.byte_count;
    }
    Ok(bytes)
}

/// The cube of the root, in steps of the lattice.
#[derive(Clone, Copy)]
struct Cube {
    /// World corner, and its place on the lattice `[steps]`.
    corner: [f64; 3],
    low: [f64; 3],
    /// Length of the sides, world, and a step's share of it along each axis.
    side: f64,
    shares: [f64; 3],
    /// Levels below which cells are smaller than a step.
    levels: u32,
}

impl Cube {
    fn around(head: &Head, count: &Count) -> Cube {
        let (lattice, [low, high]) = (head.lattice, count.bounds.unwrap_or_default());
        let [low, high] = [low, high].map(|steps| lattice.world(steps.map(i64::from)));
        // No point lies on the upper sides.
        let side = ((high - low).max_element() + lattice.step.max_element()) * (1.0 + 1e-9);
        let corner = (low + high - side) / 2.0;
        Cube {
            corner: corner.to_array(),
            low: ((corner - lattice.offset) / lattice.step).to_array(),
            side,
            shares: (lattice.step / side).to_array(),
            levels: (side / lattice.step.max_element()).log2().ceil() as u32,
        }
    }

    /// Returns the cell of a record on the grid of 2^bits cells along each axis.
    fn cell(&self, record: &[u8], bits: u32) -> [u64; 3] {
        let cells = (1u64 << bits) as f64;
        [0, 1, 2].map(|axis| {
            let step = i32::from_le_bytes(array_at(record, 4 * axis)) as f64;
            let share = (step - self.low[axis]) * self.shares[axis];
            (share * cells).clamp(0.0, cells - 1.0) as u64
        })
    }

    /// Returns the contents of the first record, with the place and length of the nodes' list.
    fn info(&self, times: [f64; 2], hierarchy: [u64; 2]) -> Vec<u8> {
        let half = self.side / 2.0;
        let spacing = self.side / (1u64 << CELL_BITS) as f64;
        let center = self.corner.map(|v| v + half);
        let mut data = Vec::with_capacity(160);
        center.iter().chain(&[half, spacing]).for_each(|v| data.extend(v.to_le_bytes()));
        hierarchy.iter().for_each(|v| data.extend(v.to_le_bytes()));
        times.iter().for_each(|v| data.extend(v.to_le_bytes()));
        data.resize(160, 0);
        data
    }
}

/// The nodes, from the root on.
struct Tree<'t> {
    cube: Cube,
    /// Bytes of a record.
    width: usize,
    packed: ParLasZipCompressor<BufWriter<File>>,
    /// Nodes that are not compressed yet.
    waiting: Vec<Vec<u8>>,
    keys: Vec<Key>,
    done: u64,
    total: u64,
    memory: Memory,
    progress: &'t dyn Progress,
}

impl Tree<'_> {
    /// Writes a node and those below it.
    fn divide(&mut self, key: Key, records: Records) -> Result<()> {
        let (level, width) = (key[0] as u32, self.width);
        if records.bytes() <= WHOLE * width as u64 || level >= self.cube.levels {
            let mut own = Vec::with_capacity(records.bytes() as usize);
            return records
                .each(width, &mut self.memory, &mut |block, _| {
                    own.extend_from_slice(block);
                    Ok(())
                })
                .and_then(|()| self.node(key, own));
        }
        let (cube, mask) = (self.cube, (1 << CELL_BITS) - 1);
        let mut taken = vec![0u64; (1 << (3 * CELL_BITS)) / 64];
        let mut own = Vec::new();
        let mut children: [Records; 8] = Default::default();
        records.each(width, &mut self.memory, &mut |block, memory| {
            for record in block.chunks_exact(width) {
                let [x, y, z] = cube.cell(record, level + CELL_BITS).map(|v| v & mask);
                let cell = (z << CELL_BITS | y) << CELL_BITS | x;
                let (word, bit) = (cell as usize / 64, 1 << (cell % 64));
                if taken[word] & bit == 0 {
                    taken[word] |= bit;
                    own.extend_from_slice(record);
                } else {
                    let half = CELL_BITS - 1;
                    let child = x >> half | (y >> half) << 1 | (z >> half) << 2;
                    children[child as usize].push(record, memory)?;
                }
            }
            self.progress.tick("dividing points", self.done, self.total)
        })?;
        for child in &mut children {
            if child.bytes() < FEWEST * width as u64 {
                std::mem::take(child).each(width, &mut self.memory, &mut |block, _| {
                    own.extend_from_slice(block);
                    Ok(())
                })?;
            } else {
                child.settle(&mut self.memory)?;
            }
        }
        drop(taken);
        self.node(key, own)?;
        let children = children.into_iter().zip(0..8).filter(|(child, _)| child.bytes() > 0);
        for (child, k) in children {
            let [level, x, y, z] = key;
            let below = [level + 1, x << 1 | k & 1, y << 1 | k >> 1 & 1, z << 1 | k >> 2];
            self.divide(below, child)?;
        }
        Ok(())
    }

    fn node(&mut self, key: Key, records: Vec<u8>) -> Result<()> {
        self.keys.push(key);
        self.waiting.push(records);
        let waiting: usize = self.waiting.iter().map(Vec::len).sum();
        if waiting > WAITING { self.compress() } else { Ok(()) }
    }

    /// Compresses the nodes that wait.
    fn compress(&mut self) -> Result<()> {
        let waiting = std::mem::take(&mut self.waiting);
        self.done += waiting.iter().map(|node| (node.len() / self.width) as u64).sum::<u64>();
        self.packed
            .compress_chunks(waiting)
            .map_err(|error| Error::io("write", &self.memory.path, error))?;
        self.progress.tick("writing nodes", self.done, self.total)
    }
}

/// Bounds of the memory for records that are in no node yet.
struct Memory {
    /// Files of records lie beside this one.
    path: PathBuf,
    held: usize,
    most: usize,
}

/// Records in order: those in a file, then those in memory.
#[derive(Default)]
struct Records {
    file: Option<File>,
    written: u64,
    tail: Vec<u8>,
}

impl Records {
    fn bytes(&self) -> u64 {
        self.written + self.tail.len() as u64
    }

    fn push(&mut self, records: &[u8], memory: &mut Memory) -> Result<()> {
        self.tail.extend_from_slice(records);
        memory.held += records.len();
        let is_full = memory.held > memory.most && self.tail.len() >= BLOCK.min(memory.most);
        if is_full { self.spill(memory) } else { Ok(()) }
    }

    fn spill(&mut self, memory: &mut Memory) -> Result<()> {
        let wrote = |error| Error::io("write", &memory.path, error);
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(temporary_file(&memory.path)?),
        };
        file.write_all(&self.tail).map_err(wrote)?;
        self.written += self.tail.len() as u64;
        memory.held -= self.tail.len();
        self.tail = Vec::new();
        Ok(())
    }

    /// Makes room for others where some records are in a file already.
    fn settle(&mut self, memory: &mut Memory) -> Result<()> {
        if self.file.is_some() { self.spill(memory) } else { Ok(()) }
    }

    /// Gives all records away, a block at a time.
    fn each(
        self,
        width: usize,
        memory: &mut Memory,
        sink: &mut dyn FnMut(&[u8], &mut Memory) -> Result<()>,
    ) -> Result<()> {
        let Records { file, written, tail } = self;
        if let Some(mut file) = file {
            let path = memory.path.clone();
            let read = |error| Error::io("read", &path, error);
            file.seek(SeekFrom::Start(0)).map_err(read)?;
            let (mut left, mut block) = (written, vec![0; BLOCK / width * width]);
            while left > 0 {
                let length = left.min(block.len() as u64) as usize;
                file.read_exact(&mut block[..length]).map_err(read)?;
                sink(&block[..length], memory)?;
                left -= length as u64;
            }
        }
        memory.held -= tail.len();
        tail.chunks(BLOCK / width * width).try_for_each(|block| sink(block, memory))
    }
}
