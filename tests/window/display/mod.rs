//! A display of a test's own, and the program with its window on it: real keys, a real mouse, and
//! screenshots. Validation is on; its messages end the program with exit code 1.
//!
//! Needs Xvfb, xdotool and ImageMagick's import, which tools/setup installs.

pub mod desktop;
pub mod drop;
pub mod place;

use crate::png_file::{Png, read_png};
use crate::program::{pointillist, succeeded};
use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, ExitStatus, Output, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

pub const SIZE: [u32; 2] = [400, 300];

/// How long nothing happens at rest.
const REST: Duration = Duration::from_secs(2);

/// An X server without a screen.
pub struct Display {
    server: Child,
    // The server ends when its output is closed.
    _says: BufReader<ChildStdout>,
    pub name: String,
}

impl Display {
    pub fn open() -> Display {
        let mut server = Command::new("Xvfb")
            .args([
                "-displayfd",
                "1",
                "-screen",
                "0",
                "1280x960x24",
                "-nolisten",
                "tcp",
                "-noreset",
            ])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb; tools/setup installs it");
        let mut number = String::new();
        let mut says = BufReader::new(server.stdout.take().unwrap());
        says.read_line(&mut number).expect("the display's number");
        Display { server, _says: says, name: format!(":{}", number.trim()) }
    }

    pub fn command(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.env("DISPLAY", &self.name);
        command
    }

    pub fn xdotool(&self, line: &str) -> String {
        let output = self
            .command("xdotool")
            .args(line.split_whitespace())
            .output()
            .expect("xdotool; tools/setup installs it");
        assert!(
            output.status.success(),
            "xdotool {line}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        String::from_utf8(output.stdout).unwrap().trim().to_string()
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        // A server that is asked to end removes its socket.
        let _ = Command::new("kill").arg(self.server.id().to_string()).status();
        let _ = self.server.wait();
    }
}

/// The output of a stream so far, read on a thread.
struct Heard {
    lines: Arc<Mutex<Vec<String>>>,
    reader: JoinHandle<()>,
}

impl Heard {
    fn of(stream: impl Read + Send + 'static) -> Heard {
        let lines = Arc::new(Mutex::new(Vec::new()));
        let kept = lines.clone();
        let reader = std::thread::spawn(move || {
            BufReader::new(stream)
                .lines()
                .map_while(Result::ok)
                .for_each(|line| kept.lock().unwrap().push(line));
        });
        Heard { lines, reader }
    }

    fn now(&self) -> Vec<String> {
        self.lines.lock().unwrap().clone()
    }

    /// Returns all of it, once the stream has ended.
    fn end(self) -> Vec<u8> {
        self.reader.join().unwrap();
        self.lines
            .lock()
            .unwrap()
            .iter()
            .flat_map(|line| [line, "\n"].concat().into_bytes())
            .collect()
    }
}

/// The program with its window.
pub struct Viewer<'d> {
    display: &'d Display,
    program: Option<Child>,
    /// On standard output and on standard error.
    heard: Option<[Heard; 2]>,
    pub window: String,
    folder: PathBuf,
}

impl<'d> Viewer<'d> {
    /// Opens a small window without anything over the picture.
    pub fn open(display: &'d Display, folder: &Path, files: &[&Path], line: &str) -> Viewer<'d> {
        let mut viewer = Viewer::with_panel(display, folder, files, SIZE, line);
        // Keys before the first frame may be lost.
        viewer.until("panel", |viewer| {
            let seen = viewer.photograph();
            seen.pixels.iter().any(|pixel| *pixel != seen.pixels[0])
        });
        // The panel is folded to a button there, then shown, and hidden.
        viewer.key("n");
        viewer.key("n");
        viewer
    }

    pub fn with_panel(
        display: &'d Display,
        folder: &Path,
        files: &[&Path],
        size: [u32; 2],
        line: &str,
    ) -> Viewer<'d> {
        let mut command = pointillist();
        command.arg("view").args(files).args([
            "--size",
            &format!("{}x{}", size[0], size[1]),
            "--validate",
            "--timings",
        ]);
        if !line.contains("--cache-dir") {
            command.arg("--no-cache");
        }
        // Words like NAME=VALUE at the front are the environment's.
        let is_environment =
            |word: &&str| word.split_once('=').is_some_and(|(name, _)| !name.starts_with('-'));
        let words: Vec<&str> = line.split_whitespace().collect();
        let environment = words.iter().copied().take_while(is_environment);
        command.envs(environment.clone().filter_map(|word| word.split_once('=')));
        command
            .args(&words[environment.count()..])
            .env("DISPLAY", &display.name)
            .env("XDG_RUNTIME_DIR", folder)
            .env("XDG_STATE_HOME", folder)
            .env_remove("WAYLAND_DISPLAY");
        let mut program = command
            .current_dir(folder)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("start the program");
        let heard =
            [Heard::of(program.stdout.take().unwrap()), Heard::of(program.stderr.take().unwrap())];
        let mut viewer = Viewer {
            display,
            program: Some(program),
            heard: Some(heard),
            window: String::new(),
            folder: folder.to_path_buf(),
        };
        viewer.until("a window", |viewer| {
            let found = display
                .command("xdotool")
                .args(["search", "--name", "pointillist"])
                .output()
                .unwrap();
            viewer.window = String::from_utf8(found.stdout).unwrap().trim().to_string();
            !viewer.window.is_empty()
        });
        display.xdotool(&format!("windowfocus --sync {}", viewer.window));
        viewer
    }

    #[track_caller]
    pub fn until(&mut self, what: &str, mut holds: impl FnMut(&mut Self) -> bool) {
        let began = Instant::now();
        while !holds(self) {
            if let Some(status) = self.program.as_mut().unwrap().try_wait().unwrap() {
                panic!(
                    "no {what}: the program has ended, {status}: {}",
                    String::from_utf8_lossy(&self.end(status).stderr)
                );
            }
            assert!(
                began.elapsed() < Duration::from_secs(60),
                "no {what} within a minute; {}",
                self.so_far()
            );
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Fails a test that waited in vain, with the program's output and a screenshot outside of the
    /// test's folder.
    fn so_far(&self) -> String {
        let kept = Path::new(env!("CARGO_TARGET_TMPDIR"))
            .join(format!("missed-{}.png", std::process::id()));
        self.photograph();
        std::fs::copy(self.folder.join("photograph.png"), &kept).unwrap();
        let mouse = self.display.xdotool("getmouselocation");
        let title = self.display.xdotool(&format!("getwindowname {}", self.window));
        let focus = self.display.command("xdotool").arg("getwindowfocus").output().unwrap();
        let focus = String::from_utf8_lossy(&focus.stdout).trim().to_string();
        format!(
            "it said {:?} and printed {:?}; the window is {}, {title:?}, the focus on {focus}, the mouse at {mouse}; photograph: {}",
            self.said(),
            self.printed(),
            self.window,
            kept.display()
        )
    }

    /// Returns the lines on standard output until now.
    pub fn printed(&self) -> Vec<String> {
        self.heard.as_ref().unwrap()[0].now()
    }

    /// Returns the lines on standard error until now.
    pub fn said(&self) -> Vec<String> {
        self.heard.as_ref().unwrap()[1].now()
    }

    fn end(&mut self, status: ExitStatus) -> Output {
        self.program = None;
        let [stdout, stderr] = self.heard.take().unwrap().map(Heard::end);
        Output { status, stdout, stderr }
    }

    pub fn key(&self, key: &str) {
        self.display.xdotool(&format!("key {key}"));
    }

    pub fn photograph(&self) -> Png {
        let path = self.folder.join("photograph.png");
        // Without such a window, import would wait for a click on another one.
        let mut import = self.display.command("timeout");
        import
            .args(["20", "import", "-window", &self.window, "-depth", "8"])
            .arg(format!("png24:{}", path.display()));
        let taken = import.status().expect("timeout");
        assert!(
            taken.success(),
            "no photograph, {taken}: is import there, which tools/setup installs, and the window?"
        );
        read_png(&path)
    }

    /// Waits until the window shows this.
    #[track_caller]
    pub fn shows(&mut self, picture: &Path) {
        // What is seen instead outlives the test's own folder.
        let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join(picture.file_name().unwrap());
        let wanted = read_png(picture);
        self.until(&format!("{} (last seen: {})", picture.display(), kept.display()), |viewer| {
            let seen = viewer.photograph();
            let same = seen.size == wanted.size && seen.pixels == wanted.pixels;
            if !same {
                std::fs::copy(viewer.folder.join("photograph.png"), &kept).unwrap();
            }
            same
        });
    }

    /// Returns the program's processor time so far [10 ms].
    pub fn ticks(&self) -> u64 {
        let stat =
            std::fs::read_to_string(format!("/proc/{}/stat", self.program.as_ref().unwrap().id()))
                .unwrap();
        // The name in parentheses may hold anything.
        let fields: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
        [11, 12].map(|at| fields[at].parse::<u64>().unwrap()).iter().sum()
    }

    /// Checks that nothing is drawn, and nothing else done, without input.
    #[track_caller]
    pub fn rests(&self) {
        std::thread::sleep(Duration::from_secs(1));
        let before = self.ticks();
        std::thread::sleep(REST);
        let worked = self.ticks() - before;
        assert!(worked <= 2, "{worked} hundredths of a second of work within two seconds of rest");
    }

    /// Waits until files are read and nothing is drawn, where no picture tells it.
    #[track_caller]
    pub fn comes_to_rest(&mut self) {
        // What the program had done by when: a rest may begin at any time.
        let mut done = VecDeque::new();
        self.until("rest", |viewer| {
            let now = Instant::now();
            done.push_back((now, viewer.ticks()));
            let is_long_ago = |(then, _): &(Instant, u64)| now - *then >= REST;
            while done.get(1).is_some_and(is_long_ago) {
                done.pop_front();
            }
            is_long_ago(&done[0]) && done[done.len() - 1].1 - done[0].1 <= 2
        });
    }

    /// Sends a signal, as `kill -NAME` does.
    pub fn signal(&self, name: &str) {
        let sent = Command::new("kill")
            .args(["-s", name, &self.program.as_ref().unwrap().id().to_string()])
            .status();
        assert!(sent.expect("kill").success());
    }

    /// Waits at most a minute for the program's end.
    #[track_caller]
    pub fn ended(mut self) -> Output {
        let began = Instant::now();
        loop {
            if let Some(status) = self.program.as_mut().unwrap().try_wait().unwrap() {
                return self.end(status);
            }
            assert!(began.elapsed() < Duration::from_secs(60), "it has not ended within a minute");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Closes the window, though something may not be saved.
    pub fn leave(&self) {
        self.display.xdotool("key Escape key Return");
    }

    /// Closes the window, and returns the program's statistics; fails on validation messages.
    #[track_caller]
    pub fn close(self) -> String {
        self.leave();
        let said = succeeded(&self.ended());
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
