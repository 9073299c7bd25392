//! Files of `../shared`.

use crate::skip::skip;
use std::path::{Path, PathBuf};

/// Returns a file or folder of `../shared`. Records a skipped test if it is missing.
pub fn shared(relative: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared").join(relative);
    if !path.exists() {
        skip(&format!("{} is missing", path.display()));
        return None;
    }
    Some(path)
}
