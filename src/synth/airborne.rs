//! An airborne laser scanner: parallel flight lines that overlap, an oscillating mirror, several
//! returns where leaves let light through.
//!
//! Each pulse answers at the first surface and, behind a leaf, goes on with what is left of it
//! until something solid stops it.

use super::chunk::{Chunk, Pulse};
use super::noise::Random;
use super::scanner::Scanner;
use super::world::{CLASS_TREE, Hit, Method, World};
use glam::DVec3;

pub struct Airborne<'a> {
    world: &'a World,
    seed: u64,
    noise: f64,
    height: f64,
    half_angle: f64,
    /// Across-track position and gain of each strip.
    lines: &'a [(f64, f64)],
    /// First and last along-track position.
    track: (f64, f64),
}

const PULSES_PER_JOB: u64 = 16_384;
/// LAS 1.2 counts returns in three bits, and five is what its formats define.
const MOST_RETURNS: usize = 5;
/// Probability that a leaf lets part of the pulse through.
const PASSES_LEAF: f64 = 0.6;
const STRIP_S: f64 = 600.0;
const PULSE_S: f64 = 4e-6;

impl<'a> Airborne<'a> {
    pub fn new(world: &'a World, seed: u64, noise: f64) -> Self {
        let Method::Strips { height, half_angle, lines } = &world.method else {
            unreachable!("only called for strips")
        };
        let bounds = world.bounds();
        Airborne {
            world,
            seed,
            noise,
            height: *height,
            half_angle: half_angle.to_radians(),
            lines,
            track: (bounds.min.y + 0.5, bounds.max.y - 0.5),
        }
    }

    /// Returns pulses across and along, and along-track rows per job.
    fn grid(&self, spacing: f64) -> (u64, u64, u64) {
        let across = (2.0 * self.half_angle * self.height / spacing).ceil() as u64;
        let along = ((self.track.1 - self.track.0) / spacing).ceil() as u64;
        (across, along, (PULSES_PER_JOB / across).max(1))
    }

    fn pulse(
        &self,
        line: usize,
        across: f64,
        along: f64,
        random: &mut Random,
        answers: &mut Vec<Hit>,
    ) -> (DVec3, DVec3) {
        let angle = self.half_angle * (2.0 * across - 1.0);
        let origin = DVec3::new(
            self.lines[line].0,
            self.track.0 + (self.track.1 - self.track.0) * along,
            self.height,
        );
        // The mirror looks a few degrees ahead, so that walls are seen from one side in each strip.
        let direction = DVec3::new(angle.tan(), 0.06, -1.0).normalize();
        answers.clear();
        let mut from = 0.0;
        while let Some(hit) = self.world.trace_beyond(origin, direction, from) {
            // A receiver cannot separate echoes closer than this [m].
            from = hit.t + 0.25;
            answers.push(hit);
            if hit.class != CLASS_TREE
                || answers.len() == MOST_RETURNS
                || random.unit() > PASSES_LEAF
            {
                break;
            }
        }
        (origin, direction)
    }
}

impl Scanner for Airborne<'_> {
    fn yield_at_unit_spacing(&self) -> f64 {
        let (side, mut answers) = (96, Vec::new());
        let mut total = 0;
        for line in 0..self.lines.len() {
            for i in 0..side * side {
                let mut random = Random::new(self.seed, 3, i);
                let (across, along) = ((i % side) as f64 + 0.5, (i / side) as f64 + 0.5);
                self.pulse(
                    line,
                    across / side as f64,
                    along / side as f64,
                    &mut random,
                    &mut answers,
                );
                total += answers.len();
            }
        }
        let area = 2.0 * self.half_angle * self.height * (self.track.1 - self.track.0);
        total as f64 / (side * side) as f64 * area
    }

    fn coarsest(&self) -> f64 {
        (self.track.1 - self.track.0) / 64.0
    }

    fn jobs(&self, spacing: f64) -> u64 {
        let (_, along, rows) = self.grid(spacing);
        along.div_ceil(rows) * self.lines.len() as u64
    }

    fn job(&self, spacing: f64, pass: u64, job: u64) -> Chunk {
        let (across, along, rows) = self.grid(spacing);
        let jobs = along.div_ceil(rows);
        let (line, part) = ((job / jobs) as usize, job % jobs);
        let mut start = Random::new(self.seed, 2 << 32 | pass, line as u64);
        let phase = (start.unit(), start.unit());
        let gain = self.lines[line].1;
        let mut chunk = Chunk::new(self.world.lattice(), PULSES_PER_JOB as usize * 2);
        let mut answers = Vec::new();
        for row in part * rows..along.min((part + 1) * rows) {
            for column in 0..across {
                let pulse = row * across + column;
                let mut random = Random::new(self.seed, (line as u64) << 33 | pass << 1, pulse);
                // Forth on even rows and back on odd ones; the row shears along the track
                // meanwhile, as the aeroplane flies on.
                let turn = (column as f64 + phase.0) / across as f64;
                let swing = if row % 2 == 0 { turn } else { 1.0 - turn };
                let (origin, direction) = self.pulse(
                    line,
                    swing,
                    (row as f64 + phase.1 * 0.5 + turn * 0.5) / along as f64,
                    &mut random,
                    &mut answers,
                );
                let scan_angle = direction.x.atan2(-direction.z).to_degrees().round() as i8;
                let of = answers.len() as u8;
                let time =
                    (line as u64 * 16 + pass) as f64 * STRIP_S / 16.0 + pulse as f64 * PULSE_S;
                for (number, hit) in answers.iter().enumerate() {
                    let error = if self.noise > 0.0 { self.noise * random.normal() } else { 0.0 };
                    let position = origin + direction * (hit.t + error);
                    let echo = gain * (0.4 + 0.6 * hit.normal.dot(direction).abs()) / of as f64;
                    let returns = (number as u8 + 1, of);
                    let about = Pulse {
                        gain: DVec3::splat(gain),
                        echo,
                        source: line as u16 + 1,
                        returns,
                        gps_time: time,
                        scan_angle,
                    };
                    chunk.push(hit, position, about);
                }
            }
        }
        chunk
    }
}
