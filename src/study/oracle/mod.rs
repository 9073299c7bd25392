//! Naive f64 twins of the kernels, with bounds on the kernels' errors.
//!
//! A twin takes a kernel's input, floats in the same f32 bits, and returns the result in f64 with a
//! bound on the kernel's error. The bounds are running error bounds (Higham 2002, sec. 3.3; guide:
//! numerics, rule 3) over the kernel's own operations, from Vulkan's guarantees for each (guide:
//! numerics, rule 1). The twins are deliberately simple and slow, and share nothing with the
//! kernels.

pub mod antialias;
pub mod ao;
pub mod edl;
pub mod exposure;
pub mod fill;
pub mod fill_mask;
pub mod levels;
pub mod luminance;
pub mod phong;
pub mod points;
pub mod project;
pub mod pullpush;
pub mod scattered;
pub mod shadows;
pub mod shape;
pub mod smooth;
pub mod splat;
pub mod strokes;
pub mod surface;
pub mod transparency;
pub mod visibility;

use std::ops::{Add, Div, Mul, Neg, Sub};

/// One unit in the last place of an f32, relative to the number, at most. Vulkan's + - * are within
/// one (correct rounding in a direction of the driver's choice).
pub const ULP: f64 = 1.0 / (1u64 << 23) as f64;

/// Results below the smallest normal f32 may be flushed to 0.
pub const FLUSH: f64 = f32::MIN_POSITIVE as f64;

/// A number and a bound on the kernel's error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounded {
    pub value: f64,
    pub error: f64,
}

impl Bounded {
    /// Returns a number that the kernel has in the same bits.
    pub fn exact(value: impl Into<f64>) -> Bounded {
        Bounded { value: value.into(), error: 0.0 }
    }

    /// Returns a decimal constant of a shader, which the compiler rounds to the nearest f32.
    pub fn constant(value: f64) -> Bounded {
        Bounded { value, error: 0.5 * ULP * value.abs() }
    }

    /// Returns a result that inherits an error and is itself within `ulps` of the exact operation.
    fn rounded(value: f64, inherited: f64, ulps: f64) -> Bounded {
        Bounded { value, error: inherited + ulps * ULP * (value.abs() + inherited) + FLUSH }
    }

    /// Returns the minimum with an exact number; `min` and `max` round nothing, and hide errors
    /// beyond it.
    pub fn min(self, other: f64) -> Bounded {
        self.through(|x| x.min(other))
    }

    pub fn max(self, other: f64) -> Bounded {
        self.through(|x| x.max(other))
    }

    /// Returns the root of a non-negative number, within 5 ulps: 1 by an inverse root of 2 ulps.
    pub fn sqrt(self) -> Bounded {
        let value = self.value.sqrt();
        let least = (self.value - self.error).max(0.0).sqrt();
        Bounded::rounded(value, (value - least).max((self.value + self.error).sqrt() - value), 5.0)
    }

    /// Applies an exact, monotonically rising function.
    fn through(self, rising: impl Fn(f64) -> f64) -> Bounded {
        let [lo, value, hi] =
            [self.value - self.error, self.value, self.value + self.error].map(rising);
        Bounded { value, error: (hi - value).max(value - lo) }
    }

    pub fn holds(self, drawn: f32) -> bool {
        (drawn as f64 - self.value).abs() <= self.error
    }
}

impl Add for Bounded {
    type Output = Bounded;
    fn add(self, other: Bounded) -> Bounded {
        Bounded::rounded(self.value + other.value, self.error + other.error, 1.0)
    }
}

impl Sub for Bounded {
    type Output = Bounded;
    fn sub(self, other: Bounded) -> Bounded {
        self + -other
    }
}

impl Neg for Bounded {
    type Output = Bounded;
    fn neg(self) -> Bounded {
        Bounded { value: -self.value, ..self }
    }
}

impl Mul for Bounded {
    type Output = Bounded;
    fn mul(self, other: Bounded) -> Bounded {
        let inherited = self.value.abs() * other.error
            + other.value.abs() * self.error
            + self.error * other.error;
        Bounded::rounded(self.value * other.value, inherited, 1.0)
    }
}

impl Div for Bounded {
    type Output = Bounded;
    /// Division is within 2.5 ulps.
    fn div(self, other: Bounded) -> Bounded {
        let value = self.value / other.value;
        let least = other.value.abs() - other.error;
        let inherited = if least > 0.0 {
            (self.error + value.abs() * other.error) / least
        } else {
            f64::INFINITY
        };
        Bounded::rounded(value, inherited, 2.5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The CPU's f32 arithmetic is allowed by Vulkan, so it stays within the bounds.
        #[test]
        fn bounds_hold_what_f32_arithmetic_gives(a in -1e6f32..1e6, b in -1e6f32..1e6, c in 1e-3f32..1e6) {
            let [x, y, z] = [a, b, c].map(Bounded::exact);
            prop_assert!((x * y + x - y * z).holds(a * b + a - b * c));
            prop_assert!(((x - y) / z * x).holds((a - b) / c * a));
            prop_assert!((x * x + z).sqrt().holds((a * a + c).sqrt()));
            prop_assert!(Bounded::constant(0.1).holds(0.1));
        }
    }
}
