//! Floating-point points onto a lattice.
//!
//! Input are points of formats that store decimal or binary fractions, gathered block by block in
//! the file's order. One step serves all axes, so that the cloud is less than 2^30 steps wide. It
//! is the finest power of two, 7 binary digits finer than `f32` coordinates over the same width. If
//! that would round coordinates and all are decimals of few digits, it is their last digit. If all
//! steps share trailing zeros (integer coordinates, `f32` far from zero), the step grows by them,
//! which loses nothing and makes the numbers small.

use super::axis::Axis;
use super::crs::Crs;
use super::digits::number;
use super::input::Input;
use super::rgb_conversion;
use super::rgb_range::{By, Scale};
use super::scalar::{Scalar, ScalarColumn};
use super::strays::RobustBounds;
use super::{ColumnSet, Columns, Header, Lattice, Part};
use glam::DVec3;
use rayon::prelude::*;

/// Points as read. Present columns have the length of `x`.
#[derive(Clone, Debug)]
pub struct Floats {
    axes: [Axis; 3],
    /// Colours stored as bytes.
    pub rgb: Option<Vec<[u8; 3]>>,
    /// Colours stored otherwise, in [`ColorUnit`].
    pub color: Option<Vec<[f32; 3]>>,
    pub intensity: Option<Vec<f32>>,
    pub class: Option<Vec<u8>>,
    pub normal: Option<Vec<[i8; 3]>>,
    /// Return numbers, packed as in [`Columns`].
    pub returns: Option<Vec<u8>>,
    pub source: Option<Vec<u16>>,
    pub gps_time: Option<Vec<f64>>,
    pub scalars: Vec<ScalarColumn>,
    /// Columns of the file, whether they are wanted or not.
    there: ColumnSet,
    /// Points skipped because a coordinate is NaN or infinite.
    pub not_finite: u64,
    /// Points with byte colours out of range.
    pub clamped: u64,
}

/// The range of stored colour channels, by the file or its format.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ColorUnit {
    /// 0 to 1.
    Unit,
    /// 16-bit fields.
    Fields,
    /// Exactly 0 to 1, as computed here.
    Harmonics,
    /// Limits of each channel.
    Limits([[f64; 2]; 3]),
    /// Unknown.
    Guess,
}

impl ColorUnit {
    fn limits(self) -> Option<[[f64; 2]; 3]> {
        match self {
            ColorUnit::Unit | ColorUnit::Harmonics => Some([[0.0, 1.0]; 3]),
            ColorUnit::Fields => Some([[0.0, 65535.0]; 3]),
            ColorUnit::Limits(limits) => Some(limits),
            ColorUnit::Guess => None,
        }
    }
}

/// One point to be added to [`Floats`]; fields without a column keep their defaults.
#[derive(Clone, Debug, Default)]
pub struct Point {
    pub position: [f64; 3],
    pub rgb: [u8; 3],
    /// Whether a channel exceeded what `rgb` holds.
    pub clamped: bool,
    pub color: [f32; 3],
    pub intensity: f32,
    pub class: u8,
    pub normal: [f32; 3],
    /// Return number (low four bits) and number of returns (high four bits).
    pub returns: u8,
    pub source: u16,
    pub gps_time: f64,
    /// Scalars, one for each column of them.
    pub scalars: Vec<f64>,
}

/// The role of a file's column or property.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    Position(usize),
    Color(usize),
    Normal(usize),
    Intensity,
    Class,
    /// Return number.
    Return,
    /// Number of returns.
    Returns,
    /// Point source id.
    Source,
    /// GPS time.
    Time,
    /// A requested scalar, and which of these it is.
    Scalar(Scalar, usize),
    Other,
}

impl Role {
    /// Tests whether the column of this role can hold a value.
    pub fn holds(self, value: f64) -> bool {
        let whole = |most: f64| value.fract() == 0.0 && (0.0..=most).contains(&value);
        match self {
            Role::Class => whole(u8::MAX.into()),
            Role::Return | Role::Returns => whole(15.0),
            Role::Source => whole(u16::MAX.into()),
            _ => true,
        }
    }
}

/// Returns the columns that these roles fill; triples only if complete.
pub fn there(roles: &[Role]) -> ColumnSet {
    let whole = |role: fn(usize) -> Role| (0..3).all(|i| roles.contains(&role(i)));
    ColumnSet {
        rgb: whole(Role::Color),
        normal: whole(Role::Normal),
        intensity: roles.contains(&Role::Intensity),
        class: roles.contains(&Role::Class),
        returns: roles.contains(&Role::Return),
        source: roles.contains(&Role::Source),
        gps_time: roles.contains(&Role::Time),
        scalars: scalars(roles).collect(),
    }
}

/// Returns the scalars among roles, in their order.
pub fn scalars(roles: &[Role]) -> impl Iterator<Item = Scalar> {
    roles.iter().filter_map(|role| match role {
        Role::Scalar(scalar, _) => Some(*scalar),
        _ => None,
    })
}

impl Point {
    pub fn set(&mut self, role: Role, value: f64) {
        match role {
            Role::Position(axis) => self.position[axis] = value,
            Role::Color(channel) => {
                self.color[channel] = value as f32;
                self.rgb[channel] = value as u8;
                self.clamped |= !(0.0..=255.0).contains(&value);
            }
            Role::Normal(axis) => self.normal[axis] = value as f32,
            Role::Intensity => self.intensity = value as f32,
            Role::Class => self.class = value as u8,
            Role::Return => self.returns = self.returns & 0xF0 | value as u8 & 15,
            Role::Returns => self.returns = self.returns & 15 | (value as u8 & 15) << 4,
            Role::Source => self.source = value as u16,
            Role::Time => self.gps_time = value,
            Role::Scalar(_, which) => self.scalars[which] = value,
            Role::Other => {}
        }
    }
}

impl Floats {
    /// Returns empty points with the columns of these roles that are in `wanted`. `narrow`: positions
    /// are `f32`; `bytes`: colours are bytes.
    pub fn with_roles(roles: &[Role], wanted: ColumnSet, narrow: bool, bytes: bool) -> Self {
        let column = |scalar| ScalarColumn { scalar, numbers: Vec::new() };
        let scalars = scalars(roles).map(column).collect();
        Self { scalars, ..Self::new(there(roles), wanted, narrow, bytes) }
    }

    /// Returns empty points with columns that are both in `wanted` and `there`, without scalars.
    pub fn new(there: ColumnSet, wanted: ColumnSet, narrow: bool, bytes: bool) -> Self {
        let rgb = there.rgb && wanted.rgb;
        Self {
            axes: std::array::from_fn(|_| Axis::new(narrow)),
            rgb: (rgb && bytes).then(Vec::new),
            color: (rgb && !bytes).then(Vec::new),
            intensity: (there.intensity && wanted.intensity).then(Vec::new),
            class: (there.class && wanted.class).then(Vec::new),
            normal: (there.normal && wanted.normal).then(Vec::new),
            returns: (there.returns && wanted.returns).then(Vec::new),
            source: (there.source && wanted.source).then(Vec::new),
            gps_time: (there.gps_time && wanted.gps_time).then(Vec::new),
            scalars: Vec::new(),
            there,
            not_finite: 0,
            clamped: 0,
        }
    }

    /// Returns a point whose scalars are missing.
    pub fn point(&self) -> Point {
        Point { scalars: vec![f64::NAN; self.scalars.len()], ..Point::default() }
    }

    pub fn len(&self) -> usize {
        self.axes[0].len()
    }

    /// Reserves exact room if available: growing by doubling would hold two copies at the peak.
    pub fn reserve(&mut self, count: usize) {
        fn hint<T>(column: &mut Option<Vec<T>>, count: usize) {
            if let Some(column) = column {
                let _ = column.try_reserve_exact(count);
            }
        }
        self.axes.iter_mut().for_each(|axis| axis.reserve(count));
        hint(&mut self.rgb, count);
        hint(&mut self.color, count);
        hint(&mut self.intensity, count);
        hint(&mut self.class, count);
        hint(&mut self.normal, count);
        hint(&mut self.returns, count);
        hint(&mut self.source, count);
        hint(&mut self.gps_time, count);
        for own in &mut self.scalars {
            let _ = own.numbers.try_reserve_exact(count);
        }
    }

    pub fn push(&mut self, point: &Point) {
        if !point.position.iter().all(|v| v.is_finite()) {
            self.not_finite += 1;
            return;
        }
        self.axes.iter_mut().zip(point.position).for_each(|(axis, v)| axis.push(v));
        if let Some(column) = &mut self.rgb {
            column.push(point.rgb);
            self.clamped += point.clamped as u64;
        }
        self.color.iter_mut().for_each(|column| column.push(point.color));
        self.intensity.iter_mut().for_each(|column| column.push(point.intensity));
        self.class.iter_mut().for_each(|column| column.push(point.class));
        self.normal.iter_mut().for_each(|column| column.push(unit_normal(point.normal)));
        self.returns.iter_mut().for_each(|column| column.push(point.returns));
        self.source.iter_mut().for_each(|column| column.push(point.source));
        self.gps_time.iter_mut().for_each(|column| column.push(point.gps_time));
        let scalars = self.scalars.iter_mut().zip(&point.scalars);
        scalars.for_each(|(own, number)| own.numbers.push(*number));
    }

    /// Appends a block with the same columns.
    pub fn append(&mut self, block: Floats) {
        fn join<T>(column: &mut Option<Vec<T>>, block: Option<Vec<T>>) {
            if let (Some(column), Some(mut block)) = (column, block) {
                column.append(&mut block);
            }
        }
        self.axes.iter_mut().zip(block.axes).for_each(|(axis, block)| axis.append(block));
        join(&mut self.rgb, block.rgb);
        join(&mut self.color, block.color);
        join(&mut self.intensity, block.intensity);
        join(&mut self.class, block.class);
        join(&mut self.normal, block.normal);
        join(&mut self.returns, block.returns);
        join(&mut self.source, block.source);
        join(&mut self.gps_time, block.gps_time);
        let scalars = self.scalars.iter_mut().zip(block.scalars);
        scalars.for_each(|(own, mut block)| own.numbers.append(&mut block.numbers));
        self.not_finite += block.not_finite;
        self.clamped += block.clamped;
    }

    /// Returns the part, and one for its strays if any. Notes report skipped and changed points.
    /// `limits` is the file's intensity range.
    pub fn into_parts(
        self,
        input: &Input,
        header: Header,
        unit: ColorUnit,
        limits: Option<[f64; 2]>,
        notes: &mut Vec<String>,
    ) -> Vec<Part> {
        let name = input.name();
        if self.not_finite > 0 {
            notes.push(format!(
                "{name}: {} points with NaN or infinite coordinates were skipped",
                self.not_finite
            ));
        }
        let header = Header { columns: self.there, ..header };
        let is_angular = Crs::of(&header).is_some_and(|system| system.degrees.is_some());
        let mut columns = Columns {
            class: self.class,
            returns: self.returns,
            source: self.source,
            gps_time: self.gps_time,
            scalars: self.scalars,
            // Zeros and NaN alone are not normals.
            normal: self.normal.filter(|normal| normal.iter().any(|normal| *normal != [0; 3])),
            ..Columns::default()
        };
        let mut rgb_scale = Scale::default();
        let mut clamped = self.clamped;
        columns.rgb = self.rgb;
        if let Some(color) = self.color {
            let asked = input.rgb_range.filter(|_| unit != ColorUnit::Harmonics);
            let converted = rgb_conversion::convert(&color, unit.limits(), asked);
            clamped += converted.clamped;
            rgb_scale = converted.scale;
            notes.extend(converted.note.map(|note| format!("{name}: {note}")));
            columns.rgb = Some(converted.rgb);
        } else if let (Some(rgb), Some(asked)) = (&mut columns.rgb, input.rgb_range) {
            rgb_scale = Scale::new(asked, By::Request);
            rgb.iter_mut().for_each(|color| *color = color.map(|v| asked.to_8_bits(v.into())));
        }
        if clamped > 0 {
            notes.push(format!("{name}: clamped NaN or out-of-range colours of {clamped} points"));
        }
        columns.rgb = columns.rgb.filter(|rgb| rgb.iter().any(|color| *color != [0; 3]));
        let mut intensity_range = [0.0, 65535.0];
        if let Some(intensity) = self.intensity {
            let undefined = intensity.iter().filter(|v| !v.is_finite()).count();
            if undefined > 0 {
                notes.push(format!("{name}: {undefined} intensities are missing, NaN or infinite; they were set to the smallest"));
            }
            let (column, range) = intensities(&intensity, limits);
            (columns.intensity, intensity_range) = (Some(column), range);
        }
        let part = |axes: [Axis; 3], columns: Columns, strays: bool| {
            let (lattice, columns, rounded) = on_a_lattice(axes, columns, is_angular, strays);
            let header = Header { strays, ..header.clone() };
            (
                Part {
                    path: input.path.clone(),
                    name: None,
                    header,
                    lattice,
                    columns,
                    intensity_range,
                    rgb_scale,
                },
                rounded,
            )
        };
        let place = |i: usize| DVec3::from_array(self.axes.each_ref().map(|axis| axis.at(i)));
        let parts = match RobustBounds::of(self.axes[0].len(), place) {
            None => vec![part(self.axes, columns, false)],
            Some(core) => {
                let (inside, strays): (Vec<u32>, Vec<u32>) =
                    (0..self.axes[0].len() as u32).partition(|&i| core.has(place(i as usize)));
                let some = |points: &[u32]| {
                    (self.axes.each_ref().map(|axis| axis.pick(points)), columns.pick(points))
                };
                let [(inside, inside_columns), (strays, strays_columns)] =
                    [some(&inside), some(&strays)];
                vec![part(inside, inside_columns, false), part(strays, strays_columns, true)]
            }
        };
        let (_, rounded) = parts[0];
        if let Some(step) = rounded.filter(|step| *step > LARGEST_QUIET_STEP) {
            notes.push(format!(
                "{name}: the extent is so large that coordinates are rounded to steps of {}",
                number(step)
            ));
        }
        parts.into_iter().map(|(part, _)| part).collect()
    }
}

/// Puts positions on a lattice as fine as their extent allows. Returns it with the step along z if
/// that rounds positions. The lattice of strays is as fine as their distance allows.
fn on_a_lattice(
    axes: [Axis; 3],
    mut columns: Columns,
    is_angular: bool,
    strays: bool,
) -> (Lattice, Columns, Option<f64>) {
    let Extent { offset, step, rounds } = extent(&axes, is_angular, strays);
    let [x, y, z] = axes;
    columns.x = x.quantise(offset[0], step[0]);
    columns.y = y.quantise(offset[1], step[1]);
    columns.z = z.quantise(offset[2], step[2]);
    let lattice = Lattice {
        step: DVec3::from_array(step) * coarsen(&mut columns) as f64,
        offset: DVec3::from_array(offset),
    };
    (lattice, columns, rounds[2].then_some(step[2]))
}

/// Largest step without a note, about a millimetre: above, positions lose visible detail.
const LARGEST_QUIET_STEP: f64 = 1.0 / 1024.0;

/// Exponents of steps that stay normal as `f32` after later products.
const STEP_EXPONENTS: std::ops::RangeInclusive<i32> = -100..=1000;

struct Extent {
    offset: [f64; 3],
    step: [f64; 3],
    /// Axes with positions between steps.
    rounds: [bool; 3],
}

/// Returns the extent that decides the step. Angles are finer than the heights beside them. Strays
/// count from the origin.
fn extent(axes: &[Axis; 3], is_angular: bool, strays: bool) -> Extent {
    let mut ranges = axes.each_ref().map(Axis::range);
    if strays {
        ranges = ranges.map(|(lo, hi)| (lo.min(0.0), hi.max(0.0)));
    }
    let is_place = ranges.iter().all(|(lo, hi)| lo == hi);
    let first = if is_angular { 2 } else { 3 };
    let mut extent =
        Extent { offset: ranges.map(|(lo, _)| lo), step: [1.0; 3], rounds: [false; 3] };
    for group in [0..first, first..3].into_iter().filter(|group| !group.is_empty()) {
        let half = half_width(&ranges[group.clone()]);
        let (own, binary) = (&axes[group.clone()], binary_step(half));
        let is_exact = own.iter().all(|axis| axis.is_on(binary));
        let far = ranges[group.clone()]
            .iter()
            .fold(0.0, |far: f64, (lo, hi)| far.max(lo.abs()).max(hi.abs()));
        let decimal = if is_exact { None } else { decimal_step(own, half, far) };
        let step = decimal.unwrap_or(binary);
        for axis in group {
            extent.step[axis] = step;
            extent.rounds[axis] = decimal.is_none() && !is_exact;
            let steps = (ranges[axis].0 / step).floor() * step;
            let is_level = ranges[axis].0 == ranges[axis].1 && is_angular && axis == 2;
            if decimal.is_none() && steps.is_finite() && !is_place && !is_level {
                extent.offset[axis] = steps;
            }
        }
    }
    extent
}

/// Returns half of the widest range: the whole width of the largest finite one is infinite.
fn half_width(ranges: &[(f64, f64)]) -> f64 {
    ranges.iter().fold(0.0, |widest: f64, (lo, hi)| widest.max(hi / 2.0 - lo / 2.0))
}

/// Returns the last decimal digit of coordinates, if the width is less than 2^30 of it, and the
/// farthest from 0 less than 2^53; `None` for `f32`.
fn decimal_step(axes: &[Axis], half: f64, far: f64) -> Option<f64> {
    const MOST: i32 = 15;
    let fits = |digits: &i32| {
        let steps = 10f64.powi(*digits);
        half * steps < (1u64 << 29) as f64 && far * steps < (1u64 << 53) as f64
    };
    let most = (0..=MOST).take_while(fits).last()?;
    let digits = axes.iter().try_fold(0, |digits, axis| axis.decimals(digits, most))?;
    Some(1.0 / 10f64.powi(digits))
}

fn binary_step(half: f64) -> f64 {
    if half == 0.0 {
        return 1.0 / 1024.0;
    }
    let exponent =
        (floor_log2(half) + 2 - 30).clamp(*STEP_EXPONENTS.start(), *STEP_EXPONENTS.end());
    2f64.powi(exponent)
}

/// Returns the exponent of a positive number; subnormal ones count as the smallest normal.
fn floor_log2(v: f64) -> i32 {
    (v.to_bits() >> 52 & 0x7ff) as i32 - 1023
}

/// Divides all steps by their common power of two, and returns its exponent.
fn coarsen(columns: &mut Columns) -> u32 {
    let occurred =
        [&columns.x, &columns.y, &columns.z].into_iter().flatten().fold(0, |bits, q| bits | q);
    let shared = if occurred == 0 { 0 } else { occurred.trailing_zeros() };
    if shared > 0 {
        for axis in [&mut columns.x, &mut columns.y, &mut columns.z] {
            axis.par_iter_mut().with_min_len(1 << 16).for_each(|q| *q >>= shared);
        }
    }
    1 << shared
}

/// Maps intensities to 0..=65535. Integers that fit are kept, counted from the least below 0;
/// others are spread over the stated limits or their own range.
fn intensities(stored: &[f32], limits: Option<[f64; 2]>) -> (Vec<u16>, [f64; 2]) {
    let finite = || stored.iter().copied().filter(|v| v.is_finite());
    let (lo, hi) =
        finite().fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
    if lo > hi {
        return (vec![0; stored.len()], [0.0, 0.0]);
    }
    let least = lo.min(0.0);
    if hi - least <= 65535.0 && hi - least > 1.0 && finite().all(|v| v.fract() == 0.0) {
        let from_least = |v: f32| (if v.is_finite() { v } else { lo } - least) as u16;
        return (
            stored.iter().map(|&v| from_least(v)).collect(),
            [least.into(), least as f64 + 65535.0],
        );
    }
    let own = [lo as f64, hi as f64];
    let [lo, hi] = limits
        .filter(|[a, b]| a.is_finite() && b.is_finite() && *a <= own[0] && own[1] <= *b)
        .unwrap_or(own);
    let scale = if hi > lo { 65535.0 / (hi - lo) } else { 0.0 };
    let spread = |v: f32| if v.is_finite() { ((v as f64 - lo) * scale).round() as u16 } else { 0 };
    (stored.iter().map(|&v| spread(v)).collect(), [lo, hi])
}

/// Returns a unit normal with 127 = 1.0; zero if the length is 0 or not finite.
fn unit_normal(normal: [f32; 3]) -> [i8; 3] {
    let length = normal.iter().map(|&v| v as f64 * v as f64).sum::<f64>().sqrt();
    if !(length.is_finite() && length > 0.0) {
        return [0; 3];
    }
    normal.map(|v| (v as f64 / length * 127.0).round() as i8)
}
