//! Streaming an index: what is resident and drawn; a settled picture depends neither on the pool,
//! nor on the order of arrival, nor, beyond the missing node, on a damaged file. So for COPC files,
//! whose nodes add to those above them.

use crate::ancestors::ancestors;
use crate::cameras::perspective;
use crate::copc_file::write_copc;
use crate::gpu::{self, Way};
use crate::points::{Random, bumpy};
use crate::tree::{STEP, Shape, plant};
use glam::DVec3;
use pointillist::cloud::attribute::{Attribute, DisplayAttribute};
use pointillist::config::{POINTS_PER_PAGE, UPLOAD_BYTES, UPLOAD_BYTES_SHARED};
use pointillist::graph::{Gpu, Graph};
use pointillist::index::format::{Index, Plane};
use pointillist::loader::{Answer, Destination, Loader, NodeRequest, Outcome};
use pointillist::passes::Switch;
use pointillist::progress::Silent;
use pointillist::render::frame;
use pointillist::render::settings::{FrameConfig, RenderSettings};
use pointillist::resident::streaming::{Residency, Update};
use pointillist::resident::{Resident, pages::PAGE_BYTES};
use pointillist::select::clip::Clips;
use pointillist::select::lod::{self, Detail};
use pointillist::select::slab::Slab;
use pointillist::view::{Camera, View};
use proptest::prelude::*;
use std::collections::HashSet;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const HUGE: u64 = 1 << 30;

/// A cloud 20 m wide in 56 leaves, and its index.
struct Planted {
    folder: tempfile::TempDir,
    index: Arc<Index>,
}

impl Planted {
    fn new() -> Planted {
        let folder = tempfile::tempdir().unwrap();
        let (points, colors) = bumpy(24_000, 20_000, &mut Random(0xC10D));
        let index = plant(&folder.path().join("cloud.pnti"), &points, &colors, &Shape::default());
        Planted { folder, index }
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("cloud.pnti")
    }

    fn shown(&self) -> DisplayAttribute {
        DisplayAttribute::indexed(Attribute::Rgb, [0.0, 1.0], [0, 255])
    }

    fn open(&self, gpu: &mut Gpu, pool_bytes: u64) -> Residency {
        Residency::open(gpu, self.index.clone(), self.shown(), pool_bytes).unwrap()
    }

    /// The same file with one byte of a plane changed.
    fn damaged(&self, node: usize, plane: Plane) -> Arc<Index> {
        let path = self.folder.path().join(format!("damaged{node}.pnti"));
        let mut bytes = std::fs::read(self.path()).unwrap();
        bytes[self.index.nodes()[node].range(plane).0 as usize + 5] ^= 0x10;
        std::fs::write(&path, bytes).unwrap();
        Arc::new(Index::open(&path).unwrap())
    }
}

fn camera(seed: u64) -> Camera {
    let mut random = Random(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
    let mut point = |reach: f64| DVec3::from_array([(); 3].map(|()| random.within(-reach, reach)));
    perspective(point(16.0), point(6.0), 55.0)
}

fn view(seed: u64) -> View {
    View::new(camera(seed), [160, 120]).unwrap()
}

/// Returns settings that draw everything in view, to the last leaf.
fn all() -> Detail {
    Detail { budget: u64::MAX, lod_px: 0.0, ..Detail::of([160, 120]) }
}

fn few(points: u64) -> Detail {
    Detail { budget: points, lod_px: 0.0, ..Detail::of([160, 120]) }
}

/// Depth, ids and picture, as bits.
type Picture = (Vec<u32>, Vec<u32>, Vec<[u32; 4]>);

fn draw(gpu: &mut Gpu, view: &View, resident: &Resident) -> Picture {
    let mut settings = RenderSettings::points();
    settings.effects.edl.switch = Switch::Off;
    let config = FrameConfig::new(&settings, view, resident);
    let mut g = Graph::new(gpu);
    let outcome = frame::record(&mut g, view, resident, &config).unwrap();
    let [depth, index, picture] =
        [&outcome.gbuffer.depth, &outcome.gbuffer.index, &outcome.picture]
            .map(|image| g.download(image));
    let frame = g.submit_and_wait(&[]).expect("drawn, and no validation message");

    (frame.read(&depth).to_vec(), frame.read(&index).to_vec(), frame.read(&picture).to_vec())
}

fn settled(
    gpu: &mut Gpu,
    residency: &mut Residency,
    view: &View,
    detail: &Detail,
) -> (Update, Picture) {
    let update = residency.wait_until_resident(gpu, view, detail, &Silent).unwrap();
    (update, draw(gpu, view, residency.resident()))
}

/// Checks that all nodes draw what the points of [`bumpy`] do that they were made of.
fn draws_what_its_points_draw(planted: &Planted, points: usize, seed: u64) {
    gpu::with(Way::Compute64, |gpu| {
        let (points, colors) = bumpy(points, 20_000, &mut Random(seed));
        let lattice = pointillist::cloud::Lattice { step: DVec3::splat(STEP), offset: DVec3::ZERO };
        let cloud = gpu::cloud(vec![gpu::part(lattice, &points, Some(colors))]);
        let shown = DisplayAttribute::automatic(&cloud).0;
        let whole = Resident::fill(gpu, cloud, shown, &Silent).unwrap();
        let mut residency = planted.open(gpu, HUGE);
        for seed in 0..4 {
            let view = view(seed);
            let (update, picture) = settled(gpu, &mut residency, &view, &all());
            assert!(
                update.is_complete() && update.holes == 0 && update.cut.largest_error_px == 0.0
            );
            let expected = draw(gpu, &view, &whole);
            // Nodes have other origins here, so f32 arithmetic may round a point into the
            // neighbouring pixel.
            let differ = picture.2.iter().zip(&expected.2).filter(|(a, b)| a != b).count();
            let covered = expected.1.iter().filter(|&&id| id != u32::MAX).count();
            assert!(covered > 500 && differ <= 4 + covered / 500, "{differ} of {covered} differ");
        }
    });
}

#[test]
fn an_index_refined_to_its_leaves_draws_what_the_cloud_itself_draws() {
    draws_what_its_points_draw(&Planted::new(), 24_000, 0xC10D);
}

#[test]
fn a_settled_picture_depends_neither_on_the_pool_nor_on_what_was_drawn_before() {
    let planted = Planted::new();
    gpu::with(Way::Compute64, |gpu| {
        let detail = few(8000);
        // The pages of the largest cut below, and not one more than the roots need beside it.
        let mut huge = planted.open(gpu, HUGE);
        let most = (0..6).map(|seed| {
            huge.wait_until_resident(gpu, &view(seed), &detail, &Silent).unwrap();
            let mut fresh = planted.open(gpu, HUGE);
            fresh.wait_until_resident(gpu, &view(seed), &detail, &Silent).unwrap();

            fresh.pool_bytes()[1]
        });
        let most = most.max().unwrap();
        let mut tiny = planted.open(gpu, most);
        let mut random = Random(77);
        for round in 0..18 {
            let view = view(round % 6);
            // A walk in between, without waiting: arrivals and evictions in another order.
            for _ in 0..random.bits() % 4 {
                let elsewhere = self::view(100 + random.bits() % 50);
                tiny.update(gpu, &elsewhere, &detail).unwrap();
                if random.bits().is_multiple_of(2) {
                    std::thread::sleep(Duration::from_micros(random.bits() % 3000));
                }
            }
            let (small, by_small) = settled(gpu, &mut tiny, &view, &detail);
            let (large, by_large) = settled(gpu, &mut huge, &view, &detail);
            assert_eq!(small.cut, large.cut);
            assert!(by_small == by_large, "round {round}: the pictures differ");
            assert!(tiny.pool_bytes()[1] <= most);
        }
        assert!(tiny.evictions > 0 && huge.evictions == 0, "{} {}", tiny.evictions, huge.evictions);
    });
}

#[test]
fn a_cut_that_does_not_fit_the_pool_is_coarser_and_complete() {
    let planted = Planted::new();
    gpu::with(Way::Compute64, |gpu| {
        let mut residency = planted.open(gpu, 14 * PAGE_BYTES);
        let (update, _) = settled(gpu, &mut residency, &view(1), &all());
        assert!(
            update.is_complete()
                && update.holes == 0
                && update.budget < 24_000
                && update.cut.largest_error_px > 0.0,
            "{update:?}"
        );
        // A pool too small for the root is reported.
        let mut residency = planted.open(gpu, PAGE_BYTES);
        let error =
            residency.wait_until_resident(gpu, &view(1), &all(), &Silent).unwrap_err().to_string();
        assert!(error.contains("roots"), "{error}");
    });
}

/// Returns holes that something resident could have filled, found by walking up from every node of
/// the cut.
fn needless_holes(residency: &Residency, view: &View, update: &Update) -> usize {
    let index = residency.index();
    let drawn: HashSet<usize> = residency.drawn().iter().copied().collect();
    let shows = |node: usize| {
        drawn.contains(&node) || ancestors(index, node).any(|above| drawn.contains(&above))
    };
    let leaves_below = |node: usize| {
        let below =
            move |leaf: usize| leaf == node || ancestors(index, leaf).any(|above| above == node);
        let visible = |leaf: usize| view.least_depth(index.bounds(&index.nodes()[leaf])).is_some();
        (0..index.nodes().len())
            .filter(move |&leaf| index.nodes()[leaf].is_leaf() && below(leaf) && visible(leaf))
    };
    let fillable = |node: usize| {
        residency.is_resident(node)
            || ancestors(index, node).any(|above| residency.is_resident(above))
    };
    let cut = update.cut.nodes.iter().map(|wanted| wanted.node);
    cut.filter(|&node| fillable(node) && leaves_below(node).any(|leaf| !shows(leaf))).count()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn over_a_walk_there_is_never_a_hole_that_a_resident_node_could_have_filled(seed in any::<u64>(), pages in 12u64..120) {
        let planted = Planted::new();
        gpu::with(Way::Compute64, |gpu| {
            let mut residency = planted.open(gpu, pages * PAGE_BYTES);
            let mut random = Random(seed | 1);
            let mut place = random.bits();
            for _ in 0..40 {
                if random.bits().is_multiple_of(5) {
                    place = random.bits();
                }
                let mut camera = camera(place);
                camera.eye += DVec3::splat(random.within(-0.5, 0.5));
                let view = View::new(camera, [160, 120]).unwrap();
                let update = residency.update(gpu, &view, &few(6000)).unwrap();
                assert_eq!(needless_holes(&residency, &view, &update), 0);
                let drawn = residency.drawn();
                let twice = drawn.iter().filter(|&&node| ancestors(residency.index(), node).any(|above| drawn.contains(&above))).count();
                assert_eq!(twice, 0, "a node and what is below it");
                assert!(residency.pool_bytes()[1] <= pages * PAGE_BYTES);
                if random.bits().is_multiple_of(3) {
                    draw(gpu, &view, residency.resident());
                }
                std::thread::sleep(Duration::from_micros(random.bits() % 1500));
            }
        });
    }
}

#[test]
fn a_picture_that_moves_asks_for_little_at_a_time_and_is_whole_at_last() {
    let planted = Planted::new();
    gpu::with(Way::Compute64, |gpu| {
        let most = if gpu.device.is_cpu { UPLOAD_BYTES_SHARED } else { UPLOAD_BYTES };
        let mut residency = planted.open(gpu, HUGE);
        let (view, mut updates, mut before) = (view(2), 0, 0);
        loop {
            let update = residency.update_moving(gpu, &view, &all()).unwrap();
            let used = residency.pool_bytes()[1];
            // Nothing is evicted from a pool of this size, so that it grows by what is requested.
            assert!(used - before <= most, "{} bytes were asked for at once", used - before);
            (updates, before) = (updates + 1, used);
            if update.is_complete() {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(
            before > 2 * UPLOAD_BYTES_SHARED && updates > 2,
            "too little to tell: {before} bytes"
        );
    });
}

#[test]
fn a_damaged_leaf_is_said_once_and_its_parent_is_drawn() {
    let planted = Planted::new();
    let leaf = planted.index.nodes().iter().position(|record| record.is_leaf()).unwrap();
    let view = View::new(perspective(DVec3::new(0.0, -30.0, 20.0), DVec3::ZERO, 50.0), [160, 120])
        .unwrap();
    for plane in [Plane::Coarse, Plane::Rgb] {
        let index = planted.damaged(leaf, plane);
        gpu::with(Way::Compute64, |gpu| {
            let mut residency = Residency::open(gpu, index.clone(), planted.shown(), HUGE).unwrap();
            let (update, _) = settled(gpu, &mut residency, &view, &all());
            assert_eq!(update.errors.len(), 1, "{:?}", update.errors);
            assert!(
                update.errors[0].contains(&format!("node {leaf}'s"))
                    && update.errors[0].contains("checksum"),
                "{:?}",
                update.errors
            );
            let parent = index.nodes()[leaf].parent as usize;
            assert!(residency.drawn().contains(&parent) && !residency.drawn().contains(&leaf));
            // It equals the picture of a cut without the leaf.
            let expected =
                lod::choose(&index, &[view], &Clips::default(), &all(), &HashSet::from([leaf]));
            assert_eq!(update.cut, expected);
            let again = residency.wait_until_resident(gpu, &view, &all(), &Silent).unwrap();
            assert!(again.errors.is_empty() && again.bytes_read == 0, "tried again: {again:?}");
        });
    }
}

#[test]
fn a_damaged_root_is_drawn_by_its_children() {
    let planted = Planted::new();
    let index = planted.damaged(0, Plane::Fine);
    gpu::with(Way::Compute64, |gpu| {
        let mut residency = Residency::open(gpu, index, planted.shown(), HUGE).unwrap();
        let detail = Detail { lod_px: 1e9, ..all() };
        let (update, picture) = settled(gpu, &mut residency, &view(2), &detail);
        assert!(
            update.is_complete()
                && !residency.drawn().contains(&0)
                && !residency.drawn().is_empty(),
            "{update:?}"
        );
        assert!(picture.1.iter().any(|&id| id != u32::MAX));
    });
}

#[test]
fn a_file_that_shrinks_is_an_error_and_the_picture_goes_on() {
    let planted = Planted::new();
    gpu::with(Way::Compute64, |gpu| {
        let mut residency = planted.open(gpu, HUGE);
        let view = view(3);
        let coarse = Detail { lod_px: 1e9, ..all() };
        let (_, before) = settled(gpu, &mut residency, &view, &coarse);
        std::fs::OpenOptions::new()
            .write(true)
            .open(planted.path())
            .unwrap()
            .set_len(8192)
            .unwrap();
        let (update, after) = settled(gpu, &mut residency, &view, &all());
        assert!(!update.errors.is_empty(), "nothing was said");
        assert!(before == after, "what is resident is still drawn");
    });
}

#[test]
fn a_device_whose_memory_is_not_mapped_draws_the_same_and_tells_the_same() {
    let planted = Planted::new();
    let (points, colors) = bumpy(24_000, 20_000, &mut Random(0xC10D));
    let lattice = pointillist::cloud::Lattice { step: DVec3::splat(STEP), offset: DVec3::ZERO };
    let cloud = gpu::cloud(vec![gpu::part(lattice, &points, Some(colors))]);
    let slab = Slab::new(DVec3::splat(-9.0), DVec3::splat(9.0), 2.0).unwrap();
    let all_of_it = [Way::Compute64, Way::Unmapped].map(|way| {
        gpu::with(way, |gpu| {
            assert_eq!(gpu.device.has_host_visible_vram, way == Way::Compute64);
            let mut found = Vec::new();
            let mut config = |gpu: &mut Gpu, resident: &Resident, view: &View| {
                let ids = [0, 3, POINTS_PER_PAGE, POINTS_PER_PAGE * 7 + 11, u32::MAX - 1];
                let points = ids.map(|id| resident.point(gpu, id).unwrap());
                let section = resident.section(gpu, &slab).unwrap();
                assert!(points[0].is_some() && points[4].is_none() && !section.points.is_empty());
                found.push((
                    draw(gpu, view, resident),
                    points,
                    section,
                    resident.positions(gpu).unwrap(),
                ));
            };
            let whole =
                Resident::fill(gpu, cloud.clone(), DisplayAttribute::automatic(&cloud).0, &Silent)
                    .unwrap();
            config(gpu, &whole, &view(0));
            // A pool with streaming nodes, walked through without waiting.
            let mut residency = planted.open(gpu, 60 * PAGE_BYTES);
            for seed in 0..12 {
                let view = view(seed % 6);
                for step in 0..3 {
                    residency.update(gpu, &self::view(50 + 3 * seed + step), &few(6000)).unwrap();
                    draw(gpu, &view, residency.resident());
                }
                residency.wait_until_resident(gpu, &view, &few(6000), &Silent).unwrap();
                config(gpu, residency.resident(), &view);
            }
            assert!(residency.evictions > 0);
            found
        })
    });
    assert!(all_of_it[0] == all_of_it[1]);
}

/// Pages in memory, and a gate at which the loader waits.
struct Gate {
    node: usize,
    written: Arc<Mutex<Vec<usize>>>,
    pass: Option<Receiver<()>>,
    began: Option<Sender<()>>,
    panics: bool,
}

impl Destination for Gate {
    fn put(&mut self, _page: u32, _words: &[u32]) {
        assert!(!self.panics, "on purpose");
        if let Some(began) = self.began.take() {
            began.send(()).unwrap();
        }
        if let Some(pass) = self.pass.take() {
            pass.recv().unwrap();
            self.written.lock().unwrap().push(self.node);
        }
    }
}

impl Gate {
    fn open(node: usize) -> Gate {
        Gate { node, written: Arc::default(), pass: None, began: None, panics: false }
    }

    fn request(self) -> NodeRequest {
        NodeRequest { node: self.node, planes: 1, destination: Some(Box::new(self)) }
    }
}

fn answers(loader: &Loader, count: usize) -> Vec<Answer> {
    let within = Instant::now() + Duration::from_secs(5);
    let next = |_| {
        loader
            .wait(within.saturating_duration_since(Instant::now()))
            .unwrap()
            .expect("an answer in time")
    };
    (0..count).map(next).collect()
}

#[test]
fn the_newest_wish_list_wins() {
    let planted = Planted::new();
    let published = Arc::new(Mutex::new(0));
    let count = published.clone();
    let loader =
        Loader::start(planted.index.clone(), planted.shown(), move || *count.lock().unwrap() += 1)
            .unwrap();
    let ((pass, gate), (begins, began)) = (channel(), channel());
    let written = Arc::new(Mutex::new(Vec::new()));
    let held =
        Gate { pass: Some(gate), began: Some(begins), written: written.clone(), ..Gate::open(1) };
    loader.post(vec![
        held.request(),
        Gate::open(2).request(),
        Gate::open(3).request(),
        Gate::open(4).request(),
    ]);
    // Node 1 has started. Of the rest the second list keeps only 4, and the third requests 5 before
    // it.
    began.recv().unwrap();
    let kept = |node| NodeRequest { node, planes: 1, destination: None };
    loader.post(vec![kept(4), kept(1)]);
    loader.post(vec![Gate::open(5).request(), kept(4)]);
    pass.send(()).unwrap();
    let said: Vec<_> = answers(&loader, 5)
        .into_iter()
        .map(|Answer { node, outcome }| (node, matches!(outcome, Outcome::Done(_))))
        .collect();
    assert_eq!(said, [(1, true), (2, false), (3, false), (5, true), (4, true)]);
    assert_eq!(*written.lock().unwrap(), [1]);
    drop(loader);
    assert_eq!(*published.lock().unwrap(), 5, "published after every answer");
}

#[test]
fn a_panic_in_the_loader_is_an_error_of_one_node() {
    let planted = Planted::new();
    let loader = Loader::start(planted.index.clone(), planted.shown(), || ()).unwrap();
    loader.post(vec![Gate { panics: true, ..Gate::open(1) }.request(), Gate::open(2).request()]);
    let [first, second]: [Answer; 2] = answers(&loader, 2).try_into().unwrap();
    assert!(
        matches!(&first.outcome, Outcome::Failed(error) if error.to_string().contains("node 1") && error.to_string().contains("on purpose"))
    );
    assert!(matches!(second.outcome, Outcome::Done(read) if read.bytes > 0));
    assert!(!loader.has_ended());
}

#[test]
fn a_loader_that_is_gone_is_said_and_never_waited_for() {
    let planted = Planted::new();
    let loader =
        Loader::start(planted.index.clone(), planted.shown(), || panic!("outside of any node"))
            .unwrap();
    loader.post(vec![Gate::open(1).request(), Gate::open(2).request()]);
    assert_eq!(answers(&loader, 1)[0].node, 1);
    let began = Instant::now();
    assert!(loader.wait(Duration::from_secs(600)).unwrap_err().to_string().contains("ended"));
    // A busy machine may take long to report where a thread has panicked.
    assert!(began.elapsed() < Duration::from_secs(60));
}

impl Planted {
    /// Opens an index with nodes that cannot be read.
    fn failing(&self, fault: &str) -> Arc<Index> {
        let mut index = Index::open(&self.path()).unwrap();
        index.fault = Some(fault.parse().unwrap());
        Arc::new(index)
    }
}

/// Updates for a duration, with a picture after each; returns messages and their times.
fn updates(
    gpu: &mut Gpu,
    residency: &mut Residency,
    view: &View,
    during: Duration,
) -> Vec<(Duration, String)> {
    let (began, mut said) = (Instant::now(), Vec::new());
    while began.elapsed() < during {
        let update = residency.update(gpu, view, &all()).unwrap();
        assert_eq!(needless_holes(residency, view, &update), 0);
        said.extend(update.errors.into_iter().map(|error| (began.elapsed(), error)));
        std::thread::sleep(Duration::from_millis(10));
    }
    said
}

#[test]
fn a_loader_that_hangs_is_said_within_a_second_and_what_is_there_stays() {
    let planted = Planted::new();
    gpu::with(Way::Compute64, |gpu| {
        let mut residency =
            Residency::open(gpu, planted.failing("hang:9"), planted.shown(), HUGE).unwrap();
        let view = view(3);
        let said = updates(gpu, &mut residency, &view, Duration::from_secs(2));
        assert!(
            said.len() == 1
                && said[0].1.contains("has not come")
                && said[0].1.contains("cloud.pnti"),
            "{said:?}"
        );
        // A second after the start of the read; polling and a busy machine take a little longer.
        assert!(said[0].0 < Duration::from_millis(1500), "{said:?}");
        assert!(!residency.drawn().is_empty() && residency.drawn().len() <= 8);
        let before = draw(gpu, &view, residency.resident());
        residency.update(gpu, &view, &all()).unwrap();
        assert!(
            before == draw(gpu, &view, residency.resident()),
            "what is resident is still drawn"
        );
        // Nothing waits for it at the end; it has nothing left to write to.
        let closing = Instant::now();
        assert!(closing.elapsed() < Duration::from_secs(5), "{:?}", closing.elapsed());
    });
}

#[test]
fn a_node_that_comes_late_is_an_error_until_it_is_there() {
    let planted = Planted::new();
    gpu::with(Way::Compute64, |gpu| {
        let mut residency =
            Residency::open(gpu, planted.failing("slow:9"), planted.shown(), HUGE).unwrap();
        let (began, mut errors, mut resolved) = (Instant::now(), Vec::new(), Vec::new());
        loop {
            let update = residency.update(gpu, &view(3), &all()).unwrap();
            let is_complete = update.is_complete();
            errors.extend(update.errors);
            resolved.extend(update.resolved);
            if is_complete {
                break;
            }
            assert!(began.elapsed() < Duration::from_secs(60), "{errors:?}");
            std::thread::sleep(Duration::from_millis(10));
        }
        assert!(errors.iter().any(|error| error.contains("has not come")), "{errors:?}");
        assert_eq!(resolved, errors);
    });
}

#[test]
fn a_loader_that_ends_is_said_and_another_one_goes_on() {
    let planted = Planted::new();
    gpu::with(Way::Compute64, |gpu| {
        let (view, detail) = (view(3), all());
        let mut whole = planted.open(gpu, HUGE);
        let (_, expected) = settled(gpu, &mut whole, &view, &detail);
        let mut residency =
            Residency::open(gpu, planted.failing("end:20"), planted.shown(), HUGE).unwrap();
        let (update, picture) = settled(gpu, &mut residency, &view, &detail);
        assert!(
            update.errors.iter().all(|error| error.contains("has ended"))
                && !update.errors.is_empty(),
            "{:?}",
            update.errors
        );
        assert!(update.is_complete() && picture == expected);
        assert!(residency.pool_bytes()[1] <= HUGE);
    });
}

#[test]
fn what_the_device_outlives_is_written_nowhere() {
    // A residency that is dropped, not freed, after its device: its thread must not touch freed
    // memory.
    let planted = Planted::new();
    let wish = pointillist::gpu::DeviceOptions::default();
    let mut gpu = Gpu::open(&wish).unwrap();
    let mut residency = planted.open(&mut gpu, HUGE);
    residency.update(&mut gpu, &view(1), &all()).unwrap();
    drop(gpu);
    drop(residency);
}

#[test]
fn every_attribute_is_shown_as_the_cloud_itself_shows_it() {
    // Elevation is computed from positions. The picture tests cover the planes of the tree.
    let planted = Planted::new();
    let [lo, hi] = planted.index.directory.contents.bounds.unwrap();
    let shown = DisplayAttribute::indexed(Attribute::Elevation, [lo.z, hi.z], [0, 65_535]);
    let words = Arc::new(Mutex::new(Vec::new()));
    struct Keep(Arc<Mutex<Vec<u32>>>);
    impl Destination for Keep {
        fn put(&mut self, page: u32, words: &[u32]) {
            if page == 1 {
                *self.0.lock().unwrap() = words.to_vec();
            }
        }
    }
    let loader = Loader::start(planted.index.clone(), shown, || ()).unwrap();
    for node in [0, planted.index.nodes().len() - 1] {
        loader.post(vec![NodeRequest {
            node,
            planes: 1,
            destination: Some(Box::new(Keep(words.clone()))),
        }]);
        assert!(matches!(answers(&loader, 1)[0].outcome, Outcome::Done(_)));
        let expected: Vec<u32> =
            planted.index.samples(node).unwrap().iter().map(|(p, _)| shown.place(p.z)).collect();
        assert_eq!(*words.lock().unwrap(), expected);
    }
}

// ---- COPC in place

/// A COPC file of several levels, read in place.
fn copc() -> Planted {
    let folder = tempfile::tempdir().unwrap();
    let (points, colors) = bumpy(COPC_POINTS, 20_000, &mut Random(0xC0BC));
    write_copc(&folder.path().join("cloud.copc.laz"), &points, &colors);
    let index = Index::open_octree(&folder.path().join("cloud.copc.laz"), None, false).unwrap();
    assert!(index.nodes().len() > 5);
    Planted { folder, index: Arc::new(index) }
}

const COPC_POINTS: usize = 200_000;

#[test]
fn a_copc_file_with_all_of_its_nodes_draws_what_its_points_draw() {
    draws_what_its_points_draw(&copc(), COPC_POINTS, 0xC0BC);
}

#[test]
fn a_settled_picture_of_a_copc_file_depends_neither_on_the_pool_nor_on_what_was_drawn_before() {
    let planted = copc();
    gpu::with(Way::Compute64, |gpu| {
        let detail = few(120_000);
        let mut huge = planted.open(gpu, HUGE);
        let most = (0..4).map(|seed| {
            let mut fresh = planted.open(gpu, HUGE);
            fresh.wait_until_resident(gpu, &view(seed), &detail, &Silent).unwrap();
            fresh.pool_bytes()[1]
        });
        let most = most.max().unwrap();
        let mut tiny = planted.open(gpu, most);
        let mut random = Random(78);
        for round in 0..8 {
            let view = view(round % 4);
            for _ in 0..random.bits() % 4 {
                let elsewhere = self::view(100 + random.bits() % 50);
                let update = tiny.update(gpu, &elsewhere, &detail).unwrap();
                // What has come is drawn, and nothing else.
                let cut: HashSet<usize> = update.cut.nodes.iter().map(|own| own.node).collect();
                let here = cut.iter().filter(|&&node| tiny.is_resident(node)).count();
                assert_eq!(here, tiny.drawn().iter().filter(|node| cut.contains(node)).count());
                assert!(here + update.missing == cut.len());
            }
            let (small, by_small) = settled(gpu, &mut tiny, &view, &detail);
            let (large, by_large) = settled(gpu, &mut huge, &view, &detail);
            assert_eq!(small.cut, large.cut);
            assert!(by_small == by_large, "round {round}: the pictures differ");
        }
    });
}

/// The points of a node are as far apart as those that are drawn among them.
#[test]
fn the_spacing_of_a_copc_file_is_that_of_its_finest_nodes() {
    let planted = copc();
    gpu::with(Way::Compute64, |gpu| {
        let mut residency = planted.open(gpu, HUGE);
        let spacing = |residency: &mut Residency, detail: &Detail, gpu: &mut Gpu| {
            residency.wait_until_resident(gpu, &view(1), detail, &Silent).unwrap();
            residency.resident().nodes.iter().map(|node| node.spacing()).collect::<Vec<f64>>()
        };
        let coarse = spacing(&mut residency, &few(1), gpu);
        let fine = spacing(&mut residency, &all(), gpu);
        assert!(coarse.len() == 1 && fine.len() > 1);
        let least = fine.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(fine[0] == least && fine[0] < coarse[0], "{coarse:?} {fine:?}");
    });
}
