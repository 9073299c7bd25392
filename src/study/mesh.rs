//! A mesh in (PLY, OBJ, or arrays), what a ray meets first out, f64; and points that are uniform by area.
//!
//! Readers of `cloud` leave faces aside, because a point cloud has none: only truth needs them, so they are read here, plainly and whole.
//! Rays are tested in axes of their own, sheared so that a ray is the third axis (Woop, Benthin and Wald 2013): the signs that decide whether it passes
//! a shared edge are computed from the same products for both triangles, so no ray slips between them. Triangles have two sides.

use crate::error::{Error, Result};
use crate::synth::bvh::{Aabb, Bvh};
use crate::synth::noise::Random;
use glam::DVec3;
use std::path::Path;

pub struct Mesh {
    pub vertices: Vec<DVec3>,
    /// Corners, in tree order.
    triangles: Vec<[DVec3; 3]>,
    tree: Bvh,
    /// The area of every triangle and those before it.
    areas: Vec<f64>,
}

impl Mesh {
    /// `faces` are vertex numbers.
    pub fn new(vertices: Vec<DVec3>, faces: &[[u32; 3]]) -> Mesh {
        let corners = |face: &[u32; 3]| face.map(|vertex| vertices[vertex as usize]);
        let bounds: Vec<Aabb> = faces.iter().map(|face| corners(face).into_iter().fold(Aabb::EMPTY, Aabb::including)).collect();
        let mut tree = Bvh::build(&bounds);
        let triangles: Vec<[DVec3; 3]> = tree.renumber(0).into_iter().map(|face| corners(&faces[face as usize])).collect();
        let mut sum = 0.0;
        let mut up_to = |[a, b, c]: &[DVec3; 3]| {
            sum += (b - a).cross(c - a).length() / 2.0;
            sum
        };
        let areas = triangles.iter().map(&mut up_to).collect();
        Mesh { vertices, triangles, tree, areas }
    }

    /// By the file's name; vertices go through `place` first.
    pub fn read(path: &Path, place: impl Fn(DVec3) -> DVec3) -> Result<Mesh> {
        let bytes = std::fs::read(path).map_err(|error| Error::io("read", path, error))?;
        let found = match path.extension().is_some_and(|extension| extension == "obj") {
            true => obj(&bytes),
            false => ply(&bytes),
        };
        let (vertices, faces) = found.ok_or_else(|| Error::format(path, "is not a whole mesh in PLY or OBJ"))?;
        if vertices.iter().any(|p| !p.is_finite()) || faces.iter().flatten().any(|&vertex| vertex as usize >= vertices.len()) {
            return Err(Error::format(path, "has vertices that are no numbers, or faces without vertices"));
        }
        Ok(Mesh::new(vertices.into_iter().map(place).collect(), &faces))
    }

    /// How far the first triangle with t > 0 is, in units of the direction's length.
    pub fn first(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        let ray = Sheared::new(origin, direction);
        let mut first = None;
        self.tree.walk(origin, direction, 0.0, f64::INFINITY, false, |triangle, t_max| {
            let t = ray.cross(&self.triangles[triangle as usize]).filter(|t| *t > 0.0 && *t < t_max)?;
            first = Some(t);
            first
        });
        first
    }

    /// A point, uniform by area: the square folded onto the triangle.
    pub fn sample(&self, random: &mut Random) -> DVec3 {
        let at = random.unit() * self.areas.last().expect("a mesh has triangles");
        let [a, b, c] = self.triangles[self.areas.partition_point(|&sum| sum <= at).min(self.areas.len() - 1)];
        let (u, v) = (random.unit(), random.unit());
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        a + (b - a) * u + (c - a) * v
    }
}

/// A ray in axes of its own, the longest of its components last.
struct Sheared {
    origin: DVec3,
    axes: [usize; 3],
    /// What a step along the last axis adds to the others, and to t.
    shear: DVec3,
}

impl Sheared {
    fn new(origin: DVec3, direction: DVec3) -> Sheared {
        let last = direction.abs().max_position();
        let axes = [(last + 1) % 3, (last + 2) % 3, last];
        let shear = DVec3::new(direction[axes[0]], direction[axes[1]], 1.0) / direction[last];
        Sheared { origin, axes, shear }
    }

    /// Where the ray's line meets the triangle's plane, if inside of it or on its border.
    fn cross(&self, corners: &[DVec3; 3]) -> Option<f64> {
        let [a, b, c] = corners.map(|corner| {
            let [x, y, z] = self.axes.map(|axis| (corner - self.origin)[axis]);
            DVec3::new(x - self.shear.x * z, y - self.shear.y * z, self.shear.z * z)
        });
        let side = |p: DVec3, q: DVec3| p.x * q.y - p.y * q.x;
        let weights = DVec3::new(side(c, b), side(a, c), side(b, a));
        let sum = weights.element_sum();
        let beside = weights.min_element() < 0.0 && weights.max_element() > 0.0;
        (!beside && sum != 0.0).then(|| weights.dot(DVec3::new(a.z, b.z, c.z)) / sum)
    }
}

type Found = Option<(Vec<DVec3>, Vec<[u32; 3]>)>;

/// A polygon as a fan around its first corner.
fn fan(polygon: &[u32]) -> impl Iterator<Item = [u32; 3]> + '_ {
    polygon.windows(2).skip(1).map(|pair| [polygon[0], pair[0], pair[1]])
}

fn obj(bytes: &[u8]) -> Found {
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for line in std::str::from_utf8(bytes).ok()?.lines() {
        let mut fields = line.split_ascii_whitespace();
        match fields.next() {
            Some("v") => {
                let mut axis = || fields.next()?.parse().ok();
                vertices.push(DVec3::new(axis()?, axis()?, axis()?));
            }
            Some("f") => {
                // From 1 on, or back from the last vertex so far; texture and normal follow behind slashes.
                let number = |field: &str| match field.split('/').next()?.parse::<i64>().ok()? {
                    back if back < 0 => u32::try_from(vertices.len() as i64 + back).ok(),
                    number => u32::try_from(number - 1).ok(),
                };
                faces.extend(fan(&fields.map(number).collect::<Option<Vec<u32>>>()?));
            }
            _ => {}
        }
    }
    Some((vertices, faces))
}

struct Property<'h> {
    name: &'h str,
    kind: &'h str,
    /// The type of a list's length.
    length: Option<&'h str>,
}

/// The numbers of a PLY body, one after the other.
enum Body<'b> {
    Ascii(std::str::SplitAsciiWhitespace<'b>),
    Binary { bytes: &'b [u8], big: bool },
}

impl Body<'_> {
    fn next(&mut self, kind: &str) -> Option<f64> {
        let (bytes, big) = match self {
            Body::Ascii(fields) => return fields.next()?.parse().ok(),
            Body::Binary { bytes, big } => (bytes, *big),
        };
        let mut take = |count: usize| {
            let (own, rest) = bytes.split_at_checked(count)?;
            *bytes = rest;
            let mut little = [0; 8];
            little[..count].copy_from_slice(own);
            if big {
                little[..count].reverse();
            }
            Some(u64::from_le_bytes(little))
        };
        Some(match kind {
            "char" | "int8" => take(1)? as i8 as f64,
            "uchar" | "uint8" => take(1)? as f64,
            "short" | "int16" => take(2)? as i16 as f64,
            "ushort" | "uint16" => take(2)? as f64,
            "int" | "int32" => take(4)? as i32 as f64,
            "uint" | "uint32" => take(4)? as f64,
            "float" | "float32" => f32::from_bits(take(4)? as u32) as f64,
            "double" | "float64" => f64::from_bits(take(8)?),
            _ => return None,
        })
    }
}

fn ply(bytes: &[u8]) -> Found {
    let end = bytes.windows(10).position(|window| window == b"end_header")?;
    let body_at = end + bytes[end..].iter().position(|&byte| byte == b'\n')? + 1;
    let header = std::str::from_utf8(&bytes[..end]).ok()?;
    let mut coding = "";
    let mut elements: Vec<(&str, u64, Vec<Property>)> = Vec::new();
    for line in header.lines() {
        match line.split_ascii_whitespace().collect::<Vec<_>>()[..] {
            ["format", name, _] => coding = name,
            ["element", name, count] => elements.push((name, count.parse().ok()?, Vec::new())),
            ["property", "list", length, kind, name] => elements.last_mut()?.2.push(Property { name, kind, length: Some(length) }),
            ["property", kind, name] => elements.last_mut()?.2.push(Property { name, kind, length: None }),
            _ => {}
        }
    }
    let body = &bytes[body_at..];
    let mut body = match coding {
        "ascii" => Body::Ascii(std::str::from_utf8(body).ok()?.split_ascii_whitespace()),
        _ => Body::Binary { bytes: body, big: coding == "binary_big_endian" },
    };
    let (mut vertices, mut faces, mut polygon) = (Vec::new(), Vec::new(), Vec::new());
    for (element, count, properties) in &elements {
        for _ in 0..*count {
            let mut vertex = DVec3::ZERO;
            for Property { name, kind, length } in properties {
                let Some(length) = length else {
                    let value = body.next(kind)?;
                    if let Some(axis) = ["x", "y", "z"].iter().position(|axis| axis == name) {
                        vertex[axis] = value;
                    }
                    continue;
                };
                polygon.clear();
                for _ in 0..body.next(length)? as u64 {
                    polygon.push(body.next(kind)? as u32);
                }
                if *element == "face" && name.starts_with("vertex_ind") {
                    faces.extend(fan(&polygon));
                }
            }
            if *element == "vertex" {
                vertices.push(vertex);
            }
        }
    }
    Some((vertices, faces))
}
