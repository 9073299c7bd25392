//! Malformed, hostile and odd files through the program itself: a picture of what is readable, with
//! a note that counts the rest, or one line and exit code 1; within a second or two, and in bounded
//! memory (guide: reliability).

use crate::png_file::read_png;
use crate::program::{failed, pointillist, succeeded, text};
use crate::shared::shared;
use std::io::{Read, Seek};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

const SIZE: &str = "320x180";
/// Longest time beyond that of drawing an empty cloud.
const TIME: Duration = Duration::from_secs(2);
const MEMORY: u64 = 256 << 20;

/// Files that lose points, and a text that the note must contain.
const LOST: &[(&str, &str)] = &[
    ("ply_inf_coordinates.ply", "3 points"),
    ("d_las_count_times_10.las", "2732 could be read"),
    ("d_las_cut_mid_record.las", "1261 could be read"),
    ("d_laz_cut_at_60pct.laz", "header declares 110000 points"),
    ("d_ply_cut_in_vertices.ply", "header declares 64365 points"),
];

/// Files of which nothing can be shown.
const REFUSED: &[&str] = &[
    "e57_bad_crc.e57",
    "empty.ply",
    "las_no_points_but_count_1065.las",
    "ply_empty_header.ply",
    "ply_truncated_header_crash.ply",
    "ply_unsized_types_order.ply",
    "d_las_scale_zero.las",
];

fn files() -> Vec<PathBuf> {
    let Some(folder) = shared("bad") else { return Vec::new() };
    let list = |folder: &Path| {
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect::<Vec<_>>()
    };
    let mut files = [list(&folder), list(&folder.join("derived"))].concat();
    files.retain(|path| {
        path.is_file() && path.extension().is_none_or(|extension| extension != "md")
    });
    files.sort();
    assert!(files.len() >= 36, "{} files", files.len());
    files
}

fn draw(file: &Path, picture: &Path) -> Cost {
    let mut command = pointillist();
    command.arg("render").arg(file).args(["--size", SIZE, "-o"]).arg(picture);
    watch(command, Duration::from_secs(60))
}

/// Cost of a run.
pub struct Cost {
    pub output: Output,
    /// Processor time. Waiting on a busy machine does not count.
    pub time: Duration,
    /// Largest resident size [bytes], if the system reports it.
    pub peak: Option<u64>,
}

/// Runs a command and watches it. The kernel's high-water mark is read until the process is gone.
/// Only growth within the last millisecond is missed.
pub fn watch(mut command: Command, limit: Duration) -> Cost {
    // Files take any amount. A pipe that is not read would stop its writer.
    let [mut out, mut err] = [(); 2].map(|()| tempfile::tempfile().expect("a temporary file"));
    command.stdout(out.try_clone().unwrap()).stderr(err.try_clone().unwrap());
    let began = Instant::now();
    let mut child = command.spawn().expect("start the program");
    let [memory, worked] = ["status", "stat"].map(|file| format!("/proc/{}/{file}", child.id()));
    let (mut peak, mut time) = (None, Duration::ZERO);
    let status = loop {
        if let Some(done) = child.try_wait().expect("wait for the program") {
            break done;
        }
        peak = peak.max(high_water(&memory));
        time = time.max(processor_time(&worked).unwrap_or_default());
        if began.elapsed() > limit {
            child.kill().expect("end the program");
            panic!("{command:?} still ran after {limit:?}");
        }
        std::thread::sleep(Duration::from_millis(1));
    };
    let contents = |file: &mut std::fs::File| {
        let mut bytes = Vec::new();
        file.rewind().and_then(|()| file.read_to_end(&mut bytes)).expect("its output");
        bytes
    };
    Cost {
        output: Output { status, stdout: contents(&mut out), stderr: contents(&mut err) },
        time,
        peak,
    }
}

/// Returns the processor time of user and system, which the kernel counts in hundredths of a
/// second.
fn processor_time(stat: &str) -> Option<Duration> {
    let stat = std::fs::read_to_string(stat).ok()?;
    // The name in parentheses may hold anything.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks: u64 =
        [11, 12].iter().map(|&at| fields.get(at)?.parse::<u64>().ok()).sum::<Option<u64>>()?;
    Some(Duration::from_millis(10 * ticks))
}

fn high_water(status: &str) -> Option<u64> {
    let status = std::fs::read_to_string(status).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok()? * 1024)
}

#[test]
fn bad_files_end_in_a_picture_or_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let empty = folder.path().join("empty.ply");
    let header = "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    std::fs::write(&empty, header).unwrap();
    let baseline: Vec<Cost> =
        (0..3).map(|_| draw(&empty, &folder.path().join("empty.png"))).collect();
    baseline.iter().for_each(|cost| drop(succeeded(&cost.output)));
    let start = baseline.iter().map(|cost| cost.time).max().unwrap();
    let memory = baseline.iter().filter_map(|cost| cost.peak).max();

    for file in files() {
        let name = file.file_name().unwrap().to_str().unwrap();
        let picture = folder.path().join("picture.png");
        let cost = draw(&file, &picture);
        let said = text(&cost.output.stderr);
        println!("{name}: {:?}, {} MiB: {said}", cost.time, cost.peak.unwrap_or(0) >> 20);
        if REFUSED.contains(&name) {
            failed(&cost.output, 1);
            assert!(!picture.exists(), "{name}: a picture of nothing");
        } else {
            succeeded(&cost.output);
            assert_eq!(read_png(&picture).size, [320, 180], "{name}");
            std::fs::remove_file(&picture).unwrap();
        }
        if let Some((_, count)) = LOST.iter().find(|(lost, _)| *lost == name) {
            assert!(
                said.contains("note: ") && said.contains(count),
                "{name}: no word of {count:?}: {said}"
            );
        }
        assert!(
            cost.time < start + TIME,
            "{name} took {:?}, and an empty cloud {start:?}",
            cost.time
        );
        if let (Some(peak), Some(memory)) = (cost.peak, memory) {
            assert!(
                peak < memory + MEMORY,
                "{name} took {} MiB, and an empty cloud {}",
                peak >> 20,
                memory >> 20
            );
        }
    }
}

#[test]
fn info_describes_or_refuses_the_same_files() {
    for file in files() {
        let name = file.file_name().unwrap().to_str().unwrap();
        let mut command = pointillist();
        command.args(["info", "--json"]).arg(&file);
        let cost = watch(command, Duration::from_secs(60));
        if REFUSED.contains(&name) {
            failed(&cost.output, 1);
            continue;
        }
        succeeded(&cost.output);
        let report: serde_json::Value = serde_json::from_slice(&cost.output.stdout)
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(report["points"].is_u64(), "{name}: {report}");
        if let Some((_, count)) = LOST.iter().find(|(lost, _)| *lost == name) {
            assert!(report["notes"].to_string().contains(count), "{name}: {}", report["notes"]);
        }
        assert!(cost.time < TIME, "{name} took {:?}", cost.time);
    }
}

#[test]
fn strictness_refuses_what_lost_points() {
    let Some(derived) = shared("bad/derived") else { return };
    for name in [
        "d_las_count_times_10.las",
        "d_las_cut_mid_record.las",
        "d_laz_cut_at_60pct.laz",
        "d_ply_cut_in_vertices.ply",
    ] {
        let folder = tempfile::tempdir().unwrap();
        let picture = folder.path().join("p.png");
        let output = pointillist()
            .arg("render")
            .arg(derived.join(name))
            .arg("--strict")
            .arg("-o")
            .arg(&picture)
            .output()
            .unwrap();
        failed(&output, 1);
        assert!(!picture.exists(), "{name}");
    }
}
