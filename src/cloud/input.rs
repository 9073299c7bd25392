//! Inputs, read by position: files, and objects on servers.
//!
//! Readers request ranges from several threads at once, so there is no shared file position. What
//! will be read is stated beforehand ([`Input::ahead`]), so that servers are asked for much at a
//! time. Indexes, whose nodes are read again and again, are mapped; other files are read once.

use super::column_file::ColumnFile;
use super::mmap::{Map, read_some_at};
use super::rgb_range::RgbRange;
use crate::error::{Error, Result};
use crate::network::{self, Object};
use crate::progress::{Progress, Silent};
use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

pub struct Input {
    pub path: PathBuf,
    /// Length when opened; a file that shrinks later fails the read that finds it.
    pub length: u64,
    /// Colour range given by the user.
    pub rgb_range: Option<RgbRange>,
    /// Takes points that are too many for memory.
    pub column_file: Option<Arc<ColumnFile>>,
    contents: Contents,
}

enum Contents {
    File(File),
    Mapped(Map),
    Remote(Arc<Object>),
    /// Bytes to read instead of a file's.
    Made(Arc<[u8]>),
    Decoded(Box<dyn Decoded>),
}

/// Another form of the bytes of a file, read by position.
pub trait Decoded: Send + Sync {
    /// Reads bytes, as many as there are at hand. Returns their number, 0 at the end.
    fn read_some_at(&self, bytes: &mut [u8], offset: u64) -> Result<usize>;
}

/// Descriptions of clouds in several files, those of Potree 2 and EPT. A folder with one is opened
/// by it.
pub const OCTREES: [&str; 2] = ["metadata.json", "ept.json"];

impl Input {
    /// Opens a file, or the description of a cloud in a folder; also by an address. Refuses pipes
    /// and devices by their metadata, since opening a pipe would wait for a writer.
    pub fn open(path: &Path) -> Result<Self> {
        Input::open_slowly(path, &Silent)
    }

    /// Opens a file as [`Input::open`], with reports of progress while a server does not answer.
    pub fn open_slowly(path: &Path, progress: &dyn Progress) -> Result<Self> {
        if let Some(path) = network::path_of_file_address(path) {
            return Input::open(&path);
        }
        if network::is_address(path) {
            return Input::open_address(path, progress);
        }
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
            column_file: None,
            contents: Contents::File(file),
        })
    }

    /// Opens a file as [`Input::open`], to be read again and again.
    pub fn open_mapped(path: &Path) -> Result<Self> {
        let mut input = Input::open(path)?;
        if let Contents::File(file) = input.contents {
            let map = Map::new(file).map_err(|source| Error::io("map", path, source))?;
            input.contents = Contents::Mapped(map);
        }
        Ok(input)
    }

    /// Opens an object on a server. A name without an ending may be that of a folder.
    fn open_address(path: &Path, progress: &dyn Progress) -> Result<Self> {
        let name = network::without_query(path);
        let is_folder = name.to_string_lossy().ends_with('/');
        if is_folder || name.extension().is_none() {
            let inner = network::beside(path, &name_in_folder(name, is_folder));
            for description in OCTREES {
                let path = network::beside(&inner, description);
                match Object::open(&path, progress) {
                    Ok(object) => return Ok(Input::remote(path, object)),
                    Err(error) if !Object::is_missing(&path) => return Err(error),
                    Err(_) => {}
                }
            }
            if is_folder {
                return Err(Error::format(
                    path,
                    "has neither metadata.json (Potree) nor ept.json (EPT); give the address of a file",
                ));
            }
        }
        Object::open(path, progress).map(|object| Input::remote(path.to_owned(), object))
    }

    fn remote(path: PathBuf, object: Arc<Object>) -> Self {
        let (length, contents) = (object.length(), Contents::Remote(object));
        Input { path, length, rgb_range: None, column_file: None, contents }
    }

    /// Returns the folder of the file, for the files that belong to it.
    pub fn folder(&self) -> Folder {
        let object = match &self.contents {
            Contents::Remote(object) => Some(object.clone()),
            _ => None,
        };
        Folder { path: self.path.clone(), object }
    }

    /// Announces that ranges will be read. Files need no announcement.
    pub fn ahead(&self, ranges: impl Iterator<Item = Range<u64>>) {
        if let Contents::Remote(object) = &self.contents {
            object.ahead(&ranges.collect::<Vec<_>>());
        }
    }

    /// Tests whether it is on a server.
    pub fn is_remote(&self) -> bool {
        matches!(self.contents, Contents::Remote(_))
    }

    /// Returns what tells an object on a server from its other versions.
    pub fn tag(&self) -> Option<&str> {
        match &self.contents {
            Contents::Remote(object) => Some(object.tag()),
            _ => None,
        }
    }

    /// Fetches all of an object on a server, for readers that read all.
    pub fn download(&self, progress: &dyn Progress) -> Result<()> {
        match &self.contents {
            Contents::Remote(object) => object.download(&self.name(), progress),
            _ => Ok(()),
        }
    }

    /// Returns an input with these contents.
    pub fn made(path: PathBuf, bytes: Vec<u8>) -> Input {
        Input {
            path,
            length: bytes.len() as u64,
            rgb_range: None,
            column_file: None,
            contents: Contents::Made(bytes.into()),
        }
    }

    /// Returns the same input once more.
    pub fn again(&self) -> Result<Input> {
        let contents = match &self.contents {
            Contents::Remote(object) => Contents::Remote(object.clone()),
            Contents::Made(bytes) => Contents::Made(bytes.clone()),
            _ => Input::open(&self.path)?.contents,
        };
        let (path, column_file) = (self.path.clone(), self.column_file.clone());
        Ok(Input { path, column_file, contents, ..*self })
    }

    /// Returns the same file in another form, of this length.
    pub fn decoded(&self, length: u64, decoded: impl Decoded + 'static) -> Input {
        let (path, column_file) = (self.path.clone(), self.column_file.clone());
        Input { path, length, column_file, contents: Contents::Decoded(Box::new(decoded)), ..*self }
    }

    /// Returns the input with the user's colour range.
    pub fn counting_to(self, rgb_range: Option<RgbRange>) -> Self {
        Self { rgb_range, ..self }
    }

    /// Returns the input with a file for points that are too many for memory.
    pub fn spilling_to(self, file: &Arc<ColumnFile>) -> Self {
        Self { column_file: Some(file.clone()), ..self }
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
                // What the network says names the address.
                Err(error) => match error.downcast() {
                    Ok(own) => return Err(own),
                    Err(error) => return Err(Error::io("read", &self.path, error)),
                },
            }
        }
        Ok(filled)
    }

    /// Fills all of `bytes`. Errors if the file has been truncated since it was opened.
    pub fn read_exactly(&self, offset: u64, bytes: &mut [u8]) -> Result<()> {
        let there = self.read_at(offset, bytes)?;
        if there < bytes.len() {
            return Err(self.wrong(format!(
                "became shorter while it was open: byte {} is gone",
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

/// The folder of a file, with other files that belong to it.
pub struct Folder {
    /// Path of the file.
    path: PathBuf,
    object: Option<Arc<Object>>,
}

impl Folder {
    pub fn path_of(&self, name: &str) -> PathBuf {
        network::beside(&self.path, name)
    }

    /// Opens a file in the folder, or below it.
    pub fn open(&self, name: &str) -> Result<Input> {
        let path = self.path_of(name);
        match &self.object {
            Some(object) => object.member(&path).map(|member| Input::remote(path, member)),
            None => Input::open(&path),
        }
    }

    /// Announces that files will be opened. Those on a disk need no announcement.
    pub fn ahead(&self, names: impl Iterator<Item = String>) {
        if let Some(object) = &self.object {
            object.members_ahead(&names.map(|name| self.path_of(&name)).collect::<Vec<_>>());
        }
    }

    /// Tests whether it is on a server.
    pub fn is_remote(&self) -> bool {
        self.object.is_some()
    }
}

/// Returns a name in the folder that an address names, as seen from the folder above.
fn name_in_folder(name: &Path, ends: bool) -> String {
    let folder = name.file_name().unwrap_or_default().to_string_lossy();
    if ends { "-".into() } else { format!("{folder}/-") }
}

/// Returns the name of a file; of a cloud in several files that of their folder.
pub fn name_of(path: &Path) -> String {
    let path = network::without_query(path);
    let folder = path.parent().filter(|_| OCTREES.iter().any(|name| path.ends_with(name)));
    let name = folder.and_then(Path::file_name).or(path.file_name());
    name.unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

impl Contents {
    fn read_some_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        match self {
            Contents::File(file) => read_some_at(file, bytes, offset),
            Contents::Mapped(map) => map.read_some_at(bytes, offset),
            Contents::Remote(object) => object.read_at(offset, bytes).map_err(io::Error::other),
            Contents::Decoded(decoded) => {
                decoded.read_some_at(bytes, offset).map_err(io::Error::other)
            }
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
    /// Where points wait that are too many for memory.
    column_file: Option<Arc<ColumnFile>>,
    doing: String,
    done: AtomicU64,
    total: u64,
}

impl<'a> Meter<'a> {
    const STEP: u64 = 1 << 20;

    pub fn new(progress: &'a dyn Progress, input: &Input, total: u64) -> Self {
        let column_file = input.column_file.clone();
        Self { column_file, ..Self::named(progress, &input.name(), total) }
    }

    pub fn named(progress: &'a dyn Progress, name: &str, total: u64) -> Self {
        let (doing, done) = (format!("reading {name}"), AtomicU64::new(0));
        Self { progress, column_file: None, doing, done, total }
    }

    pub fn advance(&self, count: u64) -> Result<()> {
        let before = self.done.fetch_add(count, Ordering::Relaxed);
        let after = before + count;
        if before / Self::STEP != after / Self::STEP || before == 0 {
            // Reading on is for nothing once a point is lost.
            self.column_file.as_ref().map_or(Ok(()), |file| file.check())?;
            self.progress.tick(&self.doing, after.min(self.total), self.total)
        } else {
            Ok(())
        }
    }
}
