//! PANEL, KEYS -> DEEDS: what was chosen there, and the files that come of it.

use super::drawing::Message;
use super::navigation::Input;
use super::{App, boxes};
use crate::error::{Error, Result};
use crate::view::View;
use crate::whole_file::whole_file;
use std::path::{Path, PathBuf};
use std::time::Instant;
use winit::window::Fullscreen;

/// What is done at once, by a key or in the panel, besides changing the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Deed {
    Navigate(Input),
    SavePicture,
    SaveScene,
    SavePath,
    /// What was picked, with this extension: csv or geojson.
    Export(&'static str),
    /// What was picked.
    Forget,
    /// One more clip box.
    AddBox,
    /// One more view of the camera path, from here.
    AddKey,
    ForgetPath,
    /// Along the camera path, or no longer.
    Play,
    FullScreen,
    Help,
    /// With the panel, or without.
    Panel,
}

impl App {
    /// Lays the panel out, and does what was chosen there.
    pub(super) fn lay_out(&mut self) {
        let (Some(window), Some(panel)) = (&self.window, &mut self.panel) else { return };
        let before = self.scene.clone();
        self.facts.mode = self.navigation.mode;
        let size = window.inner_size();
        let view = View::new(self.scene.camera, [size.width.max(1), size.height.max(1)]).ok();
        let laid_out = panel.lay_out(window, &self.facts, view.as_ref(), &mut self.scene);
        self.laid_out = laid_out.again_in.and_then(|wait| Instant::now().checked_add(wait));
        self.post(Message::Panel(Box::new(laid_out.overlay)));
        if self.scene.color != before.color
            && let Err(error) = self.open()
        {
            self.trouble(&error);
        }
        if self.scene != before {
            self.post_scene();
        }
        for deed in laid_out.deeds {
            self.deed(deed);
        }
    }

    pub(super) fn deed(&mut self, deed: Deed) {
        match deed {
            Deed::Navigate(input) => self.navigate(input),
            Deed::SavePicture => self.post(Message::Save(unused_name("png"))),
            Deed::SaveScene => self.save(&unused_name("json"), |app, path| app.scene.write(path)),
            Deed::SavePath => self.save(&unused_name("path.json"), |app, path| app.facts.path.write(path)),
            Deed::Export(extension) => self.save(&unused_name(extension), |app, path| app.export(extension, path)),
            Deed::Forget => self.forget(),
            Deed::AddBox => {
                self.scene.clips.0.push(boxes::around(&self.facts.measure, &self.navigation.camera));
                self.post_scene();
            }
            Deed::AddKey => self.facts.path.add(self.navigation.camera),
            Deed::ForgetPath => self.facts.path.keys.clear(),
            Deed::Play => self.play(),
            Deed::FullScreen => self.full_screen(),
            Deed::Help => self.facts.help = !self.facts.help,
            Deed::Panel => self.facts.hidden = !self.facts.hidden,
        }
        self.title();
    }

    fn save(&mut self, path: &Path, write: impl FnOnce(&App, &Path) -> Result<()>) {
        match write(self, path) {
            Ok(()) => self.facts.doing = Some(format!("saved {}", path.display())),
            Err(error) => self.trouble(&error),
        }
    }

    /// What was picked, and what lies between.
    fn export(&self, extension: &str, path: &Path) -> Result<()> {
        let text = match extension {
            "csv" => self.facts.measure.csv(),
            _ => format!("{:#}\n", self.facts.measure.geojson()),
        };
        whole_file(path, |partial| std::fs::write(partial, text).map_err(|error| Error::io("write", path, error)))
    }

    fn full_screen(&self) {
        if let Some(window) = &self.window {
            let now = window.fullscreen().is_none().then_some(Fullscreen::Borderless(None));
            window.set_fullscreen(now);
        }
    }
}

/// A file in the folder that the program runs in, which does not exist yet.
fn unused_name(extension: &str) -> PathBuf {
    (1..).map(|number| PathBuf::from(format!("pointillist-{number}.{extension}"))).find(|path| !path.exists()).expect("numbers do not end")
}
