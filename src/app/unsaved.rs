//! What would be lost if the window closed now.

use super::App;
use super::history::same;
use crate::render::scene::Scene;
use crate::view::camera_path::CameraPath;
use glam::DVec3;

/// What is in files, or was there when the window opened.
pub(super) struct Saved {
    pub scene: Scene,
    pub points: Vec<DVec3>,
    pub path: CameraPath,
}

impl App {
    /// Lists what would be lost, and how to save it.
    pub(super) fn unsaved(&self) -> Vec<String> {
        let count = |count: usize, what: &str| {
            format!("{count} {what}{}", if count == 1 { "" } else { "s" })
        };
        let (points, keys) = (self.ui.measure.places(), &self.ui.path.keys);
        let [saves, boxes] = [self.pending_saves.len(), self.scene.clips.0.len()];
        let mut lost = Vec::new();
        if !points.is_empty() && points != self.saved.points {
            lost.push(format!("{}; C saves them", count(points.len(), "picked point")));
        }
        if self.scene.clips != self.saved.scene.clips && boxes > 0 {
            lost.push(format!(
                "{}; F8 saves them with the scene",
                count(boxes, "clip box").replace("boxs", "boxes")
            ));
        } else if !same(&self.scene, &self.saved.scene) {
            lost.push("settings of the scene; F8 saves it".into());
        }
        if !keys.is_empty() && self.ui.path != self.saved.path {
            lost.push(format!("a camera path of {}; F7 saves it", count(keys.len(), "view")));
        }
        if saves > 0 {
            lost.push(format!("{} that are being saved", count(saves, "file")));
        }
        lost
    }

    /// Closes the window, or asks first if something would be lost.
    pub(super) fn close(&mut self) {
        let lost = self.unsaved();
        if lost.is_empty() {
            self.closes = true;
        } else {
            self.ui.asks = lost;
            self.title();
        }
    }
}
