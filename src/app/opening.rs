//! OPENING THREAD: files in, a cloud for the drawing thread out, and on the way how far it is.

use super::navigation::Subject;
use crate::cloud::attribute::{Attribute, Further, Shown};
use crate::cloud::counts::Counts;
use crate::cloud::{ReadOptions, Station, Wanted};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::source::{Opening, Prepared, Preview, Source};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A cloud that is read, or found in an index, and needs nothing but the device.
pub struct Opened {
    pub prepared: Prepared,
    pub subject: Subject,
    pub said: Said,
    /// Not a sample, before the whole.
    pub is_whole: bool,
    /// What was to be opened, and to show.
    pub files: Vec<PathBuf>,
    pub color: Option<Attribute>,
}

/// Of a cloud, for the panel and for picks.
pub struct Said {
    /// The files that its points are from.
    pub origins: Vec<PathBuf>,
    pub shown: Shown,
    pub kinds: Kinds,
    /// Of the files, as their headers say while only a sample is there.
    pub points: u64,
    /// Why it shows that.
    pub why_shown: String,
    /// What is odd about the files.
    pub notes: Vec<String>,
}

/// What points can be told apart by, each with how many points are of it, where that is known.
#[derive(Clone, Debug, Default)]
pub struct Kinds {
    pub classes: Vec<(u8, u64)>,
    pub returns: Vec<(u8, u64)>,
    pub stations: Vec<Station>,
}

impl Kinds {
    fn of(source: &Source) -> Kinds {
        let Counts { classes, returns } = source.counts().unwrap_or_default();
        Kinds { classes, returns, stations: source.stations().to_vec() }
    }
}

/// Says a few times a second how far something is; stops where nobody waits for it any more.
pub struct Watch {
    pub abandoned: Arc<AtomicBool>,
    say: Box<dyn Fn(String) + Send + Sync>,
    said: Mutex<Option<Instant>>,
}

const BETWEEN: Duration = Duration::from_millis(100);

impl Watch {
    pub fn new(abandoned: Arc<AtomicBool>, say: impl Fn(String) + Send + Sync + 'static) -> Watch {
        Watch { abandoned, say: Box::new(say), said: Mutex::new(None) }
    }
}

impl Progress for Watch {
    fn tick(&self, doing: &str, done: u64, total: u64) -> Result<()> {
        if self.abandoned.load(Relaxed) {
            return Err(Error::Interrupted);
        }
        let mut said = self.said.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if said.is_none_or(|last| last.elapsed() >= BETWEEN) {
            *said = Some(Instant::now());
            let percent = (100 * done.min(total)).checked_div(total);
            (self.say)(percent.map_or(doing.to_string(), |percent| format!("{doing}: {percent} %")));
        }
        Ok(())
    }
}

/// Opens files on a thread of their own. Where `sampled`, of files that have to be indexed first, or take long to be read, a sample comes before.
pub fn start(
    files: Vec<PathBuf>,
    opening: Opening,
    asked: Option<Attribute>,
    further: Further,
    sampled: bool,
    watch: Watch,
    opened: impl Fn(Result<Opened>) + Send + 'static,
) -> Result<JoinHandle<()>> {
    // People choose while they look.
    let further = Further { kind: true, normal: true, ..further };
    let shown = asked.map_or(Wanted { rgb: true, intensity: true, ..Wanted::default() }, Attribute::wanted);
    let opening = Opening { read: ReadOptions { wanted: shown.and(further.wanted()), ..opening.read }, ..opening };
    let wanted = files.clone();
    let ready = move |mut source: Source, sample_of: Option<u64>, progress: &dyn Progress| -> Result<Opened> {
        source.find(asked, progress)?;
        let (mut shown, why_shown) = source.shown(asked)?;
        let (kinds, subject) = (Kinds::of(&source), Subject::of(source.core_points()));
        shown.further = Further { normal: source.has_normals(), light: source.has_light(), ..further };
        // Of a sample, what is odd about it is said once the whole is there.
        let notes = if sample_of.is_none() { source.notes(shown.further) } else { Vec::new() };
        let said = Said { origins: source.files(), shown, kinds, points: sample_of.unwrap_or(source.points()), why_shown, notes };
        let prepared = source.prepare(shown, progress)?;
        Ok(Opened { prepared, subject, said, is_whole: sample_of.is_none(), files: wanted.clone(), color: asked })
    };
    let work = move || {
        // What is wrong with the files is said once, of the whole.
        if sampled && let Ok(Some(Preview { source, points })) = Source::preview(&files, &opening, &watch) {
            opened(ready(source, Some(points), &watch));
        }
        opened(Source::open(&files, &opening, &watch).and_then(|source| ready(source, None, &watch)));
    };
    let failed = |error: &dyn std::fmt::Display| Error::Request(format!("cannot start a thread to read files: {error}"));
    // Who draws what has been read so far would otherwise wait in one queue with all that is still to be read.
    let pool = rayon::ThreadPoolBuilder::new().build().map_err(|error| failed(&error))?;
    let thread = std::thread::Builder::new().name("opening".into()).spawn(move || pool.install(work));
    thread.map_err(|error| failed(&error))
}
