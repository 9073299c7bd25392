//! The load thread: files in; a cloud for the render thread, and progress reports, out.

use super::allocator;
use super::cancel::CancelToken;
use super::navigation::Subject;
use crate::cloud::attribute::{Attribute, DisplayAttribute, ExtraAttributes};
use crate::cloud::crs::Reference;
use crate::cloud::filter::Filter;
use crate::cloud::histograms::Histograms;
use crate::cloud::up::Up;
use crate::cloud::{ColumnSet, ReadOptions, Station};
use crate::error::{Error, Result};
use crate::index::attributes::strokes::StrokeCache;
use crate::progress::Progress;
use crate::render::gpu_cloud::PreparedCloud;
use crate::render::source::{OpenOptions, Preview, Source, bounds_of};
use glam::DVec3;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A cloud that is read, or found in an index, and ready to upload.
pub struct LoadedCloud {
    pub prepared: PreparedCloud,
    pub subject: Subject,
    pub info: CloudInfo,
}

/// Files to load, and what to show of them.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadRequest {
    pub files: Vec<PathBuf>,
    /// The attribute to show; None chooses it automatically.
    pub color: Option<Attribute>,
    pub filter: Filter,
}

/// Facts of a loaded cloud, for the panel and for picks.
pub struct CloudInfo {
    pub request: LoadRequest,
    /// False for a sample that is shown before the whole.
    pub is_whole: bool,
    /// Files that its points come from.
    pub origins: Vec<PathBuf>,
    pub shown: DisplayAttribute,
    pub categories: Categories,
    /// Points of the files; of a sample, as the headers state.
    pub points: u64,
    /// Reason for the displayed attribute.
    pub why_shown: String,
    /// Oddities of the files.
    pub notes: Vec<String>,
}

/// Classes, return numbers and stations of a cloud, with their numbers of points if known.
#[derive(Clone, Debug, Default)]
pub struct Categories {
    pub classes: Vec<(u8, u64)>,
    pub returns: Vec<(u8, u64)>,
    pub stations: Vec<Station>,
    /// Coordinate system and units.
    pub reference: Reference,
    /// The axis that points up.
    pub up: Up,
    /// Bounds without strays: least and greatest (world).
    pub bounds: Option<[DVec3; 2]>,
    /// Attributes that points can show.
    pub attributes: Vec<Attribute>,
}

impl Categories {
    fn of(source: &Source, bounds: Option<[DVec3; 2]>) -> Categories {
        let Histograms { classes, returns } = source.counts().unwrap_or_default();
        Categories {
            classes,
            returns,
            stations: source.stations().to_vec(),
            reference: source.reference(),
            up: source.up(),
            bounds,
            attributes: source.attributes(),
        }
    }
}

/// Reports progress a few times a second, and stops work whose token is cancelled.
pub struct ProgressReporter {
    pub token: CancelToken,
    report: Box<dyn Fn(String) + Send + Sync>,
    reported: Mutex<Option<Instant>>,
}

/// Shortest time between two reports.
const BETWEEN: Duration = Duration::from_millis(100);

impl ProgressReporter {
    pub fn new(
        token: CancelToken,
        report: impl Fn(String) + Send + Sync + 'static,
    ) -> ProgressReporter {
        ProgressReporter { token, report: Box::new(report), reported: Mutex::new(None) }
    }
}

impl Progress for ProgressReporter {
    fn tick(&self, doing: &str, done: u64, total: u64) -> Result<()> {
        if self.token.is_cancelled() {
            return Err(Error::Interrupted);
        }
        let mut reported = self.reported.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if reported.is_none_or(|last| last.elapsed() >= BETWEEN) {
            *reported = Some(Instant::now());
            let percent = (100 * done.min(total)).checked_div(total);
            (self.report)(
                percent.map_or(doing.to_string(), |percent| format!("{doing}: {percent} %")),
            );
        }
        Ok(())
    }

    fn note(&self, line: &str) {
        (self.report)(line.to_string());
    }
}

/// The part of files to load first. An index always has everything: its strokes are stored, or
/// computed node by node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FirstStage {
    /// A sample, if the files have to be indexed or take long to read; then the points.
    Sample,
    /// All points, without strokes, which take long to compute.
    Points,
    /// Everything that is wanted.
    All,
}

/// Loads files on a new thread; calls `loaded` with the sample, if there is one, and with the
/// whole.
pub fn start(
    request: LoadRequest,
    opening: OpenOptions,
    further: ExtraAttributes,
    first: FirstStage,
    found: Arc<StrokeCache>,
    watch: ProgressReporter,
    loaded: impl Fn(Result<LoadedCloud>) + Send + 'static,
) -> Result<JoinHandle<()>> {
    // Filters and lighting can be switched on at any time.
    let further = ExtraAttributes { kind: true, normal: true, ..further };
    let shown = request.color.map_or(
        ColumnSet { rgb: true, intensity: true, ..ColumnSet::default() },
        Attribute::wanted,
    );
    let of_files =
        ExtraAttributes { strokes: further.strokes && first == FirstStage::All, ..further };
    let opening = OpenOptions {
        read: ReadOptions { wanted: shown.and(of_files.wanted()), ..opening.read },
        strokes: of_files.strokes,
        ..opening
    };
    let (files, color) = (request.files.clone(), request.color);
    let ready = move |mut source: Source,
                      sample_of: Option<u64>,
                      progress: &dyn Progress|
          -> Result<LoadedCloud> {
        source.find(color, progress)?;
        let (mut shown, why_shown) = source.shown(color)?;
        let core = source.core_points();
        let categories = Categories::of(&source, bounds_of(&core));
        let subject = Subject::of(core, source.up().axis());
        let further = if let Source::Index(_) = source { further } else { of_files };
        shown.further =
            ExtraAttributes { normal: source.has_normals(), light: source.has_light(), ..further };
        // Notes come with the whole, not with its sample.
        let notes = if sample_of.is_none() { source.notes(shown.further) } else { Vec::new() };
        let (request, is_whole, points) =
            (request.clone(), sample_of.is_none(), sample_of.unwrap_or(source.points()));
        let info = CloudInfo {
            request,
            is_whole,
            origins: source.files(),
            shown,
            categories,
            points,
            why_shown,
            notes,
        };
        Ok(LoadedCloud { prepared: source.prepare(shown, &found, progress)?, subject, info })
    };
    let work = move || {
        // An error is reported once, for the whole.
        if first == FirstStage::Sample
            && let Ok(Some(Preview { source, points })) = Source::preview(&files, &opening, &watch)
        {
            loaded(ready(source, Some(points), &watch));
        }
        loaded(
            Source::open(&files, &opening, &watch).and_then(|source| ready(source, None, &watch)),
        );
        allocator::return_gaps();
    };
    let failed = |error: &dyn std::fmt::Display| {
        Error::Request(format!("cannot start a thread to read files: {error}"))
    };
    // A pool of its own: on the shared one, uploads of the sample would queue behind the reading.
    let pool = rayon::ThreadPoolBuilder::new().build().map_err(|error| failed(&error))?;
    let thread = std::thread::Builder::new().name("load".into()).spawn(move || pool.install(work));
    thread.map_err(|error| failed(&error))
}
