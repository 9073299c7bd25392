//! The driver of `tools/fuzz`: libFuzzer, guided by coverage, with the target that TARGET names.
//!
//! `POINTILLIST_FUZZ_SEEDS=FOLDER` writes the seeds of the target there, and its words, prints the
//! most bytes of an input, and ends.

#![no_main]

#[path = "../support/copc_file.rs"]
mod copc_file;
mod heap;
#[path = "../support/made.rs"]
#[allow(dead_code, reason = "tests use the rest")]
mod made;
#[path = "../support/octree_files.rs"]
#[allow(dead_code, reason = "tests use the rest")]
mod octree_files;
#[allow(dead_code, reason = "tests use the rest")]
mod targets;
#[path = "../support/tree.rs"]
#[allow(dead_code, reason = "tests use the rest")]
mod tree;

use std::ffi::{c_char, c_int};
use std::path::Path;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicPtr, Ordering};
use targets::{MOST_HEAP, Target};

#[global_allocator]
static HEAP: heap::CountingHeap = heap::CountingHeap;

/// The target, and the folder of its files.
static CHOSEN: OnceLock<(&Target, tempfile::TempDir)> = OnceLock::new();

/// Gives the handler of faults a stack of its own, without which an input that overflows the stack
/// ends the process without a word. libFuzzer takes the flag over.
fn keep_overflows() {
    const BYTES: usize = 1 << 20;
    /// Known here, so that no sanitizer takes it for lost.
    static ROOM: AtomicPtr<u8> = AtomicPtr::new(std::ptr::null_mut());
    let room = Box::leak(vec![0u8; BYTES].into_boxed_slice()).as_mut_ptr();
    ROOM.store(room, Ordering::Relaxed);
    let stack = libc::stack_t { ss_sp: room.cast(), ss_flags: 0, ss_size: BYTES };
    // SAFETY: the stack is never freed, and an action of zeros is the usual one.
    unsafe {
        assert_eq!(libc::sigaltstack(&stack, std::ptr::null_mut()), 0, "a stack for faults");
        let mut action: libc::sigaction = std::mem::zeroed();
        action.sa_flags = libc::SA_ONSTACK;
        for signal in [libc::SIGSEGV, libc::SIGBUS] {
            let set = libc::sigaction(signal, &action, std::ptr::null_mut());
            assert_eq!(set, 0, "a stack for signal {signal}");
        }
    }
}

/// Ends the process at a panic, with the stack that led there.
fn end_at_panics() {
    let told = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        told(panic);
        std::process::abort();
    }));
}

/// Chooses the target. libFuzzer calls it once, first.
#[unsafe(no_mangle)]
extern "C" fn LLVMFuzzerInitialize(_: *const c_int, _: *const *const *const c_char) -> c_int {
    end_at_panics();
    // Panics of decoders that the readers catch are no faults.
    pointillist::cloud::catch_panic::hide_caught_panics();
    keep_overflows();
    // One thread, so that coverage is of one input.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread();
    pool.build_global().expect("nothing used threads before");
    let name = std::env::var("TARGET").unwrap_or_default();
    let Some(target) = targets::target(&name) else {
        let names: Vec<_> = targets::TARGETS.iter().map(|target| target.name).collect();
        eprintln!("TARGET={name:?} is none of {}", names.join(" "));
        std::process::exit(2);
    };
    // tools/fuzz removes it.
    let folder = tempfile::tempdir().expect("a folder");
    if let Some(output) = std::env::var_os("POINTILLIST_FUZZ_SEEDS") {
        let output = Path::new(&output);
        for (k, seed) in (target.seeds)(folder.path()).iter().enumerate() {
            std::fs::write(output.join(format!("seed-{k}")), seed).expect("seeds");
        }
        std::fs::write(output.with_extension("dict"), dictionary(target)).expect("a dictionary");
        println!("{}", target.most_bytes);
        drop(folder);
        std::process::exit(0);
    }
    drop(CHOSEN.set((target, folder)));
    0
}

/// Returns the words of a target as libFuzzer's dictionary.
fn dictionary(target: &Target) -> String {
    let escaped =
        |word: &str| word.bytes().map(|byte| format!("\\x{byte:02x}")).collect::<String>();
    target.words.iter().map(|word| format!("\"{}\"\n", escaped(word))).collect()
}

/// Runs one input.
///
/// # Safety
///
/// `bytes` are `length` bytes, as libFuzzer passes them.
#[unsafe(no_mangle)]
unsafe extern "C" fn LLVMFuzzerTestOneInput(bytes: *const u8, length: usize) -> c_int {
    // SAFETY: as the caller ensures. libFuzzer passes a pointer even with no bytes.
    let bytes = unsafe { std::slice::from_raw_parts(bytes, length) };
    let (target, folder) = CHOSEN.get().expect("a target was chosen");
    heap::peak();
    (target.run)(folder.path(), bytes);
    let peak = heap::peak();
    assert!(peak < MOST_HEAP, "{} MiB of the heap were taken", peak >> 20);
    0
}
