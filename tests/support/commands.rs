//! Commands that need no device.

use crate::program::{pointillist, succeeded};
use std::ffi::OsStr;
use std::path::Path;
use std::process::Output;

pub fn run<I: AsRef<OsStr>>(arguments: impl IntoIterator<Item = I>) -> Output {
    pointillist().args(arguments).output().expect("start the program")
}

/// Returns what `info --json` prints about these files.
pub fn info(files: &[&Path], more: &str) -> serde_json::Value {
    let output = pointillist()
        .arg("info")
        .arg("--json")
        .args(files)
        .args(more.split_whitespace())
        .output()
        .expect("start the program");
    succeeded(&output);
    serde_json::from_slice(&output.stdout).expect("JSON")
}
