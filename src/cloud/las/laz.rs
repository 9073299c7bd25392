//! LAZ chunks to records.
//!
//! Chunks are located in three ways, best first: by the table at the end of the file; without it,
//! for layered chunks (point formats 6 to 10), by their own sizes; else in one sequential pass,
//! since the arithmetic decoder stops exactly where a chunk ends. The `laz` crate only decodes
//! records: its table reader allocates, and its file readers unwrap, on any input. Sizes are
//! checked here first, and panics are caught. The fields that it decodes by recursion, GPS times
//! and layered points, have decoders of their own here.

mod point14;
mod times;

use super::header::{Layout, array_at, u32_at};
use super::records::{Fields, Lane};
use super::{Places, Sequence, Stretch};
use crate::cloud::ColumnSet;
use crate::cloud::catch_panic::catch_panic;
use crate::cloud::input::{Input, Meter};
use crate::cloud::scalar::Scalar;
use crate::error::Result;
use laz::las::selective::DecompressionSelection;
use laz::laszip::{ChunkTable, CompressorType};
use laz::record::{
    LayeredPointRecordDecompressor, RecordDecompressor, SequentialPointRecordDecompressor,
};
use laz::{LazItem, LazItemType, LazVlr};
use point14::Point14;
use std::io::{BufReader, Cursor, Read};
use times::Times;

/// Most points per compressed byte: a million coincident points come to about 100. It bounds the
/// memory a crafted file can take.
pub const POINTS_PER_BYTE: u64 = 256;

/// Most bytes of a chunk's entry in the table, two compressed 32-bit numbers.
const TABLE_ENTRY_BYTES: u64 = 16;

/// Most chunks of a table, 48 bytes each in memory: with the usual 50,000 points each, a hundred
/// billion points. A sparse file may have room for more without having them.
const MOST_CHUNKS: u64 = 1 << 21;

/// Records per decoding step.
const DECODED: usize = 512;

/// The compression of a file's records.
pub struct Coding {
    items: Vec<LazItem>,
    record_bytes: usize,
    /// Number of layer sizes after a layered chunk's first point and count; 0 for sequential
    /// coding.
    layers: usize,
    selection: DecompressionSelection,
}

/// Returns the coding of a file, the location of its chunks, and anomalies of locating them.
pub fn open(
    input: &Input,
    layout: &Layout,
    available: ColumnSet,
    all_layers: bool,
) -> Result<(Coding, Places, String)> {
    let Some(laszip) = &layout.laszip else {
        return Err(input.wrong("is compressed, but has no laszip record; the header is damaged"));
    };
    let vlr =
        catch_panic(|| LazVlr::read_from(laszip.as_slice()).map_err(|error| error.to_string()))
            .flatten()
            .map_err(|what| input.wrong(format!("has an unusable laszip record: {what}")))?;
    let compressor = u16::from_le_bytes(array_at(laszip, 0));
    let selection = if all_layers { DecompressionSelection::all() } else { selection(available) };
    let coding = Coding::new(input, layout, &vlr, compressor, selection)?;
    let sequence = |at: u64, chunk_points| {
        let points =
            layout.points.min(input.length.saturating_sub(at).saturating_mul(POINTS_PER_BYTE));
        Places::Sequence(Sequence { at, points, chunk_points })
    };
    let chunk_points = (!vlr.uses_variable_size_chunks()).then_some(vlr.chunk_size() as u64);
    let (places, lost) = if compressor == CompressorType::PointWise as u16 {
        (sequence(layout.points_at, u64::MAX), String::new())
    } else {
        match (table(input, layout, chunk_points), chunk_points) {
            (Ok(mut chunks), _) => {
                counted(input, &coding, chunk_points, chunks.last_mut())?;
                (Places::Known(chunks), String::new())
            }
            (Err(lost), _) if coding.is_layered() => {
                (Places::Known(walk(input, layout, &coding, chunk_points)?), lost)
            }
            (Err(lost), Some(points)) => (sequence(layout.points_at + 8, points), lost),
            (Err(lost), None) => {
                return Err(input.wrong(format!(
                    "{lost}; chunks of varying size cannot be located without it"
                )));
            }
        }
    };
    if let Places::Known(chunks) = &places
        && let Some(chunk) =
            chunks.iter().find(|chunk| chunk.points > chunk.bytes.saturating_mul(POINTS_PER_BYTE))
    {
        return Err(input.wrong(format!(
            "declares {} points in a LAZ chunk of {} bytes",
            chunk.points, chunk.bytes
        )));
    }
    Ok((coding, places, lost))
}

impl Coding {
    fn new(
        input: &Input,
        layout: &Layout,
        vlr: &LazVlr,
        compressor: u16,
        selection: DecompressionSelection,
    ) -> Result<Self> {
        if !(1..=3).contains(&compressor) {
            return Err(
                input.wrong(format!("uses LAZ compressor {compressor}; supported are 1 to 3"))
            );
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
                return Err(input.wrong(format!(
                    "declares {} bytes for a LAZ item of {size}; the laszip record is damaged",
                    item.size()
                )));
            }
            bytes += size;
            layers += its_layers;
        }
        if bytes != layout.record_bytes {
            return Err(input.wrong(format!(
                "has LAZ items of {bytes} bytes for points of {} bytes; the laszip record is damaged",
                layout.record_bytes
            )));
        }
        let base =
            matches!(vlr.items()[0].item_type(), LazItemType::Point10 | LazItemType::Point14);
        if !base
            || (layers > 0) != (compressor == CompressorType::LayeredChunked as u16)
            || (layers > 0) != (layout.format >= 6)
        {
            return Err(input.wrong(format!(
                "has LAZ items that do not match compressor {compressor} and point format {}",
                layout.format
            )));
        }
        Ok(Self { items: vlr.items().clone(), record_bytes: bytes, layers, selection })
    }

    /// Returns the coding with only the layers of these columns to decode.
    pub fn selecting(&self, available: ColumnSet) -> Coding {
        Coding { selection: selection(available), items: self.items.clone(), ..*self }
    }

    pub fn is_layered(&self) -> bool {
        self.layers > 0
    }

    /// Returns the bytes of a layered chunk before its layers: first point, count, layer sizes.
    fn head_bytes(&self) -> usize {
        self.record_bytes + 4 + 4 * self.layers
    }

    fn sequential<'a, R: Read + 'a>(
        &self,
        source: R,
    ) -> laz::Result<SequentialPointRecordDecompressor<'a, R>> {
        let mut decoder = SequentialPointRecordDecompressor::new(source);
        for item in &self.items {
            match (item.item_type(), item.version()) {
                (LazItemType::GpsTime, 2) => decoder.add_field_decompressor(Times::sequential()),
                _ => decoder.set_fields_from(&vec![*item])?,
            }
        }
        Ok(decoder)
    }

    fn layered<'a>(
        &self,
        source: Cursor<&'a [u8]>,
    ) -> laz::Result<LayeredPointRecordDecompressor<'a, Cursor<&'a [u8]>>> {
        let mut decoder = LayeredPointRecordDecompressor::new(source);
        for item in &self.items {
            match (item.item_type(), item.version()) {
                (LazItemType::Point14, version @ 3..=4) => {
                    decoder.add_field_decompressor(Point14::new(version));
                }
                _ => decoder.set_fields_from(&vec![*item])?,
            }
        }
        decoder.set_selection(self.selection);
        Ok(decoder)
    }
}

/// Returns the layers to decode: only those of available columns.
fn selection(available: ColumnSet) -> DecompressionSelection {
    let is_extra = available.scalars.iter().any(|own| matches!(own, Scalar::Extra(_)));
    let mut bits = DecompressionSelection::Z;
    for (there, bit) in [
        (available.rgb, DecompressionSelection::RGB),
        (available.intensity, DecompressionSelection::INTENSITY),
        (available.class, DecompressionSelection::CLASSIFICATION),
        (available.source, DecompressionSelection::POINT_SOURCE_ID),
        (available.gps_time, DecompressionSelection::GPS_TIME),
        (available.scalars.has(Scalar::NearInfrared), DecompressionSelection::NIR),
        (available.scalars.has(Scalar::ScanAngle), DecompressionSelection::SCAN_ANGLE),
        (is_extra, DecompressionSelection::ALL_EXTRA_BYTES),
    ] {
        if there {
            bits |= bit;
        }
    }
    DecompressionSelection(bits)
}

/// Reads the chunk table at the end of the file. Errors if its sizes do not fit the file.
fn table(
    input: &Input,
    layout: &Layout,
    chunk_points: Option<u64>,
) -> std::result::Result<Vec<Stretch>, String> {
    let first = layout.points_at + 8;
    let offset_at = |at: u64| {
        input
            .take(at, 8)
            .ok()
            .filter(|bytes| bytes.len() == 8)
            .map(|bytes| i64::from_le_bytes(array_at(&bytes, 0)))
    };
    let plausible = |at: &i64| *at >= first as i64 && *at as u64 + 8 <= input.length;
    let at = offset_at(layout.points_at)
        .filter(plausible)
        .or_else(|| offset_at(input.length.saturating_sub(8)).filter(plausible))
        .ok_or("the LAZ chunk table is missing")? as u64;
    let read = |length| {
        input
            .take(at, length)
            .ok()
            .filter(|bytes| bytes.len() >= 8)
            .ok_or("the LAZ chunk table is truncated")
    };
    let count = u32_at(&read(8)?, 4) as u64;
    if count > (at - first) / layout.record_bytes as u64 {
        return Err(format!(
            "the LAZ chunk table lists {count} chunks, more than {} bytes can hold",
            at - first
        ));
    }
    if count > MOST_CHUNKS {
        return Err(format!(
            "the LAZ chunk table at byte {at} lists {count} chunks; at most {MOST_CHUNKS} are read"
        ));
    }
    let bytes = read(8 + TABLE_ENTRY_BYTES * (count + 1))?;
    let entries = catch_panic(|| {
        ChunkTable::read(&mut Cursor::new(&bytes), chunk_points.is_none())
            .map_err(|error| error.to_string())
    })
    .flatten()
    .map_err(|what| format!("the LAZ chunk table is damaged ({what})"))?;
    let mut chunks = Vec::with_capacity(count as usize);
    let mut next = first;
    for entry in &entries {
        let points = chunk_points.unwrap_or(entry.point_count);
        // The first point of a chunk is not compressed.
        let least = if points.min(layout.points) > 0 { layout.record_bytes as u64 } else { 0 };
        if entry.byte_count > at - next || entry.byte_count < least {
            return Err("the LAZ chunk table does not fit the file".into());
        }
        chunks.push(Stretch { at: next, bytes: entry.byte_count, points });
        next += entry.byte_count;
    }
    if layout.points > 0 && chunks.iter().all(|chunk| chunk.points == 0) {
        return Err("the LAZ chunk table lists no points".into());
    }
    if let (Some(size), Some(last)) = (chunk_points, chunks.last_mut()) {
        let before = size.saturating_mul(count - 1);
        // A header that declares less than the full chunks hold is not believed; the last chunk
        // then ends where its bytes do.
        if layout.points > before {
            last.points = size.min(layout.points - before);
        }
    }
    Ok(chunks)
}

/// Sets the points of the last chunk by its own count, if layered, where the header declares fewer.
fn counted(
    input: &Input,
    coding: &Coding,
    chunk_points: Option<u64>,
    last: Option<&mut Stretch>,
) -> Result<()> {
    let Some((size, last)) = chunk_points.zip(last).filter(|_| coding.is_layered()) else {
        return Ok(());
    };
    let head = input.take(last.at, coding.head_bytes() as u64)?;
    if head.len() == coding.head_bytes() && last.bytes >= coding.head_bytes() as u64 {
        let own = u32_at(&head, coding.record_bytes) as u64;
        last.points = if own <= size { last.points.max(own) } else { last.points };
    }
    Ok(())
}

/// Locates layered chunks by their own sizes, from the first byte, up to the first incomplete one.
fn walk(
    input: &Input,
    layout: &Layout,
    coding: &Coding,
    chunk_points: Option<u64>,
) -> Result<Vec<Stretch>> {
    let mut chunks = Vec::new();
    let mut at = layout.points_at + 8;
    let mut left = layout.points;
    while left > 0 {
        let head = input.take(at, coding.head_bytes() as u64)?;
        let Some(bytes) = layered_bytes(&head, coding) else { break };
        let points = u32_at(&head, coding.record_bytes) as u64;
        if bytes > input.length - at
            || points == 0
            || points > left
            || chunk_points.is_some_and(|size| points > size)
        {
            break;
        }
        chunks.push(Stretch { at, bytes, points });
        at += bytes;
        left -= points;
    }
    Ok(chunks)
}

/// Returns the length of a layered chunk by its head; `None` if the head is truncated.
fn layered_bytes(head: &[u8], coding: &Coding) -> Option<u64> {
    let sizes = head.get(coding.record_bytes + 4..coding.head_bytes())?;
    Some(
        coding.head_bytes() as u64
            + sizes.chunks_exact(4).map(|size| u32_at(size, 0) as u64).sum::<u64>(),
    )
}

/// A reason why a chunk could not be decoded entirely, if so.
pub type Outcome = Option<String>;

/// Decodes one chunk in memory.
pub fn chunk(
    bytes: &[u8],
    points: u64,
    coding: &Coding,
    fields: &Fields,
    block: &mut Vec<u8>,
    lane: &mut impl Lane,
    meter: &Meter,
) -> Result<Outcome> {
    let source = Cursor::new(bytes);
    if !coding.is_layered() {
        return match catch_panic(|| coding.sequential(source).map_err(|error| error.to_string()))
            .flatten()
        {
            Ok(mut decoder) => decode(&mut decoder, points, fields, block, lane, meter),
            Err(why) => Ok(Some(why)),
        };
    }
    if layered_bytes(bytes, coding).is_none_or(|length| length > bytes.len() as u64) {
        return Ok(Some("its layers exceed the chunk".into()));
    }
    let points = points.min(u32_at(bytes, coding.record_bytes) as u64);
    match catch_panic(|| coding.layered(source).map_err(|error| error.to_string())).flatten() {
        Ok(mut decoder) => decode(&mut decoder, points, fields, block, lane, meter),
        Err(why) => Ok(Some(why)),
    }
}

/// Decodes sequential chunks without a table, until points or bytes are used up.
pub fn sequence(
    input: &Input,
    places: &Sequence,
    coding: &Coding,
    fields: &Fields,
    lane: &mut impl Lane,
    meter: &Meter,
) -> Result<Outcome> {
    let mut source = BufReader::with_capacity(1 << 16, input.stream(places.at));
    let mut block = Vec::new();
    let mut left = places.points;
    while left > 0 {
        let mut decoder =
            coding.sequential(source).map_err(|error| input.wrong(error.to_string()))?;
        let in_chunk = left.min(places.chunk_points);
        if let Some(why) = decode(&mut decoder, in_chunk, fields, &mut block, lane, meter)? {
            return Ok(Some(format!("decoding stopped: {why}")));
        }
        left -= in_chunk;
        source = decoder.into_inner();
    }
    Ok(None)
}

/// Decodes `points` records into the lane, room by room.
fn decode<R, D: RecordDecompressor<R>>(
    decoder: &mut D,
    points: u64,
    fields: &Fields,
    block: &mut Vec<u8>,
    lane: &mut impl Lane,
    meter: &Meter,
) -> Result<Outcome> {
    block.resize(DECODED * fields.record_bytes, 0);
    let mut left = points as usize;
    while left > 0 {
        let room = lane.room(left);
        let outcome = catch_panic(|| decode_room(decoder, room, fields, block, lane)).flatten();
        lane.settle()?;
        meter.advance(room as u64)?;
        if let Err(why) = outcome {
            return Ok(Some(why));
        }
        left -= room;
    }
    Ok(None)
}

/// Decodes up to `points` records, block by block.
fn decode_room<R, D: RecordDecompressor<R>>(
    decoder: &mut D,
    points: usize,
    fields: &Fields,
    block: &mut [u8],
    lane: &mut impl Lane,
) -> std::result::Result<(), String> {
    for start in (0..points).step_by(DECODED) {
        let mut decoded = 0;
        let mut failure = None;
        for record in block.chunks_exact_mut(fields.record_bytes).take(points - start) {
            if let Err(error) = decoder.decompress_next(record) {
                failure = Some(error.to_string());
                break;
            }
            decoded += 1;
        }
        lane.put(&block[..decoded * fields.record_bytes], fields);
        if let Some(failure) = failure {
            return Err(failure);
        }
    }
    Ok(())
}
