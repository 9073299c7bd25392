//! What an index holds, as its directory says: planes, node records, and what was opened.

use crate::cloud::attribute::Attribute;
use crate::cloud::color::Scale;
use crate::cloud::histograms::Histograms;
use crate::cloud::{Header, Lattice, Station};
use crate::config::BITS_PER_PLANE;
use crate::error::Result;
use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

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
    /// Bit `k`: it has `PLANES[k]`; [`SINGLE_STATION`].
    pub planes: u16,
    pub lattice: u16,
    /// Bits that the longest side needs.
    pub bits: u8,
    /// Inner nodes keep positions to 2^`coarser` lattice steps.
    pub coarser: u8,
    pub level: u8,
    /// With [`SINGLE_STATION`] that station; else [`TWO_PER_BYTE`] where two numbers share a byte.
    pub station: u8,
}

/// Of [`NodeRecord::planes`], beside the bit of [`Plane::Station`].
pub const SINGLE_STATION: u16 = 1 << PLANES.len();
/// Numbers of stations below 16, the first of two in the lower half.
pub const TWO_PER_BYTE: u8 = 2;

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
    pub fn single_station(&self) -> Option<u8> {
        (self.planes & SINGLE_STATION != 0).then_some(self.station)
    }

    /// Numbers of the points' stations, from what [`Plane::Station`] has in the file.
    pub fn stations(&self, stored: &[u8]) -> Vec<u8> {
        match self.single_station() {
            Some(station) => vec![station; self.count as usize],
            None if self.station == TWO_PER_BYTE => stored
                .iter()
                .flat_map(|both| [both & 15, both >> 4])
                .take(self.count as usize)
                .collect(),
            None => stored.to_vec(),
        }
    }

    /// Bytes of a plane once it is read.
    pub fn unpacked_bytes(&self, plane: Plane) -> u64 {
        plane.bytes_per_point() * self.count as u64
    }

    /// Where a plane lies in the file, and how many bytes it has there.
    pub fn range(&self, plane: Plane) -> (u64, u64) {
        let stored = |plane| match plane {
            Plane::Station if self.single_station().is_some() => 0,
            Plane::Station if self.station == TWO_PER_BYTE => {
                self.unpacked_bytes(plane).div_ceil(2)
            }
            _ => self.unpacked_bytes(plane),
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

/// The lattice that a node's `origin` and `extent` count steps of. Rounded positions lie in the middle of theirs.
pub fn lattice(node: &NodeRecord, lattices: &[[DVec3; 2]]) -> Lattice {
    let [step, offset] = lattices[node.lattice as usize];
    let coarse = 2f64.powi(node.coarser as i32);
    Lattice { step: step * coarse, offset: offset + step * (coarse / 2.0).floor() }
}

/// The lattice that starts where the tree of a node does.
pub fn tree_lattice(node: &NodeRecord, lattices: &[[DVec3; 2]]) -> Lattice {
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

/// Right-handed unit vectors.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Axes(pub [DVec3; 3]);

impl Default for Axes {
    fn default() -> Self {
        Axes([DVec3::X, DVec3::Y, DVec3::Z])
    }
}

impl Axes {
    /// A vector of the world in them.
    pub fn own(&self, v: DVec3) -> DVec3 {
        DVec3::from_array(self.0.map(|axis| axis.dot(v)))
    }

    /// And back.
    pub fn world(&self, v: DVec3) -> DVec3 {
        let Axes([x, y, z]) = *self;
        x * v.x + y * v.y + z * v.z
    }

    pub fn are_the_files(&self) -> bool {
        *self == Axes::default()
    }
}

/// No exposures differ by more.
pub const MAX_STOPS: f64 = 4.0;

/// What gives all stations one exposure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Balance {
    /// By number of the station, the factor on its light, 2^-4 to 2^4; 1 of one that overlaps with none.
    pub gains: Vec<f64>,
    /// Of the cells that stations share, the part where they surely differ by more than a quarter of a stop all the same: shadows, the time of day, what moves.
    pub uneven: f64,
}

impl Balance {
    /// Whether it may have been found.
    pub fn is_valid(&self) -> bool {
        self.gains.iter().all(|gain| gain.log2().abs() <= MAX_STOPS)
            && (0.0..=1.0).contains(&self.uneven)
    }
}
