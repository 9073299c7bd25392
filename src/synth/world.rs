//! A scene for ray casting: the ground truth of every study.
//!
//! Coordinates are metres relative to `offset`. A hit lies on its surface to better than 1e-9 m.
//! Random parts of a scene are drawn when it is built, so a ray always has the same answer.

use super::bvh::{Aabb, Bvh};
use super::light::Light;
use super::material;
use super::shapes::{Pose, Solid};
use glam::DVec3;

/// The first surface on a ray.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Ray parameter, in units of the direction's length.
    pub t: f64,
    pub point: DVec3,
    /// Unit normal towards the origin of the ray.
    pub normal: DVec3,
    /// Albedo, linear RGB.
    pub albedo: DVec3,
    /// Albedo times baked light, linear RGB, before any station's exposure.
    pub lit: DVec3,
    /// Luminance of `lit` (Rec. 709 weights).
    pub luminance: f64,
    /// The object: a torus, a house, a car.
    pub part: u32,
    /// ASPRS class.
    pub class: u8,
}

/// A leaf: a disc. Trees have tens of thousands, so it is its own small primitive.
#[derive(Clone, Copy, Debug)]
pub struct Leaf {
    pub centre: DVec3,
    pub normal: DVec3,
    pub radius: f64,
    pub albedo: DVec3,
    pub part: u32,
}

/// A scanner's position, and the exposure of its camera.
#[derive(Clone, Copy, Debug)]
pub struct Station {
    pub position: DVec3,
    /// Factor on `lit` per channel: exposure times white balance.
    pub gain: DVec3,
}

/// The way a scene is sampled.
#[derive(Clone, Debug)]
pub enum Method {
    /// Every solid's surface, uniform by area; `shares` is each solid's part of the points, summing
    /// to 1.
    Area { shares: Vec<f64> },
    /// Terrestrial scanners on rotating mirrors.
    Stations(Vec<Station>),
    /// An aeroplane flying along y at each x; half the opening of its scan in degrees; a gain on
    /// intensity and colour for each strip.
    Strips { height: f64, half_angle: f64, lines: Vec<(f64, f64)> },
}

/// A suitable first camera, as plain numbers (world coordinates with the offset, degrees).
#[derive(Clone, Copy, Debug)]
pub struct Viewpoint {
    pub eye: DVec3,
    pub target: DVec3,
    pub fov_y: f64,
}

pub struct World {
    /// Added to all output: the position of the scene in its map projection `[m]`.
    pub offset: DVec3,
    /// Lattice that output coordinates are rounded to `[m]`.
    pub step: f64,
    pub method: Method,
    pub light: Light,
    pub solids: Vec<Solid>,
    pub leaves: Vec<Leaf>,
    /// Relative to the offset.
    viewpoint: Viewpoint,
    tree: Bvh,
}

/// Start of rays towards the sun above the surface `[m]`: above the rounding of any hit, below any
/// detail.
const LIFT_M: f64 = 1e-6;

/// ASPRS: high vegetation.
pub const CLASS_TREE: u8 = 5;

impl World {
    pub fn new(
        solids: Vec<Solid>,
        leaves: Vec<Leaf>,
        light: Light,
        method: Method,
        viewpoint: Viewpoint,
    ) -> World {
        let disc = |leaf: &Leaf| {
            // A disc reaches r sqrt(1 - n^2) along each axis.
            let reach = (DVec3::ONE - leaf.normal * leaf.normal).max(DVec3::ZERO).map(f64::sqrt)
                * leaf.radius;
            Aabb { min: leaf.centre - reach, max: leaf.centre + reach }
        };
        let boxes: Vec<Aabb> =
            solids.iter().map(Solid::bounds).chain(leaves.iter().map(disc)).collect();
        let mut tree = Bvh::build(&boxes);
        let first = solids.len() as u32;
        let leaves =
            tree.renumber(first).into_iter().map(|old| leaves[(old - first) as usize]).collect();
        World { offset: DVec3::ZERO, step: 1e-4, method, light, solids, leaves, viewpoint, tree }
    }

    /// Returns the box around all surfaces, relative to the offset.
    pub fn bounds(&self) -> Aabb {
        self.tree.bounds()
    }

    pub fn camera(&self) -> Viewpoint {
        Viewpoint {
            eye: self.viewpoint.eye + self.offset,
            target: self.viewpoint.target + self.offset,
            fov_y: self.viewpoint.fov_y,
        }
    }

    pub fn stations(&self) -> &[Station] {
        match &self.method {
            Method::Stations(stations) => stations,
            _ => &[],
        }
    }

    /// Returns the first surface with t > 0, coloured and lit. Origin relative to the offset; the
    /// direction need not be unit.
    pub fn trace(&self, origin: DVec3, direction: DVec3) -> Option<Hit> {
        self.trace_beyond(origin, direction, 0.0)
    }

    /// Returns the distance of the first surface with t > 0.
    pub fn first(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        self.nearest(origin, direction, 0.0).map(|(t, ..)| t)
    }

    /// Returns the first surface with t > `t_min`, for the later returns of a pulse.
    pub fn trace_beyond(&self, origin: DVec3, direction: DVec3, t_min: f64) -> Option<Hit> {
        let (t, normal, primitive) = self.nearest(origin, direction, t_min)?;
        let point = origin + direction * t;
        match self.solids.get(primitive as usize) {
            Some(solid) => {
                let world_normal = solid.pose.vector(normal);
                let facing =
                    if world_normal.dot(direction) > 0.0 { -world_normal } else { world_normal };
                let local = solid.pose.local_point(point);
                Some(self.shade(solid, t, point, facing, local, normal))
            }
            None => {
                let leaf = &self.leaves[primitive as usize - self.solids.len()];
                let facing = if normal.dot(direction) > 0.0 { -normal } else { normal };
                Some(self.shade_leaf(leaf, t, point, facing))
            }
        }
    }

    /// Returns the first primitive with t > `t_min`: t, its local normal, its number.
    fn nearest(&self, origin: DVec3, direction: DVec3, t_min: f64) -> Option<(f64, DVec3, u32)> {
        let mut nearest = None;
        self.tree.walk(origin, direction, t_min, f64::INFINITY, false, |primitive, t_max| {
            let (t, normal) = self.cross(primitive, origin, direction, t_min, t_max)?;
            nearest = Some((t, normal, primitive));
            Some(t)
        });
        nearest
    }

    /// Returns a point uniform on a solid's surface, as a hit at t = 0.
    pub fn sampled(&self, solid: usize, random: &mut super::noise::Random) -> Hit {
        let solid = &self.solids[solid];
        let (local, normal) = solid.sample(random);
        self.shade(solid, 0.0, solid.pose.point(local), solid.pose.vector(normal), local, normal)
    }

    fn cross(
        &self,
        primitive: u32,
        origin: DVec3,
        direction: DVec3,
        t_min: f64,
        t_max: f64,
    ) -> Option<(f64, DVec3)> {
        match self.solids.get(primitive as usize) {
            Some(solid) => solid.intersect(origin, direction, t_min, t_max),
            None => {
                let leaf = &self.leaves[primitive as usize - self.solids.len()];
                let t = (leaf.centre - origin).dot(leaf.normal) / direction.dot(leaf.normal);
                let inside = t > t_min
                    && t < t_max
                    && (origin + direction * t).distance_squared(leaf.centre)
                        <= leaf.radius * leaf.radius;
                inside.then_some((t, leaf.normal))
            }
        }
    }

    fn in_shadow(&self, point: DVec3, normal: DVec3) -> bool {
        let origin = point + normal * LIFT_M;
        let sun = self.light.sun_direction;
        self.tree.walk(origin, sun, 0.0, f64::INFINITY, true, |primitive, t_max| {
            let ground = self
                .solids
                .get(primitive as usize)
                .is_some_and(|s| matches!(s.shape, super::shapes::Shape::Terrain { .. }));
            // Gentle hills under a high sun cast no shadows, and marching along them would be slow.
            if ground {
                None
            } else {
                self.cross(primitive, origin, sun, 0.0, t_max).map(|(t, _)| t)
            }
        })
    }

    fn shade(
        &self,
        solid: &Solid,
        t: f64,
        point: DVec3,
        normal: DVec3,
        local: DVec3,
        local_normal: DVec3,
    ) -> Hit {
        let (albedo, open) = material::albedo(solid, point, normal, local, local_normal);
        let facing = normal.dot(self.light.sun_direction);
        let sunlit = facing > 0.0 && !(self.light.shadows && self.in_shadow(point, normal));
        let sun = if sunlit { self.light.sun * facing } else { DVec3::ZERO };
        finish(
            t,
            point,
            normal,
            albedo,
            sun + self.light.ambient(point, normal) * open,
            solid.part,
            solid.class,
        )
    }

    /// Shades a leaf, which scatters light through: half as bright from behind, never quite dark.
    fn shade_leaf(&self, leaf: &Leaf, t: f64, point: DVec3, normal: DVec3) -> Hit {
        let facing = normal.dot(self.light.sun_direction);
        let sunlit = !(self.light.shadows && self.in_shadow(point, self.light.sun_direction));
        let strength = if facing > 0.0 { 0.35 + 0.65 * facing } else { 0.35 - 0.25 * facing };
        let sun = if sunlit { self.light.sun * strength } else { DVec3::ZERO };
        let soft = (normal + DVec3::Z * 2.0).normalize();
        finish(
            t,
            point,
            normal,
            leaf.albedo,
            sun + self.light.ambient(point, soft),
            leaf.part,
            CLASS_TREE,
        )
    }
}

fn finish(
    t: f64,
    point: DVec3,
    normal: DVec3,
    albedo: DVec3,
    light: DVec3,
    part: u32,
    class: u8,
) -> Hit {
    let lit = albedo * light;
    Hit { t, point, normal, albedo, lit, luminance: lit.dot(LUMINANCE), part, class }
}

/// Rec. 709 weights of linear RGB.
pub const LUMINANCE: DVec3 = DVec3::new(0.2126, 0.7152, 0.0722);

/// Returns a solid, for scenes of few posed shapes.
pub fn solid(
    pose: Pose,
    shape: super::shapes::Shape,
    material: material::Material,
    part: u32,
    class: u8,
) -> Solid {
    Solid { pose, shape, material, part, class }
}
