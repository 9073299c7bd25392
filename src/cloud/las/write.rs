//! LAS and LAZ files of packed records: streamed, and complete or absent.
//!
//! Records go to the `las` crate, which keeps the header's counts and bounds, and compresses.

use crate::atomic_file::AtomicFile;
use crate::cloud::Lattice;
use crate::error::{Error, Result};
use las::{Builder, PointDataBuilder, Transform, Vector, Writer};
use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// A file being written. Dropping it before [`LasWriter::finish`] leaves nothing.
pub struct LasWriter {
    path: PathBuf,
    // Declared before the file, so that it is closed before the file is removed.
    writer: Writer<Sink>,
    file: AtomicFile,
}

/// Byte of the header where the global encoding begins.
const GLOBAL_ENCODING: u64 = 6;

impl LasWriter {
    pub fn create(path: &Path, builder: Builder) -> Result<LasWriter> {
        let whole = AtomicFile::create(path)?;
        let file = File::create(whole.partial()).map_err(|e| Error::io("create", path, e))?;
        let header = builder.into_header().map_err(|e| failed(path, e))?;
        let sink = Sink { file: BufWriter::with_capacity(1 << 20, file), broken: false };
        let writer = Writer::new(sink, header).map_err(|e| failed(path, e))?;
        Ok(LasWriter { path: path.to_owned(), writer, file: whole })
    }

    /// Writes records of the header's point format.
    pub fn write(&mut self, records: Vec<u8>) -> Result<()> {
        let header = self.writer.header();
        let points = PointDataBuilder::new()
            .with_format(*header.point_format())
            .with_transforms(*header.transforms())
            .build_from_bytes(records)
            .and_then(|points| self.writer.write_points(&points));
        points.map_err(|e| failed(&self.path, e))
    }

    /// Completes the header and renames the file to its final name. The `las` crate derives the
    /// global encoding from the point format; `encoding` replaces it.
    pub fn finish(mut self, encoding: Option<u16>) -> Result<()> {
        self.writer.close().map_err(|e| failed(&self.path, e))?;
        let sink = self.writer.into_inner().map_err(|e| failed(&self.path, e))?;
        let wrote = |error| Error::io("write", &self.path, error);
        let mut file = sink.file.into_inner().map_err(|e| wrote(e.into_error()))?;
        if let Some(encoding) = encoding {
            file.seek(SeekFrom::Start(GLOBAL_ENCODING))
                .and_then(|_| file.write_all(&encoding.to_le_bytes()))
                .map_err(wrote)?;
        }
        self.file.finish()
    }
}

/// Returns the scales and offsets of a lattice.
pub fn transforms(Lattice { step, offset }: Lattice) -> Vector<Transform> {
    let axis = |axis: usize| Transform { scale: step[axis], offset: offset[axis] };
    Vector { x: axis(0), y: axis(1), z: axis(2) }
}

pub fn failed(path: &Path, error: las::Error) -> Error {
    match error {
        las::Error::Io(source) => Error::io("write", path, source),
        other => Error::format(path, other.to_string()),
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
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.unless_broken(0, |file| file.seek(to))
    }
}
