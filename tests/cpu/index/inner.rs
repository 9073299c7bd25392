//! Inner nodes resemble their children, and are no larger than needed.

use super::crafted::{field, first_version, number, signed, with_contents};
use super::*;

#[test]
fn samples_of_several_stations_are_means_of_what_all_have_with_one_exposure() {
    let place = Place::new();
    let file = place.at("street.las");
    scan(&file, SceneKind::Street, 500_000);
    let index = place.faithful(&[file], &OPTIONS);
    assert!(
        index.directory.contents.balance.is_some()
            && index.nodes().iter().any(|node| !node.is_leaf())
    );
    // An index without exposures reports none.
    place.write("first.pnti", &first_version(&fs::read(place.at("a.pnti")).unwrap()));
    let first = Index::open(&place.at("first.pnti")).unwrap();
    assert_eq!(
        first.directory.contents,
        Contents {
            balance: None,
            intensity_balance: None,
            counts: None,
            ..index.directory.contents.clone()
        }
    );
    // Too few, too many, and impossible ones.
    let bytes = fs::read(place.at("a.pnti")).unwrap();
    let json = number(&bytes, 24) as usize + index.nodes().len() * field::BYTES;
    let contents: serde_json::Value = serde_json::from_slice(&bytes[json..]).unwrap();
    for gains in [
        &[1.0; 4][..],
        &[1.0; 6],
        &[1.0, 1.0, 1.0, 1.0, 0.0],
        &[1.0, 1.0, 1.0, 1.0, -1.0],
        &[1.0, 1.0, 17.0, 1.0, 1.0],
    ] {
        let mut contents = contents.clone();
        contents["balance"]["gains"] = gains.into();
        let contents = serde_json::to_vec(&contents).unwrap();
        let crafted = signed(with_contents(&bytes, json, &contents));
        let error = Index::open(&place.write("crafted.pnti", &crafted))
            .err()
            .expect("impossible exposures were taken")
            .to_string();
        assert!(error.contains("exposures"), "{error}");
    }
}

#[test]
fn the_heaviest_class_of_a_cell_is_its_class() {
    // 2^18 pairs of cells' corners, far from each other: three points of one class and two of
    // another in each.
    let mut points = Vec::new();
    for i in 0..1i32 << 17 {
        let corner = [i % 512 * 1024, i / 512 * 1024, 0];
        let (many, few) = if i % 2 == 0 { (2, 9) } else { (6, 5) };
        let five = [many, few, many, few, many];
        points.extend(five.into_iter().enumerate().map(|(k, class)| Point {
            q: [corner[0] + k as i32 % 2, corner[1] + k as i32 / 2, 0],
            class,
            rgb: [1000; 3],
            ..Point::default()
        }));
    }
    let place = Place::new();
    let index = place.faithful(&[place.las("a.las", &points, MILLIMETRES)], &OPTIONS);
    let root = decode(&index, 0).unwrap();
    assert!(!index.nodes()[0].is_leaf());
    // A cell of the root holds whole groups of five, and in even columns only even ones.
    for i in 0..root.q.len() {
        let class = root.get::<1>(Plane::Class, i).unwrap()[0];
        assert!(class == 2 || class == 6, "class {class}");
        assert_eq!(root.weight(i) % 5, 0);
    }
}

#[test]
fn colours_of_8_and_16_bits_and_none() {
    let place = Place::new();
    let colored = |color: &dyn Fn(u16) -> u16| -> Vec<Point> {
        (0..70_000u32)
            .map(|i| Point {
                q: [i as i32; 3],
                rgb: [color(i as u16), 0, color(7)],
                ..Point::default()
            })
            .collect()
    };
    let first = |index: &Index| {
        decode(index, index.nodes().iter().position(NodeRecord::is_leaf).unwrap()).unwrap()
    };
    let narrow = place.las("8.las", &colored(&|v| v & 255), MILLIMETRES);
    let index = place.faithful(std::slice::from_ref(&narrow), &OPTIONS);
    assert_eq!(
        (0..256).map(|i| first(&index).get::<3>(Plane::Rgb, i).unwrap()[0]).collect::<Vec<_>>(),
        (0..=255).collect::<Vec<_>>()
    );
    assert_eq!(index.directory.contents.parts[0].rgb_bits, 8);
    let wide = place.las("16.las", &colored(&|v| v), MILLIMETRES);
    let index = place.faithful(std::slice::from_ref(&wide), &OPTIONS);
    assert_eq!(first(&index).get::<3>(Plane::Rgb, 257 * 9).unwrap(), [9, 0, 0]);
    assert_eq!(index.directory.contents.parts[0].rgb_bits, 16);
    let black = place.las("0.las", &colored(&|_| 0), MILLIMETRES);
    let index = place.faithful(std::slice::from_ref(&black), &OPTIONS);
    assert!(index.nodes().iter().all(|node| !node.has(Plane::Rgb)));
    // Together: all black counts as no colours, and is shown white.
    place.faithful(&[narrow, black.clone(), wide], &OPTIONS);
    place.faithful(&[black.clone(), black], &OPTIONS);
}

#[test]
fn only_what_is_wanted_is_kept() {
    let place = Place::new();
    let file = place.las("a.las", &shape(Shape::Uniform, 5000, [0; 3], [9999; 3], 1), MILLIMETRES);
    place
        .build(
            std::slice::from_ref(&file),
            "a.pnti",
            &Options { wanted: ColumnSet { class: true, ..ColumnSet::default() }, ..OPTIONS },
        )
        .unwrap();
    let index = Index::open(&place.at("a.pnti")).unwrap();
    for (plane, _) in PLANES {
        let expected = [Plane::Coarse, Plane::Fine, Plane::Class].contains(&plane);
        assert!(index.nodes().iter().all(|node| node.has(plane) == expected), "{plane:?}");
    }
}

#[test]
fn position_colour_intensity_and_class_take_at_most_20_bytes_a_point() {
    let place = Place::new();
    scan(&place.at("street.las"), SceneKind::Street, 2_000_000);
    let summary = place.build(&[place.at("street.las")], "a.pnti", &OPTIONS).unwrap();
    let bytes = summary.core_bytes as f64 / summary.points as f64;
    println!("{bytes} bytes a point, {} in all", summary.bytes as f64 / summary.points as f64);
    assert!(bytes <= 20.0, "{bytes}");
}
