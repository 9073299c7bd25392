//! Small valid files of every format, from which fuzzing begins.

use super::forge::together;
use super::readers;
use crate::copc_file::write_copc;
use crate::made::{Las, sheet};
use crate::octree_files::{self, Kind};
use crate::tree::{Shape, plant};
use e57::{E57Writer, Record, RecordDataType, RecordName, RecordValue};
use std::path::Path;

pub const PLY_WORDS: &[&str] = &[
    "element vertex ",
    "property float x\n",
    "property list uchar int vertex_indices\n",
    "format ascii 1.0\n",
    "format binary_little_endian 1.0\n",
    "format binary_big_endian 1.0\n",
    "end_header\n",
    "property uchar red\n",
    "property double nx\n",
    "property ushort intensity\n",
    "nan",
    "inf",
    "1e308",
    "4294967296",
    "comment ",
    "obj_info ",
    "scalar_",
    "f_dc_0",
];
pub const E57_WORDS: &[&str] = &[
    "<cartesianX type=\"Float\"/>",
    "type=\"ScaledInteger\"",
    "minimum=\"",
    "maximum=\"",
    "scale=\"",
    "offset=\"",
    "recordCount=\"",
    "fileOffset=\"",
    "<pose>",
    "<rotation>",
    "<translation>",
    "precision=\"single\"",
    "<vectorChild type=\"Structure\">",
    "<points type=\"CompressedVector\"",
    "1e308",
    "-9223372036854775808",
    "nan",
    "<colorLimits>",
    "<intensityLimits>",
];
pub const TABLE_WORDS: &[&str] = &[
    "x,y,z\n",
    "//X Y Z\n",
    "lat,lon,alt\n",
    "R,G,B",
    "intensity",
    "\"",
    ";",
    "\t",
    ",",
    "\u{feff}",
    "\r\n",
    "1e308",
    "-1.70141E+38",
    "nan",
    "1,5",
    "#",
    "500000.123",
    "class",
    "gps_time",
    "nx",
];
pub const OCTREE_WORDS: &[&str] = &[
    "\"points\":",
    "\"scale\":",
    "\"offset\":",
    "\"boundingBox\":",
    "\"attributes\":",
    "\"encoding\":\"BROTLI\"",
    "\"encoding\":\"DEFAULT\"",
    "\"size\":",
    "\"numElements\":",
    "\"type\":\"double\"",
    "\"min\":",
    "\"max\":",
    "\"schema\":",
    "\"bounds\":",
    "\"dataType\":\"binary\"",
    "\"dataType\":\"laszip\"",
    "\"span\":",
    "1e308",
    "\"0-0-0-0\":",
    "\"1-0-0-0\":",
    "-1",
    "18446744073709551615",
];
pub const INDEX_WORDS: &[&str] = &[
    "\"lattices\":",
    "\"stations\":",
    "\"points\":",
    "\"bounds\":null",
    "1e308",
    "\"balance\":",
    "\"gains\":",
];

fn colored(points: usize) -> Vec<crate::made::Point> {
    sheet(|i| [i as u16 * 13, i as u16, 65_535 - i as u16])[..points].to_vec()
}

pub fn some_las(points: usize) -> Vec<u8> {
    Las { points: colored(points), ..Las::default() }.bytes()
}

/// Returns an index of several nodes of a few points.
pub fn some_tree(folder: &Path) -> Vec<u8> {
    let at: Vec<[i32; 3]> = colored(120).iter().map(|point| point.q).collect();
    let rgb: Vec<[u8; 3]> = (0..at.len()).map(|i| [i as u8; 3]).collect();
    let path = folder.join("tree.pnti");
    plant(&path, &at, &rgb, &Shape { leaf_points: 20, ..Shape::default() });
    std::fs::read(path).expect("an index")
}

pub fn las(_: &Path) -> Vec<Vec<u8>> {
    let declaration = {
        let mut bytes = vec![0u8; 192];
        (bytes[2], bytes[3]) = (9, 0);
        bytes[4..9].copy_from_slice(b"extra");
        bytes
    };
    let of = |(minor, format): (u8, u8)| {
        let vlrs = vec![("LASF_Spec", 4, declaration.clone())];
        Las { minor, format, extra: 4, vlrs, points: colored(12), ..Las::default() }.bytes()
    };
    [(2, 0), (2, 3), (3, 5), (4, 6), (4, 7)].map(of).into()
}

pub fn laz(_: &Path) -> Vec<Vec<u8>> {
    let of = |(minor, format): (u8, u8)| {
        Las { minor, format, points: colored(40), ..Las::default() }.laz()
    };
    [(2, 0), (2, 3), (4, 6), (4, 7)].map(of).into()
}

pub fn copc(folder: &Path) -> Vec<Vec<u8>> {
    let path = folder.join("seed.copc.laz");
    let at: Vec<[i32; 3]> = colored(60).iter().map(|point| point.q).collect();
    write_copc(&path, &at, &vec![[1, 2, 3]; at.len()]);
    vec![std::fs::read(path).expect("a COPC file")]
}

/// Returns the files of a folder as one input.
fn folder_of(folder: &Path, kind: Kind, names: &[&str]) -> Vec<u8> {
    let own = folder.join(format!("{kind:?}"));
    let at: Vec<[i32; 3]> = colored(30).iter().map(|point| point.q).collect();
    octree_files::write(kind, &own, &octree_files::records(&at, &vec![[9, 8, 7]; at.len()]));
    let read = |name: &&str| std::fs::read(own.join(name)).unwrap_or_default();
    together(&names.iter().map(read).collect::<Vec<_>>())
}

pub fn potree(folder: &Path) -> Vec<Vec<u8>> {
    let names = &readers::POTREE_FILES;
    [Kind::PotreePlain, Kind::PotreeBrotli].map(|kind| folder_of(folder, kind, names)).into()
}

pub fn ept(folder: &Path) -> Vec<Vec<u8>> {
    let names = &readers::EPT_FILES;
    [Kind::EptBinary, Kind::EptLaszip].map(|kind| folder_of(folder, kind, names)).into()
}

pub fn ply(_: &Path) -> Vec<Vec<u8>> {
    let head = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment made\nelement vertex 4\nproperty float x\nproperty float y\nproperty double z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty float nx\nproperty float ny\nproperty float nz\nproperty short other\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let binary = |big: bool| {
        let mut bytes = Vec::new();
        let mut put = |own: &[u8]| {
            if big { bytes.extend(own.iter().rev()) } else { bytes.extend(own) }
        };
        for i in 0..4 {
            put(&(i as f32 * 1.5).to_le_bytes());
            put(&(-i as f32).to_le_bytes());
            put(&(i as f64 * 0.1).to_le_bytes());
            (0..3).for_each(|k| put(&[40 * i as u8 + k]));
            (0..3).for_each(|k| put(&(if k == 2 { 1f32 } else { 0.0 }).to_le_bytes()));
            put(&(i as i16 - 2).to_le_bytes());
        }
        put(&[3]);
        (0..3).for_each(|k: i32| put(&k.to_le_bytes()));
        bytes
    };
    let lines = "0 0 0.5 255 0 9 0 0 1 7\n1.5 -1 0.25 0 255 9 0 1 0 -7\n3 -2 1e3 1 2 3 1 0 0 0\n4 4 4 4 4 4 0 0 1 4\n3 0 1 2\n";
    vec![
        (head("ascii") + lines).into_bytes(),
        [head("binary_little_endian").into_bytes(), binary(false)].concat(),
        [head("binary_big_endian").into_bytes(), binary(true)].concat(),
    ]
}

pub fn e57(folder: &Path) -> Vec<Vec<u8>> {
    let write = |name: &str, prototype: Vec<Record>, value: &dyn Fn(i64) -> Vec<RecordValue>| {
        let path = folder.join(name);
        let mut file = E57Writer::from_file(&path, "file").expect("a file");
        let mut scan = file.add_pointcloud("scan", prototype).expect("a scan");
        (0..20).for_each(|i| scan.add_point(value(i)).expect("a point"));
        scan.finalize().expect("a scan");
        file.finalize().expect("a file");
        std::fs::read(path).expect("a file")
    };
    let record = |name, data_type| Record { name, data_type };
    let integer = |min, max| RecordDataType::Integer { min, max };
    let scaled =
        RecordDataType::ScaledInteger { min: -100_000, max: 100_000, scale: 0.001, offset: 5.0 };
    let cartesian = vec![
        record(RecordName::CartesianX, RecordDataType::F64),
        record(RecordName::CartesianY, RecordDataType::F32),
        record(RecordName::CartesianZ, scaled),
        record(RecordName::ColorRed, integer(0, 255)),
        record(RecordName::ColorGreen, integer(0, 255)),
        record(RecordName::ColorBlue, integer(0, 255)),
        record(RecordName::Intensity, RecordDataType::UNIT_F32),
        record(RecordName::CartesianInvalidState, integer(0, 2)),
    ];
    let spherical = vec![
        record(RecordName::SphericalRange, RecordDataType::F64),
        record(RecordName::SphericalAzimuth, RecordDataType::F64),
        record(RecordName::SphericalElevation, RecordDataType::F64),
        record(RecordName::ReturnIndex, integer(0, 3)),
        record(RecordName::ReturnCount, integer(1, 4)),
        record(RecordName::TimeStamp, RecordDataType::F64),
    ];
    let (double, number) = (RecordValue::Double, RecordValue::Integer);
    let place = |i: i64| {
        vec![
            double(i as f64),
            RecordValue::Single(-i as f32),
            RecordValue::ScaledInteger(i * 100),
            number(i),
            number(2 * i),
            number(255 - i),
            RecordValue::Single(i as f32 / 20.0),
            number(i64::from(i == 3)),
        ]
    };
    let angle = |i: i64| {
        let turn = i as f64 / 10.0;
        vec![double(9.0), double(turn), double(turn / 4.0), number(0), number(1), double(turn)]
    };
    vec![write("cartesian.e57", cartesian, &place), write("spherical.e57", spherical, &angle)]
}

fn texts(all: &[&str]) -> Vec<Vec<u8>> {
    all.iter().map(|text| text.as_bytes().to_vec()).collect()
}

pub fn obj(_: &Path) -> Vec<Vec<u8>> {
    texts(&[
        "# made\nv 0 0 0\nv 1.5 0 1\nv 1 1 1 0.5 0.25 1\nvn 0 0 1\nf 1 2 3\n",
        "v 500000.25 5000000.5 97\nv 500001 5000001 98\n",
    ])
}

pub fn table(_: &Path) -> Vec<Vec<u8>> {
    texts(&[
        "x,y,z,red,green,blue,intensity,class\n1,2,3,255,0,0,17,2\n1.5,2.5,3.5,0,255,0,18,6\n-1,0,9,9,9,9,0,0\n",
        "500000.125 5000000.250 97.5 12\n500001.125 5000001.250 98.5 13\n",
        "a;1,5;2,5;3,5\nb;2,5;3,5;4,5\n",
        "lat,lon,alt\n48.1,11.5,500\n48.1001,11.5001,501\n",
        "//X[m] Y[m] Z[m] Rf Gf Bf Nx Ny Nz\n1 2 3 0.5 0.5 1 0 0 1\n2 3 4 0.25 0 1 0 1 0\n",
    ])
}

pub fn ptx(_: &Path) -> Vec<Vec<u8>> {
    let grid = "2\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n5 6 7 1\n0 0 0 0.5\n1 0 0 0.25 9 8 7\n1 1 0 1\n1 1 1 0\n";
    texts(&[grid, &format!("{grid}{grid}")])
}

pub fn pts(_: &Path) -> Vec<Vec<u8>> {
    texts(&[
        "3\n0 0 0 -1000 1 2 3\n1 0 0 200 4 5 6\n1 1 1 2000 7 8 9\n",
        "2\n0 0 0\n1 2 3\n1\n4 5 6\n",
    ])
}
