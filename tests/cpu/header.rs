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
        .with_config(config)
        .generate()
        .expect("src/c is what cbindgen understands")
        .write(&mut text);
    String::from_utf8(text).expect("text")
}

/// Returns functions of the header, which give a struct as the caller knows it, whatever the size
/// that the library knows.
fn defaults() -> String {
    let source = include_str!("../../src/c/structs.rs");
    let names =
        source.match_indices("pub unsafe extern \"C\" fn pointillist_").map(|(at, found)| {
            let function = &source[at + found.len()..];
            let name = function.split("_init(").next().expect("a name");
            let argument = function.split("*mut ").nth(1).expect("an argument");
            let kind = argument.split(',').next().expect("a type");
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

/// Each struct that begins with its size can be made as the caller knows it.
#[test]
fn every_sized_struct_has_a_default() {
    let header = header();
    let sized = header.split("typedef struct ").filter_map(|found| {
        let (name, members) = found.split_once(" {\n")?;
        let first = members.lines().find(|line| !line.trim_start().starts_with("//"))?;
        (first == "  size_t size;").then_some(name)
    });
    let sized: Vec<&str> = sized.collect();
    assert!(sized.len() >= 9, "{sized:?}");
    for name in sized {
        let count = |what: String| header.matches(&what).count();
        assert_eq!(count(format!("static inline {name} pointillist_")), 1, "{name}");
        assert_eq!(count(format!("_init(struct {name} *to, size_t size);")), 1, "{name}");
    }
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
