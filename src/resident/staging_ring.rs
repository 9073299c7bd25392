//! Staging ring: the CPU writes pages of a pool that it cannot map here, and the device copies them
//! to their places.
//!
//! - open: reserves consecutive slots for a run of pages
//! - close: ends writing; what was written waits for the next submission
//! - submit_copies: one submission copies all waiting runs. Frames follow in the same queue, so
//!   that they find the pages written, and nothing waits
//!
//! Slots are free again when the device has completed that submission. There are twice as many as
//! the loader may have in flight, so that it writes while the device copies.

use super::pages::{PAGE_BYTES, Pages};
use crate::config::{PAGES_PER_BLOCK, UPLOAD_BYTES};
use crate::error::Result;
use crate::gpu::memory::RawBuffer;
use crate::gpu::{BufferDesc, Place};
use crate::graph::{Gpu, Graph, Handle};
use std::collections::{BTreeMap, HashMap};

const SLOTS: u32 = (2 * UPLOAD_BYTES / PAGE_BYTES) as u32;

/// Consecutive slots, and the first page they are for.
#[derive(Clone, Copy)]
struct Run {
    page: u32,
    slot: u32,
    count: u32,
}

pub struct StagingRing {
    slots: Pages,
    /// One buffer, created at the first write.
    memory: Vec<RawBuffer>,
    /// Open runs by their first page.
    open: HashMap<u32, Run>,
    written: Vec<Run>,
    /// Runs being copied, with their submission.
    landing: Vec<(Run, u64)>,
}

impl Default for StagingRing {
    fn default() -> StagingRing {
        StagingRing {
            slots: Pages::new(SLOTS),
            memory: Vec::new(),
            open: HashMap::new(),
            written: Vec::new(),
            landing: Vec::new(),
        }
    }
}

impl StagingRing {
    pub fn open(&mut self, gpu: &mut Gpu, page: u32, count: u32) -> Result<bool> {
        if self.memory.is_empty() {
            let desc = BufferDesc { bytes: PAGE_BYTES * SLOTS as u64, place: Place::Upload };
            self.memory.push(gpu.memory.buffer(&gpu.device, desc, "ring")?);
        }
        if self.has_pending_copies() {
            let passed = gpu.completed()?;
            self.landing.retain(|(run, submission)| {
                let landed = *submission <= passed;
                if landed {
                    self.slots.give(run.slot, run.count);
                }
                !landed
            });
        }
        let slot = self.slots.take(count);
        self.open.extend(slot.map(|slot| (page, Run { page, slot, count })));
        Ok(slot.is_some())
    }

    /// Returns the first slot of an open run.
    pub fn place(&self, page: u32) -> u32 {
        self.open[&page].slot
    }

    /// Returns the buffer of the slots.
    pub fn memory(&self) -> &[RawBuffer] {
        &self.memory
    }

    pub fn memory_mut(&mut self) -> &mut [RawBuffer] {
        &mut self.memory
    }

    pub fn close(&mut self, page: u32, written: bool) {
        let run = self.open.remove(&page).expect("closed once, after it was opened");
        if written {
            self.written.push(run);
        } else {
            self.slots.give(run.slot, run.count);
        }
    }

    /// Submits copies of all closed runs to their pages in `blocks`.
    pub fn submit_copies(&mut self, gpu: &mut Gpu, blocks: &[RawBuffer]) -> Result<()> {
        if self.written.is_empty() {
            return Ok(());
        }
        let mut parts = BTreeMap::<u32, Vec<[u64; 3]>>::new();
        for run in &self.written {
            let [from, to, bytes] = [run.slot, run.page % PAGES_PER_BLOCK, run.count]
                .map(|pages| PAGE_BYTES * pages as u64);
            parts.entry(run.page / PAGES_PER_BLOCK).or_default().push([from, to, bytes]);
        }
        let mut g = Graph::new(gpu);
        let ring = g.import("ring", &self.memory[0]);
        let mut reached = Vec::new();
        for (block, parts) in parts {
            let mut block = g.import("pages", &blocks[block as usize]);
            g.copy_parts("land pages", &ring, &mut block, parts);
            reached.push(block.resource());
        }
        let submission = g.submit_detached(&reached)?;
        self.landing.extend(self.written.drain(..).map(|run| (run, submission)));
        Ok(())
    }

    /// Has the copies of a submission that was dropped made again by the next one.
    pub fn copy_again(&mut self, dropped: u64) {
        let lost = self.landing.extract_if(.., |(_, submission)| *submission == dropped);
        self.written.extend(lost.map(|(run, _)| run));
    }

    pub fn has_pending_copies(&self) -> bool {
        !self.landing.is_empty()
    }

    pub fn into_memory(self) -> Vec<RawBuffer> {
        self.memory
    }
}
