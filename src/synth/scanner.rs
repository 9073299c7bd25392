//! Scanning a world with an exact number of points, in chunks and in a fixed order.
//!
//! A scanner samples angles, so the number of points for a spacing is only known afterwards. A
//! pilot scan measures the yield, a first pass aims slightly low, and further, ever sparser passes
//! (other phase, whole field of view) fill up; the last one is truncated. Chunks are made in
//! parallel but passed on in order, and each depends on the seed alone, so threads change nothing.

use super::airborne::Airborne;
use super::area;
use super::chunk::{CHUNK, Chunk};
use super::terrestrial::Terrestrial;
use super::world::{Method, World};
use crate::error::{Error, Result};
use crate::progress::Progress;
use rayon::prelude::*;

/// A caster of rays at a spacing (radians or metres), with about `yield_of / spacing^2` points.
pub trait Scanner: Sync {
    fn yield_at_unit_spacing(&self) -> f64;
    /// Returns the coarsest spacing that covers the whole field of view.
    fn coarsest(&self) -> f64;
    fn jobs(&self, spacing: f64) -> u64;
    fn job(&self, spacing: f64, pass: u64, job: u64) -> Chunk;
}

/// Share of the missing points that the first passes aim at: the pilot's error must not cut off the
/// last station.
const AIM: f64 = 0.97;

/// Passes exactly `points` points to `sink`. `noise` is the standard deviation of the range `[m]`
/// (along the normal if there is no ray).
pub fn scan(
    world: &World,
    points: u64,
    seed: u64,
    noise: f64,
    sink: &mut dyn FnMut(&Chunk) -> Result<()>,
    progress: &dyn Progress,
) -> Result<()> {
    world.check_lattice()?;
    if !(noise >= 0.0 && noise.is_finite()) {
        return Err(Error::Request(format!(
            "a range noise of {noise} m makes no sense; it must be 0 or more"
        )));
    }
    // Coordinates of LAS would end at their largest value.
    let most = world.largest_noise();
    if noise > most {
        return Err(Error::Request(format!(
            "a range noise of {noise} m moves points farther than steps of {} m reach; give at most {most:.0} m, or a larger --step",
            world.lattice().step
        )));
    }
    let mut left = points;
    let mut give = |chunk: &mut Chunk| -> Result<bool> {
        chunk.truncate(left.min(chunk.len() as u64) as usize);
        if !chunk.is_empty() {
            sink(chunk)?;
        }
        left -= chunk.len() as u64;
        progress.tick("scanning", points - left, points)?;
        Ok(left > 0)
    };
    match &world.method {
        Method::Area { shares } => {
            let size = CHUNK as u64;
            let make = |job: u64| {
                area::chunk(
                    world,
                    shares,
                    points,
                    job * size..points.min((job + 1) * size),
                    seed,
                    noise,
                )
            };
            in_order(points.div_ceil(size), make, &mut give)?;
        }
        Method::Stations(stations) => {
            passes(&Terrestrial { world, stations, seed, noise }, points, &mut give)?
        }
        Method::Strips { .. } => passes(&Airborne::new(world, seed, noise), points, &mut give)?,
    }
    Ok(())
}

fn passes(
    scanner: &dyn Scanner,
    points: u64,
    give: &mut dyn FnMut(&mut Chunk) -> Result<bool>,
) -> Result<()> {
    let per_unit = scanner.yield_at_unit_spacing();
    if per_unit <= 0.0 {
        return Err(Error::Request(
            "no ray of any station meets a surface; nothing can be scanned".to_owned(),
        ));
    }
    let mut left = points;
    for pass in 0.. {
        if left == 0 {
            break;
        }
        let spacing = (per_unit / (AIM * left as f64)).sqrt().min(scanner.coarsest());
        let mut give = |chunk: &mut Chunk| {
            left = left.saturating_sub(chunk.len() as u64);
            give(chunk)
        };
        if !in_order(scanner.jobs(spacing), |job| scanner.job(spacing, pass, job), &mut give)? {
            break;
        }
    }
    Ok(())
}

/// Makes chunks in parallel, a few per thread at a time, and passes them on in order. Returns false
/// if no more are wanted.
fn in_order(
    jobs: u64,
    make: impl Fn(u64) -> Chunk + Sync,
    give: &mut dyn FnMut(&mut Chunk) -> Result<bool>,
) -> Result<bool> {
    let batch = 4 * rayon::current_num_threads() as u64;
    let mut next = 0;
    while next < jobs {
        let end = jobs.min(next + batch);
        let chunks: Vec<Chunk> = (next..end).into_par_iter().map(&make).collect();
        for mut chunk in chunks {
            if !give(&mut chunk)? {
                return Ok(false);
            }
        }
        next = end;
    }
    Ok(true)
}
