//! COPC, Potree 2 and EPT drawn in place: pictures of the file if everything is drawn, otherwise of
//! the nodes that the view needs; what their nodes cannot tell is indexed as before.

use crate::files::scan;
use crate::octree_files::{KINDS, Kind, records, write, write_laz};
use crate::png_file::read_png;
use crate::program::{failed, pointillist, render, succeeded};
use crate::shared::shared;
use pointillist::synth::SceneKind;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Output;

struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn empty() -> Place {
        Place { folder: tempfile::tempdir().unwrap() }
    }

    /// A scan of this many points, as COPC.
    fn new(points: u64) -> Place {
        let place = Place::empty();
        scan(&place.at("street.las"), SceneKind::Street, points);
        place.export(&place.at("street.las"), "street.copc.laz");
        place
    }

    fn export(&self, file: &Path, name: &str) {
        let export = pointillist().arg("export").arg(file).arg("-o").arg(self.at(name)).output();
        succeeded(&export.unwrap());
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn render(&self, file: &Path, line: &str) -> Output {
        let line = format!("{line} --cache-dir @cache");
        render(file, &line.replace('@', &format!("{}/", self.folder.path().display())))
    }
}

/// Without `exposure` and `luminance`, which need stations.
const POINTS: &str =
    "--style points --effect edl=off --effect exposure=off --effect luminance=off --size 480x270";
const ALL: &str = "--lod 0 --point-budget 100000000";

fn explained(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Checks that the picture of all nodes is that of the whole file.
fn check_whole(place: &Place, file: &Path, line: &str) {
    check_same(place, file, file, line);
}

/// Checks that the picture of all nodes is that of another file, drawn whole.
fn check_same(place: &Place, other: &Path, file: &Path, line: &str) {
    let whole = place.render(other, &format!("{POINTS} {line} -o @whole.png --explain=json"));
    assert!(!succeeded(&whole).contains("in place"));
    // The root's points are framed a little otherwise than all.
    std::fs::write(place.at("camera.json"), explained(&whole)["camera"].to_string()).unwrap();
    let line = line.replace("--view top", "");
    let line = format!("{POINTS} {line} {ALL} --camera @camera.json -o @nodes.png");
    let said = succeeded(&place.render(file, &line));
    assert!(said.contains("drawn in place"), "{said}");
    let [whole, nodes] = ["whole.png", "nodes.png"].map(|name| read_png(&place.at(name)));
    assert!(
        whole.pixels.iter().filter(|pixel| **pixel != whole.pixels[0]).count() > 1000,
        "{line}"
    );
    // Nodes have other origins, so f32 arithmetic may round a point into the neighbouring pixel.
    let differ = whole.pixels.iter().zip(&nodes.pixels).filter(|(a, b)| a != b).count();
    assert!(differ < whole.pixels.len() / 1000, "{line}: {differ} pixels differ");
}

#[test]
fn a_copc_file_drawn_to_its_last_node_is_the_picture_of_the_file() {
    let place = Place::new(300_000);
    for line in [
        "--color rgb",
        "--color class --view top",
        "--color return",
        "--color rgb --only class=2",
        "--color rgb --where z=..105",
    ] {
        check_whole(&place, &place.at("street.copc.laz"), line);
    }
    assert!(!place.at("cache").exists());
    let line = format!("{POINTS} --lod 8 -o @a.png");
    let said = succeeded(&place.render(&place.at("street.copc.laz"), &line));
    assert!(said.contains("several point source ids"), "{said}");
    let Some(file) = shared("data/aerial/lone-star.copc.laz") else { return };
    check_whole(&place, &file, "--color class");
    let Some(file) = shared("data/aerial/autzen_trim.laz") else { return };
    place.export(&file, "autzen.copc.laz");
    check_whole(&place, &place.at("autzen.copc.laz"), "--color rgb");
}

#[test]
fn maps_of_a_copc_file_are_those_of_its_index() {
    let place = Place::new(100_000);
    let file = place.at("street.copc.laz");
    let index =
        pointillist().arg("index").arg(&file).arg("-o").arg(place.at("street.pnti")).output();
    succeeded(&index.unwrap());
    let line = "--view top --resolution 0.5 --color rgb -o";
    let said = succeeded(&place.render(&file, &format!("{line} @file.tif")));
    assert!(!said.contains("in place"), "{said}");
    succeeded(&place.render(&place.at("street.pnti"), &format!("{line} @index.tif")));
    let [file, index] =
        ["file.tif", "index.tif"].map(|name| std::fs::read(place.at(name)).unwrap());
    assert!(file == index);
}

#[test]
fn a_coarse_picture_reads_few_bytes_of_a_copc_file() {
    let place = Place::new(1_000_000);
    let file = place.at("street.copc.laz");
    let read = |line: &str| {
        let output = place.render(&file, &format!("{POINTS} {line} -o @a.png --explain=json"));
        assert!(succeeded(&output).contains("drawn in place"));
        let index = explained(&output)["index"].clone();
        [index["bytes_read"].as_u64().unwrap(), index["index_bytes"].as_u64().unwrap()]
    };
    let [all, bytes] = read(ALL);
    let [coarse, _] = read("--lod 1000");
    assert_eq!(bytes, std::fs::metadata(&file).unwrap().len());
    assert!(all <= bytes && all > bytes / 2 && coarse < bytes / 4, "{coarse} {all} {bytes}");
    let [near, _] = read("--lod 0 --point-budget 300000");
    assert!(near < bytes * 6 / 10, "{near} {bytes}");
}

#[test]
fn what_nodes_cannot_tell_is_indexed_first() {
    let place = Place::new(300_000);
    let file = place.at("street.copc.laz");
    for line in ["--color source", "--color rgb --only source=1", "--color scan-angle"] {
        let said = succeeded(&place.render(&file, &format!("{POINTS} {line} --lod 4 -o @a.png")));
        // All three may be drawn from one index.
        let is_indexed = said.contains("indexed in") || said.contains("drawn from");
        assert!(is_indexed && !said.contains("in place"), "{line}: {said}");
    }
}

#[test]
fn an_octree_that_lies_is_said_and_its_points_are_drawn() {
    let place = Place::new(300_000);
    let mut bytes = std::fs::read(place.at("street.copc.laz")).unwrap();
    let list = u64::from_le_bytes(bytes[469..477].try_into().unwrap()) as usize;
    bytes[list + 28] ^= 1;
    std::fs::write(place.at("lies.copc.laz"), bytes).unwrap();
    let line = format!("{POINTS} {ALL} -o @lies.png");
    let said = succeeded(&place.render(&place.at("lies.copc.laz"), &line));
    assert!(said.contains("claims") && said.contains("indexed instead"), "{said}");
    let refused = failed(&place.render(&place.at("lies.copc.laz"), &format!("{line} --strict")), 1);
    assert!(refused.contains("claims") && refused.contains(&list.to_string()), "{refused}");
}

/// Returns points of a hill, with all attributes.
fn hill(points: i32) -> Vec<[u8; 36]> {
    let point = |i: i32| {
        let [x, y] = [i.wrapping_mul(7919), i.wrapping_mul(104_729)].map(|v| v.rem_euclid(100_003));
        let z = 20_000.0 + 9000.0 * (x as f64 / 16_000.0).sin() * (y as f64 / 13_000.0).cos();
        ([x, y, z as i32], [(x >> 9) as u8, (y >> 9) as u8, 90])
    };
    let (at, rgb): (Vec<_>, Vec<_>) = (0..points).map(point).unzip();
    records(&at, &rgb)
}

#[test]
fn potree_and_ept_are_drawn_as_their_own_laz_is() {
    let place = Place::empty();
    let (records, laz) = (hill(60_000), place.at("hill.laz"));
    write_laz(&laz, &records);
    for kind in KINDS {
        let folder = place.at(&format!("{kind:?}"));
        write(kind, &folder, &records);
        check_same(&place, &laz, &folder, "--color rgb");
    }
    check_same(&place, &laz, &place.at("PotreeBrotli/metadata.json"), "--color class --view top");
    check_same(&place, &laz, &place.at("EptLaszip/ept.json"), "--color return --only class=2..9");
    let line = format!("{POINTS} --color source --lod 4 -o @a.png");
    let said = succeeded(&place.render(&place.at("EptBinary"), &line));
    assert!(said.contains("indexed in") && !said.contains("in place"), "{said}");
    let said = succeeded(&place.render(&place.at("EptBinary"), &line));
    assert!(said.contains("drawn from"), "{said}");
}

#[test]
fn potree_and_ept_are_inputs_of_all_commands() {
    let place = Place::empty();
    let (records, laz) = (hill(20_000), place.at("hill.laz"));
    write_laz(&laz, &records);
    let run = |words: &[&str]| {
        let output = pointillist().current_dir(place.folder.path()).args(words).output().unwrap();
        (succeeded(&output), output.stdout)
    };
    let told = |file: &str| -> Value {
        let mut told: Value = serde_json::from_slice(&run(&["info", file, "--json"]).1).unwrap();
        let part = told["parts"][0].take();
        let same = ["points", "bounds", "attributes", "step"].map(|what| part[what].clone());
        same.into()
    };
    for kind in [Kind::PotreeBrotli, Kind::EptBinary] {
        let name = format!("{kind:?}");
        write(kind, &place.at(&name), &records);
        assert_eq!(told(&name), told("hill.laz"));
        run(&["export", &name, "-o", "a.laz"]);
        assert_eq!(told("a.laz"), told("hill.laz"));
        run(&["index", &name, "-o", "a.pnti"]);
        let said = String::from_utf8(run(&["info", "a.pnti"]).1).unwrap();
        assert!(said.contains("20000") && said.contains(&name), "{said}");
    }
    let said = failed(&pointillist().arg("info").arg(place.folder.path()).output().unwrap(), 1);
    assert!(said.contains("without metadata.json"), "{said}");
}
