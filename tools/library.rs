//! The shared and the static library for C: all functions of `include/pointillist.h`.

pub use pointillist::c::*;
