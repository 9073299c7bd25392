//! PICTURE -> SCREEN: linear colours to 8-bit sRGB, for files on the CPU and for windows on the device, to the same bytes.
//!
//! Codes are found by comparing with thresholds, since a power function rounds differently everywhere.

use crate::error::Result;
use crate::graph::{Buffer, Graph, Image, Tiles};
use crate::shader::{self, encode::Push, encode::Spec};

/// Linear values above which a channel rounds to the next 8-bit code: exact, and the same on every machine.
pub struct Thresholds([f32; 255]);

impl Thresholds {
    pub fn new() -> Thresholds {
        Thresholds(std::array::from_fn(|code| super::resolve::srgb_to_linear((code as f64 + 0.5) / 255.0) as f32))
    }

    pub fn encode(&self, linear: f32) -> u8 {
        self.0.partition_point(|&threshold| linear >= threshold) as u8
    }
}

impl Default for Thresholds {
    fn default() -> Self {
        Thresholds::new()
    }
}

/// Where a picture is shown.
pub struct Screen {
    /// A word a pixel, row by row from the top left; there may be more.
    pub words: Buffer,
    /// The lowest byte of a word is blue, not red.
    pub blue_first: bool,
}

pub fn record(g: &mut Graph, picture: &Image, screen: &mut Screen) -> Result<()> {
    let thresholds = g.upload("thresholds", &Thresholds::new().0)?;
    let push = Push { size: picture.desc.size };
    let [width, height] = picture.desc.size;
    let groups = Tiles::Groups([width.div_ceil(64), height, 1]);
    let spec = Spec { blue_first: screen.blue_first };
    g.run(shader::Encode { picture, thresholds: &thresholds, screen: &mut screen.words, push, spec }, groups);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_8_bit_code_survives_decoding_and_encoding() {
        let thresholds = Thresholds::new();
        for code in 0..=255u8 {
            assert_eq!(thresholds.encode(crate::passes::resolve::srgb_to_linear(code as f64 / 255.0) as f32), code);
        }
        assert_eq!([-1.0, f32::NAN, 2.0, f32::INFINITY].map(|value| thresholds.encode(value)), [0, 0, 255, 255]);
    }
}
