//! Triangles over a picture, blended row by row as its file is written: in pictures in pieces, too.

use crate::passes::encode::Channels;

/// A corner of a triangle.
#[derive(Clone, Copy, Debug)]
pub struct Corner {
    /// Place in the picture `[px]`.
    pub at: [f32; 2],
    /// Place in the texture, 0..=1.
    pub uv: [f32; 2],
    /// sRGB times alpha, and alpha, 0..=1.
    pub color: [f32; 4],
}

/// Triangles in the order in which they are drawn, and their texture.
#[derive(Clone, Debug, Default)]
pub struct Overlay {
    pub triangles: Vec<[Corner; 3]>,
    /// Width and height of the texture, and its texels: sRGB times alpha, and alpha.
    pub texture_size: [usize; 2],
    pub texture: Vec<[u8; 4]>,
}

impl Overlay {
    /// Blends the triangles with the rows from `top` on of a picture of this width.
    pub fn blend(&self, pixels: &mut [u8], channels: Channels, width: usize, top: usize) {
        let pixel_bytes = channels.bytes();
        let bottom = top + pixels.len() / (pixel_bytes * width);
        for corners in &self.triangles {
            let [a, b, c] = corners.map(|corner| corner.at);
            let area = cross(a, b, c);
            if area == 0.0 || !area.is_finite() {
                continue;
            }
            // Counterclockwise, so that of two triangles with a common edge one has its pixels.
            let [a, b, c] =
                if area > 0.0 { *corners } else { [corners[0], corners[2], corners[1]] };
            let range = |axis: usize, from: usize, to: usize| {
                let [least, most] =
                    [f32::min, f32::max].map(|pick| pick(pick(a.at[axis], b.at[axis]), c.at[axis]));
                (least.floor().max(from as f32) as usize)
                    ..(most.ceil().min(to as f32).max(0.0) as usize)
            };
            for y in range(1, top, bottom) {
                for x in range(0, 0, width) {
                    let at = [x as f32 + 0.5, y as f32 + 0.5];
                    let edges =
                        [(b, c), (c, a), (a, b)].map(|(from, to)| inside(from.at, to.at, at));
                    let [Some(a_share), Some(b_share), Some(c_share)] = edges else { continue };
                    let mix = |a: f32, b: f32, c: f32| {
                        (a * a_share + b * b_share + c * c_share) / area.abs()
                    };
                    let uv = [0, 1].map(|axis| mix(a.uv[axis], b.uv[axis], c.uv[axis]));
                    let texel = self.texel(uv);
                    let source: [f32; 4] = std::array::from_fn(|channel| {
                        mix(a.color[channel], b.color[channel], c.color[channel]) * texel[channel]
                    });
                    let start = pixel_bytes * ((y - top) * width + x);
                    blend_pixel(&mut pixels[start..start + pixel_bytes], source);
                }
            }
        }
    }

    /// Returns the texture's value, interpolated, 0..=1; 1 without a texture.
    fn texel(&self, uv: [f32; 2]) -> [f32; 4] {
        let [width, height] = self.texture_size;
        if self.texture.is_empty() {
            return [1.0; 4];
        }
        let place = |axis: usize, size: usize| {
            let at = (uv[axis] * size as f32 - 0.5).clamp(0.0, (size - 1) as f32);
            (at as usize, (at as usize + 1).min(size - 1), at.fract())
        };
        let ((x0, x1, right), (y0, y1, down)) = (place(0, width), place(1, height));
        let texel = |x: usize, y: usize| self.texture[y * width + x].map(|v| v as f32 / 255.0);
        let [a, b, c, d] = [texel(x0, y0), texel(x1, y0), texel(x0, y1), texel(x1, y1)];
        std::array::from_fn(|k| {
            let (above, below) = (a[k] + (b[k] - a[k]) * right, c[k] + (d[k] - c[k]) * right);
            above + (below - above) * down
        })
    }
}

/// Blends a colour times alpha, and alpha, with a pixel, whose colour is not multiplied by its
/// alpha.
fn blend_pixel(pixel: &mut [u8], source: [f32; 4]) {
    let (color, alpha) = pixel.split_at_mut(3);
    let under = alpha.first().map_or(1.0, |alpha| *alpha as f32 / 255.0) * (1.0 - source[3]);
    let whole = source[3] + under;
    for (value, own) in color.iter_mut().zip(source).filter(|_| whole > 0.0) {
        *value = ((255.0 * own + *value as f32 * under) / whole).round() as u8;
    }
    alpha.iter_mut().for_each(|alpha| *alpha = (255.0 * whole).round() as u8);
}

/// Returns twice the area of a triangle, positive if it is counterclockwise with y upwards.
fn cross(a: [f32; 2], b: [f32; 2], c: [f32; 2]) -> f32 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Returns on which side of an edge a pixel is, as an area; `None` if it is outside. A pixel on the
/// edge belongs to one direction of it only.
fn inside(from: [f32; 2], to: [f32; 2], at: [f32; 2]) -> Option<f32> {
    // The same number for both directions, apart from its sign.
    let is_forward = (from[0], from[1]) < (to[0], to[1]);
    let side = if is_forward { cross(from, to, at) } else { -cross(to, from, at) };
    (side > 0.0 || side == 0.0 && is_forward).then_some(side)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner(x: f32, y: f32, alpha: f32) -> Corner {
        Corner { at: [x, y], uv: [0.0; 2], color: [alpha, 0.0, 0.0, alpha] }
    }

    /// A square of two triangles of different orientation.
    fn square(from: f32, to: f32) -> Overlay {
        let [a, b, c, d] =
            [(from, from), (to, from), (from, to), (to, to)].map(|(x, y)| corner(x, y, 0.5));
        Overlay { triangles: vec![[a, b, d], [a, c, d]], ..Overlay::default() }
    }

    #[test]
    fn two_triangles_of_a_square_cover_each_of_its_pixels_once() {
        let mut pixels = vec![100u8; 3 * 64];
        square(1.5, 6.5).blend(&mut pixels, Channels::Rgb, 8, 0);
        let red = |x: usize, y: usize| pixels[3 * (8 * y + x)];
        let inside = (0..64).filter(|i| red(i % 8, i / 8) != 100);
        assert_eq!(inside.clone().count(), 25);
        assert!(inside.into_iter().all(|i| red(i % 8, i / 8) == 178));
        assert_eq!(pixels[3 * (8 * 3 + 3) + 1], 50);
    }

    #[test]
    fn what_is_drawn_over_transparent_pixels_is_as_opaque_as_it_is() {
        let mut pixels = vec![0u8; 4 * 64];
        square(1.5, 6.5).blend(&mut pixels, Channels::Rgba, 8, 0);
        let pixel = |x: usize, y: usize| &pixels[4 * (8 * y + x)..][..4];
        assert_eq!((pixel(3, 3), pixel(0, 0)), (&[255, 0, 0, 128][..], &[0; 4][..]));
        let mut opaque = [0, 0, 200, 255];
        blend_pixel(&mut opaque, [0.5, 0.0, 0.0, 0.5]);
        assert_eq!(opaque, [128, 0, 100, 255]);
    }

    #[test]
    fn rows_blended_apart_are_those_blended_together() {
        let overlay = square(-3.0, 7.3);
        let mut whole = vec![9u8; 3 * 100];
        let mut parts = whole.clone();
        overlay.blend(&mut whole, Channels::Rgb, 10, 0);
        for (k, rows) in parts.chunks_mut(3 * 30).enumerate() {
            overlay.blend(rows, Channels::Rgb, 10, 3 * k);
        }
        assert_eq!(whole, parts);
    }
}
