//! Colours of any kind -> 8 bits a channel; and what these mean: the sRGB transfer function.
//!
//! In: channels as a file stores them. Out: 8-bit values, and what the file's own counted to: 1, 255, 65535, or what it says.
//! Many writers put 8-bit values into 16-bit fields, or 255 where a format means 1, so it is not the format that decides but the values of
//! the whole file: those of most points, since a few outliers prove nothing. `--rgb-range` goes before both.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Exactly `round(v / 257)` for all 65,536 values (HARD_CASES 24).
pub fn to_8_bits(v: u16) -> u8 {
    ((v as u32 * 255 + 32895) >> 16) as u8
}

/// `--rgb-range`: what the channels of a file count to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

    /// A channel of a 16-bit field; what is beyond the range is clamped.
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

/// What the colours of a file count to, and who says so.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scale {
    /// The value of full light.
    pub full: f64,
    pub by: By,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum By {
    /// The file, or its format.
    File,
    /// The values of most points, which are others than those that the file or its format announces, or than nothing.
    Values,
    /// `--rgb-range`.
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

    /// As stored: 8 or 16 bits a channel.
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

/// Of points that have a colour other than black, fewer than one in so many prove nothing.
const OUTLIERS: u64 = 10;

/// Whether so many of the coloured points are more than outliers.
pub fn is_many(points: u64, coloured: u64) -> bool {
    points.saturating_mul(OUTLIERS) > coloured
}

/// The range of values that no format announces, or that are others than it announces; `above` says whether more than outliers have a channel above a value.
pub fn range_of(fractions: bool, above: impl Fn(f32) -> bool) -> RgbRange {
    if fractions && !above(UNIT_LIMIT) {
        RgbRange::Unit
    } else if !above(255.0) {
        RgbRange::Bytes
    } else {
        RgbRange::Words
    }
}

/// Fractions of light may be a little above 1; colours of 0 to 255 are not all as dark as this.
pub const UNIT_LIMIT: f32 = 2.0;

/// What occurred in 16-bit fields.
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

    /// Every value was 0.
    pub fn is_black(self) -> bool {
        self.coloured == 0
    }

    #[inline]
    pub fn look(&mut self, [r, g, b]: [u16; 3]) {
        let bits = r | g | b;
        self.coloured += (bits != 0) as u64;
        self.wide += (bits > 255) as u64;
    }

    /// What the fields count to; 16 bits, as they are meant, where nothing occurred.
    pub fn range(self) -> RgbRange {
        if self.is_black() || is_many(self.wide, self.coloured) {
            RgbRange::Words
        } else {
            RgbRange::Bytes
        }
    }

    /// What to say of colours that were taken to count to `scale`: whatever is not as the format has it, or not clear.
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

/// The option that decides otherwise, before the value that it is given.
pub const OTHERWISE: &str = "otherwise give --rgb-range";

const NOTE_8_IN_16: &str = "colours are 8-bit values in 16-bit fields, and read as such";
