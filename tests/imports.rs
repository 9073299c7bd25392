//! Who may use whom: each module only what stands before it. And what is kept in few places stays there.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Every module and those that stand right before it; what stands before those is allowed too.
const BEFORE: &[(&str, &[&str])] = &[
    ("cloud", &[]),
    ("synth", &["cloud"]),
    ("view", &[]),
    ("index", &["cloud", "view"]),
    ("select", &["index", "view"]),
    ("loader", &["index"]),
    ("gpu", &[]),
    ("graph", &["gpu"]),
    ("shader", &["graph"]),
    ("resident", &["select", "loader", "graph"]),
    ("passes", &["shader", "resident"]),
    ("render", &["passes"]),
    ("present", &["graph"]),
    ("output", &["render"]),
    ("app", &["present", "output"]),
    ("bench", &["app", "synth"]),
    ("study", &["bench"]),
    ("guide", &[]),
    ("cli", &["study", "guide"]),
];

const FOR_ALL: &[&str] = &["error", "config", "progress", "atomic_file"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Path within `src` and code without comments, of every source.
fn sources() -> BTreeMap<String, String> {
    let (mut folders, mut found) = (vec![root().join("src")], BTreeMap::new());
    while let Some(folder) = folders.pop() {
        for path in list(&folder) {
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let text = fs::read_to_string(&path).unwrap();
                let code = text
                    .lines()
                    .map(|line| line.split("//").next().unwrap_or_default())
                    .collect::<Vec<_>>()
                    .join("\n");
                found.insert(
                    path.strip_prefix(root().join("src"))
                        .unwrap()
                        .to_str()
                        .unwrap()
                        .replace('\\', "/"),
                    code,
                );
            }
        }
    }
    found
}

fn list(folder: &Path) -> Vec<PathBuf> {
    fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect()
}

fn module(path: &str) -> &str {
    path.split('/').next().unwrap().trim_end_matches(".rs")
}

fn word(character: char) -> bool {
    character.is_alphanumeric() || character == '_'
}

/// First names after `crate::`, those in braces too.
fn used(code: &str) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for (at, _) in code.match_indices("crate::") {
        if code[..at].ends_with(word) {
            continue;
        }
        let rest = &code[at + "crate::".len()..];
        match rest.strip_prefix('{') {
            None => drop(names.insert(rest.split(|c| !word(c)).next().unwrap().to_string())),
            Some(group) => {
                let (mut depth, mut name) = (0, String::new());
                for character in group.chars() {
                    match character {
                        '{' => depth += 1,
                        '}' if depth == 0 => break,
                        '}' => depth -= 1,
                        ',' if depth == 0 => drop(names.insert(
                            std::mem::take(&mut name).trim().split(':').next().unwrap().to_string(),
                        )),
                        _ if depth == 0 => name.push(character),
                        _ => {}
                    }
                }
                names.insert(name.trim().split(':').next().unwrap().to_string());
            }
        }
    }
    names.remove("");
    names
}

/// Everything that stands before a module.
fn before(module: &str) -> BTreeSet<&'static str> {
    let mut found = BTreeSet::new();
    let mut ask = vec![module];
    while let Some(name) = ask.pop() {
        for &earlier in
            BEFORE.iter().find(|(known, _)| *known == name).map_or(&[][..], |(_, direct)| direct)
        {
            if found.insert(earlier) {
                ask.push(earlier);
            }
        }
    }
    found
}

#[test]
fn groups_of_imports_are_taken_apart() {
    let code = "use crate::{cloud::{self, Cloud}, view::View, error}; pub(crate) fn f() { crate::graph::g(); mycrate::not() }";
    assert_eq!(used(code).into_iter().collect::<Vec<_>>(), ["cloud", "error", "graph", "view"]);
}

#[test]
fn every_module_uses_only_what_stands_before_it() {
    let mut wrong = Vec::new();
    for (path, code) in sources() {
        let own = module(&path);
        if matches!(own, "lib" | "main") {
            continue;
        }
        let allowed = before(own);
        let known = FOR_ALL.contains(&own) || BEFORE.iter().any(|(name, _)| *name == own);
        assert!(
            known,
            "src/{path}: the module {own} has no place in the order; give it one in tests/imports.rs"
        );
        for name in used(&code) {
            // What all may use may use each other only.
            if name != own && !FOR_ALL.contains(&name.as_str()) && !allowed.contains(name.as_str())
            {
                wrong.push(format!("src/{path} uses {name}, which does not stand before {own}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn unsafe_code_and_vulkan_stay_where_they_are_read_with_care() {
    let has = |code: &str, wanted: &str| code.split(|c| !word(c)).any(|found| found == wanted);
    let device = |path: &str| {
        path.starts_with("gpu/")
            || path.starts_with("present/")
            || matches!(path, "graph/record.rs" | "present.rs")
    };
    // A map of a file, and hints to the system about one.
    let files = |path: &str| matches!(path, "index/format/mmap.rs" | "index/format/writer.rs");
    let names_vulkan =
        |path: &str| device(path) || path.starts_with("graph/") || path == "error.rs";
    let mut wrong = Vec::new();
    for (path, code) in sources() {
        if has(&code, "unsafe") && !device(&path) && !files(&path) {
            wrong.push(format!("src/{path} has unsafe code"));
        }
        if has(&code, "ash") && !names_vulkan(&path) {
            wrong.push(format!("src/{path} names ash"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn gpu_and_graph_know_nothing_about_points_and_files_nothing_about_devices() {
    for (path, code) in sources() {
        if matches!(module(&path), "gpu" | "graph") {
            assert!(
                used(&code)
                    .is_disjoint(&["cloud", "index", "view", "resident"].map(String::from).into()),
                "src/{path}"
            );
        }
    }
}

#[test]
fn every_shader_has_a_pass() {
    let passes: String = sources()
        .into_iter()
        .filter(|(path, _)| path.starts_with("passes/") || path.starts_with("bench/"))
        .map(|(_, code)| code)
        .collect();
    for path in list(&root().join("glsl")) {
        let Some(extension) = path.extension().and_then(|extension| extension.to_str()) else {
            continue;
        };
        let name = path.file_stem().unwrap().to_str().unwrap();
        match extension {
            "comp" | "vert" | "frag" => {
                let structure: String =
                    name.split('_').map(|part| part[..1].to_uppercase() + &part[1..]).collect();
                let is_named = passes
                    .match_indices(&format!("shader::{structure}"))
                    .any(|(at, found)| passes[at + found.len()..].starts_with([' ', ',']));
                assert!(is_named, "no pass runs glsl/{name}.{extension}");
            }
            _ => panic!("what is glsl/{name}.{extension}?"),
        }
    }
}
