//! The end of a process that aborts: no file is left half written.

/// The message after an abort, below that of the code that aborted.
const ABORTED: &str = "pointillist: stopped where memory ran out or a library gave up, as said above; \
     nothing was left half written. Free memory, or lift `ulimit -v`\n";

/// Ends an aborting process as any other that could not do its work: an allocation that fails, in Rust
/// or in a driver, aborts.
pub fn end_orderly() {
    extern "C" fn end(_: libc::c_int) {
        crate::atomic_file::remove_unfinished_at_abort();
        // SAFETY: two system calls; the text is static.
        unsafe {
            libc::write(libc::STDERR_FILENO, ABORTED.as_ptr().cast(), ABORTED.len());
            libc::_exit(1);
        }
    }
    // SAFETY: an action of zeros is the usual one. The thread that aborts runs the handler, outside
    // of the allocator, which has returned.
    unsafe {
        let mut action: libc::sigaction = std::mem::zeroed();
        action.sa_sigaction = end as extern "C" fn(libc::c_int) as usize;
        // If it cannot be set, the process ends by the signal.
        libc::sigaction(libc::SIGABRT, &action, std::ptr::null_mut());
    }
}
