//! guide: numerics, one test a case, named after it. What each promises, and why, stands there; a tolerance that is not there is derived beside its use.

mod gpu;

#[path = "hard/coordinates.rs"]
mod coordinates;
#[path = "hard/decisions.rs"]
mod decisions;
#[path = "hard/formats.rs"]
mod formats;
#[path = "hard/levels.rs"]
mod levels;
#[path = "hard/luminance.rs"]
mod luminance;
#[path = "hard/same_bits.rs"]
mod same_bits;
#[path = "hard/screen.rs"]
mod screen;
#[path = "hard/surface.rs"]
mod surface;
