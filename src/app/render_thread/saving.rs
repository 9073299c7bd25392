//! PICTURES -> FILES, while the window goes on: tile by tile, whenever there is nothing to draw in the window.
//!
//! In: what was to be seen when somebody asked, and how large. Out: the bytes that `render` writes. Between two tiles everything that is posted is handled, and on a software device, where a tile takes long,
//! it gives way; so the window moves, fits and closes as if nothing else were done, and takes in files that are dropped: the cloud that pictures were asked for of stays beside the window's until they are there. A picture no larger than the window is there as soon as it is asked for, unless nodes are on their way. One that is under way when the window closes is
//! not there, which is said.

use super::{Redraw, RenderEvent, RenderLoop, Superseded};
use crate::app::warn;
use crate::error::{Error, Result};
use crate::output::export;
use crate::output::tiled::{self, TiledPicture};
use crate::progress::{Progress, Silent};
use crate::render::source::GpuCloud;
use crate::select::clip::Clips;
use crate::select::opacity::Opacities;
use crate::view::View;
use std::path::{Path, PathBuf};

/// Width of a tile, pixels: several times as wide as the borders that surfaces want on either side, which are drawn, too.
const TILE: u32 = 2048;

/// A picture on its way into a file, and what it leaves out.
pub(super) struct PendingSave {
    asked: SaveTarget,
    opacities: Opacities,
    clips: Clips,
}

/// A cloud that the window no longer shows.
pub(super) struct RetiredCloud {
    cloud: GpuCloud,
    /// That wait, and are of it.
    pictures: usize,
}

enum SaveTarget {
    Picture(Box<TiledPicture>),
    /// All at once.
    Layers(Box<tiled::PictureRequest>, PathBuf),
}

impl PendingSave {
    fn path(&self) -> &Path {
        match &self.asked {
            SaveTarget::Picture(picture) => picture.path(),
            SaveTarget::Layers(_, path) => path,
        }
    }
}

impl RenderLoop {
    pub(super) fn save(&mut self, path: PathBuf, size: [u32; 2], layers: bool) -> Result<()> {
        let (Some(scene), Some(cloud)) = (&self.scene, &self.cloud) else {
            (self.report)(RenderEvent::SaveFailed(
                path,
                Error::Request("nothing is in the window yet; ask again when something is".into()),
            ));
            return Ok(());
        };
        let wanted = tiled::PictureRequest {
            view: View::new(scene.camera, size)?,
            settings: super::settings(scene, cloud.resident()),
            lod: scene.lod,
            piece: None,
            tile: Some(TILE),
        };
        // Of what the window shows whole, there is nothing to wait for.
        let is_there =
            self.redraw == Redraw::Nothing || matches!(self.cloud, Some(GpuCloud::Whole(_)));
        let at_once = is_there
            && self.saves.is_empty()
            && size.map(u64::from).iter().product::<u64>() <= self.pixels();
        let asked = match layers {
            true => Ok(SaveTarget::Layers(Box::new(wanted), path.clone())),
            false => TiledPicture::begin(wanted, &path)
                .map(|picture| SaveTarget::Picture(Box::new(picture))),
        };
        match asked {
            Ok(asked) => self.saves.push_back(PendingSave {
                asked,
                opacities: scene.opacities.clone(),
                clips: scene.clips.clone(),
            }),
            Err(error) => (self.report)(RenderEvent::SaveFailed(path, error)),
        }
        while at_once && !self.saves.is_empty() {
            self.continue_save(false)?;
        }
        Ok(())
    }

    /// Of the window.
    fn pixels(&self) -> u64 {
        self.present.as_ref().map_or(0, |present| present.size().map(u64::from).iter().product())
    }

    /// One tile, where something is being saved.
    pub(super) fn save_step(&mut self) -> Result<()> {
        if self.saves.is_empty() { Ok(()) } else { self.continue_save(true) }
    }

    fn continue_save(&mut self, gives_way: bool) -> Result<()> {
        let retired = self.retired.front_mut().map(|retired| &mut retired.cloud);
        self.filters_replaced |= retired.is_none();
        let (Some(saving), Some(cloud)) = (self.saves.front_mut(), retired.or(self.cloud.as_mut()))
        else {
            return Ok(());
        };
        cloud.set_filters(saving.opacities.clone(), saving.clips.clone());
        let newer = Superseded { count: &self.count, handled: self.handled };
        let progress = if gives_way { &newer as &dyn Progress } else { &Silent };
        let written = match &mut saving.asked {
            SaveTarget::Layers(wanted, path) => {
                export::write(&mut self.gpu, cloud, wanted, path, progress)
            }
            SaveTarget::Picture(picture) => match picture.step(&mut self.gpu, cloud, progress) {
                Ok(false) => {
                    let (done, total) = picture.so_far().unwrap_or((0, 1));
                    (self.report)(RenderEvent::Status(format!(
                        "saving {}: {done} of {total} tiles",
                        picture.path().display()
                    )));
                    return Ok(());
                }
                Ok(true) => Ok(Vec::new()),
                Err(error) => Err(error),
            },
        };
        match written {
            // It is begun again when there is nothing else to do.
            Err(Error::Interrupted) => return Ok(()),
            Err(error) if error.is_lost_device() => return Err(error),
            _ => {}
        }
        let saving = self.saves.pop_front().expect("it is the first");
        let path = saving.path().to_owned();
        let finished = written.and_then(|notes| match saving.asked {
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
        if let Some(retired) = self.retired.front_mut() {
            retired.pictures -= 1;
            if retired.pictures == 0 {
                self.retired
                    .pop_front()
                    .into_iter()
                    .for_each(|retired| retired.cloud.free(&mut self.gpu));
            }
        }
        Ok(())
    }

    /// A cloud that the window no longer shows is given back once all pictures of it are there.
    pub(super) fn retire(&mut self, cloud: GpuCloud) {
        // Pictures are made in the order that they were asked for in, so those of clouds before it come first.
        let pictures =
            self.saves.len() - self.retired.iter().map(|retired| retired.pictures).sum::<usize>();
        match pictures {
            0 => cloud.free(&mut self.gpu),
            _ => self.retired.push_back(RetiredCloud { cloud, pictures }),
        }
    }

    /// What is loaded is again what the window shows, for whoever asks about that.
    pub(super) fn restore_filters(&mut self) -> Result<()> {
        let (true, Some(scene), Some(cloud), Some(present)) =
            (self.filters_replaced, &self.scene, &mut self.cloud, &self.present)
        else {
            return Ok(());
        };
        self.filters_replaced = false;
        cloud.set_filters(scene.opacities.clone(), scene.clips.clone());
        if let GpuCloud::Parts(residency) = cloud {
            let update = residency.update(
                &mut self.gpu,
                &View::new(scene.camera, present.size())?,
                &scene.lod.of(present.size()),
            )?;
            if !update.is_complete() {
                self.redraw = self.redraw.max(Redraw::NodesArriving);
            }
            update
                .errors
                .into_iter()
                .for_each(|error| (self.report)(RenderEvent::Failed(Error::Request(error))));
        }
        Ok(())
    }

    pub(super) fn cancel_saves(&mut self) {
        for saving in self.saves.drain(..) {
            warn(&format!(
                "{} was not saved: drawing has ended before all of it was there",
                saving.path().display()
            ));
        }
        self.retired.drain(..).for_each(|retired| retired.cloud.free(&mut self.gpu));
    }
}
