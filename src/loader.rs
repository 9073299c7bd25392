//! The loader thread reads nodes of an index into pages.
//!
//! The frame thread posts request lists, and the loader follows the newest (`queue`): requests of
//! an older list that have not been started and are not repeated come back as dropped. Each request
//! is answered with its outcome, and then a callback is called; the frame never waits.
//!
//!   read(request): for every plane: copy it from the file, check the copy, write it to its page
//!
//! Nothing is ever checked on the page itself: mapped device memory may be write-combined,
//! and slow to read.
//!
//! A panic while reading is an error of one node; the thread goes on. A read that takes too long is
//! reported ([`Loader::stalled`]), since a disk or a network folder may hang. Dropping the
//! [`Loader`] lets the thread finish its node and joins it; a hanging thread is left behind, and
//! the creator of the destinations closes them.

use crate::cloud::attribute::{
    Attribute, CODE_SHIFT, DisplayAttribute, STATION_SHIFT, station_code, station_left_out,
};
use crate::cloud::octahedral;
use crate::cloud::scalar::Scalar;
use crate::config::{BITS_PER_PLANE, PATIENCE, PATIENCE_WITH_SERVERS, POINTS_PER_PAGE};
use crate::error::{Error, Result};
use crate::index::attributes::strokes;
use crate::index::fault_injection::FaultKind;
use crate::index::format::scatter::{self, Clump};
use crate::index::format::spacing::spacing;
use crate::index::format::{Index, NodeRecord, PLANES, Plane};
use queue::{Next, Queue};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

mod queue;

mod sync {
    pub use std::sync::{Condvar, Mutex, MutexGuard};
}

/// Destination of a node's pages. It is dropped before the request is answered: from then on the
/// pages are the frame's again.
pub trait Destination: Send {
    /// Writes the first words of a page: position planes from 0 on, then the points' attribute
    /// words.
    fn put(&mut self, page: u32, words: &[u32]);
}

/// A requested node, in the order of the list.
pub type NodeRequest = queue::NodeRequest<Box<dyn Destination>>;

/// Outcome of a request.
#[derive(Debug)]
pub enum Outcome {
    /// The pages have been written.
    Done(Read),
    /// Not started before a newer list left it out.
    Dropped,
    Failed(Error),
}

/// Statistics of a node that was read.
#[derive(Clone, Debug)]
pub struct Read {
    /// Bytes of the file.
    pub bytes: u64,
    /// Point spacing [cells of the coarsest plane].
    pub spacing: f64,
    /// How its points lie.
    pub clumps: Vec<Clump>,
}

#[derive(Debug)]
pub struct Answer {
    pub node: usize,
    pub outcome: Outcome,
}

pub struct Loader {
    queue: Arc<Queue<Box<dyn Destination>>>,
    answers: Receiver<Answer>,
    reading: Arc<Mutex<Reading>>,
    patience: Duration,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Reading {
    /// The node being read, unless it may take long.
    node: Option<usize>,
    /// Start of the current read, and duration of all earlier ones.
    since: Option<Instant>,
    before: Duration,
    /// File in which the system reports the thread's processor time.
    cpu_time_file: Option<PathBuf>,
}

fn lock(reading: &Mutex<Reading>) -> MutexGuard<'_, Reading> {
    reading.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Loader {
    /// Starts the thread, which calls `publish` after every answer.
    pub fn start(
        index: Arc<Index>,
        shown: DisplayAttribute,
        publish: impl FnMut() + Send + 'static,
    ) -> Result<Loader> {
        let (queue, reading) = (Arc::new(Queue::new()), Arc::<Mutex<Reading>>::default());
        let (answer, answers) = channel();
        let path = index.path().to_owned();
        let patience = if index.is_remote() { PATIENCE_WITH_SERVERS } else { PATIENCE };
        let words = vec![0; POINTS_PER_PAGE as usize];
        let faces = index.has_faces();
        let thread = Thread {
            index,
            faces,
            shown,
            queue: queue.clone(),
            reading: reading.clone(),
            answer,
            publish,
            words,
            bytes: Vec::new(),
            nodes: 0,
        };
        let thread = std::thread::Builder::new().name("loader".into()).spawn(move || thread.run());
        let thread = thread.map_err(|error| Error::io("start a thread to read", &path, error))?;
        Ok(Loader { queue, answers, reading, patience, thread: Some(thread) })
    }

    /// Replaces the request list.
    pub fn post(&self, requests: Vec<NodeRequest>) {
        // If the thread is gone, `answer` and `wait` report it.
        self.queue.post(requests);
    }

    /// Returns the longest read that is not reported.
    pub fn patience(&self) -> Duration {
        self.patience
    }

    /// Returns the node whose read takes too long.
    pub fn stalled(&self) -> Option<usize> {
        let reading = lock(&self.reading);
        reading.node.filter(|_| reading.since.is_some_and(|since| since.elapsed() >= self.patience))
    }

    /// Returns the thread's processor time since the start, to a tick of the system's clock; 0 once
    /// it has ended. On systems other than Linux, the time spent reading, waiting included.
    pub fn worked(&self) -> Duration {
        let reading = lock(&self.reading);
        match &reading.cpu_time_file {
            Some(cpu_time_file) => processor_time(cpu_time_file).unwrap_or_default(),
            None => reading.before + reading.since.map_or(Duration::ZERO, |since| since.elapsed()),
        }
    }

    /// Returns an answer that has arrived; errors if the thread is gone.
    pub fn answer(&self) -> Result<Option<Answer>> {
        match self.answers.try_recv() {
            Ok(answer) => Ok(Some(answer)),
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(gone()),
        }
    }

    /// Returns whether the thread has ended, which only a panic outside of any node causes.
    pub fn has_ended(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Returns the next answer, or `None` after `at_most`.
    pub fn wait(&self, at_most: Duration) -> Result<Option<Answer>> {
        match self.answers.recv_timeout(at_most) {
            Ok(answer) => Ok(Some(answer)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(gone()),
        }
    }
}

/// Returns the file in which Linux reports this thread's processor time `[ns]`, the first number of
/// three.
fn cpu_time_file() -> Option<PathBuf> {
    let thread = std::fs::read_link("/proc/thread-self").ok()?;
    let cpu_time_file = Path::new("/proc").join(thread).join("schedstat");
    processor_time(&cpu_time_file).map(|_| cpu_time_file)
}

fn processor_time(cpu_time_file: &Path) -> Option<Duration> {
    let text = std::fs::read_to_string(cpu_time_file).ok()?;
    text.split_whitespace().next()?.parse().ok().map(Duration::from_nanos)
}

fn gone() -> Error {
    Error::Request("the thread that reads the index has ended".into())
}

impl Drop for Loader {
    fn drop(&mut self) {
        self.queue.close();
        let until = Instant::now() + PATIENCE;
        let ended = loop {
            match self.answers.recv_timeout(until.saturating_duration_since(Instant::now())) {
                Ok(_) => {}
                Err(RecvTimeoutError::Disconnected) => break true,
                Err(RecvTimeoutError::Timeout) => break false,
            }
        };
        if let Some(thread) = self.thread.take().filter(|_| ended) {
            // A panic outside of a node has been reported by `answer` or `wait`.
            let _ = thread.join();
        }
    }
}

struct Thread<P> {
    index: Arc<Index>,
    /// True if faces join the points of all files.
    faces: bool,
    shown: DisplayAttribute,
    queue: Arc<Queue<Box<dyn Destination>>>,
    reading: Arc<Mutex<Reading>>,
    answer: Sender<Answer>,
    publish: P,
    /// Scratch for one plane of one node.
    words: Vec<u32>,
    bytes: Vec<u8>,
    /// Nodes read or attempted.
    nodes: u64,
}

impl<P: FnMut()> Thread<P> {
    fn run(mut self) {
        lock(&self.reading).cpu_time_file = cpu_time_file();
        while let Some(next) = self.queue.next() {
            // Those behind this one come from a server while it is read.
            if self.index.is_remote()
                && let Some(list) = self.queue.newest()
            {
                let own = match &next {
                    Next::Read { node, planes, .. } => Some((*node, *planes)),
                    Next::Dropped { .. } => None,
                };
                self.announce(own.into_iter().chain(list));
            }
            let (node, outcome) = match next {
                // The pages return to the frame before it gets the answer.
                Next::Dropped { node, destination } => {
                    drop(destination);
                    (node, Outcome::Dropped)
                }
                Next::Read { node, planes, destination } => {
                    (node, self.attempt(node, planes, destination))
                }
            };
            // The receiver is gone if the loader is being dropped.
            let _ = self.answer.send(Answer { node, outcome });
            (self.publish)();
        }
    }

    fn attempt(
        &mut self,
        node: usize,
        planes: u32,
        mut destination: Box<dyn Destination>,
    ) -> Outcome {
        self.nodes += 1;
        let fault = self.index.fault.and_then(|fault| fault.at(self.nodes));
        assert!(fault != Some(FaultKind::End), "on purpose, between two nodes");
        self.watch(Some(node));
        let read = catch_unwind(AssertUnwindSafe(|| {
            assert!(fault != Some(FaultKind::Panic), "on purpose");
            while fault == Some(FaultKind::Hang) {
                std::thread::park();
            }
            if fault == Some(FaultKind::Slow) {
                std::thread::sleep(2 * PATIENCE);
            }
            self.read(node, planes, &mut *destination)
        }));
        self.watch(None);
        drop(destination);
        let read = read.unwrap_or_else(|panic| {
            let said = panic
                .downcast_ref::<&str>()
                .map(|said| said.to_string())
                .or(panic.downcast_ref::<String>().cloned());
            let what = format!(
                "node {node} could not be read: {}",
                said.unwrap_or("an unknown panic".into())
            );
            Err(Error::format(self.index.path(), what))
        });
        read.map_or_else(Outcome::Failed, Outcome::Done)
    }

    /// Announces nodes that will be read, with the planes that are looked at.
    fn announce(&self, list: impl Iterator<Item = (usize, u32)>) {
        let shown = &self.shown;
        let elevation = shown.attribute == Attribute::Elevation;
        let mut extra = Plane::of(shown.attribute).to_vec();
        let kinds: &[Plane] =
            if shown.kind().is_some() { &[Plane::Class, Plane::Returns] } else { &[] };
        let stations = shown.kind().is_some() || shown.coded;
        let normals = if shown.normal().is_some() { &NORMALS[..] } else { &[] };
        let strokes = shown.strokes().map(|_| [Plane::Facing, Plane::Brush]);
        extra.extend(kinds.iter().chain(normals).copied());
        extra.extend(stations.then_some(Plane::STATIONS).into_iter().flatten());
        extra.extend(strokes.into_iter().flatten());
        let planes_of = |(node, planes): (usize, u32)| {
            let record = &self.index.nodes()[node];
            let planes = if elevation { record.position_planes() } else { planes };
            let positions = PLANES.iter().take(planes as usize).map(|(plane, _)| *plane);
            let extra = extra.iter().copied().filter(|&plane| record.has(plane));
            (node, positions.chain(extra).collect())
        };
        self.index.ahead(&list.map(planes_of).collect::<Vec<_>>());
    }

    /// Starts timing the read of a node, or stops it.
    fn watch(&self, node: Option<usize>) {
        let mut reading = lock(&self.reading);
        let took = reading.since.map_or(Duration::ZERO, |since| since.elapsed());
        reading.before += took;
        (reading.node, reading.since) = (node, node.map(|_| Instant::now()));
    }

    fn read(
        &mut self,
        node: usize,
        planes: u32,
        destination: &mut dyn Destination,
    ) -> Result<Read> {
        let index = self.index.clone();
        let record = &index.nodes()[node];
        let count = record.count as usize;
        let words = &mut self.words[..count];
        let elevation = self.shown.attribute == Attribute::Elevation;
        let along = self.shown.up.index() as u32 * BITS_PER_PLANE;
        let mut heights = vec![0u32; if elevation { count } else { 0 }];
        let mut read = Read { bytes: 0, spacing: 0.0, clumps: Vec::new() };
        // Elevation uses the whole position, independent of the planes that are drawn.
        let needed = if elevation { record.position_planes() } else { planes };
        for (page, &(plane, _)) in (0..needed).zip(&PLANES) {
            read.bytes += index.read(node, plane, bytemuck::cast_slice_mut(words))?;
            if page == 0 {
                let step = index.lattice(record).step;
                read.spacing = spacing(words);
                read.clumps = scatter::clumps(words, record.bits as u32, step, self.faces);
            }
            if page < planes {
                destination.put(page, words);
            }
            heights.iter_mut().zip(&*words).for_each(|(height, word)| {
                *height = *height << BITS_PER_PLANE | (word >> along) & ((1 << BITS_PER_PLANE) - 1)
            });
        }
        let above = Attribute::Scalar(Scalar::HeightAboveGround);
        let is_above = self.shown.attribute == above && index.ground.is_some();
        let planes_of = if is_above { &[][..] } else { Plane::of(self.shown.attribute) };
        match planes_of.iter().copied().find(|&plane| record.has(plane)) {
            Some(plane) => {
                self.bytes.resize(record.unpacked_bytes(plane) as usize, 0);
                read.bytes += index.read(node, plane, &mut self.bytes)?;
                match plane {
                    Plane::GpsTime => {
                        let numbers =
                            self.bytes.as_chunks().0.iter().map(|&v| f64::from_le_bytes(v));
                        words
                            .iter_mut()
                            .zip(numbers)
                            .for_each(|(word, v)| *word = self.shown.place(v));
                    }
                    _ => widen(plane, &self.bytes, words),
                }
                if Plane::STATIONS.contains(&plane) {
                    // The file's own station number; nodes store its place in the list.
                    let stations = &index.directory.contents.stations;
                    words.iter_mut().for_each(|word| {
                        *word = stations
                            .get(*word as usize)
                            .and_then(|station| station.source)
                            .unwrap_or(0) as u32
                    });
                }
                if self.shown.coded && Plane::STATIONS.into_iter().any(|plane| record.has(plane)) {
                    let mut stations = vec![0; count];
                    read.bytes += gather(
                        &index,
                        node,
                        &Plane::STATIONS.map(|plane| (plane, 0)),
                        &mut self.bytes,
                        &mut stations,
                    )?;
                    let codes =
                        stations.into_iter().map(|station| station_code(station as usize) as u32);
                    words
                        .iter_mut()
                        .zip(codes)
                        .for_each(|(word, code)| *word |= code << CODE_SHIFT);
                }
            }
            None if is_above => {
                let columns = index.columns(node, above.wanted())?;
                let numbers = above.numbers_of(&columns).into_iter().flatten();
                words.iter_mut().zip(numbers).for_each(|(word, &v)| *word = self.shown.place(v));
            }
            None if elevation => {
                let height = world_height(&index, record, self.shown.up.index());
                words
                    .iter_mut()
                    .zip(&heights)
                    .for_each(|(word, &cell)| *word = self.shown.place(height(cell)));
            }
            None => words.fill(lacking(self.shown.attribute)),
        }
        destination.put(planes, words);
        if let Some(word) = self.shown.kind() {
            let [station, source] = Plane::STATIONS.map(|plane| (plane, STATION_SHIFT));
            let parts = [(Plane::Class, 0), (Plane::Returns, 8), station, source];
            words.fill(0);
            read.bytes += gather(&index, node, &parts, &mut self.bytes, words)?;
            if let Some(filter) = &index.filter {
                let out = station_left_out(index.directory.contents.stations.len());
                let left = index.left(node, filter)?;
                words
                    .iter_mut()
                    .zip(left)
                    .filter(|(_, left)| !left)
                    .for_each(|(word, _)| *word = out << STATION_SHIFT);
            }
            destination.put(planes + word, words);
        }
        if let Some(word) = self.shown.normal() {
            read.bytes += normals(&index, node, &mut self.bytes, words)?;
            destination.put(planes + word, words);
        }
        if let Some(word) = self.shown.strokes() {
            if record.has(Plane::Brush) {
                for (k, plane) in [Plane::Facing, Plane::Brush].into_iter().enumerate() {
                    read.bytes += index.read(node, plane, bytemuck::cast_slice_mut(words))?;
                    destination.put(planes + word + k as u32, words);
                }
            } else {
                // Computing strokes may take long without being stalled.
                lock(&self.reading).node = None;
                let (strokes, bytes) = strokes::of_node(&index, node)?;
                read.bytes += bytes;
                for k in 0..2 {
                    words.iter_mut().zip(&strokes).for_each(|(word, stroke)| *word = stroke[k]);
                    destination.put(planes + word + k as u32, words);
                }
            }
        }
        if let (Some(word), Some(shadows)) = (self.shown.light(), &index.shadows) {
            self.bytes.resize(count, 0);
            shadows.read(node, &mut self.bytes)?;
            read.bytes += count as u64;
            words.iter_mut().zip(&self.bytes).for_each(|(word, &value)| *word = value as u32);
            destination.put(planes + word, words);
        }
        Ok(read)
    }
}

/// Adds planes to words, each shifted; missing planes add nothing. Returns the bytes read.
fn gather(
    index: &Index,
    node: usize,
    parts: &[(Plane, u32)],
    bytes: &mut Vec<u8>,
    words: &mut [u32],
) -> Result<u64> {
    let record = &index.nodes()[node];
    let (mut read, mut own) = (0, vec![0; words.len()]);
    for &(plane, shift) in parts.iter().filter(|(plane, _)| record.has(*plane)) {
        bytes.resize(record.unpacked_bytes(plane) as usize, 0);
        read += index.read(node, plane, bytes)?;
        widen(plane, bytes, &mut own);
        words.iter_mut().zip(&own).for_each(|(word, own)| *word |= own << shift);
    }
    Ok(read)
}

/// Planes of normals, the first that a node has.
const NORMALS: [Plane; 2] = [Plane::Facing, Plane::Normal];

/// Reads a node's normals: derived ones, else those of its files, else unknown. Returns the bytes
/// read.
fn normals(index: &Index, node: usize, bytes: &mut Vec<u8>, words: &mut [u32]) -> Result<u64> {
    let record = &index.nodes()[node];
    words.fill(octahedral::UNKNOWN);
    let Some(plane) = NORMALS.into_iter().find(|&plane| record.has(plane)) else {
        return Ok(0);
    };
    bytes.resize(record.range(plane).1 as usize, 0);
    let read = index.read(node, plane, bytes)?;
    match plane {
        Plane::Facing => words
            .iter_mut()
            .zip(bytes.as_chunks().0)
            .for_each(|(word, &facing)| *word = u32::from_le_bytes(facing) & octahedral::UNKNOWN),
        _ => words
            .iter_mut()
            .zip(bytes.as_chunks().0)
            .for_each(|(word, normal)| *word = octahedral::of_bytes(normal.map(|v| v as i8))),
    }
    Ok(read)
}

/// Returns the world coordinate of a cell along an axis, given with all planes.
fn world_height(index: &Index, record: &NodeRecord, axis: usize) -> impl Fn(u32) -> f64 {
    let lattice = index.lattice(record);
    let (lowest, pad) =
        (record.origin[axis], BITS_PER_PLANE * record.position_planes() - record.bits as u32);
    move |cell| lattice.offset[axis] + lattice.step[axis] * (lowest + (cell >> pad) as i64) as f64
}

/// Widens a plane's values to words, as [`DisplayAttribute::word`] does.
fn widen(plane: Plane, bytes: &[u8], words: &mut [u32]) {
    let three = |[a, b, c]: [u8; 3]| a as u32 | (b as u32) << 8 | (c as u32) << 16;
    match plane {
        Plane::Rgb | Plane::Corrected => {
            words.iter_mut().zip(bytes.as_chunks().0).for_each(|(word, &rgb)| *word = three(rgb))
        }
        Plane::Normal => {
            let shifted = |v: [u8; 3]| v.map(|c| (c as i8 as i16 + 127) as u8);
            words
                .iter_mut()
                .zip(bytes.as_chunks().0)
                .for_each(|(word, &normal)| *word = three(shifted(normal)));
        }
        Plane::Facing => {
            let shown = |facing: [u8; 4]| {
                octahedral::unpack(u32::from_le_bytes(facing))
                    .map_or(lacking(Attribute::Normal), |n| {
                        three((n * 127.0).round().to_array().map(|c| (c + 127.0) as u8))
                    })
            };
            words
                .iter_mut()
                .zip(bytes.as_chunks().0)
                .for_each(|(word, &facing)| *word = shown(facing));
        }
        Plane::Intensity | Plane::Source => {
            words
                .iter_mut()
                .zip(bytes.as_chunks().0)
                .for_each(|(word, &value)| *word = u16::from_le_bytes(value) as u32);
        }
        Plane::Returns => {
            words.iter_mut().zip(bytes).for_each(|(word, value)| *word = (value & 15) as u32)
        }
        _ => words.iter_mut().zip(bytes).for_each(|(word, value)| *word = *value as u32),
    }
}

/// Returns the value of points without the attribute.
fn lacking(attribute: Attribute) -> u32 {
    match attribute {
        Attribute::Rgb | Attribute::Corrected => 0xFFFFFF,
        Attribute::Normal => 0x7F7F7F,
        _ => 0,
    }
}
