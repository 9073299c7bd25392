//! Shadows saved beside an index: the same as those cast from all of its points, in any memory; and
//! refused if they do not belong.

use crate::commands::run;
use crate::files::scan;
use crate::png_file::read_png;
use crate::program::{failed, pointillist, succeeded};
use pointillist::index::format::Index;
use pointillist::synth::SceneKind;
use serde_json::Value;
use std::path::PathBuf;
use std::process::Output;

/// A scan, its index, and files made of them.
struct Place {
    folder: tempfile::TempDir,
}

const LIGHT: &str = "--light direction:0.3,0.8,-0.8";
const CAST: &str = "samples=6,radius=3,size=500";

impl Place {
    fn new(points: u64) -> Place {
        let place = Place { folder: tempfile::tempdir().unwrap() };
        scan(&place.at("street.las"), SceneKind::Street, points);
        succeeded(&place.run("index @street.las -o @street.pnti"));
        place
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn run(&self, line: &str) -> Output {
        run(line.replace('@', &format!("{}/", self.folder.path().display())).split_whitespace())
    }

    fn cast(&self, name: &str, line: &str) -> String {
        succeeded(&self.run(&format!(
            "shadows @street.pnti -o @{name} {LIGHT} --effect shadows={CAST} {line}"
        )))
    }

    fn explained(&self, line: &str) -> Value {
        let output = self.run(&format!("render @street.pnti --size 320x200 {line} --explain=json"));
        succeeded(&output);
        serde_json::from_slice(&output.stdout).unwrap()
    }
}

fn casts(explained: &Value) -> bool {
    explained["passes"]
        .as_array()
        .unwrap()
        .iter()
        .any(|pass| pass == "shadow_test" || pass == "shadow_depth_limit")
}

#[test]
fn saved_shadows_are_those_of_all_points_and_nothing_is_cast_any_more() {
    let place = Place::new(400_000);
    place.cast("a.shadows", "");
    let all = "--lod 0 --point-budget 1000000";
    let cast = place.explained(&format!("-o @cast.png {all} {LIGHT} --effect shadows=on,{CAST}"));
    let saved = place.explained(&format!("-o @saved.png {all} {LIGHT} --shadows @a.shadows"));
    assert!(casts(&cast) && !casts(&saved), "{saved}");
    assert_eq!(
        (&saved["shadows"]["saved"], &saved["shadows"]["samples"]),
        (&Value::from(true), &Value::from(6))
    );
    assert_eq!(saved["shadows"]["layer_m"], cast["shadows"]["layer_m"]);
    let [cast, saved, none] = ["cast", "saved", "none"].map(|name| {
        if name == "none" {
            place.explained(&format!("-o @none.png {all} {LIGHT}"));
        }
        read_png(&place.at(&format!("{name}.png")))
    });
    assert!(cast.pixels == saved.pixels && cast.pixels != none.pixels);
    // A direction has no length; and settings of casting change nothing but how dark shadows are.
    let note = |line: &str| {
        let said = succeeded(&place.run(&format!(
            "render @street.pnti --size 320x200 -o @again.png {all} --shadows @a.shadows {line}"
        )));
        (said, read_png(&place.at("again.png")).pixels == saved.pixels)
    };
    let (quiet, same) = note("--light direction:0.6,1.6,-1.6");
    assert!(!quiet.contains("note:") && same, "{quiet}");
    let (said, same) = note(&format!("{LIGHT} --effect shadows=on,samples=16,radius=20"));
    assert!(said.contains("note: saved shadows ignore samples and radius;") && same, "{said}");
    for line in ["shadows=on,ambient=0.1 --effect phong=off", "phong=on,ambient=0.1"] {
        let (said, same) = note(&format!("{LIGHT} --effect {line}"));
        assert!(!said.contains("note:") && !same, "{said}");
    }
    let (said, _) = note(&format!("{LIGHT} --clip outside:499998,5000020,90,500002,5000030,110"));
    assert!(
        said.contains("note: saved shadows include points that --opacity or --clip remove"),
        "{said}"
    );
    // A coarse picture has them, too.
    let coarse = place.explained(&format!("-o @coarse.png --lod 8 {LIGHT} --shadows @a.shadows"));
    assert!(!casts(&coarse) && coarse["shadows"]["saved"] == true, "{coarse}");

    // With very little memory.
    let said = place.cast("b.shadows", "--gpu-memory 3MiB");
    assert!(said.contains("read 12 times"), "{said}");
    assert!(
        std::fs::read(place.at("a.shadows")).unwrap()
            == std::fs::read(place.at("b.shadows")).unwrap()
    );
}

#[test]
fn samples_of_inner_nodes_have_the_mean_of_the_points_that_they_stand_for() {
    let place = Place::new(300_000);
    place.cast("a.shadows", "");
    let index = Index::open(&place.at("street.pnti")).unwrap();
    let marks = index.open_shadows(&place.at("a.shadows")).unwrap();
    let sums: Vec<(f64, f64)> = (0..index.nodes().len())
        .map(|node| {
            let mut own = vec![0; index.nodes()[node].count as usize];
            marks.read(node, &mut own).unwrap();
            let weights = index.samples(node).unwrap();
            let sum = own
                .iter()
                .zip(&weights)
                .map(|(&mark, (_, weight))| mark as f64 * *weight as f64)
                .sum();
            (sum, weights.iter().map(|(_, weight)| *weight as f64).sum())
        })
        .collect();
    let (mut inner, mut between) = (0, false);
    for (node, record) in index.nodes().iter().enumerate().filter(|(_, record)| !record.is_leaf()) {
        let below = record
            .children()
            .map(|child| sums[child])
            .fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        let (own, all) = sums[node];
        assert_eq!(all, below.1);
        // Each is rounded once.
        assert!((own - below.0).abs() <= 0.5 * all, "node {node}: {own} of {below:?}");
        inner += 1;
        between |= own > 0.0 && own < marks.contents.full as f64 * all;
    }
    assert!(inner > 0 && between);
}

/// Its bytes do not depend on the memory that it was built in.
#[test]
fn shadows_belong_to_an_index_that_was_built_again_in_other_memory() {
    // More than 64 MiB of records.
    let place = Place::new(4_000_000);
    let line = "--effect shadows=samples=1,size=200";
    succeeded(&place.run(&format!("shadows @street.pnti -o @a.shadows {LIGHT} {line}")));
    let draw = |name: &str| {
        let explained = place.explained(&format!("-o @{name} {LIGHT} --shadows @a.shadows"));
        assert_eq!(explained["shadows"]["saved"], true);
        std::fs::read(place.at(name)).unwrap()
    };
    let before = draw("before.png");
    std::fs::remove_file(place.at("street.pnti")).unwrap();
    succeeded(&place.run("index @street.las -o @street.pnti --memory 64MiB"));
    assert!(draw("after.png") == before);
}

#[test]
fn shadows_of_another_cloud_or_light_are_refused_and_damaged_ones_are_said() {
    let place = Place::new(200_000);
    place.cast("a.shadows", "");
    let render = |line: &str| place.run(&format!("render --size 64x64 -o @a.png {line}"));
    let said = failed(&render("@street.pnti --shadows @a.shadows"), 1);
    assert!(said.contains("a.shadows has shadows of --light direction:0.3,0.8,-0.8, but the picture's light is headlight"), "{said}");
    let said = failed(&render(&format!("@street.las --shadows @a.shadows {LIGHT}")), 1);
    assert!(said.contains("the input is not one"), "{said}");
    let said = failed(&render(&format!("@street.pnti --shadows @street.las {LIGHT}")), 1);
    assert!(said.contains("is not a shadow file") && !said.contains("street.las`"), "{said}");
    let scan_before = std::fs::read(place.at("street.las")).unwrap();
    let said = failed(&place.run(&format!("shadows @street.pnti -o @street.las {LIGHT}")), 1);
    assert!(
        said.contains("exists and is not a shadow file; choose another name with -o"),
        "{said}"
    );
    assert!(std::fs::read(place.at("street.las")).unwrap() == scan_before);
    scan(&place.at("other.las"), SceneKind::Plane, 200_000);
    succeeded(&place.run("index @other.las -o @other.pnti"));
    let said = failed(&render(&format!("@other.pnti --shadows @a.shadows {LIGHT}")), 1);
    assert!(said.contains("has shadows of another cloud than"), "{said}");

    let whole = std::fs::read(place.at("a.shadows")).unwrap();
    for length in [0, 100, 4096, whole.len() - 1] {
        std::fs::write(place.at("b.shadows"), &whole[..length]).unwrap();
        failed(&render(&format!("@street.pnti --shadows @b.shadows {LIGHT}")), 1);
    }
    // The last node is a leaf.
    let end_of_marks = u64::from_le_bytes(whole[32..40].try_into().unwrap()) as usize;
    for (at, line) in [(20, 1), (whole.len() - 2, 1), (end_of_marks - 5, 0)] {
        let mut damaged = whole.clone();
        damaged[at] ^= 1;
        std::fs::write(place.at("b.shadows"), &damaged).unwrap();
        let output = render(&format!("@street.pnti --lod 0 --shadows @b.shadows {LIGHT}"));
        match line {
            1 => drop(failed(&output, 1)),
            _ => assert!(succeeded(&output).contains("damaged"), "byte {at}"),
        }
    }
    let said = failed(&place.run("shadows @street.las -o @c.shadows"), 1);
    assert!(said.contains("pointillist index"), "{said}");
    let said = failed(
        &place.run(&format!("shadows @street.pnti -o @c.shadows {LIGHT} --effect edl=on")),
        2,
    );
    assert!(
        said.contains("only settings of shadows apply") && !place.at("c.shadows").exists(),
        "{said}"
    );
    assert!(pointillist().arg("shadows").output().unwrap().status.code() == Some(2));
}
