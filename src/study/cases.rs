//! Test surfaces with known truth, seen from several sides, as points of several densities.
//!
//! ```text
//!     scene -> its views -> Truth, cast once -> densities -> with and without noise -> Case
//! ```
//!
//! Closed-form scenes and meshes are sampled uniformly by area, independently, including hidden
//! sides; the street by its own scanner; meshes also as their vertices alone. Meshes are in an
//! optional data folder. A density is the number of points of the first surface per covered pixel,
//! since the share of hidden surfaces depends on the view. Noise is Gaussian along the ray to the
//! eye, so that silhouettes stay in place, and cut off at three sigma, so that every point lies
//! within the tolerances of metrics.

use super::mesh::Mesh;
use super::precision::finest_step;
use super::truth::{Errors, NOISE_SIGMAS, Surface, Truth, compare};
use crate::cloud::{Cloud, Columns, Header, Lattice, Part, Station};
use crate::error::Result;
use crate::progress::Progress;
use crate::synth::noise::Random;
use crate::synth::{self, World};
use crate::view::{Camera, Preset, Projection, View};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;

#[derive(Clone, Copy)]
enum Source {
    Synthetic(synth::SceneKind),
    /// A mesh in the data folder, and its vertical axis.
    Mesh(&'static str, Up),
}

#[derive(Clone, Copy)]
enum Up {
    Y,
    Z,
}

const SCENES: [(&str, Source); 8] = [
    ("sphere", Source::Synthetic(synth::SceneKind::Sphere)),
    ("torus", Source::Synthetic(synth::SceneKind::Torus)),
    ("step", Source::Synthetic(synth::SceneKind::Step)),
    ("street", Source::Synthetic(synth::SceneKind::Street)),
    ("bunny", Source::Mesh("objects/bun_zipper.ply", Up::Y)),
    ("armadillo", Source::Mesh("objects/armadillo.obj", Up::Y)),
    ("dragon", Source::Mesh("objects/stanford_dragon_437k.ply", Up::Y)),
    ("fragment", Source::Mesh("photogrammetry/frag_115.ply", Up::Z)),
];

pub const NAMES: [&str; SCENES.len()] = {
    let mut names = [""; SCENES.len()];
    let mut i = 0;
    while i < names.len() {
        names[i] = SCENES[i].0;
        i += 1;
    }
    names
};

/// Distance between the layers of `step` `[m]`: a fortieth of its width.
const GAP: f64 = 0.1;

/// Points of the pilot, which measures the share of a scene's points in a view and frames the
/// views.
const PILOT: u64 = 200_000;
const FRAMED_BY: u64 = 5_000;

/// Angle between the near view and the whole one `[degrees]`.
const ASIDE: f64 = 115.0;

/// Distance of the near view relative to the whole one: the picture is full, and a fifteenth of the
/// surface is in it.
const NEAR: f64 = 0.75;

#[derive(Clone, Debug)]
pub struct Options {
    /// Size of the pictures `[px]`.
    pub size: [u32; 2],
    pub seed: u64,
    /// Densities that need more points of a scene, seen or not, are skipped.
    pub most_points: u64,
    /// Folder of meshes.
    pub data: PathBuf,
    /// Names of scenes; all if empty.
    pub scenes: Vec<String>,
    /// Number of views per scene.
    pub views: usize,
    /// Points of the first surface per covered pixel.
    pub densities: Vec<f64>,
    /// Standard deviations of noise [px at a point's own depth].
    pub noises_px: Vec<f64>,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            size: [512, 512],
            seed: 1,
            most_points: 4_000_000,
            data: "../shared/data".into(),
            scenes: Vec::new(),
            views: 3,
            densities: vec![0.0025, 0.01, 0.04, 0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0],
            noises_px: vec![0.0, 0.5],
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sampling {
    /// About this many points of the first surface per covered pixel.
    Density(f64),
    /// The vertices of a mesh.
    Vertices,
}

/// A cloud in a view, and its truth.
pub struct Case {
    pub scene: &'static str,
    pub view_name: &'static str,
    pub sampling: Sampling,
    /// Points of the first surface per covered pixel, counted before noise.
    pub density: f64,
    /// Standard deviation of noise [px at a point's own depth].
    pub noise_px: f64,
    pub view: View,
    /// The points that fall into the picture.
    pub cloud: Cloud,
    pub truth: Arc<Truth>,
}

impl Case {
    /// Returns the errors; see [`compare`].
    pub fn errors(&self, raw: &[f32], depth: &[f32], visible: Option<&[bool]>) -> Errors {
        compare(&self.truth, self.noise_px, raw, depth, visible)
    }
}

/// Returns names and files of meshes in the data folder.
pub fn meshes() -> impl Iterator<Item = (&'static str, &'static str)> {
    SCENES.into_iter().filter_map(|(name, source)| {
        if let Source::Mesh(file, _) = source { Some((name, file)) } else { None }
    })
}

/// Visits every case in turn; each is made when needed. Returns a line for everything skipped.
pub fn each(
    options: &Options,
    progress: &dyn Progress,
    mut visit: impl FnMut(&Case) -> Result<()>,
) -> Result<Vec<String>> {
    let mut left_out = Vec::new();
    let wanted =
        |name: &str| options.scenes.is_empty() || options.scenes.iter().any(|scene| scene == name);
    for (scene, source) in SCENES.into_iter().filter(|(name, _)| wanted(name)) {
        progress.tick(scene, 0, 0)?;
        let Some(shown) = Shown::open(source, options)? else {
            left_out.push(format!("{scene}: {} has no such mesh", options.data.display()));
            continue;
        };
        let pilot = shown.points(PILOT, options.seed, progress)?;
        for (view_name, view) in
            shown.views(options.size, options.seed, progress)?.into_iter().take(options.views)
        {
            let truth = Arc::new(Truth::cast(&view, &shown));
            let covered = truth.inside.iter().filter(|inside| **inside).count() as f64;
            let density =
                |points: &[DVec3]| first_surface(&truth, points) as f64 / covered.max(1.0);
            let share = density(&pilot) / pilot.len() as f64;
            let count = |density: f64| (density / share).ceil();
            let affordable = |density: &f64| count(*density) <= options.most_points as f64;
            let (densities, too_dense): (Vec<f64>, Vec<f64>) =
                options.densities.iter().partition(|density| affordable(density));
            if let Some(least) = too_dense.iter().copied().reduce(f64::min) {
                left_out.push(format!("{scene}, {view_name}: {least} points a pixel and more, {:.0} points of the scene", count(least)));
            }
            let vertices = matches!(shown, Shown::Mesh(_)).then_some(Sampling::Vertices);
            for sampling in densities.into_iter().map(Sampling::Density).chain(vertices) {
                let points = match (sampling, &shown) {
                    (Sampling::Density(density), _) => {
                        &shown.points(count(density) as u64, options.seed, progress)?
                    }
                    (Sampling::Vertices, Shown::Mesh(mesh)) => &mesh.vertices,
                    (Sampling::Vertices, Shown::World(_)) => {
                        unreachable!("only meshes have vertices")
                    }
                };
                let density = density(points);
                for &noise_px in &options.noises_px {
                    let cloud = cloud(scene, &noisy(&truth, points, noise_px, options.seed));
                    let truth = truth.clone();
                    visit(&Case {
                        scene,
                        view_name,
                        sampling,
                        density,
                        noise_px,
                        view,
                        cloud,
                        truth,
                    })?;
                }
            }
        }
    }
    Ok(left_out)
}

enum Shown {
    World(Box<World>),
    Mesh(Mesh),
}

impl Surface for Shown {
    fn first(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        match self {
            Shown::World(world) => world.first(origin, direction),
            Shown::Mesh(mesh) => mesh.first(origin, direction),
        }
    }

    fn scanned(&self, point: DVec3) -> bool {
        let Shown::World(world) = self else { return true };
        let sees = |station: &synth::Station| {
            let ray = point - station.position;
            synth::reaches(ray)
                && world.first(station.position, ray).is_some_and(|reach| reach > 1.0 - 1e-6)
        };
        world.stations().is_empty() || world.stations().iter().any(sees)
    }
}

impl Shown {
    /// Opens a scene; `None` if its mesh is missing.
    fn open(source: Source, options: &Options) -> Result<Option<Shown>> {
        match source {
            Source::Synthetic(scene) => {
                let mut world = synth::build(scene, options.seed, GAP);
                // In small coordinates: large ones are for studies of position.
                world.offset = DVec3::ZERO;
                world.step = finest_step(&world);
                Ok(Some(Shown::World(Box::new(world))))
            }
            Source::Mesh(file, up) => {
                let path: &Path = &options.data.join(file);
                if !path.exists() {
                    return Ok(None);
                }
                let upright = |p: DVec3| match up {
                    Up::Y => DVec3::new(p.x, -p.z, p.y),
                    Up::Z => p,
                };
                Ok(Some(Shown::Mesh(Mesh::read(path, upright)?)))
            }
        }
    }

    fn points(&self, count: u64, seed: u64, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        match self {
            Shown::Mesh(mesh) => Ok((0..count)
                .into_par_iter()
                .map(|i| mesh.sample(&mut Random::new(seed, 0, i)))
                .collect()),
            Shown::World(world) => {
                let mut points = Vec::with_capacity(count as usize);
                let mut keep = |chunk: &synth::Chunk| {
                    let step = chunk.lattice.step;
                    points.extend((0..chunk.len()).map(|i| {
                        DVec3::new(chunk.x[i] as f64, chunk.y[i] as f64, chunk.z[i] as f64) * step
                    }));
                    Ok(())
                };
                synth::scan(world, count, seed, 0.0, &mut keep, progress)?;
                Ok(points)
            }
        }
    }

    /// Returns the views: whole with perspective, near and from another side, and orthographic.
    fn views(
        &self,
        size: [u32; 2],
        seed: u64,
        progress: &dyn Progress,
    ) -> Result<[(&'static str, View); 3]> {
        let points = self.points(FRAMED_BY, seed, progress)?;
        let whole = Camera::framing(Preset::Fit, &points, size);
        let back = whole.eye - whole.target;
        let turned = DMat3::from_rotation_z(ASIDE.to_radians()) * back;
        let cameras = match self {
            Shown::World(world) if !world.stations().is_empty() => in_street(world),
            _ => [
                ("whole", whole),
                ("near", Camera { eye: whole.target + turned * NEAR, ..whole }),
                ("parallel", Camera::framing(Preset::Iso, &points, size)),
            ],
        };
        let [first, second, third] =
            cameras.map(|(name, camera)| Ok((name, View::new(camera, size)?)));
        Ok([first?, second?, third?])
    }
}

/// Returns the views of the street from where its scanners stood: along it, back, and orthographic
/// at its houses. Nothing above was scanned.
fn in_street(world: &World) -> [(&'static str, Camera); 3] {
    let (viewpoint, stations) = (world.camera(), world.stations());
    let along = Camera {
        eye: viewpoint.eye,
        target: viewpoint.target,
        up: DVec3::Z,
        fov_y: viewpoint.fov_y,
        projection: Projection::Perspective,
        ortho_height: None,
    };
    let end = stations
        .iter()
        .map(|station| station.position)
        .max_by(|a, b| a.y.total_cmp(&b.y))
        .expect("a street has stations");
    // Beside the station: from the station itself nothing it saw is hidden.
    let back = Camera { eye: end + DVec3::new(0.6, 0.0, 0.3), target: viewpoint.eye, ..along };
    let above = stations[1].position + DVec3::Z * 4.0;
    let target = above + DVec3::new(1.0, 1.0, -0.1);
    let houses = Camera {
        eye: above,
        target,
        projection: Projection::Orthographic,
        ortho_height: Some(16.0),
        ..along
    };
    [("along", along), ("back", back), ("parallel", houses)]
}

/// Projects a point to its pixel and planar depth.
fn projected(view: &View, point: DVec3) -> Option<(usize, f64)> {
    let from_eye = point - view.camera.eye;
    let depth = from_eye.dot(view.basis.forward);
    let scale = match view.camera.projection {
        Projection::Perspective => view.focal_px() / depth,
        Projection::Orthographic => view.focal_px(),
    };
    let [width, height] = view.size.map(f64::from);
    let (x, y) = (
        from_eye.dot(view.basis.right) * scale + width / 2.0,
        height / 2.0 - from_eye.dot(view.basis.up) * scale,
    );
    let inside = depth > 0.0 && (0.0..width).contains(&x) && (0.0..height).contains(&y);
    inside.then(|| (y as usize * view.size[0] as usize + x as usize, depth))
}

/// Counts the points of the first surface within the silhouette.
fn first_surface(truth: &Truth, points: &[DVec3]) -> usize {
    let seen = |point: &&DVec3| {
        projected(&truth.view, **point).is_some_and(|(pixel, depth)| {
            truth.inside[pixel] && truth.is_visible(pixel, depth, 0.0) == Some(true)
        })
    };
    points.par_iter().filter(seen).count()
}

/// Returns the points, moved along the ray to the eye by noise. Those beyond the picture are kept,
/// since surfaces do not end at its edges.
fn noisy(truth: &Truth, points: &[DVec3], noise_px: f64, seed: u64) -> Vec<DVec3> {
    let view = &truth.view;
    points
        .par_iter()
        .enumerate()
        .map(|(i, point)| {
            let depth = view.basis.forward.dot(*point - view.camera.eye);
            // Points behind the eye are in no picture.
            if noise_px == 0.0 || depth <= 0.0 {
                return *point;
            }
            let mut random = Random::new(seed, 1, i as u64);
            let sigmas = std::iter::repeat_with(|| random.normal())
                .find(|sigmas| sigmas.abs() <= NOISE_SIGMAS)
                .expect("endless");
            let by = sigmas * noise_px * truth.pixel_m(depth);
            match view.camera.projection {
                Projection::Perspective => {
                    view.camera.eye + (*point - view.camera.eye) * (1.0 + by / depth)
                }
                Projection::Orthographic => *point + view.basis.forward * by,
            }
        })
        .collect()
}

/// Returns a cloud on a lattice of less than 2^30 steps across, as fine as that of floating-point
/// files.
pub(super) fn cloud(name: &str, points: &[DVec3]) -> Cloud {
    let (min, max) = points
        .iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), &p| (min.min(p), max.max(p)));
    let min = if points.is_empty() { DVec3::ZERO } else { min };
    let across = (max - min).max_element().max(f64::MIN_POSITIVE);
    let step = 2f64.powi(across.log2().floor() as i32 + 1 - 30);
    let steps = |axis: usize| {
        points.par_iter().map(|p| ((p[axis] - min[axis]) / step).round() as i32).collect()
    };
    let columns = Columns { x: steps(0), y: steps(1), z: steps(2), ..Columns::default() };
    let part = Part {
        path: PathBuf::from(name),
        name: None,
        header: Header::default(),
        lattice: Lattice { step: DVec3::splat(step), offset: min },
        columns,
        intensity_range: [0.0, 65_535.0],
        rgb_scale: Default::default(),
    };
    let station =
        Station { part: 0, source: None, name: name.to_string(), points: points.len() as u64 };
    Cloud { parts: vec![part], stations: vec![station], ..Cloud::default() }
}
