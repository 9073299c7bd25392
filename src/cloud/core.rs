//! The points that a camera should frame: almost all, since one stray return would push the rest into a corner.

use super::Cloud;
use glam::DVec3;

/// Points looked at; every k-th of the cloud, so that all parts count by their points.
const SAMPLES: u64 = 100_000;
/// Share of the points that may lie beyond each side.
const BEYOND: f64 = 0.002;

impl Cloud {
    /// A sample of the points, without those beyond the 0.2nd and 99.8th percentile of an axis; all of a small cloud. World.
    pub fn core_points(&self) -> Vec<DVec3> {
        let every = (self.len() / SAMPLES + 1) as usize;
        let mut points = Vec::new();
        for part in &self.parts {
            let columns = &part.columns;
            let at = |i: usize| part.lattice.world([columns.x[i] as i64, columns.y[i] as i64, columns.z[i] as i64]);
            points.extend((0..columns.len()).step_by(every).map(at));
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
