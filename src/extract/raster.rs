//! Points in the cells of a map: heights, intensities, counts and colours.
//!
//! ```text
//! points that are left -> cells of some rows -> rows of samples, from the north
//! ```
//! As many rows are in memory at a time as fit. Larger maps read the input several times.

use super::Selection;
use super::fields::intensity;
use super::input::{Batch, Input};
use crate::cloud::ColumnSet;
use crate::cloud::attribute::Attribute;
use crate::cloud::scalar::{self, Scalar};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::similar::did_you_mean;
use crate::view::map::MapGrid;
use std::ops::Range;
use strum::{EnumString, IntoStaticStr, VariantArray};

/// Value of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Value {
    /// Height above the zero of the files, 32-bit floating point.
    Height,
    /// Intensity as in the files, 32-bit floating point.
    Intensity,
    /// Number of points, 32-bit unsigned.
    Count,
    /// Red, green, blue, and alpha of 0 where there are no points, 8-bit.
    Rgb,
    /// A scalar, 32-bit floating point.
    Scalar(Scalar),
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Value::Scalar(scalar) => scalar.fmt(f),
            named => f.write_str(&format!("{named:?}").to_lowercase()),
        }
    }
}

impl std::str::FromStr for Value {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Value, String> {
        let mut named = [Value::Height, Value::Intensity, Value::Count, Value::Rgb].into_iter();
        let scalar = || text.parse().ok().map(Value::Scalar);
        named.find(|own| own.to_string() == text).or_else(scalar).ok_or_else(|| {
            let scalars = scalar::NAMED.map(|own| own.to_string());
            let names = ["height", "intensity", "count", "rgb"];
            let meant = did_you_mean(text, names.into_iter().chain(scalars.iter().map(|s| &**s)));
            let scalars = scalars.join(", ");
            format!("{text:?} is not a value{meant}; there are height, intensity, count, rgb, {scalars} and extra:NAME, which `pointillist info` lists")
        })
    }
}

/// Which of a cell's points counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum Pick {
    /// The highest; of equal ones the first in the files
    Highest,
    /// The lowest
    Lowest,
    /// The mean of all
    Mean,
}

/// The value of cells without points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoData(f64);

/// The usual value of cells without points, where all numbers may be values of points.
pub const NO_DATA: NoData = NoData(-9999.0);

impl std::str::FromStr for NoData {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<NoData, String> {
        let number = text.parse().ok().filter(|number: &f64| !number.is_infinite());
        let own = number.map(NoData).filter(|own| own.0.is_nan() || own.float().is_finite());
        own.ok_or_else(|| format!("{text:?} is neither a 32-bit number, such as -9999, nor nan"))
    }
}

impl NoData {
    fn float(self) -> f32 {
        self.0 as f32
    }

    /// Returns it as a count; errors if it cannot be one.
    fn count(self) -> Result<u32> {
        let NoData(number) = self;
        let is_count = number >= 0.0 && number <= u32::MAX.into() && number.fract() == 0.0;
        is_count.then_some(number as u32).ok_or_else(|| {
            Error::Request(format!(
                "--no-data {number}: counts are whole numbers from 0 to {}; give one of these, such as 0",
                u32::MAX
            ))
        })
    }

    /// Returns it as a GeoTIFF has it: the number that cells hold, in full.
    pub fn text(self, value: Value) -> String {
        match value {
            _ if self.0.is_nan() => "nan".into(),
            Value::Count => self.0.to_string(),
            _ => f64::from(self.float()).to_string(),
        }
    }
}

impl Value {
    /// Returns the value of cells without points for the one asked for; errors if it cannot be one.
    pub fn no_data(self, asked: Option<NoData>) -> Result<Option<NoData>> {
        match (self, asked) {
            (Value::Rgb, None) => Ok(None),
            (Value::Rgb, Some(_)) => Err(Error::Request(
                "--no-data: colours have an alpha of 0 where there are no points; leave it out"
                    .into(),
            )),
            (Value::Count, None) => Ok(None),
            (Value::Count, Some(own)) => own.count().map(|_| asked),
            (_, asked) => Ok(asked.or(Some(NO_DATA))),
        }
    }

    /// Returns the attribute to read.
    pub fn wanted(self) -> ColumnSet {
        if let Value::Scalar(scalar) = self {
            return Attribute::Scalar(scalar).wanted();
        }
        ColumnSet {
            intensity: self == Value::Intensity,
            rgb: self == Value::Rgb,
            ..ColumnSet::default()
        }
    }

    fn numbers(self) -> usize {
        match self {
            Value::Height | Value::Intensity | Value::Scalar(_) => 1,
            Value::Count => 0,
            Value::Rgb => 3,
        }
    }
}

/// A raster to make.
#[derive(Clone, Copy, Debug)]
pub struct Request {
    pub grid: MapGrid,
    pub value: Value,
    pub pick: Pick,
    /// Value of cells without points ([`Value::no_data`]); None: 0, or an alpha of 0.
    pub no_data: Option<NoData>,
    /// Most bytes of cells at a time; a row fits always.
    pub memory: u64,
}

/// Outcome of a raster.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Filled {
    /// Cells with points.
    pub cells: u64,
    /// Points in cells.
    pub points: u64,
    /// Cells with points whose value is that of cells without.
    pub ambiguous: u64,
    /// True if some number is not 0: files without colours may have black ones.
    has_value: bool,
}

/// A point in its cell.
struct Hit {
    cell: usize,
    height: f64,
    numbers: [f64; 3],
}

/// The cells of some rows.
struct Cells {
    counts: Vec<u32>,
    /// The extreme height so far.
    heights: Vec<f64>,
    /// Sums, or the numbers of the extreme point; as many a cell as the value has.
    numbers: Vec<f64>,
}

impl Request {
    fn has_extremes(&self) -> bool {
        self.pick != Pick::Mean && self.value != Value::Count
    }

    fn rows_at_once(&self) -> u64 {
        let own = 4 + 8 * (self.has_extremes() as usize + self.value.numbers());
        (self.memory / (own as u64 * self.grid.size[0] as u64)).max(1)
    }

    /// Returns the points of a batch that fall into some rows.
    fn hits(&self, input: &Input, batch: &Batch, rows: &Range<u32>) -> Vec<Hit> {
        let (part, columns) = (&input.parts()[batch.part], batch.columns);
        let hit = |&i: &u32| {
            let i = i as usize;
            let place = part.lattice.world(batch.steps(i));
            let [column, row] = self.grid.cell(place.x, place.y)?;
            if !rows.contains(&row) {
                return None;
            }
            // Points without the attribute are in no cell.
            let numbers = match self.value {
                Value::Height => [place.z, 0.0, 0.0],
                Value::Intensity => {
                    let stored = columns.intensity.as_ref()?[i];
                    [intensity(stored, part.intensity_range), 0.0, 0.0]
                }
                Value::Count => [0.0; 3],
                Value::Scalar(scalar) => {
                    let number = columns.scalar(scalar)?[i];
                    [Some(number).filter(|number| !number.is_nan())?, 0.0, 0.0]
                }
                Value::Rgb => columns.rgb.as_ref()?[i].map(f64::from),
            };
            let cell = (row - rows.start) as usize * self.grid.size[0] as usize + column as usize;
            Some(Hit { cell, height: place.z, numbers })
        };
        batch.left.iter().filter_map(hit).collect()
    }

    fn empty(&self, cells: usize) -> Cells {
        Cells {
            counts: vec![0; cells],
            heights: vec![0.0; if self.has_extremes() { cells } else { 0 }],
            numbers: vec![0.0; cells * self.value.numbers()],
        }
    }

    fn add(&self, cells: &mut Cells, Hit { cell, height, numbers }: &Hit) {
        let is_first = cells.counts[*cell] == 0;
        cells.counts[*cell] = cells.counts[*cell].saturating_add(1);
        let count = self.value.numbers();
        let own = &mut cells.numbers[cell * count..(cell + 1) * count];
        if !self.has_extremes() {
            own.iter_mut().zip(numbers).for_each(|(sum, number)| *sum += number);
            return;
        }
        let extreme = &mut cells.heights[*cell];
        let is_beyond = match self.pick {
            Pick::Lowest => height < extreme,
            _ => height > extreme,
        };
        if is_first || is_beyond {
            *extreme = *height;
            own.copy_from_slice(&numbers[..count]);
        }
    }

    /// Returns the number of cells with points whose value is that of cells without.
    fn ambiguous(&self, cells: &Cells) -> u64 {
        let Some(own) = self.no_data else { return 0 };
        let is_own = |cell: &usize| match self.value {
            Value::Count => own.count().is_ok_and(|own| own == cells.counts[*cell]),
            _ => self.number(cells, *cell, 0) as f32 == own.float(),
        };
        let filled = (0..cells.counts.len()).filter(|&cell| cells.counts[cell] > 0);
        filled.filter(is_own).count() as u64
    }

    /// Returns a number of a cell with points.
    fn number(&self, cells: &Cells, cell: usize, k: usize) -> f64 {
        let points = if self.pick == Pick::Mean { cells.counts[cell] as f64 } else { 1.0 };
        cells.numbers[cell * self.value.numbers() + k] / points
    }

    /// Returns the samples of a row, as bytes of this machine.
    fn row(&self, cells: &Cells, row: usize) -> Vec<u8> {
        let width = self.grid.size[0] as usize;
        let number = |cell: usize, k: usize| self.number(cells, cell, k);
        let all = row * width..(row + 1) * width;
        let is_empty = |cell: usize| cells.counts[cell] == 0;
        match self.value {
            Value::Count => {
                let empty = self.no_data.and_then(|own| own.count().ok()).unwrap_or(0);
                let value = |count: &u32| if *count == 0 { empty } else { *count };
                bytemuck::cast_slice(&cells.counts[all].iter().map(value).collect::<Vec<u32>>())
                    .to_vec()
            }
            Value::Rgb => all
                .flat_map(|cell| match is_empty(cell) {
                    true => [0; 4],
                    false => {
                        let [r, g, b] = [0, 1, 2].map(|k| number(cell, k).round() as u8);
                        [r, g, b, 255]
                    }
                })
                .collect(),
            Value::Height | Value::Intensity | Value::Scalar(_) => {
                let empty = self.no_data.unwrap_or(NO_DATA).float();
                let value = |cell| if is_empty(cell) { empty } else { number(cell, 0) as f32 };
                bytemuck::cast_slice(&all.map(value).collect::<Vec<f32>>()).to_vec()
            }
        }
    }
}

/// Gives all rows of a raster to `put`, from the north. Errors if no point is in it.
pub fn raster(
    input: &Input,
    selection: &Selection,
    request: &Request,
    progress: &dyn Progress,
    put: &mut dyn FnMut(&[u8]) -> Result<()>,
) -> Result<Filled> {
    let [width, height] = request.grid.size;
    let at_once = u32::try_from(request.rows_at_once()).unwrap_or(u32::MAX).min(height);
    let mut filled = Filled::default();
    for start in (0..height).step_by(at_once as usize) {
        let rows = start..height.min(start.saturating_add(at_once));
        let mut cells = request.empty(rows.len() * width as usize);
        let map = |batch: &Batch| Ok(request.hits(input, batch, &rows));
        let mut take = |hits: Vec<Hit>| {
            filled.points += hits.len() as u64;
            filled.has_value |= hits.iter().any(|hit| hit.numbers != [0.0; 3]);
            hits.iter().for_each(|hit| request.add(&mut cells, hit));
            Ok(())
        };
        input.each(selection, progress, &map, &mut take)?;
        filled.cells += cells.counts.iter().filter(|count| **count > 0).count() as u64;
        filled.ambiguous += request.ambiguous(&cells);
        for row in 0..rows.len() {
            put(&request.row(&cells, row))?;
            progress.tick("writing rows", rows.start as u64 + row as u64 + 1, height as u64)?;
        }
    }
    match request.value {
        Value::Intensity | Value::Rgb | Value::Scalar(_) if !filled.has_value => {
            Err(Error::Request(
                "no point in the map has the attribute; `pointillist info` lists those of files"
                    .into(),
            ))
        }
        _ if filled.points == 0 => {
            Err(Error::Request("no point that is left is within --extent".into()))
        }
        _ => Ok(filled),
    }
}
