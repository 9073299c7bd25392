//! Counts of the points that are left.

use super::Selection;
use super::input::{Batch, Input};
use crate::cloud::digits::Digits;
use crate::cloud::histograms::{Histograms, Tally};
use crate::error::Result;
use crate::progress::Progress;
use glam::DVec3;

/// How many points are left, and what they are.
#[derive(Clone, Debug)]
pub struct Count {
    pub points: u64,
    /// Points of the input.
    pub of: u64,
    /// World corners of the box around them.
    pub bounds: Option<[DVec3; 2]>,
    pub histograms: Histograms,
    pub notes: Vec<String>,
}

/// Counts the points that are left, each as it is in the files.
pub fn count(input: &Input, selection: &Selection, progress: &dyn Progress) -> Result<Count> {
    input.check(&selection.filter)?;
    let (mut points, mut of) = (0, 0);
    let (mut tally, mut bounds) = (Tally::default(), None::<[DVec3; 2]>);
    let map = |batch: &Batch| {
        let own = batch.columns.pick(&batch.left);
        let lattice = &input.parts()[batch.part].lattice;
        let corner = |corner: [i32; 3]| {
            lattice.world([0, 1, 2].map(|axis| corner[axis] as i64 + batch.shift[axis]))
        };
        let mut tally = Tally::default();
        tally.add(&own);
        Ok((tally, own.bounds().map(|ends| ends.map(corner)), own.len(), batch.columns.len()))
    };
    let mut take = |(own, ends, left, all): (Tally, Option<[DVec3; 2]>, usize, usize)| {
        (points, of) = (points + left as u64, of + all as u64);
        tally.join(&own);
        let widen = |[low, high]: [DVec3; 2], [a, b]: [DVec3; 2]| [low.min(a), high.max(b)];
        bounds = bounds.into_iter().chain(ends).reduce(widen);
        Ok(())
    };
    let notes = input.each(selection, progress, &map, &mut take)?;
    let digits = Digits::of(input.parts().iter().map(|part| part.lattice));
    let bounds = bounds.map(|ends| ends.map(|end| digits.round(end)));
    Ok(Count { points, of, bounds, histograms: tally.counts(), notes })
}
