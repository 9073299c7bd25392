//! LAS files with known contents: colours, lattices, counts, versions, extra bytes.

use super::text_and_ply::ply;
use super::{colors, las, read, read_bytes, read_strictly, world};
use crate::commands::{self, run};
use crate::made::{Las as Made, sheet};
use crate::program::{failed, render, text};
use glam::DVec3;
use pointillist::cloud::point_lookup::{self, LookupQuery};
use pointillist::cloud::{ReadOptions, spacing};
use pointillist::progress::Silent;
use std::fs;
use std::path::Path;

#[test]
fn hard_24_sixteen_bit_colours_are_rounded_exactly() {
    let cloud = read_bytes("all.las", &las(&colors(0..=u16::MAX))).unwrap();
    let rgb = cloud.parts[0].columns.rgb.as_ref().unwrap();
    for (v, color) in rgb.iter().enumerate() {
        let exact = (v as f64 / 257.0).round() as u8;
        assert_eq!(*color, [exact, 0, exact], "{v}");
    }
    assert_eq!(cloud.parts[0].rgb_scale.bits(), 16);
}

#[test]
fn hard_24_colour_depth_is_decided_over_the_whole_file() {
    let count = 20_000;
    let narrow =
        read_bytes("narrow.las", &las(&colors((0..count).map(|i| (i % 256) as u16)))).unwrap();
    assert_eq!(narrow.parts[0].rgb_scale.bits(), 8);
    assert!(
        narrow.parts[0]
            .columns
            .rgb
            .as_ref()
            .unwrap()
            .iter()
            .enumerate()
            .all(|(i, color)| color[0] as usize == i % 256)
    );
    assert!(
        narrow.notes.iter().any(|note| note.contains("8-bit values in 16-bit fields")),
        "{:?}",
        narrow.notes
    );

    // One wide value is an outlier. Wide ones in a fifth of the file are not, wherever they were
    // read, and then all others are 16-bit values too.
    for wide_at in [0, 8191, 8192, 10_000, count - 1] {
        let values = (0..count).map(|i| if i == wide_at { 256 } else { (i % 256) as u16 });
        let one = read_bytes("one.las", &las(&colors(values.clone()))).unwrap();
        let rgb = one.parts[0].columns.rgb.as_ref().unwrap();
        assert!(
            rgb.iter().zip(values).all(|(color, v)| color[0] as u16 == v.min(255)),
            "wide at {wide_at}"
        );
        assert!(
            one.notes.iter().any(|note| note.contains("except those of 1 of 199")),
            "{:?}",
            one.notes
        );
        let values = (0..count)
            .map(|i| if usize::abs_diff(i, wide_at) < count / 5 { 256 } else { (i % 256) as u16 });
        let wide = read_bytes("wide.las", &las(&colors(values.clone()))).unwrap();
        assert_eq!(wide.parts[0].rgb_scale.bits(), 16);
        let rgb = wide.parts[0].columns.rgb.as_ref().unwrap();
        assert!(
            rgb.iter().zip(values).all(|(color, v)| color[0] == (v as f64 / 257.0).round() as u8),
            "wide about {wide_at}"
        );
    }
    let black = read_bytes("black.las", &las(&colors((0..count).map(|_| 0)))).unwrap();
    assert!(black.parts[0].columns.rgb.is_none());
}

#[test]
fn hard_30_the_whole_i32_range_keeps_its_lattice() {
    let extremes = [[i32::MIN, i32::MAX, 0], [i32::MAX, i32::MIN, 0], [-1, 1, i32::MIN]];
    let cloud = read_bytes("extreme.las", &las(&extremes.map(|q| (q, [0; 3])))).unwrap();
    let columns = &cloud.parts[0].columns;
    assert_eq!([columns.x[0], columns.y[0], columns.z[2]], [i32::MIN, i32::MAX, i32::MIN]);
    assert_eq!(cloud.bounds().unwrap().1.x, i32::MAX as f64 * 0.001);
    for scale in [0.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut file = las(&[([1, 2, 3], [0; 3])]);
        file[131..139].copy_from_slice(&scale.to_le_bytes());
        let error = read_bytes("scale.las", &file).unwrap_err().to_string();
        assert!(error.contains("scale"), "{error}");
    }
}

#[test]
fn a_count_below_what_the_file_holds_is_said() {
    let mut file = las(&colors(0..100));
    file[107..111].copy_from_slice(&60u32.to_le_bytes());
    // Non-blank whole records are points, as of an interrupted writer.
    let cloud = read_bytes("low.las", &file).unwrap();
    assert_eq!((cloud.len(), cloud.parts[0].columns.x[99]), (100, 99));
    assert!(
        cloud.notes.iter().any(|note| note
            .contains("header declares 60 points (number of point records), 100 could be read")),
        "{:?}",
        cloud.notes
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("low.las");
    fs::write(&path, &file).unwrap();
    assert!(read_strictly(&path).unwrap_err().to_string().contains("number of point records"));
    // Padding is not, nor is an incomplete record.
    for tail in [vec![0u8; 26 * 3], vec![7u8; 25]] {
        let mut padded = las(&colors(0..100));
        padded.extend(tail);
        let cloud = read_bytes("padded.las", &padded).unwrap();
        assert_eq!(cloud.len(), 100);
    }
}

#[test]
fn las_1_5_is_read_as_1_4() {
    let folder = tempfile::tempdir().unwrap();
    for format in [6, 7, 8] {
        for name in ["a.las", "a.laz"] {
            let modern = |minor| Made {
                minor,
                format,
                points: sheet(|i| [i as u16 * 13; 3]),
                ..Made::default()
            };
            let (old, new) = (
                modern(4).write(folder.path(), &format!("4{name}")),
                modern(5).write(folder.path(), name),
            );
            let (old, new) = (read_strictly(&old).unwrap(), read_strictly(&new).unwrap());
            assert_eq!(new.parts[0].columns, old.parts[0].columns, "{format} {name}");
            assert!(
                new.parts[0].header.format.contains(" 1.5 format"),
                "{}",
                new.parts[0].header.format
            );
        }
    }
    let mut file = Made { minor: 4, format: 6, ..Made::default() }.bytes();
    file[25] = 6;
    assert!(
        read_bytes("6.las", &file).unwrap_err().to_string().contains("supported are 1.0 to 1.5")
    );
}

#[test]
fn negative_scales_are_read_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let mut points = sheet(|_| [0; 3]);
    (points[0].q, points[1].q) = ([0, i32::MIN, 5], [7, i32::MAX, -5]);
    for scale in [[0.001, -0.001, 0.001], [-0.5, 0.25, -0.125]] {
        for name in ["a.las", "b.laz"] {
            let offset = [10.0, 20.0, 30.0];
            let path = Made { scale, offset, points: points.clone(), ..Made::default() }
                .write(folder.path(), name);
            let mut header = fs::read(&path).unwrap();
            // The header distinguishes minimum and maximum.
            for axis in 0..3 {
                let at = 179 + 16 * axis;
                let [a, b] = [at, at + 8]
                    .map(|at| f64::from_le_bytes(header[at..at + 8].try_into().unwrap()));
                header[at..at + 8].copy_from_slice(&a.max(b).to_le_bytes());
                header[at + 8..at + 16].copy_from_slice(&a.min(b).to_le_bytes());
            }
            fs::write(&path, header).unwrap();
            let cloud = read_strictly(&path).unwrap();
            assert!(cloud.parts[0].lattice.step.min_element() > 0.0);
            assert!(
                cloud.notes.iter().any(|note| note.contains("is negative; it is used as given")),
                "{:?}",
                cloud.notes
            );
            for (own, point) in world(&cloud).iter().zip(&points) {
                let right = DVec3::from_array(offset)
                    + DVec3::from_array(scale) * DVec3::from_array(point.q.map(f64::from));
                assert!(
                    (*own - right).abs().max_element() <= 1e-9 * right.abs().max_element(),
                    "{own} {right}"
                );
            }
            // A picked point is that of the file.
            let sought = LookupQuery { position: world(&cloud)[17], ..LookupQuery::default() };
            let found = point_lookup::find(
                std::slice::from_ref(&path),
                ReadOptions::default(),
                &sought,
                &Silent,
            )
            .unwrap()
            .unwrap();
            assert_eq!((found.point, found.extras.user_data), (17, Some(0)));
        }
    }
}

#[test]
fn extra_bytes_without_room_are_said_and_not_listed() {
    let folder = tempfile::tempdir().unwrap();
    let attribute = |kind: u8, name: &str| {
        let mut bytes = vec![0u8; 192];
        bytes[2] = kind;
        bytes[4..4 + name.len()].copy_from_slice(name.as_bytes());
        bytes
    };
    // Two bytes, four, and three times eight.
    let declared =
        [attribute(3, "Amplitude"), attribute(9, "Reflectance"), attribute(30, "Beam")].concat();
    for (extra, fit) in [(0, 0), (1, 0), (2, 1), (6, 2), (29, 2), (30, 3)] {
        let made =
            Made { extra, vlrs: vec![("LASF_Spec", 4, declared.clone())], ..Made::default() };
        let path = made.write(folder.path(), "a.las");
        let cloud = read(&path).unwrap();
        let facts = &cloud.parts[0].header.facts;
        assert_eq!(
            facts.iter().filter(|(what, _)| what == "extra attribute").count(),
            fit,
            "{extra}"
        );
        // Attributes of several numbers are not shown.
        let beam = "Beam: three numbers a point, which --color does not show";
        assert_eq!(facts.iter().any(|(_, name)| name == beam), fit == 3, "{facts:?}");
        assert_eq!(
            cloud.notes.iter().any(|note| note.contains("declares the extra bytes")),
            fit < 3,
            "{extra}: {:?}",
            cloud.notes
        );
        assert_eq!(read_strictly(&path).is_ok(), fit == 3, "{extra}");
        assert_eq!(cloud.len(), 5000);
    }
    // Undeclared bytes are not read.
    let path = Made { extra: 40, vlrs: vec![("LASF_Spec", 4, declared)], ..Made::default() }
        .write(folder.path(), "b.las");
    let cloud = read(&path).unwrap();
    assert!(
        cloud.notes.iter().any(|note| note.contains("has 10 more bytes per point than")),
        "{:?}",
        cloud.notes
    );
    assert!(read_strictly(&path).is_err());
}

#[test]
fn coordinates_beyond_all_steps_are_errors_that_name_the_field() {
    let folder = tempfile::tempdir().unwrap();
    for offset in [1e308, -1e14, f64::INFINITY, f64::NAN] {
        let path =
            Made { offset: [0.0, offset, 0.0], ..Made::default() }.write(folder.path(), "a.las");
        for output in [info(&path), render(&path, "--size 32x32 -o a.png")] {
            let said = failed(&output, 1);
            assert!(said.contains("Y offset"), "{said}");
        }
    }
    let near = Made { offset: [500_000.0, 5_000_000.0, 0.0], scale: [1e-8; 3], ..Made::default() }
        .write(folder.path(), "near.las");
    assert!(read(&near).is_ok());
    for text in ["1e17 1e17 1e17\n", "-1.7e308 0 0\n1.7e308 1 1\n", "1e300 0 0\n1e300 1 1\n"] {
        let path = folder.path().join("far.xyz");
        fs::write(&path, text).unwrap();
        let index = format!("{}", folder.path().join("far.pnti").display());
        for output in [
            info(&path),
            render(&path, "--size 32x32 -o a.png"),
            run([Path::new("index"), &path, Path::new("-o"), Path::new(&index)]),
        ] {
            let said = failed(&output, 1);
            assert!(said.contains("coordinates of up to"), "{said}");
        }
    }
}

fn info(path: &Path) -> std::process::Output {
    run([Path::new("info"), path])
}

#[test]
fn times_and_intensities_are_printed_as_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let mut points = sheet(|_| [0; 3]);
    (points[0].time, points[1].time, points[2].time) = (f64::NAN, -1e301, 1e-300);
    let path = Made { points, ..Made::default() }.write(folder.path(), "a.las");
    let output = info(&path);
    let said = text(&output.stdout);
    assert!(said.contains("-1e301..2499.5; 1 are NaN"), "{said}");
    let json = commands::info(&[&path], "");
    let times = &json["parts"][0]["attributes"]["gps_time"];
    assert_eq!((times["nan"].as_u64(), times["min"].as_f64()), (Some(1), Some(-1e301)));
    let found = |time: f64| {
        point_lookup::Record { gps_time: Some(time), ..point_lookup::Record::default() }.to_string()
    };
    assert!(found(1e301).contains("time 1e301") && found(0.25).contains("time 0.25"));
    // PTS: integers below zero, and fractions.
    for (values, range) in [
        (["-2047", "2046", "0"], "-2047..2046"),
        (["0.1", "0.7", "0.3"], "0.1..0.7"),
        (["12", "70000", "5"], "5..70000"),
    ] {
        let path = folder.path().join("a.ply");
        let lines: String =
            values.iter().enumerate().map(|(i, v)| format!("{i} 0 0 {v}\n")).collect();
        let properties =
            "property float x\nproperty float y\nproperty float z\nproperty float intensity\n";
        fs::write(&path, ply("ascii", properties, 3, lines.as_bytes())).unwrap();
        let said = text(&info(&path).stdout);
        assert!(
            said.lines()
                .any(|line| line.trim_start().starts_with("intensity") && line.ends_with(range)),
            "{said}"
        );
    }
}

#[test]
fn a_ply_whose_lines_end_in_returns_is_read() {
    let head = |coding: &str| {
        format!(
            "ply\rformat {coding} 1.0\rcomment old\relement face 2\rproperty list uchar int i\relement vertex 3\rproperty float x\rproperty float y\rproperty float z\relement edge 1\rproperty int a\rend_header\r"
        )
    };
    // The first byte of the body is that of a line end.
    let mut binary = head("binary_little_endian").into_bytes();
    binary.extend([0, 1, 5, 0, 0, 0]);
    let places =
        [[f32::from_le_bytes([10, 13, 10, 63]), 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]];
    binary.extend(places.iter().flatten().flat_map(|v| v.to_le_bytes()));
    let ascii = head("ascii") + "1 7\r\r2 7 8\r0.5 2 3\r4 5 6\r7 8 9\r3\r";
    for (file, first) in [(binary, places[0][0] as f64), (ascii.into_bytes(), 0.5)] {
        let cloud = read_bytes("a.ply", &file).unwrap();
        assert_eq!(
            world(&cloud),
            [DVec3::new(first, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0), DVec3::new(7.0, 8.0, 9.0)]
        );
        assert!(cloud.notes.is_empty(), "{:?}", cloud.notes);
    }
}

#[test]
fn a_million_coincident_points_are_no_bomb() {
    use laz::{LasZipCompressor, LazItemRecordBuilder, LazItemType, LazVlr};
    for modern in [false, true] {
        let (kind, size, minor, format, head) = if modern {
            (LazItemType::Point14, 30, 4, 6, 375)
        } else {
            (LazItemType::Point10, 20, 2, 0, 227)
        };
        let vlr = LazVlr::from_laz_items(LazItemRecordBuilder::new().add_item(kind).build());
        let mut record = Vec::new();
        vlr.write_to(&mut record).unwrap();
        let mut file = las(&[]);
        file.resize(head, 0);
        (file[25], file[104]) = (minor, format | 128);
        file[94..96].copy_from_slice(&(head as u16).to_le_bytes());
        file[96..100].copy_from_slice(&((head + 54 + record.len()) as u32).to_le_bytes());
        file[100..104].copy_from_slice(&1u32.to_le_bytes());
        file[105..107].copy_from_slice(&(size as u16).to_le_bytes());
        file[107..111].copy_from_slice(&1_000_000u32.to_le_bytes());
        if modern {
            file[247..255].copy_from_slice(&1_000_000u64.to_le_bytes());
        }
        file.extend([0; 2]);
        file.extend(b"laszip encoded\0\0");
        file.extend(22204u16.to_le_bytes());
        file.extend((record.len() as u16).to_le_bytes());
        file.extend([0; 32]);
        file.extend(record);
        let mut sink = std::io::Cursor::new(Vec::new());
        std::io::Write::write_all(&mut sink, &file).unwrap();
        let mut compressor = LasZipCompressor::new(sink, vlr).unwrap();
        let mut point = vec![7u8; size];
        point[14] = 0x11;
        for _ in 0..1_000_000 {
            compressor.compress_one(&point).unwrap();
        }
        compressor.done().unwrap();
        let bytes = compressor.into_inner().into_inner();
        let cloud = read_bytes("coincident.laz", &bytes).unwrap();
        assert_eq!(cloud.len(), 1_000_000);
        assert!(
            cloud.parts[0].columns.x.iter().all(|&x| x == 0x0707_0707),
            "format {format}, {} bytes",
            bytes.len()
        );
        assert_eq!(spacing::spacing(&cloud), None);
    }
}
