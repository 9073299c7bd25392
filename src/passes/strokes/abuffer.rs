//! The A-buffer: room for the counted fragments of each pixel, for one frame or kept over several,
//! which sort it step by step (dos Anjos et al. 2018, sec. 3.3.3).
//!
//! The fragments, the start of those of each pixel, and the keys of the nearest strokes are kept.
//! All of it belongs to one view, the same points, and the settings that fragments depend on;
//! otherwise it is invalid.

use super::FRAGMENT_BYTES;
use crate::error::Result;
use crate::graph::{Buffer, Graph};
use std::ops::Range;

/// Fragments of the pixels of some tiles.
pub struct Abuffer {
    /// First fragment of each pixel, tile by tile, and the end of all.
    pub starts: Buffer,
    pub fragments: Buffer,
    /// Number of sorted fragments per pixel, from the nearest on, before and after this frame.
    pub ordered: Range<u32>,
    /// True if later frames continue with it.
    pub kept: bool,
}

impl Abuffer {
    /// Creates an A-buffer for one frame.
    pub fn new(g: &mut Graph, per_pixel: &[u32], most: u32) -> Result<Abuffer> {
        let starts = sums(per_pixel);
        let fragments = g.buffer("fragments", bytes(starts[per_pixel.len()] as u64));
        Ok(Abuffer {
            starts: g.upload("starts", &starts)?,
            fragments,
            ordered: 0..most,
            kept: false,
        })
    }
}

/// Returns the bytes of `fragments` fragments.
pub fn bytes(fragments: u64) -> u64 {
    FRAGMENT_BYTES * fragments.max(1)
}

/// Names of the persistent keys, starts and fragments.
const PLACES: [&str; 3] = ["kept keys", "kept starts", "kept fragments"];

/// Size of a kept A-buffer.
pub struct Size {
    pub pixels: u64,
    pub in_tiles: u64,
    pub fragments: u64,
}

impl Size {
    fn bytes(&self) -> [u64; 3] {
        [8 * self.pixels, 4 * (self.in_tiles + 1), bytes(self.fragments)]
    }

    /// Returns whether a device can bind it; persistent buffers are rounded up to a power of two.
    pub fn fits(&self, limit: u64) -> bool {
        self.bytes().iter().all(|bytes| bytes.next_power_of_two() <= limit)
    }
}

/// Returns the notes stored behind `cache_key` if an A-buffer of it is kept completely.
pub fn held<const N: usize>(g: &Graph, cache_key: &[u64]) -> Option<[u64; N]> {
    let (whole, _) = g.persistent_state(PLACES[2])?;
    let notes = whole.strip_prefix(cache_key)?.try_into().ok()?;
    PLACES
        .iter()
        .all(|place| g.persistent_state(place).is_some_and(|(of, _)| of == whole))
        .then_some(notes)
}

/// Returns keys and an A-buffer that outlive the frame. `next` maps the number of sorted fragments,
/// 0 if just counted, to the number after this frame.
pub fn keep(
    g: &mut Graph,
    cache_key: &[u64],
    size: &Size,
    counted: Option<&[u32]>,
    next: impl Fn(u32) -> u32,
) -> Result<(Buffer, Abuffer)> {
    if counted.is_some() {
        PLACES.iter().for_each(|place| g.invalidate(place));
    }
    let [of_keys, of_starts, of_fragments] = size.bytes();
    let (keys, _) = g.persistent(PLACES[0], of_keys, cache_key.to_vec(), |_| 1)?;
    let (mut starts, _) = g.persistent(PLACES[1], of_starts, cache_key.to_vec(), |_| 1)?;
    let (fragments, ordered) = g.persistent(PLACES[2], of_fragments, cache_key.to_vec(), &next)?;
    if let Some(per_pixel) = counted {
        let counted = g.upload("starts", &sums(per_pixel))?;
        g.copy_parts("keep starts", &counted, &mut starts, vec![[0, 0, of_starts]]);
    }
    Ok((keys, Abuffer { starts, fragments, ordered: ordered..next(ordered), kept: true }))
}

/// Returns prefix sums: for each count the sum of those before it, then the total.
pub fn sums(counts: &[u32]) -> Vec<u32> {
    let before = counts.iter().scan(0, |sum, count| {
        *sum += count;
        Some(*sum)
    });
    [0].into_iter().chain(before).collect()
}
