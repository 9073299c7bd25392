//! The closed-form scenes: plane, sphere, torus, nested tori, step.

use super::light::Light;
use super::material::Material;
use super::panel::Panel;
use super::shapes::{Pose, Shape, Solid};
use super::world::{Method, Viewpoint, World, solid};
use glam::{DVec2, DVec3};

/// ASPRS "unclassified"; the parts of a scene get the classes from here on.
const CLASS: u8 = 1;

fn viewpoint(eye: [f64; 3], target: [f64; 3]) -> Viewpoint {
    Viewpoint { eye: eye.into(), target: target.into(), fov_y: 40.0 }
}

fn by_area(solids: Vec<Solid>, viewpoint: Viewpoint) -> World {
    let total: f64 = solids.iter().map(Solid::area).sum();
    let shares = solids.iter().map(|s| s.area() / total).collect();
    World::new(solids, Vec::new(), Light::studio(), Method::Area { shares }, viewpoint)
}

fn square(width: f64, height: f64, corner: DVec3, colors: [DVec3; 2], part: u32) -> Solid {
    let panel = Panel { size: DVec2::new(width, height), gable: 0.0, openings: None };
    solid(
        Pose::at(corner),
        Shape::Panel(panel),
        Material::Checks { colors, size: 0.5 },
        part,
        CLASS + part as u8,
    )
}

const SAND: DVec3 = DVec3::new(0.72, 0.58, 0.38);
const CREAM: DVec3 = DVec3::new(0.86, 0.80, 0.68);
const TEAL: DVec3 = DVec3::new(0.10, 0.42, 0.45);
const CORAL: DVec3 = DVec3::new(0.80, 0.27, 0.18);
const NIGHT: DVec3 = DVec3::new(0.12, 0.18, 0.38);

/// 4 m x 4 m, z = 0.
pub fn plane() -> World {
    by_area(
        vec![square(4.0, 4.0, DVec3::new(-2.0, -2.0, 0.0), [SAND, CREAM], 0)],
        viewpoint([2.6, -4.6, 3.2], [0.0, 0.0, 0.0]),
    )
}

/// Radius 1 m around the origin.
pub fn sphere() -> World {
    let material = Material::Globe { colors: [CORAL, CREAM], bands: 6.0, major: 0.0 };
    let ball = solid(
        Pose::at(DVec3::ZERO),
        Shape::Ellipsoid { semi_axes: DVec3::ONE },
        material,
        0,
        CLASS,
    );
    by_area(vec![ball], viewpoint([1.3, -3.1, 1.4], [0.0, 0.0, 0.0]))
}

fn torus_solid(minor: f64, colors: [DVec3; 2], part: u32) -> Solid {
    let material = Material::Globe { colors, bands: 9.0, major: 1.0 };
    solid(
        Pose::at(DVec3::ZERO),
        Shape::Torus { major: 1.0, minor },
        material,
        part,
        CLASS + part as u8,
    )
}

/// Major radius 1 m, minor 0.4 m.
pub fn torus() -> World {
    by_area(vec![torus_solid(0.4, [TEAL, CREAM], 0)], viewpoint([1.6, -3.0, 2.4], [0.0, 0.0, 0.0]))
}

/// Builds Dobrev's figure 17: one ring inside the other, brown in green in blue, a third of the
/// points each, six layers on a ray.
pub fn nested_tori() -> World {
    let brown = [DVec3::new(0.36, 0.19, 0.08), DVec3::new(0.46, 0.27, 0.13)];
    let green = [DVec3::new(0.13, 0.48, 0.14), DVec3::new(0.25, 0.60, 0.22)];
    let blue = [DVec3::new(0.10, 0.22, 0.66), DVec3::new(0.18, 0.34, 0.78)];
    let solids =
        vec![torus_solid(0.14, brown, 0), torus_solid(0.27, green, 1), torus_solid(0.40, blue, 2)];
    let shares = vec![1.0 / 3.0; 3];
    World::new(
        solids,
        Vec::new(),
        Light::studio(),
        Method::Area { shares },
        viewpoint([1.6, -3.0, 2.4], [0.0, 0.0, 0.0]),
    )
}

/// Builds a layer at z = 0, 4 m x 4 m, and `gap` above it another that covers its half x > 0: a
/// depth step of known size, and a hidden layer.
pub fn step(gap: f64) -> World {
    let low = square(4.0, 4.0, DVec3::new(-2.0, -2.0, 0.0), [NIGHT, TEAL], 0);
    let high = square(2.0, 4.0, DVec3::new(0.0, -2.0, gap), [SAND, CREAM], 1);
    by_area(vec![low, high], viewpoint([-4.0, -3.4, 3.4 + gap], [0.0, 0.0, 0.0]))
}
