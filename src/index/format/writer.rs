//! Writer of index files: planes at any place, then the directory, then the header.

use super::schema::{Contents, Directory};
use crate::atomic_file::AtomicFile;
use crate::error::{Error, Result};
use bytemuck::{Pod, Zeroable};
use std::fs::File;
use std::path::{Path, PathBuf};

pub(super) const MAGIC: [u8; 8] = *b"pnti\r\n\x1a\n";
/// Version 2 added derived planes, version 3 station numbers of 8 bits; older versions can be read.
pub(super) const VERSION: u32 = 3;
pub(super) const HEADER_BYTES: u64 = 4096;

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct FileHeader {
    pub(super) magic: [u8; 8],
    pub(super) version: u32,
    pub(super) nodes: u32,
    pub(super) length: u64,
    pub(super) directory_at: u64,
    pub(super) contents_bytes: u64,
    pub(super) roots: u32,
    pub(super) directory_crc: u32,
    pub(super) header_crc: u32,
    pub(super) spare: u32,
}

impl FileHeader {
    pub(super) fn own_crc(&self) -> u32 {
        crc32c::crc32c(bytemuck::bytes_of(&FileHeader { header_crc: 0, ..*self }))
    }
}

/// An index being written.
pub struct Writer {
    whole: AtomicFile,
    file: File,
    path: PathBuf,
}

impl Writer {
    pub fn create(path: &Path) -> Result<Writer> {
        let whole = AtomicFile::create(path)?;
        let file = File::options()
            .read(true)
            .write(true)
            .open(whole.partial())
            .map_err(|error| Error::io("create", path, error))?;
        Ok(Writer { whole, file, path: path.to_owned() })
    }

    /// Offset of the first plane.
    pub const START: u64 = HEADER_BYTES;

    /// Writes planes, from any thread, each to its own range.
    pub fn put(&self, at: u64, bytes: &[u8]) -> Result<()> {
        std::os::unix::fs::FileExt::write_all_at(&self.file, bytes, at)
            .map_err(|error| Error::io("write", &self.path, error))?;
        self.start_writing_back(at, bytes.len());
        Ok(())
    }

    /// Starts writing a range back to the disk, so that `finish` has less to wait for. Only a hint.
    #[cfg(target_os = "linux")]
    fn start_writing_back(&self, at: u64, bytes: usize) {
        use std::os::fd::AsRawFd;
        // SAFETY: a system call on an open file.
        unsafe {
            libc::sync_file_range(
                self.file.as_raw_fd(),
                at as i64,
                bytes as i64,
                libc::SYNC_FILE_RANGE_WRITE,
            )
        };
    }

    #[cfg(not(target_os = "linux"))]
    fn start_writing_back(&self, _at: u64, _bytes: usize) {}

    /// Reads back what was written.
    pub fn get(&self, at: u64, bytes: &mut [u8]) -> Result<()> {
        std::os::unix::fs::FileExt::read_exact_at(&self.file, bytes, at)
            .map_err(|error| Error::io("read", &self.path, error))
    }

    /// Writes the directory, syncs, writes the header, syncs, and names the file. Returns its
    /// length.
    pub fn finish(self, directory: &Directory, end: u64) -> Result<u64> {
        let records: &[u8] = bytemuck::cast_slice(&directory.nodes);
        let contents = serde_json::to_vec(&directory.contents)
            .map_err(|error| Error::Request(error.to_string()))?;
        // JSON has no infinity, and a lattice that is rounded in its last digit moves every point.
        if !serde_json::from_slice(&contents)
            .is_ok_and(|again: Contents| again == directory.contents)
        {
            return Err(Error::Request(format!(
                "{}: the input has numbers that an index cannot store",
                self.path.display()
            )));
        }
        self.put(end, records)?;
        self.put(end + records.len() as u64, &contents)?;
        let length = end + (records.len() + contents.len()) as u64;
        let mut header = FileHeader {
            magic: MAGIC,
            version: VERSION,
            nodes: directory.nodes.len() as u32,
            length,
            directory_at: end,
            contents_bytes: contents.len() as u64,
            roots: directory.roots,
            directory_crc: crc32c::crc32c_append(crc32c::crc32c(records), &contents),
            header_crc: 0,
            spare: 0,
        };
        header.header_crc = header.own_crc();
        let mut page = vec![0; HEADER_BYTES as usize];
        page[..size_of::<FileHeader>()].copy_from_slice(bytemuck::bytes_of(&header));
        self.close(&page)?;
        Ok(length)
    }

    /// Syncs, writes the header, syncs, and names the file.
    pub fn close(self, header: &[u8]) -> Result<()> {
        self.file.sync_all().map_err(|error| Error::io("write", &self.path, error))?;
        self.put(0, header)?;
        self.whole.finish()
    }
}
