//! A terrestrial laser scanner: a mirror turning about a horizontal axis on a head turning about
//! the vertical one.
//!
//! Rays lie on a regular grid of azimuth and elevation, so that points are dense beside the tripod
//! and thin out with distance and grazing incidence. The first surface answers; its range is noisy
//! along the ray; colours carry the exposure of the station.

use super::chunk::{Chunk, Pulse};
use super::noise::Random;
use super::scanner::Scanner;
use super::world::{Station, World};
use glam::DVec3;
use std::f64::consts::TAU;

pub struct Terrestrial<'a> {
    pub world: &'a World,
    pub stations: &'a [Station],
    pub seed: u64,
    pub noise: f64,
}

/// Elevations that the mirror reaches: the tripod hides what is below.
const LOWEST: f64 = -62.0;
const HIGHEST: f64 = 86.0;
const RAYS_PER_JOB: u64 = 32_768;
/// A time between stations, and between pulses, seconds.
const STATION_S: f64 = 1000.0;
const PULSE_S: f64 = 2e-6;

struct Grid {
    rows: u64,
    columns: u64,
    columns_per_job: u64,
    jobs: u64,
}

fn sweep() -> (f64, f64) {
    (LOWEST.to_radians(), HIGHEST.to_radians())
}

/// Returns whether the mirror reaches a direction from the station.
pub fn reaches(direction: DVec3) -> bool {
    let (low, high) = sweep();
    (low..=high).contains(&direction.z.atan2(direction.x.hypot(direction.y)))
}

fn grid(spacing: f64) -> Grid {
    let (low, high) = sweep();
    let rows = ((high - low) / spacing).ceil() as u64;
    let columns = (TAU / spacing).ceil() as u64;
    let columns_per_job = (RAYS_PER_JOB / rows).max(1);
    Grid { rows, columns, columns_per_job, jobs: columns.div_ceil(columns_per_job) }
}

/// The unit direction of the centre of a grid cell, shifted by a phase in [0, 1)^2.
fn direction(grid: &Grid, column: u64, row: u64, phase: (f64, f64)) -> DVec3 {
    let (low, high) = sweep();
    let azimuth = TAU * (column as f64 + phase.0) / grid.columns as f64;
    let elevation = low + (high - low) * (row as f64 + phase.1) / grid.rows as f64;
    let (sin_a, cos_a) = azimuth.sin_cos();
    let (sin_e, cos_e) = elevation.sin_cos();
    DVec3::new(cos_a * cos_e, sin_a * cos_e, sin_e)
}

impl Scanner for Terrestrial<'_> {
    fn yield_at_unit_spacing(&self) -> f64 {
        let pilot = grid(1.5f64.to_radians());
        let rays = pilot.rows * pilot.columns;
        let hits = |station: &Station| {
            let hit = |i: u64| {
                self.world
                    .trace(
                        station.position,
                        direction(&pilot, i / pilot.rows, i % pilot.rows, (0.5, 0.5)),
                    )
                    .is_some()
            };
            (0..rays).filter(|&i| hit(i)).count() as f64 / rays as f64
        };
        let (low, high) = sweep();
        self.stations.iter().map(hits).sum::<f64>() * TAU * (high - low)
    }

    fn coarsest(&self) -> f64 {
        3f64.to_radians()
    }

    fn jobs(&self, spacing: f64) -> u64 {
        grid(spacing).jobs * self.stations.len() as u64
    }

    fn job(&self, spacing: f64, pass: u64, job: u64) -> Chunk {
        let grid = grid(spacing);
        let (index, part) = ((job / grid.jobs) as usize, job % grid.jobs);
        let station = &self.stations[index];
        let mut start = Random::new(self.seed, 1 << 32 | pass, index as u64);
        let phase = (start.unit(), start.unit());
        let mut chunk = Chunk::new(self.world.lattice(), RAYS_PER_JOB as usize);
        for column in
            part * grid.columns_per_job..grid.columns.min((part + 1) * grid.columns_per_job)
        {
            for row in 0..grid.rows {
                let ray = direction(&grid, column, row, phase);
                let Some(hit) = self.world.trace(station.position, ray) else { continue };
                let pulse = column * grid.rows + row;
                let mut error = 0.0;
                if self.noise > 0.0 {
                    error = self.noise
                        * Random::new(self.seed, (index as u64) << 33 | pass << 1 | 1, pulse)
                            .normal();
                }
                let position = station.position + ray * (hit.t + error);
                let echo = (0.25 + 0.75 * hit.normal.dot(ray).abs()) / (1.0 + hit.t / 60.0);
                let time =
                    (index as u64 * 16 + pass) as f64 * STATION_S / 16.0 + pulse as f64 * PULSE_S;
                let source = index as u16 + 1;
                chunk.push(
                    &hit,
                    position,
                    Pulse {
                        gain: station.gain,
                        echo,
                        source,
                        returns: (1, 1),
                        gps_time: time,
                        scan_angle: 0,
                    },
                );
            }
        }
        chunk
    }
}
