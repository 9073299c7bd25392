//! Sampling of closed-form surfaces, uniform by area.
//!
//! Draws are independent, not on a lattice: the number of points on a patch is Poisson distributed,
//! so holes of every size occur, as in a merged raw cloud.

use super::chunk::{CHUNK, Chunk, Pulse};
use super::noise::Random;
use super::world::World;
use glam::DVec3;
use std::ops::Range;

/// Returns points `range` of `points`: solid k has those from shares[..k] to shares[..=k].
pub fn chunk(
    world: &World,
    shares: &[f64],
    points: u64,
    range: Range<u64>,
    seed: u64,
    noise: f64,
) -> Chunk {
    let mut chunk = Chunk::new(world.lattice(), CHUNK);
    let mut solid = 0;
    let mut sum = 0.0;
    let mut ends = shares.iter().map(|share| {
        sum += share;
        (sum * points as f64).round() as u64
    });
    let mut end = ends.next().unwrap_or(points);
    for index in range {
        while index >= end && solid + 1 < shares.len() {
            solid += 1;
            end = ends.next().unwrap_or(points);
        }
        let mut random = Random::new(seed, solid as u64, index);
        let hit = world.sampled(solid, &mut random);
        let away = if noise > 0.0 { hit.normal * (noise * random.normal()) } else { DVec3::ZERO };
        let cosine = hit.normal.z.abs();
        let pulse = Pulse {
            gain: DVec3::ONE,
            echo: 0.3 + 0.7 * cosine,
            source: 0,
            returns: (1, 1),
            gps_time: index as f64 * 1e-6,
            scan_angle: 0,
        };
        chunk.push(&hit, hit.point + away, pulse);
    }
    chunk
}
