//! The error of a picture against that of the finest tuning of the same view.
//!
//! In pixels: how far each pixel must be moved, or how much else it must change, to become the
//! reference's. A depth that differs by 1 % counts as one pixel, and so does a channel that differs
//! by a tenth of its range. Of all pixels of the reference within 4 px the nearest counts in which
//! the largest of the three is least; if all are farther off, the error is 4 px. In parts of the
//! depth: how much the depths of the same pixel differ, 4 % at most, and where one picture alone
//! has a depth.
//!
//! Both are means over the pixels that either picture covers.

use rayon::prelude::*;

/// Largest error of a pixel `[px]`.
pub const MOST_PX: f64 = 4.0;
/// Difference of depths that counts as a pixel, in parts of the reference's depth.
pub const DEPTH_A_PIXEL: f64 = 0.01;
/// Difference of a channel that counts as a pixel, in parts of its range, sRGB.
pub const COLOR_A_PIXEL: f64 = 0.1;

/// A picture with its depths.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pixels {
    pub size: [u32; 2],
    /// Planar depths `[m]`; not finite where there is no surface.
    pub depth: Vec<f32>,
    /// Red, green and blue of each pixel, sRGB.
    pub rgb: Vec<u8>,
}

/// Errors of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Errors {
    /// Mean error `[px]`.
    pub px: f64,
    /// Mean error in parts of the depth.
    pub depth: f64,
}

impl Errors {
    /// Returns the larger of both errors.
    pub fn worst(self, other: Errors) -> Errors {
        Errors { px: self.px.max(other.px), depth: self.depth.max(other.depth) }
    }
}

impl Pixels {
    /// Returns the picture of a screen's first words, one a pixel, whose lowest byte is red, or
    /// blue.
    pub fn of_screen(size: [u32; 2], words: &[u32], blue_first: bool, depth: Vec<f32>) -> Pixels {
        let bytes = |word: &u32| {
            let [a, green, b, _] = word.to_le_bytes();
            if blue_first { [b, green, a] } else { [a, green, b] }
        };
        let rgb = words[..depth.len()].iter().flat_map(bytes).collect();
        Pixels { size, depth, rgb }
    }

    /// Returns the errors against a reference of the same size.
    pub fn errors(&self, reference: &Pixels) -> Errors {
        self.errors_of(reference, &self.map(reference))
    }

    /// Returns the errors against a reference, with the map of them.
    pub fn errors_of(&self, reference: &Pixels, map: &[f64]) -> Errors {
        assert_eq!(self.size, reference.size, "pictures of one size");
        let width = self.size[0] as usize;
        let row = |y: usize| {
            (y * width..(y + 1) * width)
                .filter(|&i| self.depth[i].is_finite() || reference.depth[i].is_finite())
                .fold([0.0; 3], |[count, px, depth], i| {
                    let apart = relative(self.depth[i], reference.depth[i]);
                    [count + 1.0, px + map[i], depth + apart.min(MOST_PX * DEPTH_A_PIXEL)]
                })
        };
        let rows: Vec<[f64; 3]> = (0..self.size[1] as usize).into_par_iter().map(row).collect();
        // In the order of the rows, so that threads change nothing.
        let [count, px, depth] =
            rows.into_iter().fold([0.0; 3], |sums, row| std::array::from_fn(|k| sums[k] + row[k]));
        Errors { px: px / count.max(1.0), depth: depth / count.max(1.0) }
    }

    /// Returns the picture as a window shows it in more pixels: colours by linear filtering of
    /// their sRGB values, depths of the nearest pixel.
    pub fn enlarged(&self, size: [u32; 2]) -> Pixels {
        if size == self.size {
            return self.clone();
        }
        let [own, wide] = [self.size, size].map(|size| size.map(|side| side as usize));
        // The two nearest pixels of an axis, with the weight of the second, and the nearest one.
        let places = |axis: usize| {
            let place = |k: usize| {
                let at = (k as f64 + 0.5) * own[axis] as f64 / wide[axis] as f64;
                let (low, last) = ((at - 0.5).max(0.0), own[axis] - 1);
                let first = (low as usize).min(last);
                (first, (first + 1).min(last), low - first as f64, (at as usize).min(last))
            };
            (0..wide[axis]).map(place).collect::<Vec<_>>()
        };
        let (columns, rows) = (places(0), places(1));
        let mut larger = Pixels { size, ..Pixels::default() };
        for &(top, bottom, down, row) in &rows {
            for &(left, right, across, column) in &columns {
                larger.depth.push(self.depth[row * own[0] + column]);
                for c in 0..3 {
                    let value = |y: usize, x: usize| self.rgb[3 * (y * own[0] + x) + c] as f64;
                    let mix = |y| value(y, left) * (1.0 - across) + value(y, right) * across;
                    let mixed = mix(top) * (1.0 - down) + mix(bottom) * down;
                    larger.rgb.push(mixed.round() as u8);
                }
            }
        }
        larger
    }

    /// Returns the error of every pixel `[px]`; 0 where neither picture has a surface.
    pub fn map(&self, reference: &Pixels) -> Vec<f64> {
        let steps = steps();
        let covered = |i: usize| self.depth[i].is_finite() || reference.depth[i].is_finite();
        let error = |i| if covered(i) { self.error_px(reference, i, &steps) } else { 0.0 };
        (0..self.depth.len()).into_par_iter().map(error).collect()
    }

    /// Returns the error of a pixel `[px]`. Steps are the nearest first.
    fn error_px(&self, reference: &Pixels, i: usize, steps: &[(i32, i32, f64)]) -> f64 {
        let [width, height] = self.size.map(|side| side as i32);
        let (x, y) = (i as i32 % width, i as i32 / width);
        let mut least = MOST_PX;
        for &(dx, dy, far) in steps {
            if far >= least {
                break;
            }
            let (x, y) = (x + dx, y + dy);
            if (0..width).contains(&x) && (0..height).contains(&y) {
                let other = (y * width + x) as usize;
                least = least.min(far.max(self.differs(reference, i, other)));
            }
        }
        least
    }

    /// Returns the difference of depth and colour from another pixel of the reference `[px]`.
    fn differs(&self, reference: &Pixels, i: usize, other: usize) -> f64 {
        let depth = relative(self.depth[i], reference.depth[other]) / DEPTH_A_PIXEL;
        if depth >= MOST_PX {
            return MOST_PX;
        }
        let channel = |c: usize| self.rgb[3 * i + c].abs_diff(reference.rgb[3 * other + c]);
        let color = [0, 1, 2].map(channel).into_iter().max().unwrap_or(0) as f64 / 255.0;
        depth.max(color / COLOR_A_PIXEL)
    }
}

/// Returns the difference in parts of the reference's depth; 0 if neither is finite, infinite if
/// one is.
fn relative(depth: f32, reference: f32) -> f64 {
    match (depth.is_finite(), reference.is_finite()) {
        (true, true) => ((depth - reference) as f64 / reference as f64).abs(),
        (false, false) => 0.0,
        _ => f64::INFINITY,
    }
}

/// Returns the steps to pixels nearer than the largest error, with their lengths, nearest first.
fn steps() -> Vec<(i32, i32, f64)> {
    let most = MOST_PX as i32;
    let mut steps: Vec<(i32, i32, f64)> = (-most..=most)
        .flat_map(|dy| (-most..=most).map(move |dx| (dx, dy, f64::from(dx).hypot(f64::from(dy)))))
        .filter(|(_, _, far)| *far < MOST_PX)
        .collect();
    steps.sort_by(|a, b| a.2.total_cmp(&b.2));
    steps
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a grey wall at this depth with a black upright line at `x`.
    fn wall(depth: f32, x: usize) -> Pixels {
        let (width, height) = (32, 8);
        let rgb = (0..width * height).flat_map(|i| [if i % width == x { 0u8 } else { 153 }; 3]);
        Pixels {
            size: [width as u32, height as u32],
            depth: vec![depth; width * height],
            rgb: rgb.collect(),
        }
    }

    #[test]
    fn equal_pictures_have_no_error_and_empty_ones_neither() {
        assert_eq!(wall(5.0, 8).errors(&wall(5.0, 8)), Errors::default());
        assert_eq!(Pixels::default().errors(&Pixels::default()), Errors::default());
        let empty = Pixels { depth: vec![f32::INFINITY; 256], ..wall(5.0, 8) };
        assert_eq!(empty.errors(&empty), Errors::default());
        let errors = empty.errors(&wall(5.0, 8));
        assert!((errors.px - MOST_PX).abs() < 1e-9);
        assert!((errors.depth - MOST_PX * DEPTH_A_PIXEL).abs() < 1e-9);
    }

    #[test]
    fn a_screen_has_the_errors_of_a_file_to_the_last_bit() {
        let (own, reference) = (wall(5.01, 10), wall(5.0, 8));
        let screen = |picture: &Pixels, blue_first: bool| {
            let word = |rgb: &[u8]| {
                let [a, b] = if blue_first { [rgb[2], rgb[0]] } else { [rgb[0], rgb[2]] };
                u32::from_le_bytes([a, rgb[1], b, 255])
            };
            // A screen may have more words than the picture.
            let words: Vec<u32> = picture.rgb.chunks(3).map(word).chain([7; 3]).collect();
            Pixels::of_screen(picture.size, &words, blue_first, picture.depth.clone())
        };
        for blue_first in [false, true] {
            let errors = screen(&own, blue_first).errors(&screen(&reference, blue_first));
            let file = own.errors(&reference);
            assert_eq!(errors.px.to_bits(), file.px.to_bits());
            assert_eq!(errors.depth.to_bits(), file.depth.to_bits());
        }
    }

    #[test]
    fn a_larger_picture_has_colours_between_and_depths_of_its_pixels() {
        let small = Pixels { size: [2, 1], depth: vec![1.0, 2.0], rgb: vec![0, 0, 0, 200, 100, 0] };
        let large = small.enlarged([4, 2]);
        assert_eq!(large.depth, [1.0, 1.0, 2.0, 2.0, 1.0, 1.0, 2.0, 2.0]);
        let red: Vec<u8> = large.rgb.iter().step_by(3).copied().collect();
        assert_eq!(red, [0, 50, 150, 200, 0, 50, 150, 200]);
        assert_eq!(small.enlarged([2, 1]), small);
    }

    #[test]
    fn a_moved_line_is_off_by_its_way_and_depth_and_light_by_their_scales() {
        // What the line has left looks like its neighbours.
        let moved = wall(5.0, 10).map(&wall(5.0, 8));
        assert_eq!((moved[10], moved[8], moved[20]), (2.0, 1.0, 0.0));
        let behind = wall(5.05, 8).errors(&wall(5.0, 8));
        assert!((behind.px - 1.0).abs() < 1e-4 && (behind.depth - 0.01).abs() < 1e-6);
        let mut dark = wall(5.0, 40);
        dark.rgb.iter_mut().for_each(|channel| *channel -= 51);
        assert!((dark.errors(&wall(5.0, 40)).px - 2.0).abs() < 1e-9);
        let map = dark.map(&wall(5.0, 40));
        assert!(map.iter().all(|px| (px - 2.0).abs() < 1e-9));
    }
}
