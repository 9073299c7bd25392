//! Damaged LAS and LAZ: a changed header, a changed variable-length record or a truncated end is an
//! error, or is reported, or changes no value. Changed bytes of points are not tested, since they
//! cannot be detected.

use crate::made::{Las, sheet};
use glam::DVec3;
use pointillist::cloud::{self, Cloud, ColumnSet, ReadOptions};
use pointillist::progress::Silent;
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use std::cell::Cell;
use std::path::Path;

/// A change of a file: its kind, place, and byte.
type Edit = (Kind, prop::sample::Index, u8);

#[derive(Clone, Copy, Debug)]
enum Kind {
    Byte,
    Bit,
    /// Four bytes from a multiple of four become zeros.
    Zeros,
    /// The file is truncated here.
    End,
}

impl Kind {
    fn apply(self, file: &mut Vec<u8>, damaged: usize, at: prop::sample::Index, byte: u8) {
        let place = at.index(damaged);
        match self {
            Kind::Byte => file[place] = byte,
            Kind::Bit => file[place] ^= 1 << (byte % 8),
            Kind::Zeros => file[place / 4 * 4..place / 4 * 4 + 4].fill(0),
            Kind::End => file.truncate(at.index(file.len())),
        }
    }
}

fn places(cloud: &Cloud) -> Vec<DVec3> {
    let of_part = |part: &cloud::Part| {
        let columns = &part.columns;
        let place = |i: usize| {
            part.lattice.world([columns.x[i], columns.y[i], columns.z[i]].map(i64::from))
        };
        (0..columns.len()).map(place).collect::<Vec<_>>()
    };
    cloud.parts.iter().flat_map(of_part).collect()
}

/// Tests whether all values are equal: positions up to a lattice step, since a header's last bits
/// may not matter.
fn are_same(a: &Cloud, b: &Cloud) -> bool {
    let attributes = |cloud: &Cloud| {
        let columns = |part: &cloud::Part| {
            let none = Vec::new;
            cloud::Columns { x: none(), y: none(), z: none(), ..part.columns.clone() }
        };
        cloud.parts.iter().map(columns).collect::<Vec<_>>()
    };
    let step =
        a.parts.iter().map(|part| part.lattice.step).fold(DVec3::splat(f64::INFINITY), DVec3::min);
    let (own, other) = (places(a), places(b));
    own.len() == other.len()
        && own.iter().zip(&other).all(|(own, other)| (*own - *other).abs().cmple(1.01 * step).all())
        && attributes(a) == attributes(b)
}

#[test]
fn what_damage_changes_is_an_error_or_said() {
    let folder = tempfile::tempdir().unwrap();
    let [same, said, refused] = [(); 3].map(|()| Cell::new(0));
    let kinds = prop::sample::select(vec![
        Kind::Byte,
        Kind::Byte,
        Kind::Bit,
        Kind::Bit,
        Kind::Zeros,
        Kind::End,
    ]);
    let bytes = prop_oneof![
        prop::sample::select(vec![0u8, 1, 2, 3, 6, 7, 20, 26, 28, 34, 127, 128, 255]),
        any::<u8>()
    ];
    let edits = prop::collection::vec((kinds, any::<prop::sample::Index>(), bytes), 1..3);
    let formats = prop::sample::select((0..=8u8).collect::<Vec<_>>());
    let points = sheet(|i| [i as u16 * 13, i as u16, 65_535 - i as u16]);
    let test = |(format, compressed, extra, edits): (u8, bool, u16, Vec<Edit>)| {
        // Formats with waveforms are not compressed.
        let compressed = compressed && !matches!(format, 4 | 5);
        let minor = [2, 2, 2, 2, 3, 3, 4, 4, 4][format as usize];
        let declaration = |width: u16| {
            let mut bytes = vec![0u8; 192];
            (bytes[2], bytes[3]) = (0, width as u8);
            bytes[4] = b'e';
            bytes
        };
        let vlrs = if extra > 0 { vec![("LASF_Spec", 4, declaration(extra))] } else { Vec::new() };
        let made =
            Las { minor, format, extra, vlrs, points: points[..1500].to_vec(), ..Las::default() };
        let path = folder.path().join(if compressed { "a.laz" } else { "a.las" });
        let mut file = if compressed { made.laz() } else { made.bytes() };
        std::fs::write(&path, &file).unwrap();
        let options = |strict| ReadOptions::new(ColumnSet::ALL, strict);
        let read = |strict| cloud::read(std::slice::from_ref(&path), &options(strict), &Silent);
        let whole = read(true).unwrap();
        let points_at = u32::from_le_bytes(file[96..100].try_into().unwrap()) as usize;
        // For a compressed file also the offset of its chunk table.
        let damaged = if compressed { points_at + 8 } else { points_at };
        for (kind, at, byte) in &edits {
            // Truncation comes last.
            if file.len() >= damaged {
                kind.apply(&mut file, damaged, *at, *byte);
            }
        }
        std::fs::write(&path, &file).unwrap();
        let (cloud, strictly) = (read(false), read(true));
        let Ok(cloud) = cloud else {
            refused.set(refused.get() + 1);
            prop_assert!(strictly.is_err());
            return Ok(());
        };
        if are_same(&whole, &cloud) {
            same.set(same.get() + 1);
            return Ok(());
        }
        said.set(said.get() + 1);
        prop_assert!(
            cloud.notes.len() > whole.notes.len(),
            "no note on values that differ: {:?}",
            cloud.parts[0].header
        );
        prop_assert!(strictly.is_err(), "a guess or a loss passes as strict: {:?}", cloud.notes);
        Ok(())
    };
    let inputs = (formats, any::<bool>(), prop::sample::select(vec![0u16, 0, 3]), edits);
    let config = Config { cases: 1000, failure_persistence: None, ..Config::default() };
    let mut runner =
        TestRunner::new_with_rng(config, TestRng::from_seed(RngAlgorithm::ChaCha, &[33; 32]));
    runner.run(&inputs, test).unwrap_or_else(|error| panic!("{error}"));
    let (same, said, refused) = (same.get(), said.get(), refused.get());
    println!("{same} without a change of values, {said} said, {refused} refused");
    assert!(same > 100 && said > 100 && refused > 100);
}

/// A GPS time that names another sequence of times, which names another one, and so on a million
/// times, in layers and between other fields.
#[test]
fn endless_gps_times_are_said() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["laz/02_endless_times_of_layers", "laz/03_endless_times_in_sequence"] {
        let seed = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz/crashed").join(name);
        let path = folder.path().join("a.laz");
        std::fs::copy(seed, &path).unwrap();
        let read = |strict| {
            let options = ReadOptions::new(ColumnSet::ALL, strict);
            cloud::read(std::slice::from_ref(&path), &options, &Silent)
        };
        let cloud = read(false).unwrap();
        assert_eq!(cloud.parts[0].columns.len(), 1);
        let said = "header declares 2 points, 1 could be read";
        let why = "its GPS times are damaged";
        let is_said =
            |text: &str| text.contains("a.laz") && text.contains(said) && text.contains(why);
        assert!(cloud.notes.iter().any(|note| is_said(note)), "{:?}", cloud.notes);
        assert!(is_said(&read(true).unwrap_err().to_string()));
    }
}
