//! Calls that make no sense are errors, and leave everything as it was.

use super::*;
use pointillist::renderer::{CloudId, PickId, Projection};

fn camera() -> Camera {
    Camera {
        eye: DVec3::new(0.0, 0.0, 3.0),
        target: DVec3::ZERO,
        up: DVec3::Y,
        fov_y: 40.0,
        projection: Projection::Perspective,
        ortho_height: None,
    }
}

#[test]
fn hosts_that_make_no_sense_are_refused() {
    let application = Application::new(COLOR);
    let host = application.host();
    let null = std::ptr::null();
    let wrong = [
        (Host { get_instance_proc_addr: null, ..host }, "get_instance_proc_addr is null"),
        (Host { instance: 0, ..host }, "null"),
        (Host { physical_device: 0, ..host }, "null"),
        (Host { device: 0, ..host }, "null"),
        (Host { queue_family: 99, ..host }, "queue family 99"),
        (Host { queue_family: u32::MAX, ..host }, "queue family"),
    ];
    for (host, why) in wrong {
        // SAFETY: what is not null is valid.
        let refused = unsafe { Renderer::new(&host, RendererOptions::default()) };
        let refused = refused.err().expect(why).to_string();
        assert!(refused.contains(why), "{refused}");
    }
}

#[test]
fn clouds_and_words_that_make_no_sense_are_refused() {
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    let targets = application.targets();
    let views = [view_of(camera())];
    let none = [CloudId(0), CloudId(77), CloudId(u64::MAX)];
    let cloud = renderer.add_points(&Points::new(Positions::F32(&[[0.0; 3]]))).unwrap();
    renderer.remove(cloud).unwrap();
    for cloud in none.into_iter().chain([cloud]) {
        let unit = glam::DMat4::IDENTITY.to_cols_array();
        let refused = [
            renderer.remove(cloud).err(),
            renderer.set_visible(cloud, true).err(),
            renderer.set_transform(cloud, &unit).err(),
            renderer.state(cloud).err(),
            renderer.notes(cloud).err(),
        ];
        for why in refused {
            let why = why.expect("there is no such cloud").to_string();
            assert!(why.contains(&format!("there is no cloud {}", cloud.0)), "{why}");
        }
    }
    // Points that are nowhere or very far, none at all, and files that are none.
    let nowhere = [[f64::NAN, 0.0, 0.0], [f64::INFINITY, 1.0, 2.0]];
    let all_colors = OpenSettings { color: Some("no such colour".into()), strict: true };
    let odd = [
        renderer.add_points(&Points::new(Positions::F64(&nowhere))),
        renderer.add_points(&Points::new(Positions::F32(&[]))),
        renderer.add_points(&Points::new(Positions::F64(&[[1e300, -1e300, 0.0]]))),
        renderer.add_points(&Points::new(Positions::Steps {
            steps: &[[1, 2, 3]],
            scale: [0.0, -1.0, f64::NAN],
            offset: [0.0; 3],
        })),
        renderer.open(&["/".into()], &OpenSettings::default()),
        renderer.open(&["/dev/null".into()], &all_colors),
    ];
    let no_files = renderer.open(&[], &OpenSettings::default()).unwrap_err().to_string();
    assert!(no_files.contains("name at least one"), "{no_files}");
    for (number, cloud) in odd.into_iter().enumerate() {
        let cloud = match cloud {
            Ok(cloud) => cloud,
            Err(why) => {
                println!("{number}: refused: {why}");
                continue;
            }
        };
        let mut frames = 0;
        let waits = |state: &CloudState| {
            matches!(state, CloudState::Loading { .. } | CloudState::Uploading)
        };
        while waits(&renderer.state(cloud).unwrap()) {
            application.draw(&mut renderer, targets, &views, None);
            frames += 1;
            assert!(frames < 2000, "it never ends");
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        println!("{number}: {:?}", renderer.state(cloud).unwrap());
        application.draw(&mut renderer, targets, &views, None);
        renderer.remove(cloud).unwrap();
    }
    let settings = renderer.settings().clone();
    let junk = ["?", "=", "edl=on,,", "box:1,2", "\u{0}", "-1", "NaN", "1e999", "direction:0,0"];
    let names = [
        "",
        "style",
        "effect",
        "light",
        "background",
        "layer",
        "opacity",
        "clip",
        "ramp",
        "range",
        "contrast",
        "gamma",
        "error",
    ];
    for name in names {
        for value in junk {
            assert!(renderer.set(name, value).is_err(), "{name}={value} is taken");
        }
    }
    assert!(renderer.set("time", "-5ms").is_err() && renderer.set("time", "").is_err());
    assert_eq!(format!("{:?}", renderer.settings()), format!("{settings:?}"));
    // Picks that were never requested, and pixels beyond the picture.
    assert_eq!(renderer.picked(PickId(1234)), Picked::Nothing);
    let beyond = renderer.pick([u32::MAX, u32::MAX]);
    assert_eq!(renderer.picked(beyond), Picked::Pending);
    application.draw(&mut renderer, targets, &views, None);
    application.draw(&mut renderer, targets, &views, None);
    let answers = [renderer.picked(beyond), renderer.picked(beyond)];
    assert_eq!(answers, [Picked::Nothing, Picked::Nothing]);
}

#[test]
fn frames_that_make_no_sense_are_refused_or_reported() {
    let folder = tempfile::tempdir().unwrap();
    let (path, good) = scan(folder.path());
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    renderer.open(&[path], &OpenSettings::default()).unwrap();
    let targets = application.targets();
    let (_, expected, _) = application.settle(&mut renderer, targets, &[view_of(good)]);
    let number = application.frame;
    // Refused before anything is recorded.
    let mut refused = |targets: Targets, area: Area, number: u64, safe: u64| {
        let views = [FrameView { area, ..view_of(good) }];
        let frame = Frame { number, safe, targets, views: &views };
        // SAFETY: as above.
        unsafe { renderer.record(0, &frame) }.unwrap_err().to_string()
    };
    for (corner, size) in [
        ([0, 0], [0, 0]),
        ([-1, 0], [10, 10]),
        ([i32::MIN, i32::MAX], SIZE),
        ([i32::MAX, 0], [u32::MAX, u32::MAX]),
        ([0, 0], [u32::MAX, 1]),
    ] {
        let why = refused(targets, Area { corner, size }, number + 1, number);
        assert!(why.contains("not within the targets"), "{why}");
    }
    let numbers = [(0, 0), (number, 0), (number - 1, 0), (number + 1, number + 1), (1, u64::MAX)];
    for (next, safe) in numbers {
        let why = refused(targets, WHOLE, next, safe);
        assert!(why.contains("numbers must grow"), "{why}");
    }
    let of_format = |format: i32| Target { format, ..targets.color };
    let rgba = Some(of_format(vk::Format::R8G8B8A8_UNORM.as_raw()));
    for format in [0, -1, i32::MAX, vk::Format::R8_UNORM.as_raw(), vk::Format::D32_SFLOAT.as_raw()]
    {
        let wrong = [
            Targets { color: of_format(format), ..targets },
            Targets { ids: Some(of_format(format)), ..targets },
            Targets { normals: Some(of_format(format)), ..targets },
            Targets { depth: rgba, ..targets },
        ];
        for targets in wrong {
            let why = refused(targets, WHOLE, number + 1, number);
            assert!(why.contains("format"), "{why}");
        }
    }
    let null = Target { view: 0, ..targets.color };
    let many = Target { samples: 0, ..targets.color };
    for (color, word) in [(null, "null handle"), (many, "0 samples")] {
        let why = refused(Targets { color, ..targets }, WHOLE, number + 1, number);
        assert!(why.contains(word), "{why}");
    }
    // Views that cannot be drawn are reported, and the rest is drawn.
    let matrices = Matrices::of(&good, SIZE, 0.1, 100.0).unwrap();
    let of_matrices = |view: [f64; 16], projection: [f64; 16]| {
        let matrices = Matrices { view, projection };
        FrameView { camera: ViewCamera::Matrices(matrices), area: WHOLE }
    };
    let depths = |near: f64, far: f64| FrameView {
        camera: ViewCamera::Camera { camera: good, near, far },
        area: WHOLE,
    };
    let flat = Camera { projection: Projection::Orthographic, ortho_height: None, ..good };
    let views = [
        of_matrices([0.0; 16], matrices.projection),
        of_matrices(matrices.view, [0.0; 16]),
        of_matrices([f64::NAN; 16], [f64::INFINITY; 16]),
        of_matrices([1e300; 16], matrices.projection),
        view_of(Camera { eye: good.target, ..good }),
        view_of(Camera { eye: DVec3::NAN, ..good }),
        view_of(Camera { fov_y: 180.0, ..good }),
        view_of(Camera { fov_y: -1.0, ..good }),
        view_of(flat),
        depths(0.0, 1.0),
        depths(5.0, 1.0),
        depths(f64::NAN, f64::NAN),
    ];
    for view in views {
        let (report, ..) = application.draw(&mut renderer, targets, &[view], None);
        assert!(!report.errors.is_empty(), "{view:?} is drawn");
    }
    // Of more pixels than the device has images for.
    let size = [1_000_000, 1_000_000];
    let huge = Targets::of(Target { size, ..targets.color });
    let views = [FrameView { area: Area { corner: [0, 0], size }, ..view_of(good) }];
    application.frame += 1;
    let number = application.frame;
    let frame = Frame { number, safe: number - 1, targets: huge, views: &views };
    let (raw, commands) = (&application.device.raw, application.commands);
    // SAFETY: what is recorded is not submitted.
    let outcome = unsafe {
        raw.begin_command_buffer(commands, &Default::default()).unwrap();
        let outcome = renderer.record(commands.as_raw(), &frame);
        raw.end_command_buffer(commands).unwrap();
        outcome
    };
    let why = outcome.map_or_else(|error| error.to_string(), |report| report.errors.join(" "));
    assert!(why.contains("1000000"), "{why}");
    drop(application.device.take_validation_errors());
    let (_, after, _) = application.settle(&mut renderer, targets, &[view_of(good)]);
    assert!(after == expected, "wrong calls change the picture");
}
