//! Indexes that are built by jobs of a plan.

use super::*;
use pointillist::index::build::plan::{Plan, part_path, plan};
use pointillist::index::build::{job, merge};

/// Plans jobs of about half a million points.
fn planned(place: &Place, files: &[PathBuf], options: &Options) -> Plan {
    plan(files, &place.at("plan.json"), options, 1, &Silent).unwrap();
    Plan::read(&place.at("plan.json")).unwrap()
}

fn do_job(place: &Place, plan: &Plan, number: usize, options: &Options) -> Result<Vec<u8>> {
    let output = part_path(&place.at("plan.json"), number);
    job(plan, number, &output, options, &Silent)?;
    Ok(fs::read(output).unwrap())
}

fn merged(place: &Place, plan: &Plan) -> Result<Vec<u8>> {
    let part = |number| part_path(&place.at("plan.json"), number);
    let parts: Vec<PathBuf> = (1..=plan.summary().jobs).map(part).collect();
    merge(plan, &parts, &place.at("merged.pnti"), &OPTIONS, &Silent)?;
    Ok(fs::read(place.at("merged.pnti")).unwrap())
}

/// Returns files on two lattices: two stations, many points in one place, strays, and colours of
/// which only a few show that they have 16 bits.
fn survey(place: &Place) -> [PathBuf; 3] {
    scan(&place.at("street.las"), SceneKind::Street, 1_500_000);
    let street = cloud::read(&[place.at("street.las")], &READ, &Silent).unwrap();
    let Lattice { step, offset } = street.parts[0].lattice;
    let frame = Frame {
        step: step.to_array(),
        offset: (offset + step * 40_100.0).to_array(),
        stated: None,
    };
    let mut blob = shape(Shape::Uniform, 700_000, [-40_000; 3], [64; 3], 9);
    blob.extend(shape(Shape::Uniform, 9, [2_000_000_000; 3], [90_000_000; 3], 4));
    blob.iter_mut().enumerate().filter(|(i, _)| i % 60_000 != 0).for_each(|(_, point)| {
        point.rgb = point.rgb.map(|v| v & 255);
    });
    let near = DVec3::new(0.3, 0.2, 0.1) + offset;
    let other = Frame { step: [0.002; 3], offset: near.to_array(), stated: None };
    let corner = shape(Shape::Corner, 600_000, [0; 3], [50_000; 3], 5);
    [
        place.at("street.las"),
        place.las("blob.las", &blob, frame),
        place.las("corner.las", &corner, other),
    ]
}

#[test]
fn jobs_in_any_order_and_memory_make_the_bytes_of_one_machine() {
    let place = Place::new();
    let files = survey(&place);
    place.build(&files, "one.pnti", &OPTIONS).unwrap();
    let plan = planned(&place, &files, &OPTIONS);
    let jobs = plan.summary().jobs;
    assert!(jobs > 3, "{jobs} jobs");
    let little = Options { memory: 64 << 20, threads: 1, ..OPTIONS };
    for number in (1..=jobs).rev() {
        let options = if number % 2 == 0 { &OPTIONS } else { &little };
        do_job(&place, &plan, number, options).unwrap();
    }
    // A job that runs twice.
    let first = fs::read(part_path(&place.at("plan.json"), 2)).unwrap();
    assert!(do_job(&place, &plan, 2, &little).unwrap() == first);
    assert!(merged(&place, &plan).unwrap() == fs::read(place.at("one.pnti")).unwrap());
}

#[test]
fn damaged_and_foreign_parts_are_refused_or_change_no_byte() {
    let place = Place::new();
    let file = place.las("a.las", &shape(Shape::Uniform, 3000, [0; 3], [9000; 3], 1), MILLIMETRES);
    let files = [file];
    let derived = Options { derive: DerivedPlanes::ALL, ..OPTIONS };
    place.build(&files, "one.pnti", &derived).unwrap();
    let one = fs::read(place.at("one.pnti")).unwrap();
    let plan = planned(&place, &files, &derived);
    let part = do_job(&place, &plan, 1, &OPTIONS).unwrap();
    let path = part_path(&place.at("plan.json"), 1);
    let refused = |what: &str| match merged(&place, &plan) {
        Err(error) => assert!(!error.to_string().is_empty()),
        Ok(bytes) => assert!(bytes == one, "{what}"),
    };
    for i in (0..part.len()).step_by(149).chain(0..64) {
        let mut flipped = part.clone();
        flipped[i] ^= 1 << (i % 8);
        fs::write(&path, flipped).unwrap();
        refused(&format!("byte {i}"));
    }
    for length in (0..part.len()).step_by(997) {
        fs::write(&path, &part[..length]).unwrap();
        assert!(merged(&place, &plan).is_err(), "{length} bytes");
    }
    fs::write(&path, &part).unwrap();
    assert!(merged(&place, &plan).unwrap() == one);
    fs::remove_file(&path).unwrap();
    let error = merged(&place, &plan).unwrap_err().to_string();
    assert!(error.contains("missing") && error.contains("plan.1.part"), "{error}");
    // The part of another plan.
    let class = Options { wanted: ColumnSet { class: false, ..ColumnSet::ALL }, ..OPTIONS };
    let other = planned(&place, &files, &class);
    do_job(&place, &other, 1, &OPTIONS).unwrap();
    let error = merged(&place, &plan).unwrap_err().to_string();
    assert!(error.contains("another plan"), "{error}");
}

#[test]
fn changed_files_and_damaged_plans_are_refused() {
    let place = Place::new();
    let points = shape(Shape::Uniform, 3000, [0; 3], [9000; 3], 1);
    let file = place.las("a.las", &points, MILLIMETRES);
    let plan = planned(&place, &[file], &OPTIONS);
    let moved = shape(Shape::Uniform, 3000, [1; 3], [9000; 3], 1);
    for (what, changed) in [("longer", &points[1..]), ("moved", &moved)] {
        place.las("a.las", changed, MILLIMETRES);
        let error = do_job(&place, &plan, 1, &OPTIONS).unwrap_err().to_string();
        assert!(error.contains("a.las") && error.contains("plan it again"), "{what}: {error}");
    }
    for number in [0, 2, usize::MAX] {
        let error = do_job(&place, &plan, number, &OPTIONS).unwrap_err().to_string();
        assert!(error.contains("the plan has 1"), "{error}");
    }
    // Every number of the plan is replaced by another one.
    let text = fs::read_to_string(place.at("plan.json")).unwrap();
    let is_first = |i: &usize| !text[..*i].ends_with(|c: char| c.is_ascii_digit());
    let numbers = text.match_indices(|c: char| c.is_ascii_digit()).map(|(i, _)| i).filter(is_first);
    for i in numbers {
        let end = i + text[i..].find(|c: char| !c.is_ascii_digit()).unwrap_or(0);
        for number in ["77", "4294967295", "340282366920938463463374607431768211455"] {
            let changed = format!("{}{number}{}", &text[..i], &text[end..]);
            // Digits of a checksum may be this number.
            if changed == text {
                continue;
            }
            fs::write(place.at("plan.json"), changed).unwrap();
            assert!(Plan::read(&place.at("plan.json")).is_err(), "byte {i}: {number}");
        }
    }
}
