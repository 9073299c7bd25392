//! COPC files read in place: every point is in one node, as `cloud::read` has it; a cut has the
//! nodes above those that it refines to; and a crafted octree is refused in time, in little memory,
//! with its place.

use crate::ancestors::ancestors;
use crate::cameras::perspective;
use crate::copc_file::write_copc;
use crate::points::Random;
use crate::shared::shared;
use glam::DVec3;
use pointillist::cloud::{self, ColumnSet, Columns, ReadOptions};
use pointillist::config::POINTS_PER_PAGE;
use pointillist::index::format::{Index, Plane, Refinement};
use pointillist::progress::Silent;
use pointillist::select::clip::Clips;
use pointillist::select::lod::{Detail, choose};
use pointillist::view::View;
use proptest::prelude::*;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

pub const WANTED: ColumnSet = ColumnSet { source: false, normal: false, ..ColumnSet::ALL };

/// Points of a slope with some height, and their colours.
pub fn slope(points: usize) -> (Vec<[i32; 3]>, Vec<[u8; 3]>) {
    let mut random = Random(0x5EED);
    let mut below = |most: u64| (random.bits() % most) as i32;
    let point = |_| {
        let [x, y] = [below(100_000), below(60_000)];
        ([x, y, x / 3 + below(500)], [below(256) as u8, below(256) as u8, 7])
    };
    (0..points).map(point).unzip()
}

/// Points all over a cube, of which the root has more than a page.
fn cube(points: usize) -> (Vec<[i32; 3]>, Vec<[u8; 3]>) {
    let mut random = Random(0xC0BE);
    let mut below = |most: u64| (random.bits() % most) as i32;
    let point = |_| ([(); 3].map(|()| below(10_000)), [below(256) as u8, 0, 0]);
    (0..points).map(point).unzip()
}

struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn of((at, rgb): (Vec<[i32; 3]>, Vec<[u8; 3]>)) -> Place {
        let place = Place { folder: tempfile::tempdir().unwrap() };
        write_copc(&place.path(), &at, &rgb);
        place
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("a.copc.laz")
    }

    fn open(&self) -> Index {
        Index::open_octree(&self.path(), None, false).unwrap()
    }
}

/// All that is read of a point; times tell points apart.
type Point = ([i64; 3], Option<[u8; 3]>, u16, u8, u8, u64);

fn points(columns: &Columns, origin: [i64; 3]) -> Vec<Point> {
    let Columns { x, y, z, rgb, intensity, class, returns, gps_time, .. } = columns;
    let point = |i: usize| {
        let at = [x[i], y[i], z[i]];
        let place = [0, 1, 2].map(|axis| at[axis] as i64 + origin[axis]);
        let time = gps_time.as_ref().unwrap()[i].to_bits();
        let rgb = rgb.as_ref().map(|rgb| rgb[i]);
        (
            place,
            rgb,
            intensity.as_ref().unwrap()[i],
            class.as_ref().unwrap()[i],
            returns.as_ref().unwrap()[i],
            time,
        )
    };
    (0..columns.len()).map(point).collect()
}

pub fn check_points(path: &Path) -> Index {
    let index = Index::open_octree(path, None, false).unwrap();
    assert!(Index::is_octree(path) && !Index::is_one(path));
    let cloud = cloud::read(&[path.to_owned()], &ReadOptions::new(WANTED, false), &Silent).unwrap();
    let mut expected = points(&cloud.parts[0].columns, [0; 3]);
    let mut found = Vec::new();
    for (number, record) in index.nodes().iter().enumerate() {
        assert!(record.count > 0 && record.count <= POINTS_PER_PAGE);
        assert!(record.is_leaf() == (record.spacing == 0.0));
        let below: u64 = record.children().map(|child| index.nodes()[child].points).sum();
        assert_eq!(record.points, record.count as u64 + below);
        for child in record.children() {
            assert!(child > number && index.nodes()[child].parent as usize == number);
        }
        found.extend(points(&index.columns(number, WANTED).unwrap(), record.origin));
    }
    assert!(index.refinement == Refinement::Adds);
    assert_eq!(index.directory.contents.points, expected.len() as u64);
    expected.sort_unstable();
    found.sort_unstable();
    assert!(found == expected, "{} of {} points", found.len(), expected.len());
    index
}

#[test]
fn nodes_have_every_point_of_the_file_once() {
    let place = Place::of(slope(300_000));
    let index = check_points(&place.path());
    assert!(index.nodes().len() > 4 && index.directory.roots == 1);
    let place = Place::of(cube(200_000));
    let index = check_points(&place.path());
    assert!(index.directory.roots > 1, "a root of several pages");
}

#[test]
fn files_of_other_writers_have_every_point_too() {
    for name in ["data/aerial/lone-star.copc.laz", "data/formats/las1.2_pf3.copc.laz"] {
        let Some(path) = shared(name) else { return };
        check_points(&path);
    }
}

#[test]
fn a_cut_has_all_nodes_above_its_own_and_keeps_its_budget() {
    let place = Place::of(slope(300_000));
    let index = place.open();
    let mut random = Random(11);
    for budget in [1, 80_000, 150_000, 250_000, u64::MAX] {
        let mut within = |least: f64, most: f64| random.within(least, most);
        let eye = DVec3::new(within(0.0, 100.0), within(0.0, 60.0), within(60.0, 90.0));
        let target = DVec3::new(within(0.0, 100.0), within(0.0, 60.0), 20.0);
        let view = View::new(perspective(eye, target, 50.0), [320, 200]).unwrap();
        let sees = |node: usize| view.least_depth(index.bounds(&index.nodes()[node])).is_some();
        let detail = Detail { budget, lod_px: 0.0, ..Detail::of(view.size) };
        let cut = choose(&index, &[view], &Clips::default(), &detail, &HashSet::new());
        let chosen: HashSet<usize> = cut.nodes.iter().map(|wanted| wanted.node).collect();
        assert_eq!(chosen.len(), cut.nodes.len());
        let sum: u64 = chosen.iter().map(|&node| index.nodes()[node].count as u64).sum();
        assert_eq!(sum, cut.points);
        let roots: u64 =
            (0..index.directory.roots as usize).map(|root| index.nodes()[root].count as u64).sum();
        assert!(cut.points <= budget.max(roots));
        let mut seen = HashSet::new();
        for wanted in &cut.nodes {
            // What a node adds to is needed first.
            assert!(ancestors(&index, wanted.node).all(|above| seen.contains(&above)));
            seen.insert(wanted.node);
        }
        if budget == u64::MAX {
            let all = (0..index.nodes().len()).filter(|&node| sees(node));
            assert_eq!(chosen, all.collect());
            assert_eq!(cut.largest_error_px, 0.0);
            // A node that is lost takes nothing with it but its own points.
            let lost = HashSet::from([cut.nodes.last().unwrap().node]);
            let others = choose(&index, &[view], &Clips::default(), &detail, &lost);
            assert_eq!(others.nodes.len(), cut.nodes.len() - 1);
        }
    }
}

#[test]
fn what_is_decoded_once_is_not_read_again() {
    let place = Place::of(slope(300_000));
    let index = place.open();
    let node = index.nodes().len() - 1;
    let record = index.nodes()[node];
    let read = |plane: Plane| {
        index.read(node, plane, &mut vec![0; record.unpacked_bytes(plane) as usize]).unwrap()
    };
    let first = read(Plane::Rgb);
    assert!(first > 0 && first < index.bytes() / 4);
    assert_eq!([read(Plane::Coarse), read(Plane::Fine), read(Plane::Rgb)], [0; 3]);
}

// ---- octrees that lie

const INFO_AT: usize = 429;

fn number(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

/// A file, and where its list of nodes is.
struct Crafted {
    place: Place,
    bytes: Vec<u8>,
    list: usize,
    nodes: usize,
}

impl Crafted {
    fn new() -> Crafted {
        let place = Place::of(slope(200_000));
        let bytes = std::fs::read(place.path()).unwrap();
        let list = number(&bytes, INFO_AT + 40) as usize;
        let nodes = number(&bytes, INFO_AT + 48) as usize / 32;
        assert!(nodes > 4 && list + 32 * nodes == bytes.len());
        Crafted { place, bytes, list, nodes }
    }

    /// Returns the error that a change of the bytes leads to.
    #[track_caller]
    fn refused(&self, change: impl FnOnce(&mut Vec<u8>), length: Option<u64>) -> String {
        let mut bytes = self.bytes.clone();
        change(&mut bytes);
        let path = self.place.folder.path().join("crafted.copc.laz");
        std::fs::write(&path, bytes).unwrap();
        if let Some(length) = length {
            std::fs::File::options().write(true).open(&path).unwrap().set_len(length).unwrap();
        }
        let began = Instant::now();
        let error =
            Index::open_octree(&path, None, false).err().expect("a crafted octree").to_string();
        assert!(began.elapsed() < Duration::from_secs(2), "{:?}: {error}", began.elapsed());
        assert!(error.contains("crafted.copc.laz"), "{error}");
        error
    }
}

/// Returns most memory of this process so far `[bytes]`.
pub fn peak() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap() << 10
}

#[test]
fn octrees_that_lie_are_refused_with_what_is_wrong_and_where() {
    let crafted = Crafted::new();
    let (list, nodes) = (crafted.list, crafted.nodes);
    let entry = |k: usize| list + 32 * k;
    let put = |bytes: &mut Vec<u8>, at: usize, value: &[u8]| {
        bytes[at..at + value.len()].copy_from_slice(value)
    };
    let said = |what: &str, place: usize, error: String| {
        assert!(error.contains(what) && error.contains(&place.to_string()), "{what}: {error}");
    };
    let page_at = |bytes: &mut Vec<u8>, k: usize, at: u64, length: u32| {
        put(bytes, entry(k) + 16, &at.to_le_bytes());
        put(bytes, entry(k) + 24, &length.to_le_bytes());
        put(bytes, entry(k) + 28, &(-1i32).to_le_bytes());
    };
    let length = 32 * nodes as u32;
    said(
        "page that is known",
        entry(2),
        crafted.refused(|bytes| page_at(bytes, 2, list as u64, length), None),
    );
    // A page within the page that points at it has nodes that are known.
    said(
        "has the chunk of another",
        entry(0),
        crafted.refused(|bytes| page_at(bytes, nodes - 1, entry(1) as u64, 32), None)
            + &entry(0).to_string(),
    );
    said(
        "which the file of",
        1 << 40,
        crafted.refused(|bytes| page_at(bytes, 2, 1 << 40, 32), None),
    );
    said(
        "has the chunk of another",
        entry(3),
        crafted
            .refused(|bytes| bytes.copy_within(entry(1) + 16..entry(1) + 32, entry(3) + 16), None),
    );
    said(
        "comes twice",
        entry(3),
        crafted.refused(|bytes| bytes.copy_within(entry(1)..entry(1) + 16, entry(3)), None),
    );
    said(
        "claims 2147483647 points",
        entry(1),
        crafted.refused(|bytes| put(bytes, entry(1) + 28, &i32::MAX.to_le_bytes()), None),
    );
    said(
        "where no chunk does",
        entry(1),
        crafted.refused(|bytes| put(bytes, entry(1) + 16, &7u64.to_le_bytes()), None),
    );
    for key in [[31, 0, 0, 0], [-1, 0, 0, 0], [1, 2, 0, 0], [1, 0, -1, 0], [i32::MAX; 4]] {
        let key: Vec<u8> = key.iter().flat_map(|v: &i32| v.to_le_bytes()).collect();
        said(
            "outside of the root",
            entry(1),
            crafted.refused(|bytes| put(bytes, entry(1), &key), None),
        );
    }
    said(
        "none has that at byte",
        nodes - 1,
        crafted.refused(
            |bytes| put(bytes, INFO_AT + 48, &(32 * (nodes as u64 - 1)).to_le_bytes()),
            None,
        ),
    );
    for length in [33, u64::MAX, 32 << 40] {
        said(
            "a page of",
            list,
            crafted.refused(|bytes| put(bytes, INFO_AT + 48, &length.to_le_bytes()), None),
        );
    }
    // A file as long as it claims, of zeros that take no place.
    said(
        "entries",
        list,
        crafted.refused(
            |bytes| put(bytes, INFO_AT + 48, &(32u64 << 37).to_le_bytes()),
            Some(33 << 37),
        ),
    );
    for (at, value) in [(0, f64::NAN), (24, -1.0), (24, f64::INFINITY), (32, 0.0), (32, f64::NAN)] {
        said(
            "impossible cube",
            INFO_AT,
            crafted.refused(|bytes| put(bytes, INFO_AT + at, &value.to_le_bytes()), None),
        );
    }
    let far = crafted.refused(|bytes| put(bytes, INFO_AT, &1e6f64.to_le_bytes()), None);
    assert!(far.contains("outside of the bounds"), "{far}");
    let huge = crafted.refused(|bytes| put(bytes, INFO_AT + 24, &1e300f64.to_le_bytes()), None);
    assert!(huge.contains("node"), "{huge}");
    assert!(peak() < 256 << 20, "{} MiB", peak() >> 20);
}

/// Pages that each point at the next, in circles or not, end.
#[test]
fn a_long_chain_of_pages_is_refused() {
    let crafted = Crafted::new();
    let chain = |bytes: &mut Vec<u8>| {
        let start = bytes.len() as u64;
        bytes[INFO_AT + 40..INFO_AT + 48].copy_from_slice(&start.to_le_bytes());
        bytes[INFO_AT + 48..INFO_AT + 56].copy_from_slice(&32u64.to_le_bytes());
        for k in 1..100_000u64 {
            bytes.extend([0; 16]);
            bytes.extend((start + 32 * k).to_le_bytes());
            bytes.extend(32u32.to_le_bytes());
            bytes.extend((-1i32).to_le_bytes());
        }
    };
    let error = crafted.refused(chain, None);
    assert!(error.contains("entries (page at byte"), "{error}");
}

/// A table of 2^32 chunks in a file that is long enough for them, but has nothing there: chunks are
/// found by their own sizes.
#[test]
fn a_table_of_more_chunks_than_there_can_be_is_not_believed() {
    let crafted = Crafted::new();
    let points_at = u32::from_le_bytes(crafted.bytes[96..100].try_into().unwrap()) as usize;
    let length = crafted.bytes.len() as u64;
    let path = crafted.place.folder.path().join("crafted.copc.laz");
    let told = |at: u64, count: u32, length: u64| {
        let mut bytes = crafted.bytes.clone();
        bytes[points_at..points_at + 8].copy_from_slice(&at.to_le_bytes());
        std::fs::write(&path, bytes).unwrap();
        let file = std::fs::File::options().write(true).open(&path).unwrap();
        file.set_len(length).unwrap();
        let head = [[0; 4], count.to_le_bytes()].concat();
        std::os::unix::fs::FileExt::write_all_at(&file, &head, at).unwrap();
        let began = Instant::now();
        let options = ReadOptions::new(WANTED, false);
        let cloud = cloud::read(std::slice::from_ref(&path), &options, &Silent).unwrap();
        assert!(began.elapsed() < Duration::from_secs(2), "{:?}", began.elapsed());
        assert_eq!(cloud.len(), 200_000);
        cloud.notes.join("; ")
    };
    let many = told(1 << 39, u32::MAX, 1 << 40);
    assert!(many.contains("lists 4294967295 chunks; at most"), "{many}");
    let few = told(length, u32::MAX, length + 100);
    assert!(few.contains("bytes can hold"), "{few}");
    // As many as are read, of which the file has none.
    let zeros = told(1 << 39, 1 << 21, 1 << 40);
    assert!(zeros.contains("LAZ chunk table"), "{zeros}");
    assert!(peak() < 256 << 20, "{} MiB", peak() >> 20);
}

/// Points in a node that is not theirs are found when they are read.
#[test]
fn points_outside_of_their_node_are_refused_when_they_are_read() {
    let crafted = Crafted::new();
    let mut bytes = crafted.bytes.clone();
    let [first, last] = [1, crafted.nodes - 1].map(|k| crafted.list + 32 * k);
    let key = bytes[first..first + 16].to_vec();
    bytes.copy_within(last..last + 16, first);
    bytes[last..last + 16].copy_from_slice(&key);
    let path = crafted.place.folder.path().join("swapped.copc.laz");
    std::fs::write(&path, bytes).unwrap();
    let index = Index::open_octree(&path, None, false).unwrap();
    let errors: Vec<String> = (0..index.nodes().len())
        .filter_map(|node| index.columns(node, WANTED).err())
        .map(|error| error.to_string())
        .collect();
    assert!(
        errors.len() == 2 && errors.iter().all(|error| error.contains("outside of its node")),
        "{errors:?}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn damaged_bytes_are_refused_or_harmless(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4)) {
        let crafted = Crafted::new();
        let mut bytes = crafted.bytes.clone();
        // In the information record or the list of nodes.
        let places: Vec<usize> = (INFO_AT..INFO_AT + 160).chain(crafted.list..bytes.len()).collect();
        for (place, byte) in changes {
            bytes[*place.get(&places)] = byte;
        }
        let path = crafted.place.folder.path().join("damaged.copc.laz");
        std::fs::write(&path, bytes).unwrap();
        if let Ok(index) = Index::open_octree(&path, None, false) {
            for node in 0..index.nodes().len() {
                let _ = index.columns(node, WANTED);
            }
        }
    }
}
