//! RESIDENT NODE BUFFERS: nodes in, pages that the GPU reads out.
//!
//! A page is one plane of one node: 65,536 words of 32 bits, in a [`pool`] of fixed pages. A small cloud is organised in memory and is
//! resident as a whole ([`Resident::fill`]); the nodes of an index come and go ([`residency`]). Either way [`Resident::nodes`] is what a frame draws from.
//!
//! Shaders reach pages by device address, because storage buffer bindings may end at 128 MiB. A point's id is `number * points per page + i`, where `number`
//! is its node's place among the nodes of the frame. Those are in node order, so ids, and with them ties, depend neither on which thread packed
//! which node, nor on which pages were free when a node arrived.

mod cloud_upload;
mod leaves;
pub mod point_density;
pub mod pool;
pub mod residency;
pub mod slab_query;
mod staging_ring;
pub mod station_overlap;

pub use cloud_upload::{CloudUpload, Partitioner};
pub use point_density::PointDensity;
pub use residency::Residency;
pub use station_overlap::StationOverlap;

use crate::cloud::attribute::DisplayAttribute;
use crate::cloud::histograms::Histograms;
use crate::cloud::{Cloud, Lattice, Station};
use crate::config::{BITS_PER_PLANE, NO_POINT, POINTS_PER_PAGE};
use crate::error::Result;
use crate::graph::{Buffer, Gpu, Graph};
use crate::index;
use crate::index::build::pack::Frame;
use crate::index::format::Axes;
use crate::index::format::Balance;
use crate::index::format::shadow_file::ShadowContents;
use crate::progress::Progress;
use crate::select::clip::{Clips, Left};
use crate::select::opacity::{Known, Opacities};
use crate::view::View;
use glam::DVec3;
use pool::{PAGE_BYTES, Pool};

/// A node whose planes are on the GPU.
#[derive(Clone, Debug)]
pub struct ResidentNode {
    pub lattice: Lattice,
    pub frame: Frame,
    pub count: u32,
    /// Its place among the nodes of the frame.
    pub number: u32,
    /// Its pages lie side by side in one block: position planes from here, coarsest first, then the other words of its points ([`DisplayAttribute::words`]).
    pub first_page: u32,
    /// Position planes that are resident; at least one, and fewer than `frame.planes` where no more are needed, or not yet there.
    pub planes: u32,
    /// How far apart its points are, metres.
    pub spacing: f64,
    /// The one that all of its points are of, where there is one and somebody knows.
    pub station: Option<u32>,
}

impl ResidentNode {
    /// The id of its first point.
    pub fn first_point(&self) -> u32 {
        self.number * POINTS_PER_PAGE
    }

    /// World corners of its box.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let top = [0, 1, 2].map(|axis| self.frame.origin[axis] + self.frame.extent[axis] as i64);
        let (a, b) = (self.lattice.world(self.frame.origin), self.lattice.world(top));
        (a.min(b), a.max(b))
    }
}

/// Numbers that say which node it is ([`Resident::nodes_identity`]).
pub const IDENTITY_WORDS: usize = 15;

/// World corners of the box of a node, by those numbers.
pub fn bounds_of(identity: &[u64]) -> (DVec3, DVec3) {
    let place =
        |at: usize| DVec3::from_array([0, 1, 2].map(|axis| f64::from_bits(identity[at + axis])));
    let lattice = Lattice { step: place(9), offset: place(12) };
    let corner = |k: u64| {
        lattice.world([0, 1, 2].map(|axis| identity[axis] as i64 + (k * identity[3 + axis]) as i64))
    };
    let (a, b) = (corner(0), corner(1));
    (a.min(b), a.max(b))
}

/// A point that somebody asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// World.
    pub position: DVec3,
    /// The position is the file's own, not that of a cell around it.
    pub exact: bool,
    /// As [`crate::cloud::attribute::kind`] packs it, where points bring it.
    pub kind: Option<u32>,
}

/// The pool, and of what is in it, what the frame draws from.
pub struct Resident {
    /// Which of the device's clouds this is, counted.
    serial: u64,
    pool: Pool,
    /// In node order; of these a frame leaves out what its view cannot see.
    pub nodes: Vec<ResidentNode>,
    /// What the points show.
    pub shown: DisplayAttribute,
    /// Of the whole cloud.
    pub points: u64,
    pub stations: Vec<Station>,
    /// As [`Resident::spacing_m`], of a cloud that is there whole.
    spacing_m: Option<f64>,
    /// Of the whole cloud, where they were counted and points bring their kinds.
    pub counts: Option<Histograms>,
    /// What gives all stations one exposure, where colours say which station they are of.
    pub balance: Option<Balance>,
    /// Normals that points have brought say which side of a surface is outside.
    pub oriented: bool,
    /// What strokes are painted in.
    pub axes: Axes,
    /// How opaque its points are; what hides some by their kind needs them to bring it.
    pub opacities: Opacities,
    /// Of an index, whose nodes come and go.
    pub comes_and_goes: bool,
    /// Of which light points say how much reaches them, where they have brought that.
    pub light: Option<Box<ShadowContents>>,
    /// Which part of it is there.
    pub clips: Clips,
}

/// A length in cells of the coarsest plane, in metres; where a lattice has other steps along other axes, along the widest.
fn in_metres(cells: f64, lattice: &Lattice, frame: &Frame) -> f64 {
    cells * crate::select::lod::cell_steps(frame, 1) * lattice.step.abs().max_element()
}

/// Of a node's words, in the middle of the cell that the resident planes tell; the position itself where all of them are resident.
fn position(node: &ResidentNode, words: &[u32], i: u32) -> DVec3 {
    let Frame { origin, bits, planes, .. } = node.frame;
    let cells = (0..node.planes).fold([0u64; 3], |cells, plane| {
        let word = words[(plane * POINTS_PER_PAGE + i) as usize];
        [0, 1, 2].map(|axis| {
            cells[axis] << BITS_PER_PLANE
                | (word >> (BITS_PER_PLANE * axis as u32) & ((1 << BITS_PER_PLANE) - 1)) as u64
        })
    });
    let (missing, pad) = (BITS_PER_PLANE * (planes - node.planes), BITS_PER_PLANE * planes - bits);
    let middle = (1u64 << missing) >> 1;
    node.lattice.world(
        [0, 1, 2].map(|axis| origin[axis] + (((cells[axis] << missing) + middle) >> pad) as i64),
    )
}

/// Ids end before the one that means "no point".
const MOST_NODES: u64 = NO_POINT as u64 / POINTS_PER_PAGE as u64;

impl Resident {
    /// Whether some points of nodes that are drawn may not be there, by what they are or by where they lie.
    pub fn leaves_out(&self) -> bool {
        self.opacities.hides(&self.known()) || self.clips.active() > 0
    }

    /// Organises the cloud and puts all of it into pages. The columns of each part are dropped as soon as its nodes are packed.
    pub fn fill(
        gpu: &mut Gpu,
        cloud: Cloud,
        shown: DisplayAttribute,
        progress: &dyn Progress,
    ) -> Result<Resident> {
        Resident::arrange(gpu, cloud, shown, index::partition, progress)
    }

    /// The same with another way of organising than the Morton order; for benchmarks.
    pub fn arrange(
        gpu: &mut Gpu,
        cloud: Cloud,
        shown: DisplayAttribute,
        partitioner: Partitioner,
        progress: &dyn Progress,
    ) -> Result<Resident> {
        let mut upload = CloudUpload::new(cloud, shown, None);
        let mut fill = || {
            while upload.build_nodes(partitioner, progress)? {
                upload.upload_nodes(gpu, usize::MAX, progress)?;
            }
            Ok(())
        };
        match fill() {
            Ok(()) => Ok(upload.finish(gpu)),
            Err(error) => {
                upload.free(gpu);
                Err(error)
            }
        }
    }

    /// What is known of the points that rules about them may name.
    pub fn known(&self) -> Known<'_> {
        Known { stations: &self.stations, points: self.points, counts: self.counts.as_ref() }
    }

    /// Whether some points let through what is behind them.
    pub fn is_transparent(&self) -> bool {
        self.opacities.is_transparent(&self.known())
    }

    /// Whether some points are left out by how opaque they are.
    pub fn hides(&self) -> bool {
        self.opacities.hides(&self.known())
    }

    /// World positions of all points of a small cloud, decoded from the pages, in the order of their ids.
    pub fn positions(&self, gpu: &mut Gpu) -> Result<Vec<DVec3>> {
        let mut positions = Vec::new();
        self.look_at(gpu, &self.nodes.iter().collect::<Vec<_>>(), |node, words| {
            positions.extend((0..node.count).map(|i| position(node, words, i)));
        })?;
        Ok(positions)
    }

    /// The pages of some nodes, one node after another.
    fn look_at(
        &self,
        gpu: &mut Gpu,
        nodes: &[&ResidentNode],
        mut look: impl FnMut(&ResidentNode, &[u32]),
    ) -> Result<()> {
        /// At once, so that copies of them stay small.
        const NODES: usize = 16;
        for nodes in nodes.chunks(NODES) {
            let runs: Vec<_> = nodes
                .iter()
                .map(|node| (node.first_page, node.planes + self.shown.words()))
                .collect();
            let words = self.pool.read(gpu, &runs)?;
            nodes.iter().zip(&words).for_each(|(node, words)| look(node, words));
        }
        Ok(())
    }

    /// The point of an id, as far as what is resident tells.
    pub fn point(&self, gpu: &mut Gpu, id: u32) -> Result<Option<Point>> {
        let (number, i) = (id / POINTS_PER_PAGE, id % POINTS_PER_PAGE);
        let Some(node) = self.nodes.get(number as usize).filter(|node| i < node.count) else {
            return Ok(None);
        };
        let mut found = None;
        self.look_at(gpu, &[node], |node, words| found = Some(self.point_of(node, words, i)))?;
        Ok(found)
    }

    fn point_of(&self, node: &ResidentNode, words: &[u32], i: u32) -> Point {
        let word = |further: u32| words[((node.planes + further) * POINTS_PER_PAGE + i) as usize];
        Point {
            position: position(node, words, i),
            exact: node.planes == node.frame.planes,
            kind: self.shown.kind().map(word),
        }
    }

    /// Handles of the pool's blocks for one frame.
    pub fn import(&self, g: &mut Graph) -> Vec<Buffer> {
        self.pool.import(g)
    }

    /// For every node by its number, the address of the page with this word of its points ([`DisplayAttribute::words`]).
    pub fn addresses(&self, word: u32) -> Vec<[u32; 2]> {
        let addresses =
            self.nodes.iter().map(|node| self.pool.address(node.first_page + node.planes + word));
        addresses.chain(self.nodes.is_empty().then_some([0; 2])).collect()
    }

    /// For every node by its number, the address of its first page, and how many of its pages are position planes.
    pub fn homes(&self) -> Vec<([u32; 2], u32)> {
        self.nodes
            .iter()
            .map(|node| (self.pool.address(node.first_page), node.planes))
            .chain(self.nodes.is_empty().then_some(([0; 2], 0)))
            .collect()
    }

    /// How far apart points are, metres: that of the cloud ([`crate::cloud::spacing`]), or where nodes come and go of the points that are there, in
    /// the node that the middle one is in, from dense nodes to sparse ones; 0 where there are none.
    pub fn spacing_m(&self) -> f64 {
        if let Some(spacing_m) = self.spacing_m {
            return spacing_m;
        }
        point_density::weighted_median(
            self.nodes.iter().map(|node| (node.spacing, node.count as u64)).collect(),
        )
    }

    /// Nodes of which the view can see something, with the least and the greatest depth of each.
    pub fn seen<'r>(
        &'r self,
        view: &'r View,
    ) -> impl Iterator<Item = ((f64, f64), &'r ResidentNode)> {
        self.seen_of(self.nodes.iter(), view)
    }

    /// The same of some of the nodes.
    pub fn seen_of<'r>(
        &'r self,
        nodes: impl Iterator<Item = &'r ResidentNode>,
        view: &'r View,
    ) -> impl Iterator<Item = ((f64, f64), &'r ResidentNode)> {
        let is_left = |node: &&ResidentNode| self.clips.left(node.bounds()) != Left::Nothing;
        nodes.filter(is_left).filter_map(|node| Some((view.depths(node.bounds())?, node)))
    }

    /// What is drawn, in numbers: the same ones only where a frame draws the same points under the same ids.
    pub fn identity(&self) -> Vec<u64> {
        self.cloud_identity().into_iter().chain(self.nodes_identity()).collect()
    }

    /// Of every node, in numbers of which each has as many: the same ones only where it has the same points.
    pub fn nodes_identity(&self) -> Vec<u64> {
        let node = |node: &ResidentNode| {
            let Frame { origin, extent, .. } = node.frame;
            let lattice = [node.lattice.step, node.lattice.offset]
                .map(|place| place.to_array().map(f64::to_bits))
                .concat();
            let counts = [node.count as u64, node.planes as u64, node.spacing.to_bits()];
            [origin.map(|steps| steps as u64), extent.map(|steps| steps as u64), counts]
                .concat()
                .into_iter()
                .chain(lattice)
        };
        self.nodes.iter().flat_map(node).collect()
    }

    /// What points are drawn, and which of them are left out, but for the nodes: as [`Resident::identity`].
    pub fn cloud_identity(&self) -> Vec<u64> {
        // Of opacities, which points are left out.
        let factors = self.opacities.table(&self.stations).into_iter().enumerate();
        let left_out: Vec<u64> =
            factors.filter(|(_, factor)| *factor == 0.0).map(|(number, _)| number as u64).collect();
        let counts = [self.serial, left_out.len() as u64, self.clips.active() as u64];
        counts.into_iter().chain(left_out).chain(self.clips.identity()).collect()
    }

    /// Bytes of the pages in use.
    pub fn bytes(&self) -> u64 {
        PAGE_BYTES * self.pool.pages.used as u64
    }

    /// Gives the pool's memory back.
    pub fn free(self, gpu: &mut Gpu) {
        self.pool.free(gpu);
    }
}
