//! Progress on a terminal, and signals that end the program: Ctrl-C, SIGTERM and SIGHUP.

use super::streams;
use crate::error::{Error, Result};
use crate::progress::Progress;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Callbacks of [`Progress::when_interrupted`].
static WAITING: Mutex<Vec<Box<dyn Fn() + Send>>> = Mutex::new(Vec::new());

/// A progress bar for work of over a second, on a terminal only. Turns these signals into an error,
/// so that half-written files are removed.
pub struct Terminal {
    shows: bool,
    since: Instant,
    bar: Mutex<Option<(String, ProgressBar)>>,
}

impl Terminal {
    pub fn new() -> Terminal {
        // If no handler can be set, a signal ends the process at once.
        let _ = ctrlc::set_handler(|| {
            if INTERRUPTED.swap(true, Relaxed) {
                crate::atomic_file::remove_unfinished();
                std::process::exit(130);
            }
            call_waiting();
        });
        super::abort::handle_signals();
        Terminal {
            shows: std::io::stderr().is_terminal(),
            since: Instant::now(),
            bar: Mutex::new(None),
        }
    }
}

fn call_waiting() {
    WAITING.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).iter().for_each(|act| act());
}

impl Default for Terminal {
    fn default() -> Self {
        Terminal::new()
    }
}

impl Progress for Terminal {
    fn tick(&self, doing: &str, done: u64, total: u64) -> Result<()> {
        if INTERRUPTED.load(Relaxed) {
            return Err(Error::Interrupted);
        }
        if !self.shows || self.since.elapsed() < Duration::from_secs(1) {
            return Ok(());
        }
        let mut shown = self.bar.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if shown.as_ref().is_none_or(|(what, _)| what != doing) {
            let bar = ProgressBar::new(total);
            if let Ok(style) =
                ProgressStyle::with_template("{msg} {bar:30} {human_pos}/{human_len} {eta} left")
            {
                bar.set_style(style);
            }
            bar.set_message(doing.to_string());
            // Count the time left from here, and not what was done before the bar appeared.
            bar.set_position(done);
            bar.reset_eta();
            if let Some((_, old)) = shown.replace((doing.to_string(), bar)) {
                old.finish_and_clear();
            }
        }
        if let Some((_, bar)) = shown.as_ref() {
            bar.set_length(total);
            bar.set_position(done);
            if done >= total && total > 0 {
                bar.finish_and_clear();
            }
        }
        Ok(())
    }

    fn note(&self, line: &str) {
        let shown = self.bar.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let print = || streams::say(format_args!("pointillist: {line}"));
        shown.as_ref().map_or_else(print, |(_, bar)| bar.suspend(print));
    }

    fn when_interrupted(&self, act: Box<dyn Fn() + Send>) {
        WAITING.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).push(act);
        // The signal may have come before the callback was registered.
        if INTERRUPTED.load(Relaxed) {
            call_waiting();
        }
    }
}
