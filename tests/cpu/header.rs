//! `include/pointillist.h` is what `src/c` says. With `POINTILLIST_UPDATE=1` it is written.

use std::path::Path;

fn header() -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut config = cbindgen::Config {
        language: cbindgen::Language::C,
        cpp_compat: true,
        include_guard: Some("POINTILLIST_H".into()),
        no_includes: true,
        sys_includes: vec!["stdbool.h".into(), "stddef.h".into(), "stdint.h".into()],
        usize_is_size_t: true,
        documentation_style: cbindgen::DocumentationStyle::C99,
        line_length: 100,
        header: Some(
            "// Point clouds drawn into a Vulkan application's images: docs in the guide, \"embedding\".\n//\n// Structs begin with their size, which their _default function sets: as many bytes as this header\n// knows, so that older hosts run with newer libraries. Every function returns a PointillistResult; on\n// failure, outputs are as they were, and `error`, which may be NULL, has a message. Handles are cast\n// to uint64_t. A renderer is used by one thread at a time."
                .into(),
        ),
        trailer: Some(defaults()),
        ..cbindgen::Config::default()
    };
    // Functions take its numbers as integers.
    config.export.include = vec!["PointillistPreset".into()];
    config.enumeration.prefix_with_name = true;
    config.enumeration.rename_variants = cbindgen::RenameRule::QualifiedScreamingSnakeCase;
    config.enumeration.prefix_with_name = false;
    let mut text = Vec::new();
    cbindgen::Builder::new()
        .with_src(root.join("src/c/mod.rs"))
        .with_src(root.join("src/c/structs.rs"))
        .with_config(config)
        .generate()
        .expect("src/c is what cbindgen understands")
        .write(&mut text);
    String::from_utf8(text).expect("text")
}

/// Returns functions of the header, which give a struct as the caller knows it, whatever the size that
/// the library knows.
fn defaults() -> String {
    let source = include_str!("../../src/c/structs.rs");
    let names = source.match_indices("_init(to: *mut ").map(|(at, found)| {
        let name = source[..at].rsplit("pointillist_").next().expect("a name");
        let kind = source[at + found.len()..].split(',').next().expect("a type");
        format!(
            "static inline {kind} pointillist_{name}_default(void) {{\n  {kind} value;\n  \
             pointillist_{name}_init(&value, sizeof value);\n  return value;\n}}\n"
        )
    });
    let functions: Vec<String> = names.collect();
    format!(
        "#ifndef POINTILLIST_DEFAULTS\n#define POINTILLIST_DEFAULTS\n\n{}\n#endif",
        functions.join("\n")
    )
}

#[test]
fn the_header_is_that_of_the_source() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("include/pointillist.h");
    let header = header();
    if std::env::var_os("POINTILLIST_UPDATE").is_some() {
        std::fs::write(&path, &header).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(found == header, "include/pointillist.h differs; POINTILLIST_UPDATE=1 writes it");
}
