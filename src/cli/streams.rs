//! Standard output and standard error, which may be closed or on a full disk.

use crate::error::{Error, Result};
use std::borrow::Cow;
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

/// Most characters of a line on standard error; what a file says may be longer.
const MOST_CHARACTERS: usize = 4000;

/// Writes lines to standard error, long ones shortened. A failure changes neither files nor the
/// exit code.
pub fn say(lines: impl std::fmt::Display) {
    let lines = lines.to_string();
    let shortened: Vec<_> = lines.split('\n').map(shortened).collect();
    drop(writeln!(std::io::stderr(), "{}", shortened.join("\n")));
}

fn shortened(line: &str) -> Cow<'_, str> {
    let Some((end, _)) = line.char_indices().nth(MOST_CHARACTERS) else { return line.into() };
    let left = line[end..].chars().count();
    format!("{}... ({left} more characters)", &line[..end]).into()
}

/// Writes a note to standard error, as [`say`].
pub fn note(note: impl std::fmt::Display) {
    say(format_args!("pointillist: note: {note}"));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_shortened() {
        let line = "é".repeat(MOST_CHARACTERS);
        assert_eq!(shortened(&line), line);
        assert_eq!(shortened(&format!("{line}é.")), format!("{line}... (2 more characters)"));
    }
}
