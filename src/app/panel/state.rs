//! State that the panel shows and edits, besides the scene.

use crate::app::load_thread::Categories;
use crate::app::measure::Measure;
use crate::app::navigation::{Mode, NavigationStyle};
use crate::app::profile::Profile;
use crate::app::render_thread::{Loading, Measured, Moving};
use crate::cloud::attribute::DisplayAttribute;
use crate::cloud::filter::Filter;
use crate::cloud::histograms::Histograms;
use crate::output::annotations::Shown;
use crate::passes::EffectDecisions;
use crate::prices::Price;
use crate::render::scene::Scene;
use crate::tune::Limit;
use crate::view::camera_path::CameraPath;
use egui::TextureHandle;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

#[derive(Default)]
pub struct UiState {
    /// Names of the open files.
    pub title: String,
    /// Work in progress, or its last result.
    pub doing: Option<String>,
    /// The last errors, until dismissed.
    pub error: Option<String>,
    /// The error dismissed last; it is not shown again until the next action.
    pub dismissed_error: Option<String>,
    /// Files that were opened before, newest first.
    pub recent: Vec<PathBuf>,
    /// What would be lost, while the window asks whether to close.
    pub asks: Vec<String>,
    /// Numbers of steps that can be undone, and redone.
    pub steps: [usize; 2],
    /// The line of filters.
    pub filter: FilterLine,
    /// Names of the files that the displayed points come from.
    pub files: Vec<String>,
    /// Points of the whole cloud.
    pub points: u64,
    /// Points of the last frame.
    pub drawn: u64,
    /// True if filters may leave out some of these.
    pub at_most: bool,
    pub latency: Duration,
    pub took: Duration,
    /// Device time of every pass `[ms]`.
    pub passes: Vec<(String, f64)>,
    pub decisions: EffectDecisions,
    pub shown: Option<DisplayAttribute>,
    /// Reason for the displayed attribute.
    pub why_shown: String,
    /// Oddities of the files.
    pub notes: Vec<String>,
    /// Settings that have no effect on the last frame, and other notes on it.
    pub picture_notes: Vec<String>,
    /// Tuning of moving pictures.
    pub pace: Pace,
    /// Costs of the effects, once they are asked for.
    pub prices: Vec<Price>,
    /// Loading of an index; None for files.
    pub loading: Option<Loading>,
    /// Bytes read of the index.
    pub bytes_read: u64,
    pub categories: Categories,
    pub mode: Mode,
    pub style: NavigationStyle,
    /// The picked points.
    pub measure: Measure,
    /// Size of saved pictures.
    pub save_size: SaveSize,
    /// Width of profiles `[m]`; 0: by their length.
    pub width: f64,
    pub profile: Option<Profile>,
    /// The camera path.
    pub path: CameraPath,
    /// True if the path is played.
    pub plays: bool,
    /// The part of the panel that is shown.
    pub tab: Tab,
    /// True if the notes are shown.
    pub reads_notes: bool,
    /// True if the list of keys is shown.
    pub help: bool,
    pub panel: PanelState,
}

/// How much of the panel is there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PanelState {
    extent: Extent,
    /// True if the user has chosen it; until then the width of the window decides.
    chosen: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Extent {
    #[default]
    Shown,
    /// A button that shows it.
    Folded,
    /// Nothing is over the picture.
    Hidden,
}

impl PanelState {
    /// Largest share of the window that the panel takes unasked.
    const MOST: f64 = 0.4;

    pub fn is_shown(self) -> bool {
        self.extent == Extent::Shown
    }

    pub fn is_folded(self) -> bool {
        self.extent == Extent::Folded
    }

    /// Folds the panel, or unfolds it, by the share of the window that it takes.
    pub fn fit(&mut self, share: f64) {
        if !self.chosen {
            self.extent = if share > PanelState::MOST { Extent::Folded } else { Extent::Shown };
        }
    }

    /// Shows or hides the panel.
    pub fn toggle(&mut self) {
        self.choose(Extent::Hidden);
    }

    /// Shows or folds the panel.
    pub fn fold(&mut self) {
        self.choose(Extent::Folded);
    }

    fn choose(&mut self, other: Extent) {
        self.extent = if self.is_shown() { other } else { Extent::Shown };
        self.chosen = true;
    }
}

/// Tuning of moving pictures and its cost.
#[derive(Default)]
pub struct Pace {
    /// Their limit; None before there is a device.
    pub limit: Option<Limit>,
    /// Where the front is from.
    pub origin: String,
    /// The last moving frame.
    pub moving: Option<Moving>,
    /// Its errors against the picture that the window has settled on, once it has.
    pub measured: Option<Arc<Measured>>,
    /// Shows the errors of its pixels over that.
    pub shows_errors: bool,
    /// Their colours, while they are shown.
    pub texture: Option<TextureHandle>,
}

/// Filters as text, while they are typed.
#[derive(Default)]
pub struct FilterLine {
    pub text: String,
    /// The filter that the text was made from, or has become.
    pub of: Filter,
    /// Why the text is no filter, or leaves nothing.
    pub error: Option<String>,
}

/// A part of the panel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tab {
    /// How points are drawn.
    #[default]
    Look,
    /// Picked points, and profiles.
    Measure,
    /// Which points are drawn.
    Layers,
}

impl Tab {
    pub const ALL: [(Tab, &str); 3] =
        [(Tab::Look, "Look"), (Tab::Measure, "Measure"), (Tab::Layers, "Layers")];
}

impl UiState {
    /// Forgets an error that no longer holds, shown or dismissed.
    pub fn withdraw_error(&mut self, error: &str) {
        for shown in [&mut self.error, &mut self.dismissed_error] {
            let Some(lines) = shown.take() else { continue };
            let left: Vec<_> = lines.lines().filter(|&line| line != error).collect();
            *shown = (!left.is_empty()).then(|| left.join("\n"));
        }
    }

    /// Closes the question, the error, the notes, the profile or the keys, the first that is there;
    /// false if there is none.
    pub fn dismiss(&mut self) -> bool {
        if !std::mem::take(&mut self.asks).is_empty() {
            return true;
        }
        let was = self.error.take();
        if was.is_none() && self.profile.take().is_some() {
            return true;
        }
        if was.is_none() {
            let read = std::mem::take(&mut self.reads_notes);
            return read || std::mem::take(&mut self.help);
        }
        self.dismissed_error = was;
        true
    }

    /// Returns what annotations name of the displayed cloud, if there is one.
    pub fn named(&self, scene: &Scene) -> Option<Shown> {
        self.shown.map(|shown| named_of(shown, &self.categories, scene))
    }
}

/// Returns what annotations name of a cloud.
pub fn named_of(mut attribute: DisplayAttribute, categories: &Categories, scene: &Scene) -> Shown {
    attribute.scale = scene.scale;
    let Categories { classes, returns, stations, reference, up, bounds, .. } = categories.clone();
    let counts = Histograms { classes, returns };
    Shown { attribute, reference, up, bounds, counts, stations }
}

/// Size of a saved picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SaveSize {
    /// A multiple of the window's size.
    Times(u32),
    /// A size `[px]`.
    To([u32; 2]),
}

impl Default for SaveSize {
    fn default() -> SaveSize {
        SaveSize::Times(1)
    }
}

impl SaveSize {
    /// Returns the size `[px]` for a window of this size.
    pub fn of(self, window: [u32; 2]) -> [u32; 2] {
        match self {
            SaveSize::Times(times) => window.map(|side| side * times),
            SaveSize::To(size) => size,
        }
    }
}
