//! Pictures of any size, drawn in pieces if larger than a device's images or its safe load.
//!
//! ```text
//!     whole picture -> rows of pieces -> window around each, wider by what its pixels depend on
//!                   -> frame -> its middle -> rows of pixels -> file
//! ```
//! Points fall into the pixels of the whole picture, whichever part is drawn, and effects are
//! decided for the whole. If the border is as wide as effects look (`FrameConfig::reach_px`),
//! pieces therefore meet without a seam, bit by bit (`tests/program/tiled.rs`). One row of pieces
//! is in memory at a time.
//!
//! A window draws pieces one at a time, between its other work ([`TiledPicture`]).

use crate::atomic_file::{AtomicFile, finish_together};
use crate::config::WHOLE_PIXELS;
use crate::error::{Error, Result};
use crate::graph::{Gpu, Pause};
use crate::output::image_io::PngRows;
use crate::output::overlay::Overlay;
use crate::passes::encode::{self, Channels};
use crate::passes::{LEAST_BLOCK_PX, visibility};
use crate::progress::{Progress, Whole};
use crate::render::gpu_cloud::SelectionReport;
use crate::render::settings::FrameConfig;
use crate::renderer::{CloudId, Renderer};
use crate::select::lod::LodOptions;
use crate::view::View;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Size of a piece `[px]`. A picture takes two gigabytes with it, since buffers of the smaller
/// windows at the edges stay in the pool beside the others.
pub const PIECE: [u32; 2] = [4096, 1024];

/// Most bytes of one row of pieces.
const ROW_BYTES: u64 = 1 << 27;

/// The division of a picture, or of some of its rows, into pieces.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pieces {
    whole: [u32; 2],
    drawn: Range<u32>,
    piece: [u32; 2],
    border: u32,
}

/// A part of the picture, and the wider window that is drawn for it: corners and sizes `[px]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Piece {
    pub corner: [u32; 2],
    pub size: [u32; 2],
    pub window_corner: [u32; 2],
    pub window_size: [u32; 2],
}

/// Tests whether a picture must be drawn in pieces. `asked` is the most pixels per side of a piece.
pub fn needs_pieces(gpu: &Gpu, size: [u32; 2], asked: Option<u32>) -> bool {
    let largest = asked
        .map_or(gpu.device.limits.max_image_dimension2_d - visibility::BEYOND_PX, |asked| {
            asked.max(LEAST_BLOCK_PX)
        });
    let too_many = asked.is_none() && size[0] as u64 * size[1] as u64 > WHOLE_PIXELS;
    too_many || size.iter().any(|&side| side > largest)
}

impl Pieces {
    /// Divides these rows of a picture.
    pub fn of(
        gpu: &Gpu,
        view: &View,
        config: &FrameConfig,
        asked: Option<u32>,
        drawn: Range<u32>,
    ) -> Result<Pieces> {
        let whole = view.size;
        if !needs_pieces(gpu, whole, asked) && drawn == (0..whole[1]) {
            return Ok(Pieces { whole, drawn, piece: whole, border: 0 });
        }
        let reach = config.reach_px(view).ok_or_else(|| {
            let [width, height] = whole;
            Error::Request(format!(
                "cannot draw {width}x{height} pixels with ao=radius= in metres and perspective: it reaches beyond a piece; use ao=off or pixels"
            ))
        })?;
        // A power of two, which divides the rows of parts.
        let rows = (ROW_BYTES / (3 * whole[0] as u64)).clamp(1, PIECE[1] as u64);
        let rows = 1 << rows.ilog2();
        let block = config.block_px();
        let piece = asked
            .map_or([PIECE[0], rows], |asked| [asked; 2])
            .map(|side| side.max(1).next_multiple_of(block));
        Ok(Pieces { whole, drawn, piece, border: reach.next_multiple_of(block) })
    }

    /// Returns the rows of pieces from the top down, each from left to right.
    pub fn rows(&self) -> impl Iterator<Item = Vec<Piece>> + '_ {
        let [across, down] = self.piece.map(|side| side as usize);
        let row = move |y| (0..self.whole[0]).step_by(across).map(|x| self.piece([x, y])).collect();
        self.drawn.clone().step_by(down).map(row)
    }

    fn piece(&self, corner: [u32; 2]) -> Piece {
        let ends = [self.whole[0], self.drawn.end];
        let end = [0, 1].map(|axis| (corner[axis] + self.piece[axis]).min(ends[axis]));
        Piece::around(corner, end, self.border, self.whole)
    }
}

impl Piece {
    /// Returns a piece with its border clipped to the picture.
    pub fn around(corner: [u32; 2], end: [u32; 2], border: u32, whole: [u32; 2]) -> Piece {
        // Whole blocks, except at the picture's own edges.
        let window_corner = corner.map(|at| at.saturating_sub(border));
        let window_end = [0, 1].map(|axis| end[axis].saturating_add(border).min(whole[axis]));
        let size = |end: [u32; 2], corner: [u32; 2]| [0, 1].map(|axis| end[axis] - corner[axis]);
        Piece {
            corner,
            size: size(end, corner),
            window_corner,
            window_size: size(window_end, window_corner),
        }
    }
}

/// A picture to draw.
#[derive(Clone)]
pub struct PictureRequest {
    pub view: View,
    pub lod: LodOptions,
    /// Rows that are drawn: all, or those of a part.
    pub rows: Range<u32>,
    /// Most pixels per side of a piece.
    pub piece: Option<u32>,
    /// Drawn over the picture.
    pub over: Overlay,
    /// What its pixels have; with alpha, for a black background.
    pub channels: Channels,
}

/// A picture being written to a PNG file, which exists after [`TiledPicture::finish`]. Dropped
/// before, it leaves no file.
pub struct TiledPicture {
    drawing: Drawing,
    path: PathBuf,
    rows: PngRows,
}

/// A picture being drawn.
struct Drawing {
    request: PictureRequest,
    plan: Option<Plan>,
    /// The pixels of one row of pieces.
    pixels: Vec<u8>,
    /// Warnings: unreadable parts, and settings without effect.
    notes: Vec<String>,
}

/// The configuration and the pieces to draw.
struct Plan {
    config: FrameConfig,
    pieces: Vec<Piece>,
    done: usize,
}

impl TiledPicture {
    /// Creates the file; draws nothing yet.
    pub fn begin(request: PictureRequest, path: &Path) -> Result<TiledPicture> {
        let PictureRequest { view, rows, over, channels, .. } = &request;
        let rows = PngRows::create(path, view.size[0], rows.clone(), over.clone(), *channels)?;
        Ok(TiledPicture { drawing: Drawing::new(request), path: path.to_owned(), rows })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the number of drawn pieces and of all pieces; `None` before the first.
    pub fn so_far(&self) -> Option<(usize, usize)> {
        self.drawing.plan.as_ref().map(|plan| (plan.done, plan.pieces.len()))
    }

    /// Draws one more piece. Returns whether it was the last. If `progress` or `pause` cancels it,
    /// the call has no effect.
    pub fn step(
        &mut self,
        renderer: &mut Renderer,
        cloud: CloudId,
        progress: &dyn Progress,
        pause: Option<&mut Pause>,
    ) -> Result<bool> {
        self.drawing.step(renderer, cloud, progress, pause, &mut |pixels| self.rows.write(pixels))
    }

    /// Completes the file and returns the warnings.
    pub fn finish(self) -> Result<Vec<String>> {
        self.rows.complete()?.finish()?;
        Ok(self.drawing.notes)
    }
}

/// Takes whole rows of pixels, from the top down.
type Put<'p> = dyn FnMut(&[u8]) -> Result<()> + 'p;

impl Drawing {
    fn new(request: PictureRequest) -> Drawing {
        Drawing { request, plan: None, pixels: Vec::new(), notes: Vec::new() }
    }

    fn step(
        &mut self,
        renderer: &mut Renderer,
        cloud: CloudId,
        progress: &dyn Progress,
        pause: Option<&mut Pause>,
        put: &mut Put,
    ) -> Result<bool> {
        let mut plan = match self.plan.take() {
            Some(plan) => plan,
            None => self.plan(renderer, cloud, progress)?,
        };
        let drawn = self.draw_next(&mut plan, renderer, cloud, progress, pause, put);
        let is_whole = plan.done == plan.pieces.len();
        self.plan = Some(plan);
        drawn.map(|()| is_whole)
    }

    fn plan(
        &mut self,
        renderer: &mut Renderer,
        cloud: CloudId,
        progress: &dyn Progress,
    ) -> Result<Plan> {
        let PictureRequest { view, lod, piece, rows, .. } = self.request.clone();
        // For a picture in pieces, effects are decided by as much of the cloud as shows the whole
        // picture on a screen.
        let overview =
            if needs_pieces(&renderer.gpu, view.size, piece) { PIECE } else { view.size };
        let taken = renderer.load(cloud, &view, &lod.of(overview), progress)?;
        self.note(notes_of(taken));
        let config = renderer.config(cloud, &view)?;
        self.note(config.warnings(renderer.cloud(cloud)?.1.resident()));
        let pieces = Pieces::of(&renderer.gpu, &view, &config, piece, rows)?;
        Ok(Plan { config, pieces: pieces.rows().flatten().collect(), done: 0 })
    }

    fn draw_next(
        &mut self,
        plan: &mut Plan,
        renderer: &mut Renderer,
        cloud: CloudId,
        progress: &dyn Progress,
        pause: Option<&mut Pause>,
        put: &mut Put,
    ) -> Result<()> {
        let part = plan.pieces[plan.done];
        let PictureRequest { view, lod, channels, .. } = &self.request;
        let (done, total, width) =
            (plan.done as u64, plan.pieces.len() as u64, view.size[0] as usize);
        let whole = Whole { progress, doing: "drawing pieces", done, total };
        let window = view.window(part.window_corner.map(|at| at as i32), part.window_size);
        let taken = renderer.load(
            cloud,
            &window,
            &lod.of(window.size),
            if total > 1 { &whole } else { progress },
        )?;
        self.pixels.resize(channels.bytes() * width * part.size[1] as usize, 0);
        let done =
            renderer.draw_pausing(cloud, &window, &plan.config, &whole, pause, |g, outcome| {
                encode::encoded(g, &outcome.picture, *channels)
            })?;
        let strips = done.asked.read(&done.frame);
        cut_out(&strips, channels.bytes(), &part, width, &mut self.pixels);
        self.note(notes_of(taken));
        self.note(done.notes);
        if part.corner[0] as usize + part.size[0] as usize == width {
            put(&self.pixels)?;
            self.pixels.clear();
        }
        plan.done += 1;
        Ok(())
    }

    fn note(&mut self, said: Vec<String>) {
        for note in said {
            if !self.notes.contains(&note) {
                self.notes.push(note);
            }
        }
    }
}

fn notes_of(taken: Option<SelectionReport>) -> Vec<String> {
    taken.map_or(Vec::new(), |taken| taken.notes)
}

/// Draws a picture, 8 bits a channel, and gives its rows to `put`. Returns warnings.
pub fn draw(
    renderer: &mut Renderer,
    cloud: CloudId,
    request: PictureRequest,
    progress: &dyn Progress,
    put: &mut Put,
) -> Result<Vec<String>> {
    let (over, width) = (request.over.clone(), request.view.size[0] as usize);
    let channels = request.channels;
    let (mut blended, mut rows) = (Vec::new(), request.rows.start as usize);
    let mut drawing = Drawing::new(request);
    let mut put = |pixels: &[u8]| {
        blended.clear();
        blended.extend_from_slice(pixels);
        over.blend(&mut blended, channels, width, rows);
        rows += pixels.len() / (channels.bytes() * width);
        put(&blended)
    };
    while !drawing.step(renderer, cloud, progress, None, &mut put)? {}
    Ok(drawing.notes)
}

/// Draws a picture into a PNG file. Returns warnings.
pub fn write(
    renderer: &mut Renderer,
    cloud: CloudId,
    request: PictureRequest,
    path: &Path,
    progress: &dyn Progress,
) -> Result<Vec<String>> {
    let mut picture = TiledPicture::begin(request, path)?;
    while !picture.step(renderer, cloud, progress, None)? {}
    picture.finish()
}

/// Draws a map into a PNG file, which gets its name together with its world file. Returns warnings.
pub fn write_map(
    renderer: &mut Renderer,
    cloud: CloudId,
    request: PictureRequest,
    path: &Path,
    world: AtomicFile,
    progress: &dyn Progress,
) -> Result<Vec<String>> {
    let mut picture = TiledPicture::begin(request, path)?;
    while !picture.step(renderer, cloud, progress, None)? {}
    finish_together([world, picture.rows.complete()?])?;
    Ok(picture.drawing.notes)
}

/// Copies the middle of a window to its place in `pixels`, a row of pieces that is `width` pixels
/// wide; pixels have this many bytes.
fn cut_out(bytes: &[&[u8]], pixel_bytes: usize, part: &Piece, width: usize, pixels: &mut [u8]) {
    let row_bytes = pixel_bytes * part.window_size[0] as usize;
    let rows = bytes.iter().flat_map(|strip| strip.chunks_exact(row_bytes));
    let [left, top] = [0, 1].map(|axis| (part.corner[axis] - part.window_corner[axis]) as usize);
    let [across, down] = part.size.map(|side| side as usize);
    for (y, row) in rows.skip(top).take(down).enumerate() {
        let at = pixel_bytes * (y * width + part.corner[0] as usize);
        pixels[at..at + pixel_bytes * across]
            .copy_from_slice(&row[pixel_bytes * left..pixel_bytes * (left + across)]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_cover_every_pixel_once_and_have_whole_blocks_around_them() {
        for (whole, piece, border) in [
            ([1000, 177], [256, 128], 384),
            ([40, 40], [128, 128], 128),
            ([4097, 9], [128, 128], 0),
        ] {
            let pieces = Pieces { whole, drawn: 0..whole[1], piece, border };
            let mut covered = vec![0u8; (whole[0] * whole[1]) as usize];
            for piece in pieces.rows().flatten() {
                for (axis, whole) in whole.into_iter().enumerate() {
                    let (end, window_end) = (
                        piece.corner[axis] + piece.size[axis],
                        piece.window_corner[axis] + piece.window_size[axis],
                    );
                    assert!(
                        piece.window_corner[axis] % LEAST_BLOCK_PX == 0
                            && (window_end % LEAST_BLOCK_PX == 0 || window_end == whole)
                    );
                    assert!(
                        piece.corner[axis] - piece.window_corner[axis]
                            == border.min(piece.corner[axis])
                    );
                    assert!(window_end - end == border.min(whole - end));
                }
                for y in piece.corner[1]..piece.corner[1] + piece.size[1] {
                    (piece.corner[0]..piece.corner[0] + piece.size[0])
                        .for_each(|x| covered[(y * whole[0] + x) as usize] += 1);
                }
            }
            assert!(covered.iter().all(|&count| count == 1));
        }
    }
}
