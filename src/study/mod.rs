//! Accuracy against time.
pub mod oracle;
