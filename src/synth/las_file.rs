//! Chunks in, a LAS or LAZ file out: LAS 1.2, point format 3 (time and colour), streamed and atomic.
//!
//! Everything goes to a temporary file in the same folder that takes the asked-for name only when it is complete; it is removed
//! when it is dropped before that (an error, Ctrl-C through `Progress`). Records are packed here, 34 bytes each, and handed to the
//! `las` crate as they are, which keeps the header's counts and bounds and compresses when the name ends in `.laz`.

use super::chunk::{Chunk, Lattice};
use crate::error::{Error, Result};
use las::point::Format;
use las::{Builder, PointDataBuilder, Transform, Vector, Writer};
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

const RECORD_BYTES: usize = 34;

pub struct LasFile {
    path: PathBuf,
    partial: PathBuf,
    /// None once it is closed.
    writer: Option<Writer<BufWriter<File>>>,
    lattice: Lattice,
}

impl LasFile {
    /// `points` is how many will come: more than LAS 1.2 can count are refused before any work is done.
    pub fn create(path: &Path, lattice: Lattice, points: u64) -> Result<LasFile> {
        if points > u32::MAX as u64 {
            return Err(Error::Request(format!("{points} points are more than LAS 1.2 can count ({}); write several files", u32::MAX)));
        }
        let mut name = path.file_name().ok_or_else(|| Error::Request(format!("{} is no file name", path.display())))?.to_owned();
        let compressed = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("laz"));
        name.push(format!(".partial-{}", std::process::id()));
        let partial = path.with_file_name(name);
        let file = File::create(&partial).map_err(|e| Error::io("create", &partial, e))?;
        // From here on a drop removes the file.
        let mut las_file = LasFile { path: path.to_owned(), partial, writer: None, lattice };
        let mut builder = Builder::from((1, 2));
        builder.point_format = Format::new(3).map_err(|e| failed(path, e))?;
        builder.point_format.is_compressed = compressed;
        // No date and no guid: the same seed gives the same bytes on any day.
        builder.date = None;
        builder.generating_software = concat!("pointillist ", env!("CARGO_PKG_VERSION")).to_owned();
        builder.system_identifier = "SIMULATION".to_owned();
        builder.transforms = transforms(lattice);
        let header = builder.into_header().map_err(|e| failed(path, e))?;
        las_file.writer = Some(Writer::new(BufWriter::with_capacity(1 << 20, file), header).map_err(|e| failed(path, e))?);
        Ok(las_file)
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
        let writer = self.writer.as_mut().expect("not yet closed");
        let points = PointDataBuilder::new()
            .with_format(*writer.header().point_format())
            .with_transforms(transforms(self.lattice))
            .build_from_bytes(bytes)
            .and_then(|points| writer.write_points(&points));
        points.map_err(|e| failed(&self.path, e))
    }

    /// Completes the header and gives the file its name.
    pub fn finish(mut self) -> Result<()> {
        let mut writer = self.writer.take().expect("finished once");
        writer.close().map_err(|e| failed(&self.path, e))?;
        let file = writer.into_inner().map_err(|e| failed(&self.path, e))?;
        let file = file.into_inner().map_err(|e| Error::io("write", &self.path, e.into_error()))?;
        file.sync_all().map_err(|e| Error::io("write", &self.path, e))?;
        std::fs::rename(&self.partial, &self.path).map_err(|e| Error::io("create", &self.path, e))
    }
}

impl Drop for LasFile {
    fn drop(&mut self) {
        self.writer = None;
        // After a rename there is nothing to remove, and nobody to tell if it fails.
        let _ = std::fs::remove_file(&self.partial);
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
