//! The window with real keys and a real mouse: its pictures are those that `render` draws.
//!
//! Tests never wait a fixed time, but for a picture, a file or a line of output.

use crate::display::drop::drop_file;
use crate::display::place::Place;
use crate::display::{SIZE, Viewer};
use crate::exr_file::read_exr;
use crate::files::{names, scan};
use crate::png_file::{Png, read_png};
use crate::program::{failed, pointillist, render, succeeded, text};
use glam::DVec3;
use pointillist::app::viewport::Viewport;
use pointillist::cloud::attribute::Attribute;
use pointillist::cloud::colormap::code_color;
use pointillist::cloud::digits::Digits;
use pointillist::cloud::{self, ColumnSet, ReadOptions};
use pointillist::passes::EFFECTS;
use pointillist::progress::Silent;
use pointillist::select::slab::Slab;
use pointillist::synth::SceneKind;
use pointillist::view::{Camera, View};
use std::collections::HashSet;
use std::path::Path;
use std::time::Duration;

#[test]
fn window_matches_render_after_input_and_resizes_and_then_rests() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let mut viewer = place.view(&[&cloud], "");
    let fit = place.picture(&[&cloud], "fit.png", "");
    viewer.shows(&fit);
    viewer.rests();

    for (key, view) in [("7", "top"), ("1", "front"), ("3", "side"), ("0", "fit")] {
        viewer.key(key);
        viewer.shows(&place.picture(&[&cloud], &format!("{view}.png"), &format!("--view {view}")));
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
        place.display.xdotool(gesture);
        let scene = place.shows_its_scene(&mut viewer, &[&cloud], number + 1, "");
        assert_ne!(scene["camera"], last["camera"], "{gesture}");
        last = scene;
    }
    place.display.xdotool("key p key 0");
    viewer.shows(&fit);

    // The picture in the file is the one in the window.
    let saved = place.saved(&mut viewer, "F9", "pointillist-1.png");
    assert_eq!(read_png(&saved).pixels, read_png(&fit).pixels);

    place.display.xdotool(&format!("windowsize {} 300 200", viewer.window));
    viewer.until("smaller window", |viewer| viewer.photograph().size == [300, 200]);
    place.shows_its_scene(&mut viewer, &[&cloud], gestures.len() + 1, "--size 300x200");

    let said = viewer.close();
    assert!(said.contains("first frame after"), "{said}");
}

#[test]
fn views_chosen_before_loading_apply_to_the_loaded_cloud() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let mut viewer = place.view(&[], "");
    viewer.key("7");
    drop_file(&place.display, &viewer.window, &cloud);
    viewer.shows(&place.picture(&[&cloud], "top.png", "--view top"));
    viewer.close();

    let mut viewer = place.view(&[], "");
    place.display.xdotool("key 3 key 5");
    drop_file(&place.display, &viewer.window, &cloud);
    viewer.until("cloud", |viewer| {
        let seen = viewer.photograph();
        seen.pixels.iter().any(|pixel| *pixel != seen.pixels[0])
    });
    let scene = place.shows_its_scene(&mut viewer, &[&cloud], 1, "");
    assert_eq!(scene["camera"]["projection"], "perspective");
    viewer.key("5");
    viewer.shows(&place.picture(&[&cloud], "side.png", "--view side"));
    viewer.close();
}

/// The preview is framed by itself, the whole cloud as `render` frames it.
#[test]
fn slow_file_ends_as_the_picture_of_render() {
    let place = Place::new();
    let cloud = place.scan("scan.laz", SceneKind::Street, 2_100_000);
    let fit = place.picture(&[&cloud], "fit.png", "");
    let mut viewer = place.view(&[&cloud], "");
    viewer.shows(&fit);
    viewer.rests();
    viewer.close();
}

/// A moving picture casts one sample of a new light. At rest the others follow until the picture is
/// that of `render`; then the window is idle.
#[test]
fn light_samples_accumulate_at_rest() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let line = "--light direction:0.3,0.8,-0.8 --effect shadows=on,samples=24,radius=3";
    let mut viewer = place.view(&[&cloud], line);
    for (key, view) in [("7", "top"), ("0", "fit")] {
        viewer.key(key);
        viewer.shows(&place.picture(
            &[&cloud],
            &format!("{view}.png"),
            &format!("{line} --view {view}"),
        ));
    }
    viewer.rests();
}

/// In a moving picture the nearest strokes hide the others. At rest all are blended, more of them
/// in order with every frame, until the picture is that of `render`; then the window is idle.
#[test]
fn strokes_are_sorted_at_rest() {
    let place = Place::new();
    let cloud = place.street(30_000);
    let line = "--style strokes";
    let mut viewer = place.view(&[&cloud], line);
    for (key, view) in [("7", "top"), ("0", "fit")] {
        viewer.key(key);
        viewer.shows(&place.picture(
            &[&cloud],
            &format!("{view}.png"),
            &format!("{line} --view {view}"),
        ));
    }
    viewer.rests();
}

#[test]
fn a_scene_and_an_index_are_shown_as_render_draws_them() {
    let place = Place::new();
    let (cloud, index, scene) =
        (place.street(300_000), place.at("scan.pnti"), place.at("scene.json"));
    succeeded(&pointillist().arg("index").arg(&cloud).arg("-o").arg(&index).output().unwrap());
    let words = r#"{"camera": {"eye": [500020, 4999960, 130], "target": [500000, 5000020, 105]}, "color": "elevation",
        "effects": ["edl=on,strength=0.7", "shape=off"], "light": "direction:1,1,-2", "background": "ffffff"}"#;
    std::fs::write(&scene, words).unwrap();
    let line = format!("--scene {}", scene.display());
    let mut viewer = place.view(&[&index], &line);
    viewer.shows(&place.picture(&[&index], "scene.png", &line));
    viewer.close();
}

#[test]
fn unreadable_file_is_reported_and_the_window_stays() {
    let place = Place::new();
    let bad = place.at("bad.las");
    std::fs::write(&bad, b"LASF, or so it says").unwrap();
    let mut viewer = place.view(&[&bad], "");
    put_away(&mut viewer);
    let said = viewer.close();
    assert!(said.contains("bad.las"), "{said}");
}

/// Returns whether the window shows an error, in red.
fn is_in_trouble(viewer: &mut Viewer) -> bool {
    viewer.photograph().pixels.contains(&[255, 128, 128])
}

fn put_away(viewer: &mut Viewer) {
    viewer.until("trouble", is_in_trouble);
    viewer.key("Escape");
    viewer.until("peace", |viewer| !is_in_trouble(viewer));
}

/// The other files are shown, in any order; each error is reported once.
#[test]
fn unreadable_file_does_not_block_other_files() {
    let place = Place::new();
    let (cloud, bad, worse) = (
        place.scan("torus.las", SceneKind::Torus, 60_000),
        place.at("bad.las"),
        place.at("worse.ply"),
    );
    [&bad, &worse].iter().for_each(|path| std::fs::write(path, b"LASF, or so it says").unwrap());
    let mut viewer = place.view(&[&bad, &cloud, &worse], "--view top");
    viewer.until("both said", |viewer| {
        ["bad.las", "worse.ply"]
            .iter()
            .all(|name| viewer.said().iter().any(|line| line.contains(name)))
    });
    put_away(&mut viewer);
    viewer.shows(&place.picture(&[&cloud], "torus.png", "--view top"));
    let said = viewer.close();
    assert!(["bad.las", "worse.ply"].iter().all(|name| said.matches(name).count() == 1), "{said}");
}

#[test]
fn dropped_unreadable_file_leaves_the_picture() {
    let place = Place::new();
    let (torus, street) = (place.scan("torus.las", SceneKind::Torus, 10_000), place.street(30_000));
    let bad = place.at("bad.las");
    std::fs::write(&bad, b"LASF, or so it says").unwrap();
    let view = "--view top";
    let mut viewer = place.view(&[&torus], view);
    let one = place.picture(&[&torus], "one.png", view);
    viewer.shows(&one);
    drop_file(&place.display, &viewer.window, &bad);
    viewer.until("trouble", is_in_trouble);
    drop_file(&place.display, &viewer.window, &torus);
    viewer.until("said twice", |viewer| {
        viewer.said().iter().any(|line| line.contains("torus.las is open already"))
    });
    drop_file(&place.display, &viewer.window, &street);
    let both = place.picture(&[&torus, &street], "both.png", view);
    viewer.until("both", |viewer| {
        viewer.key("7");
        std::thread::sleep(Duration::from_millis(500));
        viewer.photograph().pixels == read_png(&both).pixels
    });
    viewer.close();
}

/// Drops scenes one after the other.
#[test]
fn every_effect_is_switched_on_as_render_does() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let camera = r#""camera": {"eye": [500020, 4999960, 130], "target": [500000, 5000020, 105], "up": [0, 0, 1], "fov_y": 45}"#;
    let mut viewer = place.view(&[&cloud], "");
    for on in EFFECTS {
        let effects: Vec<String> = EFFECTS
            .iter()
            .map(|effect| format!("\"{effect}={}\"", if effect == on { "on" } else { "off" }))
            .collect();
        let scene = place.at(&format!("{on}.json"));
        std::fs::write(
            &scene,
            format!(
                "{{{camera}, \"opacity\": [\"class:6=0.5\"], \"effects\": [{}]}}",
                effects.join(", ")
            ),
        )
        .unwrap();
        drop_file(&place.display, &viewer.window, &scene);
        viewer.shows(&place.picture(
            &[&cloud],
            &format!("{on}.png"),
            &format!("--scene {}", scene.display()),
        ));
    }
    viewer.close();
}

#[test]
fn render_and_a_window_take_the_same_scene() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = folder.path().join("scan.las");
    scan(&cloud, SceneKind::Torus, 5000);
    let bad = folder.path().join("scene.json");
    std::fs::write(&bad, "{}").unwrap();
    let said = failed(
        &render(
            &cloud,
            &format!("-o {} --scene {}", folder.path().join("o.png").display(), bad.display()),
        ),
        1,
    );
    assert!(said.contains("scene.json") && said.contains("camera"), "{said}");
}

#[test]
fn ctrl_c_closes_the_window_without_partial_files() {
    let place = Place::new();
    let (small, cache) = (place.street(20_000), place.at("cache"));
    let mut viewer = place.view(&[&small], "");
    viewer.shows(&place.picture(&[&small], "fit.png", ""));
    viewer.signal("INT");
    let said = failed(&viewer.ended(), 130);
    assert!(said.contains("interrupted") && !said.contains("Validation"), "{said}");

    // While an index is being made there is a file beside its place.
    let large = place.scan("large.las", SceneKind::Street, 3_000_000);
    let line = format!("--point-budget 100000 --cache-dir {}", cache.display());
    let mut viewer = place.view_with_panel(&[&large], SIZE, &line);
    viewer.until("half an index", |_| cache.exists() && !names(&cache).is_empty());
    viewer.signal("INT");
    let said = failed(&viewer.ended(), 130);
    assert!(said.contains("interrupted"), "{said}");
    let left: Vec<_> = names(&cache).into_iter().filter(|name| !name.ends_with(".pnti")).collect();
    assert!(left.is_empty(), "{left:?} is left");
}

/// Reads all that a file holds.
fn read(file: &Path) -> cloud::Part {
    cloud::read(&[file.to_owned()], &ReadOptions::new(ColumnSet::ALL, true), &Silent)
        .unwrap()
        .parts
        .remove(0)
}

/// Returns the position of a file's point, with the digits of its lattice, as printed and exported.
fn position(part: &cloud::Part, i: usize) -> DVec3 {
    let place = part
        .lattice
        .world([part.columns.x[i], part.columns.y[i], part.columns.z[i]].map(i64::from));
    Digits::of([part.lattice]).round(place)
}

#[test]
fn picks_and_measures_are_of_the_visible_points_of_the_file() {
    let place = Place::new();
    let (cloud, layers) = (place.street(60_000), place.at("layers.exr"));
    let camera = Camera {
        eye: DVec3::new(500_020.0, 4_999_960.0, 130.0),
        target: DVec3::new(500_000.0, 5_000_020.0, 105.0),
        ..serde_json::from_str("{\"eye\": [0,0,1], \"target\": [0,0,0]}").unwrap()
    };
    std::fs::write(place.at("cam.json"), serde_json::to_string(&camera).unwrap()).unwrap();
    let line = format!("--camera {}", place.at("cam.json").display());
    let drawn =
        place.picture(&[&cloud], "picture.png", &format!("{line} --exr {}", layers.display()));
    let layers = read_exr(&layers);
    assert_eq!(layers.size, SIZE.map(|side| side as usize));
    let (view, depth) = (View::new(camera, SIZE).unwrap(), layers.floats("depth.Z"));
    let mut viewer = place.view(&[&cloud], &line);
    viewer.shows(&drawn);
    // Two places where a surface is, all around.
    let solid = |x: usize, y: usize| {
        (y - 9..=y + 9)
            .all(|y| (x - 9..=x + 9).all(|x| depth[y * SIZE[0] as usize + x].is_finite()))
    };
    let places: Vec<[usize; 2]> = (20..280)
        .step_by(7)
        .flat_map(|y| (20..380).step_by(11).map(move |x| [x, y]))
        .filter(|[x, y]| solid(*x, *y))
        .collect();
    let clicked = [places[places.len() / 4], places[3 * places.len() / 4]];
    let part = read(&cloud);
    let all: Vec<DVec3> = (0..part.columns.len()).map(|i| position(&part, i)).collect();
    let mut picked = Vec::new();
    for (number, [x, y]) in clicked.into_iter().enumerate() {
        let gesture = if number == 0 {
            format!("mousemove {x} {y} click 1")
        } else {
            format!("mousemove {x} {y} keydown shift click 1 keyup shift")
        };
        place.display.xdotool(&gesture);
        let start = format!("point {}: ", number + 1);
        let find =
            |viewer: &Viewer| viewer.printed().into_iter().find(|line| line.starts_with(&start));
        viewer.until("picked point", |viewer| find(viewer).is_some());
        let line = find(&viewer).unwrap();
        let numbers: Vec<f64> = line[start.len()..]
            .split_whitespace()
            .take(3)
            .map(|number| number.parse().unwrap())
            .collect();
        let point = DVec3::from_slice(&numbers);
        assert!(all.contains(&point), "{line} is no point of the file");
        assert!(
            line.contains(" class ") && line.contains(" return ") && line.contains(" station "),
            "{line}"
        );
        let [px, py] = view.pixel(point).unwrap();
        assert!(
            (px - x as f64).hypot(py - y as f64) < 10.0,
            "{line} is seen at {px} {py}, not at {x} {y}"
        );
        // The visible point, not one behind it. A round point may show beside a surface that covers
        // its middle.
        let seen = [[px as usize, py as usize], [x, y]]
            .map(|[x, y]| depth[y * SIZE[0] as usize + x] as f64);
        let deep = (point - camera.eye).dot(view.basis.forward);
        assert!(
            seen.iter().any(|seen| (deep - seen).abs() < 0.02 * seen),
            "{line} is {deep} m deep at {px} {py}, and the surface {seen:?}; clicked at {x} {y}"
        );
        picked.push(point);
    }
    let measured = format!("distance {:.4} m", picked[0].distance(picked[1]));
    viewer.until("distance", |viewer| {
        viewer.printed().iter().any(|line| line.starts_with(&measured))
    });
    for number in [1, 2] {
        let start = format!("record {number}: ");
        viewer
            .until("record", |viewer| viewer.printed().iter().any(|line| line.starts_with(&start)));
    }
    let table = place.saved(&mut viewer, "c", "pointillist-1.csv");
    let json = place.saved(&mut viewer, "g", "pointillist-1.geojson");
    let table = std::fs::read_to_string(&table).unwrap();
    let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(
        rows[0].join(" "),
        "x y z class return station returns source intensity red green blue gps_time point file near_infrared scan_angle user_data flags extra_bytes unit x_m y_m z_m"
    );
    for (row, picked) in rows[1..].iter().zip(&picked) {
        let numbers: Vec<f64> =
            row[..14].iter().map(|number| number.parse().unwrap_or(f64::NAN)).collect();
        assert_eq!(DVec3::from_slice(&numbers), *picked);
        // The record is the one that stands there in the file.
        let (i, columns) = (numbers[13] as usize, &part.columns);
        assert_eq!(position(&part, i), *picked);
        let whole = |column: &Option<Vec<u8>>| column.as_ref().unwrap()[i] as f64;
        assert_eq!(
            [numbers[3], numbers[4], numbers[6]],
            [
                whole(&columns.class),
                (columns.returns.as_ref().unwrap()[i] & 15) as f64,
                (columns.returns.as_ref().unwrap()[i] >> 4) as f64
            ]
        );
        assert_eq!(
            [numbers[7], numbers[8]],
            [columns.source.as_ref().unwrap()[i], columns.intensity.as_ref().unwrap()[i]]
                .map(f64::from)
        );
        // In the file's own 16 bits.
        assert_eq!(
            [0, 1, 2].map(|c| (numbers[9 + c] / 257.0).round()),
            columns.rgb.as_ref().unwrap()[i].map(f64::from)
        );
        assert_eq!((row[16], row[17]), ("0", "0"));
        let time = columns.gps_time.as_ref().map(|times| times[i]);
        assert!(time.is_none() || time == Some(numbers[12]), "{time:?} {row:?}");
        assert_eq!(row[14], "scan.las");
    }
    assert_eq!(rows.len(), 3);
    let json: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    let distance = json["features"][0]["properties"]["distance_m"].as_f64().unwrap();
    assert!((distance - picked[0].distance(picked[1])).abs() < 1e-8, "{distance}");
    viewer.close();
}

#[test]
fn dropped_file_is_drawn_with_the_open_one() {
    let place = Place::new();
    let first = place.scan("a street.las", SceneKind::Street, 30_000);
    let second = place.scan("torus.las", SceneKind::Torus, 10_000);
    let view = "--view top";
    let mut viewer = place.view(&[&second], view);
    viewer.shows(&place.picture(&[&second], "one.png", view));
    drop_file(&place.display, &viewer.window, &first);
    // The camera stays where it was; then it frames both.
    let both = place.picture(&[&second, &first], "both.png", view);
    viewer.until("both", |viewer| {
        viewer.key("7");
        std::thread::sleep(Duration::from_millis(500));
        viewer.photograph().pixels == read_png(&both).pixels
    });
    viewer.close();
}

/// Finds pixels of a colour in the panel, on the left: the middle of their lowest or highest group.
fn find(viewer: &Viewer, color: [u8; 3]) -> Option<[usize; 2]> {
    let seen = viewer.photograph();
    // Where the panel is not there yet, the picture may have the colour.
    if seen.pixels[2 * seen.size[0] as usize + 2] != FILL {
        return None;
    }
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

/// Finds pixels of a colour once the panel is complete.
fn find_at_rest(viewer: &mut Viewer, color: [u8; 3]) -> [usize; 2] {
    let mut last = None;
    viewer.until("panel at rest", |viewer| {
        std::thread::sleep(Duration::from_millis(400));
        let before = std::mem::replace(&mut last, find(viewer, color));
        last.is_some() && last == before
    });
    last.expect("it was found")
}

/// Width of the panel [px], its colour, and where its tabs and the fold of effects are.
const PANEL: usize = 276;
const FILL: [u8; 3] = [27; 3];
const LAYERS: [u32; 2] = [225, 82];
const EFFECTS_FOLD: [u32; 2] = [40, 266];

fn is_there(viewer: &Viewer) -> bool {
    let seen = viewer.photograph();
    seen.pixels[2 * seen.size[0] as usize + 2] == FILL
}

#[test]
fn panel_switches_an_effect_off() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let line = "--size 700x900 --style points --effect exposure=off --effect edl=on";
    let mut viewer = place.view_with_panel(
        &[&cloud],
        [700, 900],
        "--style points --effect exposure=off --effect edl=on",
    );
    let on = place.picture(&[&cloud], "on.png", line);
    viewer.key("n");
    viewer.shows(&on);
    viewer.key("n");
    // Effects that run are named in green, and one runs; `off` is in the middle of its row.
    let green = [0x90, 0xEE, 0x90];
    viewer.until("panel", |viewer| is_there(viewer));
    place.display.xdotool(&format!("mousemove {} {} click 1", EFFECTS_FOLD[0], EFFECTS_FOLD[1]));
    viewer.until("effect that runs", |viewer| find(viewer, green).is_some());
    let [_, row] = find_at_rest(&mut viewer, green);
    place.display.xdotool(&format!("mousemove 186 {row} click 1"));
    viewer.until("effect that stops", |viewer| find(viewer, green).is_none());
    // Clicks hold the view, so it is framed anew without the panel.
    place.display.xdotool("mousemove 600 800 key n key 0");
    viewer.shows(&place.picture(
        &[&cloud],
        "off.png",
        "--size 700x900 --style points --effect exposure=off --effect edl=off",
    ));
    let saved = place.saved(&mut viewer, "F8", "pointillist-1.json");
    assert!(std::fs::read_to_string(&saved).unwrap().contains("edl=off"));
    viewer.close();
}

/// An index lists what it counted when it was made.
#[test]
fn panel_hides_and_shows_a_class() {
    let place = Place::new();
    let file = place.street(60_000);
    let index = place.at("scan.pnti");
    succeeded(&pointillist().arg("index").arg(&file).arg("-o").arg(&index).output().unwrap());
    // Buildings, and what else there is.
    const CLASS: u8 = 6;
    let size = "--size 700x700 --color class";
    for cloud in [&file, &index] {
        let mut viewer = place.view_with_panel(
            &[cloud],
            [700, 700],
            "--color class --effect shape=off --effect edl=off",
        );
        let [all, without] =
            [("all.png", ""), ("without.png", "--opacity class:6=0")].map(|(name, rule)| {
                place.picture(
                    &[cloud],
                    name,
                    &format!("{size} --effect shape=off --effect edl=off {rule}"),
                )
            });
        // The tree shows each class's colour beside its eye.
        viewer.until("panel", |viewer| is_there(viewer));
        place.display.xdotool(&format!("mousemove {} {} click 1", LAYERS[0], LAYERS[1]));
        viewer
            .until("legend", |viewer| find(viewer, code_color(Attribute::Class, CLASS)).is_some());
        for wanted in [without, all] {
            let [x, y] = find_at_rest(&mut viewer, code_color(Attribute::Class, CLASS));
            place.display.xdotool(&format!(
                "mousemove {} {y} click 1 mousemove 600 650 key n key 0",
                x - 18
            ));
            viewer.shows(&wanted);
            viewer.key("n");
            viewer.until("legend", |viewer| {
                find(viewer, code_color(Attribute::Class, CLASS)).is_some()
            });
        }
        viewer.close();
    }
}

/// Returns the faces of a box in a scene's file.
fn faces(scene: &serde_json::Value) -> Vec<f64> {
    let words = scene["clip"][0].as_str().unwrap();
    words.split_once(':').unwrap().1.split(',').map(|number| number.parse().unwrap()).collect()
}

#[test]
fn a_clip_box_is_added_around_a_picked_point_and_its_face_dragged() {
    let place = Place::new();
    let cloud = place.street(60_000);
    // Wide enough for the box to be beside the panel.
    let (size, line) = ([720, 400], "--size 720x400");
    let mut viewer = place.view_with_panel(&[&cloud], size, "--view top");
    let pixel = |picture: &Png, x: i64, y: i64| picture.pixels[(y * size[0] as i64 + x) as usize];
    viewer.until("panel", |viewer| is_there(viewer));
    viewer.key("n");
    viewer.shows(&place.picture(&[&cloud], "top.png", &format!("{line} --view top")));
    pick(&place, &mut viewer, &[[348, 187]]);
    // The camera of a view that was moved stays as it is when the panel comes.
    place.display.xdotool("click 5 key b Delete");
    let before = place.shows_its_scene(&mut viewer, &[&cloud], 1, line);
    let camera: Camera = serde_json::from_value(before["camera"].clone()).unwrap();
    let [x0, y0, z0, x1, y1, z1]: [f64; 6] = faces(&before).try_into().unwrap();
    // The handle of the face in the east, beside the panel.
    let [x, y] = Viewport::new(size, PANEL as f64)
        .view(camera)
        .unwrap()
        .pixel(DVec3::new(x1, (y0 + y1) / 2.0, (z0 + z1) / 2.0))
        .unwrap();
    let (x, y) = (x.round() as i64, y.round() as i64);
    viewer.key("n");
    viewer.until("handle", |viewer| pixel(&viewer.photograph(), x, y) == [0x90, 0xEE, 0x90]);
    // What the cursor is on, or drags, is white.
    let to = x + 40;
    for (x, hand) in [(x, ""), (x, "mousedown 1"), (x + 20, ""), (to, "")] {
        place.display.xdotool(&format!("mousemove {x} {y} {hand}"));
        viewer.until("handle under the cursor", |viewer| {
            pixel(&viewer.photograph(), x, y) == [255; 3]
        });
    }
    place.display.xdotool(&format!("mouseup 1 mousemove {to} 10 key n"));
    let after = place.shows_its_scene(&mut viewer, &[&cloud], 2, line);
    let pixel_m = camera.ortho_height.unwrap() / size[1] as f64;
    let moved = faces(&after)[3] - x1;
    assert!((moved - 40.0 * pixel_m).abs() < 5.0 * pixel_m, "{moved} m, of {} m a pixel", pixel_m);
    assert_eq!((&faces(&after)[..3], &faces(&after)[4..]), (&[x0, y0, z0][..], &[y1, z1][..]));
    viewer.close();
}

/// Returns a camera above the middle of the street, which lies across the picture.
fn above() -> Camera {
    serde_json::from_str(
        r#"{"eye": [500000, 5000000, 300], "target": [500000, 5000000, 100], "up": [1, 0, 0],
            "projection": "orthographic", "ortho_height": 40}"#,
    )
    .unwrap()
}

/// Returns the coordinates in a line that names a picked point.
fn place_of(line: &str) -> DVec3 {
    let words = line.split_once(": ").unwrap().1.split_whitespace();
    let numbers: Vec<f64> = words.take(3).map(|number| number.parse().unwrap()).collect();
    DVec3::from_slice(&numbers)
}

/// Returns the points that were picked so far.
fn picked(viewer: &Viewer) -> Vec<DVec3> {
    let lines = viewer.printed();
    lines.iter().filter(|line| line.starts_with("point ")).map(|line| place_of(line)).collect()
}

/// The view changes at once after a click, before it can be answered.
#[test]
fn clicks_while_moving_pick_what_was_seen() {
    let place = Place::new();
    let (cloud, camera) = (place.street(300_000), place.at("cam.json"));
    std::fs::write(&camera, serde_json::to_string(&above()).unwrap()).unwrap();
    let scene = serde_json::json!({ "camera": above() });
    std::fs::write(place.at("above.json"), scene.to_string()).unwrap();
    let part = read(&cloud);
    let all: Vec<DVec3> = (0..part.columns.len()).map(|i| position(&part, i)).collect();
    let mut viewer = place.view(&[&cloud], &format!("--camera {} --time 4ms", camera.display()));
    viewer.comes_to_rest();
    for (round, [x, y]) in [[200, 150], [230, 140], [150, 160]].into_iter().enumerate() {
        // Scenes before and after the click tell where the camera was between.
        place.display.xdotool(&format!(
            "mousemove {x} {y} keydown d sleep 0.3 key F8 sleep 0.3 click 1 key F8 keyup d key 1"
        ));
        viewer.until("picked point", |viewer| picked(viewer).len() > round);
        let point = picked(&viewer)[round];
        assert!(all.contains(&point), "{point} is no point of the file");
        let [before, after] = [1, 2].map(|which| {
            let scene = place.at(&format!("pointillist-{}.json", 2 * round + which));
            let scene: serde_json::Value =
                serde_json::from_str(&std::fs::read_to_string(scene).unwrap()).unwrap();
            let camera = serde_json::from_value(scene["camera"].clone()).unwrap();
            View::new(camera, SIZE).unwrap().pixel(point).unwrap()
        });
        let (x, y) = (f64::from(x), f64::from(y));
        assert!((before[1] - y).abs() < 10.0, "{point} is seen at {before:?}, not at {x} {y}");
        assert!(after[0] < before[0] - 5.0, "nothing moved: {before:?}, {after:?}");
        // The camera flies to the right, so that what is seen moves to the left.
        assert!(
            (after[0] - 10.0..before[0] + 10.0).contains(&x),
            "{point} is seen at {before:?}, then {after:?}, not at {x} {y}"
        );
        // Back above the middle.
        let scene = place.at("above.json");
        drop_file(&place.display, &viewer.window, &scene);
        viewer.comes_to_rest();
    }
    viewer.leave();
    viewer.ended();
}

/// The view moves, so that a click waits for its answer, which the key forgets before it is there.
#[test]
fn clicks_that_are_forgotten_pick_nothing_later() {
    let place = Place::new();
    let cloud = place.street(300_000);
    let mut viewer = place.view(&[&cloud], "--view top");
    viewer.comes_to_rest();
    for [x, y] in [[200, 150], [230, 140], [150, 160], [260, 145]] {
        place.display.xdotool(&format!(
            "mousemove {x} {y} keydown d sleep 0.3 click 1 key Delete keyup d key 7"
        ));
        viewer.comes_to_rest();
    }
    viewer.shows(&place.picture(&[&cloud], "top.png", "--view top"));
    viewer.leave();
    viewer.ended();
}

/// What is seen first is a sample, or the coarse levels of an index.
#[test]
fn clicks_while_points_arrive_pick_the_same_as_when_all_are_there() {
    let place = Place::new();
    let (cloud, index) = (place.street(3_000_000), place.at("scan.pnti"));
    succeeded(&pointillist().arg("index").arg(&cloud).arg("-o").arg(&index).output().unwrap());
    let camera = place.at("cam.json");
    std::fs::write(&camera, serde_json::to_string(&above()).unwrap()).unwrap();
    let places = [[200, 150], [230, 140], [150, 160], [260, 145]];
    for file in [&cloud, &index] {
        let line = format!("--camera {}", camera.display());
        let mut viewer = place.view(&[file], &line);
        let click = |[x, y]: [u32; 2]| {
            place.display.xdotool(&format!("mousemove {x} {y} keydown shift click 1 keyup shift"));
        };
        // A click before the first points are seen is on nothing.
        viewer.until("points", |viewer| {
            viewer.photograph().pixels.iter().collect::<HashSet<_>>().len() > 200
        });
        let mut looks = 0;
        viewer.until("an early pick", |viewer| {
            // A click before the first frame has been reported is lost.
            if looks % 100 == 0 {
                click(places[0]);
            }
            looks += 1;
            !picked(viewer).is_empty()
        });
        places[1..].iter().copied().for_each(click);
        viewer.until("early picks", |viewer| picked(viewer).len() == places.len());
        viewer.comes_to_rest();
        viewer.key("Delete");
        for (number, at) in places.into_iter().enumerate() {
            click(at);
            viewer.until("pick", |viewer| picked(viewer).len() > places.len() + number);
        }
        let all = picked(&viewer);
        let (early, late) = all.split_at(places.len());
        assert_eq!(early, late, "{}", file.display());
        viewer.leave();
        viewer.ended();
    }
}

/// Picks the points under these pixels, and waits for the last.
#[track_caller]
fn pick(place: &Place, viewer: &mut Viewer, at: &[[i64; 2]]) {
    for (number, [x, y]) in at.iter().enumerate() {
        let click = if number == 0 { "click 1" } else { "keydown shift click 1 keyup shift" };
        let start = format!("point {}: ", number + 1);
        let mut looks = 0;
        viewer.until("picked point", |viewer| {
            // A click before the first frame is lost; two within a second would be a double click.
            if looks % 40 == 0 {
                place.display.xdotool(&format!("mousemove {x} {y} {click}"));
            }
            looks += 1;
            viewer.printed().iter().any(|line| line.starts_with(&start))
        });
    }
}

#[test]
fn profile_has_the_points_of_the_file_along_its_line() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let mut viewer = place.view(&[&cloud], "--view top");
    viewer.shows(&place.picture(&[&cloud], "top.png", "--view top"));
    viewer.key("x");
    viewer.until("word of what is missing", |viewer| {
        viewer.said().iter().any(|line| line.contains("two picked points"))
    });
    put_away(&mut viewer);
    pick(&place, &mut viewer, &[[195, 150], [202, 260]]);
    viewer.key("x");
    viewer.until("profile", |viewer| {
        viewer.printed().iter().any(|line| line.starts_with("profile: "))
    });
    let said = viewer.printed().into_iter().find(|line| line.starts_with("profile: ")).unwrap();
    let picks = place.saved(&mut viewer, "c", "pointillist-1.csv");
    let table = |path: &Path| -> Vec<Vec<f64>> {
        let text = std::fs::read_to_string(path).unwrap();
        text.lines()
            .skip(1)
            .map(|line| line.split(',').map(|number| number.parse().unwrap_or(f64::NAN)).collect())
            .collect()
    };
    let ends: Vec<DVec3> = table(&picks).iter().map(|row| DVec3::from_slice(row)).collect();
    let width = 0.02 * (ends[1] - ends[0]).truncate().length();
    let slab = Slab::new(ends[0], ends[1], width).unwrap();
    let part = read(&cloud);
    let bits = |p: DVec3| p.to_array().map(f64::to_bits);
    let mut expected: Vec<_> = (0..part.columns.len())
        .map(|i| position(&part, i))
        .filter(|p| slab.place(*p).is_some())
        .map(bits)
        .collect();
    let written = place.at("pointillist-1.profile.csv");
    viewer.until("table", |_| written.exists());
    let rows = table(&written);
    let svg = std::fs::read_to_string(place.at("pointillist-1.profile.svg")).unwrap();
    assert!(svg.contains("distance [") && svg.contains("data:image/png"), "{svg}");
    assert!(svg.contains(said.as_str()), "{said}: {svg}");
    // The table is that of the command line.
    let [from, to] = [ends[0], ends[1]].map(|end| format!("{},{}", end.x, end.y));
    let output = place.at("own.csv");
    let mut command = pointillist();
    command.arg("profile").arg(&cloud).args(["--from", &from, "--to", &to]);
    command.args(["--width", &width.to_string(), "-o"]).arg(&output);
    assert!(command.output().unwrap().status.success());
    let texts = [&written, &output].map(|path| std::fs::read_to_string(path).unwrap());
    assert_eq!(texts[0], texts[1]);
    let mut found: Vec<_> = rows.iter().map(|row| bits(DVec3::from_slice(&row[3..]))).collect();
    expected.sort_unstable();
    found.sort_unstable();
    assert!(expected.len() > 20 && found == expected, "{} of {}", found.len(), expected.len());
    assert!(said.contains(&format!("{} points, ", found.len())), "{said}");
    assert!(rows.iter().all(|row| row[0] >= 0.0
        && row[0] <= slab.length
        && row[1] == row[5]
        && row[2].abs() <= width / 2.0));
    // Once for the profile, and then for the window.
    viewer.key("Escape");
    viewer.close();
}

#[test]
fn saved_scene_loads_by_key_and_by_drop() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let mut viewer = place.view(&[&cloud], "");
    let fit = place.picture(&[&cloud], "fit.png", "");
    viewer.shows(&fit);
    viewer.key("7");
    let scene = place.saved(&mut viewer, "F8", "pointillist-1.json");
    let mut words: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(&scene).unwrap()).unwrap();
    words["color"] = "class".into();
    words["effects"] = serde_json::json!(["shape=off"]);
    words["clip"] = serde_json::json!(["box:-inf,-inf,-inf,500010,inf,inf"]);
    std::fs::write(&scene, words.to_string()).unwrap();
    // The camera frames all points, of which the box of the scene leaves some.
    let camera = place.at("above.json");
    std::fs::write(&camera, words["camera"].to_string()).unwrap();
    let line = format!(
        "--camera {} --color class --effect shape=off --clip box:-inf,-inf,-inf,500010,inf,inf",
        camera.display()
    );
    let above = place.picture(&[&cloud], "above.png", &line);
    viewer.key("0");
    viewer.shows(&fit);
    viewer.key("F6");
    viewer.shows(&above);
    viewer.key("0");
    drop_file(&place.display, &viewer.window, &scene);
    viewer.shows(&above);
    // What it takes to paint is found out when a scene asks for it.
    words["effects"] = serde_json::json!(["strokes=on", "fill=off", "visibility=off", "shape=off"]);
    std::fs::write(&scene, words.to_string()).unwrap();
    viewer.key("F6");
    viewer.shows(&place.picture(&[&cloud], "painted.png", &format!("--scene {}", scene.display())));
    words["effects"] = serde_json::json!(["shape=off"]);
    std::fs::write(&scene, words.to_string()).unwrap();
    viewer.key("F6");
    viewer.shows(&above);
    // An invalid scene is reported and changes nothing.
    std::fs::write(&scene, "{}").unwrap();
    viewer.key("F6");
    viewer.until("word of it", |viewer| {
        viewer.said().iter().any(|line| line.contains("not a scene file"))
    });
    put_away(&mut viewer);
    viewer.shows(&above);
    viewer.close();
}

/// Marks of shadows are made again for the new device.
#[test]
fn lost_device_keeps_shadows() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let options = "--view top --light direction:0.4,0.3,-0.6 --effect shadows=on";
    let lit = place.picture(&[&cloud], "lit.png", options);
    let unlit = place.picture(&[&cloud], "unlit.png", &options.replace("=on", "=off"));
    assert!(std::fs::read(&lit).unwrap() != std::fs::read(unlit).unwrap(), "there are no shadows");
    let mut viewer = place.view(&[&cloud], &format!("{options} --lose-device 40"));
    viewer.shows(&lit);
    place.loses_device(&mut viewer);
    put_away(&mut viewer);
    viewer.key("7");
    viewer.shows(&lit);
    viewer.close();
}

#[test]
fn lost_device_keeps_picture_and_picks() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let mut viewer = place.view(&[&cloud], "--view top --lose-device 40");
    let top = place.picture(&[&cloud], "top.png", "--view top");
    viewer.shows(&top);
    pick(&place, &mut viewer, &[[190, 140]]);
    place.loses_device(&mut viewer);
    put_away(&mut viewer);
    let table = place.saved(&mut viewer, "c", "pointillist-1.csv");
    assert_eq!(std::fs::read_to_string(table).unwrap().lines().count(), 2);
    // The mark of what was picked lies over the picture.
    place.display.xdotool("key Delete key 7");
    viewer.shows(&top);
    viewer.close();
}

#[test]
fn hanging_disk_is_reported_within_a_second() {
    let place = Place::new();
    let (cloud, index) = (place.street(1_500_000), place.at("cloud.pnti"));
    succeeded(&pointillist().arg("index").arg(&cloud).arg("-o").arg(&index).output().unwrap());
    for (fault, word) in [
        ("hang:4", "has not come"),
        ("panic:4", "could not be read: on purpose"),
        ("end:4", "has ended"),
    ] {
        let mut viewer = place.view(&[&index], &format!("--lod 0 --fail-reading {fault}"));
        viewer.until(word, |viewer| viewer.said().iter().any(|line| line.contains(word)));
        // Keys still move the camera, and pictures of what is there follow.
        let scene = place.saved(&mut viewer, "F8", "pointillist-1.json");
        viewer.key("7");
        std::fs::remove_file(scene).unwrap();
        let scene = place.saved(&mut viewer, "F8", "pointillist-1.json");
        std::fs::remove_file(scene).unwrap();
        put_away(&mut viewer);
        viewer.leave();
        // It reports the panic, and no device error.
        let ended = viewer.ended();
        let said = text(&ended.stderr);
        assert!(ended.status.success() && !said.to_lowercase().contains("validation"), "{said}");
    }
}

#[test]
fn camera_path_plays_in_the_window_and_renders() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let mut viewer = place.view(&[&cloud], "");
    let [fit, top] = [("fit.png", ""), ("top.png", "--view top")]
        .map(|(name, line)| place.picture(&[&cloud], name, line));
    viewer.shows(&fit);
    place.display.xdotool("mousemove 200 150 key k click 4 click 4 key k");
    let path = place.saved(&mut viewer, "F7", "pointillist-1.path.json");
    // Played from anywhere it ends at its last view.
    viewer.key("7");
    viewer.shows(&top);
    viewer.key("space");
    let [png, exr] = ["tour.png", "tour.exr"].map(|name| place.at(name));
    let line = format!(
        "-o {} --exr {} --size {}x{} --path {}",
        png.display(),
        exr.display(),
        SIZE[0],
        SIZE[1],
        path.display()
    );
    let text = std::fs::read_to_string(&path).unwrap().replace("25.0", "1.0");
    std::fs::write(&path, text).unwrap();
    succeeded(&render(&cloud, &line));
    let frames: Vec<_> =
        names(place.folder.path()).into_iter().filter(|name| name.starts_with("tour-")).collect();
    assert_eq!(
        frames,
        [1, 2, 3]
            .map(|number| [format!("tour-000{number}.exr"), format!("tour-000{number}.png")])
            .concat()
    );
    assert_eq!(read_png(&place.at("tour-0001.png")).pixels, read_png(&fit).pixels);
    // Each frame with its own layers.
    place.picture(&[&cloud], "fit.png", &format!("--exr {}", place.at("fit.exr").display()));
    let depths = ["fit.exr", "tour-0001.exr", "tour-0003.exr"]
        .map(|name| read_exr(&place.at(name)).floats("depth.Z"));
    // Cameras of a path may differ from their keys by a rounding.
    let alike = |a: &[f32], b: &[f32]| {
        a.iter().zip(b).filter(|(a, b)| a == b || (*a - *b).abs() < 1e-4 * **a).count()
    };
    assert!(
        alike(&depths[0], &depths[1]) > 9 * depths[0].len() / 10
            && alike(&depths[1], &depths[2]) < depths[0].len()
    );
    viewer.shows(&place.at("tour-0003.png"));
    viewer.close();
    // Existing frames are drawn again, or kept with a note.
    std::fs::write(place.at("tour-0002.png"), "no picture").unwrap();
    std::fs::remove_file(place.at("tour-0003.png")).unwrap();
    let said = succeeded(&render(&cloud, &format!("{line} --resume")));
    assert!(said.contains("2 of 3 frames"), "{said}");
    assert_eq!(std::fs::read(place.at("tour-0002.png")).unwrap(), b"no picture");
    assert!(place.at("tour-0003.png").exists());
    assert!(!succeeded(&render(&cloud, &line)).contains("kept"));
    read_png(&place.at("tour-0002.png"));
}
