//! Types of option values: numbers of bytes, sizes of pictures, lengths.

use super::streams;
use crate::cloud::crs::Unit;
use crate::cloud::length::{self, Length};

/// Parses a length above 0.
pub fn length(text: &str) -> Result<Length, String> {
    match text.parse::<Length>()? {
        length if length.number() > 0.0 => Ok(length),
        _ => Err(format!(
            "{text:?} is not a length above 0, such as 0.25, 0.25m or 10ft; units are {}",
            length::units()
        )),
    }
}

/// Returns a length of an option in the files' unit. Says how long it is where that may not be what
/// was meant.
pub fn counted(option: &str, length: Length, unit: &Unit) -> f64 {
    note_length(option, length, unit);
    length.counted_in(unit.metres)
}

/// Says how long a length of an option is: one without a unit, if the files are not in metres; one
/// in metres, if the files state no unit.
pub fn note_length(option: &str, length: Length, unit: &Unit) {
    match length {
        Length::OfCoordinates(length) if !unit.is_metre() && !unit.is_none() => {
            let (symbol, metres) = (unit.symbol(), length * unit.metres);
            streams::note(format_args!(
                "{option} is in the files' unit: {length} {symbol}, which are {metres:.4} m; {length}m is in metres"
            ));
        }
        Length::Metres(metres) if unit.is_none() => streams::note(format_args!(
            "{option} is {metres} m, but the files do not state their unit; one unit is taken as 1 m"
        )),
        _ => {}
    }
}

/// A number of bytes: 512MiB, 2GiB, 1000000.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bytes(pub u64);

impl std::str::FromStr for Bytes {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Bytes, String> {
        let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
        let scale = match text[digits.len()..].to_ascii_lowercase().as_str() {
            "" | "b" => Some(1),
            "k" | "kib" => Some(1u64 << 10),
            "m" | "mib" => Some(1 << 20),
            "g" | "gib" => Some(1 << 30),
            "t" | "tib" => Some(1 << 40),
            "kb" => Some(1_000),
            "mb" => Some(1_000_000),
            "gb" => Some(1_000_000_000),
            "tb" => Some(1_000_000_000_000),
            _ => None,
        };
        let bytes = scale.and_then(|scale| digits.trim().parse::<u64>().ok()?.checked_mul(scale));
        bytes.map(Bytes).ok_or(format!("{text:?} is not a number of bytes, such as 512MiB or 2GiB"))
    }
}

impl std::fmt::Display for Bytes {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let units = [(1 << 30, "GiB"), (1 << 20, "MiB"), (1 << 10, "KiB"), (1, "")];
        let (size, unit) =
            units.into_iter().find(|&(size, _)| self.0.is_multiple_of(size)).unwrap_or((1, ""));
        write!(f, "{}{unit}", self.0 / size)
    }
}

/// A picture's size `[px]`, as WIDTHxHEIGHT.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size(pub [u32; 2]);

/// The longest side of a picture `[px]`: a row of it takes a megabyte.
pub const LARGEST_SIDE: u32 = 262_144;

impl std::str::FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Size, String> {
        let sides =
            text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
        let valid = sides
            .filter(|sides: &[u32; 2]| sides.iter().all(|side| (1..=LARGEST_SIDE).contains(side)));
        valid
            .map(Size)
            .ok_or(format!("{text:?} is not WIDTHxHEIGHT in pixels, 1 to {LARGEST_SIDE} each"))
    }
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{}", self.0[0], self.0[1])
    }
}
