//! Study `normals`: planes fitted to the points around each (dos Anjos et al. 2018, sec. 3.2.2), by
//! the number of neighbours that define the radius and the number of radii, against the time per
//! million points.
//!
//! One of the two differs from the defaults of `index --normals` and strokes. Truth is analytic: a
//! sphere and a torus, without noise and with noise of a quarter of the point spacing. The angle is
//! that between lines, since a plane has two normals. A point whose neighbours determine no plane
//! has none, and counts as unknown, not as wrong.

use super::report::{self, Section, Table};
use super::{Plan, Row, mark_fronts, metrics, sweep};
use crate::error::Result;
use crate::graph::Gpu;
use crate::index::attributes::knn_query::KnnQuery;
use crate::index::attributes::leaf_cache::Leaf;
use crate::index::attributes::normals::{self, FIT, Fit, Scratch};
use crate::progress::Progress;
use crate::synth::{self, SceneKind};
use glam::DVec3;
use std::time::Instant;

pub const SUMMARY: &str = "neighbours and radii of fitted planes: angles to the surface's own normals, against time a million";

/// The outward direction at a place relative to the centre, and the surface area [m^2].
struct Truth {
    normal: fn(DVec3) -> DVec3,
    area: f64,
}

const SPHERE: Truth = Truth { normal: |p| p.normalize_or_zero(), area: 4.0 * std::f64::consts::PI };
/// Radii 1 and 0.4.
const TORUS: Truth = Truth {
    normal: |p| (p - DVec3::new(p.x, p.y, 0.0).normalize_or_zero()).normalize_or_zero(),
    area: 4.0 * std::f64::consts::PI * std::f64::consts::PI * 0.4,
};

/// Scenes, and their noise in spacings of the points.
const SCENES: [(&str, SceneKind, Truth, f64); 4] = [
    ("sphere", SceneKind::Sphere, SPHERE, 0.0),
    ("noisy sphere", SceneKind::Sphere, SPHERE, 0.25),
    ("torus", SceneKind::Torus, TORUS, 0.0),
    ("noisy torus", SceneKind::Torus, TORUS, 0.25),
];

const NEAR: [usize; 4] = [4, 8, 16, 32];
const REACH: [f64; 5] = [1.5, 2.0, 3.0, 4.0, 6.0];

const METRICS: [(&str, &str, &str); 3] = [
    ("median_degrees", "median angle, degrees", "Angle to the surface's own normal: median"),
    (
        "p99_degrees",
        "99th percentile, degrees",
        "Angle to the surface's own normal: 99th percentile",
    ),
    ("unknown", "share of the points", "Points without a normal"),
];

pub fn run(_gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    let mut rows = Vec::new();
    let head = [
        "scene",
        "neighbours",
        "radii",
        "median, degrees",
        "99 %, degrees",
        "unknown",
        "ms a million",
    ];
    let mut table = Table {
        title: "Angles and times".into(),
        head: head.map(String::from).to_vec(),
        rows: Vec::new(),
    };
    for (done, (name, scene, truth, noise)) in SCENES.into_iter().enumerate() {
        progress.tick("study normals", done as u64, SCENES.len() as u64)?;
        let spacing = (truth.area / plan.points as f64).sqrt();
        let cloud = synth::collect(
            name,
            &synth::build(scene, plan.seed, 0.0),
            plan.points,
            plan.seed,
            noise * spacing,
            progress,
        )?;
        let part = &cloud.parts[0];
        let middle = part.bounds().map_or(DVec3::ZERO, |(lo, hi)| (lo + hi) / 2.0);
        let leaf = Leaf::of(&part.columns, &part.lattice, [0; 3], false);
        let by_near = NEAR.map(|near| ("neighbours", Fit { near, ..FIT }));
        let by_reach = REACH.map(|reach| ("radii", Fit { reach, ..FIT }));
        let fits: Vec<(&str, Fit)> = by_near.into_iter().chain(by_reach).collect();
        let places = places(leaf.tree.len());
        let mut found = Vec::new();
        let times = sweep::interleaved(&fits, plan.repeat.max(1), |&(_, fit)| {
            let start = Instant::now();
            let own = planes(&leaf, &places, fit)?;
            let ms = start.elapsed().as_secs_f64() * 1e3;
            if found.len() < fits.len() {
                found.push(own);
            }
            Ok(ms * 1e6 / places.len().max(1) as f64)
        })?;
        for (((parameter, fit), times), found) in fits.into_iter().zip(times).zip(found) {
            let (angles, unknown) = compare(
                &leaf,
                &places,
                |steps| (truth.normal)(part.lattice.world(steps) - middle),
                &found,
            );
            let [median, p99] = [0.5, 0.99].map(|share| {
                angles.get((share * angles.len() as f64) as usize).copied().unwrap_or(0.0)
            });
            let ms = metrics::quartiles(&times);
            let value =
                if parameter == "radii" { fit.reach.to_string() } else { fit.near.to_string() };
            for (metric, error) in METRICS.iter().zip([median, p99, unknown]) {
                let (value, auto) = (value.clone(), fit == FIT);
                rows.push(Row {
                    scene: name,
                    view: "points",
                    parameter,
                    value,
                    metric: metric.0,
                    error,
                    ms,
                    n: times.len(),
                    auto,
                    front: false,
                });
            }
            let numbers = [
                format!("{median:.3}"),
                format!("{p99:.3}"),
                format!("{unknown:.5}"),
                format!("{:.0}", ms[1]),
            ];
            table.rows.push(
                [vec![name.into(), fit.near.to_string(), fit.reach.to_string()], numbers.to_vec()]
                    .concat(),
            );
        }
    }
    mark_fronts(&mut rows);
    let label = |row: &Row| format!("{} {}", row.value, row.parameter);
    let chart = |&(metric, y_axis, caption): &_| {
        report::chart(metric, ["milliseconds a million", y_axis], caption, &rows, &label)
    };
    let charts = METRICS.iter().map(chart).collect();
    let method = format!(
        "{} points a scene, of which at most {PLACES} in runs of {RUN} are looked at; n = {} interleaved rounds after one that is not counted, on one core of the CPU, without building the tree. <em>auto</em> is what <code>index --normals</code> does: {} neighbours and {} radii.",
        plan.points, plan.repeat, FIT.near, FIT.reach
    );
    Ok(Section {
        name: "normals",
        title: "Normals".into(),
        method,
        rows,
        charts,
        tables: vec![table],
    })
}

/// Most points tested, in runs of neighbours as in an index, spread over all.
const PLACES: usize = 65_536;
const RUN: usize = 1024;

fn places(points: usize) -> Vec<usize> {
    let apart = points.div_ceil(PLACES).max(1);
    (0..points).filter(|place| (place / RUN).is_multiple_of(apart)).collect()
}

/// Returns the planes in the order of the places.
fn planes(leaf: &Leaf, places: &[usize], fit: Fit) -> Result<Vec<Option<DVec3>>> {
    let (mut around, mut scratch) = (KnnQuery::alone(leaf), Scratch::default());
    let normal = |&place: &usize| {
        Ok(normals::patch(&mut around, place, fit, &mut scratch, &mut |_| {})?
            .plane
            .map(|plane| plane.normal))
    };
    places.iter().map(normal).collect()
}

/// Returns the sorted errors of known normals `[degrees]`, and the share of unknown ones. `truth`
/// takes a place in steps.
fn compare(
    leaf: &Leaf,
    places: &[usize],
    truth: impl Fn([i64; 3]) -> DVec3,
    found: &[Option<DVec3>],
) -> (Vec<f64>, f64) {
    let angle = |(&place, normal): (&usize, &Option<DVec3>)| {
        let own = truth(leaf.tree.steps(place).map(i64::from));
        normal.map(|normal| normal.cross(own).length().atan2(normal.dot(own).abs()).to_degrees())
    };
    let mut angles: Vec<f64> = places.iter().zip(found).filter_map(angle).collect();
    angles.sort_by(f64::total_cmp);
    let unknown = 1.0 - angles.len() as f64 / found.len().max(1) as f64;
    (angles, unknown)
}
