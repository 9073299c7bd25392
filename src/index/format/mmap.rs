//! A read-only file map that survives a shrinking file.
//!
//! Touching a mapped page that a shrinking file has lost ends a program with SIGBUS, and checking
//! the length first only makes that rarer. So on Linux the kernel copies: `process_vm_readv` on our
//! own memory reports such a page as an error. On other systems the file is read by position. Bytes
//! that turn zero after a shrink are found by checksums.

use crate::error::{Error, Result};
use memmap2::Mmap;
use std::fs::File;
use std::path::{Path, PathBuf};

pub struct Map {
    path: PathBuf,
    file: File,
    map: Mmap,
}

impl Map {
    pub fn open(path: &Path) -> Result<Map> {
        let found = std::fs::metadata(path).map_err(|error| Error::io("open", path, error))?;
        // Opening a pipe would wait for a writer.
        if !found.is_file() {
            return Err(Error::format(path, "is a folder, a pipe or a device, not a file"));
        }
        let file = File::open(path).map_err(|error| Error::io("open", path, error))?;
        // SAFETY: no slice of the map is ever made; only the kernel copies its bytes, for which a
        // page that changes or disappears is no undefined behaviour.
        let map = unsafe { Mmap::map(&file) }.map_err(|error| Error::io("map", path, error))?;
        Ok(Map { path: path.to_owned(), file, map })
    }

    /// Returns the length when it was opened `[bytes]`.
    pub fn len(&self) -> u64 {
        self.map.len() as u64
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Copies the bytes from `at` on; errors if some of them are missing.
    pub fn copy(&self, at: u64, into: &mut [u8]) -> Result<()> {
        if at.checked_add(into.len() as u64).is_none_or(|end| end > self.len()) {
            return Err(Error::format(
                &self.path,
                format!(
                    "has no bytes {at} to {}: it is damaged",
                    at.saturating_add(into.len() as u64)
                ),
            ));
        }
        if into.is_empty() {
            return Ok(());
        }
        self.copy_out(at, into)
    }

    #[cfg(target_os = "linux")]
    fn copy_out(&self, at: u64, into: &mut [u8]) -> Result<()> {
        let mut done = 0;
        while done < into.len() {
            let rest = into.len() - done;
            let to = libc::iovec { iov_base: into[done..].as_mut_ptr().cast(), iov_len: rest };
            let from = libc::iovec {
                iov_base: self.map.as_ptr().wrapping_add(at as usize + done).cast_mut().cast(),
                iov_len: rest,
            };
            // SAFETY: `to` is a live, exclusive slice, `from` lies within the map; the kernel
            // checks both and touches nothing else.
            let copied = unsafe { libc::process_vm_readv(libc::getpid(), &to, 1, &from, 1, 0) };
            match copied {
                1.. => done += copied as usize,
                _ => {
                    let why = std::io::Error::last_os_error();
                    match why.raw_os_error() {
                        Some(libc::EINTR) => {}
                        Some(libc::EFAULT) | Some(0) | None => {
                            return Err(Error::format(
                                &self.path,
                                format!(
                                    "became shorter while it was open: byte {} is gone",
                                    at + done as u64
                                ),
                            ));
                        }
                        // Containers may forbid the call; reading by position is equivalent.
                        Some(libc::EPERM) | Some(libc::ENOSYS) => {
                            return self.read(at + done as u64, &mut into[done..]);
                        }
                        _ => return Err(Error::io("read", &self.path, why)),
                    }
                }
            }
        }
        Ok(())
    }

    #[cfg(not(target_os = "linux"))]
    fn copy_out(&self, at: u64, into: &mut [u8]) -> Result<()> {
        self.read(at, into)
    }

    fn read(&self, at: u64, into: &mut [u8]) -> Result<()> {
        #[cfg(unix)]
        let read = std::os::unix::fs::FileExt::read_exact_at(&self.file, into, at);
        #[cfg(windows)]
        let read = std::os::windows::fs::FileExt::seek_read(&self.file, into, at).map(|_| ());
        read.map_err(|error| Error::io("read", &self.path, error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_shrinks_is_an_error_and_not_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map");
        std::fs::write(&path, vec![7u8; 1 << 20]).unwrap();
        let map = Map::open(&path).unwrap();
        let mut bytes = vec![0; 1 << 20];
        map.copy(0, &mut bytes).unwrap();
        assert!(bytes.iter().all(|&b| b == 7));
        std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(10_000).unwrap();
        assert!(map.copy(0, &mut bytes).unwrap_err().to_string().contains("shorter"));
        assert!(map.copy((1 << 20) - 1, &mut bytes[..2]).is_err());
        map.copy(0, &mut bytes[..10_000]).unwrap();
    }
}
