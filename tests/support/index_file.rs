//! Indexes of files.

use crate::program::{pointillist, succeeded};
use std::path::{Path, PathBuf};

/// Indexes these files, and returns the index, which lies beside the first.
pub fn indexed(files: &[&Path], more: &str) -> PathBuf {
    let index = files[0].with_extension("pnti");
    let output = pointillist()
        .arg("index")
        .args(files)
        .arg("-o")
        .arg(&index)
        .args(more.split_whitespace())
        .output();
    succeeded(&output.expect("start the program"));
    index
}
