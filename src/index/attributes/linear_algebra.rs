//! Eigenvalues and eigenvectors of symmetric 3 x 3 matrices.

use glam::DVec3;

/// Jacobi sweeps; they converge quadratically: three leave 1e-10, five nothing.
const SWEEPS: usize = 6;

/// Returns eigenvalues, smallest first, and unit eigenvectors of a symmetric matrix (Jacobi 1846;
/// Golub and Van Loan 2013, sec. 8.5).
pub fn eigen([xx, xy, xz, yy, yz, zz]: [f64; 6]) -> [(f64, DVec3); 3] {
    let mut a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let mut vectors = [DVec3::X, DVec3::Y, DVec3::Z];
    for _ in 0..SWEEPS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let tau = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = tau.signum() / (tau.abs() + (1.0 + tau * tau).sqrt());
            let c = 1.0 / (1.0 + t * t).sqrt();
            let s = t * c;
            a[p][p] -= t * a[p][q];
            a[q][q] += t * a[p][q];
            (a[p][q], a[q][p]) = (0.0, 0.0);
            let r = 3 - p - q;
            let (rp, rq) = (a[r][p], a[r][q]);
            (a[r][p], a[r][q]) = (c * rp - s * rq, s * rp + c * rq);
            (a[p][r], a[q][r]) = (a[r][p], a[r][q]);
            (vectors[p], vectors[q]) =
                (c * vectors[p] - s * vectors[q], s * vectors[p] + c * vectors[q]);
        }
    }
    let mut pairs = [0, 1, 2].map(|k| (a[k][k], vectors[k]));
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn eigenvectors_solve_their_equation(m in prop::array::uniform6(-1.0f64..1.0)) {
            let [xx, xy, xz, yy, yz, zz] = m;
            let pairs = eigen(m);
            prop_assert!(pairs[0].0 <= pairs[1].0 && pairs[1].0 <= pairs[2].0);
            for (value, v) in pairs {
                let product = DVec3::new(DVec3::new(xx, xy, xz).dot(v), DVec3::new(xy, yy, yz).dot(v), DVec3::new(xz, yz, zz).dot(v));
                prop_assert!((product - value * v).length() < 1e-13 && (v.length() - 1.0).abs() < 1e-14);
            }
        }
    }
}
