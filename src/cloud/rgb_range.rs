//! Ranges of colour channels: 1, 255 or 65535, or as stated by a file.
//!
//! Many writers put 8-bit values into 16-bit fields, or 255 where a format means 1. The values of
//! most points of the whole file therefore decide, not the format; a few outliers prove nothing.
//! `--rgb-range` overrides both.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Returns exactly `round(v / 257)` for all 65,536 values (guide: numerics, case 24).
pub fn to_8_bits(v: u16) -> u8 {
    ((v as u32 * 255 + 32895) >> 16) as u8
}

/// The value of a full channel, as in `--rgb-range`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RgbRange {
    Unit,
    Bytes,
    Words,
}

impl RgbRange {
    pub fn full(self) -> u16 {
        match self {
            RgbRange::Unit => 1,
            RgbRange::Bytes => 255,
            RgbRange::Words => 65535,
        }
    }

    /// Converts a channel of a 16-bit field to 8 bits, clamped.
    #[inline]
    pub fn to_8_bits(self, v: u16) -> u8 {
        match self {
            RgbRange::Unit => v.min(1) as u8 * 255,
            RgbRange::Bytes => v.min(255) as u8,
            RgbRange::Words => to_8_bits(v),
        }
    }
}

impl FromStr for RgbRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "0..1" | "1" => Ok(RgbRange::Unit),
            "0..255" | "255" => Ok(RgbRange::Bytes),
            "0..65535" | "65535" => Ok(RgbRange::Words),
            _ => Err(format!("{text:?} is not a colour range; give 0..1, 255 or 65535")),
        }
    }
}

/// The range of a file's colours, and its origin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scale {
    /// The value of a full channel.
    pub full: f64,
    pub by: By,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum By {
    /// Stated by the file or its format.
    File,
    /// Decided by the values of most points, against the file or for lack of a statement.
    Values,
    /// Given by `--rgb-range`.
    Request,
}

impl Default for Scale {
    fn default() -> Scale {
        Scale { full: 255.0, by: By::File }
    }
}

impl Scale {
    pub fn new(range: RgbRange, by: By) -> Scale {
        Scale { full: range.full().into(), by }
    }

    /// Returns the stored bits per channel, 8 or 16.
    pub fn bits(self) -> u8 {
        if self.full > 255.0 { 16 } else { 8 }
    }
}

impl fmt::Display for Scale {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let by = match self.by {
            By::File => "as the file or its format says",
            By::Values => "as the values of most points show",
            By::Request => "as --rgb-range says",
        };
        write!(f, "0 to {}, {by}", self.full)
    }
}

/// Fewer than one in this many non-black points are outliers.
const OUTLIERS: u64 = 10;

/// Tests whether this many of the coloured points are more than outliers.
pub fn is_many(points: u64, coloured: u64) -> bool {
    points.saturating_mul(OUTLIERS) > coloured
}

/// Returns the range of values for a format without one, or against its statement. `above` tests
/// whether more than outliers have a channel above a value.
pub fn range_of(fractions: bool, above: impl Fn(f32) -> bool) -> RgbRange {
    if fractions && !above(UNIT_LIMIT) {
        RgbRange::Unit
    } else if !above(255.0) {
        RgbRange::Bytes
    } else {
        RgbRange::Words
    }
}

/// Limit of fractional channels: fractions may be slightly above 1; colours of 0 to 255 are not all
/// as dark as this.
pub const UNIT_LIMIT: f32 = 2.0;

/// Statistics of 16-bit colour fields.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Occurred {
    /// Points that are not black.
    pub coloured: u64,
    /// Points with a channel above 255.
    pub wide: u64,
}

impl Occurred {
    pub fn join(self, other: Occurred) -> Occurred {
        Occurred { coloured: self.coloured + other.coloured, wide: self.wide + other.wide }
    }

    /// Tests whether every value was 0.
    pub fn is_black(self) -> bool {
        self.coloured == 0
    }

    #[inline]
    pub fn look(&mut self, [r, g, b]: [u16; 3]) {
        let bits = r | g | b;
        self.coloured += (bits != 0) as u64;
        self.wide += (bits > 255) as u64;
    }

    /// Returns the range of the fields; 16 bits if nothing occurred.
    pub fn range(self) -> RgbRange {
        if self.is_black() || is_many(self.wide, self.coloured) {
            RgbRange::Words
        } else {
            RgbRange::Bytes
        }
    }

    /// Returns a note on colours read with `scale` if it is unusual for the format or uncertain.
    pub fn says(self, scale: Scale) -> Option<String> {
        let Occurred { coloured, wide } = self;
        let narrow = coloured - wide;
        if coloured == 0 || scale.by == By::Request {
            return (wide > 0 && scale.full < 65535.0)
                .then(|| format!("clamped out-of-range colours of {wide} points"));
        }
        if scale.full > 255.0 {
            return is_many(narrow, coloured).then(|| {
                format!(
                    "colours are read as 16-bit values, but {narrow} of {coloured} coloured points have no channel above 255; {OTHERWISE} 255"
                )
            });
        }
        let outliers = if wide > 0 {
            format!(
                " except those of {wide} of {coloured} points, which were clamped; {OTHERWISE} 65535"
            )
        } else {
            String::new()
        };
        Some(format!("{NOTE_8_IN_16}{outliers}"))
    }
}

/// The option that overrides the decision; its value follows.
pub const OTHERWISE: &str = "otherwise give --rgb-range";

const NOTE_8_IN_16: &str = "colours are 8-bit values in 16-bit fields, and read as such";
