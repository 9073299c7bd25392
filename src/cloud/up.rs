//! The axis of the coordinates that points up.
//!
//! Scanners and maps count heights along z. Formats of meshes state no axis, and many of their
//! files are y-up. An object stands on its base: where the lowest slice along y is broad, and both
//! the highest slice along y and the lowest along z are not, y points up. E57 is a format of
//! surveys, in metres: there only what is as small as things on a table is looked at. LAS names no
//! unit without a coordinate system, so that nothing tells objects from surveys.

use super::Header;
use super::crs::Crs;
use glam::DVec3;
use strum::{EnumString, IntoStaticStr, VariantArray};

/// An axis that points up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Up {
    Y,
    #[default]
    Z,
}

/// A requested axis, as in `--up`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum UpOption {
    Y,
    #[default]
    Z,
    /// y for PLY and OBJ files without a coordinate system, and for E57 files of things below half
    /// a metre, whose points stand on a base along y; z for all others
    Auto,
}

/// Thickness of a base, relative to the points' extent along the axis.
const SLICE: f64 = 0.03;
/// Least share of the footprint that a base covers.
const BROAD: f64 = 0.25;
/// How much broader than the slices at other ends it is.
const BROADER: f64 = 2.0;
/// Least extent along the axis, relative to the shorter of the others: all of a sheet is base.
const THICK: f64 = 0.5;
/// Largest extent of what E57 files may have scanned on a table `[m]`.
const TABLE: f64 = 0.5;

impl Up {
    pub fn index(self) -> usize {
        match self {
            Up::Y => 1,
            Up::Z => 2,
        }
    }

    pub fn axis(self) -> DVec3 {
        DVec3::AXES[self.index()]
    }

    /// Finds the axis by the shape of points without strays; z if the shape does not tell.
    pub fn of_shape(points: &[DVec3]) -> Up {
        let Some((lo, hi)) = corners(points) else { return Up::Z };
        let size = hi - lo;
        let base = share(points, |p| p.y <= lo.y + SLICE * size.y, 1);
        let others = share(points, |p| p.y >= hi.y - SLICE * size.y, 1).max(share(
            points,
            |p| p.z <= lo.z + SLICE * size.z,
            2,
        ));
        let is_thick = size.y >= THICK * size.x.min(size.z);
        if is_thick && base >= BROAD && base >= BROADER * others { Up::Y } else { Up::Z }
    }
}

impl UpOption {
    /// Returns the axis of files, and a note if it is not the customary one and was not requested.
    /// `points` are a sample without strays.
    pub fn of<'h>(
        self,
        headers: impl Iterator<Item = &'h Header>,
        points: impl FnOnce() -> Vec<DVec3>,
    ) -> (Up, Option<String>) {
        let headers: Vec<&Header> = headers.collect();
        let is_of = |header: &&Header, names: &[&str]| {
            Crs::of(header).is_none() && names.iter().any(|name| header.format.starts_with(name))
        };
        let is_object = || {
            let may_be = headers.iter().all(|header| is_of(header, &["PLY", "OBJ", "E57"]));
            let points = if may_be { points() } else { Vec::new() };
            let are_meshes = headers.iter().all(|header| header.is_mesh());
            (are_meshes || size(&points).max_element() < TABLE) && Up::of_shape(&points) == Up::Y
        };
        match self {
            UpOption::Y => (Up::Y, None),
            UpOption::Auto if is_object() => {
                let note = "y is taken as up, since the points stand on a base along y; --up z draws them otherwise";
                (Up::Y, Some(note.into()))
            }
            UpOption::Z | UpOption::Auto => (Up::Z, None),
        }
    }
}

/// Returns the corners of the box around points.
fn corners(points: &[DVec3]) -> Option<(DVec3, DVec3)> {
    points.iter().map(|&p| (p, p)).reduce(|(lo, hi), (a, b)| (lo.min(a), hi.max(b)))
}

fn size(points: &[DVec3]) -> DVec3 {
    corners(points).map_or(DVec3::ZERO, |(lo, hi)| hi - lo)
}

/// Returns the area of some points relative to that of all, seen along an axis: of the convex
/// hulls.
fn share(points: &[DVec3], of: impl Fn(&DVec3) -> bool, along: usize) -> f64 {
    let seen = |p: &DVec3| [p[(along + 1) % 3], p[(along + 2) % 3]];
    let some = hull_area(points.iter().filter(|p| of(p)).map(seen).collect());
    some / hull_area(points.iter().map(seen).collect()).max(f64::MIN_POSITIVE)
}

/// Returns the area of the convex hull: a walk along each of its sides in the order of x, which
/// turns one way only.
fn hull_area(mut points: Vec<[f64; 2]>) -> f64 {
    points.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let cross = |o: [f64; 2], a: [f64; 2], b: [f64; 2]| {
        (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])
    };
    let side = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut walk: Vec<[f64; 2]> = Vec::new();
        for p in points {
            while let [.., o, a] = walk[..]
                && cross(o, a, p) <= 0.0
            {
                walk.pop();
            }
            walk.push(p);
        }
        walk
    };
    let (below, above) =
        (side(&mut points.iter().copied()), side(&mut points.iter().rev().copied()));
    let Some(&first) = points.first() else { return 0.0 };
    let around = below.iter().chain(&above);
    around.clone().zip(around.skip(1)).map(|(&a, &b)| cross(first, a, b)).sum::<f64>() / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A figure that stands on a plate: `up` is its height.
    fn figure(place: impl Fn(f64, f64, f64) -> DVec3) -> Vec<DVec3> {
        let plate = (0..400).map(|i| [(i % 20) as f64 / 20.0, (i / 20) as f64 / 20.0, 0.0]);
        let body = (0..2000).map(|i| {
            let (turn, up) = (i as f64 * 2.4, i as f64 / 2000.0);
            let radius = 0.45 * (1.0 - up);
            [0.5 + radius * turn.cos(), 0.5 + radius * turn.sin(), up]
        });
        plate.chain(body).map(|[x, y, up]| place(x, y, up)).collect()
    }

    #[test]
    fn what_stands_on_a_base_along_y_is_y_up() {
        assert_eq!(Up::of_shape(&figure(|x, y, up| DVec3::new(x, up, -y))), Up::Y);
        assert_eq!(Up::of_shape(&figure(DVec3::new)), Up::Z);
        // On its head, it stands on a tip.
        assert_eq!(Up::of_shape(&figure(|x, y, up| DVec3::new(x, -up, -y))), Up::Z);
    }

    #[test]
    fn what_does_not_tell_is_z_up() {
        assert_eq!(Up::of_shape(&[]), Up::Z);
        assert_eq!(Up::of_shape(&[DVec3::ONE; 9]), Up::Z);
        let ball = |i: i32| {
            let (z, turn) = (1.0 - i as f64 / 500.0, i as f64 * 2.4);
            let r = (1.0 - z * z).sqrt();
            DVec3::new(r * turn.cos(), r * turn.sin(), z)
        };
        assert_eq!(Up::of_shape(&(0..1000).map(ball).collect::<Vec<_>>()), Up::Z);
        // A facade is broad seen along y, but it does not stand on its back.
        let facade = |i: i32| DVec3::new((i % 50) as f64, (i % 7) as f64 / 7.0, (i / 50) as f64);
        assert_eq!(Up::of_shape(&(0..2000).map(facade).collect::<Vec<_>>()), Up::Z);
    }

    #[test]
    fn only_meshes_and_small_objects_are_looked_at() {
        let header = |format: &str| Header { format: format.into(), ..Header::default() };
        let up = |option: UpOption, format| {
            let (ply, other) = (header("PLY ascii"), header(format));
            option.of([&ply, &other].into_iter(), || figure(|x, y, up| DVec3::new(x, up, -y)))
        };
        assert!(
            matches!(up(UpOption::Auto, "OBJ"), (Up::Y, Some(note)) if note.contains("--up z"))
        );
        assert_eq!(up(UpOption::Auto, "LAS 1.2"), (Up::Z, None));
        let small = |scale: f64| {
            let e57 = header("E57");
            let points = || figure(|x, y, up| scale * DVec3::new(x, up, -y));
            UpOption::Auto.of([&e57].into_iter(), points).0
        };
        assert_eq!((small(0.15), small(1.0)), (Up::Y, Up::Z));
        assert_eq!(up(UpOption::Z, "OBJ"), (Up::Z, None));
        assert_eq!(up(UpOption::Y, "LAS 1.2"), (Up::Y, None));
    }

    #[test]
    fn hulls_have_the_area_of_their_shape() {
        let square = vec![[0.0, 0.0], [2.0, 0.0], [1.0, 1.0], [2.0, 2.0], [0.0, 2.0], [1.0, 0.0]];
        assert_eq!(hull_area(square), 4.0);
        assert_eq!(hull_area(vec![[0.0, 0.0], [1.0, 1.0]]), 0.0);
        assert_eq!(hull_area(vec![]), 0.0);
    }
}
