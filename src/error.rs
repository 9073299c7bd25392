//! Everything that can go wrong outside our own code, as one enum whose messages carry the values.
//!
//! A message says what failed, where, and what to do about it, in one line: the program prints it as it is and exits with 1.
//! Misuse of the render graph is a programming error and panics instead, with pass and resource names.

use std::path::{Path, PathBuf};

pub type Result<T> = std::result::Result<T, Error>;

#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused a file operation.
    #[error("cannot {doing} {}: {source}", path.display())]
    Io { doing: &'static str, path: PathBuf, source: std::io::Error },

    /// A file's contents are not what its format promises.
    #[error("{}: {what}", path.display())]
    Format { path: PathBuf, what: String },

    /// What the user asked for makes no sense together (a camera without direction, a size beyond the device).
    #[error("{0}")]
    Request(String),

    /// No Vulkan device, a missing feature, or a device memory limit.
    #[error("{0}")]
    Device(String),

    /// A Vulkan call failed; `during` names the call or the pass that was running.
    #[error("Vulkan failed with {code} during {during}")]
    Vulkan { during: String, code: String },

    /// The validation layers, which `--validate` and every test turn on, objected.
    #[error("Vulkan validation: {0}")]
    Validation(String),

    /// Ctrl-C; whatever was being written has been removed.
    #[error("interrupted; nothing was left half written")]
    Interrupted,
}

impl Error {
    /// Whether all that was on the device is gone, and another one may be opened.
    pub fn is_lost_device(&self) -> bool {
        matches!(self, Error::Vulkan { code, .. } if code == "ERROR_DEVICE_LOST")
    }

    /// The file that it is about, where it is about one.
    pub fn path(&self) -> Option<&Path> {
        match self {
            Error::Io { path, .. } | Error::Format { path, .. } => Some(path),
            _ => None,
        }
    }

    pub fn io(doing: &'static str, path: &Path, source: std::io::Error) -> Self {
        Error::Io { doing, path: path.to_owned(), source }
    }

    pub fn format(path: &Path, what: impl Into<String>) -> Self {
        Error::Format { path: path.to_owned(), what: what.into() }
    }
}
