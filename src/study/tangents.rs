//! Study `tangents`: the smoothness of the stroke field by the four ways to find a tangent (dos
//! Anjos et al. 2018, sec. 3.3.1), against the time per million tangents.
//!
//! Normals are those of planes fitted to the points, turned outward. Each point's tangent is
//! compared with those of its four nearest neighbours, as an angle between lines. Eight points
//! around a pole where a method jumps are few, so the mean tells the overall smoothness, and the
//! 99th percentile the worst.

use super::oracle::strokes::tangent;
use super::report::{self, Section, Table};
use super::{Plan, Row, mark_fronts, metrics};
use crate::error::Result;
use crate::graph::Gpu;
use crate::index::attributes::kd_tree::KdTree;
use crate::index::attributes::strokes;
use crate::passes::strokes::Tangents;
use crate::passes::strokes::tangents::on_device;
use crate::progress::Progress;
use crate::shader::Direction;
use crate::synth::{self, SceneKind};
use glam::DVec3;
use std::time::Instant;

pub const SUMMARY: &str =
    "ways to find a tangent: angles between neighbouring strokes, against time a million";

const WAYS: [(&str, Tangents); 4] = [
    ("householder", Tangents::Householder),
    ("eberly", Tangents::Eberly),
    ("squareplate", Tangents::Squareplate),
    ("covariance", Tangents::Covariance),
];

/// Scenes, their noise `[m]`, and the outward direction at a place relative to the centre.
type Outward = fn(DVec3) -> DVec3;
const SCENES: [(&str, SceneKind, f64, Outward); 4] = [
    ("sphere", SceneKind::Sphere, 0.0, |p| p),
    ("noisy sphere", SceneKind::Sphere, 0.002, |p| p),
    ("torus", SceneKind::Torus, 0.0, from_ring),
    ("noisy torus", SceneKind::Torus, 0.002, from_ring),
];

fn from_ring(p: DVec3) -> DVec3 {
    p - DVec3::new(p.x, p.y, 0.0).normalize_or_zero()
}

/// Neighbours each tangent is compared with.
const BESIDE: usize = 4;

const METRICS: [(&str, &str, &str); 2] = [
    ("mean_degrees", "mean angle, degrees", "Angle between the strokes of neighbours: mean"),
    (
        "p99_degrees",
        "99th percentile, degrees",
        "Angle between the strokes of neighbours: 99th percentile",
    ),
];

pub fn run(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    let mut rows = Vec::new();
    let mut table = Table {
        title: "Angles and times".into(),
        head: [
            "scene",
            "tangents",
            "mean, degrees",
            "99 %, degrees",
            "ms a million",
            "device, ms a million",
        ]
        .map(String::from)
        .to_vec(),
        rows: Vec::new(),
    };
    for (done, (name, scene, noise, outward)) in SCENES.into_iter().enumerate() {
        progress.tick("study tangents", done as u64, SCENES.len() as u64)?;
        let cloud = synth::collect(
            name,
            &synth::build(scene, plan.seed, 0.0),
            plan.points,
            plan.seed,
            noise,
            progress,
        )?;
        let part = &cloud.parts[0];
        let middle = part.bounds().map_or(DVec3::ZERO, |(lo, hi)| (lo + hi) / 2.0);
        let tree = KdTree::new(&part.columns, &part.lattice);
        let known = strokes::strokes(&part.columns, &part.lattice, progress)?;
        let frames: Vec<Option<(DVec3, DVec3)>> = (0..tree.len())
            .map(|place| {
                let at = part.lattice.world(tree.steps(place).map(i64::from)) - middle;
                let plane = known[tree.number(place)].plane?;
                let out = plane.normal.dot(outward(at)) >= 0.0;
                Some((if out { plane.normal } else { -plane.normal }, plane.along))
            })
            .collect();
        let beside = beside(&tree);
        let directions: Vec<Direction> =
            frames.iter().flatten().map(|&(normal, along)| direction(normal, along)).collect();
        for (way, tangents) in WAYS {
            let mut found = Vec::new();
            let mut times = Vec::new();
            for _ in 0..plan.repeat.max(1) {
                let start = Instant::now();
                found = frames
                    .iter()
                    .map(|frame| frame.map(|(normal, along)| tangent(tangents, normal, along)))
                    .collect::<Vec<_>>();
                times.push(start.elapsed().as_secs_f64() * 1e3 * 1e6 / frames.len() as f64);
            }
            let angles = angles(&found, &beside);
            let mean = angles.iter().sum::<f64>() / angles.len().max(1) as f64;
            let p99 = angles.get(angles.len() * 99 / 100).copied().unwrap_or(0.0);
            let ms = metrics::quartiles(&times);
            let on_device = (0..plan.repeat.max(1)).map(|_| {
                Ok(on_device(gpu, tangents, &directions)?.1 * 1e6 / directions.len().max(1) as f64)
            });
            let on_device = metrics::quartiles(&on_device.collect::<Result<Vec<_>>>()?);
            for (metric, error) in METRICS.iter().zip([mean, p99]) {
                let (value, auto) = (way.to_string(), tangents == Tangents::default());
                rows.push(Row {
                    scene: name,
                    view: "outside",
                    parameter: "tangents",
                    value,
                    metric: metric.0,
                    error,
                    ms,
                    n: times.len(),
                    auto,
                    front: false,
                });
            }
            table.rows.push(vec![
                name.into(),
                way.into(),
                format!("{mean:.3}"),
                format!("{p99:.3}"),
                format!("{:.1}", ms[1]),
                format!("{:.2}", on_device[1]),
            ]);
        }
    }
    mark_fronts(&mut rows);
    let label = |row: &Row| row.value.clone();
    let chart = |&(metric, y_axis, caption): &_| {
        report::chart(metric, ["milliseconds a million", y_axis], caption, &rows, &label)
    };
    let charts = METRICS.iter().map(chart).collect();
    let method = format!(
        "{} points a scene; n = {} rounds, on one core of the CPU, f64, from normals that are known, in the axes of the file; and of the kernel, f32, on the device. Covariance is free here, because its direction is found with the normal; the paper counts that \
         search to it. The formula of squareplate is not in the paper: it is read here as the cross product with the normal's own parts, moved on by one.",
        plan.points, plan.repeat
    );
    Ok(Section {
        name: "tangents",
        title: "Tangents".into(),
        method,
        rows,
        charts,
        tables: vec![table],
    })
}

/// Returns a normal as the kernel takes it, with the rotation from its own tangent to the main
/// spread of its neighbours.
fn direction(normal: DVec3, along: DVec3) -> Direction {
    let (tangent, bitangent) = strokes::householder(normal);
    Direction {
        normal: normal.as_vec3().to_array(),
        turn: [along.dot(tangent) as f32, along.dot(bitangent) as f32],
    }
}

/// Returns the nearest neighbours of every place.
fn beside(tree: &KdTree) -> Vec<Vec<u32>> {
    use rayon::prelude::*;
    let of = |place| {
        let mut found = Vec::new();
        tree.nearest(place, BESIDE, &mut found);
        found.iter().map(|neighbour| neighbour.place).collect()
    };
    (0..tree.len()).into_par_iter().map(of).collect()
}

/// Returns the sorted angles between lines `[degrees]`.
fn angles(tangents: &[Option<DVec3>], beside: &[Vec<u32>]) -> Vec<f64> {
    let pairs = tangents.iter().zip(beside).flat_map(|(own, beside)| {
        beside.iter().map(move |&other| (*own, tangents[other as usize]))
    });
    let angle = |(a, b): (Option<DVec3>, Option<DVec3>)| {
        Some(a?.cross(b?).length().atan2(a?.dot(b?).abs()).to_degrees())
    };
    let mut angles: Vec<f64> = pairs.filter_map(angle).collect();
    angles.sort_by(f64::total_cmp);
    angles
}
