//! Copies the words of picked points, position planes and attributes, for the CPU: it may not be
//! able to map the pages, and a later frame may have others there.

use crate::error::Result;
use crate::graph::{Buffer, Dispatch, Graph, Image};
use crate::resident::Resident;
use crate::shader::{self, picked::Push};

/// Words of picked points, which are read back with the frame.
pub struct Picked {
    pub words: Buffer,
    /// Words of each point at the most.
    pub each: usize,
}

/// Copies the words of the points whose ids are in these pixels, at least one. Those of pixels
/// without a point are undefined.
pub fn record(
    g: &mut Graph,
    resident: &Resident,
    index: &Image,
    pixels: &[[u32; 2]],
) -> Result<Picked> {
    let attributes = resident.shown.words();
    let homes = resident.homes().into_iter();
    let homes: Vec<[u32; 3]> =
        homes.map(|([low, high], planes)| [low, high, planes + attributes]).collect();
    let most = homes.iter().map(|[.., pages]| *pages).max().unwrap_or(1);
    let homes = g.upload("picked homes", &homes)?;
    let wanted = g.upload("picked pixels", pixels)?;
    let count = pixels.len() as u32;
    let mut words = g.readback("picked words", 4 * most as u64 * count as u64);
    let (pixels, homes, picked) = (&wanted, &homes, &mut words);
    let push = Push { count, words: most };
    g.run(
        shader::Picked { index, pixels, homes, picked, push },
        Dispatch::Groups([count.div_ceil(64), 1, 1]),
    );
    Ok(Picked { words, each: most as usize })
}
