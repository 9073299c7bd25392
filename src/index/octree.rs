//! Octrees of other programs as indexes: the nodes of COPC, Potree 2 and EPT are drawn in place.
//!
//! A node's points are in none of its children, so that they are drawn together
//! ([`Refinement::Adds`]). A node of more points than a page holds is several records, of which the
//! first has the children. Positions count on the file's own lattice from the corner of the node's
//! box, and points are in Morton order, as in files NAME.pnti. Of that, only the list of nodes is
//! read when a file is opened, and the first nodes, for the ranges of what is shown.

use super::format::{
    Contents, Directory, Index, IndexedPart, NodeRecord, NodeSource, Plane, Refinement, morton,
};
use crate::cloud::attribute::percentiles;
use crate::cloud::input::Input;
use crate::cloud::las::octree::{self, Key, Octree, OctreeNode, named};
use crate::cloud::las::{INTENSITY_RANGE, Las, Stretch};
use crate::cloud::rgb_range::RgbRange;
use crate::cloud::{ColumnSet, Columns, Header, Lattice, Station, crs, title};
use crate::config::{BITS_PER_PLANE, MOST_NODE_POINTS, POINTS_PER_PAGE, POSITION_PLANES};
use crate::error::{Error, Result};
use bytemuck::Zeroable;
use glam::DVec3;
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// Points of decoded nodes that are kept, for their next plane; about 40 bytes each.
const KEPT_POINTS: usize = 1 << 20;

/// Points that tell the ranges of intensities and heights, and most nodes below the roots that are
/// read for them.
const ENOUGH_POINTS: u64 = 1 << 16;
const FIRST_NODES: usize = 8;

/// Columns that can be read in place. Point source ids cannot: the stations are those of all
/// points.
pub const COLUMNS: ColumnSet = ColumnSet { source: false, normal: false, ..ColumnSet::ALL };

/// An open octree.
struct InPlace {
    input: Input,
    las: Las,
    nodes: Vec<OctreeNode>,
    /// Length of all files `[bytes]`.
    bytes: u64,
    /// The node of every record, and the index of its first point among the node's.
    pieces: Vec<(usize, usize)>,
    decoded: Mutex<Decoded>,
}

/// Nodes in memory, the last used one last.
#[derive(Default)]
struct Decoded {
    nodes: Vec<(usize, Arc<DecodedNode>)>,
    /// All columns that were asked for, which are decoded together.
    asked: ColumnSet,
}

struct DecodedNode {
    columns: Columns,
    has: ColumnSet,
    /// The points in Morton order, by their numbers in the chunk.
    order: Vec<u32>,
}

impl Index {
    /// Tests whether a file or folder says that it is an octree of COPC, Potree 2 or EPT. A pipe is
    /// not opened.
    pub fn is_octree(path: &Path) -> bool {
        Input::open(path).and_then(|input| octree::is_one(&input)).unwrap_or(false)
    }

    /// Opens an octree. Its nodes are checked, and their points when they are read. If `strict`, a
    /// header that the nodes contradict is an error.
    pub fn open_octree(path: &Path, rgb_range: Option<RgbRange>, strict: bool) -> Result<Index> {
        let input = Input::open(path)?.counting_to(rgb_range);
        let mut notes = Vec::new();
        // Colours are judged by the root, below.
        let mut las = Las::open(&input, ColumnSet::default(), &mut notes)?;
        if let Some(lie) = las.layout.lies.first().filter(|_| strict) {
            return Err(input.wrong(lie));
        }
        let octree = las.octree(&input)?;
        if las.points() != las.layout.points {
            return Err(input.wrong(format!(
                "declares {} points, but its nodes have {}",
                las.layout.points,
                las.points()
            )));
        }
        let title = title(None, &input.path);
        let lattice = las.layout.lattice;
        if crs::settle(&mut las.layout.header, lattice, &mut None, &title, &mut notes) != lattice {
            return Err(input.wrong("has angles as coordinates, which are converted first"));
        }
        let bounds = stated(&las.layout.header).unwrap_or_else(|| octree.cube([0; 4]));
        let Records { records: mut nodes, pieces, roots } =
            Records::of(&input, &octree, lattice, bounds)?;
        let holds = las.holds();
        let mut planes: Vec<Plane> = [
            (holds.intensity, Plane::Intensity),
            (holds.class, Plane::Class),
            (holds.returns, Plane::Returns),
            (holds.gps_time, Plane::GpsTime),
        ]
        .into_iter()
        .filter_map(|(has, plane)| has.then_some(plane))
        .collect();
        let mut decoded = Decoded::default();
        if let Some((root, record)) = octree.nodes.first().zip(nodes.first()) {
            let has =
                ColumnSet { rgb: true, intensity: true, source: true, ..ColumnSet::default() };
            let (mut columns, occurred) = las.chunk(&input, &root.chunk, has)?;
            if las.reconsiders(occurred) {
                (columns, _) = las.chunk(&input, &root.chunk, has)?;
            }
            notes.extend(occurred.says(las.scale()).map(|what| format!("{title}: {what}")));
            let mut ids = columns.source.iter().flatten();
            let first = ids.next();
            if ids.any(|id| Some(id) != first) {
                notes.push(format!(
                    "{title}: the points have several point source ids, and are drawn as one station; `pointillist index {} -o OUT.pnti` tells them apart, and evens their light",
                    path.display()
                ));
            }
            // Black is no colour, as in files that are read whole.
            planes.extend((columns.rgb.is_some() && !occurred.is_black()).then_some(Plane::Rgb));
            let order = order(&input, root, record, &columns)?;
            decoded.nodes.push((0, Arc::new(DecodedNode { columns, has, order })));
        }
        for node in &mut nodes {
            planes.iter().for_each(|plane| node.planes |= 1 << *plane as u16);
        }
        let mut header = las.layout.header.clone();
        (header.scalars, header.columns) = Default::default();
        let contents = Contents {
            stations: vec![Station { part: 0, source: None, name: title, points: las.points() }],
            notes,
            lattices: vec![[lattice.step, lattice.offset]; 2],
            points: las.points(),
            bounds: Some(bounds),
            parts: vec![IndexedPart {
                path: input.path.clone(),
                name: None,
                header,
                step: lattice.step,
                offset: lattice.offset,
                points: las.points(),
                intensity_range: INTENSITY_RANGE,
                rgb_bits: las.scale().bits(),
                rgb_scale: las.scale(),
            }],
            ..Contents::default()
        };
        let mut identity = blake3::Hasher::new();
        for node in &octree.nodes {
            identity.update(bytemuck::bytes_of(&node.key));
            identity.update(&node.chunk.at.to_le_bytes());
            identity.update(&node.chunk.bytes.to_le_bytes());
        }
        identity.update(&octree.bytes.to_le_bytes());
        identity.update(input.tag().unwrap_or_default().as_bytes());
        let [identity, ..]: [u64; 4] = bytemuck::cast(*identity.finalize().as_bytes());
        let Octree { nodes: own, bytes, .. } = octree;
        let decoded = Mutex::new(decoded);
        let in_place = InPlace { input, las, nodes: own, bytes, pieces, decoded };
        let directory = Directory { nodes, roots, contents };
        let mut index = Index::of(Box::new(in_place), directory, Refinement::Adds, identity);
        index.find_stretches()?;
        Ok(index)
    }

    /// Sets the ends of the colour ramps by the points of the first nodes: of the roots, and of so
    /// many below that there are enough.
    fn find_stretches(&mut self) -> Result<()> {
        let (mut intensities, mut heights) = (vec![0u64; 1 << 16], vec![0u64; 1 << 16]);
        let [low, high] = self.directory.contents.bounds.unwrap_or_default();
        let share = if high.z > low.z { 65_535.0 / (high.z - low.z) } else { 0.0 };
        let mut seen = 0;
        let roots = self.directory.roots as usize;
        let first = 0..self.nodes().len().min(roots + FIRST_NODES);
        self.ahead(&first.clone().map(|node| (node, Vec::new())).collect::<Vec<_>>());
        for node in first {
            let is_root = node < roots;
            if !is_root && seen >= ENOUGH_POINTS {
                break;
            }
            let wanted = ColumnSet { intensity: true, ..ColumnSet::default() };
            let read = self.columns(node, wanted).and_then(|own| Ok((own, self.samples(node)?)));
            let (columns, samples) = match read {
                Ok(read) => read,
                Err(error) if is_root => return Err(error),
                // Said when it is drawn.
                Err(_) => continue,
            };
            seen += samples.len() as u64;
            let greys = columns.intensity.unwrap_or_default();
            greys.into_iter().for_each(|grey| intensities[grey as usize] += 1);
            for (position, _) in samples {
                heights[((position.z - low.z) * share).clamp(0.0, 65_535.0) as usize] += 1;
            }
        }
        let contents = &mut self.directory.contents;
        contents.intensity_stretch = percentiles(&intensities);
        contents.elevation_stretch = percentiles(&heights);
        Ok(())
    }
}

/// Returns the bounds in the header, if they are any.
fn stated(header: &Header) -> Option<[DVec3; 2]> {
    let [low, high] = header.bounds?.map(DVec3::from_array);
    (low.is_finite() && high.is_finite() && low.cmple(high).all()).then_some([low, high])
}

/// The records of an octree's nodes, roots first and siblings side by side.
#[derive(Default)]
struct Records {
    records: Vec<NodeRecord>,
    /// The node of each record, and the index of its first point among the node's.
    pieces: Vec<(usize, usize)>,
    roots: u32,
}

impl Records {
    /// Lists the nodes. One is below the nearest one above it that has points.
    fn of(input: &Input, octree: &Octree, lattice: Lattice, bounds: [DVec3; 2]) -> Result<Records> {
        let numbers: HashMap<Key, usize> =
            octree.nodes.iter().enumerate().map(|(number, node)| (node.key, number)).collect();
        let above = |key: Key| {
            std::iter::successors(octree::parent(key), |&key| octree::parent(key))
                .find_map(|key| numbers.get(&key).copied())
        };
        let (mut roots, mut below) = (Vec::new(), vec![Vec::new(); octree.nodes.len()]);
        let mut points: Vec<u64> = octree.nodes.iter().map(|node| node.chunk.points).collect();
        // Nodes come behind those above them.
        for (number, node) in octree.nodes.iter().enumerate().rev() {
            match above(node.key) {
                Some(above) => {
                    below[above].push(number);
                    points[above] += points[number];
                }
                None => roots.push(number),
            }
        }
        let mut all = Records::default();
        let add = |siblings: &[usize], parent: Option<usize>, all: &mut Records| {
            let first = all.records.len();
            for &number in siblings.iter().rev() {
                let node = &octree.nodes[number];
                let record = record(input, octree, node, lattice, bounds)?;
                let own = node.chunk.points as usize;
                for start in (0..own).step_by(POINTS_PER_PAGE as usize) {
                    let count = (own - start).min(POINTS_PER_PAGE as usize);
                    let rest = if start == 0 { points[number] - own as u64 } else { 0 };
                    all.records.push(NodeRecord {
                        count: count as u32,
                        points: count as u64 + rest,
                        parent: parent.unwrap_or(all.records.len()) as u32,
                        ..record
                    });
                    all.pieces.push((number, start));
                }
            }
            Ok::<_, Error>(first..all.records.len())
        };
        all.roots = add(&roots, None, &mut all)?.len() as u32;
        let mut next = 0;
        while next < all.records.len() {
            let (number, start) = all.pieces[next];
            if start == 0 && !below[number].is_empty() {
                let children = add(&below[number], Some(next), &mut all)?;
                let record = &mut all.records[next];
                record.first_child = children.start as u32;
                record.children = children.len() as u32;
                record.spacing = octree.spacing / 2f64.powi(octree.nodes[number].key[0]);
            }
            next += 1;
        }
        Ok(all)
    }
}

/// Returns the record of a node: its box is that part of its cube that is within the bounds of all.
fn record(
    input: &Input,
    octree: &Octree,
    node: &OctreeNode,
    lattice: Lattice,
    [low, high]: [DVec3; 2],
) -> Result<NodeRecord> {
    let wrong = |what: &str| input.wrong(format!("has a node {} {what}", named(node.key)));
    if node.chunk.points > MOST_NODE_POINTS {
        return Err(wrong(&format!(
            "of {} points; at most {MOST_NODE_POINTS} are read at a time",
            node.chunk.points
        )));
    }
    let cube = octree.cube(node.key);
    // Both may be rounded by a step.
    let steps = |corner: DVec3, by: f64| ((corner - lattice.offset) / lattice.step).round() + by;
    let from = steps(cube[0].max(low), -1.0).to_array().map(|v| v as i64);
    let to = steps(cube[1].min(high), 1.0).to_array().map(|v| v as i64);
    let sides = [0, 1, 2].map(|axis| to[axis].checked_sub(from[axis]).unwrap_or(-1));
    if sides.iter().any(|&side| side < 0) {
        return Err(wrong("outside of the bounds in its header"));
    }
    let longest = sides.into_iter().max().unwrap_or(0);
    if longest >= 1 << (BITS_PER_PLANE * POSITION_PLANES) {
        return Err(wrong("of more steps than planes of positions can have"));
    }
    let bits = (64 - longest.leading_zeros()).max(1);
    Ok(NodeRecord {
        origin: from,
        extent: sides.map(|side| side as u32),
        at: node.chunk.at,
        bits: bits as u8,
        level: node.key[0] as u8,
        planes: (1 << bits.div_ceil(BITS_PER_PLANE)) - 1,
        ..NodeRecord::zeroed()
    })
}

impl InPlace {
    /// Returns a node with at least these columns, and how many bytes were read for it.
    fn node(
        &self,
        number: usize,
        record: &NodeRecord,
        wanted: ColumnSet,
    ) -> Result<(Arc<DecodedNode>, u64)> {
        let lock = || self.decoded.lock().unwrap_or_else(PoisonError::into_inner);
        let asked = {
            let mut decoded = lock();
            decoded.asked = decoded.asked.and(wanted);
            let has = |own: &DecodedNode| own.has.and(wanted) == own.has;
            let found = decoded.nodes.iter().position(|(own, node)| *own == number && has(node));
            if let Some(found) = found {
                let kept = decoded.nodes.remove(found);
                decoded.nodes.push(kept.clone());
                return Ok((kept.1, 0));
            }
            decoded.asked
        };
        let node = &self.nodes[number];
        let bytes = node.chunk.bytes;
        let (columns, _) = self.las.chunk(&self.input, &node.chunk, asked)?;
        let order = order(&self.input, node, record, &columns)?;
        let node = Arc::new(DecodedNode { columns, has: asked, order });
        let mut decoded = lock();
        decoded.nodes.retain(|(own, _)| *own != number);
        decoded.nodes.push((number, node.clone()));
        let points = |decoded: &Decoded| -> usize {
            decoded.nodes.iter().map(|(_, node)| node.order.len()).sum()
        };
        while decoded.nodes.len() > 1 && points(&decoded) > KEPT_POINTS {
            decoded.nodes.remove(0);
        }
        Ok((node, bytes))
    }
}

/// Returns the order of a node's points: by the Morton code of the coarsest plane, then by
/// position, then as in the file.
fn order(
    input: &Input,
    node: &OctreeNode,
    record: &NodeRecord,
    columns: &Columns,
) -> Result<Vec<u32>> {
    let axes = [&columns.x, &columns.y, &columns.z];
    for axis in 0..3 {
        let inside = 0..=record.extent[axis] as i64;
        let outside = |q: &&i32| !inside.contains(&(**q as i64 - record.origin[axis]));
        if let Some(q) = axes[axis].iter().find(outside) {
            return Err(input.wrong(format!(
                "has a point outside of its node {}: {} {q} is not within {} to {}",
                named(node.key),
                ["x", "y", "z"][axis],
                record.origin[axis],
                record.origin[axis] + record.extent[axis] as i64
            )));
        }
    }
    let cells = |i: usize| [0, 1, 2].map(|k| cell(record, k, axes[k][i]));
    let shift = BITS_PER_PLANE * (record.position_planes() - 1);
    let code = |i: usize| morton::code(cells(i).map(|cell| cell >> shift));
    let mut keys: Vec<u64> =
        (0..columns.len()).map(|i| (code(i) as u64) << 32 | i as u64).collect();
    keys.sort_unstable();
    for run in keys.chunk_by_mut(|a, b| a >> 32 == b >> 32).filter(|run| run.len() > 1) {
        run.sort_by_cached_key(|&key| (cells(key as u32 as usize), key as u32));
    }
    Ok(keys.into_iter().map(|key| key as u32).collect())
}

/// Returns the place of a coordinate in the planes of all position bits.
fn cell(record: &NodeRecord, axis: usize, q: i32) -> u32 {
    let pad = BITS_PER_PLANE * record.position_planes() - record.bits as u32;
    ((q as i64 - record.origin[axis]) as u32) << pad
}

impl NodeSource for InPlace {
    fn ahead(&self, _nodes: &[NodeRecord], wanted: &[(usize, Vec<Plane>)]) {
        let mut numbers: Vec<usize> = wanted.iter().map(|(node, _)| self.pieces[*node].0).collect();
        numbers.dedup();
        let decoded = self.decoded.lock().unwrap_or_else(PoisonError::into_inner);
        numbers.retain(|number| !decoded.nodes.iter().any(|(own, _)| own == number));
        drop(decoded);
        let chunks: Vec<Stretch> =
            numbers.into_iter().map(|number| self.nodes[number].chunk).collect();
        self.las.ahead(&self.input, &chunks);
    }

    fn is_remote(&self) -> bool {
        self.input.is_remote()
    }

    fn path(&self) -> &Path {
        &self.input.path
    }

    fn bytes(&self) -> u64 {
        self.bytes
    }

    fn copy(&self, at: u64, into: &mut [u8]) -> Result<()> {
        self.input.read_exactly(at, into)
    }

    fn read(&self, node: usize, record: &NodeRecord, plane: Plane, into: &mut [u8]) -> Result<u64> {
        let (number, start) = self.pieces[node];
        let none = ColumnSet::default();
        let wanted = match plane {
            Plane::Rgb => ColumnSet { rgb: true, ..none },
            Plane::Intensity => ColumnSet { intensity: true, ..none },
            Plane::Class => ColumnSet { class: true, ..none },
            Plane::Returns => ColumnSet { returns: true, ..none },
            Plane::GpsTime => ColumnSet { gps_time: true, ..none },
            _ => none,
        };
        let (decoded, bytes) = self.node(number, record, wanted)?;
        let order = &decoded.order[start..start + record.count as usize];
        let Columns { x, y, z, rgb, intensity, class, returns, gps_time, .. } = &decoded.columns;
        match plane {
            Plane::Rgb => gather(rgb, order, into),
            Plane::Intensity => gather(intensity, order, into),
            Plane::Class => gather(class, order, into),
            Plane::Returns => gather(returns, order, into),
            Plane::GpsTime => gather(gps_time, order, into),
            _ => {
                let below = record.position_planes() - 1 - plane as u32;
                let part = |axis: usize, q: i32| {
                    let cell = cell(record, axis, q) >> (BITS_PER_PLANE * below);
                    (cell & ((1 << BITS_PER_PLANE) - 1)) << (BITS_PER_PLANE * axis as u32)
                };
                let (words, _) = into.as_chunks_mut::<4>();
                for (word, &i) in words.iter_mut().zip(order) {
                    let i = i as usize;
                    *word = (part(0, x[i]) | part(1, y[i]) | part(2, z[i])).to_le_bytes();
                }
            }
        }
        Ok(bytes)
    }
}

/// Copies a column in an order; zeros if it is missing.
fn gather<T: bytemuck::NoUninit>(column: &Option<Vec<T>>, order: &[u32], into: &mut [u8]) {
    let Some(column) = column else { return into.fill(0) };
    for (bytes, &i) in into.chunks_exact_mut(size_of::<T>()).zip(order) {
        bytes.copy_from_slice(bytemuck::bytes_of(&column[i as usize]));
    }
}
