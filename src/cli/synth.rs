//! `pointillist synth`: a simulated scan of an analytic scene as LAS, or its ground truth for a
//! camera as EXR.

use super::files::check_extension;
use super::named::named;
use super::units::Size;
use crate::atomic_file::write_atomically;
use crate::config;
use crate::error::{Error, Result};
use crate::output::image_io::{Samples, write_exr};
use crate::progress::Progress;
use crate::synth::{self, LasFile, SceneKind, Viewpoint, World};
use crate::view::{Camera, Projection, View};
use glam::DVec3;
use rayon::prelude::*;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  pointillist synth street -o street.laz --points 20000000        five stations, 2 mm noise, UTM coordinates
  pointillist synth step --gap 0.02 -o step.las --points 1000000  two layers 2 cm apart
  pointillist synth sphere -o s.las --offset 500000,5000000,100   the same sphere, far from the origin
  pointillist synth street --camera-out cam.json                  a good camera for the scene
  pointillist synth street --truth cam.json -o truth.exr --size 1920x1080
                                                                  what this camera sees, ray cast in f64";

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// What to scan
    #[arg(value_parser = named::<SceneKind>())]
    pub scene: SceneKind,
    /// The file to write: .las or .laz, with --truth .exr
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Number of points, exactly
    #[arg(long, default_value_t = 1_000_000, value_name = "N")]
    pub points: u64,
    /// Seed; the same seed gives the same file, byte for byte
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Standard deviation of the range, metres [default: 0.002 for street, 0.015 for terrain, else
    /// 0]
    #[arg(long, value_name = "METRES")]
    pub noise: Option<f64>,
    /// Distance between the layers of `step`, metres
    #[arg(long, default_value_t = 0.1, value_name = "METRES")]
    pub gap: f64,
    /// Lattice step of the coordinates, metres [default: 0.001 for street and terrain, else 0.0001]
    #[arg(long, value_name = "METRES")]
    pub step: Option<f64>,
    /// Offset of the scene, in metres [default: 500000,5000000,100 for street and terrain, else
    /// 0,0,0]
    #[arg(long, value_name = "E,N,H", value_parser = parse_offset, allow_hyphen_values = true)]
    pub offset: Option<DVec3>,
    /// Instead of scanning, ray-cast what this camera sees into an EXR picture
    #[arg(long, value_name = "CAMERA.json", requires = "output")]
    pub truth: Option<PathBuf>,
    /// Size of the --truth picture, pixels
    #[arg(long, value_name = "WxH", default_value_t = Size(config::SIZE))]
    pub size: Size,
    /// Write a good camera for the scene
    #[arg(long, value_name = "CAMERA.json")]
    pub camera_out: Option<PathBuf>,
}

/// Longest side of a truth [px], as of a device's images; a square of it takes 14 GiB.
const TRUTH_SIDE: u32 = 16_384;

fn parse_offset(text: &str) -> std::result::Result<DVec3, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|n| n.trim().parse::<f64>())
        .collect::<std::result::Result<_, _>>()
        .map_err(|e| e.to_string())?;
    match numbers[..] {
        [e, n, h] if e.is_finite() && n.is_finite() && h.is_finite() => Ok(DVec3::new(e, n, h)),
        _ => Err("expected three finite numbers: E,N,H".to_owned()),
    }
}

pub fn run(arguments: &Arguments, progress: &dyn Progress) -> Result<()> {
    if !arguments.gap.is_finite() {
        return Err(Error::Request(format!(
            "--gap {} is not a distance; give a finite number of metres",
            arguments.gap
        )));
    }
    let mut world = synth::build(arguments.scene, arguments.seed, arguments.gap);
    world.offset = arguments.offset.unwrap_or(world.offset);
    world.step = arguments.step.unwrap_or(world.step);
    if let Some(path) = &arguments.camera_out {
        let text = serde_json::to_string_pretty(&camera(world.camera()))
            .expect("a camera is plain numbers");
        write_atomically(path, |partial| {
            std::fs::write(partial, text + "\n").map_err(|e| Error::io("write", path, e))
        })?;
    }
    if let Some(output) = &arguments.output {
        check_extension(
            output,
            if arguments.truth.is_some() { &["exr"] } else { &["las", "laz"] },
        )?;
    }
    match (&arguments.output, &arguments.truth) {
        (Some(output), Some(camera)) => {
            if arguments.size.0.iter().any(|&side| side > TRUTH_SIDE) {
                let size = arguments.size;
                return Err(Error::Request(format!(
                    "--size {size} is too large for --truth; the most is {TRUTH_SIDE} pixels a side"
                )));
            }
            let view = View::new(Camera::read(camera)?, arguments.size.0)?;
            let Truth { channels, parts, .. } = truth(&world, &view, progress)?;
            let planes = channels.into_iter().map(|(name, values)| (name, Samples::Float(values)));
            write_exr(output, view.size, planes.chain([("index.V", Samples::Id(parts))]).collect())
        }
        (Some(output), None) => {
            let noise = arguments.noise.unwrap_or(arguments.scene.default_noise());
            let mut file = LasFile::create(output, world.lattice(), arguments.points)?;
            synth::scan(
                &world,
                arguments.points,
                arguments.seed,
                noise,
                &mut |chunk| file.write(chunk),
                progress,
            )?;
            file.finish()
        }
        (None, _) if arguments.camera_out.is_some() => Ok(()),
        (None, _) => Err(Error::Request(
            "nothing to write: give -o file.las or --camera-out camera.json".to_owned(),
        )),
    }
}

/// Converts the scene's own camera to the renderer's.
pub fn camera(viewpoint: Viewpoint) -> Camera {
    Camera {
        eye: viewpoint.eye,
        target: viewpoint.target,
        up: DVec3::Z,
        fov_y: viewpoint.fov_y,
        projection: Projection::Perspective,
        ortho_height: None,
    }
}

/// Ground truth of a view: one sample per pixel centre, as f32 planes.
pub struct Truth {
    pub size: [u32; 2],
    /// Name and values of every channel, row by row from the top left.
    pub channels: Vec<(&'static str, Vec<f32>)>,
    /// Part id of each pixel; `NO_POINT` where the ray hits nothing.
    pub parts: Vec<u32>,
}

const CHANNELS: [&str; 12] = [
    "R",
    "G",
    "B",
    "A",
    "depth.Z",
    "normal.X",
    "normal.Y",
    "normal.Z",
    "albedo.R",
    "albedo.G",
    "albedo.B",
    "luminance.V",
];

/// Casts a ray through every pixel centre. Misses have infinite depth and 0 elsewhere.
pub fn truth(world: &World, view: &View, progress: &dyn Progress) -> Result<Truth> {
    let [width, height] = view.size.map(|n| n as usize);
    let mut channels = vec![Vec::with_capacity(width * height); CHANNELS.len()];
    let mut parts = Vec::with_capacity(width * height);
    let rows_at_once = 16;
    for top in (0..height).step_by(rows_at_once) {
        progress.tick("ray casting", top as u64, height as u64)?;
        let rows = top..height.min(top + rows_at_once);
        let pixel = |i: usize| -> ([f32; 12], u32) {
            let (origin, direction) =
                view.ray((i % width) as f64 + 0.5, (top + i / width) as f64 + 0.5);
            let Some(hit) = world.trace(origin - world.offset, direction) else {
                let mut nothing = [0.0; 12];
                nothing[4] = f32::INFINITY;
                return (nothing, config::NO_POINT);
            };
            let (c, n, a) = (hit.lit.as_vec3(), hit.normal.as_vec3(), hit.albedo.as_vec3());
            // The direction's forward component is 1, so t is planar depth.
            (
                [
                    c.x,
                    c.y,
                    c.z,
                    1.0,
                    hit.t as f32,
                    n.x,
                    n.y,
                    n.z,
                    a.x,
                    a.y,
                    a.z,
                    hit.luminance as f32,
                ],
                hit.part,
            )
        };
        let pixels: Vec<_> = (0..rows.len() * width).into_par_iter().map(pixel).collect();
        for (values, part) in pixels {
            parts.push(part);
            channels.iter_mut().zip(values).for_each(|(channel, value)| channel.push(value));
        }
    }
    Ok(Truth { size: view.size, channels: CHANNELS.into_iter().zip(channels).collect(), parts })
}
