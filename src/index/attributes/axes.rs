//! Principal axes of a cloud, by decreasing spread. They turn with the cloud, and so do strokes
//! painted in them.
//!
//! ```text
//! of every point, relative to one centre: sums of the products of two and of three coordinates
//! eigenvectors of the covariance, oriented towards the longer tail (third moments)
//! ```
//!
//! A cloud that spreads equally along two axes, or has no longer tail, keeps the axes of its file:
//! axes decided by rounding would differ in the next version of the file.

use super::linear_algebra::eigen;
use crate::cloud::Part;
use crate::index::format::Axes;
use glam::DVec3;

/// Spreads and skews below this part of the largest spread are rounding.
const NEGLIGIBLE: f64 = 1e-6;

/// Sums of products of coordinates relative to one common centre.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    count: f64,
    first: DVec3,
    /// xx, xy, xz, yy, yz, zz.
    second: [f64; 6],
    /// xxx, xxy, xxz, xyy, xyz, xzz, yyy, yyz, yzz, zzz.
    third: [f64; 10],
}

impl Moments {
    pub fn of(points: impl Iterator<Item = DVec3>) -> Moments {
        let mut sums = Moments::default();
        for p in points {
            let [xx, xy, xz, yy, yz, zz] = products(p);
            sums.count += 1.0;
            sums.first += p;
            sums.second
                .iter_mut()
                .zip([xx, xy, xz, yy, yz, zz])
                .for_each(|(sum, product)| *sum += product);
            let third = [
                xx * p.x,
                xx * p.y,
                xx * p.z,
                yy * p.x,
                xy * p.z,
                zz * p.x,
                yy * p.y,
                yy * p.z,
                zz * p.y,
                zz * p.z,
            ];
            sums.third.iter_mut().zip(third).for_each(|(sum, product)| *sum += product);
        }
        sums
    }

    pub fn and(mut self, other: Moments) -> Moments {
        self.count += other.count;
        self.first += other.first;
        self.second.iter_mut().zip(other.second).for_each(|(sum, other)| *sum += other);
        self.third.iter_mut().zip(other.third).for_each(|(sum, other)| *sum += other);
        self
    }

    pub fn axes(&self) -> Axes {
        let count = self.count.max(1.0);
        let mean = self.first / count;
        let of_mean = products(mean);
        let [(least, _), (middle, second), (most, first)] =
            eigen(std::array::from_fn(|k| self.second[k] / count - of_mean[k]));
        if !(middle - least > NEGLIGIBLE * most && most - middle > NEGLIGIBLE * most) {
            return Axes::default();
        }
        let [Some(x), Some(y)] = [first, second].map(|axis| self.towards(axis, mean, most)) else {
            return Axes::default();
        };
        // Rounded to f32, so that the order of summation does not change pictures.
        let x = x.as_vec3().as_dvec3().normalize();
        let y = y.as_vec3().as_dvec3();
        let z = x.cross(y).normalize();
        Axes([x, z.cross(x), z])
    }

    /// Orients an axis so that the third central moment along it is positive; `None` if it is too
    /// small.
    fn towards(&self, axis: DVec3, mean: DVec3, most: f64) -> Option<DVec3> {
        let DVec3 { x, y, z } = axis;
        let count = self.count.max(1.0);
        let factors = [
            x * x * x,
            3.0 * x * x * y,
            3.0 * x * x * z,
            3.0 * x * y * y,
            6.0 * x * y * z,
            3.0 * x * z * z,
            y * y * y,
            3.0 * y * y * z,
            3.0 * y * z * z,
            z * z * z,
        ];
        let cubes: f64 =
            self.third.iter().zip(factors).map(|(sum, factor)| sum / count * factor).sum();
        let [xx, xy, xz, yy, yz, zz] = self.second.map(|sum| sum / count);
        let squares =
            x * x * xx + y * y * yy + z * z * zz + 2.0 * (x * y * xy + x * z * xz + y * z * yz);
        let m = mean.dot(axis);
        let lopsided = cubes - 3.0 * m * squares + 2.0 * m * m * m;
        (lopsided.abs() > NEGLIGIBLE * most.powf(1.5)).then_some(if lopsided < 0.0 {
            -axis
        } else {
            axis
        })
    }
}

/// Returns the axes of a cloud in memory.
pub fn of(parts: &[Part]) -> Axes {
    let bounds = parts
        .iter()
        .filter_map(Part::bounds)
        .reduce(|(lo, hi), (part_lo, part_hi)| (lo.min(part_lo), hi.max(part_hi)));
    let middle = bounds.map_or(DVec3::ZERO, |(lo, hi)| (lo + hi) / 2.0);
    let of_part = |part: &Part| {
        let columns = &part.columns;
        let world = |i: usize| {
            part.lattice.world([columns.x[i], columns.y[i], columns.z[i]].map(i64::from))
        };
        Moments::of((0..columns.len()).map(|i| world(i) - middle))
    };
    parts.iter().map(of_part).fold(Moments::default(), Moments::and).axes()
}

/// xx, xy, xz, yy, yz, zz.
fn products(p: DVec3) -> [f64; 6] {
    [p.x * p.x, p.x * p.y, p.x * p.z, p.y * p.y, p.y * p.z, p.z * p.z]
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    /// Points with a longer tail along every axis.
    fn lump() -> Vec<DVec3> {
        (0..500)
            .map(|k| k as f64 / 500.0)
            .map(|t| {
                DVec3::new(5.0 * t * t, 2.0 * (7.3 * t).fract().powi(3), (31.7 * t).fract().powi(4))
            })
            .collect()
    }

    #[test]
    fn axes_turn_with_the_points_wherever_they_are() {
        let of = |turn: DQuat, to: DVec3| {
            Moments::of(lump().into_iter().map(|p| turn * p + to)).axes().0
        };
        let own = of(DQuat::IDENTITY, DVec3::ZERO);
        assert!(
            (own[0].cross(own[1]).dot(own[2]) - 1.0).abs() < 1e-12 && own[0].x > 0.8,
            "{own:?}"
        );
        for k in 0..50 {
            let turn = DQuat::from_axis_angle(
                DVec3::new((k as f64).sin(), (2.1 * k as f64).cos(), 0.3).normalize(),
                k as f64,
            );
            let found = of(turn, DVec3::new(3.0, -2.0, 1.0));
            (0..3).for_each(|i| assert!(found[i].distance(turn * own[i]) < 1e-5, "{k}: {found:?}"));
        }
    }

    #[test]
    fn what_has_no_axes_of_its_own_has_those_of_its_file() {
        let ball = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| [axis, -axis]);
        assert_eq!(Moments::of(ball.clone()).axes(), Axes::default(), "no direction");
        assert_eq!(
            Moments::of(ball.map(|p| p * DVec3::new(3.0, 2.0, 1.0))).axes(),
            Axes::default(),
            "no side"
        );
        assert_eq!(Moments::default().axes(), Axes::default());
    }

    #[test]
    fn parts_add_up() {
        let points = lump();
        let (some, others) = points.split_at(123);
        let [whole, parts] = [
            Moments::of(points.iter().copied()),
            Moments::of(some.iter().copied()).and(Moments::of(others.iter().copied())),
        ];
        let (whole, parts) = (whole.axes().0, parts.axes().0);
        (0..3).for_each(|i| assert!(whole[i].distance(parts[i]) < 1e-6));
    }
}
