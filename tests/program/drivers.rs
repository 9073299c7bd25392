//! A second Vulkan driver, if one is installed, draws the same picture.
//!
//! SwiftShader, in Debian's chromium package, has neither 64-bit atomics nor large texel buffers,
//! so it takes the other variant of every core kernel.

use crate::skip::skip;
use std::path::{Path, PathBuf};
use std::process::Command;

const SWIFTSHADER: &str = "/usr/lib/chromium/vk_swiftshader_icd.json";

/// Returns the second driver, if it is installed.
pub fn swiftshader() -> Option<&'static str> {
    let is_there = Path::new(SWIFTSHADER).exists();
    if !is_there {
        skip(&format!("no driver at {SWIFTSHADER} (in Debian's package chromium)"));
    }
    is_there.then_some(SWIFTSHADER)
}

fn run(arguments: &[&str], driver: Option<&str>) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pointillist"));
    command.args(arguments);
    if let Some(driver) = driver {
        command.env("VK_ICD_FILENAMES", driver).env("VK_DRIVER_FILES", driver);
    }
    let output = command.output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn swiftshader_draws_the_same_bytes() {
    let Some(driver) = swiftshader() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| -> PathBuf { folder.path().join(name) };
    let text = |path: PathBuf| path.to_str().unwrap().to_string();
    let scan = text(path("street.las"));
    let camera = text(path("camera.json"));
    run(&["synth", "street", "-o", &scan, "--points", "200000", "--camera-out", &camera], None);
    for (name, driver) in [("default", None), ("swiftshader", Some(driver))] {
        for style in ["surface", "points"] {
            let (png, exr) = (
                text(path(&format!("{name}.{style}.png"))),
                text(path(&format!("{name}.{style}.exr"))),
            );
            run(
                &[
                    "render", &scan, "-o", &png, "--exr", &exr, "--camera", &camera, "--size",
                    "640x360", "--style", style,
                ],
                driver,
            );
        }
    }
    for kind in ["surface.png", "surface.exr", "points.png", "points.exr"] {
        let read = |name: &str| std::fs::read(path(&format!("{name}.{kind}"))).unwrap();
        assert!(read("default") == read("swiftshader"), "the two drivers' {kind} files differ");
    }
}

/// A driver on top of another interface, such as MoltenVK on Metal, says so in its manifest.
/// Loaders list it only to those who ask for such.
#[test]
fn a_driver_on_top_of_another_interface_is_found() {
    let installed = std::fs::read_dir("/usr/share/vulkan/icd.d").into_iter().flatten().flatten();
    let lavapipe = installed.map(|entry| entry.path()).find(|path| {
        path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("lvp_icd"))
    });
    let Some(lavapipe) = lavapipe else { return skip("no lavapipe in /usr/share/vulkan/icd.d") };
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let words = std::fs::read_to_string(lavapipe).unwrap();
    let mut manifest: serde_json::Value = serde_json::from_str(&words).unwrap();
    manifest["file_format_version"] = "1.0.1".into();
    manifest["ICD"]["is_portability_driver"] = true.into();
    std::fs::write(path("driver.json"), manifest.to_string()).unwrap();
    run(&["synth", "sphere", "-o", &path("scan.las"), "--points", "1000"], None);
    let render = ["render", &path("scan.las"), "-o", &path("a.png"), "--size", "64x64"];
    run(&render, Some(&path("driver.json")));
}
