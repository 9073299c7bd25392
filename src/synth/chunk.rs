//! Simulated points between scanner and file: a struct of arrays on the file's integer lattice.

use super::world::{Hit, LUMINANCE, World};
use crate::error::{Error, Result};
use glam::{DVec3, I64Vec3};

/// Approximate points of a chunk; a few chunks per thread are all that a scan holds in memory.
pub const CHUNK: usize = 65_536;

/// A lattice: coordinate = offset + step * integer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    pub step: f64,
    pub offset: DVec3,
}

/// Attributes of a point from the scanner, besides the surface.
#[derive(Clone, Copy, Debug)]
pub struct Pulse {
    /// Exposure and white balance, a factor on linear light.
    pub gain: DVec3,
    /// Geometric part of the intensity, about 1 for a near surface facing the scanner; reflectance
    /// comes from the albedo.
    pub echo: f64,
    pub source: u16,
    pub returns: (u8, u8),
    pub gps_time: f64,
    /// Angle from straight down `[degrees]`, as LAS's scan angle rank.
    pub scan_angle: i8,
}

#[derive(Clone, Debug)]
pub struct Chunk {
    pub lattice: Lattice,
    pub x: Vec<i32>,
    pub y: Vec<i32>,
    pub z: Vec<i32>,
    /// Colours, sRGB, 16 bits.
    pub rgb: Vec<[u16; 3]>,
    pub intensity: Vec<u16>,
    pub class: Vec<u8>,
    /// LAS point source id: station or strip, from 1; 0 if none.
    pub source: Vec<u16>,
    /// Return number and number of returns of the pulse.
    pub returns: Vec<(u8, u8)>,
    /// Time `[s]`.
    pub gps_time: Vec<f64>,
    /// Angle from straight down `[degrees]`; 0 for scanners on the ground.
    pub scan_angle: Vec<i8>,
}

impl World {
    pub fn lattice(&self) -> Lattice {
        Lattice { step: self.step, offset: self.offset }
    }

    /// Returns the largest deviation with which no point leaves the lattice, ten of them from where
    /// it belongs `[m]`.
    pub fn largest_noise(&self) -> f64 {
        let reach = self.bounds().min.abs().max(self.bounds().max.abs()).max_element() + 1.0;
        (self.step * i32::MAX as f64 - reach) / 10.0
    }

    /// Errors if the lattice is too fine for 32-bit integers.
    pub fn check_lattice(&self) -> Result<()> {
        let reach = self.bounds().min.abs().max(self.bounds().max.abs()).max_element() + 1.0;
        let steps = reach / self.step;
        if self.step > 0.0 && steps < i32::MAX as f64 && self.offset.is_finite() {
            return Ok(());
        }
        Err(Error::Request(format!(
            "a lattice step of {} m needs {steps:.0} steps for a scene {reach:.0} m wide, and LAS holds {}; choose a larger --step",
            self.step,
            i32::MAX
        )))
    }
}

impl Chunk {
    pub fn new(lattice: Lattice, capacity: usize) -> Chunk {
        Chunk {
            lattice,
            x: Vec::with_capacity(capacity),
            y: Vec::with_capacity(capacity),
            z: Vec::with_capacity(capacity),
            rgb: Vec::with_capacity(capacity),
            intensity: Vec::with_capacity(capacity),
            class: Vec::with_capacity(capacity),
            source: Vec::with_capacity(capacity),
            returns: Vec::with_capacity(capacity),
            gps_time: Vec::with_capacity(capacity),
            scan_angle: Vec::with_capacity(capacity),
        }
    }

    pub fn len(&self) -> usize {
        self.x.len()
    }

    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    pub fn truncate(&mut self, length: usize) {
        self.x.truncate(length);
        self.y.truncate(length);
        self.z.truncate(length);
        self.rgb.truncate(length);
        self.intensity.truncate(length);
        self.class.truncate(length);
        self.source.truncate(length);
        self.returns.truncate(length);
        self.gps_time.truncate(length);
        self.scan_angle.truncate(length);
    }

    /// Adds a point at `position` (relative to the offset) with the colour and class of `hit`.
    pub fn push(&mut self, hit: &Hit, position: DVec3, pulse: Pulse) {
        let steps: I64Vec3 = (position / self.lattice.step).round().as_i64vec3();
        self.x.push(steps.x as i32);
        self.y.push(steps.y as i32);
        self.z.push(steps.z as i32);
        self.rgb.push(srgb16(hit.lit * pulse.gain));
        self.intensity
            .push((hit.albedo.dot(LUMINANCE).sqrt() * pulse.echo * 60_000.0).clamp(0.0, 65_535.0)
                as u16);
        self.class.push(hit.class);
        self.source.push(pulse.source);
        self.returns.push(pulse.returns);
        self.gps_time.push(pulse.gps_time);
        self.scan_angle.push(pulse.scan_angle);
    }
}

/// Encodes linear light as sRGB (IEC 61966-2-1), 16 bits.
pub fn srgb16(linear: DVec3) -> [u16; 3] {
    let encode = |v: f64| {
        let v = v.clamp(0.0, 1.0);
        let encoded = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
        (encoded * 65_535.0).round() as u16
    };
    [encode(linear.x), encode(linear.y), encode(linear.z)]
}
