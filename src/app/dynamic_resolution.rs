//! Dynamic resolution: measured frame times in, the divisor of a moving picture's sides out. Pure.
//!
//! The cost of a frame grows with its pixels: that of screen passes directly, that of an index
//! through its point budget (`select::lod`). So a moving picture is drawn smaller by a whole
//! number, and is otherwise the same.

use std::time::Duration;

/// Longest frame time before pictures get smaller: 30 frames a second look like motion.
pub const TARGET: Duration = Duration::from_millis(33);

/// Largest divisor: smaller pictures are too coarse to navigate by.
pub const COARSEST: u32 = 4;

/// Share of [`TARGET`] within which a finer picture has to fit, so that the divisor does not
/// oscillate.
const SPARE: f64 = 0.7;

/// Divisor of the sides of a moving picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResolutionScale {
    pub divisor: u32,
}

impl Default for ResolutionScale {
    /// Returns the largest divisor, so that the first picture comes soonest.
    fn default() -> ResolutionScale {
        ResolutionScale { divisor: COARSEST }
    }
}

impl ResolutionScale {
    /// Returns the divisor to use after a frame of this divisor took this long.
    pub fn after(self, divisor: u32, took: Duration) -> ResolutionScale {
        let would = |other: u32| took.mul_f64((divisor * divisor) as f64 / (other * other) as f64);
        // Part of a frame's cost does not depend on size, so predictions of slower frames are
        // safer.
        let fits = |other: &u32| {
            would(*other) <= if *other < divisor { TARGET.mul_f64(SPARE) } else { TARGET }
        };
        ResolutionScale { divisor: (1..=COARSEST).find(fits).unwrap_or(COARSEST) }
    }
}

/// Divides a window's size, rounding up.
pub fn divided(size: [u32; 2], divisor: u32) -> [u32; 2] {
    size.map(|side| side.div_ceil(divisor))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn divisors_meet_the_target_and_settle() {
        for whole_ms in [5.0, 33.0, 40.0, 100.0, 400.0, 3000.0] {
            let mut scale = ResolutionScale::default();
            let cost = |scale: ResolutionScale| {
                Duration::from_secs_f64(whole_ms / 1e3 / (scale.divisor * scale.divisor) as f64)
            };
            for _ in 0..4 {
                scale = scale.after(scale.divisor, cost(scale));
            }
            assert!(cost(scale) <= TARGET || scale.divisor == COARSEST, "{whole_ms}");
            assert_eq!(scale, scale.after(scale.divisor, cost(scale)), "{whole_ms}");
            assert!(whole_ms > SPARE * 33.0 || scale.divisor == 1, "{whole_ms}");
        }
    }
}
