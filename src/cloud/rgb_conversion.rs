//! Conversion of colour channels of any numeric type to 8 bits.
//!
//! A range stated by the file or its format holds if the values of most points agree with it;
//! otherwise they decide.

use super::rgb_range::{By, OTHERWISE, RgbRange, Scale, UNIT_LIMIT, is_many, range_of};
use rayon::prelude::*;

/// Findings of colours that decide their range.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seen {
    /// Points that are not black; NaN counts as coloured.
    coloured: u64,
    /// Points above one part in 257 of the stated range, which is the step of a byte in 16 bits.
    above_least: u64,
    /// Points above what the stated range allows.
    above_most: u64,
    /// Points above fractions, and above bytes.
    above_unit: u64,
    above_bytes: u64,
    /// True if a channel is no integer.
    fractions: bool,
}

impl Seen {
    /// Looks at colours whose stated limits per channel these are.
    pub fn of(stored: &[[f32; 3]], stated: Option<[[f64; 2]; 3]>) -> Seen {
        let reach = |share: f64| {
            stated.map_or([f32::INFINITY; 3], |limits| {
                limits.map(|[lo, hi]| (lo + share * (hi - lo)) as f32)
            })
        };
        let (least, most) = (reach(1.0 / 257.0), reach(UNIT_LIMIT.into()));
        let look = |mut seen: Seen, color: &[f32; 3]| {
            let above = |limits: [f32; 3]| color.iter().zip(limits).any(|(&v, limit)| v > limit);
            seen.coloured += u64::from(above([0.0; 3]));
            seen.above_least += u64::from(above(least));
            seen.above_most += u64::from(above(most));
            seen.above_unit += u64::from(above([UNIT_LIMIT; 3]));
            seen.above_bytes += u64::from(above([255.0; 3]));
            seen.fractions |= color.iter().any(|v| v.fract() != 0.0);
            seen
        };
        let all = stored.par_iter().with_min_len(TASK).copied();
        all.fold(Seen::default, |seen, color| look(seen, &color)).reduce(Seen::default, Seen::join)
    }

    pub fn join(self, other: Seen) -> Seen {
        Seen {
            coloured: self.coloured + other.coloured,
            above_least: self.above_least + other.above_least,
            above_most: self.above_most + other.above_most,
            above_unit: self.above_unit + other.above_unit,
            above_bytes: self.above_bytes + other.above_bytes,
            fractions: self.fractions || other.fractions,
        }
    }

    /// Decides how colours are converted. `asked` overrides the stated limits.
    pub fn decide(self, stated: Option<[[f64; 2]; 3]>, asked: Option<RgbRange>) -> Conversion {
        let up_to = |range: RgbRange| [[0.0, range.full().into()]; 3];
        if let Some(range) = asked {
            return Conversion::new(up_to(range), By::Request);
        }
        let are_many = |points: u64| is_many(points, self.coloured);
        if let Some(limits) = stated
            && (self.coloured == 0 || are_many(self.above_least) && !are_many(self.above_most))
        {
            return Conversion::new(limits, By::File);
        }
        let above = |limit: f32| {
            are_many(if limit == UNIT_LIMIT { self.above_unit } else { self.above_bytes })
        };
        let found = range_of(self.fractions, above);
        let is_said = stated.is_some_and(|limits| limits == up_to(found)) || self.coloured == 0;
        Conversion::new(up_to(found), if is_said { By::File } else { By::Values })
    }
}

/// Colours per task.
const TASK: usize = 1 << 16;

/// A conversion of colours to bytes.
#[derive(Clone, Debug)]
pub struct Conversion {
    /// Ends of every channel.
    limits: [[f64; 2]; 3],
    pub scale: Scale,
}

impl Conversion {
    fn new(limits: [[f64; 2]; 3], by: By) -> Conversion {
        let full = limits.iter().map(|[_, hi]| *hi).fold(0.0, f64::max);
        Conversion { limits, scale: Scale { full, by } }
    }

    /// Returns the decision as a note, if the file states no range or another one.
    pub fn note(&self) -> Option<String> {
        let Scale { by, .. } = self.scale;
        (by == By::Values)
            .then(|| format!("colours are read as values of {}; {OTHERWISE}", self.scale))
    }

    /// Returns the number of colours with a channel that is NaN or out of range.
    pub fn beyond(&self, stored: &[[f32; 3]]) -> u64 {
        let is_beyond = |color: &&[f32; 3]| {
            let ends = color.iter().zip(&self.limits);
            ends.into_iter().any(|(&v, [lo, hi])| !(*lo..=*hi).contains(&v.into()))
        };
        stored.par_iter().with_min_len(TASK).filter(is_beyond).count() as u64
    }

    /// Tests whether all colours become black.
    pub fn is_black(&self, stored: &[[f32; 3]]) -> bool {
        stored.iter().all(|color| self.bytes(color) == [0; 3])
    }

    pub fn convert(&self, stored: &[[f32; 3]]) -> Vec<[u8; 3]> {
        stored.par_iter().with_min_len(TASK).map(|color| self.bytes(color)).collect()
    }

    fn bytes(&self, color: &[f32; 3]) -> [u8; 3] {
        std::array::from_fn(|channel| {
            let [lo, hi] = self.limits[channel];
            // NaN becomes 0.
            ((color[channel] as f64 - lo) * (255.0 / (hi - lo))).clamp(0.0, 255.0).round() as u8
        })
    }
}
