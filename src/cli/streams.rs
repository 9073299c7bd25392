//! Standard output and standard error, which may be closed or on a full disk.

use crate::error::{Error, Result};
use std::io::{ErrorKind, Write};
use std::path::Path;

/// Writes to standard output. Errors if it cannot be written; a closed pipe is no error, since its
/// reader needs no more.
pub fn print(text: &str) -> Result<()> {
    let mut output = std::io::stdout().lock();
    match output.write_all(text.as_bytes()).and_then(|()| output.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Error::io("write", Path::new("standard output"), error))
        }
        _ => Ok(()),
    }
}

/// Writes a line to standard error. A failure changes neither files nor the exit code.
pub fn say(line: impl std::fmt::Display) {
    drop(writeln!(std::io::stderr(), "{line}"));
}

/// Writes a note to standard error, as [`say`].
pub fn note(note: impl std::fmt::Display) {
    say(format_args!("pointillist: note: {note}"));
}
