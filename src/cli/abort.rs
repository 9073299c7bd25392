//! The end of a process that aborts, or whose file may grow no more: nothing is left half written.

const ABORTED: &str = "pointillist: aborted. If memory ran out, free some, or lift `ulimit -v`\n";
const REMOVED: &str = "pointillist: no file was left half written\n";

/// Lets an abort remove partial files and end with exit code 1: an allocation that fails, in Rust
/// or in a driver, aborts. Lets writing beyond `ulimit -f` fail as on a full disk.
pub fn handle_signals() {
    extern "C" fn end(_: libc::c_int) {
        let is_clean = crate::atomic_file::remove_unfinished_at_abort();
        for line in [Some(ABORTED), is_clean.then_some(REMOVED)].into_iter().flatten() {
            // SAFETY: a system call; the text is static.
            unsafe { libc::write(libc::STDERR_FILENO, line.as_ptr().cast(), line.len()) };
        }
        // SAFETY: a system call.
        unsafe { libc::_exit(1) }
    }
    // SAFETY: an action of zeros is the usual one. The thread that aborts runs the handler.
    unsafe {
        let mut action: libc::sigaction = std::mem::zeroed();
        action.sa_sigaction = end as extern "C" fn(libc::c_int) as usize;
        // If it cannot be set, the process ends by the signal.
        libc::sigaction(libc::SIGABRT, &action, std::ptr::null_mut());
        libc::signal(libc::SIGXFSZ, libc::SIG_IGN);
    }
}
