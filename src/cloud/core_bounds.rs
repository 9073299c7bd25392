//! The box that a camera should frame: where almost all points are, since one stray return would push the rest into a corner.

use super::Cloud;
use glam::DVec3;

/// Points looked at; every k-th of the cloud, so that all parts count by their points.
const SAMPLES: u64 = 200_000;
/// Share of the points that may lie beyond each side.
const BEYOND: f64 = 0.002;

impl Cloud {
    /// The box between the 0.2nd and 99.8th percentile of each axis, world; all of a small cloud. `None` for an empty one.
    pub fn core_bounds(&self) -> Option<(DVec3, DVec3)> {
        let every = (self.len() / SAMPLES + 1) as usize;
        let mut axes: [Vec<f64>; 3] = Default::default();
        for part in &self.parts {
            let columns = &part.columns;
            for i in (0..columns.len()).step_by(every) {
                let p = part.lattice.world([columns.x[i] as i64, columns.y[i] as i64, columns.z[i] as i64]);
                axes.iter_mut().zip(p.to_array()).for_each(|(axis, v)| axis.push(v));
            }
        }
        let beyond = (axes[0].len() as f64 * BEYOND) as usize;
        let last = axes[0].len().checked_sub(1)?;
        let at = |axis: &mut Vec<f64>, k: usize| *axis.select_nth_unstable_by(k, f64::total_cmp).1;
        let low = axes.each_mut().map(|axis| at(axis, beyond));
        let high = axes.each_mut().map(|axis| at(axis, last - beyond));
        Some((DVec3::from_array(low), DVec3::from_array(high)))
    }
}
