//! Long work tells how far it is, and is told when to stop.
//!
//! Whoever does something that may take over a second takes a `&dyn Progress`, calls [`Progress::tick`] a few times a second
//! (a chunk, not a point), and returns its error at once after removing what it had half written.

use crate::error::Result;

/// A listener for long work. `cli` shows a bar on a terminal and turns Ctrl-C into [`crate::error::Error::Interrupted`].
pub trait Progress: Sync {
    /// `done` of `total` units of `doing` ("reading scan.laz") are finished; `total` 0 means it is not known.
    fn tick(&self, doing: &str, done: u64, total: u64) -> Result<()>;

    /// Calls `act`, on any thread, when it is to stop: for who waits, and so does not tick. A listener that never stops anything never calls it.
    fn when_interrupted(&self, _act: Box<dyn Fn() + Send>) {}
}

/// How far a whole is, whatever is being done for one of its parts: a film's frame, a picture's piece.
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

    fn when_interrupted(&self, act: Box<dyn Fn() + Send>) {
        self.progress.when_interrupted(act);
    }
}

/// How far a whole is, whatever it is called, by how far one of its parts is.
pub struct Part<'p> {
    pub progress: &'p dyn Progress,
    /// Before it, and of the whole.
    pub done: u64,
    pub total: u64,
}

impl Progress for Part<'_> {
    fn tick(&self, doing: &str, done: u64, _total: u64) -> Result<()> {
        self.progress.tick(doing, self.done + done, self.total)
    }
}

/// Listens to nothing: for tests, and for embedding.
pub struct Silent;

impl Progress for Silent {
    fn tick(&self, _doing: &str, _done: u64, _total: u64) -> Result<()> {
        Ok(())
    }
}
