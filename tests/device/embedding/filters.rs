//! Filters and limits of clouds, as a scene file has them: hosts draw what `render --scene` does.

use super::*;
use crate::png_file::read_png;
use crate::program::{pointillist, succeeded};
use serde_json::{Value, json};
use std::path::Path;

/// Draws a scene as `render` does.
fn by_program(file: &Path, scene: &Value) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    std::fs::write(place("scene.json"), scene.to_string()).unwrap();
    let mut command = pointillist();
    command.arg("render").arg(file).arg("--scene").arg(place("scene.json"));
    command.args(["--size", &format!("{}x{}", SIZE[0], SIZE[1]), "-o"]).arg(place("a.png"));
    succeeded(&command.output().unwrap());
    read_png(&place("a.png")).pixels.into_flattened()
}

/// Gives a renderer the words of a scene.
fn set(renderer: &mut Renderer, scene: &Value) {
    for (name, value) in scene.as_object().unwrap() {
        match (name.as_str(), value) {
            ("camera", _) => {}
            (_, Value::Array(items)) => {
                let items: Vec<&str> = items.iter().map(|item| item.as_str().unwrap()).collect();
                renderer.set(name, &items.join(";")).unwrap();
            }
            (_, value) => renderer.set(name, &value.to_string()).unwrap(),
        }
    }
}

/// Checks that a host draws each scene as `render --scene` does, and not as without its words.
fn check(camera: Camera, scenes: &[(&Path, Value)]) {
    let mut application = Application::new(COLOR);
    let targets = application.targets();
    for (file, words) in scenes {
        let plain = json!({ "camera": camera });
        let mut scene = plain.clone();
        scene.as_object_mut().unwrap().extend(words.as_object().unwrap().clone());
        let expected = by_program(file, &scene);
        assert!(expected != by_program(file, &plain), "{scene}: nothing changes");
        let mut renderer = application.renderer();
        set(&mut renderer, &scene);
        renderer.open(&[file.to_path_buf()], &OpenSettings::default()).unwrap();
        let (report, color, _) = application.settle(&mut renderer, targets, &[view_of(camera)]);
        assert!(report.points > 0);
        assert!(without_alpha(&color) == expected, "{} {scene}", file.display());
        drop(renderer);
        (application.frame, application.safe) = (0, 0);
    }
}

/// Writes a scan with classes and intensities, and returns its path, and a camera.
fn street(folder: &Path) -> (PathBuf, Camera) {
    let path = folder.join("street.las");
    files::scan(&path, pointillist::synth::SceneKind::Street, 300_000);
    let options = pointillist::cloud::ReadOptions::new(Default::default(), false);
    let cloud = pointillist::cloud::read(std::slice::from_ref(&path), &options, &Silent).unwrap();
    let camera = Camera::framing(Preset::Fit, &cloud.core_points(), SIZE);
    (path, camera)
}

#[test]
fn filters_and_limits_of_a_scene_file_are_those_of_a_host() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = street(folder.path());
    let index = &*indexed(&[&path], "");
    let scenes = [
        (&*path, json!({ "only": ["ground"] })),
        (index, json!({ "only": ["ground"] })),
        (index, json!({ "only": ["intensity=100..", "z=..6"], "not": ["class=building,5"] })),
        (index, json!({ "lod": 6.5 })),
        (index, json!({ "budget": 70_000 })),
        (index, json!({ "not": ["ground"], "lod": 0.0, "budget": 150_000, "opacity": ["0.5"] })),
    ];
    check(camera, &scenes);
}

/// The index is in the user's cache folder, which is another one for a process of its own.
#[test]
fn files_are_indexed_for_limits() {
    let folder = tempfile::tempdir().unwrap();
    if std::env::var_os("AGAIN").is_none() {
        let cache = folder.path().display().to_string();
        again(&[("AGAIN", "1".into()), ("XDG_CACHE_HOME", cache)]);
        assert!(folder.path().join("pointillist").read_dir().unwrap().next().is_some());
        return;
    }
    let (path, camera) = street(folder.path());
    check(camera, &[(&path, json!({ "lod": 6.5 }))]);
}

/// Clouds that are there already keep their points; points of memory are filtered, too.
#[test]
fn filters_are_of_clouds_that_are_added_from_then_on() {
    let mut application = Application::new(COLOR);
    let targets = application.targets();
    let mut renderer = application.renderer();
    let places: Vec<[f32; 3]> =
        (0..5000).map(|i| [(i % 70) as f32, (i / 70) as f32, 0.0]).collect();
    let classes: Vec<u8> = (0..5000).map(|i| if i % 5 == 0 { 2 } else { 6 }).collect();
    let points = Points { classes: Some(&classes), ..Points::new(Positions::F32(&places)) };
    let top =
        view_of(Camera::framing(Preset::Fit, &[DVec3::ZERO, DVec3::new(70.0, 72.0, 0.0)], SIZE));
    let mut drawn =
        |renderer: &mut Renderer| application.settle(renderer, targets, &[top]).0.points;
    renderer.add_points(&points).unwrap();
    assert_eq!(drawn(&mut renderer), 5000);
    renderer.set("only", "ground").unwrap();
    assert_eq!(drawn(&mut renderer), 5000);
    renderer.add_points(&points).unwrap();
    assert_eq!(drawn(&mut renderer), 6000);
    renderer.set("only", "").unwrap();
    renderer.set("not", "class=2;class=7").unwrap();
    let cloud = renderer.add_points(&points).unwrap();
    assert_eq!(drawn(&mut renderer), 10_000);
    renderer.remove(cloud).unwrap();
    renderer.set("only", "class=7").unwrap();
    let none = renderer.add_points(&points).unwrap();
    drawn(&mut renderer);
    let CloudState::Failed(why) = renderer.state(none).unwrap() else { panic!("no point is left") };
    assert!(why.contains("leaves none"), "{why}");
    for (name, value, expected) in [
        ("only", "clas=2", "there is no attribute"),
        ("not", "class=2;return=perhaps", "perhaps"),
        ("lod", "-1", "not a number of pixels"),
        ("lod", "inf", "not a number of pixels"),
        ("budget", "1.5", "not a number of points"),
    ] {
        let refused = renderer.set(name, value).unwrap_err().to_string();
        assert!(refused.contains(expected) && refused.contains(name), "{refused}");
    }
    for name in ["lod", "budget"] {
        renderer.set(name, "auto").unwrap();
    }
}
