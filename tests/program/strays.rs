//! Strays and duplicate points have no influence: pictures, spacing and elevation colours are those
//! of the cloud without them, from files and through an index.

use crate::commands::run;
use crate::png_file::{Png, read_png};
use crate::program::{pointillist, render, succeeded, text};
use glam::DVec3;
use las::point::Classification;
use las::{Builder, Point, Transform, Vector, Writer};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Returns a wavy sheet of 20 x 20 m.
fn sheet(points: usize, corner: DVec3) -> Vec<DVec3> {
    let place = |i: usize| {
        let (x, y) =
            (((i * 7919) % 20_011) as f64 / 1000.55, ((i * 104_729) % 19_997) as f64 / 999.85);
        corner + DVec3::new(x, y, 3.0 * (0.3 * x).sin() * (0.3 * y).cos())
    };
    (0..points).map(place).collect()
}

fn write(path: &Path, points: &[DVec3], class: impl Fn(usize) -> u8) {
    let mut builder = Builder::from((1, 4));
    builder.point_format = las::point::Format::new(6).unwrap();
    let axis = Transform { scale: 0.001, offset: 0.0 };
    builder.transforms = Vector { x: axis, y: axis, z: axis };
    let mut writer = Writer::from_path(path, builder.into_header().unwrap()).unwrap();
    for (i, p) in points.iter().enumerate() {
        let classification = Classification::new(class(i)).unwrap();
        let point = Point {
            x: p.x,
            y: p.y,
            z: p.z,
            classification,
            gps_time: Some(0.0),
            return_number: 1,
            number_of_returns: 1,
            ..Point::default()
        };
        writer.write_point(point).unwrap();
    }
    writer.close().unwrap();
}

struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new() -> Place {
        Place { folder: tempfile::tempdir().unwrap() }
    }

    fn las(&self, name: &str, points: &[DVec3]) -> PathBuf {
        let path = self.folder.path().join(format!("{name}.las"));
        write(&path, points, |_| 1);
        path
    }

    fn index(&self, las: &Path) -> PathBuf {
        let path = las.with_extension("pnti");
        succeeded(&run([Path::new("index"), las, Path::new("-o"), &path]));
        path
    }

    fn picture(&self, cloud: &Path, options: &str) -> Png {
        let path = cloud.with_extension("png");
        succeeded(&render(cloud, &format!("-o {} --size 320x240 {options}", path.display())));
        read_png(&path)
    }

    fn info(&self, cloud: &Path) -> serde_json::Value {
        serde_json::from_str(&succeeded_text(cloud)).unwrap()
    }
}

fn succeeded_text(cloud: &Path) -> String {
    let output = run([Path::new("info"), cloud, Path::new("--json")]);
    succeeded(&output);
    text(&output.stdout)
}

/// Returns the share of pixels that differ by more than a few levels.
fn differing(a: &Png, b: &Png) -> f64 {
    assert_eq!(a.size, b.size);
    let differ = a
        .pixels
        .iter()
        .zip(&b.pixels)
        .filter(|(a, b)| (0..3).any(|c| a[c].abs_diff(b[c]) > 8))
        .count();
    differ as f64 / a.pixels.len() as f64
}

#[test]
fn pictures_are_those_of_the_cloud_without_strays() {
    let place = Place::new();
    let far = DVec3::new(500_000.0, 1_000_000.0, 100.0);
    for (name, corner, strays) in [
        ("up", DVec3::ZERO, vec![DVec3::new(10.0, 10.0, 1000.0)]),
        ("zero", far, vec![DVec3::ZERO]),
        ("down", DVec3::ZERO, (0..4).map(|i| DVec3::new(5.0 * i as f64, 3.0, -3e5)).collect()),
        ("few", DVec3::ZERO, vec![DVec3::new(0.0, 0.0, 500.0)]),
    ] {
        let points = sheet(if name == "few" { 300 } else { 5000 }, corner);
        let without = place.las(&format!("{name}_without"), &points);
        let with = place.las(&format!("{name}_with"), &[&points[..], &strays[..]].concat());
        let (one, other) = (place.picture(&without, ""), place.picture(&with, ""));
        assert_eq!(differing(&one, &other), 0.0, "{name}");
        let [one, other] = [without, with.clone()].map(|las| place.picture(&place.index(&las), ""));
        // Points of a leaf lie along another curve, by which their spacing is estimated.
        assert!(differing(&one, &other) < 1e-2, "{name}, indexed: {}", differing(&one, &other));
        for cloud in [with.clone(), with.with_extension("pnti")] {
            let said = place.info(&cloud);
            assert_eq!(said["strays"]["points"], strays.len(), "{name}: {said}");
            let at: Vec<f64> = said["strays"]["places"][0]
                .as_array()
                .unwrap()
                .iter()
                .map(|v| v.as_f64().unwrap())
                .collect();
            assert!((DVec3::from_slice(&at) - strays[0]).length() < 1.0, "{name}: {at:?}");
        }
    }
}

/// Returns rows of five points a metre apart, far beyond a sheet and far from each other, as the
/// last ones that a scanner on the ground sees.
fn rows(count: usize) -> Vec<DVec3> {
    let row = |k: usize| DVec3::new(40.0 + 9.0 * (k % 6) as f64, 9.0 * (k / 6) as f64 - 15.0, 0.0);
    (0..count).flat_map(|k| (0..5).map(move |i| row(k) + DVec3::Y * i as f64)).collect()
}

#[test]
fn splats_of_strays_are_no_larger_than_those_of_others() {
    let place = Place::new();
    // The points of a crown lie on no surface.
    let along = |i: usize, prime: usize| ((i * prime) % 20_011) as f64 / 10_005.5 - 1.0;
    let crown = (0..60_000)
        .map(|i| DVec3::new(along(i, 7919), along(i, 104_729), along(i, 15_485_863)))
        .filter(|at| at.length() < 1.0)
        .map(|at| DVec3::new(10.0, 10.0, 5.0) + 4.0 * at);
    let las = place.las("crown", &crown.chain(rows(30)).collect::<Vec<_>>());
    let camera = place.folder.path().join("camera.json");
    std::fs::write(
        &camera,
        r#"{"eye": [40, -120, 60], "target": [40, 15, 0], "up": [0, 0, 1], "fov_y": 50}"#,
    )
    .unwrap();
    for cloud in [las.clone(), place.index(&las)] {
        let said = place.info(&cloud);
        assert_eq!(said["strays"]["points"], 150, "{}: {said}", cloud.display());
        let [points, splats] = ["points", "splats"].map(|style| {
            let [shown, hidden] = ["show", "hide"].map(|strays| {
                let camera = camera.display();
                let options = "--effect edl=off --strays";
                let options = format!("--style {style} --camera {camera} {options} {strays}");
                place.picture(&cloud, &options)
            });
            shown.pixels.iter().zip(&hidden.pixels).filter(|(a, b)| a != b).count()
        });
        assert!(points >= 100, "{points}");
        assert!(splats <= 2 * points, "{splats} pixels of splats, {points} of points");
    }
}

#[test]
fn strays_are_drawn_where_they_lie_unless_they_are_to_be_hidden() {
    let place = Place::new();
    let points = sheet(5000, DVec3::ZERO);
    let las = place.las("with", &[&points[..], &[DVec3::new(10.0, 10.0, 60.0)]].concat());
    let camera = place.folder.path().join("camera.json");
    std::fs::write(
        &camera,
        r#"{"eye": [10, -120, 30], "target": [10, 10, 30], "up": [0, 0, 1], "fov_y": 50}"#,
    )
    .unwrap();
    let options = format!("--camera {} --effect edl=off", camera.display());
    for cloud in [las.clone(), place.index(&las)] {
        let [shown, hidden] = ["show", "hide"]
            .map(|strays| place.picture(&cloud, &format!("{options} --strays {strays}")));
        let differ: Vec<usize> =
            (0..shown.pixels.len()).filter(|&i| shown.pixels[i] != hidden.pixels[i]).collect();
        assert_eq!(differ.len(), 1, "{}: {differ:?}", cloud.display());
        assert!(differ[0] < shown.pixels.len() / 3, "it lies above the sheet");
    }
}

/// Strays are beside the map; a bird above the points does not move its edges.
#[test]
fn rasters_are_those_of_the_cloud_without_strays() {
    let place = Place::new();
    let points = sheet(5_000, DVec3::new(50_000.0, 500_000.0, 100.0));
    let bird = DVec3::new(50_007.0, 500_007.0, 900.0);
    let none = place.las("none", &points);
    let with = place.las("with", &[&points[..], &[DVec3::ZERO, bird]].concat());
    let raster = |cloud: &Path| {
        let output = cloud.with_extension("tif");
        let mut command = pointillist();
        command.arg("raster").arg(cloud).arg("-o").arg(&output);
        succeeded(&command.args(["--resolution", "1", "--value", "count"]).output().unwrap())
    };
    let size = |said: &str| {
        let (_, rest) = said.split_once(".tif: ").unwrap();
        rest.split_once(',').unwrap().0.to_string()
    };
    let (clean, said) = (raster(&none), raster(&with));
    assert_eq!(size(&clean), size(&said));
    assert!(!clean.contains("left out of the map"), "{clean}");
    assert!(said.contains("far outside of all others, 1 of 5,002, are left out"), "{said}");
    let index = place.index(&with);
    assert_eq!(size(&raster(&index)), size(&said));
}

#[test]
fn points_that_occur_ten_times_are_drawn_as_one() {
    let place = Place::new();
    let points = sheet(5000, DVec3::ZERO);
    let ten: Vec<DVec3> = points.iter().flat_map(|&p| [p; 10]).collect();
    let (once, often) = (place.las("once", &points), place.las("often", &ten));
    assert_eq!(differing(&place.picture(&once, ""), &place.picture(&often, "")), 0.0);
    let [once, often] = [once, often].map(|las| place.picture(&place.index(&las), ""));
    assert!(differing(&once, &often) < 2e-3, "{}", differing(&once, &often));
}

#[test]
fn pictures_of_classes_have_the_colours_of_classes_alone() {
    let place = Place::new();
    let path = place.folder.path().join("classes.las");
    write(&path, &sheet(5000, DVec3::ZERO), |i| 2 + (i * 31 % 7) as u8 / 2);
    for cloud in [path.clone(), place.index(&path)] {
        for fill in ["fill=method=median", "fill=method=pullpush", "fill=method=mask", "fill=auto"]
        {
            let colors = |options: &str| -> BTreeSet<[u8; 3]> {
                let picture = place.picture(
                    &cloud,
                    &format!("--color class --effect shape=off --effect edl=off {options}"),
                );
                picture.pixels.into_iter().collect()
            };
            let palette = colors("--effect fill=off --effect visibility=off");
            assert_eq!(palette.len(), 5);
            // Colours are rounded on their way.
            let is_one = |color: &[u8; 3]| {
                palette.iter().any(|one| (0..3).all(|c| color[c].abs_diff(one[c]) <= 1))
            };
            let filled = colors(&format!("--effect {fill}"));
            assert!(filled.iter().all(is_one), "{fill}: {filled:?} {palette:?}");
        }
    }
}
