//! The f64 twin of project and resolve: for each point the possible pixels and depths; and a check
//! of a drawn depth layer.
//!
//! The kernel computes, for each of three rows, `r1 d1 + r2 d2 + r3 d3 + w`: d is a difference of
//! integers, r and w are computed in f64 and rounded once (`record_of`). With v the point relative
//! to the eye, a an axis of the camera and c the size of the node's cells, `record_of` chooses the
//! cell nearest to the eye on each axis, so that
//!   |r_i d_i| + |w_i| <= |a_i| (|v_i| + c_i)
//! and the sum of the magnitudes is at most S = sum |a_i| (|v_i| + c_i). In ulps of S: rounding r
//! or w 1/2, converting d 1, the products 1, the three sums 3; together
//!   |row - a . v| <= 5.5 ulp S            (11 u S; guide: numerics, case 2 has 12 u f)
//! From afar that is too much: d spans at most the node's cube, of sides L, and w is summed in f64.
//! With T = sum |a_i| (L_i + c_i), |w| <= |a . v| + T, so
//!   |row - a . v| <= 5 ulp T + 1.5 ulp |a . v|
//! Both hold, and the smaller is used; plus the f64 arithmetic of `record_of`, plus the
//! displacement by reading and quantising. Then x = X * (1 / z) + centre: 2.5 + 1 ulps of the
//! quotient, 1 of the sum. Pixels and depths are intervals: wide for a point near the camera plane
//! or far outside of the picture.
//!
//! A drawn depth Z must, **in every pixel**, be that of a point that may be in the pixel, and no
//! farther than any point that certainly is. If no uncertain point could be in front, that leaves
//! the nearest point alone; the other pixels are *in the band*.

use super::{FLUSH, ULP};
use crate::cloud::{Lattice, Part};
use crate::config::{NEAR_M, QUANTISATION_PX};
use crate::passes::project::Precision;
use crate::view::{Projection, View};
use glam::DVec3;
use rayon::prelude::*;

/// Displacements of points before the kernel, per axis `[m]`.
#[derive(Clone, Copy, Debug)]
pub struct Source {
    /// The lattice's step: all planes together are no coarser.
    pub step: DVec3,
    /// The largest numbers that `record_of` adds in f64: the offset as seen from the eye, and
    /// coordinates on the lattice.
    pub reach: DVec3,
    /// Sides of a cube, in steps, that contains any node's cube: less than twice the longest side
    /// of all points.
    pub cube: DVec3,
    /// How far a reader may have moved points from their positions in the file.
    pub moved: DVec3,
    /// True if planes are chosen as `Precision::Auto` does; else all are drawn.
    pub auto: bool,
}

impl Source {
    /// Returns the source of a part. `moved` is 0 if the lattice is the file's own.
    pub fn new(part: &Part, view: &View, precision: Precision, moved: DVec3) -> Source {
        let largest =
            |column: &[i32]| column.iter().map(|q| q.unsigned_abs()).max().unwrap_or(0) as f64;
        let columns = &part.columns;
        let steps = DVec3::new(largest(&columns.x), largest(&columns.y), largest(&columns.z));
        let reach = (part.lattice.offset - view.camera.eye).abs() + part.lattice.step.abs() * steps;
        let width = [&columns.x, &columns.y, &columns.z]
            .map(|column| crate::cloud::range(column).map_or(0, |(lo, hi)| hi as i64 - lo as i64));
        let cube =
            part.lattice.step.abs() * 2.0 * width.into_iter().max().unwrap_or(0).max(1) as f64;
        Source {
            step: part.lattice.step.abs(),
            reach,
            cube,
            moved,
            auto: precision == Precision::Auto,
        }
    }
}

/// Returns the positions of all points of a part relative to the eye.
pub fn positions(part: &Part, eye: DVec3) -> Vec<DVec3> {
    let Part { columns, lattice, .. } = part;
    let at = |i: usize| {
        relative(lattice, [columns.x[i] as i64, columns.y[i] as i64, columns.z[i] as i64], eye)
    };
    (0..columns.len()).into_par_iter().map(at).collect()
}

/// Returns `offset + step * q - eye` to the last bit: sum and product with their errors (Dekker
/// 1971), since at UTM 5,000,000 even f64 rounds by half a nanometre.
pub fn relative(lattice: &Lattice, q: [i64; 3], eye: DVec3) -> DVec3 {
    let axis = |offset: f64, step: f64, q: f64, eye: f64| {
        let (apart, apart_error) = two_sum(offset, -eye);
        let along = step * q;
        let along_error = step.mul_add(q, -along);
        let (sum, sum_error) = two_sum(apart, along);
        sum + (sum_error + apart_error + along_error)
    };
    let Lattice { offset: o, step: s } = lattice;
    DVec3::new(
        axis(o.x, s.x, q[0] as f64, eye.x),
        axis(o.y, s.y, q[1] as f64, eye.y),
        axis(o.z, s.z, q[2] as f64, eye.z),
    )
}

fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let b_seen = sum - a;
    (sum, (a - (sum - b_seen)) + (b - b_seen))
}

/// The possible positions of a drawn point.
#[derive(Clone, Copy, Debug)]
pub struct Footprint {
    /// Exact position `[px]`.
    pub at: [f64; 2],
    /// Planar depth `[m]`.
    pub depth: f64,
    /// Least and greatest pixel positions and depth that the kernel may find.
    pub x: [f64; 2],
    pub y: [f64; 2],
    pub z: [f64; 2],
}

/// Bound on terms of second order and on the f64 rounding of this code, relative to terms of first
/// order.
const SECOND_ORDER: f64 = 1.0 + 1e-5;

/// Returns the footprint of the point at `v` from the eye; `None` if it is certainly behind the
/// camera plane.
pub fn footprint(view: &View, source: &Source, v: DVec3) -> Option<Footprint> {
    let f = view.focal_px();
    let perspective = view.camera.projection == Projection::Perspective;
    let basis = &view.basis;
    let depth = v.dot(basis.forward);
    // `Auto` keeps half a cell's diagonal below QUANTISATION_PX at the node's least depth, and no
    // point of the node is in front of that.
    let half_cell = if source.auto {
        QUANTISATION_PX * if perspective { depth.max(0.0) } else { 1.0 } / f
    } else {
        0.0
    };
    let cell = source.step.max(DVec3::splat(2.0 * half_cell));
    let magnitudes = v.abs() + cell;
    // Eight f64 roundings of numbers of at most this size: offset - eye, origin, their products and
    // sums, nearest, the dot product.
    let in_f64 = 8.0 * f64::EPSILON * (source.reach + magnitudes);
    // Cells may be 2^9 times finer than steps; a row whose entries are flushed loses 2^-126 per
    // cell.
    let flushed = FLUSH * (512.0 * (v.abs() / source.step + 1.0).element_sum() + 4.0);
    let error = |axis: DVec3| {
        let along = v.dot(axis).abs();
        let axis = axis.abs();
        let ulps =
            (5.5 * axis.dot(magnitudes)).min(5.0 * axis.dot(source.cube + cell) + 1.5 * along);
        ulps * ULP * SECOND_ORDER + axis.dot(in_f64 + source.moved) + half_cell + flushed
    };
    let around = |axis: DVec3| [v.dot(axis) - error(axis), v.dot(axis) + error(axis)];
    let z = around(basis.forward);
    let near = NEAR_M as f64;
    if z[1] < near {
        return None;
    }
    let in_front = [z[0].max(near), z[1]];
    let side = |axis: DVec3, size: u32| {
        let centre = size as f64 / 2.0;
        let [lo, hi] = around(axis).map(|metres| metres * f);
        let (at, [lo, hi]) = match perspective {
            true => (
                v.dot(axis) * f / depth,
                [lo / in_front[(lo > 0.0) as usize], hi / in_front[(hi < 0.0) as usize]],
            ),
            false => (v.dot(axis) * f, [lo, hi]),
        };
        let widened = |x: f64, way: f64| {
            let x = x + way * 3.5 * ULP * SECOND_ORDER * x.abs() + centre;
            x + way * (ULP * SECOND_ORDER * x.abs() + FLUSH)
        };
        (at + centre, [widened(lo, -1.0), widened(hi, 1.0)])
    };
    let (x, y) = (side(basis.right, view.size[0]), side(-basis.up, view.size[1]));
    Some(Footprint { at: [x.0, y.0], depth, x: x.1, y: y.1, z })
}

impl Footprint {
    /// Returns the pixels that it may be in, clipped to the picture: columns and rows.
    fn pixels(&self, size: [u32; 2]) -> [std::ops::Range<u32>; 2] {
        let clipped = |[lo, hi]: [f64; 2], side: u32| {
            lo.floor().clamp(0.0, side as f64) as u32
                ..(hi.floor() + 1.0).clamp(0.0, side as f64) as u32
        };
        [clipped(self.x, size[0]), clipped(self.y, size[1])]
    }

    /// Tests whether it certainly lies in one pixel, in front of the camera.
    fn certain(&self) -> bool {
        self.z[0] >= NEAR_M as f64
            && self.x[0].floor() == self.x[1].floor()
            && self.y[0].floor() == self.y[1].floor()
    }

    /// Tests whether it lies on an edge between pixels even in f64, to a millionth of its bound:
    /// data and picture are aligned, and no arithmetic could decide it.
    fn on_edge(&self) -> bool {
        let aligned = |at: f64, [lo, hi]: [f64; 2]| (at - at.round()).abs() <= 1e-6 * (hi - lo);
        aligned(self.at[0], self.x) || aligned(self.at[1], self.y)
    }
}

/// The comparison of a drawn depth layer with the reference.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Agreement {
    pub pixels: usize,
    /// Pixels in which some point certainly lies.
    pub covered: usize,
    /// Pixels with one possible answer that was drawn.
    pub agreeing: usize,
    /// Pixels with several possible answers, one of which was drawn.
    pub in_band: usize,
    /// Pixels of `in_band` whose doubtful points lie on an edge even in f64.
    pub on_edge: usize,
    /// Expected pixels in the band if points lie uniformly in their pixels: a point is in doubt
    /// with the probability that its bounds take of its pixel.
    pub expected_in_band: f64,
    /// Pixels that no allowed arithmetic gives.
    pub wrong: usize,
    /// The first of these: column, row, drawn depth, least and greatest allowed depth.
    pub example: Option<[f64; 5]>,
}

impl Agreement {
    /// Returns a reason to reject the result: a wrong pixel, or more pixels in the band than 1e-4
    /// of all (guide: numerics, rule 3) beyond those on edges and those explained by the band's
    /// width. Explained is what chance gives more often than 3e-7, as five standard deviations
    /// would be. Doubtful points are rare and independent, and each puts at most two pixels in
    /// doubt in the mean, so half their number is at worst Poisson distributed with half the mean.
    /// Its tail is bounded by Chernoff's inequality, which, unlike a normal distribution, also
    /// holds if less than one pixel is expected.
    pub fn objection(&self) -> Option<String> {
        let beyond = (self.in_band - self.on_edge) as f64 - 1e-4 * self.pixels as f64;
        let (half, mean) = (beyond / 2.0, self.expected_in_band / 2.0);
        let unexplained = half > mean && half - mean - half * (half / mean).ln() < 3e-7f64.ln();
        (self.wrong > 0 || unexplained).then(|| format!("{self:?}"))
    }
}

#[derive(Clone, Copy)]
struct Candidate {
    pixel: u32,
    z: [f64; 2],
    certain: bool,
    on_edge: bool,
}

/// Compares `drawn`, depths row by row from the top left, with all points: parts and their
/// positions relative to the eye.
pub fn check(view: &View, parts: &[(Source, Vec<DVec3>)], drawn: &[f32]) -> Agreement {
    let footprints = || {
        parts
            .iter()
            .flat_map(|(source, positions)| positions.iter().map(move |v| (source, *v)))
            .collect::<Vec<_>>()
    };
    let footprints: Vec<Footprint> =
        footprints().into_par_iter().filter_map(|(source, v)| footprint(view, source, v)).collect();
    let width = view.size[0];
    let candidates = |f: &Footprint| {
        let [columns, rows] = f.pixels(view.size);
        let (z, certain, on_edge) = (f.z, f.certain(), f.on_edge());
        rows.flat_map(move |row| {
            columns.clone().map(move |column| Candidate {
                pixel: row * width + column,
                z,
                certain,
                on_edge,
            })
        })
    };
    let mut candidates: Vec<Candidate> = footprints.par_iter().flat_map_iter(candidates).collect();
    candidates.par_sort_unstable_by_key(|candidate| candidate.pixel);
    let mut in_pixel = vec![0..0; drawn.len()];
    let mut start = 0;
    for run in candidates.chunk_by(|a, b| a.pixel == b.pixel) {
        in_pixel[run[0].pixel as usize] = start..start + run.len();
        start += run.len();
    }
    let mut agreement = Agreement { pixels: drawn.len(), ..Agreement::default() };
    let mut front = vec![f64::INFINITY; drawn.len()];
    for (pixel, range) in in_pixel.into_iter().enumerate() {
        let here = &candidates[range];
        let depth = drawn[pixel] as f64;
        let nearest =
            here.iter().filter(|c| c.certain).map(|c| c.z[1]).fold(f64::INFINITY, f64::min);
        front[pixel] = nearest;
        let doubtful = || here.iter().filter(|c| !c.certain && c.z[0] < nearest);
        let possible = here.iter().any(|c| c.z[0] <= depth && depth <= c.z[1]) && depth <= nearest
            || nearest.is_infinite() && depth == f64::INFINITY;
        agreement.covered += nearest.is_finite() as usize;
        match (possible, doubtful().next()) {
            (false, _) => {
                agreement.wrong += 1;
                let least = here.iter().map(|c| c.z[0]).fold(f64::INFINITY, f64::min);
                agreement.example.get_or_insert([
                    (pixel as u32 % width) as f64,
                    (pixel as u32 / width) as f64,
                    depth,
                    least,
                    nearest,
                ]);
            }
            (true, None) => agreement.agreeing += 1,
            (true, Some(_)) => {
                agreement.in_band += 1;
                agreement.on_edge += doubtful().all(|c| c.on_edge) as usize;
            }
        }
    }
    // The probability per pixel that no point puts it in doubt.
    let mut clear = vec![1.0; drawn.len()];
    footprints.iter().for_each(|f| doubt(f, view.size, &front, &mut clear));
    agreement.expected_in_band = clear.into_iter().map(|clear| 1.0 - clear).sum();
    agreement
}

/// Returns the pixels that a point may put in the band if it may lie anywhere in its own, with
/// probabilities: its own pixel, if in front, with the area of the margin within the pixel; each
/// neighbour that it would be in front of, with the area of the margin on its side.
fn doubt(f: &Footprint, size: [u32; 2], front: &[f64], clear: &mut [f64]) {
    let half = [(f.x[1] - f.x[0]) / 2.0, (f.y[1] - f.y[0]) / 2.0];
    let mut count = |x: f64, y: f64, probability: f64| {
        let inside = x >= 0.0 && y >= 0.0 && x < size[0] as f64 && y < size[1] as f64;
        let pixel = if inside { y as usize * size[0] as usize + x as usize } else { return };
        if f.z[0] <= front[pixel] {
            clear[pixel] *= 1.0 - probability;
        }
    };
    if half[0] >= 0.5 || half[1] >= 0.5 {
        let [columns, rows] = f.pixels(size);
        rows.for_each(|y| columns.clone().for_each(|x| count(x as f64, y as f64, 1.0)));
        return;
    }
    let [x, y] = f.at.map(f64::floor);
    count(x, y, 1.0 - (1.0 - 2.0 * half[0]) * (1.0 - 2.0 * half[1]));
    for (dx, dy, margin) in
        [(-1.0, 0.0, half[0]), (1.0, 0.0, half[0]), (0.0, -1.0, half[1]), (0.0, 1.0, half[1])]
    {
        count(x + dx, y + dy, margin);
    }
}
