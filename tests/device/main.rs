//! Tests that open a Vulkan device.

#[path = "../support/ancestors.rs"]
mod ancestors;
#[path = "../support/browser.rs"]
mod browser;
#[path = "../support/cameras.rs"]
mod cameras;
#[path = "../support/copc_file.rs"]
mod copc_file;
#[path = "../support/counting.rs"]
mod counting;
#[path = "../support/exr_file.rs"]
mod exr_file;
#[path = "../support/faulty_layer.rs"]
mod faulty_layer;
#[path = "../support/files.rs"]
mod files;
#[path = "../support/index_file.rs"]
mod index_file;
#[path = "../support/png_file.rs"]
mod png_file;
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

/// Counts the bytes of each thread, for tests that ask.
#[global_allocator]
static HEAP: counting::CountingHeap = counting::CountingHeap;

mod baselines;
mod called_for;
mod clip;
mod derive;
mod embedding;
mod golden;
mod gpu;
mod hard;
mod kernels;
mod layers;
mod load_thread;
mod plan;
mod residency;
mod shadows;
mod strokes;
mod study;
mod styles;
