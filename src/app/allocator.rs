//! The allocator of a process that runs for long.

/// Smallest array that is returned to the system when it is freed `[bytes]`.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const LEAST: libc::c_int = 1 << 20;

/// Has large arrays returned to the system once they are freed. Otherwise glibc keeps those of up
/// to 32 MiB once one has been freed, and clouds that are loaded again and again leave gaps: the
/// memory of a window grows to three times what it needs (`tools/soak`).
pub fn return_large_arrays() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: it sets a number of the allocator.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, LEAST);
    }
}

/// Returns what lies free between smaller arrays to the system.
pub fn return_gaps() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: it frees only what nothing has.
    unsafe {
        libc::malloc_trim(0);
    }
}
