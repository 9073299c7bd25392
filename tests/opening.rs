//! Opening files for the window: those that take long are there in part before.

mod support;

use pointillist::app::opening::{self, Opened, Watch};
use pointillist::cloud::attribute::Further;
use pointillist::cloud::{ReadOptions, Wanted};
use pointillist::config;
use pointillist::index::cache::Place;
use pointillist::progress::Silent;
use pointillist::source::{Opening, Source};
use pointillist::synth::Scene;
use std::path::PathBuf;
use std::sync::mpsc;

fn opening() -> Opening {
    let read = ReadOptions { wanted: Wanted { rgb: true, ..Wanted::default() }, strict: false };
    Opening { read, index: None, place: Some(Place::Nowhere), shadows: None, fault: None }
}

/// What becomes of files, one after the other.
fn opened(files: &[PathBuf], opening: Opening, sampled: bool) -> Vec<Opened> {
    let (sender, receiver) = mpsc::channel();
    let watch = Watch::new(Default::default(), |_| ());
    let opened = move |opened| sender.send(opened).unwrap();
    opening::start(files.to_vec(), opening, None, Further::default(), sampled, watch, opened).unwrap().join().unwrap();
    receiver.into_iter().map(|opened| opened.unwrap()).collect()
}

#[test]
fn files_that_take_long_to_be_read_or_indexed_are_there_in_part_before() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, points: u64| {
        let path = folder.path().join(name);
        support::scan(&path, Scene::Street, points);
        vec![path]
    };
    let slow = config::SLOW_POINTS / config::DECOMPRESSION;
    let (large, small) = (file("large.laz", slow), file("small.laz", 100_000));
    let both = [&large[..], &small].concat();
    let part_of = |files: &[PathBuf], opening: &Opening| {
        let preview = Source::preview(files, opening, &Silent).unwrap();
        preview.map(|preview| (preview.source.points(), preview.points))
    };
    assert_eq!(part_of(&small, &opening()), None);
    assert_eq!(part_of(&file("plain.las", slow), &opening()), None);
    for (files, points) in [(&large, slow), (&both, slow + 100_000)] {
        let (part, whole) = part_of(files, &opening()).unwrap();
        assert_eq!(whole, points);
        let share = part * config::PREVIEW_SHARE;
        // A file that has fewer than its share gives all of them.
        assert!((points / 2..points + points / 100).contains(&share), "{part} of {points} points");
    }
    // Indexing takes longer than reading.
    let indexing = Opening { index: Some("asked for"), ..opening() };
    assert_eq!(part_of(&small, &indexing), Some((100_000, 100_000)));

    let told_of = |files: &[PathBuf], opening: Opening, sampled: bool| -> Vec<_> {
        opened(files, opening, sampled).into_iter().map(|opened| (opened.is_whole, opened.prepared.points(), opened.said.points)).collect()
    };
    let told = |files: &[PathBuf], opening: Opening| told_of(files, opening, true);
    // What is on the screen already, and is read anew for other colours.
    assert_eq!(told_of(&large, opening(), false), [(true, slow, slow)]);
    assert_eq!(told(&large, opening()), [(false, slow / config::PREVIEW_SHARE, slow), (true, slow, slow)]);
    assert_eq!(told(&small, opening()), [(true, 100_000, 100_000)]);
    assert_eq!(told(&small, indexing), [(false, 100_000, 100_000), (true, 100_000, 100_000)]);
}
