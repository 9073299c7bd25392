//! The studies at tiny sizes: their files hold what they promise.

use crate::browser::look;
use crate::files::scan;
use crate::gpu::{self, Way};
use crate::shared::shared;
use glam::DVec3;
use pointillist::cloud::{self, Cloud, ColumnSet, ReadOptions};
use pointillist::index;
use pointillist::progress::Silent;
use pointillist::study::cases::{self, Case, Options, Sampling};
use pointillist::study::mesh::Mesh;
use pointillist::study::truth::{Errors, Surface, Truth};
use pointillist::study::{self, Plan, Row, report};
use pointillist::synth::{self, SceneKind, World};
use pointillist::view::{Camera, Preset, View};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;

const PLAN: Plan = Plan {
    points: 20_000,
    seed: 1,
    repeat: 3,
    size: [64, 64],
    scenes: Vec::new(),
    files: Vec::new(),
};

#[test]
fn the_precision_study_keeps_its_promises() {
    let folder = tempfile::tempdir().unwrap();
    let rows = gpu::with(Way::Compute64, |gpu| {
        let sections = study::run(&["precision".into()], gpu, &PLAN, &Silent).unwrap();
        report::write(folder.path(), &sections, &PLAN, &report::Origin::here(gpu)).unwrap();
        sections.into_iter().next().unwrap().rows
    });
    // Three scenes, three views, four settings, six metrics.
    csv_holds_exactly(
        &std::fs::read_to_string(folder.path().join("precision.csv")).unwrap(),
        &rows,
        ["precision", "bits", "auto"],
        216,
    );
    assert!(rows.iter().all(|row| row.n == 3));
    errors_fall_as_bits_rise(&rows);
    fronts_are_fronts(&rows);
    // Six charts: pooled, and nine scenes and views of each.
    check_page(&folder.path().join("study.html"), 6 * 10);
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        2,
        "nothing half written is left"
    );
}

fn csv_holds_exactly(text: &str, rows: &[Row], [study, parameter, auto]: [&str; 3], count: usize) {
    let mut lines = text.lines();
    assert_eq!(
        lines.next(),
        Some(
            "study,scene,view,parameter,value,metric,error,ms_median,ms_q1,ms_q3,n,auto,front,device"
        )
    );
    assert_eq!((rows.len(), lines.clone().count()), (count, count));
    for (line, row) in lines.zip(rows) {
        let fields: Vec<&str> = line.splitn(14, ',').collect();
        assert_eq!(fields[..6], [study, row.scene, row.view, parameter, &row.value, row.metric]);
        let numbers: Vec<f64> = fields[6..10].iter().map(|field| field.parse().unwrap()).collect();
        assert_eq!(numbers, [row.error, row.ms[1], row.ms[0], row.ms[2]]);
        assert!(
            row.error >= 0.0 && row.ms[0] > 0.0 && row.ms[0] <= row.ms[1] && row.ms[1] <= row.ms[2],
            "{row:?}"
        );
        assert_eq!(
            fields[10..13],
            [row.n.to_string(), (row.value == auto).to_string(), row.front.to_string()]
        );
        assert!(fields[13].len() > 2);
    }
}

/// Checks how a page looks in a browser.
fn check_page(page: &Path, panels: usize) {
    let Some(found) = look(page, 1100) else { return };
    for wrong in ["errors", "overlaps", "outside", "wide"] {
        assert_eq!(found[wrong].as_array().unwrap().len(), 0, "{:#}", found[wrong]);
    }
    assert_eq!(found["panels"], panels);
}

/// Runs one study into a folder. Returns its rows, the text of its CSV, and the number of charts.
fn made(name: &str, plan: &Plan) -> (Vec<Row>, String, usize) {
    let folder = tempfile::tempdir().unwrap();
    let made = gpu::with(Way::Compute64, |gpu| {
        let sections = study::run(&[name.into()], gpu, plan, &Silent).unwrap();
        report::write(folder.path(), &sections, plan, &report::Origin::here(gpu)).unwrap();
        sections.into_iter().next().unwrap()
    });
    let csv = std::fs::read_to_string(folder.path().join(format!("{name}.csv"))).unwrap();
    (made.rows, csv, made.charts.len())
}

#[test]
fn the_lod_study_keeps_its_promises() {
    let plan = Plan { points: 150_000, seed: 1, repeat: 2, size: [128, 96], ..PLAN };
    let (mut rows, text, charts) = made("lod", &plan);
    // Two scenes, seven settings; three views with nine metrics, one dolly with two.
    csv_holds_exactly(&text, &rows, ["lod", "lod", "auto"], 2 * 7 * (3 * 9 + 2));
    assert_eq!(charts, 10);
    // More dB are better: their front is that of the RMS errors that they are logarithms of.
    for (psnr, rms) in rows
        .iter()
        .filter(|row| row.metric == "psnr_db")
        .zip(rows.iter().filter(|row| row.metric == "rms"))
    {
        assert_eq!(
            (psnr.scene, psnr.view, &psnr.value, psnr.front),
            (rms.scene, rms.view, &rms.value, rms.front)
        );
        assert!(
            (psnr.error + 20.0 * rms.error.log10()).abs() < 1e-9
                || rms.error == 0.0 && psnr.error == f64::INFINITY
        );
    }
    rows.retain(|row| row.metric != "psnr_db");
    fronts_are_fronts(&rows);
    let mut deepest = 0f64;
    for ((scene, view, metric), rows) in groups(&rows) {
        let error = |value: &str| rows.iter().find(|row| row.value == value).unwrap().error;
        let falling = ["8", "4", "2", "1", "0.5", "0.25"].map(error);
        let at = format!("{scene} {view} {metric}: {falling:?} auto {}", error("auto"));
        match metric {
            "points" | "bytes_read" => {
                assert!(
                    falling.is_sorted() && error("auto") <= error("1") && falling[0] > 0.0,
                    "{at}"
                );
                let budget = 2.0 * (plan.size[0] * plan.size[1]) as f64;
                assert!(metric != "points" || error("auto") <= budget.max(falling[0]), "{at}");
            }
            // A tenth, and a pixel in a thousand: which of two points is nearer is chance.
            "rms" | "flip" | "holes" => {
                assert!(falling.windows(2).all(|pair| pair[1] <= 1.1 * pair[0] + 1e-3), "{at}");
                assert!(error("auto") >= 0.9 * error("1") - 1e-3, "{at}");
                deepest = if view == "far" { deepest.max(falling[0]) } else { deepest };
            }
            "popping_max" => assert!(falling.iter().all(|&max| max > 0.0 && max < 1.0), "{at}"),
            _ => {}
        }
    }
    assert!(deepest > 0.05, "the far views cut nothing");
}

/// Leaves of LAS input are equal to it (guide: numerics, case 29); with fewer planes a point is
/// drawn from the middle of its cell, of at most 2^30 / 2^(10 k) steps.
#[test]
fn hard_29_the_index_study_keeps_its_promises() {
    let (rows, text, charts) = made("index", &Plan { points: 100_000, ..PLAN });
    // Three scenes, three settings; three metrics, and three views with two.
    csv_holds_exactly(&text, &rows, ["index", "bits", "all"], 3 * 3 * (3 + 3 * 2));
    assert_eq!(charts, 5);
    fronts_are_fronts(&rows);
    for ((scene, view, metric), rows) in groups(&rows) {
        let error = |value: &str| rows.iter().find(|row| row.value == value).unwrap().error;
        let at =
            format!("{scene} {view} {metric}: {} {} {}", error("10"), error("20"), error("all"));
        if metric == "bytes_point" {
            assert!(error("10") == 4.0 && error("20") <= 8.0 && error("all") <= 12.0, "{at}");
            continue;
        }
        assert!(
            error("all") == 0.0 && error("20") <= error("10") / 512.0 && error("10") > 0.0,
            "{at}"
        );
    }
}

fn groups(rows: &[Row]) -> BTreeMap<(&str, &str, &str), Vec<&Row>> {
    let mut groups: BTreeMap<_, Vec<&Row>> = BTreeMap::new();
    rows.iter()
        .for_each(|row| groups.entry((row.scene, row.view, row.metric)).or_default().push(row));
    groups
}

/// 10 bits are worst, visibly so from near. More bits are better down to the error of f32
/// arithmetic, 12 u f pixels (guide: numerics, case 2): f is at most 64 px / (2 tan 20 degrees) =
/// 88 px here, and the depths are below 10 km, where the same 12 u are 7 mm.
fn errors_fall_as_bits_rise(rows: &[Row]) {
    let u = 2f64.powi(-24);
    for ((scene, view, metric), rows) in groups(rows) {
        let error = |value: &str| rows.iter().find(|row| row.value == value).unwrap().error;
        if metric == "bytes_read" {
            // Four bytes per point and plane.
            assert!(
                error("10") <= error("20")
                    && error("20") <= error("all")
                    && error("auto") <= error("all"),
                "{scene} {view}"
            );
            assert!(error("10") > 0.0 && error("10") % 4.0 == 0.0, "{scene} {view}");
            continue;
        }
        let floor = match metric {
            "px_max" | "px_rms" => 12.0 * u * 88.0,
            "m_max" | "m_rms" => 12.0 * u * 1e4,
            _ => {
                assert_eq!(
                    error("all"),
                    0.0,
                    "{scene} {view}: the picture at full precision is its own reference"
                );
                0.0
            }
        };
        let at = format!(
            "{scene} {view} {metric}: {} {} {} auto {}",
            error("10"),
            error("20"),
            error("all"),
            error("auto")
        );
        assert!(
            error("10") + floor >= error("20")
                && error("20") + floor >= error("all")
                && error("10") + floor >= error("auto"),
            "{at}"
        );
        if metric == "px_max" && view == "close-up" {
            assert!(error("10") > 0.5, "10 bits do not fail visibly: {at}");
            // The quantisation bound of auto, plus the floor; in a corner of this picture a point
            // is 1.25 times as far from the eye as it is deep.
            assert!(error("auto") <= 1.25 / 4096.0 + floor, "{at}");
        }
    }
}

/// Checks the definition, independently of the code that marked them.
fn fronts_are_fronts(rows: &[Row]) {
    for (group, rows) in groups(rows) {
        for row in &rows {
            let beaten = rows.iter().any(|other| {
                let no_worse = other.error <= row.error && other.ms[1] <= row.ms[1];
                no_worse && (other.error < row.error || other.ms[1] < row.ms[1])
            });
            assert_eq!(row.front, !beaten, "{group:?} {}", row.value);
        }
        assert!(rows.iter().any(|row| row.front), "{group:?} has no front");
    }
}

#[test]
fn a_study_that_there_is_not_names_those_that_there_are() {
    let error = gpu::with(Way::Compute64, |gpu| {
        study::run(&["speed".into()], gpu, &PLAN, &Silent).err().unwrap().to_string()
    });
    assert!(error.contains("speed") && error.contains("precision"), "{error}");
}

/// Visits closed-form scenes, small.
fn visited(scenes: &[&str], densities: &[f64], mut visit: impl FnMut(&Case)) -> Vec<String> {
    let options = Options {
        size: [96, 80],
        most_points: 400_000,
        scenes: scenes.iter().map(|scene| scene.to_string()).collect(),
        densities: densities.to_vec(),
        ..Options::default()
    };
    cases::each(&options, &Silent, |case| {
        visit(case);
        Ok(())
    })
    .unwrap()
}

#[test]
fn the_truth_has_no_errors_and_what_is_not_true_has() {
    let mut count = 0;
    visited(&["sphere", "torus"], &[0.5], |case| {
        count += 1;
        let truth = &case.truth;
        let depth: Vec<f32> = truth.depth.iter().map(|depth| *depth as f32).collect();
        let of = |depth: &[f32]| case.errors(depth, depth, None);
        let own = of(&depth);
        assert!(own.interior > 500 && own.inside > own.interior, "{own:?}");
        assert_eq!(
            [own.misplaced, own.wrong_layer, own.holes, own.spilled, own.hidden[0]],
            [0; 5],
            "{own:?}"
        );
        assert!(own.visible[0] > own.inside / 2);
        for by in [0.9, 1.1] {
            let shifted = of(&depth.iter().map(|depth| depth * by).collect::<Vec<_>>());
            assert!(
                shifted.misplaced == own.interior
                    && shifted.wrong_layer == own.interior
                    && shifted.holes == 0,
                "{shifted:?}"
            );
            // Nothing hides what is nearer than the surface.
            assert_eq!(
                (shifted.visible[0] == 0, shifted.hidden[0] == 0),
                (by > 1.0, by < 1.0),
                "{shifted:?}"
            );
        }
        let every_fifth: Vec<f32> =
            (0..depth.len()).map(|i| if i % 5 == 0 { f32::INFINITY } else { depth[i] }).collect();
        let thinned = of(&every_fifth);
        assert_eq!(
            thinned.holes,
            (0..depth.len()).step_by(5).filter(|&i| truth.inside[i]).count() as u64
        );
        assert!((thinned.hole_share() - 0.2).abs() < 0.02 && thinned.misplaced == 0);
        let flooded = of(&depth.iter().map(|depth| depth.min(3.0)).collect::<Vec<_>>());
        assert_eq!(flooded.spilled, truth.beyond.iter().filter(|beyond| **beyond).count() as u64);
        let hidden = case.errors(&depth, &depth, Some(&vec![false; depth.len()]));
        assert_eq!(
            (hidden.recall(), hidden.visible[0], hidden.visible[1]),
            (0.0, 0, own.visible[0])
        );
        assert_eq!([own, hidden].into_iter().sum::<Errors>().inside, 2 * own.inside);
    });
    assert_eq!(count, 2 * 3 * 2, "two scenes, three views, two noises");
}

/// Returns every pixel's nearest point, naively.
fn projected(case: &Case) -> Vec<f32> {
    let [width, height] = case.view.size.map(f64::from);
    let mut depth = vec![f32::INFINITY; (width * height) as usize];
    for part in &case.cloud.parts {
        for i in 0..part.columns.len() {
            let q = [part.columns.x[i], part.columns.y[i], part.columns.z[i]].map(i64::from);
            let p = part.lattice.world(q) - case.view.camera.eye;
            let z = p.dot(case.view.basis.forward);
            let f = case.view.focal_px()
                / if case.view.camera.ortho_height.is_some() { 1.0 } else { z };
            let (x, y) = (
                p.dot(case.view.basis.right) * f + width / 2.0,
                height / 2.0 - p.dot(case.view.basis.up) * f,
            );
            if (0.0..width).contains(&x) && (0.0..height).contains(&y) {
                let pixel = &mut depth[y as usize * width as usize + x as usize];
                *pixel = pixel.min(z as f32);
            }
        }
    }
    depth
}

/// Points of the first surface fall as a Poisson process: evenly spread, 1 - exp(-d) of the pixels
/// get one; towards limbs they crowd, so fewer do. Noise is within its tolerance; what it excuses
/// behind limbs is not on the first surface.
#[test]
fn points_of_a_case_lie_on_its_surface_and_are_as_dense_as_they_say() {
    let left_out = visited(&["sphere", "torus"], &[0.25, 2.0, 1e4], |case| {
        let raw = projected(case);
        let errors = case.errors(&raw, &raw, None);
        let Sampling::Density(density) = case.sampling else { panic!("a sphere has no vertices") };
        assert!((case.density / density - 1.0).abs() < 0.1, "{density}: {}", case.density);
        let visible = |i: usize| {
            raw[i].is_finite()
                && case.truth.is_visible(i, raw[i] as f64, case.noise_px) == Some(true)
        };
        let kept: Vec<bool> = (0..raw.len()).map(visible).collect();
        let shown = (0..raw.len()).filter(|&i| kept[i] && case.truth.inside[i]).count() as f64
            / errors.inside as f64;
        let even = 1.0 - (-density).exp();
        let as_dense = case.noise_px > 0.0 || (0.6 * even..1.02 * even).contains(&shown);
        assert!(
            as_dense && errors.spilled == 0,
            "{} {}: {shown} {errors:?}",
            case.scene,
            case.view_name
        );
        // Without the points behind, nothing is wrong: the rest is on the surface, up to its noise.
        let front: Vec<f32> = raw
            .iter()
            .zip(&kept)
            .map(|(depth, kept)| if *kept { *depth } else { f32::INFINITY })
            .collect();
        let errors = case.errors(&raw, &front, Some(&kept));
        assert_eq!(
            (errors.wrong_layer, errors.precision(), errors.recall()),
            (0, 1.0, 1.0),
            "{errors:?}"
        );
    });
    assert_eq!(left_out.len(), 2 * 3, "{left_out:?}");
}

struct Analytic(World);

impl Surface for Analytic {
    fn first(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        self.0.first(origin, direction)
    }
}

struct Triangles(Mesh);

impl Surface for Triangles {
    fn first(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        self.0.first(origin, direction)
    }
}

/// Returns an octahedron on the unit sphere, with every triangle repeatedly split into four.
fn sphere_mesh(levels: u32) -> Mesh {
    let mut vertices = vec![DVec3::X, DVec3::Y, DVec3::Z, -DVec3::X, -DVec3::Y, -DVec3::Z];
    let mut faces: Vec<[u32; 3]> = vec![
        [0, 1, 2],
        [1, 3, 2],
        [3, 4, 2],
        [4, 0, 2],
        [1, 0, 5],
        [3, 1, 5],
        [4, 3, 5],
        [0, 4, 5],
    ];
    for _ in 0..levels {
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                vertices.push((vertices[a as usize] + vertices[b as usize]).normalize());
                vertices.len() as u32 - 1
            })
        };
        faces = faces
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    Mesh::new(vertices, &faces)
}

#[test]
fn a_sphere_of_triangles_is_the_sphere() {
    let mut view = None;
    visited(&["sphere"], &[0.01], |case| view = Some(case.view));
    let view: View = view.unwrap();
    let (round, flat) =
        (Analytic(synth::build(SceneKind::Sphere, 1, 0.0)), Triangles(sphere_mesh(7)));
    let (round, flat) = (Truth::cast(&view, &round), Truth::cast(&view, &flat));
    let depth: Vec<f32> = flat.depth.iter().map(|depth| *depth as f32).collect();
    let errors = study::truth::compare(&round, 0.0, &depth, &depth, None);
    assert_eq!(
        [errors.misplaced, errors.wrong_layer, errors.holes, errors.spilled, errors.hidden[0]],
        [0; 5],
        "{errors:?}"
    );
    let interior = |i: &usize| round.interior[*i];
    // A chord of 90 / 128 degrees lies 1 - cos(half of it) = 2e-5 below its arc; a steep pixel sees
    // that under 2 px of its limb.
    let farthest = (0..depth.len())
        .filter(interior)
        .map(|i| (round.depth[i] - flat.depth[i]).abs())
        .fold(0.0, f64::max);
    assert!(farthest < 2e-4, "{farthest}");
    let differ = (0..depth.len()).filter(|&i| round.inside[i] != flat.inside[i]).count();
    assert!(differ < 20, "{differ}");
}

#[test]
fn the_surface_study_keeps_its_promises() {
    let plan = Plan {
        points: 3_000,
        repeat: 1,
        size: [48, 48],
        scenes: vec!["sphere".into(), "torus".into()],
        ..PLAN
    };
    let (rows, text, charts) = made("surface", &plan);
    assert_eq!((charts, rows.len() % 6, text.lines().count()), (6, 0, rows.len() + 1));
    for (case, rows) in groups(&rows)
        .into_values()
        .flatten()
        .map(|row| ((row.scene, row.view, &row.value), row))
        .fold(BTreeMap::<_, Vec<&Row>>::new(), |mut cases, (case, row)| {
            cases.entry(case).or_default().push(row);
            cases
        })
    {
        let error = |metric: &str| rows.iter().find(|row| row.metric == metric).unwrap().error;
        assert!(
            rows.len() == 6 && rows.iter().all(|row| (0.0..=1.0).contains(&row.error)),
            "{case:?}"
        );
        // Points alone: no hole is closed, and every point counts as visible.
        assert!(
            !case.2.starts_with("points")
                || error("lost_visible") == 0.0 && error("spilled") < 0.01,
            "{case:?}"
        );
    }
    let holes = |value: &str| {
        let found = rows.iter().find(|row| {
            (row.scene, row.view, row.metric) == ("torus", "whole", "holes")
                && row.value.starts_with("points")
                && row.value.contains(value)
        });
        found.unwrap().error
    };
    assert!(holes(" 0.04/px") > holes(" 0.1/px") && holes(" 0.1/px") > holes(" 0.25/px"));
}

/// Runs a study of configurations on two tiny scenes: `configurations` of them, one automatic, in
/// each of two scenes and both together, at three densities.
fn configured(name: &str, configurations: usize, metrics: usize, charts: usize) -> Vec<Row> {
    let plan =
        Plan { points: 50_000, repeat: 2, scenes: vec!["sphere".into(), "torus".into()], ..PLAN };
    let (rows, text, found) = made(name, &plan);
    assert_eq!(
        (rows.len(), text.lines().count(), found),
        (3 * 3 * configurations * metrics, rows.len() + 1, charts)
    );
    fronts_are_fronts(&rows);
    for (group, rows) in groups(&rows) {
        assert_eq!(
            (rows.len(), rows.iter().filter(|row| row.auto).count()),
            (configurations, 1),
            "{group:?}"
        );
        // Flooded background can spill more than the silhouette holds.
        let most = if ["spilled", "false_holes"].contains(&group.2) { f64::INFINITY } else { 1.0 };
        assert!(
            rows.iter()
                .all(|row| row.n == 2 && (0.0..=most).contains(&row.error) && row.ms[0] >= 0.0),
            "{group:?}"
        );
    }
    rows
}

fn of(rows: &[Row], scene: &str, metric: &str, value: &str) -> f64 {
    let sum = rows
        .iter()
        .filter(|row| (row.scene, row.metric, row.value.as_str()) == (scene, metric, value))
        .map(|row| row.error);
    sum.reduce(|a, b| a + b).unwrap_or_else(|| panic!("no {value} in {scene}, {metric}")) / 3.0
}

#[test]
fn the_visibility_study_keeps_its_promises() {
    let rows = configured("visibility", 32, 4, 4 + 1);
    let thresholds: Vec<_> =
        rows.iter().filter(|row| row.parameter == "threshold").cloned().collect();
    for scene in ["all scenes", "sphere", "torus"] {
        // A higher threshold hides more.
        let along = |metric: &str| {
            ["0.5", "1.5", "2.5", "5"].map(|threshold| of(&thresholds, scene, metric, threshold))
        };
        assert!(
            along("shown_hidden").is_sorted_by(|a, b| a >= b),
            "{scene} {:?}",
            along("shown_hidden")
        );
        assert!(along("lost_visible").is_sorted(), "{scene} {:?}", along("lost_visible"));
        assert!(along("lost_visible")[3] > along("lost_visible")[0]);
    }
}

#[test]
fn the_fill_study_keeps_its_promises() {
    let rows = configured("fill", 31, 4, 4);
    for scene in ["all scenes", "sphere", "torus"] {
        let error = |metric: &str, value: &str| of(&rows, scene, metric, value);
        // Larger splats leave fewer holes and spill more; without visibility pull-push floods the
        // background; points alone spill nothing.
        let splats = |metric: &str| {
            ["splat 1 px", "splat 3 px", "splat 9 px"].map(|value| error(metric, value))
        };
        assert!(
            splats("holes").is_sorted_by(|a, b| a >= b) && splats("spilled").is_sorted(),
            "{scene}"
        );
        assert!(
            error("holes", "pullpush, no visibility") == 0.0
                && error("spilled", "pullpush, no visibility") > 0.1,
            "{scene}"
        );
        assert!(
            error("spilled", "points") == 0.0 && error("holes", "points") > error("holes", "auto"),
            "{scene}"
        );
    }
}

#[test]
fn the_smooth_study_keeps_its_promises() {
    let rows = configured("smooth", 15, 2, 2);
    for scene in ["all scenes", "sphere", "torus"] {
        let error = |metric: &str, value: &str| of(&rows, scene, metric, value);
        // Every filter removes steps.
        let [none, filters @ ..] =
            ["none", "alleviated", "gaussian", "box"].map(|value| error("roughness_rms", value));
        assert!(filters.iter().all(|filter| *filter < 0.8 * none), "{scene}: {none}, {filters:?}");
        // They lie where something was filled: smoothing there takes nearly as much of a surface's
        // roughness as smoothing all, and leaves it as near to the truth.
        for filled in ["auto", "alleviated"] {
            let taken =
                [filled, "all, alleviated"].map(|value| none - error("roughness_rms", value));
            let depth = [filled, "all, alleviated"].map(|value| error("depth_rms", value));
            assert!(
                taken[0] > 0.9 * taken[1] && depth[0] < 1.1 * depth[1],
                "{scene}: {filled} {taken:?}, {depth:?}"
            );
        }
    }
    for ((scene, view, metric), rows) in
        groups(&rows).into_iter().filter(|((scene, ..), _)| *scene != "all scenes")
    {
        let error = |value: &str| rows.iter().find(|row| row.value == value).unwrap().error;
        assert!(
            ["alleviated", "box"].into_iter().any(|filter| error(filter) == error("auto")),
            "{scene}, {view}: {metric}"
        );
    }
}

#[test]
fn the_shape_study_keeps_its_promises() {
    let rows = configured("shape", 9, 2, 2);
    for scene in ["all scenes", "sphere", "torus"] {
        let own = ["1", "4", "16", "64"].map(|levels| of(&rows, scene, "self_rms", levels));
        assert!(own.is_sorted_by(|a, b| a > b) && own[3] == 0.0, "{scene}: {own:?}");
    }
}

#[test]
fn the_ao_study_keeps_its_promises() {
    let rows = configured("ao", 14, 2, 2);
    for scene in ["all scenes", "sphere", "torus"] {
        let own = ["2", "auto", "64"].map(|directions| of(&rows, scene, "self_rms", directions));
        assert!(own.is_sorted_by(|a, b| a > b), "{scene}: {own:?}");
    }
}

/// Compares the remaining steps and lost details of both corrections with the offline reference; a
/// tenth more is allowed. The default brings the picture nearer to the truth by 6 dB.
#[test]
fn the_luminance_study_keeps_its_promises() {
    let (rows, text, charts) =
        made("luminance", &Plan { points: 150_000, repeat: 1, size: [160, 96], ..PLAN });
    // Three sizes, sixteen configurations, three metrics.
    assert_eq!((rows.len(), text.lines().count(), charts), (144, 145, 3));
    for ((_, view, metric), rows) in groups(&rows) {
        let error = |value: &str| rows.iter().find(|row| row.value == value).unwrap().error;
        let [before, auto, after, reference] =
            ["uncorrected", "auto", "alone", "reference"].map(error);
        println!(
            "{view} {metric}: {before} before, {auto} with what is called for, {after} averaged, {reference} offline"
        );
        match metric {
            "step" => assert!(auto <= 1.1 * reference && auto < 0.1 * before, "{view}"),
            "detail_lost" => assert!(auto <= reference + 0.05, "{view}"),
            _ => assert!(auto <= 0.5 * before, "{view}"),
        }
        // A pixel of 40 x 24 is wider than what there is to see.
        if view == "quarter" {
            continue;
        }
        match metric {
            "step" => assert!(after < 0.9 * before && after <= 1.1 * reference, "{view}"),
            "detail_lost" => assert!(after <= reference + 0.1 && before < 0.05, "{view}"),
            // Exposures that have become equal are not the truth's.
            _ => assert!(after <= reference, "{view}"),
        }
    }
}

/// Scattering, border, shadowing: averaging on the screen leaves less of each than averaging over
/// neighbours.
#[test]
fn where_stations_meet_on_a_wall_the_correction_leaves_less_than_the_reference() {
    let plan = Plan { points: 60_000, size: [128, 72], repeat: 1, ..PLAN };
    let table = gpu::with(gpu::WAYS[0], |gpu| {
        pointillist::study::luminance::problems::table(gpu, &plan, &Silent)
    })
    .unwrap();
    assert_eq!(table.rows.len(), 15);
    for region in table.rows.chunks(5) {
        let numbers = |row: &[String]| [2, 3, 4].map(|column| row[column].parse::<f64>().unwrap());
        let [before, reference, even, after, both] =
            [0, 1, 2, 3, 4].map(|way| numbers(&region[way]));
        println!("{}: {before:?} before, {reference:?} offline, {after:?} after", region[0][0]);
        assert!(
            (0..2).all(|k| after[k] < 0.25 * before[k] && after[k] <= reference[k]),
            "{}",
            region[0][0]
        );
        // Each station's own side stays unchanged: nothing tells which of the two is right.
        assert!(after[2] <= before[2] && after[2] <= 1.1 * reference[2], "{}", region[0][0]);
        // A factor per station mends all but a shadow, and does no harm to that.
        assert!(
            region[0][0] == "shadowing" || (0..3).all(|k| even[k] < 0.1 * before[k]),
            "{}: {even:?}",
            region[0][0]
        );
        assert!(
            (0..3).all(|k| even[k] <= 1.01 * before[k] && both[k] <= 1.1 * reference[k]),
            "{}: {even:?} {both:?}",
            region[0][0]
        );
    }
}

/// Two strips of an airborne scan, which see the same roofs and trees from two sides, by their
/// intensities. Their truth is unknown, but the offline reference can be compared.
#[test]
fn strips_of_a_real_scan_meet_as_closely_as_offline_and_keep_as_many_details() {
    let Some(path) = shared("data/aerial/ign_2strips.laz") else { return };
    let mut strips =
        cloud::read(&[path], &ReadOptions::new(ColumnSet::ALL, false), &Silent).unwrap();
    // The reference needs colours.
    let columns = &mut strips.parts[0].columns;
    let intensity = columns.intensity.take().unwrap();
    let most = *intensity.iter().max().unwrap() as f64;
    columns.rgb = Some(
        intensity
            .iter()
            .map(|&value| [(255.0 * (value as f64 / most).sqrt()).round().max(1.0) as u8; 3])
            .collect(),
    );
    let (mut offline, mut marked) = (strips.clone(), strips.clone());
    index::attributes::luminance::correct(
        &mut offline,
        index::attributes::luminance::NEIGHBOURS,
        &Silent,
    )
    .unwrap();
    let sources = strips.parts[0].columns.source.as_ref().unwrap();
    marked.parts[0].columns.rgb = Some(
        sources
            .iter()
            .map(|&source| if source == sources[0] { [255, 1, 1] } else { [1, 1, 255] })
            .collect(),
    );
    let plain = gpu::bare();
    let mut averaged = plain.clone();
    averaged.effects.set_any("luminance=on").unwrap();
    for side in [56, 104] {
        let size = [side, side];
        let view =
            View::new(Camera::framing(Preset::Top, &strips.core_points(), size), size).unwrap();
        let draw = |cloud: &Cloud, settings| gpu::draw(Way::Compute64, cloud, &view, settings);
        let station: Vec<bool> =
            draw(&marked, &plain).color.iter().map(|color| color[0] > color[2]).collect();
        // Differences of neighbours on one surface in stops: the mean between stations, from the
        // second to the first, in which the scene's own differences cancel; the mean square within
        // one; and the first one's standard error.
        let judged = |cloud: &Cloud, settings| {
            let drawn = draw(cloud, settings);
            let (mut between, mut within) = (Vec::new(), Vec::new());
            for i in 0..drawn.depth.len() {
                for k in [
                    (i % side as usize + 1 < side as usize).then_some(i + 1),
                    Some(i + side as usize),
                ]
                .into_iter()
                .flatten()
                {
                    let is_one =
                        k < drawn.depth.len() && (drawn.depth[i] - drawn.depth[k]).abs() < 0.5;
                    if !is_one {
                        continue;
                    }
                    let step = (drawn.color[i][0] as f64 / drawn.color[k][0] as f64).log2();
                    match (station[i], station[k]) {
                        (true, false) => between.push(step),
                        (false, true) => between.push(-step),
                        _ => within.push(step * step),
                    }
                }
            }
            let mean = |steps: &[f64]| steps.iter().sum::<f64>() / steps.len() as f64;
            assert!(between.len() > 500 && within.len() > 500);
            let spread = mean(&between.iter().map(|step| step * step).collect::<Vec<_>>()).sqrt();
            [mean(&between).abs(), mean(&within), spread / (between.len() as f64).sqrt()]
        };
        let [before, after, reference] =
            [judged(&strips, &plain), judged(&strips, &averaged), judged(&offline, &plain)];
        let lost = |judged: [f64; 3]| 1.0 - judged[1] / before[1];
        println!(
            "{side}: steps of {:.3} stops become {:.3}, offline {:.3}; details lost {:.2}, offline {:.2}",
            before[0],
            after[0],
            reference[0],
            lost(after),
            lost(reference)
        );
        // Both are near zero, and a mean of this many steps is known to its standard error.
        assert!(
            after[0] <= 1.1 * reference[0] + 2.0 * after[2] && after[0] < 0.02 * before[0],
            "{after:?} {reference:?}"
        );
        assert!(lost(after) <= lost(reference) + 0.05, "{after:?} {reference:?}");
    }
}

/// Every pass is nearer to the exact sort, sixteen are near enough for a torus, and another order
/// is another picture.
#[test]
fn the_strokes_study_keeps_its_promises() {
    let (rows, text, charts) = made("strokes", &Plan { points: 4_000, repeat: 1, ..PLAN });
    // Two scenes, fourteen configurations.
    assert_eq!((rows.len(), text.lines().count(), charts), (28, 29, 1));
    fronts_are_fronts(&rows);
    for ((scene, ..), rows) in groups(&rows) {
        let error = |value: &str| rows.iter().find(|row| row.value == value).unwrap().error;
        let falling = ["1", "2", "4", "8", "16", "32"].map(error);
        println!(
            "{scene}: {falling:?}, opaque {}, whole strokes {}",
            error("opaque"),
            error("stroke")
        );
        assert_eq!(error("auto"), 0.0, "{scene}");
        assert!(falling.is_sorted_by(|a, b| a >= b) && falling[0] > 0.0, "{scene}: {falling:?}");
        assert!(error("stroke") > 0.0 && error("stroke") < falling[0], "{scene}");
    }
}

/// Compares with a search through all points.
#[test]
fn the_offline_reference_averages_the_nearest() {
    let world = synth::build(SceneKind::Sphere, 1, 0.0);
    let mut cloud = synth::collect("sphere", &world, 3_000, 5, 0.0, &Silent).unwrap();
    let columns = cloud.parts[0].columns.clone();
    let (positions, colors) = (&columns, columns.rgb.as_ref().unwrap());
    let squared = |i: usize, k: usize| {
        let apart = |column: &[i32]| (column[i] as f64 - column[k] as f64).powi(2);
        apart(&positions.x) + apart(&positions.y) + apart(&positions.z)
    };
    let value = |i: usize| *colors[i].iter().max().unwrap() as f64;
    pointillist::index::attributes::luminance::correct(&mut cloud, 12, &Silent).unwrap();
    let corrected = cloud.parts[0].columns.rgb.as_ref().unwrap();
    for i in (0..3_000).step_by(7) {
        let mut others: Vec<usize> = (0..3_000).filter(|&k| squared(i, k) > 0.0).collect();
        others.sort_by(|&a, &b| squared(i, a).total_cmp(&squared(i, b)));
        // Either of equally far ones may count.
        if squared(i, others[10]) == squared(i, others[11]) {
            continue;
        }
        let mean = (value(i) + others[..11].iter().map(|&k| value(k)).sum::<f64>()) / 12.0;
        let expected = colors[i].map(|channel| (channel as f64 * mean / value(i)).round() as u8);
        assert_eq!(corrected[i], expected);
    }
}

/// More samples are nearer to the truth in half shadow, and both methods mark the same points.
#[test]
fn the_shadows_study_keeps_its_promises() {
    let (rows, text, charts) = made("shadows", &Plan { points: 60_000, repeat: 1, ..PLAN });
    // Eleven configurations, two metrics.
    assert_eq!((rows.len(), text.lines().count(), charts), (22, 23, 2));
    fronts_are_fronts(&rows);
    for ((.., metric), rows) in groups(&rows) {
        let error = |value: &str| rows.iter().find(|row| row.value == value).unwrap().error;
        let falling = ["1", "4", "auto"].map(error);
        assert!(metric != "rms" || falling.is_sorted_by(|a, b| a > b), "{falling:?}");
        assert_eq!(error("4"), error("index 4"), "{metric}");
    }
}

/// More points average out noise; the default is within its documented bounds.
#[test]
fn the_normals_study_keeps_its_promises() {
    let (rows, text, charts) = made("normals", &Plan { points: 20_000, repeat: 1, ..PLAN });
    // Four scenes, nine settings, three metrics.
    assert_eq!((rows.len(), text.lines().count(), charts), (108, 109, 3));
    fronts_are_fronts(&rows);
    for ((scene, view, metric), rows) in groups(&rows) {
        let error = |parameter: &str, value: &str| {
            rows.iter().find(|row| row.parameter == parameter && row.value == value).unwrap().error
        };
        let by_radius = ["2", "3", "6"].map(|value| error("radii", value));
        println!("{scene} {view} {metric}: {by_radius:?}");
        assert_eq!(error("radii", "3"), error("neighbours", "8"));
        match (metric, scene.starts_with("noisy")) {
            ("median_degrees", false) => assert!(by_radius[1] < 1.0, "{scene}: {by_radius:?}"),
            ("median_degrees", true) => assert!(
                by_radius.is_sorted_by(|a, b| a > b) && by_radius[1] < 5.0,
                "{scene}: {by_radius:?}"
            ),
            ("unknown", _) => assert_eq!(by_radius[1], 0.0, "{scene}"),
            _ => {}
        }
    }
}

#[test]
fn the_tune_study_keeps_its_promises() {
    let plan = Plan { points: 30_000, repeat: 1, size: [64, 48], ..PLAN };
    let (rows, text, charts) = made("tune", &plan);
    // Seven times with four metrics, five errors with two.
    assert_eq!((rows.len(), text.lines().count(), charts), (7 * 4 + 5 * 2, 39, 1));
    let of = |metric: &str| {
        rows.iter().filter(|row| row.metric == metric).map(|row| row.error).collect::<Vec<_>>()
    };
    for share in ["missed_first", "missed", "broken"] {
        assert!(of(share).iter().all(|share| (0.0..=1.0).contains(share)), "{share}");
    }
    let (median, most) = (of("ratio_median"), of("ratio_most"));
    assert_eq!(median.len(), 7);
    for (median, most) in median.iter().zip(&most) {
        assert!(1.0 <= *median && median <= most, "{median} {most}");
    }
    // A coarser error asked for never gets a finer picture's time.
    assert_eq!(of("error_most").len(), 5);
}

/// Nothing is nearer to the finest picture than itself, and every knob that acts has a chart.
#[test]
fn the_files_study_keeps_its_promises() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a street.las");
    scan(&path, SceneKind::Street, 20_000);
    let plan = Plan { repeat: 1, size: [64, 48], files: vec![path], ..PLAN };
    let (rows, text, charts) = made("files", &plan);
    assert_eq!(rows.len() + 1, text.lines().count());
    fronts_are_fronts(&rows);
    for ((scene, view, metric), rows) in groups(&rows) {
        assert!(scene == "a street.las" && metric.starts_with("self_"), "{scene} {metric}");
        let error = |value: &str| rows.iter().find(|row| row.value == value).unwrap().error;
        assert_eq!(error("finest"), 0.0, "{view} {metric}");
        assert!(error("fill=off,levels=10") > error("auto"), "{view} {metric}");
    }
    let knobs: BTreeSet<_> = rows.iter().map(|row| row.parameter).collect();
    // Besides knobs, the default and the finest; besides charts of knobs, those of both metrics.
    assert!(knobs.contains("shape") && !knobs.contains("luminance"), "{knobs:?}");
    assert_eq!(charts, knobs.len() - 2 + 2);
}
