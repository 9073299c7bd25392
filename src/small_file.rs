//! Small text files that a user names: cameras, scenes, camera paths.
//!
//! They are read once and within bounds. A pipe could block for ever, and a device never ends.

use crate::error::{Error, Result};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Most bytes of such a file: a path of 100,000 cameras has fewer.
const MOST_BYTES: u64 = 64 << 20;

/// Reads a file. Errors if it is none, too large, or not UTF-8.
pub fn read_text(path: &Path) -> Result<String> {
    let failed = |error| Error::io("read", path, error);
    if !path.metadata().map_err(failed)?.is_file() {
        return Err(Error::format(path, "is a folder, a pipe or a device; name a file"));
    }
    let mut text = String::new();
    let mut file = File::open(path).map_err(failed)?.take(MOST_BYTES + 1);
    file.read_to_string(&mut text).map_err(failed)?;
    if text.len() as u64 > MOST_BYTES {
        return Err(Error::format(path, format!("is larger than {} MiB", MOST_BYTES >> 20)));
    }
    Ok(text)
}
