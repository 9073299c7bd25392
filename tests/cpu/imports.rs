//! Module dependencies: the edges that exist, without circles. Some things are confined to few
//! places.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Edges between top-level modules, exactly those that exist; lower modules first.
const EDGES: &[(&str, &[&str])] = &[
    ("network", &[]),
    ("cloud", &["network"]),
    ("gpu", &[]),
    ("graph", &["gpu"]),
    ("guide", &[]),
    ("index", &["cloud", "network"]),
    ("loader", &["cloud", "index"]),
    ("present", &["gpu", "graph"]),
    // Built outside of the library, which it uses as any program does.
    ("python", &[]),
    ("shader", &["gpu"]),
    ("synth", &["cloud"]),
    ("view", &[]),
    ("select", &["cloud", "index", "view"]),
    ("extract", &["cloud", "index", "select", "view"]),
    ("resident", &["cloud", "gpu", "graph", "index", "loader", "select", "view"]),
    ("passes", &["cloud", "gpu", "graph", "index", "resident", "select", "shader", "view"]),
    ("render", &["cloud", "graph", "index", "network", "passes", "resident", "select", "view"]),
    ("tune", &["index", "passes", "render", "select"]),
    (
        "renderer",
        &[
            "cloud", "gpu", "graph", "index", "network", "passes", "render", "resident", "select",
            "shader", "tune", "view",
        ],
    ),
    ("c", &["gpu", "renderer"]),
    ("prices", &["passes", "render", "renderer", "view"]),
    ("output", &["cloud", "graph", "passes", "render", "renderer", "select", "view"]),
    (
        "app",
        &[
            "cloud", "extract", "gpu", "graph", "index", "network", "output", "passes", "present",
            "prices", "render", "renderer", "resident", "select", "tune", "view",
        ],
    ),
    (
        "bench",
        &[
            "app", "cloud", "gpu", "graph", "index", "passes", "render", "renderer", "resident",
            "select", "shader", "synth", "view",
        ],
    ),
    (
        "study",
        &[
            "cloud", "graph", "index", "passes", "render", "resident", "select", "shader", "synth",
            "tune", "view",
        ],
    ),
    (
        "cli",
        &[
            "app", "bench", "cloud", "extract", "gpu", "graph", "guide", "index", "network",
            "output", "passes", "prices", "render", "renderer", "resident", "select", "study",
            "synth", "tune", "view",
        ],
    ),
];

/// Circles between files of a folder that are left to cut.
const CIRCLES: &[&str] = &[
    "app: actions profile render_thread",
    "app: frame_stats scripted_flight",
    "cli: frames render",
    "cli: indexed_info info",
    "cloud/table: heading sniff values",
    "cloud: las point_lookup stream",
    "passes/strokes: brush settings",
    "passes/strokes: quads surface",
    "passes: fill visibility",
    "study: lod popping",
    "synth: airborne scanner terrestrial",
    "synth: material props shapes terrain world",
];

const FOR_ALL: &[&str] = &[
    "error",
    "config",
    "progress",
    "atomic_file",
    "small_file",
    "names",
    "similar",
    "thread_pool",
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Returns the path within `src` of every source, and its code without comments.
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

fn word(character: char) -> bool {
    character.is_alphanumeric() || character == '_'
}

/// Returns the module path of a source.
fn module_path(path: &str) -> Vec<String> {
    let path = path.trim_end_matches(".rs").trim_end_matches("/mod");
    path.split('/').map(str::to_string).collect()
}

/// Returns the paths of a use tree, or of a path within code: `a::{b, c::d}` is `a::b` and
/// `a::c::d`.
fn expand(code: &str) -> Vec<Vec<String>> {
    let code = code.trim_start();
    if let Some(group) = code.strip_prefix('{') {
        let (mut depth, mut start, mut found) = (0, 0, Vec::new());
        for (at, character) in group.char_indices() {
            match character {
                '{' => depth += 1,
                ',' | '}' if depth == 0 => {
                    found.extend(expand(&group[start..at]));
                    if character == '}' {
                        break;
                    }
                    start = at + 1;
                }
                '}' => depth -= 1,
                _ => {}
            }
        }
        return found;
    }
    let name: String = code.chars().take_while(|&c| word(c)).collect();
    match code[name.len()..].strip_prefix("::") {
        _ if name.is_empty() => Vec::new(),
        Some(rest) => {
            let below = expand(rest);
            let below = if below.is_empty() { vec![Vec::new()] } else { below };
            below.into_iter().map(|path| [vec![name.clone()], path].concat()).collect()
        }
        None => vec![vec![name]],
    }
}

/// Returns the modules that a module uses, other than itself.
fn used(own: &[String], code: &str, modules: &BTreeSet<Vec<String>>) -> BTreeSet<Vec<String>> {
    let mut found = BTreeSet::new();
    for start in ["crate::", "super::", "self::"] {
        for (at, _) in code.match_indices(start) {
            if code[..at].ends_with(|c| word(c) || c == ':') {
                continue;
            }
            for path in expand(&code[at..]) {
                let mut target = if start == "crate::" { Vec::new() } else { own.to_vec() };
                for name in path {
                    match name.as_str() {
                        "crate" | "self" => {}
                        "super" => drop(target.pop()),
                        _ => target.push(name),
                    }
                }
                while !target.is_empty() && !modules.contains(&target) {
                    target.pop();
                }
                found.insert(target);
            }
        }
    }
    found.remove(own);
    found
}

/// Returns for each folder which of its files and folders use which others of it, without unit
/// tests.
fn edges() -> BTreeMap<String, BTreeMap<String, BTreeSet<String>>> {
    let sources: BTreeMap<Vec<String>, String> = sources()
        .into_iter()
        .filter(|(path, _)| !matches!(path.as_str(), "lib.rs" | "main.rs"))
        .map(|(path, code)| {
            let code = code.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
            (module_path(&path), code.to_string())
        })
        .collect();
    let modules = sources.keys().cloned().collect();
    let mut edges = BTreeMap::<_, BTreeMap<_, BTreeSet<String>>>::new();
    for (own, code) in &sources {
        edges.entry(String::new()).or_default().entry(own[0].clone()).or_default();
        for other in used(own, code, &modules) {
            let common = own.iter().zip(&other).take_while(|(a, b)| a == b).count();
            if let (Some(from), Some(to)) = (own.get(common), other.get(common)) {
                let folder = edges.entry(own[..common].join("/")).or_default();
                folder.entry(from.clone()).or_default().insert(to.clone());
            }
        }
    }
    edges
}

/// Returns everything that can be reached from a node.
fn reached(edges: &BTreeMap<String, BTreeSet<String>>, from: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let mut open = vec![from.to_string()];
    while let Some(node) = open.pop() {
        for next in edges.get(&node).into_iter().flatten() {
            if found.insert(next.clone()) {
                open.push(next.clone());
            }
        }
    }
    found
}

#[test]
fn groups_of_imports_are_taken_apart() {
    let modules = ["cloud", "cloud/read", "error", "graph", "view"].map(module_path).into();
    let code = "use crate::{cloud::{self, read::{A, b}}, view::View, error}; \
                pub(crate) fn f() { crate::graph::g(); mycrate::not() }";
    let found: Vec<String> =
        used(&["app".into()], code, &modules).iter().map(|path| path.join("/")).collect();
    assert_eq!(found, ["cloud", "cloud/read", "error", "graph", "view"]);
}

#[test]
fn top_level_modules_use_exactly_what_the_table_says() {
    let mut wrong = Vec::new();
    let found = edges().remove("").unwrap_or_default();
    for (own, used) in &found {
        let listed = EDGES.iter().find(|(name, _)| name == own).map(|(_, used)| *used);
        let Some(listed) = listed.or(FOR_ALL.contains(&own.as_str()).then_some(&[])) else {
            wrong.push(format!("{own} is not in EDGES"));
            continue;
        };
        // Modules for all may use each other only.
        let used: BTreeSet<&str> =
            used.iter().map(String::as_str).filter(|name| !FOR_ALL.contains(name)).collect();
        let listed: BTreeSet<&str> = listed.iter().copied().collect();
        wrong.extend(used.difference(&listed).map(|name| format!("{own} uses {name}")));
        wrong.extend(listed.difference(&used).map(|name| format!("{own} does not use {name}")));
    }
    for (at, (own, used)) in EDGES.iter().enumerate() {
        let below = &EDGES[..at];
        let late = used.iter().filter(|name| !below.iter().any(|(earlier, _)| earlier == *name));
        wrong.extend(late.map(|name| format!("{own} stands before {name}")));
    }
    assert!(wrong.is_empty(), "EDGES in tests/cpu/imports.rs:\n{}", wrong.join("\n"));
}

#[test]
fn files_of_a_folder_use_each_other_in_no_circle_but_the_known_ones() {
    let mut found = BTreeSet::new();
    for (folder, edges) in edges() {
        for own in edges.keys() {
            let circle: Vec<String> = edges
                .keys()
                .filter(|other| {
                    reached(&edges, own).contains(*other) && reached(&edges, other).contains(own)
                })
                .cloned()
                .collect();
            if !circle.is_empty() {
                found.insert(format!("{folder}: {}", circle.join(" ")));
            }
        }
    }
    let known: BTreeSet<String> = CIRCLES.iter().map(|circle| circle.to_string()).collect();
    assert_eq!(found, known, "CIRCLES in tests/cpu/imports.rs lists the circles that are left");
}

#[test]
fn unsafe_code_and_vulkan_stay_where_they_are_read_with_care() {
    let has = |code: &str, wanted: &str| code.split(|c| !word(c)).any(|found| found == wanted);
    let device = |path: &str| {
        path.starts_with("gpu/")
            || path.starts_with("present/")
            || matches!(
                path,
                "graph/record.rs" | "graph/host.rs" | "graph/submission.rs" | "present.rs"
            )
    };
    // The host's handles and pointers.
    let host = |path: &str| path.starts_with("renderer/") || path.starts_with("c/");
    // A map of a file, and hints to the system about one.
    let files = |path: &str| matches!(path, "cloud/mmap.rs" | "index/format/writer.rs");
    // A signal, and a setting of the allocator.
    let signal = |path: &str| matches!(path, "cli/abort.rs" | "app/allocator.rs");
    let names_vulkan =
        |path: &str| device(path) || host(path) || path.starts_with("graph/") || path == "error.rs";
    let mut wrong = Vec::new();
    for (path, code) in sources() {
        if has(&code, "unsafe") && !device(&path) && !files(&path) && !host(&path) && !signal(&path)
        {
            wrong.push(format!("src/{path} has unsafe code"));
        }
        if has(&code, "ash") && !names_vulkan(&path) {
            wrong.push(format!("src/{path} names ash"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The program and the window print. The library returns notes, reports to `Progress`, or logs.
#[test]
fn the_library_prints_nothing() {
    let mut wrong = Vec::new();
    for (path, code) in sources() {
        // Standard output is also a file that a user names `-`.
        let prints = path.starts_with("cli/")
            || path.starts_with("app/")
            || ["main.rs", "atomic_file.rs"].contains(&&path[..]);
        let code = code.split("#[cfg(test)]").next().unwrap();
        for printer in ["println!", "print!", "dbg!", "stderr()", "stdout()"] {
            if !prints && code.contains(printer) {
                wrong.push(format!("src/{path} uses {printer}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_shader_has_a_pass() {
    let passes: String = sources()
        .into_iter()
        .filter(|(path, _)| {
            ["passes/", "bench/", "renderer/"].iter().any(|folder| path.starts_with(folder))
        })
        .map(|(_, code)| code)
        .collect();
    let folders = list(&root().join("glsl")).into_iter().filter(|folder| {
        // Includes, and shaders of a host.
        !folder.ends_with("lib") && !folder.ends_with("examples")
    });
    for path in folders.flat_map(|folder| list(&folder)) {
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
