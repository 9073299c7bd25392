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

/// Compares what the types say with the package: names, and the parameters of all functions.
#[test]
fn the_types_are_those_of_the_package() {
    let folder = tempfile::tempdir().unwrap();
    let Some(mut python) = python(folder.path()) else { return };
    let types = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/python/pointillist.pyi");
    let ran = python.args(["-c", TYPES]).arg(types).output().unwrap();
    succeeded(&ran);
    let said = text(&ran.stdout);
    println!("{said}");
    assert!(said.trim().parse::<u32>().unwrap() > 10, "{said}");
}

/// Prints how many functions and properties are compared.
const TYPES: &str = r#"
import ast, inspect, sys
import pointillist

tree = ast.parse(open(sys.argv[1]).read())
P = inspect.Parameter

def wanted(node):
    a = node.args
    plain = a.posonlyargs + a.args
    missing = [None] * (len(plain) - len(a.defaults))
    found = [(p.arg, P.POSITIONAL_OR_KEYWORD, d is not None) for p, d in zip(plain, missing + a.defaults)]
    found += [(a.vararg.arg, P.VAR_POSITIONAL, False)] if a.vararg else []
    found += [(p.arg, P.KEYWORD_ONLY, d is not None) for p, d in zip(a.kwonlyargs, a.kw_defaults)]
    found += [(a.kwarg.arg, P.VAR_KEYWORD, False)] if a.kwarg else []
    return [p for p in found if p[0] != "self"]

def given(function):
    parameters = inspect.signature(function).parameters.values()
    return [(p.name, p.kind, p.default is not P.empty) for p in parameters if p.name != "self"]

def compare(name, node, function):
    own, said = given(function), wanted(node)
    # Options are named in the types, and taken by their names.
    if ("options", P.VAR_KEYWORD, False) in own:
        extra = [p for p in said if p not in own]
        assert all(kind == P.KEYWORD_ONLY and has for _, kind, has in extra), (name, extra)
        said = [p for p in said if p not in extra]
    assert own == said, (name, own, said)

def public(names):
    return {name for name in names if not name.startswith("_")}

functions = {n.name: n for n in tree.body if isinstance(n, ast.FunctionDef)}
classes = {n.name: n for n in tree.body if isinstance(n, ast.ClassDef)}
typed = {name for name, n in classes.items() if any(getattr(b, "id", "") == "TypedDict" for b in n.bases)}
assert public(vars(pointillist)) == public(functions) | (public(classes) - typed), vars(pointillist)
count = 0
for name, node in functions.items():
    compare(name, node, getattr(pointillist, name))
    count += 1
for name in set(classes) - typed:
    kind = getattr(pointillist, name)
    members = {n.name: n for n in classes[name].body if isinstance(n, ast.FunctionDef)}
    if issubclass(kind, Exception):
        assert not members
        continue
    assert public(vars(kind)) == public(members), (name, public(vars(kind)) ^ public(members))
    for member, node in members.items():
        own = vars(kind).get(member)
        if member == "__init__":
            compare(name, node, kind)
        elif any(getattr(d, "id", "") == "property" for d in node.decorator_list):
            assert inspect.isgetsetdescriptor(own), member
        else:
            compare(f"{name}.{member}", node, own)
        count += 1
print(count)
"#;

/// Builds a wheel as users do, and imports it.
#[test]
fn a_wheel_is_built_and_imported() {
    let tried = Command::new("maturin").arg("--version").output();
    if !tried.is_ok_and(|tried| tried.status.success()) {
        return skip("maturin is missing; pip install maturin installs it");
    }
    let folder = tempfile::tempdir().unwrap();
    let package = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/python");
    let wheels = folder.path().join("wheels");
    let built = Command::new("maturin")
        .args(["build", "--release", "--offline", "-m"])
        .arg(package.join("Cargo.toml"))
        .arg("-o")
        .arg(&wheels)
        .output();
    succeeded(&built.unwrap());
    let wheel = std::fs::read_dir(&wheels).unwrap().next().unwrap().unwrap().path();
    assert!(wheel.to_str().unwrap().contains("abi3"), "{}", wheel.display());
    let site = folder.path().join("site");
    let unpacked =
        Command::new("python3").args(["-m", "zipfile", "-e"]).args([&wheel, &site]).output();
    succeeded(&unpacked.unwrap());
    let script = "import pointillist; print(pointillist.__file__)";
    let ran =
        Command::new("python3").args(["-c", script]).env("PYTHONPATH", &site).output().unwrap();
    succeeded(&ran);
    assert!(text(&ran.stdout).contains(site.to_str().unwrap()), "{}", text(&ran.stdout));
    assert!(
        site.join("pointillist/__init__.pyi").exists() || site.join("pointillist.pyi").exists()
    );
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
