//! GeoTIFF files: TIFF with the place of its pixels and their coordinate system.
//!
//! Pixels are compressed in tiles, a row of tiles at a time on all threads, so that maps of any
//! size take little memory. Files that may exceed what TIFF can address become BigTIFF.

use crate::atomic_file::AtomicFile;
use crate::cloud::crs::{Crs, Kind};
use crate::error::{Error, Result};
use crate::view::map::MapGrid;
use flate2::{Compression, write::ZlibEncoder};
use rayon::prelude::*;
use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::Path;
use tiff::TiffError;
use tiff::encoder::{DirectoryEncoder, TiffEncoder, TiffKind, TiffKindBig, TiffKindStandard};
use tiff::tags::Tag;

/// Side of a tile `[px]`.
const TILE: usize = 256;

/// The largest image without compression that TIFF can certainly address `[bytes]`.
const TIFF_BYTES: u64 = 7 << 29;

/// A value of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sample {
    /// Unsigned, 8 bits.
    Byte,
    /// Unsigned, 32 bits.
    Count,
    /// Floating point, 32 bits.
    Float,
}

impl Sample {
    fn bytes(self) -> usize {
        if self == Sample::Byte { 1 } else { 4 }
    }
}

/// What a file holds, and where that lies.
#[derive(Clone, Debug)]
pub struct Map<'a> {
    pub grid: MapGrid,
    pub system: Option<&'a Crs>,
    /// Well-known text of the system, for one without an EPSG number.
    pub text: Option<&'a str>,
    pub sample: Sample,
    /// Samples of a pixel: 1, or red, green and blue, and then alpha.
    pub bands: usize,
    /// Name of the first band, and the unit of its values.
    pub named: Option<(&'a str, &'a str)>,
    /// The value of pixels without data.
    pub no_data: Option<&'a str>,
    /// True if values are heights, whose system is then stated too.
    pub has_heights: bool,
}

impl Map<'_> {
    pub fn pixel_bytes(&self) -> usize {
        self.sample.bytes() * self.bands
    }

    /// Returns the north-west corner, and the sides of a pixel, in coordinates of the file: degrees
    /// if points were drawn on a plane.
    pub fn placed(&self) -> ([f64; 2], [f64; 2]) {
        let (corner, side) = (self.grid.north_west(), self.grid.resolution);
        match self.system.and_then(|system| Some((system.plane?, system.degrees?))) {
            Some((plane, degrees)) => (
                plane.lonlat(corner.extend(0.0)).map(|angle| angle / degrees),
                plane.metres_per_degree.map(|metres| side / metres / degrees),
            ),
            None => (corner.to_array(), [side; 2]),
        }
    }
}

/// Writes a file, complete or absent. `draw` gives all rows of pixels from the north, any number
/// at a time, to the function that it gets.
pub fn write<T>(
    path: &Path,
    map: &Map,
    draw: impl FnOnce(&mut dyn FnMut(&[u8]) -> Result<()>) -> Result<T>,
) -> Result<T> {
    let whole = AtomicFile::create(path)?;
    let file = File::create(whole.partial()).map_err(|error| Error::io("write", path, error))?;
    let file = BufWriter::new(file);
    let done = if map.grid.cells() * map.pixel_bytes() as u64 > TIFF_BYTES {
        encode::<TiffKindBig, T>(file, path, map, draw)
    } else {
        encode::<TiffKindStandard, T>(file, path, map, draw)
    }?;
    whole.finish()?;
    Ok(done)
}

fn encode<K: TiffKind, T>(
    mut file: BufWriter<File>,
    path: &Path,
    map: &Map,
    draw: impl FnOnce(&mut dyn FnMut(&[u8]) -> Result<()>) -> Result<T>,
) -> Result<T> {
    let failed = |error| failure(path, error);
    let mut encoder = TiffEncoder::<_, K>::new_generic(&mut file).map_err(failed)?;
    let mut image = encoder.image_directory().map_err(failed)?;
    let row_bytes = map.grid.size[0] as usize * map.pixel_bytes();
    let (mut offsets, mut lengths) = (Vec::new(), Vec::new());
    // Less than a row of tiles.
    let mut rows = Vec::new();
    let mut put = |rows: &[u8]| -> std::result::Result<(), TiffError> {
        for tile in tiles(rows, row_bytes, map.pixel_bytes()) {
            let tile = tile?;
            offsets.push(K::convert_offset(image.write_data(&tile[..])?)?);
            lengths.push(K::convert_offset(tile.len() as u64)?);
        }
        Ok(())
    };
    let done = draw(&mut |mut pixels| {
        while !pixels.is_empty() {
            let (now, later) = pixels.split_at(pixels.len().min(TILE * row_bytes - rows.len()));
            rows.extend_from_slice(now);
            pixels = later;
            if rows.len() == TILE * row_bytes {
                put(&rows).map_err(failed)?;
                rows.clear();
            }
        }
        Ok(())
    })?;
    put(&rows).map_err(failed)?;
    let tags = |image: &mut DirectoryEncoder<_, K>| {
        image.write_tag(Tag::TileOffsets, K::convert_slice(&offsets))?;
        image.write_tag(Tag::TileByteCounts, K::convert_slice(&lengths))?;
        describe(image, map)
    };
    tags(&mut image).and_then(|()| image.finish()).map_err(failed)?;
    file.flush().map_err(|error| Error::io("write", path, error))?;
    Ok(done)
}

/// Returns a row of compressed tiles. Tiles are whole: beyond the image they hold zeros.
fn tiles(rows: &[u8], row_bytes: usize, pixel_bytes: usize) -> Vec<std::io::Result<Vec<u8>>> {
    let tile_bytes = TILE * pixel_bytes;
    let compressed = |left: usize| {
        let mut tile = vec![0; TILE * tile_bytes];
        let right = (left + tile_bytes).min(row_bytes);
        for (row, into) in rows.chunks_exact(row_bytes).zip(tile.chunks_exact_mut(tile_bytes)) {
            into[..right - left].copy_from_slice(&row[left..right]);
        }
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(&tile)?;
        encoder.finish()
    };
    let across = if rows.is_empty() { 0 } else { row_bytes.div_ceil(tile_bytes) };
    (0..across).into_par_iter().map(|tile| compressed(tile * tile_bytes)).collect()
}

fn failure(path: &Path, error: TiffError) -> Error {
    match error {
        TiffError::IoError(source) => Error::io("write", path, source),
        other => Error::format(path, other.to_string()),
    }
}

/// Writes what pixels are, and where.
fn describe<W: Write + Seek, K: TiffKind>(
    image: &mut DirectoryEncoder<W, K>,
    map: &Map,
) -> std::result::Result<(), TiffError> {
    let [width, height] = map.grid.size;
    let bands = map.bands;
    image.write_tag(Tag::ImageWidth, width)?;
    image.write_tag(Tag::ImageLength, height)?;
    image.write_tag(Tag::TileWidth, TILE as u32)?;
    image.write_tag(Tag::TileLength, TILE as u32)?;
    image.write_tag(Tag::BitsPerSample, &vec![8 * map.sample.bytes() as u16; bands][..])?;
    let format = if map.sample == Sample::Float { 3u16 } else { 1 };
    image.write_tag(Tag::SampleFormat, &vec![format; bands][..])?;
    image.write_tag(Tag::SamplesPerPixel, bands as u16)?;
    image.write_tag(Tag::PlanarConfiguration, 1u16)?;
    // Deflate.
    image.write_tag(Tag::Compression, 8u16)?;
    // Brightness, or red, green and blue.
    image.write_tag(Tag::PhotometricInterpretation, if bands == 1 { 1u16 } else { 2 })?;
    if bands == 4 {
        // Alpha that colours are not multiplied by.
        image.write_tag(Tag::ExtraSamples, 2u16)?;
    }
    let ([x, y], [across, down]) = map.placed();
    image.write_tag(Tag::ModelPixelScaleTag, &[across, down, 0.0][..])?;
    image.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, x, y, 0.0][..])?;
    let Keys { directory, numbers, texts } = Keys::of(map);
    image.write_tag(Tag::GeoKeyDirectoryTag, &directory[..])?;
    if !numbers.is_empty() {
        image.write_tag(Tag::GeoDoubleParamsTag, &numbers[..])?;
    }
    if !texts.is_empty() {
        image.write_tag(Tag::GeoAsciiParamsTag, &texts[..])?;
    }
    if let Some(no_data) = map.no_data {
        image.write_tag(Tag::GdalNodata, no_data)?;
    }
    if let Some((name, unit)) = map.named {
        let item = |role: &str, text: &str| {
            format!(
                "<Item name=\"{}\" sample=\"0\" role=\"{role}\">{text}</Item>",
                role.to_uppercase()
            )
        };
        let items = item("description", name) + &item("unittype", unit);
        image.write_tag(GDAL_METADATA, &format!("<GDALMetadata>{items}</GDALMetadata>")[..])?;
    }
    Ok(())
}

/// Names and units of bands.
const GDAL_METADATA: Tag = Tag::Unknown(42112);

/// A value that is defined by other keys.
const OF_THE_USER: u16 = 32767;

/// Units of length by their EPSG numbers, and what they are in metres: metre, foot, foot of the US.
const LENGTHS: [(u16, f64); 3] = [(9001, 1.0), (9002, 0.3048), (9003, 1200.0 / 3937.0)];

/// A projection without an EPSG number.
#[derive(Clone, Debug)]
struct Projection {
    /// Transverse Mercator, Lambert's conic with two parallels, or Albers'.
    method: u16,
    /// Keys and values, in rising order; lengths in units of the system.
    parameters: Vec<(u16, f64)>,
    /// Larger radius `[m]`, and inverse flattening.
    ellipsoid: [f64; 2],
}

impl Projection {
    /// Reads a PROJ definition; `None` of other projections, and of ellipsoids without numbers.
    fn of(proj: &str) -> Option<Projection> {
        let value = |name: &str| {
            let mut words = proj.split_whitespace().filter_map(|word| word.split_once('='));
            words.find(|(key, _)| key.strip_prefix('+') == Some(name)).map(|(_, value)| value)
        };
        let number = |name: &str| value(name)?.parse::<f64>().ok();
        let metres = number("to_meter").or_else(|| value("units").is_none().then_some(1.0));
        let [east, north] = ["x_0", "y_0"].map(|name| number(name).unwrap_or(0.0));
        let [latitude, longitude] = ["lat_0", "lon_0"].map(|name| number(name).unwrap_or(0.0));
        let (east, north) = (east / metres?, north / metres?);
        let parallels = || Some([(3078, number("lat_1")?), (3079, number("lat_2")?)]);
        let origin = [(3080, longitude), (3081, latitude), (3082, east), (3083, north)];
        let (method, parameters) = match value("proj")? {
            "tmerc" => {
                let scale = number("k").or_else(|| number("k_0")).unwrap_or(1.0);
                (1, [&origin[..], &[(3092, scale)]].concat())
            }
            "lcc" => (
                8,
                [
                    parallels()?,
                    [(3084, longitude), (3085, latitude)],
                    [(3086, east), (3087, north)],
                ]
                .concat(),
            ),
            "aea" => (11, [&parallels()?[..], &origin].concat()),
            _ => return None,
        };
        let ellipsoid = match (number("a"), number("rf"), value("ellps")) {
            (Some(radius), Some(flattening), _) => [radius, flattening],
            (_, _, Some("GRS80")) => [6_378_137.0, 298.257_222_101],
            (_, _, Some("WGS84")) => [6_378_137.0, 298.257_223_563],
            _ => return None,
        };
        Some(Projection { method, parameters, ellipsoid })
    }
}

/// The coordinate system as GeoTIFF keys, in rising order.
#[derive(Default)]
struct Keys {
    /// A header of four numbers, then four numbers a key.
    directory: Vec<u16>,
    numbers: Vec<f64>,
    texts: String,
}

impl Keys {
    fn of(map: &Map) -> Keys {
        // Version 1.1: systems of heights are EPSG numbers.
        let mut keys = Keys { directory: vec![1, 1, 1, 0], ..Keys::default() };
        let kind = map.system.map(|system| system.kind);
        match kind {
            Some(Kind::Projected) => keys.number(1024, 1),
            Some(Kind::Geographic) => keys.number(1024, 2),
            _ => {}
        }
        // A pixel is an area.
        keys.number(1025, 1);
        if let Some(system) = map.system {
            keys.system(system, map.text);
        }
        let heights = map.system.filter(|_| map.has_heights).and_then(|s| s.height_epsg);
        if let Some(code) = heights.and_then(|code| u16::try_from(code).ok()) {
            keys.number(4096, code);
        }
        keys.directory[3] = (keys.directory.len() / 4 - 1) as u16;
        keys
    }

    fn system(&mut self, system: &Crs, text: Option<&str>) {
        self.text(1026, &system.title());
        let code = system.epsg.and_then(|code| u16::try_from(code).ok());
        let name = || system.name.clone().unwrap_or_else(|| "unnamed".into());
        match system.kind {
            Kind::Projected if code.is_some() => self.number(3072, code.unwrap_or(OF_THE_USER)),
            Kind::Projected => {
                let projection = system.proj.as_deref().and_then(Projection::of);
                if let Some(&Projection { ellipsoid: [radius, flattening], .. }) =
                    projection.as_ref()
                {
                    self.number(2048, OF_THE_USER);
                    self.number(2050, OF_THE_USER);
                    self.number(2054, 9102);
                    self.number(2056, OF_THE_USER);
                    self.double(2057, radius);
                    self.double(2059, flattening);
                }
                self.number(3072, OF_THE_USER);
                // Text of the first version after these words is read by GDAL and ArcGIS.
                let text = text.filter(|text| text.starts_with("PROJCS") && text.is_ascii());
                let text = text.filter(|_| projection.is_none());
                self.text(3073, &text.map_or_else(name, |wkt| format!("ESRI PE String = {wkt}")));
                if let Some(Projection { method, .. }) = &projection {
                    self.number(3074, OF_THE_USER);
                    self.number(3075, *method);
                }
                let metres = system.unit().metres;
                match LENGTHS.iter().find(|(_, own)| *own == metres) {
                    Some(&(code, _)) => self.number(3076, code),
                    None => {
                        self.number(3076, OF_THE_USER);
                        self.double(3077, metres);
                    }
                }
                let parameters = projection.iter().flat_map(|own| &own.parameters);
                parameters.for_each(|&(key, value)| self.double(key, value));
            }
            Kind::Geographic => {
                self.number(2048, code.unwrap_or(OF_THE_USER));
                if code.is_none() {
                    self.text(2049, &name());
                }
                self.number(2054, if system.degrees == Some(1.0) { 9102 } else { OF_THE_USER });
            }
            Kind::Geocentric | Kind::Local => {}
        }
    }

    fn number(&mut self, key: u16, value: u16) {
        self.directory.extend([key, 0, 1, value]);
    }

    fn double(&mut self, key: u16, value: f64) {
        self.directory.extend([key, 34736, 1, self.numbers.len() as u16]);
        self.numbers.push(value);
    }

    /// Adds a text, which ends with a bar.
    fn text(&mut self, key: u16, text: &str) {
        let text: String =
            text.chars().map(|c| if c.is_ascii() && c != '|' { c } else { '?' }).collect();
        let (length, at) = (text.len() as u16 + 1, self.texts.len() as u16);
        self.directory.extend([key, 34737, length, at]);
        self.texts += &text;
        self.texts.push('|');
    }
}
