//! A host draws clouds into its own images, beside its own geometry, on its own queue.

mod affine;
mod application;
mod blending;
mod c;
mod colors;
mod depth;
mod failures;
mod families;
mod filters;
mod guide;
mod lifetimes;
mod memory;
mod ownership;
mod picks;
mod wrong_calls;

use application::*;

use crate::counting::{self, allocations, heap_bytes, objects};
use crate::files;
use crate::gpu::division_error;
use crate::index_file::indexed;
use ash::vk::{self, Handle};
use glam::DVec3;
use pointillist::cloud::colormap::linear_to_srgb;
use pointillist::gpu::{Device, DeviceOptions, TestOverrides};
use pointillist::graph::Graph;
use pointillist::passes::{Effects, Switch, encode};
use pointillist::progress::Silent;
use pointillist::render::frame;
use pointillist::render::settings::{FrameConfig, RenderSettings, Style};
use pointillist::render::source::{OpenOptions, Source};
use pointillist::renderer::{
    Access, Area, Camera, CloudState, Encoding, Frame, FrameReport, FrameView, Host, Limit,
    Matrices, NO_POINT, OpenSettings, Picked, PointBuffer, Points, Positions, Preset, Renderer,
    RendererOptions, Target, Targets, ViewCamera,
};
use pointillist::resident::Resident;
use pointillist::view::View;
use std::path::PathBuf;

#[test]
fn a_renderer_with_a_device_of_its_own_draws_the_same_and_refuses_frames_of_hosts() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let options = DeviceOptions { validate: true, ..DeviceOptions::default() };
    let mut renderer = Renderer::open_device(&options, RendererOptions::default()).unwrap();
    let cloud = renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
    renderer.wait(cloud).unwrap();
    let expected = rendered(&path, camera, &RenderSettings::default());
    assert_eq!(renderer.picture(cloud, camera, SIZE).unwrap(), expected.color);

    let application = Application::new(COLOR);
    let (targets, mut hosted) = (application.targets(), application.renderer());
    let frame = Frame { number: 1, safe: 0, targets, views: &[] };
    // SAFETY: it is refused before anything is used.
    let refused = unsafe { renderer.record(0, &frame) }.unwrap_err();
    assert!(refused.to_string().contains("device of its own"), "{refused}");
    let cloud = hosted.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
    let refused = hosted.wait(cloud).unwrap_err();
    assert!(refused.to_string().contains("host's device"), "{refused}");
    let missing = renderer.open(&[folder.path().join("missing.las")], &OpenSettings::default());
    assert!(renderer.wait(missing.unwrap()).unwrap_err().to_string().contains("missing.las"));
}

#[test]
fn a_limit_changes_pictures_as_far_as_it_asks_and_none_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let options = DeviceOptions { validate: true, ..DeviceOptions::default() };
    let mut renderer = Renderer::open_device(&options, RendererOptions::default()).unwrap();
    let cloud = renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
    renderer.wait(cloud).unwrap();
    let plain = renderer.picture(cloud, camera, SIZE).unwrap();
    // The fastest settings of all; the most accurate, which are the renderer's own.
    renderer.set_limit(Some(Limit::Pixels(100.0))).unwrap();
    assert_ne!(renderer.picture(cloud, camera, SIZE).unwrap(), plain);
    renderer.set("error", "0.000000001px").unwrap();
    assert!(renderer.set("time", "soon").unwrap_err().to_string().contains("not a time"));
    assert_eq!(renderer.picture(cloud, camera, SIZE).unwrap(), plain);
    // Whatever a minute is enough for, after some pictures.
    renderer.set_limit(Some(Limit::Time(60_000.0))).unwrap();
    let mut pictures = (0..12).map(|_| renderer.picture(cloud, camera, SIZE).unwrap());
    assert_eq!(pictures.next_back().unwrap(), plain);
    renderer.set_limit(None).unwrap();
    assert_eq!(renderer.picture(cloud, camera, SIZE).unwrap(), plain);
}

fn without_alpha(color: &[u8]) -> Vec<u8> {
    color.chunks(4).flat_map(|pixel| &pixel[..3]).copied().collect()
}

/// A renderer moves to the host's render thread.
#[test]
fn a_renderer_is_sent_between_threads() {
    fn is_send<T: Send>() {}
    is_send::<Renderer>();
}

#[test]
fn a_settled_frame_is_recorded_in_no_time_and_makes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    // The layers take as long for each draw as we do.
    let applications = [(1, Application::new(COLOR)), (4, Application::unchecked())];
    for (count, mut application) in applications {
        let mut renderer = application.renderer();
        for _ in 0..count {
            renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
        }
        let targets = Targets { ids: None, normals: None, ..application.targets() };
        let size = [SIZE[0] / count, SIZE[1]];
        let area = |number| Area { corner: [(number * size[0]) as i32, 0], size };
        let views: Vec<_> =
            (0..count).map(|number| FrameView { area: area(number), ..view_of(camera) }).collect();
        let (_, first, _) = application.settle(&mut renderer, targets, &views);
        let made = objects().made;
        let mut times = Vec::with_capacity(50);
        let mut heap = Vec::with_capacity(50);
        for _ in 0..50 {
            let (_, color, _) = application.draw(&mut renderer, targets, &views, None);
            assert!(color == first);
            times.push(application.recorded.as_secs_f64() * 1e3);
            drop(color);
            heap.push(heap_bytes());
        }
        assert_eq!(objects().made, made, "Vulkan objects were made");
        // Queues of frames may grow at first.
        assert_eq!(heap[49], heap[10], "{heap:?}");
        times.sort_by(f64::total_cmp);
        println!(
            "{count} clouds in {count} views: recorded in {:.3} ms (median), {:.3} ms (worst)",
            times[25], times[49]
        );
        assert!(times[25] < 0.3, "{count} clouds in {count} views: {times:?}");
    }
}

/// From one to three frames are in flight. Nothing is submitted, and nothing waited for, beside
/// them.
#[test]
fn frames_of_random_calls_leave_the_picture_of_a_fresh_start() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let index = indexed(&[&path], "");
    let mut application = Application::new(COLOR);
    let targets = application.targets();
    let mut fresh = application.renderer();
    fresh.open(std::slice::from_ref(&index), &OpenSettings::default()).unwrap();
    let (_, expected, _) = application.settle(&mut fresh, targets, &[view_of(camera)]);
    drop(fresh);
    (application.frame, application.safe) = (0, 0);
    let mut renderer = application.renderer();
    let mut random = 1u64;
    let mut next = |below: u64| {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        random % below
    };
    let mut clouds = Vec::new();
    let place = [[0.0f32; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.3]];
    let on_device = application.point_buffer(&place);
    // Images that frames in flight use are waited for.
    let mut flying = targets;
    let any = Access::any(vk::ImageLayout::UNDEFINED.as_raw());
    flying.color.before = any;
    for target in [&mut flying.depth, &mut flying.ids, &mut flying.normals] {
        target.iter_mut().for_each(|target| target.before = any);
    }
    let mut growth = Vec::new();
    // What costs much is drawn for a few frames at a time: until which, and what ends it.
    let costly = [
        ("effect", "strokes=on", "strokes=off"),
        ("effect", "shadows=on", "shadows=off"),
        ("opacity", "0.5", ""),
    ];
    let mut ends: Option<(usize, &str, &str)> = None;
    for frame in 0..1000 {
        match next(18) {
            0 | 1 if clouds.len() < 4 => {
                clouds.push(
                    renderer.open(std::slice::from_ref(&index), &OpenSettings::default()).unwrap(),
                );
            }
            2 if clouds.len() < 4 => {
                let points = Points::new(Positions::F32(&place));
                clouds.push(renderer.add_points(&points).unwrap());
            }
            3 if clouds.len() < 4 => {
                // SAFETY: the buffer lives as long as the application.
                clouds.push(unsafe { renderer.add_buffer(on_device) }.unwrap());
            }
            4 | 5 | 15 | 16 if !clouds.is_empty() => {
                let cloud = clouds.swap_remove(next(clouds.len() as u64) as usize);
                renderer.remove(cloud).unwrap();
            }
            6 if !clouds.is_empty() => {
                let cloud = clouds[next(clouds.len() as u64) as usize];
                renderer.set_visible(cloud, next(2) == 0).unwrap();
            }
            7 if !clouds.is_empty() => {
                let stretched = DVec3::new(1.0, 1.0, [1.0, 2.0, -0.5][next(3) as usize]);
                let columns = glam::DMat4::from_scale(stretched)
                    * glam::DMat4::from_rotation_z(next(6) as f64);
                let cloud = clouds[next(clouds.len() as u64) as usize];
                renderer.set_transform(cloud, &columns.to_cols_array()).unwrap();
            }
            8 | 9 => drop(renderer.pick([next(320) as u32, next(240) as u32])),
            10 | 11 => {
                let effects = ["edl=on", "edl=off", "fill=on", "ao=on"];
                renderer.set("effect", effects[next(4) as usize]).unwrap();
            }
            13 => {
                let clips = ["box:-1,-1,-1,0.5,1,1", "box:-3,-3,-3,3,3,3", ""];
                renderer.set("clip", clips[next(3) as usize]).unwrap();
            }
            14 if ends.is_none() => {
                let (name, on, off) = costly[next(3) as usize];
                renderer.set(name, on).unwrap();
                ends = Some((frame + 2, name, off));
            }
            _ => {}
        }
        if let Some((_, name, off)) = ends.take_if(|(until, ..)| frame >= *until) {
            renderer.set(name, off).unwrap();
        }
        let size = [48 + 16 * next(6) as u32, 48 + 16 * next(6) as u32];
        let area = Area { corner: [next(100) as i32, next(80) as i32], size };
        let mut moved = camera;
        moved.eye += DVec3::splat(next(10) as f64 / 10.0);
        let size = SIZE.map(|side| side / 2);
        let whole = FrameView { area: Area { corner: [0, 0], size }, ..view_of(camera) };
        let views = [FrameView { area, ..view_of(moved) }, whole];
        let views = &views[..1 + next(2) as usize];
        let report = application.draw_in_flight(&mut renderer, flying, views, 1 + next(3));
        let is_told = |error: &String| !error.contains("drawn as points");
        let errors: Vec<_> = report.errors.into_iter().filter(is_told).collect();
        assert_eq!(errors, Vec::<String>::new(), "frame {frame}");
        growth.push(objects().alive);
    }
    // As many are alive at the most in the last quarter as in the second.
    let most = |frames: std::ops::Range<usize>| *growth[frames].iter().max().unwrap();
    println!("objects alive: {} at most, then {}", most(250..500), most(750..1000));
    assert!(most(750..1000) <= most(250..500) * 11 / 10, "{growth:?}");
    clouds.into_iter().for_each(|cloud| renderer.remove(cloud).unwrap());
    renderer.set_settings(RenderSettings::default());
    renderer.set_filters(Default::default(), Default::default());
    renderer.open(&[index], &OpenSettings::default()).unwrap();
    let (_, settled, _) = application.settle(&mut renderer, targets, &[view_of(camera)]);
    assert!(settled == expected);
    drop(renderer);
    assert_eq!(objects().alive, 0, "objects outlive the renderer");
    let allocations = allocations();
    assert!(allocations.alive == 0 && allocations.made > 0, "{allocations:?}");
    assert_eq!(counting::queue_calls(), 0, "the queue is the host's");
}

#[test]
fn what_cannot_be_recorded_is_an_error_and_nothing_else() {
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    let targets = application.targets();
    let camera = Camera {
        eye: DVec3::ZERO,
        target: DVec3::Y,
        up: DVec3::Z,
        fov_y: 40.0,
        projection: pointillist::renderer::Projection::Perspective,
        ortho_height: None,
    };
    let (report, color, _) = application.draw(&mut renderer, targets, &[view_of(camera)], None);
    assert!(report.settled && color.chunks(4).all(|pixel| pixel == &color[..4]));
    let wrong = |renderer: &mut Renderer, targets: Targets, number, safe| {
        let frame = Frame { number, safe, targets, views: &[] };
        // SAFETY: refused before anything is recorded.
        unsafe { renderer.record(0, &frame) }.unwrap_err().to_string()
    };
    assert!(wrong(&mut renderer, targets, 1, 0).contains("numbers must grow"));
    assert!(wrong(&mut renderer, targets, 5, 5).contains("numbers must grow"));
    let mut many = targets;
    many.depth.iter_mut().for_each(|depth| depth.samples = 4);
    assert!(wrong(&mut renderer, many, 5, 1).contains("4 samples per pixel; resolve"));
    let beyond = Area { corner: [1, 0], size: SIZE };
    let views = [FrameView { area: beyond, ..view_of(camera) }];
    let frame = Frame { number: 5, safe: 1, targets, views: &views };
    // SAFETY: refused before anything is recorded.
    let refused = unsafe { renderer.record(0, &frame) }.unwrap_err().to_string();
    assert!(refused.contains("not within the targets"), "{refused}");
    let swapped = Targets { color: targets.depth.unwrap(), ..targets };
    assert!(wrong(&mut renderer, swapped, 5, 1).contains("D32_SFLOAT"));
    let missing = renderer.open(&["/no/such.las".into()], &OpenSettings::default()).unwrap();
    while matches!(renderer.state(missing).unwrap(), CloudState::Loading { .. }) {
        application.draw(&mut renderer, targets, &[view_of(camera)], None);
    }
    let CloudState::Failed(why) = renderer.state(missing).unwrap() else { panic!() };
    assert!(why.contains("/no/such.las"), "{why}");
}

/// What the host says about its images is what is recorded: a lie is found.
#[test]
fn a_host_that_lies_about_a_layout_is_caught() {
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    let honest = application.targets();
    application.draw(&mut renderer, honest, &[], None);
    let mut lying = honest;
    lying.color.before = Access::any(vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL.as_raw());
    lying.color.clear = false;
    application.submit(&mut renderer, lying, &[], None);
    let said = std::mem::replace(&mut application.said, Ok(())).unwrap_err().to_string();
    assert!(said.contains("SHADER_READ_ONLY_OPTIMAL"), "{said}");
}
