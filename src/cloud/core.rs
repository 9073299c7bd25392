//! The points that a camera should frame: almost all, since one stray return would push the rest into a corner.

use super::Cloud;
use glam::DVec3;
use rayon::prelude::*;

/// About as many points are looked at. Which ones their coordinates decide, not their place in the file, so that the camera does not depend on the order.
const SAMPLES: u64 = 100_000;
/// Share of the points that may lie beyond each side.
const BEYOND: f64 = 0.002;

impl Cloud {
    /// A sample of the points, without those beyond the 0.2nd and 99.8th percentile of an axis; all of a small cloud. World.
    pub fn core_points(&self) -> Vec<DVec3> {
        let every = self.len() / SAMPLES + 1;
        let mut points = Vec::new();
        for part in &self.parts {
            let columns = &part.columns;
            let at = |i: usize| part.lattice.world([columns.x[i] as i64, columns.y[i] as i64, columns.z[i] as i64]);
            let chosen = |&i: &usize| scatter([columns.x[i], columns.y[i], columns.z[i]]).is_multiple_of(every);
            points.par_extend((0..columns.len()).into_par_iter().filter(chosen).map(at));
        }
        let beyond = (points.len() as f64 * BEYOND) as usize;
        if beyond > 0 {
            let last = points.len() - 1;
            let mut values: Vec<f64> = Vec::new();
            let [mut low, mut high] = [DVec3::ZERO; 2];
            for axis in 0..3 {
                values.clear();
                values.extend(points.iter().map(|p| p[axis]));
                low[axis] = *values.select_nth_unstable_by(beyond, f64::total_cmp).1;
                high[axis] = *values.select_nth_unstable_by(last - beyond, f64::total_cmp).1;
            }
            points.retain(|p| p.cmpge(low).all() && p.cmple(high).all());
        }
        points
    }
}

/// A number that looks random and depends on a point's lattice coordinates alone (the finaliser of SplitMix64, Steele et al. 2014).
fn scatter(q: [i32; 3]) -> u64 {
    let mut h = (q[0] as u32 as u64) ^ (q[1] as u32 as u64).rotate_left(21) ^ (q[2] as u32 as u64).rotate_left(42);
    h = (h ^ h >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    h = (h ^ h >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    h ^ h >> 31
}
