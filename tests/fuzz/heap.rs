//! A heap that counts what each thread takes at most.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// The system's heap, whose bytes are counted.
pub struct CountingHeap;

thread_local! {
    /// Bytes that this thread has allocated and not freed, and the most since [`peak`].
    static BYTES: Cell<[isize; 2]> = const { Cell::new([0; 2]) };
}

/// Returns the most bytes that this thread had since the last call, beyond those it has now.
pub fn peak() -> usize {
    let [live, peak] = BYTES.replace([BYTES.get()[0]; 2]);
    usize::try_from(peak - live).unwrap_or(0)
}

fn add(bytes: isize) {
    // A thread that ends counts no more.
    let _ = BYTES.try_with(|counted| {
        let [live, peak] = counted.get();
        counted.set([live + bytes, peak.max(live + bytes)]);
    });
}

// SAFETY: the system's heap does all the work.
unsafe impl GlobalAlloc for CountingHeap {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        add(layout.size() as isize);
        // SAFETY: as the caller ensures.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        add(layout.size() as isize);
        // SAFETY: as the caller ensures.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        add(-(layout.size() as isize));
        // SAFETY: as the caller ensures.
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, bytes: usize) -> *mut u8 {
        add(bytes as isize - layout.size() as isize);
        // SAFETY: as the caller ensures.
        unsafe { System.realloc(at, layout, bytes) }
    }
}
