//! Renderers side by side, and what they leave behind.

use super::*;
use crate::program::{pointillist, succeeded};

/// Returns the names of this process's threads that are ours.
fn own_threads() -> Vec<String> {
    let tasks = std::fs::read_dir("/proc/self/task").unwrap();
    let names =
        tasks.filter_map(|task| std::fs::read_to_string(task.ok()?.path().join("comm")).ok());
    let is_own = |name: &String| name.starts_with("pointillist") || name.trim() == "loader";
    names.filter(is_own).collect()
}

/// Threads that wait for servers end with the last renderer that uses them.
#[test]
fn no_thread_that_waits_for_a_server_outlives_its_renderers() {
    let network = || {
        let tasks = std::fs::read_dir("/proc/self/task").unwrap();
        let names =
            tasks.filter_map(|task| std::fs::read_to_string(task.ok()?.path().join("comm")).ok());
        names.filter(|name| name.trim() == "network").count()
    };
    let application = Application::new(COLOR);
    let mut both = [application.renderer(), application.renderer()];
    for renderer in &mut both {
        // Nothing listens there.
        let address = PathBuf::from("http://127.0.0.1:9/scan.copc.laz");
        renderer.open(&[address], &OpenSettings::default()).unwrap();
    }
    let began = std::time::Instant::now();
    while network() == 0 {
        assert!(began.elapsed().as_secs() < 10, "no thread is started");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let [one, other] = both;
    drop(one);
    assert!(network() > 0, "the other renderer still waits");
    drop(other);
    assert_eq!(network(), 0);
}

/// A renderer ends its threads, also while it reads files and an index: those that read, and those
/// that the work is divided among.
#[test]
fn no_thread_outlives_its_renderer() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("torus.las");
    // By the program: work in this process is the renderer's alone.
    let made =
        pointillist().args(["synth", "torus", "--points", "2000000", "-o"]).arg(&path).output();
    succeeded(&made.unwrap());
    let index = indexed(&[&path], "");
    let camera = Camera {
        eye: DVec3::new(0.0, -4.0, 2.0),
        target: DVec3::ZERO,
        up: DVec3::Z,
        fov_y: 40.0,
        projection: pointillist::renderer::Projection::Perspective,
        ortho_height: None,
    };
    let mut application = Application::new(COLOR);
    let targets = application.targets();
    let mut most = 0;
    for frames in [0, 1, 3, 10, 40] {
        application.frame = 0;
        let mut renderer = application.renderer();
        for file in [&path, &index] {
            renderer.open(std::slice::from_ref(file), &OpenSettings::default()).unwrap();
        }
        let place = |i: u32| [(i % 300) as f64 / 150.0, (i / 300) as f64 / 150.0, 0.0];
        let places: Vec<[f64; 3]> = (0..90_000).map(place).collect();
        renderer.add_points(&Points::new(Positions::F64(&places))).unwrap();
        for _ in 0..frames {
            application.draw(&mut renderer, targets, &[view_of(camera)], None);
        }
        if frames == 40 {
            application.settle(&mut renderer, targets, &[view_of(camera)]);
            renderer.framing(Preset::Fit, SIZE).unwrap();
        }
        let reading = own_threads().len();
        most = most.max(reading);
        drop(renderer);
        // The system lists a thread for a moment after its end.
        let left = (0..100).map(|_| own_threads()).find(|left| {
            std::thread::sleep(std::time::Duration::from_millis(1));
            left.is_empty()
        });
        println!("{frames} frames, {reading} threads, then {:?}", own_threads());
        assert!(left.is_some(), "after {frames} frames: {:?}", own_threads());
    }
    assert!(most > 2, "nothing is read: {most}");
    // Nothing was divided among threads of the process, which would stay: they start only now.
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().unwrap();
}

/// Two renderers on two devices, drawing at the same time in two threads, draw what each does
/// alone.
#[test]
fn renderers_on_two_devices_are_independent() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let drawn = |effect: &'static str| {
        let path = path.clone();
        move || {
            let mut application = Application::new(COLOR);
            let mut renderer = application.renderer();
            renderer.set("effect", effect).unwrap();
            renderer.open(&[path], &OpenSettings::default()).unwrap();
            let targets = application.targets();
            let (_, settled, _) = application.settle(&mut renderer, targets, &[view_of(camera)]);
            for turn in 0..8 {
                let mut moved = camera;
                moved.eye += DVec3::splat((turn % 7) as f64 / 20.0);
                application.draw(&mut renderer, targets, &[view_of(moved)], None);
            }
            let (_, after, _) = application.settle(&mut renderer, targets, &[view_of(camera)]);
            assert!(settled == after);
            settled
        }
    };
    let effects = ["edl=on", "fill=off"];
    let alone = effects.map(|effect| drawn(effect)());
    let together = effects.map(|effect| std::thread::spawn(drawn(effect)));
    let together = together.map(|thread| thread.join().unwrap());
    assert!(alone == together && alone[0] != alone[1]);
}

/// The next device after a lost one shows what the lost one did.
#[test]
fn a_restored_renderer_draws_the_same_on_another_device() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    let cloud = renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
    let hidden = renderer.open(&[path], &OpenSettings::default()).unwrap();
    renderer.set_visible(hidden, false).unwrap();
    let turned = glam::DMat4::from_translation(camera.target)
        * glam::DMat4::from_rotation_z(0.3)
        * glam::DMat4::from_translation(-camera.target);
    renderer.set_transform(cloud, &turned.to_cols_array()).unwrap();
    renderer.set("style", "surface").unwrap();
    renderer.set("effect", "edl=on").unwrap();
    renderer.set("background", "1e3c5a").unwrap();
    let targets = application.targets();
    let (_, before, depth) = application.settle(&mut renderer, targets, &[view_of(camera)]);
    let points = renderer.add_points(&Points::new(Positions::F32(&[[0.0; 3]; 9]))).unwrap();
    let pick = renderer.pick([5, 5]);

    let mut other = Application::new(COLOR);
    // SAFETY: the renderer is dropped before the application.
    let mut next = unsafe { renderer.restored(&other.host()) }.unwrap();
    drop(renderer);
    drop(application);
    let pictures = [Picked::Nothing, Picked::Nothing];
    assert_eq!([next.picked(pick), next.picked(pick)], pictures);
    let CloudState::Failed(why) = next.state(points).unwrap() else { panic!("points of memory") };
    assert!(why.contains("add them again"), "{why}");
    next.remove(points).unwrap();
    let targets = other.targets();
    let (_, after, depths) = other.settle(&mut next, targets, &[view_of(camera)]);
    assert!(before == after && depth == depths);
    assert!(
        next.open(&[folder.path().join("scan.las")], &OpenSettings::default()).unwrap() > points
    );
    drop(next);
}

/// A lost device is an error that says so, wherever it is noticed; the next device shows the same.
#[test]
fn a_lost_device_is_told_and_the_next_one_draws_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let index = indexed(&[&path], "");
    let mut moved = camera;
    moved.eye += DVec3::splat(0.3);
    let lost = vk::Result::ERROR_DEVICE_LOST;
    // While times are read, while nodes are taken in, and while something is made for a picture.
    let ways: [(&PathBuf, fn()); 3] = [
        (&path, || counting::lose_device(true)),
        (&index, || counting::lose_device(true)),
        (&path, || counting::refuse(0, vk::Result::ERROR_DEVICE_LOST)),
    ];
    for (way, (file, lose)) in ways.into_iter().enumerate() {
        let mut application = Application::new(COLOR);
        let mut renderer = application.renderer();
        renderer.open(std::slice::from_ref(file), &OpenSettings::default()).unwrap();
        renderer.set("effect", "edl=on").unwrap();
        let targets = application.targets();
        let (_, before, depth) = application.settle(&mut renderer, targets, &[view_of(camera)]);
        if way == 0 {
            application.draw(&mut renderer, targets, &[view_of(moved)], None);
        }
        let pick = renderer.pick([160, 120]);
        moved.eye += DVec3::splat(0.1);
        lose();
        let told = application.try_submit(&mut renderer, targets, &[view_of(moved)], None);
        let told = told.expect_err("the device is lost");
        assert!(told.is_lost_device(), "{way}: {told}");
        counting::lose_device(false);
        counting::accept();
        let mut other = Application::new(COLOR);
        // SAFETY: the renderer is dropped before the application.
        let mut next = unsafe { renderer.restored(&other.host()) }.unwrap();
        counting::lose_device(true);
        drop(renderer);
        drop(application);
        counting::lose_device(false);
        assert_eq!(next.picked(pick), Picked::Nothing);
        let targets = other.targets();
        let (_, after, depths) = other.settle(&mut next, targets, &[view_of(camera)]);
        assert!(before == after && depth == depths, "{way}");
    }
    // While a cloud is uploaded: the frame tells it, not the cloud alone.
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    let cloud = renderer.open(&[path], &OpenSettings::default()).unwrap();
    counting::refuse(0, lost);
    let targets = application.targets();
    let told = (0..2000).find_map(|_| {
        std::thread::sleep(std::time::Duration::from_millis(2));
        application.try_submit(&mut renderer, targets, &[view_of(camera)], None).err()
    });
    assert!(told.expect("the device is lost").is_lost_device());
    assert!(counting::accept() && matches!(renderer.state(cloud), Ok(CloudState::Failed(_))));
    let mut other = Application::new(COLOR);
    // SAFETY: the renderer is dropped before the application.
    let mut next = unsafe { renderer.restored(&other.host()) }.unwrap();
    drop(renderer);
    let targets = other.targets();
    let (report, ..) = other.settle(&mut next, targets, &[view_of(camera)]);
    assert!(report.points > 0);
}

/// Four views of an index share one cut and what is read for it.
#[test]
fn views_share_what_is_read_and_a_frame_takes_no_more_than_its_share() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("street.las");
    files::scan(&path, pointillist::synth::SceneKind::Street, 3_000_000);
    let index = indexed(&[&path], "");
    let settings = OpenSettings::default();
    let of = |files: &[&PathBuf], count| {
        let mut application = Application::new(COLOR);
        let mut renderer = application.renderer();
        for &file in files {
            renderer.open(std::slice::from_ref(file), &settings).unwrap();
        }
        let targets = application.targets();
        let mut views = Vec::new();
        let (mut sum, mut largest, mut settled) = (0, 0, false);
        for _ in 0..2000 {
            if let (true, Some(camera)) = (views.is_empty(), renderer.framing(Preset::Fit, SIZE)) {
                views = vec![view_of(camera); count];
            }
            let (report, ..) = application.draw(&mut renderer, targets, &views, None);
            (sum, largest) = (sum + report.streamed, report.streamed.max(largest));
            settled = report.settled && !views.is_empty();
            if settled {
                break;
            }
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        assert!(settled);
        (sum, largest)
    };
    let (alone, largest) = of(&[&index], 1);
    let (four, largest_of_four) = of(&[&index], 4);
    println!("{alone} bytes, at most {largest} a frame; four views {four}, {largest_of_four}");
    let most = pointillist::config::UPLOAD_BYTES;
    assert!(alone > 1 << 20 && largest.max(largest_of_four) <= most);
    // A file is uploaded whole, in more than one frame.
    let (whole, largest_of_file) = of(&[&path], 1);
    println!("of the file {whole} bytes, at most {largest_of_file} a frame");
    assert!(whole > most && largest_of_file <= most, "{whole} {largest_of_file}");
    // Clouds share what a frame may take.
    let (both, largest_of_both) = of(&[&index, &index], 1);
    assert!(both >= alone && largest_of_both <= most, "{both} {largest_of_both}");
    let (both, largest_of_both) = of(&[&path, &path], 1);
    assert!(both >= whole && largest_of_both <= most, "{both} {largest_of_both}");
    // The budgets of the views add up, so that each has its points.
    assert!(four >= alone && four <= 2 * alone, "{four} {alone}");
}

/// Frames that are recorded and not submitted, such as after an image of a swapchain is lost, while
/// points arrive and when all are there.
#[test]
fn a_frame_that_is_not_submitted_is_taken_back() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let index = indexed(&[&path], "");
    let mut application = Application::new(COLOR);
    let (targets, views) = (application.targets(), [view_of(camera)]);
    let mut fresh = application.renderer();
    fresh.open(std::slice::from_ref(&index), &OpenSettings::default()).unwrap();
    let (_, expected, _) = application.settle(&mut fresh, targets, &views);
    drop(fresh);
    (application.frame, application.safe) = (0, 0);
    let mut renderer = application.renderer();
    renderer.open(std::slice::from_ref(&index), &OpenSettings::default()).unwrap();
    let middle = SIZE.map(|side| side / 2);
    let mut picks = Vec::new();
    for round in 0..60 {
        if round == 40 {
            application.settle(&mut renderer, targets, &views);
        }
        picks.push(renderer.pick(middle));
        application.drop_one(&mut renderer, targets, &views);
        if round % 3 == 0 {
            application.draw(&mut renderer, targets, &views, None);
        }
    }
    assert!(renderer.drop_frame(1).unwrap_err().to_string().contains("cannot be dropped"));
    let (_, settled, _) = application.settle(&mut renderer, targets, &views);
    assert!(settled == expected);
    application.draw(&mut renderer, targets, &views, None);
    let last = renderer.pick(middle);
    application.draw(&mut renderer, targets, &views, None);
    application.draw(&mut renderer, targets, &views, None);
    let Picked::Point(point) = renderer.picked(last) else { panic!("the pick is answered") };
    for pick in picks {
        // Before any point has arrived there is none.
        match renderer.picked(pick) {
            Picked::Point(own) => assert_eq!(own.cloud, point.cloud),
            other => assert_eq!(other, Picked::Nothing),
        }
    }
    drop(renderer);
    assert_eq!(objects().alive, 0, "objects outlive the renderer");
}

/// A host has nothing to look at yet.
#[test]
fn targets_are_cleared_without_views() {
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    renderer.set("background", "#204060").unwrap();
    let (_, color, depth) = application.draw(&mut renderer, application.targets(), &[], None);
    assert!(color.chunks(4).all(|pixel| pixel == [0x20, 0x40, 0x60, 255]), "{:?}", &color[..4]);
    assert!(depth.iter().all(|depth| *depth == 0.0));
    let (ids, normals) = &application.layers;
    assert!(ids.iter().all(|id| *id == [NO_POINT, 0]) && normals.iter().all(|n| *n == [0.0; 4]));
}
