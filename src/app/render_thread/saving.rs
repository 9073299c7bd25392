//! Saving of pictures while the window goes on: piece by piece, when there is nothing to draw.
//!
//! A request keeps the view, settings and filters of its time; its file has the bytes that `render`
//! writes. Messages are handled between pieces. On a software device, where a piece takes long, the
//! panel is shown meanwhile, and a change of the picture interrupts it. Files that are dropped
//! meanwhile load at once; the cloud that is being saved stays resident until its pictures are
//! written. A picture no larger than the window is saved at once, unless nodes are arriving.
//! Pictures that are unfinished when the window closes are reported and not written.

use super::draw_frame::{PANEL_EVERY, Superseded};
use super::{Redraw, RenderEvent, RenderLoop};
use crate::app::warn;
use crate::error::{Error, Result};
use crate::graph::{Gpu, Pause};
use crate::output::export;
use crate::output::overlay::Overlay;
use crate::output::tiled::{self, TiledPicture};
use crate::passes::encode::Channels;
use crate::progress::{Progress, Silent};
use crate::render::gpu_cloud::GpuCloud;
use crate::render::scene::Scene;
use crate::renderer::CloudId;
use crate::view::View;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Pictures to save, in order.
#[derive(Default)]
pub(super) struct SaveQueue {
    pub queue: VecDeque<PendingSave>,
    /// True if the renderer has the scene of a saved picture.
    pub scene_replaced: bool,
}

impl SaveQueue {
    /// Tests whether pictures of other clouds than the window's are to be saved.
    pub fn of_other_clouds(&self, own: Option<CloudId>) -> bool {
        self.queue.iter().any(|save| Some(save.cloud) != own)
    }
}

/// A picture to save, with cloud and scene of its time.
pub(super) struct PendingSave {
    target: SaveTarget,
    cloud: CloudId,
    scene: Scene,
}

/// A file to save, and where.
enum SaveTarget {
    Picture(Box<TiledPicture>),
    /// Layers, which are written in one step.
    Layers(Box<tiled::PictureRequest>, PathBuf),
}

impl PendingSave {
    fn path(&self) -> &Path {
        match &self.target {
            SaveTarget::Picture(picture) => picture.path(),
            SaveTarget::Layers(_, path) => path,
        }
    }
}

impl RenderLoop {
    /// Queues a picture, or saves it at once if that is quick.
    pub(super) fn save(
        &mut self,
        path: PathBuf,
        size: [u32; 2],
        layers: bool,
        over: Overlay,
    ) -> Result<()> {
        let (Some(scene), Some(cloud)) = (&self.scene, self.cloud) else {
            (self.report)(RenderEvent::SaveFailed(
                path,
                Error::Request(
                    "there is nothing to save yet; wait until the window shows a cloud".into(),
                ),
            ));
            return Ok(());
        };
        let wanted = tiled::PictureRequest {
            view: View::new(scene.camera, size)?,
            lod: scene.lod,
            rows: 0..size[1],
            piece: None,
            over,
            channels: Channels::Rgb,
        };
        // If the window shows everything, there is nothing to wait for.
        let is_there = self.schedule.redraw == Redraw::Nothing
            || matches!(self.renderer.cloud(cloud)?.1, GpuCloud::Whole(_));
        let at_once = is_there
            && self.saves.queue.is_empty()
            && size.map(u64::from).iter().product::<u64>() <= self.pixels();
        let target = match layers {
            true => Ok(SaveTarget::Layers(Box::new(wanted), path.clone())),
            false => TiledPicture::begin(wanted, &path)
                .map(|picture| SaveTarget::Picture(Box::new(picture))),
        };
        match target {
            Ok(target) => {
                self.saves.queue.push_back(PendingSave { target, cloud, scene: scene.clone() });
            }
            Err(error) => (self.report)(RenderEvent::SaveFailed(path, error)),
        }
        while at_once && !self.saves.queue.is_empty() {
            self.continue_save(false)?;
        }
        Ok(())
    }

    /// Returns the number of pixels of the window.
    fn pixels(&self) -> u64 {
        self.present.as_ref().map_or(0, |present| present.size().map(u64::from).iter().product())
    }

    /// Saves one more piece, if there is a picture to save.
    pub(super) fn save_step(&mut self) -> Result<()> {
        if self.saves.queue.is_empty() { Ok(()) } else { self.continue_save(true) }
    }

    /// Saves one more piece of the first picture; a newer message interrupts it if `interruptible`.
    fn continue_save(&mut self, interruptible: bool) -> Result<()> {
        let Some(saving) = self.saves.queue.front_mut() else { return Ok(()) };
        let (renderer, cloud) = (&mut self.renderer, saving.cloud);
        renderer.set_scene(&saving.scene);
        self.saves.scene_replaced = true;
        let (inbox, schedule, present) = (&mut self.inbox, &mut self.schedule, &mut self.present);
        let posted = inbox.posted.clone();
        let newer = Superseded { posted: &posted, handled: inbox.handled };
        let progress = if interruptible { &newer as &dyn Progress } else { &Silent };
        let mut shown = Instant::now();
        let mut pause = |gpu: &mut Gpu| {
            if let (true, Some(present)) = (shown.elapsed() >= PANEL_EVERY, present.as_mut()) {
                inbox.show_panel(gpu, present, &mut schedule.show_due)?;
                shown = Instant::now();
            }
            progress.tick("", 0, 0)
        };
        let pause = Some(&mut pause as &mut Pause);
        let written = match &mut saving.target {
            SaveTarget::Layers(wanted, path) => {
                export::write(renderer, cloud, wanted, path, progress, pause)
            }
            SaveTarget::Picture(picture) => match picture.step(renderer, cloud, progress, pause) {
                Ok(false) => {
                    let (done, total) = picture.so_far().unwrap_or((0, 1));
                    (self.report)(RenderEvent::Status(format!(
                        "saving {}: {done} of {total} pieces",
                        picture.path().display()
                    )));
                    return Ok(());
                }
                Ok(true) => Ok(Vec::new()),
                Err(error) => Err(error),
            },
        };
        match written {
            // It starts again when there is nothing else to do.
            Err(Error::Interrupted) => return Ok(()),
            Err(error) if error.is_lost_device() => return Err(error),
            _ => {}
        }
        let saving = self.saves.queue.pop_front().expect("it is the first");
        let path = saving.path().to_owned();
        let finished = written.and_then(|notes| match saving.target {
            SaveTarget::Picture(picture) => picture.finish(),
            SaveTarget::Layers(..) => Ok(notes),
        });
        match finished {
            Ok(notes) => {
                notes
                    .into_iter()
                    .for_each(|note| (self.report)(RenderEvent::Failed(Error::Request(note))));
                (self.report)(RenderEvent::Saved(path));
            }
            Err(error) => (self.report)(RenderEvent::SaveFailed(path, error)),
        }
        self.remove_unused(cloud)
    }

    /// Removes a cloud that the window does not show and that no picture is saved of.
    pub(super) fn remove_unused(&mut self, cloud: CloudId) -> Result<()> {
        let is_saved = self.saves.queue.iter().any(|save| save.cloud == cloud);
        if self.cloud == Some(cloud) || is_saved { Ok(()) } else { self.renderer.remove(cloud) }
    }

    /// Restores scene and nodes of the window's view after saving has replaced them.
    pub(super) fn restore_scene(&mut self) -> Result<()> {
        let (true, Some(scene), Some(cloud), Some(present)) =
            (self.saves.scene_replaced, &self.scene, self.cloud, &self.present)
        else {
            return Ok(());
        };
        self.saves.scene_replaced = false;
        self.renderer.set_scene(scene);
        let (gpu, cloud) = self.renderer.cloud(cloud)?;
        if let GpuCloud::Parts(residency) = cloud {
            let update = residency.update(
                gpu,
                &self.viewport.view_of(scene.camera, present.size())?,
                &scene.lod.of(present.size()),
            )?;
            if !update.is_complete() {
                self.schedule.redraw = self.schedule.redraw.max(Redraw::NodesArriving);
            }
            update
                .errors
                .into_iter()
                .for_each(|error| (self.report)(RenderEvent::Failed(Error::Request(error))));
        }
        Ok(())
    }

    /// Drops and reports unfinished pictures.
    pub(super) fn cancel_saves(&mut self) {
        for saving in self.saves.queue.drain(..) {
            warn(&format!(
                "{} was not saved: the window closed before it was complete",
                saving.path().display()
            ));
        }
    }
}
