//! The place of a window test: a folder and a display, scans, and the pictures that `render` draws.

use super::{Display, SIZE, Viewer};
use crate::files::scan;
use crate::program::{pointillist, succeeded};
use pointillist::synth::SceneKind;
use std::path::{Path, PathBuf};

/// A folder and a display of its own.
pub struct Place {
    pub folder: tempfile::TempDir,
    pub display: Display,
}

impl Place {
    pub fn new() -> Place {
        Place { folder: tempfile::tempdir().unwrap(), display: Display::open() }
    }

    pub fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a scan to a file of this name.
    pub fn scan(&self, name: &str, scene: SceneKind, points: u64) -> PathBuf {
        let path = self.at(name);
        scan(&path, scene, points);
        path
    }

    pub fn street(&self, points: u64) -> PathBuf {
        self.scan("scan.las", SceneKind::Street, points)
    }

    /// Opens a small window without its panel.
    pub fn view(&self, cloud: &[&Path], line: &str) -> Viewer<'_> {
        Viewer::open(&self.display, self.folder.path(), cloud, line)
    }

    pub fn view_with_panel(&self, cloud: &[&Path], size: [u32; 2], line: &str) -> Viewer<'_> {
        Viewer::with_panel(&self.display, self.folder.path(), cloud, size, line)
    }

    /// Returns what `render` draws, with the window's size unless the line has another.
    #[track_caller]
    pub fn picture(&self, cloud: &[&Path], name: &str, line: &str) -> PathBuf {
        let path = self.at(name);
        let mut command = pointillist();
        let size = format!("--size {}x{} ", SIZE[0], SIZE[1]);
        let line = if line.contains("--size") { line.to_string() } else { size + line };
        command.arg("render").args(cloud).arg("-o").arg(&path).args(line.split_whitespace());
        succeeded(&command.output().unwrap());
        path
    }

    /// Turns the wheel, which draws pictures, until the device is lost and was opened again.
    #[track_caller]
    pub fn loses_device(&self, viewer: &mut Viewer) {
        // The wheel turns in the window below the mouse.
        viewer.until("lost device", |viewer| {
            self.display.xdotool("mousemove 200 150 click 4 click 5");
            viewer
                .said()
                .iter()
                .any(|line| line.contains("DEVICE_LOST") && line.contains("opened again"))
        });
    }

    /// Presses a key, and waits for the file that it saves.
    #[track_caller]
    pub fn saved(&self, viewer: &mut Viewer, key: &str, name: &str) -> PathBuf {
        let path = self.at(name);
        viewer.key(key);
        viewer.until(name, |_| path.exists());
        path
    }

    /// Saves the window's scene, draws it with `render`, and waits until the window shows the same.
    #[track_caller]
    pub fn shows_its_scene(
        &self,
        viewer: &mut Viewer,
        cloud: &[&Path],
        number: usize,
        line: &str,
    ) -> serde_json::Value {
        let scene = self.saved(viewer, "F8", &format!("pointillist-{number}.json"));
        let line = format!("--scene {} {line}", scene.display());
        viewer.shows(&self.picture(cloud, &format!("scene-{number}.png"), &line));
        serde_json::from_str(&std::fs::read_to_string(&scene).unwrap()).unwrap()
    }
}
