//! Builds NAME.pnti from files, out of core, on all cores, in bounded memory.
//!
//! ```text
//! files whose lattices agree form one tree; others form trees of their own: no point is moved
//! of every tree:
//!   distribute the points to a grid of buckets over the stated box (`spill_bucket`; a header with
//!     a wrong box costs a second pass)
//!   cut the grid into chunks, the largest kd-cells with at most C points; a place with more of them
//!     is several chunks
//! number the stations; find their exposure gains from a sample of points (`exposure`), before
//!   colours of several stations are merged
//! of every tree:
//!   build every chunk, on all cores: leaves and inner nodes (`build_chunk`); write them in order
//!   after the last chunk of a kd-cell: join the open nodes of its halves, and make their parent
//! above several trees: common nodes, on a lattice of their own (`merge_lattices`)
//! number the nodes, roots first, siblings side by side
//! derive what depends on neighbours, if requested (`attributes::derive`)
//! directory; header (`format`)
//! ```
//!
//! The input is read once, so that LAZ is decoded once. Chunks are cells of the same kd-tree
//! whatever their size, and nodes lie in the order of the tree, each behind those below it, so that
//! the same files give the same bytes with any number of threads and any memory.
//!
//! In memory, `partition` cuts a part into nodes, and `pack` packs a node for the GPU.

mod build_chunk;
mod builder;
mod ingest;
mod merge_lattices;
mod morton_sort;
pub mod pack;
pub mod partition;
mod point_record;
mod spill_bucket;

use super::attributes::derive;
pub use super::format::samples::DerivedPlanes;
use super::format::samples::{self, Samples};
use super::format::schema;
use super::format::{Contents, Directory, NodeRecord, Writer};
use super::merge::Gains;
use crate::cloud::ReadOptions;
use crate::cloud::attribute::percentiles;
use crate::cloud::histograms::Tally;
use crate::cloud::stream;
use crate::error::{Error, Result};
use crate::progress::Progress;
use build_chunk::{BuiltNode, GrownChunk, OpenNode, TreeLayout, TreeSpec, Worker};
pub use builder::Options;
use builder::{Builder, lock};
use ingest::{Chunk, Ingested, group};
use point_record::Colors;
use rayon::prelude::*;
use spill_bucket::Spill;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Instant;

/// Summary of a build.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct Summary {
    pub points: u64,
    pub nodes: usize,
    pub leaves: usize,
    /// Length of the file.
    pub bytes: u64,
    /// Bytes of position, colour, intensity, class and weight, over all nodes.
    pub core_bytes: u64,
    pub spilled_bytes: u64,
    pub seconds: f64,
    /// Seconds until all points were read and distributed.
    pub read_seconds: f64,
    /// Seconds of deriving.
    pub derive_seconds: f64,
    /// Memory that grows with the cloud, beyond `Options::memory`: node records are held until all
    /// are known.
    pub held_bytes_per_point: f64,
    /// Peak memory of this process so far `[MiB]`, on Linux.
    pub peak_mib: f64,
    pub notes: Vec<String>,
}

/// A built node, then its record, with its number in between.
const HELD_BYTES_PER_NODE: usize = size_of::<BuiltNode>() + size_of::<NodeRecord>() + 16;

pub fn build(
    paths: &[PathBuf],
    output: &Path,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Summary> {
    let began = Instant::now();
    let options = &Options { threads: options.threads.max(1), ..*options };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads).build();
    let pool = pool.map_err(|error| {
        Error::Request(format!("cannot start {} threads: {error}", options.threads))
    })?;
    pool.install(|| {
        let mut notes = Vec::new();
        let Options { wanted, strict, text, rgb_range, .. } = *options;
        let read = ReadOptions { text, rgb_range, ..ReadOptions::new(wanted, strict) };
        let sources = stream::open(paths, &read, progress, &mut notes)?;
        if sources.len() > u16::MAX as usize {
            return Err(Error::Request(format!(
                "{} files are more than the 65,535 that one index takes",
                sources.len()
            )));
        }
        let writer = Writer::create(output)?;
        let spill = Spill::new(output, options.bucket_bytes())?;
        let scalar = sources.iter().find_map(|source| source.available().scalars.iter().next());
        let scalar = scalar.map(|scalar| scalar.to_string());
        let contents = Contents { notes, scalar, ..Contents::default() };
        let mut builder = Builder {
            sources: &sources,
            options,
            progress,
            writer: &writer,
            spill: &spill,
            contents,
            parts: vec![None; sources.len()],
            colors: vec![Colors::Bytes; sources.len()],
            intensities: vec![0; 1 << 16],
            tally: Tally::default(),
            end: Writer::START,
            nodes: Vec::new(),
            roots: Vec::new(),
            far_roots: Vec::new(),
            corners: Vec::new(),
            numbers: BTreeMap::new(),
            gains: None,
        };
        let trees = group(&sources)
            .into_iter()
            .map(|group| builder.ingest(group))
            .collect::<Result<Vec<_>>>()?;
        let read_seconds = began.elapsed().as_secs_f64();
        builder.stations(&trees)?;
        builder.contents.intensity_stretch = percentiles(&builder.intensities);
        let [colors, intensities] = builder.balances(&trees)?;
        builder.gains = Some(Arc::new(Gains::new(colors.as_ref(), intensities.as_ref())));
        (builder.contents.balance, builder.contents.intensity_balance) = (colors, intensities);
        trees.into_iter().try_for_each(|tree| builder.tree(tree))?;
        builder.unite()?;
        // Strays have no parent in common with the others, which would show them as one place.
        builder.roots.append(&mut builder.far_roots);
        let Builder { mut contents, parts, nodes, roots, end, tally, corners, .. } = builder;
        contents.counts = Some(tally.counts());
        contents.parts = parts.into_iter().flatten().collect();
        let (nodes, roots) = number(nodes, &roots);
        let mut summary = Summary {
            points: contents.points,
            nodes: nodes.len(),
            leaves: nodes.iter().filter(|node| node.is_leaf()).count(),
            core_bytes: nodes.iter().map(core_bytes).sum(),
            spilled_bytes: spill.bytes_on_disk(),
            held_bytes_per_point: (nodes.len() * HELD_BYTES_PER_NODE) as f64
                / contents.points.max(1) as f64,
            read_seconds,
            ..Summary::default()
        };
        let mut directory = Directory { nodes, roots, contents };
        directory.contents.elevation_stretch = elevations(&directory, &writer)?;
        if options.derive != DerivedPlanes::NONE {
            let began = Instant::now();
            let Options { memory, threads, derive, .. } = *options;
            let options = derive::Options { derive, memory, threads };
            derive::derive(&mut directory, &writer, &corners, &options, progress)?;
            summary.derive_seconds = began.elapsed().as_secs_f64();
        }
        summary.bytes = writer.finish(&directory, end)?;
        summary.notes = directory.contents.notes;
        summary.peak_mib = peak_mib();
        summary.seconds = began.elapsed().as_secs_f64();
        Ok(summary)
    })
}

/// Returns "VmHWM" of /proc/self/status `[MiB]`.
fn peak_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kib = status.lines().find_map(|line| {
        line.strip_prefix("VmHWM:")?.split_whitespace().next()?.parse::<f64>().ok()
    });
    kib.unwrap_or(0.0) / 1024.0
}

fn core_bytes(node: &NodeRecord) -> u64 {
    use super::format::Plane::*;
    let planes = [Coarse, Fine, Finest, Rgb, Intensity, Class, Weight];
    planes.into_iter().filter(|&plane| node.has(plane)).map(|plane| node.range(plane).1).sum()
}

impl Builder<'_> {
    /// Builds and writes one group's tree.
    fn tree(&mut self, ingested: Ingested) -> Result<()> {
        let is_of_strays = ingested.is_of_strays(self.sources);
        let Ingested { mut tree, chunks, points, .. } = ingested;
        if points == 0 {
            return Ok(());
        }
        tree.kind.gains = self.gains.clone();
        let root = self.grow(&tree, chunks, points)?;
        if is_of_strays {
            self.far_roots.push(root)
        } else {
            self.roots.push(root)
        };
        Ok(())
    }

    /// Builds the chunks on all threads, and the nodes above them. Writes planes in the order of the
    /// tree. Returns the root.
    fn grow(&mut self, tree: &TreeLayout, chunks: Vec<Chunk>, points: u64) -> Result<u32> {
        let count = chunks.len();
        let cells: Vec<Cell> =
            chunks.iter().map(|chunk| Cell { depth: chunk.depth, prefix: chunk.prefix }).collect();
        let chunks: Vec<Mutex<Option<Chunk>>> =
            chunks.into_iter().map(|chunk| Mutex::new(Some(chunk))).collect();
        let next = AtomicUsize::new(0);
        let placing = Mutex::new(Placing {
            end: self.end,
            nodes: std::mem::take(&mut self.nodes),
            ..Placing::default()
        });
        let placed = Condvar::new();
        let (this, progress) = (&*self, self.progress);
        let threads = self.options.threads;
        let work = || -> Result<()> {
            let mut worker = Worker::default();
            let station = this.numbered();
            loop {
                let number = next.fetch_add(1, Relaxed);
                if number >= count {
                    return Ok(());
                }
                let chunk = lock(&chunks[number]).take().expect("each chunk is taken once");
                let grown = worker.grow(
                    tree,
                    &this.colors,
                    chunk.depth,
                    chunk.buckets,
                    &station,
                    this.spill,
                )?;
                // Chunks that are ready before their turn wait here, but not many of them.
                let mut state = lock(&placing);
                while state.next != number && state.waiting.len() > 2 * threads && !state.failed {
                    state = placed.wait(state).unwrap_or_else(|poisoned| poisoned.into_inner());
                }
                if state.failed {
                    return Err(Error::Interrupted);
                }
                state.waiting.insert(number, grown);
                let mut writes = Vec::new();
                while let Some(grown) = {
                    let next = state.next;
                    state.waiting.remove(&next)
                } {
                    let next = state.next;
                    writes.push((next, state.place(cells[next], grown)));
                    this.ascend(&mut state, &tree.kind, cells.get(next + 1))?;
                }
                let (done, total) = (state.points, points);
                drop(state);
                placed.notify_all();
                for (chunk, (at, planes)) in writes {
                    this.writer.put(at, &planes)?;
                    worker.planes = planes;
                    lock(&placing).written(chunk);
                }
                progress.tick("indexing", done, total)?;
            }
        };
        let outcomes: Vec<Result<()>> = std::thread::scope(|scope| {
            let guarded = || {
                // On a panic as well, since other threads would wait for its chunk forever.
                let alarm = Alarm { placing: &placing, placed: &placed };
                let outcome = work();
                if outcome.is_ok() {
                    std::mem::forget(alarm);
                }
                outcome
            };
            // If the system starts fewer threads, those do all the work.
            let started = (0..threads)
                .map_while(|_| std::thread::Builder::new().spawn_scoped(scope, guarded).ok());
            let handles: Vec<_> = started.collect();
            if handles.is_empty() {
                return vec![Err(Error::Request("the system cannot start threads".into()))];
            }
            handles
                .into_iter()
                .map(|handle| {
                    handle.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
                })
                .collect()
        });
        // Returns the error that stopped the others, not theirs.
        let (mut first, mut interrupted) = (None, None);
        for outcome in outcomes {
            match outcome {
                Ok(()) => {}
                Err(Error::Interrupted) => interrupted = Some(Error::Interrupted),
                Err(error) => first = first.or(Some(error)),
            }
        }
        if let Some(error) = first.or(interrupted) {
            return Err(error);
        }
        let Placing { end, nodes, open, .. } =
            placing.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
        (self.end, self.nodes) = (end, nodes);
        Ok(open[0].nodes[0].node)
    }

    /// Joins the open nodes of cells that no further chunk lies in, and makes and writes their
    /// parents. `next` is the cell of the next chunk, if any.
    fn ascend(&self, state: &mut Placing, kind: &TreeSpec, next: Option<&Cell>) -> Result<()> {
        while let Some(top) = state.open.pop_if(|top| {
            top.cell.parent().is_some_and(|parent| next.is_none_or(|next| !parent.has(next)))
        }) {
            let Some(cell) = top.cell.parent() else { break };
            let mut joined = OpenCell { cell, nodes: Vec::new() };
            let sibling = state.open.pop_if(|other| other.cell.parent() == Some(cell));
            joined.nodes.extend(sibling.into_iter().flat_map(|sibling| sibling.nodes));
            joined.nodes.extend(top.nodes);
            if build_chunk::has_enough_samples(&joined.nodes) {
                self.close(state, kind, &mut joined.nodes)?;
            }
            state.open.push(joined);
        }
        if next.is_none()
            && let Some(mut root) = state.open.pop()
        {
            if root.nodes.len() > 1 {
                self.close(state, kind, &mut root.nodes)?;
            }
            state.open.push(root);
        }
        Ok(())
    }

    /// Replaces open nodes by their parent, behind all that is written.
    fn close(&self, state: &mut Placing, kind: &TreeSpec, open: &mut Vec<OpenNode>) -> Result<()> {
        let (planes, mut built) = self.parent(&state.nodes, kind, open)?;
        built.record.at = state.end;
        self.writer.put(state.end, &planes)?;
        state.end += planes.len() as u64;
        *open = vec![OpenNode {
            node: state.nodes.len() as u32,
            count: built.record.count,
            samples: None,
        }];
        state.nodes.push(built);
        Ok(())
    }

    /// Makes one root above those of several trees, so that a distant view need not show one of
    /// each.
    fn unite(&mut self) -> Result<()> {
        let records: Vec<_> =
            self.roots.iter().map(|&root| &self.nodes[root as usize].record).collect();
        let Some((mut kind, order)) =
            merge_lattices::over(&records, &self.contents, self.options.derive)
        else {
            return Ok(());
        };
        kind.lattice_number = self.lattice(&kind.lattice, kind.corner)?;
        kind.gains = self.gains.clone();
        let open = |&place: &usize| {
            let node = self.roots[place];
            OpenNode { node, count: self.nodes[node as usize].record.count, samples: None }
        };
        let mut open: Vec<OpenNode> = order.iter().map(open).collect();
        while open.len() > 1 {
            let mut lists = merge_lattices::lists(open);
            for some in lists.chunks_mut(4 * self.options.threads) {
                self.progress.tick("joining", 0, 1)?;
                self.parents(&kind, some.iter_mut().filter(|list| list.len() > 1).collect())?;
            }
            open = lists.into_iter().flatten().collect();
        }
        self.roots = open.iter().map(|open| open.node).collect();
        Ok(())
    }

    /// Makes the parent of open nodes. Their samples are read back, if they are not at hand.
    fn parent(
        &self,
        nodes: &[BuiltNode],
        kind: &TreeSpec,
        open: &mut [OpenNode],
    ) -> Result<(Vec<u8>, BuiltNode)> {
        let samples = |open: &mut OpenNode| {
            if let Some(samples) = open.samples.take() {
                return Ok(samples);
            }
            let record = &nodes[open.node as usize].record;
            let mut planes = vec![0; record.bytes() as usize];
            self.writer.get(record.at, &mut planes)?;
            let corner = self.corners[record.lattice as usize];
            let samples = Samples::unpack(record, corner, &samples::within(record, &planes));
            let is_own = record.lattice / 2 == kind.lattice_number / 2;
            let lattices = &self.contents.lattices;
            Ok(if is_own {
                samples
            } else {
                samples
                    .moved(&schema::tree_lattice(record, lattices), &kind.lattice)
                    .completed(kind.has)
            })
        };
        let parts = open.iter_mut().map(samples).collect::<Result<Vec<_>>>()?;
        let mut planes = Vec::new();
        let spacing = |child: u32| nodes[child as usize].record.spacing;
        let (built, _) = build_chunk::parent(kind, open, spacing, parts, &mut planes);
        Ok((planes, built))
    }

    /// Replaces each list of open nodes by their parent.
    fn parents(&mut self, kind: &TreeSpec, lists: Vec<&mut Vec<OpenNode>>) -> Result<()> {
        let this = &*self;
        let made: Vec<(_, &mut Vec<OpenNode>)> = lists
            .into_par_iter()
            .map(|open| Ok((this.parent(&this.nodes, kind, open)?, open)))
            .collect::<Result<_>>()?;
        for ((planes, mut built), open) in made {
            built.record.at = self.end;
            self.writer.put(self.end, &planes)?;
            self.end += planes.len() as u64;
            *open = vec![OpenNode {
                node: self.nodes.len() as u32,
                count: built.record.count,
                samples: None,
            }];
            self.nodes.push(built);
        }
        Ok(())
    }
}

/// A cell of the kd-tree: the number of code bits that it decides, and their value.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cell {
    depth: u32,
    prefix: u128,
}

impl Cell {
    /// Returns the cell that is halved into this one and another; `None` for the whole tree.
    fn parent(self) -> Option<Cell> {
        Some(Cell { depth: self.depth.checked_sub(1)?, prefix: self.prefix >> 1 })
    }

    /// Tests whether the cell is `other` or holds it.
    fn has(self, other: &Cell) -> bool {
        other.depth >= self.depth && other.prefix >> (other.depth - self.depth) == self.prefix
    }
}

/// Open nodes of a cell whose chunks are all placed.
struct OpenCell {
    cell: Cell,
    nodes: Vec<OpenNode>,
}

/// Built chunks being placed in the file, in order.
#[derive(Default)]
struct Placing {
    next: usize,
    waiting: BTreeMap<usize, GrownChunk>,
    end: u64,
    points: u64,
    nodes: Vec<BuiltNode>,
    /// Cells in Morton order; the last may still be joined with the one before.
    open: Vec<OpenCell>,
    /// Of chunks that are not written yet, the range of their nodes, whose samples are kept.
    unwritten: BTreeMap<usize, Range<u32>>,
    failed: bool,
}

/// Stops all threads when dropped.
struct Alarm<'a> {
    placing: &'a Mutex<Placing>,
    placed: &'a Condvar,
}

impl Drop for Alarm<'_> {
    fn drop(&mut self) {
        lock(self.placing).failed = true;
        self.placed.notify_all();
    }
}

impl Placing {
    /// Numbers the next chunk's nodes and places its planes.
    fn place(&mut self, cell: Cell, grown: GrownChunk) -> (u64, Vec<u8>) {
        let (at, first) = (self.end, self.nodes.len() as u32);
        for BuiltNode { mut record, mut children } in grown.nodes {
            record.at += at;
            children.iter_mut().for_each(|child| *child += first);
            self.points += if children.is_empty() { record.points } else { 0 };
            self.nodes.push(BuiltNode { record, children });
        }
        let nodes = grown.open.into_iter().map(|open| OpenNode { node: open.node + first, ..open });
        match self.open.last_mut() {
            // The next piece of many points in one place.
            Some(last) if last.cell == cell => last.nodes.extend(nodes),
            _ => self.open.push(OpenCell { cell, nodes: nodes.collect() }),
        }
        self.unwritten.insert(self.next, first..self.nodes.len() as u32);
        self.end += grown.planes.len() as u64;
        self.next += 1;
        (at, grown.planes)
    }

    /// Drops the samples of a chunk that can be read back now.
    fn written(&mut self, chunk: usize) {
        let Some(own) = self.unwritten.remove(&chunk) else { return };
        let open = self.open.iter_mut().flat_map(|cell| &mut cell.nodes);
        open.filter(|open| own.contains(&open.node)).for_each(|open| open.samples = None);
    }
}

/// Numbers nodes, roots first and siblings side by side behind them.
fn number(built: Vec<BuiltNode>, roots: &[u32]) -> (Vec<NodeRecord>, u32) {
    let mut order: Vec<u32> = roots.to_vec();
    let mut records: Vec<NodeRecord> = Vec::with_capacity(built.len());
    let mut parents: Vec<u32> = (0..roots.len() as u32).collect();
    let mut levels = vec![0u8; roots.len()];
    let mut i = 0;
    while i < order.len() {
        let BuiltNode { record, children } = &built[order[i] as usize];
        let first_child = if children.is_empty() { 0 } else { order.len() as u32 };
        let children_count = children.len() as u32;
        records.push(NodeRecord {
            first_child,
            children: children_count,
            parent: parents[i],
            level: levels[i],
            ..*record
        });
        order.extend(children);
        parents.extend(children.iter().map(|_| i as u32));
        let level = levels[i].saturating_add(1);
        levels.extend(children.iter().map(|_| level));
        i += 1;
    }
    (records, roots.len() as u32)
}

/// Returns the heights at the ends of the colour ramp, from the roots' samples and weights: exact
/// to the size of their cells.
fn elevations(directory: &Directory, writer: &Writer) -> Result<[u32; 2]> {
    let Some([low, high]) = directory.contents.bounds else { return Ok([0, 255]) };
    let mut counts = vec![0u64; 1 << 16];
    for root in &directory.nodes[..directory.roots as usize] {
        let lattice = schema::lattice(root, &directory.contents.lattices);
        for (position, weight) in schema::samples(root, lattice, &mut |plane, bytes| {
            writer.get(root.range(plane).0, bytes)
        })? {
            let level = if high.z > low.z {
                ((position.z - low.z) / (high.z - low.z) * 65_535.0).clamp(0.0, 65_535.0)
            } else {
                0.0
            };
            counts[level as usize] += weight as u64;
        }
    }
    Ok(percentiles(&counts))
}
