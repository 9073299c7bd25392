//! Columns of points in an unnamed temporary file, for clouds larger than memory.
//!
//! The file is made when the first points no longer fit, in the system's folder of temporary files,
//! and the system removes it with the process.

use crate::atomic_file::temporary_file;
use crate::error::{Error, Result};
use bytemuck::Pod;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};

/// Points of all files together that are held in memory.
const HELD: usize = 1 << 19;

/// A temporary file to which columns are appended.
#[derive(Debug)]
pub struct ColumnFile {
    /// The file, or why there is none.
    file: OnceLock<std::result::Result<File, String>>,
    end: AtomicU64,
    /// Points that may still be held in memory.
    room: AtomicUsize,
    /// Why a column could not be appended.
    failed: OnceLock<String>,
}

impl ColumnFile {
    pub fn new() -> ColumnFile {
        ColumnFile {
            file: OnceLock::new(),
            end: AtomicU64::new(0),
            room: AtomicUsize::new(HELD),
            failed: OnceLock::new(),
        }
    }

    /// Returns the number of points that may still be held in memory.
    pub fn room(&self) -> usize {
        self.room.load(Relaxed)
    }

    /// Takes room for points in memory. Returns whether there is as much.
    pub fn hold(&self, points: usize) -> bool {
        self.room.fetch_update(Relaxed, Relaxed, |room| room.checked_sub(points)).is_ok()
    }

    /// Appends a column, from any thread, and returns where it begins. An error is kept for
    /// [`ColumnFile::check`], and nothing is written after it.
    pub fn append<T: Pod>(&self, column: &[T]) -> u64 {
        if self.failed.get().is_some() {
            return 0;
        }
        let bytes: &[u8] = bytemuck::cast_slice(column);
        let at = self.end.fetch_add(bytes.len() as u64, Relaxed);
        let written = self.file().and_then(|file| {
            file.write_all_at(bytes, at).map_err(|source| wrong("write", &source))
        });
        written.unwrap_or_else(|why| {
            // The first one is told.
            let _ = self.failed.set(why);
        });
        at
    }

    /// Returns an error if a column could not be appended.
    pub fn check(&self) -> Result<()> {
        self.failed.get().map_or(Ok(()), |why| Err(Error::Request(why.clone())))
    }

    /// Reads a column of this many points.
    pub fn read<T: Pod>(&self, at: u64, points: usize) -> Result<Vec<T>> {
        let mut column = vec![T::zeroed(); points];
        let bytes = bytemuck::cast_slice_mut(&mut column);
        let read = self.file().and_then(|file| {
            file.read_exact_at(bytes, at).map_err(|source| wrong("read", &source))
        });
        read.map_err(Error::Request)?;
        Ok(column)
    }

    fn file(&self) -> std::result::Result<&File, String> {
        let make = || {
            let beside = std::env::temp_dir().join("pointillist-points");
            temporary_file(&beside).map_err(|error| match error {
                Error::Io { source, .. } => wrong("create", &source),
                other => other.to_string(),
            })
        };
        self.file.get_or_init(make).as_ref().map_err(String::clone)
    }
}

fn wrong(doing: &str, source: &io::Error) -> String {
    format!(
        "cannot {doing} temporary points in {}: {source}; set TMPDIR to a folder with room for them",
        std::env::temp_dir().display()
    )
}
