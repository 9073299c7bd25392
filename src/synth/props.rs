//! Objects in a scene: trees, cars, lamp posts, cottages, roofs. Each is a few posed primitives.

use super::bvh::Aabb;
use super::material::{Material, Wall};
use super::noise::Random;
use super::shapes::{Face, Pose, Shape, Solid};
use super::world::{CLASS_TREE, Leaf, solid};
use glam::DVec3;

/// ASPRS classes.
pub const CLASS_GROUND: u8 = 2;
pub const CLASS_BUILDING: u8 = 6;
/// Beyond ASPRS's own list for format 3; 20 and up are free for users.
pub const CLASS_CAR: u8 = 20;
pub const CLASS_FURNITURE: u8 = 21;

pub fn cuboid(pose: Pose, half: [f64; 3], material: Material, part: u32, class: u8) -> Solid {
    solid(pose, Shape::Cuboid { half: half.into() }, material, part, class)
}

/// A cylinder along local z that starts at `base`.
pub fn pole(
    base: DVec3,
    axis: DVec3,
    radius: f64,
    height: f64,
    material: Material,
    part: u32,
    class: u8,
) -> Solid {
    let aside = if axis.x.abs() < 0.9 { DVec3::X } else { DVec3::Y };
    let x = (aside - axis * aside.dot(axis)).normalize();
    let pose = Pose { origin: base, x, y: axis.cross(x), z: axis };
    solid(pose, Shape::Cylinder { radius, height }, material, part, class)
}

fn convex(faces: &[([f64; 3], f64)], min: [f64; 3], max: [f64; 3]) -> Shape {
    let face = |(n, offset): &([f64; 3], f64)| {
        let length = DVec3::from(*n).length();
        Face { normal: DVec3::from(*n) / length, offset: offset / length }
    };
    Shape::Convex {
        faces: faces.iter().map(face).collect(),
        bounds: Aabb { min: min.into(), max: max.into() },
    }
}

/// A saddle roof on z = 0: ridge along x, half extents `a` and `b`; `hip` is how far the ridge is
/// shorter at each end.
pub fn roof(a: f64, b: f64, height: f64, hip: f64) -> Shape {
    let end = if hip > 0.0 { ([height, 0.0, hip], height * a) } else { ([1.0, 0.0, 0.0], a) };
    let other = ([-end.0[0], 0.0, end.0[2]], end.1);
    let faces = [
        ([0.0, 0.0, -1.0], 0.0),
        ([0.0, height, b], height * b),
        ([0.0, -height, b], height * b),
        end,
        other,
    ];
    convex(&faces, [-a, -b, 0.0], [a, b, height])
}

/// A trunk that forks, and a crown of leaves in clumps. `size` 1 is a street tree 8 m tall.
#[allow(clippy::too_many_arguments)]
pub fn tree(
    solids: &mut Vec<Solid>,
    leaves: &mut Vec<Leaf>,
    base: DVec3,
    size: f64,
    count: usize,
    radius: f64,
    part: u32,
    random: &mut Random,
) {
    let bark = |from: DVec3, to: DVec3, radius: f64| {
        let way = to - from;
        pole(from, way.normalize(), radius, way.length(), Material::Bark, part, CLASS_TREE)
    };
    let fork =
        base + DVec3::new(random.between(-0.15, 0.15), random.between(-0.15, 0.15), 2.7) * size;
    solids.push(bark(base, fork, 0.15 * size));
    let clumps: Vec<(DVec3, f64)> = (0..11)
        .map(|k| {
            let angle = k as f64 * 2.4 + random.between(-0.4, 0.4);
            let up = k as f64 / 10.0;
            let out = 1.75 * (1.0 - 0.75 * up * up) * random.between(0.75, 1.1);
            let centre =
                base + DVec3::new(out * angle.cos(), out * angle.sin(), 3.5 + 3.3 * up) * size;
            (centre, random.between(0.95, 1.35) * size * (1.0 - 0.25 * up))
        })
        .collect();
    for (centre, _) in clumps.iter().step_by(2) {
        solids.push(bark(fork, *centre, 0.055 * size));
    }
    let hue = random.unit();
    let fresh = DVec3::new(0.17 + 0.10 * hue, 0.29, 0.055);
    for i in 0..count {
        let (centre, reach) = clumps[i % clumps.len()];
        let z = random.between(-1.0, 1.0);
        let (sin, cos) = (random.unit() * std::f64::consts::TAU).sin_cos();
        let ring = (1.0 - z * z).sqrt();
        let outward = DVec3::new(ring * cos, ring * sin, z * 0.8);
        // Most leaves are where the light is: in the shell of a clump.
        let away = reach * random.unit().powf(0.28);
        let tilt = DVec3::new(random.normal(), random.normal(), random.normal()) * 0.55;
        let normal = (outward + tilt + DVec3::Z * 0.5).try_normalize().unwrap_or(DVec3::Z);
        let inner = 0.45 + 0.55 * (away / reach);
        let albedo = fresh
            * (inner * random.between(0.72, 1.25))
            * DVec3::new(random.between(0.85, 1.2), 1.0, 1.0);
        leaves.push(Leaf {
            centre: centre + outward * away,
            normal,
            radius: radius * random.between(0.7, 1.15),
            albedo,
            part,
        });
    }
}

/// A parked car on the ground at `base`; the front points `degrees` from east.
pub fn car(solids: &mut Vec<Solid>, base: DVec3, degrees: f64, paint: DVec3, part: u32) {
    let pose = Pose::turned(base, degrees);
    let mut push = |pose: Pose, shape: Shape, material: Material| {
        solids.push(solid(pose, shape, material, part, CLASS_CAR))
    };
    let rounded = |half: [f64; 3], radius: f64| Shape::Rounded { half: half.into(), radius };
    let at = |x: f64, y: f64, z: f64| pose.moved(DVec3::new(x, y, z));
    push(at(0.0, 0.0, 0.58), rounded([2.08, 0.86, 0.30], 0.20), Material::Plain(paint));
    push(
        at(0.0, 0.0, 0.36),
        rounded([2.13, 0.84, 0.13], 0.10),
        Material::Plain(DVec3::splat(0.035)),
    );
    // The cabin: windscreen and rear window lean, sides lean in a little.
    let cabin = [
        ([0.0, 0.0, -1.0], 0.0),
        ([0.0, 0.0, 1.0], 0.58),
        ([0.62, 0.0, 0.80], 0.62 * 1.02),
        ([-0.80, 0.0, 0.62], 0.80 * 1.45),
        ([0.0, 1.0, 0.26], 0.76),
        ([0.0, -1.0, 0.26], 0.76),
    ];
    push(
        at(-0.15, 0.0, 0.86),
        convex(&cabin, [-1.45, -0.77, 0.0], [1.02, 0.77, 0.58]),
        Material::Cabin { paint },
    );
    for (x, y) in [(1.28, 0.64), (1.28, -0.86), (-1.28, 0.64), (-1.28, -0.86)] {
        let wheel = |radius: f64, out: f64| {
            let centre = pose.point(DVec3::new(x, y - out, 0.32));
            (centre, pose.y, radius, 0.22 + 2.0 * out)
        };
        for ((base, axis, radius, height), color) in
            [(wheel(0.32, 0.0), 0.02), (wheel(0.19, 0.008), 0.42)]
        {
            solids.push(pole(
                base,
                axis,
                radius,
                height,
                Material::Plain(DVec3::splat(color)),
                part,
                CLASS_CAR,
            ));
        }
    }
    for side in [-1.0, 1.0] {
        for (x, color) in
            [(1.98, DVec3::new(0.85, 0.85, 0.80)), (-1.98, DVec3::new(0.55, 0.03, 0.02))]
        {
            let lamp = Shape::Ellipsoid { semi_axes: DVec3::new(0.13, 0.17, 0.08) };
            solids.push(solid(
                pose.moved(DVec3::new(x, 0.60 * side, 0.66)),
                lamp,
                Material::Plain(color),
                part,
                CLASS_CAR,
            ));
        }
    }
}

/// An old street lamp: a post with a foot and a collar, two arms and two globes along x.
pub fn lamp(solids: &mut Vec<Solid>, base: DVec3, part: u32) {
    let iron = Material::Plain(DVec3::new(0.035, 0.045, 0.042));
    let mut post = |from: DVec3, axis: DVec3, radius: f64, height: f64| {
        solids.push(pole(base + from, axis, radius, height, iron, part, CLASS_FURNITURE));
    };
    post(DVec3::ZERO, DVec3::Z, 0.13, 0.55);
    post(DVec3::ZERO, DVec3::Z, 0.055, 4.4);
    post(DVec3::Z * 2.6, DVec3::Z, 0.085, 0.10);
    post(DVec3::new(-0.55, 0.0, 4.15), DVec3::X, 0.03, 1.1);
    for side in [-0.55, 0.55] {
        let globe = Shape::Ellipsoid { semi_axes: DVec3::new(0.19, 0.19, 0.23) };
        let glass = Material::Plain(DVec3::new(0.86, 0.84, 0.76));
        solids.push(solid(
            Pose::at(base + DVec3::new(side, 0.0, 4.42)),
            globe,
            glass,
            part,
            CLASS_FURNITURE,
        ));
        solids.push(pole(
            base + DVec3::new(side, 0.0, 4.62),
            DVec3::Z,
            0.07,
            0.10,
            iron,
            part,
            CLASS_FURNITURE,
        ));
    }
}

/// A house of the countryside, seen from above: body, roof, chimney.
pub fn cottage(solids: &mut Vec<Solid>, base: DVec3, degrees: f64, part: u32, random: &mut Random) {
    let pose = Pose::turned(base, degrees);
    let (a, b, wall) =
        (random.between(4.5, 7.0), random.between(3.4, 4.6), random.between(3.6, 6.0));
    let color =
        [DVec3::new(0.68, 0.60, 0.46), DVec3::new(0.60, 0.42, 0.24), DVec3::new(0.62, 0.58, 0.54)]
            [random.below(3)];
    let tile =
        [DVec3::new(0.42, 0.15, 0.08), DVec3::new(0.33, 0.13, 0.09), DVec3::new(0.15, 0.15, 0.17)]
            [random.below(3)];
    let salt = part as u64;
    let plaster = Material::Masonry { wall: Wall::Plaster, color, salt };
    // Sunk into the slope.
    solids.push(cuboid(
        pose.moved(DVec3::new(0.0, 0.0, wall / 2.0 - 1.0)),
        [a, b, wall / 2.0 + 1.0],
        plaster,
        part,
        CLASS_BUILDING,
    ));
    let hip = if random.unit() < 0.3 { b * 0.7 } else { 0.0 };
    let shape = roof(a + 0.5, b + 0.5, b * 0.85, hip);
    solids.push(solid(
        pose.moved(DVec3::Z * wall),
        shape,
        Material::Tiles { color: tile, salt },
        part,
        CLASS_BUILDING,
    ));
    let brick = Material::Masonry { wall: Wall::Brick, color: DVec3::new(0.40, 0.17, 0.11), salt };
    solids.push(cuboid(
        pose.moved(DVec3::new(a * 0.5, b * 0.2, wall + b * 0.8)),
        [0.45, 0.35, 0.9],
        brick,
        part,
        CLASS_BUILDING,
    ));
}
