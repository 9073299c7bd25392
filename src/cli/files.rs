//! Checks of output paths.

use crate::error::{Error, Result};
use std::path::{Path, PathBuf};

/// Errors if a path has an extension that is none of these; a path without one passes.
pub fn check_extension(path: &Path, extensions: &[&str]) -> Result<()> {
    match path.extension() {
        Some(other) if extensions.iter().all(|known| !other.eq_ignore_ascii_case(known)) => {
            Err(Error::Request(format!(
                "cannot write {}: its name must end in .{}",
                path.display(),
                extensions.join(" or .")
            )))
        }
        _ => Ok(()),
    }
}

/// Errors if the output is one of the inputs.
pub fn refuse_to_overwrite(output: &Path, inputs: &[PathBuf]) -> Result<()> {
    let same = |input: &PathBuf| matches!((output.canonicalize(), input.canonicalize()), (Ok(a), Ok(b)) if a == b);
    match inputs.iter().find(|input| same(input)) {
        Some(input) => Err(Error::Request(format!(
            "cannot write {}: it is an input; name another file with -o",
            input.display()
        ))),
        None => Ok(()),
    }
}
