//! The range of colours is decided by most points, whatever the format or header, and can be given.
//!
//! Files are generated; real ones lie in `../shared/cases`, and the test that needs it is skipped
//! if it is missing.

use crate::commands::info;
use crate::index_file::indexed;
use crate::made::{Las, Point, sheet};
use crate::png_file::{Png, read_png};
use crate::program::{failed, pointillist, succeeded, text};
use crate::shared::shared;
use pointillist::cloud::rgb_range::{By, RgbRange};
use pointillist::cloud::{self, Cloud, ColumnSet, ReadOptions};
use pointillist::error::Result;
use pointillist::progress::Silent;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

const ALL: ReadOptions = ReadOptions::new(ColumnSet::ALL, false);

fn read(path: &Path) -> Cloud {
    cloud::read(&[path.to_owned()], &ALL, &Silent).unwrap()
}

fn read_as(path: &Path, rgb_range: RgbRange) -> Cloud {
    cloud::read(&[path.to_owned()], &ReadOptions { rgb_range: Some(rgb_range), ..ALL }, &Silent)
        .unwrap()
}

fn read_strictly(path: &Path) -> Result<Cloud> {
    cloud::read(&[path.to_owned()], &ReadOptions { strict: true, ..ALL }, &Silent)
}

fn colors(cloud: &Cloud) -> &[[u8; 3]] {
    cloud.parts[0].columns.rgb.as_deref().unwrap()
}

fn scale(cloud: &Cloud) -> (f64, By) {
    let scale = cloud.parts[0].rgb_scale;
    (scale.full, scale.by)
}

/// Returns the colour of most pixels of a picture.
fn drawn(path: &Path, more: &str) -> [u8; 3] {
    let picture = path.with_extension("png");
    let line = format!("--size 64x64 --view top --style points --effect edl=off --no-cache {more}");
    succeeded(
        &pointillist()
            .arg("render")
            .arg(path)
            .arg("-o")
            .arg(&picture)
            .args(line.split_whitespace())
            .output()
            .unwrap(),
    );
    let mut reader = png::Decoder::new(std::io::BufReader::new(fs::File::open(&picture).unwrap()))
        .read_info()
        .unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let frame = reader.next_frame(&mut pixels).unwrap();
    let channels = pixels.len() / (64 * 64);
    assert_eq!((frame.width, frame.height), (64, 64));
    let background = [pixels[0], pixels[1], pixels[2]];
    let mut counts = std::collections::BTreeMap::new();
    let colors = pixels.chunks(channels).map(|pixel| [pixel[0], pixel[1], pixel[2]]);
    colors
        .filter(|color| *color != background)
        .for_each(|color| *counts.entry(color).or_insert(0) += 1);
    counts.into_iter().max_by_key(|(_, count)| *count).expect("a point").0
}

fn rgb_of(info: &Value) -> &Value {
    &info["parts"][0]["attributes"]["rgb"]
}

/// Returns 5000 points of colour 200, 100, 50 in 16-bit fields, this many of them with another
/// value.
fn las(outliers: usize, value: u16) -> Las {
    Las {
        points: sheet(|i| if i * outliers % 5000 < outliers { [value; 3] } else { [200, 100, 50] }),
        ..Las::default()
    }
}

#[test]
fn eight_bits_in_sixteen_are_seen_past_outliers_in_every_kind_of_las() {
    let folder = tempfile::tempdir().unwrap();
    for (name, format) in [("a.las", 3), ("b.las", 7), ("c.laz", 3), ("d.laz", 7)] {
        for outliers in [0, 1, 250] {
            let path = Las { format, minor: if format > 5 { 4 } else { 2 }, ..las(outliers, 300) }
                .write(folder.path(), name);
            let cloud = read(&path);
            assert_eq!(scale(&cloud), (255.0, By::Values), "{name} {outliers}");
            let of = |color: [u8; 3]| colors(&cloud).iter().filter(|own| **own == color).count();
            assert_eq!((of([200, 100, 50]), of([255; 3])), (5000 - outliers, outliers), "{name}");
            let note = if outliers > 0 {
                format!("except those of {outliers} of 5000 points")
            } else {
                "8-bit values in 16-bit fields".into()
            };
            assert!(cloud.notes.iter().any(|line| line.contains(&note)), "{:?}", cloud.notes);
            // Nothing is lost if all are bytes.
            assert_eq!(read_strictly(&path).is_ok(), outliers == 0);
            assert_eq!(colors(&read_as(&path, RgbRange::Words))[4999], [1, 0, 0]);
        }
        // Only outliers that are not black, and a file that is really dark.
        let dark = Las {
            points: sheet(|i| if i % 100 == 0 { [20_000, 300, 0] } else { [0; 3] }),
            ..Las::default()
        };
        let cloud = read(&dark.write(folder.path(), "dark.las"));
        assert_eq!((scale(&cloud), colors(&cloud)[0]), ((65535.0, By::File), [78, 1, 0]));
    }
}

#[test]
fn a_look_that_misses_is_made_good_by_reading_again_and_an_index_agrees() {
    let folder = tempfile::tempdir().unwrap();
    // Points of which a sample sees one in eight runs at most: colours there, black elsewhere.
    for (name, wide) in [("wide.las", 40_000u16), ("narrow.las", 200)] {
        let place = |i: usize| (2500..2504).contains(&i);
        let points = sheet(|i| {
            if place(i) {
                [wide, 100, 50]
            } else if i < 64 {
                [180, 100, 50]
            } else {
                [0; 3]
            }
        });
        let points = points.into_iter().enumerate().map(|(i, mut point)| {
            if i < 64 && !place(i) && wide > 255 {
                point.rgb = [0; 3];
            }
            point
        });
        let path = Las { points: points.collect(), ..Las::default() }.write(folder.path(), name);
        let cloud = read(&path);
        assert_eq!(scale(&cloud).0, if wide > 255 { 65535.0 } else { 255.0 }, "{name}");
        let index = info(&[&indexed(&[&path], "")], "");
        assert_eq!(index["parts"][0]["rgb_scale"]["full"], scale(&cloud).0);
        assert_eq!(index["notes"], info(&[&path], "")["notes"]);
    }
}

#[test]
fn mixed_depths_are_said() {
    let folder = tempfile::tempdir().unwrap();
    let half = Las {
        points: sheet(|i| if i % 2 == 0 { [51_400, 25_700, 12_850] } else { [200, 100, 50] }),
        ..Las::default()
    };
    let cloud = read(&half.write(folder.path(), "half.las"));
    assert_eq!((colors(&cloud)[0], colors(&cloud)[1]), ([200, 100, 50], [1, 0, 0]));
    assert!(
        cloud
            .notes
            .iter()
            .any(|line| line.contains("2500 of 5000 coloured points have no channel above 255")),
        "{:?}",
        cloud.notes
    );
}

/// Returns a binary PLY of the sheet with further f32 properties.
fn ply(
    folder: &Path,
    name: &str,
    properties: &[&str],
    values: impl Fn(usize) -> Vec<f32>,
) -> PathBuf {
    let points = sheet(|_| [0; 3]);
    let names = ["x", "y", "z"]
        .iter()
        .chain(properties)
        .map(|name| format!("property float {name}\n"))
        .collect::<String>();
    let mut file = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n{names}end_header\n",
        points.len()
    )
    .into_bytes();
    for (i, point) in points.iter().enumerate() {
        let own = values(i);
        file.extend(
            point.q.iter().map(|&q| q as f32 * 0.001).chain(own).flat_map(f32::to_le_bytes),
        );
    }
    let path = folder.join(name);
    fs::write(&path, file).unwrap();
    path
}

const RGB: [&str; 3] = ["red", "green", "blue"];

#[test]
fn float_colours_count_to_one_or_to_255() {
    let folder = tempfile::tempdir().unwrap();
    let bright = [200.0f32, 100.0, 50.0];
    let made = |name: &str, outlier: f32, scale: f32| {
        ply(folder.path(), name, &RGB, |i| {
            bright.map(|v| if i % 1000 == 0 { outlier } else { v * scale }).to_vec()
        })
    };
    for (name, outlier, factor, full, by) in [
        ("a.ply", 0.5, 1.0, 255.0, By::Values),
        ("b.ply", 1e6, 1.0, 255.0, By::Values),
        ("c.ply", 0.5, 1.0 / 255.0, 1.0, By::File),
        ("d.ply", 254.0, 1.0 / 255.0, 1.0, By::File),
        ("e.ply", f32::NAN, 257.0, 65535.0, By::Values),
    ] {
        let path = made(name, outlier, factor);
        let cloud = read(&path);
        assert_eq!((scale(&cloud), colors(&cloud)[1]), ((full, by), [200, 100, 50]), "{name}");
        assert_eq!(
            cloud.notes.iter().any(|note| note.contains("colours are read as")),
            by == By::Values,
            "{name} {:?}",
            cloud.notes
        );
        assert_eq!(drawn(&path, ""), [200, 100, 50], "{name}");
        assert_eq!(drawn(&indexed(&[&path], ""), ""), [200, 100, 50], "{name}");
    }
    assert_eq!(colors(&read_as(&made("f.ply", 0.5, 1.0), RgbRange::Unit))[1], [255; 3]);
}

#[test]
fn gaussian_splats_have_the_colours_of_their_harmonics() {
    let folder = tempfile::tempdir().unwrap();
    let coefficients = |i: usize| {
        [200.0f32, 100.0, 50.0].map(|v| if i == 7 { 9.0 } else { (v / 255.0 - 0.5) / 0.282_094_8 })
    };
    let path = ply(folder.path(), "splats.ply", &["f_dc_0", "f_dc_1", "f_dc_2", "opacity"], |i| {
        coefficients(i).into_iter().chain([1.0]).collect()
    });
    for cloud in [read(&path), read_as(&path, RgbRange::Bytes)] {
        assert_eq!((colors(&cloud)[0], colors(&cloud)[7]), ([200, 100, 50], [255; 3]));
        assert!(
            cloud.notes.iter().any(|note| note.contains("Gaussian splats")),
            "{:?}",
            cloud.notes
        );
    }
    assert_eq!(drawn(&path, ""), [200, 100, 50]);
    // Plain colours are preferred.
    let both = ply(
        folder.path(),
        "both.ply",
        &["f_dc_0", "f_dc_1", "f_dc_2", "red", "green", "blue"],
        |_| vec![9.0, 9.0, 9.0, 0.2, 0.4, 0.6],
    );
    assert_eq!(colors(&read(&both))[0], [51, 102, 153]);
}

/// Writes an E57 of the sheet with these colour limits.
fn e57(folder: &Path, name: &str, limits: i64, rgb: impl Fn(usize) -> [i64; 3]) -> PathBuf {
    use e57::{ColorLimits, E57Writer, Record, RecordDataType, RecordName, RecordValue};
    let path = folder.join(name);
    let record = |name, data_type| Record { name, data_type };
    let color = RecordDataType::Integer { min: 0, max: 65535 };
    let prototype = vec![
        record(RecordName::CartesianX, RecordDataType::Double { min: None, max: None }),
        record(RecordName::CartesianY, RecordDataType::Double { min: None, max: None }),
        record(RecordName::CartesianZ, RecordDataType::Double { min: None, max: None }),
        record(RecordName::ColorRed, color.clone()),
        record(RecordName::ColorGreen, color.clone()),
        record(RecordName::ColorBlue, color),
    ];
    let mut writer = E57Writer::from_file(&path, "file").unwrap();
    let mut scan = writer.add_pointcloud("scan", prototype).unwrap();
    let [lo, hi] = [0, limits].map(|limit| Some(RecordValue::Integer(limit)));
    scan.set_color_limits(Some(ColorLimits {
        red_min: lo.clone(),
        red_max: hi.clone(),
        green_min: lo.clone(),
        green_max: hi.clone(),
        blue_min: lo,
        blue_max: hi,
    }));
    for (i, point) in sheet(|_| [0; 3]).iter().enumerate() {
        let place = point.q.map(|q| RecordValue::Double(q as f64 * 0.001));
        scan.add_point(place.into_iter().chain(rgb(i).map(RecordValue::Integer)).collect())
            .unwrap();
    }
    scan.finalize().unwrap();
    writer.finalize().unwrap();
    path
}

#[test]
fn limits_of_an_e57_are_believed_only_where_its_points_agree() {
    let folder = tempfile::tempdir().unwrap();
    let of = |factor: i64| {
        move |i: usize| if i == 3 { [65535; 3] } else { [200, 100, 50].map(|v: i64| v * factor) }
    };
    for (name, limits, factor, full, by) in [
        ("lying.e57", 65535, 1, 255.0, By::Values),
        ("true.e57", 65535, 257, 65535.0, By::File),
        ("bytes.e57", 255, 1, 255.0, By::File),
        ("low.e57", 255, 257, 65535.0, By::Values),
        ("ten.e57", 1023, 4, 1023.0, By::File),
    ] {
        let path = e57(folder.path(), name, limits, of(factor));
        let cloud = read(&path);
        let expected = if full == 1023.0 { [199, 100, 50] } else { [200, 100, 50] };
        assert_eq!((scale(&cloud), colors(&cloud)[0]), ((full, by), expected), "{name}");
        assert_eq!(read_strictly(&path).is_ok(), by == By::File, "{name}");
        assert_eq!(rgb_of(&info(&[&path], ""))["full"], json!(full));
    }
}

#[test]
fn every_command_takes_the_range_that_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = las(0, 0).write(folder.path(), "a.las");
    let said = info(&[&path], "--rgb-range 65535");
    let rgb = rgb_of(&said);
    assert_eq!(
        (&rgb["full"], &rgb["by"], &rgb["max"]),
        (&json!(65535.0), &json!("request"), &json!([1, 0, 0]))
    );
    assert_eq!(rgb_of(&info(&[&path], ""))["by"], "values");
    // Dark colours are stretched, and the only tone lies in the middle, unless a range is given.
    assert_eq!(drawn(&path, "--rgb-range 65535"), [128, 0, 0]);
    assert_eq!(drawn(&path, "--rgb-range 65535 --range 0,255"), [1, 0, 0]);
    assert_eq!(drawn(&path, "--rgb-range 0..1"), [255; 3]);
    assert_eq!(drawn(&path, "--lod 1 --rgb-range 65535 --range 0,255"), [1, 0, 0]);
    let index = indexed(&[&path], "--rgb-range 65535");
    assert_eq!(drawn(&index, "--range 0,255"), [1, 0, 0]);
    let refused =
        pointillist().arg("info").arg(&index).args(["--rgb-range", "255"]).output().unwrap();
    assert!(failed(&refused, 1).contains("is an index"), "{}", text(&refused.stderr));
    failed(&pointillist().arg("info").arg(&path).args(["--rgb-range", "7"]).output().unwrap(), 2);
}

#[test]
fn files_that_people_have_met_have_their_colours() {
    let Some(cases) = shared("cases") else { return };
    for name in ["rgbfloat255.ply", "rgb8_limits_wrong.e57", "rgb16_dark.las"] {
        let cloud = read(&cases.join(name));
        assert_eq!(scale(&cloud), (255.0, By::Values), "{name}");
        let right = colors(&cloud).iter().filter(|color| **color == [200, 100, 50]).count();
        println!("{name}: {right} of {}", cloud.len());
        assert!(name.ends_with("las") || right as u64 == cloud.len(), "{name}");
    }
}

/// Returns the share of drawn pixels whose colour is not one of the points', red and green in turn.
fn mixed(name: &str, points: Vec<[i32; 3]>) -> f64 {
    let folder = tempfile::tempdir().unwrap();
    let color = |i: usize| if i.is_multiple_of(2) { [65_535, 0, 0] } else { [0, 65_535, 0] };
    let points = points
        .into_iter()
        .enumerate()
        .map(|(i, q)| Point { q, rgb: color(i), time: 0.0 })
        .collect();
    let path = Las { points, ..Las::default() }.write(folder.path(), name);
    let picture = folder.path().join("a.png");
    let line = "--size 400x400 --effect fill=auto,method=pullpush --effect shape=off --effect edl=off --no-cache";
    succeeded(
        &pointillist()
            .arg("render")
            .arg(&path)
            .arg("-o")
            .arg(&picture)
            .args(line.split_whitespace())
            .output()
            .unwrap(),
    );
    let Png { pixels, .. } = read_png(&picture);
    let background = pixels[0];
    let is_own = |color: &[u8; 3]| color[2] <= 1 && color[..2].iter().all(|&v| v <= 1 || v >= 254);
    let drawn: Vec<_> = pixels.into_iter().filter(|color| *color != background).collect();
    assert!(drawn.len() > 20_000, "{name}: {} pixels", drawn.len());
    drawn.iter().filter(|color| !is_own(color)).count() as f64 / drawn.len() as f64
}

#[test]
fn leaves_keep_their_colours_and_surfaces_share_them() {
    let mut state = 7u64;
    let mut next = |width: i32| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as i32 % width
    };
    let crown = (0..6000).map(|_| [next(20_000), next(20_000), next(20_000)]).collect();
    let wall = (0..6000).map(|_| [next(20_000), 0, next(20_000)]).collect();
    let [crown, wall] = [mixed("crown.las", crown), mixed("wall.las", wall)];
    println!(
        "colours of two points in {:.1} % of a crown and {:.1} % of a wall",
        100.0 * crown,
        100.0 * wall
    );
    assert!(crown < 0.25 * wall && wall > 0.5);
}
