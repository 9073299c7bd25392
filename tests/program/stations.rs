//! An index stores the exposures of its stations: bit-identical to those of its files in memory,
//! for any number of files and any lattices.

use crate::files::scan;
use crate::png_file::read_png;
use crate::program::{pointillist, succeeded};
use pointillist::cloud::attribute::{Attribute, DisplayAttribute};
use pointillist::cloud::table::TextOptions;
use pointillist::cloud::{self, ColumnSet, ReadOptions};
use pointillist::index::attributes::exposure;
use pointillist::index::build::{self, DerivedPlanes, Options};
use pointillist::index::format::{Index, Plane};
use pointillist::progress::Silent;
use pointillist::synth::SceneKind;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

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

/// Sizes in LAS 1.2, point format 3, as `synth` writes it: bytes before the points, of a point, and
/// before its source.
const HEAD: usize = 227;
const RECORD: usize = 34;
const SOURCE: usize = 18;

/// Writes a file for every station, each `apart` metres further along, which is not a whole number
/// of steps.
fn split(file: &Path, apart: f64) -> Vec<PathBuf> {
    let bytes = fs::read(file).unwrap();
    let (head, records) = bytes.split_at(HEAD);
    let source = |record: &[u8]| u16::from_le_bytes([record[SOURCE], record[SOURCE + 1]]);
    let stations: BTreeSet<u16> = records.chunks_exact(RECORD).map(source).collect();
    let write = |(number, station): (usize, u16)| {
        let own: Vec<u8> = records
            .chunks_exact(RECORD)
            .filter(|record| source(record) == station)
            .flatten()
            .copied()
            .collect();
        let mut head = head.to_vec();
        head[107..111].copy_from_slice(&((own.len() / RECORD) as u32).to_le_bytes());
        // Offset, highest and lowest along x.
        for at in [155, 179, 187] {
            let moved =
                f64::from_le_bytes(head[at..at + 8].try_into().unwrap()) + apart * number as f64;
            head[at..at + 8].copy_from_slice(&moved.to_le_bytes());
        }
        let path = file.with_file_name(format!("{station}.las"));
        fs::write(&path, [head, own].concat()).unwrap();
        path
    };
    stations.into_iter().enumerate().map(write).collect()
}

/// Returns the exposures of an index and of its files.
fn same(files: &[PathBuf], options: &Options) -> (Index, Vec<f64>) {
    let path = files[0].with_file_name("a.pnti");
    build::build(files, &path, options, &Silent).unwrap_or_else(|error| panic!("{error}"));
    let index = Index::open(&path).unwrap();
    let cloud = cloud::read(files, &READ, &Silent).unwrap();
    let found = exposure::balance(&cloud).unwrap();
    assert_eq!(index.directory.contents.balance, Some(found.clone()), "{} files", files.len());
    assert_eq!(index.directory.contents.stations, cloud.stations);
    let [_, full] = DisplayAttribute::new(Attribute::Intensity, &cloud).stretch;
    assert_eq!(index.directory.contents.intensity_stretch[1], full);
    let intensities = exposure::balance_of(&cloud, &exposure::Values::of_intensities(full));
    assert_eq!(index.directory.contents.intensity_balance, intensities);
    (index, found.gains)
}

#[test]
fn exposures_of_an_index_are_those_of_its_files() {
    let folder = tempfile::tempdir().unwrap();
    let street = folder.path().join("street.las");
    scan(&street, SceneKind::Street, 300_000);
    let (index, one) = same(std::slice::from_ref(&street), &OPTIONS);
    assert!(one.len() == 5 && one.iter().any(|gain| (gain - 1.0).abs() > 0.1), "{one:?}");
    let bytes = fs::read(index.path()).unwrap();
    for threads in [1, 3] {
        same(std::slice::from_ref(&street), &Options { threads, ..OPTIONS });
        assert!(fs::read(index.path()).unwrap() == bytes, "{threads} threads");
    }
    let lattices = |index: &Index| {
        index
            .nodes()
            .iter()
            .filter(|node| node.is_leaf())
            .map(|node| node.lattice)
            .collect::<BTreeSet<_>>()
            .len()
    };
    for (apart, trees) in [(0.0, 1), (0.00037, 5)] {
        let files = split(&street, apart);
        let (index, several) = same(&files, &OPTIONS);
        assert_eq!((lattices(&index), index.directory.roots), (trees, 1));
        assert!(one.iter().zip(&several).all(|(a, b)| (a - b).abs() < 0.02), "{one:?} {several:?}");
        // Not in the order of their stations, and one without a source.
        let mixed = [&files[3], &files[1], &files[4], &files[1]].map(Clone::clone);
        same(&mixed, &OPTIONS);
    }
}

#[test]
fn of_more_points_than_are_looked_at_an_index_takes_the_same_as_a_cloud_in_memory() {
    let folder = tempfile::tempdir().unwrap();
    let street = folder.path().join("street.las");
    scan(&street, SceneKind::Street, 3_000_000);
    let (_, one) = same(std::slice::from_ref(&street), &Options { memory: 24 << 20, ..OPTIONS });
    let (_, several) =
        same(&split(&street, 0.00037), &Options { memory: 24 << 20, threads: 3, ..OPTIONS });
    assert!(one.iter().zip(&several).all(|(a, b)| (a - b).abs() < 0.02), "{one:?} {several:?}");
}

#[test]
fn one_station_has_no_exposures_and_those_of_an_index_without_any_are_not_evened() {
    let folder = tempfile::tempdir().unwrap();
    let street = folder.path().join("street.las");
    scan(&street, SceneKind::Street, 100_000);
    let alone = split(&street, 0.0).swap_remove(2);
    let path = folder.path().join("a.pnti");
    build::build(&[alone], &path, &OPTIONS, &Silent).unwrap();
    let index = Index::open(&path).unwrap();
    assert_eq!(
        (index.directory.contents.stations.len(), &index.directory.contents.balance),
        (1, &None)
    );
    let without = Options { wanted: ColumnSet { rgb: false, ..ColumnSet::ALL }, ..OPTIONS };
    build::build(&[street], &path, &without, &Silent).unwrap();
    let index = Index::open(&path).unwrap();
    assert_eq!(
        (index.directory.contents.stations.len(), &index.directory.contents.balance),
        (5, &None)
    );
}

/// Tiles that lie apart, as most files of a site do.
#[test]
fn a_node_takes_as_few_bytes_as_it_may_to_say_which_stations_have_seen_it() {
    let folder = tempfile::tempdir().unwrap();
    let street = folder.path().join("street.las");
    scan(&street, SceneKind::Street, 600_000);
    let (files, path) = (split(&street, 1000.0), folder.path().join("tiles.pnti"));
    build::build(&files, &path, &OPTIONS, &Silent).unwrap();
    let index = Index::open(&path).unwrap();
    let mut seen = [0; 5];
    for (node, record) in index.nodes().iter().enumerate().filter(|(_, record)| record.is_leaf()) {
        let mut stations = vec![255; record.unpacked_bytes(Plane::Station) as usize];
        index.read(node, Plane::Station, &mut stations).unwrap();
        stations.iter().for_each(|&station| seen[station as usize] += 1);
        let one = stations.iter().all(|station| *station == stations[0]);
        assert_eq!(record.single_station().is_some(), one);
        assert_eq!(
            record.range(Plane::Station).1,
            if one { 0 } else { (record.count as u64).div_ceil(2) }
        );
    }
    let read = cloud::read(&files, &READ, &Silent).unwrap();
    assert_eq!(seen.to_vec(), read.parts.iter().map(|part| part.columns.len()).collect::<Vec<_>>());
    assert!(index.nodes().iter().filter(|record| record.single_station().is_some()).count() >= 5);

    // Stations are shown alike.
    let picture = |name: &str, cloud: &[PathBuf]| {
        let to = folder.path().join(name);
        let line = [
            "--color", "source", "--style", "points", "--view", "top", "--size", "320x180",
            "--lod", "0.01", "-o",
        ];
        succeeded(&pointillist().arg("render").args(cloud).args(line).arg(&to).output().unwrap());
        read_png(&to).pixels
    };
    let [of_files, of_index] =
        [picture("files.png", &files), picture("index.png", std::slice::from_ref(&path))];
    let other = of_files.iter().zip(&of_index).filter(|(a, b)| a != b).count();
    assert!(other <= 3, "{other} pixels");
}
