//! FILES -> NAME.pnti: every point is in one leaf, bit by bit what `cloud::read` says of it; inner nodes are pictures of their children; the bytes depend
//! on the points alone; and whatever becomes of the file, it is refused or read as it was written.
//!
//! Leaves are decoded here from the description in `index::file`, not by the code that packs them. Clouds are made here, or by `synth`, or lie in
//! `../shared`; where that folder is missing, the tests that need it say so and pass.

mod support;

use glam::DVec3;
use pointillist::clip::Clips;
use pointillist::cloud::counts::Counts;
use pointillist::cloud::{self, Cloud, Lattice, ReadOptions, Wanted};
use pointillist::config::POINTS_PER_PAGE;
use pointillist::cut::{self, Detail};
use pointillist::error::{Error, Result};
use pointillist::index::build::{self, Derive, Options, Summary};
use pointillist::index::file::{Contents, Index, NodeRecord, PLANES, Plane};
use pointillist::progress::{Progress, Silent};
use pointillist::synth::Scene;
use pointillist::view::{Camera, Preset, View};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use support::{names, scan, shared, shuffled};

const OPTIONS: Options = Options { memory: 1 << 30, threads: 2, wanted: Wanted::ALL, strict: false, derive: Derive::NONE };
const READ: ReadOptions = ReadOptions { wanted: Wanted::ALL, strict: false };

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

/// Where a LAS file's points lie, and what its header says of it.
#[derive(Clone, Copy, Debug)]
struct Frame {
    step: [f64; 3],
    offset: [f64; 3],
    /// The header's own words: maximum and minimum of each axis. None: the truth.
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
        let of = |pick: fn(i32, i32) -> i32| world(points.iter().map(|point| point.q[axis]).reduce(pick).unwrap_or(0));
        let [highest, lowest] = frame.stated.map_or_else(|| [of(i32::max), of(i32::min)], |stated| stated[axis]);
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

/// A number that looks random.
fn noise(i: u64) -> u64 {
    let z = (i + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ z >> 31
}

/// Attributes that tell points apart, at a place.
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

const SHAPES: [Shape; 7] = [Shape::Uniform, Shape::Line, Shape::Plane, Shape::Corners, Shape::Series, Shape::Clusters, Shape::Corner];

/// `count` points in the box from `low`, `sides` wide.
fn shape(shape: Shape, count: usize, low: [i32; 3], sides: [u32; 3], seed: u64) -> Vec<Point> {
    let within = |axis: usize, part: u64| (low[axis] as i64 + (part as u128 * sides[axis] as u128 / u64::MAX as u128) as i64) as i32;
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

    /// Builds `name` of the files; nothing else is left.
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
        let summary = self.build(files, "a.pnti", options).unwrap_or_else(|error| panic!("{error}"));
        let index = Index::open(&self.at("a.pnti")).unwrap_or_else(|error| panic!("{error}"));
        let leaves = index.nodes().iter().filter(|node| node.is_leaf()).count();
        assert_eq!((summary.nodes, summary.leaves, summary.bytes), (index.nodes().len(), leaves, index.bytes()));
        assert_eq!(summary.points, index.directory.contents.points);
        index
    }

    /// An index of the files that holds what they hold.
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

/// The samples of a node: steps of its lattice, and bytes of whatever else it has.
struct Decoded {
    q: Vec<[i64; 3]>,
    planes: BTreeMap<usize, Vec<u8>>,
}

impl Decoded {
    fn get<const N: usize>(&self, plane: Plane, i: usize) -> Option<[u8; N]> {
        self.planes.get(&(plane as usize)).map(|bytes| bytes[i * N..(i + 1) * N].try_into().unwrap())
    }

    fn weight(&self, i: usize) -> u32 {
        self.get(Plane::Weight, i).map_or(1, u32::from_le_bytes)
    }

    /// Its number, in 8 bits or in 16.
    fn station(&self, i: usize) -> usize {
        let narrow = self.get(Plane::Station, i).map(|[station]| station as usize);
        narrow.or(self.get(Plane::Source, i).map(|station| u16::from_le_bytes(station) as usize)).unwrap_or(0)
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
    // Three planes of ten bits an axis, x lowest, from the highest of the `bits` that the longest side needs.
    let count = (node.bits as usize).div_ceil(10);
    let q = (0..node.count as usize).map(|i| {
        let words = (0..count).map(|plane| u32::from_le_bytes(planes[&plane][4 * i..4 * i + 4].try_into().unwrap()));
        [0, 1, 2].map(|axis| {
            let all = words.clone().fold(0u64, |all, word| all << 10 | (word >> (10 * axis)) as u64 & 1023);
            node.origin[axis] + (all >> (10 * count - node.bits as usize)) as i64
        })
    });
    Ok(Decoded { q: q.collect(), planes })
}

/// Where whole steps of a node's lattice are those of a part's; None if they are not.
fn shift(own: Lattice, part: Lattice) -> Option<[i64; 3]> {
    let steps = (own.offset - part.offset) / part.step;
    let near = own.step == part.step && (steps - steps.round()).abs().max_element() < 1e-3;
    near.then(|| steps.round().to_array().map(|v| v as i64))
}

/// A point as the file and the index both tell it.
type Row = (usize, [i64; 3], [u8; 3], u16, [u8; 2], u16, [u8; 3], u64);

fn hashed(row: Row) -> u64 {
    let mut hasher = DefaultHasher::new();
    row.hash(&mut hasher);
    hasher.finish()
}

/// Of all leaves, sorted.
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
                moved = shift(Lattice { step, offset }, cloud.parts[part].lattice).expect("on a lattice of its own");
            }
            rows.push(hashed((
                part,
                [0, 1, 2].map(|axis| decoded.q[i][axis] + moved[axis]),
                decoded.get(Plane::Rgb, i).unwrap_or([255; 3]),
                decoded.get(Plane::Intensity, i).map_or(0, u16::from_le_bytes),
                [decoded.get(Plane::Class, i).unwrap_or([0])[0], decoded.get(Plane::Returns, i).unwrap_or([0])[0]],
                station.source.unwrap_or(0),
                decoded.get(Plane::Normal, i).unwrap_or([0; 3]),
                decoded.get(Plane::GpsTime, i).map_or(0, u64::from_le_bytes),
            )));
        }
    }
    rows.sort_unstable();
    rows
}

/// The same of a cloud as it is read. What only other files have is as in [`leaf_rows`] where planes are missing.
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

/// What the directory says of all points is what the files say.
fn check_contents(index: &Index, cloud: &Cloud) {
    let contents = &index.directory.contents;
    assert_eq!(contents.parts.len(), cloud.parts.len());
    for (own, part) in contents.parts.iter().zip(&cloud.parts) {
        assert_eq!((&own.path, &own.name, own.points), (&part.path, &part.name, part.columns.len() as u64));
        assert_eq!((own.step, own.offset, own.rgb_bits), (part.lattice.step, part.lattice.offset, part.rgb_bits));
        assert_eq!(own.intensity_range, part.intensity_range);
        assert_eq!((&own.header.format, own.header.points), (&part.header.format, part.header.points));
    }
    let sorted = |stations: &[cloud::Station]| {
        let mut stations: Vec<_> = stations.iter().filter(|station| station.points > 0).cloned().collect();
        stations.sort_by_key(|station| (station.part, station.source));
        stations
    };
    assert_eq!(sorted(&contents.stations), sorted(&cloud.stations));
    assert_eq!(contents.points, cloud.len());
    let counted = |column: fn(&cloud::Columns) -> Option<&Vec<u8>>, mask: u8| {
        let mut counts = BTreeMap::<u8, u64>::new();
        cloud.parts.iter().filter_map(|part| column(&part.columns)).flatten().for_each(|kind| *counts.entry(kind & mask).or_default() += 1);
        counts.into_iter().collect::<Vec<_>>()
    };
    let counts = Counts { classes: counted(|c| c.class.as_ref(), 255), returns: counted(|c| c.returns.as_ref(), 15) };
    assert_eq!(contents.counts, Some(counts));
    match (contents.bounds, cloud.bounds()) {
        (Some([low, high]), Some((true_low, true_high))) => {
            // One lattice for several files moves corners by a thousandth of a step at most.
            let step = contents.lattices.iter().fold(DVec3::ZERO, |most, [step, _]| most.max(*step));
            let near = |a: DVec3, b: DVec3| (a - b).abs().cmple(1e-3 * step + 1e-15 * (a.abs() + b.abs())).all();
            assert!(near(low, true_low) && near(high, true_high), "{low} {high}, not {true_low} {true_high}");
        }
        (own, read) => assert!(own.is_none() && read.is_none()),
    }
    if let [part] = &cloud.parts[..] {
        let c = &part.columns;
        let expected = [(Plane::Rgb, c.rgb.is_some()), (Plane::Intensity, c.intensity.is_some()), (Plane::Class, c.class.is_some())];
        let more = [(Plane::Returns, c.returns.is_some()), (Plane::Normal, c.normal.is_some())];
        for (plane, there) in expected.into_iter().chain(more) {
            assert!(index.nodes().iter().all(|node| node.has(plane) == there), "{plane:?}: {there}");
        }
        let stations = |node: &NodeRecord| node.has(Plane::Source) as u32 + node.has(Plane::Station) as u32;
        assert!(index.nodes().iter().all(|node| stations(node) == c.source.is_some() as u32));
        assert!(cloud.stations.len() > 256 || !index.has(Plane::Source));
    }
    assert_eq!(contents.notes, cloud.notes);
}

/// World position of steps of a node's lattice.
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
        // With one exposure for all stations, where that is known.
        let gain = index.directory.contents.balance.as_ref().map_or(1.0, |balance| balance.gains[decoded.station(i)]);
        sums.color += weight * gain * DVec3::from_array(decoded.get(Plane::Rgb, i).unwrap_or([255; 3]).map(linear));
        sums.intensity += weight * decoded.get(Plane::Intensity, i).map_or(0, u16::from_le_bytes) as f64;
    }
    sums
}

/// Every inner node is its children seen from further away.
fn check_inner_nodes(index: &Index) {
    let nodes = index.nodes();
    let from = index.directory.contents.bounds.map_or(DVec3::ZERO, |[low, _]| low);
    // Of the leaves under every node.
    let mut below = vec![Sums::default(); nodes.len()];
    for number in (0..nodes.len()).rev() {
        let node = &nodes[number];
        let own = sums(index, number, from);
        let (low, high) = index.bounds(node);
        if node.is_leaf() {
            below[number] = own;
            // What is outside of the view by an ancestor's box is outside by its own.
            let (mut child, mut above) = (number, node.parent as usize);
            while above != child {
                let (box_low, box_high) = index.bounds(&nodes[above]);
                let slack = 1e-9 * (low.abs() + high.abs());
                assert!(low.cmpge(box_low - slack).all() && high.cmple(box_high + slack).all(), "leaf {number} lies beyond node {above}");
                (child, above) = (above, nodes[above].parent as usize);
            }
        } else {
            assert_eq!(own.weight, node.points as f64, "node {number}: weights");
            assert_eq!(node.children().map(|child| nodes[child].points).sum::<u64>(), node.points);
            for child in node.children() {
                let sums = below[child];
                below[number] += sums;
                assert!(node.spacing >= nodes[child].spacing, "node {number}: {} above {}", node.spacing, nodes[child].spacing);
            }
        }
        let leaves = below[number];
        assert_eq!(leaves.weight, own.weight);
        let off = (own.color - leaves.color).abs() / own.weight;
        assert!(off.max_element() < 1.0 / 255.0, "node {number}: mean colour is off by {off}");
        let off = (own.position - leaves.position).abs() / own.weight;
        let far = 1e-9 * (high - from).abs().max_element() + 1e-12 * high.abs().max(low.abs()).max_element();
        assert!(off.max_element() <= node.spacing / 2.0 + far, "node {number}: mean position is off by {off}, cells are {}", node.spacing);
        let off = (own.intensity - leaves.intensity).abs() / own.weight;
        assert!(off < 4.0, "node {number}: mean intensity is off by {off}");
    }
}

/// The nodes' contents, whatever their numbers and their places in the file.
fn contents_of_nodes(index: &Index) -> Vec<u64> {
    let of = |number: usize| {
        let node = &index.nodes()[number];
        let mut hasher = DefaultHasher::new();
        (node.origin, node.extent, node.count, node.points, node.children, node.level, node.spacing.to_bits()).hash(&mut hasher);
        decode(index, number).unwrap().planes.hash(&mut hasher);
        hasher.finish()
    };
    let mut all: Vec<u64> = (0..index.nodes().len()).map(of).collect();
    all.sort_unstable();
    all
}

// ---- every point once

/// Least corners and sides of boxes: small, flat and long, and as large as there are.
const BOXES: [([i32; 3], [u32; 3]); 5] = [
    ([0; 3], [1000; 3]),
    ([-7; 3], [1, 0, 2]),
    ([-500_000_000, 3, -1], [1_000_000_000, 1000, 1]),
    ([i32::MIN; 3], [u32::MAX; 3]),
    ([i32::MIN, 0, i32::MAX - 9], [u32::MAX, 5, 9]),
];

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn small_clouds_of_any_shape_are_kept_bit_by_bit(
        which in 0..SHAPES.len(), extent in 0..BOXES.len(), shrink in prop::array::uniform3(0u32..32), count in 1usize..400, seed: u64,
        scale in prop::array::uniform3(1e-4..1.0f64), offset in prop::array::uniform3(-1e7..1e7f64), threads in 1usize..3,
    ) {
        let (low, sides) = BOXES[extent];
        let sides = [0, 1, 2].map(|axis| sides[axis] >> shrink[axis]);
        let place = Place::new();
        let file = place.las("a.las", &shape(SHAPES[which], count, low, sides, seed), Frame { step: scale, offset, stated: None });
        place.faithful(&[file], &Options { threads, ..OPTIONS });
    }
}

#[test]
fn large_clouds_of_any_shape_are_kept_bit_by_bit() {
    for (number, (low, sides)) in BOXES.into_iter().enumerate() {
        for which in SHAPES {
            // Half of them fill many leaves.
            let count = if (number + which as usize).is_multiple_of(2) { 300_000 } else { 70_000 };
            let place = Place::new();
            let file = place.las("a.las", &shape(which, count, low, sides, 5), MILLIMETRES);
            let index = place.faithful(&[file], &OPTIONS);
            println!("{which:?} in {sides:?}: {} nodes", index.nodes().len());
        }
    }
}

#[test]
fn one_point_and_two_points_as_far_apart_as_can_be() {
    let place = Place::new();
    let ends = [point([i32::MIN; 3], 1), point([i32::MAX; 3], 2)];
    for (points, nodes) in [(&ends[..1], 1), (&ends[1..], 1), (&ends, 3), (&[ends[0], ends[0]], 1)] {
        let file = place.las("a.las", points, MILLIMETRES);
        assert_eq!(place.faithful(&[file], &OPTIONS).nodes().len(), nodes);
    }
}

#[test]
fn an_empty_cloud_is_an_index_without_nodes() {
    let place = Place::new();
    let index = place.faithful(&[place.las("none.las", &[], MILLIMETRES)], &OPTIONS);
    assert_eq!((index.nodes().len(), index.directory.roots, index.directory.contents.points), (0, 0, 0));
    let some = place.las("some.las", &[point([1; 3], 1)], MILLIMETRES);
    assert_eq!(place.faithful(&[place.at("none.las"), some], &OPTIONS).nodes().len(), 1);
}

#[test]
fn a_million_coincident_points_are_leaves_of_the_same_bytes_in_any_order() {
    let place = Place::new();
    let points: Vec<Point> = (0..1_000_000).map(|i| point([5, -6, 7], i)).collect();
    let file = place.las("a.las", &points, MILLIMETRES);
    let index = place.faithful(std::slice::from_ref(&file), &OPTIONS);
    let leaves: Vec<u32> = index.nodes().iter().filter(|node| node.is_leaf()).map(|node| node.count).collect();
    assert_eq!(leaves.len(), 1_000_000usize.div_ceil(POINTS_PER_PAGE as usize));
    assert_eq!((index.nodes()[0].count, index.nodes()[0].points), (1, 1_000_000));
    let bytes = fs::read(place.at("a.pnti")).unwrap();
    place.write("a.las", &shuffled(&fs::read(&file).unwrap()));
    place.build(&[file], "a.pnti", &Options { memory: 64 << 20, threads: 1, ..OPTIONS }).unwrap();
    assert!(fs::read(place.at("a.pnti")).unwrap() == bytes);
}

fn files_below(folder: PathBuf, most: u64) -> Vec<PathBuf> {
    let mut folders = vec![folder];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap()) {
            match entry.metadata().unwrap() {
                found if found.is_dir() => folders.push(entry.path()),
                found if found.len() <= most && entry.path().extension().is_some_and(|extension| extension != "md") => {
                    files.push(entry.path())
                }
                _ => {}
            }
        }
    }
    files.sort();
    files
}

#[test]
fn real_files_are_kept_bit_by_bit() {
    let Some(data) = shared("data") else { return };
    let files = files_below(data, 4_000_000);
    assert!(files.len() >= 20, "{} files", files.len());
    for (i, file) in files.into_iter().enumerate() {
        let index = Place::new().faithful(std::slice::from_ref(&file), &Options { threads: 1 + i % 2, ..OPTIONS });
        println!("{}: {} points in {} nodes", file.display(), index.directory.contents.points, index.nodes().len());
    }
}

#[test]
fn real_files_of_every_format_are_kept_together() {
    let mut files = Vec::new();
    for name in ["e57/A_B.e57", "e57/ColouredCubeFloat.e57", "aerial/sample_c.las", "aerial/4_6_crop.las", "formats/las1.4_pf9.laz"] {
        let Some(file) = shared(&format!("data/{name}")) else { return };
        files.push(file);
    }
    files.push(shared("data/photogrammetry/frag_115.ply").unwrap());
    let index = Place::new().faithful(&files, &OPTIONS);
    assert!(trees(&index) >= 5 && index.directory.roots == 1, "{} trees", trees(&index));
}

#[test]
fn files_on_one_lattice_become_one_tree_and_others_their_own_below_one_root() {
    let place = Place::new();
    let cloud = |seed| shape(Shape::Plane, 40_000, [-1000; 3], [5000; 3], seed);
    let shifted = Frame { offset: [123.456, -7.0, 1e6 * 0.001], ..MILLIMETRES };
    let coarse = Frame { step: [0.001, 0.001, 0.002], ..MILLIMETRES };
    let between = Frame { offset: [0.0005, 0.0, 0.0], ..MILLIMETRES };
    let file = |name: &str, seed, frame| place.las(name, &cloud(seed), frame);
    let files = [file("a.las", 1, MILLIMETRES), file("b.las", 2, shifted), file("c.las", 3, coarse), file("d.las", 4, between)];
    for (which, count) in [(&files[..2], 1), (&files[..3], 2), (&files[1..3], 2), (&files, 3)] {
        let index = place.faithful(which, &OPTIONS);
        assert_eq!((index.directory.roots, trees(&index)), (1, count));
        assert!(index.directory.contents.stations.len() >= which.len());
    }
    // Twice the same.
    let index = place.faithful(&[files[0].clone(), files[0].clone()], &OPTIONS);
    assert_eq!((index.directory.roots, index.directory.contents.points), (1, 80_000));
}

/// Lattices that leaves lie on.
fn trees(index: &Index) -> usize {
    index.nodes().iter().filter(|node| node.is_leaf()).map(|node| node.lattice).collect::<BTreeSet<_>>().len()
}

#[test]
fn a_hundred_files_on_lattices_of_their_own_cost_a_view_no_more_than_one() {
    let place = Place::new();
    let side = 200_000;
    let cloud = shape(Shape::Plane, 400_000, [0; 3], [side; 3], 11);
    let whole = place.las("whole.las", &cloud, MILLIMETRES);
    let tile = |i: i32| {
        // Each with an offset that is no whole number of steps from any other's.
        let at = |q: i32| (10 * q as i64 / (side as i64 + 1)) as i32;
        let own: Vec<Point> = cloud.iter().filter(|point| at(point.q[0]) == i % 10 && at(point.q[1]) == i / 10).copied().collect();
        place.las(&format!("{i}.las"), &own, Frame { offset: [1e-3 * (0.137 + 0.0071 * i as f64), 0.0, 0.0], ..MILLIMETRES })
    };
    let tiles: Vec<PathBuf> = (0..100).map(tile).collect();
    let many = place.faithful(&tiles, &OPTIONS);
    assert_eq!((trees(&many), many.directory.roots), (100, 1));
    let two = contents_of_nodes(&many);
    assert!(contents_of_nodes(&place.index(&tiles, &Options { threads: 1, memory: 64 << 20, ..OPTIONS })) == two, "threads, or memory");
    let one = place.index(&[whole], &OPTIONS);
    let [low, high] = one.directory.contents.bounds.unwrap();
    let camera = Camera::framing(Preset::Fit, &[low, high], [320, 180]);
    let view = View::new(camera, [320, 180]).unwrap();
    for budget in [70_000, 150_000, 300_000] {
        let detail = Detail { budget, ..Detail::of([320, 180]) };
        let points = [&one, &many].map(|index| cut::choose(index, &view, &Clips::default(), &detail, &HashSet::new()).points);
        println!("budget {budget}: {} points of one file, {} of a hundred", points[0], points[1]);
        assert!(points.iter().all(|&points| points <= budget), "{points:?}");
        assert!(points[1] <= 2 * points[0].max(65_536), "{points:?}");
    }
}

#[test]
fn files_too_far_apart_for_one_lattice_are_refused_with_a_reason() {
    let place = Place::new();
    let near = place.las("near.las", &[point([i32::MAX; 3], 1)], MILLIMETRES);
    let far = place.las("far.las", &[point([i32::MIN; 3], 1)], Frame { offset: [-1000.0; 3], ..MILLIMETRES });
    let error = place.build(&[near, far], "a.pnti", &OPTIONS).unwrap_err().to_string();
    assert!(error.contains("apart"), "{error}");
}

#[test]
fn more_than_fits_the_memory_goes_through_a_file_and_full_buckets_are_split() {
    let place = Place::new();
    scan(&place.at("street.las"), Scene::Street, 2_000_000);
    let street = cloud::read(&[place.at("street.las")], &READ, &Silent).unwrap();
    let Lattice { step, offset } = street.parts[0].lattice;
    // Half a million points in a few centimetres, on the same lattice, counted from elsewhere.
    let blob = shape(Shape::Uniform, 500_000, [-40_000; 3], [64; 3], 9);
    let frame = Frame { step: step.to_array(), offset: (offset + step * 40_100.0).to_array(), stated: None };
    let files = [place.at("street.las"), place.las("blob.las", &blob, frame)];
    let little = Options { memory: 64 << 20, threads: 1, ..OPTIONS };
    let summary = place.build(&files, "b.pnti", &little).unwrap();
    assert!(summary.spilled_bytes > 4 << 20, "{} bytes spilled", summary.spilled_bytes);
    let one = contents_of_nodes(&place.faithful(&files, &little));
    let two = contents_of_nodes(&place.index(&files, &Options { threads: 2, ..little }));
    assert!(one == two, "threads");
    let much = place.index(&files, &OPTIONS);
    assert_eq!(much.directory.roots, 1);
    assert!(contents_of_nodes(&much) == one, "memory");
}

#[test]
fn a_header_that_lies_about_its_box_changes_no_point() {
    let points = shape(Shape::Clusters, 90_000, [-70_000, 5, 9], [140_000, 70_000, 3], 3);
    let everywhere = [[2147483.0, -2147483.0]; 3];
    for (what, stated) in [
        ("too small", [[0.01, 0.0]; 3]),
        ("elsewhere", [[5000.0, 4000.0]; 3]),
        ("too large", everywhere),
        ("beyond the lattice", [[1e30, -1e30]; 3]),
        ("NaN", [[f64::NAN; 2]; 3]),
        ("one NaN", [[f64::NAN, 0.0], [1.0, 0.0], [1.0, 0.0]]),
        ("infinite", [[f64::INFINITY, f64::NEG_INFINITY]; 3]),
        ("inverted", [[0.0, 100.0]; 3]),
        ("zero", [[0.0; 2]; 3]),
    ] {
        println!("{what}");
        let place = Place::new();
        let file = place.las("a.las", &points, Frame { stated: Some(stated), ..MILLIMETRES });
        place.faithful(std::slice::from_ref(&file), &OPTIONS);
        if !what.contains("NaN") {
            assert!(place.build(std::slice::from_ref(&file), "strict.pnti", &Options { strict: true, ..OPTIONS }).is_err());
        }
        // Beside another that lies about the same lattice.
        let other = Frame { offset: [1_000_000.0; 3], stated: Some(everywhere.map(|range| range.map(|v| v + 1_000_000.0))), ..MILLIMETRES };
        let other = place.las("b.las", &points, other);
        place.faithful(&[file, other], &OPTIONS);
    }
}

#[test]
fn extreme_lattices_are_kept_exactly() {
    let points = shape(Shape::Uniform, 400, [i32::MIN; 3], [u32::MAX; 3], 3);
    for step in [5e-324, 1e-300, 1e-7, 0.1, 1.0 / 3.0, 1e300 / 2f64.powi(31)] {
        for offset in [0.0, 0.1, -4_999_999.999_999_9, 1e299] {
            let place = Place::new();
            let file = place.las("a.las", &points, Frame { step: [step; 3], offset: [offset, -offset, 0.0], stated: None });
            let index = place.index(std::slice::from_ref(&file), &OPTIONS);
            let cloud = cloud::read(&[file], &READ, &Silent).unwrap();
            assert_eq!(index.directory.contents.lattices[0], [cloud.parts[0].lattice.step, cloud.parts[0].lattice.offset]);
            assert!(leaf_rows(&index, &cloud) == rows(&index, &cloud), "{step} {offset}");
        }
    }
}

#[test]
fn lattices_come_back_to_the_last_bit() {
    let place = Place::new();
    for i in 0..100 {
        let random = |k: u64| f64::from_bits(noise(6 * i + k) & !(0x7FF << 52) | (1023 - 10 + 30 * (k >= 3) as u64) << 52).abs();
        let frame = Frame { step: [random(0), random(1), random(2)], offset: [random(3), random(4), random(5)], stated: None };
        let index = place.index(&[place.las("a.las", &[point([1, 2, 3], 1)], frame)], &OPTIONS);
        let [step, offset] = index.directory.contents.lattices[0];
        assert_eq!((step.to_array(), offset.to_array()), (frame.step, frame.offset));
    }
}

// ---- the same bytes

#[test]
fn threads_and_the_order_of_the_file_change_no_byte() {
    let place = Place::new();
    // Points that coincide, and colours of which only a few show that they have 16 bits.
    let mut points = shape(Shape::Corner, 600_000, [0; 3], [40_000; 3], 7);
    points.iter_mut().enumerate().for_each(|(i, point)| {
        if i % 60_000 != 0 {
            point.rgb = point.rgb.map(|v| v & 255);
        }
    });
    let file = place.las("a.las", &points, MILLIMETRES);
    let sorted = fs::read(&file).unwrap();
    place.faithful(std::slice::from_ref(&file), &OPTIONS);
    let bytes = fs::read(place.at("a.pnti")).unwrap();
    for threads in [1, 3] {
        place.build(std::slice::from_ref(&file), "b.pnti", &Options { threads, ..OPTIONS }).unwrap();
        assert!(fs::read(place.at("b.pnti")).unwrap() == bytes, "{threads} threads");
    }
    place.write("a.las", &shuffled(&sorted));
    place.build(&[file], "c.pnti", &OPTIONS).unwrap();
    assert!(fs::read(place.at("c.pnti")).unwrap() == bytes, "shuffled");
}

// ---- inner nodes

#[test]
fn samples_of_several_stations_are_means_of_what_all_have_with_one_exposure() {
    let place = Place::new();
    let file = place.at("street.las");
    scan(&file, Scene::Street, 500_000);
    let index = place.faithful(&[file], &OPTIONS);
    assert!(index.directory.contents.balance.is_some() && index.nodes().iter().any(|node| !node.is_leaf()));
    // Of an index that does not know them, nobody says any.
    place.write("first.pnti", &first_version(&fs::read(place.at("a.pnti")).unwrap()));
    let first = Index::open(&place.at("first.pnti")).unwrap();
    assert_eq!(first.directory.contents, Contents { balance: None, counts: None, ..index.directory.contents.clone() });
    // Too few, too many, and none that there can be.
    let bytes = fs::read(place.at("a.pnti")).unwrap();
    let json = number(&bytes, 24) as usize + index.nodes().len() * field::BYTES;
    let contents: serde_json::Value = serde_json::from_slice(&bytes[json..]).unwrap();
    for gains in [&[1.0; 4][..], &[1.0; 6], &[1.0, 1.0, 1.0, 1.0, 0.0], &[1.0, 1.0, 1.0, 1.0, -1.0], &[1.0, 1.0, 17.0, 1.0, 1.0]] {
        let mut contents = contents.clone();
        contents["balance"]["gains"] = gains.into();
        let contents = serde_json::to_vec(&contents).unwrap();
        let crafted = signed(with_contents(&bytes, json, &contents));
        let error = Index::open(&place.write("crafted.pnti", &crafted)).err().expect("impossible exposures were taken").to_string();
        assert!(error.contains("exposures"), "{error}");
    }
}

#[test]
fn the_heaviest_class_of_a_cell_is_its_class() {
    // 2^18 pairs of cells' corners: three points of one class and two of another in each, far from the next.
    let mut points = Vec::new();
    for i in 0..1i32 << 17 {
        let corner = [i % 512 * 1024, i / 512 * 1024, 0];
        let (many, few) = if i % 2 == 0 { (2, 9) } else { (6, 5) };
        let five = [many, few, many, few, many];
        points.extend(five.into_iter().enumerate().map(|(k, class)| Point {
            q: [corner[0] + k as i32 % 2, corner[1] + k as i32 / 2, 0],
            class,
            rgb: [1000; 3],
            ..Point::default()
        }));
    }
    let place = Place::new();
    let index = place.faithful(&[place.las("a.las", &points, MILLIMETRES)], &OPTIONS);
    let root = decode(&index, 0).unwrap();
    assert!(!index.nodes()[0].is_leaf());
    // A cell of the root holds whole groups of five, and in even columns only even ones.
    for i in 0..root.q.len() {
        let class = root.get::<1>(Plane::Class, i).unwrap()[0];
        assert!(class == 2 || class == 6, "class {class}");
        assert_eq!(root.weight(i) % 5, 0);
    }
}

#[test]
fn colours_of_8_and_16_bits_and_none() {
    let place = Place::new();
    let colored = |color: &dyn Fn(u16) -> u16| -> Vec<Point> {
        (0..70_000u32).map(|i| Point { q: [i as i32; 3], rgb: [color(i as u16), 0, color(7)], ..Point::default() }).collect()
    };
    let first = |index: &Index| decode(index, index.nodes().iter().position(NodeRecord::is_leaf).unwrap()).unwrap();
    let narrow = place.las("8.las", &colored(&|v| v & 255), MILLIMETRES);
    let index = place.faithful(std::slice::from_ref(&narrow), &OPTIONS);
    assert_eq!((0..256).map(|i| first(&index).get::<3>(Plane::Rgb, i).unwrap()[0]).collect::<Vec<_>>(), (0..=255).collect::<Vec<_>>());
    assert_eq!(index.directory.contents.parts[0].rgb_bits, 8);
    let wide = place.las("16.las", &colored(&|v| v), MILLIMETRES);
    let index = place.faithful(std::slice::from_ref(&wide), &OPTIONS);
    assert_eq!(first(&index).get::<3>(Plane::Rgb, 257 * 9).unwrap(), [9, 0, 0]);
    assert_eq!(index.directory.contents.parts[0].rgb_bits, 16);
    let black = place.las("0.las", &colored(&|_| 0), MILLIMETRES);
    let index = place.faithful(std::slice::from_ref(&black), &OPTIONS);
    assert!(index.nodes().iter().all(|node| !node.has(Plane::Rgb)));
    // Together: what is black everywhere has no colour, and is shown white.
    place.faithful(&[narrow, black.clone(), wide], &OPTIONS);
    place.faithful(&[black.clone(), black], &OPTIONS);
}

#[test]
fn only_what_is_wanted_is_kept() {
    let place = Place::new();
    let file = place.las("a.las", &shape(Shape::Uniform, 5000, [0; 3], [9999; 3], 1), MILLIMETRES);
    place
        .build(std::slice::from_ref(&file), "a.pnti", &Options { wanted: Wanted { class: true, ..Wanted::default() }, ..OPTIONS })
        .unwrap();
    let index = Index::open(&place.at("a.pnti")).unwrap();
    for (plane, _) in PLANES {
        let expected = [Plane::Coarse, Plane::Fine, Plane::Class].contains(&plane);
        assert!(index.nodes().iter().all(|node| node.has(plane) == expected), "{plane:?}");
    }
}

#[test]
fn position_colour_intensity_and_class_take_at_most_20_bytes_a_point() {
    let place = Place::new();
    scan(&place.at("street.las"), Scene::Street, 2_000_000);
    let summary = place.build(&[place.at("street.las")], "a.pnti", &OPTIONS).unwrap();
    let bytes = summary.core_bytes as f64 / summary.points as f64;
    println!("{bytes} bytes a point, {} in all", summary.bytes as f64 / summary.points as f64);
    assert!(bytes <= 20.0, "{bytes}");
}

// ---- what is not an index any more

/// A few points that are several nodes all the same, because they lie too far apart for one.
fn small(place: &Place) -> PathBuf {
    let mut points = shape(Shape::Uniform, 12, [i32::MIN; 3], [u32::MAX; 3], 1);
    points.extend(shape(Shape::Clusters, 12, [0; 3], [100; 3], 2));
    place.las("small.las", &points, MILLIMETRES);
    place.build(&[place.at("small.las")], "small.pnti", &OPTIONS).unwrap();
    place.at("small.pnti")
}

/// All that can be read: contents, and records with their planes.
#[derive(Debug, PartialEq)]
struct Told(Contents, Vec<(NodeRecord, BTreeMap<usize, Vec<u8>>)>);

fn told(path: &Path) -> Result<Told> {
    let index = Index::open(path)?;
    let nodes = (0..index.nodes().len()).map(|number| Ok((index.nodes()[number], decode(&index, number)?.planes)));
    Ok(Told(index.directory.contents.clone(), nodes.collect::<Result<_>>()?))
}

const HEADER_BYTES: usize = 56;
const HEADER_PAGE: usize = 4096;

#[test]
fn every_flipped_bit_is_found_or_harmless() {
    let place = Place::new();
    let path = small(&place);
    let bytes = fs::read(&path).unwrap();
    assert!(bytes.len() < 64 << 10 && Index::open(&path).unwrap().nodes().len() >= 3);
    let truth = told(&path).unwrap();
    let flips = bytes.len() * 8;
    let found = AtomicU64::new(0);
    std::thread::scope(|scope| {
        for (half, range) in [0..flips / 2, flips / 2..flips].into_iter().enumerate() {
            let copy = place.write(&format!("{half}.pnti"), &bytes);
            let (bytes, found, truth) = (&bytes, &found, &truth);
            scope.spawn(move || {
                let file = fs::OpenOptions::new().write(true).open(&copy).unwrap();
                for flip in range {
                    let at = flip / 8;
                    file.write_all_at(&[bytes[at] ^ 1 << (flip % 8)], at as u64).unwrap();
                    match told(&copy) {
                        Ok(content) => {
                            assert!(content == *truth, "bit {flip} was not found, and changed something");
                            assert!((HEADER_BYTES..HEADER_PAGE).contains(&at), "bit {flip} was not found");
                        }
                        Err(_) => _ = found.fetch_add(1, Relaxed),
                    }
                    file.write_all_at(&bytes[at..=at], at as u64).unwrap();
                }
                assert!(told(&copy).unwrap() == *truth);
            });
        }
    });
    println!("{} of {flips} flips are found, the rest are padding", found.load(Relaxed));
    assert_eq!(found.into_inner() as usize, flips - 8 * (HEADER_PAGE - HEADER_BYTES));
}

#[test]
fn a_cut_index_is_none() {
    let place = Place::new();
    let path = small(&place);
    let file = fs::OpenOptions::new().write(true).open(&path).unwrap();
    let whole = fs::metadata(&path).unwrap().len();
    file.set_len(whole + 1).unwrap();
    assert!(Index::open(&path).is_err());
    for length in (0..whole).rev() {
        file.set_len(length).unwrap();
        let error = Index::open(&path).err().unwrap_or_else(|| panic!("{length} bytes of {whole} are an index")).to_string();
        assert!(error.contains("small.pnti"), "{error}");
    }
}

/// Offsets of a node record's fields.
mod field {
    pub const ORIGIN: usize = 0;
    pub const POINTS: usize = 24;
    pub const AT: usize = 32;
    pub const SPACING: usize = 40;
    pub const EXTENT: usize = 48;
    pub const COUNT: usize = 60;
    pub const FIRST_CHILD: usize = 124;
    pub const CHILDREN: usize = 128;
    pub const PARENT: usize = 132;
    pub const PLANES: usize = 136;
    pub const LATTICE: usize = 138;
    pub const BITS: usize = 140;
    pub const COARSER: usize = 141;
    pub const BYTES: usize = 144;
}

fn number(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

/// Gives a changed header and directory their checksums.
fn signed(mut bytes: Vec<u8>) -> Vec<u8> {
    if let Some(directory) = bytes.get(number(&bytes, 24) as usize..) {
        let crc = crc32c::crc32c(directory);
        bytes[44..48].copy_from_slice(&crc.to_le_bytes());
    }
    bytes[48..52].fill(0);
    let crc = crc32c::crc32c(&bytes[..HEADER_BYTES]);
    bytes[48..52].copy_from_slice(&crc.to_le_bytes());
    bytes
}

#[test]
fn an_index_from_the_future_is_refused_with_a_sentence() {
    let place = Place::new();
    let path = small(&place);
    let mut bytes = fs::read(&path).unwrap();
    assert!(signed(bytes.clone()) == bytes, "checksums are what this test takes them for");
    bytes[8] += 1;
    for bytes in [bytes.clone(), signed(bytes)] {
        let error = Index::open(&place.write("new.pnti", &bytes)).err().unwrap().to_string();
        assert!(error.contains("version 4") && error.contains("newer"), "{error}");
    }
    for bytes in [&b"something else"[..], &[0; 5000], b"pnti\r\n\x1a\n"] {
        let path = place.write("none.pnti", bytes);
        assert!(Index::open(&path).is_err());
        assert_eq!(Index::is_one(&path), bytes.len() == 8);
    }
    assert!(Index::is_one(&path) && !Index::is_one(place.folder.path()) && !Index::is_one(&place.at("nowhere")));
    assert!(Index::open(place.folder.path()).is_err() && Index::open(&place.at("nowhere")).is_err());
}

/// An index with other contents, which begin at this byte.
fn with_contents(bytes: &[u8], at: usize, contents: &[u8]) -> Vec<u8> {
    let mut crafted = [&bytes[..at], contents].concat();
    let length = crafted.len() as u64;
    crafted[16..24].copy_from_slice(&length.to_le_bytes());
    crafted[32..40].copy_from_slice(&(contents.len() as u64).to_le_bytes());
    crafted
}

#[test]
fn crafted_directories_are_refused() {
    let place = Place::new();
    let path = small(&place);
    let bytes = fs::read(&path).unwrap();
    let index = Index::open(&path).unwrap();
    let nodes = index.nodes().to_vec();
    let directory = number(&bytes, 24) as usize;
    let inner = nodes.iter().position(|node| !node.is_leaf()).unwrap();
    let second = nodes.iter().skip(inner + 1).position(|node| !node.is_leaf()).map(|i| i + inner + 1);
    let leaf = nodes.iter().position(NodeRecord::is_leaf).unwrap();
    let child = nodes[inner].first_child as usize;
    let try_it = |what: &str, edits: &[(usize, usize, &[u8])]| {
        let mut crafted = bytes.clone();
        for &(node, field, value) in edits {
            let at = directory + node * field::BYTES + field;
            crafted[at..at + value.len()].copy_from_slice(value);
        }
        assert!(crafted != bytes, "{what}: nothing is different");
        let path = place.write("crafted.pnti", &signed(crafted));
        let error = Index::open(&path).err().unwrap_or_else(|| panic!("{what} was taken")).to_string();
        println!("{what}: {}", error.rsplit('/').next().unwrap());
    };
    let long = |v: u64| v.to_le_bytes();
    let word = |v: u32| v.to_le_bytes();
    let real = |v: f64| v.to_le_bytes();
    use field::*;
    try_it("its own child", &[(inner, FIRST_CHILD, &word(inner as u32))]);
    try_it("a child before its parent", &[(inner, FIRST_CHILD, &word(0))]);
    try_it("a leaf with a child above it", &[(leaf, FIRST_CHILD, &word(0)), (leaf, CHILDREN, &word(1)), (leaf, SPACING, &real(1.0))]);
    for count in [1, nodes[inner].children - 1, nodes[inner].children + 1, u32::MAX, u32::MAX - nodes[inner].first_child] {
        try_it("children that are too many or too few", &[(inner, CHILDREN, &word(count))]);
    }
    try_it("no children", &[(inner, CHILDREN, &word(0))]);
    try_it("children far away", &[(inner, FIRST_CHILD, &word(u32::MAX))]);
    if let Some(second) = second {
        try_it("children of two", &[(second, FIRST_CHILD, &word(nodes[inner].first_child))]);
    }
    try_it("another parent", &[(child, PARENT, &word(u32::MAX))]);
    for count in [0, POINTS_PER_PAGE + 1, u32::MAX] {
        try_it("a count", &[(leaf, COUNT, &word(count))]);
        try_it("a count and its points", &[(leaf, COUNT, &word(count)), (leaf, POINTS, &long(count as u64))]);
    }
    for points in [0, 1, u64::MAX, nodes[inner].points + 1] {
        try_it("points", &[(inner, POINTS, &long(points))]);
    }
    for at in [0, 4095, directory as u64, directory as u64 - 1, bytes.len() as u64, u64::MAX, u64::MAX - 4096] {
        try_it("planes elsewhere", &[(leaf, AT, &long(at))]);
    }
    for lattice in [index.directory.contents.lattices.len() as u16, u16::MAX] {
        try_it("a lattice", &[(leaf, LATTICE, &lattice.to_le_bytes())]);
    }
    for spacing in [f64::NAN, f64::INFINITY, -1.0, 0.0] {
        try_it("a spacing", &[(inner, SPACING, &real(spacing))]);
    }
    for spacing in [f64::NAN, 1.0] {
        try_it("a leaf's spacing", &[(leaf, SPACING, &real(spacing))]);
    }
    for bits in [0, 31, 40, 255, nodes[leaf].bits ^ 1] {
        try_it("bits", &[(leaf, BITS, &[bits])]);
    }
    try_it("an extent", &[(leaf, EXTENT, &word(u32::MAX)), (leaf, BITS, &[32])]);
    for origin in [i64::MIN, i64::MAX, 1 << 61] {
        try_it("an origin", &[(leaf, ORIGIN, &origin.to_le_bytes())]);
    }
    for coarser in [65, 255] {
        try_it("a rounding", &[(inner, COARSER, &[coarser])]);
    }
    for planes in [0u16, 1 << 15, u16::MAX, nodes[leaf].planes & !1] {
        try_it("planes", &[(leaf, PLANES, &planes.to_le_bytes())]);
    }
    // The header's own numbers.
    for (what, at, value) in [
        ("nodes", 12, &word(nodes.len() as u32 + 1)[..]),
        ("all nodes", 12, &word(u32::MAX)),
        ("no nodes", 12, &word(0)),
        ("length", 16, &long(bytes.len() as u64 + 1)),
        ("directory", 24, &long((directory + field::BYTES) as u64)),
        ("directory behind", 24, &long(u64::MAX)),
        ("contents", 32, &long(0)),
        ("long contents", 32, &long(u64::MAX)),
        ("no roots", 40, &word(0)),
        ("two roots", 40, &word(2)),
        ("roots", 40, &word(u32::MAX)),
    ] {
        let mut crafted = bytes.clone();
        crafted[at..at + value.len()].copy_from_slice(value);
        let path = place.write("crafted.pnti", &signed(crafted));
        assert!(Index::open(&path).is_err(), "{what}");
    }
    let json = directory + nodes.len() * field::BYTES;
    // More points of a class than there are, no class, and one twice.
    let told: serde_json::Value = serde_json::from_slice(&bytes[json..]).unwrap();
    for (kinds, counts) in [("classes", "[[2,18446744073709551615]]"), ("returns", "[[16,1]]"), ("returns", "[[1,1],[1,1]]")] {
        let mut told = told.clone();
        told["counts"][kinds] = serde_json::from_str(counts).unwrap();
        let crafted = with_contents(&bytes, json, &serde_json::to_vec(&told).unwrap());
        let error = Index::open(&place.write("crafted.pnti", &signed(crafted))).err().unwrap().to_string();
        assert!(error.contains("impossible numbers of points"), "{error}");
    }
    // Contents that are no JSON, not these, or nested without end.
    for contents in [&b"{}"[..], b"", b"\xff", &[b'['; 100_000], b"{\"points\": 1e999}"] {
        assert!(Index::open(&place.write("crafted.pnti", &signed(with_contents(&bytes, json, contents)))).is_err());
    }
}

#[test]
fn random_records_are_refused_or_can_be_read() {
    let place = Place::new();
    let path = small(&place);
    let bytes = fs::read(&path).unwrap();
    let directory = number(&bytes, 24) as usize;
    let records = Index::open(&path).unwrap().nodes().len() * field::BYTES;
    let mut taken = 0;
    let copy = place.write("crafted.pnti", &bytes);
    let file = fs::OpenOptions::new().write(true).open(&copy).unwrap();
    for i in 0..20_000 {
        let mut crafted = bytes.clone();
        for k in 0..1 + noise(i) % 3 {
            let n = noise(i * 4 + k);
            let at = directory + n as usize % records;
            let value =
                [0, 1, 0x7F, 0x80, 0xFF, (n >> 40) as u8, crafted[at].wrapping_add(1), crafted[at].wrapping_sub(1)][(n >> 32) as usize % 8];
            crafted[at] = value;
        }
        // Either is well; neither panics.
        file.write_all_at(&signed(crafted), 0).unwrap();
        let told = told(&copy);
        let index = Index::open(&copy);
        taken += told.is_ok() as u32;
        if let Ok(index) = index {
            for number in 0..index.nodes().len() {
                let _ = index.samples(number);
                let _ = index.bounds(&index.nodes()[number]);
            }
        }
    }
    println!("{taken} of 20,000 were taken");
}

#[test]
fn an_index_that_shrinks_or_changes_while_it_is_open_is_an_error() {
    let place = Place::new();
    place.las("a.las", &shape(Shape::Plane, 200_000, [0; 3], [99_999; 3], 1), MILLIMETRES);
    place.build(&[place.at("a.las")], "a.pnti", &OPTIONS).unwrap();
    let path = place.at("a.pnti");
    let bytes = fs::read(&path).unwrap();
    let file = fs::OpenOptions::new().write(true).open(&path).unwrap();
    let index = Index::open(&path).unwrap();
    let all = || (0..index.nodes().len()).map(|number| decode(&index, number).map(drop)).collect::<Result<Vec<()>>>();
    all().unwrap();
    for length in [bytes.len() as u64 / 2, 4097, 1, 0] {
        file.set_len(length).unwrap();
        let error = all().unwrap_err().to_string();
        assert!(error.contains("shorter") || error.contains("damaged"), "{error}");
        assert!(index.samples(0).is_err());
        file.set_len(bytes.len() as u64).unwrap();
        // Zeros where there were points.
        assert!(all().unwrap_err().to_string().contains("damaged"));
        file.write_all_at(&bytes, 0).unwrap();
        all().unwrap();
    }
    // While somebody reads.
    let stop = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for i in 0..200 {
                file.set_len(noise(i) % bytes.len() as u64).unwrap();
                file.write_all_at(&bytes, 0).unwrap();
            }
            stop.store(true, Relaxed);
        });
        let mut errors = 0;
        while !stop.load(Relaxed) {
            errors += all().is_err() as u32;
        }
        println!("{errors} errors");
    });
    all().unwrap();
}

// ---- stopping

/// Counts ticks, and from one on says that it was interrupted.
struct Stops {
    at: u64,
    ticks: AtomicU64,
}

impl Progress for Stops {
    fn tick(&self, _doing: &str, _done: u64, _total: u64) -> Result<()> {
        if self.ticks.fetch_add(1, Relaxed) >= self.at { Err(Error::Interrupted) } else { Ok(()) }
    }
}

/// Stops once only: whoever comes later is not told.
struct StopsOnce(Stops);

impl Progress for StopsOnce {
    fn tick(&self, _doing: &str, _done: u64, _total: u64) -> Result<()> {
        if self.0.ticks.fetch_add(1, Relaxed) == self.0.at { Err(Error::Interrupted) } else { Ok(()) }
    }
}

#[test]
fn work_that_is_interrupted_at_any_tick_ends_and_leaves_nothing() {
    let place = Place::new();
    let file = place.las("a.las", &shape(Shape::Uniform, 400_000, [0; 3], [9_999; 3], 1), MILLIMETRES);
    let output = place.at("a.pnti");
    for threads in [1, 2, 3] {
        let options = Options { threads, memory: 64 << 20, ..OPTIONS };
        let count = Stops { at: u64::MAX, ticks: AtomicU64::new(0) };
        build::build(std::slice::from_ref(&file), &output, &options, &count).unwrap();
        fs::remove_file(&output).unwrap();
        let ticks = count.ticks.into_inner();
        println!("{threads} threads: {ticks} ticks");
        for at in 0..ticks {
            let stops = Stops { at, ticks: AtomicU64::new(0) };
            let ended = build::build(std::slice::from_ref(&file), &output, &options, &stops);
            assert!(matches!(ended, Err(Error::Interrupted)), "tick {at}: {ended:?}");
            assert_eq!(names(place.folder.path()), ["a.las"]);
            let once = StopsOnce(Stops { at, ticks: AtomicU64::new(0) });
            assert!(build::build(std::slice::from_ref(&file), &output, &options, &once).is_err(), "tick {at}, once");
            assert_eq!(names(place.folder.path()), ["a.las"]);
        }
    }
}

#[test]
fn odd_outputs_and_requests_are_refused_or_taken() {
    let place = Place::new();
    let file = place.las("a.las", &[point([1; 3], 1)], MILLIMETRES);
    for output in [place.folder.path().to_owned(), place.at("nowhere/a.pnti"), PathBuf::from("/dev/null"), PathBuf::from("/")] {
        assert!(build::build(std::slice::from_ref(&file), &output, &OPTIONS, &Silent).is_err(), "{}", output.display());
    }
    place.build(&[], "none.pnti", &OPTIONS).unwrap();
    for name in ["new\nline.pnti", &"x".repeat(255), &"é".repeat(127), &"🦀".repeat(63)] {
        place.build(std::slice::from_ref(&file), name, &OPTIONS).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(Index::open(&place.at(name)).is_ok());
    }
    use std::os::unix::ffi::OsStrExt;
    let odd = place.folder.path().join(std::ffi::OsStr::from_bytes(b"\xff\xfe.las"));
    fs::copy(&file, &odd).unwrap();
    place.build(std::slice::from_ref(&odd), "odd.pnti", &OPTIONS).unwrap();
    assert_eq!(Index::open(&place.at("odd.pnti")).unwrap().directory.contents.points, 1);
    // A pipe that nobody writes to.
    let pipe = std::ffi::CString::new(place.at("pipe").as_os_str().as_bytes()).unwrap();
    // SAFETY: a plain system call with a string that ends in 0.
    assert_eq!(unsafe { libc::mkfifo(pipe.as_ptr(), 0o600) }, 0);
    assert!(!Index::is_one(&place.at("pipe")) && Index::open(&place.at("pipe")).is_err());
    // No threads, no memory: as few as there must be.
    place.build(std::slice::from_ref(&file), "least.pnti", &Options { threads: 0, memory: 0, ..OPTIONS }).unwrap();
}

// ---- other versions

/// The same index as the first version wrote it: shorter records, without room for planes that are derived.
fn first_version(bytes: &[u8]) -> Vec<u8> {
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let long = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    let (nodes, directory_at, contents) = (word(12) as usize, long(24), long(32));
    let record = size_of::<NodeRecord>();
    let records =
        bytes[directory_at..][..nodes * record].chunks(record).flat_map(|record| [&record[..108], &record[record.len() - 20..]].concat());
    let records: Vec<u8> = records.collect();
    let mut known: serde_json::Value = serde_json::from_slice(&bytes[directory_at + nodes * record..][..contents]).unwrap();
    ["oriented", "balance", "counts"].into_iter().for_each(|unknown| drop(known.as_object_mut().unwrap().remove(unknown)));
    let directory = [records, serde_json::to_vec(&known).unwrap()].concat();
    let mut first = [&bytes[..directory_at], &directory].concat();
    let length = first.len() as u64;
    first[8..12].copy_from_slice(&1u32.to_le_bytes());
    first[16..24].copy_from_slice(&length.to_le_bytes());
    first[32..40].copy_from_slice(&(directory.len() as u64 - 128 * nodes as u64).to_le_bytes());
    first[44..48].copy_from_slice(&crc32c::crc32c(&directory).to_le_bytes());
    first[48..52].fill(0);
    let crc = crc32c::crc32c(&first[..56]);
    first[48..52].copy_from_slice(&crc.to_le_bytes());
    first
}

#[test]
fn an_index_of_the_first_version_is_read_as_it_was() {
    let place = Place::new();
    let mut points = shape(Shape::Plane, 200_000, [0; 3], [100_000; 3], 3);
    // So many stations that no node numbers its own in 8 bits, which that version could not.
    points.iter_mut().enumerate().for_each(|(i, point)| point.source = (i % 1000) as u16);
    let now = place.faithful(&[place.las("a.las", &points, MILLIMETRES)], &OPTIONS);
    assert!(!now.has(Plane::Station));
    place.write("first.pnti", &first_version(&fs::read(place.at("a.pnti")).unwrap()));
    let first = Index::open(&place.at("first.pnti")).unwrap();
    let length = |contents: &Contents| serde_json::to_vec(contents).unwrap().len() as u64;
    let unknown = length(&now.directory.contents) - length(&first.directory.contents) + ",\"oriented\":false".len() as u64;
    assert_eq!(first.bytes() + 16 * now.nodes().len() as u64 + unknown, now.bytes());
    assert_eq!(first.directory.contents, Contents { balance: None, counts: None, ..now.directory.contents.clone() });
    assert!(first.nodes() == now.nodes());
    assert!(contents_of_nodes(&first) == contents_of_nodes(&now));
}
