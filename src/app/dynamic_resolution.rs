//! How fine a picture may be while the camera moves: measured frames in, the share of pixels to draw out. Pure.
//!
//! What a frame costs grows with its pixels: passes over the screen by themselves, and the points of an index by their budget (select/lod.rs). So a moving picture is a smaller one,
//! by a whole number, and nothing else about it is different.

use std::time::Duration;

/// A frame that takes longer is drawn smaller: thirty of them a second look like motion.
pub const TARGET: Duration = Duration::from_millis(33);

/// Smaller ones show nothing that one could steer by.
pub const COARSEST: u32 = 4;

/// Finer only with so much to spare, so that it does not go to and fro.
const SPARE: f64 = 0.7;

/// What the sides of a moving picture are divided by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResolutionScale {
    pub divisor: u32,
}

impl Default for ResolutionScale {
    /// The first picture is there soonest.
    fn default() -> ResolutionScale {
        ResolutionScale { divisor: COARSEST }
    }
}

impl ResolutionScale {
    /// After a frame of this divisor has taken so long.
    pub fn after(self, divisor: u32, took: Duration) -> ResolutionScale {
        let would = |other: u32| took.mul_f64((divisor * divisor) as f64 / (other * other) as f64);
        // Part of a frame is the same at any size, so what would be slower is known better than what would be faster.
        let fits = |other: &u32| {
            would(*other) <= if *other < divisor { TARGET.mul_f64(SPARE) } else { TARGET }
        };
        ResolutionScale { divisor: (1..=COARSEST).find(fits).unwrap_or(COARSEST) }
    }
}

/// The size of a picture in a window.
pub fn divided(size: [u32; 2], divisor: u32) -> [u32; 2] {
    size.map(|side| side.div_ceil(divisor))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_as_fine_as_the_target_allows_and_settle() {
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
