//! Nothing is there twice or unused: shaders and the passes that run them, effects and what belongs
//! to each.

use pointillist::guide::{self, PAGES};
use pointillist::passes::EFFECTS;
use pointillist::study::STUDIES;
use pointillist::tune::KNOBS;
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

/// Returns the text of all files of a folder.
fn text(folder: &str) -> String {
    let read = |path: &PathBuf| String::from_utf8_lossy(&fs::read(path).unwrap()).into_owned();
    files(&root().join(folder)).iter().map(read).collect()
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap().to_str().unwrap().into()
}

#[test]
fn every_included_shader_file_is_included() {
    let shaders = text("glsl");
    for path in files(&root().join("glsl/lib")) {
        let name = path.file_name().unwrap().to_str().unwrap();
        assert!(shaders.contains(&format!("#include \"{name}\"")), "no shader includes {name}");
    }
}

#[test]
fn every_effect_has_a_file_a_twin_a_picture_and_a_line_for_its_user() {
    let readme = fs::read_to_string(root().join("README.md")).unwrap();
    let goldens: Vec<String> =
        files(&root().join("tests/device/golden")).iter().map(|path| stem(path)).collect();
    for effect in EFFECTS {
        assert!(
            root().join(format!("src/passes/{effect}.rs")).is_file(),
            "{effect} has no file in src/passes"
        );
        assert!(
            root().join(format!("src/study/oracle/{effect}.rs")).is_file(),
            "{effect} has no twin in src/study/oracle"
        );
        assert!(
            goldens.iter().any(|golden| golden.contains(effect)),
            "{effect} has no picture in tests/device/golden"
        );
        let line = format!("\n| `{effect}` |");
        assert!(readme.contains(&line), "{effect} is not in README's table of effects");
        let page = guide::page("command_line").unwrap().text;
        assert!(page.contains(&line), "{effect} is not in the guide's table of effects");
    }
}

/// The table, the list in `lib.rs` and the folders agree.
#[test]
fn every_module_is_in_the_crates_documentation() {
    let library = fs::read_to_string(root().join("src/lib.rs")).unwrap();
    let modules =
        library.lines().filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(';'));
    for module in modules {
        assert!(
            library.contains(&format!("`{module}`")),
            "lib.rs does not say what {module} is for"
        );
    }
}

#[test]
fn every_study_is_in_the_guide() {
    let page = guide::page("studies").unwrap().text;
    for (study, _) in STUDIES {
        assert!(page.contains(&format!("`{study}`")), "the guide does not have the study {study}");
    }
}

/// What trades accuracy for time is measured by `tune`, and stands in the guide.
#[test]
fn every_knob_is_in_the_guide_and_sets_an_effect_or_the_cut() {
    let page = guide::page("studies").unwrap().text;
    for knob in &KNOBS {
        assert!(page.contains(&format!("\n| `{}` |", knob.name)), "no row of {}", knob.name);
        let effect = knob.effect();
        assert!(effect.is_none_or(|name| EFFECTS.contains(&name)), "{effect:?} is no effect");
    }
}

/// Comments cite pages as "guide: numerics, case 12".
#[test]
fn what_comments_cite_is_in_the_guide() {
    let sources: String = ["src", "glsl", "tests"].map(text).concat();
    for (at, cited) in sources.match_indices("guide: ") {
        let rest = &sources[at + cited.len()..];
        let word = |c: char| !(c.is_alphanumeric() || c == '_');
        let name = rest.split(word).next().unwrap();
        // The first words of two files, and this test.
        if sources[..at].ends_with("The ") || name.is_empty() {
            continue;
        }
        let page = PAGES.iter().find(|page| page.name == name);
        let page = page.unwrap_or_else(|| panic!("the guide has no page {name}"));
        if let Some(case) = rest.strip_prefix(&format!("{name}, case ")) {
            let case = case.split(word).next().unwrap();
            assert!(page.text.contains(&format!("\n{case}. **")), "no case {case} in {name}");
        }
    }
}

/// Lines with columns, such as those of diagrams, are as wide as they need to be.
#[test]
fn comments_are_plain_and_narrow() {
    const NEVER: [&str; 5] = ["whoever", "nobody", "somebody", "so many", "is said"];
    let mut wrong = Vec::new();
    for path in ["src", "glsl", "tests", "tools"].iter().flat_map(|name| files(&root().join(name)))
    {
        let Ok(text) = fs::read_to_string(&path) else { continue };
        let is_code = path.extension().is_some_and(|kind| {
            ["rs", "c", "comp", "frag", "glsl", "vert"].iter().any(|code| kind == *code)
        });
        for (number, line) in text.lines().enumerate().filter(|_| is_code) {
            let Some(comment) = line.trim_start().strip_prefix("//") else { continue };
            let words = comment.trim_start_matches(['/', '!']).trim_start_matches(' ');
            let has_columns = comment.contains("  ");
            let is_wide = line.chars().count() > 100 && !has_columns;
            let is_odd = NEVER.iter().any(|odd| words.to_lowercase().contains(odd));
            let opens = ["/ Of ", "/ To ", "/ Whether ", " Whether "]
                .iter()
                .any(|odd| comment.starts_with(odd));
            if is_wide || is_odd || opens {
                wrong.push(format!("{}:{}: {line}", path.display(), number + 1));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
