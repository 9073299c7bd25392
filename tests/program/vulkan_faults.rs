//! Whatever call of Vulkan fails, and wherever the device is lost, a run ends with one line and
//! exit code 1, or with the same picture; no object is left, which the validation layers would say
//! (guide: reliability).
//!
//! A layer between the program and Vulkan (`tests/support/faulty_layer.c`) counts the calls that
//! may fail, and lets the N-th do so. The tests go through all N.

#![cfg(target_os = "linux")]

use crate::faulty_layer::{self, Layer};
use crate::files::{names, scan};
use crate::program::{succeeded, text};
use pointillist::synth::SceneKind;
use std::collections::HashSet;
use std::fs;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// Longest time of a run on a busy machine, beyond which it hangs [s].
const LONGEST: &str = "60";

/// Fault at the N-th call.
#[derive(Clone, Copy, PartialEq)]
enum Fault {
    /// The call fails for lack of memory.
    Fails,
    /// The device is lost, of the calls that may say so.
    Loses,
}

/// A folder with a cloud, its index, and the layer.
struct Place(tempfile::TempDir);

impl Place {
    /// Makes the layer; `None` without a C compiler or Vulkan's headers.
    fn new() -> Option<Place> {
        let place = Place(tempfile::tempdir().unwrap());
        if !faulty_layer::build(place.0.path()) {
            return None;
        }
        scan(&place.path("a.las"), SceneKind::Street, 20_000);
        let mut index = crate::program::pointillist();
        index.current_dir(place.0.path()).args([
            "index",
            "a.las",
            "-o",
            "a.pnti",
            "--normals",
            "--strokes",
        ]);
        succeeded(&index.output().unwrap());
        Some(place)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Runs `render` with a fault at the N-th call, or without one. Returns the names of the calls
    /// that failed, or of all, and the picture if there is one.
    fn render(
        &self,
        line: &str,
        fault: Fault,
        at: Option<usize>,
    ) -> (Vec<String>, Option<Vec<u8>>) {
        let out = tempfile::tempdir_in(self.0.path()).unwrap();
        let (log, picture) = (self.path(&format!("{}.log", out.path().display())), "a.png");
        let mut command = Command::new("timeout");
        command.arg(LONGEST).arg(env!("CARGO_BIN_EXE_pointillist")).arg("render");
        command.args(line.split_whitespace()).args(["--size", "64x48", "--validate", "-o"]);
        command.arg(out.path().join(picture)).current_dir(self.0.path()).stdin(Stdio::null());
        command.env("RUST_BACKTRACE", "0").env("FAULT_LOG", &log);
        command.envs(faulty_layer::environment(self.0.path(), Layer::AboveValidation));
        if fault == Fault::Loses {
            command.env("FAULT_LOSES", "1");
        }
        if let Some(at) = at {
            command.env("FAULT_AT", at.to_string());
        }
        let output = command.output().unwrap();
        let calls = fs::read_to_string(&log).unwrap_or_default();
        let calls: Vec<String> = calls.lines().map(str::to_owned).collect();
        let what = format!("{line}: call {at:?}, {calls:?}");
        let said = text(&output.stderr);
        assert!(!said.contains("panicked") && !said.contains("Validation"), "{what}: {said}");
        let found = fs::read(out.path().join(picture)).ok();
        let left = names(out.path());
        match output.status.code() {
            Some(0) => assert_eq!(left, [picture], "{what}"),
            Some(1) => {
                assert!(left.is_empty(), "{what}: {left:?} were left");
                let is_one_line = said.trim_end().lines().count() == 1;
                assert!(is_one_line && said.starts_with("pointillist: "), "{what}: {said}");
            }
            _ => panic!("{what}: {}: {said}", output.status),
        }
        (calls, found)
    }

    /// Renders with a fault at every call that `wanted` picks from all calls, by their places.
    fn at_every(&self, line: &str, fault: Fault, wanted: impl Fn(&[String]) -> Vec<usize>) {
        let (calls, expected) = self.render(line, fault, None);
        assert!(expected.is_some(), "{line}");
        let wanted = wanted(&calls);
        let (next, same) = (AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
                scope.spawn(|| {
                    while let Some(&at) = wanted.get(next.fetch_add(1, Relaxed)) {
                        let (failed, found) = self.render(line, fault, Some(at + 1));
                        if found.is_some() {
                            assert!(found == expected, "{line}: {failed:?} at {at}");
                            same.fetch_add(1, Relaxed);
                        }
                    }
                });
            }
        });
        let same = same.into_inner();
        println!("{line}: {} of {} calls, {same} pictures", wanted.len(), calls.len());
        // A call that never fails is not counted.
        assert!(same < wanted.len());
    }
}

fn all(calls: &[String]) -> Vec<usize> {
    (0..calls.len()).collect()
}

/// Picks each call that follows its predecessor for the first time: the same lines of code make the
/// same calls for every pass.
fn first_of_kind(calls: &[String]) -> Vec<usize> {
    let mut seen = HashSet::new();
    (1..calls.len()).filter(|&at| seen.insert((&calls[at - 1], &calls[at]))).collect()
}

#[test]
fn every_call_of_a_picture_of_points_may_fail() {
    let Some(place) = Place::new() else { return };
    place.at_every("a.las --style points", Fault::Fails, all);
}

#[test]
fn every_kind_of_call_of_an_index_and_of_a_surface_may_fail() {
    let Some(place) = Place::new() else { return };
    for line in ["a.las", "a.pnti", "a.pnti --unmapped --style points", "a.pnti --style strokes"] {
        place.at_every(line, Fault::Fails, first_of_kind);
    }
}

#[test]
fn the_device_may_be_lost_at_every_call() {
    let Some(place) = Place::new() else { return };
    place.at_every("a.las --style points", Fault::Loses, all);
    place.at_every("a.pnti --unmapped --style points", Fault::Loses, all);
    place.at_every("a.las", Fault::Loses, first_of_kind);
}
