//! Unit vectors in 24 bits: the octahedron |x| + |y| + |z| = 1 unfolded onto a square, 12 bits
//! along each side (Cigolle et al. 2014). The error is at most 0.06 degrees (half a step along both
//! sides, in the middle of a face).

use glam::DVec3;

/// Largest code along a side: even, so that 0 has a code; the code above marks an unknown vector.
const LAST: f64 = 4094.0;
const SIDE_BITS: u32 = 12;
const SIDE: u32 = (1 << SIDE_BITS) - 1;

/// The word of a point without a normal, all ones. Normals are never guessed (guide: numerics, case
/// 18).
pub const UNKNOWN: u32 = (1 << (2 * SIDE_BITS)) - 1;

/// Packs a vector of any length but 0.
pub fn pack(v: DVec3) -> u32 {
    let n = v / v.abs().element_sum();
    let (x, y) = if n.z >= 0.0 { (n.x, n.y) } else { (fold(n.x, n.y), fold(n.y, n.x)) };
    let [x, y] = [x, y].map(|c| ((c * 0.5 + 0.5) * LAST).round() as u32);
    x | y << SIDE_BITS
}

/// Unpacks a word as the device does; bits above the 24 are ignored.
pub fn unpack(word: u32) -> Option<DVec3> {
    if word & UNKNOWN == UNKNOWN {
        return None;
    }
    let [x, y] = [word & SIDE, word >> SIDE_BITS & SIDE].map(|c| c as f64 / (LAST / 2.0) - 1.0);
    let z = 1.0 - x.abs() - y.abs();
    let n = if z >= 0.0 { DVec3::new(x, y, z) } else { DVec3::new(fold(x, y), fold(y, x), z) };
    Some(n.normalize())
}

/// Packs a normal as stored in files, 127 = 1.0; 0 is unknown.
pub fn of_bytes(normal: [i8; 3]) -> u32 {
    if normal == [0; 3] { UNKNOWN } else { pack(DVec3::from_array(normal.map(f64::from))) }
}

fn fold(a: f64, b: f64) -> f64 {
    (1.0 - b.abs()) * if a >= 0.0 { 1.0 } else { -1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_vector_comes_back_within_its_rounding(x in -1.0f64..1.0, y in -1.0f64..1.0, z in -1.0f64..1.0, scale in -20i32..20) {
            let v = DVec3::new(x, y, z).normalize_or(DVec3::X);
            let back = unpack(pack(v * 2f64.powi(scale))).expect("a vector");
            prop_assert!(back.cross(v).length().atan2(back.dot(v)).to_degrees() < 0.06);
        }
    }

    #[test]
    fn axes_are_exact_and_none_is_none() {
        for v in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z] {
            assert_eq!(unpack(pack(v)), Some(v));
        }
        assert_eq!(
            (of_bytes([0; 3]), unpack(UNKNOWN), unpack(0xAB_FF_FF_FF)),
            (UNKNOWN, None, None)
        );
        assert_eq!(unpack(of_bytes([0, -127, 0])), Some(DVec3::NEG_Y));
    }
}
