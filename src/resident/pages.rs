//! Allocation of pages in runs, without their memory.

use crate::config::{PAGES_PER_BLOCK, POINTS_PER_PAGE};

/// Size of a page `[bytes]`.
pub const PAGE_BYTES: u64 = 4 * POINTS_PER_PAGE as u64;
/// Size of the memory that is allocated at a time `[bytes]`.
pub const BLOCK_BYTES: u64 = PAGE_BYTES * PAGES_PER_BLOCK as u64;

/// Occupancy of pages, without memory.
#[derive(Clone, Debug)]
pub struct Pages {
    taken: Vec<bool>,
    /// Lowest page that may be free.
    lowest: u32,
    pub budget: u32,
    pub used: u32,
}

impl Pages {
    pub fn new(budget: u32) -> Pages {
        Pages { taken: Vec::new(), lowest: 0, budget, used: 0 }
    }

    fn is_free(&self, page: u32) -> bool {
        !self.taken.get(page as usize).copied().unwrap_or(false)
    }

    /// Takes the lowest free run of pages and returns its first.
    pub fn take(&mut self, count: u32) -> Option<u32> {
        let mut run = 0;
        for page in self.lowest..self.budget {
            run = match (self.is_free(page), page % PAGES_PER_BLOCK) {
                (false, _) => 0,
                (true, 0) => 1,
                (true, _) => run + 1,
            };
            if run == count {
                let first = page + 1 - count;
                if self.taken.len() <= page as usize {
                    self.taken.resize(page as usize + 1, false);
                }
                self.taken[first as usize..=page as usize].fill(true);
                self.used += count;
                while self.lowest < self.budget && !self.is_free(self.lowest) {
                    self.lowest += 1;
                }
                return Some(first);
            }
        }
        None
    }

    /// Tests whether no page from this one on is taken.
    pub fn is_free_from(&self, page: u32) -> bool {
        self.taken.iter().skip(page as usize).all(|taken| !taken)
    }

    pub fn give(&mut self, first: u32, count: u32) {
        let run = &mut self.taken[first as usize..(first + count) as usize];
        assert!(
            run.iter().all(|&taken| taken),
            "pages {first} to {} were not all taken",
            first + count
        );
        run.fill(false);
        self.used -= count;
        self.lowest = self.lowest.min(first);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn runs_never_overlap_lie_in_one_block_and_are_the_lowest(asked in prop::collection::vec((1u32..5, any::<bool>()), 1..400), budget in 1u32..700) {
            let mut pages = Pages::new(budget);
            let mut runs: Vec<(u32, u32)> = Vec::new();
            for (count, give) in asked {
                if give && !runs.is_empty() {
                    let (first, count) = runs.swap_remove(count as usize % runs.len());
                    pages.give(first, count);
                    continue;
                }
                let fits = |first: u32| {
                    let free = |page| runs.iter().all(|&(first, count)| page < first || page >= first + count);
                    first / PAGES_PER_BLOCK == (first + count - 1) / PAGES_PER_BLOCK && (first..first + count).all(free)
                };
                let expected = (0..(budget + 1).saturating_sub(count)).find(|&first| fits(first));
                prop_assert_eq!(pages.take(count), expected);
                runs.extend(expected.map(|first| (first, count)));
                prop_assert_eq!(pages.used, runs.iter().map(|run| run.1).sum::<u32>());
            }
        }
    }
}
