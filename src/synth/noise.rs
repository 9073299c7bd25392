//! Pseudorandom numbers: a counter-based generator and smooth noise.
//!
//! Every random value of a scene or a scan is a pure function of (seed, what, which one), so that
//! the same seed gives the same bytes for any number of threads, and one point can be made without
//! those before it. SplitMix64 (Steele, Lea and Flood 2014) suffices: it passes BigCrush and takes
//! three multiplications.

use std::f64::consts::TAU;

const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;

/// Mixes by SplitMix64's finaliser: a bijection of 64 bits in which every input bit changes half of
/// the output bits.
pub fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// A generator with an independent stream for every (seed, stream, index).
#[derive(Clone)]
pub struct Random {
    state: u64,
}

impl Random {
    pub fn new(seed: u64, stream: u64, index: u64) -> Random {
        Random { state: mix(mix(mix(seed ^ GOLDEN).wrapping_add(stream)).wrapping_add(index)) }
    }

    /// Returns a uniform value in [0, 1) with 53 bits.
    pub fn unit(&mut self) -> f64 {
        self.state = self.state.wrapping_add(GOLDEN);
        (mix(self.state) >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Returns one of `count` choices.
    pub fn below(&mut self, count: usize) -> usize {
        (self.unit() * count as f64) as usize
    }

    /// Returns a standard normal value (Box and Muller); |value| < 8.6 because `1 - unit()` is at
    /// least 2^-53.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (TAU * self.unit()).cos()
    }
}

/// Returns a uniform value in [0, 1) for a lattice cell, such as the colour of one brick.
pub fn cell(x: i64, y: i64, salt: u64) -> f64 {
    (mix((x as u64).wrapping_mul(GOLDEN)
        ^ mix((y as u64).wrapping_add(salt.wrapping_mul(0xD134_2543_DE82_EF95))))
        >> 11) as f64
        * (1.0 / (1u64 << 53) as f64)
}

/// Returns smooth value noise in [0, 1] with features one unit wide.
pub fn value(x: f64, y: f64, salt: u64) -> f64 {
    let (i, j) = (x.floor(), y.floor());
    let fade = |t: f64| t * t * (3.0 - 2.0 * t);
    let (u, v) = (fade(x - i), fade(y - j));
    let (i, j) = (i as i64, j as i64);
    let low = cell(i, j, salt) * (1.0 - u) + cell(i + 1, j, salt) * u;
    let high = cell(i, j + 1, salt) * (1.0 - u) + cell(i + 1, j + 1, salt) * u;
    low * (1.0 - v) + high * v
}

/// Returns three octaves of [`value`], about 0.5 on average: weathering, asphalt, grass.
pub fn mottle(x: f64, y: f64, salt: u64) -> f64 {
    (value(x, y, salt) * 4.0
        + value(x * 2.03, y * 2.03, salt + 1) * 2.0
        + value(x * 4.09, y * 4.09, salt + 2))
        / 7.0
}
