//! Names that a user may give for inputs and outputs: links, devices, pipes, standard output, and
//! crafted files.

use crate::bad::watch;
use crate::files::scan;
use crate::program::{failed, pointillist, succeeded, text};
use crate::shared::shared;
use pointillist::synth::SceneKind;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

const SIZE: [&str; 2] = ["--size", "200x150"];

/// A folder with a scan and a camera.
struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new() -> Place {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        scan(&at("scan.las"), SceneKind::Street, 5_000);
        let camera = r#"{"eye": [500020, 4999960, 130], "target": [500000, 5000020, 105]}"#;
        std::fs::write(at("camera.json"), camera).unwrap();
        Place { folder }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn command(&self, words: &str) -> Command {
        let mut command = pointillist();
        command.current_dir(self.folder.path()).args(["render", "scan.las"]).args(SIZE);
        command.args(words.split_whitespace());
        command
    }

    fn run(&self, words: &str) -> Output {
        self.command(words).output().unwrap()
    }

    fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.folder.path()).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

#[test]
fn standard_output_takes_a_whole_picture_and_nothing_else() {
    let place = Place::new();
    succeeded(&place.run("-o picture.png"));
    let picture = std::fs::read(place.at("picture.png")).unwrap();
    let output = place.run("-o -");
    succeeded(&output);
    assert!(output.stdout == picture, "{} bytes", output.stdout.len());
    let said = failed(&place.run("-o - --explain=json"), 1);
    assert!(said.contains("standard output"), "{said}");
    failed(&place.run("-o - --exr -"), 1);
    failed(&place.run("-o - --turntable 2"), 1);
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full");
    if let Ok(full) = full {
        let output = place.command("-o -").stdout(full).output().unwrap();
        let said = failed(&output, 1);
        assert!(said.contains("standard output"), "{said}");
    }
    assert_eq!(place.names(), ["camera.json", "picture.png", "scan.las"]);
}

#[cfg(unix)]
#[test]
fn a_link_stays_a_link_and_a_device_a_device() {
    let place = Place::new();
    std::fs::create_dir(place.at("pictures")).unwrap();
    std::os::unix::fs::symlink("pictures/picture.png", place.at("link.png")).unwrap();
    succeeded(&place.run("-o link.png"));
    assert!(place.at("link.png").symlink_metadata().unwrap().is_symlink());
    assert!(place.at("pictures/picture.png").symlink_metadata().unwrap().is_file());
    // As `> picture.png` in a shell, with the device's own name.
    let redirected = std::fs::File::create(place.at("redirected.png")).unwrap();
    let output = place.command("-o /proc/self/fd/1").stdout(redirected).output().unwrap();
    succeeded(&output);
    let [a, b] = ["redirected.png", "link.png"].map(|name| std::fs::read(place.at(name)).unwrap());
    assert!(a == b);
    for device in ["/dev/null", "/proc/self/fd/1"] {
        let said = failed(&place.run(&format!("-o {device}")), 1);
        assert!(said.contains("pipe or a device"), "{said}");
    }
}

#[test]
fn inputs_are_not_overwritten() {
    let place = Place::new();
    let camera = std::fs::read(place.at("camera.json")).unwrap();
    for words in ["--camera camera.json -o camera.json", "--scene camera.json -o camera.json"] {
        failed(&place.run(words), 1);
    }
    let kept = |place: &Place, option: &str, name: &str| {
        let before = std::fs::read(place.at(name)).unwrap();
        let said = failed(&place.run(&format!("{option} {name} -o {name}")), 1);
        assert!(said.contains("it is an input"), "{option}: {said}");
        assert!(std::fs::read(place.at(name)).unwrap() == before, "{option}");
        // Alone it is what the option takes.
        succeeded(&place.run(&format!("{option} {name} -o picture.png")));
    };
    // Without an ending, so that only the input is in the way.
    std::fs::copy(place.at("camera.json"), place.at("view")).unwrap();
    kept(&place, "--camera", "view");
    std::fs::write(place.at("scene"), format!(r#"{{"camera": {}}}"#, text(&camera))).unwrap();
    kept(&place, "--scene", "scene");
    assert!(std::fs::read(place.at("view")).unwrap() == camera);

    let path = format!(
        r#"{{"keys": [{{"time": 0, "camera": {0}}}, {{"time": 1, "camera": {0}}}]}}"#,
        text(&camera)
    );
    std::fs::write(place.at("path.mp4"), path).unwrap();
    let light = "--light direction:0.3,0.8,-0.8";
    let index = |words: &str| {
        let mut command = pointillist();
        command.current_dir(place.folder.path()).args(words.split_whitespace());
        command.output().unwrap()
    };
    succeeded(&index("index scan.las -o scan.pnti"));
    succeeded(&index(&format!("shadows scan.pnti -o saved.shadows {light}")));
    std::fs::rename(place.at("saved.shadows"), place.at("saved.png")).unwrap();
    let shadows = std::fs::read(place.at("saved.png")).unwrap();
    let draw = format!("render scan.pnti --size 64x48 {light} --shadows saved.png");
    succeeded(&index(&format!("{draw} -o picture.png")));
    for (words, name) in [
        (format!("{draw} -o saved.png"), "saved.png"),
        ("render scan.las --path path.mp4 -o path.mp4".to_string(), "path.mp4"),
    ] {
        let before = std::fs::read(place.at(name)).unwrap();
        let said = failed(&index(&words), 1);
        assert!(said.contains("it is an input"), "{words}: {said}");
        assert!(std::fs::read(place.at(name)).unwrap() == before, "{words}");
    }
    assert!(std::fs::read(place.at("saved.png")).unwrap() == shadows);
}

#[cfg(unix)]
#[test]
fn pipes_and_devices_are_no_cameras_scenes_or_paths() {
    let place = Place::new();
    let made = Command::new("mkfifo").arg(place.at("pipe")).status().unwrap();
    assert!(made.success());
    for option in ["--camera", "--scene", "--path"] {
        for file in ["pipe", "/dev/zero"] {
            let command = place.command(&format!("{option} {file} -o picture.png"));
            let cost = watch(command, Duration::from_secs(20));
            let said = failed(&cost.output, 1);
            assert!(said.contains("a pipe or a device"), "{option} {file}: {said}");
        }
    }
}

#[test]
fn long_scenes_are_refused_in_short_lines() {
    let place = Place::new();
    let camera = std::fs::read_to_string(place.at("camera.json")).unwrap();
    let refused = |rest: &str, why: &str| {
        let scene = format!(r#"{{"camera": {camera}, {rest}}}"#);
        std::fs::write(place.at("scene.json"), scene).unwrap();
        let cost = watch(place.command("--scene scene.json -o p.png"), Duration::from_secs(20));
        let said = failed(&cost.output, 1);
        assert!(said.contains(why) && said.len() < 5000, "{} bytes, {said:.300}", said.len());
    };
    let clips = vec![r#""outside:0,0,0,1,1,1""#; 1001].join(",");
    refused(&format!(r#""clip": [{clips}]"#), "at most 1000 are allowed");
    let long = "x".repeat(900_000);
    refused(&format!(r#""color": "{long}""#), "more characters)");
    refused(&format!(r#""color": "{long}{long}""#), "larger than 1 MiB");
}

#[test]
fn a_reader_that_goes_away_does_not_cost_the_picture() {
    let place = Place::new();
    // Nothing reads what is printed.
    for words in ["--explain", "--timings", "--explain=json"] {
        let mut child = place
            .command(&format!("{words} -o picture.png"))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        drop(child.stdout.take());
        drop(child.stderr.take());
        assert_eq!(child.wait().unwrap().code(), Some(0), "{words}");
        std::fs::remove_file(place.at("picture.png")).unwrap();
    }
    if let Ok(full) = std::fs::OpenOptions::new().write(true).open("/dev/full") {
        let output = place.command("-o picture.png --explain=json").stdout(full).output().unwrap();
        let said = failed(&output, 1);
        assert!(said.contains("standard output"), "{said}");
    }
}

#[test]
fn crafted_files_are_refused_in_one_line_or_drawn() {
    let Some(folder) = shared("cases") else { return };
    let place = Place::new();
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let mut crafted = 0;
    for file in files {
        let name = file.file_name().unwrap().to_str().unwrap();
        let kind = name.split(['-', '.']).next().unwrap();
        let is_crafted = name.contains("-render-")
            || ["las_offset_1e308_synth", "root_cycle", "root_parent_5", "nodata"].contains(&kind);
        if !is_crafted {
            continue;
        }
        crafted += 1;
        let name_of = |path: &Path| path.to_str().unwrap().to_string();
        let command = match kind {
            "scene" | "path" => place.command(&format!("--{kind} {} -o p.png", name_of(&file))),
            _ => {
                let mut command = pointillist();
                command.current_dir(place.folder.path()).arg("render").arg(&file);
                command.args(SIZE).args(["-o", "p.png"]);
                command
            }
        };
        let cost = watch(command, Duration::from_secs(20));
        let said = text(&cost.output.stderr);
        println!("{name}: {:?}: {said}", cost.output.status.code());
        assert!(matches!(cost.output.status.code(), Some(0 | 1)), "{name}: {said}");
        assert!(!said.contains("panicked"), "{name}: {said}");
        if name.ends_with("pnti") {
            failed(&cost.output, 1);
        }
    }
    assert!(crafted > 20, "{crafted} files");
}

/// Lines of every subcommand but `view` and `tune`, and whether they print to standard output.
const PRINTING: &[(&str, bool)] = &[
    ("info scan.las", true),
    ("info --json scan.las", true),
    ("info --count scan.las", true),
    ("info scan.pnti", true),
    ("render scan.las -o out.png --size 64x48 --explain=json", true),
    ("render scan.las -o out.png --size 64x48 --timings", false),
    ("index scan.las -o out.pnti", false),
    ("shadows scan.pnti -o out.shadows --light direction:0.3,0.8,-0.8", false),
    ("export scan.las -o out.las", false),
    ("raster scan.las -o out.tif --resolution 1", false),
    ("profile scan.las --from 499990,4999990 --to 500010,5000010 --width 2 -o out.csv", false),
    ("synth torus -o out.las --points 1000", false),
    ("study tangents --points 2000 --size 64x48 --repeat 1", true),
    ("bench project --points 2000 --size 64x48 --repeat 1 --json", true),
    ("bench splat --points 2000 --size 64x48 --repeat 1", true),
    ("guide", true),
    ("guide strokes", true),
    ("render --help-effects", true),
    ("--help", true),
    ("--version", true),
];

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_said_and_a_closed_pipe_is_not() {
    let place = Place::new();
    let command = |line: &str| {
        let mut command = pointillist();
        command.current_dir(place.folder.path()).args(line.split_whitespace());
        command
    };
    succeeded(&command("index scan.las -o scan.pnti").output().unwrap());
    let given = place.names();
    let full = || std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    for &(line, prints) in PRINTING {
        let output = command(line).stdout(full()).output().unwrap();
        if prints {
            let said = text(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{line}: {said}");
            assert!(said.contains("standard output") && !said.contains("panicked"), "{said}");
        } else {
            succeeded(&output);
        }
        // Only the words on standard error are lost.
        let output = command(line).stderr(full()).output().unwrap();
        assert_eq!((output.status.code(), output.stdout.is_empty()), (Some(0), !prints), "{line}");
        let mut child =
            command(line).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop((child.stdout.take(), child.stderr.take()));
        assert_eq!(child.wait().unwrap().code(), Some(0), "{line}");
        for name in place.names().iter().filter(|name| !given.contains(name)) {
            let path = place.at(name);
            let removed = match path.is_dir() {
                true => std::fs::remove_dir_all(path),
                false => std::fs::remove_file(path),
            };
            removed.unwrap();
        }
    }
}
