//! The best that points can tell of a surface: linear interpolation between those that are visible.
//!
//! The truth says which points these are, and where the surface is, so that nothing is hidden
//! wrongly, and no hole and no background is filled. What is left is what lies between points.

use super::truth::Truth;
use crate::view::Projection;
use delaunator::{Point, triangulate};

/// Its name beside styles.
pub const NAME: &str = "linear";

/// Returns which pixels have a visible point. `raw` is depth as projected.
pub fn visible(truth: &Truth, noise_px: f64, raw: &[f32]) -> Vec<bool> {
    let is_visible = |(i, depth): (usize, &f32)| {
        depth.is_finite() && truth.is_visible(i, *depth as f64, noise_px) == Some(true)
    };
    raw.iter().enumerate().map(is_visible).collect()
}

/// Returns the depths of a picture, interpolated in the Delaunay triangulation of its visible
/// points, in pixels entirely in the silhouette; infinite elsewhere. With perspective, inverse
/// depths are interpolated, which are affine on planes.
pub fn linear(truth: &Truth, raw: &[f32], visible: &[bool]) -> Vec<f32> {
    let width = truth.view.size[0] as usize;
    let flat = |depth: f64| match truth.view.camera.projection {
        Projection::Perspective => 1.0 / depth,
        Projection::Orthographic => depth,
    };
    let visible: Vec<usize> = (0..raw.len()).filter(|&i| visible[i]).collect();
    let places: Vec<Point> =
        visible.iter().map(|&i| Point { x: (i % width) as f64, y: (i / width) as f64 }).collect();
    let mut depths = vec![f32::INFINITY; raw.len()];
    for corners in triangulate(&places).triangles.chunks_exact(3) {
        let [a, b, c] = [corners[0], corners[1], corners[2]];
        let [p, q, r] = [a, b, c].map(|k| &places[k]);
        let values = [a, b, c].map(|k| flat(raw[visible[k]] as f64));
        let area = cross(p, q, r);
        let rows = p.y.min(q.y).min(r.y)..=p.y.max(q.y).max(r.y);
        for y in *rows.start() as usize..=*rows.end() as usize {
            let [from, to] = span([p, q, r], y as f64);
            for x in from.ceil() as usize..=to.floor() as usize {
                let at = Point { x: x as f64, y: y as f64 };
                let weights = [cross(q, r, &at), cross(r, p, &at), cross(p, q, &at)];
                let value: f64 = weights.iter().zip(values).map(|(w, v)| w / area * v).sum();
                let i = y * width + x;
                if truth.inside[i] {
                    // The same either way: a depth of its inverse.
                    depths[i] = flat(value) as f32;
                }
            }
        }
    }
    depths
}

/// Returns twice the signed area of a triangle.
fn cross(a: &Point, b: &Point, c: &Point) -> f64 {
    (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)
}

/// Returns the first and the last place of a row within a triangle.
fn span(corners: [&Point; 3], y: f64) -> [f64; 2] {
    let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
    for k in 0..3 {
        let [a, b] = [corners[k], corners[(k + 1) % 3]];
        if (a.y - y) * (b.y - y) > 0.0 {
            continue;
        }
        let crossings =
            if a.y == b.y { [a.x, b.x] } else { [a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x); 2] };
        for x in crossings {
            ends = [ends[0].min(x), ends[1].max(x)];
        }
    }
    ends
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::truth::Surface;
    use crate::view::{Camera, View};
    use glam::DVec3;

    /// A plane that is not parallel to the picture.
    struct Slope;

    impl Surface for Slope {
        fn first(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
            let normal = DVec3::new(0.2, 0.3, 1.0);
            Some(normal.dot(DVec3::new(0.0, 0.0, -2.0) - origin) / normal.dot(direction))
        }
    }

    #[test]
    fn planes_are_exact_between_points() {
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let camera = Camera {
                eye: DVec3::ZERO,
                target: DVec3::NEG_Z,
                up: DVec3::Y,
                fov_y: 60.0,
                projection,
                ortho_height: (projection == Projection::Orthographic).then_some(2.0),
            };
            let truth = Truth::cast(&View::new(camera, [64, 48]).unwrap(), &Slope);
            let taken =
                |i: usize| i.is_multiple_of(29) || [0, 63, 47 * 64, 48 * 64 - 1].contains(&i);
            let raw: Vec<f32> = (0..truth.depth.len())
                .map(|i| if taken(i) { truth.depth[i] as f32 } else { f32::INFINITY })
                .collect();
            let depths = linear(&truth, &raw, &visible(&truth, 0.0, &raw));
            for (i, (found, expected)) in depths.iter().zip(&truth.depth).enumerate() {
                let off = (*found as f64 / expected - 1.0).abs();
                assert!(off < 1e-6, "{projection:?}, pixel {i}: {found}, not {expected}");
            }
        }
    }
}
