//! NAME.pnti: the node index as a file.
//!
//! ```text
//! header, 4096 bytes   magic, version, length, offset of the directory, CRC-32C of both
//! planes               node by node, plane by plane, packed; CRC-32C of each in the directory;
//!                      derived planes last
//! directory            node records (children behind their parents, siblings side by side), then
//!                      the description of the input, as JSON
//! ```
//!
//! All integers are little-endian. A plane holds one number per point: ten bits per axis of the
//! position, or an attribute. A frame reads the planes that it needs. The header is written last,
//! after the rest is on the disk (guide: reliability): an index is complete or absent.

use super::schema::{
    CHECKSUMS, Contents, Directory, IndexedPart, NodeRecord, PLANES, Plane, bounds, lattice,
    samples, tree_lattice,
};
use super::shadow_file::SavedShadows;
use super::source::{NodeSource, Refinement};
use super::writer::{FileHeader, HEADER_BYTES, MAGIC, VERSION};
use crate::cloud::crs::Reference;
use crate::cloud::filter::Compiled;
use crate::cloud::ground::Surface;
use crate::cloud::input::Input;
use crate::cloud::strays::RobustBounds;
use crate::cloud::up::Up;
use crate::cloud::{Lattice, have_faces};
use crate::config::{BITS_PER_PLANE, POINTS_PER_PAGE, POSITION_PLANES};
use crate::error::{Error, Result};
use crate::index::fault_injection::Fault;
use bytemuck::Zeroable;
use glam::DVec3;
use std::path::Path;
use std::sync::Arc;

/// Bytes of a version 1 record before its checksums, of them, and after them; later versions have
/// more checksums.
const FIRST_VERSION: [usize; 3] = [64, 4 * 11, 20];

/// Converts a record of version 1.
fn from_version_1(bytes: &[u8]) -> NodeRecord {
    let [before, checksums, _] = FIRST_VERSION;
    let mut record = NodeRecord::zeroed();
    let own = bytemuck::bytes_of_mut(&mut record);
    own[..before + checksums].copy_from_slice(&bytes[..before + checksums]);
    own[before + 4 * CHECKSUMS..].copy_from_slice(&bytes[before + checksums..]);
    record
}

/// An open index.
pub struct Index {
    source: Box<dyn NodeSource>,
    pub directory: Directory,
    /// What drawing the children of a node does to it.
    pub refinement: Refinement,
    /// Checksums of directory and header.
    identity: u64,
    /// Saved shadows, if they were opened.
    pub shadows: Option<SavedShadows>,
    /// Box outside of which nothing is drawn.
    pub hidden: Option<RobustBounds>,
    /// Filter of the points that are drawn.
    pub filter: Option<Compiled>,
    /// The axis that points up.
    pub up: Up,
    /// Ground from which heights count, if it was found.
    pub ground: Option<Arc<Surface>>,
    /// Fault to inject, for tests.
    pub fault: Option<Fault>,
}

impl Index {
    /// Returns whether a file starts as an index does. A pipe is not opened, since that could block
    /// forever.
    pub fn is_one(path: &Path) -> bool {
        let begin = Input::open(path).and_then(|input| input.take(0, MAGIC.len() as u64));
        begin.is_ok_and(|begin| begin == MAGIC)
    }

    /// Opens an index and checks everything except the planes, which are checked when they are
    /// read.
    pub fn open(path: &Path) -> Result<Index> {
        let input = Input::open_mapped(path)?;
        let wrong = |what: String| {
            Error::format(path, format!("{what}; make it again with `pointillist index`"))
        };
        let mut header = FileHeader::zeroed();
        if input.length < HEADER_BYTES {
            return Err(wrong(format!("is not a complete index ({} bytes)", input.length)));
        }
        input.read_exactly(0, bytemuck::bytes_of_mut(&mut header))?;
        if header.magic != MAGIC {
            return Err(wrong("is not an index, or is unfinished".into()));
        }
        if header.version > VERSION {
            return Err(Error::format(
                path,
                format!(
                    "is an index of version {}, made by a newer pointillist; this one reads up to {VERSION}",
                    header.version
                ),
            ));
        }
        if header.own_crc() != header.header_crc || header.version == 0 {
            return Err(wrong("has a damaged header".into()));
        }
        if header.length != input.length {
            return Err(wrong(format!("has {} of {} bytes", input.length, header.length)));
        }
        // In u128, so that no sum of a crafted header overflows.
        let record_bytes =
            if header.version == 1 { FIRST_VERSION.iter().sum() } else { size_of::<NodeRecord>() };
        let records = header.nodes as u128 * record_bytes as u128;
        if header.directory_at as u128 + records + header.contents_bytes as u128
            != header.length as u128
        {
            return Err(wrong("has a directory that does not fit its length".into()));
        }
        let mut bytes = vec![0; records as usize];
        input.read_exactly(header.directory_at, &mut bytes)?;
        let mut contents = vec![0; header.contents_bytes as usize];
        input.read_exactly(header.directory_at + records as u64, &mut contents)?;
        if crc32c::crc32c_append(crc32c::crc32c(&bytes), &contents) != header.directory_crc {
            return Err(wrong("has a damaged directory".into()));
        }
        let record =
            if header.version == 1 { from_version_1 } else { bytemuck::pod_read_unaligned };
        let nodes = bytes.chunks_exact(record_bytes).map(record).collect();
        let contents: Contents = serde_json::from_slice(&contents)
            .map_err(|error| wrong(format!("has unreadable contents ({error})")))?;
        let directory = Directory { nodes, roots: header.roots, contents };
        check(&directory, header.directory_at).map_err(wrong)?;
        let identity = (header.directory_crc as u64) << 32 | header.header_crc as u64;
        Ok(Index::of(Box::new(Stored(input)), directory, Refinement::Replaces, identity))
    }

    /// Returns the index of a source of nodes, which `directory` describes.
    pub(in crate::index) fn of(
        source: Box<dyn NodeSource>,
        directory: Directory,
        refinement: Refinement,
        identity: u64,
    ) -> Index {
        Index {
            source,
            directory,
            refinement,
            identity,
            shadows: None,
            hidden: None,
            filter: None,
            up: Up::Z,
            ground: None,
            fault: None,
        }
    }

    pub fn path(&self) -> &Path {
        self.source.path()
    }

    /// Opens a shadow file, which must belong to this index.
    pub fn open_shadows(&self, path: &Path) -> Result<SavedShadows> {
        SavedShadows::open(path, self.path(), self.identity, self.nodes())
    }

    /// Returns the reference system of its coordinates.
    pub fn reference(&self) -> Reference {
        let lattice = |part: &IndexedPart| Lattice { step: part.step, offset: part.offset };
        Reference::of(
            self.directory.contents.parts.iter().map(|part| (&part.header, lattice(part))),
        )
    }

    /// Returns whether faces join the points of all files.
    pub fn has_faces(&self) -> bool {
        have_faces(self.directory.contents.parts.iter().map(|part| &part.header))
    }

    /// Returns a number that identifies this index among those with other points.
    pub fn identity(&self) -> u64 {
        self.identity
    }

    /// Copies bytes of the file, unchecked.
    pub(in crate::index) fn copy(&self, at: u64, into: &mut [u8]) -> Result<()> {
        self.source.copy(at, into)
    }

    /// Returns the corner of a node's tree in steps of its files' lattice.
    pub(in crate::index) fn tree_corner(&self, node: &NodeRecord) -> [i64; 3] {
        let lattices = &self.directory.contents.lattices;
        let [step, offset] = lattices[node.lattice as usize / 2 * 2];
        ((tree_lattice(node, lattices).offset - offset) / step)
            .round()
            .to_array()
            .map(|steps| steps as i64)
    }

    /// Returns the length of the file `[bytes]`.
    pub fn bytes(&self) -> u64 {
        self.source.bytes()
    }

    pub fn nodes(&self) -> &[NodeRecord] {
        &self.directory.nodes
    }

    /// Returns the lattice of a node's `origin` and `extent`.
    pub fn lattice(&self, node: &NodeRecord) -> Lattice {
        lattice(node, &self.directory.contents.lattices)
    }

    /// Returns the world corners of a box around all points of a node: that of its samples, widened
    /// by the distance of the points that a sample stands for.
    pub fn bounds(&self, node: &NodeRecord) -> (DVec3, DVec3) {
        bounds(node, &self.directory.contents.lattices)
    }

    /// Returns whether some node has this plane.
    pub fn has(&self, plane: Plane) -> bool {
        self.nodes().iter().any(|node| node.has(plane))
    }

    /// Announces that planes of nodes will be read, which the nodes have.
    pub fn ahead(&self, wanted: &[(usize, Vec<Plane>)]) {
        self.source.ahead(self.nodes(), wanted);
    }

    /// Tests whether its nodes are on a server.
    pub fn is_remote(&self) -> bool {
        self.source.is_remote()
    }

    /// Reads a plane of a node, as [`NodeSource::read`].
    pub fn read(&self, node: usize, plane: Plane, into: &mut [u8]) -> Result<u64> {
        let record = &self.directory.nodes[node];
        assert_eq!(
            (into.len() as u64, record.has(plane)),
            (record.unpacked_bytes(plane), true),
            "node {node} has no such plane {plane:?}"
        );
        self.source.read(node, record, plane, into)
    }

    /// Returns world positions and weights of a node's samples, with all of its position planes.
    pub fn samples(&self, node: usize) -> Result<Vec<(DVec3, u32)>> {
        let record = &self.directory.nodes[node];
        samples(record, self.lattice(record), &mut |plane, into| {
            self.read(node, plane, into).map(|_| ())
        })
    }
}

/// The planes of a file NAME.pnti.
struct Stored(Input);

impl NodeSource for Stored {
    fn path(&self) -> &Path {
        &self.0.path
    }

    fn bytes(&self) -> u64 {
        self.0.length
    }

    fn copy(&self, at: u64, into: &mut [u8]) -> Result<()> {
        self.0.read_exactly(at, into)
    }

    fn ahead(&self, nodes: &[NodeRecord], wanted: &[(usize, Vec<Plane>)]) {
        self.0.ahead(wanted.iter().flat_map(|(node, planes)| {
            planes.iter().map(|&plane| {
                let (at, bytes) = nodes[*node].range(plane);
                at..at + bytes
            })
        }));
    }

    fn is_remote(&self) -> bool {
        self.0.is_remote()
    }

    fn read(&self, node: usize, record: &NodeRecord, plane: Plane, into: &mut [u8]) -> Result<u64> {
        let (at, bytes) = record.range(plane);
        let read = |into: &mut [u8]| {
            self.copy(at, into)?;
            if crc32c::crc32c(into) != record.crc[plane as usize] {
                let end = at + bytes;
                return Err(Error::format(
                    self.path(),
                    format!(
                        "is damaged: the checksum of node {node}'s {plane:?} plane (bytes {at} to {end}) is wrong"
                    ),
                ));
            }
            Ok(bytes)
        };
        if plane != Plane::Station {
            return read(into);
        }
        let mut stored = vec![0; bytes as usize];
        read(&mut stored)?;
        into.copy_from_slice(&record.stations(&stored));
        Ok(bytes)
    }
}

/// Checks what tree walks rely on: children behind their parents and each under one, planes inside
/// the file, numbers in their ranges.
fn check(directory: &Directory, end: u64) -> std::result::Result<(), String> {
    let nodes = &directory.nodes;
    if directory.roots as usize > nodes.len() {
        return Err(format!("claims {} roots among {} nodes", directory.roots, nodes.len()));
    }
    for &[step, offset] in &directory.contents.lattices {
        if let Some(what) = (Lattice { step: step.abs(), offset }).wrong() {
            return Err(what);
        }
    }
    let mut next = directory.roots as usize;
    for (i, node) in nodes.iter().enumerate() {
        let wrong = |what: &str| Err(format!("has a node {i} {what}"));
        if node.count == 0 || node.count > POINTS_PER_PAGE || node.points < node.count as u64 {
            return wrong("with an impossible number of points");
        }
        if node.lattice as usize >= directory.contents.lattices.len() || node.coarser > 64 {
            return wrong("on an unknown lattice");
        }
        let longest = node.extent.iter().max().map_or(0, |&side| 32 - side.leading_zeros()).max(1);
        if node.bits as u32 != longest || longest > BITS_PER_PLANE * POSITION_PLANES {
            return wrong("whose box does not fit its planes");
        }
        if node.origin.iter().any(|origin| origin.unsigned_abs() > 1 << 60) {
            return wrong("beyond any coordinate");
        }
        let (lo, hi) = bounds(node, &directory.contents.lattices);
        if let Some(what) = lattice(node, &directory.contents.lattices).too_far(lo, hi) {
            return wrong(&format!("that {what}"));
        }
        if (0..3)
            .any(|plane| node.has(PLANES[plane].0) != ((plane as u32) < node.position_planes()))
            || (node.single_station().is_some() && !node.has(Plane::Station))
        {
            return wrong("with the wrong planes");
        }
        if node.at < HEADER_BYTES || node.at.checked_add(node.bytes()).is_none_or(|last| last > end)
        {
            return wrong("beyond the end of the file");
        }
        if !node.spacing.is_finite()
            || node.spacing < 0.0
            || (node.spacing == 0.0) != node.is_leaf()
        {
            return wrong("with an impossible spacing");
        }
        if i < directory.roots as usize && node.parent as usize != i {
            return wrong("that is a root below another node");
        }
        if node.is_leaf() {
            if node.points != node.count as u64 {
                return wrong("that is an incomplete leaf");
            }
            continue;
        }
        // Children are in the order of their parents, so that ranges are disjoint, nothing is left
        // out, and no walk cycles.
        if node.first_child as usize != next
            || next <= i
            || node.first_child as u64 + node.children as u64 > nodes.len() as u64
        {
            return wrong("with misplaced children");
        }
        next += node.children as usize;
        let children = &nodes[node.children()];
        let sum = children.iter().fold(0u64, |sum, child| sum.saturating_add(child.points));
        if sum != node.points || children.iter().any(|child| child.parent as usize != i) {
            return wrong("with children of another node");
        }
    }
    if next != nodes.len() {
        return Err(format!("has {} nodes without a parent", nodes.len() - next.min(nodes.len())));
    }
    let stations = directory.contents.stations.len();
    let Contents { balance, intensity_balance, .. } = &directory.contents;
    if [balance, intensity_balance]
        .into_iter()
        .flatten()
        .any(|balance| balance.gains.len() != stations || !balance.is_valid())
    {
        return Err("has impossible exposures".into());
    }
    if directory
        .contents
        .counts
        .as_ref()
        .is_some_and(|counts| !counts.are_possible(directory.contents.points))
    {
        return Err("has impossible numbers of points of some class or return number".into());
    }
    let total = nodes[..directory.roots as usize]
        .iter()
        .fold(0u64, |sum, root| sum.saturating_add(root.points));
    if total != directory.contents.points {
        return Err(format!("claims {} points but has {total}", directory.contents.points));
    }
    Ok(())
}
