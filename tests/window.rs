//! The window, as people have it: real keys and a real mouse, and pictures of what is on it, which are those that `render` draws.
//!
//! Nothing is taken for done because some time has passed: a test waits for the picture, the file or the line that says so.

mod display;
mod support;

use display::drop::drop_file;
use display::{Display, SIZE, Viewer};
use glam::DVec3;
use pointillist::cloud::attribute::Attribute;
use pointillist::cloud::{self, ReadOptions, Wanted};
use pointillist::passes::resolve::code_color;
use pointillist::progress::Silent;
use pointillist::synth::Scene;
use pointillist::view::{Camera, View};
use std::path::{Path, PathBuf};
use std::time::Duration;
use support::{names, pointillist, read_exr, read_png, render, scan, succeeded};

/// What `render` draws, of the window's size where the line does not say another.
fn picture(folder: &Path, cloud: &[&Path], name: &str, line: &str) -> PathBuf {
    let path = folder.join(name);
    let mut command = pointillist();
    let size = format!("--size {}x{} ", SIZE[0], SIZE[1]);
    let line = if line.contains("--size") { line.to_string() } else { size + line };
    command.arg("render").args(cloud).arg("-o").arg(&path).args(line.split_whitespace());
    succeeded(&command.output().unwrap());
    path
}

/// What hands have made of the scene, as a file, the picture that `render` draws of it, and waits until the window shows that.
#[track_caller]
fn shows_its_scene(viewer: &mut Viewer, folder: &Path, cloud: &[&Path], number: usize, line: &str) -> serde_json::Value {
    viewer.key("F8");
    let scene = folder.join(format!("pointillist-{number}.json"));
    viewer.until("saved scene", |_| scene.exists());
    let line = format!("--scene {} {line}", scene.display());
    viewer.shows(&picture(folder, cloud, &format!("scene-{number}.png"), &line));
    serde_json::from_str(&std::fs::read_to_string(&scene).unwrap()).unwrap()
}

#[test]
fn the_window_shows_what_render_draws_through_keys_drags_and_sizes_and_rests() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let cloud = folder.join("scan.las");
    scan(&cloud, Scene::Street, 60_000);
    let display = Display::open();
    let mut viewer = Viewer::open(&display, folder, &[&cloud], "");
    let fit = picture(folder, &[&cloud], "fit.png", "");
    viewer.shows(&fit);

    // Nobody touches anything: nothing is drawn, and nothing else done.
    std::thread::sleep(Duration::from_secs(1));
    let before = viewer.ticks();
    std::thread::sleep(Duration::from_secs(2));
    assert!(viewer.ticks() - before <= 2, "{} hundredths of a second of work within two seconds of rest", viewer.ticks() - before);

    for (key, view) in [("7", "top"), ("1", "front"), ("3", "side"), ("0", "fit")] {
        viewer.key(key);
        viewer.shows(&picture(folder, &[&cloud], &format!("{view}.png"), &format!("--view {view}")));
    }

    let mut last = serde_json::Value::Null;
    let gestures = [
        "mousemove 200 150 mousedown 1 mousemove 220 160 mousemove 260 170 mouseup 1",
        "mousedown 3 mousemove 230 150 mousemove 200 140 mouseup 3",
        "click 4 click 4 click 4",
        "key o",
        "keydown w sleep 0.3 keyup w",
    ];
    for (number, gesture) in gestures.into_iter().enumerate() {
        display.xdotool(gesture);
        let scene = shows_its_scene(&mut viewer, folder, &[&cloud], number + 1, "");
        assert_ne!(scene["camera"], last["camera"], "{gesture}");
        last = scene;
    }
    display.xdotool("key p key 0");
    viewer.shows(&fit);

    // The picture in the file is the one in the window.
    viewer.key("F9");
    let saved = folder.join("pointillist-1.png");
    viewer.until("saved picture", |_| saved.exists());
    assert_eq!(read_png(&saved).pixels, read_png(&fit).pixels);

    display.xdotool(&format!("windowsize {} 300 200", viewer.window));
    viewer.until("smaller window", |viewer| viewer.photograph().size == [300, 200]);
    shows_its_scene(&mut viewer, folder, &[&cloud], gestures.len() + 1, "--size 300x200");

    let said = viewer.close();
    assert!(said.contains("first picture after"), "{said}");
}

/// Of a light that is new a moving picture casts one sample; at rest the others follow, the picture becomes that of `render`, and then nothing is done any more.
#[test]
fn samples_of_the_light_follow_when_the_window_rests() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let cloud = folder.join("scan.las");
    scan(&cloud, Scene::Street, 60_000);
    let display = Display::open();
    let line = "--light direction:0.3,0.8,-0.8 --effect shadows=on,samples=24,radius=3";
    let mut viewer = Viewer::open(&display, folder, &[&cloud], line);
    for (key, view) in [("7", "top"), ("0", "fit")] {
        viewer.key(key);
        viewer.shows(&picture(folder, &[&cloud], &format!("{view}.png"), &format!("{line} --view {view}")));
    }
    std::thread::sleep(Duration::from_secs(1));
    let before = viewer.ticks();
    std::thread::sleep(Duration::from_secs(2));
    assert!(viewer.ticks() - before <= 2, "{} hundredths of a second of work within two seconds of rest", viewer.ticks() - before);
}

#[test]
fn a_scene_and_an_index_are_shown_as_render_draws_them() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (cloud, index, scene) = (folder.join("scan.las"), folder.join("scan.pnti"), folder.join("scene.json"));
    scan(&cloud, Scene::Street, 300_000);
    succeeded(&pointillist().arg("index").arg(&cloud).arg("-o").arg(&index).output().unwrap());
    let words = r#"{"camera": {"eye": [500020, 4999960, 130], "target": [500000, 5000020, 105]}, "color": "elevation",
        "effects": ["edl=on,strength=0.7", "shape=off"], "light": "direction:1,1,-2", "background": "ffffff"}"#;
    std::fs::write(&scene, words).unwrap();
    let display = Display::open();
    let line = format!("--scene {}", scene.display());
    let mut viewer = Viewer::open(&display, folder, &[&index], &line);
    viewer.shows(&picture(folder, &[&index], "scene.png", &line));
    viewer.close();
}

#[test]
fn what_cannot_be_opened_is_said_in_the_window_which_stays() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let bad = folder.join("bad.las");
    std::fs::write(&bad, b"LASF, or so it says").unwrap();
    let display = Display::open();
    let mut viewer = Viewer::open(&display, folder, &[&bad], "");
    // A photograph taken before the panel is hidden would show it, and the panel that comes back would be no change.
    let background = pointillist::config::BACKGROUND;
    viewer.until("bare window", |viewer| viewer.photograph().pixels.iter().all(|pixel| *pixel == background));
    viewer.key("n");
    viewer.until("panel", |viewer| viewer.photograph().pixels.iter().any(|pixel| *pixel != background));
    let said = viewer.close();
    assert!(said.contains("bad.las"), "{said}");
}

#[test]
fn render_and_a_window_take_the_same_scene() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = folder.path().join("scan.las");
    scan(&cloud, Scene::Torus, 5000);
    let bad = folder.path().join("scene.json");
    std::fs::write(&bad, "{}").unwrap();
    let said = support::failed(&render(&cloud, &format!("-o {} --scene {}", folder.path().join("o.png").display(), bad.display())), 1);
    assert!(said.contains("scene.json") && said.contains("camera"), "{said}");
}

#[test]
fn one_ctrl_c_closes_the_window_and_leaves_nothing_half_written() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (small, large, cache) = (folder.join("small.las"), folder.join("large.las"), folder.join("cache"));
    scan(&small, Scene::Street, 20_000);
    let display = Display::open();
    let mut viewer = Viewer::open(&display, folder, &[&small], "");
    viewer.shows(&picture(folder, &[&small], "fit.png", ""));
    viewer.signal("INT");
    let said = support::failed(&viewer.ended(), 130);
    assert!(said.contains("interrupted") && !said.contains("Validation"), "{said}");

    // While an index is being made there is a file beside its place.
    scan(&large, Scene::Street, 3_000_000);
    let line = format!("--budget 100000 --cache-dir {}", cache.display());
    let mut viewer = Viewer::with_panel(&display, folder, &[&large], SIZE, &line);
    viewer.until("half an index", |_| cache.exists() && !names(&cache).is_empty());
    viewer.signal("INT");
    let said = support::failed(&viewer.ended(), 130);
    assert!(said.contains("interrupted"), "{said}");
    let left: Vec<_> = names(&cache).into_iter().filter(|name| !name.ends_with(".pnti")).collect();
    assert!(left.is_empty(), "{left:?} is left");
}

/// Positions of all points of a file.
fn points(file: &Path) -> Vec<DVec3> {
    let cloud = cloud::read(&[file.to_owned()], &ReadOptions { wanted: Wanted::default(), strict: true }, &Silent).unwrap();
    let place = |part: &cloud::Part, i: usize| {
        let steps = DVec3::new(part.columns.x[i] as f64, part.columns.y[i] as f64, part.columns.z[i] as f64);
        part.lattice.offset + part.lattice.step * steps
    };
    cloud.parts.iter().flat_map(|part| (0..part.columns.x.len()).map(move |i| place(part, i))).collect()
}

#[test]
fn picked_points_are_those_of_the_file_that_are_seen_there_and_are_measured() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (cloud, layers) = (folder.join("scan.las"), folder.join("layers.exr"));
    scan(&cloud, Scene::Street, 60_000);
    let camera = Camera {
        eye: DVec3::new(500_020.0, 4_999_960.0, 130.0),
        target: DVec3::new(500_000.0, 5_000_020.0, 105.0),
        ..serde_json::from_str("{\"eye\": [0,0,1], \"target\": [0,0,0]}").unwrap()
    };
    std::fs::write(folder.join("cam.json"), serde_json::to_string(&camera).unwrap()).unwrap();
    let line = format!("--camera {}", folder.join("cam.json").display());
    let drawn = picture(folder, &[&cloud], "picture.png", &format!("{line} --exr {}", layers.display()));
    let (view, depth) = (View::new(camera, SIZE).unwrap(), read_exr(&layers).floats("depth.Z"));
    let display = Display::open();
    let mut viewer = Viewer::open(&display, folder, &[&cloud], &line);
    viewer.shows(&drawn);
    // Two places where a surface is, all around.
    let solid = |x: usize, y: usize| (y - 9..=y + 9).all(|y| (x - 9..=x + 9).all(|x| depth[y * SIZE[0] as usize + x].is_finite()));
    let places: Vec<[usize; 2]> =
        (20..280).step_by(7).flat_map(|y| (20..380).step_by(11).map(move |x| [x, y])).filter(|[x, y]| solid(*x, *y)).collect();
    let clicked = [places[places.len() / 4], places[3 * places.len() / 4]];
    let all = points(&cloud);
    let mut picked = Vec::new();
    for (number, [x, y]) in clicked.into_iter().enumerate() {
        let gesture =
            if number == 0 { format!("mousemove {x} {y} click 1") } else { format!("mousemove {x} {y} keydown shift click 1 keyup shift") };
        display.xdotool(&gesture);
        let start = format!("point {}: ", number + 1);
        let find = |viewer: &Viewer| viewer.printed().into_iter().find(|line| line.starts_with(&start));
        viewer.until("picked point", |viewer| find(viewer).is_some());
        let line = find(&viewer).unwrap();
        let numbers: Vec<f64> = line[start.len()..].split_whitespace().take(3).map(|number| number.parse().unwrap()).collect();
        let point = DVec3::from_slice(&numbers);
        assert!(all.contains(&point), "{line} is no point of the file");
        assert!(line.contains(" class ") && line.contains(" return ") && line.contains(" station "), "{line}");
        let [px, py] = view.pixel(point).unwrap();
        assert!((px - x as f64).hypot(py - y as f64) < 10.0, "{line} is seen at {px} {py}, not at {x} {y}");
        // What is seen there, not what is behind it.
        let seen = depth[py as usize * SIZE[0] as usize + px as usize] as f64;
        let deep = (point - camera.eye).dot(view.basis.forward);
        assert!((deep - seen).abs() < 0.02 * seen, "{line} is {deep} m deep, and the surface {seen}");
        picked.push(point);
    }
    let measured = format!("distance {:.4} m", picked[0].distance(picked[1]));
    viewer.until("distance", |viewer| viewer.printed().iter().any(|line| line.starts_with(&measured)));
    viewer.key("c");
    viewer.key("g");
    let (table, json) = (folder.join("pointillist-1.csv"), folder.join("pointillist-1.geojson"));
    viewer.until("saved points", |_| table.exists() && json.exists());
    let rows: Vec<DVec3> = std::fs::read_to_string(&table)
        .unwrap()
        .lines()
        .skip(1)
        .map(|line| {
            let numbers: Vec<f64> = line.split(',').map(|number| number.parse().unwrap()).collect();
            DVec3::from_slice(&numbers)
        })
        .collect();
    assert_eq!(rows, picked);
    let json: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    assert_eq!(json["features"][0]["properties"]["distance_m"].as_f64().unwrap(), picked[0].distance(picked[1]));
    viewer.close();
}

#[test]
fn a_file_dropped_on_the_window_is_drawn_with_the_one_that_is_open() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let [first, second] = ["a street.las", "torus.las"].map(|name| folder.join(name));
    scan(&first, Scene::Street, 30_000);
    scan(&second, Scene::Torus, 10_000);
    let view = "--view top";
    let display = Display::open();
    let mut viewer = Viewer::open(&display, folder, &[&second], view);
    viewer.shows(&picture(folder, &[&second], "one.png", view));
    drop_file(&display, &viewer.window, &first);
    // The camera stays where it was; then it frames both.
    let both = picture(folder, &[&second, &first], "both.png", view);
    viewer.until("both", |viewer| {
        viewer.key("7");
        std::thread::sleep(Duration::from_millis(500));
        viewer.photograph().pixels == read_png(&both).pixels
    });
    viewer.close();
}

/// Pixels of the panel, which is on the left, of a colour that only what is looked for has there: the middle of the lowest group, or of the highest.
fn find(viewer: &Viewer, color: [u8; 3]) -> Option<[usize; 2]> {
    let seen = viewer.photograph();
    let near = |pixel: &[u8; 3]| pixel.iter().zip(color).all(|(&a, b)| a.abs_diff(b) <= 3);
    let places: Vec<[usize; 2]> = (0..seen.pixels.len())
        .map(|at| [at % seen.size[0] as usize, at / seen.size[0] as usize])
        .filter(|[x, y]| *x < PANEL && near(&seen.pixels[y * seen.size[0] as usize + x]))
        .collect();
    let top = places.iter().map(|[_, y]| *y).min()?;
    // A row of the panel is no higher.
    let row: Vec<_> = places.into_iter().filter(|[_, y]| *y < top + 12).collect();
    let middle = |axis: usize| row.iter().map(|place| place[axis]).sum::<usize>() / row.len();
    Some([middle(0), middle(1)])
}

/// As wide as the panel is at least, pixels.
const PANEL: usize = 240;

#[test]
fn an_effect_that_is_switched_off_in_the_panel_is_gone_from_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (cloud, scene) = (folder.join("scan.las"), folder.join("scene.json"));
    scan(&cloud, Scene::Street, 60_000);
    let line = "--size 640x900 --style points --effect edl=on";
    let display = Display::open();
    let mut viewer = Viewer::with_panel(&display, folder, &[&cloud], [640, 900], "--style points --effect edl=on");
    let on = picture(folder, &[&cloud], "on.png", line);
    viewer.key("n");
    viewer.shows(&on);
    viewer.key("n");
    // Effects that run are named in green, and one runs; its switch begins with `off`, at the left.
    let green = [0x90, 0xEE, 0x90];
    viewer.until("effect that runs", |viewer| find(viewer, green).is_some());
    let [_, row] = find(&viewer, green).unwrap();
    display.xdotool(&format!("mousemove 28 {row} click 1"));
    viewer.until("effect that stops", |viewer| find(viewer, green).is_none());
    display.xdotool("mousemove 600 800 key n");
    viewer.shows(&picture(folder, &[&cloud], "off.png", "--size 640x900 --style points --effect edl=off"));
    viewer.key("F8");
    let saved = folder.join("pointillist-1.json");
    viewer.until("saved scene", |_| saved.exists());
    std::fs::rename(&saved, &scene).unwrap();
    assert!(std::fs::read_to_string(&scene).unwrap().contains("edl=off"));
    viewer.close();
}

#[test]
fn a_class_that_is_unticked_is_not_drawn_and_one_that_is_ticked_again_is() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let cloud = folder.join("scan.las");
    scan(&cloud, Scene::Street, 60_000);
    // Buildings, and what else there is.
    const CLASS: u8 = 6;
    let size = "--size 640x700 --color class";
    let display = Display::open();
    let mut viewer = Viewer::with_panel(&display, folder, &[&cloud], [640, 700], "--color class --effect shape=off --effect edl=off");
    let [all, without] = [("all.png", ""), ("without.png", "--opacity class:6=0")]
        .map(|(name, rule)| picture(folder, &[&cloud], name, &format!("{size} --effect shape=off --effect edl=off {rule}")));
    // The legend shows each class's colour beside its box.
    viewer.until("legend", |viewer| find(viewer, code_color(Attribute::Class, CLASS)).is_some());
    for wanted in [without, all] {
        let [x, y] = find(&viewer, code_color(Attribute::Class, CLASS)).expect("the legend stays");
        display.xdotool(&format!("mousemove {} {y} click 1 mousemove 600 650 key n", x + 20));
        viewer.shows(&wanted);
        viewer.key("n");
        viewer.until("legend", |viewer| find(viewer, code_color(Attribute::Class, CLASS)).is_some());
    }
    viewer.close();
}

#[test]
fn a_camera_path_made_in_the_window_is_played_there_and_drawn_by_render() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let cloud = folder.join("scan.las");
    scan(&cloud, Scene::Street, 60_000);
    let display = Display::open();
    let mut viewer = Viewer::open(&display, folder, &[&cloud], "");
    let [fit, top] = [("fit.png", ""), ("top.png", "--view top")].map(|(name, line)| picture(folder, &[&cloud], name, line));
    viewer.shows(&fit);
    display.xdotool("key k click 4 click 4 key k F7");
    let path = folder.join("pointillist-1.path.json");
    viewer.until("saved path", |_| path.exists());
    // Played from anywhere it ends at its last view.
    viewer.key("7");
    viewer.shows(&top);
    viewer.key("space");
    let line = format!("-o {} --size {}x{} --path {}", folder.join("tour.png").display(), SIZE[0], SIZE[1], path.display());
    let text = std::fs::read_to_string(&path).unwrap().replace("25.0", "1.0");
    std::fs::write(&path, text).unwrap();
    succeeded(&render(&cloud, &line));
    let frames: Vec<_> = names(folder).into_iter().filter(|name| name.starts_with("tour-")).collect();
    assert_eq!(frames, ["tour-0001.png", "tour-0002.png", "tour-0003.png"]);
    assert_eq!(read_png(&folder.join("tour-0001.png")).pixels, read_png(&fit).pixels);
    viewer.shows(&folder.join("tour-0003.png"));
    viewer.close();
    // What is there is drawn again, or kept, which is said.
    std::fs::write(folder.join("tour-0002.png"), "no picture").unwrap();
    std::fs::remove_file(folder.join("tour-0003.png")).unwrap();
    let said = succeeded(&render(&cloud, &format!("{line} --resume")));
    assert!(said.contains("2 of 3 frames"), "{said}");
    assert_eq!(std::fs::read(folder.join("tour-0002.png")).unwrap(), b"no picture");
    assert!(folder.join("tour-0003.png").exists());
    assert!(!succeeded(&render(&cloud, &line)).contains("kept"));
    read_png(&folder.join("tour-0002.png"));
}
