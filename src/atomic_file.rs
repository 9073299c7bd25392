//! Files that are complete or absent.
//!
//! A file gets its name only once it is complete and on the disk. Until then it is a partial file
//! beside its place, `.NAME.partial-PID`, or with another number if that is taken. The partial file
//! is removed when writing fails, on Ctrl-C, and when the process exits early. Links are followed:
//! what they point to is written. The name `-` is standard output, to which a complete file is
//! copied. Partial files of a
//! killed process are removed by the next writer of the same name: writers hold a lock on their
//! partial file, so one that can be locked is stale.

use crate::error::{Error, Result};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Partial files of this process, for [`remove_unfinished`].
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// A file being written: write to [`AtomicFile::partial`], then call [`AtomicFile::finish`].
/// Dropping it earlier leaves nothing.
pub struct AtomicFile {
    path: PathBuf,
    /// `None` once the file has its name.
    partial: Option<PathBuf>,
    /// Locked while the file is being written.
    _lock: File,
}

impl AtomicFile {
    /// Creates the empty partial file, so that a read-only folder is reported before the work is
    /// done.
    pub fn create(path: &Path) -> Result<AtomicFile> {
        if path == Path::new(STANDARD_OUTPUT) {
            let name = std::env::temp_dir().join("pointillist-output");
            let (partial, lock) = claim(&name, &partial_begin(&name)?)?;
            return Ok(AtomicFile { path: path.to_owned(), partial: Some(partial), _lock: lock });
        }
        // A rename would replace a pipe, or as root /dev/null, by a file.
        if path.metadata().is_ok_and(|found| !found.is_file()) {
            return Err(Error::Request(format!(
                "cannot write {}: it is a folder, a pipe or a device; name a file, or - for standard output",
                path.display()
            )));
        }
        let path = &target(path)?;
        let begin = partial_begin(path)?;
        remove_stale(path, &begin);
        let (partial, lock) = claim(path, &begin)?;
        Ok(AtomicFile { path: path.to_owned(), partial: Some(partial), _lock: lock })
    }

    pub fn partial(&self) -> &Path {
        self.partial.as_deref().unwrap_or(&self.path)
    }

    /// Syncs the contents, renames the file, and syncs the folder.
    pub fn finish(self) -> Result<()> {
        if self.path == Path::new(STANDARD_OUTPUT) {
            let mut out = std::io::stdout().lock();
            let copied = File::open(self.partial())
                .and_then(|mut file| std::io::copy(&mut file, &mut out))
                .and_then(|_| out.flush());
            return copied.map_err(|error| Error::io("write", Path::new("standard output"), error));
        }
        finish_together([self])
    }

    fn sync(&self) -> Result<()> {
        let synced = OpenOptions::new().write(true).open(self.partial());
        synced.and_then(|file| file.sync_all()).map_err(|error| self.failed(error))
    }

    fn failed(&self, error: std::io::Error) -> Error {
        Error::io("write", &self.path, error)
    }

    fn rename(&mut self, unfinished: &mut Vec<PathBuf>) -> std::io::Result<()> {
        std::fs::rename(self.partial(), &self.path)?;
        let partial = self.partial.take();
        unfinished.retain(|other| Some(other) != partial.as_ref());
        Ok(())
    }
}

/// Finishes files in this order, all complete before the first gets its name: an interruption
/// leaves all or none.
pub fn finish_together<const N: usize>(mut files: [AtomicFile; N]) -> Result<()> {
    files.iter().try_for_each(AtomicFile::sync)?;
    // Under the lock, because after a rename another writer may take the partial name, and the
    // process may be exiting.
    let mut unfinished = unfinished();
    for file in &mut files {
        file.rename(&mut unfinished).map_err(|error| file.failed(error))?;
    }
    drop(unfinished);
    files.iter().try_for_each(|file| sync_folder(&file.path).map_err(|error| file.failed(error)))
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        let Some(partial) = self.partial.take() else { return };
        let mut unfinished = unfinished();
        // A failure cannot be reported here.
        let _ = std::fs::remove_file(&partial);
        unfinished.retain(|other| *other != partial);
    }
}

/// The name of standard output.
pub const STANDARD_OUTPUT: &str = "-";

/// Most links between a name and its file, as in the system.
const MOST_LINKS: usize = 40;

/// Returns the file that a name stands for: where links lead, or the name itself.
fn target(path: &Path) -> Result<PathBuf> {
    let mut target = path.to_owned();
    for _ in 0..MOST_LINKS {
        if !target.symlink_metadata().is_ok_and(|found| found.is_symlink()) {
            return Ok(target);
        }
        let link = target.read_link().map_err(|error| Error::io("read", path, error))?;
        target = target.with_file_name("").join(link);
    }
    Err(Error::Request(format!("cannot write {}: its links lead in a circle", path.display())))
}

/// Writes `path` completely or not at all.
pub fn write_atomically(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let file = AtomicFile::create(path)?;
    write(file.partial())?;
    file.finish()
}

/// Creates an unnamed temporary file beside `path`, which the system removes when the process ends.
/// If the process is killed before the name is removed, the file is as stale as a partial file.
pub fn temporary_file(path: &Path) -> Result<File> {
    let (partial, file) = claim(path, &partial_begin(path)?)?;
    let mut unfinished = unfinished();
    let removed = std::fs::remove_file(&partial);
    unfinished.retain(|other| *other != partial);
    removed.map_err(|error| Error::io("remove", &partial, error))?;
    Ok(file)
}

/// Returns the beginning of the names of partial files of `path`.
fn partial_begin(path: &Path) -> Result<String> {
    let name = path
        .file_name()
        .ok_or_else(|| Error::Request(format!("{} is not a file name", path.display())))?;
    Ok(format!(".{}.partial-", shortened(&name.to_string_lossy(), NAME_BYTES - 1 - PARTIAL_BYTES)))
}

/// Process ids are smaller on every system.
const NUMBERS: u32 = 1 << 22;

/// Creates a partial file with a free name, and locks it.
fn claim(path: &Path, begin: &str) -> Result<(PathBuf, File)> {
    let failed = |error| Error::io("create", path, error);
    // Another writer in this process, or in a container with the same process id, may have the
    // first name.
    for number in (0..u32::MAX / NUMBERS).map(|k| k * NUMBERS + std::process::id() % NUMBERS) {
        let partial = path.with_file_name(format!("{begin}{number}"));
        let mut unfinished = unfinished();
        // Memory may run out, but not between making the file and listing it.
        unfinished.reserve(1);
        let listed = partial.clone();
        let file = match OpenOptions::new().read(true).write(true).create_new(true).open(&partial) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => continue,
            created => created.map_err(failed)?,
        };
        // Before it was locked it looked stale: whichever process holds the lock, or held it, has
        // removed it. On file systems without locks no file counts as stale.
        if matches!(file.try_lock(), Err(TryLockError::WouldBlock)) || !is_at(&file, &partial) {
            continue;
        }
        unfinished.push(listed);
        return Ok((partial, file));
    }
    Err(failed(ErrorKind::AlreadyExists.into()))
}

/// Returns whether a file is still where it was created; true if the system does not tell.
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

/// Removes all partial files, for a process that exits without unwinding.
pub fn remove_unfinished() {
    for partial in unfinished().drain(..) {
        // It may have been renamed at this moment.
        let _ = std::fs::remove_file(partial);
    }
}

/// Removes the partial files of a process that aborts, in whatever state its memory is. Another
/// thread that is about to finish has a moment for it. Returns whether it could.
pub fn remove_unfinished_at_abort() -> bool {
    const TRIES: u32 = 100;
    for _ in 0..TRIES {
        let unfinished = match UNFINISHED.try_lock() {
            Ok(unfinished) => unfinished,
            Err(std::sync::TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(std::sync::TryLockError::WouldBlock) => {
                std::thread::sleep(std::time::Duration::from_millis(1));
                continue;
            }
        };
        // Short paths are not copied to the heap.
        unfinished.iter().for_each(|partial| drop(std::fs::remove_file(partial)));
        return true;
    }
    false
}

/// Removes partial files of the same name whose writer is gone.
fn remove_stale(path: &Path, begin: &str) {
    let folder =
        path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let is_partial = entry
            .file_name()
            .to_str()
            .and_then(|name| name.strip_prefix(begin))
            .is_some_and(|pid| pid.parse::<u32>().is_ok());
        // Names of this process change under the same lock, so that only the file that was found is
        // removed.
        let unfinished = unfinished();
        let is_stale = |path: &Path| {
            OpenOptions::new()
                .write(true)
                .open(path)
                .is_ok_and(|file| file.try_lock().is_ok() && is_at(&file, path))
        };
        if is_partial && !unfinished.contains(&entry.path()) && is_stale(&entry.path()) {
            // A concurrent removal has the same effect.
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

/// Longest file name that file systems allow `[bytes]`.
const NAME_BYTES: usize = 255;
/// Length of ".partial-" and a process id `[bytes]`.
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

    #[cfg(unix)]
    #[test]
    fn links_stay_and_what_they_point_to_is_written() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("there")).unwrap();
        std::fs::write(at("there/old.png"), "old").unwrap();
        symlink("there/old.png", at("a.png")).unwrap();
        symlink("a.png", at("b.png")).unwrap();
        symlink(at("there/new.png"), at("dangling.png")).unwrap();
        symlink("circle.png", at("circle.png")).unwrap();
        let write = |path: &Path| {
            write_atomically(path, |partial| {
                std::fs::write(partial, "new").map_err(|error| Error::io("write", partial, error))
            })
        };
        for link in ["b.png", "dangling.png"] {
            write(&at(link)).unwrap();
            assert!(at(link).symlink_metadata().unwrap().is_symlink());
        }
        for file in ["there/old.png", "there/new.png"] {
            assert_eq!(std::fs::read(at(file)).unwrap(), b"new");
        }
        assert!(write(&at("circle.png")).unwrap_err().to_string().contains("circle"));
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
    fn files_that_are_finished_together_appear_together() {
        let folder = tempfile::tempdir().unwrap();
        let [world, picture] = ["a.pgw", "a.png"].map(|name| folder.path().join(name));
        let create = || [&world, &picture].map(|path| AtomicFile::create(path).unwrap());
        let files = create();
        std::fs::remove_file(files[1].partial()).unwrap();
        assert!(finish_together(files).is_err());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        finish_together(create()).unwrap();
        assert!(world.exists() && picture.exists());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
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
