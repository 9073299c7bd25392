//! A-BUFFER: how many fragments each pixel has in, room for them out; for one frame, or kept over several, which bring them into order step by step (dos Anjos et al. 2018, sec. 3.3.3).
//!
//! Kept is what only counting and painting would bring back: the fragments, where those of each pixel begin, and the keys of the nearest strokes. All of it is of one view, the same points, and the same
//! settings, as far as fragments depend on them; where one of these is another, it is void.

use super::FRAGMENT_BYTES;
use crate::error::Result;
use crate::graph::{Buffer, Graph};
use std::ops::Range;

/// Fragments of the pixels of some tiles.
pub struct Abuffer {
    /// Of every pixel, tile by tile, the first; and the one after the last of all.
    pub starts: Buffer,
    pub fragments: Buffer,
    /// How many of each pixel's, from the nearest on, are in order, and how many shall be.
    pub ordered: Range<u32>,
    /// Later frames go on with it.
    pub kept: bool,
}

impl Abuffer {
    /// For a frame.
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

/// Bytes of so many fragments.
pub fn bytes(fragments: u64) -> u64 {
    FRAGMENT_BYTES * fragments.max(1)
}

/// Where the keys, the starts and the fragments are kept.
const PLACES: [&str; 3] = ["kept keys", "kept starts", "kept fragments"];

/// What is kept of a whole picture: of so many pixels, and of as many in tiles.
pub struct Size {
    pub pixels: u64,
    pub in_tiles: u64,
    pub fragments: u64,
}

impl Size {
    fn bytes(&self) -> [u64; 3] {
        [8 * self.pixels, 4 * (self.in_tiles + 1), bytes(self.fragments)]
    }

    /// Whether a device can bind it; kept buffers are as large as the next power of two.
    pub fn fits(&self, limit: u64) -> bool {
        self.bytes().iter().all(|bytes| bytes.next_power_of_two() <= limit)
    }
}

/// What was noted behind `made_of` when frames before this one kept an A-buffer of that, if all of it is still there.
pub fn held<const N: usize>(g: &Graph, made_of: &[u64]) -> Option<[u64; N]> {
    let (whole, _) = g.persistent_state(PLACES[2])?;
    let notes = whole.strip_prefix(made_of)?.try_into().ok()?;
    PLACES
        .iter()
        .all(|place| g.persistent_state(place).is_some_and(|(of, _)| of == whole))
        .then_some(notes)
}

/// Keys, and an A-buffer, that outlive the frame; `next` says how many fragments shall be in order when so many are, which are none where it has just been counted.
pub fn keep(
    g: &mut Graph,
    made_of: &[u64],
    size: &Size,
    counted: Option<&[u32]>,
    next: impl Fn(u32) -> u32,
) -> Result<(Buffer, Abuffer)> {
    if counted.is_some() {
        PLACES.iter().for_each(|place| g.invalidate(place));
    }
    let [of_keys, of_starts, of_fragments] = size.bytes();
    let (keys, _) = g.persistent(PLACES[0], of_keys, made_of.to_vec(), |_| 1)?;
    let (mut starts, _) = g.persistent(PLACES[1], of_starts, made_of.to_vec(), |_| 1)?;
    let (fragments, ordered) = g.persistent(PLACES[2], of_fragments, made_of.to_vec(), &next)?;
    if let Some(per_pixel) = counted {
        let counted = g.upload("starts", &sums(per_pixel))?;
        g.copy_parts("keep starts", &counted, &mut starts, vec![[0, 0, of_starts]]);
    }
    Ok((keys, Abuffer { starts, fragments, ordered: ordered..next(ordered), kept: true }))
}

/// Of every one the sum of those before it; then that of all.
pub fn sums(counts: &[u32]) -> Vec<u32> {
    let before = counts.iter().scan(0, |sum, count| {
        *sum += count;
        Some(*sum)
    });
    [0].into_iter().chain(before).collect()
}
