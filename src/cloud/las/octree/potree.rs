//! Potree 2: `metadata.json`, with the list of nodes in `hierarchy.bin` and their points in
//! `octree.bin`.
//!
//! The list is in chunks, each a walk of some levels in order of breadth; nodes at the end of it
//! stand for chunks below. Points are rows, or columns that brotli packed: positions and colours as
//! Morton codes there.

use super::super::Stretch;
use super::super::header::{array_at, check_lattice, u32_at};
use super::super::laz::Outcome;
use super::layout::{Attribute, Place, Plan, Said, WIDTHS};
use super::{Key, MOST_NODE_BYTES, NodeReader, Octree, Opened, is_inside, named};
use crate::cloud::catch_panic::catch_panic;
use crate::cloud::input::Input;
use crate::cloud::stream::BATCH;
use crate::cloud::{ColumnSet, Lattice};
use crate::error::Result;
use brotli_decompressor::Decompressor;
use glam::DVec3;
use serde::Deserialize;
use std::collections::{HashMap, VecDeque};
use std::io::Read;

/// Files beside the description.
pub const FILES: [&str; 2] = ["hierarchy.bin", "octree.bin"];

/// Length of a node in the list `[bytes]`.
const ENTRY_BYTES: u64 = 22;

/// Type of a node that stands for a chunk of the list.
const PROXY: u8 = 2;

/// Entries that are read at a time.
const ENTRIES: u64 = 4096;

/// Bytes of a position and of a colour in packed points.
const PACKED_POSITION: usize = 16;
const PACKED_COLOR: usize = 8;

#[derive(Deserialize)]
struct Metadata {
    version: String,
    points: u64,
    #[serde(default)]
    projection: String,
    hierarchy: Hierarchy,
    offset: [f64; 3],
    scale: [f64; 3],
    spacing: f64,
    #[serde(rename = "boundingBox")]
    bounding_box: Bounds,
    #[serde(default)]
    encoding: String,
    attributes: Vec<Declared>,
}

#[derive(Deserialize)]
struct Hierarchy {
    #[serde(rename = "firstChunkSize")]
    first_chunk_size: u64,
}

#[derive(Deserialize)]
struct Bounds {
    min: [f64; 3],
    max: [f64; 3],
}

#[derive(Deserialize)]
struct Declared {
    name: String,
    size: usize,
    #[serde(rename = "numElements")]
    elements: usize,
    #[serde(rename = "type")]
    kind: String,
    #[serde(default)]
    min: Vec<f64>,
    #[serde(default)]
    max: Vec<f64>,
}

/// Names of types, in the order of extra bytes.
const TYPES: [&str; 10] =
    ["uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float", "double"];

/// An open file of nodes.
struct Potree {
    /// The file of points.
    input: Input,
    plan: Plan,
    packed: bool,
    /// Points of the node at each place.
    points: HashMap<u64, u64>,
}

pub fn open(input: &Input, text: &[u8]) -> Result<Opened> {
    let metadata: Metadata = serde_json::from_slice(text)
        .map_err(|error| input.wrong(format!("does not describe a Potree cloud: {error}")))?;
    if !metadata.version.starts_with("2.") {
        return Err(input.wrong(format!("is Potree {}; 2.0 is read", metadata.version)));
    }
    let packed = match metadata.encoding.as_str() {
        "BROTLI" => true,
        "DEFAULT" | "UNCOMPRESSED" | "" => false,
        other => {
            return Err(input.wrong(format!(
                "has points of the encoding {other}; BROTLI and DEFAULT are read"
            )));
        }
    };
    let lattice = Lattice {
        step: DVec3::from_array(metadata.scale),
        offset: DVec3::from_array(metadata.offset),
    };
    check_lattice(input, lattice.step, lattice.offset)?;
    let [low, high] = [metadata.bounding_box.min, metadata.bounding_box.max].map(DVec3::from_array);
    let (sides, spacing) = (high - low, metadata.spacing);
    let is_box = low.is_finite() && sides.is_finite() && sides.min_element() > 0.0;
    let is_fine = spacing > 0.0 && spacing <= sides.max_element();
    if !(is_box && is_fine && lattice.step.min_element() > 0.0) {
        return Err(input.wrong(format!(
            "has an octree of an impossible box: {low} to {high}, spacing {spacing}, scale {}",
            lattice.step
        )));
    }
    let stated = metadata.attributes.iter().find(|own| own.name == "position");
    let stated = stated.map(|own| [own.min.clone(), own.max.clone()].map(TryInto::try_into));
    let bounds = match stated {
        Some([Ok(min), Ok(max)]) => Some([min, max]),
        _ => None,
    };
    let attributes = metadata.attributes.into_iter().map(|own| own.checked(input));
    let plan = Plan::new(input, attributes.collect::<Result<_>>()?)?;
    let folder = input.folder();
    folder.ahead(FILES.map(String::from).into_iter());
    let [hierarchy, points] = FILES.map(|name| folder.open(name));
    let (hierarchy, points) = (hierarchy?, points?);
    let row = if packed { packed_bytes(&plan) } else { plan.row_bytes() } as u64;
    let first = metadata.hierarchy.first_chunk_size;
    let list = List { hierarchy: &hierarchy, most: points.length, row, packed };
    let nodes = Octree::nodes_of(list.nodes(first)?.into_iter());
    let mut ends: Vec<&Stretch> = nodes.iter().map(|node| &node.chunk).collect();
    ends.sort_unstable_by_key(|chunk| chunk.at);
    if let Some([one, other]) =
        ends.array_windows().find(|[one, other]| one.at + one.bytes > other.at)
    {
        return Err(hierarchy.wrong(format!(
            "has two nodes in the same bytes of octree.bin: {} from {} and {} from {}",
            one.bytes, one.at, other.bytes, other.at
        )));
    }
    let there: u64 = nodes.iter().map(|node| node.chunk.points).sum();
    let lie = format!("declares {} points, but its nodes have {there}", metadata.points);
    let layout = plan.layout(Said {
        format: format!("Potree {} {}", metadata.version, if packed { "brotli" } else { "plain" }),
        points: there,
        lattice,
        bounds,
        system: metadata.projection,
        compressed: packed,
        lies: Some(lie).filter(|_| metadata.points != there).into_iter().collect(),
    });
    let bytes = input.length + hierarchy.length + points.length;
    let counts = nodes.iter().map(|node| (node.chunk.at, node.chunk.points)).collect();
    let reader = Box::new(Potree { input: points, plan, packed, points: counts });
    Ok(Opened { layout, octree: Octree { corner: low, sides, spacing, nodes, bytes }, reader })
}

impl Declared {
    fn checked(self, input: &Input) -> Result<Attribute> {
        let kind = TYPES.iter().position(|name| *name == self.kind);
        let fits = |kind: &usize| WIDTHS[*kind].checked_mul(self.elements) == Some(self.size);
        let Some(kind) = kind.filter(|kind| fits(kind) && self.size > 0) else {
            return Err(input.wrong(format!(
                "has an attribute {} of {} numbers of type {}, in {} bytes",
                self.name, self.elements, self.kind, self.size
            )));
        };
        let most = self.max.iter().copied().reduce(f64::max);
        let (kind, elements) = (kind as u8 + 1, self.elements);
        // Scales of extra bytes are those of their declaration, which points are not multiplied
        // with.
        Ok(Attribute { name: self.name, kind, elements, scale: 1.0, offset: 0.0, most })
    }
}

/// The list of nodes, and what they are checked with.
struct List<'l> {
    hierarchy: &'l Input,
    /// Length of the file of points `[bytes]`.
    most: u64,
    /// Bytes of a point, unpacked.
    row: u64,
    packed: bool,
}

impl List<'_> {
    /// Reads all chunks, the first of which has `first` bytes.
    fn nodes(&self, first: u64) -> Result<Vec<(Key, Stretch)>> {
        let most = self.hierarchy.length / ENTRY_BYTES;
        let (mut nodes, mut entries) = (Vec::new(), 0);
        let mut chunks: Vec<(Key, u64, u64)> = vec![([0; 4], 0, first)];
        while let Some((root, at, bytes)) = chunks.pop() {
            let wrong = |what: String| {
                let root = named(root);
                self.hierarchy.wrong(format!("has a chunk of node {root} at byte {at} {what}"))
            };
            let is_there = at.checked_add(bytes).is_some_and(|end| end <= self.hierarchy.length);
            if bytes == 0 || !bytes.is_multiple_of(ENTRY_BYTES) || !is_there {
                let length = self.hierarchy.length;
                return Err(wrong(format!(
                    "of {bytes} bytes, which the file of {length} does not have"
                )));
            }
            let own = bytes / ENTRY_BYTES;
            entries += own;
            if entries > most {
                return Err(wrong(format!(
                    "that overlaps another: with it there are {entries} entries, but the file has {most}"
                )));
            }
            let mut open = VecDeque::from([root]);
            for start in (0..own).step_by(ENTRIES as usize) {
                let count = ENTRIES.min(own - start);
                let mut block = vec![0; (count * ENTRY_BYTES) as usize];
                self.hierarchy.read_exactly(at + start * ENTRY_BYTES, &mut block)?;
                for (entry, k) in block.chunks_exact(ENTRY_BYTES as usize).zip(start..) {
                    let Some(key) = open.pop_front() else {
                        return Err(wrong(format!("with {own} entries for {k} nodes")));
                    };
                    let (place, size) = (u64_at(entry, 6), u64_at(entry, 14));
                    let wrong = |what: &str| {
                        let byte = at + k * ENTRY_BYTES;
                        wrong(format!("whose node {} {what} (entry at byte {byte})", named(key)))
                    };
                    if !is_inside(key) {
                        return Err(wrong("is deeper than 30 levels"));
                    }
                    match entry[0] {
                        PROXY if k == 0 => return Err(wrong("points at a chunk for itself")),
                        PROXY => {
                            chunks.push((key, place, size));
                            continue;
                        }
                        0 | 1 => {}
                        other => return Err(wrong(&format!("has the unknown type {other}"))),
                    }
                    let below = (0..8).filter(|child| entry[1] >> child & 1 != 0);
                    open.extend(below.map(|child| child_of(key, child)));
                    if open.len() as u64 > own - k - 1 {
                        return Err(wrong("has children without entries"));
                    }
                    // Nodes without bytes are empty, whatever they say (potree issue 1125).
                    let points = if size == 0 { 0 } else { u32_at(entry, 2) as u64 };
                    if place.checked_add(size).is_none_or(|end| end > self.most) {
                        return Err(wrong(&format!(
                            "has {size} bytes from {place} on, but octree.bin has {}",
                            self.most
                        )));
                    }
                    let unpacked = points * self.row;
                    if unpacked > MOST_NODE_BYTES {
                        return Err(wrong(&format!(
                            "claims {points} points; at most {} are read at a time",
                            MOST_NODE_BYTES / self.row
                        )));
                    }
                    if !self.packed && unpacked != size {
                        return Err(wrong(&format!(
                            "claims {points} points of {} bytes each in {size}",
                            self.row
                        )));
                    }
                    nodes.push((key, Stretch { at: place, bytes: size, points }));
                }
            }
            if !open.is_empty() {
                return Err(wrong(format!("without entries for {} nodes", open.len())));
            }
        }
        Ok(nodes)
    }
}

/// Returns a child of a node. Potree numbers them with z lowest.
fn child_of([level, x, y, z]: Key, child: i32) -> Key {
    [level + 1, x << 1 | child >> 2, y << 1 | child >> 1 & 1, z << 1 | child & 1]
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(array_at(bytes, at))
}

/// Returns the bytes that each attribute of a packed point has.
fn packed_widths(plan: &Plan) -> impl Iterator<Item = usize> {
    let width = |k: usize| match k {
        _ if plan.is_position(k) => PACKED_POSITION,
        _ if plan.is_color(k) => PACKED_COLOR,
        _ => plan.attributes[k].bytes(),
    };
    (0..plan.attributes.len()).map(width)
}

fn packed_bytes(plan: &Plan) -> usize {
    packed_widths(plan).sum()
}

impl NodeReader for Potree {
    fn ahead(&self, chunks: &[Stretch]) {
        self.input.ahead(chunks.iter().map(|chunk| chunk.at..chunk.at + chunk.bytes));
    }

    fn records(
        &self,
        chunk: &Stretch,
        _wanted: ColumnSet,
        take: &mut dyn FnMut(&[u8]) -> Result<()>,
    ) -> Result<Outcome> {
        let all = self.points.get(&chunk.at).copied().unwrap_or_default() as usize;
        let mut data = vec![0; chunk.bytes as usize];
        self.input.read_exactly(chunk.at, &mut data)?;
        let wrong = |what: String| {
            self.input.wrong(format!(
                "{what} (node of {all} points at bytes {} to {})",
                chunk.at,
                chunk.at + chunk.bytes
            ))
        };
        let places = if self.packed {
            let length = all * packed_bytes(&self.plan);
            data = catch_panic(|| unpack(&data, length))
                .flatten()
                .map_err(|why| wrong(format!("has points that cannot be unpacked: {why}")))?;
            self.plain(&mut data, all)
        } else {
            let stride = self.plan.row_bytes();
            let bytes = self.plan.attributes.iter().map(Attribute::bytes);
            let at = bytes.scan(0, |at, bytes| Some(std::mem::replace(at, *at + bytes)));
            at.map(|at| Place { at, stride }).collect()
        };
        let (mut block, points) = (Vec::new(), all.min(chunk.points as usize));
        for start in (0..points).step_by(BATCH) {
            block.clear();
            let some = start..points.min(start + BATCH);
            self.plan
                .write(&data, &places, some, &mut block)
                .map_err(|what| wrong(format!("has a point with {what}")))?;
            take(&block)?;
        }
        Ok(None)
    }
}

impl Potree {
    /// Turns Morton codes into numbers, in place. Returns where each attribute is.
    fn plain(&self, data: &mut [u8], points: usize) -> Vec<Place> {
        let (mut places, mut at) = (Vec::new(), 0);
        for (k, width) in packed_widths(&self.plan).enumerate() {
            let own = &mut data[at..at + points * width];
            if self.plan.is_position(k) {
                for i in 0..points {
                    let [high, low] = [0, 8].map(|part| u64_at(own, PACKED_POSITION * i + part));
                    for axis in 0..3 {
                        let part = |code: u64| every_third(code >> axis);
                        let v = part(high) << 16 | part(low);
                        let to = 12 * i + 4 * axis;
                        own[to..to + 4].copy_from_slice(&v.to_le_bytes());
                    }
                }
            } else if self.plan.is_color(k) {
                for i in 0..points {
                    let code = u64_at(own, PACKED_COLOR * i);
                    for channel in 0..3 {
                        let v = every_third(code >> channel) as u16;
                        let to = 6 * i + 2 * channel;
                        own[to..to + 2].copy_from_slice(&v.to_le_bytes());
                    }
                }
            }
            places.push(Place { at, stride: self.plan.attributes[k].bytes() });
            at += points * width;
        }
        places
    }
}

/// Returns the 16 bits that are every third of a code's low 48 bits.
fn every_third(code: u64) -> u32 {
    let v = code & 0x2492_4924_9249;
    let v = (v | v >> 2) & 0x10C3_0C30_C30C_30C3;
    let v = (v | v >> 4) & 0x100F_00F0_0F00_F00F;
    let v = (v | v >> 8) & 0x001F_0000_FF00_00FF;
    let v = (v | v >> 16) & 0x001F_0000_0000_FFFF;
    (v | v >> 32) as u32 & 0xFFFF
}

/// Unpacks exactly this many bytes.
fn unpack(packed: &[u8], length: usize) -> std::result::Result<Vec<u8>, String> {
    let mut from = Decompressor::new(packed, 1 << 14);
    let mut data = vec![0; length];
    from.read_exact(&mut data).map_err(|error| error.to_string())?;
    match from.read(&mut [0]) {
        Ok(0) => Ok(data),
        Ok(_) => Err(format!("they have more than {length} bytes")),
        Err(error) => Err(error.to_string()),
    }
}
