//! World files: six lines beside a picture that say where its pixels lie.

use super::geotiff::Map;
use crate::atomic_file::AtomicFile;
use crate::error::{Error, Result};
use std::path::{Path, PathBuf};

/// Returns the name of the world file of a PNG picture.
pub fn beside(picture: &Path) -> PathBuf {
    picture.with_extension("pgw")
}

/// Creates the file, which exists after [`AtomicFile::finish`].
pub fn create(path: &Path, map: &Map) -> Result<AtomicFile> {
    let file = AtomicFile::create(path)?;
    let ([west, north], [across, down]) = map.placed();
    // The last two lines are the middle of the first pixel.
    let lines = [across, 0.0, 0.0, -down, west + across / 2.0, north - down / 2.0];
    let text: String = lines.iter().map(|line| format!("{line}\n")).collect();
    std::fs::write(file.partial(), text).map_err(|error| Error::io("write", path, error))?;
    Ok(file)
}
