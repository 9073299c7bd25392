//! The Python package: its own tests, and pictures that are those of the program.

use crate::files::scan;
use crate::hosts::example;
use crate::png_file::read_png;
use crate::program::{render, succeeded, text};
use crate::skip::skip;
use pointillist::synth::SceneKind;
use std::path::Path;
use std::process::Command;

/// Returns an interpreter that finds the package in a folder, where it is put; none if there is no
/// Python with NumPy.
fn python(folder: &Path) -> Option<Command> {
    let library = example("libpointillist_python.so")?;
    let tried = Command::new("python3").args(["-c", "import numpy"]).output();
    if !tried.as_ref().is_ok_and(|tried| tried.status.success()) {
        let why = tried.map_or_else(|error| error.to_string(), |tried| text(&tried.stderr));
        let why = why.trim().lines().last().unwrap_or_default();
        skip(&format!("python3 with NumPy is missing ({why}); tools/setup installs it"));
        return None;
    }
    std::fs::copy(library, folder.join("pointillist.abi3.so")).unwrap();
    let mut python = Command::new("python3");
    python.env("PYTHONPATH", folder).env("PYTHONDONTWRITEBYTECODE", "1");
    Some(python)
}

#[test]
fn the_package_passes_its_own_tests() {
    let folder = tempfile::tempdir().unwrap();
    let Some(mut python) = python(folder.path()) else { return };
    let tests = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/python/tests");
    let ran = python.args(["-m", "unittest", "discover"]).arg(tests).output().unwrap();
    let said = succeeded(&ran);
    assert!(said.contains("OK") && !said.contains("skipped"), "{said}");
}

#[test]
fn pictures_are_those_of_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let Some(mut python) = python(folder.path()) else { return };
    let cloud = folder.path().join("torus.las");
    scan(&cloud, SceneKind::Torus, 50_000);
    let cases = [
        ("", ""),
        (
            "--style points --view top --background ffffff",
            "style='points', camera='top', background='ffffff'",
        ),
        (
            "--effect edl=on,strength=2 --effect ao=on --color elevation",
            "effects=['edl=on,strength=2', 'ao=on'], color='elevation'",
        ),
        ("--style strokes --view iso", "style='strokes', camera='iso'"),
        (
            "--clip box:-1,-1,-1,1,1,1 --light direction:1,2,-3 --effect phong=on",
            "clip=['box:-1,-1,-1,1,1,1'], light='direction:1,2,-3', effects=['phong=on']",
        ),
    ];
    let mut script = format!(
        "import pointillist, numpy\nr = pointillist.Renderer()\nr.open({:?})\n",
        cloud.to_str().unwrap()
    );
    for (i, (_, options)) in cases.iter().enumerate() {
        let to = folder.path().join(format!("{i}.raw"));
        script +=
            &format!("r.render(size=(200, 150), {options}).tofile({:?})\n", to.to_str().unwrap());
    }
    let ran = python.args(["-W", "error", "-c", &script]).output().unwrap();
    succeeded(&ran);
    for (i, (options, _)) in cases.iter().enumerate() {
        let png = folder.path().join(format!("{i}.png"));
        let line = format!("-o {} --size 200x150 {options}", png.display());
        succeeded(&render(&cloud, &line));
        let expected = read_png(&png).pixels;
        let found = std::fs::read(folder.path().join(format!("{i}.raw"))).unwrap();
        assert!(found.len() == 4 * 200 * 150);
        assert!(found.chunks(4).zip(&expected).all(|(a, b)| a[..3] == b[..3]), "{options}");
    }
}
