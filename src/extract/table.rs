//! Tables of text: a line of names, then a line a point.

use super::fields::{Colors, Fields};
use super::input::{Batch, Input};
use super::{Packed, Sink, Taker};
use crate::atomic_file::AtomicFile;
use crate::cloud::digits::Digits;
use crate::cloud::scalar::Scalar;
use crate::error::{Error, Result};
use crate::progress::Progress;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

pub struct Plan<'p> {
    input: &'p Input,
    fields: Fields,
    /// Decimals of each part's coordinates.
    decimals: Vec<[usize; 3]>,
}

impl<'p> Plan<'p> {
    pub fn new(input: &'p Input, scalars: &[Scalar], notes: &mut Vec<String>) -> Plan<'p> {
        let fields = Fields::new(input, Colors::of(input), scalars, notes);
        let decimals = |part: &super::input::Part| Digits::of([part.own]).decimals();
        Plan { input, fields, decimals: input.parts().iter().map(decimals).collect() }
    }

    pub fn create(&self, path: &Path) -> Result<ByteFile> {
        let names = self.fields.fields.iter().map(|(_, name)| format!(",{name}"));
        let head = format!("x,y,z{}\n", names.collect::<String>());
        ByteFile::create(path, head.as_bytes())
    }
}

impl Sink for Plan<'_> {
    fn pack(&self, batch: &Batch) -> Result<Packed> {
        let mut packed = Packed::default();
        let own = self.input.parts()[batch.part].own;
        let [dx, dy, dz] = self.decimals[batch.part];
        for &i in &batch.left {
            let [x, y, z] = own.world(batch.steps(i as usize)).to_array();
            let out = &mut packed.bytes;
            // Never fails, since it writes to memory.
            let _ = write!(out, "{x:.dx$},{y:.dy$},{z:.dz$}");
            for (_, value) in self.fields.values(self.input, batch, i as usize) {
                // Empty where there is none, as tables are read.
                let _ = match value.is_nan() {
                    true => write!(out, ","),
                    false => write!(out, ",{value}"),
                };
            }
            out.push(b'\n');
            packed.ends.push(out.len());
        }
        Ok(packed)
    }
}

/// A file of bytes in order.
pub struct ByteFile {
    path: std::path::PathBuf,
    file: BufWriter<File>,
    whole: AtomicFile,
    pub points: u64,
}

impl ByteFile {
    pub fn create(path: &Path, head: &[u8]) -> Result<ByteFile> {
        let whole = AtomicFile::create(path)?;
        let wrote = |error| Error::io("write", path, error);
        let mut file =
            BufWriter::with_capacity(1 << 20, File::create(whole.partial()).map_err(wrote)?);
        file.write_all(head).map_err(wrote)?;
        Ok(ByteFile { path: path.to_owned(), file, whole, points: 0 })
    }

    /// Completes the file; `patch` changes what has been written.
    pub fn finish_with(self, patch: impl FnOnce(&mut File) -> std::io::Result<()>) -> Result<()> {
        let ByteFile { path, file, whole, .. } = self;
        let file = file.into_inner().map_err(|error| error.into_error());
        file.and_then(|mut file| patch(&mut file)).map_err(|e| Error::io("write", &path, e))?;
        whole.finish()
    }
}

impl Taker for ByteFile {
    fn take(&mut self, points: u64, bytes: Vec<u8>) -> Result<()> {
        self.points += points;
        self.file.write_all(&bytes).map_err(|error| Error::io("write", &self.path, error))
    }

    fn finish(self: Box<Self>, _progress: &dyn Progress) -> Result<()> {
        self.finish_with(|_| Ok(()))
    }
}
