//! The threads that work is divided among.
//!
//! They start with the first work otherwise, where a system that has no thread left would be a panic.

use crate::error::{Error, Result};
use std::error::Error as _;
use std::sync::OnceLock;

/// Starts the threads, once. They are those of a host that has started its own.
pub fn start() -> Result<()> {
    static STARTED: OnceLock<Option<String>> = OnceLock::new();
    let failed = STARTED.get_or_init(|| {
        let started = rayon::ThreadPoolBuilder::new().build_global();
        // An error without a source says that there are threads already.
        let error = started.err()?;
        Some(error.source()?.to_string())
    });
    failed.as_ref().map_or(Ok(()), |error| {
        Err(Error::Request(format!(
            "cannot start threads to work with ({error}); end other programs, or allow more processes (ulimit -u)"
        )))
    })
}
