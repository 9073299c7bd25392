//! Loading files for the window: slow ones are previewed before they are complete.

use crate::files::scan;
use crate::program::{pointillist, succeeded};
use pointillist::app::load_thread::{self, FirstStage, LoadRequest, LoadedCloud, ProgressReporter};
use pointillist::cloud::attribute::{Attribute, DisplayAttribute, ExtraAttributes};
use pointillist::cloud::filter::Filter;
use pointillist::cloud::{ColumnSet, ReadOptions};
use pointillist::config;
use pointillist::config::POINTS_PER_PAGE;
use pointillist::error::{Error, Result};
use pointillist::gpu::DeviceOptions;
use pointillist::graph::Gpu;
use pointillist::index::attributes::strokes::StrokeCache;
use pointillist::index::cache::CacheLocation;
use pointillist::progress::{Progress, Silent};
use pointillist::render::gpu_cloud::Allowance;
use pointillist::render::source::{OpenOptions, Source};
use pointillist::resident::Resident;
use pointillist::synth::SceneKind;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, mpsc};

fn opening() -> OpenOptions {
    let read = ReadOptions::new(ColumnSet { rgb: true, ..ColumnSet::default() }, false);
    OpenOptions {
        read,
        filter: Default::default(),
        index: None,
        indexes_octrees: false,
        strokes: false,
        place: Some(CacheLocation::Temporary),
        shadows: None,
        fault: None,
    }
}

/// Loads files, and returns all results in order.
fn loaded(
    files: &[PathBuf],
    opening: OpenOptions,
    further: ExtraAttributes,
    first: FirstStage,
) -> Vec<LoadedCloud> {
    let (sender, receiver) = mpsc::channel();
    let watch = ProgressReporter::new(Default::default(), |_| ());
    let loaded = move |loaded| sender.send(loaded).unwrap();
    load_thread::start(
        LoadRequest { files: files.to_vec(), color: None, filter: Filter::default() },
        opening,
        further,
        first,
        Arc::default(),
        watch,
        loaded,
    )
    .unwrap()
    .join()
    .unwrap();
    receiver.into_iter().map(|loaded| loaded.unwrap()).collect()
}

#[test]
fn slow_files_are_previewed() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, points: u64| {
        let path = folder.path().join(name);
        scan(&path, SceneKind::Street, points);
        vec![path]
    };
    let slow = config::SLOW_POINTS / config::DECOMPRESSION;
    let (large, small) = (file("large.laz", slow), file("small.laz", 100_000));
    let both = [&large[..], &small].concat();
    let part_of = |files: &[PathBuf], opening: &OpenOptions| {
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
    let indexing = OpenOptions { index: Some("asked for"), ..opening() };
    assert_eq!(part_of(&small, &indexing), Some((100_000, 100_000)));

    let told_of = |files: &[PathBuf], opening: OpenOptions, first: FirstStage| -> Vec<_> {
        loaded(files, opening, ExtraAttributes::default(), first)
            .into_iter()
            .map(|loaded| (loaded.info.is_whole, loaded.prepared.points(), loaded.info.points))
            .collect()
    };
    let told =
        |files: &[PathBuf], opening: OpenOptions| told_of(files, opening, FirstStage::Sample);
    // A cloud on the screen is loaded again for other colours.
    assert_eq!(told_of(&large, opening(), FirstStage::Points), [(true, slow, slow)]);
    assert_eq!(
        told(&large, opening()),
        [(false, slow / config::PREVIEW_SHARE, slow), (true, slow, slow)]
    );
    assert_eq!(told(&small, opening()), [(true, 100_000, 100_000)]);
    assert_eq!(told(&small, indexing), [(false, 100_000, 100_000), (true, 100_000, 100_000)]);
}

/// Strokes of files take long; those of an index are computed per node as it is read.
#[test]
fn strokes_of_files_follow_their_points_and_those_of_an_index_come_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let (file, index) = (folder.path().join("scan.las"), folder.path().join("scan.pnti"));
    scan(&file, SceneKind::Street, 20_000);
    succeeded(&pointillist().arg("index").arg(&file).arg("-o").arg(&index).output().unwrap());
    let wanted = ExtraAttributes { strokes: true, ..ExtraAttributes::default() };
    let knows = |path: &PathBuf, first: FirstStage| -> Vec<bool> {
        loaded(std::slice::from_ref(path), opening(), wanted, first)
            .into_iter()
            .map(|loaded| loaded.info.shown.further.strokes)
            .collect()
    };
    for (first, of_file) in
        [(FirstStage::Sample, false), (FirstStage::Points, false), (FirstStage::All, true)]
    {
        assert_eq!(
            (knows(&file, first), knows(&index, first)),
            (vec![of_file], vec![true]),
            "{first:?}"
        );
    }
}

/// Records progress, until it is cancelled.
#[derive(Default)]
struct Heard {
    ticks: Mutex<Vec<(String, u64, u64)>>,
    most: Option<usize>,
}

impl Progress for Heard {
    fn tick(&self, doing: &str, done: u64, total: u64) -> Result<()> {
        let mut ticks = self.ticks.lock().unwrap();
        ticks.push((doing.to_string(), done, total));
        if self.most.is_some_and(|most| ticks.len() > most) {
            Err(Error::Interrupted)
        } else {
            Ok(())
        }
    }
}

impl Heard {
    fn of(&self, what: &str) -> Vec<(u64, u64)> {
        self.ticks
            .lock()
            .unwrap()
            .iter()
            .filter(|(doing, ..)| doing == what)
            .map(|&(_, done, total)| (done, total))
            .collect()
    }
}

fn painted() -> ExtraAttributes {
    ExtraAttributes { kind: true, strokes: true, ..ExtraAttributes::default() }
}

/// Returns two scans with this many points each as one cloud.
fn source(
    folder: &Path,
    points: [u64; 2],
    color: Option<Attribute>,
    further: ExtraAttributes,
) -> (Source, DisplayAttribute) {
    let files = points.map(|points| {
        let path = folder.join(format!("{points}.las"));
        scan(&path, SceneKind::Street, points);
        path
    });
    let read = ReadOptions::new(
        ColumnSet { rgb: true, ..ColumnSet::default() }.and(further.wanted()),
        true,
    );
    let source = Source::open(&files, &OpenOptions { read, ..opening() }, &Silent).unwrap();
    let (mut shown, _) = source.shown(color).unwrap();
    shown.further = further;
    (source, shown)
}

#[test]
fn uploads_report_progress_once() {
    let folder = tempfile::tempdir().unwrap();
    let mut gpu = Gpu::open(&DeviceOptions { validate: true, ..DeviceOptions::default() }).unwrap();
    const POINTS: [u64; 2] = [600_000, 400_000];
    let further = ExtraAttributes { kind: true, ..ExtraAttributes::default() };
    let (in_turns, in_halves) = (Heard::default(), Heard::default());
    let (source, shown) = self::source(folder.path(), POINTS, None, further);
    let Source::Files(cloud) = source else { panic!("files") };
    Resident::fill(&mut gpu, cloud, shown, &in_turns).unwrap();
    let (source, shown) = self::source(folder.path(), POINTS, None, further);
    let mut prepared = source.prepare(shown, &Arc::default(), &in_halves).unwrap();
    while prepared.step(&mut gpu, &mut Allowance::of_frame(), &in_halves).unwrap().0 {}
    prepared.finish(&mut gpu, 0).unwrap();
    // Nodes that threads work on at a time may be reported in another order.
    let slack = rayon::current_num_threads() as u64 * POINTS_PER_PAGE as u64;
    for heard in [in_turns.of("organising"), in_halves.of("organising")] {
        assert!(
            heard.iter().all(|&(done, total)| total == 2_000_000 && done <= total),
            "{heard:?}"
        );
        assert!(heard.windows(2).all(|pair| pair[1].0 + slack >= pair[0].0), "{heard:?}");
        assert!(heard[0].0 == 0 && heard.last().unwrap().0 + slack >= 2_000_000, "{heard:?}");
    }
    gpu.device.take_validation_errors().unwrap();
}

#[test]
fn strokes_are_computed_once_and_can_be_cancelled() {
    let folder = tempfile::tempdir().unwrap();
    const POINTS: [u64; 2] = [60_000, 40_000];
    let found = Arc::new(StrokeCache::default());
    let ticks = |color: Option<Attribute>, further: ExtraAttributes| {
        let (heard, (source, shown)) =
            (Heard::default(), source(folder.path(), POINTS, color, further));
        source.prepare(shown, &found, &heard).unwrap();
        heard.of("painting")
    };
    let first = ticks(None, painted());
    assert!(
        !first.is_empty() && first.iter().all(|&(done, total)| done < total && total == 100_000)
    );
    // In between they need not be wanted.
    assert_eq!(ticks(None, ExtraAttributes::default()), []);
    assert_eq!(ticks(Some(Attribute::Elevation), painted()), []);

    let found = Arc::default();
    for most in [0, 3, 10, 20] {
        let (heard, (source, shown)) = (
            Heard { most: Some(most), ..Heard::default() },
            source(folder.path(), POINTS, None, painted()),
        );
        assert!(matches!(source.prepare(shown, &found, &heard), Err(Error::Interrupted)), "{most}");
    }
}
