//! Readers, on real files, on hostile ones, and on generated ones with known contents.
//!
//! Real and bad files lie in `../shared`; tests that need it are skipped if it is missing.

mod damaged;
mod generated_las;
mod text_and_ply;

use crate::shared::shared;
use glam::DVec3;
use pointillist::cloud::point_lookup::{self, Extras, LookupQuery};
use pointillist::cloud::{self, Cloud, ColumnSet, Columns, Part, ReadOptions, spacing};
use pointillist::error::{Error, Result};
use pointillist::progress::{Progress, Silent};
use pointillist::render::source::{Source, bounds_of};
use pointillist::select::clip::Clips;
use pointillist::synth::{self, SceneKind};
use pointillist::view::{Camera, Preset, View};
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
