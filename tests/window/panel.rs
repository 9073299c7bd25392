//! The panel's own: filters as text, undo, recent files, and the question before the window closes.

use crate::display::Viewer;
use crate::display::place::Place;
use crate::png_file::read_png;
use crate::program::{succeeded, text};
use std::path::Path;
use std::time::Duration;

const SIZE: [u32; 2] = [800, 600];
/// Colours of the panel: behind it, behind fields of text, and of errors.
const FILL: [u8; 3] = [27; 3];
const FIELD: [u8; 3] = [12; 3];
const ERROR: [u8; 3] = [255, 128, 128];
/// The tab of layers [px].
const LAYERS: [u32; 2] = [225, 82];

/// Returns the places of a colour, row by row.
fn places(viewer: &Viewer, color: [u8; 3]) -> Vec<[usize; 2]> {
    let seen = viewer.photograph();
    let width = seen.size[0] as usize;
    let found = seen.pixels.iter().enumerate().filter(|(_, pixel)| **pixel == color);
    found.map(|(at, _)| [at % width, at / width]).collect()
}

/// Opens a window, and waits for its panel.
fn panel<'p>(place: &'p Place, files: &[&Path], line: &str) -> Viewer<'p> {
    let mut viewer = place.view_with_panel(files, SIZE, line);
    viewer.until("panel", |viewer| viewer.photograph().pixels[2 * SIZE[0] as usize + 2] == FILL);
    viewer
}

fn size() -> String {
    format!("--size {}x{}", SIZE[0], SIZE[1])
}

#[test]
fn a_line_of_filters_leaves_what_the_command_line_leaves() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let fit = place.picture(&[&cloud], "fit.png", &format!("{} --view top", size()));
    let mut viewer = panel(&place, &[&cloud], "--view top");
    place.display.xdotool(&format!("mousemove {} {} click 1", LAYERS[0], LAYERS[1]));
    viewer.until("field", |viewer| places(viewer, FIELD).len() > 1000);
    let fields = places(&viewer, FIELD);
    let [x, y] = fields[fields.len() / 2];
    let write = |words: &str| {
        place.display.xdotool(&format!("mousemove {x} {y} click --repeat 3 1"));
        place.display.xdotool("key ctrl+a");
        // A word beginning with two hyphens would be an option.
        for word in words.split(' ') {
            let typed = place.display.command("xdotool").args(["type", "--", word]).status();
            assert!(typed.unwrap().success());
            place.display.xdotool("key space");
        }
        place.display.xdotool("key Return mousemove 700 590");
    };
    write("--only grund");
    viewer.until("an error", |viewer| !places(viewer, ERROR).is_empty());
    write("--only building");
    viewer.until("no error", |viewer| places(viewer, ERROR).is_empty());
    viewer.key("n");
    let scene = place.shows_its_scene(&mut viewer, &[&cloud], 1, &size());
    assert_eq!(scene["only"], serde_json::json!(["building"]));
    // What leaves nothing is refused, and what was there stays.
    viewer.key("n");
    write("--only class=77");
    viewer.until("an error", |viewer| !places(viewer, ERROR).is_empty());
    viewer.key("Escape");
    viewer.key("n");
    let scene = place.shows_its_scene(&mut viewer, &[&cloud], 2, &size());
    assert_eq!(scene["only"], serde_json::json!(["building"]));
    viewer.key("ctrl+z");
    viewer.key("ctrl+z");
    // Undoing moves no camera; the key frames all points again, once they are there.
    viewer.comes_to_rest();
    viewer.key("7");
    viewer.shows(&fit);
    viewer.close();
}

/// Only motions of the camera hold a view.
#[test]
fn a_view_that_was_only_clicked_on_is_framed_again_for_another_room() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let fit = place.picture(&[&cloud], "fit.png", &size());
    let mut viewer = panel(&place, &[&cloud], "");
    viewer.comes_to_rest();
    // Tabs, a mode, a point of the picture, and the background.
    for [x, y] in [[225, 82], [40, 82], [60, 55], [20, 55], [540, 300], [790, 10]] {
        place.display.xdotool(&format!("mousemove {x} {y} click 1"));
        std::thread::sleep(Duration::from_millis(500));
    }
    viewer.key("Delete");
    viewer.key("n");
    viewer.shows(&fit);
    place.display.xdotool(&format!("windowsize {} 500 300", viewer.window));
    viewer.shows(&place.picture(&[&cloud], "smaller.png", "--size 500x300"));
    place.display.xdotool(&format!("windowsize {} {} {}", viewer.window, SIZE[0], SIZE[1]));
    viewer.shows(&fit);
    place.display.xdotool("mousemove 540 300 mousedown 1 mousemove 560 310 mouseup 1");
    let held = place.shows_its_scene(&mut viewer, &[&cloud], 1, &size());
    place.display.xdotool(&format!("windowsize {} 500 300", viewer.window));
    let smaller = place.shows_its_scene(&mut viewer, &[&cloud], 2, "--size 500x300");
    assert_eq!(held["camera"], smaller["camera"]);
    viewer.leave();
    viewer.ended();
}

/// What is drawn over the picture covers no points of a view that is framed.
#[test]
fn the_first_view_is_framed_beside_annotations() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let own = "--color elevation --legend --scale-bar --title Street";
    let with = place.picture(&[&cloud], "with.png", &format!("{} {own}", size()));
    let mut viewer = panel(&place, &[&cloud], own);
    viewer.key("n");
    viewer.until("the picture beside annotations", |viewer| {
        let (seen, wanted) = (viewer.photograph(), read_png(&with));
        // Edges of text are blended by the device.
        let apart = |(a, b): (&[u8; 3], &[u8; 3])| (0..3).any(|k| a[k].abs_diff(b[k]) > 60);
        let differ = seen.pixels.iter().zip(&wanted.pixels).filter(|pair| apart(*pair)).count();
        seen.size == wanted.size && differ < seen.pixels.len() / 500
    });
    viewer.leave();
    viewer.ended();
}

#[test]
fn changes_are_undone_and_redone() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let mut viewer = place.view(&[&cloud], "--view top");
    viewer.shows(&place.picture(&[&cloud], "top.png", "--view top"));
    for (number, (key, boxes)) in
        [("b", 1), ("b", 2), ("ctrl+z", 1), ("ctrl+z", 0), ("ctrl+shift+z", 1)]
            .into_iter()
            .enumerate()
    {
        viewer.key(key);
        let scene = place.saved(&mut viewer, "F8", &format!("pointillist-{}.json", number + 1));
        let scene = std::fs::read_to_string(scene).unwrap();
        assert_eq!(scene.matches("box:").count(), boxes, "{number}: {scene}");
    }
    viewer.close();
}

#[test]
fn the_window_asks_before_something_is_lost() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let mut viewer = place.view(&[&cloud], "");
    viewer.shows(&place.picture(&[&cloud], "fit.png", ""));
    viewer.key("b");
    // Twice: the question, and no.
    for _ in 0..2 {
        viewer.key("Escape");
        std::thread::sleep(Duration::from_millis(500));
    }
    // It is still there.
    place.saved(&mut viewer, "F8", "pointillist-1.json");
    viewer.key("Escape");
    succeeded(&viewer.ended());
    let mut viewer = place.view(&[&cloud], "");
    viewer.shows(&place.at("fit.png"));
    viewer.key("b");
    viewer.leave();
    succeeded(&viewer.ended());
}

#[test]
fn an_empty_window_offers_recent_files() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let fit = place.picture(&[&cloud], "fit.png", &size());
    let list = place.at("pointillist/recent.json");
    let mut viewer = panel(&place, &[&cloud], "");
    viewer.until("list", |_| list.exists());
    viewer.close();
    let mut viewer = panel(&place, &[], "");
    let button = [52; 3];
    let hint = |viewer: &Viewer| -> Vec<[usize; 2]> {
        places(viewer, button).into_iter().filter(|[x, _]| *x > 300).collect()
    };
    viewer.until("hint", |viewer| !hint(viewer).is_empty());
    // The files are below the button of the dialog.
    let [x, y] = *hint(&viewer).last().unwrap();
    place.display.xdotool(&format!(
        "mousemove {} {} click 1 mousemove 790 590 key n",
        x - 4,
        y - 4
    ));
    viewer.shows(&fit);
    viewer.close();
}

#[test]
fn a_desktop_without_a_dialog_is_told_of() {
    let place = Place::new();
    let line = "PATH=/nowhere DBUS_SESSION_BUS_ADDRESS=unix:path=/nowhere";
    let mut viewer = panel(&place, &[], line);
    viewer.key("ctrl+o");
    viewer.until("word of it", |viewer| {
        viewer.said().iter().any(|line| line.contains("no dialog for files"))
    });
    viewer.until("an error", |viewer| !places(viewer, ERROR).is_empty());
    viewer.key("Escape");
    viewer.key("Escape");
    let ended = viewer.ended();
    assert!(!text(&ended.stderr).contains("panicked"));
}

/// The key needs no panel: the map lies over the picture at rest, and is gone when it moves.
#[test]
fn errors_of_the_last_moving_picture_are_shown_and_hidden() {
    let place = Place::new();
    let cloud = place.street(60_000);
    let mut viewer = place.view(&[&cloud], "--view top --time 4ms");
    viewer.shows(&place.picture(&[&cloud], "top.png", "--view top"));
    viewer.key("1");
    let front = place.picture(&[&cloud], "front.png", "--view front");
    viewer.shows(&front);
    // Where there is no error, the picture is darker.
    let corner = |viewer: &Viewer| viewer.photograph().pixels[0];
    let plain = corner(&viewer);
    viewer.key("t");
    viewer.until("errors", |viewer| corner(viewer) < plain);
    viewer.key("t");
    viewer.shows(&front);
    viewer.key("t");
    viewer.until("errors", |viewer| corner(viewer) < plain);
    // Switched off first: the map of the next picture comes at its own time.
    viewer.key("t");
    viewer.key("7");
    viewer.shows(&place.picture(&[&cloud], "top.png", "--view top"));
    viewer.close();
}
