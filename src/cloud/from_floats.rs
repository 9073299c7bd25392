//! Floating-point points onto a lattice.
//!
//! One step serves all axes, so that the cloud is less than 2^30 steps wide. It
//! is the finest power of two, 7 binary digits finer than `f32` coordinates over the same width. If
//! that would round coordinates and all are decimals of few digits, it is their last digit. If all
//! steps share trailing zeros (integer coordinates, `f32` far from zero), the step grows by them,
//! which loses nothing and makes the numbers small.

use super::axis::Axis;
use super::crs::Crs;
use super::digits::number;
use super::float_attributes::Attributes;
use super::floats::{Block, ColorUnit, Floats, Watched, once_more};
use super::input::Input;
use super::scalar::Scalars;
use super::strays::{Places, RobustBounds, tasks};
use super::{ColumnSet, Columns, Header, Lattice, Part};
use crate::error::{Error, Result};
use crate::progress::Progress;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

impl Floats {
    /// Returns the parts of the file's points: all, and strays if any. Notes report skipped and
    /// changed points. `limits` is the file's intensity range.
    pub fn into_parts(
        self,
        input: &Input,
        header: Header,
        unit: ColorUnit,
        limits: Option<[f64; 2]>,
        progress: &dyn Progress,
        notes: &mut Vec<String>,
    ) -> Result<Vec<ReadPart>> {
        let floats = self.settle()?;
        let name = input.name();
        if floats.not_finite > 0 {
            notes.push(format!(
                "{name}: {} points with NaN or infinite coordinates were skipped",
                floats.not_finite
            ));
        }
        let header = Header { columns: floats.there, ..header };
        let is_angular = Crs::of(&header).is_some_and(|system| system.degrees.is_some());
        let watched = Watched { floats: &floats, name: &name, progress };
        let attributes = Attributes::of(&watched, unit, input.rgb_range, limits, notes)?;
        let (core, mut rounded) = (RobustBounds::among(&watched)?, None);
        let (floats, strays) = match core {
            None => (floats, None),
            Some(core) => {
                let (floats, strays) = floats.split(core, &name, progress)?;
                (floats, Some(strays))
            }
        };
        let (mut parts, has_intensities) = (Vec::new(), floats.intensity.is_some());
        for (floats, strays) in [(Some(floats), false), (strays, true)] {
            let Some(floats) = floats else { continue };
            let watched = Watched { floats: &floats, name: &name, progress };
            let extent = extent(&watched, is_angular, strays)?;
            if !strays && extent.rounds[2] {
                rounded = Some(extent.step[2]);
            }
            let Placed { lattice, columns, on_disk } =
                floats.placed(&extent, &attributes, &name, progress)?;
            let part = Part {
                path: input.path.clone(),
                name: None,
                header: Header { strays, ..header.clone() },
                lattice,
                columns,
                intensity_range: attributes.intensity_range(has_intensities),
                rgb_scale: attributes.rgb_scale,
            };
            parts.push(ReadPart { part, on_disk });
        }
        if let Some(step) = rounded.filter(|step| *step > LARGEST_QUIET_STEP) {
            notes.push(format!(
                "{name}: the extent is so large that coordinates are rounded to steps of {}",
                number(step)
            ));
        }
        Ok(parts)
    }

    /// Separates the points outside of a box.
    fn split(
        mut self,
        core: RobustBounds,
        name: &str,
        progress: &dyn Progress,
    ) -> Result<(Floats, Floats)> {
        let divide = |axes: &[Axis; 3]| -> (Vec<u32>, Vec<u32>) {
            (0..axes[0].len() as u32).partition(|&i| core.has(place(axes, i as usize)))
        };
        let meter = once_more(name, progress, self.len());
        let Some(mut spilled) = self.spilled.take() else {
            let (inside, strays) = divide(&self.axes);
            return Ok((self.pick(&inside), self.pick(&strays)));
        };
        let (file, mut strays) = (&spilled.file, self.clone());
        let wanted = ColumnSet { scalars: Scalars::ALL, ..ColumnSet::ALL };
        // Strays are few.
        for block in &mut spilled.blocks {
            let (_, outside) = divide(&self.axes_of(file, block)?);
            if !outside.is_empty() {
                strays.append(self.block_of(file, block, wanted)?.pick(&outside));
                spilled.points -= outside.len();
                block.without = outside;
            }
            meter.advance(block.len() as u64)?;
        }
        self.spilled = Some(spilled);
        Ok((self, strays))
    }

    /// Puts the points on a lattice.
    fn placed(
        self,
        extent: &Extent,
        attributes: &Attributes,
        name: &str,
        progress: &dyn Progress,
    ) -> Result<Placed> {
        let Extent { offset, step, .. } = *extent;
        let lattice = |shift: u32| Lattice {
            step: DVec3::from_array(step) * (1u32 << shift) as f64,
            offset: DVec3::from_array(offset),
        };
        if self.spilled.is_none() {
            let mut columns = self.columns(attributes, offset, step);
            let shift = Occurred::of(&columns).shift();
            shift_right(&mut columns, shift);
            return Ok(Placed { lattice: lattice(shift), columns, on_disk: None });
        }
        let occurred = |block: usize| {
            let [x, y, z] = self.axes(block)?.into_owned();
            let columns = Columns {
                x: x.quantise(offset[0], step[0]),
                y: y.quantise(offset[1], step[1]),
                z: z.quantise(offset[2], step[2]),
                ..Columns::default()
            };
            Ok(Occurred::of(&columns))
        };
        let watched = Watched { floats: &self, name, progress };
        let occurred = watched.fold(occurred, Occurred::join)?;
        let shift = occurred.shift();
        let bounds = occurred.bounds.map(|ends| ends.map(|end| end.map(|q| q >> shift)));
        let on_disk =
            OnDisk { attributes: attributes.clone(), offset, step, shift, bounds, floats: self };
        let (lattice, columns) = (lattice(shift), Columns::default());
        Ok(Placed { lattice, columns, on_disk: Some(Arc::new(on_disk)) })
    }

    /// Converts points in memory.
    fn columns(self, attributes: &Attributes, offset: [f64; 3], step: [f64; 3]) -> Columns {
        let columns = Columns {
            rgb: attributes.rgb(self.rgb, self.color),
            intensity: self.intensity.map(|column| attributes.intensities(&column)),
            class: self.class,
            returns: self.returns,
            source: self.source,
            normal: self.normal.filter(|_| attributes.has_normals),
            gps_time: self.gps_time,
            scalars: self.scalars,
            ..Columns::default()
        };
        let [x, y, z] = self.axes;
        Columns {
            x: x.quantise(offset[0], step[0]),
            y: y.quantise(offset[1], step[1]),
            z: z.quantise(offset[2], step[2]),
            ..columns
        }
    }
}

/// A part as it was read. The columns of one that is on a disk are empty.
pub struct ReadPart {
    pub part: Part,
    pub on_disk: Option<Arc<OnDisk>>,
}

impl ReadPart {
    /// Returns a part in memory.
    pub fn held(part: Part) -> ReadPart {
        ReadPart { part, on_disk: None }
    }

    pub fn named(mut self, name: &str) -> ReadPart {
        self.part.name = Some(name.to_owned());
        self
    }
}

/// A part's points in a temporary file.
#[derive(Debug)]
pub struct OnDisk {
    floats: Floats,
    attributes: Attributes,
    offset: [f64; 3],
    step: [f64; 3],
    /// Common power of two of all steps.
    shift: u32,
    /// The box around the points [lattice steps].
    pub bounds: Option<[[i32; 3]; 2]>,
}

impl OnDisk {
    pub fn len(&self) -> usize {
        self.floats.len()
    }

    /// Returns the number of the first point of each block.
    pub fn firsts(&self) -> Vec<u64> {
        let blocks = self.floats.spilled.iter().flat_map(|spilled| &spilled.blocks);
        let before = |sum: &mut u64, block: &Block| {
            let first = *sum;
            *sum += block.len() as u64;
            Some(first)
        };
        blocks.scan(0, before).collect()
    }

    /// Returns the steps of at most this many points from all over.
    pub fn every(&self, most: usize) -> Result<Vec<[i32; 3]>> {
        let (every, mut next, mut steps) = (self.len().div_ceil(most).max(1), 0, Vec::new());
        for (block, first) in self.firsts().into_iter().enumerate() {
            let columns = self.columns(block, ColumnSet::default())?;
            let Columns { x, y, z, .. } = &columns;
            while next < first as usize + columns.len() {
                let i = next - first as usize;
                steps.push([x[i], y[i], z[i]]);
                next += every;
            }
        }
        Ok(steps)
    }

    /// Returns the points of a block with the wanted columns.
    pub fn columns(&self, block: usize, wanted: ColumnSet) -> Result<Columns> {
        let OnDisk { floats, attributes, offset, step, shift, .. } = self;
        let Some(spilled) = &floats.spilled else { return Ok(Columns::default()) };
        let floats = floats.block_of(&spilled.file, &spilled.blocks[block], wanted)?;
        let mut columns = floats.columns(attributes, *offset, *step);
        shift_right(&mut columns, *shift);
        Ok(columns)
    }

    /// Returns the wanted columns of all blocks.
    pub fn available(&self, wanted: ColumnSet) -> ColumnSet {
        let Floats {
            rgb, color, intensity, class, normal, returns, source, gps_time, scalars, ..
        } = &self.floats;
        ColumnSet {
            rgb: wanted.rgb && (rgb.is_some() || color.is_some()) && self.attributes.has_colors,
            intensity: wanted.intensity && intensity.is_some(),
            class: wanted.class && class.is_some(),
            returns: wanted.returns && returns.is_some(),
            source: wanted.source && source.is_some(),
            normal: wanted.normal && normal.is_some() && self.attributes.has_normals,
            gps_time: wanted.gps_time && gps_time.is_some(),
            scalars: scalars
                .iter()
                .map(|own| own.scalar)
                .filter(|scalar| wanted.scalars.has(*scalar))
                .collect(),
        }
    }
}

/// Points on a lattice.
struct Placed {
    lattice: Lattice,
    columns: Columns,
    on_disk: Option<Arc<OnDisk>>,
}

/// Steps that occur.
struct Occurred {
    /// Bits of any coordinate.
    bits: i32,
    bounds: Option<[[i32; 3]; 2]>,
}

impl Occurred {
    fn of(columns: &Columns) -> Occurred {
        let all = [&columns.x, &columns.y, &columns.z].into_iter().flatten();
        Occurred { bits: all.fold(0, |bits, q| bits | q), bounds: columns.bounds() }
    }

    fn join(self, other: Occurred) -> Occurred {
        let both = |[low, high]: [[i32; 3]; 2], [a, b]: [[i32; 3]; 2]| {
            [0, 1, 2].map(|axis| [low[axis].min(a[axis]), high[axis].max(b[axis])])
        };
        let both = |one, other| {
            let ends = both(one, other);
            [0, 1].map(|end| ends.map(|ends| ends[end]))
        };
        let bounds = self.bounds.into_iter().chain(other.bounds).reduce(both);
        Occurred { bits: self.bits | other.bits, bounds }
    }

    /// Returns the exponent of the common power of two of all steps.
    fn shift(&self) -> u32 {
        if self.bits == 0 { 0 } else { self.bits.trailing_zeros() }
    }
}

/// Divides all steps by a power of two.
fn shift_right(columns: &mut Columns, shift: u32) {
    if shift > 0 {
        for axis in [&mut columns.x, &mut columns.y, &mut columns.z] {
            axis.par_iter_mut().with_min_len(1 << 16).for_each(|q| *q >>= shift);
        }
    }
}

fn place(axes: &[Axis; 3], i: usize) -> DVec3 {
    DVec3::from_array(axes.each_ref().map(|axis| axis.at(i)))
}

impl Places for Watched<'_> {
    type Error = Error;

    fn count(&self) -> usize {
        self.len()
    }

    fn fold<T: Send>(
        &self,
        empty: impl Fn() -> T + Sync + Send,
        add: impl Fn(&mut T, DVec3) + Sync + Send,
        join: impl Fn(T, T) -> T + Sync + Send,
    ) -> Result<T> {
        let of_block = |block: usize| {
            let axes = self.axes(block)?;
            let of_range = |range: Range<usize>| {
                let mut sum = empty();
                range.for_each(|i| add(&mut sum, place(&axes, i)));
                sum
            };
            Ok(tasks(axes[0].len()).map(of_range).reduce(&empty, &join))
        };
        Watched::fold(self, of_block, &join)
    }
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
/// count from the origin, and their lattice is as fine as their distance allows.
fn extent(floats: &Watched, is_angular: bool, strays: bool) -> Result<Extent> {
    let wider = |(a, b): (f64, f64), (lo, hi): (f64, f64)| (a.min(lo), b.max(hi));
    let range = |axis: usize| {
        let of_block = |block: usize| Ok(floats.axis(axis, block)?.range());
        let some = |one: Option<(f64, f64)>, other: Option<(f64, f64)>| {
            one.into_iter().chain(other).reduce(wider)
        };
        Ok(floats.fold(of_block, some)?.unwrap_or((0.0, 0.0)))
    };
    let [x, y, z] = [0, 1, 2].map(range);
    let mut ranges = [x?, y?, z?];
    if strays {
        ranges = ranges.map(|(lo, hi)| (lo.min(0.0), hi.max(0.0)));
    }
    let is_place = ranges.iter().all(|(lo, hi)| lo == hi);
    let first = if is_angular { 2 } else { 3 };
    let mut extent =
        Extent { offset: ranges.map(|(lo, _)| lo), step: [1.0; 3], rounds: [false; 3] };
    for group in [0..first, first..3].into_iter().filter(|group| !group.is_empty()) {
        let half = half_width(&ranges[group.clone()]);
        let binary = binary_step(half);
        let is_exact = are_on(floats, group.clone(), binary)?;
        let far = ranges[group.clone()]
            .iter()
            .fold(0.0, |far: f64, (lo, hi)| far.max(lo.abs()).max(hi.abs()));
        let decimal = if is_exact { None } else { decimal_step(floats, group.clone(), half, far)? };
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
    Ok(extent)
}

/// Tests whether all coordinates along some axes are multiples of a power of two.
fn are_on(floats: &Watched, mut axes: Range<usize>, step: f64) -> Result<bool> {
    let is_off = AtomicBool::new(false);
    let is_on = |axis: usize| {
        let look = |block: usize| {
            if !is_off.load(Relaxed) && !floats.axis(axis, block)?.is_on(step) {
                is_off.store(true, Relaxed);
            }
            Ok(())
        };
        floats.fold(look, |(), ()| ())?;
        Ok(!is_off.load(Relaxed))
    };
    axes.try_fold(true, |all, axis| Ok(all && is_on(axis)?))
}

/// Returns half of the widest range: the whole width of the largest finite one is infinite.
fn half_width(ranges: &[(f64, f64)]) -> f64 {
    ranges.iter().fold(0.0, |widest: f64, (lo, hi)| widest.max(hi / 2.0 - lo / 2.0))
}

/// Returns the last decimal digit of coordinates, if the width is less than 2^30 of it, and the
/// farthest from 0 less than 2^53; `None` for `f32`.
fn decimal_step(floats: &Watched, axes: Range<usize>, half: f64, far: f64) -> Result<Option<f64>> {
    const MOST: i32 = 15;
    let fits = |digits: &i32| {
        let steps = 10f64.powi(*digits);
        half * steps < (1u64 << 29) as f64 && far * steps < (1u64 << 53) as f64
    };
    let Some(most) = (0..=MOST).take_while(fits).last() else { return Ok(None) };
    let (has_more, mut digits) = (AtomicBool::new(false), 0);
    for axis in axes {
        let look = |block: usize| {
            let own = match has_more.load(Relaxed) {
                true => None,
                false => floats.axis(axis, block)?.decimals(digits, most),
            };
            has_more.fetch_or(own.is_none(), Relaxed);
            Ok(own)
        };
        let own = floats.fold(look, |a, b| Some(a?.max(b?)))?;
        let Some(own) = own else { return Ok(None) };
        digits = own;
    }
    Ok(Some(1.0 / 10f64.powi(digits)))
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
