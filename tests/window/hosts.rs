//! A window of GLFW, which shows a cloud by way of the library for C: `tools/embed_window.c`.

use crate::display::Display;
use crate::files::scan;
use crate::png_file::read_png;
use crate::program::succeeded;
use crate::skip::skip;
use pointillist::synth::SceneKind;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

#[test]
fn a_window_of_another_toolkit_shows_a_cloud() {
    let library = Path::new(env!("CARGO_BIN_EXE_pointillist"))
        .with_file_name("examples")
        .join("libpointillist_c.so");
    if !library.exists() {
        return skip("libpointillist_c.so is not built; `cargo build --release --examples` does");
    }
    if !Path::new("/usr/include/GLFW/glfw3.h").exists() {
        return skip("GLFW is missing; tools/setup installs it");
    }
    let (root, folder) = (Path::new(env!("CARGO_MANIFEST_DIR")), tempfile::tempdir().unwrap());
    let host = folder.path().join("embed_window");
    let built = Command::new(std::env::var("CC").unwrap_or("cc".into()))
        .args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-I"])
        .arg(root.join("include"))
        .arg(root.join("tools/embed_window.c"))
        .arg(&library)
        .args(["-lvulkan", "-lglfw", "-o"])
        .arg(&host)
        .output();
    succeeded(&built.expect("a C compiler"));
    let (display, cloud) = (Display::open(), folder.path().join("torus.las"));
    scan(&cloud, SceneKind::Torus, 100_000);
    let mut window = display
        .command("timeout")
        .arg("60")
        .args([&host, &cloud])
        .env("LD_LIBRARY_PATH", library.parent().unwrap())
        .env("VK_INSTANCE_LAYERS", "VK_LAYER_KHRONOS_validation")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(window.stdout.take().unwrap()).lines().map(Result::unwrap);
    let mut said = Vec::new();
    let mut wait_for = |wanted: &str| {
        for line in lines.by_ref() {
            said.push(line);
            if said.last().unwrap().contains(wanted) {
                return said.join("\n");
            }
        }
        panic!("the window ended without {wanted:?}: {}", said.join("\n"));
    };
    wait_for("complete 400 x 300");
    let id = display.xdotool("search --name ^embed$");
    let photograph = |name: &str| {
        let path = folder.path().join(name);
        // The last complete frame may not be on the screen yet.
        std::thread::sleep(std::time::Duration::from_millis(500));
        let mut import = display.command("import");
        let to = format!("png24:{}", path.display());
        assert!(import.args(["-window", &id, "-depth", "8", &to]).status().unwrap().success());
        read_png(&path)
    };
    let colors = |picture: &crate::png_file::Png| {
        picture.pixels.iter().filter(|pixel| **pixel != picture.pixels[0]).count()
    };
    let small = colors(&photograph("small.png"));
    assert!(small > 20_000, "{small} pixels of the cloud");
    // The near side of the ring.
    display.xdotool(&format!("mousemove --window {id} 200 220 click 1"));
    let picked = wait_for("picked");
    let numbers: Vec<f64> = picked.lines().last().unwrap()["picked ".len()..]
        .split(' ')
        .map(|number| number.parse().unwrap())
        .collect();
    let off = ((numbers[0].hypot(numbers[1]) - 1.0).hypot(numbers[2]) - 0.4).abs();
    assert!(off < 0.01, "a point {off} m off the torus: {picked}");
    display.xdotool(&format!("windowsize {id} 640 480"));
    wait_for("complete 640 x 480");
    let large = colors(&photograph("large.png"));
    assert!(large > 2 * small, "{large} pixels after {small}");
    display.xdotool(&format!("windowfocus {id}"));
    display.xdotool("key Escape");
    let rest: Vec<String> = lines.collect();
    assert!(window.wait().unwrap().success());
    let all = [said, rest].concat().join("\n");
    assert!(!all.contains("Validation"), "{all}");
}
