//! LAZ chunks -> columns.
//!
//! In: the laszip record and the compressed bytes. Out: the windows of the columns, filled. Three ways the chunks are found, best first:
//! the table at the end of the file; without it, for layered chunks (point formats 6 to 10), their own sizes, which say where the next begins;
//! else one pass from the first byte on, since the arithmetic decoder stops exactly where a chunk ends.
//! The `laz` crate decodes records, and nothing else is left to it: its table reader reserves, and its file readers unwrap, whatever a file says.
//! So sizes are checked here first, and the calls are fenced.

use super::Found;
use super::header::{Layout, array_at, u32_at};
use super::records::{self, Fields, Filled, WINDOW, Window};
use crate::cloud::Wanted;
use crate::cloud::guard::guard;
use crate::cloud::input::{Input, Meter};
use crate::error::Result;
use crate::progress::Progress;
use laz::las::selective::DecompressionSelection;
use laz::laszip::{ChunkTable, CompressorType};
use laz::record::{LayeredPointRecordDecompressor, RecordDecompressor, SequentialPointRecordDecompressor};
use laz::{LazItem, LazItemType, LazVlr};
use rayon::prelude::*;
use std::io::{BufReader, Cursor, Read};

/// No honest file packs more points into a byte: a million coincident ones come to about 100. It bounds what a crafted file can make us hold.
const POINTS_PER_BYTE: u64 = 256;

/// A chunk's entry in the table, two compressed 32-bit numbers, never takes more.
const TABLE_ENTRY_BYTES: u64 = 16;

/// Records decoded at a time.
const BATCH: usize = 512;

struct Coding {
    items: Vec<LazItem>,
    record_bytes: usize,
    /// Sizes of layers that follow a layered chunk's first point and count; 0 for the sequential coding.
    layers: usize,
    selection: DecompressionSelection,
}

#[derive(Clone, Copy, Debug)]
struct Chunk {
    at: u64,
    bytes: u64,
    points: u64,
}

/// One file's decoding: what stays the same from chunk to chunk.
struct Job<'a> {
    input: &'a Input,
    layout: &'a Layout,
    fields: &'a Fields,
    coding: Coding,
    available: Wanted,
    progress: &'a dyn Progress,
}

pub fn read(input: &Input, layout: &Layout, fields: &Fields, wanted: Wanted, progress: &dyn Progress) -> Result<Found> {
    let Some(laszip) = &layout.laszip else {
        return Err(input.wrong("is compressed, but has no laszip record that says how: the header is damaged"));
    };
    let vlr = guard(|| LazVlr::read_from(laszip.as_slice()).map_err(|error| error.to_string()))
        .flatten()
        .map_err(|what| input.wrong(format!("has a laszip record that cannot be used: {what}")))?;
    let available = fields.available(wanted);
    let compressor = u16::from_le_bytes(array_at(laszip, 0));
    let coding = Coding::new(input, layout, &vlr, compressor, available)?;
    let job = Job { input, layout, fields, coding, available, progress };
    if compressor == CompressorType::PointWise as u16 {
        return job.stream(layout.points_at, u64::MAX);
    }
    let chunk_points = (!vlr.uses_variable_size_chunks()).then_some(vlr.chunk_size() as u64);
    match (job.table(chunk_points), chunk_points) {
        (Ok(chunks), _) => job.in_chunks(chunks, String::new()),
        (Err(lost), _) if job.coding.layers > 0 => job.in_chunks(job.walk(chunk_points)?, lost),
        (Err(lost), Some(points)) => {
            let mut found = job.stream(layout.points_at + 8, points)?;
            found.why = if found.why.is_empty() { lost } else { format!("{lost}; {}", found.why) };
            Ok(found)
        }
        (Err(lost), None) => Err(input.wrong(format!("{lost}, and chunks of varying size cannot be found without it"))),
    }
}

impl Coding {
    fn new(input: &Input, layout: &Layout, vlr: &LazVlr, compressor: u16, available: Wanted) -> Result<Self> {
        if !(1..=3).contains(&compressor) {
            return Err(input.wrong(format!("uses the LAZ compressor {compressor}; 1 to 3 can be read")));
        }
        let mut bytes = 0;
        let mut layers = 0;
        for item in vlr.items() {
            let (size, its_layers) = match item.item_type() {
                LazItemType::Byte(count) => (count as usize, 0),
                LazItemType::Point10 => (20, 0),
                LazItemType::GpsTime => (8, 0),
                LazItemType::RGB12 => (6, 0),
                LazItemType::WavePacket13 => (29, 0),
                LazItemType::Point14 => (30, 9),
                LazItemType::RGB14 => (6, 1),
                LazItemType::RGBNIR14 => (8, 2),
                LazItemType::WavePacket14 => (29, 1),
                LazItemType::Byte14(count) => (count as usize, count as usize),
            };
            if item.size() as usize != size {
                return Err(input.wrong(format!("says {} bytes for a LAZ item of {size}: the laszip record is damaged", item.size())));
            }
            bytes += size;
            layers += its_layers;
        }
        if bytes != layout.record_bytes {
            return Err(
                input.wrong(format!("has LAZ items of {bytes} bytes for points of {}: the laszip record is damaged", layout.record_bytes))
            );
        }
        let base = matches!(vlr.items()[0].item_type(), LazItemType::Point10 | LazItemType::Point14);
        if !base || (layers > 0) != (compressor == CompressorType::LayeredChunked as u16) || (layers > 0) != (layout.format >= 6) {
            return Err(
                input.wrong(format!("has LAZ items that do not belong to compressor {compressor} and point format {}", layout.format))
            );
        }
        Ok(Self { items: vlr.items().clone(), record_bytes: bytes, layers, selection: selection(available) })
    }

    /// Bytes of a layered chunk before its layers: first point, count, layer sizes.
    fn head_bytes(&self) -> usize {
        self.record_bytes + 4 + 4 * self.layers
    }

    fn sequential<'a, R: Read + 'a>(&self, source: R) -> laz::Result<SequentialPointRecordDecompressor<'a, R>> {
        let mut decoder = SequentialPointRecordDecompressor::new(source);
        decoder.set_fields_from(&self.items)?;
        Ok(decoder)
    }

    fn layered<'a>(&self, source: Cursor<&'a [u8]>) -> laz::Result<LayeredPointRecordDecompressor<'a, Cursor<&'a [u8]>>> {
        let mut decoder = LayeredPointRecordDecompressor::new(source);
        decoder.set_fields_from(&self.items)?;
        decoder.set_selection(self.selection);
        Ok(decoder)
    }
}

/// Layers that nobody wants are not decoded.
fn selection(available: Wanted) -> DecompressionSelection {
    let mut bits = DecompressionSelection::Z;
    for (there, bit) in [
        (available.rgb, DecompressionSelection::RGB),
        (available.intensity, DecompressionSelection::INTENSITY),
        (available.class, DecompressionSelection::CLASSIFICATION),
        (available.source, DecompressionSelection::POINT_SOURCE_ID),
        (available.gps_time, DecompressionSelection::GPS_TIME),
    ] {
        if there {
            bits |= bit;
        }
    }
    DecompressionSelection(bits)
}

impl Job<'_> {
    /// The chunks as the table at the end of the file lists them, with sizes that fit the file; else what is wrong with it.
    fn table(&self, chunk_points: Option<u64>) -> std::result::Result<Vec<Chunk>, String> {
        let first = self.layout.points_at + 8;
        let offset_at =
            |at: u64| self.input.take(at, 8).ok().filter(|bytes| bytes.len() == 8).map(|bytes| i64::from_le_bytes(array_at(&bytes, 0)));
        let plausible = |at: &i64| *at >= first as i64 && *at as u64 + 8 <= self.input.length;
        let at = offset_at(self.layout.points_at)
            .filter(plausible)
            .or_else(|| offset_at(self.input.length.saturating_sub(8)).filter(plausible))
            .ok_or("the LAZ chunk table is missing")? as u64;
        let read = |length| self.input.take(at, length).ok().filter(|bytes| bytes.len() >= 8).ok_or("the LAZ chunk table is cut off");
        let count = u32_at(&read(8)?, 4) as u64;
        if count > (at - first) / self.layout.record_bytes as u64 {
            return Err(format!("the LAZ chunk table lists {count} chunks, more than {} bytes can hold", at - first));
        }
        let bytes = read(8 + TABLE_ENTRY_BYTES * (count + 1))?;
        let entries = guard(|| ChunkTable::read(&mut Cursor::new(&bytes), chunk_points.is_none()).map_err(|error| error.to_string()))
            .flatten()
            .map_err(|what| format!("the LAZ chunk table is damaged ({what})"))?;
        let mut chunks = Vec::with_capacity(count as usize);
        let mut next = first;
        for entry in &entries {
            if entry.byte_count > at - next {
                return Err("the LAZ chunk table does not fit the file".into());
            }
            chunks.push(Chunk { at: next, bytes: entry.byte_count, points: chunk_points.unwrap_or(entry.point_count) });
            next += entry.byte_count;
        }
        if let (Some(size), Some(last)) = (chunk_points, chunks.last_mut()) {
            let before = size.saturating_mul(count - 1);
            // A header that promises less than the full chunks hold is not believed; the last chunk then ends where its bytes do.
            if self.layout.points > before {
                last.points = size.min(self.layout.points - before);
            }
        }
        Ok(chunks)
    }

    /// Layered chunks found by their own sizes, from the first byte on, up to the first that is not whole.
    fn walk(&self, chunk_points: Option<u64>) -> Result<Vec<Chunk>> {
        let mut chunks = Vec::new();
        let mut at = self.layout.points_at + 8;
        let mut left = self.layout.points;
        while left > 0 {
            let head = self.input.take(at, self.coding.head_bytes() as u64)?;
            let Some(bytes) = layered_bytes(&head, &self.coding) else { break };
            let points = u32_at(&head, self.coding.record_bytes) as u64;
            if bytes > self.input.length - at || points == 0 || points > left || chunk_points.is_some_and(|size| points > size) {
                break;
            }
            chunks.push(Chunk { at, bytes, points });
            at += bytes;
            left -= points;
        }
        Ok(chunks)
    }

    /// Chunks of known place, in parallel.
    fn in_chunks(&self, chunks: Vec<Chunk>, lost: String) -> Result<Found> {
        for chunk in &chunks {
            if chunk.points > chunk.bytes.saturating_mul(POINTS_PER_BYTE) {
                return Err(self.input.wrong(format!("claims {} points in a LAZ chunk of {} bytes", chunk.points, chunk.bytes)));
            }
        }
        let count: u64 = chunks.iter().map(|chunk| chunk.points).sum();
        let mut columns = records::columns(count as usize, self.available).ok_or_else(|| super::no_room(self.input, count))?;
        let meter = Meter::new(self.progress, self.input, count);
        let windows = Window::over(&mut columns).split_into(chunks.iter().map(|chunk| chunk.points as usize));
        let tasks: Vec<_> = chunks.into_iter().zip(windows).collect();
        let outcomes = tasks
            .into_par_iter()
            .map(|(chunk, mut window)| {
                let bytes = self.input.take(chunk.at, chunk.bytes)?;
                let outcome = chunk_into(&bytes, chunk, &self.coding, self.fields, &mut window);
                meter.advance(chunk.points)?;
                Ok(outcome)
            })
            .collect::<Result<Vec<_>>>()?;
        let short = outcomes.iter().filter(|(_, why)| why.is_some()).count();
        let mut why = lost;
        if let Some((_, Some(first))) = outcomes.iter().find(|(_, why)| why.is_some()) {
            let join = if why.is_empty() { "" } else { "; " };
            why += &format!("{join}{short} of {} LAZ chunks could not be read to the end ({first})", outcomes.len());
        }
        Ok(Found { columns, windows: outcomes.into_iter().map(|(filled, _)| filled).collect(), why })
    }

    /// Sequential chunks of `chunk_points` from `at` on, without a table, on one thread, until the promised points or the bytes are used up.
    fn stream(&self, at: u64, chunk_points: u64) -> Result<Found> {
        if self.coding.layers > 0 {
            return Err(self.input.wrong("has layered points without chunks, which no writer makes: the laszip record is damaged"));
        }
        let promised = self.layout.points.min(self.input.length.saturating_sub(at).saturating_mul(POINTS_PER_BYTE));
        let mut columns = records::columns(0, self.available).unwrap_or_default();
        let mut windows: Vec<Filled> = Vec::new();
        let meter = Meter::new(self.progress, self.input, promised);
        let mut source = Some(BufReader::with_capacity(1 << 16, self.input.stream(at)));
        let mut why = String::new();
        let mut left = promised;
        while left > 0 && why.is_empty() {
            let Some(taken) = source.take() else { break };
            let mut decoder = self.coding.sequential(taken).map_err(|error| self.input.wrong(error.to_string()))?;
            let mut in_chunk = left.min(chunk_points);
            while in_chunk > 0 && why.is_empty() {
                let room = (in_chunk as usize).min(WINDOW);
                let start = columns.len();
                grow(&mut columns, start + room);
                let (_, mut window) = Window::over(&mut columns).split(start);
                let mut done = 0;
                let outcome = guard(|| decode(&mut decoder, room, &self.coding, self.fields, &mut window, &mut done)).flatten();
                windows.push(window.filled(done));
                if let Err(failure) = outcome {
                    why = format!("decoding stopped: {failure}");
                }
                meter.advance(done as u64)?;
                in_chunk -= room as u64;
                left -= room as u64;
            }
            source = Some(decoder.into_inner());
        }
        Ok(Found { columns, windows, why })
    }
}

/// The whole length of a layered chunk, by its head; `None` where the head is cut off.
fn layered_bytes(head: &[u8], coding: &Coding) -> Option<u64> {
    let sizes = head.get(coding.record_bytes + 4..coding.head_bytes())?;
    Some(coding.head_bytes() as u64 + sizes.chunks_exact(4).map(|size| u32_at(size, 0) as u64).sum::<u64>())
}

/// One chunk whose bytes are in memory.
fn chunk_into(bytes: &[u8], chunk: Chunk, coding: &Coding, fields: &Fields, window: &mut Window) -> (Filled, Option<String>) {
    let mut done = 0;
    let mut expected = chunk.points as usize;
    if coding.layers > 0 {
        match layered_bytes(bytes, coding) {
            Some(length) if length <= bytes.len() as u64 => expected = expected.min(u32_at(bytes, coding.record_bytes) as usize),
            _ => return (window.filled(0), Some("its layers do not fit".into())),
        }
    }
    let outcome = guard(|| {
        let source = Cursor::new(bytes);
        if coding.layers > 0 {
            decode(&mut coding.layered(source).map_err(|error| error.to_string())?, expected, coding, fields, window, &mut done)
        } else {
            decode(&mut coding.sequential(source).map_err(|error| error.to_string())?, expected, coding, fields, window, &mut done)
        }
    })
    .flatten();
    (window.filled(done), outcome.err())
}

/// Decodes up to `expected` records into the window from its point `done` on, and counts them there.
fn decode<R, D: RecordDecompressor<R>>(
    decoder: &mut D,
    expected: usize,
    coding: &Coding,
    fields: &Fields,
    window: &mut Window,
    done: &mut usize,
) -> std::result::Result<(), String> {
    let mut records = vec![0; BATCH * coding.record_bytes];
    let goal = *done + expected;
    while *done < goal {
        let batch = BATCH.min(goal - *done);
        let mut decoded = 0;
        let mut failure = None;
        for record in records.chunks_exact_mut(coding.record_bytes).take(batch) {
            if let Err(error) = decoder.decompress_next(record) {
                failure = Some(error.to_string());
                break;
            }
            decoded += 1;
        }
        window.fill(*done, &records[..decoded * coding.record_bytes], fields);
        *done += decoded;
        if let Some(failure) = failure {
            return Err(failure);
        }
    }
    Ok(())
}

fn grow(columns: &mut super::Columns, count: usize) {
    columns.x.resize(count, 0);
    columns.y.resize(count, 0);
    columns.z.resize(count, 0);
    columns.rgb.iter_mut().for_each(|column| column.resize(count, [0; 3]));
    columns.intensity.iter_mut().for_each(|column| column.resize(count, 0));
    columns.class.iter_mut().for_each(|column| column.resize(count, 0));
    columns.returns.iter_mut().for_each(|column| column.resize(count, 0));
    columns.source.iter_mut().for_each(|column| column.resize(count, 0));
    columns.gps_time.iter_mut().for_each(|column| column.resize(count, 0.0));
}
