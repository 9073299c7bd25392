//! Tests of the program, which draws on a Vulkan device.

#[path = "../support/commands.rs"]
mod commands;
#[path = "../support/exr_file.rs"]
mod exr_file;
#[path = "../support/faulty_layer.rs"]
mod faulty_layer;
#[path = "../support/files.rs"]
mod files;
#[path = "../support/index_file.rs"]
mod index_file;
#[path = "../support/made.rs"]
mod made;
#[path = "../support/octree_files.rs"]
mod octree_files;
#[path = "../support/png_file.rs"]
mod png_file;
#[path = "../support/program.rs"]
mod program;
#[path = "../support/servers.rs"]
mod servers;
#[path = "../support/shared.rs"]
mod shared;
#[path = "../support/skip.rs"]
mod skip;
#[path = "../support/witness.rs"]
mod witness;

mod bad;
mod cli;
mod colors;
mod drivers;
mod export;
mod faults;
mod films;
mod guide;
mod hosts;
mod in_place;
mod indexed;
mod inputs_and_outputs;
mod jobs;
mod lesser_devices;
mod maps;
mod memory;
mod network;
mod pictures;
mod profiles;
mod python;
mod saved_shadows;
mod stations;
mod strays;
mod text_tables;
mod tiled;
mod tuned;
mod vulkan_faults;
