//! `bench index`: the speed of indexing, relative to reading the input and writing the output
//! alone.
//!
//! Input is the street of `synth`, as LAS or LAZ. Each round reads alone (streams every point,
//! keeps none), indexes (in a process of its own, to measure its peak memory), and writes alone
//! (the same number of bytes in pieces of 1 MiB). The input is read once before, so it lies in the
//! system's cache as far as it fits. The output is a new file each time: freeing the pages of a
//! replaced index takes the system 0.1 s for 20 million points, and is not part of indexing.

use super::quartiles;
use crate::cloud::stream;
use crate::cloud::{ColumnSet, ReadOptions};
use crate::error::{Error, Result};
use crate::index::build::Summary;
use crate::progress::Progress;
use crate::synth::{self, LasFile, SceneKind};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// Options of the benchmark.
pub struct Plan {
    pub points: Vec<u64>,
    pub laz: bool,
    pub seed: u64,
    pub repeat: usize,
    /// Memory as for `index --memory`.
    pub memory: String,
    /// Folder of input and output.
    pub folder: PathBuf,
}

/// The results of a cloud. Times are medians over the rounds.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Row {
    pub points: u64,
    pub format: String,
    pub seconds: f64,
    pub seconds_q1: f64,
    pub seconds_q3: f64,
    pub mpts_per_s: f64,
    /// Bytes per point of position, colour, intensity and class, including weights of inner nodes;
    /// and of the whole file.
    pub bytes_per_point: f64,
    pub file_bytes_per_point: f64,
    pub peak_mib: f64,
    /// Memory that grows with the cloud, per point.
    pub held_bytes_per_point: f64,
    pub read_seconds: f64,
    pub write_seconds: f64,
    pub spilled_mib: f64,
    pub nodes: usize,
    pub n: usize,
}

pub fn run(plan: &Plan, progress: &dyn Progress) -> Result<Vec<Row>> {
    plan.points.iter().map(|&points| measure(plan, points, progress)).collect()
}

/// Files of a round, removed when dropped.
struct Scratch(Vec<PathBuf>);

impl Drop for Scratch {
    fn drop(&mut self) {
        self.0.iter().for_each(|path| drop(std::fs::remove_file(path)));
    }
}

fn measure(plan: &Plan, points: u64, progress: &dyn Progress) -> Result<Row> {
    let format = if plan.laz { "laz" } else { "las" };
    let at =
        |name: &str| plan.folder.join(format!("pointillist-bench-{}-{name}", std::process::id()));
    let (input, output, copy) = (at(&format!("street.{format}")), at("street.pnti"), at("copy"));
    let _scratch = Scratch(vec![input.clone(), output.clone(), copy.clone()]);
    let world = synth::build(SceneKind::Street, plan.seed, 0.0);
    let mut file = LasFile::create(&input, world.lattice(), points)?;
    synth::scan(
        &world,
        points,
        plan.seed,
        SceneKind::Street.default_noise(),
        &mut |chunk| file.write(chunk),
        progress,
    )?;
    file.finish()?;
    read_alone(&input, progress)?;
    let (mut seconds, mut reads, mut writes) = (Vec::new(), Vec::new(), Vec::new());
    let mut last = Summary::default();
    for round in 0..plan.repeat {
        progress.tick(&format!("bench index {points} points"), round as u64, plan.repeat as u64)?;
        reads.push(read_alone(&input, progress)?);
        // From the round before.
        let _ = std::fs::remove_file(&output);
        last = index(&input, &output, &plan.memory)?;
        seconds.push(last.seconds);
        writes.push(write_alone(&copy, last.bytes)?);
    }
    let median = |times: &mut Vec<f64>| quartiles(times)[1];
    let [seconds_q1, seconds, seconds_q3] = quartiles(&mut seconds);
    Ok(Row {
        points,
        format: format.into(),
        seconds,
        seconds_q1,
        seconds_q3,
        mpts_per_s: points as f64 / seconds / 1e6,
        bytes_per_point: last.core_bytes as f64 / points as f64,
        file_bytes_per_point: last.bytes as f64 / points as f64,
        peak_mib: last.peak_mib,
        held_bytes_per_point: last.held_bytes_per_point,
        read_seconds: median(&mut reads),
        write_seconds: median(&mut writes),
        spilled_mib: last.spilled_bytes as f64 / (1 << 20) as f64,
        nodes: last.nodes,
        n: plan.repeat,
    })
}

/// Reads and decodes every point and keeps none.
fn read_alone(input: &Path, progress: &dyn Progress) -> Result<f64> {
    let began = Instant::now();
    let options = ReadOptions::new(ColumnSet { gps_time: false, ..ColumnSet::ALL }, false);
    for source in stream::open(&[input.to_owned()], &options, progress, &mut Vec::new())? {
        source.stream(progress, &|_| Ok(()))?;
    }
    Ok(began.elapsed().as_secs_f64())
}

fn index(input: &Path, output: &Path, memory: &str) -> Result<Summary> {
    let failed = |what: String| {
        Error::Request(format!("the process indexing {} failed: {what}", input.display()))
    };
    let program = std::env::current_exe().map_err(|error| failed(error.to_string()))?;
    let done = Command::new(program)
        .arg("index")
        .arg(input)
        .arg("-o")
        .arg(output)
        .args(["--json", "--memory", memory])
        .output();
    let done = done.map_err(|error| failed(error.to_string()))?;
    if !done.status.success() {
        return Err(failed(String::from_utf8_lossy(&done.stderr).trim().to_string()));
    }
    serde_json::from_slice(&done.stdout).map_err(|error| failed(error.to_string()))
}

fn write_alone(path: &Path, bytes: u64) -> Result<f64> {
    let piece = vec![0x5A; 1 << 20];
    let began = Instant::now();
    let write = || {
        let mut file = File::create(path)?;
        let mut left = bytes;
        while left > 0 {
            let now = left.min(piece.len() as u64);
            file.write_all(&piece[..now as usize])?;
            left -= now;
        }
        file.sync_all()
    };
    write().map_err(|error| Error::io("write", path, error))?;
    Ok(began.elapsed().as_secs_f64())
}

/// Formats the rows as a table.
pub fn table(rows: &[Row]) -> String {
    let mut text = String::from(
        "    points  format  seconds       q1       q3  M points/s  bytes a point  whole file  peak MiB  held a point  spilled MiB  read alone s  write alone s\n",
    );
    for row in rows {
        text += &format!(
            "{:>10}  {:<6} {:>8.2} {:>8.2} {:>8.2} {:>11.2} {:>14.2} {:>11.2} {:>9.0} {:>13.4} {:>12.0} {:>13.2} {:>14.2}\n",
            row.points,
            row.format,
            row.seconds,
            row.seconds_q1,
            row.seconds_q3,
            row.mpts_per_s,
            row.bytes_per_point,
            row.file_bytes_per_point,
            row.peak_mib,
            row.held_bytes_per_point,
            row.spilled_mib,
            row.read_seconds,
            row.write_seconds
        );
    }
    text
}
