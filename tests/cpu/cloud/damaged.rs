//! Damaged, lying and absurd files of all formats.

use super::{read, read_bytes, read_strictly};
use crate::shared::shared;
use e57::{
    DateTime, E57Writer, Extension, Quaternion, Record, RecordDataType, RecordName, RecordValue,
    Transform, Translation,
};
use pointillist::cloud::scalar::{Scalar, Scalars};
use pointillist::cloud::{self, ColumnSet, Part, ReadOptions};
use pointillist::error::Error;
use pointillist::progress::Silent;
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

#[test]
fn every_bad_file_ends_in_points_or_an_error_soon_and_small() {
    let Some(bad) = shared("bad") else { return };
    let files = [bad.clone(), bad.join("derived")]
        .into_iter()
        .flat_map(|folder| fs::read_dir(folder).unwrap())
        .map(|entry| entry.unwrap().path());
    for path in files.filter(|path| {
        path.is_file() && path.extension().is_some_and(|extension| extension != "md")
    }) {
        let start = Instant::now();
        let outcome = read(&path);
        assert!(
            start.elapsed() < Duration::from_secs(2),
            "{}: {:?}",
            path.display(),
            start.elapsed()
        );
        if let Err(error) = outcome {
            assert_eq!(error.to_string().lines().count(), 1, "{error}");
        }
    }
    if let Some(kib) = peak_kib() {
        assert!(kib < 256 << 10, "peak {kib} KiB");
    }
}

/// Returns the process's largest resident size so far.
fn peak_kib() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))?
        .trim()
        .trim_end_matches(" kB")
        .parse()
        .ok()
}

#[test]
fn bad_files_with_good_points_are_read_and_what_is_missing_is_said() {
    let Some(bad) = shared("bad") else { return };
    let expected = [
        ("las_zero_points.las", 0, ""),
        ("laz_zero_points.laz", 0, ""),
        ("las_bad_vlr_count.las", 10, "declares 3 variable-length records, but only 2 fit"),
        ("las_lots_of_vlr.las", 1, ""),
        ("las_bad_geotiff_keys.las", 10, ""),
        ("las_header_bounds_unscaled.las", 999, "header declares bounds -235434519"),
        ("las_malformed_extrabytes.las", 10, "header declares bounds"),
        ("las_gps_time_nan.las", 1, ""),
        ("las_bad_return_numbers.las", 1, ""),
        ("laz_duplicates_431k.laz", 431_853, ""),
        ("laz_unsupported_item_v4_pf7.laz", 1024, ""),
        ("laz_1.2r0_no_chunk_table.laz", 1065, ""),
        ("e57_empty.e57", 0, "no scan"),
        ("e57_zero_points.e57", 0, ""),
        ("e57_different_dims.e57", 2, ""),
        ("e57_测试点云.e57", 0, "no scan"),
        ("ply_empty_bin.ply", 0, ""),
        ("ply_points_with_lists.ply", 5, ""),
        ("ply_bad_mesh_indices.ply", 4, ""),
        ("ply_inf_coordinates.ply", 13, "3 points with NaN or infinite coordinates"),
        ("ply_int_coordinates.ply", 16, ""),
        ("ply_extra_whitespace.ply", 3, ""),
        ("ply_crlf_header_binary.ply", 8, ""),
        ("ply_raw_range_grid.ply", 40_097, ""),
        ("obj_out_of_range.obj", 8, ""),
        (
            "derived/d_laz_cut_at_60pct.laz",
            64_556,
            "header declares 110000 points, 64556 could be read",
        ),
        (
            "derived/d_las_count_times_10.las",
            2732,
            "header declares 27320 points, 2732 could be read",
        ),
        (
            "derived/d_las_cut_mid_record.las",
            1261,
            "header declares 2732 points, 1261 could be read",
        ),
        (
            "derived/d_ply_cut_in_vertices.ply",
            33_322,
            "header declares 64365 points, 33322 could be read",
        ),
    ];
    for (name, count, note) in expected {
        let cloud = read(&bad.join(name)).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(cloud.len(), count, "{name}");
        assert!(
            cloud.notes.iter().any(|text| text.contains(note)) || note.is_empty(),
            "{name}: {:?}",
            cloud.notes
        );
    }
    let refused = [
        ("las_no_points_but_count_1065.las", "header declares 1065 points, 0 could be read"),
        ("e57_bad_crc.e57", "checksum"),
        ("ply_empty_header.ply", "no vertex element"),
        ("ply_truncated_header_crash.ply", "header line 7"),
        ("ply_unsized_types_order.ply", "without z"),
        ("empty.ply", "empty"),
        ("derived/d_las_scale_zero.las", "scale 0 0 0"),
    ];
    for (name, what) in refused {
        let error = read(&bad.join(name)).expect_err(name).to_string();
        assert!(error.contains(what), "{error}");
    }
}

#[test]
fn the_decodable_part_of_a_cut_laz_is_a_prefix_of_the_whole() {
    let (Some(whole), Some(cut)) =
        (shared("data/aerial/autzen_trim.laz"), shared("bad/derived/d_laz_cut_at_60pct.laz"))
    else {
        return;
    };
    let (whole, cut) = (read(&whole).unwrap(), read(&cut).unwrap());
    let (whole, cut) = (&whole.parts[0].columns, &cut.parts[0].columns);
    assert_eq!(cut.x, whole.x[..cut.len()]);
    assert_eq!(cut.rgb.as_ref().unwrap()[..], whole.rgb.as_ref().unwrap()[..cut.len()]);
    assert_eq!(cut.intensity.as_ref().unwrap()[..], whole.intensity.as_ref().unwrap()[..cut.len()]);
}

#[test]
fn strict_refuses_what_is_otherwise_kept() {
    let Some(derived) = shared("bad/derived") else { return };
    for name in [
        "d_laz_cut_at_60pct.laz",
        "d_las_count_times_10.las",
        "d_las_cut_mid_record.las",
        "d_ply_cut_in_vertices.ply",
    ] {
        assert!(matches!(read_strictly(&derived.join(name)), Err(Error::Format { .. })), "{name}");
    }
}

#[test]
fn layered_chunks_are_found_without_their_table() {
    let Some(path) = shared("data/formats/las1.4_pf6_rand.laz") else { return };
    let whole = read(&path).unwrap();
    let bytes = fs::read(path).unwrap();
    let points_at = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
    let table_at = u64::from_le_bytes(bytes[points_at..points_at + 8].try_into().unwrap()) as usize;
    let cut = read_bytes("cut.laz", &bytes[..table_at]).unwrap();
    assert_eq!(cut.parts[0].columns, whole.parts[0].columns);
    assert!(cut.notes[0].contains("chunk table is missing"), "{:?}", cut.notes);
    let shorter = read_bytes("cut.laz", &bytes[..table_at - 1]).unwrap();
    assert_eq!(shorter.len(), 768, "three of four chunks of 256");
}

#[test]
fn every_truncation_gives_a_prefix_or_an_error() {
    let names = [
        "data/formats/las1.0_pf0.las",
        "data/formats/las1.2_pf2.laz",
        "data/e57/A_B.e57",
        "bad/ply_crlf_header_binary.ply",
    ];
    for name in names.into_iter().chain([
        "bad/ply_extra_whitespace.ply",
        "bad/las_bad_vlr_count.las",
        "bad/laz_zero_points.laz",
    ]) {
        let Some(path) = shared(name) else { return };
        let whole = read(&path).unwrap();
        let bytes = fs::read(&path).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let cut = folder.path().join(path.file_name().unwrap());
        // Every length near both ends, where headers and tables are; every seventh between.
        for length in (0..bytes.len())
            .filter(|length| length % 7 == 0 || *length < 1000 || bytes.len() - length < 1000)
        {
            fs::write(&cut, &bytes[..length]).unwrap();
            if let Ok(cloud) = read(&cut)
                && let (Some(part), Some(of)) = (cloud.parts.first(), whole.parts.first())
                && part.lattice == of.lattice
            {
                assert!(of.columns.x.starts_with(&part.columns.x), "{name} cut to {length}");
                assert!(
                    part.columns.len() == of.columns.len() || !cloud.notes.is_empty(),
                    "{name} cut to {length} says nothing"
                );
            }
        }
    }
}

#[test]
fn every_lying_header_field_is_survived() {
    let fields: [(usize, usize); 15] = [
        (24, 1),
        (25, 1),
        (94, 2),
        (96, 4),
        (100, 4),
        (104, 1),
        (105, 2),
        (107, 4),
        (111, 4),
        (131, 8),
        (155, 8),
        (227, 8),
        (235, 8),
        (243, 4),
        (247, 8),
    ];
    for name in ["las1.2_pf2.las", "las1.2_pf2.laz", "las1.4_pf6_rand.laz", "las1.4_pf9.las"] {
        let Some(path) = shared(&format!("data/formats/{name}")) else { return };
        let bytes = fs::read(path).unwrap();
        let mut places: Vec<(usize, usize)> =
            fields.into_iter().filter(|(at, _)| *at < 111 || bytes[25] >= 4 || *at < 227).collect();
        // The laszip record: compressor, chunk size, items.
        if let Some(record) = bytes.windows(14).position(|window| window == b"laszip encoded") {
            let contents = record - 2 + 54;
            places.extend([
                (contents, 2),
                (contents + 12, 4),
                (contents + 32, 2),
                (contents + 34, 2),
                (contents + 36, 2),
                (contents + 38, 2),
            ]);
            let points_at = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
            let table_at =
                u64::from_le_bytes(bytes[points_at..points_at + 8].try_into().unwrap()) as usize;
            places.extend([
                (points_at, 8),
                (table_at, 4),
                (table_at + 4, 4),
                (table_at + 8, 4),
                (table_at + 12, 2),
                (points_at + 38, 4),
                (points_at + 42, 4),
            ]);
        }
        for (at, width) in places {
            let mut truth = [0; 8];
            truth[..width].copy_from_slice(&bytes[at..at + width]);
            let truth = u64::from_le_bytes(truth);
            for value in [
                0,
                1,
                truth.wrapping_sub(1),
                truth.wrapping_add(1),
                1 << 31,
                u32::MAX.into(),
                u64::MAX,
                0x7ff0 << 48,
            ] {
                let mut lying = bytes.clone();
                lying[at..at + width].copy_from_slice(&value.to_le_bytes()[..width]);
                let start = Instant::now();
                let _ = read_bytes("lying.las", &lying);
                assert!(
                    start.elapsed() < Duration::from_secs(2),
                    "{name}: {value} at {at} takes {:?}",
                    start.elapsed()
                );
            }
        }
    }
    if let Some(kib) = peak_kib() {
        assert!(kib < 256 << 10, "peak {kib} KiB");
    }
}

#[test]
fn no_byte_of_a_small_laz_or_e57_can_make_a_panic() {
    for name in ["formats/las1.2_pf2.laz", "formats/las1.4_pf6_rand.laz", "e57/A_B.e57"] {
        let Some(path) = shared(&format!("data/{name}")) else { return };
        let bytes = fs::read(path).unwrap();
        for at in (0..bytes.len()).step_by(67) {
            let mut flipped = bytes.clone();
            flipped[at] ^= 1 << (at % 8);
            let _ = read_bytes("flipped", &flipped);
        }
    }
}

#[test]
fn absurd_counts_reserve_nothing() {
    let listless = format!(
        "ply\nformat binary_little_endian 1.0\nelement void {}\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nend_header\n{}",
        1u64 << 60,
        1u64 << 60,
        "\0".repeat(12)
    );
    assert_eq!(read_bytes("a.ply", listless.as_bytes()).unwrap().len(), 1);
    let lists = format!(
        "ply\nformat binary_little_endian 1.0\nelement face {}\nproperty list uchar int i\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
        1u64 << 60
    );
    assert!(read_bytes("a.ply", lists.as_bytes()).is_err());
    let ascii = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n",
        u64::MAX
    );
    assert_eq!(read_bytes("a.ply", ascii.as_bytes()).unwrap().len(), 1);
}

#[test]
fn deep_xml_is_refused() {
    let nested = "<a>".repeat(200_000);
    let error = read_bytes("deep.e57", &e57_with_xml(&nested)).unwrap_err();
    assert!(error.to_string().contains("E57"), "{error}");
}

/// Times count from the start of the scan, returns from 0, and normals turn with the scan. Other
/// fields are scalars.
#[test]
fn every_field_of_e57_points_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fields.e57");
    let integer = |min, max| RecordDataType::Integer { min, max };
    let of = |namespace: &str, name: &str| RecordName::Unknown {
        namespace: namespace.into(),
        name: name.into(),
    };
    let prototype = [
        (RecordName::CartesianX, RecordDataType::F64),
        (RecordName::CartesianY, RecordDataType::F64),
        (RecordName::CartesianZ, RecordDataType::F64),
        (RecordName::RowIndex, integer(0, 100)),
        (RecordName::ColumnIndex, integer(0, 100)),
        (RecordName::ReturnIndex, integer(0, 3)),
        (RecordName::ReturnCount, integer(1, 4)),
        (RecordName::TimeStamp, RecordDataType::F64),
        (RecordName::IsTimeStampInvalid, integer(0, 1)),
        (of("nor", "normalX"), RecordDataType::F32),
        (of("nor", "normalY"), RecordDataType::F32),
        (of("nor", "normalZ"), RecordDataType::F32),
        (of("ext", "reflectance"), RecordDataType::F32),
    ];
    let prototype = prototype.map(|(name, data_type)| Record { name, data_type }).to_vec();
    let mut file = E57Writer::from_file(&path, "file").unwrap();
    for namespace in ["nor", "ext"] {
        file.register_extension(Extension::new(namespace, "http://example.org")).unwrap();
    }
    let mut scan = file.add_pointcloud("scan", prototype).unwrap();
    scan.set_acquisition_start(Some(DateTime { gps_time: 1000.0, atomic_reference: false }));
    let half = 0.5f64.sqrt();
    scan.set_transform(Some(Transform {
        // A quarter turn around z.
        rotation: Quaternion { w: half, x: 0.0, y: 0.0, z: half },
        translation: Translation { x: 0.0, y: 0.0, z: 0.0 },
    }));
    for i in 0..40 {
        let (number, float) = (RecordValue::Integer, RecordValue::Double);
        scan.add_point(vec![
            float(i as f64),
            float(0.0),
            float((i % 7) as f64),
            number(i),
            number(i % 5),
            number(i % 3),
            number(3),
            float(0.5 * i as f64),
            number(i64::from(i == 9)),
            RecordValue::Single(1.0),
            RecordValue::Single(0.0),
            RecordValue::Single(0.0),
            RecordValue::Single(-0.25 * i as f32),
        ])
        .unwrap();
    }
    scan.finalize().unwrap();
    file.finalize().unwrap();
    let wanted = ColumnSet { scalars: Scalars::ALL, ..ColumnSet::ALL };
    let options = ReadOptions::new(wanted, true);
    let cloud = cloud::read(&[path], &options, &Silent).unwrap();
    let Part { columns, header, .. } = &cloud.parts[0];
    assert_eq!(header.scalars, ["extra:rowIndex", "extra:columnIndex", "extra:reflectance"]);
    let numbers = |name: &str| columns.scalar(Scalar::extra(name)).unwrap();
    for i in 0..40 {
        assert_eq!(numbers("rowIndex")[i], i as f64);
        assert_eq!(numbers("columnIndex")[i], (i % 5) as f64);
        assert_eq!(numbers("reflectance")[i], -0.25 * i as f64);
        assert_eq!(columns.returns.as_ref().unwrap()[i] as usize, (i % 3 + 1) | 3 << 4);
        let time = columns.gps_time.as_ref().unwrap()[i];
        assert!(if i == 9 { time.is_nan() } else { time == 1000.0 + 0.5 * i as f64 });
        assert_eq!(columns.normal.as_ref().unwrap()[i], [0, 127, 0]);
    }
}

#[test]
fn an_e57_scan_of_records_without_bits_is_refused() {
    let xml = r#"<?xml version="1.0"?><e57Root type="Structure" xmlns="http://www.astm.org/COMMIT/E57/2010-e57-v1.0">
        <formatName type="String">ASTM E57 3D Imaging Data File</formatName><guid type="String">g</guid>
        <versionMajor type="Integer">1</versionMajor><versionMinor type="Integer">0</versionMinor>
        <data3D type="Vector"><vectorChild type="Structure"><points type="CompressedVector" fileOffset="48" recordCount="1000000000000"><prototype type="Structure">
        <cartesianX type="Integer" minimum="1" maximum="1"/><cartesianY type="Integer" minimum="1" maximum="1"/><cartesianZ type="Integer" minimum="1" maximum="1"/>
        </prototype></points></vectorChild></data3D></e57Root>"#;
    let error = read_bytes("void.e57", &e57_with_xml(xml)).unwrap_err().to_string();
    assert!(error.contains("of zero bytes each"), "{error}");
}

/// Returns an E57 file that is all XML, in pages of 1024 bytes with their checksums.
fn e57_with_xml(xml: &str) -> Vec<u8> {
    let mut header = Vec::from(*b"ASTM-E57");
    header.extend([1u32, 0].map(u32::to_le_bytes).concat());
    let pages = (48 + xml.len()).div_ceil(1020);
    header.extend([pages as u64 * 1024, 48, xml.len() as u64, 1024].map(u64::to_le_bytes).concat());
    header.extend(xml.as_bytes());
    header.resize(pages * 1020, 0);
    header.chunks(1020).flat_map(|page| [page, &crc32c(page).to_be_bytes()].concat()).collect()
}

fn crc32c(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(
            crc ^ byte as u32,
            |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0x82F6_3B78 } else { crc >> 1 },
        )
    })
}

#[test]
fn what_is_no_file_is_a_typed_error() {
    let folder = tempfile::tempdir().unwrap();
    assert!(matches!(read(folder.path()), Err(Error::Format { .. })));
    assert!(matches!(read(&folder.path().join("none.las")), Err(Error::Io { .. })));
    let pipe = folder.path().join("pipe.las");
    if std::process::Command::new("mkfifo").arg(&pipe).status().is_ok_and(|status| status.success())
    {
        assert!(matches!(read(&pipe), Err(Error::Format { .. })));
    }
    if Path::new("/dev/zero").exists() {
        assert!(matches!(read(Path::new("/dev/zero")), Err(Error::Format { .. })));
    }
}
