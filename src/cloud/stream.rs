//! Files in batches, for clouds larger than memory.
//!
//! [`open`] returns a [`Source`] per part, from which points can be streamed repeatedly. LAS, LAZ
//! and octrees are read anew each time, by the code that fills whole columns in `las`, but into
//! lanes one batch long: only a batch, a block and a compressed chunk per thread are in memory.
//! Other formats derive their lattice from all points (`from_floats`), so [`open`] reads them
//! through, and their source holds the columns of half a million points; those of more are in a
//! temporary file. Notes and errors are those of [`super::read`]; [`Streamed`] has
//! what only the points can tell. [`Source::stream_in_order`] gives batches in the file's order.

use super::column_file::ColumnFile;
use super::crs::{self, plane::Plane};
use super::from_floats::{OnDisk, ReadPart};
use super::input::{Input, Meter};
use super::las::octree;
use super::las::records::{self, Fields, Lane, Pile};
use super::las::{self, Las, Places};
use super::rgb_range::{Occurred, Scale};
use super::{ColumnSet, Columns, Header, Lattice, Part, ReadOptions, SAMPLE};
use crate::error::{Error, Result};
use crate::progress::Progress;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

/// Most points of a batch.
pub const BATCH: usize = 65_536;

/// One part to stream: a file, or a scan of an E57 file. Holds no file open.
pub struct Source {
    path: PathBuf,
    strict: bool,
    /// Lattice that points are drawn on: the file's own, or that on a local plane for angles.
    lattice: Lattice,
    /// Notes on the coordinate system.
    notes: Vec<String>,
    contents: Contents,
}

enum Contents {
    Las {
        las: Box<Las>,
        /// Length of the file when opened `[bytes]`.
        length: u64,
    },
    Part(Box<Part>),
    /// A part whose columns are in a temporary file, and those of them that are read.
    OnDisk(Box<Part>, Arc<OnDisk>, ColumnSet),
}

/// A batch of a source's points.
pub struct Batch<'a> {
    pub columns: &'a Columns,
    /// Index of its first point in the file.
    pub first: u64,
    /// The points as LAS records, if requested ([`ReadOptions::records`]); their coordinates are
    /// those of the file, before a negative scale is replaced.
    pub records: &'a [u8],
}

/// Stretches or batches that are in memory at a time, for each thread, if order matters.
const IN_ORDER: usize = 4;

/// Distance from a step that is due to the rounding of a header's bounds [lattice steps].
const ROUNDED: f64 = 1e-3;

/// A summary of all streamed points.
pub struct Streamed {
    pub points: u64,
    /// Range of the file's colour channels.
    pub rgb_scale: Scale,
    /// True if the colours of batches are wrong, since all points together show another range. The
    /// next call has the right ones.
    pub again: bool,
    /// Columns of the batches, without colours that were all 0.
    pub available: ColumnSet,
    /// The box around the points [lattice steps]; `None` if there are none.
    pub bounds: Option<[[i32; 3]; 2]>,
    pub notes: Vec<String>,
}

/// Opens `paths` in their order. Errors if any file cannot be read at all.
pub fn open(
    paths: &[PathBuf],
    options: &ReadOptions,
    progress: &dyn Progress,
    notes: &mut Vec<String>,
) -> Result<Vec<Source>> {
    let (mut sources, mut plane) = (Vec::new(), None);
    let column_file = Arc::new(ColumnFile::new());
    let interrupted = Arc::downgrade(&column_file);
    let interrupt = move || interrupted.upgrade().iter().for_each(|file| file.interrupt());
    progress.when_interrupted(Box::new(interrupt));
    for path in paths {
        let input = Input::open_slowly(path, progress)?.counting_to(options.rgb_range);
        if !octree::is_one(&input)? {
            input.download(progress)?;
        }
        let own = input.path.clone();
        let mut push = |contents| -> Result<()> {
            sources.push(Source::new(&own, options, contents, &mut plane)?);
            Ok(())
        };
        if las::is_one(&input)? {
            notes.extend(options.text.idle(&input));
            let las = Box::new(Las::open_for(&input, options.wanted, options.records, notes)?);
            push(Contents::Las { las, length: input.length })?;
        } else {
            let input = input.spilling_to(&column_file);
            for ReadPart { part, on_disk } in super::read_one(&input, options, progress, notes)? {
                let part = Box::new(part);
                push(match on_disk {
                    None => Contents::Part(part),
                    Some(points) => Contents::OnDisk(part, points, options.wanted),
                })?;
            }
        }
    }
    notes.extend(crs::differences(sources.iter().map(Source::header)));
    Ok(sources)
}

/// The size of files, before reading them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FileSummary {
    pub points: u64,
    /// Points to decompress.
    pub compressed: u64,
}

/// Estimates how many points files hold: from their headers, or from their lengths for formats
/// without a count.
pub fn summary(paths: &[PathBuf]) -> Result<FileSummary> {
    /// Bytes per point to estimate with: position and colour; text takes more.
    const BYTES_PER_POINT: u64 = 16;
    let mut about = FileSummary::default();
    for path in paths {
        let input = Input::open(path)?;
        if !las::is_one(&input)? {
            about.points += input.length / BYTES_PER_POINT;
            continue;
        }
        let las = Las::open(&input, ColumnSet::default(), &mut Vec::new())?;
        about.points += las.points();
        about.compressed += if las.layout.compressed { las.points() } else { 0 };
    }
    Ok(about)
}

impl Source {
    fn new(
        path: &Path,
        options: &ReadOptions,
        mut contents: Contents,
        plane: &mut Option<Plane>,
    ) -> Result<Source> {
        let (lattice, title, header) = match &mut contents {
            Contents::Las { las, .. } => {
                (las.layout.lattice, super::title(None, path), &mut las.layout.header)
            }
            Contents::Part(part) => {
                part.look_around();
                (part.lattice, part.title(), &mut part.header)
            }
            Contents::OnDisk(part, points, _) => {
                if part.header.lacks_sample() {
                    part.header.sample = part.sample(points.every(SAMPLE)?.into_iter());
                }
                (part.lattice, part.title(), &mut part.header)
            }
        };
        let mut notes = Vec::new();
        let lattice = crs::settle(header, lattice, plane, &title, &mut notes);
        Ok(Source { path: path.to_owned(), strict: options.strict, lattice, notes, contents })
    }

    /// Returns a part that was read whole, whose notes were given then.
    pub fn of_part(part: Part) -> Source {
        Source {
            path: part.path.clone(),
            strict: false,
            lattice: part.lattice,
            notes: Vec::new(),
            contents: Contents::Part(Box::new(part)),
        }
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    pub fn is_las(&self) -> bool {
        self.las().is_some()
    }

    /// Returns the LAS file.
    pub fn las(&self) -> Option<&Las> {
        match &self.contents {
            Contents::Las { las, .. } => Some(las),
            Contents::Part(_) | Contents::OnDisk(..) => None,
        }
    }

    /// Returns the scan's own name within its file, if any.
    pub fn name(&self) -> Option<&str> {
        match &self.contents {
            Contents::Las { .. } => None,
            Contents::Part(part) | Contents::OnDisk(part, ..) => part.name.as_deref(),
        }
    }

    /// Returns the scan's own name, or the file's.
    pub fn title(&self) -> String {
        let title = super::title(self.name(), &self.path);
        if self.header().strays { format!("{title}, far outside") } else { title }
    }

    pub fn header(&self) -> &Header {
        match &self.contents {
            Contents::Las { las, .. } => &las.layout.header,
            Contents::Part(part) | Contents::OnDisk(part, ..) => &part.header,
        }
    }

    pub fn lattice(&self) -> Lattice {
        self.lattice
    }

    /// Returns the file's lattice, before angles become metres.
    pub fn own_lattice(&self) -> Lattice {
        match &self.contents {
            Contents::Las { las, .. } => las.layout.lattice,
            Contents::Part(part) | Contents::OnDisk(part, ..) => part.lattice,
        }
    }

    /// Returns the range as [`Part::intensity_range`].
    pub fn intensity_range(&self) -> [f64; 2] {
        match &self.contents {
            Contents::Las { .. } => las::INTENSITY_RANGE,
            Contents::Part(part) | Contents::OnDisk(part, ..) => part.intensity_range,
        }
    }

    /// Returns the range as [`Part::rgb_scale`]; for LAS by a sample, until all points have been
    /// streamed.
    pub fn rgb_scale(&self) -> Scale {
        match &self.contents {
            Contents::Las { las, .. } => las.scale(),
            Contents::Part(part) | Contents::OnDisk(part, ..) => part.rgb_scale,
        }
    }

    /// Returns the number of points: for LAS the header's, limited by the file's length; exact for
    /// other formats.
    pub fn points(&self) -> u64 {
        match &self.contents {
            Contents::Las { las, .. } => las.points(),
            Contents::Part(part) => part.columns.len() as u64,
            Contents::OnDisk(_, points, _) => points.len() as u64,
        }
    }

    /// Returns the header's bounds in lattice steps, rounded outwards where they are more than
    /// rounding away from a step, if finite, ordered and on the lattice; they may still be wrong.
    /// For formats other than LAS, the points' own.
    pub fn stated_bounds(&self) -> Option<[[i32; 3]; 2]> {
        match &self.contents {
            Contents::Las { las, .. } => {
                let lattice = las.layout.lattice;
                let steps = |corner| (DVec3::from_array(corner) - lattice.offset) / lattice.step;
                let [lo, hi] = las.layout.header.bounds?;
                let (lo, hi) = ((steps(lo) + ROUNDED).floor(), (steps(hi) - ROUNDED).ceil());
                let fits = lo.cmple(hi).all()
                    && lo.min_element() >= i32::MIN as f64
                    && hi.max_element() <= i32::MAX as f64;
                fits.then(|| [lo.as_ivec3().to_array(), hi.as_ivec3().to_array()])
            }
            Contents::Part(part) => part.columns.bounds(),
            Contents::OnDisk(_, points, _) => points.bounds,
        }
    }

    /// Reads only these of its columns and scalars from now on. Columns in memory stay.
    pub fn narrow(&mut self, wanted: ColumnSet) {
        match &mut self.contents {
            Contents::Las { las, .. } => las.narrow(wanted),
            Contents::OnDisk(_, _, own) => *own = wanted,
            Contents::Part(_) => {}
        }
    }

    /// Returns the columns of batches.
    pub fn available(&self) -> ColumnSet {
        match &self.contents {
            Contents::Las { las, .. } => las.available,
            Contents::Part(part) => part.columns.available(),
            Contents::OnDisk(_, points, wanted) => points.available(*wanted),
        }
    }

    /// Calls `sink` with every batch, from all threads, in no particular order. An error of `sink`
    /// ends it. May be called repeatedly.
    pub fn stream(
        &self,
        progress: &dyn Progress,
        sink: &(dyn Fn(&Batch) -> Result<()> + Sync),
    ) -> Result<Streamed> {
        self.run(progress, usize::MAX, sink, &|| Ok(()))
    }

    /// Calls `sink` with the nodes of an octree that may have a point at a place of the file's
    /// lattice. Returns the columns of these; `None` without an octree.
    pub fn nodes_around(
        &self,
        steps: [i32; 3],
        sink: &mut dyn FnMut(&Batch),
    ) -> Result<Option<ColumnSet>> {
        let Some(las) = self.las() else { return Ok(None) };
        let input = Input::open(&self.path)?;
        if !octree::is_one(&input)? {
            return Ok(None);
        }
        // The points of one that lies are found otherwise.
        let Ok(octree) = las.octree(&input) else { return Ok(None) };
        let lattice = self.own_lattice();
        let place = lattice.world(steps.map(i64::from));
        let mut occurred = Occurred::default();
        for node in &octree.nodes {
            // Corners may be rounded by a step.
            let [low, high] = octree.cube(node.key);
            let is_in = (low - lattice.step).cmple(place) & place.cmple(high + lattice.step);
            if is_in.all() {
                let (columns, own) = las.chunk(&input, &node.chunk, las.available)?;
                sink(&Batch { columns: &columns, first: node.first, records: &[] });
                occurred = occurred.join(own);
            }
        }
        Ok(Some(ColumnSet { rgb: las.available.rgb && !occurred.is_black(), ..las.available }))
    }

    /// Maps every batch, on all threads, and calls `take` with the results in the file's order.
    /// Only as many results wait as threads work on.
    pub fn stream_in_order<T: Send>(
        &self,
        progress: &dyn Progress,
        map: &(dyn Fn(&Batch) -> Result<T> + Sync),
        take: &mut (dyn FnMut(T) -> Result<()> + Send),
    ) -> Result<Streamed> {
        let waiting = Mutex::new((Vec::new(), take));
        let lock = || waiting.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let sink = |batch: &Batch| {
            let mapped = map(batch)?;
            lock().0.push((batch.first, mapped));
            Ok(())
        };
        let settle = || {
            let mut waiting = lock();
            let (ready, take) = &mut *waiting;
            ready.sort_by_key(|(first, _)| *first);
            ready.drain(..).try_for_each(|(_, mapped)| take(mapped))
        };
        self.run(progress, IN_ORDER * rayon::current_num_threads(), &sink, &settle)
    }

    /// Streams `at_once` stretches or batches at a time, and calls `settle` after these.
    fn run(
        &self,
        progress: &dyn Progress,
        at_once: usize,
        sink: &(dyn Fn(&Batch) -> Result<()> + Sync),
        settle: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Streamed> {
        // Batches of a sequence come from one lane, in order.
        let settled = |batch: &Batch| {
            sink(batch)?;
            settle()
        };
        let is_sequence = self.las().is_some_and(|las| matches!(las.places, Places::Sequence(_)));
        let desk = Desk {
            sink: if is_sequence { &settled } else { sink },
            available: self.available(),
            records: self.las().is_some_and(|las| las.keeps_records),
            most: BATCH.min(usize::try_from(self.points()).unwrap_or(BATCH)),
            spare: Mutex::default(),
            sum: Mutex::default(),
        };
        let (mut notes, mut again) = (Vec::new(), false);
        match &self.contents {
            Contents::Las { las, length } => {
                let input = Input::open(&self.path)?;
                if input.length != *length {
                    return Err(input.wrong(format!(
                        "had {length} bytes when it was opened, and has {} now",
                        input.length
                    )));
                }
                let meter = Meter::new(progress, &input, las.points());
                let why = match &las.places {
                    Places::Known(stretches) => {
                        let (mut first, mut outcomes) = (0, Vec::new());
                        for stretches in stretches.chunks(at_once.min(stretches.len().max(1))) {
                            let before = |sum: &mut u64, points: u64| {
                                Some(std::mem::replace(sum, *sum + points))
                            };
                            let firsts: Vec<u64> = stretches
                                .iter()
                                .map(|stretch| stretch.points)
                                .scan(first, before)
                                .collect();
                            first += stretches.iter().map(|stretch| stretch.points).sum::<u64>();
                            let lanes = firsts.par_iter().map(|&first| desk.lane(first));
                            outcomes.extend(las.read_some(&input, stretches, lanes, &meter)?);
                            settle()?;
                        }
                        las.why(&outcomes)
                    }
                    Places::Sequence(_) => {
                        las.read_sequence(&input, &mut desk.lane(0), progress)?
                    }
                };
                let sum = desk.sum();
                again = las.reconsiders(sum.occurred);
                notes.extend(las.verdict(&input, sum.points, sum.occurred, why, self.strict)?);
            }
            Contents::Part(part) => {
                let count = part.columns.len();
                let batches: Vec<usize> = (0..count).step_by(BATCH).collect();
                let deliver = |&first: &usize| {
                    desk.cut(&part.columns, first..count.min(first + BATCH), first as u64)
                };
                self.deliver(progress, &batches, at_once, &deliver, settle)?;
            }
            Contents::OnDisk(_, points, wanted) => {
                let blocks: Vec<(usize, u64)> = points.firsts().into_iter().enumerate().collect();
                let deliver = |&(block, first): &(usize, u64)| {
                    let columns = points.columns(block, *wanted)?;
                    for at in (0..columns.len()).step_by(BATCH) {
                        let end = columns.len().min(at + BATCH);
                        desk.cut(&columns, at..end, first + at as u64)?;
                    }
                    Ok(columns.len() as u64)
                };
                self.deliver(progress, &blocks, at_once, &deliver, settle)?;
            }
        }
        let Sum { points, occurred, bounds } = *desk.sum();
        let own = self.own_lattice();
        let world = bounds.map(|bounds| own.world_box(bounds));
        notes.extend(super::bounds_note(
            &self.path,
            &self.title(),
            self.header(),
            own,
            world,
            self.strict,
        )?);
        super::far_error(&self.path, own, world)?;
        if let Some(lie) = crs::lie(self.header()).filter(|_| self.strict) {
            return Err(Error::format(&self.path, lie));
        }
        notes.extend(self.notes.iter().cloned());
        let black = matches!(self.contents, Contents::Las { .. }) && occurred.is_black();
        let available = ColumnSet { rgb: desk.available.rgb && !black, ..desk.available };
        Ok(Streamed { points, rgb_scale: self.rgb_scale(), again, available, bounds, notes })
    }

    /// Delivers some pieces at a time, each of which returns its number of points.
    fn deliver<P: Sync>(
        &self,
        progress: &dyn Progress,
        pieces: &[P],
        at_once: usize,
        deliver: &(dyn Fn(&P) -> Result<u64> + Sync),
        settle: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<()> {
        let meter = Meter::named(progress, &self.title(), self.points());
        for pieces in pieces.chunks(at_once.min(pieces.len().max(1))) {
            pieces.par_iter().try_for_each(|piece| meter.advance(deliver(piece)?))?;
            settle()?;
        }
        Ok(())
    }
}

/// Passes batches on, recycles their columns, and sums up statistics.
struct Desk<'a> {
    sink: &'a (dyn Fn(&Batch) -> Result<()> + Sync),
    available: ColumnSet,
    /// True if batches have LAS records.
    records: bool,
    /// Most points of a batch, by the header.
    most: usize,
    /// Spare columns and records, as many as batches existed at a time.
    spare: Mutex<Vec<(Columns, Vec<u8>)>>,
    sum: Mutex<Sum>,
}

#[derive(Clone, Copy, Default)]
struct Sum {
    points: u64,
    occurred: Occurred,
    bounds: Option<[[i32; 3]; 2]>,
}

impl Desk<'_> {
    fn lane(&self, first: u64) -> BatchLane<'_> {
        BatchLane { desk: self, pile: None, records: Vec::new(), first }
    }

    fn lend(&self) -> (Columns, Vec<u8>) {
        let spare = self.spare.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).pop();
        spare.unwrap_or_else(|| (records::zeros(self.most, self.available), Vec::new()))
    }

    fn take_back(&self, columns: Columns, records: Vec<u8>) {
        let mut spare = self.spare.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        spare.push((columns, records));
    }

    fn sum(&self) -> MutexGuard<'_, Sum> {
        self.sum.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Delivers some of the points in columns. Returns their number.
    fn cut(&self, columns: &Columns, points: Range<usize>, first: u64) -> Result<u64> {
        let own = columns.slice(points);
        self.deliver(&own, first, &[], Occurred::default())?;
        Ok(own.len() as u64)
    }

    fn deliver(
        &self,
        columns: &Columns,
        first: u64,
        records: &[u8],
        occurred: Occurred,
    ) -> Result<()> {
        let Some(own) = columns.bounds() else { return Ok(()) };
        let mut sum = self.sum();
        sum.points += columns.len() as u64;
        sum.occurred = sum.occurred.join(occurred);
        sum.bounds = Some(sum.bounds.map_or(own, |[lo, hi]| {
            let pick = |a: [i32; 3], b: [i32; 3], pick: fn(i32, i32) -> i32| {
                std::array::from_fn(|axis| pick(a[axis], b[axis]))
            };
            [pick(lo, own[0], i32::min), pick(hi, own[1], i32::max)]
        }));
        drop(sum);
        (self.sink)(&Batch { columns, first, records })
    }
}

/// A lane one batch long, emptied into the sink when settled.
struct BatchLane<'a> {
    desk: &'a Desk<'a>,
    pile: Option<Pile>,
    records: Vec<u8>,
    /// Index of the next point.
    first: u64,
}

impl Lane for BatchLane<'_> {
    fn room(&mut self, points: usize) -> usize {
        let points = points.min(BATCH);
        if self.pile.is_none() {
            let (columns, mut records) = self.desk.lend();
            records.clear();
            (self.pile, self.records) = (Some(Pile::new(columns)), records);
        }
        self.pile.iter_mut().for_each(|pile| pile.grow(points));
        points
    }

    fn put(&mut self, records: &[u8], fields: &Fields) {
        self.pile.iter_mut().for_each(|pile| pile.fill(records, fields));
        if self.desk.records {
            self.records.extend_from_slice(records);
        }
    }

    fn settle(&mut self) -> Result<()> {
        let Some(mut pile) = self.pile.take() else { return Ok(()) };
        let filled = pile.cut();
        let records = std::mem::take(&mut self.records);
        self.desk.deliver(&pile.columns, self.first, &records, filled.occurred)?;
        self.first += filled.points as u64;
        self.desk.take_back(pile.columns, records);
        Ok(())
    }
}
