//! Clouds as octrees of other programs, written by their public descriptions: Potree 2 and EPT,
//! with known points. Nodes are the same in all.

use glam::DVec3;
use pointillist::cloud::Lattice;
use pointillist::cloud::las::write::{Head, LasWriter};
use serde_json::{Value, json};
use std::collections::{BTreeMap, VecDeque};
use std::path::Path;

/// Level of a node, and its number along each axis.
pub type Key = [i32; 4];

/// Lattice steps of the root's sides.
const SIDE: i32 = 1 << 17;

/// Most points of a node that is not divided.
const WHOLE: usize = 3000;

/// Levels in a chunk of Potree's list.
const LEVELS: usize = 2;

/// Bytes of a record.
pub const WIDTH: usize = 36;

/// A coordinate system for all.
pub const SYSTEM: &str = "EPSG:32632";

/// How nodes are stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    PotreePlain,
    PotreeBrotli,
    EptLaszip,
    EptBinary,
}

pub const KINDS: [Kind; 4] =
    [Kind::PotreePlain, Kind::PotreeBrotli, Kind::EptLaszip, Kind::EptBinary];

pub fn lattice() -> Lattice {
    Lattice { step: DVec3::splat(0.001), offset: DVec3::new(500_000.0, 5_000_000.0, 0.0) }
}

/// Returns points as records of format 7, with a value for each field; times are their numbers.
pub fn records(at: &[[i32; 3]], rgb: &[[u8; 3]]) -> Vec<[u8; WIDTH]> {
    let record = |(i, (at, rgb)): (usize, (&[i32; 3], &[u8; 3]))| {
        let mut record = Vec::with_capacity(WIDTH);
        at.iter().for_each(|v| record.extend(v.to_le_bytes()));
        record.extend((i as u16).to_le_bytes());
        record.extend([0x21 - (i % 2) as u8 * 0x10, 0x40 * (i % 3) as u8, (i % 70) as u8, 9]);
        record.extend((i as i16 % 50 * 500).to_le_bytes());
        record.extend((i as u16 % 5).to_le_bytes());
        record.extend((i as f64 / 8.0).to_le_bytes());
        rgb.iter().for_each(|&v| record.extend((v as u16 * 257).to_le_bytes()));
        record.try_into().unwrap()
    };
    at.iter().zip(rgb).enumerate().map(record).collect()
}

fn head(compressed: bool) -> Head {
    Head {
        minor: 4,
        format: 7,
        extra_bytes: 0,
        compressed,
        lattice: lattice(),
        file_source: 0,
        global_encoding: 0,
        system: String::new(),
        records: Vec::new(),
    }
}

pub fn write_laz(path: &Path, records: &[[u8; WIDTH]]) {
    let mut file = LasWriter::create(path, head(true)).unwrap();
    file.write(records.as_flattened()).unwrap();
    file.finish().unwrap();
}

/// Writes a folder.
pub fn write(kind: Kind, folder: &Path, records: &[[u8; WIDTH]]) {
    std::fs::create_dir_all(folder).unwrap();
    let mut nodes = BTreeMap::new();
    divide([0; 4], (0..records.len()).collect(), records, &mut nodes);
    match kind {
        Kind::PotreePlain => write_potree(folder, records, &nodes, false),
        Kind::PotreeBrotli => write_potree(folder, records, &nodes, true),
        Kind::EptLaszip => write_ept(folder, records, &nodes, true),
        Kind::EptBinary => write_ept(folder, records, &nodes, false),
    }
}

fn number<const N: usize>(record: &[u8; WIDTH], at: usize) -> [u8; N] {
    record[at..at + N].try_into().unwrap()
}

fn steps(record: &[u8; WIDTH]) -> [i32; 3] {
    [0, 4, 8].map(|at| i32::from_le_bytes(number(record, at)))
}

/// Divides points: a node has every eighth, and its children the others.
fn divide(
    key: Key,
    points: Vec<usize>,
    records: &[[u8; WIDTH]],
    nodes: &mut BTreeMap<Key, Vec<usize>>,
) {
    if points.len() <= WHOLE {
        nodes.insert(key, points);
        return;
    }
    let (own, rest): (Vec<usize>, Vec<usize>) = points.into_iter().partition(|i| i % 8 == 0);
    nodes.insert(key, own);
    let mut children: BTreeMap<Key, Vec<usize>> = BTreeMap::new();
    let side = SIDE >> (key[0] + 1);
    for i in rest {
        let [x, y, z] = steps(&records[i]).map(|v| v / side);
        children.entry([key[0] + 1, x, y, z]).or_default().push(i);
    }
    children.into_iter().for_each(|(key, points)| divide(key, points, records, nodes));
}

/// Returns the children of a node in Potree's order, with their numbers.
fn children(key: Key, nodes: &BTreeMap<Key, Vec<usize>>) -> Vec<(u8, Key)> {
    let [level, x, y, z] = key;
    let child = |k: u8| {
        let [i, j, l] = [k >> 2, k >> 1 & 1, k & 1].map(i32::from);
        (k, [level + 1, 2 * x + i, 2 * y + j, 2 * z + l])
    };
    (0..8).map(child).filter(|(_, key)| nodes.contains_key(key)).collect()
}

/// Returns lowest and highest corner of all points `[lattice steps]`.
fn bounds(records: &[[u8; WIDTH]]) -> [[f64; 3]; 2] {
    let pick = |pick: fn(i32, i32) -> i32| {
        let all = records.iter().map(steps);
        let corner = all.reduce(|a, b| [0, 1, 2].map(|k| pick(a[k], b[k]))).unwrap();
        lattice().world(corner.map(i64::from)).to_array()
    };
    [pick(i32::min), pick(i32::max)]
}

/// An attribute: its name, its type, its numbers a point, and its value.
type Attribute = (&'static str, &'static str, usize, fn(&[u8; WIDTH]) -> Vec<u8>);

const POTREE: [Attribute; 11] = [
    ("position", "int32", 3, |r| r[..12].to_vec()),
    ("intensity", "uint16", 1, |r| r[12..14].to_vec()),
    ("return number", "uint8", 1, |r| vec![r[14] & 15]),
    ("number of returns", "uint8", 1, |r| vec![r[14] >> 4]),
    ("classification flags", "uint8", 1, |r| vec![r[15] & 15]),
    ("classification", "uint8", 1, |r| vec![r[16]]),
    ("user data", "uint8", 1, |r| vec![r[17]]),
    ("scan angle", "int16", 1, |r| r[18..20].to_vec()),
    ("point source id", "uint16", 1, |r| r[20..22].to_vec()),
    ("gps-time", "double", 1, |r| r[22..30].to_vec()),
    ("rgb", "uint16", 3, |r| r[30..36].to_vec()),
];

/// Entries of a chunk of the list: a node, or the number of the chunk that it stands for.
type Entries = Vec<(Key, Option<usize>)>;

fn write_potree(
    folder: &Path,
    records: &[[u8; WIDTH]],
    nodes: &BTreeMap<Key, Vec<usize>>,
    packed: bool,
) {
    let (mut points, mut places) = (Vec::new(), BTreeMap::new());
    for (key, own) in nodes {
        let at = points.len() as u64;
        if packed {
            let columns = POTREE.iter().flat_map(|(name, .., value)| {
                own.iter().flat_map(move |&i| match *name {
                    "position" => {
                        let steps = steps(&records[i]).map(|v| v as u32);
                        let halves = [16, 0].map(|shift| morton(steps.map(|v| v >> shift)));
                        halves.iter().flat_map(|v| v.to_le_bytes()).collect()
                    }
                    "rgb" => {
                        let channel = |at| u16::from_le_bytes(number(&records[i], at)).into();
                        morton([30, 32, 34].map(channel)).to_le_bytes().to_vec()
                    }
                    _ => value(&records[i]),
                })
            });
            points.extend(stored_brotli(&columns.collect::<Vec<u8>>()));
        } else {
            let row = |&i: &usize| POTREE.iter().flat_map(move |(.., value)| value(&records[i]));
            points.extend(own.iter().flat_map(row));
        }
        places.insert(*key, [at, points.len() as u64 - at]);
    }
    // The list, in chunks of some levels.
    let mut chunks: Vec<Entries> = Vec::new();
    let mut roots = VecDeque::from([[0; 4]]);
    let mut begun = 1;
    while let Some(root) = roots.pop_front() {
        let (mut entries, mut open) = (Vec::new(), VecDeque::from([root]));
        while let Some(key) = open.pop_front() {
            let below = children(key, nodes);
            if (key[0] - root[0]) as usize == LEVELS && !below.is_empty() {
                entries.push((key, Some(begun)));
                roots.push_back(key);
                begun += 1;
            } else {
                entries.push((key, None));
                open.extend(below.into_iter().map(|(_, key)| key));
            }
        }
        chunks.push(entries);
    }
    let starts: Vec<u64> = chunks
        .iter()
        .scan(0, |at, chunk| Some(std::mem::replace(at, *at + 22 * chunk.len() as u64)))
        .collect();
    let mut list = Vec::new();
    for (key, stands) in chunks.iter().flatten() {
        let below = children(*key, nodes);
        let mask = below.iter().fold(0u8, |mask, (k, _)| mask | 1 << k);
        let (kind, [at, bytes]) = match stands {
            Some(chunk) => (2, [starts[*chunk], 22 * chunks[*chunk].len() as u64]),
            None => (u8::from(below.is_empty()), places[key]),
        };
        list.extend([kind, mask]);
        list.extend((nodes[key].len() as u32).to_le_bytes());
        [at, bytes].iter().for_each(|v| list.extend(v.to_le_bytes()));
    }
    let [low, high] = bounds(records);
    let declared = |(name, kind, elements, value): &Attribute| {
        let size = value(&records[0]).len();
        let mut declared = json!({
            "name": name, "description": "", "size": size, "numElements": elements,
            "elementSize": size / elements, "type": kind,
        });
        if *name == "position" {
            (declared["min"], declared["max"]) = (json!(low), json!(high));
        }
        declared
    };
    let corner = lattice().offset.to_array();
    let side = SIDE as f64 * 0.001;
    let metadata = json!({
        "version": "2.0", "name": "made", "description": "", "points": records.len(),
        "projection": SYSTEM,
        "hierarchy": {"firstChunkSize": 22 * chunks[0].len(), "stepSize": LEVELS, "depth": 9},
        "offset": corner, "scale": vec![0.001; 3], "spacing": side / 128.0,
        "boundingBox": {"min": corner, "max": corner.map(|v| v + side)},
        "encoding": if packed { "BROTLI" } else { "DEFAULT" },
        "attributes": POTREE.iter().map(declared).collect::<Vec<Value>>(),
    });
    std::fs::write(folder.join("metadata.json"), format!("{metadata:#}")).unwrap();
    std::fs::write(folder.join("hierarchy.bin"), list).unwrap();
    std::fs::write(folder.join("octree.bin"), points).unwrap();
}

/// Returns the Morton code of the low 16 bits of three numbers.
fn morton(numbers: [u32; 3]) -> u64 {
    (0..16).fold(0, |code, bit| {
        let bits = [0, 1, 2].map(|axis| ((numbers[axis] >> bit & 1) as u64) << (3 * bit + axis));
        code | bits[0] | bits[1] | bits[2]
    })
}

/// Returns bytes as a brotli stream that stores them.
pub fn stored_brotli(bytes: &[u8]) -> Vec<u8> {
    let mut stream = Vec::new();
    for (k, block) in bytes.chunks(1 << 16).enumerate() {
        // A window of 2^16 comes first; then for each block: not the last, four digits of length.
        let (length, shift) = (block.len() as u32 - 1, u32::from(k == 0));
        let bits = (length << 3 | 1 << 19) << shift;
        stream.extend(&bits.to_le_bytes()[..3]);
        stream.extend(block);
    }
    stream.push(3);
    stream
}

const EPT: [Attribute; 16] = [
    ("X", "signed", 1, |r| r[..4].to_vec()),
    ("Y", "signed", 1, |r| r[4..8].to_vec()),
    ("Z", "signed", 1, |r| r[8..12].to_vec()),
    ("Intensity", "unsigned", 1, |r| r[12..14].to_vec()),
    ("ReturnNumber", "unsigned", 1, |r| vec![r[14] & 15]),
    ("NumberOfReturns", "unsigned", 1, |r| vec![r[14] >> 4]),
    ("ScanDirectionFlag", "unsigned", 1, |r| vec![r[15] >> 6 & 1]),
    ("EdgeOfFlightLine", "unsigned", 1, |r| vec![r[15] >> 7]),
    ("Classification", "unsigned", 1, |r| vec![r[16]]),
    ("ScanAngleRank", "float", 1, |r| {
        (i16::from_le_bytes([r[18], r[19]]) as f32 * 0.006).to_le_bytes().to_vec()
    }),
    ("UserData", "unsigned", 1, |r| vec![r[17]]),
    ("PointSourceId", "unsigned", 1, |r| r[20..22].to_vec()),
    ("GpsTime", "float", 1, |r| r[22..30].to_vec()),
    ("Red", "unsigned", 1, |r| r[30..32].to_vec()),
    ("Green", "unsigned", 1, |r| r[32..34].to_vec()),
    ("Blue", "unsigned", 1, |r| r[34..36].to_vec()),
];

fn ept_name([level, x, y, z]: Key) -> String {
    format!("{level}-{x}-{y}-{z}")
}

fn write_ept(
    folder: &Path,
    records: &[[u8; WIDTH]],
    nodes: &BTreeMap<Key, Vec<usize>>,
    packed: bool,
) {
    let [data, lists] = ["ept-data", "ept-hierarchy"].map(|name| folder.join(name));
    [&data, &lists].iter().for_each(|folder| std::fs::create_dir_all(folder).unwrap());
    for (key, own) in nodes {
        let path = |ending: &str| data.join(format!("{}.{ending}", ept_name(*key)));
        if packed {
            let own: Vec<[u8; WIDTH]> = own.iter().map(|&i| records[i]).collect();
            write_laz(&path("laz"), &own);
        } else {
            let row = |&i: &usize| EPT.iter().flat_map(move |(.., value)| value(&records[i]));
            std::fs::write(path("bin"), own.iter().flat_map(row).collect::<Vec<u8>>()).unwrap();
        }
    }
    // Nodes of level two have lists of their own, if they have children.
    let mut written: BTreeMap<Key, serde_json::Map<String, Value>> = BTreeMap::new();
    for (&key, own) in nodes {
        let above = key[0] - 2;
        let second = [2, key[1] >> above.max(0), key[2] >> above.max(0), key[3] >> above.max(0)];
        let has_own = key[0] >= 2 && !children(second, nodes).is_empty();
        let list = if has_own { second } else { [0; 4] };
        written.entry(list).or_default().insert(ept_name(key), own.len().into());
        if has_own && key == second {
            written.entry([0; 4]).or_default().insert(ept_name(key), (-1).into());
        }
    }
    for (key, list) in written {
        let path = lists.join(format!("{}.json", ept_name(key)));
        std::fs::write(path, Value::Object(list).to_string()).unwrap();
    }
    let ([low, high], offset) = (bounds(records), lattice().offset.to_array());
    let schema = EPT.iter().enumerate().map(|(k, (name, kind, _, value))| {
        let size = value(&records[0]).len();
        let mut own = json!({"name": name, "type": kind, "size": size});
        if k < 3 {
            (own["scale"], own["offset"]) = (json!(0.001), json!(offset[k]));
        }
        own
    });
    let side = SIDE as f64 * 0.001;
    let cube = [offset, offset.map(|v| v + side)].concat();
    let conforming = [low, high].concat();
    let ept = json!({
        "bounds": cube,
        "boundsConforming": conforming,
        "dataType": if packed { "laszip" } else { "binary" },
        "hierarchyType": "json", "points": records.len(),
        "schema": schema.collect::<Vec<Value>>(),
        "span": 128, "srs": {"authority": "EPSG", "horizontal": "32632"}, "version": "1.1.0",
    });
    std::fs::write(folder.join("ept.json"), format!("{ept:#}")).unwrap();
}
