//! Picks that the last picture cannot answer: it was coarse, as pictures are while something moves
//! or arrives, or shows another view by now.
//!
//! The pixels around the click are drawn at full density, from the camera of the click, with the
//! border that their effects need. For an index the few nodes along the ray are loaded, a little
//! between any two frames.

use super::{RenderEvent, RenderLoop};
use crate::app::cancel::CancelToken;
use crate::app::pick_buffer::{MISS_PX, PickBuffer};
use crate::error::{Error, Result};
use crate::output::tiled::Piece;
use crate::progress::{Progress, Silent};
use crate::resident::Point;
use crate::view::View;
use glam::DVec2;
use std::time::{Duration, Instant};

/// A click.
#[derive(Clone, Debug)]
pub struct PickRequest {
    /// The window as it was seen, in its full size.
    pub view: View,
    /// Place of the cursor `[px]`.
    pub at: DVec2,
    /// Id of the point there, in a last picture that has all points.
    pub id: Option<u32>,
    /// True if the point joins the picked ones.
    pub adds: bool,
    /// Cancelled once the user forgets the picked points.
    pub token: CancelToken,
}

/// Longest time that a pick takes between two frames.
const SLICE: Duration = Duration::from_millis(50);

/// Interrupts a pick that waits for nodes.
struct Until(Instant);

impl Progress for Until {
    fn tick(&self, _doing: &str, _done: u64, _total: u64) -> Result<()> {
        if Instant::now() > self.0 { Err(Error::Interrupted) } else { Ok(()) }
    }
}

/// Returns the part of a picture around a pixel within which points are picked.
fn piece(at: DVec2, whole: [u32; 2], block: u32, border: Option<u32>) -> Piece {
    let edge = |axis: usize, by: f64| (at[axis] + by).clamp(0.0, whole[axis].into()) as u32;
    let miss = MISS_PX as f64;
    let corner = [0, 1].map(|axis| edge(axis, -miss) / block * block);
    let end = [0, 1].map(|axis| (edge(axis, miss + 1.0)).next_multiple_of(block).min(whole[axis]));
    Piece::around(
        corner,
        end,
        border.map_or(u32::MAX / block * block, |border| border.next_multiple_of(block)),
        whole,
    )
}

impl RenderLoop {
    /// Answers a click, or keeps it for later.
    pub(super) fn pick(&mut self, pick: PickRequest) -> Result<()> {
        if let Some(id) = pick.id {
            self.restore_scene()?;
            let Some(cloud) = self.cloud else { return Ok(()) };
            let (gpu, cloud) = self.renderer.cloud(cloud)?;
            let resident = cloud.resident();
            // Ids are void if nodes have arrived since the last picture. What no node has is looked
            // for again, too.
            if resident.identity() == self.last_drawn
                && let Some(point) = resident.point(gpu, id)?
            {
                self.answer(Some(point), &pick);
                return Ok(());
            }
        }
        self.picks.push_back(pick);
        Ok(())
    }

    /// Draws the surroundings of the first click that is kept, and answers it.
    pub(super) fn pick_step(&mut self) -> Result<()> {
        let Some(pick) = self.picks.front().cloned() else { return Ok(()) };
        match self.point_at(&pick) {
            // It goes on after the next frame.
            Err(Error::Interrupted) => return Ok(()),
            Err(error @ Error::Request(_)) => (self.report)(RenderEvent::Failed(error)),
            Err(error) => return Err(error),
            Ok(point) => self.answer(point, &pick),
        }
        self.picks.pop_front();
        Ok(())
    }

    fn answer(&self, point: Option<Point>, pick: &PickRequest) {
        (self.report)(match point {
            Some(point) => {
                RenderEvent::Picked { point, adds: pick.adds, token: pick.token.clone() }
            }
            None => RenderEvent::NothingPicked { adds: pick.adds },
        });
    }

    fn point_at(&mut self, pick: &PickRequest) -> Result<Option<Point>> {
        let (Some(scene), Some(id)) = (&self.scene, self.cloud) else { return Ok(None) };
        self.renderer.set_scene(scene);
        self.saves.scene_replaced = true;
        let config = self.renderer.config(id, &pick.view)?.progressive();
        let border = config.reach_px(&pick.view);
        let piece = piece(pick.at, pick.view.size, config.block_px(), border);
        let corner = piece.window_corner.map(|at| at as i32);
        let view = pick.view.window(corner, piece.window_size);
        let until = Until(Instant::now() + SLICE);
        self.renderer.load(id, &view, &scene.lod.of(view.size), &until)?;
        let drawn = self.renderer.draw(id, &view, &config, &Silent, |g, outcome| {
            Ok([&outcome.gbuffer.depth, &outcome.gbuffer.index].map(|layer| g.download(layer)))
        })?;
        let [depth, index] = &drawn.asked;
        let buffer = PickBuffer {
            view,
            depth: drawn.frame.read(depth).to_vec(),
            index: drawn.frame.read(index).to_vec(),
            is_exact: true,
        };
        let at = pick.at - DVec2::from_array(corner.map(f64::from));
        let Some(point) = buffer.point(at, view.size) else { return Ok(None) };
        let (gpu, cloud) = self.renderer.cloud(id)?;
        cloud.resident().point(gpu, point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_piece_has_all_pixels_that_a_click_may_mean() {
        let whole = [1000, 700];
        for (at, block) in [([0.0, 0.0], 64), ([999.5, 699.0], 64), ([640.2, 63.9], 128)] {
            let piece = piece(at.into(), whole, block, Some(40));
            for axis in 0..2 {
                let miss = MISS_PX as f64;
                let least = (at[axis] - miss).max(0.0) as u32;
                let most = ((at[axis] + miss) as u32).min(whole[axis] - 1);
                let end = piece.corner[axis] + piece.size[axis];
                assert!(piece.corner[axis] <= least && end > most, "{at:?}: {piece:?}");
                assert!(piece.window_corner[axis].is_multiple_of(block), "{at:?}: {piece:?}");
            }
        }
        // Effects that look at the whole picture.
        let all = piece([500.0, 300.0].into(), whole, 64, None);
        assert_eq!((all.window_corner, all.window_size), ([0, 0], whole));
    }
}
