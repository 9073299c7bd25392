//! Frames that fail: the host drops their commands, and the next ones are those of a fresh start.

use super::memory::device_memory;
use super::*;
use pointillist::renderer::CloudId;

/// Clouds, and where they are seen from.
struct Scene {
    index: PathBuf,
    file: PathBuf,
    camera: Camera,
}

/// What is seen of a scene.
#[derive(PartialEq)]
struct Seen {
    color: Vec<u8>,
    depth: Vec<f32>,
    picked: DVec3,
}

const MIDDLE: [u32; 2] = [100, 120];

impl Scene {
    fn new(folder: &std::path::Path) -> Scene {
        let (file, camera) = scan(folder);
        Scene { index: indexed(&[&file], ""), file, camera }
    }

    /// Adds an index, a file and points of the application's buffer.
    fn open(&self, renderer: &mut Renderer, application: &Application) -> [CloudId; 3] {
        let mut open = |path: &PathBuf| {
            renderer.open(std::slice::from_ref(path), &OpenSettings::default()).unwrap()
        };
        let (index, file) = (open(&self.index), open(&self.file));
        let moved = glam::DMat4::from_translation(DVec3::new(0.3, 0.2, 0.5));
        renderer.set_transform(file, &moved.to_cols_array()).unwrap();
        let place = |i: u32| [(i % 200) as f32 / 100.0 - 1.0, (i / 200) as f32 / 50.0 - 1.0, 0.1];
        let places: Vec<[f32; 3]> = (0..20_000).map(place).collect();
        let buffer = application.point_buffer(&places);
        // SAFETY: the buffer lives as long as the application.
        [index, file, unsafe { renderer.add_buffer(buffer) }.unwrap()]
    }

    /// Opens the scene, and draws until all of it is seen; calls `mend` after a failure, and at the
    /// end. Returns also how many frames failed, and how many clouds.
    fn seen(
        &self,
        application: &mut Application,
        renderer: &mut Renderer,
        mend: &dyn Fn(),
    ) -> (Seen, [usize; 2]) {
        let (mut targets, mut frames, mut failed) = (application.targets(), 0, [0; 2]);
        // The renderer has a depth image of its own.
        targets.depth = None;
        let whole = view_of(self.camera);
        let mut nearer = self.camera;
        nearer.eye = nearer.target + 0.7 * (nearer.eye - nearer.target);
        let corner = Area { corner: [200, 100], size: [120, 140] };
        let views = [whole, FrameView { area: corner, ..view_of(nearer) }];
        let mut clouds = self.open(renderer, application);
        loop {
            frames += 1;
            assert!(frames < 4000, "the picture never settles");
            let pick = renderer.pick(MIDDLE);
            let drawn = application.try_submit(renderer, targets, &views, None);
            std::mem::replace(&mut application.said, Ok(())).unwrap();
            let Ok((report, color, _)) = drawn else {
                failed[0] += 1;
                assert_eq!(renderer.picked(pick), Picked::Pending);
                mend();
                // The picks of the frame are answered by the next one.
                let again = renderer.pick(MIDDLE);
                (0..2).for_each(|_| {
                    application.draw(renderer, targets, &views, None);
                });
                let answer = renderer.picked(pick);
                assert!(answer != Picked::Pending && answer == renderer.picked(again));
                continue;
            };
            let is_failed =
                |cloud: &CloudId| matches!(renderer.state(*cloud).unwrap(), CloudState::Failed(_));
            if clouds.iter().any(is_failed) {
                failed[1] += 1;
                mend();
                clouds.into_iter().for_each(|cloud| renderer.remove(cloud).unwrap());
                clouds = self.open(renderer, application);
            } else if report.settled && report.errors.is_empty() && report.points > 0 {
                mend();
                let pick = renderer.pick(MIDDLE);
                let (_, again, _) = application.draw(renderer, targets, &views, None);
                application.draw(renderer, targets, &views, None);
                let Picked::Point(point) = renderer.picked(pick) else { panic!("a point") };
                let with_depth = application.targets();
                let (_, with, depth) = application.settle(renderer, with_depth, &views);
                assert!(again == color && with == color, "depth of the host changes colours");
                clouds.into_iter().for_each(|cloud| renderer.remove(cloud).unwrap());
                return (Seen { color, depth, picked: point.world }, failed);
            }
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
    }
}

fn with(unmapped: bool) -> RendererOptions {
    let overrides = TestOverrides { unmapped, ..TestOverrides::default() };
    RendererOptions { overrides, ..RendererOptions::default() }
}

/// The host refuses the blocks of memory from each one on, until a frame or a cloud has failed.
#[test]
fn frames_without_memory_leave_the_picture_of_a_fresh_start() {
    let folder = tempfile::tempdir().unwrap();
    let scene = Scene::new(folder.path());
    for unmapped in [false, true] {
        let mut application = Application::new(COLOR);
        let host = device_memory::host_of(&application);
        let mend = || *device_memory::BLOCKS.lock().unwrap() = None;
        let mut expected = None;
        let mut failures = [0; 3];
        for blocks in std::iter::once(None).chain((0..).map(Some)) {
            *device_memory::BLOCKS.lock().unwrap() = blocks;
            application.frame = 0;
            // SAFETY: the renderer is dropped before the application.
            let Ok(mut renderer) = (unsafe { Renderer::new(&host, with(unmapped)) }) else {
                failures[2] += 1;
                continue;
            };
            let (seen, [frames, clouds]) = scene.seen(&mut application, &mut renderer, &mend);
            (failures[0], failures[1]) = (failures[0] + frames, failures[1] + clouds);
            let expected = expected.get_or_insert_with(|| Seen {
                color: seen.color.clone(),
                depth: seen.depth.clone(),
                ..seen
            });
            assert!(seen == *expected, "refused after {blocks:?} blocks");
            drop(renderer);
            assert_eq!(device_memory::bytes(), 0, "all is given back");
            if blocks.is_some() && [frames, clouds] == [0; 2] {
                break;
            }
        }
        mend();
        let [frames, clouds, starts] = failures;
        println!(
            "unmapped {unmapped}: {frames} frames, {clouds} clouds and {starts} starts failed"
        );
        assert!(frames > 0 && clouds > 0 && starts > 0);
    }
}

/// A creation fails, wherever it is in the frames of new clouds.
#[test]
fn frames_that_fail_leave_the_picture_of_a_fresh_start() {
    let folder = tempfile::tempdir().unwrap();
    let scene = Scene::new(folder.path());
    for unmapped in [false, true] {
        let mut application = Application::new(COLOR);
        // SAFETY: the renderer is dropped before the application.
        let mut renderer = unsafe { Renderer::new(&application.host(), with(unmapped)) }.unwrap();
        renderer.set("effect", "shadows=on").unwrap();
        let (expected, _) = scene.seen(&mut application, &mut renderer, &|| ());
        let (mut failures, mut after) = ([0; 2], 0);
        loop {
            counting::refuse(after, vk::Result::ERROR_OUT_OF_DEVICE_MEMORY);
            let refused = std::cell::Cell::new(false);
            let mend = || refused.set(counting::accept());
            let (seen, [frames, clouds]) = scene.seen(&mut application, &mut renderer, &mend);
            failures = [failures[0] + frames, failures[1] + clouds];
            assert!(seen == expected, "refused after {after}");
            assert!(refused.get() || [frames, clouds] == [0; 2]);
            if !refused.get() {
                break;
            }
            // All of the first ones.
            after += 1 + after / 4;
        }
        let [frames, clouds] = failures;
        println!("unmapped {unmapped}: {frames} frames and {clouds} clouds failed, to {after}");
        assert!(frames > 5 && clouds > 0);
        drop(renderer);
        assert_eq!(objects().alive, 0, "objects outlive the renderer");
    }
}
