//! The interface that stays, item by item: `tests/cpu/public_api.txt` shows every change to it.
//! With `POINTILLIST_UPDATE=1` it is written. The interface for C is `include/pointillist.h`.

use std::path::Path;

/// Types of other modules that the interface has, and their files.
const ELSEWHERE: [(&str, &[&str]); 9] = [
    ("cloud/color_scale.rs", &["ColorScale", "Ramp"]),
    ("error.rs", &["Error", "Result"]),
    ("gpu/device.rs", &["DeviceOptions"]),
    ("render/settings.rs", &["RenderSettings", "Style"]),
    ("select/clip.rs", &["Clips", "Clip"]),
    ("select/opacity.rs", &["Opacities"]),
    ("tune/front.rs", &["Limit"]),
    ("view.rs", &["Camera", "Preset", "Projection"]),
    ("view/light.rs", &["Light"]),
];

/// Returns the lines of these types alone.
fn of_types(source: &str, types: &[&str]) -> String {
    let (mut kept, mut is_own) = (String::new(), false);
    for line in source.lines() {
        if line.starts_with(|c: char| c.is_alphabetic()) {
            let head = line.trim_start_matches("pub ").split_once(' ').map_or("", |(_, head)| head);
            let name = head.split(|c: char| !c.is_alphanumeric()).next().unwrap();
            is_own = types.contains(&name) && !line.contains(" for ");
        }
        if is_own {
            kept += &format!("{line}\n");
        }
        is_own &= line != "}";
    }
    kept
}

/// Returns the public items of a source, the variants of public enums, and their fields.
fn items(name: &str, source: &str) -> Vec<String> {
    let code = source.split("#[cfg(test)]").next().unwrap();
    let (mut found, mut within, mut is_own) = (Vec::new(), String::new(), false);
    let mut lines = code.lines();
    let mut was_hidden = false;
    while let Some(line) = lines.next() {
        let words = line.trim();
        let is_hidden = std::mem::replace(&mut was_hidden, words == "#[doc(hidden)]");
        // Fields and functions of a type that is not public are no part of the interface, and what
        // only tests and programs of the crate call is hidden.
        if is_hidden {
            is_own |= line.starts_with("impl ");
            continue;
        }
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
        if !within.is_empty() && line.starts_with("        ") && !words.starts_with(['/', '#']) {
            found.push(format!("{name}: {within}, {}", words.trim_end_matches(',')));
        }
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
    for (name, types) in ELSEWHERE {
        let source = std::fs::read_to_string(root.join("src").join(name)).unwrap();
        let own = of_types(source.split("#[cfg(test)]").next().unwrap(), types);
        let described = own.lines().fold((true, Vec::new()), |(was_described, mut bare), line| {
            let words = line.trim();
            let is_member = line.starts_with("    ")
                && !line.starts_with("     ")
                && (words.starts_with("pub ") || words.starts_with(|c: char| c.is_uppercase()));
            if is_member && !was_described {
                bare.push(words.to_string());
            }
            (words.starts_with("///") || words.starts_with("#[") && was_described, bare)
        });
        assert_eq!(described.1, Vec::<String>::new(), "{name}: not documented");
        let found = items(name, &own);
        let missing = types.iter().find(|of| !found.iter().any(|item| item.contains(*of)));
        assert!(missing.is_none(), "{name} has no {}", missing.unwrap());
        lines.extend(found);
    }
    // What the crate has at its top, and is not hidden.
    let top = std::fs::read_to_string(root.join("src/lib.rs")).unwrap();
    for item in top.split_inclusive(';').map(|item| item.trim().replace('\n', " ")) {
        let is_hidden = item.contains("#[doc(hidden)]");
        if let Some(at) = item.find("pub ").filter(|_| !is_hidden) {
            let words: Vec<&str> = item[at..].split_whitespace().collect();
            lines.push(format!("lib.rs: {}", words.join(" ")));
        }
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
