//! LAS and LAZ files of simulated scans: LAS 1.2, point format 3 (time and colour), streamed and
//! atomic.
//!
//! The file is complete or absent (`atomic_file`). Records are packed here, 34 bytes each, and
//! passed to the `las` crate, which keeps the header's counts and bounds and compresses if the name
//! ends in `.laz`.

use super::chunk::{Chunk, Lattice};
use crate::atomic_file::AtomicFile;
use crate::error::{Error, Result};
use las::point::Format;
use las::{Builder, PointDataBuilder, Transform, Vector, Writer};
use std::fs::File;
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

const RECORD_BYTES: usize = 34;

pub struct LasFile {
    path: PathBuf,
    // Declared before the file, so that it is closed before the file is removed.
    writer: Writer<Sink>,
    file: AtomicFile,
    lattice: Lattice,
}

impl LasFile {
    /// Creates a file for `points` points. Errors early if LAS 1.2 cannot count them.
    pub fn create(path: &Path, lattice: Lattice, points: u64) -> Result<LasFile> {
        if points > u32::MAX as u64 {
            return Err(Error::Request(format!(
                "{points} points are more than LAS 1.2 can count ({}); write several files",
                u32::MAX
            )));
        }
        let whole = AtomicFile::create(path)?;
        let file = File::create(whole.partial()).map_err(|e| Error::io("create", path, e))?;
        let compressed = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("laz"));
        let mut builder = Builder::from((1, 2));
        builder.point_format = Format::new(3).map_err(|e| failed(path, e))?;
        builder.point_format.is_compressed = compressed;
        // No date and no guid: the same seed gives the same bytes on any day.
        builder.date = None;
        builder.generating_software = concat!("pointillist ", env!("CARGO_PKG_VERSION")).to_owned();
        builder.system_identifier = "SIMULATION".to_owned();
        builder.transforms = transforms(lattice);
        let header = builder.into_header().map_err(|e| failed(path, e))?;
        let sink = Sink { file: BufWriter::with_capacity(1 << 20, file), broken: false };
        let writer = Writer::new(sink, header).map_err(|e| failed(path, e))?;
        Ok(LasFile { path: path.to_owned(), writer, file: whole, lattice })
    }

    pub fn write(&mut self, chunk: &Chunk) -> Result<()> {
        let mut bytes = Vec::with_capacity(chunk.len() * RECORD_BYTES);
        for i in 0..chunk.len() {
            let mut record = [0u8; RECORD_BYTES];
            record[0..4].copy_from_slice(&chunk.x[i].to_le_bytes());
            record[4..8].copy_from_slice(&chunk.y[i].to_le_bytes());
            record[8..12].copy_from_slice(&chunk.z[i].to_le_bytes());
            record[12..14].copy_from_slice(&chunk.intensity[i].to_le_bytes());
            let (number, of) = chunk.returns[i];
            record[14] = number & 7 | (of & 7) << 3;
            record[15] = chunk.class[i] & 31;
            record[16] = chunk.scan_angle[i] as u8;
            record[18..20].copy_from_slice(&chunk.source[i].to_le_bytes());
            record[20..28].copy_from_slice(&chunk.gps_time[i].to_le_bytes());
            for (k, value) in chunk.rgb[i].into_iter().enumerate() {
                record[28 + 2 * k..30 + 2 * k].copy_from_slice(&value.to_le_bytes());
            }
            bytes.extend_from_slice(&record);
        }
        let points = PointDataBuilder::new()
            .with_format(*self.writer.header().point_format())
            .with_transforms(transforms(self.lattice))
            .build_from_bytes(bytes)
            .and_then(|points| self.writer.write_points(&points));
        points.map_err(|e| failed(&self.path, e))
    }

    /// Completes the header and renames the file to its final name.
    pub fn finish(mut self) -> Result<()> {
        self.writer.close().map_err(|e| failed(&self.path, e))?;
        let file = self.writer.into_inner().map_err(|e| failed(&self.path, e))?;
        file.file.into_inner().map_err(|e| Error::io("write", &self.path, e.into_error()))?;
        self.file.finish()
    }
}

/// A writer that reports its first failure and then discards everything: the `las` writer closes
/// itself when dropped, and panics if that fails.
struct Sink {
    file: BufWriter<File>,
    broken: bool,
}

impl Sink {
    fn unless_broken<T>(
        &mut self,
        pretended: T,
        act: impl FnOnce(&mut BufWriter<File>) -> io::Result<T>,
    ) -> io::Result<T> {
        if self.broken {
            return Ok(pretended);
        }
        let done = act(&mut self.file);
        self.broken = done.as_ref().is_err_and(|error| error.kind() != io::ErrorKind::Interrupted);
        done
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.unless_broken(bytes.len(), |file| file.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.unless_broken((), |file| file.flush())
    }
}

impl Seek for Sink {
    fn seek(&mut self, to: io::SeekFrom) -> io::Result<u64> {
        self.unless_broken(0, |file| file.seek(to))
    }
}

fn transforms(lattice: Lattice) -> Vector<Transform> {
    let axis = |offset: f64| Transform { scale: lattice.step, offset };
    Vector { x: axis(lattice.offset.x), y: axis(lattice.offset.y), z: axis(lattice.offset.z) }
}

fn failed(path: &Path, error: las::Error) -> Error {
    match error {
        las::Error::Io(source) => Error::io("write", path, source),
        other => Error::format(path, other.to_string()),
    }
}
