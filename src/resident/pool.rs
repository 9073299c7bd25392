//! A pool of equal pages: runs of pages within a budget.
//!
//! The CPU writes to pages through a persistent map, or to a staging ring (`staging_ring`), from
//! which the device copies, if it can map little device memory. A page is 65,536 words of 32 bits.
//! The pages of a run are consecutive in one block, because a dispatch reads one block. Runs are
//! allocated first fit, lowest page first, so that their places depend only on the order of
//! requests. Blocks are allocated when a run first falls into them.

use super::pages::{BLOCK_BYTES, PAGE_BYTES, Pages};
use super::staging_ring::StagingRing;
use crate::config::{PAGES_PER_BLOCK, POINTS_PER_PAGE};
use crate::error::Result;
use crate::gpu::memory::{LifetimeGuard, MappedRange, RawBuffer};
use crate::gpu::{BufferDesc, Place};
use crate::graph::{Buffer, Gpu, Graph};
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Pages with their memory.
pub struct Pool {
    pub pages: Pages,
    blocks: Vec<RawBuffer>,
    /// `None` if pages are mapped.
    ring: Option<StagingRing>,
    /// Closed before memory is freed, for threads that may still write there.
    alive: LifetimeGuard,
}

impl Pool {
    /// Creates a pool of at most `budget` pages.
    pub fn new(gpu: &Gpu, budget: u32) -> Pool {
        let ring = (!gpu.device.has_host_visible_vram).then(StagingRing::default);
        Pool {
            pages: Pages::new(budget),
            blocks: Vec::new(),
            ring,
            alive: gpu.memory.alive.child(),
        }
    }

    /// Takes a run of pages; `None` if there is no room. A device error leaves the pool unchanged.
    pub fn take(&mut self, gpu: &mut Gpu, count: u32) -> Result<Option<u32>> {
        let Some(first) = self.pages.take(count) else { return Ok(None) };
        while self.blocks.len() <= (first / PAGES_PER_BLOCK) as usize {
            gpu.destroy_dropped();
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

    /// Sets the budget `[pages]`. A last block that is smaller than others does not grow.
    pub fn set_budget(&mut self, budget: u32) {
        let is_whole = |block: &RawBuffer| block.desc.bytes == BLOCK_BYTES;
        let grows = self.blocks.last().is_none_or(is_whole);
        self.pages.budget = if grows { budget } else { budget.min(self.allocated()) };
    }

    /// Frees blocks beyond the budget of which no page is taken.
    pub fn free_unused(&mut self) {
        while let Some(last) = self.blocks.len().checked_sub(1) {
            let first = last as u32 * PAGES_PER_BLOCK;
            if first < self.pages.budget || !self.pages.is_free_from(first) {
                break;
            }
            self.blocks.pop().into_iter().for_each(RawBuffer::destroy);
        }
    }

    /// Returns the number of pages with memory.
    pub fn allocated(&self) -> u32 {
        self.blocks.iter().map(|block| (block.desc.bytes / PAGE_BYTES) as u32).sum()
    }

    /// Prepares writing to a taken run; returns false if there is no staging space until the device
    /// has copied earlier runs.
    pub fn open(&mut self, gpu: &mut Gpu, first: u32, count: u32) -> Result<bool> {
        self.ring.as_mut().map_or(Ok(true), |ring| ring.open(gpu, first, count))
    }

    /// Returns buffer and first page to which an open run is written.
    fn place(&self, first: u32) -> (usize, u32) {
        match &self.ring {
            Some(ring) => (0, ring.place(first)),
            None => ((first / PAGES_PER_BLOCK) as usize, first % PAGES_PER_BLOCK),
        }
    }

    /// Returns an open run's memory for another thread to write.
    pub fn mapped_range(&self, first: u32, count: u32) -> MappedRange {
        let (block, page) = self.place(first);
        let memory = &self.ring.as_ref().map_or(&self.blocks[..], StagingRing::memory)[block];
        let at = PAGE_BYTES * page as u64;
        memory.mapped_range(at..at + PAGE_BYTES * count as u64, &self.alive)
    }

    /// Closes an open run; its contents are used only if `written`.
    pub fn close(&mut self, first: u32, written: bool) {
        self.ring.iter_mut().for_each(|ring| ring.close(first, written));
    }

    /// Submits the copies of closed runs; later submissions find them in their pages.
    pub fn submit_copies(&mut self, gpu: &mut Gpu) -> Result<()> {
        self.ring.as_mut().map_or(Ok(()), |ring| ring.submit_copies(gpu, &self.blocks))
    }

    /// Has the copies of a submission that was dropped made again ([`Pool::submit_copies`]).
    pub fn copy_again(&mut self, dropped: u64) {
        self.ring.iter_mut().for_each(|ring| ring.copy_again(dropped));
    }

    /// Returns whether copies in flight occupy staging space.
    pub fn has_pending_copies(&self) -> bool {
        self.ring.as_ref().is_some_and(StagingRing::has_pending_copies)
    }

    /// Writes taken runs in parallel, with one job each: all at once if pages are mapped, else as
    /// many at a time as the ring holds. A job gets the words of each page. Returns how many runs
    /// are written: all, unless a host's frames have to be completed first.
    pub fn write<J: Send>(
        &mut self,
        gpu: &mut Gpu,
        runs: Vec<(u32, u32, J)>,
        write: impl Fn(J, Vec<&mut [u32]>) -> Result<()> + Sync,
    ) -> Result<usize> {
        let mut count = 0;
        let mut runs = runs.into_iter().peekable();
        while runs.peek().is_some() {
            let mut opened = Vec::new();
            while let Some(&(first, count, _)) = runs.peek()
                && self.open(gpu, first, count)?
            {
                opened.extend(runs.next());
            }
            let firsts: Vec<u32> = opened.iter().map(|(first, ..)| *first).collect();
            let places: Vec<(usize, u32)> = firsts.iter().map(|&first| self.place(first)).collect();
            let memory: &mut [RawBuffer] =
                self.ring.as_mut().map_or(&mut self.blocks, StagingRing::memory_mut);
            let mut placed: Vec<_> = opened
                .into_iter()
                .zip(places)
                .map(|((_, count, job), place)| (place, count, job))
                .collect();
            placed.sort_unstable_by_key(|(place, ..)| *place);
            let runs = cut_out(
                memory,
                |block| bytemuck::cast_slice_mut(block.bytes_mut()),
                placed.iter().map(|&(place, count, _)| (place, count)),
            );
            let jobs: Vec<_> =
                placed.into_iter().zip(runs).map(|((.., job), run)| (job, run)).collect();
            let written = gpu.workers.run(|| {
                jobs.into_par_iter().try_for_each(|(job, run)| {
                    write(job, run.chunks_exact_mut(POINTS_PER_PAGE as usize).collect())
                })
            });
            firsts.iter().for_each(|&first| self.close(first, written.is_ok()));
            written?;
            count += firsts.len();
            self.submit_copies(gpu)?;
            if self.has_pending_copies() {
                if gpu.host.is_some() {
                    break;
                }
                gpu.wait_detached()?;
            }
        }
        Ok(count)
    }

    /// Returns the words of a run of pages; `None` if pages are not mapped.
    fn mapped(&self, (first, count): (u32, u32)) -> Option<&[u32]> {
        if self.ring.is_some() {
            return None;
        }
        let block = bytemuck::cast_slice(self.blocks[(first / PAGES_PER_BLOCK) as usize].bytes());
        let words = &block[(first % PAGES_PER_BLOCK * POINTS_PER_PAGE) as usize..];
        Some(&words[..(count * POINTS_PER_PAGE) as usize])
    }

    /// Returns the words of runs of pages, borrowed if mapped, else copied by the device.
    pub fn read(&self, gpu: &mut Gpu, runs: &[(u32, u32)]) -> Result<Vec<Cow<'_, [u32]>>> {
        if let Some(words) = runs.iter().map(|&run| self.mapped(run).map(Cow::Borrowed)).collect() {
            return Ok(words);
        }
        let (mut parts, mut bytes) = (BTreeMap::<u32, Vec<[u64; 3]>>::new(), 0);
        for &(first, count) in runs {
            let from = PAGE_BYTES * (first % PAGES_PER_BLOCK) as u64;
            parts.entry(first / PAGES_PER_BLOCK).or_default().push([
                from,
                bytes,
                PAGE_BYTES * count as u64,
            ]);
            bytes += PAGE_BYTES * count as u64;
        }
        let mut g = Graph::new(gpu);
        let mut copy = g.readback("pages read", bytes);
        for (block, parts) in parts {
            let block = g.import("pages", &self.blocks[block as usize]);
            g.copy_parts("read pages", &block, &mut copy, parts);
        }
        let frame = g.submit_and_wait(&[])?;
        let mut words = frame.read::<u32>(&copy);
        let mut next = |count: u32| {
            let (own, rest) = words.split_at((count * POINTS_PER_PAGE) as usize);
            words = rest;
            Cow::Owned(own.to_vec())
        };
        let read = runs.iter().map(|&(_, count)| next(count)).collect();
        Ok(read)
    }

    /// Returns the device address of a page as two words.
    pub fn address(&self, page: u32) -> [u32; 2] {
        let address = self.blocks[(page / PAGES_PER_BLOCK) as usize].address
            + PAGE_BYTES * (page % PAGES_PER_BLOCK) as u64;
        [address as u32, (address >> 32) as u32]
    }

    /// Imports the blocks into a frame; page `p` of a block starts at word `p * points per page`.
    pub fn import(&self, g: &mut Graph) -> Vec<Buffer> {
        self.blocks.iter().map(|block| g.import("pages", block)).collect()
    }
}

impl Drop for Pool {
    /// Keeps other threads from writing, and frees the memory.
    fn drop(&mut self) {
        self.alive.close(|| ());
        let ring = self.ring.take().into_iter().flat_map(StagingRing::into_memory);
        self.blocks.drain(..).chain(ring).for_each(RawBuffer::destroy);
    }
}

/// Splits blocks into the words of disjoint runs, each given by block and first page, in ascending
/// order, so that runs are written in parallel to mapped memory. Takes time in the number of runs,
/// not of blocks.
fn cut_out<'m, B>(
    blocks: &'m mut [B],
    words: impl Fn(&'m mut B) -> &'m mut [u32],
    runs: impl Iterator<Item = ((usize, u32), u32)>,
) -> Vec<&'m mut [u32]> {
    let mut blocks = blocks.iter_mut();
    let (mut next, mut page, mut left): (usize, u32, &mut [u32]) = (0, 0, &mut []);
    let many = |pages: u32| pages as usize * POINTS_PER_PAGE as usize;
    runs.map(|((block, first), count)| {
        if block >= next {
            left = words(blocks.nth(block - next).expect("a page has memory"));
            (next, page) = (block + 1, 0);
        }
        let (run, after) =
            std::mem::take(&mut left)[many(first - page)..].split_at_mut(many(count));
        (page, left) = (first + count, after);
        run
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_cut_out_of_their_blocks_where_they_lie() {
        const PAGE: usize = POINTS_PER_PAGE as usize;
        // Every word holds its page number.
        let block = |block: u32| {
            (0..4 * PAGE).map(|word| 4 * block + (word / PAGE) as u32).collect::<Vec<u32>>()
        };
        let mut blocks: Vec<Vec<u32>> = (0..5).map(block).collect();
        let runs = [((0, 1), 1), ((0, 2), 2), ((3, 0), 1), ((3, 3), 1), ((4, 0), 4)];
        let found = cut_out(&mut blocks, |block| &mut block[..], runs.into_iter());
        for (((block, first), count), words) in runs.into_iter().zip(found) {
            assert_eq!(words.len(), count as usize * PAGE);
            assert!(
                words
                    .iter()
                    .enumerate()
                    .all(|(word, &page)| page == 4 * block as u32 + first + (word / PAGE) as u32)
            );
        }
    }
}
