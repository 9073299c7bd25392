//! Panic isolation for decoding libraries.
//!
//! Third-party decoders index, divide and unwrap on untrusted bytes. A bad file must not end the
//! program, nor print a backtrace over the progress bar. In another application the hook for panics
//! is the application's.

use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};

thread_local! {
    static SILENT: Cell<bool> = const { Cell::new(false) };
}

/// Has the process print nothing of panics that are caught here; for programs of our own, once.
pub fn hide_caught_panics() {
    let outer = panic::take_hook();
    panic::set_hook(Box::new(move |info| {
        if !SILENT.get() {
            outer(info);
        }
    }));
}

/// Runs `call`. A panic inside it is returned as its message.
pub fn catch_panic<T>(call: impl FnOnce() -> T) -> Result<T, String> {
    let before = SILENT.replace(true);
    let result = panic::catch_unwind(AssertUnwindSafe(call));
    SILENT.set(before);
    result.map_err(|payload| {
        let message = payload
            .downcast_ref::<&str>()
            .map(|text| text.to_string())
            .or_else(|| payload.downcast_ref::<String>().cloned());
        format!(
            "the decoder failed: {}",
            message.unwrap_or_default().lines().next().unwrap_or("no reason given")
        )
    })
}
