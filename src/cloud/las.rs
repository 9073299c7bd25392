//! LAS 1.0 to 1.4, LAZ and COPC, and octrees whose nodes become LAS records: one part, or batches.
//!
//! Raw i32 coordinates stay on the file's own scale and offset, never converted through f64.
//! Records have a fixed width, so threads read their own stretches of the file. LAZ is decoded
//! chunk by chunk with the `laz` crate's record decoder. Both fill lanes: windows of whole columns
//! here, one batch per thread in `stream`. Only the lanes and one block per thread are ever in
//! memory. The file's length is authoritative: points that the header declares beyond it are
//! reported as missing.

pub mod copc;
pub mod header;
mod laz;
pub mod number;
pub mod octree;
pub mod raw;
pub mod read_point;
pub mod records;
mod sample;
pub mod write;

use super::crs::Sample;
use super::input::{Input, Meter};
use super::strays::Corners;
use super::{ColumnSet, Columns, Part, ReadOptions, rgb_range};
use crate::error::{Error, Result};
use crate::progress::{Progress, Silent};
use header::Layout;
use octree::{NodeReader, Octree};
use rayon::prelude::*;
use records::{BLOCK, Census, Fields, Filled, Lane, Pile, Window};
use rgb_range::{By, Occurred, RgbRange, Scale};
pub use sample::sample;
use std::sync::Mutex;

/// Signature of a LAS file.
pub const MAGIC: &[u8] = b"LASF";

/// Tests whether a file has LAS records, or describes an octree whose nodes become some.
pub fn is_one(input: &Input) -> Result<bool> {
    Ok(octree::is_description(input) || input.take(0, MAGIC.len() as u64)? == MAGIC)
}

/// Points per task of an uncompressed file.
const STRETCH: u64 = 65_536;

/// Stretches that are announced while one is read.
const AHEAD: usize = 16;

/// Most bytes of a block of records, at least one record: a header may declare 65,535 bytes a
/// record.
const BLOCK_BYTES: usize = 1 << 20;

/// A file with a parsed header: location and encoding of its points.
pub struct Las {
    pub layout: Layout,
    /// Columns that are both requested and present.
    pub available: ColumnSet,
    pub places: Places,
    fields: Fields,
    /// Colour range: as requested, or as a sample shows until all points have been read.
    range: Mutex<RgbRange>,
    asked: Option<RgbRange>,
    packing: Packing,
    /// The octree of a cloud in several files.
    octree: Option<Octree>,
    /// True if batches have the records themselves ([`ReadOptions::records`]).
    pub keeps_records: bool,
    /// Anomalies of the number of points, or of locating them.
    odd: String,
}

/// How the records of a stretch are stored.
enum Packing {
    Plain,
    Laz(laz::Coding),
    /// Nodes of an octree.
    Nodes(Box<dyn NodeReader>),
}

pub enum Places {
    /// Stretches that can be read independently.
    Known(Vec<Stretch>),
    Sequence(Sequence),
}

/// Adjacent records: a LAZ chunk, or as many as suit a task.
#[derive(Clone, Copy, Debug)]
pub struct Stretch {
    /// Place and length in the file `[bytes]`.
    pub at: u64,
    pub bytes: u64,
    pub points: u64,
}

impl Stretch {
    fn words(&self) -> String {
        let Stretch { at, bytes, points } = self;
        format!("chunk of {points} points at bytes {at} to {}", at + bytes)
    }
}

/// LAZ chunks, each of which begins where decoding the one before ends.
#[derive(Clone, Copy, Debug)]
pub struct Sequence {
    at: u64,
    points: u64,
    chunk_points: u64,
}

pub fn read(
    input: &Input,
    options: &ReadOptions,
    progress: &dyn Progress,
    notes: &mut Vec<String>,
) -> Result<Vec<Part>> {
    let las = Las::open(input, options.wanted, notes)?;
    let (mut part, mut occurred, mut why) = las.read(input, progress)?;
    if las.reconsiders(occurred) {
        (part, occurred, why) = las.read(input, progress)?;
    }
    notes.extend(las.verdict(input, part.columns.len() as u64, occurred, why, options.strict)?);
    Ok(vec![part])
}

pub const INTENSITY_RANGE: [f64; 2] = [0.0, 65535.0];

impl Las {
    /// Reads all points. Returns them with statistics of their colours, and anomalies.
    fn read(&self, input: &Input, progress: &dyn Progress) -> Result<(Part, Occurred, String)> {
        let (mut columns, lanes, corners, why) = match &self.places {
            Places::Known(stretches) => {
                let no_room = || {
                    let what = format!(
                        "has {} points, more than fit in memory; index it with `pointillist index`, or read fewer attributes",
                        self.points()
                    );
                    input.wrong(what)
                };
                let mut columns =
                    records::columns(self.points() as usize, self.available).ok_or_else(no_room)?;
                let mut windows = Window::over(&mut columns)
                    .split_into(stretches.iter().map(|stretch| stretch.points as usize));
                let why = self.read_stretches(input, windows.par_iter_mut(), progress)?;
                let lanes = windows.iter().map(Window::filled).collect();
                let corners = windows.iter().filter_map(|window| window.corners);
                let corners = corners.reduce(Corners::and);
                (columns, lanes, corners, why)
            }
            Places::Sequence(_) => {
                let mut pile = Pile::new(records::zeros(0, self.available));
                let why = self.read_sequence(input, &mut pile, progress)?;
                let lane = pile.cut();
                (pile.columns, vec![lane], None, why)
            }
        };
        let expected = columns.len();
        let occurred = records::finish(&mut columns, &lanes);
        // Fewer points than expected may lie in a smaller box.
        if let Some(corners) = corners.filter(|_| columns.len() == expected) {
            columns.keep_extent(corners);
        }
        let part = Part {
            path: input.path.clone(),
            name: None,
            header: self.layout.header.clone(),
            lattice: self.layout.lattice,
            columns,
            intensity_range: INTENSITY_RANGE,
            rgb_scale: self.scale(),
        };
        Ok((part, occurred, why))
    }

    pub fn open(input: &Input, wanted: ColumnSet, notes: &mut Vec<String>) -> Result<Self> {
        Las::open_for(input, wanted, false, notes)
    }

    /// Opens a file whose batches may have the records themselves, all fields decoded.
    pub fn open_for(
        input: &Input,
        wanted: ColumnSet,
        keeps_records: bool,
        notes: &mut Vec<String>,
    ) -> Result<Self> {
        let mut las = Las::located(input, wanted, keeps_records, notes)?;
        let available = las.available;
        let are_angles =
            las.layout.header.system.as_ref().is_some_and(|system| system.degrees.is_some());
        if are_angles || available.rgb && las.asked.is_none() {
            let Census { occurred, places } = las.census(input)?;
            las.reconsiders(occurred);
            let places = places.into_iter().map(|q| las.layout.lattice.world(q.map(i64::from)));
            las.layout.header.sample = are_angles.then(|| Sample::of(places.collect())).flatten();
        }
        Ok(las)
    }

    /// Opens a file without looking at its points.
    fn located(
        input: &Input,
        wanted: ColumnSet,
        keeps_records: bool,
        notes: &mut Vec<String>,
    ) -> Result<Self> {
        let (mut layout, tree) = if octree::is_description(input) {
            let octree::Opened { layout, octree, reader } = octree::open(input, keeps_records)?;
            (layout, Some((octree, reader)))
        } else {
            (header::read(input, notes)?, None)
        };
        layout.header.scalars = number::names(&layout);
        notes.extend(layout.lies.iter().map(|what| format!("{}: {what}", input.name())));
        let fields = Fields::new(&layout, wanted.scalars);
        layout.header.columns = fields.available(ColumnSet::ALL);
        let available = fields.available(wanted);
        let (mut octree, mut odd) = (None, String::new());
        let (packing, places) = if let Some((tree, reader)) = tree {
            let chunks = tree.nodes.iter().map(|node| node.chunk).collect();
            octree = Some(tree);
            (Packing::Nodes(reader), Places::Known(chunks))
        } else if layout.compressed {
            let (coding, places, lost) = laz::open(input, &layout, available, keeps_records)?;
            odd = lost;
            (Packing::Laz(coding), places)
        } else {
            let (places, more) = plain(input, &layout)?;
            odd = more;
            (Packing::Plain, places)
        };
        let range = Mutex::new(input.rgb_range.unwrap_or(RgbRange::Words));
        let asked = input.rgb_range;
        Ok(Self {
            layout,
            available,
            places,
            fields,
            range,
            asked,
            packing,
            octree,
            keeps_records,
            odd,
        })
    }

    /// Collects statistics of a sample of points.
    fn census(&self, input: &Input) -> Result<Census> {
        let mut census = Census::default();
        match sample::few(self) {
            Places::Known(stretches) => {
                for stretch in &stretches {
                    self.one_stretch(
                        input,
                        stretch,
                        &mut Vec::new(),
                        &mut &mut census,
                        &Meter::new(&Silent, input, 0),
                    )?;
                }
            }
            Places::Sequence(sequence) => {
                drop(self.sequence(input, &sequence, &mut &mut census, &Silent)?)
            }
        }
        Ok(census)
    }

    /// Sets the colour range from these statistics. Returns whether it differs from the assumed
    /// one.
    pub fn reconsiders(&self, occurred: Occurred) -> bool {
        let mut range = self.range.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let found =
            if self.asked.is_some() || occurred.is_black() { *range } else { occurred.range() };
        std::mem::replace(&mut *range, found) != found
    }

    fn range(&self) -> RgbRange {
        *self.range.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Returns the colour range.
    pub fn scale(&self) -> Scale {
        let range = self.range();
        let by = match (self.asked, range) {
            (Some(_), _) => By::Request,
            (None, RgbRange::Words) => By::File,
            _ => By::Values,
        };
        Scale::new(range, by)
    }

    /// Reads only some of the columns from now on, which takes less time where they are compressed
    /// in layers.
    pub fn narrow(&mut self, wanted: ColumnSet) {
        self.available = self.fields.available(wanted);
        if let Packing::Laz(coding) = &mut self.packing {
            *coding = coding.selecting(self.available);
        }
    }

    /// Returns the columns that can be read.
    pub fn holds(&self) -> ColumnSet {
        self.fields.available(ColumnSet::ALL)
    }

    /// Returns the number of points: the header's, limited by the file's length.
    pub fn points(&self) -> u64 {
        match &self.places {
            Places::Known(stretches) => stretches.iter().map(|stretch| stretch.points).sum(),
            Places::Sequence(sequence) => sequence.points,
        }
    }

    /// Reads all stretches in parallel, each into its own lane. Returns a reason for missing points
    /// or other anomalies.
    pub fn read_stretches<L: Lane>(
        &self,
        input: &Input,
        lanes: impl IndexedParallelIterator<Item = L>,
        progress: &dyn Progress,
    ) -> Result<String> {
        let Places::Known(stretches) = &self.places else { return Ok(String::new()) };
        let meter = Meter::new(progress, input, self.points());
        Ok(self.why(&self.read_some(input, stretches, lanes, &meter)?))
    }

    /// Reads some stretches in parallel, each into its own lane.
    pub fn read_some<L: Lane>(
        &self,
        input: &Input,
        stretches: &[Stretch],
        lanes: impl IndexedParallelIterator<Item = L>,
        meter: &Meter,
    ) -> Result<Vec<laz::Outcome>> {
        let read = |block: &mut Vec<u8>, ((number, stretch), mut lane): ((usize, &Stretch), L)| {
            self.ahead(input, &stretches[number..stretches.len().min(number + AHEAD)]);
            self.one_stretch(input, stretch, block, &mut lane, meter)
        };
        stretches.par_iter().enumerate().zip(lanes).map_init(Vec::new, read).collect()
    }

    /// Announces that chunks or nodes will be read.
    pub fn ahead(&self, input: &Input, chunks: &[Stretch]) {
        match &self.packing {
            Packing::Nodes(reader) => reader.ahead(chunks),
            _ => input.ahead(chunks.iter().map(|chunk| chunk.at..chunk.at + chunk.bytes)),
        }
    }

    /// Returns a reason for missing points or other anomalies, by the outcome of every stretch.
    pub fn why(&self, outcomes: &[laz::Outcome]) -> String {
        let mut short = outcomes.iter().flatten();
        let why = short.next().map(|first| {
            let pieces = match self.packing {
                Packing::Nodes(_) => "nodes",
                _ => "LAZ chunks",
            };
            let (count, all) = (1 + short.count(), outcomes.len());
            format!("{count} of {all} {pieces} could not be read to the end ({first})")
        });
        self.odd_and(why)
    }

    /// Reads all chunks in sequence into one lane. Returns as [`Las::read_stretches`].
    pub fn read_sequence(
        &self,
        input: &Input,
        lane: &mut impl Lane,
        progress: &dyn Progress,
    ) -> Result<String> {
        let Places::Sequence(sequence) = &self.places else { return Ok(String::new()) };
        Ok(self.odd_and(self.sequence(input, sequence, lane, progress)?))
    }

    fn sequence(
        &self,
        input: &Input,
        sequence: &Sequence,
        lane: &mut impl Lane,
        progress: &dyn Progress,
    ) -> Result<laz::Outcome> {
        let Packing::Laz(coding) = &self.packing else { return Ok(None) };
        let meter = Meter::new(progress, input, sequence.points);
        laz::sequence(input, sequence, coding, &self.fields(), lane, &meter)
    }

    /// Reads these columns of one chunk or node, and statistics of its colours. Errors if some of
    /// its points cannot be read.
    pub fn chunk(
        &self,
        input: &Input,
        chunk: &Stretch,
        wanted: ColumnSet,
    ) -> Result<(Columns, Occurred)> {
        let wrong = |what: &str| input.wrong(format!("{what} ({})", chunk.words()));
        let available = self.fields.available(wanted);
        let mut columns = records::columns(chunk.points as usize, available)
            .ok_or_else(|| wrong("has more points than fit in memory"))?;
        let mut window = Window::over(&mut columns);
        let (mut lane, meter) = (&mut window, Meter::new(&Silent, input, 0));
        let why = match &self.packing {
            Packing::Plain => return Err(wrong("is not compressed")),
            Packing::Laz(coding) => laz::chunk(
                &input.take(chunk.at, chunk.bytes)?,
                chunk.points,
                &coding.selecting(available),
                &self.fields(),
                &mut Vec::new(),
                &mut lane,
                &meter,
            )?,
            Packing::Nodes(reader) => {
                let why = self.node(reader.as_ref(), chunk, available, &mut lane, &meter)?;
                if let Some(why) = why {
                    return Err(input.wrong(format!("has a node that cannot be read: {why}")));
                }
                None
            }
        };
        let Filled { points, occurred, .. } = window.filled();
        if points as u64 != chunk.points {
            let why = why.unwrap_or_else(|| "it holds fewer".into());
            return Err(wrong(&format!("has only {points} readable points: {why}")));
        }
        Ok((columns, occurred))
    }

    /// Reads the record of a point, with all its fields, by its number in the file. `None` if there
    /// is none.
    pub fn record(&self, input: &Input, number: u64) -> Result<Option<Vec<u8>>> {
        let mut sought = Sought { before: number, record: None };
        match &self.places {
            Places::Known(stretches) => {
                for stretch in stretches {
                    if sought.before < stretch.points {
                        let points = sought.before + 1;
                        let bytes = match &self.packing {
                            Packing::Plain => points * self.layout.record_bytes as u64,
                            _ => stretch.bytes,
                        };
                        let some = Stretch { points, bytes, ..*stretch };
                        let meter = Meter::new(&Silent, input, 0);
                        self.one_stretch(input, &some, &mut Vec::new(), &mut sought, &meter)?;
                        break;
                    }
                    sought.before -= stretch.points;
                }
            }
            Places::Sequence(sequence) => {
                let points = sequence.points.min(number.saturating_add(1));
                let some = Sequence { points, ..*sequence };
                self.sequence(input, &some, &mut sought, &Silent)?;
            }
        }
        Ok(sought.record)
    }

    fn fields(&self) -> Fields {
        let mut fields = self.fields.clone();
        fields.range = self.range();
        fields
    }

    /// Returns the notes on this many read points and their colours, or an error if `strict`.
    pub fn verdict(
        &self,
        input: &Input,
        points: u64,
        occurred: Occurred,
        why: String,
        strict: bool,
    ) -> Result<Vec<String>> {
        let mut notes = Vec::new();
        if let Some(lie) = self.layout.lies.first().filter(|_| strict) {
            return Err(input.wrong(lie));
        }
        if points != self.layout.points {
            let because = if why.is_empty() { String::new() } else { format!(": {why}") };
            let field = if points > self.layout.points { " (number of point records)" } else { "" };
            let what = format!(
                "header declares {} points{field}, {points} could be read{because}",
                self.layout.points
            );
            if strict || points == 0 {
                return Err(input.wrong(what));
            }
            notes.push(format!("{}: {what}", input.name()));
        } else if !why.is_empty() {
            notes.push(format!("{}: {why}", input.name()));
        }
        let scale = self.scale();
        if strict && scale.by == By::Values && occurred.wide > 0 {
            return Err(
                input.wrong(format!("colours: {}", occurred.says(scale).unwrap_or_default()))
            );
        }
        notes.extend(occurred.says(scale).map(|what| format!("{}: {what}", input.name())));
        Ok(notes)
    }

    fn odd_and(&self, why: Option<String>) -> String {
        let told = [self.odd.clone(), why.unwrap_or_default()];
        told.into_iter().filter(|what| !what.is_empty()).collect::<Vec<_>>().join("; ")
    }

    /// Reads one stretch. Returns a reason if it ends early.
    fn one_stretch(
        &self,
        input: &Input,
        stretch: &Stretch,
        block: &mut Vec<u8>,
        lane: &mut impl Lane,
        meter: &Meter,
    ) -> Result<laz::Outcome> {
        match &self.packing {
            Packing::Laz(coding) => {
                let bytes = input.take(stretch.at, stretch.bytes)?;
                laz::chunk(&bytes, stretch.points, coding, &self.fields(), block, lane, meter)
            }
            Packing::Nodes(reader) => {
                self.node(reader.as_ref(), stretch, self.available, lane, meter)
            }
            Packing::Plain => self.stretch(input, stretch, block, lane, meter).map(|()| None),
        }
    }

    /// Reads one node of an octree, or its first points. Returns a reason if it ends early.
    fn node(
        &self,
        reader: &dyn NodeReader,
        chunk: &Stretch,
        wanted: ColumnSet,
        lane: &mut impl Lane,
        meter: &Meter,
    ) -> Result<laz::Outcome> {
        let (fields, mut left) = (self.fields(), chunk.points as usize);
        let width = fields.record_bytes;
        let mut pass_on = |records: &[u8]| {
            let mut rest = &records[..records.len().min(left * width)];
            while !rest.is_empty() {
                let room = lane.room(rest.len() / width);
                let (now, after) = rest.split_at(room * width);
                lane.put(now, &fields);
                lane.settle()?;
                meter.advance(room as u64)?;
                (rest, left) = (after, left - room);
            }
            Ok(())
        };
        let mut has_taken = true;
        let read = reader.records(chunk, wanted, &mut |records| {
            let taken = pass_on(records);
            has_taken = taken.is_ok();
            taken
        });
        match read {
            // Keeps what can be read of a damaged node, as of a damaged chunk.
            Err(error @ Error::Format { .. }) if has_taken => Ok(Some(error.to_string())),
            read => read,
        }
    }

    /// Reads one stretch of uncompressed records.
    fn stretch(
        &self,
        input: &Input,
        stretch: &Stretch,
        block: &mut Vec<u8>,
        lane: &mut impl Lane,
        meter: &Meter,
    ) -> Result<()> {
        let fields = self.fields();
        let width = fields.record_bytes;
        let piece = (BLOCK_BYTES / width).clamp(1, BLOCK);
        let mut at = stretch.at;
        let mut left = stretch.points as usize;
        while left > 0 {
            let room = lane.room(left);
            for start in (0..room).step_by(piece) {
                block.resize(piece.min(room - start) * width, 0);
                input.read_exactly(at, block)?;
                lane.put(block, &fields);
                at += block.len() as u64;
            }
            lane.settle()?;
            meter.advance(room as u64)?;
            left -= room;
        }
        Ok(())
    }
}

/// A lane that keeps one record.
struct Sought {
    /// Records before it that are still to come.
    before: u64,
    record: Option<Vec<u8>>,
}

impl Lane for Sought {
    fn room(&mut self, points: usize) -> usize {
        points.min(BLOCK)
    }

    fn put(&mut self, records: &[u8], fields: &Fields) {
        let mut rows = records.chunks_exact(fields.record_bytes);
        let count = rows.len() as u64;
        if self.before < count && self.record.is_none() {
            self.record = rows.nth(self.before as usize).map(<[u8]>::to_vec);
        }
        self.before = self.before.saturating_sub(count);
    }

    fn settle(&mut self) -> Result<()> {
        Ok(())
    }
}

/// Locates uncompressed records. Returns anomalies of their number.
fn plain(input: &Input, layout: &Layout) -> Result<(Places, String)> {
    let width = layout.record_bytes as u64;
    let room = (input.length - layout.points_at) / width;
    let end = layout.tail_at.unwrap_or(input.length);
    let more = (end.saturating_sub(layout.points_at) / width).saturating_sub(layout.points);
    let (count, odd) = if layout.points > room {
        (room, format!("the file ends after byte {}", input.length))
    } else if more == 0 {
        (layout.points, String::new())
    } else if are_points(input, layout, end)? {
        (layout.points + more, String::new())
    } else {
        (
            layout.points,
            format!(
                "the file has room for {more} more points than its header declares, but no such records"
            ),
        )
    };
    let stretch = |start| {
        let points = STRETCH.min(count - start);
        Stretch { at: layout.points_at + start * width, bytes: points * width, points }
    };
    Ok((Places::Known((0..count).step_by(STRETCH as usize).map(stretch).collect()), odd))
}

/// Tests whether the bytes behind the declared points are more points, as of an interrupted writer:
/// whole records, the last of which is not blank.
fn are_points(input: &Input, layout: &Layout, end: u64) -> Result<bool> {
    let width = layout.record_bytes as u64;
    let is_whole = (end - layout.points_at).is_multiple_of(width);
    Ok(is_whole && input.take(end - width, width)?.iter().any(|&byte| byte != 0))
}
