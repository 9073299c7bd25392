//! A layer between a program and Vulkan that lets calls fail, hides what a device has, and shows a
//! queue family that it has not (`faulty_layer.c`).

use crate::program::{succeeded, text};
use crate::skip::skip;
use std::path::Path;
use std::process::Command;

const NAME: &str = "VK_LAYER_POINTILLIST_faulty";
const VALIDATION: &str = "VK_LAYER_KHRONOS_validation";

/// Folders in which the loader finds the other layers.
const OTHERS: &str = "/usr/share/vulkan/explicit_layer.d:/usr/local/share/vulkan/explicit_layer.d";

/// Where the layer lies among others.
#[allow(dead_code, reason = "each program of tests needs one of them, or both")]
#[derive(Clone, Copy)]
pub enum Layer {
    /// Above validation, which does not see calls that fail.
    AboveValidation,
    /// Below validation, which checks what a device has that has less.
    BelowValidation,
}

/// Builds the layer in a folder. Returns whether it could; records a skipped test otherwise.
pub fn build(folder: &Path) -> bool {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/support/faulty_layer.c");
    let compiler = std::env::var("CC").unwrap_or("cc".into());
    let built = Command::new(&compiler)
        .args([
            "-std=c11",
            "-Wall",
            "-Wextra",
            "-Werror",
            "-shared",
            "-fPIC",
            "-Wl,-z,nodelete",
            "-o",
        ])
        .arg(folder.join("libfaulty.so"))
        .arg(source)
        .output();
    let Ok(built) = built else {
        skip(&format!("{compiler} is missing"));
        return false;
    };
    if text(&built.stderr).contains("vk_layer.h: No such file") {
        skip("Vulkan's headers are missing");
        return false;
    }
    succeeded(&built);
    let manifest = serde_json::json!({
        "file_format_version": "1.1.0",
        "layer": {
            "name": NAME,
            "type": "GLOBAL",
            "library_path": "./libfaulty.so",
            "api_version": "1.3.0",
            "implementation_version": "1",
            "description": "Lets calls fail, and changes what a device has",
        },
    });
    std::fs::write(folder.join("faulty.json"), manifest.to_string()).unwrap();
    true
}

/// Returns the variables of a program that runs on the layer of a folder. Of layers that the
/// environment names, those that are found first are nearest to the program.
pub fn environment(folder: &Path, layer: Layer) -> [(&'static str, String); 2] {
    let own = folder.display();
    let (layers, path) = match layer {
        Layer::AboveValidation => (NAME.into(), format!("{own}:{OTHERS}")),
        Layer::BelowValidation => (format!("{VALIDATION}:{NAME}"), format!("{OTHERS}:{own}")),
    };
    [("VK_INSTANCE_LAYERS", layers), ("VK_LAYER_PATH", path)]
}
