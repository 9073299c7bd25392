//! Readers: files to points.
//!
//! [`read`] returns a [`Cloud`]: one [`Part`] per file (or E57 scan), each a struct of arrays
//! ([`Columns`]) on its own integer [`Lattice`]. Coordinates stay integers up to the pixel: at UTM
//! 5,000,000 an `f32` is half a metre wide (guide: numerics, case 1). Each part keeps its own
//! lattice, so opening two files together moves no point of either. A reader checks the header
//! against the file's length before it allocates or calls a library, and reports in
//! [`Cloud::notes`] what it skipped.

pub mod attribute;
mod axis;
pub mod catch_panic;
pub mod color_scale;
pub mod colormap;
pub(crate) mod column_file;
pub mod crs;
pub mod digits;
pub mod e57;
mod encoding;
pub mod filter;
mod float_attributes;
mod floats;
mod from_floats;
pub mod ground;
pub mod histograms;
pub(crate) mod input;
pub mod las;
pub mod length;
mod mmap;
pub mod obj;
pub mod octahedral;
pub mod ply;
pub mod point_lookup;
pub mod points;
pub mod ptx;
mod rgb_conversion;
pub mod rgb_range;
pub mod robust_bounds;
pub mod scalar;
pub mod spacing;
pub mod strays;
pub mod stream;
pub mod table;
mod text;
pub mod up;
mod xml;
pub mod xyz;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crs::{Crs, Sample};
use from_floats::ReadPart;
use glam::DVec3;
use input::Input;
use rayon::prelude::*;
use rgb_range::{RgbRange, Scale};
use scalar::{Scalar, ScalarColumn, Scalars};
use std::ops::Range;
use std::path::{Path, PathBuf};
use strays::Treatment;
use table::TextOptions;
use up::{Up, UpOption};

/// The integer grid of a part's points: `world = offset + step * q` per axis, f64, in metres (or
/// the file's unit).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    pub step: DVec3,
    pub offset: DVec3,
}

impl Lattice {
    pub fn world(&self, q: [i64; 3]) -> DVec3 {
        self.offset + self.step * DVec3::new(q[0] as f64, q[1] as f64, q[2] as f64)
    }

    /// Finest and coarsest step, and farthest coordinate. Cubes of coordinates stay finite, and
    /// cubes of steps normal.
    pub const LIMITS: [f64; 2] = [
        f64::from_bits((1023 - Self::LIMIT_BITS) << 52),
        f64::from_bits((1023 + Self::LIMIT_BITS) << 52),
    ];
    const LIMIT_BITS: u64 = 333;

    /// Returns what is wrong with the numbers, if anything.
    pub fn wrong(&self) -> Option<String> {
        let [finest, coarsest] = Self::LIMITS;
        let Lattice { step, offset } = *self;
        if !(0..3).all(|axis| (finest..=coarsest).contains(&step[axis])) {
            return Some(format!(
                "has steps of {:e}, {:e}, {:e} between coordinates; they must lie between {finest:.0e} and {coarsest:.0e}",
                step.x, step.y, step.z
            ));
        }
        let is_far = offset.abs().max_element() > coarsest || offset.is_nan();
        is_far.then(|| format!("has coordinates around {offset}, beyond {coarsest:.0e}"))
    }

    /// Returns what is wrong if a box reaches farther than 2^53 steps from 0, or beyond the
    /// farthest coordinate.
    pub fn too_far(&self, lo: DVec3, hi: DVec3) -> Option<String> {
        const MOST_STEPS: f64 = (1u64 << 53) as f64;
        let [_, farthest] = Self::LIMITS;
        let far = lo.abs().max(hi.abs());
        let is_far = |axis: &usize| {
            let steps = far[*axis] / self.step[*axis].abs();
            !(steps <= MOST_STEPS && far[*axis] <= farthest)
        };
        let axis = (0..3).find(is_far)?;
        let (name, far, step) = (["x", "y", "z"][axis], far[axis], self.step[axis]);
        Some(format!(
            "has {name} coordinates of up to {far:e}, more than 2^53 steps of {step:e} or beyond {farthest:.0e}: positions there cannot be distinguished"
        ))
    }

    /// Returns the world corners of a box given in steps.
    pub fn world_box(&self, steps: [[i32; 3]; 2]) -> (DVec3, DVec3) {
        let [lo, hi] = steps.map(|q| self.world(q.map(i64::from)));
        (lo, hi)
    }
}

/// Points as a struct of arrays. Every present column has the length of `x`; columns not requested
/// or not in the file are `None`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    /// Coordinates in lattice steps.
    pub x: Vec<i32>,
    pub y: Vec<i32>,
    pub z: Vec<i32>,
    /// 8 bits a channel, sRGB. 16-bit files are rounded exactly, `(v * 255 + 32895) >> 16` (guide:
    /// numerics, case 24). A file whose colours are all 0 has none.
    pub rgb: Option<Vec<[u8; 3]>>,
    /// Intensity. LAS: the file's value. Float formats: 0..=65535 over [`Part::intensity_range`].
    pub intensity: Option<Vec<u16>>,
    /// LAS classification.
    pub class: Option<Vec<u8>>,
    /// Return number (low four bits) and number of returns (high four bits).
    pub returns: Option<Vec<u8>>,
    /// LAS point source id as in the file; [`Cloud::stations`] lists those that occur.
    pub source: Option<Vec<u16>>,
    /// Unit normals, 127 = 1.0; (0,0,0) where missing.
    pub normal: Option<Vec<[i8; 3]>>,
    /// GPS time as in the file; may be NaN.
    pub gps_time: Option<Vec<f64>>,
    /// The requested [`Scalar`]s that the file has, in its order.
    pub scalars: Vec<ScalarColumn>,
    /// Extent and strays, computed on first use.
    pub extent: strays::Kept,
}

impl Columns {
    pub fn len(&self) -> usize {
        self.x.len()
    }

    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Returns the coordinates along an axis.
    pub fn along(&self, axis: usize) -> &[i32] {
        [&self.x, &self.y, &self.z][axis]
    }

    /// Returns the box around the points [lattice steps].
    pub fn bounds(&self) -> Option<[[i32; 3]; 2]> {
        let (x, y, z) = (range(&self.x)?, range(&self.y)?, range(&self.z)?);
        Some([[x.0, y.0, z.0], [x.1, y.1, z.1]])
    }

    /// Returns the numbers of a scalar.
    pub fn scalar(&self, scalar: Scalar) -> Option<&Vec<f64>> {
        self.scalars.iter().find(|own| own.scalar == scalar).map(|own| &own.numbers)
    }

    /// Returns the set of present columns.
    pub fn available(&self) -> ColumnSet {
        ColumnSet {
            rgb: self.rgb.is_some(),
            intensity: self.intensity.is_some(),
            class: self.class.is_some(),
            returns: self.returns.is_some(),
            source: self.source.is_some(),
            normal: self.normal.is_some(),
            gps_time: self.gps_time.is_some(),
            scalars: self.scalars.iter().map(|own| own.scalar).collect(),
        }
    }

    /// Copies a range of points.
    pub fn slice(&self, points: Range<usize>) -> Columns {
        fn cut<T: Copy>(column: &Option<Vec<T>>, points: &Range<usize>) -> Option<Vec<T>> {
            column.as_ref().map(|column| column[points.clone()].to_vec())
        }
        Columns {
            x: self.x[points.clone()].to_vec(),
            y: self.y[points.clone()].to_vec(),
            z: self.z[points.clone()].to_vec(),
            rgb: cut(&self.rgb, &points),
            intensity: cut(&self.intensity, &points),
            class: cut(&self.class, &points),
            returns: cut(&self.returns, &points),
            source: cut(&self.source, &points),
            normal: cut(&self.normal, &points),
            gps_time: cut(&self.gps_time, &points),
            scalars: self.each_scalar(|numbers| numbers[points.clone()].to_vec()),
            ..Columns::default()
        }
    }

    /// Copies the given points, all present columns.
    pub fn pick(&self, points: &[u32]) -> Columns {
        fn some<T: Copy>(column: &[T], points: &[u32]) -> Vec<T> {
            if column.is_empty() {
                Vec::new()
            } else {
                points.iter().map(|&i| column[i as usize]).collect()
            }
        }
        fn pick<T: Copy>(column: &Option<Vec<T>>, points: &[u32]) -> Option<Vec<T>> {
            column.as_ref().map(|column| some(column, points))
        }
        Columns {
            x: some(&self.x, points),
            y: some(&self.y, points),
            z: some(&self.z, points),
            rgb: pick(&self.rgb, points),
            intensity: pick(&self.intensity, points),
            class: pick(&self.class, points),
            returns: pick(&self.returns, points),
            source: pick(&self.source, points),
            normal: pick(&self.normal, points),
            gps_time: pick(&self.gps_time, points),
            scalars: self.each_scalar(|numbers| some(numbers, points)),
            ..Columns::default()
        }
    }

    fn each_scalar(&self, of: impl Fn(&[f64]) -> Vec<f64>) -> Vec<ScalarColumn> {
        let each = |own: &ScalarColumn| ScalarColumn { numbers: of(&own.numbers), ..*own };
        self.scalars.iter().map(each).collect()
    }

    /// Drops the points from a number on, and frees their memory.
    pub fn truncate(&mut self, left: usize) {
        fn cut<T>(column: &mut Vec<T>, left: usize) {
            column.truncate(left);
            column.shrink_to_fit();
        }
        fn cut_some<T>(column: &mut Option<Vec<T>>, left: usize) {
            column.iter_mut().for_each(|column| cut(column, left));
        }
        cut(&mut self.x, left);
        cut(&mut self.y, left);
        cut(&mut self.z, left);
        cut_some(&mut self.rgb, left);
        cut_some(&mut self.intensity, left);
        cut_some(&mut self.class, left);
        cut_some(&mut self.returns, left);
        cut_some(&mut self.source, left);
        cut_some(&mut self.normal, left);
        cut_some(&mut self.gps_time, left);
        self.scalars.iter_mut().for_each(|own| cut(&mut own.numbers, left));
        self.extent = strays::Kept::default();
    }

    /// Drops the columns that are not in `wanted`.
    pub fn keep(&mut self, wanted: ColumnSet) {
        self.rgb.take_if(|_| !wanted.rgb);
        self.intensity.take_if(|_| !wanted.intensity);
        self.class.take_if(|_| !wanted.class);
        self.returns.take_if(|_| !wanted.returns);
        self.source.take_if(|_| !wanted.source);
        self.normal.take_if(|_| !wanted.normal);
        self.gps_time.take_if(|_| !wanted.gps_time);
        self.scalars.retain(|own| wanted.scalars.has(own.scalar));
    }
}

/// A set of columns besides the positions. Memory is bounded by what is requested.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct ColumnSet {
    pub rgb: bool,
    pub intensity: bool,
    pub class: bool,
    pub returns: bool,
    pub source: bool,
    pub normal: bool,
    pub gps_time: bool,
    pub scalars: Scalars,
}

impl ColumnSet {
    /// All that have a column of their own.
    pub const ALL: ColumnSet = ColumnSet {
        rgb: true,
        intensity: true,
        class: true,
        returns: true,
        source: true,
        normal: true,
        gps_time: true,
        scalars: Scalars::NONE,
    };

    /// Returns the union of both sets.
    pub fn and(self, other: ColumnSet) -> ColumnSet {
        ColumnSet {
            rgb: self.rgb || other.rgb,
            intensity: self.intensity || other.intensity,
            class: self.class || other.class,
            returns: self.returns || other.returns,
            source: self.source || other.source,
            normal: self.normal || other.normal,
            gps_time: self.gps_time || other.gps_time,
            scalars: self.scalars.and(other.scalars),
        }
    }

    /// Returns the set without the columns of another one.
    fn without(self, other: ColumnSet) -> ColumnSet {
        ColumnSet {
            rgb: self.rgb && !other.rgb,
            intensity: self.intensity && !other.intensity,
            class: self.class && !other.class,
            returns: self.returns && !other.returns,
            source: self.source && !other.source,
            normal: self.normal && !other.normal,
            gps_time: self.gps_time && !other.gps_time,
            scalars: self.scalars,
        }
    }
}

/// Options of reading.
#[derive(Clone, Copy, Debug, Default)]
pub struct ReadOptions {
    pub wanted: ColumnSet,
    /// Refuse a truncated or inconsistent file instead of keeping what is readable.
    pub strict: bool,
    pub text: TextOptions,
    /// Range of colour channels, overriding the file's.
    pub rgb_range: Option<RgbRange>,
    pub strays: Treatment,
    /// Collect the ranges of attributes without a column ([`Header::extras`]).
    pub extras: bool,
    /// Keep the records of LAS files in batches ([`stream::Batch::records`]).
    pub records: bool,
    /// The axis that points up.
    pub up: UpOption,
}

impl ReadOptions {
    /// Returns options that detect text tables and colour ranges.
    pub const fn new(wanted: ColumnSet, strict: bool) -> ReadOptions {
        ReadOptions {
            wanted,
            strict,
            text: TextOptions::NONE,
            rgb_range: None,
            strays: Treatment::Show,
            extras: false,
            records: false,
            up: UpOption::Z,
        }
    }
}

/// The contents of a file's header, for `info` to compare with the points.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Header {
    /// Format and version, such as "LAS 1.2 format 3", "COPC ...", "PLY binary_little_endian",
    /// "E57".
    pub format: String,
    /// Number of points in the header; `None` if the format has no such field.
    pub points: Option<u64>,
    /// Bounds in the header: min and max, world.
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Software, coordinate system, creation date, extra attributes, in the file's own words.
    pub facts: Vec<(String, String)>,
    /// Attributes without a column, if requested ([`ReadOptions::extras`]).
    #[serde(skip)]
    pub extras: Vec<Extra>,
    /// True if the part holds the strays of a file, which are ignored by all statistics.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub strays: bool,
    /// True if faces join the points, so that they lie on surfaces.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub faces: bool,
    /// Names of scalars that can be read, as [`Scalar`] is written.
    #[serde(skip)]
    pub scalars: Vec<String>,
    /// Other columns that can be read.
    #[serde(skip)]
    pub columns: ColumnSet,
    /// Coordinate system, if the file has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub system: Option<Crs>,
    /// Approximate location of the points, until [`crs::settle`] has used it.
    #[serde(skip)]
    pub sample: Option<Sample>,
}

impl Header {
    /// Returns whether coordinates may be angles, and no reader has said where points are.
    fn lacks_sample(&self) -> bool {
        let is_angular = || Crs::of(self).is_some_and(|system| system.degrees.is_some());
        self.sample.is_none() && is_angular()
    }

    /// Returns whether it is of a format of meshes, without a coordinate system.
    pub fn is_mesh(&self) -> bool {
        ["PLY", "OBJ"].iter().any(|name| self.format.starts_with(name)) && Crs::of(self).is_none()
    }
}

/// Returns whether all points are those of meshes.
pub fn have_faces<'h>(headers: impl IntoIterator<Item = &'h Header>) -> bool {
    let mut headers = headers.into_iter().peekable();
    headers.peek().is_some() && headers.all(|header| header.faces)
}

/// An attribute without a column, by the file's name, and the range of its values.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Extra {
    pub name: String,
    /// Smallest value; `None` if no point has one.
    pub min: Option<f64>,
    pub max: Option<f64>,
    /// Points without a value.
    pub missing: u64,
}

impl Extra {
    fn add(&mut self, value: Option<f64>) {
        match value.filter(|value| !value.is_nan()) {
            Some(value) => self.widen(Some(value), Some(value)),
            None => self.missing += 1,
        }
    }

    fn join(&mut self, other: Extra) {
        self.widen(other.min, other.max);
        self.missing += other.missing;
    }

    fn widen(&mut self, min: Option<f64>, max: Option<f64>) {
        let either = |a: Option<f64>, b: Option<f64>, pick: fn(f64, f64) -> f64| {
            a.into_iter().chain(b).reduce(pick)
        };
        self.min = either(self.min, min, f64::min);
        self.max = either(self.max, max, f64::max);
    }
}

/// Maps a stored intensity back to the file's value, given `[lo, hi]` of [`Part::intensity_range`].
/// The file's value was an integer or an `f32`.
pub fn intensity_of(stored: u16, [lo, hi]: [f64; 2]) -> f64 {
    digits::of_f32(lo + (hi - lo) * stored as f64 / 65535.0)
}

/// One file, or one scan of an E57 file.
#[derive(Clone, Debug)]
pub struct Part {
    pub path: PathBuf,
    /// The scan's own name within its file, if any.
    pub name: Option<String>,
    pub header: Header,
    pub lattice: Lattice,
    pub columns: Columns,
    /// Range of stored intensities: `lo + (hi - lo) * v / 65535` for float formats, `[0, 65535]`
    /// for LAS.
    pub intensity_range: [f64; 2],
    /// Range of the file's colour channels; a note reports one that is unusual for the format.
    pub rgb_scale: Scale,
}

/// A scan station: a LAS point source id, an E57 scan, or a whole file without either.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Station {
    pub part: usize,
    /// LAS point source id; `None` if the part is one station.
    pub source: Option<u16>,
    pub name: String,
    pub points: u64,
}

/// All opened files, in the order given.
#[derive(Clone, Debug, Default)]
pub struct Cloud {
    pub parts: Vec<Part>,
    pub stations: Vec<Station>,
    /// Notes for the user, one line each: wrong headers, unreadable parts, decisions about colours.
    pub notes: Vec<String>,
    pub up: Up,
    /// True if filters have left some points out. The rest is what the user wants to see.
    pub chosen: bool,
}

impl Cloud {
    pub fn len(&self) -> u64 {
        self.parts.iter().map(|part| part.columns.len() as u64).sum()
    }

    pub fn is_empty(&self) -> bool {
        self.parts.iter().all(|part| part.columns.is_empty())
    }

    /// Returns the box around the points themselves, never the header's (guide: numerics, case 30);
    /// `None` for an empty cloud.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        self.parts
            .iter()
            .filter_map(Part::bounds)
            .reduce(|(lo, hi), (part_lo, part_hi)| (lo.min(part_lo), hi.max(part_hi)))
    }
}

impl Part {
    /// Returns the scan's own name, or the file's.
    pub fn title(&self) -> String {
        let title = title(self.name.as_deref(), &self.path);
        if self.header.strays { format!("{title}, far outside") } else { title }
    }

    /// Computes where the points are, for a part whose coordinates may be angles, unless its reader
    /// has.
    fn look_around(&mut self) {
        let Columns { x, y, z, .. } = &self.columns;
        let steps = |i: usize| [x[i], y[i], z[i]];
        let sample = self.header.lacks_sample().then(|| {
            let every = x.len().div_ceil(SAMPLE).max(1);
            self.sample((0..x.len()).step_by(every).map(steps))
        });
        self.header.sample = sample.unwrap_or(self.header.sample.take());
    }

    /// Returns the location of points at these steps.
    fn sample(&self, steps: impl Iterator<Item = [i32; 3]>) -> Option<Sample> {
        Sample::of(steps.map(|steps| self.lattice.world(steps.map(i64::from))).collect())
    }

    /// Returns the world box around this part's points, exact up to one rounding of `offset + step
    /// * q`.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        self.columns.extent().map(|extent| self.lattice.world_box([extent.low, extent.high]))
    }
}

/// Most points that locate a part.
const SAMPLE: usize = 4096;

pub(crate) fn title(name: Option<&str>, path: &Path) -> String {
    name.map_or_else(|| input::name_of(path), str::to_owned)
}

/// Returns the smallest and largest value of a column.
pub fn range<T: Copy + Ord + Send + Sync>(column: &[T]) -> Option<(T, T)> {
    let widen = |a: (T, T), b: (T, T)| (a.0.min(b.0), a.1.max(b.1));
    column
        .par_chunks(1 << 16)
        .map(|chunk| chunk.iter().fold((chunk[0], chunk[0]), |range, &v| widen(range, (v, v))))
        .reduce_with(widen)
}

/// Opens `paths` as one cloud, in their order. Errors if any file cannot be read at all.
pub fn read(paths: &[PathBuf], options: &ReadOptions, progress: &dyn Progress) -> Result<Cloud> {
    let (mut cloud, mut plane) = (Cloud::default(), None);
    for path in paths {
        let input = Input::open_slowly(path, progress)?.counting_to(options.rgb_range);
        if !las::octree::is_one(&input)? {
            input.download(progress)?;
        }
        let parts = read_one(&input, options, progress, &mut cloud.notes)?;
        for ReadPart { mut part, .. } in parts {
            let index = cloud.parts.len();
            // Colours that are all black, as an example, are none.
            let missing = options.wanted.without(part.columns.available());
            part.header.columns = part.header.columns.without(missing);
            let title = part.title();
            let bounds = part.bounds();
            cloud.notes.extend(bounds_note(
                path,
                &title,
                &part.header,
                part.lattice,
                bounds,
                options.strict,
            )?);
            far_error(path, part.lattice, bounds)?;
            part.look_around();
            part.lattice =
                crs::settle(&mut part.header, part.lattice, &mut plane, &title, &mut cloud.notes);
            if let Some(lie) = crs::lie(&part.header).filter(|_| options.strict) {
                return Err(Error::format(path, lie));
            }
            if options.strays == Treatment::Hide {
                let own = self::title(part.name.as_deref(), path);
                cloud.notes.extend(
                    part.strays()
                        .note()
                        .map(|said| format!("{own}: {said}; hidden by --strays hide")),
                );
                if !part.hide_strays() {
                    continue;
                }
            }
            cloud.stations.extend(stations(&part, index));
            cloud.parts.push(part);
        }
    }
    cloud.notes.extend(crs::differences(cloud.parts.iter().map(|part| &part.header)));
    let headers = cloud.parts.iter().map(|part| &part.header);
    let (up, note) = options.up.of(headers, || cloud.core_points());
    cloud.up = up;
    cloud.notes.extend(note);
    if options.wanted.scalars.has(Scalar::HeightAboveGround) {
        let note = ground::heights(&mut cloud);
        cloud.notes.extend(note);
    }
    Ok(cloud)
}

/// Reads about this many points from all over the files, as a preview of large ones; `None` if a
/// file's format has to be read entirely to find its points.
pub fn sample(
    paths: &[PathBuf],
    options: &ReadOptions,
    points: u64,
    progress: &dyn Progress,
) -> Result<Option<Cloud>> {
    let (mut cloud, mut plane) = (Cloud::default(), None);
    let share = points / paths.len().max(1) as u64;
    for path in paths {
        let input = Input::open(path)?.counting_to(options.rgb_range);
        if !las::is_one(&input)? {
            return Ok(None);
        }
        let Some(mut part) = las::sample(&input, options.wanted, share, progress)? else {
            return Ok(None);
        };
        part.lattice = crs::settle(
            &mut part.header,
            part.lattice,
            &mut plane,
            &input.name(),
            &mut cloud.notes,
        );
        if options.strays == Treatment::Hide {
            part.hide_strays();
        }
        cloud.stations.extend(stations(&part, cloud.parts.len()));
        cloud.parts.push(part);
    }
    Ok(Some(cloud))
}

/// Reads a file by the format of its first bytes, since names lie; by its name if its format has no
/// signature.
fn read_one(
    input: &Input,
    options: &ReadOptions,
    progress: &dyn Progress,
    notes: &mut Vec<String>,
) -> Result<Vec<ReadPart>> {
    let start = input.take(0, 8)?;
    if start.is_empty() {
        return Err(input.wrong("is empty (0 bytes)"));
    }
    if las::is_one(input)? {
        notes.extend(options.text.idle(input));
        let parts = las::read(input, options, progress, notes)?;
        return Ok(parts.into_iter().map(ReadPart::held).collect());
    }
    if start.starts_with(b"ASTM-E57") {
        notes.extend(options.text.idle(input));
        return e57::read(input, options, progress, notes);
    }
    if start.starts_with(b"ply") && start.get(3).is_none_or(u8::is_ascii_whitespace) {
        notes.extend(options.text.idle(input));
        return ply::read(input, options, progress, notes);
    }
    let path = crate::network::without_query(&input.path);
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    match extension.as_str() {
        "obj" => obj::read(input, options, progress, notes),
        "xyz" | "csv" | "tsv" | "txt" | "asc" | "pts" | "ptx" | "xyzrgb" | "xyzi" | "xyzn" => xyz::read(input, options, progress, notes),
        "las" | "laz" | "ply" | "e57" => {
            Err(input.wrong(format!("does not begin like a {} file; it is damaged or misnamed", extension.to_uppercase())))
        }
        _ => Err(input.wrong("has an unknown format; supported are LAS, LAZ, COPC, Potree 2, EPT, PLY, E57, OBJ, XYZ, CSV, TXT, PTS and PTX")),
    }
}

/// Returns a note if the header's bounds are not `bounds`, those of the points; an error if
/// `strict`.
fn bounds_note(
    path: &Path,
    title: &str,
    header: &Header,
    lattice: Lattice,
    bounds: Option<(DVec3, DVec3)>,
    strict: bool,
) -> Result<Option<String>> {
    match wrong_bounds(header, lattice, bounds) {
        Some(what) if strict => Err(Error::format(path, what)),
        what => Ok(what.map(|what| format!("{title}: {what}"))),
    }
}

/// Returns an error if coordinates are farther away than their lattice can tell.
fn far_error(path: &Path, lattice: Lattice, bounds: Option<(DVec3, DVec3)>) -> Result<()> {
    let far = bounds.and_then(|(lo, hi)| lattice.too_far(lo, hi)).or(lattice.wrong());
    far.map_or(Ok(()), |what| Err(Error::format(path, what)))
}

/// Describes header bounds that are wrong by more than a step and the digits headers are rounded
/// to.
fn wrong_bounds(
    header: &Header,
    lattice: Lattice,
    bounds: Option<(DVec3, DVec3)>,
) -> Option<String> {
    let [stated_lo, stated_hi] = header.bounds?.map(DVec3::from_array);
    let (lo, hi) = bounds?;
    let tolerance = 1.001 * lattice.step + 1e-6 * (hi - lo) + 1e-12 * lo.abs().max(hi.abs());
    let differ = |stated: DVec3, own: DVec3| !(stated - own).abs().cmple(tolerance).all();
    if !differ(stated_lo, lo) && !differ(stated_hi, hi) {
        return None;
    }
    let shown = |v: DVec3| {
        v.to_array()
            .map(|v| if v.abs() < 1e16 { format!("{v:.3}") } else { digits::number(v) })
            .join(" ")
    };
    Some(format!(
        "header declares bounds {} to {}, the points lie in {} to {}",
        shown(stated_lo),
        shown(stated_hi),
        shown(lo),
        shown(hi)
    ))
}

/// Returns one station per point source id that occurs, or one for the whole part. `index` is the
/// number of the part.
pub fn stations(part: &Part, index: usize) -> Vec<Station> {
    let name = part.title();
    let Some(source) = &part.columns.source else {
        return vec![Station {
            part: index,
            source: None,
            name,
            points: part.columns.len() as u64,
        }];
    };
    // Ids are small, mostly.
    let most = source.par_iter().copied().max().unwrap_or(0);
    let count = |ids: &[u16]| {
        let mut counts = vec![0u64; most as usize + 1];
        ids.iter().for_each(|&id| counts[id as usize] += 1);
        counts
    };
    let add = |a: Vec<u64>, b: Vec<u64>| a.into_iter().zip(b).map(|(a, b)| a + b).collect();
    let task = source.len().div_ceil(rayon::current_num_threads()).max(1 << 16);
    let counts = source.par_chunks(task).map(count).reduce_with(add).unwrap_or_default();
    let occurring = (0..=u16::MAX).zip(counts).filter(|&(_, points)| points > 0);
    occurring
        .map(|(id, points)| Station {
            part: index,
            source: Some(id),
            name: format!("{name} source {id}"),
            points,
        })
        .collect()
}
