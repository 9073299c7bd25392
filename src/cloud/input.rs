//! Input files, read by position.
//!
//! Readers request ranges from several threads at once, so there is no shared file position.
//! Nothing is mapped, because a mapped file that shrinks kills the process (guide: reliability).

use super::rgb_range::RgbRange;
use crate::error::{Error, Result};
use crate::progress::Progress;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

pub struct Input {
    pub path: PathBuf,
    /// Length when opened; a file that shrinks later fails the read that finds it.
    pub length: u64,
    /// Colour range given by the user.
    pub rgb_range: Option<RgbRange>,
    contents: Contents,
}

enum Contents {
    File(File),
    /// Decoded bytes to read instead of the file's.
    Made(Vec<u8>),
}

/// Descriptions of clouds in several files, those of Potree 2 and EPT. A folder with one is opened by
/// it.
pub const OCTREES: [&str; 2] = ["metadata.json", "ept.json"];

impl Input {
    /// Opens a file, or the description of a cloud in a folder. Refuses pipes and devices by their
    /// metadata, since opening a pipe would wait for a writer.
    pub fn open(path: &Path) -> Result<Self> {
        let metadata = std::fs::metadata(path).map_err(|source| Error::io("open", path, source))?;
        if metadata.is_dir() {
            let found = OCTREES.map(|name| path.join(name)).into_iter().find(|path| path.is_file());
            return match found {
                Some(found) => Input::open(&found),
                None => Err(Error::format(
                    path,
                    "is a folder without metadata.json (Potree) and ept.json (EPT); give the files in it",
                )),
            };
        }
        if !metadata.is_file() {
            return Err(Error::format(
                path,
                "is not a regular file (a pipe or a device); save it to a file first",
            ));
        }
        let file = File::open(path).map_err(|source| Error::io("open", path, source))?;
        Ok(Self {
            path: path.to_owned(),
            length: metadata.len(),
            rgb_range: None,
            contents: Contents::File(file),
        })
    }

    /// Returns an input with these contents.
    pub fn made(path: PathBuf, bytes: Vec<u8>) -> Input {
        Input { path, length: bytes.len() as u64, rgb_range: None, contents: Contents::Made(bytes) }
    }

    /// Returns the same file with other contents.
    pub fn with(&self, bytes: Vec<u8>) -> Input {
        Input { rgb_range: self.rgb_range, ..Input::made(self.path.clone(), bytes) }
    }

    /// Returns the input with the user's colour range.
    pub fn counting_to(self, rgb_range: Option<RgbRange>) -> Self {
        Self { rgb_range, ..self }
    }

    /// Fills `bytes` from `offset`, less at the end of the file. Returns the number of bytes read.
    pub fn read_at(&self, offset: u64, bytes: &mut [u8]) -> Result<usize> {
        let mut filled = 0;
        while filled < bytes.len() {
            match self
                .contents
                .read_some_at(&mut bytes[filled..], offset.saturating_add(filled as u64))
            {
                Ok(0) => break,
                Ok(count) => filled += count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(source) => return Err(Error::io("read", &self.path, source)),
            }
        }
        Ok(filled)
    }

    /// Fills all of `bytes`. Errors if the file has been truncated since it was opened.
    pub fn read_exactly(&self, offset: u64, bytes: &mut [u8]) -> Result<()> {
        let there = self.read_at(offset, bytes)?;
        if there < bytes.len() {
            return Err(self.wrong(format!(
                "was truncated while being read: byte {} is missing",
                offset + there as u64
            )));
        }
        Ok(())
    }

    /// Reads up to `length` bytes from `offset`; never allocates more than the file has.
    pub fn take(&self, offset: u64, length: u64) -> Result<Vec<u8>> {
        let mut bytes = vec![0; length.min(self.length.saturating_sub(offset)) as usize];
        let there = self.read_at(offset, &mut bytes)?;
        bytes.truncate(there);
        Ok(bytes)
    }

    /// Returns a sequential reader from `offset`.
    pub fn stream(&self, offset: u64) -> Stream<'_> {
        Stream { input: self, offset }
    }

    pub fn wrong(&self, what: impl Into<String>) -> Error {
        Error::format(&self.path, what)
    }

    /// Returns the file's name, for notes and stations.
    pub fn name(&self) -> String {
        name_of(&self.path)
    }
}

/// Returns the name of a file; of a cloud in several files that of their folder.
pub fn name_of(path: &Path) -> String {
    let folder = path.parent().filter(|_| OCTREES.iter().any(|name| path.ends_with(name)));
    let name = folder.and_then(Path::file_name).or(path.file_name());
    name.unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

impl Contents {
    fn read_some_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        match self {
            Contents::File(file) => read_some_at(file, bytes, offset),
            Contents::Made(made) => {
                let rest = usize::try_from(offset)
                    .ok()
                    .and_then(|offset| made.get(offset..))
                    .unwrap_or_default();
                let count = rest.len().min(bytes.len());
                bytes[..count].copy_from_slice(&rest[..count]);
                Ok(count)
            }
        }
    }
}

#[cfg(unix)]
fn read_some_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
    std::os::unix::fs::FileExt::read_at(file, bytes, offset)
}

#[cfg(windows)]
fn read_some_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
    std::os::windows::fs::FileExt::seek_read(file, bytes, offset)
}

pub struct Stream<'a> {
    input: &'a Input,
    offset: u64,
}

impl io::Read for Stream<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let count = self.input.contents.read_some_at(bytes, self.offset)?;
        self.offset += count as u64;
        Ok(count)
    }
}

/// Progress of a file in units of [`Meter::STEP`], reported from any thread.
pub struct Meter<'a> {
    progress: &'a dyn Progress,
    doing: String,
    done: AtomicU64,
    total: u64,
}

impl<'a> Meter<'a> {
    const STEP: u64 = 1 << 20;

    pub fn new(progress: &'a dyn Progress, input: &Input, total: u64) -> Self {
        Self::named(progress, &input.name(), total)
    }

    pub fn named(progress: &'a dyn Progress, name: &str, total: u64) -> Self {
        Self { progress, doing: format!("reading {name}"), done: AtomicU64::new(0), total }
    }

    pub fn advance(&self, count: u64) -> Result<()> {
        let before = self.done.fetch_add(count, Ordering::Relaxed);
        let after = before + count;
        if before / Self::STEP != after / Self::STEP || before == 0 {
            self.progress.tick(&self.doing, after.min(self.total), self.total)
        } else {
            Ok(())
        }
    }
}
