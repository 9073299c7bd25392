//! Maps as a user types them, with GDAL as witness.

use crate::files::names;
use crate::index_file::indexed;
use crate::png_file::read_png;
use crate::program::{failed, pointillist, render, succeeded, text};
use crate::shared::shared;
use crate::witness::{gdal, gdalinfo};
use glam::DVec3;
use pointillist::cloud::las::header::Vlr;
use pointillist::cloud::las::write::{Head, LasWriter};
use pointillist::cloud::{self, ColumnSet, Lattice, ReadOptions};
use pointillist::progress::Silent;
use serde_json::Value;
use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

/// A point in steps of a centimetre from (500000, 5000000, 0).
#[derive(Clone, Copy)]
struct Point {
    steps: [i32; 3],
    intensity: u16,
    number: u8,
    of: u8,
    rgb: [u8; 3],
}

const ORIGIN: [i64; 3] = [50_000_000, 500_000_000, 0];

/// Returns points with two returns a pulse, many of them on edges of cells.
fn points(count: u32) -> Vec<Point> {
    let mut state = 1u32;
    let mut next = |below: u32| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) % below
    };
    (0..count)
        .map(|i| Point {
            steps: [next(800) as i32 * 5 - 7, next(500) as i32 * 5 + 3, next(3000) as i32],
            intensity: next(4000) as u16,
            number: 1 + (i % 2) as u8,
            of: 2,
            rgb: [0; 3].map(|_| 1 + next(255) as u8),
        })
        .collect()
}

/// Writes points in a system of GeoTIFF keys: LAS 1.2, format 2.
fn write(path: &Path, points: &[Point], lattice: Lattice, keys: &[[u16; 4]]) {
    let header = [1, 1, 0, keys.len() as u16];
    let words = [header].iter().chain(keys).flatten().copied().collect::<Vec<u16>>();
    let head = Head {
        minor: 2,
        format: 2,
        extra_bytes: 0,
        compressed: path.extension().is_some_and(|ending| ending == "laz"),
        lattice,
        file_source: 0,
        global_encoding: 0,
        system: String::new(),
        records: vec![Vlr {
            user: "LASF_Projection".into(),
            record: 34735,
            description: String::new(),
            data: words.iter().flat_map(|word| word.to_le_bytes()).collect(),
        }],
    };
    let mut file = LasWriter::create(path, head).unwrap();
    for point in points {
        let mut record = [0; 26];
        for (axis, steps) in point.steps.iter().enumerate() {
            record[4 * axis..4 * axis + 4].copy_from_slice(&steps.to_le_bytes());
        }
        record[12..14].copy_from_slice(&point.intensity.to_le_bytes());
        record[14] = point.number | point.of << 3;
        for (channel, value) in point.rgb.iter().enumerate() {
            let at = 20 + 2 * channel;
            record[at..at + 2].copy_from_slice(&(*value as u16 * 257).to_le_bytes());
        }
        file.write(&record).unwrap();
    }
    file.finish().unwrap();
}

/// UTM zone 32 on ETRS89, heights in DHHN2016.
const UTM: &[[u16; 4]] = &[[1024, 0, 1, 1], [3072, 0, 1, 25832], [4096, 0, 1, 7837]];

fn metres() -> Lattice {
    Lattice { step: DVec3::splat(0.01), offset: DVec3::new(500_000.0, 5_000_000.0, 0.0) }
}

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

    fn scan(&self, points: &[Point]) -> PathBuf {
        let path = self.at("scan.laz");
        write(&path, points, metres(), UTM);
        path
    }
}

fn raster(cloud: &Path, output: &Path, line: &str) -> Output {
    let mut command = pointillist();
    command.arg("raster").arg(cloud).arg("-o").arg(output).args(line.split_whitespace());
    command.output().expect("start the program")
}

/// Returns the samples of a map as GDAL reads them, band after band.
fn samples(path: &Path) -> Option<Vec<u8>> {
    let raw = path.with_extension("raw");
    gdal("gdal_translate", "-q -of ENVI -co INTERLEAVE=BSQ", &[path, &raw])?;
    Some(fs::read(raw).unwrap())
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

/// The direct grid: the points of each cell by column from the west and row from the north, in
/// whole steps. Returns the western and the northern edge in cells, the sides and the cells.
fn direct(steps: &[[i64; 3]], cell: i64) -> ([i64; 2], [usize; 2], HashMap<usize, Vec<usize>>) {
    let of = |p: &[i64; 3]| [p[0].div_euclid(cell), p[1].div_euclid(cell)];
    let ends = |axis: usize| {
        let all = || steps.iter().map(|p| of(p)[axis]);
        [all().min().unwrap(), all().max().unwrap()]
    };
    let ([west, east], [south, north]) = (ends(0), ends(1));
    let (width, height) = ((east - west + 1) as usize, (north - south + 1) as usize);
    let mut cells = HashMap::<usize, Vec<usize>>::new();
    for (i, p) in steps.iter().enumerate() {
        let [column, row] = of(p);
        let at = (north - row) as usize * width + (column - west) as usize;
        cells.entry(at).or_default().push(i);
    }
    ([west, north + 1], [width, height], cells)
}

fn whole(points: &[Point]) -> Vec<[i64; 3]> {
    points.iter().map(|p| [0, 1, 2].map(|axis| p.steps[axis] as i64 + ORIGIN[axis])).collect()
}

/// Checks place and system of a map as GDAL reads them.
fn check_place(
    path: &Path,
    corner: [f64; 2],
    size: [usize; 2],
    side: f64,
    epsg: &str,
) -> Option<()> {
    let info = gdalinfo(path)?;
    assert_eq!(info["size"], serde_json::json!(size), "{info}");
    let found = numbers(&info["geoTransform"]);
    let expected = [corner[0], side, 0.0, corner[1], 0.0, -side];
    assert!(
        found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9),
        "{found:?} {expected:?}"
    );
    let wkt = info["coordinateSystem"]["wkt"].as_str().unwrap();
    assert!(wkt.contains(&format!("ID[\"EPSG\",{epsg}]]")), "{wkt}");
    Some(())
}

#[test]
fn gdal_reads_the_direct_grid_of_the_points() {
    let place = Place::new();
    let all = points(20_000);
    let file = place.scan(&all);
    let index = indexed(&[&file], "");
    for (line, cell) in [
        ("--resolution 0.25", 25),
        ("--resolution 0.3 --only return=last", 30),
        ("--resolution 1 --only return=first --pick lowest", 100),
        ("--resolution 0.7 --pick mean", 70),
        ("--resolution 0.25 --value intensity", 25),
        ("--resolution 0.5 --value intensity --pick mean", 50),
    ] {
        let left: Vec<Point> = all
            .iter()
            .filter(|p| !line.contains("last") || p.number == p.of)
            .filter(|p| !line.contains("first") || p.number == 1)
            .copied()
            .collect();
        let steps = whole(&left);
        let (corner, size, cells) = direct(&steps, cell);
        for cloud in [&file, &index] {
            let output = place.at("map.tif");
            succeeded(&raster(cloud, &output, line));
            let side = cell as f64 / 100.0;
            let at = corner.map(|edge| (edge * cell) as f64 / 100.0);
            let Some(()) = check_place(&output, at, size, side, "25832") else { return };
            let info = gdalinfo(&output).unwrap();
            let band = &info["bands"][0];
            assert_eq!(
                (&band["type"], &band["noDataValue"]),
                (&"Float32".into(), &(-9999.0).into())
            );
            let wkt = info["coordinateSystem"]["wkt"].as_str().unwrap();
            assert_eq!(wkt.contains("7837"), !line.contains("intensity"), "{wkt}");
            let found = floats(&samples(&output).unwrap());
            assert_eq!(found.len(), size[0] * size[1]);
            for (at, value) in found.iter().enumerate() {
                let Some(own) = cells.get(&at) else {
                    assert_eq!(*value, -9999.0, "{line}: cell {at} is empty");
                    continue;
                };
                let number = |&i: &usize| match line.contains("intensity") {
                    true => left[i].intensity as f64,
                    false => steps[i][2] as f64 / 100.0,
                };
                let heights = own.iter().map(|&i| steps[i][2]);
                let extreme = match line.contains("lowest") {
                    true => heights.min().unwrap(),
                    false => heights.max().unwrap(),
                };
                let mean = own.iter().map(number).sum::<f64>() / own.len() as f64;
                // Of equally high points any may come first in an index.
                let is_right = match line.contains("mean") {
                    true => (*value as f64 - mean).abs() < 1e-6 * mean.abs().max(1.0),
                    false => own
                        .iter()
                        .filter(|&&i| steps[i][2] == extreme)
                        .any(|i| *value == number(i) as f32),
                };
                assert!(is_right, "{line}: cell {at} is {value}");
            }
        }
    }
}

#[test]
fn counts_and_colors_are_those_of_the_points() {
    let place = Place::new();
    let all = points(5_000);
    let (file, output) = (place.scan(&all), place.at("map.tif"));
    let (_, size, cells) = direct(&whole(&all), 50);
    succeeded(&raster(&file, &output, "--resolution 0.5 --value count"));
    let Some(found) = samples(&output) else { return };
    let counts = found.chunks_exact(4).map(|four| u32::from_le_bytes(four.try_into().unwrap()));
    let expected = (0..size[0] * size[1]).map(|at| cells.get(&at).map_or(0, Vec::len) as u32);
    assert!(counts.eq(expected));
    succeeded(&raster(&file, &output, "--resolution 0.5 --value rgb"));
    let info = gdalinfo(&output).unwrap();
    assert_eq!(info["bands"][3]["colorInterpretation"], "Alpha");
    let found = samples(&output).unwrap();
    for at in 0..size[0] * size[1] {
        let color = [0, 1, 2, 3].map(|band| found[band * size[0] * size[1] + at]);
        let Some(own) = cells.get(&at) else {
            assert_eq!(color, [0; 4]);
            continue;
        };
        let highest = own.iter().map(|&i| all[i].steps[2]).max().unwrap();
        let first = own.iter().find(|&&i| all[i].steps[2] == highest).unwrap();
        let [r, g, b] = all[*first].rgb;
        assert_eq!(color, [r, g, b, 255]);
    }
}

/// GDAL knows cells without points by the value that was asked for.
#[test]
fn gdal_reads_the_value_of_cells_without_points() {
    let place = Place::new();
    let all = points(2_000);
    let (file, output) = (place.scan(&all), place.at("map.tif"));
    let (_, size, cells) = direct(&whole(&all), 25);
    for (line, stored) in [
        ("--no-data nan", f32::NAN),
        ("--no-data -32768", -32768.0),
        ("--no-data 0.1 --pick mean", 0.1),
        ("--no-data -3.4028235e38", f32::MIN),
        ("--value intensity --no-data nan", f32::NAN),
    ] {
        succeeded(&raster(&file, &output, &format!("--resolution 0.25 {line}")));
        let Some(info) = gdalinfo(&output) else { return };
        let found = &info["bands"][0]["noDataValue"];
        let is_stated = match found.as_f64() {
            Some(number) => number as f32 == stored,
            None => stored.is_nan() && found == "NaN",
        };
        assert!(is_stated, "{line}: {found}");
        let found = floats(&samples(&output).unwrap());
        for (at, value) in found.iter().enumerate() {
            let is_empty = value.to_bits() == stored.to_bits();
            assert_eq!(is_empty, !cells.contains_key(&at), "{line}: cell {at} is {value}");
        }
    }
    succeeded(&raster(&file, &output, "--resolution 0.25 --value count --no-data 65535"));
    assert_eq!(gdalinfo(&output).unwrap()["bands"][0]["noDataValue"], 65535.0);
    let found = samples(&output).unwrap();
    let counts = found.chunks_exact(4).map(|four| u32::from_le_bytes(four.try_into().unwrap()));
    let expected = (0..size[0] * size[1]).map(|at| cells.get(&at).map_or(65535, Vec::len) as u32);
    assert!(counts.eq(expected));
    // A value that points have is noted.
    let height = format!("--resolution 0.25 --no-data {}", all[0].steps[2] as f64 / 100.0);
    let said = text(
        &raster(
            &file,
            &output,
            &format!("{height} --only z={0}..{0}", all[0].steps[2] as f64 / 100.0),
        )
        .stderr,
    );
    assert!(said.contains("have the value of those without"), "{said}");
    for (line, code, words) in [
        ("--value count --no-data -1", 1, "whole numbers from 0"),
        ("--value count --no-data nan", 1, "whole numbers from 0"),
        ("--value rgb --no-data 0", 1, "alpha of 0"),
        ("--no-data none", 2, "such as -9999, nor nan"),
        ("--no-data 1e39", 2, "such as -9999, nor nan"),
        ("--no-data inf", 2, "such as -9999, nor nan"),
    ] {
        let said = failed(&raster(&file, &output, &format!("--resolution 0.25 {line}")), code);
        assert!(said.contains(words), "{line}: {said}");
    }
}

/// Returns the standard error of a run that failed; notes may come before the error.
#[track_caller]
fn refused(output: &Output) -> String {
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    said
}

#[test]
fn a_map_between_clusters_far_apart_is_refused_before_it_is_written() {
    let place = Place::new();
    let (file, output) = (place.at("two.csv"), place.at("two.tif"));
    let near = (0..50).map(|k| format!("{},{},{}\n", k % 7, k / 7, k % 3));
    let far = (0..50).map(|k| format!("{},{},5\n", 1_000_000 + k % 7, 1_000_000 + k / 7));
    fs::write(&file, near.chain(far).fold("x,y,z\n".into(), |text: String, row| text + &row))
        .unwrap();
    let said = refused(&raster(&file, &output, "--resolution 0.25"));
    assert!(said.contains("4,000,0") && said.contains("100 points"), "{said}");
    assert!(!output.exists());
    // Both remedies that it names.
    let resolution = said.split("--resolution ").nth(1).unwrap().split(' ').next().unwrap();
    assert_eq!(resolution, "4");
    let said = succeeded(&raster(&file, &output, "--resolution 0.25 --extent 0,0,8,8"));
    assert!(said.contains("32 x 32 cells"), "{said}");
    fs::remove_file(&output).unwrap();
    let said = refused(&raster(&file, &output, "--resolution 3"));
    assert!(said.contains("--resolution 4 all"), "{said}");
}

/// In memory for a few rows the file is the same, byte by byte.
#[test]
fn maps_larger_than_memory_are_the_same() {
    let place = Place::new();
    let file = place.scan(&points(3_000));
    let (once, often) = (place.at("once.tif"), place.at("often.tif"));
    for line in ["", "--value rgb --pick mean", "--extent 500001,5000002,500031.3,5000011"] {
        let line = format!("--resolution 0.05 {line}");
        succeeded(&raster(&file, &once, &line));
        succeeded(&raster(&file, &often, &format!("{line} --memory 200KiB")));
        assert!(fs::read(&once).unwrap() == fs::read(&often).unwrap(), "{line}");
    }
    let corner = [500_001.0, 5_000_011.0];
    check_place(&once, corner, [606, 180], 0.05, "25832");
}

/// A file of real strips, against its own points as the library reads them.
#[test]
fn gdal_reads_the_highest_points_of_a_real_scan() {
    let Some(file) = shared("data/aerial/ign_2strips.laz") else { return };
    let place = Place::new();
    let output = place.at("map.tif");
    succeeded(&raster(&file, &output, "--resolution 0.5"));
    let options = ReadOptions::new(ColumnSet::default(), true);
    let cloud = cloud::read(&[file], &options, &Silent).unwrap();
    let [part] = &cloud.parts[..] else { panic!("one file is one part") };
    let centimetres = |q: [i32; 3]| {
        part.lattice.world(q.map(i64::from)).to_array().map(|v| (v * 100.0).round() as i64)
    };
    let columns = &part.columns;
    let steps: Vec<[i64; 3]> = (0..columns.len())
        .map(|i| centimetres([columns.x[i], columns.y[i], columns.z[i]]))
        .collect();
    let (corner, size, cells) = direct(&steps, 50);
    let at = corner.map(|edge| edge as f64 / 2.0);
    let Some(()) = check_place(&output, at, size, 0.5, "2154") else { return };
    for (at, value) in floats(&samples(&output).unwrap()).into_iter().enumerate() {
        let highest = cells.get(&at).map(|own| own.iter().map(|&i| steps[i][2]).max().unwrap());
        assert_eq!(value, highest.map_or(-9999.0, |z| (z as f64 / 100.0) as f32), "cell {at}");
    }
}

/// Lambert's conic of a state, in feet, which no EPSG number names.
#[test]
fn gdal_knows_a_projection_without_a_number() {
    let Some(file) = shared("data/aerial/autzen_trim.laz") else { return };
    let place = Place::new();
    let output = place.at("map.tif");
    succeeded(&raster(&file, &output, "--resolution 10"));
    let Some(info) = gdalinfo(&output) else { return };
    let wkt = info["coordinateSystem"]["wkt"].as_str().unwrap();
    let parts = [
        "PROJCRS[",
        "Lambert Conic Conformal (2SP)",
        "\"Latitude of 2nd standard parallel\",45.5",
        "\"Easting at false origin\",400000",
        "6378137,298.257222101",
    ];
    parts.iter().for_each(|part| assert!(wkt.contains(part), "no {part} in {wkt}"));
}

/// Writes a file of longitudes and latitudes, and returns its path.
fn in_degrees(place: &Place) -> PathBuf {
    let file = place.at("degrees.las");
    let lattice =
        Lattice { step: DVec3::new(1e-7, 1e-7, 0.01), offset: DVec3::new(11.0, 48.0, 0.0) };
    write(&file, &points(2_000), lattice, &[[1024, 0, 1, 2], [2048, 0, 1, 4326]]);
    file
}

#[test]
fn units_of_positions_are_said_of_files_in_degrees() {
    let place = Place::new();
    let file = in_degrees(&place);
    let index = indexed(&[&file], "");
    for cloud in [&file, &index] {
        let info = pointillist().arg("info").arg(cloud).output().unwrap();
        succeeded(&info);
        let info = text(&info.stdout);
        let line = |what: &str| {
            let found = info.lines().find(|line| line.trim_start().starts_with(what));
            found.unwrap_or_else(|| panic!("no {what} in {info}")).to_string()
        };
        assert!(line("bounds").ends_with(", in metres on a plane"), "{info}");
        let corners = line("in degrees").replace("in degrees", "").replace(" to ", " ");
        let corners: Vec<f64> = corners.split_whitespace().map(|v| v.parse().unwrap()).collect();
        assert!((11.0 - 1e-5..11.0).contains(&corners[0]), "{corners:?}");
        assert!((48.0..48.0 + 1e-5).contains(&corners[1]), "{corners:?}");
        assert!((11.0003..11.0005).contains(&corners[2]), "{corners:?}");
        assert!(line("crs").contains("geographic, in degrees"), "{info}");
        let clip = "--clip box:11,48,0,12,49,1000";
        let drawn = render(cloud, &format!("-o {} {clip}", place.at("clip.png").display()));
        let said = refused(&drawn);
        assert!(said.contains(", in metres on a plane around longitude 11.0"), "{said}");
        let count =
            pointillist().args(["info", "--count"]).args(clip.split(' ')).arg(cloud).output();
        let count = text(&count.unwrap().stdout);
        assert!(count.contains(", in metres on a plane around longitude 11.0"), "{count}");
    }
}

/// Degrees are drawn on a plane, and the map lies in degrees.
#[test]
fn maps_of_degrees_lie_in_degrees() {
    let place = Place::new();
    let file = in_degrees(&place);
    let output = place.at("map.tif");
    succeeded(&raster(&file, &output, "--resolution 0.5"));
    let Some(info) = gdalinfo(&output) else { return };
    assert!(info["coordinateSystem"]["wkt"].as_str().unwrap().contains("ID[\"EPSG\",4326]]"));
    let place = numbers(&info["geoTransform"]);
    let size = numbers(&info["size"]);
    // A metre is 1.340e-5 degrees of longitude at this latitude, and 0.9e-5 of latitude.
    assert!((place[1] / 0.5 - 1.340e-5).abs() < 2e-8 && (place[5] / 0.5 + 0.899e-5).abs() < 2e-8);
    let [west, east] = [place[0], place[0] + size[0] * place[1]];
    let [south, north] = [place[3] + size[1] * place[5], place[3]];
    assert!(
        west <= 11.0 && west > 11.0 - 1e-5 && (11.0004..11.0005).contains(&east),
        "{west} {east}"
    );
    assert!(south <= 48.0 && south > 48.0 - 1e-5 && (48.00025..48.0003).contains(&north));
}

/// Places are in degrees, as in the files, and lengths in metres.
#[test]
fn places_of_degrees_are_in_degrees() {
    let place = Place::new();
    let file = in_degrees(&place);
    let extent = "--extent 11.0001,48.0001,11.0003,48.0002";
    let [raster_map, picture] = ["raster.tif", "picture.tif"].map(|name| place.at(name));
    succeeded(&raster(&file, &raster_map, &format!("--resolution 0.5 {extent}")));
    let line = format!("--view top --resolution 0.5 --no-cache {extent}");
    succeeded(&render(&file, &format!("-o {} {line}", picture.display())));
    let beside = extent.replace("11.", "12.");
    let line = format!("-o {} --view top --resolution 0.5 --no-cache {beside}", picture.display());
    let output = render(&file, &line);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("--extent 12.0001,48.0001,12.0003,48.0002 lies beside"), "{said}");
    let between = |said: &str| {
        let (_, rest) = said.split_once("lie between ").unwrap();
        rest.split([',', ' ']).next().unwrap().parse::<f64>().unwrap()
    };
    assert!((between(&said) - 11.0).abs() < 1e-4, "{said}");
    let csv = place.at("p.csv");
    let profile = |ends: [&str; 2]| {
        let mut command = pointillist();
        command.arg("profile").arg(&file).args(["--from", ends[0], "--to", ends[1]]);
        command.args(["--width", "2m", "-o"]).arg(&csv).output().unwrap()
    };
    let said = succeeded(&profile(["11.0001,48.0001", "11.0003,48.0001"]));
    // A degree of longitude has 74,600 m there.
    assert!(said.contains("14.9") && said.contains("2.000 m wide"), "{said}");
    let table = fs::read_to_string(&csv).unwrap();
    let rows: Vec<Vec<f64>> = table
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|word| word.parse().unwrap_or(f64::NAN)).collect())
        .collect();
    assert!(rows.len() > 20, "{table}");
    for row in rows {
        assert!((11.0001..=11.0003).contains(&row[3]) && (row[4] - 48.0001).abs() < 1e-5);
    }
    let output = profile(["12.0001,48.0001", "12.0003,48.0001"]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!((between(&said) - 11.0).abs() < 1e-4, "{said}");
    for map in [raster_map, picture] {
        let Some(info) = gdalinfo(&map) else { return };
        let (place, size) = (numbers(&info["geoTransform"]), numbers(&info["size"]));
        let [east, south] = [0, 1].map(|k| place[3 * k] + size[k] * place[1 + 4 * k]);
        // Compares to within a cell.
        for (edge, wanted) in
            [(place[0], 11.0001), (east, 11.0003), (south, 48.0001), (place[3], 48.0002)]
        {
            assert!((edge - wanted).abs() < 7e-6, "{edge} {wanted}");
        }
    }
}

/// Single points are drawn in the pixels that they lie in, whole and in pieces.
#[test]
fn pictures_are_maps() {
    let place = Place::new();
    let color = |rgb| Point { steps: [0; 3], intensity: 0, number: 1, of: 1, rgb };
    let few: Vec<Point> = [
        ([3, 3, 0], [250, 0, 0]),
        ([2_512, 812, 300], [0, 250, 0]),
        ([5_099, 1_999, 50], [0, 0, 250]),
    ]
    .map(|(steps, rgb)| Point { steps, ..color(rgb) })
    .into();
    let file = place.scan(&few);
    let line =
        "--view top --style points --effect edl=off --background 000000 --strays show --no-cache";
    let [tif, png, pieces] = ["map.tif", "map.png", "pieces.tif"].map(|name| place.at(name));
    let draw = |output: &Path, more: &str| {
        succeeded(&render(
            &file,
            &format!("-o {} {line} --resolution 0.25 {more}", output.display()),
        ))
    };
    draw(&tif, "");
    draw(&png, "");
    draw(&pieces, "--piece 64");
    let Some(()) = check_place(&tif, [500_000.0, 5_000_020.0], [204, 80], 0.25, "25832") else {
        return;
    };
    let info = gdalinfo(&png).unwrap();
    assert_eq!(numbers(&info["geoTransform"]), [500_000.0, 0.25, 0.0, 5_000_020.0, 0.0, -0.25]);
    let bands = samples(&tif).unwrap();
    assert!(bands == samples(&png).unwrap() && bands == samples(&pieces).unwrap());
    let lit: Vec<[usize; 2]> = (0..204 * 80)
        .filter(|at| (0..3).any(|band| bands[band * 204 * 80 + at] > 100))
        .map(|at| [at % 204, at / 204])
        .collect();
    assert_eq!(lit, [[203, 0], [100, 47], [0, 79]]);
    let extent = place.at("extent.tif");
    draw(&extent, "--extent 500020,5000000,500030,5000010");
    check_place(&extent, [500_020.0, 5_000_010.0], [40, 40], 0.25, "25832");
}

#[test]
fn what_is_no_map_says_why_and_leaves_nothing() {
    let place = Place::new();
    let mut black = points(100);
    black.iter_mut().for_each(|point| point.rgb = [0; 3]);
    let file = place.scan(&black);
    let [tif, png] = ["map.tif", "map.png"].map(|name| place.at(name));
    let draws = |output: &Path, line: &str, code: i32| {
        failed(&render(&file, &format!("-o {} {line}", output.display())), code)
    };
    assert!(draws(&tif, "", 1).contains("--view top and --resolution"));
    assert!(draws(&png, "--resolution 1", 1).contains("--view top"));
    assert!(draws(&png, "--view top --resolution 0", 2).contains("above 0"));
    draws(&png, "--view top --resolution 1 --size 20x20", 2);
    // What is noted before comes from indexing.
    let line = format!("-o {} --view top --resolution 1e-7 --no-cache", png.display());
    let fine = render(&file, &line);
    assert_eq!(fine.status.code(), Some(1));
    assert!(text(&fine.stderr).contains("larger --resolution"), "{}", text(&fine.stderr));
    let fails = |line: &str, code: i32| failed(&raster(&file, &tif, line), code);
    assert!(fails("--resolution 1 --value rgb", 1).contains("attribute"));
    assert!(fails("--resolution 1 --only class=9", 1).contains("leaves none of 100 points"));
    assert!(fails("--resolution 1 --extent 0,0,5,5", 1).contains("--extent"));
    assert!(fails("--resolution 1e-9", 1).contains("larger --resolution"));
    assert!(fails("", 2).contains("--resolution"));
    failed(&raster(&file, &png, "--resolution 1"), 1);
    assert_eq!(names(place.folder.path()), ["scan.laz"]);
    let help = pointillist().args(["raster", "--help"]).output().unwrap();
    assert!(text(&help.stdout).contains("Examples:") && text(&help.stdout).contains("count"));
}

/// A scan in US survey feet, and the same in metres: lengths with a unit are as long in both.
#[test]
fn lengths_with_a_unit_are_as_long_in_files_in_feet() {
    let place = Place::new();
    let foot = 1200.0 / 3937.0;
    let [metric, feet] = ["metres.las", "feet.las"].map(|name| place.at(name));
    let lattice = Lattice { step: DVec3::splat(0.01), offset: DVec3::new(4000.0, 8000.0, 0.0) };
    let scaled = Lattice { step: lattice.step / foot, offset: lattice.offset / foot };
    let all = points(3_000);
    write(&metric, &all, lattice, UTM);
    write(&feet, &all, scaled, &[[1024, 0, 1, 1], [3072, 0, 1, 32767], [3076, 0, 1, 9003]]);
    let draws = |cloud: &Path, line: &str| {
        let output = place.at("drawn.png");
        let said =
            succeeded(&render(cloud, &format!("-o {} --size 200x150 {line}", output.display())));
        (read_png(&output).pixels, said)
    };
    let light = |unit: f64| {
        let [x, y, z] = [4020.0, 8010.0, 90.0].map(|at| at / unit);
        format!("--effect shadows=on,radius=0.5 --light position:{x},{y},{z}")
    };
    let same = |line: &str| [line.to_string(), line.to_string()];
    for [one, other] in [
        same("--point-size 1.5m"),
        same("--point-size 4ft"),
        same("--style points --point-size 4ftUS"),
        same("--style splats --effect splat=on,metres=1.5"),
        same("--effect fill=on,method=mask --layer 2m"),
        same("--effect ao=on,radius=9ft"),
        [light(1.0), light(foot)],
    ] {
        let [(a, _), (b, said)] = [draws(&metric, &one), draws(&feet, &other)];
        assert!(!said.contains("files' unit"), "{said}");
        // Numbers are rounded in another unit.
        let steps = a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| a.abs_diff(*b));
        assert!(steps.max() <= Some(1), "{one}");
    }
    let explained = |cloud: &Path| {
        let said = draws(cloud, "--layer 2m --effect fill=method=mask --explain").1;
        let line = said.lines().find(|line| line.starts_with("spacing:")).unwrap().to_string();
        assert!(said.contains("surfaces are at least 2 m apart"), "{said}");
        line.split("; depths").next().unwrap().to_string()
    };
    assert_eq!(explained(&metric), explained(&feet));
    assert!(
        draws(&feet, "--effect fill=on,method=mask --layer 2").1.contains("which are 0.6096 m")
    );
    let counts = [&metric, &feet].map(|cloud| {
        let [map, thin] = ["map.tif", "thin.las"].map(|name| place.at(name));
        // GDAL does not know a system that has no more than a unit.
        let output = raster(cloud, &map, "--resolution 0.75m");
        let said = succeeded(&output) + &text(&output.stdout);
        let size = said.split(" cells of").next().unwrap().rsplit(": ").next().unwrap().to_string();
        assert!(size.contains(" x "), "{said}");
        let line = ["export", "-o"].map(String::from);
        let line =
            line.into_iter().chain([thin.display().to_string(), cloud.display().to_string()]);
        let said = pointillist().args(line).args(["--thin", "0.75m"]).output().unwrap();
        let thinned = cloud::read(&[thin], &ReadOptions::new(ColumnSet::default(), true), &Silent);
        assert!(!succeeded(&said).contains("files' unit"));
        (thinned.unwrap().len(), size)
    });
    let [(one, size), (other, same)] = counts;
    // Points on edges of cells may be rounded to either side.
    assert!(size == same && one.abs_diff(other) * 200 < one, "{one} {other}");
    let map = place.at("feet.png");
    succeeded(&render(
        &feet,
        &format!("-o {} --view top --resolution 0.5m --no-cache", map.display()),
    ));
    let side: f64 = fs::read_to_string(map.with_extension("pgw"))
        .unwrap()
        .lines()
        .next()
        .unwrap()
        .parse()
        .unwrap();
    assert!((side * foot - 0.5).abs() < 1e-12, "{side}");
}

/// Maps are drawn from an index, so that those of files are those of indexes made of them, however
/// these were made.
#[test]
fn maps_of_an_index_are_those_of_its_files() {
    let place = Place::new();
    let made = place.scan(&points(20_000));
    let files = [Some(made), shared("data/aerial/ign_2strips.laz")];
    for file in files.into_iter().flatten() {
        let copy = place.at("copy.laz");
        fs::copy(&file, &copy).unwrap();
        let index = indexed(&[&copy], "--gps-time --normals --memory 64MiB");
        for (line, ending) in [
            ("--resolution 0.5", "tif"),
            ("--resolution 0.25 --color elevation", "png"),
            ("--resolution 0.3 --style points --only return=last", "tif"),
            ("--resolution 0.1 --piece 128", "tif"),
        ] {
            let bytes = [&file, &index].map(|cloud| {
                let output = place.at("map").with_extension(ending);
                let line = format!("-o {} --view top --no-cache {line}", output.display());
                succeeded(&render(cloud, &line));
                fs::read(output).unwrap()
            });
            assert!(bytes[0] == bytes[1], "{}: {line}", file.display());
        }
    }
}

/// Nothing is drawn over what lies below a map, unless a background is asked for.
#[test]
fn maps_are_transparent_where_nothing_is_drawn() {
    let place = Place::new();
    let color = |steps, rgb| Point { steps, intensity: 0, number: 1, of: 1, rgb };
    let file = place.scan(&[
        color([3, 3, 0], [250, 0, 0]),
        color([2_512, 812, 300], [10, 250, 30]),
        color([5_099, 1_999, 50], [0, 0, 250]),
    ]);
    let [tif, png] = ["map.tif", "map.png"].map(|name| place.at(name));
    let draw = |output: &Path, more: &str| {
        let line = "--view top --style points --effect edl=off --strays show --no-cache";
        succeeded(&render(
            &file,
            &format!("-o {} {line} --resolution 0.25 {more}", output.display()),
        ))
    };
    draw(&tif, "");
    draw(&png, "");
    for map in [&tif, &png] {
        let Some(info) = gdalinfo(map) else { return };
        let bands = info["bands"].as_array().unwrap();
        let meant: Vec<_> = bands.iter().map(|band| band["colorInterpretation"].as_str()).collect();
        assert_eq!(meant, ["Red", "Green", "Blue", "Alpha"].map(Some));
        // Transparency by alpha, not by a value or a mask of its own.
        assert_eq!(bands[0]["mask"]["flags"], serde_json::json!(["PER_DATASET", "ALPHA"]));
    }
    let bands = samples(&tif).unwrap();
    assert!(bands == samples(&png).unwrap());
    let pixel = |at: usize| [0, 1, 2, 3].map(|band| bands[band * 204 * 80 + at]);
    let drawn: Vec<_> = (0..204 * 80).map(pixel).filter(|pixel| *pixel != [0; 4]).collect();
    assert_eq!(drawn, [[0, 0, 250, 255], [10, 250, 30, 255], [250, 0, 0, 255]]);
    draw(&tif, "--background 0a0b0c");
    assert_eq!(gdalinfo(&tif).unwrap()["bands"].as_array().unwrap().len(), 3);
    // Edges that are softened are as transparent as they are, and as bright as what they show.
    draw(&tif, "--point-size 3 --effect antialias=on");
    let bands = samples(&tif).unwrap();
    let pixel = |at: usize| [0, 1, 2, 3].map(|band| bands[band * 204 * 80 + at]);
    assert!((0..204 * 80).map(pixel).all(|pixel| pixel[3] > 0 || pixel == [0; 4]));
    // What a user asks for over a picture is drawn over it; a GeoTIFF has the map's pixels alone.
    draw(&png, "--scale-bar --legend");
    let bands = samples(&png).unwrap();
    let opaque = bands[3 * 204 * 80..].iter().filter(|alpha| **alpha > 0).count();
    assert!(opaque > 100, "{opaque}");
    for over in ["--scale-bar", "--legend", "--title T", "--axes", "--north-arrow"] {
        let output = place.at("no.tif");
        let line = format!("-o {} --view top --resolution 0.25 {over}", output.display());
        assert!(failed(&render(&file, &line), 1).contains("a GeoTIFF has pixels of the map alone"));
        assert!(!output.exists());
    }
}
