//! `tune`, and pictures for a time or an error.

use crate::files::scan;
use crate::program::{failed, pointillist, succeeded, text};
use pointillist::synth::SceneKind;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Output;

/// A folder with a scan, and with a cache of its own.
struct Place(tempfile::TempDir);

impl Place {
    fn new(points: u64) -> Place {
        let place = Place(tempfile::tempdir().unwrap());
        scan(&place.at("street.las"), SceneKind::Street, points);
        place
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Runs a command line in the folder.
    fn run(&self, line: &str) -> Output {
        let mut command = pointillist();
        command.args(line.split_whitespace()).args(["--cache-dir", "cache"]);
        command.current_dir(self.0.path()).output().unwrap()
    }

    fn explained(&self, line: &str) -> Value {
        let output = self.run(&format!("{line} --explain=json"));
        succeeded(&output);
        serde_json::from_slice(&output.stdout).unwrap()
    }

    fn json(&self, path: &Path) -> Value {
        serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
    }
}

#[test]
fn a_tuned_cloud_is_drawn_in_a_time_and_with_an_error() {
    let place = Place::new(60_000);
    let tuned = place.run("tune street.las --quick -o front.html -o front.json");
    let said = succeeded(&tuned);
    assert!(said.contains("kept: "), "{said}");
    let table = text(&tuned.stdout);
    for word in ["the default", "the finest", "px", "depth %", "rounds on"] {
        assert!(table.contains(word), "{word} is missing in {table}");
    }
    let chart = std::fs::read_to_string(place.at("front.html")).unwrap();
    assert!(chart.contains("<figure") && chart.contains("the default"));

    // The fastest first; nothing is both slower and worse than another in both errors: at rest, or
    // while it moves.
    let front = place.json(&place.at("front.json"));
    let settings = front["tuned"].as_array().unwrap();
    assert!(settings.len() >= 3, "{settings:?}");
    let ms: Vec<f64> = settings.iter().map(|own| own["ms"][1].as_f64().unwrap()).collect();
    assert!(ms.is_sorted() && ms[0] > 0.0, "{ms:?}");
    let error = |own: &Value, kind: &str, name: &str| own[kind][name].as_f64().unwrap();
    let named = |own: &Value| {
        own["values"].as_array().unwrap().is_empty() || error(own, "mean", "px") == 0.0
    };
    let is_small = |own: &Value| own["values"].to_string().contains("resolution=");
    for (place, own) in settings.iter().enumerate().filter(|(_, own)| !named(own)) {
        let is_beaten = |kind: &str| {
            let beats = |other: &&Value| {
                ["px", "depth"]
                    .iter()
                    .all(|name| error(other, kind, name) <= error(own, kind, name))
            };
            let mut others =
                settings[..place].iter().filter(|other| kind != "mean" || !is_small(other));
            others.any(|other| beats(&other))
        };
        assert!(!is_beaten("moving") || (!is_small(own) && !is_beaten("mean")), "{own} is beaten");
    }

    // A time that everything fits gets a picture without an error, one that nothing fits says so.
    let picture = "render street.las --size 384x216 -o";
    let chosen = |line: &str| place.explained(&format!("{picture} {line}"))["chosen"].clone();
    let finest = chosen("fine.png --time 100s");
    assert_eq!(finest["got"]["mean"]["px"], 0.0, "{finest}");
    assert_eq!(finest["front"], "the front of this cloud on this device");
    let fastest = chosen("fast.png --time 0.001ms");
    assert_eq!(fastest["keeps"], false);
    assert!(fastest["got"]["mean"]["px"].as_f64() > Some(0.0), "{fastest}");
    let bytes = |name: &str| std::fs::read(place.at(name)).unwrap();
    assert!(bytes("fine.png") != bytes("fast.png"));

    // An error gets the fastest setting that held it in every view.
    let allowed = 0.5;
    let held = chosen(&format!("held.png --error {allowed}px"));
    let holds = |own: &&Value| own["most"]["px"].as_f64().unwrap() <= allowed;
    let most = held["expected"]["most"]["px"].as_f64().unwrap();
    assert!(most <= allowed && settings.iter().any(|own| holds(&own)), "{held}");
    assert!(held["got"]["ms"].as_f64() > Some(0.0));

    // Both columns.
    for option in ["--timings", "--explain"] {
        let said = succeeded(&place.run(&format!("{picture} a.png --error 0.2% {option}")));
        for word in ["note: --error 0.2%: ", "expected       got", "device time", "error of depth"]
        {
            assert!(said.contains(word), "{word} is missing in {said}");
        }
    }
}

#[test]
fn without_a_front_of_the_device_the_programs_own_is_used_and_said() {
    let place = Place::new(20_000);
    let line = "render street.las -o a.png --size 160x90 --time 5s";
    let said = succeeded(&place.run(line));
    assert!(said.contains("the program's own front of a software device"), "{said}");
    // What was asked for stays.
    let mine = place.explained(&format!("{line} --effect shape=levels=3"));
    assert_eq!(mine["settings"]["shape"]["levels"], 3.0);
    assert_eq!(mine["effects"]["shape"]["runs"], true);
}

#[test]
fn every_effect_has_a_price() {
    let place = Place::new(20_000);
    let said = succeeded(&place.run("render street.las -o a.png --size 160x90 --explain=prices"));
    let prices = said.split("prices:\n").nth(1).expect("a table");
    let of = |name: &str| {
        let line = prices.lines().find(|line| line.trim_start().starts_with(name));
        line.unwrap_or_else(|| panic!("no price of {name} in {prices}")).to_string()
    };
    assert!(of("shape").contains("costs") && of("visibility").contains("costs"), "{prices}");
    assert!(of("ao").contains("saves"), "{prices}");
    let output = place.run("render street.las -o b.png --size 160x90 --explain=json,prices");
    succeeded(&output);
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    let [shape, ao] = ["shape", "ao"].map(|name| json["prices"][name].clone());
    assert!(shape["runs"] == true && ao["runs"] == false, "{shape} {ao}");
    let costs = |price: &Value| price["ms"].as_f64().is_some_and(|ms| ms > 0.0);
    assert!(costs(&shape) && costs(&ao), "{shape} {ao}");
}

#[test]
fn films_and_pictures_in_pieces_keep_a_time_too() {
    let place = Place::new(20_000);
    for (more, files) in [
        ("--turntable 4", &["a-0001.png", "a-0004.png"][..]),
        ("--piece 64", &["a.png"]),
        ("--view top --resolution 0.5", &["a.png"]),
    ] {
        let size = if more.contains("resolution") { "" } else { "--size 160x90" };
        let line = format!("render street.las -o a.png {size} --time 5s {more}");
        let said = succeeded(&place.run(&line));
        assert!(said.contains("--time 5000ms: ") && said.contains("expected"), "{more}: {said}");
        for file in files {
            assert!(place.at(file).exists(), "{more}: {file}");
        }
    }
}

#[test]
fn limits_that_make_no_sense_are_refused() {
    let place = Place::new(1000);
    for (wrong, names) in [
        ("--time 0", "not a time"),
        ("--error 0.5", "not an error"),
        ("--time 5ms --error 1px", "cannot be used with"),
        ("--time 5ms --lod 2", "cannot be used with"),
    ] {
        let said = failed(&place.run(&format!("render street.las -o a.png {wrong}")), 2);
        assert!(said.contains(names), "{wrong}: {said}");
    }
    for (wrong, names) in
        [("tune --camera cam.json", "name its files"), ("tune street.las -o a.txt", "a.txt")]
    {
        let said = failed(&place.run(wrong), 1);
        assert!(said.contains(names), "{wrong}: {said}");
    }
}

#[test]
fn a_study_says_what_moved_since_an_older_one() {
    let place = Place(tempfile::tempdir().unwrap());
    let study = |more: &str| {
        let line = "study precision --points 5000 --size 64x48 --repeat 3";
        let mut command = pointillist();
        command.args(line.split_whitespace()).args(more.split_whitespace());
        command.current_dir(place.0.path()).output().unwrap()
    };
    succeeded(&study("-o before"));
    let path = place.at("before/precision.csv");
    // Twice the errors that there were.
    let table = std::fs::read_to_string(&path).unwrap();
    let halved = table.lines().map(|line| {
        let mut fields: Vec<String> = line.split(',').map(String::from).collect();
        if let Ok(error) = fields[6].parse::<f64>() {
            fields[6] = format!("{:e}", error / 2.0);
        }
        fields.join(",")
    });
    std::fs::write(&path, halved.collect::<Vec<_>>().join("\n")).unwrap();
    let output = study("-o now --compare before");
    succeeded(&output);
    let said = text(&output.stdout);
    let moved = said.lines().find(|line| line.starts_with("precision px_rms, bits 10: "));
    let moved = moved.unwrap_or_else(|| panic!("{said}"));
    assert!(
        moved.contains("less accurate") && moved.contains("2 (2 to 2) of the error"),
        "{moved}"
    );
    let page = std::fs::read_to_string(place.at("now/study.html")).unwrap();
    assert!(page.contains("since before, in parts of what it was"), "no table of what moved");
    // A folder without a report.
    let missing = failed(&study("--compare nowhere"), 1);
    assert!(missing.contains("precision.csv"), "{missing}");
}
