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
mod job;
mod kd_cell;
mod merge_lattices;
mod morton_sort;
pub mod pack;
mod part_file;
pub mod partition;
pub mod plan;
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
use crate::cloud::stream::{self, Source};
use crate::error::{Error, Result};
use crate::progress::Progress;
use build_chunk::{BuiltNode, GrownChunk, OpenNode, TreeLayout, TreeSpec, Worker};
pub use builder::Options;
use builder::{Builder, Survey, lock};
use ingest::{Chunk, Gridded, Ingested, group};
pub use job::{JobSummary, job, merge};
use kd_cell::KdCell;
use rayon::prelude::*;
use spill_bucket::{Grid, Spill};
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
    with_threads(options, |options| {
        let (sources, contents) = open(paths, options, progress)?;
        let writer = Writer::create(output)?;
        let spill = Spill::new(output, options.bucket_bytes())?;
        let mut survey = Survey::new(&sources, options, progress, &spill, contents);
        let trees = group(&sources)
            .into_iter()
            .map(|group| {
                let limit = options.chunk_points();
                let collector =
                    |bits, layout| Gridded { grid: Grid::new(bits, layout, limit), spill: &spill };
                let (ingested, Gridded { grid, .. }) = survey.ingest(group, &collector)?;
                let chunks = survey.cut(grid, ingested.tree.layout)?;
                Ok((ingested, chunks))
            })
            .collect::<Result<Vec<_>>>()?;
        let read_seconds = began.elapsed().as_secs_f64();
        survey.settle(
            trees.iter().map(|(ingested, chunks)| (ingested, chunks)),
            |survey, _, chunks, look| survey.look(chunks, look),
        )?;
        let mut builder = Builder::new(survey, &writer);
        for (ingested, chunks) in trees {
            let is_of_strays = ingested.is_of_strays(&sources);
            builder.tree(ingested.tree, is_of_strays, ingested.points, chunks)?;
        }
        let complete = builder.complete()?;
        let summary = complete.write(writer, options, progress)?;
        let (spilled_bytes, seconds) = (spill.bytes_on_disk(), began.elapsed().as_secs_f64());
        Ok(Summary { read_seconds, spilled_bytes, seconds, ..summary })
    })
}

/// Runs on the threads of the options.
fn with_threads<T: Send>(
    options: &Options,
    run: impl FnOnce(&Options) -> Result<T> + Send,
) -> Result<T> {
    let options = Options { threads: options.threads.max(1), ..*options };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads).build();
    let pool = pool.map_err(|error| {
        Error::Request(format!("cannot start {} threads: {error}", options.threads))
    })?;
    pool.install(|| run(&options))
}

/// Opens files, and begins their description.
fn open(
    paths: &[PathBuf],
    options: &Options,
    progress: &dyn Progress,
) -> Result<(Vec<Source>, Contents)> {
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
    let scalar = sources.iter().find_map(|source| source.available().scalars.iter().next());
    let scalar = scalar.map(|scalar| scalar.to_string());
    Ok((sources, Contents { notes, scalar, ..Contents::default() }))
}

/// All nodes of an index, numbered.
struct Complete {
    directory: Directory,
    corners: Vec<[i64; 3]>,
    /// End of the planes.
    end: u64,
}

impl Complete {
    /// Derives what depends on neighbours, and writes the directory.
    fn write(self, writer: Writer, options: &Options, progress: &dyn Progress) -> Result<Summary> {
        let Complete { mut directory, corners, end } = self;
        let Directory { nodes, contents, .. } = &directory;
        let mut summary = Summary {
            points: contents.points,
            nodes: nodes.len(),
            leaves: nodes.iter().filter(|node| node.is_leaf()).count(),
            core_bytes: nodes.iter().map(core_bytes).sum(),
            held_bytes_per_point: (nodes.len() * HELD_BYTES_PER_NODE) as f64
                / contents.points.max(1) as f64,
            ..Summary::default()
        };
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
        Ok(summary)
    }
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

impl Survey<'_> {
    /// Finds what nodes need to know of all files: stations and their gains. `records` passes all
    /// records of a tree to a function.
    fn settle<'t, T>(
        &mut self,
        trees: impl Iterator<Item = (&'t Ingested, T)> + Clone,
        records: impl Fn(&Survey, &Ingested, T, &(dyn Fn(&[u8]) + Sync)) -> Result<()>,
    ) -> Result<()> {
        self.stations(trees.clone().map(|(ingested, _)| ingested))?;
        self.contents.intensity_stretch = percentiles(&self.intensities);
        let tones = std::mem::take(&mut self.tones);
        self.contents.tones = if tones.iter().any(|&n| n > 0) { tones } else { Vec::new() };
        let [colors, intensities] =
            self.balances(trees, |ingested, of, look| records(self, ingested, of, look))?;
        (self.contents.balance, self.contents.intensity_balance) = (colors, intensities);
        self.contents.counts = Some(self.tally.counts());
        self.contents.parts = std::mem::take(&mut self.parts).into_iter().flatten().collect();
        self.balance();
        Ok(())
    }

    /// Prepares the gains for nodes.
    fn balance(&mut self) {
        let Contents { balance, intensity_balance, .. } = &self.contents;
        self.gains = Some(Arc::new(Gains::new(balance.as_ref(), intensity_balance.as_ref())));
    }
}

impl Builder<'_> {
    /// Builds and writes one group's tree.
    fn tree(
        &mut self,
        mut tree: TreeLayout,
        is_of_strays: bool,
        points: u64,
        chunks: Vec<Chunk>,
    ) -> Result<()> {
        if points == 0 {
            return Ok(());
        }
        tree.kind.gains = self.survey.gains.clone();
        let open = self.grow(&tree, chunks, points, KdCell::ALL)?;
        self.root(&open, is_of_strays);
        Ok(())
    }

    /// Adds the root of a tree.
    fn root(&mut self, open: &[OpenNode], is_of_strays: bool) {
        let roots = if is_of_strays { &mut self.far_roots } else { &mut self.roots };
        roots.extend(open.iter().map(|open| open.node));
    }

    /// Joins the trees, and numbers all nodes.
    fn complete(mut self) -> Result<Complete> {
        self.unite()?;
        // Strays have no parent in common with the others, which would show them as one place.
        self.roots.append(&mut self.far_roots);
        let Builder { survey: Survey { contents, corners, .. }, nodes, roots, end, .. } = self;
        let (nodes, roots) = number(nodes, &roots);
        Ok(Complete { directory: Directory { nodes, roots, contents }, corners, end })
    }

    /// Builds the chunks of a cell on all threads, and the nodes above them. Writes planes in the
    /// order of the tree. Returns the open nodes of the cell: the root, if it is the whole tree.
    fn grow(
        &mut self,
        tree: &TreeLayout,
        chunks: Vec<Chunk>,
        points: u64,
        within: KdCell,
    ) -> Result<Vec<OpenNode>> {
        let count = chunks.len();
        // Cells of chunks with few points may be larger.
        let cells: Vec<KdCell> = chunks.iter().map(|chunk| chunk.cell.within(within)).collect();
        let chunks: Vec<Mutex<Option<Chunk>>> =
            chunks.into_iter().map(|chunk| Mutex::new(Some(chunk))).collect();
        let next = AtomicUsize::new(0);
        let placing = Mutex::new(Placing {
            end: self.end,
            nodes: std::mem::take(&mut self.nodes),
            ..Placing::default()
        });
        let placed = Condvar::new();
        let (this, progress) = (&*self, self.survey.progress);
        let threads = self.survey.options.threads;
        let work = || -> Result<()> {
            let mut worker = Worker::default();
            let station = this.survey.numbered();
            loop {
                let number = next.fetch_add(1, Relaxed);
                if number >= count {
                    return Ok(());
                }
                let chunk = lock(&chunks[number]).take().expect("each chunk is taken once");
                let grown = worker.grow(
                    tree,
                    &this.survey.colors,
                    cells[number].depth,
                    chunk.buckets,
                    &station,
                    this.survey.spill,
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
                    let GrownChunk { planes, nodes, open } = grown;
                    let at = state.place(cells[next], nodes, open, planes.len() as u64);
                    writes.push((next, (at, planes)));
                    this.ascend(&mut state, &tree.kind, cells.get(next + 1), within)?;
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
        Ok(self.placed(placing.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner())))
    }

    /// Takes what has been placed. Returns the open nodes.
    fn placed(&mut self, placing: Placing) -> Vec<OpenNode> {
        (self.end, self.nodes) = (placing.end, placing.nodes);
        placing.open.into_iter().flat_map(|open| open.nodes).collect()
    }

    /// Joins the open nodes of cells that no further chunk lies in, and makes and writes their
    /// parents, up to the cell `within`. `next` is the cell of the next chunk, if any.
    fn ascend(
        &self,
        state: &mut Placing,
        kind: &TreeSpec,
        next: Option<&KdCell>,
        within: KdCell,
    ) -> Result<()> {
        while let Some(top) = state.open.pop_if(|top| {
            let parent = top.cell.parent().filter(|parent| within.has(parent));
            parent.is_some_and(|parent| next.is_none_or(|next| !parent.has(next)))
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
            && within == KdCell::ALL
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
            merge_lattices::over(&records, &self.survey.contents, self.survey.options.derive)
        else {
            return Ok(());
        };
        kind.lattice_number = self.survey.lattice(&kind.lattice, kind.corner)?;
        kind.gains = self.survey.gains.clone();
        let open = |&place: &usize| {
            let node = self.roots[place];
            OpenNode { node, count: self.nodes[node as usize].record.count, samples: None }
        };
        let mut open: Vec<OpenNode> = order.iter().map(open).collect();
        while open.len() > 1 {
            let mut lists = merge_lattices::lists(open);
            for some in lists.chunks_mut(4 * self.survey.options.threads) {
                self.survey.progress.tick("joining", 0, 1)?;
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
            let corner = self.survey.corners[record.lattice as usize];
            let samples = Samples::unpack(record, corner, &samples::within(record, &planes));
            let is_own = record.lattice / 2 == kind.lattice_number / 2;
            let lattices = &self.survey.contents.lattices;
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

/// Open nodes of a cell whose chunks are all placed.
struct OpenCell {
    cell: KdCell,
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
    /// Range of the nodes of chunks that are not written yet, whose samples are kept.
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
    /// Numbers the next nodes of a cell and places their planes, of this many bytes. Returns where.
    fn place(
        &mut self,
        cell: KdCell,
        nodes: Vec<BuiltNode>,
        open: Vec<OpenNode>,
        bytes: u64,
    ) -> u64 {
        let (at, first) = (self.end, self.nodes.len() as u32);
        for BuiltNode { mut record, mut children } in nodes {
            record.at += at;
            children.iter_mut().for_each(|child| *child += first);
            self.points += if children.is_empty() { record.points } else { 0 };
            self.nodes.push(BuiltNode { record, children });
        }
        let nodes = open.into_iter().map(|open| OpenNode { node: open.node + first, ..open });
        match self.open.last_mut() {
            // The next piece of many points in one place.
            Some(last) if last.cell == cell => last.nodes.extend(nodes),
            _ => self.open.push(OpenCell { cell, nodes: nodes.collect() }),
        }
        self.unwritten.insert(self.next, first..self.nodes.len() as u32);
        self.end += bytes;
        self.next += 1;
        at
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
