//! Points of formats that store decimal or binary fractions, gathered block by block in the file's
//! order.
//!
//! Points that are too many for memory wait in a temporary file, a block at a time, where the input
//! has one. What all points decide together is then found block by block.

use super::ColumnSet;
use super::axis::Axis;
use super::column_file::ColumnFile;
use super::input::{Input, Meter};
use super::scalar::{Scalar, ScalarColumn};
use crate::error::Result;
use crate::progress::Progress;
use bytemuck::Pod;
use rayon::prelude::*;
use std::borrow::Cow;
use std::ops::Deref;
use std::sync::Arc;

/// Points as read. Present columns have the length of `x`.
#[derive(Clone, Debug)]
pub struct Floats {
    pub(super) axes: [Axis; 3],
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
    pub(super) there: ColumnSet,
    /// Points skipped because a coordinate is NaN or infinite.
    pub not_finite: u64,
    /// Points with byte colours out of range.
    pub clamped: u64,
    /// Points that are no longer in memory, before those that are.
    pub(super) spilled: Option<Spilled>,
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
    pub fn limits(self) -> Option<[[f64; 2]; 3]> {
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
    /// True if a channel exceeded what `rgb` holds.
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
    /// Returns empty points with the columns of these roles that are in `wanted`. `narrow`:
    /// positions are `f32`; `bytes`: colours are bytes.
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
            spilled: None,
        }
    }

    /// Returns a point whose scalars are missing.
    pub fn point(&self) -> Point {
        Point { scalars: vec![f64::NAN; self.scalars.len()], ..Point::default() }
    }

    pub fn len(&self) -> usize {
        self.axes[0].len() + self.spilled.as_ref().map_or(0, |spilled| spilled.points)
    }

    /// Reserves exact room if available: growing by doubling would hold two copies at the peak.
    pub fn reserve(&mut self, count: usize) {
        let count = self.spilled.as_ref().map_or(count, |spilled| count.min(spilled.limit));
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
        self.spill_if_full();
    }

    /// Moves the points in memory to the temporary file, if they are as many as may be there.
    fn spill_if_full(&mut self) {
        let held = self.axes[0].len();
        if self.spilled.as_ref().is_some_and(|spilled| held >= spilled.limit) {
            self.spill();
        }
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
        self.spill_if_full();
    }

    /// Moves points to a temporary file whenever they are too many for memory, if the input has
    /// one.
    pub fn spilling(mut self, input: &Input) -> Self {
        self.spilled = input.column_file.clone().map(|file| Spilled {
            limit: file.room().max(BLOCK),
            file,
            blocks: Vec::new(),
            points: 0,
        });
        self
    }

    /// Moves the points in memory to the temporary file.
    fn spill(&mut self) {
        let points = self.axes[0].len();
        let Some(Spilled { file, .. }) = self.spilled.as_ref().filter(|_| points > 0) else {
            return;
        };
        let at = At {
            axes: self.axes.each_ref().map(|axis| match axis {
                Axis::Narrow(values) => file.append(values),
                Axis::Wide(values) => file.append(values),
            }),
            rgb: self.rgb.as_deref().map(|column| file.append(column)),
            color: self.color.as_deref().map(|column| file.append(column)),
            intensity: self.intensity.as_deref().map(|column| file.append(column)),
            class: self.class.as_deref().map(|column| file.append(column)),
            normal: self.normal.as_deref().map(|column| file.append(column)),
            returns: self.returns.as_deref().map(|column| file.append(column)),
            source: self.source.as_deref().map(|column| file.append(column)),
            gps_time: self.gps_time.as_deref().map(|column| file.append(column)),
            scalars: self.scalars.iter().map(|own| file.append(&own.numbers)).collect(),
        };
        // Frees the columns, since later blocks are smaller.
        fn clear<T>(column: &mut Option<Vec<T>>) {
            column.iter_mut().for_each(|column| *column = Vec::new());
        }
        self.axes.iter_mut().for_each(Axis::clear);
        clear(&mut self.rgb);
        clear(&mut self.color);
        clear(&mut self.intensity);
        clear(&mut self.class);
        clear(&mut self.normal);
        clear(&mut self.returns);
        clear(&mut self.source);
        clear(&mut self.gps_time);
        self.scalars.iter_mut().for_each(|own| own.numbers = Vec::new());
        if let Some(spilled) = &mut self.spilled {
            spilled.blocks.push(Block { points, at, without: Vec::new() });
            spilled.points += points;
            // Moves later points in smaller blocks, to the file that exists.
            spilled.limit = BLOCK;
        }
    }

    /// Moves all points to the temporary file, if they are too many for memory.
    pub(super) fn settle(mut self) -> Result<Floats> {
        let Some(spilled) = &self.spilled else { return Ok(self) };
        if spilled.blocks.is_empty() && spilled.file.hold(self.axes[0].len()) {
            self.spilled = None;
            return Ok(self);
        }
        self.spill();
        if let Some(spilled) = &self.spilled {
            spilled.file.check()?;
        }
        Ok(Floats { spilled: self.spilled.take_if(|spilled| spilled.points > 0), ..self })
    }

    /// Copies some points.
    pub(super) fn pick(&self, points: &[u32]) -> Floats {
        fn pick<T: Copy>(column: &Option<Vec<T>>, points: &[u32]) -> Option<Vec<T>> {
            column.as_ref().map(|column| points.iter().map(|&i| column[i as usize]).collect())
        }
        let scalar = |own: &ScalarColumn| ScalarColumn {
            numbers: points.iter().map(|&i| own.numbers[i as usize]).collect(),
            ..*own
        };
        Floats {
            axes: self.axes.each_ref().map(|axis| axis.pick(points)),
            rgb: pick(&self.rgb, points),
            color: pick(&self.color, points),
            intensity: pick(&self.intensity, points),
            class: pick(&self.class, points),
            normal: pick(&self.normal, points),
            returns: pick(&self.returns, points),
            source: pick(&self.source, points),
            gps_time: pick(&self.gps_time, points),
            scalars: self.scalars.iter().map(scalar).collect(),
            spilled: None,
            ..*self
        }
    }

    /// Returns the number of blocks: one if all points are in memory.
    pub(super) fn blocks(&self) -> usize {
        self.spilled.as_ref().map_or(1, |spilled| spilled.blocks.len())
    }

    /// Returns the number of points of a block.
    fn points_of(&self, block: usize) -> u64 {
        let spilled = self.spilled.as_ref().map(|spilled| spilled.blocks[block].len());
        spilled.unwrap_or(self.len()) as u64
    }

    /// Returns what is read from a block, or is in memory.
    fn some_of<'f, T: ToOwned + ?Sized>(
        &'f self,
        block: usize,
        held: &'f T,
        read: impl Fn(&ColumnFile, &Block) -> Result<T::Owned>,
    ) -> Result<Cow<'f, T>> {
        match &self.spilled {
            None => Ok(Cow::Borrowed(held)),
            Some(spilled) => Ok(Cow::Owned(read(&spilled.file, &spilled.blocks[block])?)),
        }
    }

    pub(super) fn axes(&self, block: usize) -> Result<Cow<'_, [Axis; 3]>> {
        self.some_of(block, &self.axes, |file, block| self.axes_of(file, block))
    }

    pub(super) fn axis(&self, axis: usize, block: usize) -> Result<Cow<'_, Axis>> {
        self.some_of(block, &self.axes[axis], |file, block| self.axis_of(axis, file, block))
    }

    /// Returns a column of a block.
    fn column<'f, T: Pod>(
        &'f self,
        block: usize,
        held: &'f [T],
        at: impl Fn(&At) -> Option<u64>,
    ) -> Result<Cow<'f, [T]>> {
        self.some_of(block, held, |file, block| {
            Ok(block.some(file, at(&block.at))?.unwrap_or_default())
        })
    }

    pub fn colors(&self, block: usize) -> Result<Cow<'_, [[f32; 3]]>> {
        self.column(block, self.color.as_deref().unwrap_or_default(), |at| at.color)
    }

    pub fn byte_colors(&self, block: usize) -> Result<Cow<'_, [[u8; 3]]>> {
        self.column(block, self.rgb.as_deref().unwrap_or_default(), |at| at.rgb)
    }

    pub fn normals(&self, block: usize) -> Result<Cow<'_, [[i8; 3]]>> {
        self.column(block, self.normal.as_deref().unwrap_or_default(), |at| at.normal)
    }

    pub fn intensities(&self, block: usize) -> Result<Cow<'_, [f32]>> {
        self.column(block, self.intensity.as_deref().unwrap_or_default(), |at| at.intensity)
    }

    fn axis_of(&self, axis: usize, file: &ColumnFile, block: &Block) -> Result<Axis> {
        let at = block.at.axes[axis];
        Ok(match &self.axes[axis] {
            Axis::Narrow(_) => Axis::Narrow(block.read(file, at)?),
            Axis::Wide(_) => Axis::Wide(block.read(file, at)?),
        })
    }

    pub(super) fn axes_of(&self, file: &ColumnFile, block: &Block) -> Result<[Axis; 3]> {
        let [x, y, z] = [0, 1, 2].map(|axis| self.axis_of(axis, file, block));
        Ok([x?, y?, z?])
    }

    /// Reads the wanted columns of a block.
    pub(super) fn block_of(
        &self,
        file: &ColumnFile,
        block: &Block,
        wanted: ColumnSet,
    ) -> Result<Floats> {
        let At { rgb, color, intensity, class, normal, returns, source, gps_time, .. } = block.at;
        let scalar = |(own, at): (&ScalarColumn, &u64)| {
            Ok(ScalarColumn { numbers: block.read(file, *at)?, ..*own })
        };
        let scalars = self.scalars.iter().zip(&block.at.scalars);
        Ok(Floats {
            axes: self.axes_of(file, block)?,
            rgb: block.some(file, rgb.filter(|_| wanted.rgb))?,
            color: block.some(file, color.filter(|_| wanted.rgb))?,
            intensity: block.some(file, intensity.filter(|_| wanted.intensity))?,
            class: block.some(file, class.filter(|_| wanted.class))?,
            normal: block.some(file, normal.filter(|_| wanted.normal))?,
            returns: block.some(file, returns.filter(|_| wanted.returns))?,
            source: block.some(file, source.filter(|_| wanted.source))?,
            gps_time: block.some(file, gps_time.filter(|_| wanted.gps_time))?,
            scalars: scalars
                .filter(|(own, _)| wanted.scalars.has(own.scalar))
                .map(scalar)
                .collect::<Result<_>>()?,
            spilled: None,
            ..*self
        })
    }
}

/// Points as read, and where it is told how many of them were looked at again.
pub struct Watched<'f> {
    pub floats: &'f Floats,
    /// Name of the file.
    pub name: &'f str,
    pub progress: &'f dyn Progress,
}

impl Deref for Watched<'_> {
    type Target = Floats;

    fn deref(&self) -> &Floats {
        self.floats
    }
}

impl Watched<'_> {
    /// Maps every block on all threads, and joins what that gives.
    pub fn fold<T: Send>(
        &self,
        map: impl Fn(usize) -> Result<T> + Sync + Send,
        join: impl Fn(T, T) -> T + Sync + Send,
    ) -> Result<T> {
        let meter = once_more(self.name, self.progress, self.len());
        let map = |block: usize| {
            let mapped = map(block)?;
            meter.advance(self.points_of(block))?;
            Ok(mapped)
        };
        let all = (0..self.blocks()).into_par_iter().map(map);
        all.try_reduce_with(|a, b| Ok(join(a, b))).expect("there is a block")
    }
}

/// Returns the progress of looking at points that were read before.
pub(super) fn once_more<'p>(name: &str, progress: &'p dyn Progress, points: usize) -> Meter<'p> {
    Meter::named(progress, &format!("{name} once more"), points as u64)
}

/// Points that are moved to the temporary file together, about.
const BLOCK: usize = 1 << 16;

/// Points in a temporary file.
#[derive(Clone, Debug)]
pub(super) struct Spilled {
    pub(super) file: Arc<ColumnFile>,
    pub(super) blocks: Vec<Block>,
    /// Points of all blocks.
    pub(super) points: usize,
    /// Points in memory that are moved to the file.
    limit: usize,
}

/// Points that were moved to a temporary file together.
#[derive(Clone, Debug)]
pub(super) struct Block {
    points: usize,
    at: At,
    /// Numbers of the points that are left out, in order.
    pub(super) without: Vec<u32>,
}

/// Where the columns of a block begin in the temporary file.
#[derive(Clone, Debug)]
struct At {
    axes: [u64; 3],
    rgb: Option<u64>,
    color: Option<u64>,
    intensity: Option<u64>,
    class: Option<u64>,
    normal: Option<u64>,
    returns: Option<u64>,
    source: Option<u64>,
    gps_time: Option<u64>,
    scalars: Vec<u64>,
}

impl Block {
    pub(super) fn len(&self) -> usize {
        self.points - self.without.len()
    }

    fn read<T: Pod>(&self, file: &ColumnFile, at: u64) -> Result<Vec<T>> {
        let mut column = file.read(at, self.points)?;
        let (mut left_out, mut i) = (self.without.iter().peekable(), 0);
        if !self.without.is_empty() {
            column.retain(|_| {
                i += 1;
                left_out.next_if(|&&out| out + 1 == i).is_none()
            });
        }
        Ok(column)
    }

    fn some<T: Pod>(&self, file: &ColumnFile, at: Option<u64>) -> Result<Option<Vec<T>>> {
        at.map(|at| self.read(file, at)).transpose()
    }
}

/// Returns a unit normal with 127 = 1.0; zero if the length is 0 or not finite.
fn unit_normal(normal: [f32; 3]) -> [i8; 3] {
    let length = normal.iter().map(|&v| v as f64 * v as f64).sum::<f64>().sqrt();
    if !(length.is_finite() && length > 0.0) {
        return [0; 3];
    }
    normal.map(|v| (v as f64 / length * 127.0).round() as i8)
}
