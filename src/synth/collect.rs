//! Simulated scans in memory, for benchmarks, studies and tests.

use super::{Chunk, World, scan};
use crate::cloud::rgb_range::{By, RgbRange, Scale};
use crate::cloud::{Cloud, Columns, Header, Lattice, Part};
use crate::error::Result;
use crate::progress::Progress;
use glam::DVec3;
use std::path::PathBuf;

/// Returns the points of `scan` with all columns that a file would have, 8 bits a colour channel.
pub fn collect(
    name: &str,
    world: &World,
    points: u64,
    seed: u64,
    noise: f64,
    progress: &dyn Progress,
) -> Result<Cloud> {
    let mut columns = Columns::default();
    let (mut rgb, mut intensity, mut class, mut source, mut returns, mut gps_time) =
        Default::default();
    let mut keep = |chunk: &Chunk| {
        columns.x.extend(&chunk.x);
        columns.y.extend(&chunk.y);
        columns.z.extend(&chunk.z);
        // Rounded exactly, as readers do (guide: numerics, case 24).
        Vec::extend(
            &mut rgb,
            chunk
                .rgb
                .iter()
                .map(|channels| channels.map(|v| ((v as u32 * 255 + 32_895) >> 16) as u8)),
        );
        Vec::extend(&mut intensity, &chunk.intensity);
        Vec::extend(&mut class, &chunk.class);
        Vec::extend(&mut source, &chunk.source);
        Vec::extend(&mut returns, chunk.returns.iter().map(|&(number, of)| number | of << 4));
        Vec::extend(&mut gps_time, &chunk.gps_time);
        Ok(())
    };
    scan(world, points, seed, noise, &mut keep, progress)?;
    let columns = Columns {
        rgb: Some(rgb),
        intensity: Some(intensity),
        class: Some(class),
        source: Some(source),
        returns: Some(returns),
        gps_time: Some(gps_time),
        ..columns
    };
    let lattice =
        Lattice { step: DVec3::splat(world.lattice().step), offset: world.lattice().offset };
    let part = Part {
        path: PathBuf::from(name),
        name: None,
        header: Header::default(),
        lattice,
        columns,
        intensity_range: [0.0, 65_535.0],
        rgb_scale: Scale::new(RgbRange::Words, By::File),
    };
    let stations = crate::cloud::stations(&part, 0);
    Ok(Cloud { parts: vec![part], stations, ..Cloud::default() })
}
