//! Actions: what keys and the panel can do, and the files that some of them write.

use super::history::History;
use super::navigation::Input;
use super::profile;
use super::render_thread::Message;
use super::{App, Event, clip_box_widget};
use crate::atomic_file::write_atomically;
use crate::error::{Error, Result};
use crate::extract::{self, Selection};
use crate::render::scene::Scene;
use crate::select::slab::Slab;
use crate::tune::Limit;
use crate::view::View;
use std::path::{Path, PathBuf};
use std::time::Instant;
use winit::window::Fullscreen;

/// A command of a key or of the panel that does more than change the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Action {
    Navigate(Input),
    SavePicture,
    /// Saves the picture's layers as EXR.
    SaveLayers,
    SaveScene,
    /// Loads the scene that was saved last.
    LoadScene,
    SavePath,
    /// Saves the picked points in a file with this extension: csv or geojson.
    Export(&'static str),
    /// Makes a profile from the first picked point to the last.
    Profile,
    SaveProfile,
    CloseProfile,
    /// Clears the picked points.
    Forget,
    /// Adds a clip box.
    AddBox,
    /// Adds the current camera to the camera path.
    AddKey,
    ForgetPath,
    /// Starts or stops flying along the camera path.
    Play,
    /// Sets what moving pictures keep.
    Limit(Limit),
    /// Measures what each effect costs.
    Prices,
    /// Shows or hides the errors of the last moving picture.
    Errors,
    FullScreen,
    /// Asks for files to open.
    Open,
    /// Opens a recent file, by its number in the list.
    OpenRecent(usize),
    Undo,
    Redo,
    /// Closes the window, whatever is lost.
    CloseAnyway,
    /// Shows or hides the list of keys.
    Help,
    /// Shows or hides the panel.
    Panel,
    /// Folds the panel to a button, or unfolds it.
    FoldPanel,
}

impl App {
    /// Lays the panel out, and performs the actions chosen there.
    pub(super) fn lay_out(&mut self) {
        // The panel may have been enlarged.
        let viewport = self.fitting(self.viewport.reported);
        if viewport != self.viewport {
            self.set_viewport(viewport);
        }
        let (Some(window), Some(panel)) = (&self.window, &mut self.panel) else { return };
        let before = self.scene.clone();
        (self.ui.mode, self.ui.style) = (self.navigation.mode, self.navigation.style);
        self.ui.steps = self.history.steps();
        let laid_out = panel.lay_out(window, &mut self.ui, &self.viewport, &mut self.scene);
        self.panel_due = laid_out.repaint_in.and_then(|wait| Instant::now().checked_add(wait));
        let answers = std::mem::take(&mut self.answers);
        self.post(Message::Panel { overlay: Box::new(laid_out.overlay), answers });
        self.history.record(&before, &self.scene, laid_out.continues);
        if let Err(error) = self.scene_changed(&before) {
            self.report_error(&error);
        }
        for action in laid_out.actions {
            self.perform(action);
        }
    }

    pub(super) fn perform(&mut self, action: Action) {
        // An error that was dismissed is shown again if this action causes it again.
        self.ui.dismissed_error = None;
        match action {
            Action::Navigate(input) => self.navigate(input),
            Action::SavePicture => self.save_picture(false),
            Action::SaveLayers => self.save_picture(true),
            Action::SaveScene => {
                if self.save(&unused_name("json"), |app, path| app.scene.write(path)) {
                    self.saved.scene = self.scene.clone();
                }
            }
            Action::LoadScene => match last_name("json") {
                Some(path) => self.take(path),
                None => self.report_error(&Error::Request(
                    "there is no saved scene in this folder; F8 saves one, or drop a scene file on the window".into(),
                )),
            },
            Action::SavePath => {
                if self.save(&unused_name("path.json"), |app, path| app.ui.path.write(path)) {
                    self.saved.path = self.ui.path.clone();
                }
            }
            Action::Export(_) if self.ui.measure.points.is_empty() => {
                self.report_error(&Error::Request("no points are picked; click on one first".into()));
            }
            Action::Export(extension) => {
                if extension == "csv" {
                    self.save_profile();
                }
                if self.save(&unused_name(extension), |app, path| app.export(extension, path)) {
                    self.saved.points = self.ui.measure.places();
                }
            }
            Action::Profile => self.profile(),
            Action::SaveProfile => self.save_profile(),
            Action::CloseProfile => self.ui.profile = None,
            Action::Forget => self.forget(),
            Action::AddBox => {
                let before = self.scene.clone();
                self.scene.clips.0.push(clip_box_widget::around(&self.ui.measure, &self.navigation.camera));
                self.history.record(&before, &self.scene, false);
                self.post_scene();
            }
            Action::AddKey => self.ui.path.add(self.navigation.camera),
            Action::ForgetPath => self.ui.path.keys.clear(),
            Action::Play => self.play(),
            Action::Limit(limit) => self.post(Message::Limit(limit)),
            Action::Prices => self.post(Message::Prices),
            Action::Errors => self.ui.pace.shows_errors = !self.ui.pace.shows_errors,
            Action::FullScreen => self.full_screen(),
            Action::Open => self.ask_for_files(),
            Action::OpenRecent(number) => {
                self.ui.recent.get(number).cloned().into_iter().for_each(|file| self.take(file));
            }
            Action::Undo => self.step_in_history(History::undo),
            Action::Redo => self.step_in_history(History::redo),
            Action::CloseAnyway => self.closes = true,
            Action::Help => self.ui.help = !self.ui.help,
            // Room that the panel takes or leaves changes a view that is still as it was framed.
            Action::Panel => {
                self.ui.panel.toggle();
                self.set_viewport(self.viewport_of(self.viewport.reported));
            }
            Action::FoldPanel => {
                self.ui.panel.fold();
                self.set_viewport(self.viewport_of(self.viewport.reported));
            }
        }
        self.title();
    }

    /// Replaces the scene by that before or after the last change, seen as now.
    fn step_in_history(&mut self, step: fn(&mut History, &Scene) -> Option<Scene>) {
        let before = self.scene.clone();
        let Some(scene) = step(&mut self.history, &before) else { return };
        self.scene = scene;
        if let Err(error) = self.scene_changed(&before) {
            self.report_error(&error);
        }
    }

    /// Requests a profile of the points that are loaded now.
    fn profile(&mut self) {
        let places = self.ui.measure.places();
        let width = if self.ui.width > 0.0 {
            self.ui.width
        } else {
            profile::SHARE * self.ui.measure.horizontal()
        };
        let slab = places
            .first()
            .zip(places.last())
            .and_then(|(&start, &end)| Slab::new(start, end, width));
        match slab {
            Some(slab) => {
                let Scene { filter, clips, opacities, .. } = self.scene.clone();
                self.profiled = Some(Selection { filter, clips, opacities, slab: Some(slab) });
                self.post(Message::Section(slab));
            }
            None => self.report_error(&Error::Request(
                "a profile needs two picked points, not one above the other; shift and click to pick one more".into(),
            )),
        }
    }

    /// Requests a picture from the render thread, which reports when it is saved.
    fn save_picture(&mut self, layers: bool) {
        let path = unused_names(if layers { "exr" } else { "png" })
            .find(|path| !self.pending_saves.contains(path))
            .expect("numbers do not end");
        self.pending_saves.push(path.clone());
        let size = self.ui.save_size.of(self.viewport.size());
        let view = View::new(self.navigation.camera, size).ok();
        let over = view
            .zip(self.ui.named(&self.scene))
            .map(|(view, named)| self.scene.annotations.overlay(&view, &named));
        self.post(Message::Save { path, size, layers, over: Box::new(over.unwrap_or_default()) });
    }

    /// Writes the profile as SVG, and the table of its points on a thread, since these are read
    /// from the files.
    fn save_profile(&mut self) {
        if self.ui.profile.is_some() {
            self.save(&unused_name("profile.svg"), |app, path| app.write_profile(path));
        }
        let (Some(profile), Some(selection)) = (&self.ui.profile, self.profiled.clone()) else {
            return;
        };
        let path = unused_names("profile.csv")
            .find(|path| !self.pending_saves.contains(path))
            .expect("numbers do not end");
        let (files, shown, done) =
            (self.load.origins.clone(), profile.shown(), self.events.clone());
        let (read, output) = (self.options.opening.read, path.clone());
        let watch = self.progress_reporter(self.load.table_token.clone());
        let work = move || {
            let written =
                extract::profile::write(&files, &read, &selection, Some(shown), &output, &watch);
            drop(done.send_event(Event::Written(output, written)));
        };
        match std::thread::Builder::new().name("profile".into()).spawn(work) {
            Ok(thread) => {
                self.pending_saves.push(path);
                self.load.add_worker(thread);
            }
            Err(error) => self.report_error(&Error::Request(format!(
                "cannot start a thread to write {}: {error}",
                path.display()
            ))),
        }
    }

    pub(super) fn table_written(&mut self, path: &Path, written: Result<u64>) {
        self.pending_saves.retain(|pending| pending != path);
        self.ui.doing = None;
        match written {
            Ok(points) => {
                self.ui.doing = Some(format!("saved {}: {points} points", path.display()));
            }
            Err(error) => self.report_error(&error),
        }
    }

    /// Writes a file; returns whether it is there.
    fn save(&mut self, path: &Path, write: impl FnOnce(&App, &Path) -> Result<()>) -> bool {
        match write(self, path) {
            Ok(()) => {
                self.ui.doing = Some(format!("saved {}", path.display()));
                true
            }
            Err(error) => {
                self.report_error(&error);
                false
            }
        }
    }

    /// Writes the profile as it is shown, with its legend if there is one.
    fn write_profile(&self, path: &Path) -> Result<()> {
        let (profile, reference) = (self.ui.profile.as_ref(), &self.ui.measure.reference);
        let svg = profile.map(|profile| {
            let shows_legend = self.scene.annotations.legend;
            let stations = &self.ui.categories.stations;
            let legend = shows_legend.then(|| profile.legend(reference, stations)).flatten();
            profile.svg(reference, legend)
        });
        svg.map_or(Ok(()), |svg| write(path, svg))
    }

    /// Writes the picked points, and the measures between them.
    fn export(&self, extension: &str, path: &Path) -> Result<()> {
        let text = match extension {
            "csv" => self.ui.measure.csv(),
            _ => format!("{:#}\n", self.ui.measure.geojson()),
        };
        write(path, text)
    }

    fn full_screen(&self) {
        if let Some(window) = &self.window {
            let now = window.fullscreen().is_none().then_some(Fullscreen::Borderless(None));
            window.set_fullscreen(now);
        }
    }
}

fn write(path: &Path, text: String) -> Result<()> {
    write_atomically(path, |partial| {
        std::fs::write(partial, text).map_err(|error| Error::io("write", path, error))
    })
}

/// Returns the last file that [`unused_name`] has named; None if there is none.
fn last_name(extension: &str) -> Option<PathBuf> {
    let names = (1..).map(|number| PathBuf::from(format!("pointillist-{number}.{extension}")));
    names.take_while(|path| path.exists()).last()
}

/// Returns a file name in the working directory that does not exist yet.
fn unused_name(extension: &str) -> PathBuf {
    unused_names(extension).next().expect("numbers do not end")
}

fn unused_names(extension: &str) -> impl Iterator<Item = PathBuf> {
    (1..)
        .map(move |number| PathBuf::from(format!("pointillist-{number}.{extension}")))
        .filter(|path| !path.exists())
}
