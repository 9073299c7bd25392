//! Damaged indexes, and those of other versions, are refused or read as they were written.

use super::crafted::*;
use super::*;

/// A few points in several nodes, because they are too far apart for one.
fn small(place: &Place) -> PathBuf {
    let mut points = shape(Shape::Uniform, 12, [i32::MIN; 3], [u32::MAX; 3], 1);
    points.extend(shape(Shape::Clusters, 12, [0; 3], [100; 3], 2));
    place.las("small.las", &points, MILLIMETRES);
    place.build(&[place.at("small.las")], "small.pnti", &OPTIONS).unwrap();
    place.at("small.pnti")
}

/// Reads everything: contents, records and planes.
#[derive(Debug, PartialEq)]
struct Told(Contents, Vec<(NodeRecord, BTreeMap<usize, Vec<u8>>)>);

fn told(path: &Path) -> Result<Told> {
    let index = Index::open(path)?;
    let nodes = (0..index.nodes().len())
        .map(|number| Ok((index.nodes()[number], decode(&index, number)?.planes)));
    Ok(Told(index.directory.contents.clone(), nodes.collect::<Result<_>>()?))
}

#[test]
fn every_flipped_bit_is_found_or_harmless() {
    let place = Place::new();
    let path = small(&place);
    let bytes = fs::read(&path).unwrap();
    assert!(bytes.len() < 64 << 10 && Index::open(&path).unwrap().nodes().len() >= 3);
    let truth = told(&path).unwrap();
    let flips = bytes.len() * 8;
    let found = AtomicU64::new(0);
    std::thread::scope(|scope| {
        for (half, range) in [0..flips / 2, flips / 2..flips].into_iter().enumerate() {
            let copy = place.write(&format!("{half}.pnti"), &bytes);
            let (bytes, found, truth) = (&bytes, &found, &truth);
            scope.spawn(move || {
                let file = fs::OpenOptions::new().write(true).open(&copy).unwrap();
                for flip in range {
                    let at = flip / 8;
                    file.write_all_at(&[bytes[at] ^ 1 << (flip % 8)], at as u64).unwrap();
                    match told(&copy) {
                        Ok(content) => {
                            assert!(
                                content == *truth,
                                "bit {flip} was not found, and changed something"
                            );
                            assert!(
                                (HEADER_BYTES..HEADER_PAGE).contains(&at),
                                "bit {flip} was not found"
                            );
                        }
                        Err(_) => _ = found.fetch_add(1, Relaxed),
                    }
                    file.write_all_at(&bytes[at..=at], at as u64).unwrap();
                }
                assert!(told(&copy).unwrap() == *truth);
            });
        }
    });
    println!("{} of {flips} flips are found, the rest are padding", found.load(Relaxed));
    assert_eq!(found.into_inner() as usize, flips - 8 * (HEADER_PAGE - HEADER_BYTES));
}

#[test]
fn a_cut_index_is_none() {
    let place = Place::new();
    let path = small(&place);
    let file = fs::OpenOptions::new().write(true).open(&path).unwrap();
    let whole = fs::metadata(&path).unwrap().len();
    file.set_len(whole + 1).unwrap();
    assert!(Index::open(&path).is_err());
    for length in (0..whole).rev() {
        file.set_len(length).unwrap();
        let error = Index::open(&path)
            .err()
            .unwrap_or_else(|| panic!("{length} bytes of {whole} are an index"))
            .to_string();
        assert!(error.contains("small.pnti"), "{error}");
    }
}

#[test]
fn an_index_from_the_future_is_refused_with_a_sentence() {
    let place = Place::new();
    let path = small(&place);
    let mut bytes = fs::read(&path).unwrap();
    assert!(signed(bytes.clone()) == bytes, "checksums are what this test takes them for");
    bytes[8] += 1;
    for bytes in [bytes.clone(), signed(bytes)] {
        let error = Index::open(&place.write("new.pnti", &bytes)).err().unwrap().to_string();
        assert!(error.contains("version 4") && error.contains("newer"), "{error}");
    }
    for bytes in [&b"something else"[..], &[0; 5000], b"pnti\r\n\x1a\n"] {
        let path = place.write("none.pnti", bytes);
        assert!(Index::open(&path).is_err());
        assert_eq!(Index::is_one(&path), bytes.len() == 8);
    }
    assert!(
        Index::is_one(&path)
            && !Index::is_one(place.folder.path())
            && !Index::is_one(&place.at("nowhere"))
    );
    assert!(
        Index::open(place.folder.path()).is_err() && Index::open(&place.at("nowhere")).is_err()
    );
}

#[test]
fn crafted_directories_are_refused() {
    let place = Place::new();
    let path = small(&place);
    let bytes = fs::read(&path).unwrap();
    let index = Index::open(&path).unwrap();
    let nodes = index.nodes().to_vec();
    let directory = number(&bytes, 24) as usize;
    let inner = nodes.iter().position(|node| !node.is_leaf()).unwrap();
    let second =
        nodes.iter().skip(inner + 1).position(|node| !node.is_leaf()).map(|i| i + inner + 1);
    let leaf = nodes.iter().position(NodeRecord::is_leaf).unwrap();
    let child = nodes[inner].first_child as usize;
    let try_it = |what: &str, edits: &[(usize, usize, &[u8])]| {
        let mut crafted = bytes.clone();
        for &(node, field, value) in edits {
            let at = directory + node * field::BYTES + field;
            crafted[at..at + value.len()].copy_from_slice(value);
        }
        assert!(crafted != bytes, "{what}: nothing is different");
        let path = place.write("crafted.pnti", &signed(crafted));
        let error =
            Index::open(&path).err().unwrap_or_else(|| panic!("{what} was taken")).to_string();
        println!("{what}: {}", error.rsplit('/').next().unwrap());
    };
    let long = |v: u64| v.to_le_bytes();
    let word = |v: u32| v.to_le_bytes();
    let real = |v: f64| v.to_le_bytes();
    use field::*;
    try_it("its own child", &[(inner, FIRST_CHILD, &word(inner as u32))]);
    try_it("a child before its parent", &[(inner, FIRST_CHILD, &word(0))]);
    try_it(
        "a leaf with a child above it",
        &[(leaf, FIRST_CHILD, &word(0)), (leaf, CHILDREN, &word(1)), (leaf, SPACING, &real(1.0))],
    );
    for count in [
        1,
        nodes[inner].children - 1,
        nodes[inner].children + 1,
        u32::MAX,
        u32::MAX - nodes[inner].first_child,
    ] {
        try_it("children that are too many or too few", &[(inner, CHILDREN, &word(count))]);
    }
    try_it("no children", &[(inner, CHILDREN, &word(0))]);
    try_it("children far away", &[(inner, FIRST_CHILD, &word(u32::MAX))]);
    if let Some(second) = second {
        try_it("children of two", &[(second, FIRST_CHILD, &word(nodes[inner].first_child))]);
    }
    try_it("another parent", &[(child, PARENT, &word(u32::MAX))]);
    try_it("a root below another node", &[(0, PARENT, &word(leaf as u32))]);
    for count in [0, POINTS_PER_PAGE + 1, u32::MAX] {
        try_it("a count", &[(leaf, COUNT, &word(count))]);
        try_it(
            "a count and its points",
            &[(leaf, COUNT, &word(count)), (leaf, POINTS, &long(count as u64))],
        );
    }
    for points in [0, 1, u64::MAX, nodes[inner].points + 1] {
        try_it("points", &[(inner, POINTS, &long(points))]);
    }
    for at in [
        0,
        4095,
        directory as u64,
        directory as u64 - 1,
        bytes.len() as u64,
        u64::MAX,
        u64::MAX - 4096,
    ] {
        try_it("planes elsewhere", &[(leaf, AT, &long(at))]);
    }
    for lattice in [index.directory.contents.lattices.len() as u16, u16::MAX] {
        try_it("a lattice", &[(leaf, LATTICE, &lattice.to_le_bytes())]);
    }
    for spacing in [f64::NAN, f64::INFINITY, -1.0, 0.0] {
        try_it("a spacing", &[(inner, SPACING, &real(spacing))]);
    }
    for spacing in [f64::NAN, 1.0] {
        try_it("a leaf's spacing", &[(leaf, SPACING, &real(spacing))]);
    }
    for bits in [0, 31, 40, 255, nodes[leaf].bits ^ 1] {
        try_it("bits", &[(leaf, BITS, &[bits])]);
    }
    try_it("an extent", &[(leaf, EXTENT, &word(u32::MAX)), (leaf, BITS, &[32])]);
    for origin in [i64::MIN, i64::MAX, 1 << 61] {
        try_it("an origin", &[(leaf, ORIGIN, &origin.to_le_bytes())]);
    }
    for coarser in [65, 255] {
        try_it("a rounding", &[(inner, COARSER, &[coarser])]);
    }
    for planes in [0u16, 1 << 15, u16::MAX, nodes[leaf].planes & !1] {
        try_it("planes", &[(leaf, PLANES, &planes.to_le_bytes())]);
    }
    // The header's own numbers.
    for (what, at, value) in [
        ("nodes", 12, &word(nodes.len() as u32 + 1)[..]),
        ("all nodes", 12, &word(u32::MAX)),
        ("no nodes", 12, &word(0)),
        ("length", 16, &long(bytes.len() as u64 + 1)),
        ("directory", 24, &long((directory + field::BYTES) as u64)),
        ("directory behind", 24, &long(u64::MAX)),
        ("contents", 32, &long(0)),
        ("long contents", 32, &long(u64::MAX)),
        ("no roots", 40, &word(0)),
        ("two roots", 40, &word(2)),
        ("roots", 40, &word(u32::MAX)),
    ] {
        let mut crafted = bytes.clone();
        crafted[at..at + value.len()].copy_from_slice(value);
        let path = place.write("crafted.pnti", &signed(crafted));
        assert!(Index::open(&path).is_err(), "{what}");
    }
    let json = directory + nodes.len() * field::BYTES;
    // More points of a class than there are, an unknown class, and one twice.
    let told: serde_json::Value = serde_json::from_slice(&bytes[json..]).unwrap();
    for (kinds, counts) in [
        ("classes", "[[2,18446744073709551615]]"),
        ("returns", "[[16,1]]"),
        ("returns", "[[1,1],[1,1]]"),
    ] {
        let mut told = told.clone();
        told["counts"][kinds] = serde_json::from_str(counts).unwrap();
        let crafted = with_contents(&bytes, json, &serde_json::to_vec(&told).unwrap());
        let error =
            Index::open(&place.write("crafted.pnti", &signed(crafted))).err().unwrap().to_string();
        assert!(error.contains("impossible numbers of points"), "{error}");
    }
    // Contents that are not JSON, are other JSON, or are nested without end.
    for contents in [&b"{}"[..], b"", b"\xff", &[b'['; 100_000], b"{\"points\": 1e999}"] {
        assert!(
            Index::open(
                &place.write("crafted.pnti", &signed(with_contents(&bytes, json, contents)))
            )
            .is_err()
        );
    }
}

#[test]
fn random_records_are_refused_or_can_be_read() {
    let place = Place::new();
    let path = small(&place);
    let bytes = fs::read(&path).unwrap();
    let directory = number(&bytes, 24) as usize;
    let records = Index::open(&path).unwrap().nodes().len() * field::BYTES;
    let mut taken = 0;
    let copy = place.write("crafted.pnti", &bytes);
    let file = fs::OpenOptions::new().write(true).open(&copy).unwrap();
    for i in 0..20_000 {
        let mut crafted = bytes.clone();
        for k in 0..1 + noise(i) % 3 {
            let n = noise(i * 4 + k);
            let at = directory + n as usize % records;
            let value = [
                0,
                1,
                0x7F,
                0x80,
                0xFF,
                (n >> 40) as u8,
                crafted[at].wrapping_add(1),
                crafted[at].wrapping_sub(1),
            ][(n >> 32) as usize % 8];
            crafted[at] = value;
        }
        // Both outcomes are fine; neither panics.
        file.write_all_at(&signed(crafted), 0).unwrap();
        let told = told(&copy);
        let index = Index::open(&copy);
        taken += told.is_ok() as u32;
        if let Ok(index) = index {
            for number in 0..index.nodes().len() {
                let _ = index.samples(number);
                let _ = index.bounds(&index.nodes()[number]);
            }
        }
    }
    println!("{taken} of 20,000 were taken");
}

#[test]
fn an_index_that_shrinks_or_changes_while_it_is_open_is_an_error() {
    let place = Place::new();
    place.las("a.las", &shape(Shape::Plane, 200_000, [0; 3], [99_999; 3], 1), MILLIMETRES);
    place.build(&[place.at("a.las")], "a.pnti", &OPTIONS).unwrap();
    let path = place.at("a.pnti");
    let bytes = fs::read(&path).unwrap();
    let file = fs::OpenOptions::new().write(true).open(&path).unwrap();
    let index = Index::open(&path).unwrap();
    let all = || {
        (0..index.nodes().len())
            .map(|number| decode(&index, number).map(drop))
            .collect::<Result<Vec<()>>>()
    };
    all().unwrap();
    for length in [bytes.len() as u64 / 2, 4097, 1, 0] {
        file.set_len(length).unwrap();
        let error = all().unwrap_err().to_string();
        assert!(error.contains("shorter") || error.contains("damaged"), "{error}");
        assert!(index.samples(0).is_err());
        file.set_len(bytes.len() as u64).unwrap();
        // Zeros where there were points.
        assert!(all().unwrap_err().to_string().contains("damaged"));
        file.write_all_at(&bytes, 0).unwrap();
        all().unwrap();
    }
    // During a read.
    let stop = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for i in 0..200 {
                file.set_len(noise(i) % bytes.len() as u64).unwrap();
                file.write_all_at(&bytes, 0).unwrap();
            }
            stop.store(true, Relaxed);
        });
        let mut errors = 0;
        while !stop.load(Relaxed) {
            errors += all().is_err() as u32;
        }
        println!("{errors} errors");
    });
    all().unwrap();
}

#[test]
fn an_index_of_the_first_version_is_read_as_it_was() {
    let place = Place::new();
    let mut points = shape(Shape::Plane, 200_000, [0; 3], [100_000; 3], 3);
    // More stations than 8 bits number, which that version could not do.
    points.iter_mut().enumerate().for_each(|(i, point)| point.source = (i % 1000) as u16);
    let now = place.faithful(&[place.las("a.las", &points, MILLIMETRES)], &OPTIONS);
    assert!(!now.has(Plane::Station));
    place.write("first.pnti", &first_version(&fs::read(place.at("a.pnti")).unwrap()));
    let first = Index::open(&place.at("first.pnti")).unwrap();
    let length = |contents: &Contents| serde_json::to_vec(contents).unwrap().len() as u64;
    let unknown = length(&now.directory.contents) - length(&first.directory.contents)
        + ",\"oriented\":false".len() as u64;
    assert_eq!(first.bytes() + 16 * now.nodes().len() as u64 + unknown, now.bytes());
    assert_eq!(
        first.directory.contents,
        Contents {
            balance: None,
            intensity_balance: None,
            counts: None,
            ..now.directory.contents.clone()
        }
    );
    assert!(first.nodes() == now.nodes());
    assert!(contents_of_nodes(&first) == contents_of_nodes(&now));
}
