//! The system's dialog that asks for files.

use super::{App, Event};
use crate::error::Error;
use rfd::AsyncFileDialog;
use std::path::PathBuf;

/// Endings of the files that can be opened.
const ENDINGS: [&str; 16] = [
    "las", "laz", "ply", "e57", "obj", "ptx", "pts", "xyz", "csv", "tsv", "txt", "asc", "xyzrgb",
    "xyzi", "xyzn", "pnti",
];

impl App {
    /// Asks for files to open, on a thread of its own: the window goes on.
    pub(super) fn ask_for_files(&mut self) {
        let Some(window) = self.window.clone().filter(|_| !self.is_choosing) else { return };
        let dialog = AsyncFileDialog::new()
            .set_title("Open point clouds")
            .add_filter("point clouds, and scenes", &[&ENDINGS[..], &["json"]].concat())
            .add_filter("all files", &["*"])
            .set_parent(&*window);
        let (asked, events) = (dialog.pick_files(), self.events.clone());
        let asking = std::thread::Builder::new().name("dialog".into()).spawn(move || {
            let files = pollster::block_on(asked);
            let paths = files.map(|files| files.iter().map(|file| file.path().into()).collect());
            drop(events.send_event(Event::Chosen(paths)));
        });
        match asking {
            Ok(_) => self.is_choosing = true,
            Err(error) => self.report_error(&Error::Request(format!(
                "cannot start a thread for the dialog: {error}; drop files on the window"
            ))),
        }
    }

    /// Opens the files that were chosen; None if no dialog could be shown.
    pub(super) fn chosen(&mut self, files: Option<Vec<PathBuf>>) {
        self.is_choosing = false;
        match files {
            Some(files) => files.into_iter().for_each(|file| self.take(file)),
            // Elsewhere it means that none was chosen.
            None if cfg!(all(unix, not(target_vendor = "apple"))) => {
                self.report_error(&Error::Request(
                    "this desktop has no dialog for files: neither a portal (xdg-desktop-portal) nor zenity answered; drop files on the window, or name them on the command line".into(),
                ));
            }
            None => {}
        }
    }
}
