//! PLY and text with known contents, and arbitrary ones.

use super::{read_bytes, world};
use glam::DVec3;
use proptest::prelude::*;

/// Returns a PLY file.
pub(super) fn ply(coding: &str, properties: &str, count: usize, body: &[u8]) -> Vec<u8> {
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
