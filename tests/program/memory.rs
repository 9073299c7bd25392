//! Memory of the program does not grow with its input, or keeps to what it was given.

#![cfg(target_os = "linux")]

use crate::files::scan;
use crate::program::{pointillist, succeeded};
use pointillist::synth::SceneKind;
use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Output};

/// Runs the program. Returns the most memory that it had [bytes], as the system counts.
fn peak(command: &mut Command) -> (Output, u64) {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let mut child = command
        .stdout(File::create(file("out")).unwrap())
        .stderr(File::create(file("said")).unwrap())
        .spawn()
        .unwrap();
    // SAFETY: all zeros is a value of it.
    let mut usage: libc::rusage = unsafe { std::mem::zeroed() };
    let mut status = 0;
    // SAFETY: a system call; both places are alive, and the child is waited for here only.
    let waited = unsafe { libc::wait4(child.id() as i32, &mut status, 0, &mut usage) };
    assert_eq!(waited, child.id() as i32);
    // It has been waited for: this fails, and reaps nothing else.
    let _ = child.try_wait();
    let read = |name: &str| std::fs::read(file(name)).unwrap();
    let status = std::os::unix::process::ExitStatusExt::from_raw(status);
    let output = Output { status, stdout: read("out"), stderr: read("said") };
    (output, usage.ru_maxrss as u64 * 1024)
}

/// Writes a LAS file of many points: those of another one again and again, or only its first.
fn repeated(from: &Path, to: &Path, points: u64, one: bool) {
    let bytes = std::fs::read(from).unwrap();
    let at = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
    let record = u16::from_le_bytes(bytes[105..107].try_into().unwrap()) as usize;
    assert!(bytes[25] < 4, "a file of LAS 1.4 has another count");
    let (mut head, records) = (bytes[..at].to_vec(), &bytes[at..]);
    head[107..111].copy_from_slice(&(points as u32).to_le_bytes());
    let records = if one { records[..record].repeat(100_000) } else { records.to_vec() };
    let mut file = File::create(to).unwrap();
    file.write_all(&head).unwrap();
    let (mut left, each) = (points as usize, records.len() / record);
    while left > 0 {
        file.write_all(&records[..left.min(each) * record]).unwrap();
        left -= left.min(each);
    }
}

const MIB: u64 = 1 << 20;

#[test]
fn info_of_a_large_file_takes_no_more_memory_than_of_half_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let [some, large] = ["some.las", "large.las"].map(|name| folder.path().join(name));
    scan(&some, SceneKind::Street, 300_000);
    let peaks = [4_500_000, 9_000_000].map(|points| {
        repeated(&some, &large, points, false);
        let (output, peak) = peak(pointillist().args(["info", "--json"]).arg(&large));
        succeeded(&output);
        let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(found["points"], points);
        assert_eq!(found["parts"][0]["points"], points);
        println!("{points} points: {} MiB", peak / MIB);
        peak
    });
    // Columns of nine million points are twice as much.
    assert!(peaks[1] < peaks[0] + 16 * MIB && peaks[1] < 200 * MIB, "{peaks:?}");
}

#[test]
fn an_index_of_coincident_points_keeps_to_its_memory() {
    let folder = tempfile::tempdir().unwrap();
    let [some, large] = ["some.las", "large.las"].map(|name| folder.path().join(name));
    scan(&some, SceneKind::Street, 1000);
    let peaks = [2_000_000, 4_000_000].map(|points| {
        repeated(&some, &large, points, true);
        let mut command = pointillist();
        command.args(["index", "--memory", "64MiB"]).arg(&large).arg("-o");
        let (output, peak) = peak(command.arg(folder.path().join("large.pnti")));
        succeeded(&output);
        println!("{points} points: {} MiB", peak / MIB);
        peak
    });
    // The program itself, and what is not counted, is about as much again.
    assert!(peaks[1] < peaks[0] + 16 * MIB && peaks[1] < 160 * MIB, "{peaks:?}");
}
