//! An index is old, new or absent, whatever happens while it is made (guide: reliability): the
//! program runs under `strace`, which kills it at every relevant system call, or lets that call
//! fail; on a full disk; interrupted; and several at once.
//!
//! Tests that need `strace` or mounting are skipped where they are not available.

#![cfg(target_os = "linux")]

use crate::files::{names, scan};
use crate::program::{SIGNALS, failed, pointillist, succeeded, text};
use crate::skip::skip;
use pointillist::index::format::{Index, PLANES};
use pointillist::synth::SceneKind;
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

const PROGRAM: &str = env!("CARGO_BIN_EXE_pointillist");
const PARTIAL: &str = ".out.pnti.partial-";
/// Points of a cloud whose every call fails or ends the program. Ten times as many make the same
/// calls and only derive for longer.
const FEW: u64 = 2000;

/// State of the index file.
#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Absent,
    Old,
    New,
}

/// A folder with a cloud, and the indexes of it and of another one.
struct Place {
    folder: tempfile::TempDir,
    aside: tempfile::TempDir,
    /// Planes to derive.
    found: &'static [&'static str],
    old: Vec<u8>,
    new: Vec<u8>,
}

impl Place {
    fn new(points: u64) -> Place {
        let (folder, aside) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        // Few points: the cost of deriving does not matter here.
        let found: &[&str] =
            if points <= 30_000 { &["--normals", "--strokes", "--luminance"] } else { &[] };
        let mut place = Place { folder, aside, found, old: Vec::new(), new: Vec::new() };
        for (scene, count) in [(SceneKind::Torus, 500), (SceneKind::Street, points)] {
            scan(&place.folder.path().join("a.las"), scene, count);
            succeeded(&place.command().output().unwrap());
            let bytes = fs::read(place.output()).unwrap();
            (place.old, place.new) = (std::mem::take(&mut place.new), bytes);
        }
        assert!(place.old != place.new);
        place
    }

    fn output(&self) -> PathBuf {
        self.folder.path().join("out.pnti")
    }

    fn index(&self, mut command: Command) -> Command {
        command
            .current_dir(self.folder.path())
            .args(["index", "a.las", "-o", "out.pnti", "--threads", "2", "--memory", "64MiB"])
            .args(self.found);
        command
    }

    fn command(&self) -> Command {
        self.index(pointillist())
    }

    /// Runs the program under strace, which injects a fault into some calls.
    fn traced(&self, call: &str, inject: &str) -> Command {
        let mut strace = Command::new("strace");
        // Not with --seccomp-bpf, which is faster and silently never sends a signal but the first.
        strace.args(["-f", "-qq", "-o"]).arg(self.log());
        strace.args([
            "-e",
            &format!("trace={call}"),
            "-e",
            &format!("inject={call}:{inject}"),
            PROGRAM,
        ]);
        strace.env("RUST_BACKTRACE", "0").stdin(Stdio::null());
        self.index(strace)
    }

    fn log(&self) -> PathBuf {
        self.aside.path().join("strace")
    }

    fn injected(&self) -> bool {
        fs::read_to_string(self.log()).unwrap_or_default().contains("INJECTED")
    }

    fn set(&self, state: State) {
        match state {
            State::Absent => _ = fs::remove_file(self.output()),
            State::Old => fs::write(self.output(), &self.old).unwrap(),
            State::New => fs::write(self.output(), &self.new).unwrap(),
        }
    }

    /// Returns the state, and checks that nothing else is there.
    #[track_caller]
    fn state(&self, what: &str) -> State {
        match fs::read(self.output()) {
            Err(_) => State::Absent,
            Ok(bytes) if bytes == self.old => State::Old,
            Ok(bytes) if bytes == self.new => State::New,
            Ok(bytes) => panic!("{what}: {} bytes, neither old nor new", bytes.len()),
        }
    }

    /// Checks that the cloud and perhaps its index are there, and nothing else.
    #[track_caller]
    fn is_tidy(&self, what: &str) {
        let left: Vec<_> = names(self.folder.path())
            .into_iter()
            .filter(|name| name != "a.las" && name != "out.pnti")
            .collect();
        assert!(left.is_empty(), "{what}: {left:?} were left");
    }

    /// Checks that a build without faults makes the new index and removes leftovers.
    #[track_caller]
    fn recovers(&self, what: &str) {
        succeeded(&self.command().output().unwrap());
        assert_eq!(self.state(what), State::New);
        self.is_tidy(what);
    }
}

/// Returns whether strace is available and permitted.
fn can_trace() -> bool {
    let tried = Command::new("strace").args(["-f", "-e", "trace=close", "true"]).output();
    let can = tried.is_ok_and(|output| output.status.success());
    if !can {
        skip("strace is missing or may not trace");
    }
    can
}

/// Checks that the program exited without a panic; returns its output.
#[track_caller]
fn orderly(output: &Output, what: &str) -> String {
    let said = text(&output.stderr);
    assert!(output.status.code().is_some(), "{what}: {}: {said}", output.status);
    assert!(!said.contains("panicked") && output.status.code() != Some(101), "{what}: {said}");
    said
}

#[test]
fn killed_at_any_call_it_leaves_old_new_or_nothing() {
    if !can_trace() {
        return;
    }
    let mut kills = 0;
    for (points, calls) in [
        // Without points one thread writes everything, and strace counts the calls of each.
        (
            FEW,
            &[
                "pwrite64",
                "fsync",
                "rename",
                "unlink",
                "flock",
                "sync_file_range",
                "openat",
                "statx",
                "clone3",
                "munmap",
            ][..],
        ),
        (0, &["pwrite64", "fsync", "rename", "sync_file_range"]),
    ] {
        let place = Place::new(points);
        for call in calls {
            let mut before = State::Absent;
            for k in 1.. {
                let what = format!("{points} points, killed at {call} {k}");
                place.set(before);
                let output =
                    place.traced(call, &format!("signal=SIGKILL:when={k}")).output().unwrap();
                let after = place.state(&what);
                if output.status.signal() != Some(libc::SIGKILL) {
                    succeeded(&output);
                    assert_eq!(after, State::New);
                    assert!(k > 1 || matches!(*call, "clone3" | "statx"), "no {call} was made");
                    break;
                }
                kills += 1;
                assert!(
                    after == before || after == State::New,
                    "{what}: {before:?} became {after:?}"
                );
                let left: Vec<_> = names(place.folder.path())
                    .into_iter()
                    .filter(|name| name != "a.las" && name != "out.pnti")
                    .collect();
                assert!(left.iter().all(|name| name.starts_with(PARTIAL)), "{what}: {left:?}");
                if !left.is_empty() || k % 5 == 0 {
                    place.recovers(&what);
                }
                before = if before == State::Absent { State::Old } else { State::Absent };
            }
        }
    }
    println!("killed {kills} times");
    assert!(kills > 40);
}

/// Required outcome of a failing call.
#[derive(Clone, Copy, PartialEq)]
enum Expected {
    /// One line, exit code 1, what was there before.
    Error,
    /// No effect.
    Success,
    /// Either: some of these calls are not ours.
    Either,
}

#[test]
fn any_call_that_fails_leaves_the_old_index_or_the_new_one() {
    if !can_trace() {
        return;
    }
    use Expected::*;
    let mut faults = 0;
    for points in [FEW, 0] {
        let place = Place::new(points);
        for (call, fault, expected) in [
            ("pwrite64", "error=ENOSPC", Error),
            ("pwrite64", "error=EIO", Error),
            ("pwrite64", "retval=0", Error),
            ("pwrite64", "error=EINTR", Success),
            ("fsync", "error=EIO", Error),
            ("rename", "error=EIO", Error),
            ("rename", "error=ENOSPC", Error),
            ("sync_file_range", "error=EIO", Success),
            ("flock", "error=ENOLCK", Success),
            ("unlink", "error=EIO", Either),
            ("openat", "error=EMFILE", Either),
            ("statx", "error=EIO", Either),
            ("pread64", "error=EIO", Either),
            ("clone3", "error=EAGAIN", Either),
        ] {
            if points == 0 && expected == Either {
                continue;
            }
            let mut before = State::Absent;
            for k in 1.. {
                let what = format!("{points} points, {call} {k}: {fault}");
                place.set(before);
                let output = place.traced(call, &format!("{fault}:when={k}")).output().unwrap();
                if !place.injected() {
                    succeeded(&output);
                    break;
                }
                faults += 1;
                let (said, after) = (orderly(&output, &what), place.state(&what));
                let expected = match expected {
                    Either if output.status.success() => Success,
                    Either => Error,
                    expected => expected,
                };
                match expected {
                    Success => assert!(
                        output.status.success() && after == State::New,
                        "{what}: {after:?}, {said}"
                    ),
                    // The program's loader has exit codes and messages of its own.
                    _ => {
                        assert!(
                            !output.status.success() && said.lines().count() == 1,
                            "{what}: {}: {said}",
                            output.status
                        );
                        // The last of these sync the folder.
                        assert!(
                            after == before
                                || matches!(call, "fsync" | "openat") && after == State::New,
                            "{what}: {before:?} became {after:?}"
                        );
                        assert!(
                            said.contains("shared libraries") || output.status.code() == Some(1),
                            "{what}: {said}"
                        );
                    }
                }
                // If a file cannot be removed now, the next build removes it.
                if call == "unlink" {
                    place.recovers(&what)
                } else {
                    place.is_tidy(&what)
                }
                before = if before == State::Absent { State::Old } else { State::Absent };
            }
        }
    }
    println!("{faults} faults");
    assert!(faults > 60);
}

#[test]
fn any_call_of_a_picture_that_fails_leaves_the_old_one_or_the_new_one() {
    if !can_trace() {
        return;
    }
    let [folder, aside] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    scan(&folder.path().join("a.las"), SceneKind::Street, 20_000);
    let (picture, log) = (folder.path().join("a.png"), aside.path().join("strace"));
    let render = |call: &str, inject: Option<&str>| {
        let mut strace = Command::new("timeout");
        strace.args(["60", "strace", "-f", "-qq", "-o"]).arg(&log);
        strace.args(["-e", &format!("trace={call}")]);
        strace.args(inject.iter().flat_map(|inject| ["-e", inject]));
        strace.arg(PROGRAM).args(["render", "a.las", "-o", "a.png", "--style", "points"]);
        strace.args(["--size", "64x48"]).current_dir(folder.path()).stdin(Stdio::null());
        strace.env("RUST_BACKTRACE", "0").env("RAYON_NUM_THREADS", "2").output().unwrap()
    };
    let read = || fs::read(&picture).unwrap();
    succeeded(&render("rename", None));
    let (old, new) = (b"old".to_vec(), read());
    let mut faults = 0;
    for (call, fault, most) in [
        ("pread64", "error=EIO", u32::MAX),
        ("write", "error=ENOSPC", u32::MAX),
        ("write", "retval=0", u32::MAX),
        ("fsync", "error=EIO", u32::MAX),
        ("rename", "error=EIO", u32::MAX),
        // The handler of signals, and two that work is divided among. The next are the driver's,
        // and lavapipe waits for ever for one of its own that did not start.
        ("clone3", "error=EAGAIN", 3),
    ] {
        for k in 1..=most {
            fs::write(&picture, &old).unwrap();
            let inject = format!("inject={call}:{fault}:when={k}");
            let output = render(call, Some(&inject));
            if !fs::read_to_string(&log).unwrap_or_default().contains("INJECTED") {
                succeeded(&output);
                assert!(k > 1, "no {call} was made");
                break;
            }
            faults += 1;
            let (what, found) = (format!("{call} {k}: {fault}"), read());
            let said = orderly(&output, &what);
            assert_eq!(names(folder.path()), ["a.las", "a.png"], "{what}");
            if output.status.success() {
                assert!(found == new, "{what}: {} bytes", found.len());
                continue;
            }
            // The last of these sync the folder.
            assert!(found == old || call == "fsync" && found == new, "{what}: {said}");
            assert_eq!(said.lines().count(), 1, "{what}: {said}");
            assert!(
                said.contains("shared libraries") || output.status.code() == Some(1),
                "{what}: {said}"
            );
        }
    }
    println!("{faults} faults");
    assert!(faults > 20);
}

/// Tests whether everything in an index can be read.
fn is_readable(path: &Path) -> bool {
    let Ok(index) = Index::open(path) else { return false };
    (0..index.nodes().len()).all(|number| {
        let node = &index.nodes()[number];
        PLANES.iter().filter(|(plane, _)| node.has(*plane)).all(|&(plane, _)| {
            let mut bytes = vec![0; node.unpacked_bytes(plane) as usize];
            index.read(number, plane, &mut bytes).is_ok()
        })
    })
}

#[test]
fn a_write_that_never_reached_the_disk_is_found() {
    if !can_trace() {
        return;
    }
    for points in [FEW, 0] {
        let place = Place::new(points);
        for k in 1.. {
            place.set(State::Absent);
            // The system claims to have written a hundred bytes.
            let output =
                place.traced("pwrite64", &format!("retval=100:when={k}")).output().unwrap();
            if !place.injected() {
                break;
            }
            orderly(&output, "a lost write");
            // Nothing is lost if the file had the same bytes before: radii within the bound are
            // written unchanged.
            let is_whole = fs::read(place.output()).is_ok_and(|bytes| bytes == place.new);
            assert!(
                is_whole || !is_readable(&place.output()),
                "{points} points: lost write {k} was not found"
            );
        }
        place.recovers("after lost writes");
        assert!(is_readable(&place.output()));
    }
}

#[test]
fn a_file_size_limit_is_a_short_write_and_then_an_error() {
    let place = Place::new(20_000);
    for kib in [0, 1, 4, 5, 100, place.new.len() / 1024 - 1, place.new.len() / 1024] {
        for before in [State::Absent, State::Old] {
            place.set(before);
            let mut shell = Command::new("bash");
            shell.args([
                "-c",
                &format!("trap '' XFSZ; ulimit -f {kib}; exec \"$0\" \"$@\""),
                PROGRAM,
            ]);
            let output = place.index(shell).output().unwrap();
            let said = failed(&output, 1);
            assert!(said.contains("out.pnti") && said.contains("large"), "{said}");
            assert_eq!(place.state("limited"), before);
            place.is_tidy("limited");
        }
    }
    place.recovers("limited");
}

#[test]
fn a_full_spill_file_is_an_error() {
    if !can_trace() {
        return;
    }
    let place = Place::new(1_800_000);
    let plain = succeeded(&place.command().output().unwrap());
    assert!(plain.contains("through a temporary file"), "{plain}");
    // Points are distributed first: the first calls are the spill's.
    for (call, fault) in [
        ("pwrite64", "error=ENOSPC:when=1"),
        ("pwrite64", "error=ENOSPC:when=100+"),
        ("pread64", "error=EIO:when=500+"),
    ] {
        for before in [State::Absent, State::Old] {
            place.set(before);
            let output = place.traced(call, fault).output().unwrap();
            assert!(place.injected());
            let said = failed(&output, 1);
            println!("{said}");
            assert_eq!(place.state(fault), before);
            place.is_tidy(fault);
        }
    }
    place.set(State::Old);
    let output = place.traced("pwrite64", "signal=SIGKILL:when=200").output().unwrap();
    assert_eq!(output.status.signal(), Some(libc::SIGKILL));
    assert_eq!(place.state("killed"), State::Old);
    place.recovers("killed");
}

/// A file system of a given size; `None` if mounting is not possible.
struct Mounted(PathBuf);

impl Mounted {
    fn new(at: PathBuf, kib: usize) -> Option<Mounted> {
        fs::create_dir(&at).unwrap();
        let size = format!("size={kib}k");
        let tried =
            Command::new("mount").args(["-t", "tmpfs", "-o", &size, "tmpfs"]).arg(&at).output();
        if !tried.is_ok_and(|output| output.status.success()) {
            skip("mounting a file system is not permitted");
            return None;
        }
        Some(Mounted(at))
    }
}

impl Drop for Mounted {
    fn drop(&mut self) {
        let unmounted = Command::new("umount").arg(&self.0).status();
        assert!(unmounted.is_ok_and(|status| status.success()) || std::thread::panicking());
    }
}

#[test]
fn a_full_disk_is_said_and_the_old_index_stays() {
    let place = Place::new(30_000);
    let kib = place.new.len() / 1024;
    for size in [4, 16, kib - 8, kib + 40, 2 * kib + 200] {
        let Some(disk) = Mounted::new(place.aside.path().join(format!("{size}")), size) else {
            return;
        };
        let output = disk.0.join("out.pnti");
        for old in [None, Some(&place.old)] {
            if let Some(old) = old {
                if old.len() / 1024 + 8 > size {
                    continue;
                }
                fs::write(&output, old).unwrap();
            }
            let mut command = pointillist();
            command
                .current_dir(place.folder.path())
                .args(["index", "a.las", "--threads", "2", "-o"])
                .arg(&output)
                .args(place.found);
            let ended = command.output().unwrap();
            let there = fs::read(&output).ok();
            if ended.status.success() {
                assert!(size > kib && there.as_ref() == Some(&place.new), "{size}");
                fs::remove_file(&output).unwrap();
            } else {
                let said = failed(&ended, 1);
                assert!(said.contains("out.pnti") && said.contains("No space"), "{said}");
                assert!(there.as_ref() == old, "{size}: the old index is not what it was");
            }
            assert!(names(&disk.0).iter().all(|name| name == "out.pnti"), "{:?}", names(&disk.0));
        }
    }
}

#[test]
fn interrupted_it_leaves_nothing() {
    let place = Place::new(2_000_000);
    let began = Instant::now();
    succeeded(&place.command().output().unwrap());
    let whole = began.elapsed();
    for i in 0..9u32 {
        let before = if i % 2 == 0 { State::Absent } else { State::Old };
        place.set(before);
        let child = place.command().stderr(Stdio::piped()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(20) + whole * i / 9);
        // SAFETY: a system call; the child has not been waited for, so its id is its own.
        unsafe { libc::kill(child.id() as i32, SIGNALS[i as usize % SIGNALS.len()].0) };
        let since = Instant::now();
        let output = child.wait_with_output().unwrap();
        assert!(since.elapsed() < Duration::from_secs(5), "heeded after {:?}", since.elapsed());
        let what = format!("interrupted at {i}/9: {}", output.status);
        match output.status.code() {
            Some(0) => assert_eq!(place.state(&what), State::New),
            // Before the handler is installed the signal itself ends the process.
            None => assert_eq!(place.state(&what), before),
            code => {
                assert_eq!(
                    text(&output.stderr),
                    "pointillist: interrupted; nothing was left half written\n"
                );
                assert_eq!((code, place.state(&what)), (Some(130), before));
            }
        }
        println!("{what}");
        place.is_tidy(&what);
    }
}

#[test]
fn killed_at_random_times_it_leaves_old_new_or_nothing() {
    let place = Place::new(400_000);
    let began = Instant::now();
    succeeded(&place.command().output().unwrap());
    let whole = began.elapsed();
    for i in 0..30u32 {
        let before = if i % 2 == 0 { State::Absent } else { State::Old };
        place.set(before);
        let mut child = place.command().stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(whole * i / 28);
        child.kill().unwrap();
        child.wait().unwrap();
        let after = place.state("killed");
        assert!(after == before || after == State::New, "{before:?} became {after:?}");
    }
    place.recovers("killed");
}

#[test]
fn builders_at_once_all_end_and_leave_one_whole_index() {
    let place = Place::new(100_000);
    for _ in 0..6 {
        place.set(State::Absent);
        let all: Vec<_> =
            (0..4).map(|_| place.command().stderr(Stdio::piped()).spawn().unwrap()).collect();
        for child in all {
            succeeded(&child.wait_with_output().unwrap());
        }
        assert_eq!(place.state("four at once"), State::New);
        place.is_tidy("four at once");
    }
}

#[test]
fn a_folder_that_may_not_be_written_to_is_refused() {
    let place = Place::new(1000);
    fs::create_dir(place.folder.path().join("out.pnti.d")).unwrap();
    for output in ["out.pnti.d", "nowhere/out.pnti", "/proc/out.pnti", "/dev/null"] {
        let ended = pointillist()
            .current_dir(place.folder.path())
            .args(["index", "a.las", "-o", output])
            .output()
            .unwrap();
        let said = failed(&ended, 1);
        assert!(said.contains(output), "{said}");
    }
    assert_eq!(names(place.folder.path()), ["a.las", "out.pnti", "out.pnti.d"]);
}
