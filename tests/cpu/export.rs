//! Exported points: those that a plain loop over all points leaves, and with all that the files say
//! of them.
//!
//! Real files lie in `../shared`; tests that need it are skipped if it is missing.

use crate::files::{names, scan};
use crate::made::Las;
use crate::shared::shared;
use glam::DVec3;
use pointillist::cloud::filter::{Condition, Filter};
use pointillist::cloud::las::copc::CopcWriter;
use pointillist::cloud::las::write::Head;
use pointillist::cloud::scalar::Scalars;
use pointillist::cloud::{self, Cloud, ColumnSet, Columns, Lattice, ReadOptions};
use pointillist::error::{Error, Result};
use pointillist::extract::input::Input;
use pointillist::extract::{self, Exported, Selection, Thinning, count};
use pointillist::index::build::{Options, build};
use pointillist::progress::{Progress, Silent};
use pointillist::select::clip::Clips;
use pointillist::select::opacity::Opacities;
use pointillist::synth::SceneKind;
use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};

fn options() -> ReadOptions {
    ReadOptions { records: true, ..ReadOptions::new(ColumnSet::ALL, false) }
}

fn read(path: &Path) -> Cloud {
    cloud::read(&[path.to_owned()], &options(), &Silent).unwrap()
}

fn conditions(texts: &[&str]) -> Vec<Condition> {
    texts.iter().map(|text| text.parse().unwrap()).collect()
}

fn only(texts: &[&str]) -> Selection {
    let filter = Filter { only: conditions(texts), not: Vec::new() };
    Selection { filter, ..Selection::default() }
}

fn export(
    files: &[PathBuf],
    selection: &Selection,
    thinning: &Thinning,
    output: &Path,
) -> Result<Exported> {
    let input = Input::open(files, &options(), &Silent)?;
    extract::export(&input, selection, thinning, Scalars::NONE, output, &Silent)
}

/// Exports all points of one file, and returns the notes.
fn whole(file: &Path, output: &Path) -> Vec<String> {
    export(&[file.to_owned()], &Selection::default(), &Thinning::default(), output).unwrap().notes
}

/// A row of a cloud for comparison: position, colour, intensity, class, returns, source, time.
type Row =
    ([i64; 3], Option<[u8; 3]>, Option<u16>, Option<u8>, Option<u8>, Option<u16>, Option<u64>);

/// Returns the points in order. Positions are in steps of this length.
fn rows(cloud: &Cloud, step: f64) -> Vec<Row> {
    fn at<T: Copy>(column: &Option<Vec<T>>, i: usize) -> Option<T> {
        column.as_ref().map(|column| column[i])
    }
    let of_part = |part: &cloud::Part| {
        let Columns { x, y, z, rgb, intensity, class, returns, source, gps_time, .. } =
            part.columns.clone();
        (0..x.len())
            .map(|i| {
                let place = part.lattice.world([x[i], y[i], z[i]].map(i64::from)) / step;
                (
                    place.round().as_i64vec3().to_array(),
                    at(&rgb, i),
                    at(&intensity, i),
                    at(&class, i),
                    at(&returns, i),
                    at(&source, i),
                    at(&gps_time, i).map(f64::to_bits),
                )
            })
            .collect::<Vec<_>>()
    };
    cloud.parts.iter().flat_map(of_part).collect()
}

/// Returns the positions of a cloud in order, world.
fn places(cloud: &Cloud) -> Vec<DVec3> {
    let of_part = |part: &cloud::Part| {
        let Columns { x, y, z, .. } = &part.columns;
        let place = |i: usize| part.lattice.world([x[i], y[i], z[i]].map(i64::from));
        (0..x.len()).map(place).collect::<Vec<_>>()
    };
    cloud.parts.iter().flat_map(of_part).collect()
}

/// A street of several classes, returns, sources and times.
fn street(folder: &Path, name: &str) -> PathBuf {
    let path = folder.join(name);
    scan(&path, SceneKind::Street, 60_000);
    path
}

/// The header's fields, and the bytes of the records.
struct Raw {
    lattice: Vec<u8>,
    format: u8,
    width: usize,
    vlrs: Vec<u8>,
    records: Vec<u8>,
}

impl Raw {
    fn of(las: &[u8]) -> Raw {
        let number = |at: usize, bytes: usize| {
            (0..bytes).fold(0usize, |n, i| n | (las[at + i] as usize) << (8 * i))
        };
        let (start, width, header) = (number(96, 4), number(105, 2), number(94, 2));
        let count = if las[25] >= 4 { number(247, 8) } else { number(107, 4) };
        Raw {
            lattice: las[131..179].to_vec(),
            format: las[104],
            width,
            vlrs: las[header..start].to_vec(),
            records: las[start..start + count * width].to_vec(),
        }
    }
}

#[test]
fn records_of_las_files_are_kept_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    for (format, minor, extra) in [
        (0, 2, 0),
        (1, 3, 5),
        (2, 2, 0),
        (3, 2, 2),
        (4, 3, 0),
        (5, 3, 3),
        (6, 4, 0),
        (7, 4, 4),
        (8, 4, 0),
    ] {
        let vlrs = vec![
            ("LASF_Projection", 2112, b"PROJCS[\"a\"]\0".to_vec()),
            ("a firm", 7, vec![1, 2, 3]),
        ];
        let offset = [500_000.25, 5_000_000.0, -3.0];
        let las = Las { format, minor, extra, offset, vlrs, ..Las::default() };
        let mut bytes = las.bytes();
        let before = Raw::of(&bytes);
        let start = bytes.len() - before.records.len();
        // Every bit behind the coordinates is any.
        let mut state = 7u64 + format as u64;
        for record in bytes[start..].chunks_mut(before.width) {
            for byte in &mut record[12..] {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                *byte = (state >> 56) as u8;
            }
        }
        let (input, output) = (folder.path().join("in.las"), folder.path().join("out.las"));
        std::fs::write(&input, &bytes).unwrap();
        let notes = whole(&input, &output);
        let (before, after) = (Raw::of(&bytes), Raw::of(&std::fs::read(&output).unwrap()));
        assert_eq!(after.lattice, before.lattice);
        let wave = if matches!(format, 4 | 5) { 29 } else { 0 };
        assert_eq!(after.format, [0, 1, 2, 3, 1, 3, 6, 7, 8][format as usize]);
        assert_eq!(after.width, before.width - wave);
        let kept = |record: &[u8]| {
            let bare = before.width - extra as usize;
            [&record[..bare - wave], &record[bare..]].concat()
        };
        let expected: Vec<u8> = before.records.chunks(before.width).flat_map(kept).collect();
        assert!(after.records == expected, "format {format}");
        for (user, _, contents) in &las.vlrs {
            let has = |part: &[u8]| after.vlrs.windows(part.len()).any(|window| window == part);
            assert!(has(user.as_bytes()) && has(contents), "format {format}: {user}");
        }
        assert_eq!(notes.iter().any(|note| note.contains("waveforms")), wave > 0, "{notes:?}");
        // The bytes of LAZ differ, its points do not.
        let packed = folder.path().join("out.laz");
        whole(&input, &packed);
        assert_eq!(rows(&read(&packed), 1e-3), rows(&read(&input), 1e-3), "format {format}");
        let again = folder.path().join("again.las");
        whole(&packed, &again);
        assert!(Raw::of(&std::fs::read(&again).unwrap()).records == expected, "format {format}");
    }
}

#[test]
fn what_is_left_is_what_a_plain_loop_leaves() {
    let folder = tempfile::tempdir().unwrap();
    let file = street(folder.path(), "street.laz");
    let cloud = read(&file);
    let (all, columns) = (rows(&cloud, 1e-3), &cloud.parts[0].columns);
    let (class, z) = (columns.class.clone().unwrap(), places(&cloud));
    let clips = Clips(vec!["box:499990,-inf,-inf,500003.5,inf,103".parse().unwrap()]);
    let selection = Selection {
        filter: Filter { only: conditions(&["z=..102.5"]), not: conditions(&["building"]) },
        clips: clips.clone(),
        opacities: Opacities(vec!["class:5=0".parse().unwrap(), "0.5".parse().unwrap()]),
        ..Selection::default()
    };
    let expected: Vec<Row> = (0..all.len())
        .filter(|&i| z[i].z <= 102.5 && class[i] != 6 && class[i] != 5 && clips.keep(z[i]))
        .map(|i| all[i])
        .collect();
    assert!(expected.len() > 500 && expected.len() < all.len() / 2, "{}", expected.len());
    let output = folder.path().join("some.las");
    let exported =
        export(std::slice::from_ref(&file), &selection, &Thinning::default(), &output).unwrap();
    assert_eq!((exported.points, exported.of), (expected.len() as u64, all.len() as u64));
    assert_eq!(rows(&read(&output), 1e-3), expected);
    let input = Input::open(&[file], &options(), &Silent).unwrap();
    let counted = count::count(&input, &selection, &Silent).unwrap();
    assert_eq!((counted.points, counted.of), (exported.points, exported.of));
    let points: u64 = counted.histograms.classes.iter().map(|(_, points)| points).sum();
    assert_eq!(points, counted.points);
}

#[test]
fn one_point_a_cell_is_the_first_and_every_nth_counts_from_the_first() {
    let folder = tempfile::tempdir().unwrap();
    let file = street(folder.path(), "street.las");
    let cloud = read(&file);
    let (all, places) = (rows(&cloud, 1e-3), places(&cloud));
    let mut taken = HashSet::new();
    let first: Vec<Row> = (0..all.len())
        .filter(|&i| taken.insert((places[i] / 0.7).floor().as_i64vec3()))
        .map(|i| all[i])
        .collect();
    assert!(first.len() > 1000 && first.len() < all.len() / 2, "{}", first.len());
    let output = folder.path().join("thin.laz");
    let thinned = |thinning: &Thinning| {
        export(std::slice::from_ref(&file), &Selection::default(), thinning, &output).unwrap();
        rows(&read(&output), 1e-3)
    };
    let thinning = Thinning { cell: Some(0.7), ..Thinning::default() };
    assert_eq!(thinned(&thinning), first);
    // In turns, with few cells in memory: the same points.
    let mut in_turns = thinned(&Thinning { cells: 9000, ..thinning });
    let mut sorted = first.clone();
    in_turns.sort_unstable();
    sorted.sort_unstable();
    assert_eq!(in_turns, sorted);
    let tenth: Vec<Row> = first.iter().copied().step_by(10).collect();
    assert_eq!(thinned(&Thinning { cell: Some(0.7), every: 10, ..Thinning::default() }), tenth);
}

#[test]
fn an_index_gives_the_points_of_its_files() {
    let folder = tempfile::tempdir().unwrap();
    let file = street(folder.path(), "street.laz");
    let index = folder.path().join("street.pnti");
    let with_times = Options { wanted: ColumnSet::ALL, ..Options::usual(false) };
    build(std::slice::from_ref(&file), &index, &with_times, &Silent).unwrap();
    for selection in [
        Selection::default(),
        only(&["ground", "z=..100.5"]),
        only(&["intensity=1000..", "return=first", "source=1..3"]),
        only(&["gps-time=0.1..", "file=street.laz"]),
    ] {
        let sorted = |input: &Path| {
            let output = folder.path().join("out.laz");
            let exported =
                export(&[input.to_owned()], &selection, &Thinning::default(), &output).unwrap();
            let mut rows = rows(&read(&output), 1e-3);
            rows.sort_unstable();
            assert_eq!(exported.points, rows.len() as u64);
            (rows, exported.notes)
        };
        let ((of_files, none), (of_index, said)) = (sorted(&file), sorted(&index));
        assert!(!of_files.is_empty() && of_files == of_index, "{:?}", selection.filter);
        assert!(none.is_empty() && said[0].contains("an index has no scan angles"), "{said:?}");
    }
    let missing = export(
        std::slice::from_ref(&index),
        &only(&["class=99"]),
        &Thinning::default(),
        &folder.path().join("none.laz"),
    );
    let error = missing.unwrap_err().to_string();
    assert!(error.contains("leaves none of 60,000 points; classes present: 2"), "{error}");
    assert_eq!(names(folder.path()), ["out.laz", "street.laz", "street.pnti"]);
}

/// Tables and PLY files are read back by our own readers.
#[test]
fn text_and_ply_say_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let file = street(folder.path(), "street.las");
    let expected = rows(&read(&file), 1e-3);
    for name in ["out.csv", "out.ply"] {
        let output = folder.path().join(name);
        whole(&file, &output);
        let cloud = read(&output);
        let part = &cloud.parts[0];
        assert_eq!(cloud.len(), 60_000, "{name}");
        for (i, (row, expected)) in rows(&cloud, 1e-3).into_iter().zip(&expected).enumerate() {
            let stored = part.columns.intensity.as_ref().unwrap()[i];
            let intensity = cloud::intensity_of(stored, part.intensity_range);
            // Our reader has 16 bits for the range of the file's intensities.
            assert!((intensity - expected.2.unwrap() as f64).abs() < 1.0, "{name}: {i}");
            let others = |row: &Row| (row.0, row.1, row.3, row.4, row.5, row.6);
            assert_eq!(others(&row), others(expected), "{name}: {i}");
        }
    }
}

#[test]
fn formats_without_records_become_records_of_las_1_4() {
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("table.csv");
    std::fs::write(
        &table,
        "x,y,z,red,green,blue,intensity,classification,return_number,number_of_returns,gps_time\n\
         500000.25,5000000.5,-1.125,255,0,7,12,2,1,3,0.5\n500001.25,5000001.5,2.125,1,2,3,200,6,3,3,1.5\n",
    )
    .unwrap();
    let output = folder.path().join("out.las");
    whole(&table, &output);
    let (before, after) = (read(&table), read(&output));
    assert_eq!(after.parts[0].header.format, "LAS 1.4 format 7");
    assert_eq!(places(&before), places(&after));
    let columns = &after.parts[0].columns;
    assert_eq!(columns.rgb.as_deref(), Some(&[[255, 0, 7], [1, 2, 3]][..]));
    assert_eq!(columns.intensity.as_deref(), Some(&[12, 200][..]));
    assert_eq!(columns.class.as_deref(), Some(&[2, 6][..]));
    assert_eq!(columns.returns.as_deref(), Some(&[0x31, 0x33][..]));
    assert_eq!(columns.gps_time.as_deref(), Some(&[0.5, 1.5][..]));
}

/// Files on one lattice keep it; others are rounded to the finest steps, and a note says so.
#[test]
fn files_of_different_kinds_become_one() {
    let folder = tempfile::tempdir().unwrap();
    let of = |name: &str, las: Las| las.write(folder.path(), name);
    let near = of("near.las", Las { offset: [100.0, 0.0, 0.0], ..Las::default() });
    let same = of("same.laz", Las::default());
    let other = of("other.las", Las { format: 7, minor: 4, scale: [0.002; 3], ..Las::default() });
    let output = folder.path().join("out.las");
    let export = |files: &[&PathBuf]| {
        let files: Vec<PathBuf> = files.iter().map(|file| file.to_path_buf()).collect();
        let exported =
            self::export(&files, &Selection::default(), &Thinning::default(), &output).unwrap();
        let joined = cloud::read(&files, &options(), &Silent).unwrap();
        assert_eq!(rows(&joined, 1e-3), rows(&read(&output), 1e-3));
        (read(&output).parts[0].header.format.clone(), exported.notes)
    };
    let (format, notes) = export(&[&near, &same]);
    assert!(format == "LAS 1.2 format 3" && notes.is_empty(), "{notes:?}");
    let (format, notes) = export(&[&same, &other]);
    assert!(format == "LAS 1.4 format 7", "{format}");
    let said = notes.join("\n");
    assert!(said.contains("different lattices") && said.contains("point formats"), "{said}");
}

/// A listener that interrupts after some reports.
struct Impatient(std::sync::atomic::AtomicUsize);

impl Progress for Impatient {
    fn tick(&self, _doing: &str, _done: u64, _total: u64) -> Result<()> {
        let left = self.0.fetch_sub(1, std::sync::atomic::Ordering::Relaxed);
        if left == 0 { Err(Error::Interrupted) } else { Ok(()) }
    }
}

#[test]
fn an_interrupted_export_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let file = street(folder.path(), "street.laz");
    let input = Input::open(&[file], &options(), &Silent).unwrap();
    for name in ["out.las", "out.laz", "out.copc.laz", "out.ply", "out.csv"] {
        let output = folder.path().join(name);
        let progress = Impatient(0.into());
        let (all, thinning) = (Selection::default(), Thinning::default());
        let interrupted =
            extract::export(&input, &all, &thinning, Scalars::NONE, &output, &progress);
        assert!(matches!(interrupted, Err(Error::Interrupted)), "{name}");
        assert_eq!(names(folder.path()), ["street.laz"], "{name}");
    }
}

/// Returns records of format 6 on a rough slope, in no order.
fn slope(points: usize) -> Vec<u8> {
    let mut state = 7u64;
    let mut random = |most: u64| {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 33) % most) as i32
    };
    let mut records = Vec::with_capacity(30 * points);
    for i in 0..points {
        let [x, y] = [random(100_000), random(60_000)];
        let z = x / 3 + random(500);
        let start = records.len();
        [x, y, z].iter().for_each(|v| records.extend(v.to_le_bytes()));
        records.resize(start + 30, 0);
        records[start + 14] = 0x11;
        records[start + 22..].copy_from_slice(&(i as f64).to_le_bytes());
    }
    records
}

fn copc(path: &Path, records: &[u8], memory: usize, progress: &dyn Progress) -> Result<()> {
    let head = Head {
        minor: 4,
        format: 6,
        extra_bytes: 0,
        compressed: true,
        lattice: Lattice { step: DVec3::splat(0.01), offset: DVec3::new(5e5, 5e6, 0.0) },
        file_source: 0,
        global_encoding: 0,
        system: String::new(),
        records: Vec::new(),
    };
    let mut file = CopcWriter::create(path, head, memory)?;
    records.chunks(30 * 10_000).try_for_each(|some| file.write(some))?;
    file.finish(progress)
}

/// Points that go through files beside the output are in the same nodes as those in memory.
#[test]
fn a_copc_file_is_the_same_in_any_memory() {
    let folder = tempfile::tempdir().unwrap();
    let records = slope(400_000);
    let written = |memory: usize| {
        let path = folder.path().join("slope.copc.laz");
        copc(&path, &records, memory, &Silent).unwrap();
        assert_eq!(names(folder.path()), ["slope.copc.laz"]);
        std::fs::read(&path).unwrap()
    };
    let whole = written(1 << 30);
    assert!(whole == written(1 << 18) && whole == written(1));
    let cloud = read(&folder.path().join("slope.copc.laz"));
    assert_eq!(cloud.parts[0].header.format, "COPC 1.4 format 6");
    let mut times = cloud.parts[0].columns.gps_time.clone().unwrap();
    times.sort_by(f64::total_cmp);
    assert!(times.iter().copied().eq((0..400_000).map(f64::from)));
}

#[test]
fn an_interrupted_copc_file_leaves_nothing_and_points_in_one_place_are_one_node() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.copc.laz");
    let records = slope(200_000);
    for ticks in 0..4 {
        let interrupted = copc(&path, &records, 1 << 18, &Impatient(ticks.into()));
        assert!(matches!(interrupted, Err(Error::Interrupted)), "{ticks}");
        assert_eq!(names(folder.path()), [""; 0]);
    }
    copc(&path, &records[..30].repeat(200_000), 1 << 18, &Silent).unwrap();
    assert_eq!(read(&path).len(), 200_000);
}

/// The same bytes on any number of threads.
#[test]
fn threads_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let file = street(folder.path(), "street.laz");
    let bytes = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let output = folder.path().join("out.laz");
        let thinning = Thinning { cell: Some(0.3), ..Thinning::default() };
        pool.install(|| {
            export(std::slice::from_ref(&file), &only(&["z=..104"]), &thinning, &output)
        })
        .unwrap();
        std::fs::read(&output).unwrap()
    };
    let one = bytes(1);
    assert!(one == bytes(2) && one == bytes(5));
}

#[test]
fn real_las_files_are_exported_as_they_are() {
    let mut seen = BTreeMap::new();
    for folder in ["data/aerial", "data/ground", "data/formats"] {
        let Some(folder) = shared(folder) else { return };
        for name in names(&folder) {
            let file = folder.join(&name);
            let is_large = file.metadata().unwrap().len() > 20 << 20;
            if is_large || !(name.ends_with(".las") || name.ends_with(".laz")) {
                continue;
            }
            let Ok(cloud) = cloud::read(std::slice::from_ref(&file), &options(), &Silent) else {
                continue;
            };
            if cloud.is_empty() {
                continue;
            }
            let made = tempfile::tempdir().unwrap();
            let output = made.path().join("out.laz");
            let notes = whole(&file, &output);
            let after = read(&output);
            let (before, after) = (&cloud.parts[0], &after.parts[0]);
            assert_eq!(before.columns, after.columns, "{name}");
            assert_eq!(before.lattice, after.lattice, "{name}");
            assert_eq!(before.header.system, after.header.system, "{name}");
            let format = |header: &cloud::Header| {
                header.format.split(' ').next_back().unwrap_or_default().to_string()
            };
            seen.insert(name, (format(&before.header), format(&after.header), notes));
        }
    }
    println!("{seen:#?}");
    assert!(seen.len() > 10, "{}", seen.len());
}

#[test]
fn scalars_of_all_formats_are_kept_in_all() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let line = |i: i32| {
        let gap = if i == 7 { String::new() } else { format!("{}", i as f64 / 3.0) };
        format!("{i},{},0,{gap},{},{}\n", 2 * i, i - 20, 100 * i)
    };
    let lines: String = (0..40).map(line).collect();
    std::fs::write(at("0.csv"), format!("x,y,z,curvature,scan_angle,Roughness\n{lines}")).unwrap();
    let wanted = ColumnSet { scalars: Scalars::ALL, ..ColumnSet::ALL };
    let all = ReadOptions { records: true, ..ReadOptions::new(wanted, false) };
    let scalars =
        ["extra:curvature", "scan-angle", "extra:Roughness"].map(|name| name.parse().unwrap());
    let numbers = |file: &Path| {
        let cloud = cloud::read(&[file.to_owned()], &all, &Silent).unwrap();
        let columns = &cloud.parts[0].columns;
        scalars.map(|scalar| columns.scalar(scalar).expect("the scalar").clone())
    };
    let first = numbers(&at("0.csv"));
    assert!(first[0][7].is_nan() && first[1][3] == -17.0 && first[2][9] == 900.0);
    for (number, name) in ["1.ply", "2.laz", "3.csv", "4.las", "5.ply"].iter().enumerate() {
        let before = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path());
        let before = before.max().unwrap();
        assert!(before.file_name().unwrap().to_string_lossy().starts_with(&number.to_string()));
        let input = Input::open(&[before], &all, &Silent).unwrap();
        let (left, thinning) = (Selection::default(), Thinning::default());
        extract::export(&input, &left, &thinning, Scalars::NONE, &at(name), &Silent).unwrap();
        for (own, first) in numbers(&at(name)).iter().zip(&first) {
            // Angles of LAS are multiples of 0.006 degrees.
            let is_near = |(a, b): (&f64, &f64)| (a - b).abs() < 0.003 || a.is_nan() && b.is_nan();
            assert!(own.len() == 40 && own.iter().zip(first).all(is_near), "{name}: {own:?}");
        }
    }
}
