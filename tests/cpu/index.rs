//! Building indexes: every point is in one leaf, identical to what `cloud::read` returns; inner
//! nodes resemble their children; the bytes depend on the points alone; and a damaged file is
//! refused or read as it was written.
//!
//! Leaves are decoded here from the description in `index::format`, not by the code that packs
//! them. Clouds are made here, or by `synth`, or lie in `../shared`; tests that need that folder
//! are skipped without it.

mod crafted;
mod damaged;
mod inner;
mod kept;
mod planned;
mod stopped;

use crate::files::{names, scan};
use crate::made::shuffled;
use crate::shared::shared;
use glam::DVec3;
use pointillist::cloud::histograms::Histograms;
use pointillist::cloud::table::TextOptions;
use pointillist::cloud::{self, Cloud, ColumnSet, Lattice, ReadOptions};
use pointillist::config::POINTS_PER_PAGE;
use pointillist::error::{Error, Result};
use pointillist::index::build::{self, DerivedPlanes, Options, Summary};
use pointillist::index::format::{Balance, Contents, Index, NodeRecord, PLANES, Plane};
use pointillist::progress::{Progress, Silent};
use pointillist::select::clip::Clips;
use pointillist::select::lod::{self, Detail};
use pointillist::synth::SceneKind;
use pointillist::view::{Camera, Preset, View};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

const OPTIONS: Options = Options {
    memory: 1 << 30,
    threads: 2,
    wanted: ColumnSet::ALL,
    strict: false,
    text: TextOptions::NONE,
    rgb_range: None,
    derive: DerivedPlanes::NONE,
};
const READ: ReadOptions = ReadOptions::new(ColumnSet::ALL, false);

// ---- clouds made here

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Point {
    q: [i32; 3],
    rgb: [u16; 3],
    intensity: u16,
    class: u8,
    returns: u8,
    source: u16,
    time: f64,
}

/// Lattice of a LAS file, and bounds in its header.
#[derive(Clone, Copy, Debug)]
struct Frame {
    step: [f64; 3],
    offset: [f64; 3],
    /// Bounds in the header, maximum and minimum of each axis; `None` for the true ones.
    stated: Option<[[f64; 2]; 3]>,
}

const MILLIMETRES: Frame = Frame { step: [0.001; 3], offset: [0.0; 3], stated: None };

/// LAS 1.2, point format 3.
fn las(points: &[Point], frame: Frame) -> Vec<u8> {
    let mut head = vec![0u8; 227];
    head[..4].copy_from_slice(b"LASF");
    (head[24], head[25], head[104]) = (1, 2, 3);
    head[94..96].copy_from_slice(&227u16.to_le_bytes());
    head[96..100].copy_from_slice(&227u32.to_le_bytes());
    head[105..107].copy_from_slice(&34u16.to_le_bytes());
    head[107..111].copy_from_slice(&(points.len() as u32).to_le_bytes());
    let mut put = |at: usize, value: f64| head[at..at + 8].copy_from_slice(&value.to_le_bytes());
    for axis in 0..3 {
        put(131 + 8 * axis, frame.step[axis]);
        put(155 + 8 * axis, frame.offset[axis]);
        let world = |q: i32| frame.offset[axis] + frame.step[axis] * q as f64;
        let of = |pick: fn(i32, i32) -> i32| {
            world(points.iter().map(|point| point.q[axis]).reduce(pick).unwrap_or(0))
        };
        let [highest, lowest] =
            frame.stated.map_or_else(|| [of(i32::max), of(i32::min)], |stated| stated[axis]);
        put(179 + 16 * axis, highest);
        put(187 + 16 * axis, lowest);
    }
    for point in points {
        point.q.iter().for_each(|q| head.extend(q.to_le_bytes()));
        head.extend(point.intensity.to_le_bytes());
        head.extend([point.returns, point.class, 0, 0]);
        head.extend(point.source.to_le_bytes());
        head.extend(point.time.to_le_bytes());
        point.rgb.iter().for_each(|v| head.extend(v.to_le_bytes()));
    }
    head
}

/// Returns a pseudo-random number.
fn noise(i: u64) -> u64 {
    let z = (i + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ z >> 31
}

/// Returns attributes that distinguish points, at a place.
fn point(q: [i32; 3], i: u64) -> Point {
    let n = noise(i);
    Point {
        q,
        rgb: [n as u16, (n >> 8) as u16, (n >> 16) as u16],
        intensity: (n >> 24) as u16,
        class: (n >> 40) as u8 & 31,
        returns: (n >> 45) as u8 & 63,
        source: (n >> 51) as u16 & 3,
        time: (n >> 54) as f64 * 0.1,
    }
}

#[derive(Clone, Copy, Debug)]
enum Shape {
    Uniform,
    Line,
    Plane,
    Corners,
    /// Distances from one corner halve from point to point.
    Series,
    /// A few places, many points at each.
    Clusters,
    /// Dense in one corner and nearly empty elsewhere.
    Corner,
}

const SHAPES: [Shape; 7] = [
    Shape::Uniform,
    Shape::Line,
    Shape::Plane,
    Shape::Corners,
    Shape::Series,
    Shape::Clusters,
    Shape::Corner,
];

/// Returns `count` points in the box at `low` of size `sides`.
fn shape(shape: Shape, count: usize, low: [i32; 3], sides: [u32; 3], seed: u64) -> Vec<Point> {
    let within = |axis: usize, part: u64| {
        (low[axis] as i64 + (part as u128 * sides[axis] as u128 / u64::MAX as u128) as i64) as i32
    };
    let at = |i: u64| -> [i32; 3] {
        let random = [0, 1, 2].map(|axis| noise(seed ^ (3 * i + axis) << 8));
        let parts = match shape {
            Shape::Uniform => random,
            Shape::Line => [random[0]; 3],
            Shape::Plane => [random[0], random[1], (random[0] >> 1) + (random[1] >> 1)],
            Shape::Corners => random.map(|r| if r & 1 == 1 { u64::MAX } else { 0 }),
            Shape::Series => random.map(|r| u64::MAX >> (r % 64)),
            Shape::Clusters => [0, 1, 2].map(|axis| noise(noise(seed ^ i) % 7 + axis * 100)),
            Shape::Corner => random.map(|r| if i.is_multiple_of(50) { r } else { r >> 12 }),
        };
        [0, 1, 2].map(|axis| within(axis, parts[axis]))
    };
    (0..count as u64).map(|i| point(at(i), seed ^ i << 1)).collect()
}

/// A folder with files in it.
struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new() -> Place {
        Place { folder: tempfile::tempdir().unwrap() }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        fs::write(self.at(name), bytes).unwrap();
        self.at(name)
    }

    fn las(&self, name: &str, points: &[Point], frame: Frame) -> PathBuf {
        self.write(name, &las(points, frame))
    }

    /// Builds `name` from the files; nothing else is left.
    fn build(&self, files: &[PathBuf], name: &str, options: &Options) -> Result<Summary> {
        let mut before = names(self.folder.path());
        let built = build::build(files, &self.at(name), options, &Silent);
        if built.is_ok() && !before.contains(&name.to_string()) {
            before.push(name.to_string());
            before.sort();
        }
        assert_eq!(names(self.folder.path()), before);
        built
    }

    fn index(&self, files: &[PathBuf], options: &Options) -> Index {
        let summary =
            self.build(files, "a.pnti", options).unwrap_or_else(|error| panic!("{error}"));
        let index = Index::open(&self.at("a.pnti")).unwrap_or_else(|error| panic!("{error}"));
        let leaves = index.nodes().iter().filter(|node| node.is_leaf()).count();
        assert_eq!(
            (summary.nodes, summary.leaves, summary.bytes),
            (index.nodes().len(), leaves, index.bytes())
        );
        assert_eq!(summary.points, index.directory.contents.points);
        index
    }

    /// Builds an index of the files and checks its contents.
    fn faithful(&self, files: &[PathBuf], options: &Options) -> Index {
        let index = self.index(files, options);
        let cloud = cloud::read(files, &READ, &Silent).unwrap();
        let (own, read) = (leaf_rows(&index, &cloud), rows(&index, &cloud));
        assert_eq!(own.len(), read.len());
        assert!(own == read, "other points");
        check_contents(&index, &cloud);
        check_inner_nodes(&index);
        index
    }
}

// ---- a decoder of its own

/// The samples of a node: lattice steps, and bytes of its other planes.
struct Decoded {
    q: Vec<[i64; 3]>,
    planes: BTreeMap<usize, Vec<u8>>,
}

impl Decoded {
    fn get<const N: usize>(&self, plane: Plane, i: usize) -> Option<[u8; N]> {
        self.planes
            .get(&(plane as usize))
            .map(|bytes| bytes[i * N..(i + 1) * N].try_into().unwrap())
    }

    fn weight(&self, i: usize) -> u32 {
        self.get(Plane::Weight, i).map_or(1, u32::from_le_bytes)
    }

    /// Station number, in 8 bits or in 16.
    fn station(&self, i: usize) -> usize {
        let narrow = self.get(Plane::Station, i).map(|[station]| station as usize);
        narrow
            .or(self.get(Plane::Source, i).map(|station| u16::from_le_bytes(station) as usize))
            .unwrap_or(0)
    }
}

fn decode(index: &Index, number: usize) -> Result<Decoded> {
    let node = &index.nodes()[number];
    let mut planes = BTreeMap::new();
    for (plane, bytes_per_point) in PLANES {
        if node.planes >> plane as u16 & 1 == 1 {
            let mut bytes = vec![0; (bytes_per_point * node.count as u64) as usize];
            index.read(number, plane, &mut bytes)?;
            planes.insert(plane as usize, bytes);
        }
    }
    // Up to three planes of ten bits per axis, x lowest, from the highest of the `bits` of the
    // longest side.
    let count = (node.bits as usize).div_ceil(10);
    let q = (0..node.count as usize).map(|i| {
        let words = (0..count)
            .map(|plane| u32::from_le_bytes(planes[&plane][4 * i..4 * i + 4].try_into().unwrap()));
        [0, 1, 2].map(|axis| {
            let all = words
                .clone()
                .fold(0u64, |all, word| all << 10 | (word >> (10 * axis)) as u64 & 1023);
            node.origin[axis] + (all >> (10 * count - node.bits as usize)) as i64
        })
    });
    Ok(Decoded { q: q.collect(), planes })
}

/// Returns the offset between a node's lattice and a part's in whole steps; `None` if there is
/// none.
fn shift(own: Lattice, part: Lattice) -> Option<[i64; 3]> {
    let steps = (own.offset - part.offset) / part.step;
    let near = own.step == part.step && (steps - steps.round()).abs().max_element() < 1e-3;
    near.then(|| steps.round().to_array().map(|v| v as i64))
}

/// A point as file and index have it.
type Row = (usize, [i64; 3], [u8; 3], u16, [u8; 2], u16, [u8; 3], u64);

fn hashed(row: Row) -> u64 {
    let mut hasher = DefaultHasher::new();
    row.hash(&mut hasher);
    hasher.finish()
}

/// Returns the points of all leaves, sorted.
fn leaf_rows(index: &Index, cloud: &Cloud) -> Vec<u64> {
    let contents = &index.directory.contents;
    let mut rows = Vec::new();
    for (number, node) in index.nodes().iter().enumerate().filter(|(_, node)| node.children == 0) {
        assert_eq!((node.coarser, node.spacing, node.points), (0, 0.0, node.count as u64));
        assert!(!node.has(Plane::Weight));
        let [step, offset] = contents.lattices[node.lattice as usize];
        let decoded = decode(index, number).unwrap_or_else(|error| panic!("{error}"));
        let (mut part, mut moved) = (usize::MAX, [0; 3]);
        for i in 0..node.count as usize {
            let station = &contents.stations[decoded.station(i)];
            if station.part != part {
                part = station.part;
                moved = shift(Lattice { step, offset }, cloud.parts[part].lattice)
                    .expect("on a lattice of its own");
            }
            rows.push(hashed((
                part,
                [0, 1, 2].map(|axis| decoded.q[i][axis] + moved[axis]),
                decoded.get(Plane::Rgb, i).unwrap_or([255; 3]),
                decoded.get(Plane::Intensity, i).map_or(0, u16::from_le_bytes),
                [
                    decoded.get(Plane::Class, i).unwrap_or([0])[0],
                    decoded.get(Plane::Returns, i).unwrap_or([0])[0],
                ],
                station.source.unwrap_or(0),
                decoded.get(Plane::Normal, i).unwrap_or([0; 3]),
                decoded.get(Plane::GpsTime, i).map_or(0, u64::from_le_bytes),
            )));
        }
    }
    rows.sort_unstable();
    rows
}

/// Returns the points of a cloud, with the values of [`leaf_rows`] for missing columns.
fn rows(index: &Index, cloud: &Cloud) -> Vec<u64> {
    let with_times = index.nodes().iter().any(|node| node.has(Plane::GpsTime));
    let mut rows = Vec::new();
    for (number, part) in cloud.parts.iter().enumerate() {
        let c = &part.columns;
        for i in 0..c.len() {
            rows.push(hashed((
                number,
                [c.x[i], c.y[i], c.z[i]].map(i64::from),
                c.rgb.as_ref().map_or([255; 3], |v| v[i]),
                c.intensity.as_ref().map_or(0, |v| v[i]),
                [c.class.as_ref().map_or(0, |v| v[i]), c.returns.as_ref().map_or(0, |v| v[i])],
                c.source.as_ref().map_or(0, |v| v[i]),
                c.normal.as_ref().map_or([0; 3], |v| v[i]).map(|v| v as u8),
                c.gps_time.as_ref().filter(|_| with_times).map_or(0, |v| v[i].to_bits()),
            )));
        }
    }
    rows.sort_unstable();
    rows
}

/// Checks the directory's statistics against the files.
fn check_contents(index: &Index, cloud: &Cloud) {
    let contents = &index.directory.contents;
    assert_eq!(contents.parts.len(), cloud.parts.len());
    for (own, part) in contents.parts.iter().zip(&cloud.parts) {
        assert_eq!(
            (&own.path, &own.name, own.points),
            (&part.path, &part.name, part.columns.len() as u64)
        );
        assert_eq!(
            (own.step, own.offset, own.rgb_scale),
            (part.lattice.step, part.lattice.offset, part.rgb_scale)
        );
        assert_eq!(own.intensity_range, part.intensity_range);
        assert_eq!(
            (&own.header.format, own.header.points),
            (&part.header.format, part.header.points)
        );
    }
    let sorted = |stations: &[cloud::Station]| {
        let mut stations: Vec<_> =
            stations.iter().filter(|station| station.points > 0).cloned().collect();
        stations.sort_by_key(|station| (station.part, station.source));
        stations
    };
    assert_eq!(sorted(&contents.stations), sorted(&cloud.stations));
    assert_eq!(contents.points, cloud.len());
    let counted = |column: fn(&cloud::Columns) -> Option<&Vec<u8>>, mask: u8| {
        let mut counts = BTreeMap::<u8, u64>::new();
        cloud
            .parts
            .iter()
            .filter_map(|part| column(&part.columns))
            .flatten()
            .for_each(|kind| *counts.entry(kind & mask).or_default() += 1);
        counts.into_iter().collect::<Vec<_>>()
    };
    let counts = Histograms {
        classes: counted(|c| c.class.as_ref(), 255),
        returns: counted(|c| c.returns.as_ref(), 15),
    };
    assert_eq!(contents.counts, Some(counts));
    match (contents.bounds, cloud.bounds()) {
        (Some([low, high]), Some((true_low, true_high))) => {
            // One lattice for several files moves corners by a thousandth of a step at most.
            let step =
                contents.lattices.iter().fold(DVec3::ZERO, |most, [step, _]| most.max(*step));
            let near = |a: DVec3, b: DVec3| {
                (a - b).abs().cmple(1e-3 * step + 1e-15 * (a.abs() + b.abs())).all()
            };
            assert!(
                near(low, true_low) && near(high, true_high),
                "{low} {high}, not {true_low} {true_high}"
            );
        }
        (own, read) => assert!(own.is_none() && read.is_none()),
    }
    if let [part] = &cloud.parts[..] {
        let c = &part.columns;
        let expected = [
            (Plane::Rgb, c.rgb.is_some()),
            (Plane::Intensity, c.intensity.is_some()),
            (Plane::Class, c.class.is_some()),
        ];
        let more = [(Plane::Returns, c.returns.is_some()), (Plane::Normal, c.normal.is_some())];
        for (plane, there) in expected.into_iter().chain(more) {
            assert!(
                index.nodes().iter().all(|node| node.has(plane) == there),
                "{plane:?}: {there}"
            );
        }
        let stations =
            |node: &NodeRecord| node.has(Plane::Source) as u32 + node.has(Plane::Station) as u32;
        assert!(index.nodes().iter().all(|node| stations(node) == c.source.is_some() as u32));
        assert!(cloud.stations.len() > 256 || !index.has(Plane::Source));
    }
    assert_eq!(contents.notes, cloud.notes);
}

/// Returns the world position of steps of a node's lattice.
fn world(index: &Index, node: &NodeRecord, q: [i64; 3]) -> DVec3 {
    let [step, offset] = index.directory.contents.lattices[node.lattice as usize];
    let coarse = 2f64.powi(node.coarser as i32);
    let middle = if node.coarser > 0 { 0.5 } else { 0.0 };
    offset + step * coarse * (DVec3::from_array(q.map(|v| v as f64)) + middle)
}

fn linear(v: u8) -> f64 {
    let v = v as f64 / 255.0;
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// Weighted sums over some nodes.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    weight: f64,
    color: DVec3,
    position: DVec3,
    intensity: f64,
}

impl std::ops::AddAssign for Sums {
    fn add_assign(&mut self, other: Sums) {
        self.weight += other.weight;
        self.color += other.color;
        self.position += other.position;
        self.intensity += other.intensity;
    }
}

fn sums(index: &Index, number: usize, from: DVec3) -> Sums {
    let node = &index.nodes()[number];
    let decoded = decode(index, number).unwrap_or_else(|error| panic!("{error}"));
    let mut sums = Sums::default();
    for i in 0..node.count as usize {
        let weight = decoded.weight(i) as f64;
        assert!(weight > 0.0);
        sums.weight += weight;
        sums.position += weight * (world(index, node, decoded.q[i]) - from);
        // With equalised exposures, if they are known.
        let gain = |balance: &Option<Balance>| {
            balance.as_ref().map_or(1.0, |balance| balance.gains[decoded.station(i)])
        };
        let contents = &index.directory.contents;
        sums.color += weight
            * gain(&contents.balance)
            * DVec3::from_array(decoded.get(Plane::Rgb, i).unwrap_or([255; 3]).map(linear));
        sums.intensity += weight
            * gain(&contents.intensity_balance)
            * decoded.get(Plane::Intensity, i).map_or(0, u16::from_le_bytes) as f64;
    }
    sums
}

/// Checks every inner node against its children.
fn check_inner_nodes(index: &Index) {
    let nodes = index.nodes();
    let from = index.directory.contents.bounds.map_or(DVec3::ZERO, |[low, _]| low);
    // Sums of the leaves below every node.
    let mut below = vec![Sums::default(); nodes.len()];
    for number in (0..nodes.len()).rev() {
        let node = &nodes[number];
        let own = sums(index, number, from);
        let (low, high) = index.bounds(node);
        if node.is_leaf() {
            below[number] = own;
            // A point outside the view by an ancestor's box is outside by its own.
            let (mut child, mut above) = (number, node.parent as usize);
            while above != child {
                let (box_low, box_high) = index.bounds(&nodes[above]);
                let slack = 1e-9 * (low.abs() + high.abs());
                assert!(
                    low.cmpge(box_low - slack).all() && high.cmple(box_high + slack).all(),
                    "leaf {number} lies beyond node {above}"
                );
                (child, above) = (above, nodes[above].parent as usize);
            }
        } else {
            assert_eq!(own.weight, node.points as f64, "node {number}: weights");
            assert_eq!(node.children().map(|child| nodes[child].points).sum::<u64>(), node.points);
            for child in node.children() {
                let sums = below[child];
                below[number] += sums;
                assert!(
                    node.spacing >= nodes[child].spacing,
                    "node {number}: {} above {}",
                    node.spacing,
                    nodes[child].spacing
                );
            }
        }
        let leaves = below[number];
        assert_eq!(leaves.weight, own.weight);
        let off = (own.color - leaves.color).abs() / own.weight;
        assert!(off.max_element() < 1.0 / 255.0, "node {number}: mean colour is off by {off}");
        let off = (own.position - leaves.position).abs() / own.weight;
        let far = 1e-9 * (high - from).abs().max_element()
            + 1e-12 * high.abs().max(low.abs()).max_element();
        assert!(
            off.max_element() <= node.spacing / 2.0 + far,
            "node {number}: mean position is off by {off}, cells are {}",
            node.spacing
        );
        let off = (own.intensity - leaves.intensity).abs() / own.weight;
        assert!(off < 4.0, "node {number}: mean intensity is off by {off}");
    }
}

/// Returns the nodes' contents, independent of their numbers and places in the file.
fn contents_of_nodes(index: &Index) -> Vec<u64> {
    let of = |number: usize| {
        let node = &index.nodes()[number];
        let mut hasher = DefaultHasher::new();
        (
            node.origin,
            node.extent,
            node.count,
            node.points,
            node.children,
            node.level,
            node.spacing.to_bits(),
        )
            .hash(&mut hasher);
        decode(index, number).unwrap().planes.hash(&mut hasher);
        hasher.finish()
    };
    let mut all: Vec<u64> = (0..index.nodes().len()).map(of).collect();
    all.sort_unstable();
    all
}
