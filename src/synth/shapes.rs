//! Analytic primitives of a scene: first crossings of rays, in closed form.
//!
//! Every shape is defined in local coordinates and posed by an orthonormal frame, so that a hit is
//! as exact as f64 at the size of the shape, wherever it is. Normals are outward, or towards the
//! ray for shapes without an inside.

use super::bvh::Aabb;
use super::material::Material;
use super::noise::Random;
use super::panel::{Panel, Recess};
use super::{terrain, torus};
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// The pose of a shape: its origin and its local x, y, z in scene coordinates, orthonormal.
#[derive(Clone, Copy, Debug)]
pub struct Pose {
    pub origin: DVec3,
    pub x: DVec3,
    pub y: DVec3,
    pub z: DVec3,
}

impl Pose {
    pub const fn at(origin: DVec3) -> Pose {
        Pose { origin, x: DVec3::X, y: DVec3::Y, z: DVec3::Z }
    }

    /// Returns a pose with local x along `x`, local z as near to `z` as a right angle allows.
    pub fn facing(origin: DVec3, x: DVec3, z: DVec3) -> Pose {
        let x = x.normalize();
        let z = (z - x * z.dot(x)).normalize();
        Pose { origin, x, y: z.cross(x), z }
    }

    /// Returns a pose turned about the vertical `[degrees]`, counter-clockwise from above.
    pub fn turned(origin: DVec3, degrees: f64) -> Pose {
        let (sin, cos) = degrees.to_radians().sin_cos();
        Pose { origin, x: DVec3::new(cos, sin, 0.0), y: DVec3::new(-sin, cos, 0.0), z: DVec3::Z }
    }

    pub fn point(&self, p: DVec3) -> DVec3 {
        self.origin + self.vector(p)
    }

    pub fn vector(&self, v: DVec3) -> DVec3 {
        self.x * v.x + self.y * v.y + self.z * v.z
    }

    pub fn local_point(&self, p: DVec3) -> DVec3 {
        self.local_vector(p - self.origin)
    }

    pub fn local_vector(&self, v: DVec3) -> DVec3 {
        DVec3::new(v.dot(self.x), v.dot(self.y), v.dot(self.z))
    }

    /// Returns the same orientation at another origin; `p` is local.
    pub fn moved(&self, p: DVec3) -> Pose {
        Pose { origin: self.point(p), ..*self }
    }
}

/// The half-space n.p <= offset.
#[derive(Clone, Copy, Debug)]
pub struct Face {
    pub normal: DVec3,
    pub offset: f64,
}

#[derive(Clone, Debug)]
pub enum Shape {
    Panel(Panel),
    Recess(Recess),
    Cuboid {
        half: DVec3,
    },
    /// A cuboid whose edges are rounded: all within `radius` of the cuboid `half - radius`.
    Rounded {
        half: DVec3,
        radius: f64,
    },
    Ellipsoid {
        semi_axes: DVec3,
    },
    /// Around z from z = 0 to `height`, with caps.
    Cylinder {
        radius: f64,
        height: f64,
    },
    Torus {
        major: f64,
        minor: f64,
    },
    /// The intersection of half-spaces: roofs, car cabins.
    Convex {
        faces: Vec<Face>,
        bounds: Aabb,
    },
    /// The ground of the airborne scene.
    Terrain {
        relief: terrain::Relief,
    },
}

/// A posed shape and its material.
#[derive(Clone, Debug)]
pub struct Solid {
    pub pose: Pose,
    pub shape: Shape,
    pub material: Material,
    /// The object it belongs to: a house, a car.
    pub part: u32,
    /// ASPRS class.
    pub class: u8,
}

impl Solid {
    /// Returns the first crossing with t in (t_min, t_max): its parameter and local normal.
    pub fn intersect(
        &self,
        origin: DVec3,
        direction: DVec3,
        t_min: f64,
        t_max: f64,
    ) -> Option<(f64, DVec3)> {
        let (o, d) = (self.pose.local_point(origin), self.pose.local_vector(direction));
        match &self.shape {
            Shape::Panel(panel) => panel.intersect(o, d, t_min, t_max),
            Shape::Recess(recess) => recess.intersect(o, d, t_min, t_max),
            Shape::Cuboid { half } => cuboid(*half, o, d, t_min, t_max),
            Shape::Rounded { half, radius } => rounded(*half, *radius, o, d, t_min, t_max),
            Shape::Ellipsoid { semi_axes } => {
                let (so, sd) = (o / *semi_axes, d / *semi_axes);
                let a = sd.length_squared();
                let middle = -so.dot(sd) / a;
                let rest = (1.0 - (so + sd * middle).length_squared()) / a;
                let t = pick(middle, rest, t_min, t_max)?;
                Some((t, ((o + d * t) / (*semi_axes * *semi_axes)).normalize()))
            }
            Shape::Cylinder { radius, height } => cylinder(*radius, *height, o, d, t_min, t_max),
            Shape::Torus { major, minor } => {
                let t = torus::intersect(*major, *minor, o, d, t_min, t_max)?;
                Some((t, torus_normal(*major, o + d * t)))
            }
            Shape::Convex { faces, .. } => convex(faces, o, d, t_min, t_max),
            Shape::Terrain { relief } => relief.intersect(o, d, t_min, t_max),
        }
    }

    pub fn bounds(&self) -> Aabb {
        let local = match &self.shape {
            Shape::Panel(p) => {
                Aabb { min: DVec3::ZERO, max: DVec3::new(p.size.x, p.size.y + p.gable, 0.0) }
            }
            Shape::Recess(r) => {
                let half = r.opening.half_width;
                Aabb {
                    min: DVec3::new(-half, 0.0, -r.depth),
                    max: DVec3::new(half, r.opening.top(), 0.0),
                }
            }
            Shape::Cuboid { half }
            | Shape::Rounded { half, .. }
            | Shape::Ellipsoid { semi_axes: half } => Aabb { min: -*half, max: *half },
            Shape::Cylinder { radius, height } => Aabb {
                min: DVec3::new(-radius, -radius, 0.0),
                max: DVec3::new(*radius, *radius, *height),
            },
            Shape::Torus { major, minor } => {
                let outer = DVec3::new(major + minor, major + minor, *minor);
                Aabb { min: -outer, max: outer }
            }
            Shape::Convex { bounds, .. } => *bounds,
            Shape::Terrain { relief } => relief.bounds(),
        };
        let corner = |i: usize| {
            let pick = |bit: usize, low: f64, high: f64| if i >> bit & 1 == 1 { high } else { low };
            DVec3::new(
                pick(0, local.min.x, local.max.x),
                pick(1, local.min.y, local.max.y),
                pick(2, local.min.z, local.max.z),
            )
        };
        (0..8).fold(Aabb::EMPTY, |b, i| b.including(self.pose.point(corner(i))))
    }

    /// Returns the area [m^2] of shapes that are sampled by area.
    pub fn area(&self) -> f64 {
        match &self.shape {
            Shape::Panel(p) => p.size.x * p.size.y,
            Shape::Ellipsoid { semi_axes } => 4.0 * PI * semi_axes.x * semi_axes.x,
            Shape::Torus { major, minor } => TAU * TAU * major * minor,
            _ => unreachable!("only planes, spheres and tori are sampled by area"),
        }
    }

    /// Returns a point uniform by area, and its normal; local.
    pub fn sample(&self, random: &mut Random) -> (DVec3, DVec3) {
        match &self.shape {
            Shape::Panel(p) => {
                (DVec3::new(random.unit() * p.size.x, random.unit() * p.size.y, 0.0), DVec3::Z)
            }
            Shape::Ellipsoid { semi_axes } => {
                let z = random.between(-1.0, 1.0);
                let (sin, cos) = (TAU * random.unit()).sin_cos();
                let ring = (1.0 - z * z).sqrt();
                let normal = DVec3::new(ring * cos, ring * sin, z);
                (*semi_axes * normal, normal)
            }
            Shape::Torus { major, minor } => {
                let (sin_u, cos_u) = (TAU * random.unit()).sin_cos();
                // The area element grows with the distance to the axis: accept in proportion to it.
                let (sin_v, cos_v) = loop {
                    let (sin, cos) = (TAU * random.unit()).sin_cos();
                    if random.unit() * (major + minor) <= major + minor * cos {
                        break (sin, cos);
                    }
                };
                let normal = DVec3::new(cos_v * cos_u, cos_v * sin_u, sin_v);
                (DVec3::new(major * cos_u, major * sin_u, 0.0) + normal * *minor, normal)
            }
            _ => unreachable!("only planes, spheres and tori are sampled by area"),
        }
    }
}

/// Returns the nearer of `middle` -+ sqrt(`rest`) within (t_min, t_max).
fn pick(middle: f64, rest: f64, t_min: f64, t_max: f64) -> Option<f64> {
    let half = (rest >= 0.0).then(|| rest.sqrt())?;
    [middle - half, middle + half].into_iter().find(|&t| t > t_min && t < t_max)
}

pub fn torus_normal(major: f64, p: DVec3) -> DVec3 {
    let radial = p.x.hypot(p.y);
    let ring = (radial - major) / radial;
    DVec3::new(p.x * ring, p.y * ring, p.z).normalize()
}

fn cuboid(half: DVec3, o: DVec3, d: DVec3, t_min: f64, t_max: f64) -> Option<(f64, DVec3)> {
    let mut enter = (f64::NEG_INFINITY, DVec3::ZERO);
    let mut leave = (f64::INFINITY, DVec3::ZERO);
    for axis in 0..3 {
        let mut normal = DVec3::ZERO;
        normal[axis] = 1.0;
        let (a, b) = ((-half[axis] - o[axis]) / d[axis], (half[axis] - o[axis]) / d[axis]);
        let (near, far) =
            if d[axis] > 0.0 { ((a, -normal), (b, normal)) } else { ((b, normal), (a, -normal)) };
        if d[axis] == 0.0 {
            if o[axis].abs() > half[axis] {
                return None;
            }
            continue;
        }
        enter = if near.0 > enter.0 { near } else { enter };
        leave = if far.0 < leave.0 { far } else { leave };
    }
    if enter.0 > leave.0 {
        return None;
    }
    [enter, leave].into_iter().find(|c| c.0 > t_min && c.0 < t_max)
}

fn convex(faces: &[Face], o: DVec3, d: DVec3, t_min: f64, t_max: f64) -> Option<(f64, DVec3)> {
    let mut enter = (f64::NEG_INFINITY, DVec3::ZERO);
    let mut leave = (f64::INFINITY, DVec3::ZERO);
    for face in faces {
        let (speed, ahead) = (face.normal.dot(d), face.offset - face.normal.dot(o));
        if speed == 0.0 {
            if ahead < 0.0 {
                return None;
            }
            continue;
        }
        let t = ahead / speed;
        if speed < 0.0 {
            enter = if t > enter.0 { (t, face.normal) } else { enter };
        } else {
            leave = if t < leave.0 { (t, face.normal) } else { leave };
        }
    }
    if enter.0 > leave.0 {
        return None;
    }
    [enter, leave].into_iter().find(|c| c.0 > t_min && c.0 < t_max)
}

fn cylinder(
    radius: f64,
    height: f64,
    o: DVec3,
    d: DVec3,
    t_min: f64,
    t_max: f64,
) -> Option<(f64, DVec3)> {
    let mut best = (t_max, DVec3::ZERO);
    let a = d.x * d.x + d.y * d.y;
    let middle = -(o.x * d.x + o.y * d.y) / a;
    let (nx, ny) = (o.x + d.x * middle, o.y + d.y * middle);
    let half = ((radius * radius - nx * nx - ny * ny) / a).sqrt();
    // A ray along the axis, or one that misses, makes these NaN, and NaN compares false.
    for t in [middle - half, middle + half] {
        let p = o + d * t;
        if t > t_min && t < best.0 && p.z >= 0.0 && p.z <= height {
            best = (t, DVec3::new(p.x / radius, p.y / radius, 0.0));
        }
    }
    for (z, normal) in [(0.0, DVec3::NEG_Z), (height, DVec3::Z)] {
        let t = (z - o.z) / d.z;
        if t > t_min && t < best.0 && (o + d * t).truncate().length_squared() <= radius * radius {
            best = (t, normal);
        }
    }
    (best.0 < t_max).then_some(best)
}

/// Sphere tracing (Hart 1996) down to the surface, then Newton: the distance to a rounded cuboid is
/// exact, so a step never overshoots. Only from outside, which is where scanners and cameras are.
fn rounded(
    half: DVec3,
    radius: f64,
    o: DVec3,
    d: DVec3,
    t_min: f64,
    t_max: f64,
) -> Option<(f64, DVec3)> {
    let (mut t, leave) = Aabb { min: -half, max: half }.clip(o, d.recip(), t_min, t_max)?;
    let core = half - radius;
    let speed = d.length();
    let distance = |p: DVec3| {
        let q = p.abs() - core;
        let out = q.max(DVec3::ZERO);
        (out.length() + q.max_element().min(0.0) - radius, out)
    };
    for _ in 0..64 {
        let p = o + d * t;
        let (away, out) = distance(p);
        if away < 1e-6 {
            let normal =
                (out * DVec3::new(p.x.signum(), p.y.signum(), p.z.signum())).try_normalize()?;
            let slope = normal.dot(d);
            if away.abs() < 1e-12 || slope == 0.0 {
                return (t > t_min && t < t_max && away.abs() < 1e-9).then_some((t, normal));
            }
            let step = away / slope;
            if step.abs() * speed > 1e-3 {
                return None;
            }
            t -= step;
        } else {
            t += away / speed;
            if t > leave {
                return None;
            }
        }
    }
    None
}
