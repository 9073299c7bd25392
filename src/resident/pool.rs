//! One pool of fixed pages: runs of pages out, within a budget.
//!
//! The CPU writes to them through a persistent map, or where it can map little of the device's memory to a ring (`ring`), from which the device copies them.
//! A page is 65,536 words of 32 bits. The pages of a run lie side by side in one block, because a dispatch reads one block. Runs are given first fit, lowest
//! page first, so that where things go depends on the order of asking alone. Blocks are allocated when a run first falls into them.

use super::ring::Ring;
use crate::config::{PAGES_PER_BLOCK, POINTS_PER_PAGE};
use crate::error::Result;
use crate::gpu::memory::{Alive, RawBuffer, Window};
use crate::gpu::{BufferDesc, Place};
use crate::graph::{Buffer, Gpu, Graph};
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::BTreeMap;

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
    /// None where pages are mapped.
    ring: Option<Ring>,
    /// Ended before its memory is given back, for threads that may still want to write there.
    alive: Alive,
}

impl Pool {
    /// At most so many pages.
    pub fn new(gpu: &Gpu, budget: u32) -> Pool {
        let ring = (!gpu.device.is_mapped).then(Ring::default);
        Pool { pages: Pages::new(budget), blocks: Vec::new(), ring, alive: gpu.memory.alive.within() }
    }

    /// A run of pages; none where there is no room for it. An error of the device leaves the pool as it was.
    pub fn take(&mut self, gpu: &mut Gpu, count: u32) -> Result<Option<u32>> {
        let Some(first) = self.pages.take(count) else { return Ok(None) };
        while self.blocks.len() <= (first / PAGES_PER_BLOCK) as usize {
            let number = self.blocks.len() as u32;
            let pages = PAGES_PER_BLOCK.min(self.pages.budget - number * PAGES_PER_BLOCK);
            let place = if self.ring.is_some() { Place::Device } else { Place::Upload };
            let desc = BufferDesc { bytes: PAGE_BYTES * pages as u64, place };
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

    /// Makes room to write to a run that has been taken; false where there is none before the device has copied what was written last.
    pub fn open(&mut self, gpu: &mut Gpu, first: u32, count: u32) -> Result<bool> {
        self.ring.as_mut().map_or(Ok(true), |ring| ring.open(gpu, first, count))
    }

    /// An open run for another thread to write.
    pub fn window(&self, first: u32, count: u32) -> Window {
        let (memory, page) = match &self.ring {
            Some(ring) => ring.place(first),
            None => (&self.blocks[(first / PAGES_PER_BLOCK) as usize], first % PAGES_PER_BLOCK),
        };
        let at = PAGE_BYTES * page as u64;
        memory.window(at..at + PAGE_BYTES * count as u64, &self.alive)
    }

    /// Nobody writes to an open run any more: what is there is to be drawn from, or is not.
    pub fn close(&mut self, first: u32, written: bool) {
        self.ring.iter_mut().for_each(|ring| ring.close(first, written));
    }

    /// Sends closed runs on their way; submissions from now on find them in their pages.
    pub fn land(&mut self, gpu: &mut Gpu) -> Result<()> {
        self.ring.as_mut().map_or(Ok(()), |ring| ring.land(gpu, &self.blocks))
    }

    /// Whether runs are on their way that take up room.
    pub fn is_landing(&self) -> bool {
        self.ring.as_ref().is_some_and(Ring::is_landing)
    }

    /// Writes runs that have been taken, each by a job of its own on any thread: all at once where pages are mapped, else as many at a time as the ring holds. A job gets the words of each page.
    pub fn write<J: Send>(
        &mut self,
        gpu: &mut Gpu,
        runs: Vec<(u32, u32, J)>,
        write: impl Fn(J, Vec<&mut [u32]>) -> Result<()> + Sync,
    ) -> Result<()> {
        let mut runs = runs.into_iter().peekable();
        while runs.peek().is_some() {
            let mut opened = Vec::new();
            while let Some(&(first, count, _)) = runs.peek()
                && self.open(gpu, first, count)?
            {
                opened.extend(runs.next());
            }
            let firsts: Vec<u32> = opened.iter().map(|(first, ..)| *first).collect();
            let places: Vec<u32> = firsts.iter().map(|&first| self.ring.as_ref().map_or(first, |ring| ring.place(first).1)).collect();
            // Disjoint mutable pages for every run, so that they are written in parallel straight into mapped memory.
            let memory: &mut [RawBuffer] = self.ring.as_mut().map_or(&mut self.blocks, Ring::memory_mut);
            let split = |block| bytemuck::cast_slice_mut::<u8, u32>(RawBuffer::bytes_mut(block)).chunks_exact_mut(POINTS_PER_PAGE as usize);
            let mut pages: Vec<Option<&mut [u32]>> = memory.iter_mut().flat_map(|block| split(block).map(Some)).collect();
            let mut take = |page: u32| pages[page as usize].take().expect("a page belongs to one plane of one node");
            let jobs: Vec<_> = (opened.into_iter().zip(places))
                .map(|((_, count, job), place)| (job, (place..place + count).map(&mut take).collect::<Vec<_>>()))
                .collect();
            let written = jobs.into_par_iter().try_for_each(|(job, pages)| write(job, pages));
            firsts.into_iter().for_each(|first| self.close(first, written.is_ok()));
            written?;
            self.land(gpu)?;
            if self.is_landing() {
                gpu.catch_up()?;
            }
        }
        Ok(())
    }

    /// The words of runs of pages: where they lie, or copies that the device makes.
    pub fn read(&self, gpu: &mut Gpu, runs: &[(u32, u32)]) -> Result<Vec<Cow<'_, [u32]>>> {
        if self.ring.is_none() {
            let words = |&(first, count): &(u32, u32)| {
                let block = bytemuck::cast_slice(self.blocks[(first / PAGES_PER_BLOCK) as usize].bytes());
                Cow::Borrowed(&block[(first % PAGES_PER_BLOCK * POINTS_PER_PAGE) as usize..][..(count * POINTS_PER_PAGE) as usize])
            };
            return Ok(runs.iter().map(words).collect());
        }
        let (mut parts, mut bytes) = (BTreeMap::<u32, Vec<[u64; 3]>>::new(), 0);
        for &(first, count) in runs {
            let from = PAGE_BYTES * (first % PAGES_PER_BLOCK) as u64;
            parts.entry(first / PAGES_PER_BLOCK).or_default().push([from, bytes, PAGE_BYTES * count as u64]);
            bytes += PAGE_BYTES * count as u64;
        }
        let mut g = Graph::new(gpu);
        let mut copy = g.answer("pages read", bytes);
        for (block, parts) in parts {
            let block = g.import("pages", &self.blocks[block as usize]);
            g.copy_parts("read pages", &block, &mut copy, parts);
        }
        let frame = g.submit(&[])?;
        let mut words = frame.read::<u32>(&copy);
        let mut next = |count: u32| {
            let (own, rest) = words.split_at((count * POINTS_PER_PAGE) as usize);
            words = rest;
            Cow::Owned(own.to_vec())
        };
        let read = runs.iter().map(|&(_, count)| next(count)).collect();
        frame.shelve(gpu);
        Ok(read)
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
        // A device that is lost has nothing on its way any more.
        let _ = gpu.catch_up();
        let ring = self.ring.into_iter().flat_map(Ring::into_memory);
        self.blocks.into_iter().chain(ring).for_each(|block| gpu.memory.destroy_buffer(block));
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
