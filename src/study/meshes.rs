//! Study `meshes`: the vertices of meshes, drawn with default settings, against the meshes
//! themselves.
//!
//! A mesh has fewer vertices where it is flat: points lie from a fraction of a pixel to tens of
//! pixels apart in one picture. That is typical of unknown scans, and where methods fail that were
//! tuned on evenly sampled surfaces. The parameter is the filling; the metrics are those of
//! `surface`.

use super::cases;
use super::configurations::AUTO;
use super::mesh::Mesh;
use super::report::{self, Section, Table};
use super::surface::{draw, render_settings};
use super::truth::{Errors, Surface, Truth, compare};
use super::{Plan, mark_fronts, rows, sweep, white, yardstick};
use crate::error::Result;
use crate::graph::Gpu;
use crate::progress::Progress;
use crate::view::{Camera, Projection, View};
use glam::DVec3;
use std::path::Path;

pub const SUMMARY: &str = "the same for vertices of meshes, whose density is uneven";

/// Names of views; the eye from the middle of the bounding box, in its diagonals; field of view
/// `[degrees]`.
const VIEWS: [(&str, DVec3, f64); 2] =
    [("whole", DVec3::new(0.1, 0.15, 1.3), 45.0), ("near", DVec3::new(0.3, 0.35, 0.9), 30.0)];

/// Fillings and their settings.
const STYLES: [(&str, &[&str]); 4] = [
    ("auto", &["visibility=auto", "fill=auto", "shape=off", "edl=off"]),
    ("pullpush", &["visibility=auto", "fill=auto,method=pullpush", "shape=off", "edl=off"]),
    ("median", &["visibility=auto", "fill=auto,method=median", "shape=off", "edl=off"]),
    (
        "single",
        &[
            "visibility=auto,levels=1,kernel=9,threshold=2.1",
            "fill=auto,method=median",
            "shape=off",
            "edl=off",
        ],
    ),
];

const METRICS: [&str; 4] = ["depth_share", "layer_share", "holes", "spilled"];

const HEAD: [&str; 8] =
    ["mesh", "view", "filling", "interior pixels", "depth off", "wrong layer", "holes", "spilled"];

impl Surface for Mesh {
    fn first(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        Mesh::first(self, origin, direction)
    }
}

pub fn run(gpu: &mut Gpu, plan: &Plan, progress: &dyn Progress) -> Result<Section> {
    let styles = STYLES
        .iter()
        .map(|(name, settings)| Ok((*name, render_settings(settings)?)))
        .collect::<Result<Vec<_>>>()?;
    let (mut all, mut linear) = (Vec::new(), Vec::new());
    let mut table = Table {
        title: "All meshes".into(),
        head: HEAD.map(String::from).to_vec(),
        rows: Vec::new(),
    };
    for (scene, file) in cases::meshes()
        .filter(|(name, _)| plan.scenes.is_empty() || plan.scenes.iter().any(|scene| scene == name))
    {
        let path = Path::new("../shared/data").join(file);
        if !path.exists() {
            progress.note(&format!("study meshes leaves out {scene}: no file {}", path.display()));
            continue;
        }
        let mesh = Mesh::read(&path, |place| place)?;
        let cloud = cases::cloud(scene, &mesh.vertices);
        for (view_name, view) in views(&mesh, plan.size)? {
            progress.tick("study meshes", 0, 0)?;
            let truth = Truth::cast(&view, &mesh);
            let mut add = |names: &[&str; 3], errors: &Errors| {
                let names = names.map(String::from).into_iter();
                let line: Vec<String> = names
                    .chain([errors.interior.to_string()])
                    .chain(shares(errors).map(|share| format!("{share:.1e}")))
                    .collect();
                progress.note(&line.join("  "));
                table.rows.push(line);
            };
            let resident = white(gpu, &cloud, progress)?;
            let raw = draw(
                gpu,
                &view,
                &resident,
                &render_settings(&["visibility=off", "fill=off", "shape=off", "edl=off"])?,
            )?
            .depth;
            let order: Vec<usize> = (0..styles.len()).collect();
            let mut depths = vec![Vec::new(); styles.len()];
            let times = sweep::interleaved(&order, plan.repeat, |&style| {
                let drawing = draw(gpu, &view, &resident, &styles[style].1)?;
                depths[style] = drawing.depth;
                Ok(drawing.ms)
            })?;
            for (((style, _), depth), times) in styles.iter().zip(&depths).zip(&times) {
                let errors = compare(&truth, 0.0, &raw, depth, None);
                let parameter = if *style == AUTO { AUTO } else { "fill" };
                let shares = shares(&errors);
                all.extend(rows([scene, view_name], [parameter, style], METRICS, &shares, times));
                add(&[scene, view_name, style], &errors);
            }
            let visible = yardstick::visible(&truth, 0.0, &raw);
            let depth = yardstick::linear(&truth, &raw, &visible);
            let errors = compare(&truth, 0.0, &raw, &depth, None);
            linear.extend(rows(
                [scene, view_name],
                ["fill", yardstick::NAME],
                METRICS,
                &shares(&errors),
                &[0.0],
            ));
            add(&[scene, view_name, yardstick::NAME], &errors);
        }
    }
    mark_fronts(&mut all);
    all.extend(linear);
    let charts = METRICS.map(|metric| {
        let axes = ["milliseconds of a frame", "share of pixels"];
        report::chart(metric, axes, &metric.replace('_', " "), &all, &|row| row.value.clone())
    });
    let method = format!(
        "Vertices of meshes, and their triangles as truth, ray-cast in f64 as in <em>surface</em>. With c the middle of the bounding box and e its diagonal the eye is at \
         c + e (0.1, 0.15, 1.3), 45 degrees (whole), and at c + e (0.3, 0.35, 0.9), 30 degrees (near). <em>Linear</em> is the best that vertices can tell: the truth says which are visible, depths between them are interpolated linearly. n = {} interleaved rounds.",
        plan.repeat
    );
    Ok(Section {
        name: "meshes",
        title: "Vertices of meshes".into(),
        method,
        rows: all,
        charts: charts.into(),
        tables: vec![table],
    })
}

fn shares(errors: &Errors) -> [f64; 4] {
    [
        errors.misplaced_share(),
        errors.wrong_layer_share(),
        errors.hole_share(),
        errors.spilled_share(),
    ]
}

fn views(mesh: &Mesh, size: [u32; 2]) -> Result<Vec<(&'static str, View)>> {
    let ends = |pick: fn(DVec3, DVec3) -> DVec3| {
        mesh.vertices.iter().copied().reduce(pick).unwrap_or_default()
    };
    let (low, high) = (ends(DVec3::min), ends(DVec3::max));
    let (target, diagonal) = (low.midpoint(high), (high - low).length());
    let view = |(name, toward, fov_y): (&'static str, DVec3, f64)| {
        let eye = target + diagonal * toward;
        let camera = Camera {
            eye,
            target,
            up: DVec3::Y,
            fov_y,
            projection: Projection::Perspective,
            ortho_height: None,
        };
        Ok((name, View::new(camera, size)?))
    };
    VIEWS.into_iter().map(view).collect()
}
