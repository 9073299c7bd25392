//! Conversion of colour channels of any numeric type to 8 bits.
//!
//! A range stated by the file or its format holds if the values of most points agree with it;
//! otherwise they decide.

use super::rgb_range::{By, OTHERWISE, RgbRange, Scale, UNIT_LIMIT, is_many, range_of};
use rayon::prelude::*;

pub struct Converted {
    pub rgb: Vec<[u8; 3]>,
    pub scale: Scale,
    /// Points with a channel that is NaN or out of range.
    pub clamped: u64,
    /// The decision, if the file states no range or another one.
    pub note: Option<String>,
}

/// Converts colours. `limits` are the stated ones per channel; `asked` overrides them.
pub fn convert(
    stored: &[[f32; 3]],
    limits: Option<[[f64; 2]; 3]>,
    asked: Option<RgbRange>,
) -> Converted {
    let (limits, by) = decide(stored, limits, asked);
    let full = limits.iter().map(|[_, hi]| *hi).fold(0.0, f64::max);
    let scale = Scale { full, by };
    let is_beyond = |color: &[f32; 3]| {
        color.iter().zip(&limits).any(|(&v, [lo, hi])| !(*lo..=*hi).contains(&v.into()))
    };
    let clamped = chunked(stored).filter(|color| is_beyond(color)).count() as u64;
    let rgb = chunked(stored).map(|color| bytes(color, &limits)).collect();
    let note =
        (by == By::Values).then(|| format!("colours are read as values of {scale}; {OTHERWISE}"));
    Converted { rgb, scale, clamped, note }
}

/// Returns the ends of every channel and their origin.
fn decide(
    stored: &[[f32; 3]],
    stated: Option<[[f64; 2]; 3]>,
    asked: Option<RgbRange>,
) -> ([[f64; 2]; 3], By) {
    let up_to = |range: RgbRange| [[0.0, range.full().into()]; 3];
    if let Some(range) = asked {
        return (up_to(range), By::Request);
    }
    // NaN counts as coloured.
    let coloured = chunked(stored).filter(|color| color.iter().any(|&v| v > 0.0)).count() as u64;
    let beyond = |is_beyond: &(dyn Fn(&[f32; 3]) -> bool + Sync)| {
        is_many(chunked(stored).filter(|color| is_beyond(color)).count() as u64, coloured)
    };
    if let Some(limits) = stated {
        let reaches = |share: f64| {
            let limits = limits.map(|[lo, hi]| (lo + share * (hi - lo)) as f32);
            beyond(&|color| color.iter().zip(limits).any(|(&v, limit)| v > limit))
        };
        // One part in 257 is the step of a byte in 16 bits.
        if coloured == 0 || reaches(1.0 / 257.0) && !reaches(UNIT_LIMIT.into()) {
            return (limits, By::File);
        }
    }
    let fractions = stored.iter().flatten().any(|v| v.fract() != 0.0);
    let found = range_of(fractions, |limit| beyond(&|color| color.iter().any(|&v| v > limit)));
    let is_said = stated.is_some_and(|limits| limits == up_to(found)) || coloured == 0;
    (up_to(found), if is_said { By::File } else { By::Values })
}

fn bytes(color: &[f32; 3], limits: &[[f64; 2]; 3]) -> [u8; 3] {
    std::array::from_fn(|channel| {
        let [lo, hi] = limits[channel];
        // NaN becomes 0.
        ((color[channel] as f64 - lo) * (255.0 / (hi - lo))).clamp(0.0, 255.0).round() as u8
    })
}

fn chunked(stored: &[[f32; 3]]) -> impl IndexedParallelIterator<Item = &[f32; 3]> {
    stored.par_iter().with_min_len(1 << 16)
}
