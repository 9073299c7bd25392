//! Every point is in one leaf, bit by bit, whatever the clouds are. The bytes depend on the points
//! alone.

use super::*;

/// Least corners and sides of boxes: small, flat and long, and as large as there are.
const BOXES: [([i32; 3], [u32; 3]); 5] = [
    ([0; 3], [1000; 3]),
    ([-7; 3], [1, 0, 2]),
    ([-500_000_000, 3, -1], [1_000_000_000, 1000, 1]),
    ([i32::MIN; 3], [u32::MAX; 3]),
    ([i32::MIN, 0, i32::MAX - 9], [u32::MAX, 5, 9]),
];

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn small_clouds_of_any_shape_are_kept_bit_by_bit(
        which in 0..SHAPES.len(), extent in 0..BOXES.len(), shrink in prop::array::uniform3(0u32..32), count in 1usize..400, seed: u64,
        scale in prop::array::uniform3(1e-4..1.0f64), offset in prop::array::uniform3(-1e7..1e7f64), threads in 1usize..3,
    ) {
        let (low, sides) = BOXES[extent];
        let sides = [0, 1, 2].map(|axis| sides[axis] >> shrink[axis]);
        let place = Place::new();
        let file = place.las("a.las", &shape(SHAPES[which], count, low, sides, seed), Frame { step: scale, offset, stated: None });
        place.faithful(&[file], &Options { threads, ..OPTIONS });
    }
}

#[test]
fn large_clouds_of_any_shape_are_kept_bit_by_bit() {
    for (number, (low, sides)) in BOXES.into_iter().enumerate() {
        for which in SHAPES {
            // Half of them fill many leaves.
            let count = if (number + which as usize).is_multiple_of(2) { 300_000 } else { 70_000 };
            let place = Place::new();
            let file = place.las("a.las", &shape(which, count, low, sides, 5), MILLIMETRES);
            let index = place.faithful(&[file], &OPTIONS);
            println!("{which:?} in {sides:?}: {} nodes", index.nodes().len());
        }
    }
}

#[test]
fn one_point_and_two_points_as_far_apart_as_can_be() {
    let place = Place::new();
    let ends = [point([i32::MIN; 3], 1), point([i32::MAX; 3], 2)];
    for (points, nodes) in [(&ends[..1], 1), (&ends[1..], 1), (&ends, 3), (&[ends[0], ends[0]], 1)]
    {
        let file = place.las("a.las", points, MILLIMETRES);
        assert_eq!(place.faithful(&[file], &OPTIONS).nodes().len(), nodes);
    }
}

#[test]
fn an_empty_cloud_is_an_index_without_nodes() {
    let place = Place::new();
    let index = place.faithful(&[place.las("none.las", &[], MILLIMETRES)], &OPTIONS);
    assert_eq!(
        (index.nodes().len(), index.directory.roots, index.directory.contents.points),
        (0, 0, 0)
    );
    let some = place.las("some.las", &[point([1; 3], 1)], MILLIMETRES);
    assert_eq!(place.faithful(&[place.at("none.las"), some], &OPTIONS).nodes().len(), 1);
}

#[test]
fn a_million_coincident_points_are_leaves_of_the_same_bytes_in_any_order() {
    let place = Place::new();
    let points: Vec<Point> = (0..1_000_000).map(|i| point([5, -6, 7], i)).collect();
    let file = place.las("a.las", &points, MILLIMETRES);
    let index = place.faithful(std::slice::from_ref(&file), &OPTIONS);
    let leaves: Vec<u32> =
        index.nodes().iter().filter(|node| node.is_leaf()).map(|node| node.count).collect();
    assert_eq!(leaves.len(), 1_000_000usize.div_ceil(POINTS_PER_PAGE as usize));
    assert_eq!((index.nodes()[0].count, index.nodes()[0].points), (1, 1_000_000));
    let bytes = fs::read(place.at("a.pnti")).unwrap();
    place.write("a.las", &shuffled(&fs::read(&file).unwrap()));
    let summary =
        place.build(&[file], "a.pnti", &Options { memory: 64 << 20, threads: 1, ..OPTIONS });
    assert!(fs::read(place.at("a.pnti")).unwrap() == bytes);
    // Through the temporary file, since points in one place are sorted there.
    println!("{} bytes spilled", summary.unwrap().spilled_bytes);
}

fn files_below(folder: PathBuf, most: u64) -> Vec<PathBuf> {
    let mut folders = vec![folder];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap()) {
            match entry.metadata().unwrap() {
                found if found.is_dir() => folders.push(entry.path()),
                found
                    if found.len() <= most
                        && entry.path().extension().is_some_and(|extension| extension != "md") =>
                {
                    files.push(entry.path())
                }
                _ => {}
            }
        }
    }
    files.sort();
    files
}

#[test]
fn real_files_are_kept_bit_by_bit() {
    let Some(data) = shared("data") else { return };
    let files = files_below(data, 4_000_000);
    assert!(files.len() >= 20, "{} files", files.len());
    for (i, file) in files.into_iter().enumerate() {
        let index = Place::new()
            .faithful(std::slice::from_ref(&file), &Options { threads: 1 + i % 2, ..OPTIONS });
        println!(
            "{}: {} points in {} nodes",
            file.display(),
            index.directory.contents.points,
            index.nodes().len()
        );
    }
}

#[test]
fn real_files_of_every_format_are_kept_together() {
    let mut files = Vec::new();
    for name in [
        "e57/A_B.e57",
        "e57/ColouredCubeFloat.e57",
        "aerial/sample_c.las",
        "aerial/4_6_crop.las",
        "formats/las1.4_pf9.laz",
    ] {
        let Some(file) = shared(&format!("data/{name}")) else { return };
        files.push(file);
    }
    files.push(shared("data/photogrammetry/frag_115.ply").unwrap());
    let index = Place::new().faithful(&files, &OPTIONS);
    assert!(trees(&index) >= 5 && index.directory.roots == 1, "{} trees", trees(&index));
}

#[test]
fn files_on_one_lattice_become_one_tree_and_others_their_own_below_one_root() {
    let place = Place::new();
    let cloud = |seed| shape(Shape::Plane, 40_000, [-1000; 3], [5000; 3], seed);
    let shifted = Frame { offset: [123.456, -7.0, 1e6 * 0.001], ..MILLIMETRES };
    let coarse = Frame { step: [0.001, 0.001, 0.002], ..MILLIMETRES };
    let between = Frame { offset: [0.0005, 0.0, 0.0], ..MILLIMETRES };
    let file = |name: &str, seed, frame| place.las(name, &cloud(seed), frame);
    let files = [
        file("a.las", 1, MILLIMETRES),
        file("b.las", 2, shifted),
        file("c.las", 3, coarse),
        file("d.las", 4, between),
    ];
    for (which, count) in [(&files[..2], 1), (&files[..3], 2), (&files[1..3], 2), (&files, 3)] {
        let index = place.faithful(which, &OPTIONS);
        assert_eq!((index.directory.roots, trees(&index)), (1, count));
        assert!(index.directory.contents.stations.len() >= which.len());
    }
    // Twice the same.
    let index = place.faithful(&[files[0].clone(), files[0].clone()], &OPTIONS);
    assert_eq!((index.directory.roots, index.directory.contents.points), (1, 80_000));
}

/// Lattices that leaves lie on.
fn trees(index: &Index) -> usize {
    index
        .nodes()
        .iter()
        .filter(|node| node.is_leaf())
        .map(|node| node.lattice)
        .collect::<BTreeSet<_>>()
        .len()
}

#[test]
fn a_hundred_files_on_lattices_of_their_own_cost_a_view_no_more_than_one() {
    let place = Place::new();
    let side = 200_000;
    let cloud = shape(Shape::Plane, 400_000, [0; 3], [side; 3], 11);
    let whole = place.las("whole.las", &cloud, MILLIMETRES);
    let tile = |i: i32| {
        // Each with an offset that is no whole number of steps from any other's.
        let at = |q: i32| (10 * q as i64 / (side as i64 + 1)) as i32;
        let own: Vec<Point> = cloud
            .iter()
            .filter(|point| at(point.q[0]) == i % 10 && at(point.q[1]) == i / 10)
            .copied()
            .collect();
        place.las(
            &format!("{i}.las"),
            &own,
            Frame { offset: [1e-3 * (0.137 + 0.0071 * i as f64), 0.0, 0.0], ..MILLIMETRES },
        )
    };
    let tiles: Vec<PathBuf> = (0..100).map(tile).collect();
    let many = place.faithful(&tiles, &OPTIONS);
    assert_eq!((trees(&many), many.directory.roots), (100, 1));
    let two = contents_of_nodes(&many);
    assert!(
        contents_of_nodes(
            &place.index(&tiles, &Options { threads: 1, memory: 64 << 20, ..OPTIONS })
        ) == two,
        "threads, or memory"
    );
    let one = place.index(&[whole], &OPTIONS);
    let [low, high] = one.directory.contents.bounds.unwrap();
    let camera = Camera::framing(Preset::Fit, &[low, high], [320, 180]);
    let view = View::new(camera, [320, 180]).unwrap();
    for budget in [70_000, 150_000, 300_000] {
        let detail = Detail { budget, ..Detail::of([320, 180]) };
        let points = [&one, &many].map(|index| {
            lod::choose(index, &[view], &Clips::default(), &detail, &HashSet::new()).points
        });
        println!("budget {budget}: {} points of one file, {} of a hundred", points[0], points[1]);
        assert!(points.iter().all(|&points| points <= budget), "{points:?}");
        assert!(points[1] <= 2 * points[0].max(65_536), "{points:?}");
    }
}

#[test]
fn files_too_far_apart_for_one_lattice_are_refused_with_a_reason() {
    let place = Place::new();
    let near = place.las("near.las", &[point([i32::MAX; 3], 1)], MILLIMETRES);
    let far = place.las(
        "far.las",
        &[point([i32::MIN; 3], 1)],
        Frame { offset: [-1000.0; 3], ..MILLIMETRES },
    );
    let error = place.build(&[near, far], "a.pnti", &OPTIONS).unwrap_err().to_string();
    assert!(error.contains("apart"), "{error}");
}

#[test]
fn more_than_fits_the_memory_goes_through_a_file_and_full_buckets_are_split() {
    let place = Place::new();
    scan(&place.at("street.las"), SceneKind::Street, 2_000_000);
    let street = cloud::read(&[place.at("street.las")], &READ, &Silent).unwrap();
    let Lattice { step, offset } = street.parts[0].lattice;
    // Half a million points in a few centimetres, on the same lattice, counted from elsewhere.
    let blob = shape(Shape::Uniform, 500_000, [-40_000; 3], [64; 3], 9);
    let frame = Frame {
        step: step.to_array(),
        offset: (offset + step * 40_100.0).to_array(),
        stated: None,
    };
    let files = [place.at("street.las"), place.las("blob.las", &blob, frame)];
    let little = Options { memory: 64 << 20, threads: 1, ..OPTIONS };
    let summary = place.build(&files, "b.pnti", &little).unwrap();
    assert!(summary.spilled_bytes > 4 << 20, "{} bytes spilled", summary.spilled_bytes);
    place.faithful(&files, &little);
    let bytes = |options: &Options| {
        place.build(&files, "b.pnti", options).unwrap();
        fs::read(place.at("b.pnti")).unwrap()
    };
    let one = bytes(&little);
    assert!(bytes(&Options { threads: 2, ..little }) == one, "threads");
    assert!(bytes(&OPTIONS) == one, "memory");
    assert_eq!(Index::open(&place.at("b.pnti")).unwrap().directory.roots, 1);
}

#[test]
fn derived_planes_have_the_same_bytes_whatever_the_memory() {
    let place = Place::new();
    scan(&place.at("a.las"), SceneKind::Street, 300_000);
    let [much, little] = [OPTIONS.memory, 64 << 20].map(|memory| {
        let options = Options { memory, derive: DerivedPlanes::ALL, ..OPTIONS };
        place.build(&[place.at("a.las")], "b.pnti", &options).unwrap();
        fs::read(place.at("b.pnti")).unwrap()
    });
    assert!(much == little);
}

/// The same places are counted from elsewhere in the integers.
#[test]
fn a_shift_between_offset_and_integers_changes_no_plane() {
    let place = Place::new();
    let points = shape(Shape::Clusters, 90_000, [-70_000, 5, 9], [140_000, 70_000, 30_000], 3);
    let planes = |shift: [i32; 3]| {
        let mut there = points.clone();
        there.iter_mut().for_each(|point| {
            (0..3).for_each(|axis| point.q[axis] += shift[axis]);
        });
        // A power of two, so that places are the same to the last bit.
        let (step, offset) = ([1.0 / 1024.0; 3], shift.map(|steps| steps as f64 / -1024.0));
        let file = place.las("a.las", &there, Frame { step, offset, stated: None });
        let options = Options { derive: DerivedPlanes::ALL, ..OPTIONS };
        let index = place.index(&[file], &options);
        let of_node = |number: usize| {
            let node = &index.nodes()[number];
            (node.extent, node.children, node.spacing, decode(&index, number).unwrap().planes)
        };
        (0..index.nodes().len()).map(of_node).collect::<Vec<_>>()
    };
    let here = planes([0; 3]);
    for shift in [[1, 0, 0], [1 << 28, -(1 << 27) + 5, 77], [-(1 << 29) + 1, 3, 1 << 29]] {
        assert!(planes(shift) == here, "{shift:?}");
    }
}

#[test]
fn a_header_that_lies_about_its_box_changes_no_point() {
    let points = shape(Shape::Clusters, 90_000, [-70_000, 5, 9], [140_000, 70_000, 3], 3);
    let everywhere = [[2147483.0, -2147483.0]; 3];
    for (what, stated) in [
        ("too small", [[0.01, 0.0]; 3]),
        ("elsewhere", [[5000.0, 4000.0]; 3]),
        ("too large", everywhere),
        ("beyond the lattice", [[1e30, -1e30]; 3]),
        ("NaN", [[f64::NAN; 2]; 3]),
        ("one NaN", [[f64::NAN, 0.0], [1.0, 0.0], [1.0, 0.0]]),
        ("infinite", [[f64::INFINITY, f64::NEG_INFINITY]; 3]),
        ("inverted", [[0.0, 100.0]; 3]),
        ("zero", [[0.0; 2]; 3]),
    ] {
        println!("{what}");
        let place = Place::new();
        let file = place.las("a.las", &points, Frame { stated: Some(stated), ..MILLIMETRES });
        place.faithful(std::slice::from_ref(&file), &OPTIONS);
        if !what.contains("NaN") {
            assert!(
                place
                    .build(
                        std::slice::from_ref(&file),
                        "strict.pnti",
                        &Options { strict: true, ..OPTIONS }
                    )
                    .is_err()
            );
        }
        // Beside another that lies about the same lattice.
        let other = Frame {
            offset: [1_000_000.0; 3],
            stated: Some(everywhere.map(|range| range.map(|v| v + 1_000_000.0))),
            ..MILLIMETRES
        };
        let other = place.las("b.las", &points, other);
        place.faithful(&[file, other], &OPTIONS);
    }
}

#[test]
fn extreme_lattices_are_kept_exactly() {
    let points = shape(Shape::Uniform, 400, [i32::MIN; 3], [u32::MAX; 3], 3);
    for step in [1e-300, 1e-100, 1e-7, 0.1, 1.0 / 3.0, 1e100 / 2f64.powi(31), 1e300 / 2f64.powi(31)]
    {
        for offset in [0.0, 0.1, -4_999_999.999_999_9, 1e99, 1e299] {
            let place = Place::new();
            let file = place.las(
                "a.las",
                &points,
                Frame { step: [step; 3], offset: [offset, -offset, 0.0], stated: None },
            );
            // Beyond, coordinates are not told apart, or their cubes are not finite.
            let is_far = offset.abs() / step + 2f64.powi(31) > 2f64.powi(53);
            let [finest, farthest] = Lattice::LIMITS;
            if is_far || step < finest || step * 2f64.powi(31) > farthest {
                let error = cloud::read(&[file], &READ, &Silent).unwrap_err().to_string();
                let field = if is_far { "has the X offset" } else { "they must lie" };
                let says = ["has x coordinates", field].iter().any(|what| error.contains(what));
                assert!(says, "{step} {offset}: {error}");
                continue;
            }
            let index = place.index(std::slice::from_ref(&file), &OPTIONS);
            let cloud = cloud::read(&[file], &READ, &Silent).unwrap();
            assert_eq!(
                index.directory.contents.lattices[0],
                [cloud.parts[0].lattice.step, cloud.parts[0].lattice.offset]
            );
            assert!(leaf_rows(&index, &cloud) == rows(&index, &cloud), "{step} {offset}");
        }
    }
}

#[test]
fn lattices_come_back_to_the_last_bit() {
    let place = Place::new();
    for i in 0..100 {
        let random = |k: u64| {
            f64::from_bits(
                noise(6 * i + k) & !(0x7FF << 52) | (1023 - 10 + 30 * (k >= 3) as u64) << 52,
            )
            .abs()
        };
        let frame = Frame {
            step: [random(0), random(1), random(2)],
            offset: [random(3), random(4), random(5)],
            stated: None,
        };
        let index = place.index(&[place.las("a.las", &[point([1, 2, 3], 1)], frame)], &OPTIONS);
        let [step, offset] = index.directory.contents.lattices[0];
        assert_eq!((step.to_array(), offset.to_array()), (frame.step, frame.offset));
    }
}

#[test]
fn threads_and_the_order_of_the_file_change_no_byte() {
    let place = Place::new();
    // Points that coincide, and colours of which only a few show that they have 16 bits.
    let mut points = shape(Shape::Corner, 600_000, [0; 3], [40_000; 3], 7);
    points.iter_mut().enumerate().for_each(|(i, point)| {
        if i % 60_000 != 0 {
            point.rgb = point.rgb.map(|v| v & 255);
        }
    });
    let file = place.las("a.las", &points, MILLIMETRES);
    let sorted = fs::read(&file).unwrap();
    place.faithful(std::slice::from_ref(&file), &OPTIONS);
    let bytes = fs::read(place.at("a.pnti")).unwrap();
    for threads in [1, 3] {
        place
            .build(std::slice::from_ref(&file), "b.pnti", &Options { threads, ..OPTIONS })
            .unwrap();
        assert!(fs::read(place.at("b.pnti")).unwrap() == bytes, "{threads} threads");
    }
    place.write("a.las", &shuffled(&sorted));
    place.build(&[file], "c.pnti", &OPTIONS).unwrap();
    assert!(fs::read(place.at("c.pnti")).unwrap() == bytes, "shuffled");
}
