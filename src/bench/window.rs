//! `bench window`: a scripted flight in a window: evenness of frames, time to the first picture,
//! and idle cost.
//!
//! Clouds are the street of `synth`, read from a file, and an index, of which the loader reads what
//! the flight needs. Each run is a process of its own, so that start and processor time are its
//! own. A display is needed. The camera follows paths: through the street on foot and back, and
//! through an index down to places spread over it and up again. A straight path soon leaves any
//! cloud; frames without a point are counted, since their times mean nothing.

use super::flight;
use crate::app::frame_stats::{FlightSummary, Spread, Summary};
use crate::error::{Error, Result};
use crate::index::format::Index;
use crate::progress::Progress;
use crate::synth::{self, LasFile, SceneKind};
use crate::view::camera_path::CameraPath;
use crate::view::{Camera, Projection};
use glam::DVec3;
use serde::Serialize;
use std::ffi::OsString;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Options of the benchmark.
pub struct Plan {
    /// Points of the street.
    pub points: Vec<u64>,
    /// A further index.
    pub index: Option<PathBuf>,
    pub sizes: Vec<[u32; 2]>,
    /// Duration of each flight `[s]`.
    pub seconds: u64,
    /// Further arguments of `view`: device, pool, budget.
    pub options: Vec<OsString>,
    pub seed: u64,
    /// Folder of inputs.
    pub folder: PathBuf,
}

/// The results of a flight.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    pub bench: &'static str,
    /// `street`, or the index's file name.
    pub cloud: String,
    pub points: u64,
    pub size: String,
    #[serde(flatten)]
    pub summary: Summary,
}

pub fn run(plan: &Plan, progress: &dyn Progress) -> Result<Vec<Row>> {
    // Removed with its contents.
    let folder = plan.folder.join(format!("pointillist-bench-{}-window", std::process::id()));
    std::fs::create_dir(&folder).map_err(|error| Error::io("create", &folder, error))?;
    let rows = measure(plan, &folder, progress);
    std::fs::remove_dir_all(&folder).map_err(|error| Error::io("remove", &folder, error))?;
    rows
}

fn measure(plan: &Plan, folder: &Path, progress: &dyn Progress) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    let mut flights = 0;
    let total = (plan.points.len() + plan.index.iter().len()) * plan.sizes.len();
    let written = folder.join("path.json");
    let mut fly = |cloud: &str, points: u64, file: &Path, cameras: &[Camera], size: [u32; 2]| {
        progress.tick("bench window", flights, total as u64)?;
        flights += 1;
        let mut path = CameraPath::default();
        cameras.iter().for_each(|&camera| path.add(camera));
        path.write(&written)?;
        let size = format!("{}x{}", size[0], size[1]);
        let mut words: Vec<OsString> =
            ["view", "--timings=json", "--no-cache", "--size", &size].map(OsString::from).into();
        words.extend(["--flight".into(), plan.seconds.to_string().into()]);
        words.extend(["--path".into(), written.clone().into()]);
        words.extend(plan.options.clone());
        words.push(file.into());
        rows.push(Row {
            bench: "window",
            cloud: cloud.into(),
            points,
            size,
            summary: view(&words, folder)?,
        });
        Ok(())
    };
    for &points in &plan.points {
        let file = folder.join(format!("street-{points}.las"));
        let world = synth::build(SceneKind::Street, plan.seed, 0.0);
        let mut las = LasFile::create(&file, world.lattice(), points)?;
        synth::scan(
            &world,
            points,
            plan.seed,
            SceneKind::Street.default_noise(),
            &mut |chunk| las.write(chunk),
            progress,
        )?;
        las.finish()?;
        plan.sizes
            .iter()
            .try_for_each(|&size| fly("street", points, &file, &on_foot(world.camera()), size))?;
    }
    if let Some(file) = &plan.index {
        let index = Index::open(file)?;
        if index.nodes().is_empty() {
            return Err(Error::format(file, "has no points"));
        }
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        for &size in &plan.sizes {
            fly(&name, index.directory.contents.points, file, &flight::stops(&index, size)?, size)?;
        }
    }
    Ok(rows)
}

/// Returns cameras along the street to a pedestrian's target and back, so that the path can repeat.
fn on_foot(viewpoint: synth::Viewpoint) -> Vec<Camera> {
    let way = (viewpoint.target - viewpoint.eye).with_z(0.0);
    let at = |share: f64| {
        let [eye, target] = [viewpoint.eye, viewpoint.target].map(|place| place + share * way);
        Camera {
            eye,
            target,
            up: DVec3::Z,
            fov_y: viewpoint.fov_y,
            projection: Projection::Perspective,
            ortho_height: None,
        }
    };
    [0.0, 0.4, 0.8, 0.4, 0.0].map(at).into()
}

fn view(words: &[OsString], state: &Path) -> Result<Summary> {
    let failed = |what: String| Error::Request(format!("the measured window failed: {what}"));
    let program = std::env::current_exe().map_err(|error| failed(error.to_string()))?;
    let done = Command::new(program)
        .args(words)
        .env("XDG_STATE_HOME", state)
        .output()
        .map_err(|error| failed(error.to_string()))?;
    if !done.status.success() {
        return Err(failed(String::from_utf8_lossy(&done.stderr).trim().to_string()));
    }
    serde_json::from_slice(&done.stdout).map_err(|error| failed(error.to_string()))
}

/// Formats the flights as a table.
pub fn table(rows: &[Row]) -> String {
    let mut text = String::new();
    let ms = |time: Option<f64>| time.map_or("never".to_string(), |ms| format!("{ms:.0} ms"));
    for Row { cloud, points, size, summary, .. } in rows {
        let Some(flight) = &summary.flight else { continue };
        let FlightSummary {
            pictures,
            empty,
            frame_ms,
            latency_ms,
            drawing_ms,
            loading,
            loading_ms,
            took_in_ms,
            loader_ms,
            slow,
            slow_loading,
            slow_for_loader,
            ..
        } = flight;
        writeln!(
            text,
            "{cloud}, {points} points, {size}: {pictures} pictures, {empty} of them without a point"
        )
        .expect("writing to a string");
        let times = [
            ("frame", frame_ms),
            ("of which loading", loading_ms),
            ("camera to picture", latency_ms),
            ("of that, drawing", drawing_ms),
            ("taking nodes in", took_in_ms),
            ("the loader's part", loader_ms),
        ];
        for (name, Spread { median, p99, worst }) in times {
            writeln!(
                text,
                "  {name:<18} median {median:>8.1} ms   99 % {p99:>8.1} ms   worst {worst:>8.1} ms"
            )
            .expect("writing to a string");
        }
        writeln!(
            text,
            "  start to first picture {}, to the whole one {}; standing still to the whole one {}",
            ms(summary.first_ms),
            ms(summary.first_whole_ms),
            ms(flight.to_whole_ms)
        )
        .expect("writing to a string");
        writeln!(
            text,
            "  {loading} pictures while nodes were on their way; {slow} frames over twice the median{}, {slow_loading} of them then, {slow_for_loader} that might not be without the loader; at rest, {:.0} ms: {} pictures, {} of processor time",
            if *slow > 0 { format!(" (by {})", flight.causes()) } else { String::new() },
            flight.rest_ms,
            flight.rest_pictures,
            ms(flight.rest_cpu_ms)
        )
        .expect("writing to a string");
    }
    if let Some(row) = rows.first() {
        writeln!(text, "device: {}", row.summary.device).expect("writing to a string");
    }
    text
}
