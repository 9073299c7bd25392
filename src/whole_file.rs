//! A file that is there whole or not at all.
//!
//! In: a path, and somebody who writes. Out: the file, under its own name only once it is complete and on the disk. Until then it lies beside
//! its place as `.NAME.partial-PID`; it is removed when writing fails, when Ctrl-C ends the work, and when the process leaves in a hurry. What a killed
//! process left is removed by the next one that writes the same name: whoever writes holds a lock on its partial file, so one that can be locked is stale.

use crate::error::{Error, Result};
use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// What is being written at this moment, for [`abandon_all`].
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// A file on its way: write to [`WholeFile::partial`], then [`WholeFile::finish`]. Dropped before that, it leaves nothing.
pub struct WholeFile {
    path: PathBuf,
    partial: PathBuf,
    /// Locked as long as it is being written.
    _lock: File,
}

impl WholeFile {
    /// Creates the empty partial file, so that a folder that cannot be written to is refused before the work is done.
    pub fn create(path: &Path) -> Result<WholeFile> {
        let name = path.file_name().ok_or_else(|| Error::Request(format!("{} is no file name", path.display())))?;
        // A rename would put a file in the place of a pipe, and as root in the place of /dev/null.
        if path.metadata().is_ok_and(|found| !found.is_file()) {
            return Err(Error::Request(format!("{} is a folder, a pipe or a device; name a file to write", path.display())));
        }
        let ending = format!(".partial-{}", std::process::id());
        let begin = format!(".{}", shortened(&name.to_string_lossy(), NAME_BYTES - 1 - PARTIAL_BYTES));
        remove_stale(path, &format!("{begin}.partial-"));
        let partial = path.with_file_name(begin + &ending);
        let lock = File::create(&partial).map_err(|error| Error::io("create", path, error))?;
        // Where a file system has no locks nothing is told to be stale either.
        let _ = lock.try_lock();
        unfinished().push(partial.clone());
        Ok(WholeFile { path: path.to_owned(), partial, _lock: lock })
    }

    pub fn partial(&self) -> &Path {
        &self.partial
    }

    /// Brings the contents to the disk, gives the file its name, and brings that to the disk too.
    pub fn finish(self) -> Result<()> {
        let synced = OpenOptions::new().write(true).open(&self.partial).and_then(|file| file.sync_all());
        let named = synced.and_then(|()| std::fs::rename(&self.partial, &self.path));
        named.and_then(|()| sync_folder(&self.path)).map_err(|error| Error::io("write", &self.path, error))
    }
}

impl Drop for WholeFile {
    fn drop(&mut self) {
        // After the rename there is nothing to remove, and nobody to tell if removing fails.
        let _ = std::fs::remove_file(&self.partial);
        unfinished().retain(|partial| *partial != self.partial);
    }
}

/// Writes `path` whole, or not at all.
pub fn whole_file(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let file = WholeFile::create(path)?;
    write(file.partial())?;
    file.finish()
}

/// Removes whatever is half written, for a process that is about to exit without unwinding.
pub fn abandon_all() {
    for partial in unfinished().drain(..) {
        // It may have been renamed this instant.
        let _ = std::fs::remove_file(partial);
    }
}

/// Partial files of the same name whose writer is gone.
fn remove_stale(path: &Path, begin: &str) {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let is_partial = entry.file_name().to_str().and_then(|name| name.strip_prefix(begin)).is_some_and(|pid| pid.parse::<u32>().is_ok());
        if is_partial && OpenOptions::new().write(true).open(entry.path()).is_ok_and(|file| file.try_lock().is_ok()) {
            // Whoever else is removing it has the same in mind.
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

#[cfg(unix)]
fn sync_folder(path: &Path) -> std::io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
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
        let (stale, alive) = (folder.path().join(".a.png.partial-4000001"), folder.path().join(".a.png.partial-4000002"));
        std::fs::write(&stale, "half").unwrap();
        let living = File::create(&alive).unwrap();
        living.lock().unwrap();
        whole_file(&path, |partial| std::fs::write(partial, "new").map_err(|error| Error::io("write", partial, error))).unwrap();
        assert!(!stale.exists() && alive.exists() && path.exists());
    }

    #[test]
    fn what_fails_leaves_nothing_and_keeps_what_was_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.png");
        std::fs::write(&path, "old").unwrap();
        let failing = whole_file(&path, |partial| {
            std::fs::write(partial, "half").unwrap();
            Err(Error::Interrupted)
        });
        assert!(failing.is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        whole_file(&path, |partial| std::fs::write(partial, "new").map_err(|error| Error::io("write", partial, error))).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
