//! Potree 2 and EPT: their points are those of their own LAZ, and every point is in one node, as
//! `cloud::read` has it; what lies is refused in time, in little memory, with its place.

use crate::copc::{check_points, peak, slope};
use crate::octree_files::{KINDS, Kind, WIDTH, lattice, records, stored_brotli, write, write_laz};
use pointillist::cloud::point_lookup::{LookupQuery, Record, find};
use pointillist::cloud::rgb_range::RgbRange;
use pointillist::cloud::scalar::{Scalar, Scalars};
use pointillist::cloud::{self, Cloud, ColumnSet, ReadOptions};
use pointillist::index::format::Index;
use pointillist::progress::Silent;
use proptest::prelude::*;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

fn made(points: usize) -> Vec<[u8; WIDTH]> {
    let (at, rgb) = slope(points);
    records(&at, &rgb)
}

fn read(path: &Path) -> Cloud {
    let scalars = Scalars::from_iter([Scalar::ScanAngle]);
    let options = ReadOptions::new(ColumnSet { scalars, ..ColumnSet::ALL }, true);
    cloud::read(&[path.to_owned()], &options, &Silent).unwrap()
}

/// All that is known of a point; times tell points apart.
type Point = (u64, [i32; 3], [u8; 3], [u16; 2], [u8; 2], u64);

fn points(cloud: &Cloud) -> Vec<Point> {
    let columns = &cloud.parts[0].columns;
    let angles = columns.scalar(Scalar::ScanAngle).unwrap();
    let point = |i: usize| {
        (
            columns.gps_time.as_ref().unwrap()[i].to_bits(),
            [columns.x[i], columns.y[i], columns.z[i]],
            columns.rgb.as_ref().unwrap()[i],
            [columns.intensity.as_ref().unwrap()[i], columns.source.as_ref().unwrap()[i]],
            [columns.class.as_ref().unwrap()[i], columns.returns.as_ref().unwrap()[i]],
            angles[i].to_bits(),
        )
    };
    let mut points: Vec<Point> = (0..columns.len()).map(point).collect();
    points.sort_unstable();
    points
}

#[test]
fn points_and_records_are_those_of_their_own_laz() {
    let folder = tempfile::tempdir().unwrap();
    let (records, laz) = (made(40_000), folder.path().join("a.laz"));
    write_laz(&laz, &records);
    let whole = read(&laz);
    let sought = |i: usize| {
        let steps =
            [0, 4, 8].map(|at| i32::from_le_bytes(records[i][at..at + 4].try_into().unwrap()));
        let query = LookupQuery {
            position: lattice().world(steps.map(i64::from)),
            ..LookupQuery::default()
        };
        move |path: &Path| {
            let options = ReadOptions::new(ColumnSet::ALL, false);
            let found = find(&[path.to_owned()], options, &query, &Silent).unwrap().unwrap();
            Record { file: String::new(), point: 0, ..found }
        }
    };
    for kind in KINDS {
        let path = folder.path().join(format!("{kind:?}"));
        write(kind, &path, &records);
        let cloud = read(&path);
        assert_eq!(cloud.notes, Vec::<String>::new(), "{kind:?}");
        assert!(points(&cloud) == points(&whole), "{kind:?}");
        let part = &cloud.parts[0];
        assert_eq!((part.lattice, part.title()), (lattice(), format!("{kind:?}")));
        assert_eq!(part.header.system.as_ref().and_then(|system| system.epsg), Some(32632));
        for i in [0, 7, 39_999] {
            assert_eq!(sought(i)(&path), sought(i)(&laz), "{kind:?}");
        }
        // Either the folder or its description.
        let name = if path.join("ept.json").exists() { "ept.json" } else { "metadata.json" };
        assert_eq!(read(&path.join(name)).len(), 40_000);
        let index = check_points(&path);
        assert!(index.nodes().len() > 8 && index.directory.roots == 1, "{kind:?}");
        assert!(index.nodes().iter().any(|node| node.level > 2), "{kind:?}");
    }
}

/// The files of other nodes may be gone.
#[test]
fn a_point_is_looked_up_in_the_nodes_around_it() {
    let folder = tempfile::tempdir().unwrap();
    let records = made(40_000);
    let at = |i: usize| {
        [0, 4, 8].map(|at| i32::from_le_bytes(records[i][at..at + 4].try_into().unwrap()))
    };
    write(Kind::EptLaszip, folder.path(), &records);
    // Colours that are said are not looked at.
    let rgb_range = Some(RgbRange::Words);
    let options = ReadOptions { rgb_range, ..ReadOptions::new(ColumnSet::ALL, false) };
    let paths = [folder.path().to_owned()];
    let corner = (0..40_000).filter(|i| i % 8 > 0).min_by_key(|&i| at(i)[0] + at(i)[1]).unwrap();
    let query = LookupQuery {
        position: lattice().world(at(corner).map(i64::from)),
        ..LookupQuery::default()
    };
    let whole = find(&paths, options, &query, &Silent).unwrap().unwrap();
    assert_eq!(whole.gps_time, Some(corner as f64 / 8.0));
    for entry in std::fs::read_dir(folder.path().join("ept-data")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let numbers: Vec<u32> = name.split('-').map(|number| number.parse().unwrap()).collect();
        if numbers[1..3].iter().any(|&number| number > 0) {
            // As long as before, and not LAZ.
            let length = path.metadata().unwrap().len();
            std::fs::write(&path, vec![0; length as usize]).unwrap();
        }
    }
    assert_eq!(find(&paths, options, &query, &Silent).unwrap(), Some(whole));
}

/// Files that PotreeConverter 2.1.1 made of 600 points. It rounds positions down to its own
/// lattice, and stores those that it packs one step higher.
#[test]
fn files_of_potree_converter_have_the_points_it_was_given() {
    let folder = tempfile::tempdir().unwrap();
    let point = |i: i32| {
        let [x, y] = [i * 7919 % 100_003, (i as i64 * 104_729 % 100_003) as i32];
        ([x, y, (7 * x + 3 * y) % 50_021], [(x >> 9) as u8, (y >> 9) as u8, 90])
    };
    let (at, rgb): (Vec<_>, Vec<_>) = (0..600).map(point).unzip();
    let laz = folder.path().join("a.laz");
    write_laz(&laz, &records(&at, &rgb));
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cpu/potree_converter");
    let (given, found) = (points(&read(&laz)), points(&read(&path)));
    assert_eq!(given.len(), found.len());
    for (given, found) in given.iter().zip(&found) {
        let higher = [0, 1, 2].map(|axis| found.1[axis] - given.1[axis]);
        assert!(higher.iter().all(|steps| (0..=1).contains(steps)), "{given:?} {found:?}");
        let (time, _, rgb, words, bytes, angle) = *found;
        assert_eq!((time, given.1, rgb, words, bytes, angle), *given);
    }
    check_points(&path);
}

/// A folder that is changed and opened.
struct Crafted {
    folder: tempfile::TempDir,
}

impl Crafted {
    fn new(kind: Kind) -> Crafted {
        let crafted = Crafted { folder: tempfile::tempdir().unwrap() };
        write(kind, &crafted.folder.path().join("whole"), &made(30_000));
        crafted.restore();
        crafted
    }

    /// Copies the files as they were written.
    fn restore(&self) {
        drop(std::fs::remove_dir_all(self.at("")));
        let mut folders = vec![PathBuf::new()];
        while let Some(folder) = folders.pop() {
            std::fs::create_dir(self.at("").join(&folder)).unwrap();
            for entry in std::fs::read_dir(self.folder.path().join("whole").join(&folder)).unwrap()
            {
                let entry = entry.unwrap();
                let own = folder.join(entry.file_name());
                match entry.path().is_dir() {
                    true => folders.push(own),
                    false => drop(std::fs::copy(entry.path(), self.at("").join(own)).unwrap()),
                }
            }
        }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join("crafted").join(name)
    }

    /// Returns the error that a change of the files leads to.
    #[track_caller]
    fn refused(&self, change: impl FnOnce(&Crafted)) -> String {
        self.restore();
        change(self);
        let began = Instant::now();
        let error = Index::open_octree(&self.at(""), None, false).err().expect("a crafted octree");
        assert!(began.elapsed() < Duration::from_secs(2), "{:?}: {error}", began.elapsed());
        let error = error.to_string();
        assert!(error.contains("crafted"), "{error}");
        error
    }

    #[track_caller]
    fn says(&self, what: &str, change: impl FnOnce(&Crafted)) {
        let error = self.refused(change);
        assert!(error.contains(what), "{what}: {error}");
    }

    fn change(&self, name: &str, change: impl FnOnce(&mut Vec<u8>)) {
        let mut bytes = std::fs::read(self.at(name)).unwrap();
        change(&mut bytes);
        std::fs::write(self.at(name), bytes).unwrap();
    }

    fn json(&self, name: &str, change: impl FnOnce(&mut Value)) {
        self.change(name, |bytes| {
            let mut value = serde_json::from_slice(bytes).unwrap();
            change(&mut value);
            *bytes = value.to_string().into();
        });
    }
}

type Change = Box<dyn FnOnce(&mut Vec<u8>)>;

/// Writes a number into the list of Potree.
fn put(at: usize, value: &[u8]) -> impl FnOnce(&mut Vec<u8>) {
    move |bytes| bytes[at..at + value.len()].copy_from_slice(value)
}

#[test]
fn lists_of_potree_that_lie_are_refused_with_what_is_wrong_and_where() {
    const ENTRY: usize = 22;
    let crafted = Crafted::new(Kind::PotreePlain);
    let list = std::fs::read(crafted.at("hierarchy.bin")).unwrap();
    let kinds: Vec<u8> = list.chunks(ENTRY).map(|entry| entry[0]).collect();
    let first = kinds.iter().position(|kind| *kind == 2).expect("a chunk of the list");
    let metadata: Value =
        serde_json::from_slice(&std::fs::read(crafted.at("metadata.json")).unwrap()).unwrap();
    let root = metadata["hierarchy"]["firstChunkSize"].as_u64().unwrap();
    let (below, proxy, leaf) =
        (root as usize, ENTRY * first, ENTRY * kinds.iter().position(|kind| *kind == 1).unwrap());
    let list = |change: Change| move |crafted: &Crafted| crafted.change("hierarchy.bin", change);
    let pointing = |at: u64, bytes: u64| {
        let place = [at.to_le_bytes(), bytes.to_le_bytes()].concat();
        list(Box::new(move |file: &mut Vec<u8>| put(proxy + 6, &place)(file)))
    };
    let places = |at: usize, place: u64| {
        list(Box::new(move |file: &mut Vec<u8>| put(at + 6, &place.to_le_bytes())(file)))
    };
    // Chunks that point at themselves, at those above, or into the middle of others.
    crafted.says("overlaps another", pointing(0, root));
    crafted.says("overlaps another", pointing(ENTRY as u64, root - ENTRY as u64));
    crafted.says("for itself", list(Box::new(move |file| file[below] = 2)));
    crafted.says("which the file of", pointing(1 << 40, ENTRY as u64));
    crafted.says("which the file of", pointing(u64::MAX - 5, ENTRY as u64));
    crafted.says("which the file of", pointing(0, 0));
    crafted.says("which the file of", pointing(0, 23));
    crafted.says("which the file of", pointing(0, ENTRY as u64 * (1 << 50)));
    crafted.says("unknown type 7", list(Box::new(move |file| file[leaf] = 7)));
    crafted.says("without entries", list(Box::new(move |file| file[leaf + 1] = 0xFF)));
    crafted.says("entries for", list(Box::new(|file| file[1] = 0)));
    let many = u32::MAX.to_le_bytes();
    crafted
        .says("claims 4294967295 points", list(Box::new(move |file| put(leaf + 2, &many)(file))));
    crafted.says("points of 37 bytes each", list(Box::new(move |file| file[leaf + 2] ^= 1)));
    crafted.says("but octree.bin has", places(leaf, 1 << 40));
    crafted.says("but octree.bin has", places(leaf, u64::MAX - 5));
    crafted.says("in the same bytes", places(leaf, 0));
    // A line of nodes, each below the one before.
    crafted.says("deeper than 30 levels", |crafted| {
        let line = [[0, 1].as_slice(), &[0; 20]].concat().repeat(40);
        std::fs::write(crafted.at("hierarchy.bin"), &line).unwrap();
        crafted.json("metadata.json", |own| own["hierarchy"]["firstChunkSize"] = line.len().into());
    });
    // A list as long as it claims, of zeros that take no place.
    let long = (1u64 << 40) / ENTRY as u64 * ENTRY as u64;
    for first in [long, 1 << 60, 0, 21] {
        let said = crafted.refused(|crafted| {
            let file = std::fs::File::options().write(true).open(crafted.at("hierarchy.bin"));
            file.unwrap().set_len(long).unwrap();
            crafted.json("metadata.json", |own| own["hierarchy"]["firstChunkSize"] = first.into());
        });
        let is_said = ["entries", "which the file of"].iter().any(|word| said.contains(word));
        assert!(is_said, "{first}: {said}");
    }
    assert!(peak() < 256 << 20, "{} MiB", peak() >> 20);
}

#[test]
fn descriptions_and_points_of_potree_that_lie_are_refused() {
    let crafted = Crafted::new(Kind::PotreeBrotli);
    let says = |what: &str, change: fn(&mut Value)| {
        crafted.says(what, |crafted| crafted.json("metadata.json", change));
    };
    says("is Potree 1.8", |own| own["version"] = "1.8".into());
    says("encoding ZSTD", |own| own["encoding"] = "ZSTD".into());
    says("three finite scales", |own| own["scale"][1] = 0.into());
    says("impossible box", |own| own["scale"][1] = (-0.001).into());
    says("2^53 steps", |own| own["offset"][0] = 1e300.into());
    says("impossible box", |own| own["spacing"] = 0.into());
    says("impossible box", |own| own["boundingBox"]["max"][2] = (-1e9).into());
    says("in 13 bytes", |own| own["attributes"][0]["size"] = 13.into());
    says("numbers of type", |own| own["attributes"][1]["numElements"] = u64::MAX.into());
    says("numbers of type", |own| own["attributes"][1]["type"] = "undefined".into());
    says("no positions", |own| own["attributes"][0]["name"] = "place".into());
    says("32-bit integers", |own| own["attributes"][0]["type"] = "float".into());
    says("does not describe", |own| own["hierarchy"] = 1.into());
    says("outside of the bounds", |own| {
        own["boundingBox"]["min"][0] = 1e6.into();
        own["boundingBox"]["max"][0] = 1.1e6.into();
    });
    // Other attributes than the points have.
    says("cannot be unpacked", |own| drop(own["attributes"].as_array_mut().unwrap().pop()));
    crafted.says("is larger than 16 MiB", |crafted| {
        crafted.change("metadata.json", |bytes| bytes.resize(20 << 20, b' '));
    });
    let stream = |bytes: Vec<u8>| move |file: &mut Vec<u8>| put(0, &bytes)(file);
    crafted.says("cannot be unpacked", |crafted| {
        crafted.change("octree.bin", stream(vec![0xFF; 64]));
    });
    crafted.says("cannot be unpacked", |crafted| {
        crafted.change("octree.bin", stream(stored_brotli(&[0; 64])));
    });
    crafted.says("at most", |crafted| {
        crafted.change("hierarchy.bin", |list| put(2, &u32::MAX.to_le_bytes())(list));
    });
    crafted.says("octree.bin", |crafted| std::fs::remove_file(crafted.at("octree.bin")).unwrap());
    assert!(peak() < 256 << 20, "{} MiB", peak() >> 20);
}

#[test]
fn a_wrong_number_of_points_is_said_or_refused() {
    for (kind, name) in [(Kind::PotreeBrotli, "metadata.json"), (Kind::EptBinary, "ept.json")] {
        let crafted = Crafted::new(kind);
        crafted.json(name, |own| own["points"] = 31_000.into());
        let paths = [crafted.at("")];
        let read = |strict| cloud::read(&paths, &ReadOptions::new(ColumnSet::ALL, strict), &Silent);
        let what = "declares 31000 points, but its nodes have 30000";
        let (said, refused) = (read(false).unwrap(), read(true).unwrap_err().to_string());
        assert_eq!(said.len(), 30_000);
        assert!(said.notes.iter().any(|note| note.contains(what)), "{:?}", said.notes);
        let in_place = Index::open_octree(&paths[0], None, true).err().unwrap().to_string();
        assert!(refused.contains(what) && in_place.contains(what), "{refused}; {in_place}");
        let index = Index::open_octree(&paths[0], None, false).unwrap();
        assert!(index.directory.contents.notes.iter().any(|note| note.contains(what)));
    }
}

#[test]
fn lists_of_ept_that_lie_are_refused_with_what_is_wrong_and_where() {
    const ROOT: &str = "ept-hierarchy/0-0-0-0.json";
    for kind in [Kind::EptLaszip, Kind::EptBinary] {
        let crafted = Crafted::new(kind);
        let lists = |what: &str, name: &str, points: i64| {
            crafted.says(what, |crafted| {
                crafted.json(ROOT, |list| list[name] = points.into());
            });
        };
        lists("whose list is this one", "0-0-0-0", -1);
        lists("of -2 points", "0-0-0-0", -2);
        lists("list claims 1099511627776 points", "0-0-0-0", 1 << 40);
        lists("list claims", "0-0-0-0", i64::MAX);
        for name in
            ["31-0-0-0", "1-2-0-0", "1--1-0-0", "01-0-0-0", "1-0-0", "1-0-0-0-0", "", "../x"]
        {
            lists("no place in an octree", name, 1);
        }
        lists("5-0-0-31", "5-0-0-31", 5);
        crafted.says("2-9", |crafted| {
            crafted.change(ROOT, |list| *list = b"{\"2-9-9-9\": -1}".to_vec());
        });
        crafted.says("comes twice", |crafted| {
            crafted.change(ROOT, |list| *list = b"{\"0-0-0-0\": 1, \"0-0-0-0\": 1}".to_vec());
        });
        crafted.says("list is known", |crafted| {
            crafted.change(ROOT, |list| *list = b"{\"2-0-0-0\": -1, \"2-0-0-0\": -1}".to_vec());
        });
        // A list below another that leads back to it.
        crafted.says("outside of 2-0-0-0", |crafted| {
            crafted.json(ROOT, |list| list["2-0-0-0"] = (-1).into());
            let path = crafted.at("ept-hierarchy/2-0-0-0.json");
            std::fs::write(path, "{\"2-0-0-0\": 1, \"0-0-0-0\": -1}").unwrap();
        });
        crafted.says("no list of nodes", |crafted| {
            crafted.change(ROOT, |list| *list = b"[1, 2]".to_vec());
        });
        crafted.says("larger than 16 MiB", |crafted| {
            crafted.change(ROOT, |list| list.resize(20 << 20, b' '));
        });
        // As many nodes as a list can name, none of which is there.
        crafted.says("ept-data", |crafted| {
            let names: Vec<String> = (0..1 << 19).map(|k| format!("\"20-{k}-0-{k}\":1")).collect();
            std::fs::write(crafted.at(ROOT), format!("{{{}}}", names.join(","))).unwrap();
        });
        let says = |what: &str, change: fn(&mut Value)| {
            crafted.says(what, |crafted| crafted.json("ept.json", change));
        };
        says("zstandard; laszip and binary", |own| own["dataType"] = "zstandard".into());
        says("impossible box", |own| own["span"] = 0.into());
        says("impossible box", |own| own["bounds"][3] = (-1e9).into());
        says("does not describe", |own| own["schema"] = 1.into());
        says("outside of the bounds", |own| {
            own["bounds"] = [9e5, 9e5, 9e5, 9.1e5, 9.1e5, 9.1e5].into()
        });
        if kind == Kind::EptBinary {
            says("of type float in 3 bytes", |own| own["schema"][12]["size"] = 3.into());
            says("without a scale", |own| own["schema"][1]["scale"] = Value::Null);
            says("list claims", |own| drop(own["schema"].as_array_mut().unwrap().pop()));
            crafted.says("Classification", |crafted| {
                // A class that does not fit, in whole degrees of older formats.
                crafted.json("ept.json", |own| {
                    own["schema"][8]["type"] = "signed".into();
                });
                crafted.change("ept-data/0-0-0-0.bin", |rows| rows[18] = 0xFF);
            });
        } else {
            crafted.says("but its list says", |crafted| {
                crafted.json(ROOT, |list| {
                    let points = list["0-0-0-0"].as_i64().unwrap();
                    list["0-0-0-0"] = (points + 1).into();
                });
            });
        }
    }
    assert!(peak() < 256 << 20, "{} MiB", peak() >> 20);
}

/// Checks what damaged chunks of a LAZ file are held to as well.
#[test]
fn damaged_nodes_are_left_out_and_said() {
    let cut: fn(&mut Vec<u8>) = |bytes| bytes.truncate(bytes.len() / 2);
    let flip: fn(&mut Vec<u8>) = |bytes| {
        let middle = bytes.len() / 2;
        bytes[middle..].iter_mut().for_each(|byte| *byte = !*byte);
    };
    for (kind, folder, damage, what) in [
        (Kind::EptLaszip, "ept-data", cut, "1 of"),
        (Kind::PotreeBrotli, "", flip, "cannot be unpacked"),
    ] {
        let crafted = Crafted::new(kind);
        let whole = read(&crafted.at(""));
        // The largest file: of EPT that of one node, of Potree that of all.
        let files = std::fs::read_dir(crafted.at(folder)).unwrap().map(|file| file.unwrap());
        let largest = files.max_by_key(|file| file.metadata().unwrap().len()).unwrap();
        let name = Path::new(folder).join(largest.file_name());
        crafted.change(name.to_str().unwrap(), damage);
        let read = |strict: bool| {
            let options = ReadOptions::new(ColumnSet::ALL, strict);
            cloud::read(&[crafted.at("")], &options, &Silent)
        };
        let left = read(false).unwrap();
        assert!((1..whole.len()).contains(&left.len()), "{kind:?}: {} points", left.len());
        let [note] = &left.notes[..] else { panic!("{kind:?}: {:?}", left.notes) };
        assert!(note.contains(what) && note.contains("nodes could not be read"), "{note}");
        let error = read(true).expect_err("a damaged node").to_string();
        assert!(error.contains("could be read"), "{error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn damaged_bytes_are_refused_or_harmless(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
        kind in prop::sample::select(KINDS.to_vec()),
    ) {
        let folder = tempfile::tempdir().unwrap();
        write(kind, folder.path(), &made(6_000));
        let names = match kind {
            Kind::PotreePlain | Kind::PotreeBrotli => ["metadata.json", "hierarchy.bin", "octree.bin"],
            Kind::EptLaszip => ["ept.json", "ept-hierarchy/0-0-0-0.json", "ept-data/0-0-0-0.laz"],
            Kind::EptBinary => ["ept.json", "ept-hierarchy/0-0-0-0.json", "ept-data/0-0-0-0.bin"],
        };
        for (place, byte) in changes {
            let path = folder.path().join(place.get(&names));
            let mut bytes = std::fs::read(&path).unwrap();
            *place.get_mut(&mut bytes) = byte;
            std::fs::write(path, bytes).unwrap();
        }
        if let Ok(index) = Index::open_octree(folder.path(), None, false) {
            for node in 0..index.nodes().len() {
                drop(index.columns(node, ColumnSet::ALL));
            }
        }
        drop(cloud::read(
            &[folder.path().to_owned()],
            &ReadOptions::new(ColumnSet::ALL, false),
            &Silent,
        ));
    }
}
