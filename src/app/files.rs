//! FILES -> CLOUD: what is to be opened goes to the opening thread, and what that has read on to the drawing thread.

use super::drawing::{Bring, Message};
use super::navigation::Input;
use super::opening::{self, Opened, Said, Watch};
use super::{App, Event};
use crate::error::{Error, Result};
use crate::passes::Switch;
use crate::scene::Scene;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

impl App {
    /// Another cloud beside those that are open, or a scene, which takes the place of the one that is drawn.
    pub(super) fn take(&mut self, file: PathBuf) {
        let is_scene = file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
        let taken = if is_scene {
            self.load(&file)
        } else if self.files.contains(&file) {
            Err(Error::Request(format!("{} is open already", file.display())))
        } else {
            self.files.push(file);
            self.open()
        };
        if let Err(error) = taken {
            self.trouble(&error);
        }
        self.title();
    }

    fn load(&mut self, file: &Path) -> Result<()> {
        let mut scene = Scene::read(file)?;
        // As `render --scene` does: what the file does not say is as it was asked for.
        let asked = self.options.scene.fineness;
        scene.fineness.budget = scene.fineness.budget.or(asked.budget);
        scene.fineness.lod_px = scene.fineness.lod_px.or(asked.lod_px);
        let before = std::mem::replace(&mut self.scene, scene);
        self.framed = true;
        self.options.camera = Some(self.scene.camera);
        self.navigation.camera = self.scene.camera;
        self.facts.trouble = None;
        self.scene_changed(&before)?;
        self.facts.doing = Some(format!("loaded {}", file.display()));
        Ok(())
    }

    /// Draws it, after reading files again where they have what is shown now, or what brushes need to know.
    pub(super) fn scene_changed(&mut self, before: &Scene) -> Result<()> {
        if self.scene.color != before.color {
            self.open()?;
        }
        self.find_strokes()?;
        if self.scene != *before {
            self.post_scene();
        }
        Ok(())
    }

    /// Reads all files anew, in the background.
    pub(super) fn open(&mut self) -> Result<()> {
        if self.files.is_empty() {
            return Ok(());
        }
        self.abandoned.store(true, Relaxed);
        self.abandoned = Arc::new(AtomicBool::new(false));
        self.facts.doing = Some("opening".into());
        self.facts.trouble = None;
        // What is on the screen whole is seen until it is there again as a whole.
        let sampled = self.last_opened.as_ref().is_none_or(|(files, _)| *files != self.files);
        let (progress, opened) = (self.events.clone(), self.events.clone());
        let watch = Watch::new(self.abandoned.clone(), move |text| drop(progress.send_event(Event::Progress(text))));
        let done = move |result: Result<Opened>| drop(opened.send_event(Event::Opened(result.map(Box::new))));
        self.openings.push(opening::start(
            self.files.clone(),
            self.options.opening.clone(),
            self.scene.color,
            self.options.further,
            sampled,
            watch,
            done,
        )?);
        Ok(())
    }

    /// What cannot be opened, or cannot show what is asked for, leaves what was open as it was.
    pub(super) fn not_opened(&mut self, error: &Error) {
        self.facts.doing = None;
        let files = std::mem::take(&mut self.files);
        if let Some((last, color)) = self.last_opened.clone() {
            (self.files, self.scene.color) = (last, color);
        } else if let [first @ .., _] = &files[..] {
            // Whatever was dropped last may be what is wrong.
            self.files = first.to_vec();
        }
        // A sample of what cannot be opened may be on the screen, or what came before has never been, or was on its way and is given up.
        let again = std::mem::take(&mut self.waits) | self.coming.take().is_some() | self.last_opened.is_none();
        let reopened = if again { self.open() } else { Ok(()) };
        self.trouble(error);
        if let Err(error) = reopened {
            self.trouble(&error);
        }
    }

    pub(super) fn opened(&mut self, opened: Opened) {
        let Opened { prepared, subject, said, is_whole, files, color } = opened;
        if is_whole {
            self.last_opened = Some((files, color));
        }
        self.coming = Some(said);
        self.navigation.set_subject(subject);
        // Whoever has not moved since sees the whole from where `render` does.
        if !self.framed || self.glimpsed.take() == Some(self.navigation.camera) {
            self.framed = true;
            match self.options.camera {
                Some(camera) => self.navigation.camera = camera,
                None => self.navigation.handle(Input::Look { from: self.options.preset, covered_px: 0.0 }),
            }
            self.glimpsed = (!is_whole).then_some(self.navigation.camera);
        }
        self.waits = !is_whole;
        let progress = self.events.clone();
        let watch = Watch::new(self.abandoned.clone(), move |text| drop(progress.send_event(Event::Progress(text))));
        self.post(Message::Bring(Box::new(Bring { prepared, pool_bytes: self.options.pool_bytes, watch })));
        self.post_scene();
    }

    /// What was opened is in the picture, and what is said of it true.
    pub(super) fn brought(&mut self) {
        if !self.waits {
            self.facts.doing = None;
        }
        let Some(Said { origins, shown, kinds, points, why_shown, notes }) = self.coming.take() else { return };
        let painted_later = self.paints_later();
        self.origins = origins;
        (self.facts.points, self.facts.shown, self.facts.kinds) = (points, Some(shown), kinds);
        self.facts.why_shown = why_shown;
        (self.facts.loading, self.facts.bytes_read) = (None, 0);
        // As `render` does; once, however often the files are read.
        notes.iter().filter(|note| !self.facts.notes.contains(note)).for_each(|note| eprintln!("pointillist: note: {note}"));
        self.facts.notes = notes;
        if painted_later && !self.paints_later() {
            self.post_scene();
        }
        if let Err(error) = self.find_strokes() {
            self.trouble(&error);
        }
    }

    /// What was opened does not come; what is on the screen stays.
    pub(super) fn not_brought(&mut self, error: &Error) {
        (self.coming, self.waits, self.facts.doing) = (None, false, None);
        self.trouble(error);
    }

    /// Reads files again that are on the screen without strokes that were asked for: finding them takes long, so the cloud is there before.
    fn find_strokes(&mut self) -> Result<()> {
        let is_there = self.facts.shown.is_some() && !self.waits && self.coming.is_none();
        if !is_there || !self.paints_later() || self.options.further.strokes {
            return Ok(());
        }
        (self.options.further.strokes, self.waits) = (true, true);
        self.open()
    }

    /// Whether strokes were asked for that the cloud in the picture does not know.
    pub(super) fn paints_later(&self) -> bool {
        let knows = self.facts.shown.is_some_and(|shown| shown.further.strokes);
        self.scene.wishes.effects.strokes.switch == Switch::On && !knows
    }
}
