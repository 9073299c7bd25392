//! One pool of fixed pages, persistently mapped: runs of pages out, within a budget.
//!
//! A page is 65,536 words of 32 bits. The pages of a run lie side by side in one block, because a dispatch reads one block. Runs are given first fit, lowest
//! page first, so that where things go depends on the order of asking alone. Blocks are allocated when a run first falls into them.

use crate::config::{PAGES_PER_BLOCK, POINTS_PER_PAGE};
use crate::error::Result;
use crate::gpu::memory::{Alive, RawBuffer, Window};
use crate::gpu::{BufferDesc, Place};
use crate::graph::{Buffer, Gpu, Graph};

pub const PAGE_BYTES: u64 = 4 * POINTS_PER_PAGE as u64;

/// Which pages are taken; no memory.
#[derive(Clone, Debug)]
pub struct Pages {
    taken: Vec<bool>,
    /// No page below is free.
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

    /// The first page of the lowest run of free ones.
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

    pub fn give(&mut self, first: u32, count: u32) {
        let run = &mut self.taken[first as usize..(first + count) as usize];
        assert!(run.iter().all(|&taken| taken), "pages {first} to {} were not all taken", first + count);
        run.fill(false);
        self.used -= count;
        self.lowest = self.lowest.min(first);
    }
}

/// Pages and their memory.
pub struct Pool {
    pub pages: Pages,
    blocks: Vec<RawBuffer>,
    /// Ended before its memory is given back, for threads that may still want to write there.
    alive: Alive,
}

impl Pool {
    /// At most so many pages.
    pub fn new(gpu: &Gpu, budget: u32) -> Pool {
        Pool { pages: Pages::new(budget), blocks: Vec::new(), alive: gpu.memory.alive.within() }
    }

    /// A run of pages; none where there is no room for it. An error of the device leaves the pool as it was.
    pub fn take(&mut self, gpu: &mut Gpu, count: u32) -> Result<Option<u32>> {
        let Some(first) = self.pages.take(count) else { return Ok(None) };
        while self.blocks.len() <= (first / PAGES_PER_BLOCK) as usize {
            let number = self.blocks.len() as u32;
            let pages = PAGES_PER_BLOCK.min(self.pages.budget - number * PAGES_PER_BLOCK);
            let desc = BufferDesc { bytes: PAGE_BYTES * pages as u64, place: Place::Upload };
            match gpu.memory.buffer(&gpu.device, desc, &format!("pages {number}")) {
                Ok(block) => self.blocks.push(block),
                Err(error) => {
                    self.pages.give(first, count);
                    return Err(error);
                }
            }
        }
        Ok(Some(first))
    }

    /// The pages that have memory.
    pub fn allocated(&self) -> u32 {
        self.blocks.iter().map(|block| (block.desc.bytes / PAGE_BYTES) as u32).sum()
    }

    /// A run for another thread to write.
    pub fn window(&self, first: u32, count: u32) -> Window {
        let at = PAGE_BYTES * (first % PAGES_PER_BLOCK) as u64;
        self.blocks[(first / PAGES_PER_BLOCK) as usize].window(at..at + PAGE_BYTES * count as u64, &self.alive)
    }

    /// The words from a page to the end of its block.
    pub fn words(&self, page: u32) -> &[u32] {
        let block = &self.blocks[(page / PAGES_PER_BLOCK) as usize];
        &bytemuck::cast_slice(block.bytes())[(page % PAGES_PER_BLOCK * POINTS_PER_PAGE) as usize..]
    }

    /// Every page that has memory, to be written at once.
    pub fn all_mut(&mut self) -> Vec<Option<&mut [u32]>> {
        let pages = |block| bytemuck::cast_slice_mut::<u8, u32>(RawBuffer::bytes_mut(block)).chunks_exact_mut(POINTS_PER_PAGE as usize);
        self.blocks.iter_mut().flat_map(|block| pages(block).map(Some)).collect()
    }

    /// Device address of a page, as the two words that a shader makes a pointer of.
    pub fn address(&self, page: u32) -> [u32; 2] {
        let address = self.blocks[(page / PAGES_PER_BLOCK) as usize].address + PAGE_BYTES * (page % PAGES_PER_BLOCK) as u64;
        [address as u32, (address >> 32) as u32]
    }

    /// Handles of the blocks for one frame; a block's page `p` starts at word `p * points per page`.
    pub fn import(&self, g: &mut Graph) -> Vec<Buffer> {
        self.blocks.iter().map(|block| g.import("pages", block)).collect()
    }

    /// Gives the memory back.
    pub fn free(self, gpu: &mut Gpu) {
        self.alive.end(|| ());
        self.blocks.into_iter().for_each(|block| gpu.memory.destroy_buffer(block));
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
