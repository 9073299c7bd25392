//! LAS and LAZ files of packed records: streamed, and complete or absent.
//!
//! The header is written here, since that of the `las` crate refuses return numbers above 5 in
//! files before LAS 1.4, which have them, and panics when a writer is dropped after an error. The
//! `laz` crate compresses.

use super::header::{Vlr, array_at, record_bytes};
use crate::atomic_file::AtomicFile;
use crate::cloud::Lattice;
use crate::error::{Error, Result};
use laz::{LasZipError, LazItemRecordBuilder, LazVlr, LazVlrBuilder, ParLasZipCompressor};
use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// What a header says before there are points.
#[derive(Clone, Debug)]
pub struct Head {
    /// LAS 1.2 to 1.4.
    pub minor: u8,
    pub format: u8,
    pub extra_bytes: u16,
    pub compressed: bool,
    pub lattice: Lattice,
    pub file_source: u16,
    pub global_encoding: u16,
    pub system: String,
    pub records: Vec<Vlr>,
}

/// A file being written. Dropping it before [`LasWriter::finish`] leaves nothing.
pub struct LasWriter {
    path: PathBuf,
    // Declared before the file, so that it is closed before the file is removed.
    body: Body,
    file: AtomicFile,
    head: Head,
    count: Count,
}

enum Body {
    Plain(BufWriter<File>),
    Packed(Box<ParLasZipCompressor<BufWriter<File>>>),
}

/// Statistics of the points written.
#[derive(Default)]
pub(super) struct Count {
    pub points: u64,
    by_return: [u64; 16],
    pub bounds: Option<[[i32; 3]; 2]>,
}

const HEADER_BYTES: [u16; 5] = [227, 227, 227, 235, 375];

impl LasWriter {
    pub fn create(path: &Path, head: Head) -> Result<LasWriter> {
        let whole = AtomicFile::create(path)?;
        let wrote = |error| Error::io("write", path, error);
        let mut file = File::create(whole.partial())
            .map(|file| BufWriter::with_capacity(1 << 20, file))
            .map_err(|error| Error::io("create", path, error))?;
        let (mut head, mut laszip) = (head, None);
        if head.compressed {
            laszip = Some(head.compress(false).map_err(|error| wrote(io_error(error)))?);
        }
        let count = Count::default();
        head.write(&count, 0, &mut file).map_err(wrote)?;
        let body = match laszip {
            None => Body::Plain(file),
            Some(laszip) => {
                let mut packed = ParLasZipCompressor::new(file, laszip)
                    .map_err(|error| wrote(io_error(error)))?;
                packed.reserve_offset_to_chunk_table().map_err(wrote)?;
                Body::Packed(Box::new(packed))
            }
        };
        Ok(LasWriter { path: path.to_owned(), body, file: whole, head, count })
    }

    /// Writes records of the header's point format.
    pub fn write(&mut self, records: &[u8]) -> Result<()> {
        let (width, modern) = (self.head.width() as usize, self.head.format >= 6);
        for record in records.chunks_exact(width) {
            self.count.add(record, if modern { 15 } else { 7 });
        }
        let written = match &mut self.body {
            Body::Plain(file) => file.write_all(records),
            Body::Packed(packed) => packed.compress_many(records),
        };
        written.map_err(|error| Error::io("write", &self.path, error))
    }

    /// Completes the header and renames the file to its final name.
    pub fn finish(self) -> Result<()> {
        let LasWriter { path, body, file: whole, head, count } = self;
        let ended = match body {
            Body::Plain(file) => Ok(file),
            Body::Packed(mut packed) => {
                packed.done().map_err(io_error).map(|()| packed.into_inner())
            }
        };
        ended
            .and_then(|mut file| {
                file.seek(SeekFrom::Start(0))?;
                file.write_all(&head.bytes(&count, 0))?;
                file.flush()
            })
            .map_err(|error| Error::io("write", &path, error))?;
        whole.finish()
    }
}

impl Count {
    pub fn add(&mut self, record: &[u8], return_bits: u8) {
        let steps = [0, 4, 8].map(|at| i32::from_le_bytes(array_at(record, at)));
        let [low, high] = self.bounds.unwrap_or([steps; 2]);
        let pick = |a: [i32; 3], pick: fn(i32, i32) -> i32| {
            [0, 1, 2].map(|axis| pick(a[axis], steps[axis]))
        };
        self.bounds = Some([pick(low, i32::min), pick(high, i32::max)]);
        self.points += 1;
        self.by_return[(record[14] & return_bits) as usize] += 1;
    }
}

impl Head {
    /// Returns the bytes of a record.
    pub(super) fn width(&self) -> u16 {
        record_bytes(self.format) + self.extra_bytes
    }

    /// Adds the record that says how points are compressed, in chunks of one size or of any.
    pub(super) fn compress(&mut self, varying: bool) -> laz::Result<LazVlr> {
        let items =
            LazItemRecordBuilder::default_for_point_format_id(self.format, self.extra_bytes)?;
        let builder = LazVlrBuilder::new(items);
        let laszip = if varying { builder.with_variable_chunk_size() } else { builder }.build();
        let mut data = Vec::new();
        laszip.write_to(&mut data)?;
        let (user, record) = (LazVlr::USER_ID.into(), LazVlr::RECORD_ID);
        let description = LazVlr::DESCRIPTION.into();
        self.records.push(Vlr { user, record, description, data });
        Ok(laszip)
    }

    /// Writes the header of this many points, and the records behind it.
    pub(super) fn write(
        &self,
        count: &Count,
        extended: u64,
        to: &mut impl Write,
    ) -> io::Result<()> {
        to.write_all(&self.bytes(count, extended))?;
        self.records.iter().try_for_each(|vlr| to.write_all(&vlr.bytes()))
    }

    /// Returns the header of this many points, with the place of an extended record, 0 for none.
    fn bytes(&self, count: &Count, extended: u64) -> Vec<u8> {
        let length = HEADER_BYTES[self.minor as usize];
        let between: usize = self.records.iter().map(|vlr| vlr.bytes().len()).sum();
        let mut head = vec![0; length as usize];
        let mut put = |at: usize, bytes: &[u8]| head[at..at + bytes.len()].copy_from_slice(bytes);
        put(0, super::MAGIC);
        put(4, &self.file_source.to_le_bytes());
        put(6, &self.global_encoding.to_le_bytes());
        put(24, &[1, self.minor]);
        put(26, &field::<32>(&self.system));
        put(58, &field::<32>(concat!("pointillist ", env!("CARGO_PKG_VERSION"))));
        put(94, &length.to_le_bytes());
        put(96, &(length as u32 + between as u32).to_le_bytes());
        put(100, &(self.records.len() as u32).to_le_bytes());
        put(104, &[self.format | (self.compressed as u8) << 7]);
        put(105, &self.width().to_le_bytes());
        // Formats from 6 on have no counts of 32 bits, and larger counts have none.
        let narrow = |count: u64| match self.format {
            0..6 => u32::try_from(count).unwrap_or(0),
            _ => 0,
        };
        put(107, &narrow(count.points).to_le_bytes());
        let returns = &count.by_return[1..];
        let has_room = count.points <= u32::MAX as u64;
        for (k, &points) in returns[..5].iter().enumerate() {
            put(111 + 4 * k, &narrow(if has_room { points } else { 0 }).to_le_bytes());
        }
        let [low, high] = count.bounds.map_or(Default::default(), |ends| {
            ends.map(|steps| self.lattice.world(steps.map(i64::from)).to_array())
        });
        for axis in 0..3 {
            put(131 + 8 * axis, &self.lattice.step[axis].to_le_bytes());
            put(155 + 8 * axis, &self.lattice.offset[axis].to_le_bytes());
            put(179 + 16 * axis, &high[axis].to_le_bytes());
            put(187 + 16 * axis, &low[axis].to_le_bytes());
        }
        if self.minor >= 4 {
            put(235, &extended.to_le_bytes());
            put(243, &u32::from(extended > 0).to_le_bytes());
            put(247, &count.points.to_le_bytes());
            returns
                .iter()
                .enumerate()
                .for_each(|(k, points)| put(255 + 8 * k, &points.to_le_bytes()));
        }
        head
    }
}

impl Vlr {
    fn bytes(&self) -> Vec<u8> {
        let Vlr { user, record, description, data } = self;
        let mut bytes = vec![0; 2];
        bytes.extend(field::<16>(user));
        bytes.extend(record.to_le_bytes());
        // Longer ones were in no file.
        bytes.extend((data.len() as u16).to_le_bytes());
        bytes.extend(field::<32>(description));
        bytes.extend(data);
        bytes
    }
}

/// Returns a text as a field of this width: what is ASCII of it, then zeros.
pub(super) fn field<const N: usize>(text: &str) -> [u8; N] {
    let mut field = [0; N];
    let ascii = text.bytes().filter(u8::is_ascii);
    field.iter_mut().zip(ascii).for_each(|(slot, byte)| *slot = byte);
    field
}

pub(super) fn io_error(error: LasZipError) -> io::Error {
    match error {
        LasZipError::IoError(error) => error,
        other => io::Error::other(other.to_string()),
    }
}
