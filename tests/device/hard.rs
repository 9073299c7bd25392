//! Cases of "guide: numerics", one test each, named by number. The guide says what each promises
//! and why. Tolerances that are not there are derived beside their use.

mod coordinates;
mod decisions;
mod formats;
mod levels;
mod luminance;
mod same_bits;
mod screen;
mod surface;
