//! Columns of points in an unnamed temporary file, for clouds larger than memory.
//!
//! The file is made when the first points no longer fit, in the system's folder of temporary files,
//! and the system removes it with the process.

use crate::atomic_file::temporary_file;
use crate::error::{Error, Result};
use bytemuck::Pod;
use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering::Relaxed};

/// Points of all files together that are held in memory.
const HELD: usize = 1 << 19;

/// A temporary file to which columns are appended.
#[derive(Debug)]
pub struct ColumnFile {
    /// The file, or why there is none.
    file: OnceLock<std::result::Result<File, Failure>>,
    end: AtomicU64,
    /// Points that may still be held in memory.
    room: AtomicUsize,
    /// Why a column could not be appended.
    failed: OnceLock<Failure>,
    /// True if the process is interrupted, so that nothing is read any more.
    is_interrupted: AtomicBool,
}

/// A failed operation on the file, with the system's error number.
#[derive(Clone, Copy, Debug)]
struct Failure {
    doing: &'static str,
    number: i32,
}

impl ColumnFile {
    pub fn new() -> ColumnFile {
        ColumnFile {
            file: OnceLock::new(),
            end: AtomicU64::new(0),
            room: AtomicUsize::new(HELD),
            failed: OnceLock::new(),
            is_interrupted: AtomicBool::new(false),
        }
    }

    /// Ends all reading with [`Error::Interrupted`].
    pub fn interrupt(&self) {
        self.is_interrupted.store(true, Relaxed);
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
            file.write_all_at(bytes, at).map_err(|source| Failure::of("write", &source))
        });
        written.unwrap_or_else(|why| {
            // The first one is told.
            let _ = self.failed.set(why);
        });
        at
    }

    /// Returns an error if a column could not be appended.
    pub fn check(&self) -> Result<()> {
        self.failed.get().map_or(Ok(()), |failure| Err(failure.error()))
    }

    /// Reads a column of this many points.
    pub fn read<T: Pod>(&self, at: u64, points: usize) -> Result<Vec<T>> {
        if self.is_interrupted.load(Relaxed) {
            return Err(Error::Interrupted);
        }
        let mut column = vec![T::zeroed(); points];
        let bytes = bytemuck::cast_slice_mut(&mut column);
        let read = self.file().and_then(|file| {
            file.read_exact_at(bytes, at).map_err(|source| Failure::of("read", &source))
        });
        read.map_err(Failure::error)?;
        Ok(column)
    }

    fn file(&self) -> std::result::Result<&File, Failure> {
        let make = || unnamed().map_err(|source| Failure::of("create", &source));
        self.file.get_or_init(make).as_ref().map_err(|failure| *failure)
    }
}

/// Creates a file without a name, where the file system has such files; else one whose name is
/// removed at once.
fn unnamed() -> io::Result<File> {
    let folder = std::env::temp_dir();
    let mut options = OpenOptions::new();
    options.read(true).write(true).mode(0o600).custom_flags(libc::O_TMPFILE);
    options.open(&folder).or_else(|_| {
        temporary_file(&folder.join("pointillist-points")).map_err(|error| match error {
            Error::Io { source, .. } => source,
            other => io::Error::other(other),
        })
    })
}

impl Failure {
    fn of(doing: &'static str, source: &io::Error) -> Failure {
        Failure { doing, number: source.raw_os_error().unwrap_or(libc::EIO) }
    }

    fn error(self) -> Error {
        let source = io::Error::from_raw_os_error(self.number);
        let source = match self.doing {
            "read" => source,
            _ => io::Error::new(
                source.kind(),
                format!(
                    "{source}; set TMPDIR to a folder with room for points that do not fit into memory"
                ),
            ),
        };
        Error::Io { doing: self.doing, path: std::env::temp_dir(), source }
    }
}
