//! The window, as people have it: a display of its own, real keys and a real mouse, pictures taken of what is on it. Validation is on; what it says ends the program with 1.
//!
//! Needs Xvfb, xdotool and ImageMagick's import, which tools/setup installs.

mod support;

use pointillist::synth::Scene;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};
use support::{Png, pointillist, read_png, render, scan, succeeded};

const SIZE: [u32; 2] = [400, 300];

/// An X server without a screen.
struct Display {
    server: Child,
    // It ends when nobody listens.
    _says: BufReader<ChildStdout>,
    name: String,
}

impl Display {
    fn open() -> Display {
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "640x480x24", "-nolisten", "tcp", "-noreset"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb; tools/setup installs it");
        let mut number = String::new();
        let mut says = BufReader::new(server.stdout.take().unwrap());
        says.read_line(&mut number).expect("the display's number");
        Display { server, _says: says, name: format!(":{}", number.trim()) }
    }

    fn command(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.env("DISPLAY", &self.name);
        command
    }

    fn xdotool(&self, line: &str) -> String {
        let output = self.command("xdotool").args(line.split_whitespace()).output().expect("xdotool; tools/setup installs it");
        assert!(output.status.success(), "xdotool {line}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap().trim().to_string()
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        // Asked to end it takes its socket along.
        let _ = Command::new("kill").arg(self.server.id().to_string()).status();
        let _ = self.server.wait();
    }
}

/// The program with its window.
struct Viewer<'d> {
    display: &'d Display,
    program: Option<Child>,
    window: String,
    folder: PathBuf,
}

impl<'d> Viewer<'d> {
    /// In a window without its panel, which would lie over the picture.
    fn open(display: &'d Display, folder: &Path, files: &[&Path], line: &str) -> Viewer<'d> {
        let mut command = pointillist();
        command.arg("view").args(files).args(["--size", &format!("{}x{}", SIZE[0], SIZE[1]), "--validate", "--timings", "--no-cache"]);
        command.args(line.split_whitespace()).env("DISPLAY", &display.name).env("XDG_RUNTIME_DIR", folder).env_remove("WAYLAND_DISPLAY");
        let program = command.current_dir(folder).stderr(Stdio::piped()).spawn().expect("start the program");
        let mut viewer = Viewer { display, program: Some(program), window: String::new(), folder: folder.to_path_buf() };
        viewer.until("a window", |viewer| {
            let found = display.command("xdotool").args(["search", "--name", "pointillist"]).output().unwrap();
            viewer.window = String::from_utf8(found.stdout).unwrap().trim().to_string();
            !viewer.window.is_empty()
        });
        display.xdotool(&format!("windowfocus {}", viewer.window));
        viewer.key("n");
        viewer
    }

    #[track_caller]
    fn until(&mut self, what: &str, mut holds: impl FnMut(&mut Self) -> bool) {
        let began = Instant::now();
        while !holds(self) {
            if let Some(status) = self.program.as_mut().unwrap().try_wait().unwrap() {
                panic!("no {what}: the program has ended, {status}: {}", self.said());
            }
            assert!(began.elapsed() < Duration::from_secs(60), "no {what} within a minute");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    fn said(&mut self) -> String {
        let output = self.program.take().unwrap().wait_with_output().unwrap();
        String::from_utf8_lossy(&output.stderr).into_owned()
    }

    fn key(&self, key: &str) {
        self.display.xdotool(&format!("key {key}"));
    }

    fn photograph(&self) -> Png {
        let path = self.folder.join("photograph.png");
        let taken =
            self.display.command("import").args(["-window", &self.window, "-depth", "8"]).arg(format!("png24:{}", path.display())).status();
        assert!(taken.expect("import; tools/setup installs it").success());
        read_png(&path)
    }

    /// Waits until the window shows this.
    #[track_caller]
    fn shows(&mut self, picture: &Path) {
        let wanted = read_png(picture);
        self.until(&format!("{}", picture.display()), |viewer| {
            let seen = viewer.photograph();
            seen.size == wanted.size && seen.pixels == wanted.pixels
        });
    }

    /// Waits until the picture stays, and is another one than this.
    #[track_caller]
    fn shows_another_than(&mut self, before: &Png) -> Png {
        let mut last = self.photograph();
        self.until("other picture", |viewer| {
            std::thread::sleep(Duration::from_millis(400));
            let seen = viewer.photograph();
            let settled = seen.pixels == last.pixels && (seen.size != before.size || seen.pixels != before.pixels);
            last = seen;
            settled
        });
        last
    }

    /// Of processor time, user's and system's.
    fn ticks(&self) -> u64 {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.program.as_ref().unwrap().id())).unwrap();
        let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
        [11, 12].map(|at| fields[at].parse::<u64>().unwrap()).iter().sum()
    }

    /// What it said: the statistics, and nothing of validation.
    fn close(mut self) -> String {
        self.key("Escape");
        let output = self.program.take().unwrap().wait_with_output().unwrap();
        let said = succeeded(&output);
        // Objects that outlive the device are counted when it is destroyed.
        assert!(!said.contains("Validation") && !said.contains("validation"), "{said}");
        said
    }
}

impl Drop for Viewer<'_> {
    fn drop(&mut self) {
        if let Some(mut program) = self.program.take() {
            let _ = program.kill();
            let _ = program.wait();
        }
    }
}

fn picture(folder: &Path, cloud: &[&Path], name: &str, line: &str) -> PathBuf {
    let path = folder.join(name);
    let mut command = pointillist();
    let size = format!("{}x{}", SIZE[0], SIZE[1]);
    command.arg("render").args(cloud).arg("-o").arg(&path).args(["--size", &size]).args(line.split_whitespace());
    succeeded(&command.output().unwrap());
    path
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

    let mut last = viewer.photograph();
    for gesture in [
        "mousemove 200 150 mousedown 1 mousemove 220 160 mousemove 260 170 mouseup 1",
        "mousedown 3 mousemove 230 150 mousemove 200 140 mouseup 3",
        "click 4 click 4 click 4",
        "key o",
        "keydown w sleep 0.3 keyup w",
    ] {
        display.xdotool(gesture);
        last = viewer.shows_another_than(&last);
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
    let small = viewer.shows_another_than(&last);
    assert!(small.pixels.iter().any(|pixel| *pixel != small.pixels[0]), "nothing is drawn in the smaller window");

    let said = viewer.close();
    assert!(said.contains("first picture after"), "{said}");
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
    let empty = viewer.photograph();
    viewer.key("n");
    viewer.shows_another_than(&empty);
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
