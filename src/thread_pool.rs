//! The threads that work is divided among.
//!
//! A program starts those of its process, once; they stay until it ends. What is part of another
//! program starts [`Workers`] of its own, which end with it.

use crate::error::{Error, Result};
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use std::error::Error as _;
use std::sync::{Mutex, OnceLock, PoisonError};
use std::thread::JoinHandle;

/// Start of the threads of the process, with the reason if it failed.
static OF_PROCESS: OnceLock<Option<String>> = OnceLock::new();

fn failed(error: &dyn std::fmt::Display) -> Error {
    Error::Request(format!(
        "cannot start threads to work with ({error}); end other programs, or allow more processes (ulimit -u)"
    ))
}

/// Starts the threads of the process, once, before the first work: where a system that has no
/// thread left would be a panic.
pub fn start() -> Result<()> {
    let why = OF_PROCESS.get_or_init(|| {
        let started = ThreadPoolBuilder::new().build_global();
        // An error without a source says that there are threads already.
        let error = started.err()?;
        Some(error.source()?.to_string())
    });
    why.as_ref().map_or(Ok(()), |why| Err(failed(why)))
}

/// Threads that end, with all that they do, when they are dropped. Dropping waits for them.
pub struct Workers {
    /// None if the threads are those of the process.
    pool: Option<ThreadPool>,
    threads: Mutex<Vec<JoinHandle<()>>>,
}

impl Workers {
    /// Starts threads, as many as there are cores. Errors if the system has none left.
    pub fn start() -> Result<Workers> {
        let threads = Mutex::<Vec<JoinHandle<()>>>::default();
        let started = ThreadPoolBuilder::new()
            .spawn_handler(|thread| {
                let named = std::thread::Builder::new().name("pointillist work".into());
                let thread = named.spawn(|| thread.run())?;
                threads.lock().unwrap_or_else(PoisonError::into_inner).push(thread);
                Ok(())
            })
            .build();
        // Threads that have started end without a pool.
        let pool = Some(started.map_err(|error: ThreadPoolBuildError| failed(&error))?);
        Ok(Workers { pool, threads })
    }

    /// Returns the threads of the process if a program has started them, else starts others.
    pub fn of_process_or_own() -> Result<Workers> {
        match OF_PROCESS.get() {
            Some(None) => Ok(Workers { pool: None, threads: Mutex::default() }),
            _ => Workers::start(),
        }
    }

    /// Does work that is divided among the threads.
    pub fn run<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        match &self.pool {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }

    /// Returns the number of threads.
    pub fn count(&self) -> usize {
        self.pool.as_ref().map_or_else(rayon::current_num_threads, ThreadPool::current_num_threads)
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        // Without a pool the threads end.
        drop(self.pool.take());
        let threads = self.threads.get_mut().unwrap_or_else(PoisonError::into_inner);
        for thread in threads.drain(..) {
            // Panics of the work were passed on to its caller.
            let _ = thread.join();
        }
    }
}
