//! The linear map through which a cloud is drawn: of an affine transform, what no view can express.

use glam::{DMat3, DVec3};

/// A linear map from a cloud's own coordinates to those of views, with an inverse; it may mirror.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearMap {
    matrix: DMat3,
    inverse: DMat3,
}

impl Default for LinearMap {
    fn default() -> LinearMap {
        LinearMap { matrix: DMat3::IDENTITY, inverse: DMat3::IDENTITY }
    }
}

impl LinearMap {
    /// Returns `None` if the matrix has no finite inverse.
    pub fn new(matrix: DMat3) -> Option<LinearMap> {
        // By the largest number, so that determinants neither overflow nor vanish.
        let columns = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
        let largest =
            columns.map(|column| column.abs().max_element()).into_iter().fold(0.0, f64::max);
        let scaled = matrix * largest.recip();
        let inverse = scaled.inverse() * largest.recip();
        let is_sound = matrix.is_finite() && scaled.determinant() != 0.0 && inverse.is_finite();
        is_sound.then_some(LinearMap { matrix, inverse })
    }

    /// Tests whether it changes nothing.
    pub fn is_identity(&self) -> bool {
        self.matrix == DMat3::IDENTITY
    }

    /// Returns words that are equal only for equal maps; none if it changes nothing.
    pub fn identity(&self) -> impl Iterator<Item = u64> {
        let numbers = self.matrix.to_cols_array().map(f64::to_bits);
        (!self.is_identity()).then_some(numbers).into_iter().flatten()
    }

    /// Returns where a place of the cloud is drawn.
    pub fn place(&self, own: DVec3) -> DVec3 {
        if self.is_identity() { own } else { self.matrix * own }
    }

    /// Returns the place of the cloud that is drawn at `place`.
    pub fn own(&self, place: DVec3) -> DVec3 {
        if self.is_identity() { place } else { self.inverse * place }
    }

    /// Returns the box around a box of the cloud, where it is drawn.
    pub fn bounds(&self, (min, max): (DVec3, DVec3)) -> (DVec3, DVec3) {
        if self.is_identity() {
            return (min, max);
        }
        let (middle, half) = (self.matrix * ((min + max) / 2.0), (max - min) / 2.0);
        let DMat3 { x_axis, y_axis, z_axis } = self.matrix;
        let reach = x_axis.abs() * half.x + y_axis.abs() * half.y + z_axis.abs() * half.z;
        (middle - reach, middle + reach)
    }

    /// Returns the vector whose product with a place of the cloud is that of `axis` with where it
    /// is drawn.
    pub fn pulled(&self, axis: DVec3) -> DVec3 {
        if self.is_identity() { axis } else { self.matrix.transpose() * axis }
    }

    /// Returns the vector whose product with a normal of the cloud's surface is, up to its length,
    /// that of `axis` with the normal where it is drawn.
    pub fn pulled_by_normals(&self, axis: DVec3) -> DVec3 {
        self.own(axis)
    }

    /// Returns the largest factor by which it lengthens a vector.
    pub fn largest_stretch(&self) -> f64 {
        if self.is_identity() {
            return 1.0;
        }
        // The root of the largest eigenvalue of a symmetric matrix, whose eigenvalues are the roots
        // of a cubic.
        let square = self.matrix.transpose() * self.matrix;
        let [x, y, z] = [square.x_axis.x, square.y_axis.y, square.z_axis.z];
        let mean = (x + y + z) / 3.0;
        let off = square.y_axis.x.powi(2) + square.z_axis.x.powi(2) + square.z_axis.y.powi(2);
        let spread = [x, y, z].map(|at| (at - mean).powi(2)).into_iter().sum::<f64>() + 2.0 * off;
        let radius = (spread / 6.0).sqrt();
        if radius == 0.0 {
            return mean.sqrt();
        }
        let shape = (square - DMat3::from_diagonal(DVec3::splat(mean))) * radius.recip();
        let angle = (shape.determinant() / 2.0).clamp(-1.0, 1.0).acos() / 3.0;
        (mean + 2.0 * radius * angle.cos()).sqrt()
    }

    /// Returns the longest diagonal of a box of these sides, where it is drawn.
    pub fn diagonal(&self, sides: DVec3) -> f64 {
        if self.is_identity() {
            return sides.length();
        }
        let sign = |k: u32, bit: u32| if k >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let diagonal =
            |k| (self.matrix * (sides * DVec3::new(1.0, sign(k, 0), sign(k, 1)))).length();
        (0..4).map(diagonal).fold(0.0, f64::max)
    }

    /// Returns the factor by which points lie farther apart that fill a box of these sides, as
    /// surfaces do: the root of that of the area of its faces.
    pub fn spread(&self, sides: DVec3) -> f64 {
        if self.is_identity() {
            return 1.0;
        }
        let DMat3 { x_axis: x, y_axis: y, z_axis: z } = self.matrix;
        let sides = (sides / sides.abs().max_element()).abs();
        let faces = DVec3::new(sides.y * sides.z, sides.z * sides.x, sides.x * sides.y);
        let of_faces = DVec3::new(y.cross(z).length(), z.cross(x).length(), x.cross(y).length());
        let [before, after] = [faces.length(), (faces * of_faces).length()];
        // Points along a line, or in one place.
        if before > 0.0 { (after / before).sqrt() } else { self.largest_stretch() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn number() -> impl Strategy<Value = f64> {
        -3.0f64..3.0
    }

    proptest! {
        #[test]
        fn boxes_lengths_and_products_hold_what_is_drawn(
            numbers in prop::array::uniform9(number()),
            places in prop::array::uniform6(number()),
        ) {
            let matrix = DMat3::from_cols_array(&numbers);
            prop_assume!(matrix.determinant().abs() > 1e-3);
            let map = LinearMap::new(matrix).unwrap();
            let [a, b] = [DVec3::from_slice(&places), DVec3::from_slice(&places[3..])];
            let drawn = map.place(a);
            prop_assert!((map.own(drawn) - a).length() < 1e-9 * (1.0 + a.length()) / matrix.determinant().abs());
            prop_assert!((map.pulled(b).dot(a) - b.dot(drawn)).abs() < 1e-9);
            let (low, high) = map.bounds((a.min(b), a.max(b)));
            let slack = DVec3::splat(1e-9);
            prop_assert!(drawn.cmpge(low - slack).all() && drawn.cmple(high + slack).all());
            prop_assert!(drawn.length() <= map.largest_stretch() * a.length() * (1.0 + 1e-9));
            let sides = (b - a).abs();
            prop_assert!((map.place(b) - drawn).length() <= map.diagonal(sides) * (1.0 + 1e-12));
            // Two directions in a surface stay perpendicular to its normal.
            let (in_surface, normal) = (a.cross(b), a);
            let product = map.pulled_by_normals(map.place(in_surface)).dot(normal);
            prop_assert!(product.abs() < 1e-6, "{}", product);
        }
    }

    #[test]
    fn spacings_follow_areas() {
        let stretched = LinearMap::new(DMat3::from_diagonal(DVec3::new(4.0, 1.0, 9.0))).unwrap();
        // A plane on the ground, one upright, and as much in all directions.
        assert_eq!(stretched.spread(DVec3::new(5.0, 5.0, 0.0)), 2.0);
        assert_eq!(stretched.spread(DVec3::new(0.0, 2.0, 7.0)), 3.0);
        assert_eq!(stretched.largest_stretch(), 9.0);
        assert_eq!(
            LinearMap::new(DMat3::from_diagonal(DVec3::splat(-2.0))).unwrap().spread(DVec3::ONE),
            2.0
        );
        assert_eq!(LinearMap::new(DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0))), None);
        assert_eq!(LinearMap::new(DMat3::ZERO), None);
        assert_eq!(LinearMap::new(DMat3::from_diagonal(DVec3::new(1.0, 1.0, f64::NAN))), None);
    }
}
