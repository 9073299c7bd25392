//! Streaming in batches gives the same points, counts, notes and errors as reading, on all real
//! files and on generated ones.
//!
//! Real and bad files lie in `../shared`; tests that need it are skipped if it is missing.

use crate::files::scan;
use crate::shared::shared;
use e57::{E57Writer, Record, RecordValue};
use laz::{LasZipCompressor, LazItemRecordBuilder, LazVlrBuilder};
use pointillist::cloud::filter::Filter;
use pointillist::cloud::stream::{self, BATCH, Streamed};
use pointillist::cloud::{self, ColumnSet, Columns, ReadOptions};
use pointillist::error::{Error, Result};
use pointillist::extract::Selection;
use pointillist::extract::input::Input;
use pointillist::extract::statistics::{Statistics, statistics};
use pointillist::progress::Silent;
use pointillist::synth::SceneKind;
use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// A part's title, other properties, and its points, each as a hash of all columns: the largest
/// file has ten million.
type Told = (String, String, Vec<u64>);

fn rows(columns: &Columns) -> Vec<u64> {
    fn at<T: Copy>(column: &Option<Vec<T>>, i: usize) -> Option<T> {
        column.as_ref().map(|column| column[i])
    }
    let row = |i| {
        let mut hasher = DefaultHasher::new();
        let place = [columns.x[i], columns.y[i], columns.z[i]];
        let numbers = (
            at(&columns.intensity, i),
            at(&columns.class, i),
            at(&columns.returns, i),
            at(&columns.source, i),
        );
        (
            place,
            at(&columns.rgb, i),
            numbers,
            at(&columns.normal, i),
            at(&columns.gps_time, i).map(f64::to_bits),
        )
            .hash(&mut hasher);
        hasher.finish()
    };
    (0..columns.len()).map(row).collect()
}

/// Returns a header without the columns that it names: only reading to the end finds that all
/// colours are black.
fn named(header: &cloud::Header) -> cloud::Header {
    cloud::Header { columns: ColumnSet::default(), ..header.clone() }
}

fn read(path: &Path, options: &ReadOptions) -> Result<(Vec<Told>, Vec<String>)> {
    let cloud = cloud::read(&[path.to_owned()], options, &Silent)?;
    let told = |part: &cloud::Part| {
        let mut rows = rows(&part.columns);
        rows.sort_unstable();
        (
            part.title(),
            format!("{:?} {:?} {:?}", part.lattice, part.intensity_range, named(&part.header)),
            rows,
        )
    };
    Ok((cloud.parts.iter().map(told).collect(), cloud.notes))
}

/// Collects all batches of a source as a consumer does.
fn collect(source: &stream::Source) -> Result<(Vec<u64>, Streamed)> {
    let batches = Mutex::new(Vec::new());
    let stream = || {
        batches.lock().unwrap().clear();
        source.stream(&Silent, &|batch| {
            assert!(
                (1..=BATCH).contains(&batch.columns.len()),
                "{} points in a batch",
                batch.columns.len()
            );
            assert_eq!(batch.columns.available(), source.available());
            batches.lock().unwrap().push(batch.columns.clone());
            Ok(())
        })
    };
    let mut streamed = stream()?;
    if streamed.again {
        streamed = stream()?;
    }
    assert!(!streamed.again);
    let mut all = Vec::new();
    for mut columns in batches.into_inner().unwrap() {
        columns.keep(streamed.available);
        let [lo, hi] = columns.bounds().unwrap();
        let [all_lo, all_hi] = streamed.bounds.unwrap();
        assert!((0..3).all(|axis| all_lo[axis] <= lo[axis] && hi[axis] <= all_hi[axis]));
        all.extend(rows(&columns));
    }
    assert_eq!(streamed.points, all.len() as u64);
    assert!(streamed.points <= source.points(), "{} of {}", streamed.points, source.points());
    all.sort_unstable();
    Ok((all, streamed))
}

fn streamed(path: &Path, options: &ReadOptions) -> Result<(Vec<Told>, Vec<String>)> {
    let mut notes = Vec::new();
    let mut parts = Vec::new();
    for source in stream::open(&[path.to_owned()], options, &Silent, &mut notes)? {
        assert_eq!(source.path(), path);
        let (rows, streamed) = collect(&source)?;
        notes.extend(streamed.notes);
        let about = format!(
            "{:?} {:?} {:?}",
            source.lattice(),
            source.intensity_range(),
            named(source.header())
        );
        parts.push((source.title(), about, rows));
    }
    Ok((parts, notes))
}

/// Compares reading with streaming. Returns the number of points, or the error.
#[track_caller]
fn agree(path: &Path, options: &ReadOptions) -> std::result::Result<usize, String> {
    match (read(path, options), streamed(path, options)) {
        (Ok((parts, notes)), Ok((own_parts, own_notes))) => {
            assert_eq!(own_notes, notes, "{}", path.display());
            assert_eq!(own_parts.len(), parts.len(), "{}", path.display());
            for (own, part) in own_parts.iter().zip(&parts) {
                assert_eq!(
                    (&own.0, &own.1, own.2.len()),
                    (&part.0, &part.1, part.2.len()),
                    "{}",
                    path.display()
                );
                assert!(own.2 == part.2, "{}: other points", path.display());
            }
            Ok(parts.iter().map(|part| part.2.len()).sum())
        }
        (Err(error), Err(own)) => {
            assert_eq!(own.to_string(), error.to_string(), "{}", path.display());
            Err(error.to_string())
        }
        (Ok(_), Err(own)) => panic!("{}: only streaming fails: {own}", path.display()),
        (Err(error), Ok(_)) => panic!("{}: only reading fails: {error}", path.display()),
    }
}

const ALL: ReadOptions = ReadOptions::new(ColumnSet::ALL, false);

fn agree_bytes(
    name: &str,
    bytes: &[u8],
    options: &ReadOptions,
) -> std::result::Result<usize, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, bytes).unwrap();
    agree(&path, options)
}

// ---- real files

fn files(folder: PathBuf) -> Vec<PathBuf> {
    let mut folders = vec![folder];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() { folders.push(path) } else { files.push(path) }
        }
    }
    files.retain(|path| {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        ["las", "laz", "ply", "e57", "xyz", "obj", "csv", "txt"].contains(&extension.as_str())
    });
    files.sort();
    files
}

#[test]
fn real_files_stream_the_points_that_are_read() {
    let Some(data) = shared("data") else { return };
    let files = files(data);
    assert!(files.len() >= 20, "{} files", files.len());
    for path in files {
        let points = agree(&path, &ALL).unwrap_or_else(|error| panic!("{error}"));
        println!("{}: {points}", path.display());
    }
}

#[test]
fn bad_files_are_judged_alike() {
    let Some(bad) = shared("bad") else { return };
    let files = files(bad);
    assert!(files.len() >= 36, "{} files", files.len());
    for path in files {
        for strict in [false, true] {
            println!(
                "{} {strict}: {:?}",
                path.display(),
                agree(&path, &ReadOptions { strict, ..ALL })
            );
        }
    }
}

#[test]
fn columns_that_are_not_wanted_are_not_in_batches() {
    let Some(path) = shared("data/formats/las1.4_pf9.laz") else { return };
    for wanted in [
        ColumnSet::default(),
        ColumnSet { intensity: true, ..ColumnSet::default() },
        ColumnSet { rgb: true, source: true, ..ColumnSet::default() },
    ] {
        assert!(agree(&path, &ReadOptions::new(wanted, true)).is_ok());
    }
}

#[test]
fn lies_and_cuts_are_judged_alike() {
    for name in ["las1.2_pf2.las", "las1.2_pf2.laz", "las1.4_pf6_rand.laz", "las1.4_pf9.las"] {
        let Some(path) = shared(&format!("data/formats/{name}")) else { return };
        let bytes = fs::read(path).unwrap();
        for length in
            (0..bytes.len()).step_by(997).chain(bytes.len().saturating_sub(60)..bytes.len())
        {
            let _ = agree_bytes("cut.las", &bytes[..length], &ALL);
        }
        // Counts, scale, offset, bounds, then the laszip record, the first chunk, and the table.
        let number = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        let mut places = vec![24, 25, 94, 96, 100, 104, 105, 107, 131, 155, 179, 187];
        if bytes[25] >= 4 {
            places.extend([227, 235, 243, 247]);
        }
        if let Some(record) = bytes.windows(14).position(|window| window == b"laszip encoded") {
            let contents = record - 2 + 54;
            let (chunks, table) = (number(96), number(number(96)));
            places.extend([
                contents,
                contents + 12,
                contents + 32,
                contents + 34,
                chunks,
                chunks + 8,
                chunks + 38,
                chunks + 42,
            ]);
            places.extend([table, table + 4, table + 8, table + 12]);
        }
        for at in places {
            for value in [
                0u16,
                1,
                0x7ff0,
                0x8000,
                u16::MAX,
                u16::from_le_bytes([bytes[at], bytes[at + 1]]).wrapping_add(1),
            ] {
                let mut lying = bytes.clone();
                lying[at..at + 2].copy_from_slice(&value.to_le_bytes());
                let _ = agree_bytes("lying.las", &lying, &ALL);
            }
        }
        for at in (0..bytes.len()).step_by(331) {
            let mut flipped = bytes.clone();
            flipped[at] ^= 1 << (at % 8);
            let _ = agree_bytes("flipped.las", &flipped, &ALL);
        }
    }
}

// ---- generated files

/// Point formats 3 and 7, with their record lengths.
const FORMATS: [(u8, usize); 2] = [(3, 34), (7, 36)];

#[derive(Clone, Copy)]
enum Chunks {
    Of(u32),
    /// Chunks of 1000, 2000, 3000 ... points.
    Varying,
}

fn record(i: usize, format: u8, color: u16) -> Vec<u8> {
    let mut record = Vec::new();
    let q =
        [i as i32 % 1000, i as i32 / 1000, (i as i32).wrapping_mul(0x9E37_79B9u32 as i32) >> 20];
    q.iter().for_each(|q| record.extend(q.to_le_bytes()));
    record.extend((i as u16).to_le_bytes());
    record.extend(if format == 3 {
        vec![0b01_010_001, (i % 20) as u8, 0, 0]
    } else {
        vec![0x21, 0, (i % 20) as u8, 0, 0, 0]
    });
    record.extend((i as u16 / 4096).to_le_bytes());
    record.extend((i as f64 * 0.25).to_le_bytes());
    [color, 0, color / 2].iter().for_each(|channel| record.extend(channel.to_le_bytes()));
    record
}

/// Returns the header of a LAS file whose points follow right after `between`.
fn header(format: u8, width: usize, count: usize, between: usize) -> Vec<u8> {
    let modern = format >= 6;
    let mut head = vec![0u8; if modern { 375 } else { 227 }];
    head[..4].copy_from_slice(b"LASF");
    (head[24], head[25], head[104]) = (1, if modern { 4 } else { 2 }, format);
    let length = head.len();
    head[94..96].copy_from_slice(&(length as u16).to_le_bytes());
    head[96..100].copy_from_slice(&((length + between) as u32).to_le_bytes());
    head[105..107].copy_from_slice(&(width as u16).to_le_bytes());
    head[107..111].copy_from_slice(&(count as u32).to_le_bytes());
    if modern {
        head[247..255].copy_from_slice(&(count as u64).to_le_bytes());
    }
    for axis in 0..3 {
        head[131 + 8 * axis..139 + 8 * axis].copy_from_slice(&0.001f64.to_le_bytes());
        head[179 + 16 * axis..187 + 16 * axis].copy_from_slice(&1.0f64.to_le_bytes());
    }
    head
}

fn las((format, width): (u8, usize), colors: &[u16]) -> Vec<u8> {
    let mut file = header(format, width, colors.len(), 0);
    colors.iter().enumerate().for_each(|(i, &color)| file.extend(record(i, format, color)));
    file
}

fn laz((format, width): (u8, usize), colors: &[u16], chunks: Chunks) -> Vec<u8> {
    let items = LazItemRecordBuilder::default_for_point_format_id(format, 0).unwrap();
    let vlr = match chunks {
        Chunks::Of(points) => LazVlrBuilder::new(items).with_fixed_chunk_size(points).build(),
        Chunks::Varying => LazVlrBuilder::new(items).with_variable_chunk_size().build(),
    };
    let mut laszip = Vec::new();
    vlr.write_to(&mut laszip).unwrap();
    let mut file = header(format, width, colors.len(), 54 + laszip.len());
    file[104] |= 128;
    file[100] = 1;
    file.extend(b"\0\0laszip encoded\0\0");
    file.extend(22204u16.to_le_bytes());
    file.extend((laszip.len() as u16).to_le_bytes());
    file.extend([0; 32]);
    file.extend(laszip);
    let mut sink = std::io::Cursor::new(Vec::new());
    std::io::Write::write_all(&mut sink, &file).unwrap();
    let mut compressor = LasZipCompressor::new(sink, vlr).unwrap();
    let (mut ends_at, mut size) = (1000, 1000);
    for (i, &color) in colors.iter().enumerate() {
        if matches!(chunks, Chunks::Varying) && i == ends_at {
            compressor.finish_current_chunk().unwrap();
            size += 1000;
            ends_at += size;
        }
        compressor.compress_one(&record(i, format, color)).unwrap();
    }
    compressor.done().unwrap();
    compressor.into_inner().into_inner()
}

const COUNT: usize = 150_001;

/// Returns low values with wide ones for a fifth of the file around this place, which a sample may
/// miss.
fn colors(wide_at: Option<usize>) -> Vec<u16> {
    let is_wide = |i: usize| wide_at.is_some_and(|wide_at| i.abs_diff(wide_at) < COUNT / 5);
    (0..COUNT).map(|i| if is_wide(i) { 0x1234 } else { (i % 256) as u16 }).collect()
}

#[test]
fn las_made_here_streams_in_full_and_cut() {
    for format in FORMATS {
        for wide_at in [None, Some(0), Some(BATCH - 1), Some(BATCH + 9000), Some(COUNT - 1)] {
            let file = las(format, &colors(wide_at));
            assert_eq!(agree_bytes("whole.las", &file, &ALL), Ok(COUNT));
            assert_eq!(
                agree_bytes("cut.las", &file[..file.len() - 70_000 * format.1 - 3], &ALL),
                Ok(COUNT - 70_001)
            );
        }
        assert_eq!(agree_bytes("black.las", &las(format, &[0; 100_000]), &ALL), Ok(100_000));
        assert_eq!(agree_bytes("none.las", &las(format, &[]), &ALL), Ok(0));
    }
}

#[test]
fn laz_made_here_streams_with_and_without_its_table() {
    for format in FORMATS {
        // Smaller than a batch, larger, and all of the file.
        for chunks in [Chunks::Of(5000), Chunks::Of(70_000), Chunks::Of(1_000_000), Chunks::Varying]
        {
            let depths = if matches!(chunks, Chunks::Of(70_000)) {
                &[None, Some(BATCH + 9000)][..]
            } else {
                &[Some(BATCH + 9000)]
            };
            for &wide_at in depths {
                let file = laz(format, &colors(wide_at), chunks);
                assert_eq!(agree_bytes("whole.laz", &file, &ALL), Ok(COUNT));
                let points_at = u32::from_le_bytes(file[96..100].try_into().unwrap()) as usize;
                let table_at =
                    u64::from_le_bytes(file[points_at..points_at + 8].try_into().unwrap()) as usize;
                let cut = agree_bytes("tableless.laz", &file[..table_at], &ALL);
                match (format.0, chunks) {
                    (3, Chunks::Varying) => assert!(cut.unwrap_err().contains("varying size")),
                    _ => assert_eq!(cut, Ok(COUNT)),
                }
                let half = agree_bytes("half.laz", &file[..file.len() / 2], &ALL);
                match (format.0, chunks) {
                    (3, Chunks::Varying) | (7, Chunks::Of(1_000_000)) => drop(half.unwrap_err()),
                    _ => assert!((COUNT / 4..COUNT * 3 / 4).contains(&half.unwrap())),
                }
                // Noise within one chunk; the others are intact.
                let mut damaged = file.clone();
                let middle = points_at + (table_at - points_at) / 5;
                damaged[middle..middle + 400].fill(0xA5);
                let _ = agree_bytes("damaged.laz", &damaged, &ALL);
                let _ = agree_bytes("damaged.laz", &damaged, &ReadOptions { strict: true, ..ALL });
            }
        }
        assert_eq!(
            agree_bytes("black.laz", &laz(format, &[0; 10_000], Chunks::Of(5000)), &ALL),
            Ok(10_000)
        );
    }
}

#[test]
fn what_a_source_says_before_its_points_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.las");
    let mut file = las(FORMATS[0], &colors(None));
    file[179..227].copy_from_slice(
        &[[0.999f64, 0.0], [0.15, 0.0], [2.047, -2.048]]
            .concat()
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect::<Vec<_>>(),
    );
    fs::write(&path, &file).unwrap();
    let open = || {
        stream::open(std::slice::from_ref(&path), &ALL, &Silent, &mut Vec::new()).unwrap().remove(0)
    };
    let source = open();
    assert_eq!(
        (source.title().as_str(), source.name(), source.points()),
        ("a.las", None, COUNT as u64)
    );
    assert_eq!(source.available(), ColumnSet { normal: false, ..ColumnSet::ALL });
    let ([lo, hi], streamed) = (source.stated_bounds().unwrap(), collect(&source).unwrap().1);
    assert_eq!(streamed.bounds, Some([[0, 0, -2048], [999, 150, 2047]]));
    assert!((0..3).all(|axis| (0..=1).contains(&([0, 0, -2048][axis] - lo[axis]))
        && (0..=1).contains(&(hi[axis] - [999, 150, 2047][axis]))));
    assert_eq!(streamed.notes.len(), 1, "{:?}", streamed.notes);
    for (at, value) in
        [(179, f64::NAN), (187, 2.0), (195, f64::INFINITY), (203, -1e300), (211, 1e9)]
    {
        let mut lying = file.clone();
        lying[at..at + 8].copy_from_slice(&f64::to_le_bytes(value));
        fs::write(&path, &lying).unwrap();
        assert_eq!(open().stated_bounds(), None, "{value} at {at}");
    }
}

#[test]
fn a_source_can_be_streamed_again_but_not_once_its_file_has_changed() {
    let folder = tempfile::tempdir().unwrap();
    for (name, file) in [
        ("a.las", las(FORMATS[0], &colors(None))),
        ("a.laz", laz(FORMATS[1], &colors(None), Chunks::Of(5000))),
    ] {
        let path = folder.path().join(name);
        fs::write(&path, &file).unwrap();
        let source = stream::open(std::slice::from_ref(&path), &ALL, &Silent, &mut Vec::new())
            .unwrap()
            .remove(0);
        let (first, again) = (collect(&source).unwrap(), collect(&source).unwrap());
        assert!(first.0 == again.0 && first.1.notes == again.1.notes);
        let ended = source.stream(&Silent, &|_| Err(Error::Interrupted));
        assert!(matches!(ended, Err(Error::Interrupted)));
        fs::write(&path, &file[..file.len() - 1]).unwrap();
        let error = source.stream(&Silent, &|_| Ok(())).err().unwrap().to_string();
        assert!(error.contains("when it was opened"), "{error}");
    }
}

#[test]
fn other_formats_stream_in_batches_too() {
    let text: String = (0..COUNT).map(|i| format!("{i} {} 7 {} 0 9\n", i % 77, i % 256)).collect();
    assert_eq!(agree_bytes("a.xyz", text.as_bytes(), &ALL), Ok(COUNT));
    assert!(agree_bytes("none.xyz", b"nothing here\n", &ALL).is_err());
}

/// Points that are more than a source holds in memory.
const MANY: usize = 1_300_000;

/// Returns a decimal of few digits.
fn decimal(i: usize, most: usize) -> f64 {
    (i * 7919 % most) as f64 / 1000.0
}

/// Compares reading with streaming of points in a temporary file, and the statistics of both.
fn agree_on_disk(path: &Path) {
    agree(path, &ALL).unwrap();
    let ground = Filter { only: vec!["z=..1".parse().unwrap()], not: Vec::new() };
    for filter in [Filter::default(), ground] {
        let selection = Selection { filter, ..Selection::default() };
        let [whole, batches] = statistics_of(&[path.to_owned()], &selection);
        assert_eq!(whole.unwrap(), batches.unwrap(), "{}", path.display());
    }
}

#[test]
fn text_that_is_too_large_for_memory_streams_the_points_that_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.csv");
    let mut file = BufWriter::new(fs::File::create(&path).unwrap());
    writeln!(file, "x,y,z,intensity,red,green,blue,class,gps time,height").unwrap();
    for i in 0..MANY {
        // Strays at the beginning, in the middle and at the end; no intensity, and no place.
        let x = match i {
            0 | 700_000 | 700_001 => 9e6,
            i if i == MANY - 1 => -9e6,
            i => 500_000.0 + decimal(i, 20_011),
        };
        let place = if i == 5 { "nan".into() } else { decimal(i, 3001).to_string() };
        let intensity = if i % 1000 == 1 { String::new() } else { (i % 300).to_string() };
        let color = i % 65_536;
        let (y, class) = (5e6 + decimal(i, 30_011), i % 7);
        writeln!(file, "{x},{y},{place},{intensity},{color},0,{color},{class},{i}.5,{i}").unwrap();
    }
    drop(file);
    agree_on_disk(&path);
}

#[test]
fn angles_that_are_too_many_for_memory_stream_the_points_that_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.csv");
    let mut file = BufWriter::new(fs::File::create(&path).unwrap());
    writeln!(file, "lon,lat,z").unwrap();
    for i in 0..MANY {
        let [lon, lat] = [3001, 2003].map(|most| decimal(i, most) / 1000.0);
        writeln!(file, "{:.7},{:.7},{}", 7.0 + lon, 50.0 + lat, decimal(i, 997)).unwrap();
    }
    drop(file);
    agree_on_disk(&path);
}

#[test]
fn ply_that_is_too_large_for_memory_streams_the_points_that_are_read() {
    let folder = tempfile::tempdir().unwrap();
    for (name, color, normals) in [("unit", 1.0, true), ("black", 0.0, false)] {
        let path = folder.path().join(format!("{name}.ply"));
        let mut file = BufWriter::new(fs::File::create(&path).unwrap());
        let names = ["x", "y", "z", "red", "green", "blue", "nx", "ny", "nz", "intensity"];
        writeln!(file, "ply\nformat binary_little_endian 1.0\nelement vertex {MANY}").unwrap();
        names.iter().for_each(|name| writeln!(file, "property float {name}").unwrap());
        writeln!(file, "end_header").unwrap();
        for i in 0..MANY {
            let far = if i == 900_000 { 1e7 } else { 0.0 };
            let place = [20_011, 30_011, 3001].map(|most| decimal(i, most) as f32 + far);
            let shade = color * (i % 257) as f32 / 256.0;
            let normal = if normals { [0.0, 0.6, 0.8] } else { [0.0; 3] };
            let blue = if color == 0.0 { f32::NAN } else { shade / 2.0 };
            let rest = [[shade, 0.0, blue], normal].concat();
            let intensity = (i % 97) as f32 / 96.0;
            for value in place.into_iter().chain(rest).chain([intensity]) {
                file.write_all(&value.to_le_bytes()).unwrap();
            }
        }
        drop(file);
        agree_on_disk(&path);
    }
}

#[test]
fn scans_of_an_e57_file_that_are_too_large_for_memory_stream_the_points_that_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.e57");
    let mut file = E57Writer::from_file(&path, "file").unwrap();
    // The first is held, the second waits in a file, and so does the third, as no room is left.
    for (scan, points) in [(0, 400_000), (1, 800_000), (2, 300_000)] {
        let prototype = vec![
            Record::CARTESIAN_X_F64,
            Record::CARTESIAN_Y_F64,
            Record::CARTESIAN_Z_F64,
            Record::COLOR_RED_U8,
            Record::COLOR_GREEN_U8,
            Record::COLOR_BLUE_U8,
        ];
        let mut cloud = file.add_pointcloud(&format!("scan {scan}"), prototype).unwrap();
        for i in 0..points {
            let place = [20_011, 30_011, 3001].map(|most| RecordValue::Double(decimal(i, most)));
            let color = RecordValue::Integer((i % 256) as i64);
            cloud
                .add_point(place.into_iter().chain([(); 3].map(|()| color.clone())).collect())
                .unwrap();
        }
        cloud.finalize().unwrap();
    }
    file.finalize().unwrap();
    drop(file);
    agree_on_disk(&path);
}

#[test]
fn a_sample_is_points_of_the_file_from_all_over_it() {
    let folder = tempfile::tempdir().unwrap();
    for (name, asked, expected) in
        [("scan.las", 20_000, 20_000..=20_100), ("scan.laz", 110_000, 100_000..=150_000)]
    {
        let path = folder.path().join(name);
        scan(&path, pointillist::synth::SceneKind::Street, 300_000);
        let wanted = ColumnSet { rgb: true, ..ColumnSet::default() };
        let whole =
            cloud::read(std::slice::from_ref(&path), &ReadOptions::new(wanted, true), &Silent)
                .unwrap();
        let sample = cloud::sample(
            std::slice::from_ref(&path),
            &ReadOptions::new(wanted, false),
            asked,
            &Silent,
        )
        .unwrap()
        .expect("a sample");
        assert!(expected.contains(&sample.len()), "{name}: {} points", sample.len());
        let points = |cloud: &pointillist::cloud::Cloud| -> Vec<([i32; 3], [u8; 3])> {
            let columns = &cloud.parts[0].columns;
            let rgb = columns.rgb.as_ref().unwrap();
            (0..columns.len())
                .map(|i| ([columns.x[i], columns.y[i], columns.z[i]], rgb[i]))
                .collect()
        };
        let all: std::collections::HashSet<_> = points(&whole).into_iter().collect();
        assert!(
            points(&sample).iter().all(|point| all.contains(point)),
            "{name}: a point that the file does not have"
        );
        let size = |cloud: &pointillist::cloud::Cloud| {
            cloud.bounds().map(|(lo, hi)| (hi - lo).length()).unwrap()
        };
        assert!(
            size(&sample) > 0.5 * size(&whole),
            "{name}: {} of {} metres",
            size(&sample),
            size(&whole)
        );
    }
}

/// A sample shows everything that is large enough: no part of the scene is missing between the
/// sampled places.
#[test]
fn a_sample_is_coarse_and_has_no_gaps() {
    let folder = tempfile::tempdir().unwrap();
    for (name, least) in [("scan.las", 0.99), ("scan.laz", 0.7)] {
        let path = folder.path().join(name);
        scan(&path, pointillist::synth::SceneKind::Street, 2_000_000);
        let wanted = ColumnSet::default();
        let whole =
            cloud::read(std::slice::from_ref(&path), &ReadOptions::new(wanted, true), &Silent)
                .unwrap();
        let sample = cloud::sample(
            std::slice::from_ref(&path),
            &ReadOptions::new(wanted, false),
            200_000,
            &Silent,
        )
        .unwrap()
        .expect("a sample");
        // Cells of two metres.
        let cells = |cloud: &pointillist::cloud::Cloud| {
            let part = &cloud.parts[0];
            let mut cells = std::collections::HashMap::<[i64; 3], u32>::new();
            for i in 0..part.columns.len() {
                let place = part.lattice.world(
                    [part.columns.x[i], part.columns.y[i], part.columns.z[i]].map(i64::from),
                );
                *cells.entry((place / 2.0).floor().to_array().map(|v| v as i64)).or_default() += 1;
            }
            cells
        };
        let (all, some) = (cells(&whole), cells(&sample));
        let seen: Vec<_> = all
            .iter()
            .filter(|(_, points)| **points >= 500)
            .map(|(cell, _)| some.contains_key(cell))
            .collect();
        let share = seen.iter().filter(|seen| **seen).count() as f64 / seen.len() as f64;
        println!("{name}: {share:.3} of {} cells", seen.len());
        assert!(share >= least, "{name}: {share:.3} of {} cells", seen.len());
    }
}

#[test]
fn a_sample_of_odd_files_is_what_they_have() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scan.las");
    scan(&path, pointillist::synth::SceneKind::Street, 1000);
    let bytes = std::fs::read(&path).unwrap();
    let sampled = |points: u64| {
        cloud::sample(
            std::slice::from_ref(&path),
            &ReadOptions::new(ColumnSet::ALL, false),
            points,
            &Silent,
        )
        .unwrap()
        .unwrap()
        .len()
    };
    assert_eq!(
        [0, 1, 63, 65, 1000, 1001, u64::MAX].map(sampled),
        [0, 64, 64, 125, 1000, 1000, 1000]
    );
    // Truncated, and without any point.
    std::fs::write(&path, &bytes[..227 + 34 * 500 + 7]).unwrap();
    assert_eq!([10, 500, 5000].map(sampled), [62, 500, 500]);
    std::fs::write(&path, &bytes[..227]).unwrap();
    assert_eq!([0, 5000].map(sampled), [0, 0]);
    let path = folder.path().join("scan.laz");
    scan(&path, pointillist::synth::SceneKind::Street, 120_000);
    let sampled = |points: u64| {
        cloud::sample(
            std::slice::from_ref(&path),
            &ReadOptions::new(ColumnSet::ALL, false),
            points,
            &Silent,
        )
        .unwrap()
        .unwrap()
        .len()
    };
    assert_eq!([0, 3, 120_000, u64::MAX].map(sampled), [0, 5, 120_000, 120_000]);
}

/// Returns the statistics of files read whole, and in batches.
fn statistics_of(paths: &[PathBuf], selection: &Selection) -> [Result<Statistics>; 2] {
    let options = ReadOptions { extras: true, ..ReadOptions::new(ColumnSet::ALL, false) };
    let whole = cloud::read(paths, &options, &Silent).and_then(|mut cloud| {
        cloud.filter(&selection.filter)?;
        statistics(&mut Input::of_cloud(cloud), &Selection::default(), &Silent)
    });
    let batches = Input::open(paths, &options, &Silent)
        .and_then(|mut input| statistics(&mut input, selection, &Silent));
    // Notes of what was read whole were given before.
    [whole, batches].map(|found| found.map(|found| Statistics { notes: Vec::new(), ..found }))
}

#[test]
fn statistics_of_batches_are_those_of_files_read_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    scan(&path("street.las"), SceneKind::Street, 200_000);
    let bytes = fs::read(path("street.las")).unwrap();
    let at = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
    let record = u16::from_le_bytes(bytes[105..107].try_into().unwrap()) as usize;
    // Three strays, of which two coincide, and a second station that is everywhere.
    let mut strays = bytes.clone();
    for k in [5, 77_777, 199_999] {
        let x = if k == 5 { 2_000_000_000i32 } else { -1_999_999_999 };
        strays[at + k * record..][..4].copy_from_slice(&x.to_le_bytes());
    }
    fs::write(path("strays.las"), &strays).unwrap();
    // All points in one place.
    let one: Vec<u8> = bytes[at..at + record].repeat(200_000);
    fs::write(path("one.las"), [&bytes[..at], &one].concat()).unwrap();
    // A file that is cut off.
    fs::write(path("cut.las"), &bytes[..at + 150_000 * record]).unwrap();
    let ground = Selection {
        filter: Filter { only: vec!["ground".parse().unwrap()], not: Vec::new() },
        ..Selection::default()
    };
    let mut checked = 0;
    let mut check = |paths: &[PathBuf], selection: &Selection| {
        let [whole, batches] = statistics_of(paths, selection);
        match (whole, batches) {
            (Ok(whole), Ok(batches)) => {
                assert_eq!(whole, batches, "{paths:?}");
                checked += 1;
            }
            (whole, batches) => {
                let [whole, batches] = [whole, batches].map(|found| found.err());
                let [whole, batches] = [whole, batches].map(|error| error.map(|e| e.to_string()));
                assert_eq!(whole, batches, "{paths:?}");
            }
        }
    };
    for names in [
        &["street.las"][..],
        &["strays.las"],
        &["one.las"],
        &["cut.las"],
        &["street.las", "one.las"],
    ] {
        let paths: Vec<PathBuf> = names.iter().map(|name| path(name)).collect();
        check(&paths, &Selection::default());
        check(&paths, &ground);
    }
    let [Ok(whole), _] = statistics_of(&[path("strays.las")], &Selection::default()) else {
        panic!("it can be read")
    };
    assert_eq!(whole.strays.points, 3);
    if let Some(folder) = shared("data") {
        for path in files(folder) {
            if fs::metadata(&path).unwrap().len() < 30 << 20 {
                check(&[path], &Selection::default());
            }
        }
    }
    println!("{checked} inputs");
    assert!(checked > 6);
}
