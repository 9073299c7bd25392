//! Indexes and saved shadows, with forged checksums.

use super::{file, forge, look};
use pointillist::cloud::ColumnSet;
use pointillist::cloud::filter::Filter;
use pointillist::index::attributes::shadow_writer::ShadowWriter;
use pointillist::index::build::{self, DerivedPlanes};
use pointillist::index::format::shadow_file::ShadowContents;
use pointillist::index::format::{Index, PLANES};
use pointillist::progress::Silent;
use pointillist::render::source::Source;
use pointillist::select::clip::Clips;
use pointillist::select::lod::{self, Detail};
use pointillist::view::{Camera, Preset, View};
use std::collections::HashSet;
use std::path::Path;

/// Opens an index, reads all of it, and asks what a picture needs.
pub fn index(folder: &Path, bytes: &[u8]) {
    // Half of the inputs keep damaged planes.
    let planes = bytes.len().is_multiple_of(2);
    let path = file(folder, "a.pnti", &forge::pnti(bytes, planes));
    match Index::open(&path) {
        Ok(mut index) => {
            walk(&index);
            drop(index.find_ground(&Silent));
        }
        Err(error) => look::one_line(&error.to_string()),
    }
    if let Ok(source) = Source::open(&[path], &look::opening(), &Silent) {
        look::at_source(&source, look::choice(bytes));
    }
}

/// Reads all planes, chooses cuts and compiles a filter.
pub fn walk(index: &Index) {
    let mut corners = Vec::new();
    for (number, node) in index.nodes().iter().enumerate() {
        for (plane, _) in PLANES.iter().filter(|(plane, _)| node.has(*plane)) {
            let mut bytes = vec![0; node.unpacked_bytes(*plane) as usize];
            drop(index.read(number, *plane, &mut bytes));
        }
        drop(index.columns(number, ColumnSet::ALL));
        if let Ok(samples) = index.samples(number) {
            assert_eq!(samples.len(), node.count as usize);
            assert!(samples.iter().all(|(place, _)| place.is_finite()), "node {number}");
        }
        let (low, high) = index.bounds(node);
        assert!((high - low).is_finite(), "node {number}: {low} to {high}");
        corners.extend([low, high]);
    }
    let filter = Filter { only: vec!["class=2".parse().expect("a filter")], not: Vec::new() };
    if let Ok(compiled) = index.compile(&filter) {
        (0..index.nodes().len()).for_each(|node| drop(index.left(node, &compiled)));
    }
    let size = [320, 180];
    for preset in [Preset::Top, Preset::Fit] {
        let camera = Camera::framing(preset, &corners, size);
        let Ok(view) = View::new(camera, size) else { continue };
        let detail = Detail { budget: 100_000, ..Detail::of(size) };
        let cut = lod::choose(index, &[view], &Clips::default(), &detail, &HashSet::new());
        let nodes: HashSet<usize> = cut.nodes.iter().map(|node| node.node).collect();
        assert_eq!(nodes.len(), cut.nodes.len(), "a node is drawn twice");
    }
}

/// Returns an index of a small cloud with these planes.
fn built(folder: &Path, points: usize, derive: DerivedPlanes) -> Vec<u8> {
    let cloud = file(folder, "seed.las", &super::seeds::some_las(points));
    let output = folder.join("seed.pnti");
    let options =
        build::Options { memory: 64 << 20, threads: 1, derive, ..build::Options::usual(false) };
    build::build(&[cloud], &output, &options, &Silent).expect("an index");
    std::fs::read(output).expect("an index")
}

pub fn index_seeds(folder: &Path) -> Vec<Vec<u8>> {
    let all = DerivedPlanes { strokes: true, luminance: true, ..DerivedPlanes::NONE };
    vec![
        built(folder, 40, DerivedPlanes::NONE),
        built(folder, 300, all),
        super::seeds::some_tree(folder),
    ]
}

/// Opens shadows of a small index, which is made once a process.
pub fn shadows(folder: &Path, bytes: &[u8]) {
    let path = folder.join("shaded.pnti");
    if !path.exists() {
        std::fs::write(&path, super::seeds::some_tree(folder)).expect("an index");
    }
    let index = Index::open(&path).expect("the fuzzer's own index");
    let shadows = file(folder, "a.shadows", &forge::shadows(bytes, index.identity()));
    match index.open_shadows(&shadows) {
        Ok(shadows) => {
            for (number, node) in index.nodes().iter().enumerate() {
                drop(shadows.read(number, &mut vec![0; node.count as usize]));
            }
        }
        Err(error) => look::one_line(&error.to_string()),
    }
}

pub fn shadow_seeds(folder: &Path) -> Vec<Vec<u8>> {
    let path = folder.join("shaded.pnti");
    std::fs::write(&path, super::seeds::some_tree(folder)).expect("an index");
    let index = Index::open(&path).expect("an index");
    let output = folder.join("seed.shadows");
    let writer = ShadowWriter::create(&output, &index).expect("shadows");
    for (number, node) in index.nodes().iter().enumerate() {
        writer.put(number, &vec![number as u8; node.count as usize]).expect("shadows");
    }
    let contents =
        ShadowContents { light: "sun:60,30".into(), full: 255, facts: serde_json::json!({}) };
    writer.finish(&contents).expect("shadows");
    vec![std::fs::read(output).expect("shadows")]
}
