//! guide: numerics, one test a case, named after it. What each promises, and why, stands there; a tolerance that is not there is derived beside its use.

mod coordinates;
mod decisions;
mod formats;
mod levels;
mod luminance;
mod same_bits;
mod screen;
mod surface;
