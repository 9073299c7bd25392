//! Planes, node records and the directory of an index.

use crate::cloud::attribute::Attribute;
use crate::cloud::histograms::Histograms;
use crate::cloud::rgb_range::Scale;
use crate::cloud::{Header, Lattice, Station};
use crate::config::BITS_PER_PLANE;
use crate::error::Result;
use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Contents of a plane, in the order of a node's planes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Plane {
    /// 10 + 10 + 10 bits of the position, coarsest first.
    Coarse,
    Fine,
    Finest,
    /// sRGB, 8 bits per channel.
    Rgb,
    Intensity,
    Class,
    /// Return number (low four bits) and number of returns.
    Returns,
    /// Station number, an index of [`Contents::stations`], if a node has numbers above 255.
    Source,
    /// Unit normal, 127 = 1.0.
    Normal,
    /// GPS time, or what [`Contents::scalar`] names.
    GpsTime,
    /// Number of points that a sample stands for, in inner nodes.
    Weight,
    /// Derived ([`crate::index::attributes::derive`]): the surface normal
    /// ([`crate::cloud::octahedral`]) and eight pseudo-random bits, highest.
    Facing,
    /// Derived: brush parameters beside the normal (`strokes::Stroke::words`).
    Brush,
    /// Derived: colour with the mean luminance of the neighbourhood, as [`Plane::Rgb`].
    Corrected,
    /// Station number, if all numbers of a node fit 8 bits. With few stations two numbers share a
    /// byte; a single one is in the record.
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

/// Number of checksums in a record: odd, so that the record has no padding.
pub const CHECKSUMS: usize = PLANES.len();

impl Plane {
    /// Planes of station numbers; a node has at most one.
    pub const STATIONS: [Plane; 2] = [Plane::Station, Plane::Source];

    pub fn bytes_per_point(self) -> u64 {
        PLANES[self as usize].1
    }

    /// Returns the planes that show an attribute, of which a node's first is used; positions show
    /// elevation.
    pub fn of(attribute: Attribute) -> &'static [Plane] {
        match attribute {
            Attribute::Rgb => &[Plane::Rgb],
            Attribute::Intensity => &[Plane::Intensity],
            Attribute::Class => &[Plane::Class],
            Attribute::Source => &Plane::STATIONS,
            Attribute::Return => &[Plane::Returns],
            Attribute::Normal => &[Plane::Normal, Plane::Facing],
            Attribute::Corrected => &[Plane::Corrected],
            Attribute::Time | Attribute::Scalar(_) => &[Plane::GpsTime],
            Attribute::Elevation | Attribute::White => &[],
        }
    }
}

/// A node in the directory.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct NodeRecord {
    /// Least coordinates, in steps of its lattice times 2^`coarser`.
    pub origin: [i64; 3],
    /// Points of the input in the node.
    pub points: u64,
    /// File offset of its first plane.
    pub at: u64,
    /// Longest side of the merged cells `[m]`; 0 for a leaf, which has every point.
    pub spacing: f64,
    /// Inclusive, in the same steps as `origin`.
    pub extent: [u32; 3],
    /// Number of samples, at most a page.
    pub count: u32,
    pub crc: [u32; CHECKSUMS],
    pub first_child: u32,
    pub children: u32,
    /// Parent; a root is its own.
    pub parent: u32,
    /// Bit `k` is set if it has `PLANES[k]`; [`SINGLE_STATION`].
    pub planes: u16,
    pub lattice: u16,
    /// Bits of the longest side.
    pub bits: u8,
    /// Positions of inner nodes are rounded to 2^`coarser` lattice steps.
    pub coarser: u8,
    pub level: u8,
    /// The station if [`SINGLE_STATION`] is set; else [`TWO_PER_BYTE`] if two numbers share a byte.
    pub station: u8,
}

/// Bit of [`NodeRecord::planes`]: all points are of one station.
pub const SINGLE_STATION: u16 = 1 << PLANES.len();
/// Station numbers below 16, the first of two in the lower half.
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

    /// Returns the station of all its points, if it is stored as one.
    pub fn single_station(&self) -> Option<u8> {
        (self.planes & SINGLE_STATION != 0).then_some(self.station)
    }

    /// Returns the points' station numbers from the stored [`Plane::Station`].
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

    /// Returns the unpacked size of a plane `[bytes]`.
    pub fn unpacked_bytes(&self, plane: Plane) -> u64 {
        plane.bytes_per_point() * self.count as u64
    }

    /// Returns offset and stored size of a plane `[bytes]`.
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

    /// Returns the stored size of all its planes `[bytes]`.
    pub fn bytes(&self) -> u64 {
        PLANES
            .iter()
            .filter(|(plane, _)| self.has(*plane))
            .map(|(plane, _)| self.range(*plane).1)
            .sum()
    }
}

/// A file, or a scan in one, that went into the index.
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
    /// Scale of the file's colours; missing in old indexes.
    #[serde(default)]
    pub rgb_scale: Scale,
}

/// Stores a path as text, or as bytes if it is not UTF-8, which JSON cannot hold otherwise.
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

/// Description of the input, and statistics of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Contents {
    pub parts: Vec<IndexedPart>,
    pub stations: Vec<Station>,
    pub notes: Vec<String>,
    /// Steps and offsets, two lattices per tree: the file's own, for leaves; and the same with its
    /// offset at the tree's corner, for rounded positions of inner nodes.
    pub lattices: Vec<[DVec3; 2]>,
    pub points: u64,
    /// World corners of the bounding box; `None` without points.
    pub bounds: Option<[DVec3; 2]>,
    /// Intensities at the 2nd and 98th percentile.
    pub intensity_stretch: [u32; 2],
    /// Number of points of each value of their brightest channel. Missing in old indexes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tones: Vec<u64>,
    /// Heights at the same percentiles, in units of `attribute::DisplayAttribute`.
    pub elevation_stretch: [u32; 2],
    /// True if all derived normals are those of the files, and thus oriented outwards.
    #[serde(default)]
    pub oriented: bool,
    /// Axes of all points if strokes were derived; else those of the file.
    #[serde(default, skip_serializing_if = "Axes::are_the_files")]
    pub axes: Axes,
    /// Exposure gains of the stations. A merged sample has the exposure of the station that it
    /// names. Missing in old indexes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub balance: Option<Balance>,
    /// Gains of intensities.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub intensity_balance: Option<Balance>,
    /// What [`Plane::GpsTime`] holds, as [`crate::cloud::scalar::Scalar`] is written; GPS times if
    /// `None`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scalar: Option<String>,
    /// Histograms of the input's points, not of samples. Missing in old indexes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub counts: Option<Histograms>,
}

/// Nodes and description of the input.
#[derive(Clone, Debug, Default)]
pub struct Directory {
    /// Node records, roots first.
    pub nodes: Vec<NodeRecord>,
    pub roots: u32,
    pub contents: Contents,
}

impl Contents {
    /// Tests whether a node that has the plane of an attribute has the attribute.
    pub fn keeps(&self, attribute: Attribute) -> bool {
        match attribute {
            Attribute::Time => self.scalar.is_none(),
            Attribute::Scalar(scalar) => self.scalar == Some(scalar.to_string()),
            _ => true,
        }
    }

    /// Returns the exposure gains of what points show.
    pub fn balance_of(&self, attribute: Attribute) -> Option<&Balance> {
        match attribute {
            Attribute::Rgb => self.balance.as_ref(),
            Attribute::Intensity => self.intensity_balance.as_ref(),
            _ => None,
        }
    }
}

/// Returns the lattice of a node's `origin` and `extent`. Rounded positions lie at the centres of
/// their cells.
pub fn lattice(node: &NodeRecord, lattices: &[[DVec3; 2]]) -> Lattice {
    let [step, offset] = lattices[node.lattice as usize];
    let coarse = 2f64.powi(node.coarser as i32);
    Lattice { step: step * coarse, offset: offset + step * (coarse / 2.0).floor() }
}

/// Returns the lattice with its offset at the tree's corner.
pub fn tree_lattice(node: &NodeRecord, lattices: &[[DVec3; 2]]) -> Lattice {
    // Every tree has two consecutive lattices, which differ only in their offset.
    let [step, offset] = lattices[(node.lattice as usize | 1).min(lattices.len() - 1)];
    Lattice { step, offset }
}

/// Returns the world bounds of a node, as `Index::bounds`.
pub fn bounds(node: &NodeRecord, lattices: &[[DVec3; 2]]) -> (DVec3, DVec3) {
    let lattice = lattice(node, lattices);
    let top = [0, 1, 2].map(|axis| node.origin[axis] + node.extent[axis] as i64);
    let (a, b) = (lattice.world(node.origin), lattice.world(top));
    (a.min(b) - node.spacing, a.max(b) + node.spacing)
}

/// Returns world positions and weights of a node's samples; `read` fills a plane's bytes.
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

/// Axes of the cloud: right-handed unit vectors.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Axes(pub [DVec3; 3]);

impl Default for Axes {
    fn default() -> Self {
        Axes([DVec3::X, DVec3::Y, DVec3::Z])
    }
}

impl Axes {
    /// Converts a world vector to these axes.
    pub fn own(&self, v: DVec3) -> DVec3 {
        DVec3::from_array(self.0.map(|axis| axis.dot(v)))
    }

    /// Converts a vector in these axes to the world.
    pub fn world(&self, v: DVec3) -> DVec3 {
        let Axes([x, y, z]) = *self;
        x * v.x + y * v.y + z * v.z
    }

    pub fn are_the_files(&self) -> bool {
        *self == Axes::default()
    }
}

/// Largest exposure correction `[stops]`.
pub const MAX_STOPS: f64 = 4.0;

/// Gains that give all stations one exposure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Balance {
    /// Gain on the light of each station, 2^-4 to 2^4; 1 if it overlaps with none.
    pub gains: Vec<f64>,
    /// Share of common cells that still differ by more than a quarter of a stop: shadows, time of
    /// day, moving objects.
    pub uneven: f64,
}

impl Balance {
    /// Returns whether all values are in range.
    pub fn is_valid(&self) -> bool {
        self.gains.iter().all(|gain| gain.log2().abs() <= MAX_STOPS)
            && (0.0..=1.0).contains(&self.uneven)
    }
}
