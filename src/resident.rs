//! RESIDENT NODE BUFFERS: organised points in, pages that the GPU reads out.
//!
//! One pool of fixed pages, persistently mapped. A page is one plane of one node: 65,536 words of 32 bits. Shaders reach pages by device address, because
//! storage buffer bindings may end at 128 MiB. A point's id is `page * points per page + i`, where `page` is that of its coarsest position plane.
//! A node's pages are given in node order, so that ids, and with them ties, do not depend on which thread packed which node.

use crate::cloud::attribute::Shown;
use crate::cloud::{Cloud, Columns, Lattice};
use crate::config::{BITS_PER_PLANE, NO_POINT, PAGES_PER_BLOCK, POINTS_PER_PAGE};
use crate::error::{Error, Result};
use crate::gpu::memory::RawBuffer;
use crate::gpu::{BufferDesc, Place};
use crate::graph::{Buffer, Gpu, Graph};
use crate::index::pack::{self, Frame};
use crate::index::{self, Organised};
use crate::progress::Progress;
use glam::DVec3;
use rayon::prelude::*;

/// A node whose planes are on the GPU.
#[derive(Clone, Debug)]
pub struct ResidentNode {
    pub lattice: Lattice,
    pub frame: Frame,
    pub count: u32,
    /// Its pages lie side by side in one block: position planes from here, coarsest first, then what its points show.
    pub first_page: u32,
}

impl ResidentNode {
    /// The id of its first point.
    pub fn first_point(&self) -> u32 {
        self.first_page * POINTS_PER_PAGE
    }

    /// World corners of its box.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let top = [0, 1, 2].map(|axis| self.frame.origin[axis] + self.frame.extent[axis] as i64);
        let (a, b) = (self.lattice.world(self.frame.origin), self.lattice.world(top));
        (a.min(b), a.max(b))
    }
}

/// The pool and what is in it.
pub struct Resident {
    blocks: Vec<RawBuffer>,
    pub nodes: Vec<ResidentNode>,
    /// What the points show.
    pub shown: Shown,
    pub points: u64,
    pages: u32,
}

impl Resident {
    /// Organises the cloud and puts all of it into pages. The columns of each part are dropped as soon as its nodes are packed.
    pub fn fill(gpu: &mut Gpu, cloud: Cloud, shown: Shown, progress: &dyn Progress) -> Result<Resident> {
        Resident::arrange(gpu, cloud, shown, index::organise, progress)
    }

    /// The same with another way of organising than the Morton order; for benchmarks.
    pub fn arrange(
        gpu: &mut Gpu,
        cloud: Cloud,
        shown: Shown,
        organise: impl Fn(&Columns) -> Organised,
        progress: &dyn Progress,
    ) -> Result<Resident> {
        let mut resident = Resident { blocks: Vec::new(), nodes: Vec::new(), shown, points: 0, pages: 0 };
        let total = cloud.len();
        let mut parts = cloud.parts;
        parts.iter_mut().for_each(|part| part.columns.keep(shown.attribute.wanted()));
        for part in parts {
            progress.tick("organising", resident.points, total)?;
            let organised = organise(&part.columns);
            resident.add(gpu, &part, &organised, total, progress)?;
        }
        Ok(resident)
    }

    fn add(&mut self, gpu: &mut Gpu, part: &crate::cloud::Part, organised: &Organised, total: u64, progress: &dyn Progress) -> Result<()> {
        let shown = self.shown;
        let frames: Vec<Frame> =
            organised.nodes.par_iter().map(|node| pack::frame(&part.columns, &organised.order[node.points.clone()])).collect();
        let first = self.nodes.len();
        for (node, &frame) in organised.nodes.iter().zip(&frames) {
            let first_page = self.take_pages(frame.planes + 1);
            self.nodes.push(ResidentNode { lattice: part.lattice, frame, count: node.points.len() as u32, first_page });
        }
        // The last page's points would run into the id that means "no point".
        if self.pages as u64 * POINTS_PER_PAGE as u64 > NO_POINT as u64 {
            return Err(Error::Request(format!("{total} points are more than the 4,294,901,760 that can be resident at once")));
        }
        while self.blocks.len() < self.pages.div_ceil(PAGES_PER_BLOCK) as usize {
            let desc = BufferDesc { bytes: 4 * PAGES_PER_BLOCK as u64 * POINTS_PER_PAGE as u64, place: Place::Upload };
            let name = format!("pages {}", self.blocks.len());
            self.blocks.push(gpu.memory.buffer(&gpu.device, desc, &name)?);
        }

        // Disjoint mutable pages for every node, so that nodes are packed in parallel straight into the mapped memory.
        let mut pages: Vec<Option<&mut [u32]>> = self
            .blocks
            .iter_mut()
            .flat_map(|block| bytemuck::cast_slice_mut::<u8, u32>(block.bytes_mut()).chunks_exact_mut(POINTS_PER_PAGE as usize).map(Some))
            .collect();
        let mut take = |page: u32| pages[page as usize].take().expect("a page belongs to one plane of one node");
        let jobs: Vec<_> = self.nodes[first..]
            .iter()
            .zip(&organised.nodes)
            .map(|(node, range)| {
                let planes: Vec<&mut [u32]> = (0..node.frame.planes).map(|plane| take(node.first_page + plane)).collect();
                (node, range, planes, take(node.first_page + node.frame.planes))
            })
            .collect();
        let done = std::sync::atomic::AtomicU64::new(self.points);
        jobs.into_par_iter().try_for_each(|(node, range, mut planes, shown_page)| {
            let order = &organised.order[range.points.clone()];
            pack::pack(&part.columns, &node.frame, order, organised.arrangement, |i| shown.word(part, i), &mut planes, shown_page);
            let done = done.fetch_add(order.len() as u64, std::sync::atomic::Ordering::Relaxed);
            progress.tick("organising", done, total)
        })?;
        self.points += organised.order.len() as u64;
        Ok(())
    }

    /// Pages side by side, all in one block.
    fn take_pages(&mut self, count: u32) -> u32 {
        if self.pages % PAGES_PER_BLOCK + count > PAGES_PER_BLOCK {
            self.pages = self.pages.next_multiple_of(PAGES_PER_BLOCK);
        }
        self.pages += count;
        self.pages - count
    }

    /// World positions of all points, decoded from the pages, in the order of their ids.
    pub fn positions(&self) -> impl Iterator<Item = DVec3> + '_ {
        self.nodes.iter().flat_map(move |node| {
            let Frame { origin, bits, planes, .. } = node.frame;
            let pad = BITS_PER_PLANE * planes - bits;
            let block = &self.blocks[(node.first_page / PAGES_PER_BLOCK) as usize];
            let first = (node.first_page % PAGES_PER_BLOCK * POINTS_PER_PAGE) as usize;
            let words: &[u32] = &bytemuck::cast_slice(block.bytes())[first..];
            (0..node.count as usize).map(move |i| {
                let cells = (0..planes as usize).fold([0u32; 3], |cells, plane| {
                    let word = words[plane * POINTS_PER_PAGE as usize + i];
                    [0, 1, 2]
                        .map(|axis| cells[axis] << BITS_PER_PLANE | word >> (BITS_PER_PLANE * axis as u32) & ((1 << BITS_PER_PLANE) - 1))
                });
                node.lattice.world([0, 1, 2].map(|axis| origin[axis] + (cells[axis] >> pad) as i64))
            })
        })
    }

    /// Handles of the pool's blocks for one frame; a block's page `p` starts at word `p * points per page`.
    pub fn import(&self, g: &mut Graph) -> Vec<Buffer> {
        self.blocks.iter().map(|block| g.import("pages", block)).collect()
    }

    /// Device address of a page, as the two words that a shader makes a pointer of.
    fn address(&self, page: u32) -> [u32; 2] {
        let offset = 4 * POINTS_PER_PAGE as u64 * (page % PAGES_PER_BLOCK) as u64;
        let address = self.blocks[(page / PAGES_PER_BLOCK) as usize].address + offset;
        [address as u32, (address >> 32) as u32]
    }

    /// For every page that starts point ids, the address of the page that says what those points show.
    pub fn shown_pages(&self) -> Vec<[u32; 2]> {
        let mut addresses = vec![[0; 2]; self.pages.max(1) as usize];
        for node in &self.nodes {
            addresses[node.first_page as usize] = self.address(node.first_page + node.frame.planes);
        }
        addresses
    }

    /// Bytes of the pages in use.
    pub fn bytes(&self) -> u64 {
        4 * POINTS_PER_PAGE as u64 * self.pages as u64
    }

    /// Gives the pool's memory back.
    pub fn free(self, gpu: &mut Gpu) {
        self.blocks.into_iter().for_each(|block| gpu.memory.destroy_buffer(block));
    }
}
