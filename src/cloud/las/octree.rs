//! Clouds whose points are nodes of an octree: COPC, Potree 2 and EPT.
//!
//! A node's points are in none of its children. Each format lists its nodes in its own way, and
//! nothing in such a list is believed: `copc`, `potree` and `ept` check it. The nodes of a COPC
//! file are chunks of a LAZ file, which [`Las`] decodes. Those of the others become records
//! by [`NodeReader`]; `layout` says which attribute is which field.

pub mod copc;
mod ept;
mod layout;
mod potree;

use super::header::Layout;
use super::laz::Outcome;
use super::{Las, Stretch};
use crate::cloud::ColumnSet;
use crate::cloud::input::{Input, OCTREES};
use crate::error::Result;
use crate::network::without_query;
use glam::DVec3;
use std::path::{Path, PathBuf};

/// Deepest level, so that numbers of nodes fit 32 bits.
const DEEPEST: i32 = 30;

/// Most bytes of a JSON file: of a list, about 800,000 nodes.
const MOST_JSON: u64 = 16 << 20;

/// Most bytes of a node's points, unpacked. Honest nodes have a few megabytes.
const MOST_NODE_BYTES: u64 = 96 << 20;

/// Level of a node, and its number along each axis.
pub type Key = [i32; 4];

/// A node with points.
#[derive(Clone, Copy, Debug)]
pub struct OctreeNode {
    pub key: Key,
    /// Its points. Where each node is a file, its place is its number.
    pub chunk: Stretch,
    /// Index of its first point in the cloud.
    pub first: u64,
}

/// The box of the root, and the nodes below each other in it.
#[derive(Clone, Debug)]
pub struct Octree {
    /// Least world corner, and lengths of the sides.
    pub corner: DVec3,
    pub sides: DVec3,
    /// Distance of the root's points.
    pub spacing: f64,
    /// Nodes level by level.
    pub nodes: Vec<OctreeNode>,
    /// Length of all files `[bytes]`.
    pub bytes: u64,
}

impl Octree {
    /// Returns the world corners of a node's box.
    pub fn cube(&self, [level, x, y, z]: Key) -> [DVec3; 2] {
        let sides = self.sides / 2f64.powi(level);
        [0, 1].map(|end| {
            self.corner + sides * DVec3::new((x + end) as f64, (y + end) as f64, (z + end) as f64)
        })
    }

    /// Returns the nodes in the order of their keys, without those that have no points.
    fn nodes_of(chunks: impl Iterator<Item = (Key, Stretch)>) -> Vec<OctreeNode> {
        let chunks = chunks.filter(|(_, chunk)| chunk.points > 0);
        let mut nodes: Vec<OctreeNode> =
            chunks.map(|(key, chunk)| OctreeNode { key, chunk, first: 0 }).collect();
        nodes.sort_unstable_by_key(|node| node.key);
        let mut first = 0;
        for node in &mut nodes {
            node.first = first;
            first += node.chunk.points;
        }
        nodes
    }
}

/// Returns the node above in which a node lies; `None` for the root.
pub fn parent([level, x, y, z]: Key) -> Option<Key> {
    (level > 0).then(|| [level - 1, x >> 1, y >> 1, z >> 1])
}

/// Returns a node as errors and the files of EPT name it.
pub fn named([level, x, y, z]: Key) -> String {
    format!("{level}-{x}-{y}-{z}")
}

/// Tests whether a node lies in the root.
fn is_inside(key: Key) -> bool {
    (0..=DEEPEST).contains(&key[0]) && key[1..].iter().all(|v| (0..1 << key[0]).contains(v))
}

/// A reader of nodes that are no chunks of a LAZ file.
pub trait NodeReader: Send + Sync {
    /// Announces that these nodes will be read.
    fn ahead(&self, chunks: &[Stretch]);

    /// Gives the points of a node as records, in order, in blocks of at most
    /// [`BATCH`](crate::cloud::stream::BATCH). `wanted` are the columns that are looked at. Returns
    /// a reason if the node ends early.
    fn records(
        &self,
        chunk: &Stretch,
        wanted: ColumnSet,
        take: &mut dyn FnMut(&[u8]) -> Result<()>,
    ) -> Result<Outcome>;
}

/// A cloud in several files, which its JSON describes.
pub struct Opened {
    pub layout: Layout,
    pub octree: Octree,
    pub reader: Box<dyn NodeReader>,
}

/// Tests whether a file describes an octree in other files. JSON has no signature, so it is by
/// name.
pub fn is_description(input: &Input) -> bool {
    OCTREES.into_iter().any(|name| has_name(&input.path, name))
}

fn has_name(path: &Path, name: &str) -> bool {
    without_query(path).ends_with(name)
}

/// Tests whether a file is an octree: COPC, or the description of one.
pub fn is_one(input: &Input) -> Result<bool> {
    Ok(is_description(input) || copc::is_copc(input)?)
}

/// Opens the description of an octree.
pub fn open(input: &Input, keeps_records: bool) -> Result<Opened> {
    let text = input.take(0, input.length.min(MOST_JSON + 1))?;
    if text.len() as u64 > MOST_JSON {
        return Err(input.wrong(format!("is larger than {} MiB", MOST_JSON >> 20)));
    }
    if has_name(&input.path, OCTREES[0]) {
        potree::open(input, &text)
    } else {
        ept::open(input, &text, keeps_records)
    }
}

/// Returns the files that tell whether a cloud is the same as before, if they are no objects on a
/// server.
pub fn files(input: &Input) -> Vec<PathBuf> {
    let beside: &[&str] = match () {
        () if has_name(&input.path, OCTREES[0]) => &potree::FILES,
        () if has_name(&input.path, OCTREES[1]) => &ept::FILES,
        () => &[],
    };
    let beside = beside.iter().map(|name| input.path.with_file_name(name));
    [input.path.clone()].into_iter().chain(beside.filter(|path| path.exists())).collect()
}

impl Las {
    /// Returns the octree; an error if there is none.
    pub fn octree(&self, input: &Input) -> Result<Octree> {
        self.octree.clone().map_or_else(|| copc::read(input, self), Ok)
    }
}
