//! Tests of windows. They need Xvfb, xdotool and ImageMagick, which `tools/setup` installs.

#[path = "../support/exr_file.rs"]
mod exr_file;
#[path = "../support/faulty_layer.rs"]
mod faulty_layer;
#[path = "../support/files.rs"]
mod files;
#[path = "../support/png_file.rs"]
mod png_file;
#[path = "../support/points.rs"]
mod points;
#[path = "../support/program.rs"]
mod program;
#[allow(dead_code, reason = "tests of the program use the rest")]
#[path = "../support/servers.rs"]
mod servers;
#[path = "../support/skip.rs"]
mod skip;
#[path = "../support/tree.rs"]
mod tree;

mod display;
mod hosts;
mod pace;
mod panel;
mod presentation;
mod server;
mod vulkan_faults;
mod window;
mod window_lifecycle;
