//! The interface that stays, item by item: `tests/cpu/public_api.txt` shows every change to it.
//! With `POINTILLIST_UPDATE=1` it is written. The interface for C is `include/pointillist.h`.

use std::path::Path;

/// Returns the public items of a source, and the variants of public enums.
fn items(name: &str, source: &str) -> Vec<String> {
    let code = source.split("#[cfg(test)]").next().unwrap();
    let (mut found, mut within, mut is_own) = (Vec::new(), String::new(), false);
    let mut lines = code.lines();
    while let Some(line) = lines.next() {
        let words = line.trim();
        // Fields and functions of a type that is not public are no part of the interface.
        let own_impl = line.strip_prefix("impl ").is_some_and(|of| !is_public(code, of));
        is_own |= own_impl || line.starts_with("pub(super) struct ") && line.ends_with('{');
        if is_own {
            is_own = line != "}";
            continue;
        }
        if line.starts_with("pub enum ") {
            within = words.trim_end_matches(" {").to_string();
        } else if line == "}" {
            within.clear();
        }
        let is_variant = !within.is_empty() && words.starts_with(|c: char| c.is_uppercase());
        if words.starts_with("pub ") || is_variant {
            // A signature may take several lines.
            let mut item = words.to_string();
            while !item.ends_with(['{', ';', ',', '}'])
                || item.matches('(').count() > item.matches(')').count()
            {
                let Some(next) = lines.next() else { break };
                item = format!("{item} {}", next.trim());
            }
            let item = item.trim_end_matches(['{', ',', ' ']).to_string();
            found.push(if is_variant {
                format!("{name}: {within}::{item}")
            } else {
                format!("{name}: {item}")
            });
        }
    }
    found
}

/// Tests whether the type of an impl block is public, or another file's.
fn is_public(code: &str, of: &str) -> bool {
    let name = of.split(|c: char| !c.is_alphanumeric()).next().unwrap();
    !code.contains(&format!("pub(super) struct {name}"))
}

#[test]
fn every_change_to_the_interface_is_seen() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut sources: Vec<_> = std::fs::read_dir(root.join("src/renderer"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .chain([root.join("src/cloud/points.rs")])
        .collect();
    sources.sort();
    let mut lines = Vec::new();
    for path in sources {
        let name = path.strip_prefix(root.join("src")).unwrap().display().to_string();
        lines.extend(items(&name, &std::fs::read_to_string(&path).unwrap()));
    }
    let found = lines.join("\n") + "\n";
    let path = root.join("tests/cpu/public_api.txt");
    if std::env::var_os("POINTILLIST_UPDATE").is_some() {
        std::fs::write(&path, &found).unwrap();
    }
    let listed = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        listed == found,
        "the interface changed; POINTILLIST_UPDATE=1 writes tests/cpu/public_api.txt, whose diff shows how"
    );
}
