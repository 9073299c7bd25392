//! One coordinate of many points, before the points' lattice is known.
//!
//! Values are held as `f32` if the file has `f32`, which halves the peak memory of reading and
//! loses nothing.

use rayon::prelude::*;

/// Values per task.
const TASK: usize = 1 << 16;

#[derive(Clone, Debug)]
pub enum Axis {
    Narrow(Vec<f32>),
    Wide(Vec<f64>),
}

impl Axis {
    /// Returns an empty axis. `narrow` promises that every pushed value is an `f32`.
    pub fn new(narrow: bool) -> Self {
        if narrow { Axis::Narrow(Vec::new()) } else { Axis::Wide(Vec::new()) }
    }

    pub fn len(&self) -> usize {
        match self {
            Axis::Narrow(values) => values.len(),
            Axis::Wide(values) => values.len(),
        }
    }

    /// Reserves memory if available; a failure shows when the memory is used.
    pub fn reserve(&mut self, count: usize) {
        let _ = match self {
            Axis::Narrow(values) => values.try_reserve_exact(count),
            Axis::Wide(values) => values.try_reserve_exact(count),
        };
    }

    pub fn push(&mut self, value: f64) {
        match self {
            Axis::Narrow(values) => values.push(value as f32),
            Axis::Wide(values) => values.push(value),
        }
    }

    /// Appends a block of the same width.
    pub fn append(&mut self, block: Axis) {
        match (self, block) {
            (Axis::Narrow(values), Axis::Narrow(block)) => values.extend(block),
            (Axis::Wide(values), Axis::Wide(block)) => values.extend(block),
            (Axis::Wide(values), Axis::Narrow(block)) => {
                values.extend(block.into_iter().map(f64::from))
            }
            (Axis::Narrow(_), Axis::Wide(_)) => {
                unreachable!("a block of f64 values for an axis of f32")
            }
        }
    }

    pub fn at(&self, i: usize) -> f64 {
        match self {
            Axis::Narrow(values) => values[i].into(),
            Axis::Wide(values) => values[i],
        }
    }

    /// Copies the values of the given points.
    pub fn pick(&self, points: &[u32]) -> Axis {
        match self {
            Axis::Narrow(values) => {
                Axis::Narrow(points.iter().map(|&i| values[i as usize]).collect())
            }
            Axis::Wide(values) => Axis::Wide(points.iter().map(|&i| values[i as usize]).collect()),
        }
    }

    /// Drops all values, and frees their memory.
    pub fn clear(&mut self) {
        *self = Axis::new(matches!(self, Axis::Narrow(_)));
    }

    /// Returns the smallest and largest value; `None` if empty.
    pub fn range(&self) -> Option<(f64, f64)> {
        let join = |a: (f64, f64), b: (f64, f64)| (a.0.min(b.0), a.1.max(b.1));
        match self {
            Axis::Narrow(values) => values
                .par_iter()
                .with_min_len(TASK)
                .map(|&v| (v.into(), v.into()))
                .reduce_with(join),
            Axis::Wide(values) => {
                values.par_iter().with_min_len(TASK).map(|&v| (v, v)).reduce_with(join)
            }
        }
    }

    /// Tests whether all values are multiples of a power of two.
    pub fn is_on(&self, step: f64) -> bool {
        let is_whole = |v: f64| (v / step).fract() == 0.0;
        match self {
            Axis::Narrow(values) => {
                values.par_iter().with_min_len(TASK).all(|&v| is_whole(v.into()))
            }
            Axis::Wide(values) => values.par_iter().with_min_len(TASK).all(|&v| is_whole(v)),
        }
    }

    /// Returns the number of decimals of all values, from `least` to `most`; `None` if one has more
    /// or is an `f32`.
    pub fn decimals(&self, least: i32, most: i32) -> Option<i32> {
        let Axis::Wide(values) = self else { return None };
        let of_task = |values: &[f64]| {
            values.iter().try_fold(least, |digits, &value| {
                (digits..=most).find(|&digits| is_decimal(value, 10f64.powi(digits)))
            })
        };
        values.par_chunks(TASK).map(of_task).try_reduce(|| least, |a, b| Some(a.max(b)))
    }

    /// Returns the nearest steps from `offset`. Nothing overflows before the subtraction.
    pub fn quantise(self, offset: f64, step: f64) -> Vec<i32> {
        let q = |v: f64| (v / step - offset / step).round() as i32;
        match self {
            Axis::Narrow(values) => {
                values.into_par_iter().with_min_len(TASK).map(|v| q(v.into())).collect()
            }
            Axis::Wide(values) => values.into_par_iter().with_min_len(TASK).map(q).collect(),
        }
    }
}

/// Tests whether a value is the f64 nearest to an integer divided by `parts`.
fn is_decimal(value: f64, parts: f64) -> bool {
    const MOST: f64 = (1u64 << 53) as f64;
    let whole = (value * parts).round();
    whole.abs() <= MOST && whole / parts == value
}
