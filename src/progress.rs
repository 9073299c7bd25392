//! Progress reports of long work, and its cancellation.
//!
//! A function that may take over a second takes a `&dyn Progress` and calls [`Progress::tick`] a
//! few times a second (per chunk, not per point). If that returns an error, the function removes
//! what it has half written and returns the error at once.

use crate::error::Result;

/// A listener to long work. `cli` shows a bar on a terminal and turns Ctrl-C into
/// [`crate::error::Error::Interrupted`].
pub trait Progress: Sync {
    /// Reports that `done` of `total` units of `doing` ("reading scan.laz") are finished; `total`
    /// is 0 if unknown. Errors if the work is to stop.
    fn tick(&self, doing: &str, done: u64, total: u64) -> Result<()>;

    /// Reports one line about the work: what it found, or what it left out.
    fn note(&self, _line: &str) {}

    /// Registers `act`, to be called on any thread when work is to stop. For work that waits and so
    /// does not tick.
    fn when_interrupted(&self, _act: Box<dyn Fn() + Send>) {}
}

/// Progress of a whole, unaffected by ticks of one of its parts: a frame of a film, a piece of a
/// picture.
pub struct Whole<'p> {
    pub progress: &'p dyn Progress,
    pub doing: &'static str,
    pub done: u64,
    pub total: u64,
}

impl Progress for Whole<'_> {
    fn tick(&self, _doing: &str, _done: u64, _total: u64) -> Result<()> {
        self.progress.tick(self.doing, self.done, self.total)
    }

    fn note(&self, line: &str) {
        self.progress.note(line);
    }

    fn when_interrupted(&self, act: Box<dyn Fn() + Send>) {
        self.progress.when_interrupted(act);
    }
}

/// Progress of a whole, advanced by the ticks of one of its parts.
pub struct Part<'p> {
    pub progress: &'p dyn Progress,
    /// Units of the whole before this part.
    pub done: u64,
    pub total: u64,
}

impl Progress for Part<'_> {
    fn tick(&self, doing: &str, done: u64, _total: u64) -> Result<()> {
        self.progress.tick(doing, self.done + done, self.total)
    }

    fn note(&self, line: &str) {
        self.progress.note(line);
    }
}

/// A listener that ignores everything, for tests and embedding.
pub struct Silent;

impl Progress for Silent {
    fn tick(&self, _doing: &str, _done: u64, _total: u64) -> Result<()> {
        Ok(())
    }
}
