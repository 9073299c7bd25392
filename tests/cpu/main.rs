//! Tests that need no Vulkan device.

#[path = "../support/ancestors.rs"]
mod ancestors;
#[path = "../support/browser.rs"]
mod browser;
#[path = "../support/cameras.rs"]
mod cameras;
#[path = "../support/commands.rs"]
mod commands;
#[path = "../support/copc_file.rs"]
mod copc_file;
#[path = "../support/files.rs"]
mod files;
#[path = "../fuzz/heap.rs"]
mod fuzz_heap;
#[path = "../fuzz/mutate.rs"]
mod fuzz_mutate;
#[path = "../fuzz/targets/mod.rs"]
mod fuzz_targets;
#[path = "../support/index_file.rs"]
mod index_file;
#[path = "../support/made.rs"]
mod made;
#[path = "../support/octree_files.rs"]
mod octree_files;
#[path = "../support/points.rs"]
mod points;
#[path = "../support/program.rs"]
mod program;
#[path = "../support/shared.rs"]
mod shared;
#[path = "../support/skip.rs"]
mod skip;
#[path = "../support/tree.rs"]
mod tree;

/// Counts the bytes of the heap, for tests that ask.
#[global_allocator]
static HEAP: fuzz_heap::CountingHeap = fuzz_heap::CountingHeap;

mod cloud;
mod copc;
mod cut;
mod damaged_las;
mod export;
mod fuzz;
mod ground;
mod header;
mod imports;
mod index;
mod keys;
mod navigation;
mod octrees;
mod public_api;
mod registry;
mod report;
mod stream;
mod synth;
mod units;
