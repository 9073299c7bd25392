//! Meshes (PLY, OBJ, or arrays): ray casting in f64, and sampling uniform by area.
//!
//! Readers of `cloud` ignore faces; only truth needs them, so they are read here, plainly and
//! whole. Rays are tested in sheared axes in which the ray is the third axis (Woop, Benthin and
//! Wald 2013): the signs that decide whether it passes a shared edge are computed from the same
//! products for both triangles, so no ray slips between them. Triangles have two sides.

use crate::error::{Error, Result};
use crate::synth::bvh::{Aabb, Bvh};
use crate::synth::noise::Random;
use glam::DVec3;
use std::path::Path;

pub struct Mesh {
    pub vertices: Vec<DVec3>,
    /// Corners in tree order.
    triangles: Vec<[DVec3; 3]>,
    tree: Bvh,
    /// Cumulative area of the triangles.
    areas: Vec<f64>,
}

impl Mesh {
    /// Builds a mesh; `faces` are vertex numbers.
    pub fn new(vertices: Vec<DVec3>, faces: &[[u32; 3]]) -> Mesh {
        let corners = |face: &[u32; 3]| face.map(|vertex| vertices[vertex as usize]);
        let bounds: Vec<Aabb> = faces
            .iter()
            .map(|face| corners(face).into_iter().fold(Aabb::EMPTY, Aabb::including))
            .collect();
        let mut tree = Bvh::build(&bounds);
        let triangles: Vec<[DVec3; 3]> =
            tree.renumber(0).into_iter().map(|face| corners(&faces[face as usize])).collect();
        let mut sum = 0.0;
        let mut up_to = |[a, b, c]: &[DVec3; 3]| {
            sum += (b - a).cross(c - a).length() / 2.0;
            sum
        };
        let areas = triangles.iter().map(&mut up_to).collect();
        Mesh { vertices, triangles, tree, areas }
    }

    /// Reads a mesh by the file's name; `place` transforms vertices.
    pub fn read(path: &Path, place: impl Fn(DVec3) -> DVec3) -> Result<Mesh> {
        let bytes = std::fs::read(path).map_err(|error| Error::io("read", path, error))?;
        let found = match path.extension().is_some_and(|extension| extension == "obj") {
            true => obj(&bytes),
            false => ply(&bytes),
        };
        let (vertices, faces) =
            found.ok_or_else(|| Error::format(path, "is not a complete mesh in PLY or OBJ"))?;
        if vertices.iter().any(|p| !p.is_finite())
            || faces.iter().flatten().any(|&vertex| vertex as usize >= vertices.len())
        {
            return Err(Error::format(
                path,
                "has vertices that are no numbers, or faces without vertices",
            ));
        }
        Ok(Mesh::new(vertices.into_iter().map(place).collect(), &faces))
    }

    /// Returns the distance to the first triangle with t > 0, in units of the direction's length.
    pub fn first(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        let ray = Sheared::new(origin, direction);
        let mut first = None;
        self.tree.walk(origin, direction, 0.0, f64::INFINITY, false, |triangle, t_max| {
            let t =
                ray.cross(&self.triangles[triangle as usize]).filter(|t| *t > 0.0 && *t < t_max)?;
            first = Some(t);
            first
        });
        first
    }

    /// Returns a point uniform by area: the square folded onto the triangle.
    pub fn sample(&self, random: &mut Random) -> DVec3 {
        let at = random.unit() * self.areas.last().expect("a mesh has triangles");
        let [a, b, c] =
            self.triangles[self.areas.partition_point(|&sum| sum <= at).min(self.areas.len() - 1)];
        let (u, v) = (random.unit(), random.unit());
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        a + (b - a) * u + (c - a) * v
    }
}

/// A ray in its own axes, the longest component last.
struct Sheared {
    origin: DVec3,
    axes: [usize; 3],
    /// Change of the other axes and of t per step along the last axis.
    shear: DVec3,
}

impl Sheared {
    fn new(origin: DVec3, direction: DVec3) -> Sheared {
        let last = direction.abs().max_position();
        let axes = [(last + 1) % 3, (last + 2) % 3, last];
        let shear = DVec3::new(direction[axes[0]], direction[axes[1]], 1.0) / direction[last];
        Sheared { origin, axes, shear }
    }

    /// Returns t where the ray's line meets the triangle, border included.
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

/// Splits a polygon into a fan around its first corner.
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
                // From 1, or back from the last vertex so far; texture and normal follow behind
                // slashes.
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

/// The numbers of a PLY body in sequence.
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
            ["property", "list", length, kind, name] => {
                elements.last_mut()?.2.push(Property { name, kind, length: Some(length) })
            }
            ["property", kind, name] => {
                elements.last_mut()?.2.push(Property { name, kind, length: None })
            }
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

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [DVec3; 4] = [
        DVec3::new(1.0, 0.1, 0.0),
        DVec3::new(-0.4, 0.9, 0.2),
        DVec3::new(-0.5, -0.8, 0.1),
        DVec3::new(0.0, 0.1, 1.3),
    ];
    const FACES: [[u32; 3]; 4] = [[0, 1, 2], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

    fn tetrahedron() -> Mesh {
        Mesh::new(CORNERS.to_vec(), &FACES)
    }

    /// Returns where a ray enters the intersection of half-spaces, or leaves it from inside.
    fn half_spaces(origin: DVec3, direction: DVec3) -> Option<f64> {
        let inside = CORNERS.iter().sum::<DVec3>() / 4.0;
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        for face in FACES {
            let [a, b, c] = face.map(|corner| CORNERS[corner as usize]);
            let normal = (b - a).cross(c - a);
            let outward = normal * (a - inside).dot(normal).signum();
            let (t, speed) =
                ((a - origin).dot(outward) / direction.dot(outward), direction.dot(outward));
            if speed < 0.0 { enter = enter.max(t) } else { leave = leave.min(t) }
        }
        [enter, leave].into_iter().find(|t| enter < leave && *t > 0.0)
    }

    #[test]
    fn a_tetrahedron_is_met_where_its_planes_are() {
        let mesh = tetrahedron();
        let mut hits = 0;
        for i in 0..20_000 {
            let mut random = Random::new(5, 0, i);
            let mut any = || DVec3::from_array(std::array::from_fn(|_| random.normal()));
            let origin = any() * 2.0;
            let direction = any() * 0.5 - origin;
            let (own, known) = (mesh.first(origin, direction), half_spaces(origin, direction));
            assert_eq!(own.is_some(), known.is_some(), "{origin} {direction}");
            if let (Some(own), Some(known)) = (own, known) {
                hits += 1;
                assert!((own - known).abs() <= 1e-9 * known.abs().max(1.0), "{own} {known}");
            }
        }
        assert!(hits > 1_000);
    }

    #[test]
    fn no_ray_slips_between_triangles() {
        // A fan around one vertex, seen from above: every ray through an edge or the vertex itself
        // must meet it.
        let ring = 7;
        let corner = |i: u32| (i as f64 * std::f64::consts::TAU / ring as f64).sin_cos();
        let rim = (0..ring).map(|i| DVec3::new(corner(i).0, corner(i).1, 0.1 * i as f64));
        let middle = DVec3::new(0.1, -0.07, 0.3);
        let vertices: Vec<DVec3> = std::iter::once(middle).chain(rim).collect();
        let faces: Vec<[u32; 3]> = (0..ring).map(|i| [0, 1 + i, 1 + (i + 1) % ring]).collect();
        let mesh = Mesh::new(vertices.clone(), &faces);
        for i in 0..20_000 {
            let mut random = Random::new(3, 0, i);
            let eye = DVec3::new(random.normal(), random.normal(), 9.0);
            let through =
                middle.lerp(vertices[1 + random.below(ring as usize)], 0.99 * random.unit());
            assert!(
                mesh.first(eye, through - eye).is_some() && mesh.first(eye, middle - eye).is_some(),
                "{eye} {through}"
            );
        }
    }

    #[test]
    fn points_are_uniform_by_area() {
        // Two squares, one with nine times the area of the other.
        let square = |x: f64, side: f64| {
            [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
                .map(|(u, v)| DVec3::new(x + u * side, v * side, 0.0))
        };
        let vertices: Vec<DVec3> = square(0.0, 1.0).into_iter().chain(square(10.0, 3.0)).collect();
        let mesh = Mesh::new(vertices, &[[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]);
        let points: Vec<DVec3> =
            (0..40_000).map(|i| mesh.sample(&mut Random::new(1, 0, i))).collect();
        let share = |keep: &dyn Fn(&DVec3) -> bool| {
            points.iter().filter(|p| keep(p)).count() as f64 / points.len() as f64
        };
        assert!((share(&|p| p.x < 5.0) - 0.1).abs() < 0.006);
        assert!((share(&|p| p.x > 5.0 && p.y < 1.5) - 0.45).abs() < 0.01);
    }

    #[test]
    fn ply_in_three_codings_and_obj_are_the_same_mesh() {
        let header = |coding: &str| {
            format!(
                "ply\nformat {coding} 1.0\ncomment made by hand\nelement vertex 4\nproperty float x\nproperty float y\nproperty double z\nproperty uchar red\n\
                 element face 1\nproperty list uchar int vertex_indices\nend_header\n"
            )
        };
        let vertices = [[0.5f32, 0.0, 0.25], [1.0, 0.0, 0.0], [1.0, 1.0, -2.0], [0.0, 1.0, 0.0]];
        let ascii = header("ascii")
            + &vertices.map(|[x, y, z]| format!("{x} {y} {z} 7\n")).concat()
            + "4 0 1 2 3\n";
        let binary = |big: bool| {
            let order = |mut bytes: Vec<u8>| {
                if big {
                    bytes.reverse();
                }
                bytes
            };
            let mut bytes =
                header(if big { "binary_big_endian" } else { "binary_little_endian" }).into_bytes();
            for [x, y, z] in vertices {
                bytes.extend(
                    [
                        order(x.to_le_bytes().into()),
                        order(y.to_le_bytes().into()),
                        order((z as f64).to_le_bytes().into()),
                        vec![7],
                    ]
                    .concat(),
                );
            }
            bytes.push(4);
            bytes.extend((0..4i32).flat_map(|vertex| order(vertex.to_le_bytes().into())));
            bytes
        };
        let text = vertices.map(|[x, y, z]| format!("v {x} {y} {z}\n")).concat()
            + "vn 0 0 1\nf 1/1/1 2//1 3 -1\n";
        let expected = Some((
            vertices.map(|v| DVec3::from_array(v.map(f64::from))).to_vec(),
            vec![[0, 1, 2], [0, 2, 3]],
        ));
        for (name, found) in [
            ("ascii", ply(ascii.as_bytes())),
            ("little", ply(&binary(false))),
            ("big", ply(&binary(true))),
            ("obj", obj(text.as_bytes())),
        ] {
            assert_eq!(found, expected, "{name}");
        }
        let whole = binary(false);
        assert!(
            (0..whole.len()).all(|length| ply(&whole[..length]).is_none()),
            "a part of a file is no mesh"
        );
    }
}
