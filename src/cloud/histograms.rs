//! Histograms of classes and return numbers.

use super::Columns;
use serde::{Deserialize, Serialize};

/// Number of return numbers; they have four bits.
pub const RETURNS: usize = 16;
pub const CLASSES: usize = 256;

/// Number of points of each class and return number that occurs, in ascending order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Histograms {
    pub classes: Vec<(u8, u64)>,
    pub returns: Vec<(u8, u64)>,
}

impl Histograms {
    pub fn of<'a>(parts: impl IntoIterator<Item = &'a Columns>) -> Histograms {
        let mut tally = Tally::default();
        parts.into_iter().for_each(|columns| tally.add(columns));
        tally.counts()
    }

    /// Tests whether the histograms can be those of this many points.
    pub fn are_possible(&self, points: u64) -> bool {
        let fit = |counts: &[(u8, u64)], kinds: usize| {
            let sum = counts.iter().fold(0u64, |sum, (_, count)| sum.saturating_add(*count));
            counts.is_sorted_by(|a, b| a.0 < b.0)
                && counts.iter().all(|(kind, _)| (*kind as usize) < kinds)
                && sum <= points
        };
        fit(&self.classes, CLASSES) && fit(&self.returns, RETURNS)
    }
}

/// A builder of [`Histograms`].
#[derive(Clone, Debug)]
pub struct Tally {
    classes: [u64; CLASSES],
    returns: [u64; RETURNS],
}

impl Default for Tally {
    fn default() -> Tally {
        Tally { classes: [0; CLASSES], returns: [0; RETURNS] }
    }
}

impl Tally {
    pub fn add(&mut self, columns: &Columns) {
        columns.class.iter().flatten().for_each(|&class| self.classes[class as usize] += 1);
        columns
            .returns
            .iter()
            .flatten()
            .for_each(|&packed| self.returns[packed as usize % RETURNS] += 1);
    }

    pub fn join(&mut self, other: &Tally) {
        self.classes.iter_mut().zip(other.classes).for_each(|(sum, count)| *sum += count);
        self.returns.iter_mut().zip(other.returns).for_each(|(sum, count)| *sum += count);
    }

    pub fn counts(&self) -> Histograms {
        let occurring = |counts: &[u64]| {
            (0..=u8::MAX).zip(counts.iter().copied()).filter(|&(_, count)| count > 0).collect()
        };
        Histograms { classes: occurring(&self.classes), returns: occurring(&self.returns) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn return_numbers_are_counted_whatever_the_number_of_returns() {
        let one = Columns {
            class: Some(vec![2, 6, 2]),
            returns: Some(vec![0x11, 0x21, 0x22]),
            ..Columns::default()
        };
        let other = Columns { returns: Some(vec![0xf2, 0]), ..Columns::default() };
        let counts = Histograms::of([&one, &other]);
        assert_eq!(
            counts,
            Histograms { classes: vec![(2, 2), (6, 1)], returns: vec![(0, 1), (1, 2), (2, 2)] }
        );
        assert!(counts.are_possible(5) && !counts.are_possible(4));
    }

    #[test]
    fn counts_that_nobody_counted_are_impossible() {
        let of = |classes: &[(u8, u64)], returns: &[(u8, u64)]| Histograms {
            classes: classes.to_vec(),
            returns: returns.to_vec(),
        };
        assert!(of(&[(0, 1), (255, 1)], &[(15, 2)]).are_possible(2));
        for counts in [
            of(&[], &[(16, 1)]),
            of(&[(3, 1), (3, 1)], &[]),
            of(&[(4, 1), (3, 1)], &[]),
            of(&[(1, u64::MAX), (2, 1)], &[]),
        ] {
            assert!(!counts.are_possible(2), "{counts:?}");
        }
    }
}
