//! Finished images in, PNG and EXR files out, whole or not at all.

use crate::error::{Error, Result};
use crate::whole_file::whole_file;
use exr::prelude::{AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes, LineOrder};
use exr::prelude::{SmallVec, WritableImage};
use std::io::Write;
use std::path::Path;

/// An 8-bit sRGB picture of red, green and blue of each pixel, rows of them from the top left, in as many pieces as there are ([`crate::passes::encode`]).
pub fn write_png(path: &Path, size: [u32; 2], pieces: &[&[u8]]) -> Result<()> {
    // Piece by piece, so that no second picture is in memory.
    write_png_rows(path, size, |write| pieces.iter().try_for_each(|piece| write(piece)))
}

/// The same of pixels that `draw` hands over as it comes by them, from the top left on.
pub fn write_png_rows(
    path: &Path,
    [width, height]: [u32; 2],
    draw: impl FnOnce(&mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()>,
) -> Result<()> {
    whole_file(path, |partial| {
        let io = |error| Error::io("write", path, error);
        let file = std::fs::File::create(partial).map_err(io)?;
        let mut encoder = png::Encoder::new(std::io::BufWriter::new(file), width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        encoder.set_compression(png::Compression::Fast);
        let failed = |error: png::EncodingError| match error {
            png::EncodingError::IoError(source) => io(source),
            other => Error::format(path, other.to_string()),
        };
        let mut writer = encoder.write_header().map_err(failed)?;
        let mut rows = writer.stream_writer().map_err(failed)?;
        draw(&mut |pixels| rows.write_all(pixels).map_err(io))?;
        rows.finish().map_err(failed)?;
        writer.finish().map_err(failed)
    })
}

/// The values of one channel, row by row from the top left.
pub enum Samples {
    Float(Vec<f32>),
    Id(Vec<u32>),
}

/// A 32-bit EXR picture of named channels; the same bytes whatever the number of threads.
pub fn write_exr(path: &Path, size: [u32; 2], channels: Vec<(&str, Samples)>) -> Result<()> {
    let channels: SmallVec<[_; 4]> = channels
        .into_iter()
        .map(|(name, samples)| match samples {
            Samples::Float(values) => AnyChannel::new(name, FlatSamples::F32(values)),
            Samples::Id(values) => AnyChannel::new(name, FlatSamples::U32(values)),
        })
        .collect();
    // Blocks in order: the parallel compressor would otherwise write them as they come.
    let encoding = Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let layer = Layer::new((size[0] as usize, size[1] as usize), LayerAttributes::default(), encoding, AnyChannels::sort(channels));
    whole_file(path, |partial| {
        Image::from_layer(layer).write().to_file(partial).map_err(|error| match error {
            exr::error::Error::Io(source) => Error::io("write", path, source),
            other => Error::format(path, other.to_string()),
        })
    })
}
