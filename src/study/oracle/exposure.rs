//! The twin of the `exposure` effect: a factor on linear light.

use crate::cloud::colormap::srgb_to_linear;

/// Returns a channel of a station with this gain, linear, at most white.
pub fn linear(value: u8, gain: f64) -> f64 {
    f64::min(gain * srgb_to_linear(value as f64 / 255.0), 1.0)
}
