//! Raw LAS records to columns.
//!
//! Whole columns are allocated at full length and cut into disjoint windows, so that threads fill
//! them without locks, in the file's order. If the length is unknown, or only a batch is held, the
//! lane is a pile, which grows. A block is walked once per column while it is in the cache, which
//! is faster than a point at a time.

use super::header::Layout;
use super::number::{self, Number};
use crate::cloud::rgb_range::{Occurred, RgbRange, to_8_bits};
use crate::cloud::scalar::{Scalar, ScalarColumn, Scalars};
use crate::cloud::strays::{Corners, Kept};
use crate::cloud::{ColumnSet, Columns};
use crate::error::Result;

/// Most records of a block, to fit the second-level cache.
pub const BLOCK: usize = 8192;

/// Offsets of the fields of a record.
#[derive(Clone)]
pub struct Fields {
    pub record_bytes: usize,
    /// [`Layout::flips`].
    flips: [i32; 3],
    /// True if the format is 6 to 10, which pack returns and class differently.
    modern: bool,
    class: usize,
    source: usize,
    gps_time: Option<usize>,
    rgb: Option<usize>,
    /// Where the requested scalars are.
    scalars: Vec<(Scalar, Number)>,
    /// Colour range.
    pub range: RgbRange,
    /// [`Layout::holds`].
    holds: ColumnSet,
}

const INTENSITY: usize = 12;
const RETURNS: usize = 14;

impl Fields {
    pub fn new(layout: &Layout, wanted: Scalars) -> Self {
        let modern = layout.format >= 6;
        let gps_time = match layout.format {
            0 | 2 => None,
            1..=5 => Some(20),
            _ => Some(22),
        };
        let rgb = match layout.format {
            2 => Some(20),
            3 | 5 => Some(28),
            7 | 8 | 10 => Some(30),
            _ => None,
        };
        let (class, source) = if modern { (16, 20) } else { (15, 18) };
        Self {
            record_bytes: layout.record_bytes,
            flips: layout.flips,
            modern,
            class,
            source,
            gps_time,
            rgb,
            scalars: number::wanted(layout, wanted),
            range: RgbRange::Words,
            holds: layout.holds,
        }
    }

    /// Returns the columns that are both requested and present.
    pub fn available(&self, wanted: ColumnSet) -> ColumnSet {
        ColumnSet {
            rgb: wanted.rgb && self.holds.rgb && self.rgb.is_some(),
            intensity: wanted.intensity && self.holds.intensity,
            class: wanted.class && self.holds.class,
            returns: wanted.returns && self.holds.returns,
            source: wanted.source && self.holds.source,
            gps_time: wanted.gps_time && self.holds.gps_time && self.gps_time.is_some(),
            normal: false,
            scalars: self.scalars.iter().map(|(scalar, _)| *scalar).collect(),
        }
    }
}

/// The destination of a task's points: the task requests room, fills it, settles, and repeats.
pub trait Lane {
    /// Makes room for up to `points` more points. Returns for how many.
    fn room(&mut self, points: usize) -> usize;

    /// Takes records for which there is room. Runs inside `catch_panic`, so it must
    /// not call foreign code; `settle` may.
    fn put(&mut self, records: &[u8], fields: &Fields);

    /// Ends the current room, full or not.
    fn settle(&mut self) -> Result<()>;
}

/// A range of the columns that one task fills; it leaves [`Columns::len`] unchanged.
pub struct Window<'a> {
    /// Index of the window's first point in the columns.
    start: usize,
    done: usize,
    x: &'a mut [i32],
    y: &'a mut [i32],
    z: &'a mut [i32],
    rgb: Option<&'a mut [[u8; 3]]>,
    intensity: Option<&'a mut [u16]>,
    class: Option<&'a mut [u8]>,
    returns: Option<&'a mut [u8]>,
    source: Option<&'a mut [u16]>,
    gps_time: Option<&'a mut [f64]>,
    /// In the order of [`Fields`].
    scalars: Vec<&'a mut [f64]>,
    occurred: Occurred,
    /// Corners of the box around this window's points, found while they are in the cache.
    pub corners: Option<Corners>,
}

/// Statistics of a filled lane.
#[derive(Clone, Copy)]
pub struct Filled {
    pub start: usize,
    pub points: usize,
    pub occurred: Occurred,
}

impl<'a> Window<'a> {
    pub fn over(columns: &'a mut Columns) -> Self {
        Self {
            start: 0,
            done: 0,
            corners: None,
            x: &mut columns.x,
            y: &mut columns.y,
            z: &mut columns.z,
            rgb: columns.rgb.as_deref_mut(),
            intensity: columns.intensity.as_deref_mut(),
            class: columns.class.as_deref_mut(),
            returns: columns.returns.as_deref_mut(),
            source: columns.source.as_deref_mut(),
            gps_time: columns.gps_time.as_deref_mut(),
            scalars: columns.scalars.iter_mut().map(|own| &mut own.numbers[..]).collect(),
            occurred: Occurred::default(),
        }
    }

    /// Splits after the first `count` points.
    fn split(self, count: usize) -> (Self, Self) {
        fn cut<T>(column: Option<&mut [T]>, at: usize) -> (Option<&mut [T]>, Option<&mut [T]>) {
            column.map(|column| column.split_at_mut(at)).unzip()
        }
        let (x, y, z) =
            (self.x.split_at_mut(count), self.y.split_at_mut(count), self.z.split_at_mut(count));
        let (rgb, intensity, class) =
            (cut(self.rgb, count), cut(self.intensity, count), cut(self.class, count));
        let (returns, source, gps_time) =
            (cut(self.returns, count), cut(self.source, count), cut(self.gps_time, count));
        let scalars = self.scalars.into_iter().map(|numbers| numbers.split_at_mut(count));
        let scalars: (Vec<_>, Vec<_>) = scalars.unzip();
        let first = Self {
            start: self.start,
            done: 0,
            corners: None,
            x: x.0,
            y: y.0,
            z: z.0,
            rgb: rgb.0,
            intensity: intensity.0,
            class: class.0,
            returns: returns.0,
            source: source.0,
            gps_time: gps_time.0,
            scalars: scalars.0,
            occurred: self.occurred,
        };
        let rest = Self {
            start: self.start + count,
            done: 0,
            corners: None,
            x: x.1,
            y: y.1,
            z: z.1,
            rgb: rgb.1,
            intensity: intensity.1,
            class: class.1,
            returns: returns.1,
            source: source.1,
            gps_time: gps_time.1,
            scalars: scalars.1,
            occurred: self.occurred,
        };
        (first, rest)
    }

    /// Cuts into windows of these sizes, whose sum is at most the length.
    pub fn split_into(self, sizes: impl Iterator<Item = usize>) -> Vec<Self> {
        let mut rest = self;
        let mut windows = Vec::with_capacity(sizes.size_hint().0);
        for size in sizes {
            let (window, after) = rest.split(size);
            windows.push(window);
            rest = after;
        }
        windows
    }

    /// Fills with `records`, which are at most as many points as are missing.
    fn fill(&mut self, records: &[u8], fields: &Fields) {
        let at = self.done;
        let rows = records.chunks_exact(fields.record_bytes);
        let [x, y, z] = fields.flips;
        put(&mut self.x[at..], rows.clone(), |row| i32::from_le_bytes(part(row, 0)) ^ x);
        put(&mut self.y[at..], rows.clone(), |row| i32::from_le_bytes(part(row, 4)) ^ y);
        put(&mut self.z[at..], rows.clone(), |row| i32::from_le_bytes(part(row, 8)) ^ z);
        if let Some(column) = &mut self.intensity {
            put(&mut column[at..], rows.clone(), |row| u16::from_le_bytes(part(row, INTENSITY)));
        }
        if let Some(column) = &mut self.class {
            let mask = if fields.modern { 255 } else { 31 };
            put(&mut column[at..], rows.clone(), |row| row[fields.class] & mask);
        }
        if let Some(column) = &mut self.returns {
            if fields.modern {
                put(&mut column[at..], rows.clone(), |row| row[RETURNS]);
            } else {
                put(&mut column[at..], rows.clone(), |row| {
                    row[RETURNS] & 7 | (row[RETURNS] >> 3 & 7) << 4
                });
            }
        }
        if let Some(column) = &mut self.source {
            put(&mut column[at..], rows.clone(), |row| {
                u16::from_le_bytes(part(row, fields.source))
            });
        }
        if let (Some(column), Some(offset)) = (&mut self.gps_time, fields.gps_time) {
            put(&mut column[at..], rows.clone(), |row| f64::from_le_bytes(part(row, offset)));
        }
        for (column, (_, number)) in self.scalars.iter_mut().zip(&fields.scalars) {
            put(&mut column[at..], rows.clone(), |row| number.value(row));
        }
        if let (Some(column), Some(offset)) = (&mut self.rgb, fields.rgb) {
            let column = &mut column[at..];
            self.occurred = self.occurred.join(match fields.range {
                // Written out, so that each is a loop without a branch.
                RgbRange::Words => put_colors(column, rows, offset, to_8_bits),
                range => put_colors(column, rows, offset, |v| range.to_8_bits(v)),
            });
        }
        self.done += records.len() / fields.record_bytes;
    }

    pub fn filled(&self) -> Filled {
        Filled { start: self.start, points: self.done, occurred: self.occurred }
    }
}

impl Lane for &mut Window<'_> {
    fn room(&mut self, points: usize) -> usize {
        points.min(self.x.len() - self.done)
    }

    fn put(&mut self, records: &[u8], fields: &Fields) {
        let before = self.done;
        self.fill(records, fields);
        let places = [&*self.x, &*self.y, &*self.z].map(|column| &column[before..self.done]);
        let corners = Corners::of(places);
        self.corners = Some(self.corners.map_or(corners, |seen| seen.and(corners)));
    }

    fn settle(&mut self) -> Result<()> {
        Ok(())
    }
}

/// A lane that samples positions and colours.
#[derive(Default)]
pub struct Census {
    pub occurred: Occurred,
    pub places: Vec<[i32; 3]>,
}

impl Lane for &mut Census {
    fn room(&mut self, points: usize) -> usize {
        points
    }

    fn put(&mut self, records: &[u8], fields: &Fields) {
        let place = |row: &[u8]| {
            std::array::from_fn(|axis| i32::from_le_bytes(part(row, 4 * axis)) ^ fields.flips[axis])
        };
        self.places.extend(records.chunks_exact(fields.record_bytes).map(place));
        if let Some(offset) = fields.rgb {
            records
                .chunks_exact(fields.record_bytes)
                .for_each(|row| self.occurred.look(color(row, offset)));
        }
    }

    fn settle(&mut self) -> Result<()> {
        Ok(())
    }
}

/// Columns that grow as they are filled from their first point.
pub struct Pile {
    pub columns: Columns,
    done: usize,
    occurred: Occurred,
}

impl Pile {
    /// Returns a pile that overwrites these columns.
    pub fn new(columns: Columns) -> Self {
        Self { columns, done: 0, occurred: Occurred::default() }
    }

    /// Makes room for exactly `points` more.
    pub fn grow(&mut self, points: usize) {
        resize(&mut self.columns, self.done + points);
    }

    pub fn fill(&mut self, records: &[u8], fields: &Fields) {
        let mut window =
            Window { done: self.done, occurred: self.occurred, ..Window::over(&mut self.columns) };
        window.fill(records, fields);
        (self.done, self.occurred) = (window.done, window.occurred);
    }

    /// Removes unused room.
    pub fn cut(&mut self) -> Filled {
        resize(&mut self.columns, self.done);
        Filled { start: 0, points: self.done, occurred: self.occurred }
    }
}

impl Lane for Pile {
    fn room(&mut self, points: usize) -> usize {
        let points = points.min(BLOCK);
        self.grow(points);
        points
    }

    fn put(&mut self, records: &[u8], fields: &Fields) {
        self.fill(records, fields);
    }

    fn settle(&mut self) -> Result<()> {
        Ok(())
    }
}

fn put<'r, T>(
    column: &mut [T],
    rows: impl Iterator<Item = &'r [u8]>,
    value: impl Fn(&'r [u8]) -> T,
) {
    column.iter_mut().zip(rows).for_each(|(slot, row)| *slot = value(row));
}

/// Converts the colours at an offset of the rows. Returns what occurred.
fn put_colors<'r>(
    column: &mut [[u8; 3]],
    rows: impl Iterator<Item = &'r [u8]>,
    offset: usize,
    to_8_bits: impl Fn(u16) -> u8,
) -> Occurred {
    let mut occurred = Occurred::default();
    for (slot, row) in column.iter_mut().zip(rows) {
        let [r, g, b] = color(row, offset);
        occurred.look([r, g, b]);
        *slot = [to_8_bits(r), to_8_bits(g), to_8_bits(b)];
    }
    occurred
}

#[inline]
fn color(row: &[u8], at: usize) -> [u16; 3] {
    // Written out, since a closure is not inlined here.
    let channels: [u8; 6] = part(row, at);
    let channel = |low, high| u16::from_le_bytes([channels[low], channels[high]]);
    [channel(0, 1), channel(2, 3), channel(4, 5)]
}

fn part<const N: usize>(row: &[u8], at: usize) -> [u8; N] {
    super::header::array_at(row, at)
}

/// Returns [`zeros`], or `None` if there is not enough memory.
pub fn columns(count: usize, available: ColumnSet) -> Option<Columns> {
    // A failed allocation ends the program, so the sum is first allocated and freed fallibly.
    let bytes = 12
        + 3 * available.rgb as usize
        + 2 * available.intensity as usize
        + available.class as usize;
    let bytes = bytes
        + available.returns as usize
        + 2 * available.source as usize
        + 8 * available.gps_time as usize
        + 8 * available.scalars.iter().count();
    Vec::<u8>::new().try_reserve_exact(count.checked_mul(bytes)?).ok()?;
    Some(zeros(count, available))
}

/// Returns columns of `count` zeros, which take no memory until they are written.
pub fn zeros(count: usize, available: ColumnSet) -> Columns {
    fn column<T: Clone + Default>(there: bool, count: usize) -> Option<Vec<T>> {
        there.then(|| vec![T::default(); count])
    }
    Columns {
        x: vec![0; count],
        y: vec![0; count],
        z: vec![0; count],
        rgb: column(available.rgb, count),
        intensity: column(available.intensity, count),
        class: column(available.class, count),
        returns: column(available.returns, count),
        source: column(available.source, count),
        normal: None,
        gps_time: column(available.gps_time, count),
        scalars: available
            .scalars
            .iter()
            .map(|scalar| ScalarColumn { scalar, numbers: vec![0.0; count] })
            .collect(),
        extent: Kept::default(),
    }
}

fn resize(columns: &mut Columns, count: usize) {
    columns.x.resize(count, 0);
    columns.y.resize(count, 0);
    columns.z.resize(count, 0);
    columns.rgb.iter_mut().for_each(|column| column.resize(count, [0; 3]));
    columns.intensity.iter_mut().for_each(|column| column.resize(count, 0));
    columns.class.iter_mut().for_each(|column| column.resize(count, 0));
    columns.returns.iter_mut().for_each(|column| column.resize(count, 0));
    columns.source.iter_mut().for_each(|column| column.resize(count, 0));
    columns.gps_time.iter_mut().for_each(|column| column.resize(count, 0.0));
    columns.scalars.iter_mut().for_each(|own| own.numbers.resize(count, 0.0));
}

/// Drops all-black colours and closes gaps that lanes left: a missing point is absent, never a
/// zero.
pub fn finish(columns: &mut Columns, lanes: &[Filled]) -> Occurred {
    let occurred =
        lanes.iter().fold(Occurred::default(), |occurred, lane| occurred.join(lane.occurred));
    if occurred.is_black() {
        columns.rgb = None;
    }
    close_gaps(&mut columns.x, lanes);
    close_gaps(&mut columns.y, lanes);
    close_gaps(&mut columns.z, lanes);
    columns.rgb.iter_mut().for_each(|column| close_gaps(column, lanes));
    columns.intensity.iter_mut().for_each(|column| close_gaps(column, lanes));
    columns.class.iter_mut().for_each(|column| close_gaps(column, lanes));
    columns.returns.iter_mut().for_each(|column| close_gaps(column, lanes));
    columns.source.iter_mut().for_each(|column| close_gaps(column, lanes));
    columns.gps_time.iter_mut().for_each(|column| close_gaps(column, lanes));
    columns.scalars.iter_mut().for_each(|own| close_gaps(&mut own.numbers, lanes));
    occurred
}

fn close_gaps<T: Copy>(column: &mut Vec<T>, lanes: &[Filled]) {
    let mut end = 0;
    for lane in lanes {
        if lane.start != end {
            column.copy_within(lane.start..lane.start + lane.points, end);
        }
        end += lane.points;
    }
    if end < column.len() {
        column.truncate(end);
        column.shrink_to_fit();
    }
}
