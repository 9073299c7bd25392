//! Blocks of an object on the disk, in one sparse file.
//!
//! ```text
//! head, 1024 bytes   length and tag of the object, CRC-32C
//! blocks             block k at its own place: 64 KiB, then their CRC-32C
//! ```
//!
//! A block is there if its checksum is right: a hole, a half-written block and a file of another
//! process that was emptied are all the same, blocks to be fetched. So processes share a file
//! without asking each other. All files together have a limit of bytes ([`super::Cache`]):
//! those that were not used for longest are removed, and one that is too large by itself begins
//! anew.

use super::{Cache, cache};
use crate::atomic_file::temporary_file;
use std::collections::HashSet;
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::SystemTime;

/// Bytes of a block: small beside a node, so that little is read in vain.
pub const BLOCK: u64 = 64 << 10;

const CRC: u64 = 4;
const HEAD: u64 = 1024;

/// Ending of the names of files.
const ENDING: &str = "blocks";

/// Share of the limit that is written before the folder is measured again.
const MEASURED: u64 = 16;

/// Bytes written since the folder was measured.
static WRITTEN: AtomicU64 = AtomicU64::new(0);

/// An open file of blocks.
pub struct Blocks {
    file: File,
    /// Blocks that were there.
    known: HashSet<u64>,
}

/// Returns the file in which the blocks of an object are; `None` if they are kept nowhere. The key
/// stands for all that its contents depend on.
fn place(cache: &Cache, key: &str) -> Option<PathBuf> {
    let name = blake3::hash(key.as_bytes()).to_hex();
    cache.folder.as_ref().map(|folder| folder.join(format!("{}.{ENDING}", &name[..32])))
}

impl Blocks {
    /// Opens or creates the file of an object of this length and tag.
    pub fn create(key: &str, length: u64, tag: &str) -> io::Result<Blocks> {
        let cache = cache();
        let file = match place(&cache, key) {
            None => {
                let path = std::env::temp_dir().join("pointillist.blocks");
                temporary_file(&path).map_err(io::Error::other)?
            }
            Some(path) => {
                std::fs::create_dir_all(path.parent().unwrap_or(Path::new(".")))?;
                let mut options = OpenOptions::new();
                options.read(true).write(true).create(true).truncate(false).open(&path)?
            }
        };
        let mut blocks = Blocks { file, known: HashSet::new() };
        if blocks.head() != Some((length, tag.to_string())) {
            blocks.file.set_len(0)?;
            blocks.write_head(length, tag)?;
        }
        // Last use; it decides which files are removed first.
        let _ = blocks.file.set_modified(SystemTime::now());
        Ok(blocks)
    }

    /// Opens the file of an object if there is one. Returns the object's length and tag, too.
    pub fn find(key: &str) -> Option<(Blocks, u64, String)> {
        let path = place(&cache(), key)?;
        let file = OpenOptions::new().read(true).write(true).open(path).ok()?;
        let mut blocks = Blocks { file, known: HashSet::new() };
        let (length, tag) = blocks.head()?;
        let _ = blocks.file.set_modified(SystemTime::now());
        Some((blocks, length, tag))
    }

    fn head(&mut self) -> Option<(u64, String)> {
        let mut head = vec![0; HEAD as usize];
        self.file.seek(SeekFrom::Start(0)).ok()?;
        self.file.read_exact(&mut head).ok()?;
        let (head, crc) = head.split_at((HEAD - CRC) as usize);
        if crc32c::crc32c(head).to_le_bytes() != crc {
            return None;
        }
        let length = u64::from_le_bytes(head[..8].try_into().ok()?);
        let tag_bytes = u16::from_le_bytes(head[8..10].try_into().ok()?) as usize;
        Some((length, String::from_utf8(head.get(10..10 + tag_bytes)?.to_vec()).ok()?))
    }

    fn write_head(&mut self, length: u64, tag: &str) -> io::Result<()> {
        let mut head = length.to_le_bytes().to_vec();
        head.extend((tag.len() as u16).to_le_bytes());
        head.extend(tag.as_bytes());
        if head.len() as u64 > HEAD - CRC {
            return Err(io::Error::other("the object's tag is too long"));
        }
        head.resize((HEAD - CRC) as usize, 0);
        head.extend(crc32c::crc32c(&head).to_le_bytes());
        self.file.seek(SeekFrom::Start(0))?;
        self.file.write_all(&head)
    }

    /// Tests whether a block is there, or was there a short time ago.
    pub fn has(&mut self, block: u64, bytes: usize) -> bool {
        self.known.contains(&block) || self.read(block, bytes).is_some()
    }

    /// Reads a block of this many bytes; `None` if it is not there.
    pub fn read(&mut self, block: u64, bytes: usize) -> Option<Vec<u8>> {
        let read = self.slot(block, bytes);
        if read.is_some() {
            self.known.insert(block)
        } else {
            self.known.remove(&block)
        };
        read
    }

    fn slot(&mut self, block: u64, bytes: usize) -> Option<Vec<u8>> {
        let mut slot = vec![0; (BLOCK + CRC) as usize];
        self.file.seek(SeekFrom::Start(HEAD + block * (BLOCK + CRC))).ok()?;
        self.file.read_exact(&mut slot).ok()?;
        let crc = slot.split_off(BLOCK as usize);
        slot.truncate(if crc32c::crc32c(&slot).to_le_bytes() == *crc { bytes } else { 0 });
        (slot.len() == bytes).then_some(slot)
    }

    /// Writes a block, the last one of an object maybe shorter.
    pub fn write(&mut self, block: u64, bytes: &[u8]) -> io::Result<()> {
        let mut slot = bytes.to_vec();
        slot.resize(BLOCK as usize, 0);
        slot.extend(crc32c::crc32c(&slot).to_le_bytes());
        self.file.seek(SeekFrom::Start(HEAD + block * (BLOCK + CRC)))?;
        self.file.write_all(&slot)?;
        self.known.insert(block);
        let cache = cache();
        let written = WRITTEN.fetch_add(slot.len() as u64, Relaxed) + slot.len() as u64;
        if let Some(folder) = cache.folder.as_ref().filter(|_| written > cache.most / MEASURED) {
            WRITTEN.store(0, Relaxed);
            let _ = self.file.set_modified(SystemTime::now());
            shrink(folder, cache.most);
        }
        Ok(())
    }
}

/// Removes files, the longest unused first, until the others have at most this many bytes. The last
/// used one is emptied, since its blocks are being read.
fn shrink(folder: &Path, most: u64) {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<(SystemTime, u64, PathBuf)> = entries
        .filter(|entry| entry.path().extension().is_some_and(|ending| ending == ENDING))
        .filter_map(|entry| {
            let data = entry.metadata().ok()?;
            Some((data.modified().ok()?, on_disk(&data), entry.path()))
        })
        .collect();
    files.sort();
    let mut all: u64 = files.iter().map(|(_, bytes, _)| bytes).sum();
    let last = files.len();
    for (number, (_, bytes, path)) in files.into_iter().enumerate() {
        if all <= most {
            break;
        }
        // Emptied first, since an open file keeps its bytes.
        let emptied = OpenOptions::new().write(true).open(&path).and_then(|file| file.set_len(0));
        if emptied.is_ok() && number + 1 < last {
            let _ = std::fs::remove_file(&path);
        }
        all -= bytes;
    }
}

/// Returns the bytes that a file has on the disk, holes left out.
#[cfg(unix)]
fn on_disk(data: &std::fs::Metadata) -> u64 {
    std::os::unix::fs::MetadataExt::blocks(data) * 512
}

#[cfg(not(unix))]
fn on_disk(data: &std::fs::Metadata) -> u64 {
    data.len()
}
