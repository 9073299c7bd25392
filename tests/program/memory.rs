//! Memory of the program does not grow with its input, or keeps to what it was given.

#![cfg(target_os = "linux")]

use crate::files::scan;
use crate::program::{pointillist, succeeded};
use e57::{E57Writer, Record, RecordValue};
use pointillist::synth::SceneKind;
use rayon::prelude::*;
use std::fs::File;
use std::io::{BufWriter, Write};
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

/// Writes points on a sheet to a file, whose format its name says.
fn sheet(path: &Path, points: u64) {
    let place = |i: u64| [i % 4001, i * 7919 % 3001, i % 17].map(|v| v as f64 / 100.0);
    let color = |i: u64| [i % 256, i % 7, 9];
    let mut file = BufWriter::new(File::create(path).unwrap());
    match path.extension().unwrap().to_str().unwrap() {
        "ply" => {
            writeln!(file, "ply\nformat binary_little_endian 1.0\nelement vertex {points}")
                .unwrap();
            for (kind, name) in ["x", "y", "z"]
                .map(|name| ("double", name))
                .into_iter()
                .chain(["red", "green", "blue"].map(|name| ("uchar", name)))
            {
                writeln!(file, "property {kind} {name}").unwrap();
            }
            writeln!(file, "end_header").unwrap();
            for i in 0..points {
                place(i).iter().for_each(|v| file.write_all(&v.to_le_bytes()).unwrap());
                file.write_all(&color(i).map(|v| v as u8)).unwrap();
            }
        }
        "csv" => {
            writeln!(file, "x,y,z,red,green,blue").unwrap();
            for i in 0..points {
                let ([x, y, z], [r, g, b]) = (place(i), color(i));
                writeln!(file, "{x:.5},{y:.5},{z:.5},{r},{g},{b}").unwrap();
            }
        }
        _ => {
            let mut writer = E57Writer::from_file(path, "file").unwrap();
            let prototype = vec![
                Record::CARTESIAN_X_F64,
                Record::CARTESIAN_Y_F64,
                Record::CARTESIAN_Z_F64,
                Record::COLOR_RED_U8,
                Record::COLOR_GREEN_U8,
                Record::COLOR_BLUE_U8,
            ];
            let mut scan = writer.add_pointcloud("scan", prototype).unwrap();
            for i in 0..points {
                let place = place(i).map(RecordValue::Double);
                let color = color(i).map(|v| RecordValue::Integer(v as i64));
                scan.add_point(place.into_iter().chain(color).collect()).unwrap();
            }
            scan.finalize().unwrap();
            writer.finalize().unwrap();
        }
    }
}

#[test]
fn info_of_large_files_of_other_formats_takes_no_more_memory_than_of_half_of_them() {
    let folder = tempfile::tempdir().unwrap();
    for (name, points) in
        [("large.ply", 3_000_000), ("large.csv", 2_500_000), ("large.e57", 3_000_000)]
    {
        let path = folder.path().join(name);
        let peaks = [points, 2 * points].map(|points| {
            sheet(&path, points);
            let (output, peak) = peak(pointillist().args(["info", "--json"]).arg(&path));
            succeeded(&output);
            let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
            assert_eq!(found["points"], points);
            println!("{name}, {points} points: {} MiB", peak / MIB);
            peak
        });
        assert!(peaks[1] < peaks[0] + 16 * MIB && peaks[1] < 200 * MIB, "{name}: {peaks:?}");
    }
}

#[test]
fn points_for_which_no_temporary_file_can_be_made_are_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.ply");
    sheet(&path, 3_000_000);
    let nowhere = folder.path().join("nowhere");
    let mut command = pointillist();
    let output = command.env("TMPDIR", &nowhere).arg("info").arg(&path).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    let place = nowhere.display().to_string();
    assert!(said.contains(&place) && said.contains("set TMPDIR to a folder"), "{said}");
    assert!(output.stdout.is_empty());
    // A compressed file is read again instead.
    let path = folder.path().join("large.laz");
    scan(&path, SceneKind::Street, 4_500_000);
    let info = |place: &Path| {
        let output = pointillist().env("TMPDIR", place).arg("info").arg(&path).output().unwrap();
        succeeded(&output);
        output.stdout
    };
    assert_eq!(info(&nowhere), info(folder.path()));
}

#[test]
fn memory_that_runs_out_leaves_no_partial_file() {
    let folder = tempfile::tempdir().unwrap();
    let some = folder.path().join("some.las");
    scan(&some, SceneKind::Street, 100_000);
    for (command, output) in [("index", "out.pnti"), ("export", "out.laz")] {
        let run = |mebibytes: u64, words: &[&str]| {
            let limited = format!("ulimit -v {}; exec \"$0\" \"$@\"", mebibytes * 1024);
            let mut shell = Command::new("sh");
            let program = pointillist().get_program().to_owned();
            shell.arg("-c").arg(limited).arg(program).args(words).current_dir(folder.path());
            shell.env_remove("RUST_BACKTRACE").output().unwrap()
        };
        let words = [command, "some.las", "-o", output];
        let mut ran_out = 0;
        // Libraries take address space before the program begins.
        let least = (40..).step_by(4).find(|&own| run(own, &["--version"]).status.success());
        // Some limits are enough while larger ones are not: threads take address space in leaps.
        for mebibytes in (least.unwrap()..).step_by(8).take(32) {
            let ended = run(mebibytes, &words);
            let said = String::from_utf8_lossy(&ended.stderr).into_owned();
            let path = folder.path().join(output);
            if ended.status.success() {
                std::fs::remove_file(path).unwrap();
                continue;
            }
            assert_eq!(ended.status.code(), Some(1), "{command}, {mebibytes} MiB: {said}");
            assert!(said.contains("pointillist: "), "{command}, {mebibytes} MiB: {said}");
            ran_out += said.contains("pointillist: aborted") as u64;
            assert_eq!(crate::files::names(folder.path()), ["some.las"], "{said}");
        }
        println!("{command}: memory ran out {ran_out} times");
        assert!(ran_out > 0, "{command}");
    }
}

/// A file of more points than are painted whole is indexed first, and painted from the nodes of the
/// view.
#[test]
fn strokes_of_many_points_are_painted_from_a_cut() {
    let place = tempfile::tempdir().unwrap();
    let cloud = place.path().join("many.las");
    let points = pointillist::config::WHOLE_STROKES + 1;
    scan(&cloud, SceneKind::Street, points);
    let mut index = pointillist();
    index.current_dir(place.path()).args(["index", "many.las", "-o", "many.pnti"]);
    succeeded(&index.output().unwrap());
    let pictures = ["many.las", "many.pnti"].map(|name| {
        let mut command = pointillist();
        command.current_dir(place.path()).args(["render", name, "--style", "strokes"]);
        command.args(["--size", "160x120", "--no-cache", "-o", "a.png"]);
        let (output, peak) = peak(&mut command);
        let said = succeeded(&output);
        let why = format!("{points} points are more than are painted as strokes without an index");
        assert_eq!(said.contains(&why), name == "many.las", "{said}");
        println!("{name}: {} MiB", peak / MIB);
        // Whole, they would take 1.3 GB.
        assert!(peak < 600 * MIB, "{name}: {} MiB", peak / MIB);
        std::fs::read(place.path().join("a.png")).unwrap()
    });
    assert!(pictures[0] == pictures[1]);
}

/// Least size of allocations that fail one by one [bytes]. Systems that overcommit grant smaller
/// ones from what a process has.
const LARGE: &str = "65536";

/// Each large allocation of the program fails once, those of the driver apart
/// (`tests/support/failing_allocator.c`).
#[test]
fn every_large_allocation_may_fail() {
    let place = tempfile::tempdir().unwrap();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/support/failing_allocator.c");
    let library = place.path().join("liballocator.so");
    let compiler = std::env::var("CC").unwrap_or("cc".into());
    let mut build = Command::new(&compiler);
    build.args(["-std=c11", "-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-o"]);
    let Ok(built) = build.arg(&library).arg(source).output() else {
        return crate::skip::skip(&format!("{compiler} is missing"));
    };
    succeeded(&built);
    let cloud = place.path().join("some.las");
    scan(&cloud, SceneKind::Street, 5000);
    for (line, result) in [
        ("index --strokes", "out.pnti"),
        ("render --size 64x48", "out.png"),
        ("render --size 64x48 --style strokes", "out.png"),
    ] {
        let run = |at: usize| {
            let folder = tempfile::tempdir_in(place.path()).unwrap();
            let log = folder.path().with_extension("log");
            let mut command = pointillist();
            command.args(line.split_whitespace()).arg(&cloud).args(["-o", result]);
            command.current_dir(folder.path()).env("LD_PRELOAD", &library);
            command.env("FAULT_AT", at.to_string()).env("FAULT_BYTES", LARGE);
            let output = command.env("FAULT_LOG", &log).output().unwrap();
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            let left = crate::files::names(folder.path());
            match output.status.code() {
                Some(0) => assert_eq!(left, [result], "{line}, {at}: {said}"),
                Some(1) => {
                    assert!(left.is_empty(), "{line}, {at}: {left:?} were left; {said}");
                    let last = said.trim_end().lines().last().unwrap_or_default();
                    assert!(last.starts_with("pointillist: "), "{line}, {at}: {said}");
                    assert!(!said.contains("panicked"), "{line}, {at}: {said}");
                }
                _ => panic!("{line}, {at}: {}: {said}", output.status),
            }
            let calls = std::fs::read_to_string(log).ok().map(|text| text.trim().parse().unwrap());
            (calls, output.status.success())
        };
        let (calls, _) = run(0);
        let calls: usize = calls.expect("the library is preloaded");
        let failed = (1..=calls).into_par_iter().filter(|&at| !run(at).1).count();
        println!("{line}: {failed} of {calls} allocations that fail end the program");
        assert!(calls > 20 && failed > calls / 2, "{line}: {failed} of {calls}");
    }
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
