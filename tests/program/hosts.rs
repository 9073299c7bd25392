//! Hosts that draw clouds into their own pictures: `tools/embed.rs`, `tools/embed_wgpu.rs` and
//! `tools/embed.c`.

use crate::drivers::swiftshader;
use crate::files::scan;
use crate::program::{succeeded, text};
use crate::skip::skip;
use pointillist::synth::SceneKind;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Returns a built example, which lies beside the program.
pub fn example(name: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_BIN_EXE_pointillist")).parent().unwrap().join("examples");
    let path = folder.join(name);
    if !path.exists() {
        skip(&format!("{} is not built; `cargo build --release --examples` does", path.display()));
        return None;
    }
    Some(path)
}

/// Runs a host on a scan. Returns its pixels, red, green and blue.
fn pixels(host: &mut Command, picture: &Path) -> (Output, Vec<[u8; 3]>) {
    let folder = picture.parent().unwrap();
    let cloud = folder.join("torus.las");
    scan(&cloud, SceneKind::Torus, 100_000);
    let output = host.arg(&cloud).arg(picture).output().expect("start the host");
    succeeded(&output);
    let bytes = std::fs::read(picture).unwrap();
    let found = if picture.extension().unwrap() == "png" {
        let decoder = png::Decoder::new(std::io::Cursor::new(bytes));
        let mut reader = decoder.read_info().unwrap();
        let mut rgba = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut rgba).unwrap();
        rgba.chunks(4).map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect()
    } else {
        bytes[b"P6 800 400 255\n".len()..]
            .chunks(3)
            .map(|pixel| pixel.try_into().unwrap())
            .collect()
    };
    (output, found)
}

/// Checks that the host's orange and the cloud hide each other in both halves, and that a point of
/// the torus was picked.
fn check((output, pixels): (Output, Vec<[u8; 3]>)) {
    assert_eq!(pixels.len(), 800 * 400);
    let orange = |pixel: &[u8; 3]| *pixel == [230, 128, 26] || *pixel == [229, 127, 25];
    let grey = |pixel: &[u8; 3]| *pixel == [51, 51, 64];
    for half in 0..2 {
        let inside = |i: &usize| i % 800 / 400 == half;
        let count = |is: &dyn Fn(&[u8; 3]) -> bool| {
            (0..pixels.len()).filter(inside).filter(|&i| is(&pixels[i])).count()
        };
        assert!(count(&orange) > 5000, "{} orange pixels in half {half}", count(&orange));
        let cloud = count(&|pixel| !orange(pixel) && !grey(pixel));
        assert!(cloud > 20_000, "{cloud} pixels of the cloud in half {half}");
    }
    let said = text(&output.stdout);
    let numbers: Vec<f64> = said
        .split(|c: char| !(c.is_ascii_digit() || "+-.e".contains(c)))
        .filter_map(|word| word.parse().ok())
        .collect();
    assert!(said.starts_with("picked") && numbers.len() >= 3, "{said}");
    let [x, y, z] = [numbers[0], numbers[1], numbers[2]];
    let off = ((x.hypot(y) - 1.0).hypot(z) - 0.4).abs();
    assert!(off < 0.01, "a point {off} m off the torus: {said}");
}

#[test]
fn a_host_in_rust_draws_a_triangle_through_a_cloud() {
    let Some(host) = example("embed") else { return };
    let folder = tempfile::tempdir().unwrap();
    check(pixels(&mut Command::new(host), &folder.path().join("picture.png")));
}

/// The hosts in Rust draw the same, one through wgpu.
#[test]
fn a_host_in_wgpu_draws_the_picture_of_the_one_in_vulkan() {
    let [Some(plain), Some(wgpu)] = ["embed", "embed_wgpu"].map(example) else { return };
    let folder = tempfile::tempdir().unwrap();
    let (_, expected) = pixels(&mut Command::new(plain), &folder.path().join("plain.png"));
    let mut wgpu = Command::new(wgpu);
    wgpu.env("VK_INSTANCE_LAYERS", "VK_LAYER_KHRONOS_validation");
    let drawn = pixels(&mut wgpu, &folder.path().join("wgpu.png"));
    let said = text(&drawn.0.stdout) + &text(&drawn.0.stderr);
    assert!(!said.contains("Validation") && !said.contains("VUID"), "{said}");
    let differ = expected.iter().zip(&drawn.1).filter(|(a, b)| a != b).count();
    check(drawn);
    // The compilers of shaders may round the corners differently: pixels at edges.
    assert!(differ <= expected.len() / 1000, "{differ} pixels differ");
}

/// Kernels and host commands are within what both drivers take.
#[test]
fn a_host_on_another_driver_draws_the_same() {
    let (Some(host), Some(driver)) = (example("embed"), swiftshader()) else { return };
    let folder = tempfile::tempdir().unwrap();
    let (_, expected) = pixels(&mut Command::new(&host), &folder.path().join("usual.png"));
    let mut other = Command::new(&host);
    other.env("VK_INSTANCE_LAYERS", "VK_LAYER_KHRONOS_validation");
    other.env("VK_ICD_FILENAMES", driver).env("VK_DRIVER_FILES", driver);
    let drawn = pixels(&mut other, &folder.path().join("other.png"));
    let said = text(&drawn.0.stdout) + &text(&drawn.0.stderr);
    assert!(!said.contains("Validation") && !said.contains("VUID"), "{said}");
    let differ = expected.iter().zip(&drawn.1).filter(|(a, b)| a != b).count();
    check(drawn);
    // The drivers may round the triangle's corners differently.
    println!("{differ} pixels differ");
    assert!(differ <= expected.len() / 1000, "{differ} pixels differ");
}

/// Builds the host in C with what is given. Returns it, unless there is no compiler.
fn built_in_c(folder: &Path, name: &str, libraries: &[&OsStr]) -> Option<Command> {
    let (root, host) = (Path::new(env!("CARGO_MANIFEST_DIR")), folder.join(name));
    let compiler = std::env::var("CC").unwrap_or("cc".into());
    let built = Command::new(&compiler)
        .args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-I"])
        .arg(root.join("include"))
        .arg(root.join("tools/embed.c"))
        .args(libraries)
        .args(["-lvulkan", "-o"])
        .arg(&host)
        .output();
    let Ok(built) = built else {
        skip(&format!("{compiler} is missing"));
        return None;
    };
    succeeded(&built);
    Some(Command::new(host))
}

#[test]
fn a_host_in_c_draws_a_rectangle_through_a_cloud() {
    let Some(library) = example("libpointillist_c.so") else { return };
    let folder = tempfile::tempdir().unwrap();
    let Some(mut host) = built_in_c(folder.path(), "embed", &[library.as_os_str()]) else { return };
    host.env("LD_LIBRARY_PATH", library.parent().unwrap());
    check(pixels(&mut host, &folder.path().join("picture.ppm")));
}

/// Installs into a folder for a package, and builds a host with what pkg-config says of it.
/// Libraries and program are those that are built already: cargo is replaced by a program that does
/// nothing.
#[test]
fn a_host_in_c_is_built_from_what_is_installed() {
    let [Some(shared), Some(archive)] = ["libpointillist_c.so", "libpointillist_c.a"].map(example)
    else {
        return;
    };
    if Command::new("pkg-config").arg("--version").output().is_err() {
        return skip("pkg-config is missing");
    }
    let folder = tempfile::tempdir().unwrap();
    let [bin, built, stage] = ["bin", "target/release", "stage"].map(|at| folder.path().join(at));
    [&bin, &built].into_iter().for_each(|folder| std::fs::create_dir_all(folder).unwrap());
    let cargo = bin.join("cargo");
    std::fs::write(&cargo, "#!/bin/sh\necho \"$@\" >>\"$CARGO_TARGET_DIR/asked\"\n").unwrap();
    std::fs::set_permissions(&cargo, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
    let program = Path::new(env!("CARGO_BIN_EXE_pointillist"));
    for (from, to) in
        [(program, "pointillist"), (&shared, "libpointillist.so"), (&archive, "libpointillist.a")]
    {
        std::fs::copy(from, built.join(to)).unwrap();
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
    let installed = Command::new(root.join("tools/install"))
        .arg("/opt/pointillist")
        .env("DESTDIR", &stage)
        .env("CARGO_TARGET_DIR", built.parent().unwrap())
        .env("PATH", path)
        .output()
        .unwrap();
    succeeded(&installed);
    let asked = std::fs::read_to_string(built.with_file_name("asked")).unwrap();
    assert!(asked.contains("--crate-type cdylib,staticlib"), "{asked}");
    let to = stage.join("opt/pointillist");
    let version = Command::new(to.join("bin/pointillist")).arg("--version").output().unwrap();
    assert!(version.status.success());
    let said = |arguments: &[&str]| {
        let told = Command::new("pkg-config")
            .args(arguments)
            .arg("pointillist")
            .env("PKG_CONFIG_PATH", to.join("lib/pkgconfig"))
            .env("PKG_CONFIG_SYSROOT_DIR", &stage)
            .output()
            .unwrap();
        succeeded(&told);
        text(&told.stdout).trim().to_string()
    };
    assert!(text(&version.stdout).contains(&said(&["--modversion"])), "{version:?}");
    let flags = said(&["--cflags", "--libs"]);
    assert!(flags.contains(stage.to_str().unwrap()), "{flags}");
    let compiler = std::env::var("CC").unwrap_or("cc".into());
    let host = folder.path().join("embed");
    let compiled = Command::new(&compiler)
        .args(["-std=c11", "-Wall", "-Wextra", "-Werror"])
        .arg(root.join("tools/embed.c"))
        .args(flags.split_whitespace())
        .args(["-lvulkan", "-o"])
        .arg(&host)
        .output();
    let Ok(compiled) = compiled else { return skip(&format!("{compiler} is missing")) };
    succeeded(&compiled);
    // Found by the name in the library, which that of the tests lacks.
    let mut host = Command::new(host);
    host.env("LD_LIBRARY_PATH", to.join("lib"));
    check(pixels(&mut host, &folder.path().join("picture.ppm")));
}

/// Links what `Libs.private` of the file for pkg-config names.
#[test]
fn a_host_in_c_may_be_linked_statically() {
    let Some(library) = example("libpointillist_c.a") else { return };
    let install = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/install");
    let install = std::fs::read_to_string(install).unwrap();
    let private = install.lines().find_map(|line| line.strip_prefix("Libs.private: ")).unwrap();
    let mut libraries = vec![library.as_os_str()];
    libraries.extend(private.split(' ').map(OsStr::new));
    let folder = tempfile::tempdir().unwrap();
    let Some(mut host) = built_in_c(folder.path(), "embed", &libraries) else { return };
    check(pixels(&mut host, &folder.path().join("picture.ppm")));
}
