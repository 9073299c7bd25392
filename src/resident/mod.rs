//! Nodes of a cloud in GPU memory.
//!
//! A page holds one plane of one node: 65,536 words of 32 bits, in a [`pool`] of equal pages. A
//! small cloud is partitioned in memory and is resident as a whole ([`Resident::fill`]); nodes of
//! an index are streamed ([`streaming`]). Either way frames draw from [`Resident::nodes`].
//!
//! Shaders address pages by pointer, because storage buffer bindings may end at 128 MiB. A point's
//! id is `number * points per page + i`, where `number` is the index of its node in the frame.
//! Nodes are in node order, so that ids, and with them ties, depend neither on the thread that
//! packed a node nor on the pages that were free.

mod cloud_upload;
mod leaves;
pub mod pages;
pub mod point_density;
pub mod pool;
pub mod slab_query;
mod staging_ring;
pub mod station_overlap;
pub mod streaming;

pub use cloud_upload::CloudUpload;
pub use point_density::PointDensity;
pub use station_overlap::StationOverlap;
pub use streaming::Residency;

use crate::cloud::attribute::DisplayAttribute;
use crate::cloud::colormap::color_of;
use crate::cloud::crs::Unit;
use crate::cloud::histograms::Histograms;
use crate::cloud::{Cloud, Lattice, Station};
use crate::config::{BITS_PER_PLANE, NO_POINT, POINTS_PER_PAGE};
use crate::error::Result;
use crate::graph::{Buffer, Gpu, Graph};
use crate::index::Arrangement;
use crate::index::build::pack::Frame;
use crate::index::format::Axes;
use crate::index::format::Balance;
use crate::index::format::scatter::{Clump, POINTS_PER_CLUMP};
use crate::index::format::shadow_file::ShadowContents;
use crate::progress::Progress;
use crate::select::clip::{Clips, Left};
use crate::select::opacity::{Known, Opacities};
use crate::view::View;
use crate::view::linear_map::LinearMap;
use glam::DVec3;
use pages::PAGE_BYTES;
use pool::Pool;
use std::sync::Arc;

/// A node in GPU memory.
#[derive(Clone, Debug)]
pub struct ResidentNode {
    pub lattice: Lattice,
    pub frame: Frame,
    pub count: u32,
    /// Index among the nodes of the frame.
    pub number: u32,
    /// First of its consecutive pages in one block: position planes, coarsest first, then the
    /// attribute words of its points ([`DisplayAttribute::words`]).
    pub first_page: u32,
    /// Resident position planes, at least one; fewer than `frame.planes` if no more are needed, or
    /// not yet loaded.
    pub planes: u32,
    /// Point spacing in the cloud's own coordinates `[m]`; see [`ResidentNode::spacing`].
    pub own_spacing: f64,
    /// Linear map of its places.
    pub map: LinearMap,
    /// How its points lie, clump by clump.
    pub clumps: Arc<[Clump]>,
    /// Station of all its points, if it is one and known.
    pub station: Option<u32>,
}

impl ResidentNode {
    /// Returns the id of its first point.
    pub fn first_point(&self) -> u32 {
        self.number * POINTS_PER_PAGE
    }

    /// Returns the corners of its box, in the coordinates of views.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        self.map.bounds(self.own_bounds())
    }

    /// Returns its point spacing, in the coordinates of views `[m]`.
    pub fn spacing(&self) -> f64 {
        self.own_spacing * self.spread()
    }

    /// Returns by what factor points lie farther apart in the coordinates of views.
    pub fn spread(&self) -> f64 {
        let (min, max) = self.own_bounds();
        self.map.spread(max - min)
    }

    /// Returns the corners of its box, in the cloud's own coordinates.
    pub fn own_bounds(&self) -> (DVec3, DVec3) {
        let top = [0, 1, 2].map(|axis| self.frame.origin[axis] + self.frame.extent[axis] as i64);
        let (a, b) = (self.lattice.world(self.frame.origin), self.lattice.world(top));
        (a.min(b), a.max(b))
    }

    /// Returns its clumps with their numbers of points and their boxes, in the cloud's own
    /// coordinates.
    pub fn boxed_clumps(&self) -> impl Iterator<Item = (&Clump, u64, (DVec3, DVec3))> {
        let (origin, cell) = (self.lattice.world(self.frame.origin), self.clump_cell());
        (0..).zip(self.clumps.iter()).map(move |(k, clump)| {
            let (least, most) = clump.bounds();
            let (a, b) = (origin + least * cell, origin + most * cell);
            let left = (self.count as u64).saturating_sub(k * POINTS_PER_CLUMP as u64);
            (clump, left.min(POINTS_PER_CLUMP as u64), (a.min(b), a.max(b)))
        })
    }

    /// Returns the sides of the cells that clumps are measured in `[m]`.
    fn clump_cell(&self) -> DVec3 {
        self.lattice.step * crate::select::lod::cell_steps(&self.frame, 1)
    }

    /// Returns beyond which edges of a window its points may lie: left, right, upper, lower.
    pub fn crosses(&self, view: &View) -> [bool; 4] {
        let (origin, cell) = (self.lattice.world(self.frame.origin), self.clump_cell());
        let clump = |clump: &Clump| {
            view.crossed(|normal| {
                let normal = self.map.pulled(normal);
                origin.dot(normal) + clump.reach_along(normal * cell)
            })
        };
        let by_box = self.box_crosses(view, self.own_bounds());
        match by_box.contains(&true) {
            true => self.clumps.iter().map(clump).fold([false; 4], either),
            false => by_box,
        }
    }

    /// Returns beyond which edges of a window a box in the cloud's own coordinates reaches.
    fn box_crosses(&self, view: &View, (min, max): (DVec3, DVec3)) -> [bool; 4] {
        view.crossed(|normal| {
            let normal = self.map.pulled(normal);
            (min * normal).max(max * normal).element_sum()
        })
    }
}

fn either(a: [bool; 4], b: [bool; 4]) -> [bool; 4] {
    [0, 1, 2, 3].map(|k| a[k] || b[k])
}

/// Words per node in [`Resident::nodes_identity`].
pub const IDENTITY_WORDS: usize = 15;

/// Returns the corners of a node's box, in the cloud's own coordinates, from its identity.
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

/// A point that was looked up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// World coordinates.
    pub position: DVec3,
    /// True if the position is the file's own, not the centre of a cell.
    pub exact: bool,
    /// Colour without shading, 8-bit sRGB.
    pub color: [u8; 3],
    /// Displayed number ([`DisplayAttribute::number`]).
    pub value: Option<f64>,
    /// Kind as packed by [`crate::cloud::attribute::kind`], if points have it.
    pub kind: Option<u32>,
}

/// The page pool, and the nodes that the frame draws.
pub struct Resident {
    /// Number of this cloud on the device.
    serial: u64,
    pool: Pool,
    /// Nodes in node order; frames cull those outside the view.
    pub nodes: Vec<ResidentNode>,
    /// Attribute that the points show.
    pub shown: DisplayAttribute,
    /// Points of the whole cloud.
    pub points: u64,
    pub stations: Vec<Station>,
    /// Spacing of a cloud that is resident as a whole, in its own coordinates `[m]`.
    spacing_m: Option<f64>,
    /// Histograms of the whole cloud, if they were computed and points have kinds.
    pub counts: Option<Histograms>,
    /// Exposure gains of the stations, if colours carry station codes.
    pub balance: Option<Balance>,
    /// True if the points' normals are oriented outwards.
    pub oriented: bool,
    /// Axes in which strokes are painted.
    pub axes: Axes,
    /// True if a filter leaves out points of nodes ([`crate::index::format::Index::filter`]).
    pub filtered: bool,
    /// Opacities by kind; hiding by kind needs points that have it.
    pub opacities: Opacities,
    /// True if nodes are streamed from an index.
    pub comes_and_goes: bool,
    /// Light of the saved shadows, if points have them.
    light: Option<Box<ShadowContents>>,
    /// Clip boxes, in the cloud's own coordinates.
    pub clips: Clips,
    /// Linear map of the cloud's places.
    map: LinearMap,
    /// Unit of the cloud's own coordinates.
    unit: Unit,
}

/// Converts a length in cells of the coarsest plane to metres, along the widest lattice step.
fn in_metres(cells: f64, lattice: &Lattice, frame: &Frame) -> f64 {
    cells * crate::select::lod::cell_steps(frame, 1) * lattice.step.abs().max_element()
}

/// Decodes a position from the words of its resident planes: the centre of the cell that they tell,
/// or the exact position if all are resident.
fn position(node: &ResidentNode, word: impl Fn(u32) -> u32) -> DVec3 {
    let Frame { origin, bits, planes, .. } = node.frame;
    let cells = (0..node.planes).fold([0u64; 3], |cells, plane| {
        let word = word(plane);
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

/// Returns the words of a point from those of the pages of its node, page by page.
fn word_of(words: &[u32], i: u32) -> impl Fn(u32) -> u32 {
    move |page| words[(page * POINTS_PER_PAGE + i) as usize]
}

/// Ids end before the one that means "no point".
const MOST_NODES: u64 = NO_POINT as u64 / POINTS_PER_PAGE as u64;

impl Resident {
    /// Returns whether points of drawn nodes may be hidden, by kind or by clip boxes.
    pub fn leaves_out(&self) -> bool {
        self.hides() || self.clips.active() > 0
    }

    /// Partitions the cloud and uploads all of it. The columns of each part are dropped as soon as
    /// its nodes are packed.
    pub fn fill(
        gpu: &mut Gpu,
        cloud: Cloud,
        shown: DisplayAttribute,
        progress: &dyn Progress,
    ) -> Result<Resident> {
        Resident::arrange(gpu, cloud, shown, Arrangement::Morton, progress)
    }

    /// Fills with another arrangement than Morton order; for benchmarks.
    pub fn arrange(
        gpu: &mut Gpu,
        cloud: Cloud,
        shown: DisplayAttribute,
        arrangement: Arrangement,
        progress: &dyn Progress,
    ) -> Result<Resident> {
        let mut upload = CloudUpload::new(cloud, shown, None);
        while upload.build_nodes(arrangement, progress)? {
            upload.upload_nodes(gpu, usize::MAX, &mut { u64::MAX }, progress)?;
        }
        Ok(upload.finish(gpu))
    }

    /// Returns how many metres a unit of the coordinates of views is. A world that the cloud is
    /// mapped into has metres.
    pub fn unit_m(&self) -> f64 {
        if self.map == LinearMap::default() { self.unit.metres } else { 1.0 }
    }

    /// Returns what rules about points may refer to.
    pub fn known(&self) -> Known<'_> {
        Known { stations: &self.stations, points: self.points, counts: self.counts.as_ref() }
    }

    /// Returns whether some points are transparent.
    pub fn is_transparent(&self) -> bool {
        self.opacities.is_transparent(&self.known())
    }

    /// Returns whether opacities or a filter hide some points.
    pub fn hides(&self) -> bool {
        self.filtered || self.opacities.hides(&self.known())
    }

    /// Returns the world positions of all points of a small cloud, decoded from the pages, in id
    /// order.
    pub fn positions(&self, gpu: &mut Gpu) -> Result<Vec<DVec3>> {
        let mut positions = Vec::new();
        self.look_at(gpu, &self.nodes.iter().collect::<Vec<_>>(), |node, words| {
            positions.extend((0..node.count).map(|i| position(node, word_of(words, i))));
        })?;
        Ok(positions)
    }

    /// Visits the pages of some nodes.
    fn look_at(
        &self,
        gpu: &mut Gpu,
        nodes: &[&ResidentNode],
        mut look: impl FnMut(&ResidentNode, &[u32]),
    ) -> Result<()> {
        /// Nodes read at once, so that copies stay small.
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

    /// Returns the point of an id, as far as resident planes tell.
    pub fn point(&self, gpu: &mut Gpu, id: u32) -> Result<Option<Point>> {
        let (number, i) = (id / POINTS_PER_PAGE, id % POINTS_PER_PAGE);
        let Some(node) = self.nodes.get(number as usize).filter(|node| i < node.count) else {
            return Ok(None);
        };
        let mut found = None;
        self.look_at(gpu, &[node], |node, words| {
            found = Some(self.point_of(node, word_of(words, i)))
        })?;
        Ok(found)
    }

    /// Returns the point of an id among nodes of an earlier frame from its words: position planes
    /// and attributes, as in its pages.
    pub fn point_of_nodes(&self, nodes: &[ResidentNode], id: u32, words: &[u32]) -> Option<Point> {
        let (number, i) = (id / POINTS_PER_PAGE, id % POINTS_PER_PAGE);
        let node = nodes.get(number as usize).filter(|node| i < node.count)?;
        Some(self.point_of(node, |page| words[page as usize]))
    }

    fn point_of(&self, node: &ResidentNode, word: impl Fn(u32) -> u32) -> Point {
        let attribute = |further: u32| word(node.planes + further);
        Point {
            position: position(node, &word),
            exact: node.planes == node.frame.planes,
            color: color_of(&self.shown, attribute(0)),
            value: self.shown.number(attribute(0)),
            kind: self.shown.kind().map(attribute),
        }
    }

    /// Returns its pages.
    pub fn pool_mut(&mut self) -> &mut Pool {
        &mut self.pool
    }

    /// Imports the pool's blocks into a frame.
    pub fn import(&self, g: &mut Graph) -> Vec<Buffer> {
        self.pool.import(g)
    }

    /// Returns, per node, the address of the page with this word of its points
    /// ([`DisplayAttribute::words`]).
    pub fn addresses(&self, word: u32) -> Vec<[u32; 2]> {
        let addresses =
            self.nodes.iter().map(|node| self.pool.address(node.first_page + node.planes + word));
        addresses.chain(self.nodes.is_empty().then_some([0; 2])).collect()
    }

    /// Returns, per node, the address of its first page and the number of its position planes.
    pub fn homes(&self) -> Vec<([u32; 2], u32)> {
        self.nodes
            .iter()
            .map(|node| (self.pool.address(node.first_page), node.planes))
            .chain(self.nodes.is_empty().then_some(([0; 2], 0)))
            .collect()
    }

    /// Returns the point spacing `[m]`: that of the cloud ([`crate::cloud::spacing`]), or for
    /// streamed nodes the weighted median of the resident nodes; 0 if there are none.
    pub fn spacing_m(&self) -> f64 {
        if let Some(spacing_m) = self.spacing_m {
            let all = self.nodes.iter().map(ResidentNode::own_bounds);
            let all = all.reduce(|(a, b), (c, d)| (a.min(c), b.max(d)));
            return all.map_or(spacing_m, |(min, max)| spacing_m * self.map.spread(max - min));
        }
        self.spacing_of_share(0.5)
    }

    /// Returns the spacing that this share of the points of resident nodes does not exceed `[m]`.
    pub fn spacing_of_share(&self, share: f64) -> f64 {
        let nodes = self.nodes.iter().map(|node| (node.spacing(), node.count as f64));
        point_density::weighted_quantile(nodes.collect(), share)
    }

    /// Returns what the cloud is drawn through.
    pub fn map(&self) -> &LinearMap {
        &self.map
    }

    /// Sets what the cloud is drawn through.
    pub fn set_map(&mut self, map: LinearMap) {
        if self.map != map {
            self.map = map;
            self.nodes.iter_mut().for_each(|node| node.map = map);
        }
    }

    /// Returns the light of the saved shadows, which are those of the cloud in its own coordinates.
    pub fn saved_light(&self) -> Option<&ShadowContents> {
        self.light.as_deref().filter(|_| self.map.is_identity())
    }

    /// Returns the nodes in view, with the least and greatest depth of each.
    pub fn seen<'r>(
        &'r self,
        view: &'r View,
    ) -> impl Iterator<Item = ((f64, f64), &'r ResidentNode)> {
        self.seen_of(self.nodes.iter(), view)
    }

    /// Returns what [`Resident::seen`] does, of the given nodes.
    pub fn seen_of<'r>(
        &'r self,
        nodes: impl Iterator<Item = &'r ResidentNode>,
        view: &'r View,
    ) -> impl Iterator<Item = ((f64, f64), &'r ResidentNode)> {
        let is_left = |node: &&ResidentNode| self.clips.left(node.own_bounds()) != Left::Nothing;
        nodes.filter(is_left).filter_map(|node| Some((view.depths(node.bounds())?, node)))
    }

    /// Returns words that are equal only if a frame draws the same points under the same ids.
    pub fn identity(&self) -> Vec<u64> {
        self.cloud_identity().into_iter().chain(self.nodes_identity()).collect()
    }

    /// Returns [`IDENTITY_WORDS`] words per node, equal only for the same points.
    pub fn nodes_identity(&self) -> Vec<u64> {
        let node = |node: &ResidentNode| {
            let Frame { origin, extent, .. } = node.frame;
            let lattice = [node.lattice.step, node.lattice.offset]
                .map(|place| place.to_array().map(f64::to_bits))
                .concat();
            let counts = [node.count as u64, node.planes as u64, node.own_spacing.to_bits()];
            [origin.map(|steps| steps as u64), extent.map(|steps| steps as u64), counts]
                .concat()
                .into_iter()
                .chain(lattice)
        };
        self.nodes.iter().flat_map(node).collect()
    }

    /// Returns words that identify which points are drawn and hidden, without the nodes; see
    /// [`Resident::identity`].
    pub fn cloud_identity(&self) -> Vec<u64> {
        // Opacities matter only as far as they leave points out.
        let factors = self.opacities.table(&self.stations).into_iter().enumerate();
        let left_out: Vec<u64> =
            factors.filter(|(_, factor)| *factor == 0.0).map(|(number, _)| number as u64).collect();
        let counts = [self.serial, left_out.len() as u64, self.clips.active() as u64];
        let all = counts.into_iter().chain(left_out).chain(self.clips.identity());
        all.chain(self.map.identity()).collect()
    }

    /// Bytes of the pages in use.
    pub fn bytes(&self) -> u64 {
        PAGE_BYTES * self.pool.pages.used as u64
    }
}
