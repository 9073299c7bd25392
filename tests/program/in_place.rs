//! COPC files drawn in place: pictures of the file if everything is drawn, otherwise of the nodes
//! that the view needs; what their nodes cannot tell is indexed as before.

use crate::files::scan;
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
    /// A scan of this many points, as COPC.
    fn new(points: u64) -> Place {
        let place = Place { folder: tempfile::tempdir().unwrap() };
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
    let whole = place.render(file, &format!("{POINTS} {line} -o @whole.png --explain=json"));
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
