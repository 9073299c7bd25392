//! PNG and EXR files, written atomically.

use super::overlay::Overlay;
use crate::atomic_file::{AtomicFile, write_atomically};
use crate::error::{Error, Result};
use crate::passes::encode::Channels;
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer,
    LayerAttributes, LineOrder,
};
use exr::prelude::{SmallVec, WritableImage};
use std::borrow::Cow;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// Writes an 8-bit sRGB picture: RGB, rows from the top left, split into any number of pieces
/// ([`crate::passes::encode`]).
pub fn write_png(path: &Path, size: [u32; 2], pieces: &[&[u8]]) -> Result<()> {
    write_annotated_png(path, size, pieces, Overlay::default())
}

/// Writes a picture with triangles over it.
pub fn write_annotated_png(
    path: &Path,
    size: [u32; 2],
    pieces: &[&[u8]],
    over: Overlay,
) -> Result<()> {
    // Piece by piece, so that no second copy of the picture is in memory.
    let mut rows = PngRows::create(path, size[0], 0..size[1], over, Channels::Rgb)?;
    pieces.iter().try_for_each(|piece| rows.write(piece))?;
    rows.complete()?.finish()
}

/// A PNG file written row by row from the top left. Dropped before [`PngRows::complete`], it leaves
/// no file.
pub struct PngRows {
    path: PathBuf,
    // Dropped first: it writes the end of a file that is then removed.
    rows: png::StreamWriter<'static, Watched>,
    whole: AtomicFile,
    failed: Arc<Mutex<Option<std::io::Error>>>,
    width: usize,
    /// Row of the picture that is written next.
    next: usize,
    over: Overlay,
    channels: Channels,
}

/// The file and the last error of it, since the encoder ignores errors when it writes the end in
/// its destructor.
struct Watched {
    file: BufWriter<File>,
    failed: Arc<Mutex<Option<std::io::Error>>>,
}

impl Watched {
    fn watch<T>(&self, done: std::io::Result<T>) -> std::io::Result<T> {
        done.inspect_err(|error| {
            *self.failed.lock().unwrap_or_else(|poisoned| poisoned.into_inner()) =
                Some(std::io::Error::new(error.kind(), error.to_string()));
        })
    }
}

impl Write for Watched {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let written = self.file.write(bytes);
        self.watch(written)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        let flushed = self.file.flush();
        self.watch(flushed)
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        // The error is kept and reported by `finish`.
        let _ = self.flush();
    }
}

impl PngRows {
    /// Creates the file for these rows of a picture of this width.
    pub fn create(
        path: &Path,
        width: u32,
        rows: Range<u32>,
        over: Overlay,
        channels: Channels,
    ) -> Result<PngRows> {
        let whole = AtomicFile::create(path)?;
        let file =
            File::create(whole.partial()).map_err(|error| Error::io("write", path, error))?;
        let failed = Arc::new(Mutex::new(None));
        let mut encoder = png::Encoder::new(
            Watched { file: BufWriter::new(file), failed: failed.clone() },
            width,
            rows.end - rows.start,
        );
        encoder.set_color(match channels {
            Channels::Rgb => png::ColorType::Rgb,
            Channels::Rgba => png::ColorType::Rgba,
        });
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        encoder.set_compression(png::Compression::Fast);
        let (width, next) = (width as usize, rows.start as usize);
        let rows = encoder
            .write_header()
            .and_then(png::Writer::into_stream_writer)
            .map_err(|error| encoding(path, error))?;
        Ok(PngRows { path: path.to_owned(), whole, rows, failed, width, next, over, channels })
    }

    /// Writes whole rows.
    pub fn write(&mut self, pixels: &[u8]) -> Result<()> {
        let mut pixels = Cow::Borrowed(pixels);
        if !self.over.triangles.is_empty() {
            self.over.blend(pixels.to_mut(), self.channels, self.width, self.next);
        }
        self.next += pixels.len() / (self.channels.bytes() * self.width);
        self.rows.write_all(&pixels).map_err(|error| Error::io("write", &self.path, error))
    }

    /// Completes the contents.
    pub fn complete(self) -> Result<AtomicFile> {
        let PngRows { path, whole, rows, failed, .. } = self;
        rows.finish().map_err(|error| encoding(&path, error))?;
        match failed.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).take() {
            Some(error) => Err(Error::io("write", &path, error)),
            None => Ok(whole),
        }
    }
}

pub(super) fn encoding(path: &Path, error: png::EncodingError) -> Error {
    match error {
        png::EncodingError::IoError(source) => Error::io("write", path, source),
        other => Error::format(path, other.to_string()),
    }
}

/// The values of one channel, row by row from the top left.
pub enum Samples {
    Float(Vec<f32>),
    Id(Vec<u32>),
}

/// Writes a 32-bit EXR picture of named channels. The bytes do not depend on the number of threads.
pub fn write_exr(path: &Path, size: [u32; 2], channels: Vec<(&str, Samples)>) -> Result<()> {
    let channels: SmallVec<[_; 4]> = channels
        .into_iter()
        .map(|(name, samples)| match samples {
            Samples::Float(values) => AnyChannel::new(name, FlatSamples::F32(values)),
            Samples::Id(values) => AnyChannel::new(name, FlatSamples::U32(values)),
        })
        .collect();
    // Blocks in order: the parallel compressor would otherwise write them as they are completed.
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let layer = Layer::new(
        (size[0] as usize, size[1] as usize),
        LayerAttributes::default(),
        encoding,
        AnyChannels::sort(channels),
    );
    write_atomically(path, |partial| {
        Image::from_layer(layer).write().to_file(partial).map_err(|error| match error {
            exr::error::Error::Io(source) => Error::io("write", path, source),
            other => Error::format(path, other.to_string()),
        })
    })
}
