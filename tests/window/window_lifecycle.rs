//! The window minimised, moved, scaled and destroyed, and during work that takes long.

use crate::display::desktop::Desktop;
use crate::display::drop::drop_file;
use crate::display::place::Place;
use crate::display::{SIZE, Viewer};
use crate::files::names;
use crate::png_file::{Png, read_png};
use crate::program::{pointillist, render, succeeded, text};
use glam::DVec3;
use pointillist::cloud::{self, ColumnSet, ReadOptions};
use pointillist::progress::Silent;
use pointillist::synth::SceneKind;
use pointillist::view::{Camera, View};
use std::ops::Range;
use std::path::Path;
use std::time::{Duration, Instant};

/// Returns the points of a file, in the world.
fn points(file: &Path) -> Vec<DVec3> {
    let read = ReadOptions::new(ColumnSet::default(), true);
    let part = cloud::read(&[file.to_owned()], &read, &Silent).unwrap().parts.remove(0);
    let columns = &part.columns;
    (0..columns.len())
        .map(|i| part.lattice.world([columns.x[i], columns.y[i], columns.z[i]].map(i64::from)))
        .collect()
}

fn resize(place: &Place, viewer: &mut Viewer, [width, height]: [u32; 2]) {
    place.display.xdotool(&format!("windowsize {} {width} {height}", viewer.window));
    viewer.until("another size", |viewer| viewer.photograph().size == [width, height]);
}

/// The saved picture is eight times as wide as the window.
#[test]
fn window_stays_responsive_while_saving_a_large_picture() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let mut viewer = place.view(&[&cloud], "--save-size 8x");
    let [fit, top] = [("fit.png", ""), ("top.png", "--view top")]
        .map(|(name, line)| place.picture(&[&cloud], name, line));
    let size = SIZE.map(|side| 8 * side);
    let large = place.picture(&[&cloud], "large.png", &format!("--size {}x{}", size[0], size[1]));
    viewer.shows(&fit);
    viewer.key("F9");
    viewer.key("7");
    viewer.shows(&top);
    let saved = place.at("pointillist-1.png");
    assert!(!saved.exists(), "the window waited for the file");
    viewer.until("saved picture", |_| saved.exists());
    // The view at the time of the key.
    assert!(std::fs::read(&saved).unwrap() == std::fs::read(&large).unwrap());

    // Two of them have two names; sizes change meanwhile, and points are picked.
    viewer.key("F9");
    viewer.key("F9");
    resize(&place, &mut viewer, [300, 200]);
    place.shows_its_scene(&mut viewer, &[&cloud], 1, "--size 300x200");
    let began = Instant::now();
    viewer.leave();
    let said = succeeded(&viewer.ended());
    assert!(began.elapsed().as_secs() < 5, "{:?} to close", began.elapsed());
    assert!(
        said.contains("pointillist-3.png was not saved")
            && !said.to_lowercase().contains("validation"),
        "{said}"
    );
    let left: Vec<_> =
        names(place.folder.path()).into_iter().filter(|name| name.contains("partial")).collect();
    assert!(left.is_empty(), "{left:?}");
}

/// A picture may wait for ever; the window does not.
#[test]
fn pending_saves_do_not_block_on_a_hanging_disk_or_lost_device() {
    let place = Place::new();
    let (cloud, index) = (place.street(1_500_000), place.at("scan.pnti"));
    succeeded(&pointillist().arg("index").arg(&cloud).arg("-o").arg(&index).output().unwrap());
    let mut viewer = place.view(&[&index], "--lod 0 --fail-reading hang:4");
    viewer.until("word of it", |viewer| {
        viewer.said().iter().any(|line| line.contains("has not come"))
    });
    viewer.key("F9");
    viewer.key("7");
    let scene = place.saved(&mut viewer, "F8", "pointillist-1.json");
    assert!(std::fs::read_to_string(scene).unwrap().contains("orthographic"));
    place.display.xdotool("key Escape key Escape key Return");
    let said = text(&viewer.ended().stderr);
    assert!(
        said.contains("pointillist-1.png was not saved")
            && !said.to_lowercase().contains("validation"),
        "{said}"
    );

    let small = place.scan("small.las", SceneKind::Street, 60_000);
    let mut viewer = place.view(&[&small], "--save-size 8x --lose-device 12");
    let fit = place.picture(&[&small], "fit.png", "");
    viewer.key("F9");
    // Motions of the camera interrupt tiles, so that the device is lost before all are drawn.
    place.loses_device(&mut viewer);
    place.display.xdotool("key Escape key 0");
    viewer.shows(&fit);
    let saved = place.saved(&mut viewer, "F9", "pointillist-1.png");
    assert!(saved.exists());
    viewer.leave();
    let said = text(&viewer.ended().stderr);
    assert!(
        said.contains("pointillist-1.png was not saved")
            && !said.to_lowercase().contains("validation"),
        "{said}"
    );
}

#[test]
fn layers_are_saved_as_render_writes_them() {
    let place = Place::new();
    let (cloud, layers) = (place.street(60_000), place.at("layers.exr"));
    let mut viewer = place.view(&[&cloud], "--view top");
    viewer.shows(&place.picture(
        &[&cloud],
        "top.png",
        &format!("--view top --exr {}", layers.display()),
    ));
    let saved = place.saved(&mut viewer, "l", "pointillist-1.exr");
    assert!(std::fs::read(saved).unwrap() == std::fs::read(layers).unwrap());
    viewer.close();
}

/// The saved picture is twelve times as wide as the window.
#[test]
fn file_dropped_while_saving_is_shown_and_is_in_the_next_picture() {
    let place = Place::new();
    let (torus, street, scene) = (
        place.scan("torus.las", SceneKind::Torus, 10_000),
        place.street(30_000),
        place.at("scene.json"),
    );
    let words = r#"{"camera": {"eye": [500020, 4999960, 130], "target": [500000, 5000020, 105]}, "color": "elevation"}"#;
    std::fs::write(&scene, words).unwrap();
    let (top, drawn) = ("--view top", format!("--scene {}", scene.display()));
    let size = format!("--size {}x{}", 12 * SIZE[0], 12 * SIZE[1]);
    let clouds = [&*torus, &*street];
    let mut viewer = place.view(&[&torus], &format!("{top} --save-size 12x"));
    viewer.shows(&place.picture(&clouds[..1], "top.png", top));
    let wanted = place.picture(&clouds, "scene.png", &drawn);
    let larger = place.picture(&clouds[..1], "larger.png", &format!("{top} {size}"));
    viewer.key("F9");
    drop_file(&place.display, &viewer.window, &street);
    drop_file(&place.display, &viewer.window, &scene);
    viewer.shows(&wanted);
    let saved = ["pointillist-1.png", "pointillist-2.png"].map(|name| place.at(name));
    assert!(!saved[0].exists(), "what was dropped waited for the file");
    viewer.key("F9");
    viewer.key("7");
    viewer.until("both pictures", |_| saved[1].exists());
    // The view and the files at the time of the key.
    assert!(std::fs::read(&saved[0]).unwrap() == std::fs::read(larger).unwrap());
    let larger = place.picture(&clouds, "larger.png", &format!("{drawn} {size}"));
    assert!(std::fs::read(&saved[1]).unwrap() == std::fs::read(larger).unwrap());

    // And the cancelled load is freed.
    let denser = place.scan("denser.las", SceneKind::Street, 40_000);
    let wanted = place.picture(&[&torus, &street, &denser], "denser.png", &drawn);
    viewer.key("F9");
    drop_file(&place.display, &viewer.window, &denser);
    drop_file(&place.display, &viewer.window, &scene);
    viewer.shows(&wanted);
    viewer.leave();
    let said = succeeded(&viewer.ended());
    assert!(
        said.contains("pointillist-3.png was not saved")
            && !said.to_lowercase().contains("validation"),
        "{said}"
    );
}

/// Strokes of a million points take seconds.
#[test]
fn window_stays_responsive_while_strokes_are_computed() {
    let place = Place::new();
    let (cloud, scene) = (place.street(1_000_000), place.at("scene.json"));
    let words = r#"{"camera": {"eye": [500020, 4999960, 130], "target": [500000, 5000020, 105]}, "color": "elevation", "effects": ["strokes=on"]}"#;
    std::fs::write(&scene, words).unwrap();
    let [fit, top] = [("fit.png", ""), ("top.png", "--view top --color elevation")]
        .map(|(name, line)| place.picture(&[&cloud], name, line));
    let mut viewer = place.view(&[&cloud], "");
    viewer.shows(&fit);
    drop_file(&place.display, &viewer.window, &scene);
    viewer.key("7");
    viewer.shows(&top);
    viewer.key("0");
    viewer.shows(&place.picture(&[&cloud], "painted.png", "--color elevation --effect strokes=on"));
    let said = viewer.close();
    assert!(!said.contains("strokes"), "{said}");

    // And so does a window that opens with them.
    let mut viewer = place.view(&[&cloud], "--effect strokes=on");
    viewer.shows(&fit);
    viewer.shows(&place.picture(&[&cloud], "painted.png", "--effect strokes=on"));
    viewer.close();
}

#[test]
fn lost_device_paints_again() {
    let place = Place::new();
    let cloud = place.street(300_000);
    let painted = place.picture(&[&cloud], "painted.png", "--effect strokes=on");
    let mut viewer = place.view(&[&cloud], "--effect strokes=on --lose-device 40");
    viewer.shows(&painted);
    place.loses_device(&mut viewer);
    place.display.xdotool("key Escape key 0");
    viewer.shows(&painted);
    viewer.close();
}

/// Files that are loaded again are shown before their strokes, as at the start. The file is another
/// one by then: strokes that are known come within a glance, and those of many points take many
/// times as long as a picture, however busy the machine is.
#[test]
fn lost_device_shows_points_until_strokes_are_computed_again() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let other = place.scan("other.las", SceneKind::Street, 3_000_000);
    let painted = place.picture(&[&cloud], "painted.png", "--effect strokes=on");
    let mut viewer = place.view(&[&cloud], "--effect strokes=on --lose-device 40");
    viewer.shows(&painted);
    // The camera of the first file, which the key 0 would give until the other one is there.
    let scene = place.saved(&mut viewer, "F8", "pointillist-1.json");
    let words: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(scene).unwrap()).unwrap();
    let camera = place.at("camera.json");
    std::fs::write(&camera, words["camera"].to_string()).unwrap();
    let points = place.picture(&[&other], "points.png", &format!("--camera {}", camera.display()));
    std::fs::rename(other, cloud).unwrap();
    place.loses_device(&mut viewer);
    place.display.xdotool("key Escape key F6");
    viewer.shows(&points);
    viewer.close();
}

/// A saved picture needs other nodes than the window.
#[test]
fn saving_from_an_index_keeps_picture_and_picks() {
    let place = Place::new();
    let (cloud, index) = (place.street(300_000), place.at("scan.pnti"));
    succeeded(&pointillist().arg("index").arg(&cloud).arg("-o").arg(&index).output().unwrap());
    let line = "--view top --lod 3";
    let mut viewer = place.view(&[&index], &format!("{line} --save-size 6x"));
    let top = place.picture(&[&index], "top.png", line);
    let large = place.picture(
        &[&index],
        "large.png",
        &format!("{line} --size {}x{}", 6 * SIZE[0], 6 * SIZE[1]),
    );
    viewer.shows(&top);
    viewer.rests();
    viewer.key("F9");
    let saved = place.at("pointillist-1.png");
    place.display.xdotool("mousemove 195 150 click 1");
    viewer.until("picked point", |viewer| {
        viewer.printed().iter().any(|line| line.starts_with("point 1:"))
    });
    assert!(!saved.exists(), "the pick waited for the file");
    viewer.until("saved picture", |_| saved.exists());
    assert!(std::fs::read(&saved).unwrap() == std::fs::read(&large).unwrap());
    place.display.xdotool("key Delete key 7");
    viewer.shows(&top);
    viewer.close();
}

#[test]
fn minimised_window_draws_nothing_and_comes_back_unchanged() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let mut viewer = place.view(&[&cloud], "");
    let [fit, top] = [("fit.png", ""), ("top.png", "--view top")]
        .map(|(name, line)| place.picture(&[&cloud], name, line));
    viewer.shows(&fit);
    place.display.xdotool(&format!("windowunmap --sync {}", viewer.window));
    viewer.rests();
    place.display.xdotool(&format!("windowmap --sync {}", viewer.window));
    viewer.shows(&fit);
    viewer.rests();
    place.display.xdotool(&format!("windowfocus --sync {}", viewer.window));
    viewer.key("7");
    viewer.shows(&top);
    viewer.close();
}

/// A truncated scan has to be noticed on site.
#[test]
fn panel_shows_notes_on_files_and_settings() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let whole = std::fs::read(&cloud).unwrap();
    let noted = |viewer: &mut Viewer| viewer.photograph().pixels.contains(&[255, 255, 224]);
    for (bytes, line) in [(whole.len() / 2, ""), (whole.len(), "--effect phong=on,backfaces=drop")]
    {
        std::fs::write(&cloud, &whole[..bytes]).unwrap();
        let mut viewer = place.view_with_panel(&[&cloud], [700, 480], line);
        viewer.until("note", noted);
        assert_eq!(
            viewer.said().iter().any(|line| line.contains("note: ") && line.contains("scan.las")),
            line.is_empty()
        );
        viewer.close();
    }
    let mut viewer = place.view_with_panel(&[&cloud], [700, 480], "");
    viewer.until("picture", |viewer| {
        viewer
            .photograph()
            .pixels
            .iter()
            .filter(|pixel| **pixel == pointillist::config::BACKGROUND)
            .count()
            > 100
    });
    // The panel follows the picture by a tenth of a second.
    std::thread::sleep(Duration::from_secs(2));
    assert!(!noted(&mut viewer));
    viewer.close();
}

/// Window managers destroy windows that do not respond.
#[test]
fn window_destroyed_by_another_program_ends_this_one_cleanly() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let mut viewer = place.view(&[&cloud], "");
    viewer.shows(&place.picture(&[&cloud], "fit.png", ""));
    place.display.xdotool(&format!("windowclose {}", viewer.window));
    let said = succeeded(&viewer.ended());
    assert!(!said.contains("panicked") && !said.to_lowercase().contains("validation"), "{said}");
}

/// The other monitor may be of another size.
#[test]
fn moved_window_keeps_picture_and_picks() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let mut viewer = place.view(&[&cloud], "--view top");
    let top = place.picture(&[&cloud], "top.png", "--view top");
    viewer.shows(&top);
    place.display.xdotool(&format!("windowmove --sync {} 700 500", viewer.window));
    viewer.shows(&top);
    resize(&place, &mut viewer, [500, 400]);
    place.shows_its_scene(&mut viewer, &[&cloud], 1, "--size 500x400");
    picks(&place, &mut viewer, &cloud, [500, 400], [700, 500], 1);
    viewer.close();
}

/// Clicks near the middle of a window at this place of the screen, until a point is picked; that is
/// one of the file's and is seen there.
fn picks(
    place: &Place,
    viewer: &mut Viewer,
    cloud: &Path,
    size: [u32; 2],
    corner: [u32; 2],
    number: usize,
) {
    let scene: serde_json::Value = serde_json::from_str(
        &std::fs::read_to_string(place.at(&format!("pointillist-{number}.json"))).unwrap(),
    )
    .unwrap();
    let view = View::new(serde_json::from_value::<Camera>(scene["camera"].clone()).unwrap(), size)
        .unwrap();
    let mut tried = [0; 2];
    let mut tries = 0;
    viewer.until("picked point", |viewer| {
        tried = [0, 1].map(|axis| size[axis] / 2 + 7 * (tries % 5));
        place.display.xdotool(&format!(
            "mousemove {} {} click 1 sleep 0.6",
            corner[0] + tried[0],
            corner[1] + tried[1]
        ));
        tries += 1;
        viewer.printed().iter().any(|line| line.starts_with("point 1:"))
    });
    let said = viewer.printed().into_iter().find(|line| line.starts_with("point 1:")).unwrap();
    let numbers: Vec<f64> = said["point 1: ".len()..]
        .split_whitespace()
        .take(3)
        .map(|number| number.parse().unwrap())
        .collect();
    let point = DVec3::from_slice(&numbers);
    assert!(points(cloud).contains(&point), "{said} is no point of the file");
    let pixel = view.pixel(point).unwrap();
    assert!(
        (0..2).all(|axis| (pixel[axis] - tried[axis] as f64).abs() < 10.0),
        "{said} is seen at {pixel:?}, not at {tried:?}"
    );
}

#[test]
fn scale_factor_enlarges_the_panel_and_keeps_picks_exact() {
    let place = Place::new();
    let size = [1000, 800];
    // The width of a panel beside nothing, from the left side of the window.
    let width = |viewer: &Viewer| {
        let row = &viewer.photograph().pixels[400 * 1000 + 20..401 * 1000];
        20 + row.iter().take_while(|pixel| **pixel != pointillist::config::BACKGROUND).count()
    };
    let widths = ["1", "2"].map(|scale| {
        let mut viewer =
            place.view_with_panel(&[], size, &format!("WINIT_X11_SCALE_FACTOR={scale}"));
        viewer.until("window", |viewer| {
            let seen = viewer.photograph();
            seen.pixels.iter().any(|pixel| *pixel != seen.pixels[0])
        });
        // There is no room for a large one.
        if scale == "2" {
            viewer.key("n");
        }
        viewer.until("panel", |viewer| (200..700).contains(&width(viewer)));
        let width = width(&viewer);
        viewer.close();
        width
    });
    assert!((3 * widths[0] / 2..5 * widths[0] / 2).contains(&widths[1]), "{widths:?}");

    let cloud = place.street(60_000);
    let mut viewer = place.view_with_panel(&[&cloud], size, "WINIT_X11_SCALE_FACTOR=2 --view top");
    viewer.until("window", |viewer| {
        let seen = viewer.photograph();
        seen.pixels.iter().any(|pixel| *pixel != seen.pixels[0])
    });
    viewer.key("n");
    viewer.until("panel", |viewer| viewer.photograph().pixels[400 * 1000 + 11] == [27; 3]);
    viewer.key("n");
    viewer.shows(&place.picture(&[&cloud], "top.png", "--view top --size 1000x800"));
    place.saved(&mut viewer, "F8", "pointillist-1.json");
    picks(&place, &mut viewer, &cloud, size, [0, 0], 1);
    viewer.close();
}

#[test]
fn change_of_scale_factor_resizes_window_and_panel() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let [once, twice] = [1, 2].map(|scale| {
        let size = SIZE.map(|side| scale * side);
        place.picture(
            &[&cloud],
            &format!("{scale}.png"),
            &format!("--view top --size {}x{}", size[0], size[1]),
        )
    });
    let mut desktop = Desktop::of(&place.display);
    let mut viewer = place.view(&[&cloud], "--view top");
    viewer.shows(&once);
    let panel = |viewer: &mut Viewer| {
        viewer.key("n");
        let mut reaches = 0;
        // It is as wide as it stays once it has been drawn twice.
        viewer.until("panel", |viewer| {
            let seen = viewer.photograph();
            let width = seen.size[0] as usize;
            let row = &seen.pixels[width * (seen.size[1] as usize / 2)..][..width];
            let before = reaches;
            reaches = row.iter().rposition(|pixel| *pixel == [27; 3]).unwrap_or(0);
            reaches > 0 && reaches == before
        });
        viewer.key("n");
        reaches
    };
    let narrow = panel(&mut viewer);
    desktop.dots_per_inch(192);
    viewer.shows(&twice);
    let wide = panel(&mut viewer);
    assert!((3 * narrow / 2..5 * narrow / 2).contains(&wide), "{narrow} and {wide} pixels");
    place.saved(&mut viewer, "F8", "pointillist-1.json");
    picks(&place, &mut viewer, &cloud, SIZE.map(|side| 2 * side), [0, 0], 1);
    desktop.dots_per_inch(96);
    place.display.xdotool("key Delete");
    viewer.shows(&once);
    viewer.close();
}

#[test]
fn lost_surface_keeps_the_picture() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let [top, front] = ["top", "front"]
        .map(|view| place.picture(&[&cloud], &format!("{view}.png"), &format!("--view {view}")));
    for pictures in [0, 1, 12] {
        let mut viewer = place.view(&[&cloud], &format!("--view top --lose-surface {pictures}"));
        for (key, picture) in [("7", &top), ("1", &front), ("7", &top), ("1", &front)] {
            viewer.key(key);
            viewer.shows(picture);
        }
        viewer.rests();
        viewer.close();
    }
}

/// Returns how far the middle of what a part of a picture shows is to the right of its own `[px]`.
/// Strays are few.
fn middle(picture: &Png, part: Range<usize>) -> f64 {
    let count = |x: &usize| {
        let column = picture.pixels.chunks(picture.size[0] as usize).map(|row| row[*x]);
        column.filter(|pixel| *pixel != pointillist::config::BACKGROUND).count()
    };
    let counts: Vec<usize> = part.clone().map(|x| count(&x)).collect();
    let shown = |count: &usize| *count > 4;
    let (first, last) = (counts.iter().position(shown), counts.iter().rposition(shown));
    (first.unwrap() + last.unwrap() + 1) as f64 / 2.0 - part.len() as f64 / 2.0
}

/// The projection is off-centre, and not the camera: what is saved knows of no panel.
#[test]
fn views_saved_beside_the_panel_show_their_subject_in_the_middle() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let (size, panel) = ([800, 600], 276);
    let mut viewer = place.view_with_panel(&[&cloud], size, "");
    viewer.until("panel", |viewer| viewer.photograph().pixels[300 * 800 + 11] == [27; 3]);
    let line = "--size 800x600";
    for (number, key) in ["", "0", "7", "1"].into_iter().enumerate() {
        if !key.is_empty() {
            viewer.key(key);
        }
        viewer.comes_to_rest();
        let free = middle(&viewer.photograph(), panel..800);
        let name = format!("pointillist-{}", number + 1);
        let scene = place.saved(&mut viewer, "F8", &format!("{name}.json"));
        let drawn =
            place.picture(&[&cloud], "scene.png", &format!("--scene {} {line}", scene.display()));
        let drawn = read_png(&drawn);
        let whole = middle(&drawn, 0..800);
        // Outermost points may be too few to be seen.
        assert!(whole.abs() < 24.0, "key {key:?}: {whole} px from the middle");
        assert!((free - whole).abs() < 3.0, "key {key:?}: {free} px in the window, {whole} px");
        let saved = place.saved(&mut viewer, "F9", &format!("{name}.png"));
        assert!(read_png(&saved).pixels == drawn.pixels, "key {key:?}: F9 differs from the scene");
        if number > 0 {
            viewer.key("k");
        }
    }
    // The first view is that of the key 0.
    let scene = |number: usize| std::fs::read(place.at(&format!("pointillist-{number}.json")));
    assert_eq!(scene(1).unwrap(), scene(2).unwrap());
    let path = place.saved(&mut viewer, "F7", "pointillist-1.path.json");
    let film = place.at("film.png");
    let line = format!("{line} --fps 0.5 --path {}", path.display());
    succeeded(&render(&cloud, &format!("-o {} {line}", film.display())));
    for name in ["film-0001.png", "film-0002.png", "film-0003.png"] {
        let frame = middle(&read_png(&place.at(name)), 0..800);
        assert!(frame.abs() < 24.0, "{name}: {frame} px from the middle");
    }
    let line = "--size 800x600";
    // Without the panel, where `render` looks from; a view that has not been moved follows by
    // itself.
    viewer.key("n");
    viewer.shows(&place.picture(&[&cloud], "front.png", &format!("{line} --view front")));
    viewer.key("0");
    viewer.shows(&place.picture(&[&cloud], "fit.png", line));
    viewer.leave();
    viewer.ended();
}

/// In a small window the picture has all of the room, and a button shows the panel.
#[test]
fn the_panel_is_folded_where_it_would_take_the_room_of_the_picture() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let mut viewer = place.view_with_panel(&[&cloud], [640, 480], "");
    let is_shown = |viewer: &Viewer| viewer.photograph().pixels[240 * 640 + 11] == [27; 3];
    let wanted = read_png(&place.picture(&[&cloud], "fit.png", "--size 640x480"));
    // All but the button.
    let same = |seen: &Png| {
        let pairs = seen.pixels.iter().zip(&wanted.pixels).enumerate();
        pairs.filter(|(at, _)| at % 640 > 80 || at / 640 > 40).all(|(_, (a, b))| a == b)
    };
    viewer.until("the whole picture", |viewer| same(&viewer.photograph()));
    assert!(viewer.photograph().pixels != wanted.pixels);
    place.display.xdotool("mousemove 30 20 click 1 mousemove 600 400");
    viewer.until("panel", |viewer| is_shown(viewer));
    // Its upper right corner folds it again.
    place.display.xdotool("mousemove 252 18 click 1 mousemove 600 400");
    viewer.until("no panel", |viewer| same(&viewer.photograph()));
    assert!(viewer.photograph().pixels != wanted.pixels);
    // The key shows it, too, and leaves nothing over the picture.
    viewer.key("n");
    viewer.until("panel", |viewer| is_shown(viewer));
    viewer.key("n");
    viewer.shows(&place.at("fit.png"));
    viewer.close();
}

#[test]
fn scene_without_level_of_detail_keeps_the_options() {
    let place = Place::new();
    let (cloud, index, scene) =
        (place.street(300_000), place.at("scan.pnti"), place.at("scene.json"));
    succeeded(&pointillist().arg("index").arg(&cloud).arg("-o").arg(&index).output().unwrap());
    let words = r#"{"camera": {"eye": [500020, 4999960, 130], "target": [500000, 5000020, 105]}, "color": "elevation"}"#;
    std::fs::write(&scene, words).unwrap();
    let line = "--lod 4 --point-budget 100000";
    let mut viewer = place.view(&[&index], line);
    viewer.shows(&place.picture(&[&index], "fit.png", line));
    drop_file(&place.display, &viewer.window, &scene);
    viewer.shows(&place.picture(
        &[&index],
        "scene.png",
        &format!("{line} --scene {}", scene.display()),
    ));
    viewer.close();
}
