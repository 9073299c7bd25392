//! Computes tangents of normals by the functions that `stroke_bins` calls, for the study that times
//! them and the test against their f64 twin (guide: numerics, case 19).

use super::Tangents;
use crate::error::Result;
use crate::graph::{Dispatch, Gpu, Graph};
use crate::shader::{self, Direction};

/// Returns the tangents and the device time `[ms]`.
pub fn on_device(
    gpu: &mut Gpu,
    way: Tangents,
    directions: &[Direction],
) -> Result<(Vec<[f32; 3]>, f64)> {
    /// Workgroups in a row that every device allows.
    const ROW: u32 = 65_535;
    let count = directions.len() as u32;
    let mut g = Graph::new(gpu);
    let directions = g.upload("directions", directions)?;
    let mut tangents = g.buffer("tangents", 12 * count.max(1) as u64);
    g.fill(&mut tangents, 0);
    let groups = count.div_ceil(64).max(1);
    let push = shader::stroke_tangents::Push { count, way: way as u32 };
    g.run(
        shader::StrokeTangents { directions: &directions, tangents: &mut tangents, push },
        Dispatch::Groups([groups.min(ROW), groups.div_ceil(ROW), 1]),
    );
    let found = g.download_buffer(&tangents);
    let frame = g.submit_and_wait(&[])?;
    let found =
        (frame.read::<[f32; 3]>(&found)[..count as usize].to_vec(), frame.ms("stroke_tangents"));
    Ok(found)
}
