//! Projects points to keys: one 64-bit key per pixel, `depth bits << 32 | point id`, the smallest
//! of all points in it.
//!
//! The CPU computes in f64 which nodes are in view, from how many planes each is drawn, and each
//! node's transformation to pixels and depth. On the GPU, `project64` uses 64-bit atomics. Devices
//! without them run `project32` twice: depths first, then the smallest id at that depth.

use crate::config::{CHUNKS_PER_PAGE, NEAR_M, PAGES_PER_BLOCK, POINTS_PER_CHUNK, POINTS_PER_PAGE};
use crate::error::Result;
use crate::graph::{Buffer, Dispatch, Graph};
use crate::resident::{Resident, ResidentNode};
use crate::select::clip::Left;
pub use crate::select::lod::Precision;
use crate::select::lod::{cell_steps, quantisation_px};
use crate::shader::{self, Node, Within, project32, project64};
use crate::view::{Projection, View};
use glam::DVec3;
use std::collections::BTreeMap;

/// The nodes that a view draws, on the GPU, grouped by the number of planes that they are drawn
/// from.
pub struct Drawn {
    pub(super) nodes: Buffer,
    pub(super) chunks: Buffer,
    pub(super) pages: Vec<Buffer>,
    pub(super) groups: Vec<Group>,
    /// Factors of opacity, if points of opacity 0 are left out.
    opacities: Option<Buffer>,
    /// Clip boxes, if points are compared with them one by one.
    within: Option<Buffer>,
    pub statistics: Statistics,
}

/// Reasons to leave out points of a group, as bits (glsl/lib/point_constants.glsl): opacity 0,
/// facing away from the camera, clip boxes.
const BY_OPACITY: u32 = 1;
const ONE_SIDED: u32 = 2;
const CLIPPED: u32 = 4;

/// Chunks of one dispatch: of nodes in the same block, with the same number of planes and the same
/// reasons to leave out points, and all or none in the second walk.
pub(super) struct Group {
    pub block: usize,
    pub planes: u32,
    pub filtered: u32,
    /// True if a second walk over points at the front includes them.
    pub again: bool,
    pub first_chunk: u32,
    pub chunk_count: u32,
}

impl Group {
    /// Returns the dispatch: in rows, between which a software device may pause, with fewer
    /// workgroups too many than rows.
    pub fn tiles(&self) -> Dispatch<'static> {
        self.slices(1)
    }

    /// Returns the dispatch for `slices` workgroups per chunk.
    pub fn slices(&self, slices: u32) -> Dispatch<'static> {
        const ROW: u32 = 256;
        let rows = self.chunk_count.div_ceil(ROW).min(65_535);
        Dispatch::Groups([self.chunk_count.div_ceil(rows), rows, slices])
    }
}

/// Push and specialisation constants of all walks over points (glsl/lib/point_constants.glsl,
/// project.glsl).
#[derive(Clone, Copy)]
pub(super) struct Walk {
    pub centre: [f32; 2],
    pub corner: [f32; 2],
    pub size: [f32; 2],
    pub near: f32,
    pub lanes: u32,
    pub perspective: bool,
    pub texels: bool,
    pub points_per_chunk: u32,
}

impl Walk {
    pub fn new(g: &Graph, view: &View, strip: Strip) -> Walk {
        Walk {
            centre: view.middle().map(|at| at as f32),
            corner: [view.corner[0] as f32, (view.corner[1] + strip.top as i32) as f32],
            size: strip.size.map(|side| side as f32),
            near: NEAR_M,
            lanes: if g.gpu.device.is_cpu { 8 } else { 128 },
            perspective: view.camera.projection == Projection::Perspective,
            texels: g.gpu.device.has_large_texel_buffers,
            points_per_chunk: POINTS_PER_CHUNK,
        }
    }
}

/// Statistics for `--explain`.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Statistics {
    pub nodes_drawn: usize,
    pub nodes_outside: usize,
    /// Nodes, in view or not, that clip boxes remove completely.
    pub nodes_clipped: usize,
    /// Points of the nodes drawn; nodes on faces of clip boxes count with all points.
    pub points_drawn: u64,
    /// Points that were compared with clip boxes one by one.
    pub points_compared: u64,
    /// Bytes of position planes read.
    pub position_bytes: u64,
    /// Largest quantisation error of a drawn node `[px]`.
    pub quantisation_px: f64,
}

/// Keys of one strip.
pub struct Keys {
    pub words: Buffer,
    /// True if they are of a layer behind others, [`KEY_BEHIND_BYTES`] apart.
    pub behind: bool,
}

impl Keys {
    pub fn nearest(words: Buffer) -> Keys {
        Keys { words, behind: false }
    }
}

/// Bytes of a pixel's key (glsl/lib/keys.glsl).
pub const KEY_BYTES: u64 = 8;

/// Bytes of a key of a layer behind others, with the depth that its points lie behind.
pub const KEY_BEHIND_BYTES: u64 = 16;

/// A horizontal strip of the picture: all of it, unless its keys exceed one binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strip {
    pub top: u32,
    pub size: [u32; 2],
}

impl Strip {
    pub fn pixels(self) -> u64 {
        self.size[0] as u64 * self.size[1] as u64
    }
}

/// Splits a picture into strips of at most `limit` bytes.
pub fn strips(size: [u32; 2], pixel_bytes: u64, limit: u64) -> Vec<Strip> {
    let rows = (limit / (pixel_bytes * size[0] as u64)).clamp(1, size[1] as u64) as u32;
    (0..size[1])
        .step_by(rows as usize)
        .map(|top| Strip { top, size: [size[0], rows.min(size[1] - top)] })
        .collect()
}

/// Chooses nodes and planes for a view and uploads the list.
pub fn draw(
    g: &mut Graph,
    view: &View,
    resident: &Resident,
    precision: Precision,
) -> Result<Drawn> {
    draw_again(g, view, resident, precision, |_| true)
}

/// Does the same; a second walk over points at the front ([`Shallow`]) takes only these nodes.
pub fn draw_again(
    g: &mut Graph,
    view: &View,
    resident: &Resident,
    precision: Precision,
    again: impl Fn(&ResidentNode) -> bool,
) -> Result<Drawn> {
    list(g, view, resident, &resident.nodes.iter().collect::<Vec<_>>(), precision, again)
}

/// Does the same for some of the nodes.
pub fn draw_some(
    g: &mut Graph,
    view: &View,
    resident: &Resident,
    nodes: &[&ResidentNode],
    precision: Precision,
) -> Result<Drawn> {
    list(g, view, resident, nodes, precision, |_| true)
}

fn list(
    g: &mut Graph,
    view: &View,
    resident: &Resident,
    nodes: &[&ResidentNode],
    precision: Precision,
    again: impl Fn(&ResidentNode) -> bool,
) -> Result<Drawn> {
    let mut statistics = Statistics::default();
    let mut records = Vec::new();
    let mut within: Vec<Within> = Vec::new();
    let mut chunks: BTreeMap<(usize, u32, u32, bool), Vec<u32>> = BTreeMap::new();
    let mut seen: Vec<_> = resident
        .seen_of(nodes.iter().copied(), view)
        .map(|((nearest, _), node)| (nearest, node))
        .collect();
    statistics.nodes_clipped =
        nodes.iter().filter(|node| resident.clips.left(node.own_bounds()) == Left::Nothing).count();
    statistics.nodes_outside = nodes.len() - statistics.nodes_clipped - seen.len();
    let opacities = resident.hides() && resident.shown.kind().is_some();
    // Front to back, so that hidden points find their pixels taken. The order does not change the
    // result: keys are unique.
    seen.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (distance, node) in seen {
        let is_clipped = resident.clips.left(node.own_bounds()) == Left::Some;
        // Comparing a point with a box needs its full precision.
        let planes = if is_clipped {
            node.planes
        } else {
            precision.planes(view, &node.map, &node.lattice, &node.frame, distance).min(node.planes)
        };
        statistics.nodes_drawn += 1;
        statistics.points_drawn += node.count as u64;
        statistics.position_bytes += 4 * planes as u64 * node.count as u64;
        statistics.quantisation_px = statistics.quantisation_px.max(quantisation_px(
            view,
            &node.map,
            &node.lattice,
            &node.frame,
            distance,
            planes,
        ));
        let number = records.len() as u32;
        let mut record =
            record_of(view, node, planes, [resident.shown.kind(), resident.shown.normal()]);
        if is_clipped {
            statistics.points_compared += node.count as u64;
            let boxes =
                resident.clips.within(&node.lattice, &node.frame, node.own_bounds(), planes);
            record.boxes = [
                within.len(),
                within.len() + boxes[0].len(),
                within.len() + boxes[0].len() + boxes[1].len(),
            ]
            .map(|at| at as u32);
            within.extend(
                boxes.concat().iter().map(|cells| Within { least: cells.least, most: cells.most }),
            );
        }
        records.push(record);
        let filtered =
            if opacities { BY_OPACITY } else { 0 } | if is_clipped { CLIPPED } else { 0 };
        let group = ((node.first_page / PAGES_PER_BLOCK) as usize, planes, filtered, again(node));
        chunks.entry(group).or_default().extend(
            (0..node.count.div_ceil(POINTS_PER_CHUNK))
                .map(|chunk| number * CHUNKS_PER_PAGE + chunk),
        );
    }
    let mut groups = Vec::new();
    let mut first_chunk = 0;
    for (&(block, planes, filtered, again), chunks) in &chunks {
        let chunk_count = chunks.len() as u32;
        groups.push(Group { block, planes, filtered, again, first_chunk, chunk_count });
        first_chunk += chunk_count;
    }
    let opacities = opacities
        .then(|| g.upload("opacities", &resident.opacities.table(&resident.stations)))
        .transpose()?;
    let within = (!within.is_empty()).then(|| g.upload("within", &within)).transpose()?;
    let nodes = g.upload("nodes", &records)?;
    let chunks = g.upload("chunks", &chunks.into_values().flatten().collect::<Vec<u32>>())?;
    Ok(Drawn { nodes, chunks, pages: resident.import(g), groups, opacities, within, statistics })
}

impl Drawn {
    /// Leaves out points that face away from the camera, if `asked`; those without a known normal
    /// stay.
    pub fn one_sided(mut self, asked: bool) -> Drawn {
        self.groups.iter_mut().filter(|_| asked).for_each(|group| group.filtered |= ONE_SIDED);
        self
    }

    /// Returns what walks for layers behind others keep for every chunk ([`Behind::alive`]),
    /// initialised.
    pub fn alive(&self, g: &mut Graph) -> Buffer {
        self.of_every_chunk(g, "alive", 0)
    }

    /// Returns a record of the chunks with a point at most `epsilon` behind the front `[m]`,
    /// initialised.
    pub fn shallow(&self, g: &mut Graph, epsilon: f32) -> Shallow {
        Shallow { chunks: self.of_every_chunk(g, "shallow", 0), epsilon }
    }

    /// Returns a record that marks all chunks.
    pub fn all_shallow(&self, g: &mut Graph) -> Shallow {
        Shallow { chunks: self.of_every_chunk(g, "shallow", 1), epsilon: f32::INFINITY }
    }

    fn of_every_chunk(&self, g: &mut Graph, name: &'static str, word: u32) -> Buffer {
        let chunks: u32 = self.groups.iter().map(|group| group.chunk_count).sum();
        let mut words = g.buffer(name, 4 * chunks.max(1) as u64);
        g.fill(&mut words, word);
        words
    }

    /// Returns the binding of opacities; any buffer if they are not read.
    pub(super) fn opacities(&self) -> &Buffer {
        self.opacities.as_ref().unwrap_or(&self.nodes)
    }

    /// Returns the binding of clip boxes, likewise.
    pub(super) fn within(&self) -> &Buffer {
        self.within.as_ref().unwrap_or(&self.nodes)
    }
}

/// State of a layer behind others.
pub struct Behind<'b> {
    /// Keys without points, with the depths of the layers before, which only grow.
    pub keys: &'b mut Buffer,
    /// The last layer that each chunk had points for; 0 before the first.
    pub alive: &'b mut Buffer,
    /// Number of the layer, from 1.
    pub layer: u32,
}

/// The chunks that a second walk over points at the front must read.
pub struct Shallow {
    /// 1 for each chunk with a point that is at most epsilon behind the front, or was when it was
    /// tested.
    pub chunks: Buffer,
    /// Distance behind the front `[m]`.
    pub epsilon: f32,
}

/// Projects all points, or those behind other layers.
pub fn record(
    g: &mut Graph,
    view: &View,
    drawn: &Drawn,
    behind: Option<Behind>,
    shallow: Option<&mut Shallow>,
    strip: Strip,
) -> Keys {
    if let Some(Behind { keys, alive, layer }) = behind {
        walk(g, view, drawn, Some((alive, layer)), shallow, strip, keys);
        return Keys { words: keys.alias(), behind: true };
    }
    let mut words = g.buffer("keys", KEY_BYTES * strip.pixels());
    g.fill(&mut words, u32::MAX);
    walk(g, view, drawn, None, shallow, strip, &mut words);
    Keys::nearest(words)
}

/// Projects all points into existing keys.
pub fn add(g: &mut Graph, view: &View, drawn: &Drawn, strip: Strip, keys: &mut Buffer) {
    walk(g, view, drawn, None, None, strip, keys);
}

fn walk(
    g: &mut Graph,
    view: &View,
    drawn: &Drawn,
    behind: Option<(&mut Buffer, u32)>,
    shallow: Option<&mut Shallow>,
    strip: Strip,
    keys: &mut Buffer,
) {
    let Walk { centre, corner, size, near, lanes, perspective, texels, points_per_chunk } =
        Walk::new(g, view, strip);
    // Read beside the atomics on purpose: a stale key only costs an atomic.
    let (front, mut no_alive, mut no_shallow) =
        (&keys.racy_alias(), keys.racy_alias(), keys.racy_alias());
    let (is_behind, is_shallow) = (behind.is_some(), shallow.is_some());
    let (alive, layer) = behind.unwrap_or((&mut no_alive, 0));
    let (shallow, epsilon) =
        shallow.map_or((&mut no_shallow, 0.0), |shallow| (&mut shallow.chunks, shallow.epsilon));
    let (opacities, within) = (drawn.opacities(), drawn.within());
    let int64 = g.gpu.device.int64_atomics;
    let steps: &[u32] = if int64 { &[0] } else { &[0, 1] };
    for (&step, group) in
        steps.iter().flat_map(|step| drawn.groups.iter().map(move |group| (step, group)))
    {
        let (tiles, &Group { block, planes, filtered, again, first_chunk, chunk_count }) =
            (group.tiles(), group);
        let (nodes, chunks, pages) = (&drawn.nodes, &drawn.chunks, &drawn.pages[block]);
        // The keys of a single pixel without layers in front are smaller than a texel of four
        // words.
        let front_behind = if is_behind { front } else { pages };
        // Both kernels have the same bindings and constants.
        macro_rules! run {
            ($($kernel:ident)::+, $module:ident $(, $step:ident)?) => {{
                let push = $module::Push { centre, corner, size, near, first_chunk, chunk_count, layer, epsilon };
                let spec = $module::Spec { lanes, planes, perspective, texels, points_per_chunk, filtered, behind: is_behind, shallow: is_shallow && again $(, $step)? };
                let (page_words, keys, alive, shallow) = (pages, &mut *keys, &mut *alive, &mut *shallow);
                g.run(
                    $($kernel)::+ { nodes, chunks, opacities, within, pages, page_words, front, front_behind, alive, shallow, keys, push, spec },
                    tiles,
                );
            }};
        }
        if int64 {
            run!(shader::Project64, project64);
        } else {
            run!(shader::Project32, project32, step);
        }
    }
}

/// Returns the node's transformation, computed in f64 and rounded once (guide: numerics, case 1).
fn record_of(
    view: &View,
    node: &ResidentNode,
    planes: u32,
    [kind, normal]: [Option<u32>; 2],
) -> Node {
    let steps = cell_steps(&node.frame, planes);
    let cell = node.lattice.step * steps;
    // Cells drop the finer bits: their points lie on average half a cell further, less half of the
    // finest step.
    let finest = cell_steps(&node.frame, node.frame.planes);
    let middle = if planes < node.frame.planes { (steps - finest.max(1.0)) / 2.0 } else { 0.0 };
    let [x, y, z] = node.frame.origin.map(|origin| origin as f64 + middle);
    // Position of cell 0 relative to the eye, along the cloud's own axes.
    let eye = node.map.own(view.camera.eye);
    let corner = (node.lattice.offset - eye) + node.lattice.step * DVec3::new(x, y, z);
    let [x, y, z] = node.frame.extent.map(|extent| (extent as f64 / steps).floor());
    let nearest = (-corner / cell).round().clamp(DVec3::ZERO, DVec3::new(x, y, z));
    let offset = corner + cell * nearest;
    let drawn_from_eye = match node.map.is_identity() {
        true => offset,
        false => node.map.place(offset + eye) - view.camera.eye,
    };
    let row = |axis: DVec3| {
        let r = node.map.pulled(axis) * cell;
        [r.x as f32, r.y as f32, r.z as f32, axis.dot(drawn_from_eye) as f32]
    };
    let f = view.focal_px();
    let basis = &view.basis;
    let first_word =
        |word: u32| (node.first_page + node.planes + word) % PAGES_PER_BLOCK * POINTS_PER_PAGE;
    // x and y are pixels times the depth; without perspective all view rays are parallel.
    let (across, along) =
        if view.camera.projection == Projection::Perspective { (1.0, f) } else { (0.0, 1.0) };
    let [right, up, forward] = view.normal_axes();
    let of_normals = |axis: DVec3| node.map.pulled_by_normals(axis).as_vec3().to_array();
    Node {
        row_x: row(basis.right * f),
        row_y: row(basis.up * -f),
        row_z: row(basis.forward),
        nearest: [nearest.x as i32, nearest.y as i32, nearest.z as i32],
        count: node.count,
        first_point: node.first_point(),
        first_word: node.first_page % PAGES_PER_BLOCK * POINTS_PER_PAGE,
        shown_word: (node.first_page + node.planes) % PAGES_PER_BLOCK * POINTS_PER_PAGE,
        first_kind: kind.map_or(0, first_word),
        first_normal: normal.map_or(0, first_word),
        right: of_normals(right * across),
        down: of_normals(-up * across),
        forward: of_normals(forward * along),
        boxes: [0; 3],
    }
}
