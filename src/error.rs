//! Errors of user, files and device, with messages that carry the values.
//!
//! A message says in one line what failed, where, and what to do about it. The program prints it as
//! it is and exits with 1. Misuse of the render graph is a programming error and panics instead,
//! with pass and resource names.

#![deny(missing_docs)]

use ash::vk;
use std::path::{Path, PathBuf};

/// Result of whatever may fail.
pub type Result<T> = std::result::Result<T, Error>;

/// An error of the user, of a file or of the device.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file operation failed.
    #[error("cannot {doing} {}: {source}", path.display())]
    Io {
        /// Verb of what failed, such as "read".
        doing: &'static str,
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },

    /// A file does not follow its format.
    #[error("{}: {what}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Description of the fault and its place.
        what: String,
    },

    /// A request makes no sense (a camera without direction, a size beyond the device).
    #[error("{0}")]
    Request(String),

    /// No Vulkan device, a missing feature, or exhausted device memory.
    #[error("{0}")]
    Device(String),

    /// A Vulkan call failed; `during` names the call or the running pass.
    #[error("Vulkan failed with {:?} during {during}", vk::Result::from_raw(*code))]
    Vulkan {
        /// Name of the call or of the running pass.
        during: String,
        /// Result of the call, a `VkResult`.
        code: i32,
    },

    /// The validation layers, enabled by `--validate` and every test, reported an error.
    #[error("Vulkan validation: {0}")]
    Validation(String),

    /// Ctrl-C; partly written files have been removed.
    #[error("interrupted; nothing was left half written")]
    Interrupted,
}

impl Error {
    /// Tests whether the device is lost, and another one may be opened.
    pub fn is_lost_device(&self) -> bool {
        const LOST: i32 = vk::Result::ERROR_DEVICE_LOST.as_raw();
        matches!(self, Error::Vulkan { code: LOST, .. })
    }

    /// Returns the file that the error is about, if any.
    pub fn path(&self) -> Option<&Path> {
        match self {
            Error::Io { path, .. } | Error::Format { path, .. } => Some(path),
            _ => None,
        }
    }

    /// Returns an error of a file operation.
    pub fn io(doing: &'static str, path: &Path, source: std::io::Error) -> Self {
        Error::Io { doing, path: path.to_owned(), source }
    }

    /// Returns an error of a file that does not follow its format.
    pub fn format(path: &Path, what: impl Into<String>) -> Self {
        Error::Format { path: path.to_owned(), what: what.into() }
    }
}
