//! A sample of a file's points from all over it, for a preview.
//!
//! It consists of as many pieces as fast reading allows: scanners write neighbouring points
//! together, and a few long pieces would look like slices of the scene.

use super::header::Layout;
use super::{Las, Packing, Places, Sequence, Stretch};
use crate::cloud::input::Input;
use crate::cloud::{ColumnSet, Part};
use crate::error::Result;
use crate::progress::Progress;

/// Adjacent points read from an uncompressed file: fewer would take more reads than a disk does in
/// a second.
const RUN: u64 = 64;

/// One in this many points of a run is kept, so that it spans more; a disk reads about as long for
/// it.
const STRIDE: u64 = 8;

/// Most LAZ chunks whose beginnings are decoded: a layered one must be read whole, usually a third
/// of a megabyte.
const CHUNKS: usize = 256;

/// Most chunks for statistics alone.
const FEW_CHUNKS: usize = 4;
const FEW_POINTS: u64 = 1024;

/// Bytes of a chunk that exceed its first point in any coding.
const SLACK: u64 = 1 << 16;

/// Reads about this many points; `None` if the middle cannot be located without reading what is
/// before it.
pub fn sample(
    input: &Input,
    wanted: ColumnSet,
    points: u64,
    progress: &dyn Progress,
) -> Result<Option<Part>> {
    let mut las = Las::open(input, wanted, &mut Vec::new())?;
    let all = las.points();
    let Places::Known(stretches) = &las.places else { return Ok(None) };
    las.places = Places::Known(match is_whole(&las.packing) {
        Some(whole) => beginnings(stretches, CHUNKS, points, whole),
        None => {
            // Only the first bytes of very wide records are read.
            let every = (all / points.max(1)).clamp(1, STRIDE);
            las.fields.record_bytes *= every as usize;
            runs(las.layout.points_at, all / every, las.fields.record_bytes as u64, points)
        }
    });
    Ok(Some(las.read(input, progress)?.0))
}

/// Returns runs of records, evenly spread over all.
fn runs(at: u64, all: u64, record_bytes: u64, points: u64) -> Vec<Stretch> {
    let count = points.min(all).div_ceil(RUN);
    let first = |run: u64| (run as u128 * all as u128 / count as u128) as u64;
    let run = |number| {
        let points = RUN.min(first(number + 1) - first(number));
        Stretch { at: at + first(number) * record_bytes, bytes: points * record_bytes, points }
    };
    (0..count).map(run).collect()
}

/// Returns the places of few points that represent the rest, from all over the file if possible.
pub fn few(las: &Las) -> Places {
    match (&las.places, is_whole(&las.packing)) {
        (Places::Sequence(sequence), _) => {
            Places::Sequence(Sequence { points: sequence.points.min(FEW_POINTS), ..*sequence })
        }
        (Places::Known(chunks), Some(whole)) => {
            Places::Known(beginnings(chunks, FEW_CHUNKS, FEW_POINTS, whole))
        }
        (Places::Known(_), None) => {
            let Layout { points_at, record_bytes, .. } = las.layout;
            Places::Known(runs(points_at, las.points(), record_bytes as u64, FEW_POINTS))
        }
    }
}

/// Returns whether the beginning of a chunk takes all of its bytes; `None` without chunks.
fn is_whole(packing: &Packing) -> Option<bool> {
    match packing {
        Packing::Plain => None,
        Packing::Laz(coding) => Some(coding.is_layered()),
        Packing::Nodes(_) => Some(true),
    }
}

/// Returns the first points of at most `most` chunks: a chunk is decoded from its beginning.
fn beginnings(chunks: &[Stretch], most: usize, points: u64, whole: bool) -> Vec<Stretch> {
    let chosen = || chunks.iter().step_by(chunks.len().div_ceil(most).max(1));
    let all = chosen().map(|chunk| chunk.points).sum::<u64>().max(1);
    let beginning = |chunk: &Stretch| {
        let share =
            |of: u64| (of as u128 * points as u128).div_ceil(all as u128).min(of as u128) as u64;
        // If the beginning takes more than twice its share of bytes, its last points are missing.
        let bytes =
            if whole { chunk.bytes } else { chunk.bytes.min(2 * share(chunk.bytes) + SLACK) };
        Stretch { bytes, points: share(chunk.points), ..*chunk }
    };
    chosen().map(beginning).collect()
}
