//! A file that is there whole or not at all.
//!
//! In: a path, and somebody who writes. Out: the file, under its own name only once it is complete and on the disk. Until then it lies beside
//! its place as `.NAME.partial-PID`, or with another number where that one is taken; it is removed when writing fails, when Ctrl-C ends the work, and when the process leaves in a hurry. What a killed
//! process left is removed by the next one that writes the same name: whoever writes holds a lock on its partial file, so one that can be locked is stale.

use crate::error::{Error, Result};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// What is being written at this moment, for [`abandon_all`].
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// A file on its way: write to [`AtomicFile::partial`], then [`AtomicFile::finish`]. Dropped before that, it leaves nothing.
pub struct AtomicFile {
    path: PathBuf,
    /// None once it has its name.
    partial: Option<PathBuf>,
    /// Locked as long as it is being written.
    _lock: File,
}

impl AtomicFile {
    /// Creates the empty partial file, so that a folder that cannot be written to is refused before the work is done.
    pub fn create(path: &Path) -> Result<AtomicFile> {
        // A rename would put a file in the place of a pipe, and as root in the place of /dev/null.
        if path.metadata().is_ok_and(|found| !found.is_file()) {
            return Err(Error::Request(format!(
                "cannot write {}: it is a folder, a pipe or a device; name a file",
                path.display()
            )));
        }
        let begin = partial_begin(path)?;
        remove_stale(path, &begin);
        let (partial, lock) = claim(path, &begin)?;
        Ok(AtomicFile { path: path.to_owned(), partial: Some(partial), _lock: lock })
    }

    pub fn partial(&self) -> &Path {
        self.partial.as_deref().unwrap_or(&self.path)
    }

    /// Brings the contents to the disk, gives the file its name, and brings that to the disk too.
    pub fn finish(mut self) -> Result<()> {
        let synced =
            OpenOptions::new().write(true).open(self.partial()).and_then(|file| file.sync_all());
        let named = synced.and_then(|()| self.rename());
        named
            .and_then(|()| sync_folder(&self.path))
            .map_err(|error| Error::io("write", &self.path, error))
    }

    fn rename(&mut self) -> std::io::Result<()> {
        // Under the lock, because from the rename on somebody else may have the partial name.
        let mut unfinished = unfinished();
        std::fs::rename(self.partial(), &self.path)?;
        let partial = self.partial.take();
        unfinished.retain(|other| Some(other) != partial.as_ref());
        Ok(())
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        let Some(partial) = self.partial.take() else { return };
        let mut unfinished = unfinished();
        // Nobody is left to tell if that fails.
        let _ = std::fs::remove_file(&partial);
        unfinished.retain(|other| *other != partial);
    }
}

/// Writes `path` whole, or not at all.
pub fn write_atomically(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let file = AtomicFile::create(path)?;
    write(file.partial())?;
    file.finish()
}

/// A nameless file beside `path`, to read and write, which the system removes with the process, however that ends. Killed within the instant in which it
/// has a name, it is as stale as a partial file.
pub fn temporary_file(path: &Path) -> Result<File> {
    let (partial, file) = claim(path, &partial_begin(path)?)?;
    let mut unfinished = unfinished();
    let removed = std::fs::remove_file(&partial);
    unfinished.retain(|other| *other != partial);
    removed.map_err(|error| Error::io("remove", &partial, error))?;
    Ok(file)
}

/// What the names of partial files of `path` begin with.
fn partial_begin(path: &Path) -> Result<String> {
    let name = path
        .file_name()
        .ok_or_else(|| Error::Request(format!("{} is not a file name", path.display())))?;
    Ok(format!(".{}.partial-", shortened(&name.to_string_lossy(), NAME_BYTES - 1 - PARTIAL_BYTES)))
}

/// Process numbers are smaller on every system.
const NUMBERS: u32 = 1 << 22;

/// Creates a partial file that nobody else has, and locks it.
fn claim(path: &Path, begin: &str) -> Result<(PathBuf, File)> {
    let failed = |error| Error::io("create", path, error);
    // Another writer in this process, or one in a container with a process of the same number, may have the first.
    for number in (0..u32::MAX / NUMBERS).map(|k| k * NUMBERS + std::process::id() % NUMBERS) {
        let partial = path.with_file_name(format!("{begin}{number}"));
        let mut unfinished = unfinished();
        let file = match OpenOptions::new().read(true).write(true).create_new(true).open(&partial) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => continue,
            created => created.map_err(failed)?,
        };
        // Before it was locked it looked stale: whoever has the lock, or had it, has removed it. Where a file system has no locks nothing is told to be stale.
        if matches!(file.try_lock(), Err(TryLockError::WouldBlock)) || !is_at(&file, &partial) {
            continue;
        }
        unfinished.push(partial.clone());
        return Ok((partial, file));
    }
    Err(failed(ErrorKind::AlreadyExists.into()))
}

/// Whether a file is still where it was created; where the system does not say, it is.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let identity = |found: std::fs::Metadata| (found.dev(), found.ino());
    match (file.metadata(), path.symlink_metadata()) {
        (Ok(own), Ok(there)) => identity(own) == identity(there),
        (_, Err(error)) => error.kind() != ErrorKind::NotFound,
        (Err(_), Ok(_)) => true,
    }
}

#[cfg(not(unix))]
fn is_at(_file: &File, path: &Path) -> bool {
    path.exists()
}

/// Removes whatever is half written, for a process that is about to exit without unwinding.
pub fn remove_unfinished() {
    for partial in unfinished().drain(..) {
        // It may have been renamed this instant.
        let _ = std::fs::remove_file(partial);
    }
}

/// Partial files of the same name whose writer is gone.
fn remove_stale(path: &Path, begin: &str) {
    let folder =
        path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let is_partial = entry
            .file_name()
            .to_str()
            .and_then(|name| name.strip_prefix(begin))
            .is_some_and(|pid| pid.parse::<u32>().is_ok());
        // Names of this process come and go under the same lock, so that what is removed is what was found.
        let unfinished = unfinished();
        let is_stale = |path: &Path| {
            OpenOptions::new()
                .write(true)
                .open(path)
                .is_ok_and(|file| file.try_lock().is_ok() && is_at(&file, path))
        };
        if is_partial && !unfinished.contains(&entry.path()) && is_stale(&entry.path()) {
            // Whoever else is removing it has the same in mind.
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

#[cfg(unix)]
fn sync_folder(path: &Path) -> std::io::Result<()> {
    let folder =
        path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    File::open(folder)?.sync_all()
}

#[cfg(not(unix))]
fn sync_folder(_path: &Path) -> std::io::Result<()> {
    Ok(())
}

fn unfinished() -> std::sync::MutexGuard<'static, Vec<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// What file systems allow a name.
const NAME_BYTES: usize = 255;
/// Of ".partial-" and a process number.
const PARTIAL_BYTES: usize = 19;

fn shortened(name: &str, bytes: usize) -> &str {
    &name[..name.floor_char_boundary(bytes)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_names_are_cut_between_characters() {
        assert_eq!((shortened("aéé", 4), shortened("aéé", 9)), ("aé", "aéé"));
    }

    #[test]
    fn what_a_killed_writer_left_is_removed_and_what_a_living_one_writes_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let (stale, alive) = (
            folder.path().join(".a.png.partial-4000001"),
            folder.path().join(".a.png.partial-4000002"),
        );
        std::fs::write(&stale, "half").unwrap();
        let living = File::create(&alive).unwrap();
        living.lock().unwrap();
        write_atomically(&path, |partial| {
            std::fs::write(partial, "new").map_err(|error| Error::io("write", partial, error))
        })
        .unwrap();
        assert!(!stale.exists() && alive.exists() && path.exists());
    }

    #[test]
    fn two_writers_in_one_process_do_not_share_a_partial_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let (first, second) =
            (AtomicFile::create(&path).unwrap(), AtomicFile::create(&path).unwrap());
        std::fs::write(first.partial(), "first").unwrap();
        std::fs::write(second.partial(), "second").unwrap();
        first.finish().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        let third = AtomicFile::create(&path).unwrap();
        second.finish().unwrap();
        assert!(third.partial().exists());
        drop(third);
        assert_eq!(std::fs::read(&path).unwrap(), b"second");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn many_writers_of_one_name_leave_one_whole_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let write = |v: u8| {
            for _ in 0..200 {
                write_atomically(&path, |partial| {
                    std::fs::write(partial, [v; 5000])
                        .map_err(|error| Error::io("write", partial, error))
                })
                .unwrap();
                drop(temporary_file(&path).unwrap());
            }
        };
        std::thread::scope(|scope| {
            (0..4).for_each(|v| {
                drop(scope.spawn({
                    let write = &write;
                    move || write(v)
                }))
            })
        });
        let left = std::fs::read(&path).unwrap();
        assert!(left.len() == 5000 && left.iter().all(|&v| v == left[0]));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_fails_leaves_nothing_and_keeps_what_was_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.png");
        std::fs::write(&path, "old").unwrap();
        let failing = write_atomically(&path, |partial| {
            std::fs::write(partial, "half").unwrap();
            Err(Error::Interrupted)
        });
        assert!(failing.is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        write_atomically(&path, |partial| {
            std::fs::write(partial, "new").map_err(|error| Error::io("write", partial, error))
        })
        .unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
