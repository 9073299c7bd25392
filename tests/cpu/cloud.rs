//! Readers, on real files, on hostile ones, and on generated ones with known contents.
//!
//! Real and bad files lie in `../shared`; tests that need it are skipped if it is missing.

use crate::commands::{self, run};
use crate::made::{Las as Made, sheet};
use crate::program::{failed, render, text};
use crate::shared::shared;
use e57::{
    DateTime, E57Writer, Extension, Quaternion, Record, RecordDataType, RecordName, RecordValue,
    Transform, Translation,
};
use glam::DVec3;
use pointillist::cloud::point_lookup::{self, Extras, LookupQuery};
use pointillist::cloud::scalar::{Scalar, Scalars};
use pointillist::cloud::{self, Cloud, ColumnSet, Columns, Part, ReadOptions, spacing};
use pointillist::error::{Error, Result};
use pointillist::progress::{Progress, Silent};
use pointillist::render::source::{Source, bounds_of};
use pointillist::select::clip::Clips;
use pointillist::synth::{self, SceneKind};
use pointillist::view::{Camera, Preset, View};
use proptest::prelude::*;
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

fn read(path: &Path) -> Result<Cloud> {
    cloud::read(&[path.to_owned()], &ReadOptions::new(ColumnSet::ALL, false), &Silent)
}

fn read_strictly(path: &Path) -> Result<Cloud> {
    cloud::read(&[path.to_owned()], &ReadOptions::new(ColumnSet::ALL, true), &Silent)
}

/// Reads bytes as a file of this name, which is removed afterwards.
fn read_bytes(name: &str, bytes: &[u8]) -> Result<Cloud> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, bytes).unwrap();
    read(&path)
}

/// Returns a LAS 1.2 file, point format 2, scale 0.001.
fn las(points: &[([i32; 3], [u16; 3])]) -> Vec<u8> {
    let mut file = vec![0u8; 227];
    file[..4].copy_from_slice(b"LASF");
    (file[24], file[25], file[104]) = (1, 2, 2);
    file[94..96].copy_from_slice(&227u16.to_le_bytes());
    file[96..100].copy_from_slice(&227u32.to_le_bytes());
    file[105..107].copy_from_slice(&26u16.to_le_bytes());
    file[107..111].copy_from_slice(&(points.len() as u32).to_le_bytes());
    for axis in 0..3 {
        file[131 + 8 * axis..139 + 8 * axis].copy_from_slice(&0.001f64.to_le_bytes());
        let (lo, hi) = points
            .iter()
            .fold((i32::MAX, i32::MIN), |(lo, hi), (q, _)| (lo.min(q[axis]), hi.max(q[axis])));
        file[179 + 16 * axis..187 + 16 * axis].copy_from_slice(&(hi as f64 * 0.001).to_le_bytes());
        file[187 + 16 * axis..195 + 16 * axis].copy_from_slice(&(lo as f64 * 0.001).to_le_bytes());
    }
    for (position, color) in points {
        position.iter().for_each(|q| file.extend(q.to_le_bytes()));
        file.extend([0; 8]);
        color.iter().for_each(|v| file.extend(v.to_le_bytes()));
    }
    file
}

fn colors(values: impl Iterator<Item = u16>) -> Vec<([i32; 3], [u16; 3])> {
    values.enumerate().map(|(i, v)| ([i as i32, 0, 1], [v, 0, v])).collect()
}

fn world(cloud: &Cloud) -> Vec<DVec3> {
    let place = |part: &cloud::Part, i: usize| {
        part.lattice.world([
            part.columns.x[i].into(),
            part.columns.y[i].into(),
            part.columns.z[i].into(),
        ])
    };
    cloud
        .parts
        .iter()
        .flat_map(|part| (0..part.columns.len()).map(|i| place(part, i)).collect::<Vec<_>>())
        .collect()
}

// ---- real files

#[test]
fn las_and_laz_twins_hold_the_same_columns() {
    let Some(formats) = shared("data/formats") else { return };
    for name in ["las1.2_pf2", "las1.3_pf5", "las1.4_pf9"] {
        let plain = read(&formats.join(format!("{name}.las"))).unwrap();
        let packed = read(&formats.join(format!("{name}.laz"))).unwrap();
        assert_eq!(plain.parts[0].columns, packed.parts[0].columns, "{name}");
        assert_eq!(plain.parts[0].lattice, packed.parts[0].lattice, "{name}");
    }
}

#[test]
fn copc_holds_the_points_of_its_las_twin_in_another_order() {
    let Some(formats) = shared("data/formats") else { return };
    let sorted = |name: &str| {
        let cloud = read(&formats.join(name)).unwrap();
        let mut places: Vec<_> = world(&cloud)
            .into_iter()
            .map(|p| (p * 100.0).round().as_i64vec3().to_array())
            .collect();
        places.sort();
        places
    };
    assert_eq!(sorted("las1.2_pf3.las"), sorted("las1.2_pf3.copc.laz"));
}

#[test]
fn counts_and_bounds_are_those_of_the_points() {
    // The digits given in the table of ../shared/data/README.md.
    let table = [
        (
            "aerial/autzen_trim.laz",
            110_000,
            [636001.8, 848935.2, 406.3],
            [637179.2, 849497.9, 520.5],
            0.05,
        ),
        (
            "aerial/sample_c.las",
            14_408,
            [674521.9, 1206740.1, 627.5],
            [674605.3, 1206815.0, 656.2],
            0.05,
        ),
        (
            "aerial/4_6_crop.las",
            23_875,
            [1639600.0, 1454500.0, 7077.9],
            [1639800.0, 1454700.0, 7139.7],
            0.05,
        ),
        (
            "ground/pine_plot.laz",
            114_024,
            [0.0001, 0.0001, 49.0418],
            [9.9998, 9.9998, 69.3673],
            1e-9,
        ),
        (
            "e57/pumpARowColumnIndexNoInvalidPoints.e57",
            155_201,
            [-2.9038, -5.3011, -1.8997],
            [1.7216, -0.7926, 1.8430],
            5e-5,
        ),
        ("e57/bunnyInt19.e57", 30_571, [-0.0947, 0.0400, -0.0619], [0.0610, 0.1873, 0.0588], 5e-5),
        ("e57/A_B.e57", 6, [-44.9522, -1.3493, -0.6077], [-42.6395, 2.0578, 0.6667], 5e-5),
        (
            "photogrammetry/frag_115.ply",
            64_365,
            [0.8398, 0.9180, 0.5664],
            [2.5724, 2.8135, 1.6089],
            5e-5,
        ),
        (
            "objects/stanford_dragon_437k.ply",
            437_645,
            [-0.1083, 0.0527, -0.0504],
            [0.0966, 0.1972, 0.0412],
            5e-5,
        ),
        (
            "objects/bun_zipper.ply",
            35_947,
            [-0.0947, 0.0330, -0.0619],
            [0.0610, 0.1873, 0.0588],
            5e-5,
        ),
        (
            "objects/armadillo.obj",
            43_243,
            [-0.4353, -0.5734, -0.3795],
            [0.4033, 0.4265, 0.3833],
            5e-5,
        ),
        (
            "formats/las1.4_pf6_rand.laz",
            1024,
            [-2141972467.0, -2147415560.0, -2147167116.0],
            [2131726195.0, 2139347682.0, 2146599318.0],
            0.0,
        ),
    ];
    let Some(data) = shared("data") else { return };
    for (name, count, lo, hi, tolerance) in table {
        let cloud = read(&data.join(name)).unwrap();
        assert_eq!(cloud.len(), count, "{name}");
        let (own_lo, own_hi) = cloud.bounds().unwrap();
        let off =
            (own_lo - DVec3::from_array(lo)).abs().max((own_hi - DVec3::from_array(hi)).abs());
        assert!(off.max_element() <= tolerance * 1.001, "{name}: {own_lo} {own_hi}");
    }
}

#[test]
fn attributes_are_those_of_the_table() {
    let Some(data) = shared("data") else { return };
    let cloud = read(&data.join("aerial/sample_c.las")).unwrap();
    let columns = &cloud.parts[0].columns;
    assert_eq!(cloud.parts[0].rgb_scale.bits(), 16);
    assert_eq!(cloud::range(columns.intensity.as_ref().unwrap()), Some((103, 2687)));
    assert_eq!(cloud.stations.len(), 4);
    assert_eq!(cloud.stations.iter().map(|station| station.points).sum::<u64>(), 14_408);
    let mut classes = columns.class.clone().unwrap();
    classes.sort();
    classes.dedup();
    assert_eq!(classes.len(), 8);

    let black = read(&data.join("aerial/4_6_crop.las")).unwrap();
    assert!(black.parts[0].columns.rgb.is_none(), "colours that are all 0 are no colours");
    let scans = read(&data.join("e57/A_B.e57")).unwrap();
    assert_eq!(scans.stations.iter().map(|station| station.points).collect::<Vec<_>>(), [2, 4]);
}

#[test]
fn several_files_are_several_parts_in_their_order() {
    let Some(data) = shared("data") else { return };
    let paths = [
        data.join("formats/las1.2_pf2.las"),
        data.join("e57/A_B.e57"),
        data.join("objects/armadillo.obj"),
    ];
    let cloud = cloud::read(&paths, &ReadOptions::default(), &Silent).unwrap();
    assert_eq!(
        cloud.parts.iter().map(|part| part.columns.len()).collect::<Vec<_>>(),
        [1065, 2, 4, 43_243]
    );
    assert_eq!(cloud.stations.iter().map(|station| station.part).collect::<Vec<_>>(), [0, 1, 2, 3]);
    assert!(
        cloud.parts.iter().all(|part| part.columns.rgb.is_none() && part.columns.source.is_none()),
        "nothing else was wanted"
    );
}

#[test]
fn laz_layers_that_are_not_wanted_change_nothing_else() {
    let Some(data) = shared("data") else { return };
    let path = data.join("formats/las1.4_pf9.laz");
    let all = read(&path).unwrap();
    let wanted = ColumnSet { intensity: true, ..ColumnSet::default() };
    let some = cloud::read(&[path], &ReadOptions::new(wanted, true), &Silent).unwrap();
    assert_eq!(all.parts[0].columns.z, some.parts[0].columns.z);
    assert_eq!(all.parts[0].columns.intensity, some.parts[0].columns.intensity);
}

#[test]
fn an_interrupted_reading_ends_at_once() {
    struct Impatient;
    impl Progress for Impatient {
        fn tick(&self, _doing: &str, _done: u64, _total: u64) -> Result<()> {
            Err(Error::Interrupted)
        }
    }
    let Some(data) = shared("data") else { return };
    let names = [
        "aerial/sample_c.las",
        "aerial/autzen_trim.laz",
        "photogrammetry/frag_115.ply",
        "objects/bun_zipper.ply",
        "objects/armadillo.obj",
    ];
    for name in names.into_iter().chain(["e57/pumpARowColumnIndexNoInvalidPoints.e57"]) {
        let outcome = cloud::read(&[data.join(name)], &ReadOptions::default(), &Impatient);
        assert!(matches!(outcome, Err(Error::Interrupted)), "{name}");
    }
}

// ---- bad files

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

// ---- generated LAS

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

// ---- generated PLY and text

fn ply(coding: &str, properties: &str, count: usize, body: &[u8]) -> Vec<u8> {
    let mut file = format!(
        "ply\r\nformat {coding} 1.0\r\nelement vertex {count}\r\n{properties}end_header\r\n"
    )
    .into_bytes();
    file.extend(body);
    file
}

const XYZ: &str = "property float x\r\nproperty double y\r\nproperty float z\r\n";

#[test]
fn ply_colours_of_all_kinds_become_the_same_bytes() {
    let kinds =
        [("uchar", "0 128 255", 8), ("float", "0 0.50196 1", 8), ("ushort", "0 32896 65535", 16)];
    for (kind, values, bits) in kinds {
        let properties =
            format!("{XYZ}property {kind} red\nproperty {kind} green\nproperty {kind} blue\n");
        let cloud = read_bytes(
            "color.ply",
            &ply("ascii", &properties, 1, format!("1 2 3 {values}\n").as_bytes()),
        )
        .unwrap();
        assert_eq!(cloud.parts[0].columns.rgb, Some(vec![[0, 128, 255]]), "{kind}");
        assert_eq!(cloud.parts[0].rgb_scale.bits(), bits, "{kind}");
    }
    let properties =
        format!("{XYZ}property float red\nproperty float green\nproperty float blue\n");
    let cloud =
        read_bytes("odd.ply", &ply("ascii", &properties, 2, b"1 2 3 nan 0.5 2\n1 2 4 -1 1 1\n"))
            .unwrap();
    assert_eq!(cloud.parts[0].columns.rgb, Some(vec![[0, 128, 255], [0, 255, 255]]));
    assert!(
        cloud
            .notes
            .iter()
            .any(|note| note.contains("clamped NaN or out-of-range colours of 2 points")),
        "{:?}",
        cloud.notes
    );
}

#[test]
fn ply_lists_among_the_vertex_properties_are_passed_over() {
    let properties = "property list uchar short near\nproperty float x\nproperty float y\nproperty list uchar uchar more\nproperty float z\n";
    let mut body = Vec::new();
    for i in 0..3u8 {
        body.extend([i]);
        body.extend(vec![9; 2 * i as usize]);
        body.extend((i as f32).to_be_bytes());
        body.extend(2f32.to_be_bytes());
        body.extend([1, 77]);
        body.extend((i as f32 / 2.0).to_be_bytes());
    }
    let binary = read_bytes("lists.ply", &ply("binary_big_endian", properties, 3, &body)).unwrap();
    let ascii = read_bytes(
        "lists.ply",
        &ply("ascii", properties, 3, b"0 0 2 1 77 0\n1 9 1 2 1 77 0.5\n2 9 9 2 2 1 77 1\n"),
    )
    .unwrap();
    assert_eq!(
        world(&binary),
        [DVec3::new(0.0, 2.0, 0.0), DVec3::new(1.0, 2.0, 0.5), DVec3::new(2.0, 2.0, 1.0)]
    );
    assert_eq!(world(&binary), world(&ascii));
}

#[test]
fn text_columns_are_known_by_name_or_guessed() {
    let cases: [(&str, &str, bool, bool, bool); 8] = [
        ("a.xyz", "1 2 3\n4 5 6\n", false, false, false),
        ("b.csv", "X;Y;Z;Intensity\n1;2;3;10\n4;5;6;20\n", false, true, false),
        ("c.csv", "//X,Y,Z,R,G,B\n1,2,3,255,0,0\n4,5,6,0,255,0\n", true, false, false),
        ("d.txt", "# made by hand\n1\t2\t3\t255\t0\t9\n4 5 6 7 8 9\n", true, false, false),
        ("e.xyz", "1 2 3 0 0 -1\n4 5 6 1 0 0\n", false, false, true),
        // Nothing that is a normal.
        ("n.csv", "x,y,z,nx,ny,nz\n1,2,3,nan,nan,nan\n4,5,6,0,0,0\n", false, false, false),
        ("f.pts", "2\n1 2 3 -5 200 1 2\n4 5 6 7 8 9 10\n", true, true, false),
        ("g.txt", "1 2 3 0.5 1 0 7\n4 5 6 7 1 2 3\n", true, true, false),
    ];
    for (name, text, rgb, intensity, normal) in cases {
        let cloud = read_bytes(name, text.as_bytes()).unwrap_or_else(|error| panic!("{error}"));
        let columns = &cloud.parts[0].columns;
        assert_eq!(world(&cloud), [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)], "{name}");
        assert_eq!(
            (columns.rgb.is_some(), columns.intensity.is_some(), columns.normal.is_some()),
            (rgb, intensity, normal),
            "{name}"
        );
        assert!(
            !cloud.notes.iter().any(|note| note.contains("are not points")),
            "{name}: {:?}",
            cloud.notes
        );
    }
    let cloud = read_bytes("bad.xyz", b"1 2 3\nno point\n4 5\n7 8 9\nnan 0 0\n").unwrap();
    assert_eq!(cloud.len(), 2);
    assert!(
        cloud.notes.iter().any(|note| note.contains("2 lines are not points")),
        "{:?}",
        cloud.notes
    );
    assert!(read_bytes("none.xyz", b"nothing here\n").is_err());
}

#[test]
fn long_text_is_read_in_order_across_blocks() {
    let count = 700_000;
    let text: String = (0..count).map(|i| format!("{i}.25 {} -7\n", i % 1000)).collect();
    assert!(text.len() > 8 << 20, "more than one block");
    let cloud = read_bytes("long.xyz", text.as_bytes()).unwrap();
    assert_eq!(cloud.len(), count);
    assert!(
        world(&cloud)
            .iter()
            .enumerate()
            .all(|(i, p)| *p == DVec3::new(i as f64 + 0.25, (i % 1000) as f64, -7.0))
    );
}

#[test]
fn integer_coordinates_get_a_lattice_of_whole_steps() {
    let cloud = read_bytes("whole.xyz", b"500000 5000000 7\n500003 5000001 9\n").unwrap();
    assert_eq!(cloud.parts[0].lattice.step, DVec3::ONE);
    assert_eq!(cloud.parts[0].columns.x, [0, 3]);
    let huge = read_bytes("huge.xyz", b"-1.7e100 0 0\n1.7e100 1 1\n").unwrap();
    assert!(
        huge.bounds().unwrap().0.is_finite()
            && huge.notes.iter().any(|note| note.contains("steps of"))
    );
    let tiny = read_bytes("tiny.xyz", b"0 0 0\n1e-320 0 0\n").unwrap();
    assert_eq!(tiny.len(), 2);
}

// ---- spacing

#[test]
fn spacing_of_a_grid_is_that_of_its_eight_neighbours_with_or_without_a_stray_point() {
    let grid = |stray: &str| {
        let text: String = (0..90_000)
            .map(|i| format!("{} {} 0\n", (i % 300) as f64 * 0.5, (i / 300) as f64 * 0.5))
            .collect();
        spacing::spacing(&read_bytes("grid.xyz", (text + stray).as_bytes()).unwrap()).unwrap()
    };
    // Eight on a disc whose radius is the diagonal of a cell.
    let expected = 0.5 * (std::f64::consts::PI * 2.0 / 8.0).sqrt();
    assert!((grid("") - expected).abs() < 1e-9);
    let start = Instant::now();
    assert!((grid("1e9 1e9 1e9\n") - expected).abs() < 1e-9);
    assert!(start.elapsed() < Duration::from_secs(1));
}

#[test]
fn spacing_is_the_quartile_that_brute_force_finds() {
    // At most as many points as seeds, so that every point is one.
    let mut state = 1u64;
    let mut next = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 40) as f64 / 65536.0
    };
    let text: String =
        (0..1501).map(|_| format!("{} {} {}\n", next(), next(), next() * next())).collect();
    let cloud = read_bytes("random.xyz", text.as_bytes()).unwrap();
    let points = world(&cloud);
    let eighth = |p: &DVec3| {
        let mut squares: Vec<f64> =
            points.iter().map(|q| p.distance_squared(*q)).filter(|square| *square > 0.0).collect();
        squares.sort_by(f64::total_cmp);
        (std::f64::consts::PI * squares[7] / 8.0).sqrt()
    };
    let mut apart: Vec<f64> = points.iter().map(eighth).collect();
    apart.sort_by(f64::total_cmp);
    let found = spacing::spacing(&cloud).unwrap();
    assert!((found - apart[1125]).abs() < 1e-12, "{found} {}", apart[1125]);
    // In any order.
    let mut lines: Vec<&str> = text.lines().collect();
    lines.reverse();
    assert_eq!(
        spacing::spacing(&read_bytes("random.xyz", lines.join("\n").as_bytes()).unwrap()),
        Some(found)
    );
}

// ---- generated points

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, ..ProptestConfig::default() })]

    #[test]
    fn arbitrary_bytes_never_panic(tail in prop::collection::vec(any::<u8>(), 0..2000), kind in 0..7usize) {
        let (name, magic): (&str, &[u8]) = [
            ("a.las", b"LASF".as_slice()),
            ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\nproperty float y\nproperty float z\nend_header\n"),
            ("a.ply", b"ply\nformat binary_big_endian 1.0\nelement face 3\nproperty list int int i\nelement vertex 9\nproperty list uchar uint8 a\nproperty float x\nproperty double y\nproperty char z\nend_header\n"),
            ("a.e57", b"ASTM-E57\x01\0\0\0\0\0\0\0"),
            ("a.xyz", b"1 2 3 4 5 6\n"),
            ("a.obj", b"v 1 2 3\nv "),
            ("a.ply", b"ply\n"),
        ][kind];
        let _ = read_bytes(name, &[magic, &tail].concat());
    }

    #[test]
    fn arbitrary_words_never_panic(words in prop::collection::vec("(ply|format ascii 1\\.0|element vertex [0-9]{1,3}|property (float|list uchar int|ushort) [xyz]|end_header|-?[0-9]{1,5}|nan|inf|v)[ \n]", 0..60)) {
        for name in ["a.ply", "a.xyz", "a.obj"] {
            let _ = read_bytes(name, format!("ply\n{}", words.concat()).as_bytes());
            let _ = read_bytes(name, words.concat().as_bytes());
        }
    }

    #[test]
    fn float_points_come_back_to_half_a_step(points in prop::collection::vec([-1e6f32..1e6, -1e6f32..1e6, -10f32..10.0], 1..200), big in any::<bool>()) {
        let bytes = |v: &f32| if big { v.to_be_bytes() } else { v.to_le_bytes() };
        let body: Vec<u8> = points.iter().flatten().flat_map(bytes).collect();
        let coding = if big { "binary_big_endian" } else { "binary_little_endian" };
        let properties = "property float x\nproperty float y\nproperty float z\n";
        let binary = read_bytes("a.ply", &ply(coding, properties, points.len(), &body)).unwrap();
        let text: String = points.iter().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect();
        let ascii = read_bytes("a.ply", &ply("ascii", properties, points.len(), text.as_bytes())).unwrap();
        let half = binary.parts[0].lattice.step.x / 2.0;
        let extent = binary.bounds().unwrap().1 - binary.bounds().unwrap().0;
        prop_assert!(extent.max_element() <= half * 2.0 * 2f64.powi(30));
        for ((back, again), point) in world(&binary).iter().zip(world(&ascii)).zip(&points) {
            let off = (*back - DVec3::from_array(point.map(f64::from))).abs().max_element();
            prop_assert!(off <= half, "{off} {half}");
            // Text gives each f32 its shortest decimal, which as f64 is a slightly different
            // number.
            prop_assert!((*back - again).abs().max_element() <= 2.0 * half + 0.04);
        }
    }

    #[test]
    fn text_points_come_back_to_half_a_step(points in prop::collection::vec([-1e7f64..1e7, -1e3f64..1e3, -1f64..1.0], 1..200), separator in "[ ,;\t]") {
        let text: String = points.iter().map(|[x, y, z]| format!("{x}{separator}{y}{separator}{z}\r\n")).collect();
        let cloud = read_bytes("a.csv", text.as_bytes()).unwrap();
        prop_assert_eq!(cloud.len(), points.len() as u64);
        let half = cloud.parts[0].lattice.step.x / 2.0;
        for (back, point) in world(&cloud).iter().zip(&points) {
            prop_assert!((*back - DVec3::from_array(*point)).abs().max_element() <= half * (1.0 + 1e-9));
        }
    }
}

/// Compares all attributes of a point with those read by the crate `las` from the first record to
/// the last.
#[test]
fn a_point_that_is_looked_up_comes_with_every_attribute_of_its_file() {
    let [mut colours, mut extras] = [0; 2];
    for name in [
        "formats/las1.4_pf3_extrabytes.las",
        "formats/las1.2_pf3.copc.laz",
        "formats/las1.4_pf9.laz",
        "aerial/ign_rgb16_nir_697k.laz",
    ] {
        let Some(path) = shared(&format!("data/{name}")) else { return };
        let all = las::Reader::from_path(&path).unwrap().read_points(u64::MAX).unwrap();
        let records: Vec<las::Point> = all.points().map(std::result::Result::unwrap).collect();
        let part = &read(&path).unwrap().parts[0];
        let position = |i: usize| {
            part.lattice
                .world([part.columns.x[i], part.columns.y[i], part.columns.z[i]].map(i64::from))
        };
        for i in [0, part.columns.len() / 2, part.columns.len() - 1] {
            let sought = LookupQuery { position: position(i), ..LookupQuery::default() };
            let found = point_lookup::find(
                std::slice::from_ref(&path),
                ReadOptions::default(),
                &sought,
                &Silent,
            )
            .unwrap()
            .unwrap();
            let record = &records[found.point as usize];
            assert_eq!(
                [record.x, record.y, record.z].map(|c| (c * 1e3).round()),
                position(i).to_array().map(|c| (c * 1e3).round()),
                "{name}"
            );
            let colour = record.color.map(|color| [color.red, color.green, color.blue]);
            assert!(found.rgb.is_none() || found.rgb == colour, "{name}: {found:?}");
            let Extras { near_infrared, scan_angle_deg, user_data, extra_bytes, .. } = found.extras;
            assert_eq!(
                (near_infrared, scan_angle_deg, user_data),
                (record.nir, Some(record.scan_angle), Some(record.user_data)),
                "{name}"
            );
            assert_eq!(
                (extra_bytes, found.intensity),
                (record.extra_bytes.clone(), Some(record.intensity as f64)),
                "{name}"
            );
            colours +=
                found.rgb.is_some_and(|rgb| rgb.iter().any(|&channel| channel > 255)) as usize;
            extras += (!record.extra_bytes.is_empty()) as usize;
        }
    }
    assert!(colours > 0 && extras > 0, "{colours} wide colours, {extras} with extra bytes");
}

/// Meshes carry an intensity that most vertices share; the others would be specks on them.
#[test]
fn an_intensity_that_most_points_share_is_not_shown_on_its_own() {
    use pointillist::cloud::attribute::{Attribute, DisplayAttribute};
    let shown = |sharing: usize| {
        let point = |i: usize| {
            let intensity = if i < sharing { 0.5 } else { i as f64 / 1000.0 };
            format!("{} {} {} {intensity}\n", i % 10, i / 10, i % 7)
        };
        let header = "ply\nformat ascii 1.0\nelement vertex 100\nproperty float x\nproperty float y\n\
                      property float z\nproperty float intensity\nend_header\n";
        let file = header.to_string() + &(0..100).map(point).collect::<String>();
        let cloud = read_bytes("mesh.ply", file.as_bytes()).unwrap();
        DisplayAttribute::automatic(&cloud).0.attribute
    };
    assert_eq!([0, 40].map(shown), [Attribute::Intensity; 2]);
    assert_eq!([60, 100].map(shown), [Attribute::Elevation; 2]);
}

/// What filters and boxes leave is seen to its edges, from all sides: what is left of trees and
/// poles there is little, and apart.
#[test]
fn views_frame_everything_that_boxes_and_filters_leave() {
    let world = synth::build(SceneKind::Street, 1, 0.1);
    let street = || synth::collect("street", &world, 60_000, 1, 0.02, &Silent).unwrap();
    let [low, high] = bounds_of(&places(&street())).unwrap();
    let part = |from: [f64; 3], to: [f64; 3]| {
        let [from, to] = [from, to].map(|share| low + (high - low) * DVec3::from(share));
        let [[x0, y0, z0], [x1, y1, z1]] = [from, to].map(|corner| corner.to_array());
        format!("box:{x0},{y0},{z0},{x1},{y1},{z1}")
    };
    let filters = ["", "building", "high-vegetation", "z=..104", "intensity=..16000"];
    let boxes = [
        None,
        Some(part([-1.0, -1.0, 0.5], [2.0, 2.0, 2.0])),
        Some(part([0.0, 0.3, 0.3], [0.45, 0.8, 0.9])),
        Some(part([0.6, 0.0, 0.05], [1.0, 0.3, 0.6])),
        Some(part([0.2, 0.45, 0.1], [0.25, 0.5, 0.4])),
    ];
    let mut seen = 0;
    for filter in filters {
        let mut cloud = street();
        cloud.filter(&filter.parse().unwrap()).unwrap();
        let (left, source) = (places(&cloud), Source::Files(cloud));
        for own in &boxes {
            if filter.is_empty() && own.is_none() {
                continue;
            }
            let clips = Clips(own.iter().map(|text| text.parse().unwrap()).collect());
            let left: Vec<DVec3> = left.iter().copied().filter(|&p| clips.keep(p)).collect();
            let framed = source.framed_points(&clips);
            for preset in [Preset::Fit, Preset::Top, Preset::Front, Preset::Side, Preset::Iso] {
                let size = [640, 400];
                let view = View::new(Camera::framing(preset, &framed, size), size).unwrap();
                for p in &left {
                    let [x, y] = view.pixel(*p).expect("in front");
                    let is_seen = (0.0..640.0).contains(&x) && (0.0..400.0).contains(&y);
                    assert!(is_seen, "{preset:?}, {filter} {own:?}: {p} is at {x}, {y}");
                }
            }
            seen += left.len();
        }
    }
    assert!(seen > 100_000, "{seen}");
}

fn places(cloud: &Cloud) -> Vec<DVec3> {
    let of = |part: &Part| -> Vec<DVec3> {
        let Columns { x, y, z, .. } = &part.columns;
        (0..x.len()).map(|i| part.lattice.world([x[i], y[i], z[i]].map(i64::from))).collect()
    };
    cloud.parts.iter().flat_map(of).collect()
}
