//! NAME.pnti: the node index as a file.
//!
//! ```text
//! header, 4096 bytes   magic, version, length, where the directory lies, CRC-32C of both
//! planes               node by node, plane by plane, packed; CRC-32C of each in the directory; those that are derived last
//! directory            node records (children behind their parents, siblings side by side), then what was opened, as JSON
//! ```
//! All integers are little-endian. A plane is one number a point: ten bits an axis of the positions, or an attribute. A frame reads the planes that it needs.
//! The header is written last, after the rest is on the disk (RELIABILITY, write protocol): an index is whole or it is none.

use super::axes::Axes;
use super::exposure::Balance;
use super::fault::Fault;
use super::map::Map;
use super::marks::Marks;
use crate::cloud::attribute::Attribute;
use crate::cloud::color::Scale;
use crate::cloud::histograms::Histograms;
use crate::cloud::strays::Core;
use crate::cloud::system::Reference;
use crate::cloud::{Header, Lattice, Station};
use crate::config::{BITS_PER_PLANE, POINTS_PER_PAGE, POSITION_PLANES};
use crate::error::{Error, Result};
use crate::whole_file::WholeFile;
use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::path::{Path, PathBuf};

const MAGIC: [u8; 8] = *b"pnti\r\n\x1a\n";
/// The second has room for planes that are derived, the third numbers stations in 8 bits; those before are read all the same.
const VERSION: u32 = 3;
const HEADER_BYTES: u64 = 4096;

/// What a plane holds, in the order in which a node's planes follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Plane {
    /// 10 + 10 + 10 bits of the position, coarsest first.
    Coarse,
    Fine,
    Finest,
    /// sRGB, 8 bits a channel.
    Rgb,
    Intensity,
    Class,
    /// Return number (low four bits) and number of returns.
    Returns,
    /// Number of the station, in [`Contents::stations`], of nodes whose numbers are not all below 256.
    Source,
    /// Unit normal, 127 = 1.0.
    Normal,
    GpsTime,
    /// Of inner nodes: the points that the sample stands for.
    Weight,
    /// Derived ([`super::derive`]): the normal of the surface ([`crate::cloud::octahedral`]), and eight bits that look random, highest.
    Facing,
    /// Derived: what a brush needs to know beside the normal (`strokes::Stroke::words`).
    Brush,
    /// Derived: colour whose luminance is the mean of the neighbourhood, as [`Plane::Rgb`].
    Corrected,
    /// Number of the station of nodes whose numbers all are: half of what pictures with one exposure would read otherwise. Of few stations two numbers share a byte, and of one the record says which it is.
    Station,
}

pub const PLANES: [(Plane, u64); 15] = [
    (Plane::Coarse, 4),
    (Plane::Fine, 4),
    (Plane::Finest, 4),
    (Plane::Rgb, 3),
    (Plane::Intensity, 2),
    (Plane::Class, 1),
    (Plane::Returns, 1),
    (Plane::Source, 2),
    (Plane::Normal, 3),
    (Plane::GpsTime, 8),
    (Plane::Weight, 4),
    (Plane::Facing, 4),
    (Plane::Brush, 4),
    (Plane::Corrected, 3),
    (Plane::Station, 1),
];

/// Checksums that a record has room for: an odd number, so that it has no gaps.
pub const CHECKSUMS: usize = PLANES.len();

impl Plane {
    /// Those of which a node has one where it says which stations its points are of.
    pub const STATIONS: [Plane; 2] = [Plane::Station, Plane::Source];

    pub fn bytes_per_point(self) -> u64 {
        PLANES[self as usize].1
    }

    /// The planes that an attribute is shown from, the first of them that a node has; positions show elevation.
    pub fn of(attribute: Attribute) -> &'static [Plane] {
        match attribute {
            Attribute::Rgb => &[Plane::Rgb],
            Attribute::Intensity => &[Plane::Intensity],
            Attribute::Class => &[Plane::Class],
            Attribute::Source => &Plane::STATIONS,
            Attribute::Return => &[Plane::Returns],
            Attribute::Normal => &[Plane::Normal, Plane::Facing],
            Attribute::Corrected => &[Plane::Corrected],
            Attribute::Elevation | Attribute::White => &[],
        }
    }
}

/// A node as the directory holds it.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct NodeRecord {
    /// Least coordinates, in steps of its lattice times 2^`coarser`.
    pub origin: [i64; 3],
    /// Points of the file that lie in it.
    pub points: u64,
    /// Of its first plane in the file.
    pub at: u64,
    /// Longest side of the cells that its samples were merged in, metres; 0 for a leaf, which has every point.
    pub spacing: f64,
    /// Inclusive, in the same steps as `origin`.
    pub extent: [u32; 3],
    /// Samples that it holds, at most a page.
    pub count: u32,
    pub crc: [u32; CHECKSUMS],
    pub first_child: u32,
    pub children: u32,
    /// Of itself for a root.
    pub parent: u32,
    /// Bit `k`: it has `PLANES[k]`; [`ONE_STATION`].
    pub planes: u16,
    pub lattice: u16,
    /// Bits that the longest side needs.
    pub bits: u8,
    /// Inner nodes keep positions to 2^`coarser` lattice steps.
    pub coarser: u8,
    pub level: u8,
    /// With [`ONE_STATION`] that station; else [`HALVES`] where two numbers share a byte.
    pub station: u8,
}

/// Of [`NodeRecord::planes`], beside the bit of [`Plane::Station`].
pub const ONE_STATION: u16 = 1 << PLANES.len();
/// Numbers of stations below 16, the first of two in the lower half.
pub const HALVES: u8 = 2;

/// Bytes of a record of the first version before its checksums, of these, and after them. Only there are fewer of them.
const FIRST_VERSION: [usize; 3] = [64, 4 * 11, 20];

/// A record of the first version.
fn widened(bytes: &[u8]) -> NodeRecord {
    let [before, checksums, _] = FIRST_VERSION;
    let mut record = NodeRecord::zeroed();
    let own = bytemuck::bytes_of_mut(&mut record);
    own[..before + checksums].copy_from_slice(&bytes[..before + checksums]);
    own[before + 4 * CHECKSUMS..].copy_from_slice(&bytes[before + checksums..]);
    record
}

impl NodeRecord {
    pub fn is_leaf(&self) -> bool {
        self.children == 0
    }

    pub fn children(&self) -> std::ops::Range<usize> {
        self.first_child as usize..(self.first_child + self.children) as usize
    }

    pub fn position_planes(&self) -> u32 {
        (self.bits as u32).div_ceil(BITS_PER_PLANE)
    }

    pub fn has(&self, plane: Plane) -> bool {
        self.planes >> plane as u16 & 1 == 1
    }

    /// The station of all of its points, where it has been one.
    pub fn one_station(&self) -> Option<u8> {
        (self.planes & ONE_STATION != 0).then_some(self.station)
    }

    /// Numbers of the points' stations, from what [`Plane::Station`] has in the file.
    pub fn stations(&self, stored: &[u8]) -> Vec<u8> {
        match self.one_station() {
            Some(station) => vec![station; self.count as usize],
            None if self.station == HALVES => stored
                .iter()
                .flat_map(|both| [both & 15, both >> 4])
                .take(self.count as usize)
                .collect(),
            None => stored.to_vec(),
        }
    }

    /// Bytes of a plane once it is read.
    pub fn unpacked(&self, plane: Plane) -> u64 {
        plane.bytes_per_point() * self.count as u64
    }

    /// Where a plane lies in the file, and how many bytes it has there.
    pub fn range(&self, plane: Plane) -> (u64, u64) {
        let stored = |plane| match plane {
            Plane::Station if self.one_station().is_some() => 0,
            Plane::Station if self.station == HALVES => self.unpacked(plane).div_ceil(2),
            _ => self.unpacked(plane),
        };
        let before = PLANES[..plane as usize].iter().filter(|(p, _)| self.has(*p));
        (self.at + before.map(|(p, _)| stored(*p)).sum::<u64>(), stored(plane))
    }

    /// Of all its planes in the file.
    pub fn bytes(&self) -> u64 {
        PLANES
            .iter()
            .filter(|(plane, _)| self.has(*plane))
            .map(|(plane, _)| self.range(*plane).1)
            .sum()
    }
}

/// One file, or one scan of one, that went into the index.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IndexedPart {
    #[serde(with = "any_path")]
    pub path: PathBuf,
    pub name: Option<String>,
    pub header: Header,
    pub step: DVec3,
    pub offset: DVec3,
    pub points: u64,
    pub intensity_range: [f64; 2],
    pub rgb_bits: u8,
    /// What the file's own colours count to; indexes of earlier versions say nothing of it.
    #[serde(default)]
    pub rgb_scale: Scale,
}

/// A path as text, or as its bytes where it is none: JSON has no other way.
mod any_path {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};
    use std::ffi::OsString;
    use std::path::{Path, PathBuf};

    #[derive(Serialize, Deserialize)]
    #[serde(untagged)]
    enum Kept {
        Text(String),
        Bytes(Vec<u8>),
    }

    pub fn serialize<S: Serializer>(path: &Path, serializer: S) -> Result<S::Ok, S::Error> {
        let bytes = || path.as_os_str().as_encoded_bytes().to_vec();
        path.to_str()
            .map_or_else(|| Kept::Bytes(bytes()), |text| Kept::Text(text.to_owned()))
            .serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<PathBuf, D::Error> {
        Ok(match Kept::deserialize(deserializer)? {
            Kept::Text(text) => text.into(),
            Kept::Bytes(bytes) => os_string(bytes).into(),
        })
    }

    #[cfg(unix)]
    fn os_string(bytes: Vec<u8>) -> OsString {
        std::os::unix::ffi::OsStringExt::from_vec(bytes)
    }

    #[cfg(not(unix))]
    fn os_string(bytes: Vec<u8>) -> OsString {
        String::from_utf8_lossy(&bytes).into_owned().into()
    }
}

/// What was opened, and what is known of all of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Contents {
    pub parts: Vec<IndexedPart>,
    pub stations: Vec<Station>,
    pub notes: Vec<String>,
    /// Step and offset: for every tree the file's own, on which leaves lie, and the same with its offset at the tree's corner, on which rounded positions of
    /// inner nodes lie.
    pub lattices: Vec<[DVec3; 2]>,
    pub points: u64,
    /// World corners of the box around the points; none without points.
    pub bounds: Option<[DVec3; 2]>,
    /// Intensities at the 2nd and 98th percentile.
    pub intensity_stretch: [u32; 2],
    /// The same of the heights, as `attribute::DisplayAttribute` counts them.
    pub elevation_stretch: [u32; 2],
    /// Normals that were derived are those of the files, all of them, and say which side of a surface is outside.
    #[serde(default)]
    pub oriented: bool,
    /// Of all points, where strokes were derived; those of the file where they were not.
    #[serde(default, skip_serializing_if = "Axes::are_the_files")]
    pub axes: Axes,
    /// What gives all stations one exposure. A sample that is merged of several stations has the light of the one that it names. Indexes that were made before anybody looked for it have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub balance: Option<Balance>,
    /// Points of the files, not samples. Indexes that were made before anybody counted have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub counts: Option<Histograms>,
}

/// Nodes and contents.
#[derive(Clone, Debug, Default)]
pub struct Directory {
    /// Roots first.
    pub nodes: Vec<NodeRecord>,
    pub roots: u32,
    pub contents: Contents,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct FileHeader {
    magic: [u8; 8],
    version: u32,
    nodes: u32,
    length: u64,
    directory_at: u64,
    contents_bytes: u64,
    roots: u32,
    directory_crc: u32,
    header_crc: u32,
    spare: u32,
}

impl FileHeader {
    fn own_crc(&self) -> u32 {
        crc32c::crc32c(bytemuck::bytes_of(&FileHeader { header_crc: 0, ..*self }))
    }
}

/// An index on its way.
pub struct Writer {
    whole: WholeFile,
    file: File,
    path: PathBuf,
}

impl Writer {
    pub fn create(path: &Path) -> Result<Writer> {
        let whole = WholeFile::create(path)?;
        let file = File::options()
            .read(true)
            .write(true)
            .open(whole.partial())
            .map_err(|error| Error::io("create", path, error))?;
        Ok(Writer { whole, file, path: path.to_owned() })
    }

    /// Where the first plane goes.
    pub const START: u64 = HEADER_BYTES;

    /// Writes planes; from any thread, each its own range.
    pub fn put(&self, at: u64, bytes: &[u8]) -> Result<()> {
        std::os::unix::fs::FileExt::write_all_at(&self.file, bytes, at)
            .map_err(|error| Error::io("write", &self.path, error))?;
        self.start_writing_back(at, bytes.len());
        Ok(())
    }

    /// Asks the system to bring a range to the disk now, so that `finish` has little left to wait for. A hint: nobody relies on it.
    #[cfg(target_os = "linux")]
    fn start_writing_back(&self, at: u64, bytes: usize) {
        use std::os::fd::AsRawFd;
        // SAFETY: a plain system call on an open file.
        unsafe {
            libc::sync_file_range(
                self.file.as_raw_fd(),
                at as i64,
                bytes as i64,
                libc::SYNC_FILE_RANGE_WRITE,
            )
        };
    }

    #[cfg(not(target_os = "linux"))]
    fn start_writing_back(&self, _at: u64, _bytes: usize) {}

    /// Reads back what was put.
    pub fn get(&self, at: u64, bytes: &mut [u8]) -> Result<()> {
        std::os::unix::fs::FileExt::read_exact_at(&self.file, bytes, at)
            .map_err(|error| Error::io("read", &self.path, error))
    }

    /// Directory, then to the disk, then the header, then to the disk, then the name.
    pub fn finish(self, directory: &Directory, end: u64) -> Result<u64> {
        let records: &[u8] = bytemuck::cast_slice(&directory.nodes);
        let contents = serde_json::to_vec(&directory.contents)
            .map_err(|error| Error::Request(error.to_string()))?;
        // JSON has no infinity, and a lattice that comes back one digit off moves every point.
        if !serde_json::from_slice(&contents)
            .is_ok_and(|again: Contents| again == directory.contents)
        {
            return Err(Error::Request(format!(
                "{}: what was opened has numbers that an index cannot keep",
                self.path.display()
            )));
        }
        self.put(end, records)?;
        self.put(end + records.len() as u64, &contents)?;
        let length = end + (records.len() + contents.len()) as u64;
        let mut header = FileHeader {
            magic: MAGIC,
            version: VERSION,
            nodes: directory.nodes.len() as u32,
            length,
            directory_at: end,
            contents_bytes: contents.len() as u64,
            roots: directory.roots,
            directory_crc: crc32c::crc32c_append(crc32c::crc32c(records), &contents),
            header_crc: 0,
            spare: 0,
        };
        header.header_crc = header.own_crc();
        let mut page = vec![0; HEADER_BYTES as usize];
        page[..size_of::<FileHeader>()].copy_from_slice(bytemuck::bytes_of(&header));
        self.close(&page)?;
        Ok(length)
    }

    /// What was put to the disk, then the header, then that, then the name.
    pub fn close(self, header: &[u8]) -> Result<()> {
        self.file.sync_all().map_err(|error| Error::io("write", &self.path, error))?;
        self.put(0, header)?;
        self.whole.finish()
    }
}

/// An index that can be read.
pub struct Index {
    map: Map,
    pub directory: Directory,
    /// Checksums of directory and header.
    identity: u64,
    /// How much of a light reaches its points, where somebody has saved that.
    pub marks: Option<Marks>,
    /// The box outside of which nothing is drawn.
    pub hidden: Option<Core>,
    /// For tests.
    pub fault: Option<Fault>,
}

impl Index {
    /// Whether a file begins as an index does. A pipe is none, and is not opened, which could wait for ever.
    pub fn is_one(path: &Path) -> bool {
        let mut magic = [0; 8];
        path.is_file()
            && File::open(path)
                .and_then(|mut file| std::io::Read::read_exact(&mut file, &mut magic))
                .is_ok()
            && magic == MAGIC
    }

    /// Checks everything but the planes, which are checked when they are read.
    pub fn open(path: &Path) -> Result<Index> {
        let map = Map::open(path)?;
        let wrong = |what: String| {
            Error::format(path, format!("{what}; make it again with `pointillist index`"))
        };
        let mut header = FileHeader::zeroed();
        if map.len() < HEADER_BYTES {
            return Err(wrong(format!("is no complete index ({} bytes)", map.len())));
        }
        map.copy(0, bytemuck::bytes_of_mut(&mut header))?;
        if header.magic != MAGIC {
            return Err(wrong("is no index, or an unfinished one".into()));
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
        if header.length != map.len() {
            return Err(wrong(format!("has {} bytes of {}", map.len(), header.length)));
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
        map.copy(header.directory_at, &mut bytes)?;
        let mut contents = vec![0; header.contents_bytes as usize];
        map.copy(header.directory_at + records as u64, &mut contents)?;
        if crc32c::crc32c_append(crc32c::crc32c(&bytes), &contents) != header.directory_crc {
            return Err(wrong("has a damaged directory".into()));
        }
        let record = if header.version == 1 { widened } else { bytemuck::pod_read_unaligned };
        let nodes = bytes.chunks_exact(record_bytes).map(record).collect();
        let contents: Contents = serde_json::from_slice(&contents)
            .map_err(|error| wrong(format!("has unreadable contents ({error})")))?;
        let directory = Directory { nodes, roots: header.roots, contents };
        check(&directory, header.directory_at).map_err(wrong)?;
        let identity = (header.directory_crc as u64) << 32 | header.header_crc as u64;
        Ok(Index { map, directory, identity, marks: None, hidden: None, fault: None })
    }

    pub fn path(&self) -> &Path {
        self.map.path()
    }

    /// What the coordinates of its points mean.
    pub fn reference(&self) -> Reference {
        let lattice = |part: &IndexedPart| Lattice { step: part.step, offset: part.offset };
        Reference::of(
            self.directory.contents.parts.iter().map(|part| (&part.header, lattice(part))),
        )
    }

    /// Of this index, and of none with other points.
    pub fn identity(&self) -> u64 {
        self.identity
    }

    /// Copies bytes of the file, whatever they are.
    pub(super) fn copy(&self, at: u64, into: &mut [u8]) -> Result<()> {
        self.map.copy(at, into)
    }

    /// Where the tree of a node starts, in steps of its files' lattice.
    pub(super) fn corner(&self, node: &NodeRecord) -> [i64; 3] {
        let lattices = &self.directory.contents.lattices;
        let [step, offset] = lattices[node.lattice as usize / 2 * 2];
        ((of_tree(node, lattices).offset - offset) / step)
            .round()
            .to_array()
            .map(|steps| steps as i64)
    }

    /// Bytes of the file.
    pub fn bytes(&self) -> u64 {
        self.map.len()
    }

    pub fn nodes(&self) -> &[NodeRecord] {
        &self.directory.nodes
    }

    /// The lattice that a node's `origin` and `extent` count steps of.
    pub fn lattice(&self, node: &NodeRecord) -> Lattice {
        lattice(node, &self.directory.contents.lattices)
    }

    /// World corners of a box around all points of the file that lie in a node: that of its samples, and as far beyond as the points that a sample stands for.
    pub fn bounds(&self, node: &NodeRecord) -> (DVec3, DVec3) {
        bounds(node, &self.directory.contents.lattices)
    }

    /// Whether some node has this plane.
    pub fn has(&self, plane: Plane) -> bool {
        self.nodes().iter().any(|node| node.has(plane))
    }

    /// Copies one plane of one node out of the file and checks the copy. `into` has [`NodeRecord::range`]'s bytes.
    pub fn read(&self, node: usize, plane: Plane, into: &mut [u8]) -> Result<()> {
        let record = &self.directory.nodes[node];
        let (at, bytes) = record.range(plane);
        assert_eq!(
            (into.len() as u64, record.has(plane)),
            (record.unpacked(plane), true),
            "node {node} has no such plane {plane:?}"
        );
        if plane != Plane::Station {
            return self.stored(node, plane, at, into);
        }
        let mut stored = vec![0; bytes as usize];
        self.stored(node, plane, at, &mut stored)?;
        into.copy_from_slice(&record.stations(&stored));
        Ok(())
    }

    /// As it is in the file, from this byte on.
    fn stored(&self, node: usize, plane: Plane, at: u64, into: &mut [u8]) -> Result<()> {
        self.map.copy(at, into)?;
        if crc32c::crc32c(into) != self.directory.nodes[node].crc[plane as usize] {
            let end = at + into.len() as u64;
            return Err(Error::format(
                self.path(),
                format!(
                    "is damaged: the checksum of node {node}'s {plane:?} plane (bytes {at} to {end}) is wrong"
                ),
            ));
        }
        Ok(())
    }

    /// World positions and weights of a node's samples, from as many planes as it has.
    pub fn samples(&self, node: usize) -> Result<Vec<(DVec3, u32)>> {
        let record = &self.directory.nodes[node];
        samples(record, self.lattice(record), &mut |plane, into| self.read(node, plane, into))
    }
}

/// The lattice that a node's `origin` and `extent` count steps of. Rounded positions lie in the middle of theirs.
pub fn lattice(node: &NodeRecord, lattices: &[[DVec3; 2]]) -> Lattice {
    let [step, offset] = lattices[node.lattice as usize];
    let coarse = 2f64.powi(node.coarser as i32);
    Lattice { step: step * coarse, offset: offset + step * (coarse / 2.0).floor() }
}

/// The lattice that starts where the tree of a node does.
pub fn of_tree(node: &NodeRecord, lattices: &[[DVec3; 2]]) -> Lattice {
    // Every tree has two lattices, one behind the other, that differ by nothing else.
    let [step, offset] = lattices[(node.lattice as usize | 1).min(lattices.len() - 1)];
    Lattice { step, offset }
}

/// As [`Index::bounds`].
pub fn bounds(node: &NodeRecord, lattices: &[[DVec3; 2]]) -> (DVec3, DVec3) {
    let lattice = lattice(node, lattices);
    let top = [0, 1, 2].map(|axis| node.origin[axis] + node.extent[axis] as i64);
    let (a, b) = (lattice.world(node.origin), lattice.world(top));
    (a.min(b) - node.spacing, a.max(b) + node.spacing)
}

/// World positions and weights of a node's samples; `read` fills a plane's bytes.
pub fn samples(
    node: &NodeRecord,
    lattice: Lattice,
    read: &mut dyn FnMut(Plane, &mut [u8]) -> Result<()>,
) -> Result<Vec<(DVec3, u32)>> {
    let mut words = vec![0u32; node.count as usize];
    let mut cells = vec![[0u32; 3]; node.count as usize];
    for &(plane, _) in &PLANES[..node.position_planes() as usize] {
        read(plane, bytemuck::cast_slice_mut(&mut words))?;
        for (cells, &word) in cells.iter_mut().zip(&words) {
            *cells = [0, 1, 2].map(|axis| {
                cells[axis] << BITS_PER_PLANE
                    | word >> (BITS_PER_PLANE * axis as u32) & ((1 << BITS_PER_PLANE) - 1)
            });
        }
    }
    words.fill(1);
    if node.has(Plane::Weight) {
        read(Plane::Weight, bytemuck::cast_slice_mut(&mut words))?;
    }
    let pad = BITS_PER_PLANE * node.position_planes() - node.bits as u32;
    let world = |cells: [u32; 3]| {
        lattice.world([0, 1, 2].map(|axis| node.origin[axis] + (cells[axis] >> pad) as i64))
    };
    Ok(cells.into_iter().zip(words).map(|(cells, weight)| (world(cells), weight)).collect())
}

/// What a walk over the tree relies on: children behind their parents and each under one, planes inside of the file, numbers in their ranges.
fn check(directory: &Directory, end: u64) -> std::result::Result<(), String> {
    let nodes = &directory.nodes;
    if directory.roots as usize > nodes.len() {
        return Err(format!("claims {} roots among {} nodes", directory.roots, nodes.len()));
    }
    let mut next = directory.roots as usize;
    for (i, node) in nodes.iter().enumerate() {
        let wrong = |what: &str| Err(format!("has a node {i} {what}"));
        if node.count == 0 || node.count > POINTS_PER_PAGE || node.points < node.count as u64 {
            return wrong("with an impossible number of points");
        }
        if node.lattice as usize >= directory.contents.lattices.len() || node.coarser > 64 {
            return wrong("on a lattice that there is not");
        }
        let longest = node.extent.iter().max().map_or(0, |&side| 32 - side.leading_zeros()).max(1);
        if node.bits as u32 != longest || longest > BITS_PER_PLANE * POSITION_PLANES {
            return wrong("whose box does not fit its planes");
        }
        if node.origin.iter().any(|origin| origin.unsigned_abs() > 1 << 60) {
            return wrong("beyond any coordinate");
        }
        if (0..3)
            .any(|plane| node.has(PLANES[plane].0) != ((plane as u32) < node.position_planes()))
            || (node.one_station().is_some() && !node.has(Plane::Station))
        {
            return wrong("with the wrong planes");
        }
        if node.at < HEADER_BYTES || node.at.checked_add(node.bytes()).is_none_or(|last| last > end)
        {
            return wrong("outside of the file");
        }
        if !node.spacing.is_finite()
            || node.spacing < 0.0
            || (node.spacing == 0.0) != node.is_leaf()
        {
            return wrong("with an impossible spacing");
        }
        if node.is_leaf() {
            if node.points != node.count as u64 {
                return wrong("that is a leaf without all of its points");
            }
            continue;
        }
        // Children follow each other in the order of their parents, so ranges are disjoint, nothing is left out, and no walk can come back.
        if node.first_child as usize != next
            || next <= i
            || node.first_child as u64 + node.children as u64 > nodes.len() as u64
        {
            return wrong("whose children are not where they must be");
        }
        next += node.children as usize;
        let children = &nodes[node.children()];
        let sum = children.iter().fold(0u64, |sum, child| sum.saturating_add(child.points));
        if sum != node.points || children.iter().any(|child| child.parent as usize != i) {
            return wrong("whose children are not its own");
        }
    }
    if next != nodes.len() {
        return Err(format!(
            "has {} nodes that belong to no parent",
            nodes.len() - next.min(nodes.len())
        ));
    }
    let stations = directory.contents.stations.len();
    if directory
        .contents
        .balance
        .as_ref()
        .is_some_and(|balance| balance.gains.len() != stations || !balance.is_possible())
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
        return Err(format!("claims {} points, and has {total}", directory.contents.points));
    }
    Ok(())
}
