//! Depths (`raw.Z`) agree with f64 for each format and camera. The reference is computed from the
//! numbers that the test wrote, not from what readers made of them.

use crate::cameras::{orthographic, perspective};
use crate::gpu::{Way, bare, draw};
use crate::points::{Random, bumpy};
use e57::{E57Writer, Record, RecordValue};
use glam::DVec3;
use pointillist::cloud::{self, Cloud, Lattice, ReadOptions};
use pointillist::passes::project::Precision;
use pointillist::progress::Silent;
use pointillist::render::settings::RenderSettings;
use pointillist::study::oracle::project::{self, Agreement};
use pointillist::synth::chunk::{Chunk, Lattice as FileLattice};
use pointillist::synth::las_file::LasFile;
use pointillist::view::{Camera, View};
use std::io::Write;
use std::path::Path;

const UTM: DVec3 = DVec3::new(500_000.0, 5_000_000.0, 100.0);
const SCALE: f64 = 0.001;

/// Contents of a file: integers with scale and offset, or numbers.
enum Written {
    Scaled(Vec<[i32; 3]>),
    Numbers(Vec<DVec3>),
}

impl Written {
    fn relative(&self, eye: DVec3) -> Vec<DVec3> {
        let lattice = Lattice { step: DVec3::splat(SCALE), offset: UTM };
        match self {
            Written::Scaled(points) => {
                points.iter().map(|q| project::relative(&lattice, q.map(i64::from), eye)).collect()
            }
            Written::Numbers(points) => points.iter().map(|p| *p - eye).collect(),
        }
    }
}

/// Returns surfaces 20 m wide, and a patch of 2 m around the origin in millimetres, for the camera
/// that is a millimetre away.
fn surfaces() -> Vec<[i32; 3]> {
    let random = &mut Random(0xF0);
    let (mut points, _) = bumpy(60_000, 20_000, random);
    points.extend((0..30_000).map(|_| {
        [
            random.within(-60.0, 60.0) as i32,
            random.within(-60.0, 60.0) as i32,
            -2 - (random.bits() % 2) as i32,
        ]
    }));
    points
}

/// Returns the same surfaces as numbers with all digits.
fn numbers() -> Vec<DVec3> {
    let random = &mut Random(0xF1);
    let scatter =
        |random: &mut Random| DVec3::from_array([0; 3].map(|_: i32| random.within(-0.5, 0.5)));
    surfaces()
        .iter()
        .map(|q| UTM + (DVec3::from_array(q.map(f64::from)) + scatter(random)) * SCALE)
        .collect()
}

fn cameras() -> Vec<(&'static str, Camera)> {
    let at = |x, y, z| UTM + DVec3::new(x, y, z);
    let far = at(0.6e6, -0.7e6, 0.4e6);
    vec![
        ("outside", perspective(at(17.0, -23.0, 11.0), UTM, 50.0)),
        ("inside", perspective(at(0.31, 0.22, 0.57), at(4.0, 1.0, 0.0), 75.0)),
        ("far away", perspective(far, UTM, (20.0 / (far - UTM).length()).to_degrees())),
        ("1 mm away", perspective(at(0.0005, 0.0002, -0.001), at(0.0005, 0.0012, -0.002), 60.0)),
        ("orthographic", orthographic(at(5.0, 6.0, 30.0), at(0.1, 0.2, 0.3), 19.0)),
        ("orthographic, far away", orthographic(far, UTM, 21.0)),
        (
            "orthographic, 1 mm away",
            orthographic(at(0.0005, 0.0002, -0.001), at(0.0005, 0.0012, -0.002), 0.05),
        ),
    ]
}

/// Draws the file from everywhere, with both precisions.
fn agrees(name: &str, write: impl FnOnce(&Path) -> Written) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    let written = write(&path);
    let cloud: Cloud =
        cloud::read(&[path], &ReadOptions { strict: true, ..ReadOptions::default() }, &Silent)
            .unwrap();
    assert_eq!(
        (cloud.parts.len(), cloud.len() as usize),
        (1, written.relative(UTM).len()),
        "{name}"
    );
    let part = &cloud.parts[0];
    // Decimals are kept to the last digit. Other numbers are kept to the nearest step of a lattice
    // of less than 2^30 steps, found with one division and one difference in f64: half a step, and
    // an ulp of the coordinate.
    let is_decimal = part.lattice.step.x.log2().fract() != 0.0;
    let moved = match written {
        Written::Scaled(_) => DVec3::ZERO,
        Written::Numbers(_) if is_decimal => DVec3::splat(f64::EPSILON) * (UTM + 20.0),
        Written::Numbers(_) => part.lattice.step * 0.5 + f64::EPSILON * (UTM + 20.0),
    };
    assert!(
        part.lattice.step.max_element() <= f64::max(SCALE, 20.0 / (1 << 29) as f64)
            && moved.max_element() < 1e-7,
        "{name}: {}",
        part.lattice.step
    );
    let (mut total, mut covered) = (Agreement::default(), Vec::new());
    for (place, camera) in cameras() {
        for precision in [Precision::Auto, Precision::Planes(3)] {
            let view = View::new(camera, [331, 257]).unwrap();
            let layers =
                draw(Way::Compute64, &cloud, &view, &RenderSettings { precision, ..bare() });
            let source = project::Source::new(part, &view, precision, moved);
            let agreement =
                project::check(&view, &[(source, written.relative(camera.eye))], &layers.depth);
            assert_eq!(agreement.objection(), None, "{name}, {place}, {precision:?}");
            layers.assert_finite();
            assert!(
                agreement.covered + agreement.in_band > 100,
                "{name}, {place}: hardly anything is seen: {agreement:?}"
            );
            covered.push((place, agreement.in_band, agreement.expected_in_band.round()));
            total.pixels += agreement.pixels;
            total.agreeing += agreement.agreeing;
            total.in_band += agreement.in_band;
            total.expected_in_band += agreement.expected_in_band;
        }
    }
    println!(
        "{name}: {} pixels, {} agree, {} in the band ({:.0} expected), 0 wrong; {covered:?}",
        total.pixels, total.agreeing, total.in_band, total.expected_in_band
    );
}

fn las(path: &Path) -> Written {
    let points = surfaces();
    let lattice = FileLattice { step: SCALE, offset: UTM };
    let mut chunk = Chunk::new(lattice, points.len());
    for [x, y, z] in &points {
        chunk.x.push(*x);
        chunk.y.push(*y);
        chunk.z.push(*z);
        chunk.rgb.push([*x as u16, *y as u16, 65_535]);
        [&mut chunk.intensity, &mut chunk.source].into_iter().for_each(|column| column.push(1));
        chunk.class.push(2);
        chunk.returns.push((1, 1));
        chunk.gps_time.push(0.0);
        chunk.scan_angle.push(0);
    }
    let mut file = LasFile::create(path, lattice, points.len() as u64).unwrap();
    file.write(&chunk).unwrap();
    file.finish().unwrap();
    Written::Scaled(points)
}

#[test]
fn hard_00_raw_z_agrees_with_f64_las() {
    agrees("surfaces.las", las);
}

#[test]
fn hard_00_raw_z_agrees_with_f64_laz() {
    agrees("surfaces.laz", las);
}

fn ply(
    path: &Path,
    coding: &str,
    number: &str,
    points: &[DVec3],
    vertex: impl Fn(&mut Vec<u8>, DVec3),
) {
    let mut bytes =
        format!("ply\nformat {coding} 1.0\nelement vertex {}\n", points.len()).into_bytes();
    for axis in ["x", "y", "z"] {
        writeln!(bytes, "property {number} {axis}").unwrap();
    }
    bytes.extend(b"end_header\n");
    points.iter().for_each(|p| vertex(&mut bytes, *p));
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn hard_00_raw_z_agrees_with_f64_ply() {
    agrees("ascii.ply", |path| {
        let points = numbers();
        // Rust writes the shortest decimal that reads back as the same f64.
        ply(path, "ascii", "double", &points, |bytes, p| {
            writeln!(bytes, "{} {} {}", p.x, p.y, p.z).unwrap()
        });
        Written::Numbers(points)
    });
    for (coding, big) in [("binary_little_endian", false), ("binary_big_endian", true)] {
        agrees(&format!("{coding}.ply"), |path| {
            let points = numbers();
            let bytes_of = |v: f64| if big { v.to_be_bytes() } else { v.to_le_bytes() };
            ply(path, coding, "double", &points, |bytes, p| {
                p.to_array().map(|v| bytes.extend(bytes_of(v))).into_iter().collect()
            });
            Written::Numbers(points)
        });
    }
}

#[test]
fn hard_00_raw_z_agrees_with_f64_xyz() {
    agrees("surfaces.xyz", |path| {
        let mut text = String::new();
        // Surveyors write six decimals. The reference is what these digits say.
        let lines =
            numbers().iter().map(|p| p.to_array().map(|v| format!("{v:.6}"))).collect::<Vec<_>>();
        lines.iter().for_each(|line| text += &(line.join(" ") + "\n"));
        std::fs::write(path, text).unwrap();
        Written::Numbers(
            lines
                .iter()
                .map(|line| DVec3::from_array(line.each_ref().map(|v| v.parse().unwrap())))
                .collect(),
        )
    });
}

#[test]
fn hard_00_raw_z_agrees_with_f64_e57() {
    agrees("surfaces.e57", |path| {
        let points = numbers();
        let mut file = E57Writer::from_file(path, "file").unwrap();
        let mut scan = file
            .add_pointcloud(
                "scan",
                vec![Record::CARTESIAN_X_F64, Record::CARTESIAN_Y_F64, Record::CARTESIAN_Z_F64],
            )
            .unwrap();
        for p in &points {
            scan.add_point(p.to_array().map(RecordValue::Double).to_vec()).unwrap();
        }
        scan.finalize().unwrap();
        file.finalize().unwrap();
        Written::Numbers(points)
    });
}
