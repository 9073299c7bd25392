//! Colour maps of attributes, and the sRGB transfer function.

use super::attribute::{Attribute, DisplayAttribute};
use super::color_scale::ColorScale;

/// Decodes an sRGB value in 0..=1 to linear light (IEC 61966-2-1).
pub fn srgb_to_linear(encoded: f64) -> f64 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// Encodes a linear value in 0..=1 as sRGB; the inverse of [`srgb_to_linear`].
pub fn linear_to_srgb(linear: f64) -> f64 {
    if linear <= 0.0031308 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Returns entry `i` of the 256 of an attribute's colour table, sRGB in 0..=1. For colours it is
/// that of a channel.
pub fn entry(attribute: Attribute, scale: &ColorScale, i: usize) -> [f64; 3] {
    let t = i as f64 / 255.0;
    match attribute {
        Attribute::Rgb | Attribute::Corrected => [scale.toned(t); 3],
        number if number.is_number() => {
            scale.ramp.unwrap_or(attribute.ramp()).color(scale.toned(t))
        }
        Attribute::Class => class_color(i),
        // The golden angle keeps neighbouring numbers far apart in hue.
        Attribute::Source | Attribute::Return => hue(i as f64 * 0.381_966),
        _ => [0.9; 3],
    }
}

/// Returns the 8-bit sRGB colour of a class, return number or source.
pub fn code_color(attribute: Attribute, code: u8) -> [u8; 3] {
    bytes(entry(attribute, &ColorScale::default(), code as usize))
}

fn bytes(color: [f64; 3]) -> [u8; 3] {
    color.map(|channel| (255.0 * channel).round() as u8)
}

/// Returns the 8-bit sRGB colour of a number on a ramp, given as a word that need not be whole.
pub fn ramp_color(shown: &DisplayAttribute, word: f64) -> [u8; 3] {
    let [lo, hi] = shown.ramp_words();
    let place = ((word - lo) * 255.0 / (hi - lo).max(1.0)).clamp(0.0, 255.0);
    bytes(entry(shown.attribute, &shown.scale, place as usize))
}

/// Returns the 8-bit sRGB colour of a point's word, without shading.
pub fn color_of(shown: &DisplayAttribute, word: u32) -> [u8; 3] {
    let [lo, hi] = shown.ramp_words();
    let place = |word: f64| ((word - lo) * 255.0 / (hi - lo).max(1.0)).clamp(0.0, 255.0);
    let byte = |channel: u32| (word >> (8 * channel) & 255) as u8;
    match shown.attribute {
        Attribute::Rgb | Attribute::Corrected => [0, 1, 2].map(|channel| {
            let t = place(byte(channel) as f64) / 255.0;
            (255.0 * shown.toned(t)).round() as u8
        }),
        Attribute::Normal => [0, 1, 2].map(|axis| {
            (255.0 * (byte(axis) as f64 / 254.0).clamp(0.0, 1.0).powf(1.0 / 2.2)) as u8
        }),
        number if number.is_number() => {
            // Without the station.
            ramp_color(shown, (word & 0xFF_FFFF) as f64)
        }
        Attribute::Class | Attribute::Source | Attribute::Return => {
            code_color(shown.attribute, byte(0))
        }
        _ => code_color(shown.attribute, 0),
    }
}

/// Returns the customary colour of an ASPRS standard class (LAS 1.4 R15, table 17): ground brown,
/// vegetation green, buildings red, water blue.
fn class_color(class: usize) -> [f64; 3] {
    match class {
        0 => [0.90, 0.90, 0.90],
        1 => [0.72, 0.72, 0.72],
        2 => [0.65, 0.50, 0.34],
        3 => [0.60, 0.78, 0.42],
        4 => [0.36, 0.66, 0.31],
        5 => [0.15, 0.50, 0.22],
        6 => [0.82, 0.34, 0.28],
        7 | 18 => [0.90, 0.20, 0.75],
        9 => [0.26, 0.52, 0.85],
        10 => [0.45, 0.35, 0.45],
        11 => [0.48, 0.48, 0.52],
        17 => [0.93, 0.77, 0.35],
        other => hue(other as f64 * 0.381_966),
    }
}

/// Returns a bright, not fully saturated colour for a hue in turns.
fn hue(turns: f64) -> [f64; 3] {
    [0.0, 1.0 / 3.0, 2.0 / 3.0]
        .map(|shift| 0.62 + 0.3 * ((turns - shift) * std::f64::consts::TAU).cos())
}
