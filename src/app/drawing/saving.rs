//! PICTURES -> FILES, while the window goes on: tile by tile, whenever there is nothing to draw in the window.
//!
//! In: what was to be seen when somebody asked, and how large. Out: the bytes that `render` writes. Between two tiles everything that is posted is heard, and on a software device, where a tile takes long,
//! it gives way; so the window moves, fits and closes as if nothing else were done, and takes in files that are dropped: the cloud that pictures were asked for of stays beside the window's until they are there. A picture no larger than the window is there as soon as it is asked for, unless nodes are on their way. One that is under way when the window closes is
//! not there, which is said.

use super::{Newer, Report, Thread, Wanted};
use crate::app::complain;
use crate::error::{Error, Result};
use crate::output::export;
use crate::output::tiled::{self, Tiled};
use crate::progress::{Progress, Silent};
use crate::select::clip::Clips;
use crate::select::opacity::Opacities;
use crate::source::Brought;
use crate::view::View;
use std::path::{Path, PathBuf};

/// Width of a tile, pixels: several times as wide as the borders that surfaces want on either side, which are drawn, too.
const TILE: u32 = 2048;

/// A picture on its way into a file, and what it leaves out.
pub(super) struct Saving {
    asked: Asked,
    opacities: Opacities,
    clips: Clips,
}

/// A cloud that the window no longer shows.
pub(super) struct Former {
    cloud: Brought,
    /// That wait, and are of it.
    pictures: usize,
}

enum Asked {
    Picture(Box<Tiled>),
    /// All at once.
    Layers(Box<tiled::Wanted>, PathBuf),
}

impl Saving {
    fn path(&self) -> &Path {
        match &self.asked {
            Asked::Picture(picture) => picture.path(),
            Asked::Layers(_, path) => path,
        }
    }
}

impl Thread {
    pub(super) fn save(&mut self, path: PathBuf, size: [u32; 2], layers: bool) -> Result<()> {
        let (Some(scene), Some(cloud)) = (&self.scene, &self.cloud) else {
            (self.report)(Report::NotSaved(
                path,
                Error::Request("nothing is in the window yet; ask again when something is".into()),
            ));
            return Ok(());
        };
        let wanted = tiled::Wanted {
            view: View::new(scene.camera, size)?,
            settings: super::settings(scene, cloud.resident()),
            fineness: scene.fineness,
            piece: None,
            tile: Some(TILE),
        };
        // Of what the window shows whole, there is nothing to wait for.
        let is_there =
            self.wanted == Wanted::Nothing || matches!(self.cloud, Some(Brought::Whole(_)));
        let at_once = is_there
            && self.saving.is_empty()
            && size.map(u64::from).iter().product::<u64>() <= self.pixels();
        let asked = match layers {
            true => Ok(Asked::Layers(Box::new(wanted), path.clone())),
            false => Tiled::begin(wanted, &path).map(|picture| Asked::Picture(Box::new(picture))),
        };
        match asked {
            Ok(asked) => self.saving.push_back(Saving {
                asked,
                opacities: scene.opacities.clone(),
                clips: scene.clips.clone(),
            }),
            Err(error) => (self.report)(Report::NotSaved(path, error)),
        }
        while at_once && !self.saving.is_empty() {
            self.save_more(false)?;
        }
        Ok(())
    }

    /// Of the window.
    fn pixels(&self) -> u64 {
        self.present.as_ref().map_or(0, |present| present.size().map(u64::from).iter().product())
    }

    /// One tile, where something is being saved.
    pub(super) fn save_on(&mut self) -> Result<()> {
        if self.saving.is_empty() { Ok(()) } else { self.save_more(true) }
    }

    fn save_more(&mut self, gives_way: bool) -> Result<()> {
        let former = self.former.front_mut().map(|former| &mut former.cloud);
        self.elsewhere |= former.is_none();
        let (Some(saving), Some(cloud)) = (self.saving.front_mut(), former.or(self.cloud.as_mut()))
        else {
            return Ok(());
        };
        cloud.leave_out(saving.opacities.clone(), saving.clips.clone());
        let newer = Newer { count: &self.count, heard: self.heard };
        let progress = if gives_way { &newer as &dyn Progress } else { &Silent };
        let written = match &mut saving.asked {
            Asked::Layers(wanted, path) => {
                export::write(&mut self.gpu, cloud, wanted, path, progress)
            }
            Asked::Picture(picture) => match picture.step(&mut self.gpu, cloud, progress) {
                Ok(false) => {
                    let (done, total) = picture.so_far().unwrap_or((0, 1));
                    (self.report)(Report::Doing(format!(
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
        let saving = self.saving.pop_front().expect("it is the first");
        let path = saving.path().to_owned();
        let finished = written.and_then(|notes| match saving.asked {
            Asked::Picture(picture) => picture.finish(),
            Asked::Layers(..) => Ok(notes),
        });
        match finished {
            Ok(notes) => {
                notes
                    .into_iter()
                    .for_each(|note| (self.report)(Report::Failed(Error::Request(note))));
                (self.report)(Report::Saved(path));
            }
            Err(error) => (self.report)(Report::NotSaved(path, error)),
        }
        if let Some(former) = self.former.front_mut() {
            former.pictures -= 1;
            if former.pictures == 0 {
                self.former
                    .pop_front()
                    .into_iter()
                    .for_each(|former| former.cloud.free(&mut self.gpu));
            }
        }
        Ok(())
    }

    /// A cloud that the window no longer shows is given back once all pictures of it are there.
    pub(super) fn leave(&mut self, cloud: Brought) {
        // Pictures are made in the order that they were asked for in, so those of clouds before it come first.
        let pictures =
            self.saving.len() - self.former.iter().map(|former| former.pictures).sum::<usize>();
        match pictures {
            0 => cloud.free(&mut self.gpu),
            _ => self.former.push_back(Former { cloud, pictures }),
        }
    }

    /// What is loaded is again what the window shows, for whoever asks about that.
    pub(super) fn look_back(&mut self) -> Result<()> {
        let (true, Some(scene), Some(cloud), Some(present)) =
            (self.elsewhere, &self.scene, &mut self.cloud, &self.present)
        else {
            return Ok(());
        };
        self.elsewhere = false;
        cloud.leave_out(scene.opacities.clone(), scene.clips.clone());
        if let Brought::Parts(residency) = cloud {
            let update = residency.update(
                &mut self.gpu,
                &View::new(scene.camera, present.size())?,
                &scene.fineness.of(present.size()),
            )?;
            if !update.is_complete() {
                self.wanted = self.wanted.max(Wanted::More);
            }
            update
                .errors
                .into_iter()
                .for_each(|error| (self.report)(Report::Failed(Error::Request(error))));
        }
        Ok(())
    }

    pub(super) fn give_up_saving(&mut self) {
        for saving in self.saving.drain(..) {
            complain(&format!(
                "{} was not saved: drawing has ended before all of it was there",
                saving.path().display()
            ));
        }
        self.former.drain(..).for_each(|former| former.cloud.free(&mut self.gpu));
    }
}
