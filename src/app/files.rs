//! FILES -> CLOUD: what is to be opened goes to the opening thread, and what that has read on to the drawing thread.

use super::drawing::Message;
use super::navigation::Input;
use super::opening::{self, Opened, Watch};
use super::{App, Event};
use crate::error::Result;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

impl App {
    /// Reads all files anew, in the background.
    pub(super) fn open(&mut self) -> Result<()> {
        if self.files.is_empty() {
            return Ok(());
        }
        self.abandoned.store(true, Relaxed);
        self.abandoned = Arc::new(AtomicBool::new(false));
        self.facts.doing = Some("opening".into());
        self.facts.trouble = None;
        let (progress, opened) = (self.events.clone(), self.events.clone());
        let watch = Watch::new(self.abandoned.clone(), move |text| drop(progress.send_event(Event::Progress(text))));
        let done = move |result: Result<Opened>| drop(opened.send_event(Event::Opened(result.map(Box::new))));
        self.openings.push(opening::start(
            self.files.clone(),
            self.options.opening.clone(),
            self.scene.color,
            self.options.further,
            watch,
            done,
        )?);
        Ok(())
    }

    pub(super) fn opened(&mut self, opened: Opened) {
        let Opened { source, shown, subject, kinds, is_whole } = opened;
        self.facts.points = source.points();
        (self.origins, self.stations) = (source.files(), source.stations().to_vec());
        self.facts.shows = Some(shown.attribute);
        self.facts.kinds = kinds;
        self.navigation.set_subject(subject);
        if !self.framed {
            self.framed = true;
            match self.options.camera {
                Some(camera) => self.navigation.camera = camera,
                None => self.navigation.handle(Input::Look { from: self.options.preset }),
            }
        }
        self.waits = !is_whole;
        let pool_bytes = self.options.pool_bytes;
        let progress = self.events.clone();
        let watch = Watch::new(self.abandoned.clone(), move |text| drop(progress.send_event(Event::Progress(text))));
        self.post(Message::Bring(Box::new(move |gpu| source.bring(gpu, shown, pool_bytes, &watch))));
        self.post_scene();
    }
}
