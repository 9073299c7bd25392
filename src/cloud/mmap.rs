//! Files read by position, and a read-only map that survives a shrinking file.
//!
//! Touching a mapped page that a shrinking file has lost ends a program with SIGBUS, and checking
//! the length first only makes that rarer. So on Linux the kernel copies: `process_vm_readv` on our
//! own memory reports such a page as an error. On other systems the file is read by position. Bytes
//! that turn zero after a shrink are found by checksums.

use memmap2::Mmap;
use std::fs::File;
use std::io;

pub struct Map {
    file: File,
    map: Mmap,
}

impl Map {
    pub fn new(file: File) -> io::Result<Map> {
        // SAFETY: no slice of the map is ever made; only the kernel copies its bytes, for which a
        // page that changes or disappears is no undefined behaviour.
        let map = unsafe { Mmap::map(&file) }?;
        Ok(Map { file, map })
    }

    /// Copies bytes from `at` on. Returns their number, 0 where the file has none, or none any
    /// more.
    #[cfg(target_os = "linux")]
    pub fn read_some_at(&self, bytes: &mut [u8], at: u64) -> io::Result<usize> {
        let count = (self.map.len() as u64).saturating_sub(at).min(bytes.len() as u64) as usize;
        if count == 0 {
            return Ok(0);
        }
        let to = libc::iovec { iov_base: bytes.as_mut_ptr().cast(), iov_len: count };
        let from = libc::iovec {
            iov_base: self.map.as_ptr().wrapping_add(at as usize).cast_mut().cast(),
            iov_len: count,
        };
        // SAFETY: `to` is a live, exclusive slice, `from` lies within the map; the kernel checks
        // both and touches nothing else.
        let copied = unsafe { libc::process_vm_readv(libc::getpid(), &to, 1, &from, 1, 0) };
        if copied >= 0 {
            return Ok(copied as usize);
        }
        let error = io::Error::last_os_error();
        match error.raw_os_error() {
            Some(libc::EFAULT) => Ok(0),
            // Containers may forbid the call; reading by position is equivalent.
            Some(libc::EPERM | libc::ENOSYS) => read_some_at(&self.file, bytes, at),
            _ => Err(error),
        }
    }

    /// Copies bytes from `at` on. Returns their number, 0 where the file has none, or none any
    /// more.
    #[cfg(not(target_os = "linux"))]
    pub fn read_some_at(&self, bytes: &mut [u8], at: u64) -> io::Result<usize> {
        let count = (self.map.len() as u64).saturating_sub(at).min(bytes.len() as u64) as usize;
        read_some_at(&self.file, &mut bytes[..count], at)
    }
}

/// Reads bytes from `offset` on. Returns their number, 0 at the end of the file.
#[cfg(unix)]
pub(super) fn read_some_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
    std::os::unix::fs::FileExt::read_at(file, bytes, offset)
}

/// Reads bytes from `offset` on. Returns their number, 0 at the end of the file.
#[cfg(windows)]
pub(super) fn read_some_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
    std::os::windows::fs::FileExt::seek_read(file, bytes, offset)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_shrinks_is_an_error_and_not_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map");
        std::fs::write(&path, vec![7u8; 1 << 20]).unwrap();
        let map = Map::new(File::open(&path).unwrap()).unwrap();
        let mut bytes = vec![0; 1 << 20];
        assert_eq!(map.read_some_at(&mut bytes, 0).unwrap(), 1 << 20);
        assert!(bytes.iter().all(|&byte| byte == 7));
        assert_eq!(map.read_some_at(&mut bytes, 1 << 20).unwrap(), 0);
        std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(10_000).unwrap();
        // The rest of the last page is zeros.
        assert!(map.read_some_at(&mut bytes, 0).unwrap() < 1 << 16);
        assert_eq!(map.read_some_at(&mut bytes[..2], (1 << 20) - 2).unwrap(), 0);
        assert_eq!(map.read_some_at(&mut bytes[..10_000], 0).unwrap(), 10_000);
        assert!(bytes[..10_000].iter().all(|&byte| byte == 7));
    }
}
