//! Small text files that a user names: cameras, scenes, camera paths.
//!
//! They are read once and within bounds. A pipe could block for ever, and a device never ends.

use crate::error::{Error, Result};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Most bytes of a camera or a scene.
pub const ONE_PICTURE: u64 = 1 << 20;
/// Most bytes of a file that lists pictures or jobs: a path of 100,000 cameras has fewer.
pub const MANY_PICTURES: u64 = 64 << 20;

/// Reads a file of at most `most` bytes. Errors if it is none, larger, or not UTF-8.
pub fn read_text(path: &Path, most: u64) -> Result<String> {
    let failed = |error| Error::io("read", path, error);
    if !path.metadata().map_err(failed)?.is_file() {
        return Err(Error::format(path, "is a folder, a pipe or a device; name a file"));
    }
    let mut text = String::new();
    let mut file = File::open(path).map_err(failed)?.take(most + 1);
    file.read_to_string(&mut text).map_err(failed)?;
    if text.len() as u64 > most {
        return Err(Error::format(path, format!("is larger than {} MiB", most >> 20)));
    }
    Ok(text)
}
