//! Encodes linear colours as 8-bit sRGB, with the same bytes for files and windows.
//!
//! Codes are found by comparing with thresholds, since a power function rounds differently on every
//! device.

use super::project::{self, Strip};
use crate::error::Result;
use crate::graph::{Buffer, CompletedSubmission, Dispatch, Graph, Image};
use crate::shader::{self, encode::Push, encode::Spec};

/// Smallest linear values that round to each next 8-bit code: exact, and the same on every machine.
pub struct Thresholds([f32; 255]);

impl Thresholds {
    pub fn new() -> Thresholds {
        Thresholds(std::array::from_fn(|code| {
            crate::cloud::colormap::srgb_to_linear((code as f64 + 0.5) / 255.0) as f32
        }))
    }

    pub fn encode(&self, linear: f32) -> u8 {
        self.0.partition_point(|&threshold| linear >= threshold) as u8
    }

    /// Returns, for every start of a float's bits as in glsl/core/encode.comp, the bits of the
    /// threshold among them, if any, and the code below it. The linear colours of that code and of
    /// the next follow, for glsl/core/compose.frag.
    pub fn buckets(&self) -> Vec<[u32; 4]> {
        let float = |start: u32| f32::from_bits(start << 16);
        let bucket = |start: u32| {
            let [below, within] = [start, start + 1]
                .map(|start| self.0.partition_point(|&threshold| threshold < float(start)));
            assert!(within - below <= 1, "buckets are narrower than codes");
            let threshold = if within > below { self.0[below] } else { f32::INFINITY };
            let linear = |code: usize| {
                crate::cloud::colormap::srgb_to_linear(code.min(255) as f64 / 255.0) as f32
            };
            [
                threshold.to_bits(),
                below as u32,
                linear(below).to_bits(),
                linear(below + 1).to_bits(),
            ]
        };
        (FIRST..=LAST).map(bucket).collect()
    }
}

/// Range of starts as in glsl/core/encode.comp: 2^-13 and 1.
const FIRST: u32 = 0x3900;
const LAST: u32 = 0x3F80;

impl Default for Thresholds {
    fn default() -> Self {
        Thresholds::new()
    }
}

/// The target of a window.
pub struct Screen {
    /// One word per pixel, row by row from the top left; there may be more.
    pub words: Buffer,
    /// True if the lowest byte of a word is blue instead of red.
    pub blue_first: bool,
}

pub fn record(g: &mut Graph, picture: &Image, screen: &mut Screen) -> Result<()> {
    let buckets = &g.upload("buckets", &Thresholds::new().buckets())?;
    let size = picture.desc.size;
    let (push, spec) = (
        Push { size, top: 0 },
        Spec { blue_first: screen.blue_first, packed: false, alpha: false },
    );
    let groups = Dispatch::Groups([size[0].div_ceil(64), size[1], 1]);
    g.run(shader::Encode { picture, buckets, screen: &mut screen.words, push, spec }, groups);
    Ok(())
}

/// What a pixel of a file has, 8 bits each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Channels {
    #[default]
    Rgb,
    /// Colours are not multiplied by alpha, and 0 where it is.
    Rgba,
}

impl Channels {
    /// Returns the bytes of a pixel.
    pub fn bytes(self) -> usize {
        if self == Channels::Rgba { 4 } else { 3 }
    }
}

/// A picture for a file: one buffer per strip, from the top down.
pub struct Encoded {
    strips: Vec<(Buffer, Strip)>,
    channels: Channels,
}

/// Most bytes per pixel: whole words.
const PIXEL_BYTES: u64 = 4;

/// Encodes a picture into buffers that are read back.
pub fn download(g: &mut Graph, picture: &Image) -> Result<Encoded> {
    encoded(g, picture, Channels::Rgb)
}

/// Encodes a picture with these channels, likewise. For one with alpha the background must be
/// black.
pub fn encoded(g: &mut Graph, picture: &Image, channels: Channels) -> Result<Encoded> {
    let buckets = &g.upload("buckets", &Thresholds::new().buckets())?;
    let strips = project::strips(picture.desc.size, PIXEL_BYTES, g.binding_limit())
        .into_iter()
        .map(|strip| {
            let Strip { top, size } = strip;
            let push = Push { size, top };
            if channels == Channels::Rgba {
                let mut words = g.readback("bytes", 4 * size[0] as u64 * size[1] as u64);
                let spec = Spec { blue_first: false, packed: false, alpha: true };
                let groups = Dispatch::Groups([size[0].div_ceil(64), size[1], 1]);
                g.run(shader::Encode { picture, buckets, screen: &mut words, push, spec }, groups);
                return (words, strip);
            }
            let fours = (size[0] * size[1]).div_ceil(4);
            let mut bytes = g.readback("bytes", 12 * fours as u64);
            let spec = Spec { blue_first: false, packed: true, alpha: false };
            let rows = fours.div_ceil(64).div_ceil(65_535);
            let groups = Dispatch::Groups([fours.div_ceil(64).div_ceil(rows), rows, 1]);
            g.run(shader::Encode { picture, buckets, screen: &mut bytes, push, spec }, groups);
            (bytes, strip)
        });
    Ok(Encoded { strips: strips.collect(), channels })
}

impl Encoded {
    /// Returns red, green and blue of each pixel, and alpha if it was asked for: row by row from
    /// the top left.
    pub fn read<'f>(&self, frame: &'f CompletedSubmission) -> Vec<&'f [u8]> {
        let pixels =
            |strip: &Strip| self.channels.bytes() * strip.size[0] as usize * strip.size[1] as usize;
        self.strips.iter().map(|(bytes, strip)| &frame.read(bytes)[..pixels(strip)]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_8_bit_code_survives_decoding_and_encoding() {
        let thresholds = Thresholds::new();
        for code in 0..=255u8 {
            assert_eq!(
                thresholds
                    .encode(crate::cloud::colormap::srgb_to_linear(code as f64 / 255.0) as f32),
                code
            );
        }
        assert_eq!(
            [-1.0, f32::NAN, 2.0, f32::INFINITY].map(|value| thresholds.encode(value)),
            [0, 0, 255, 255]
        );
    }

    #[test]
    fn a_bucket_and_one_comparison_give_the_same_codes() {
        let (thresholds, buckets) = (Thresholds::new(), Thresholds::new().buckets());
        let code = |linear: f32| {
            let [threshold, below, ..] =
                buckets[((linear.to_bits() >> 16).clamp(FIRST, LAST) - FIRST) as usize];
            below + (linear.min(1.0) >= f32::from_bits(threshold)) as u32
        };
        let near = |value: f32| [value.next_down(), value, value.next_up()];
        let starts = (FIRST..=LAST).map(|start| f32::from_bits(start << 16));
        for linear in
            thresholds.0.into_iter().chain(starts).flat_map(near).chain([1e-30, 2.0, f32::INFINITY])
        {
            assert_eq!(code(linear), thresholds.encode(linear) as u32, "{linear}");
        }
    }
}
