//! Study `index`: accuracy of positions by plane, and of the samples of inner nodes.
//!
//! The parameter is the number of position planes read of every leaf: 10, 20, all bits. The
//! reference is the file's own lattice coordinates, exactly: the leaves' points and the file's
//! points are sorted alike and compared one by one, in f64 from differences of integers, so that
//! all planes must give exactly 0. Pixel errors are displacements of drawn points in the views of
//! `precision`, over the visible points. The time is that of copying the planes out of the file and
//! checking them.
//!
//! The samples of an inner node and the points below it are both in Morton order and weights are
//! conserved, so each sample stands for the next `weight` points of that order; its reference is
//! their mean in f64.

use super::oracle::project::relative;
use super::precision::{cameras, finest_step};
use super::report::{self, Section, Table};
use super::scan::Scan;
use super::{Plan, Row, mark_fronts, metrics, sweep};
use crate::cloud::Lattice;
use crate::config::BITS_PER_PLANE;
use crate::error::Result;
use crate::graph::Gpu;
use crate::index::format::morton;
use crate::index::format::{Index, PLANES, Plane};
use crate::progress::Progress;
use crate::synth::SceneKind;
use crate::view::View;
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;
use std::time::Instant;

pub const SUMMARY: &str =
    "what an index keeps of positions: error and bytes of each plane, and of inner nodes";

const SCENES: [(&str, SceneKind); 3] =
    [("sphere", SceneKind::Sphere), ("street", SceneKind::Street), ("terrain", SceneKind::Terrain)];

/// Number of position planes read, ten bits each.
const SETTINGS: [(&str, u32); 3] = [("10", 1), ("20", 2), ("all", 3)];

/// Metric, its unit for axes, and its description; errors in pixels belong to a view, the others to
/// the cloud.
const METRICS: [(&str, &str, &str); 5] = [
    ("m_max", "largest error, metres", "Metres: the point farthest from where the file has it"),
    ("m_rms", "RMS error, metres", "Metres: root mean square over all points"),
    ("bytes_point", "bytes a point", "Bytes of positions a point, which are a cost, not an error"),
    (
        "px_max",
        "largest error, pixels",
        "Pixels: the point farthest from where the file has it, of those that the view shows",
    ),
    ("px_rms", "RMS error, pixels", "Pixels: root mean square over the points that the view shows"),
];

/// View name of metrics of the cloud.
const NO_VIEW: &str = "any";

pub fn run(_: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    let mut rows = Vec::new();
    let mut planes = table(
        "Planes of the whole index, inner nodes too",
        &["scene", "plane", "MiB", "bytes a point of the file"],
    );
    let mut levels = table(
        "Inner nodes by level",
        &[
            "scene",
            "level",
            "nodes",
            "samples",
            "points a sample",
            "cells, mm (least to largest)",
            "RMS distance from the mean, mm",
            "in cells",
            "largest, in cells",
        ],
    );
    for (done, (name, scene)) in SCENES.into_iter().enumerate() {
        progress.tick("study index", done as u64, SCENES.len() as u64)?;
        let mut scan = Scan::new(scene, finest_step, plan.points, plan.seed, progress)?;
        let points = leaves(&scan.index)?;
        scan.source.sort_unstable();
        let lattice =
            Lattice { step: DVec3::splat(scan.world.step), offset: scan.world.lattice().offset };
        let times = sweep::interleaved(&SETTINGS, plan.repeat, |&(_, planes)| {
            progress.tick("study index", done as u64, SCENES.len() as u64)?;
            read(&scan.index, planes)
        })?;
        let mut add = |view: &'static str, errors: &[(usize, f64)], k: usize| {
            rows.extend(errors.iter().map(|&(metric, error)| Row {
                scene: name,
                view,
                parameter: "bits",
                value: SETTINGS[k].0.into(),
                metric: METRICS[metric].0,
                error,
                ms: metrics::quartiles(&times[k]),
                n: times[k].len(),
                auto: SETTINGS[k].0 == "all",
                front: false,
            }));
        };
        for (k, (_, planes)) in SETTINGS.into_iter().enumerate() {
            let metres =
                metrics::errors(moved(&scan, &points, planes).map(|(_, moved)| moved.length()));
            add(
                NO_VIEW,
                &[(0, metres.max), (1, metres.rms), (2, bytes_per_point(&scan.index, planes))],
                k,
            );
        }
        for (view_name, camera) in cameras(&scan.world) {
            let view = View::new(camera, plan.size)?;
            for (k, (_, planes)) in SETTINGS.into_iter().enumerate() {
                let px = metrics::errors(
                    moved(&scan, &points, planes)
                        .filter_map(|(source, moved)| pixels(&view, &lattice, source, moved)),
                );
                add(view_name, &[(3, px.max), (4, px.rms)], k);
            }
        }
        planes.rows.extend(plane_rows(name, &scan.index));
        levels.rows.extend(level_rows(name, &scan.index, &points)?);
    }
    mark_fronts(&mut rows);
    let label =
        |row: &Row| if row.auto { row.value.clone() } else { format!("{} bits", row.value) };
    let chart = |&(metric, y_axis, caption): &_| {
        let x_axis = "milliseconds to read and check the planes of all leaves";
        report::chart(metric, [x_axis, y_axis], caption, &rows, &label)
    };
    let charts = METRICS.iter().map(chart).collect();
    let method = format!(
        "{} points a scene at E 500 km, N 5000 km, on the finest lattice that a LAS file holds, indexed; n = {} interleaved rounds after one that is not counted. Errors are those \
         of all points in the leaves against the file's own coordinates, compared as integers: <em>all</em> planes must be exactly 0, and are what leaves keep whatever is drawn. \
         In pixels a point counts where a picture of {} x {} pixels shows it, hidden or not. A cell is the longest side of those that an inner node's samples were merged in. A sample \
         should lie at the mean of the points that it stands for; how far it does not is the rounding of merged positions, level upon level. Times are of a file in the \
         system's cache, on one thread.",
        plan.points, plan.repeat, plan.size[0], plan.size[1]
    );
    Ok(Section {
        name: "index",
        title: "What an index keeps".into(),
        method,
        rows,
        charts,
        tables: vec![planes, levels],
    })
}

fn table(title: &str, head: &[&str]) -> Table {
    Table {
        title: title.into(),
        head: head.iter().map(|name| name.to_string()).collect(),
        rows: Vec::new(),
    }
}

/// A point of a leaf: its position as the file counts, and what its planes hold.
struct Kept {
    steps: [i64; 3],
    leaf: usize,
    cells: [u32; 3],
}

/// Returns the points of all leaves, ordered by coordinates.
fn leaves(index: &Index) -> Result<Vec<Kept>> {
    let mut points = Vec::new();
    for (leaf, node) in index.nodes().iter().enumerate().filter(|(_, node)| node.is_leaf()) {
        let mut cells = vec![[0u32; 3]; node.count as usize];
        let mut words = vec![0u32; node.count as usize];
        for &(plane, _) in &PLANES[..node.position_planes() as usize] {
            index.read(leaf, plane, bytemuck::cast_slice_mut(&mut words))?;
            for (cells, word) in cells.iter_mut().zip(&words) {
                let bits =
                    |axis: u32| word >> (BITS_PER_PLANE * axis) & ((1 << BITS_PER_PLANE) - 1);
                *cells = [0, 1, 2].map(|axis| cells[axis as usize] << BITS_PER_PLANE | bits(axis));
            }
        }
        let pad = BITS_PER_PLANE * node.position_planes() - node.bits as u32;
        let steps =
            |cells: [u32; 3]| [0, 1, 2].map(|axis| node.origin[axis] + (cells[axis] >> pad) as i64);
        points.extend(cells.into_iter().map(|cells| Kept { steps: steps(cells), leaf, cells }));
    }
    points.sort_unstable_by_key(|point| point.steps);
    Ok(points)
}

/// Returns the distance between every point and its drawn position `[m]`, with this many planes.
fn moved<'a>(
    scan: &'a Scan,
    points: &'a [Kept],
    planes: u32,
) -> impl Iterator<Item = (&'a [i32; 3], DVec3)> {
    let nodes = scan.index.nodes();
    let step = DVec3::splat(scan.world.step);
    scan.source.iter().zip(points).map(move |(source, point)| {
        let node = &nodes[point.leaf];
        let has = node.position_planes();
        let axis = |axis: usize| {
            if planes >= has {
                return (point.steps[axis] - source[axis] as i64) as f64;
            }
            // Points are drawn in the middle of their cell (`passes::project`).
            let side = 1i64 << (node.bits as u32 - BITS_PER_PLANE * planes);
            let corner = node.origin[axis]
                + (point.cells[axis] >> (BITS_PER_PLANE * (has - planes))) as i64 * side;
            (corner - source[axis] as i64) as f64 + (side - 1) as f64 / 2.0
        };
        (source, step * DVec3::new(axis(0), axis(1), axis(2)))
    })
}

/// Returns the same in pixels; `None` if the view does not show the point.
fn pixels(view: &View, lattice: &Lattice, source: &[i32; 3], moved: DVec3) -> Option<f64> {
    let at = |v: DVec3| {
        let scale = view.focal_px() / v.dot(view.basis.forward);
        DVec2::new(v.dot(view.basis.right), -v.dot(view.basis.up)) * scale
    };
    let v = relative(lattice, source.map(i64::from), view.camera.eye);
    let shown = v.dot(view.basis.forward) > 0.0
        && at(v).abs().cmple(DVec2::new(view.size[0] as f64, view.size[1] as f64) / 2.0).all();
    shown.then(|| at(v).distance(at(v + moved)))
}

fn bytes_per_point(index: &Index, planes: u32) -> f64 {
    let leaves = index.nodes().iter().filter(|node| node.is_leaf());
    let bytes: u64 =
        leaves.map(|node| 4 * node.position_planes().min(planes) as u64 * node.count as u64).sum();
    bytes as f64 / index.directory.contents.points as f64
}

/// Returns the time to copy and check this many position planes of every leaf `[ms]`.
fn read(index: &Index, planes: u32) -> Result<f64> {
    let began = Instant::now();
    let mut bytes = Vec::new();
    for (leaf, node) in index.nodes().iter().enumerate().filter(|(_, node)| node.is_leaf()) {
        for &(plane, _) in &PLANES[..node.position_planes().min(planes) as usize] {
            bytes.resize(node.unpacked_bytes(plane) as usize, 0);
            index.read(leaf, plane, &mut bytes)?;
        }
    }
    Ok(began.elapsed().as_secs_f64() * 1e3)
}

fn plane_rows(scene: &str, index: &Index) -> Vec<Vec<String>> {
    let bytes = |plane: Plane| {
        index
            .nodes()
            .iter()
            .filter(|node| node.has(plane))
            .map(|node| node.range(plane).1)
            .sum::<u64>()
    };
    let row = |(plane, bytes): (Plane, u64)| {
        let per_point = bytes as f64 / index.directory.contents.points as f64;
        vec![
            scene.into(),
            format!("{plane:?}").to_lowercase(),
            format!("{:.2}", bytes as f64 / (1 << 20) as f64),
            format!("{per_point:.2}"),
        ]
    };
    PLANES
        .iter()
        .map(|&(plane, _)| (plane, bytes(plane)))
        .filter(|(_, bytes)| *bytes > 0)
        .map(row)
        .collect()
}

/// Statistics of the inner nodes of a level.
#[derive(Default)]
struct Level {
    nodes: usize,
    samples: usize,
    points: u64,
    /// Least and largest cell `[m]`.
    cells: [f64; 2],
    /// Distances between samples and the means of their points [m and cells].
    away: Vec<[f64; 2]>,
}

fn level_rows(scene: &str, index: &Index, points: &[Kept]) -> Result<Vec<Vec<String>>> {
    let nodes = index.nodes();
    let [[step, offset], [_, corner]] = [0, 1].map(|k| index.directory.contents.lattices[k]);
    let corner = ((corner - offset) / step).round().to_array().map(|v| v as i64);
    let code = |point: &Kept| {
        morton::code_96([0, 1, 2].map(|axis| (point.steps[axis] - corner[axis]) as u32))
    };
    let mut order: Vec<(u128, usize)> =
        points.iter().enumerate().map(|(i, point)| (code(point), i)).collect();
    order.sort_unstable();
    // The beginning of each node's points in that order: children come after their parents.
    let mut starts = vec![usize::MAX; nodes.len()];
    for (at, &(_, i)) in order.iter().enumerate() {
        let start = &mut starts[points[i].leaf];
        *start = at.min(*start);
    }
    for node in (0..nodes.len()).rev().filter(|&node| !nodes[node].is_leaf()) {
        starts[node] = nodes[node]
            .children()
            .map(|child| starts[child])
            .min()
            .expect("an inner node has children");
    }
    let mut levels: BTreeMap<u8, Level> = BTreeMap::new();
    for (number, node) in nodes.iter().enumerate().filter(|(_, node)| !node.is_leaf()) {
        let level = levels.entry(node.level).or_default();
        let [least, largest] = if level.nodes == 0 { [node.spacing; 2] } else { level.cells };
        level.cells = [least.min(node.spacing), largest.max(node.spacing)];
        level.nodes += 1;
        level.samples += node.count as usize;
        level.points += node.points;
        let mut at = starts[number];
        for (sample, weight) in index.samples(number)? {
            let run = &order[at..at + weight as usize];
            at += run.len();
            let own = points[run[0].1].steps;
            let sum = run.iter().fold([0i64; 3], |sum, &(_, i)| {
                [0, 1, 2].map(|axis| sum[axis] + points[i].steps[axis] - own[axis])
            });
            let mean = DVec3::from_array(
                [0, 1, 2].map(|axis| own[axis] as f64 + sum[axis] as f64 / run.len() as f64),
            );
            let away = sample.distance(offset + step * mean);
            level.away.push([away, away / node.spacing]);
        }
    }
    let row = |(number, level): (&u8, &Level)| {
        let [metres, cells] =
            [0, 1].map(|k| metrics::errors(level.away.iter().map(|away| away[k])));
        vec![
            scene.into(),
            number.to_string(),
            level.nodes.to_string(),
            level.samples.to_string(),
            format!("{:.1}", level.points as f64 / level.samples as f64),
            format!("{:.2} to {:.2}", level.cells[0] * 1e3, level.cells[1] * 1e3),
            format!("{:.3}", metres.rms * 1e3),
            format!("{:.3}", cells.rms),
            format!("{:.3}", cells.max),
        ]
    };
    Ok(levels.iter().map(row).collect())
}
