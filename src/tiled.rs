//! A PICTURE OF ANY SIZE: view in, PNG file out, drawn in pieces where it is larger than a device's images, or than a device should be asked for at once.
//!
//! ```text
//!     whole picture -> rows of pieces -> window around each, wider by what its pixels depend on -> frame -> its middle -> rows of pixels -> file
//! ```
//! Points fall into the pixels of the whole picture, whichever part of it is drawn, and effects are decided for the whole. So where a border is as wide as effects look (`Look::reach_px`), pieces meet
//! without a seam, bit by bit (`tests/tiled.rs`). One row of pieces is in memory at a time.

use crate::cut::Fineness;
use crate::error::{Error, Result};
use crate::frame;
use crate::graph::{Gpu, Graph};
use crate::look::{self, Look, Wishes};
use crate::passes::{TILE_PX, encode, visibility};
use crate::picture;
use crate::progress::{Progress, Whole};
use crate::source::{Brought, Taken};
use crate::view::View;
use std::path::Path;

/// A picture of more pixels is drawn in pieces: a frame takes a hundred bytes a pixel and more.
const WHOLE_PIXELS: u64 = 1 << 25;

/// Of a piece, pixels: a picture takes two gigabytes with these, since buffers of the smaller windows at its edges stay on the shelf beside the others.
const PIECE: [u32; 2] = [4096, 1024];

/// Of one row of pieces.
const ROW_BYTES: u64 = 1 << 27;

/// How a picture is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pieces {
    whole: [u32; 2],
    piece: [u32; 2],
    border: u32,
}

/// A part of the picture, and the window that it is drawn in, which is wider: corners and sizes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Piece {
    pub corner: [u32; 2],
    pub size: [u32; 2],
    pub window_corner: [u32; 2],
    pub window_size: [u32; 2],
}

/// Whether a picture has to be drawn in pieces; `asked`: of at most so many pixels a side.
pub fn needs_pieces(gpu: &Gpu, size: [u32; 2], asked: Option<u32>) -> bool {
    let largest = asked.map_or(gpu.device.limits.max_image_dimension2_d - visibility::BEYOND_PX, |asked| asked.max(TILE_PX));
    let too_many = asked.is_none() && size[0] as u64 * size[1] as u64 > WHOLE_PIXELS;
    too_many || size.iter().any(|&side| side > largest)
}

/// Up to the next multiple of a tile of 8 x 8 pixels, which effects divide pictures into.
fn in_tiles(pixels: u32) -> u32 {
    pixels.next_multiple_of(TILE_PX)
}

impl Pieces {
    pub fn of(gpu: &Gpu, view: &View, look: &Look, asked: Option<u32>) -> Result<Pieces> {
        let whole = view.size;
        if !needs_pieces(gpu, whole, asked) {
            return Ok(Pieces { whole, piece: whole, border: 0 });
        }
        let reach = look.reach_px(view).ok_or_else(|| {
            let [width, height] = whole;
            Error::Request(format!(
                "{width}x{height} pixels are drawn in pieces, and fill=method=pullpush, or ao=radius= in metres with perspective, depends on more than a piece; switch it off"
            ))
        })?;
        let rows = (ROW_BYTES / (3 * whole[0] as u64)).max(1).min(PIECE[1] as u64) as u32;
        let piece = asked.map_or([PIECE[0], rows], |asked| [asked; 2]).map(|side| in_tiles(side.max(1)));
        Ok(Pieces { whole, piece, border: in_tiles(reach) })
    }

    /// From the top down, each from the left to the right.
    pub fn rows(&self) -> impl Iterator<Item = Vec<Piece>> + '_ {
        let starts = |axis: usize| (0..self.whole[axis]).step_by(self.piece[axis] as usize);
        starts(1).map(move |y| starts(0).map(|x| self.piece([x, y])).collect())
    }

    fn piece(&self, corner: [u32; 2]) -> Piece {
        let end = [0, 1].map(|axis| (corner[axis] + self.piece[axis]).min(self.whole[axis]));
        // Whole tiles, but at the picture's own edges.
        let window_corner = corner.map(|at| at.saturating_sub(self.border));
        let window_end = [0, 1].map(|axis| end[axis].saturating_add(self.border).min(self.whole[axis]));
        let size = |end: [u32; 2], corner: [u32; 2]| [0, 1].map(|axis| end[axis] - corner[axis]);
        Piece { corner, size: size(end, corner), window_corner, window_size: size(window_end, window_corner) }
    }
}

/// What a picture is of, and how fine.
pub struct Wanted<'w> {
    pub view: &'w View,
    pub wishes: &'w Wishes,
    pub fineness: Fineness,
    /// Pieces of at most so many pixels a side.
    pub piece: Option<u32>,
}

/// Draws a picture into a file. What could not be read is said in the end.
pub fn write(gpu: &mut Gpu, cloud: &mut Brought, wanted: &Wanted, path: &Path, progress: &dyn Progress) -> Result<Vec<String>> {
    let Wanted { view, wishes, fineness, piece } = *wanted;
    // Of a picture in pieces effects are decided by as much of the cloud as shows it whole on a screen.
    let overview = if needs_pieces(gpu, view.size, piece) { PIECE } else { view.size };
    let mut notes = Vec::new();
    let mut note = |said: Vec<String>| {
        let new = said.into_iter().filter(|note| !notes.contains(note)).collect::<Vec<_>>();
        notes.extend(new);
    };
    let of = |taken: Option<Taken>| taken.map_or(Vec::new(), |taken| taken.notes);
    note(of(cloud.settle(gpu, view, &fineness.of(overview), progress)?));
    let look = look::decide(wishes, view, cloud.resident());
    note(look.notes(cloud.resident()));
    let pieces = Pieces::of(gpu, view, &look, piece)?;
    let total = pieces.rows().map(|row| row.len() as u64).sum();
    let mut done = 0;
    picture::write_png_rows(path, view.size, |write| {
        for row in pieces.rows() {
            let height = row.first().map_or(0, |piece| piece.size[1]) as usize;
            let mut pixels = vec![0u8; 3 * view.size[0] as usize * height];
            for piece in row {
                let progress = Whole { progress, doing: "drawing pieces", done, total };
                let window = view.window(piece.window_corner.map(|at| at as i32), piece.window_size);
                if total > 1 {
                    note(of(cloud.settle(gpu, &window, &fineness.of(window.size), &progress)?));
                }
                draw(gpu, cloud, &window, &look, &progress, |bytes| cut_out(bytes, &piece, view.size[0] as usize, &mut pixels))?;
                done += 1;
            }
            write(&pixels)?;
        }
        Ok(())
    })?;
    Ok(notes)
}

/// A frame, and its bytes to whoever takes them.
fn draw(gpu: &mut Gpu, cloud: &Brought, view: &View, look: &Look, progress: &dyn Progress, take: impl FnOnce(&[&[u8]])) -> Result<()> {
    let mut g = Graph::new(gpu).watched(progress);
    let outcome = match frame::record(&mut g, view, cloud.resident(), look) {
        Ok(outcome) => outcome,
        Err(error) => {
            g.abandon();
            return Err(error);
        }
    };
    let encoded = encode::download(&mut g, &outcome.picture)?;
    let frame = g.submit(&[])?;
    take(&encoded.read(&frame));
    frame.shelve(gpu);
    Ok(())
}

/// The middle of a window's bytes, to its place in a row of pieces of this width, pixels.
fn cut_out(bytes: &[&[u8]], piece: &Piece, width: usize, pixels: &mut [u8]) {
    let rows = bytes.iter().flat_map(|band| band.chunks_exact(3 * piece.window_size[0] as usize));
    let [left, top] = [0, 1].map(|axis| (piece.corner[axis] - piece.window_corner[axis]) as usize);
    let [across, down] = piece.size.map(|side| side as usize);
    for (y, row) in rows.skip(top).take(down).enumerate() {
        let at = 3 * (y * width + piece.corner[0] as usize);
        pixels[at..at + 3 * across].copy_from_slice(&row[3 * left..3 * (left + across)]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_cover_every_pixel_once_and_have_whole_tiles_around_them() {
        for (whole, piece, border) in [([1000, 77], [64, 32], 24), ([40, 40], [64, 64], 8), ([4097, 9], [8, 8], 0)] {
            let pieces = Pieces { whole, piece, border };
            let mut covered = vec![0u8; (whole[0] * whole[1]) as usize];
            for piece in pieces.rows().flatten() {
                for (axis, whole) in whole.into_iter().enumerate() {
                    let (end, window_end) = (piece.corner[axis] + piece.size[axis], piece.window_corner[axis] + piece.window_size[axis]);
                    assert!(piece.window_corner[axis] % TILE_PX == 0 && (window_end % TILE_PX == 0 || window_end == whole));
                    assert!(piece.corner[axis] - piece.window_corner[axis] == border.min(piece.corner[axis]));
                    assert!(window_end - end == border.min(whole - end));
                }
                for y in piece.corner[1]..piece.corner[1] + piece.size[1] {
                    (piece.corner[0]..piece.corner[0] + piece.size[0]).for_each(|x| covered[(y * whole[0] + x) as usize] += 1);
                }
            }
            assert!(covered.iter().all(|&count| count == 1));
        }
    }
}
