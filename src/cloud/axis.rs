//! One coordinate of many points, before the points' lattice is known.
//!
//! In: `f64` values. Out: integers on a lattice. Held as `f32` where the file's own values are, which halves the peak of reading, and loses nothing.

use rayon::prelude::*;

/// Values a task, where a whole axis is walked.
const TASK: usize = 1 << 16;

#[derive(Clone, Debug)]
pub enum Axis {
    Narrow(Vec<f32>),
    Wide(Vec<f64>),
}

impl Axis {
    /// `narrow` promises that every value pushed is an `f32`.
    pub fn new(narrow: bool) -> Self {
        if narrow { Axis::Narrow(Vec::new()) } else { Axis::Wide(Vec::new()) }
    }

    pub fn len(&self) -> usize {
        match self {
            Axis::Narrow(values) => values.len(),
            Axis::Wide(values) => values.len(),
        }
    }

    /// A hint; memory that is not there is missed when it is needed, not before.
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

    /// A copy of the values of some points.
    pub fn pick(&self, points: &[u32]) -> Axis {
        match self {
            Axis::Narrow(values) => {
                Axis::Narrow(points.iter().map(|&i| values[i as usize]).collect())
            }
            Axis::Wide(values) => Axis::Wide(points.iter().map(|&i| values[i as usize]).collect()),
        }
    }

    /// Smallest and largest, 0 and 0 of none.
    pub fn range(&self) -> (f64, f64) {
        let join = |a: (f64, f64), b: (f64, f64)| (a.0.min(b.0), a.1.max(b.1));
        let range = match self {
            Axis::Narrow(values) => values
                .par_iter()
                .with_min_len(TASK)
                .map(|&v| (v.into(), v.into()))
                .reduce_with(join),
            Axis::Wide(values) => {
                values.par_iter().with_min_len(TASK).map(|&v| (v, v)).reduce_with(join)
            }
        };
        range.unwrap_or((0.0, 0.0))
    }

    /// Says whether all values are multiples of a power of two.
    pub fn is_on(&self, step: f64) -> bool {
        let is_whole = |v: f64| (v / step).fract() == 0.0;
        match self {
            Axis::Narrow(values) => {
                values.par_iter().with_min_len(TASK).all(|&v| is_whole(v.into()))
            }
            Axis::Wide(values) => values.par_iter().with_min_len(TASK).all(|&v| is_whole(v)),
        }
    }

    /// Returns how many decimals all values have at most, from `least` to `most`; none where one has more, or is an `f32`.
    pub fn decimals(&self, least: i32, most: i32) -> Option<i32> {
        let Axis::Wide(values) = self else { return None };
        let of_task = |values: &[f64]| {
            values.iter().try_fold(least, |digits, &value| {
                (digits..=most).find(|&digits| is_decimal(value, 10f64.powi(digits)))
            })
        };
        values.par_chunks(TASK).map(of_task).try_reduce(|| least, |a, b| Some(a.max(b)))
    }

    /// The nearest steps from `offset` on. Nothing overflows before the difference.
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

/// Says whether a value is the f64 nearest to a whole number divided by `parts`.
fn is_decimal(value: f64, parts: f64) -> bool {
    const MOST: f64 = (1u64 << 53) as f64;
    let whole = (value * parts).round();
    whole.abs() <= MOST && whole / parts == value
}
