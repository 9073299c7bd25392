//! A file that is there whole or not at all.
//!
//! In: a path, and somebody who writes. Out: the file, under its own name only once it is complete and on the disk. Until then it lies beside
//! its place as `.NAME.partial-PID`; it is removed when writing fails, when Ctrl-C ends the work, and when the process leaves in a hurry.

use crate::error::{Error, Result};
use std::fs::OpenOptions;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// What is being written at this moment, for [`abandon_all`].
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// A file on its way: write to [`WholeFile::partial`], then [`WholeFile::finish`]. Dropped before that, it leaves nothing.
pub struct WholeFile {
    path: PathBuf,
    partial: PathBuf,
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
        let partial = path.with_file_name(format!(".{}{ending}", shortened(&name.to_string_lossy(), NAME_BYTES - 1 - ending.len())));
        std::fs::File::create(&partial).map_err(|error| Error::io("create", path, error))?;
        unfinished().push(partial.clone());
        Ok(WholeFile { path: path.to_owned(), partial })
    }

    pub fn partial(&self) -> &Path {
        &self.partial
    }

    /// Brings the contents to the disk and gives the file its name.
    pub fn finish(self) -> Result<()> {
        let synced = OpenOptions::new().write(true).open(&self.partial).and_then(|file| file.sync_all());
        synced.and_then(|()| std::fs::rename(&self.partial, &self.path)).map_err(|error| Error::io("write", &self.path, error))
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

fn unfinished() -> std::sync::MutexGuard<'static, Vec<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// What file systems allow a name.
const NAME_BYTES: usize = 255;

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
