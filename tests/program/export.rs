//! Filters, counts and exports as a user types them, with laspy and plain text as witnesses.

use crate::commands::{info, run};
use crate::files::{names, scan};
use crate::index_file::indexed;
use crate::png_file::read_png;
use crate::program::{failed, pointillist, render, succeeded, text};
use crate::shared::shared;
use crate::witness::laspy;
use pointillist::synth::SceneKind;
use std::fs;
use std::path::{Path, PathBuf};

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

    fn street(&self) -> PathBuf {
        let path = self.at("street.laz");
        scan(&path, SceneKind::Street, 60_000);
        path
    }
}

/// Runs `export` on a cloud. Returns its output.
fn export(cloud: &Path, output: &Path, line: &str) -> std::process::Output {
    let mut command = pointillist();
    command.arg("export").arg(cloud).arg("-o").arg(output).args(line.split_whitespace());
    command.output().expect("start the program")
}

/// Compares a selection by laspy with what was exported, field by field, and the headers.
const SAME: &str = "
import sys, laspy, numpy as np
a, b = laspy.read(sys.argv[1]), laspy.read(sys.argv[2])
x, y, z = (np.asarray(v) for v in (a.x, a.y, a.z))
n = lambda name: np.asarray(a[name])
kept = WHICH
p = a.points[kept]
assert len(p) == len(b.points), (len(p), len(b.points))
assert list(p.point_format.dimension_names) == list(b.point_format.dimension_names)
for name in p.point_format.dimension_names:
    assert np.array_equal(np.asarray(p[name]), np.asarray(b[name]), equal_nan=True), name
assert (a.header.scales == b.header.scales).all() and (a.header.offsets == b.header.offsets).all()
crs = lambda las: [bytes(v.record_data_bytes()) for v in las.header.vlrs if v.user_id == 'LASF_Projection']
assert crs(a) == crs(b)
assert b.header.point_count == len(p)
assert np.allclose(b.header.mins, [b.x.min(), b.y.min(), b.z.min()], atol=1e-9)
print(len(p))
";

#[test]
fn laspy_finds_the_points_that_were_asked_for() {
    let place = Place::new();
    let files = [
        ("data/aerial/ign_2strips.laz", "--only ground", "n('classification') == 2"),
        (
            "data/aerial/ign_2strips.laz",
            "--where intensity=500..1500 --where z=25..30",
            "(n('intensity') >= 500) & (n('intensity') <= 1500) & (z >= 25) & (z <= 30)",
        ),
        (
            "data/ground/pine_plot.laz",
            "--where return=last --not ground",
            "(n('return_number') >= n('number_of_returns')) & (n('classification') != 2)",
        ),
        ("data/formats/las1.4_pf3_extrabytes.las", "--every 3", "np.arange(len(x)) % 3 == 0"),
        ("data/formats/las1.4_pf6.las", "--where returns=1", "n('number_of_returns') == 1"),
    ];
    for (file, line, which) in files {
        let Some(file) = shared(file) else { continue };
        for name in ["out.laz", "out.las"] {
            let output = place.at(name);
            let exported = export(&file, &output, line);
            let said = succeeded(&exported);
            let script = SAME.replace("WHICH", which);
            let Some(points) = laspy(&script, &[&file, &output]) else { return };
            assert!(points != "0", "{line}");
            println!("{} {line}: {points} points; {said}", file.display());
        }
    }
}

/// Reads a COPC file by levels and in a box, and compares all of its points with those of the
/// input, field by field, in an order of their own.
const COPC: &str = "
import sys, laspy, numpy as np
from laspy import Bounds, CopcReader
a, b = laspy.read(sys.argv[1]), laspy.read(sys.argv[2])
tree = CopcReader.open(sys.argv[2])
assert len(a.points) == len(b.points) == len(tree.query()) == tree.header.point_count
info = tree.copc_info
names = [n for n in a.point_format.dimension_names if n in b.point_format.dimension_names]
lost = set(a.point_format.dimension_names) - set(names)
assert lost <= {'scan_angle_rank'}, lost
rows = lambda las: np.stack([np.asarray(las[n]).reshape(len(las.points), -1)[:, 0].astype(float) for n in names])
p, q = rows(a), rows(b)
p, q = p[:, np.lexsort(p)], q[:, np.lexsort(q)]
assert np.array_equal(p, q, equal_nan=True)
if lost:
    angles = lambda v: np.sort(np.round(np.asarray(v, dtype=float)))
    assert np.array_equal(angles(a.scan_angle_rank), angles(np.asarray(b.scan_angle) * 0.006))
places = np.stack([b.X, b.Y, b.Z], 1)
low, high = tree.header.mins, tree.header.maxs
middle = (low + high) / 2
steps = lambda v: np.round((v - tree.header.offsets) / tree.header.scales)
inside = ((places >= steps(low)) & (places <= steps(middle))).all(1)
assert len(tree.query(bounds=Bounds(mins=low, maxs=middle))) == inside.sum()
levels = []
while sum(levels) < len(b.points):
    level = tree.query(level=len(levels))
    levels.append(len(level))
    # One point a cell of the level's grid, except in nodes of few points.
    spacing = info.spacing / 2 ** (len(levels) - 1)
    cells = np.floor((np.stack([level.x, level.y, level.z], 1) - (info.center - info.halfsize)) / spacing)
    assert len(levels) > 1 or len(np.unique(cells, axis=0)) > 0.9 * len(level) or len(b.points) < 70_000
print(levels)
";

#[test]
fn laspy_reads_copc_by_levels_and_boxes() {
    let place = Place::new();
    let files = [
        "data/aerial/ign_2strips.laz",
        "data/aerial/lone-star.copc.laz",
        "data/ground/pine_plot.laz",
        "data/formats/las1.4_pf3_extrabytes.las",
        "data/formats/las1.4_pf6.las",
    ];
    for file in files {
        let Some(file) = shared(file) else { continue };
        let output = place.at("out.copc.laz");
        succeeded(&export(&file, &output, ""));
        let Some(levels) = laspy(COPC, &[&file, &output]) else { return };
        println!("{}: points by level {levels}", file.display());
        assert!(info(&[&output], "")["parts"][0]["format"].as_str().unwrap().starts_with("COPC"));
    }
}

/// COPC names its coordinate system by WKT, also where the input has GeoTIFF keys.
#[test]
fn a_copc_file_states_the_system_of_its_points() {
    let place = Place::new();
    let Some(file) = shared("data/aerial/ign_2strips.laz") else { return };
    let output = place.at("out.copc.laz");
    succeeded(&export(&file, &output, "--only ground"));
    let wkt = "
import sys, laspy
print([v.string for v in laspy.open(sys.argv[1]).header.vlrs if v.record_id == 2112])
";
    let Some(text) = laspy(wkt, &[&output]) else { return };
    assert!(text.contains("PROJCS"), "{text}");
}

/// One point a cell, found by a dictionary in Python.
#[test]
fn laspy_finds_one_point_a_cell() {
    let place = Place::new();
    let Some(file) = shared("data/aerial/ign_2strips.laz") else { return };
    let output = place.at("thin.laz");
    succeeded(&export(&file, &output, "--thin 0.5"));
    let script = "
import sys, laspy, numpy as np
a, b = laspy.read(sys.argv[1]), laspy.read(sys.argv[2])
cells = np.floor(np.stack([np.asarray(v) for v in (a.x, a.y, a.z)], 1) / 0.5).astype(np.int64)
_, first = np.unique(cells, axis=0, return_index=True)
first.sort()
assert np.array_equal(a.points[first].array, b.points.array)
print(len(first))
";
    let Some(points) = laspy(script, &[&file, &output]) else { return };
    println!("{points} cells");
}

#[test]
fn a_table_has_a_line_of_names_and_a_line_a_point() {
    let place = Place::new();
    let street = place.street();
    let output = place.at("some.csv");
    let said = succeeded(&export(&street, &output, "--only building --where z=104..106"));
    let table = fs::read_to_string(&output).unwrap();
    let mut lines = table.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    assert_eq!(names[..4], ["x", "y", "z", "red"]);
    let class = names.iter().position(|name| *name == "classification").unwrap();
    let mut points = 0;
    for line in lines {
        let values: Vec<f64> = line.split(',').map(|value| value.parse().unwrap()).collect();
        assert!((104.0..=106.0).contains(&values[2]) && values[class] == 6.0, "{line}");
        assert_eq!(values.len(), names.len());
        points += 1;
    }
    let counted = info(&[&street], "--only building --where z=104..106 --count");
    assert_eq!(counted["points"], points);
    assert_eq!(counted["of"], 60_000);
    assert_eq!(counted["classes"], serde_json::json!([{ "class": 6, "points": points }]));
    assert!(said.contains(&format!("some.csv: {points}")) || points > 999, "{said}");
}

/// `info` on what is left reports as on a file of it.
#[test]
fn info_of_some_points_is_that_of_a_file_of_them() {
    let place = Place::new();
    let street = place.street();
    let (some, line) =
        (place.at("some.laz"), "--only ground --clip box:499995,-inf,-inf,inf,inf,inf");
    succeeded(&export(&street, &some, line));
    let (left, file) = (info(&[&street], line), info(&[&some], ""));
    for field in ["points", "bounds", "spacing"] {
        assert_eq!(left[field], file[field], "{field}");
    }
    for field in ["class", "intensity", "returns"] {
        let of = |report: &serde_json::Value| report["parts"][0]["attributes"][field].clone();
        assert_eq!(of(&left), of(&file), "{field}");
    }
    let index = indexed(&[&street], "");
    for cloud in [&street, &index] {
        let counted = info(&[cloud], &format!("{line} --count"));
        assert_eq!((&counted["points"], &counted["bounds"]), (&file["points"], &file["bounds"]));
    }
}

#[test]
fn what_leaves_nothing_or_makes_no_sense_says_why() {
    let place = Place::new();
    let street = place.street();
    let index = indexed(&[&street], "");
    let output = place.at("out.laz");
    let fails = |cloud: &Path, line: &str| failed(&export(cloud, &output, line), 1);
    let said = fails(&street, "--only class=9");
    assert!(
        said.contains("--only class=9 leaves none of 60,000 points; classes present: 2"),
        "{said}"
    );
    let said = fails(&index, "--only class=9");
    assert!(said.contains("leaves none of 60,000 points; classes present: 2"), "{said}");
    let said = fails(&street, "--clip box:0,0,0,1,1,1");
    assert!(said.contains("--clip leaves none of 60,000 points; the points lie in 4"), "{said}");
    let said = fails(&index, "--where gps-time=1..2");
    assert!(said.contains("--gps-time` keeps it"), "{said}");
    let drawn = place.at("out.png");
    for cloud in [&street, &index] {
        let said = failed(&render(cloud, &format!("-o {} --only class=9", drawn.display())), 1);
        assert!(said.contains("leaves none of 60,000 points; classes present: 2"), "{said}");
    }
    for cloud in [&street, &index] {
        let line = format!("-o {} --size 32x32 --clip box:0,0,0,1,1,1", drawn.display());
        let said = failed(&render(cloud, &line), 1);
        assert!(said.contains("--clip leaves none of 60,000 points; they lie in 4"), "{said}");
    }
    let said = failed(&export(&street, &output, "--only grund"), 2);
    assert!(said.contains("low-vegetation"), "{said}");
    failed(&export(&street, &street, ""), 1);
    failed(&export(&street, &place.at("out.xyz"), ""), 1);
    failed(&export(&street, &output, "--thin 0"), 2);
    assert_eq!(names(place.folder.path()), ["street.laz", "street.pnti"]);
}

/// An index with all points drawn, and the files themselves, give one picture under every filter:
/// without shading, which follows the spacing of the points that are left.
#[test]
fn filters_draw_the_same_of_files_and_of_their_index() {
    let place = Place::new();
    let street = place.street();
    let index = indexed(&[&street], "--gps-time");
    let camera = place.at("cam.json");
    let view = r#"{"eye": [500020, 4999980, 130], "target": [500000, 5000020, 103], "fov_y": 50}"#;
    fs::write(&camera, view).unwrap();
    let line = format!(
        "--camera {} --size 320x200 --style points --effect edl=off --color class",
        camera.display()
    );
    let draw = |cloud: &Path, filter: &str| {
        let output = place.at("out.png");
        let line = format!("{line} {filter} -o {}", output.display());
        succeeded(&render(cloud, &line));
        read_png(&output).pixels
    };
    let whole = draw(&street, "");
    for filter in [
        "--only ground",
        "--not building,noise",
        "--where z=101..104",
        "--where intensity=20000.. --where return=last",
        "--only source=1,2",
        "--where gps-time=1000..3500",
        "--not file=street.laz --only ground",
    ] {
        if filter.contains("file=") {
            let output = format!("{line} {filter} -o {}", place.at("none.png").display());
            failed(&render(&street, &output), 1);
            continue;
        }
        let of_files = draw(&street, filter);
        assert!(of_files != whole, "{filter} removes nothing");
        assert!(of_files == draw(&index, &format!("{filter} --lod 0")), "{filter}");
    }
}

/// `--explain` counts what is inside the boxes.
#[test]
fn explain_counts_what_is_left() {
    let place = Place::new();
    let street = place.street();
    let line = "--clip box:499995,-inf,-inf,500003,inf,inf --only ground";
    let (drawn, camera) = (place.at("out.png"), place.at("cam.json"));
    // All of the street is in the picture.
    let view = r#"{"eye": [500000, 5000000, 600], "target": [500000, 5000020, 100], "fov_y": 60}"#;
    fs::write(&camera, view).unwrap();
    let camera = format!("--camera {}", camera.display());
    let output = render(
        &street,
        &format!("-o {} --size 64x64 {camera} {line} --explain=json", drawn.display()),
    );
    succeeded(&output);
    let explained: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(explained["left"], info(&[&street], &format!("{line} --count"))["points"]);
}

#[test]
fn a_scene_keeps_its_filters() {
    let place = Place::new();
    let street = place.street();
    let scene = place.at("scene.json");
    fs::write(
        &scene,
        r#"{"camera": {"eye": [500000, 5000000, 200], "target": [500000, 5000001, 100]},
            "only": ["ground"], "not": ["z=..100"], "clip": ["off:0,0,0,1,1,1"]}"#,
    )
    .unwrap();
    let (by_scene, by_words) = (place.at("a.laz"), place.at("b.laz"));
    succeeded(&export(&street, &by_scene, &format!("--scene {}", scene.display())));
    succeeded(&export(&street, &by_words, "--only ground --not z=..100"));
    assert!(fs::read(by_scene).unwrap() == fs::read(by_words).unwrap());
    let drawn = place.at("out.png");
    let line = format!("-o {} --size 64x64 --scene {}", drawn.display(), scene.display());
    let said = succeeded(&render(&street, &line));
    assert!(said.contains("--only ground --not z=..100 leaves"), "{said}");
}

#[test]
fn export_explains_itself_with_examples() {
    let output = run(["export", "--help"]);
    succeeded(&output);
    let help = text(&output.stdout);
    assert!(
        help.contains("Examples:") && help.contains("--only") && help.contains("--thin"),
        "{help}"
    );
}
