//! Files: requests go to the load thread, and loaded clouds on to the render thread.

use super::cancel::CancelToken;
use super::load_thread::{self, CloudInfo, FirstStage, LoadRequest, LoadedCloud};
use super::navigation::Input;
use super::panel::named_of;
use super::render_thread::{Message, Upload};
use super::{App, Event, recent, warn};
use crate::cloud::attribute::ExtraAttributes;
use crate::error::{Error, Result};
use crate::index::attributes::strokes::StrokeCache;
use crate::index::format::Index;
use crate::passes::Switch;
use crate::render::scene::Scene;
use crate::view::Camera;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;

/// The files that are open, and the work of loading them.
#[derive(Default)]
pub(super) struct LoadState {
    /// Files that are open or being loaded.
    pub files: Vec<PathBuf>,
    /// Files that the displayed points come from.
    pub origins: Vec<PathBuf>,
    /// Strokes computed so far of the open files.
    pub strokes: Arc<StrokeCache>,
    /// The last request that was loaded as a whole.
    pub last: Option<LoadRequest>,
    /// The request that is displayed; None if that is a sample or nothing.
    pub displayed: Option<LoadRequest>,
    /// True if a cloud is being read or uploaded.
    pub active: bool,
    pub token: CancelToken,
    /// Token of threads that look up picked points.
    pub lookup_token: CancelToken,
    /// Token of threads that write tables.
    pub table_token: CancelToken,
    pub workers: Vec<JoinHandle<()>>,
}

impl LoadState {
    /// Keeps a thread that the end of the program waits for, and lets go of those that have ended.
    pub fn add_worker(&mut self, worker: JoinHandle<()>) {
        self.workers.retain(|worker| !worker.is_finished());
        self.workers.push(worker);
    }

    /// Waits until all threads have ended.
    pub fn join_workers(&mut self) {
        // A panic has been printed where it happened.
        self.workers.drain(..).for_each(|worker| drop(worker.join()));
    }
}

/// How the first view of a cloud is chosen: automatically, until the camera is moved.
#[derive(Default)]
pub(super) struct Framing {
    /// True if a camera is set.
    pub chosen: bool,
    /// The automatic camera for a sample, while the camera has not been moved.
    pub sample_camera: Option<Camera>,
    /// Views chosen before the whole is loaded; they are applied to it again.
    pub early_inputs: Vec<Input>,
    /// True if the last view was framed before it was known what annotations name.
    pub lacks_names: bool,
}

impl App {
    /// Opens a file: a cloud beside those that are open, or a scene in place of the current one.
    pub(super) fn take(&mut self, file: PathBuf) {
        // A new request dismisses the error before.
        self.ui.error = None;
        let is_json =
            file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
        let is_scene = is_json && !Index::is_octree(&file);
        let taken = if is_scene {
            self.load(&file)
        } else if self.load.files.contains(&file) {
            Err(Error::Request(format!("{} is open already", file.display())))
        } else {
            self.load.files.push(file);
            self.open()
        };
        if let Err(error) = taken {
            self.report_error(&error);
        }
        self.title();
    }

    fn load(&mut self, file: &Path) -> Result<()> {
        let mut scene = Scene::read(file)?;
        // Options fill in what the file leaves out, like those of `render --scene`.
        let asked = self.options.scene.lod;
        scene.lod.budget = scene.lod.budget.or(asked.budget);
        scene.lod.lod_px = scene.lod.lod_px.or(asked.lod_px);
        let before = std::mem::replace(&mut self.scene, scene);
        self.framing.chosen = true;
        self.options.camera = Some(self.scene.camera);
        self.navigation.camera = self.scene.camera;
        self.history.record(&before, &self.scene, false);
        self.saved.scene = self.scene.clone();
        self.scene_changed(&before)?;
        self.ui.doing = Some(format!("loaded {}", file.display()));
        Ok(())
    }

    /// Draws the changed scene, and loads files again if it shows another attribute or needs
    /// strokes.
    pub(super) fn scene_changed(&mut self, before: &Scene) -> Result<()> {
        if self.scene.color != before.color || self.scene.filter != before.filter {
            self.options.opening.filter = self.scene.filter.clone();
            self.ui.error = None;
            self.open()?;
        }
        self.find_strokes()?;
        if self.scene != *before {
            self.post_scene();
        }
        if self.scene.annotations != before.annotations {
            self.frame_again();
        }
        Ok(())
    }

    /// Loads all files again, in the background.
    pub(super) fn open(&mut self) -> Result<()> {
        if self.load.files.is_empty() {
            return Ok(());
        }
        let token = self.load.token.renew();
        self.load.active = true;
        self.ui.doing = Some("opening".into());
        let (request, opening) = (self.load_request(), self.options.opening.clone());
        let further = ExtraAttributes { strokes: self.wants_strokes(), ..self.options.further };
        let is_painted = self.ui.shown.is_some_and(|shown| shown.further.strokes);
        // A whole cloud stays on the screen until it is loaded again as a whole, with its strokes
        // if it had them.
        let first = match &self.load.displayed {
            Some(whole) if *whole == request || whole.files == request.files && is_painted => {
                FirstStage::All
            }
            Some(whole) if whole.files == request.files => FirstStage::Points,
            _ => FirstStage::Sample,
        };
        let (watch, events) = (self.progress_reporter(token.clone()), self.events.clone());
        let opened = move |result: Result<LoadedCloud>| {
            drop(events.send_event(Event::Loaded(result.map(Box::new), token.clone())))
        };
        let strokes = self.load.strokes.clone();
        let worker = load_thread::start(request, opening, further, first, strokes, watch, opened)?;
        self.load.add_worker(worker);
        Ok(())
    }

    /// Returns the files that should be open, and the attribute to show.
    fn load_request(&self) -> LoadRequest {
        let Scene { color, filter, .. } = &self.scene;
        LoadRequest { files: self.load.files.clone(), color: *color, filter: filter.clone() }
    }

    /// Reports a failed load, and returns to what was open before.
    pub(super) fn load_failed(&mut self, error: &Error) {
        (self.load.active, self.ui.doing) = (false, None);
        self.post_picks();
        let failed = self.load_request();
        if self.paints_later() && self.load.displayed.as_ref() == Some(&failed) {
            return self.not_painted(error);
        }
        let before = self.load.last.clone();
        let is_wrong = |file: &PathBuf| {
            error.path() == Some(file)
                && before.as_ref().is_none_or(|before| !before.files.contains(file))
        };
        match before {
            // The other files of the request may be valid.
            _ if self.load.files.iter().any(is_wrong) => {
                self.load.files.retain(|file| !is_wrong(file))
            }
            Some(LoadRequest { files, color, filter }) => {
                if self.scene.filter != filter {
                    // The line keeps its text, to be corrected.
                    self.ui.filter.of = filter.clone();
                    self.ui.filter.error = Some(error.to_string());
                }
                (self.load.files, self.scene.color) = (files, color);
                self.options.opening.filter = filter.clone();
                self.scene.filter = filter;
            }
            // The file dropped last is the most likely cause.
            None => drop(self.load.files.pop()),
        }
        // The screen may show a sample of the failed files, or nothing, or the load before may have
        // been cancelled.
        let request = self.load_request();
        let reopened = if request != failed && self.load.displayed.as_ref() != Some(&request) {
            self.open()
        } else {
            Ok(())
        };
        self.report_error(error);
        if let Err(error) = reopened {
            self.report_error(&error);
        }
    }

    /// Sends a loaded cloud to the render thread, and frames it unless a view was chosen.
    pub(super) fn loaded(&mut self, opened: LoadedCloud) {
        let LoadedCloud { prepared, subject, info } = opened;
        let is_whole = info.is_whole;
        if is_whole {
            self.load.last = Some(info.request.clone());
        }
        self.navigation.set_subject(subject);
        let named = named_of(info.shown, &info.categories, &self.scene);
        // If the camera has not moved since the sample, the whole is framed as `render` does.
        if !self.framing.chosen || self.framing.sample_camera.take() == Some(self.navigation.camera)
        {
            self.framing.chosen = true;
            match self.options.camera {
                Some(camera) => self.navigation.camera = camera,
                None => self.look(self.options.preset, Some(&named)),
            }
            for input in self.framing.early_inputs.clone() {
                match input {
                    Input::Look { from } => self.look(from, Some(&named)),
                    _ => self.navigation.handle(input),
                }
            }
            self.framing.sample_camera = (!is_whole).then_some(self.navigation.camera);
        }
        if is_whole {
            self.framing.early_inputs.clear();
        }
        let watch = self.progress_reporter(self.load.token.clone());
        self.post(Message::Upload(Box::new(Upload { prepared, info, watch })));
        self.post_scene();
    }

    /// Shows the facts of a cloud that is now drawn, even if another is being loaded by now.
    pub(super) fn uploaded(&mut self, info: CloudInfo, token: &CancelToken) {
        let CloudInfo {
            request,
            is_whole,
            origins,
            shown,
            mut categories,
            points,
            why_shown,
            notes,
        } = info;
        // Leave out columns that an earlier load has read and not found.
        if self.load.displayed.as_ref().is_some_and(|before| before.files == request.files) {
            let found = &self.ui.categories.attributes;
            categories.attributes.retain(|attribute| found.contains(attribute));
        }
        if is_whole {
            match recent::add(&request.files) {
                Ok(recent) => self.ui.recent = recent,
                Err(error) => warn(&format!("recent files are not kept: {error}")),
            }
        }
        self.load.displayed = is_whole.then_some(request);
        if is_whole && !token.is_cancelled() {
            (self.load.active, self.ui.doing) = (false, None);
        }
        let mut files: Vec<String> = origins.iter().map(|path| file_name(path)).collect();
        files.dedup();
        (self.load.origins, self.ui.files) = (origins, files);
        (self.ui.points, self.ui.shown, self.ui.categories) = (points, Some(shown), categories);
        self.ui.measure.reference = self.ui.categories.reference.clone();
        self.ui.why_shown = why_shown;
        (self.ui.loading, self.ui.bytes_read) = (None, 0);
        // Prints every note once, however often the files are loaded.
        notes
            .iter()
            .filter(|note| !self.ui.notes.contains(note))
            .for_each(|note| warn(&format!("note: {note}")));
        self.ui.notes = notes;
        if self.framing.lacks_names {
            self.frame_again();
        }
        self.post_picks();
        if let Err(error) = self.find_strokes() {
            self.report_error(&error);
        }
    }

    /// Reports a failed upload; the picture stays as it is.
    pub(super) fn upload_failed(&mut self, error: &Error) {
        (self.load.active, self.ui.doing) = (false, None);
        self.post_picks();
        if self.paints_later() && self.load.displayed.as_ref() == Some(&self.load_request()) {
            return self.not_painted(error);
        }
        self.report_error(error);
    }

    /// Switches strokes off that cannot be computed or do not fit into memory.
    fn not_painted(&mut self, error: &Error) {
        self.scene.settings.effects.strokes.switch = Switch::Off;
        self.report_error(error);
    }

    /// Loads files again that are shown without the strokes that are wanted. Strokes take long, so
    /// the cloud is shown before.
    fn find_strokes(&mut self) -> Result<()> {
        let is_there =
            self.load.displayed.as_ref() == Some(&self.load_request()) && !self.load.active;
        if is_there && self.paints_later() { self.open() } else { Ok(()) }
    }

    /// Returns whether strokes are wanted that the displayed cloud does not have.
    fn paints_later(&self) -> bool {
        self.wants_strokes() && self.ui.shown.is_none_or(|shown| !shown.further.strokes)
    }

    fn wants_strokes(&self) -> bool {
        self.scene.settings.effects.strokes.switch == Switch::On
    }
}

/// Returns the name of a file without its folders.
fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_that_have_ended_are_let_go() {
        let mut load = LoadState::default();
        for _ in 0..100 {
            let worker = std::thread::spawn(|| ());
            while !worker.is_finished() {
                std::thread::yield_now();
            }
            load.add_worker(worker);
        }
        assert_eq!(load.workers.len(), 1);
    }
}
