//! Conversion of attributes that formats store as numbers of any range: colours to 8 bits,
//! intensities to 16. All points decide together how each is converted.

use super::floats::{ColorUnit, Watched};
use super::rgb_conversion::{self, Conversion};
use super::rgb_range::{By, RgbRange, Scale};
use crate::error::Result;

/// How attributes of a file's points are converted.
#[derive(Clone, Debug)]
pub struct Attributes {
    /// True if any point has a colour that is not black.
    pub has_colors: bool,
    /// True if any point has a normal: zeros and NaN alone are none.
    pub has_normals: bool,
    pub rgb_scale: Scale,
    colors: Option<Conversion>,
    /// Requested range of byte colours.
    bytes: Option<RgbRange>,
    intensities: Intensities,
}

/// How intensities are mapped to 0..=65535.
#[derive(Clone, Copy, Debug)]
enum Intensities {
    /// No point has one.
    None,
    /// Integers that fit are kept, counted from the least below 0; points without one have the
    /// smallest.
    Integers { least: f32, lowest: f32 },
    /// Others are spread over a range.
    Spread([f64; 2]),
}

impl Attributes {
    /// Decides by all points. `asked` is the user's range of colours, `limits` the file's of
    /// intensities.
    pub fn of(
        floats: &Watched,
        unit: ColorUnit,
        asked: Option<RgbRange>,
        limits: Option<[f64; 2]>,
        notes: &mut Vec<String>,
    ) -> Result<Attributes> {
        let name = floats.name;
        let mut attributes = Attributes {
            has_colors: false,
            has_normals: false,
            rgb_scale: Scale::default(),
            colors: None,
            bytes: None,
            intensities: Intensities::None,
        };
        let (mut clamped, either) = (floats.clamped, |a: bool, b: bool| a || b);
        if floats.color.is_some() {
            let asked = asked.filter(|_| unit != ColorUnit::Harmonics);
            let stated = unit.limits();
            let look = |block: usize| Ok(rgb_conversion::Seen::of(&floats.colors(block)?, stated));
            let seen = floats.fold(look, rgb_conversion::Seen::join)?;
            let conversion = seen.decide(stated, asked);
            let look = |block: usize| {
                let colors = floats.colors(block)?;
                Ok((conversion.beyond(&colors), !conversion.is_black(&colors)))
            };
            let (beyond, has_colors) =
                floats.fold(look, |one, other| (one.0 + other.0, one.1 || other.1))?;
            clamped += beyond;
            attributes.has_colors = has_colors;
            attributes.rgb_scale = conversion.scale;
            notes.extend(conversion.note().map(|note| format!("{name}: {note}")));
            attributes.colors = Some(conversion);
        } else if floats.rgb.is_some() {
            if let Some(asked) = asked {
                attributes.rgb_scale = Scale::new(asked, By::Request);
            }
            attributes.bytes = asked;
            let look = |block: usize| {
                let is_black = |color: &[u8; 3]| attributes.byte_color(*color) == [0; 3];
                Ok(!floats.byte_colors(block)?.iter().all(is_black))
            };
            attributes.has_colors = floats.fold(look, either)?;
        }
        if clamped > 0 {
            notes.push(format!("{name}: clamped NaN or out-of-range colours of {clamped} points"));
        }
        if floats.normal.is_some() {
            let look =
                |block: usize| Ok(floats.normals(block)?.iter().any(|normal| *normal != [0; 3]));
            attributes.has_normals = floats.fold(look, either)?;
        }
        if floats.intensity.is_some() {
            let look = |block: usize| Ok(SeenIntensities::of(&floats.intensities(block)?));
            let seen = floats.fold(look, SeenIntensities::join)?;
            let undefined = seen.undefined;
            if undefined > 0 {
                notes.push(format!("{name}: {undefined} intensities are missing, NaN or infinite; they were set to the smallest"));
            }
            attributes.intensities = seen.decide(limits);
        }
        Ok(attributes)
    }

    fn byte_color(&self, color: [u8; 3]) -> [u8; 3] {
        self.bytes.map_or(color, |asked| color.map(|v| asked.to_8_bits(v.into())))
    }

    /// Converts colours; `None` if there are none.
    pub fn rgb(
        &self,
        bytes: Option<Vec<[u8; 3]>>,
        colors: Option<Vec<[f32; 3]>>,
    ) -> Option<Vec<[u8; 3]>> {
        let converted = match (&self.colors, colors) {
            (Some(conversion), Some(colors)) => Some(conversion.convert(&colors)),
            _ => bytes.map(|mut bytes| {
                if self.bytes.is_some() {
                    bytes.iter_mut().for_each(|color| *color = self.byte_color(*color));
                }
                bytes
            }),
        };
        converted.filter(|_| self.has_colors)
    }

    /// Converts intensities.
    pub fn intensities(&self, stored: &[f32]) -> Vec<u16> {
        self.intensities.convert(stored)
    }

    /// Returns the range as `Part::intensity_range`, of parts without intensities too.
    pub fn intensity_range(&self, has_some: bool) -> [f64; 2] {
        if has_some { self.intensities.range() } else { [0.0, 65535.0] }
    }
}

/// Converts all intensities of a cloud; returns them, and `Part::intensity_range`.
pub fn convert_intensities(stored: &[f32]) -> (Vec<u16>, [f64; 2]) {
    let decided = SeenIntensities::of(stored).decide(None);
    (decided.convert(stored), decided.range())
}

impl Intensities {
    fn convert(&self, stored: &[f32]) -> Vec<u16> {
        match *self {
            Intensities::None => vec![0; stored.len()],
            Intensities::Integers { least, lowest } => {
                let from_least = |&v: &f32| (if v.is_finite() { v } else { lowest } - least) as u16;
                stored.iter().map(from_least).collect()
            }
            Intensities::Spread([lo, hi]) => {
                let scale = if hi > lo { 65535.0 / (hi - lo) } else { 0.0 };
                let spread = |&v: &f32| {
                    if v.is_finite() { ((v as f64 - lo) * scale).round() as u16 } else { 0 }
                };
                stored.iter().map(spread).collect()
            }
        }
    }

    fn range(&self) -> [f64; 2] {
        match *self {
            Intensities::None => [0.0, 0.0],
            Intensities::Integers { least, .. } => [least.into(), least as f64 + 65535.0],
            Intensities::Spread(range) => range,
        }
    }
}

/// Findings that decide how intensities are mapped.
struct SeenIntensities {
    /// Points without a finite one.
    undefined: usize,
    lowest: f32,
    highest: f32,
    are_whole: bool,
}

impl SeenIntensities {
    fn of(stored: &[f32]) -> SeenIntensities {
        let none = SeenIntensities {
            undefined: 0,
            lowest: f32::INFINITY,
            highest: f32::NEG_INFINITY,
            are_whole: true,
        };
        stored.iter().fold(none, |seen, &v| match v.is_finite() {
            true => SeenIntensities {
                lowest: seen.lowest.min(v),
                highest: seen.highest.max(v),
                are_whole: seen.are_whole && v.fract() == 0.0,
                ..seen
            },
            false => SeenIntensities { undefined: seen.undefined + 1, ..seen },
        })
    }

    fn join(self, other: SeenIntensities) -> SeenIntensities {
        SeenIntensities {
            undefined: self.undefined + other.undefined,
            lowest: self.lowest.min(other.lowest),
            highest: self.highest.max(other.highest),
            are_whole: self.are_whole && other.are_whole,
        }
    }

    /// Returns the mapping, within the limits that the file states, if they hold.
    fn decide(&self, limits: Option<[f64; 2]>) -> Intensities {
        let SeenIntensities { lowest, highest, are_whole, .. } = *self;
        if lowest > highest {
            return Intensities::None;
        }
        let least = lowest.min(0.0);
        if highest - least <= 65535.0 && highest - least > 1.0 && are_whole {
            return Intensities::Integers { least, lowest };
        }
        let own = [lowest as f64, highest as f64];
        let holds =
            |[a, b]: &[f64; 2]| a.is_finite() && b.is_finite() && *a <= own[0] && own[1] <= *b;
        Intensities::Spread(limits.filter(holds).unwrap_or(own))
    }
}
