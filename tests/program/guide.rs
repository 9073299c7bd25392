//! The guide: every page is listed and printed, its commands run, its tables are those measured.
//!
//! Commands in blocks marked `sh` run, with fewer points and small pictures. Blocks marked
//! `console` hold commands that open a window or need large files: their arguments are parsed.

use crate::commands::run;
use crate::program::{failed, pointillist, succeeded, text};
use pointillist::guide::PAGES;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;

const POINTS: &str = "20000";
const SIZE: &str = "160x90";

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn readme() -> String {
    fs::read_to_string(root().join("README.md")).unwrap()
}

/// Returns the lines of all blocks of a page with this mark.
fn lines<'p>(page: &'p str, mark: &str) -> Vec<&'p str> {
    let mut found = Vec::new();
    let mut inside = None;
    for line in page.lines() {
        match (line.strip_prefix("```"), inside) {
            (Some(opened), None) => inside = Some(opened),
            (Some(_), Some(_)) => inside = None,
            (None, Some(opened)) if opened == mark => found.push(line),
            _ => {}
        }
    }
    assert!(inside.is_none(), "a block has no end");
    found
}

/// Returns the arguments of the commands in blocks with this mark, of all pages and the README.
fn commands(mark: &str) -> Vec<Vec<String>> {
    let readme = readme();
    let pages = PAGES.iter().map(|page| page.text).chain([readme.as_str()]);
    let lines = pages.flat_map(|page| lines(page, mark));
    let arguments = lines.filter_map(|line| line.strip_prefix("pointillist "));
    arguments.map(|line| line.split_whitespace().map(String::from).collect()).collect()
}

/// Sets an option, or adds it.
fn set(arguments: &mut Vec<String>, option: &str, value: &str) {
    match arguments.iter().position(|argument| argument == option) {
        Some(at) => arguments[at + 1] = value.into(),
        None => arguments.extend([option.into(), value.into()]),
    }
}

#[test]
fn every_page_is_listed_and_printed() {
    let files = fs::read_dir(root().join("src/guide")).unwrap();
    let files = files.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let files: BTreeSet<String> =
        files.filter_map(|file| file.strip_suffix(".md").map(String::from)).collect();
    let pages: BTreeSet<String> = PAGES.iter().map(|page| page.name.into()).collect();
    assert_eq!(files, pages);

    let listed = run(["guide"]);
    succeeded(&listed);
    for page in PAGES {
        assert!(text(&listed.stdout).contains(page.name), "{} is not listed", page.name);
        let printed = run(["guide", &page.name.replace('_', "-")]);
        succeeded(&printed);
        let comments = |line: &&str| !line.starts_with("<!--");
        let lines: Vec<&str> = page.text.lines().filter(comments).collect();
        assert_eq!(text(&printed.stdout).lines().collect::<Vec<_>>(), lines);
    }
    assert!(failed(&run(["guide", "nothing"]), 1).contains("no page \"nothing\""));
}

#[test]
fn commands_run() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[String]| {
        let done = pointillist().args(arguments).current_dir(folder.path()).output().unwrap();
        assert!(
            done.status.success(),
            "pointillist {}: {}",
            arguments.join(" "),
            text(&done.stderr)
        );
    };
    // Files that pages draw from, which the page before may have made.
    for line in [
        "synth street -o street.laz --camera-out cam.json",
        "synth street -o street.las",
        "synth street -o north.laz",
        "synth street -o south.laz --seed 2",
        "index street.laz -o site.pnti",
    ] {
        let mut arguments: Vec<String> = line.split(' ').map(String::from).collect();
        if arguments[0] == "synth" {
            set(&mut arguments, "--points", POINTS);
        }
        run(&arguments);
    }
    let commands = commands("sh");
    assert!(commands.len() > 30, "{} commands", commands.len());
    for mut arguments in commands {
        let is_truth = arguments.iter().any(|argument| argument == "--truth");
        match arguments[0].as_str() {
            // Maps have the size that their resolution gives.
            "render" if arguments.iter().any(|argument| argument == "--resolution") => {}
            "render" => set(&mut arguments, "--size", SIZE),
            "synth" if is_truth => set(&mut arguments, "--size", SIZE),
            "synth" => set(&mut arguments, "--points", POINTS),
            _ => {}
        }
        run(&arguments);
    }
}

#[test]
fn commands_that_open_a_window_or_need_large_files_are_understood() {
    let commands = commands("console");
    assert!(commands.len() > 10, "{} commands", commands.len());
    for arguments in commands {
        succeeded(&pointillist().args(&arguments).arg("--help").output().unwrap());
    }
}

#[test]
fn the_example_of_an_effect_is_the_effect() {
    let page = PAGES.iter().find(|page| page.name == "adding_an_effect").unwrap();
    let effect = fs::read_to_string(root().join("src/passes/edl.rs")).unwrap();
    let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let begins = page.text.find("pub fn record").expect("the page shows `record`");
    let example = page.text[begins..].split("```").next().unwrap();
    assert!(words(&effect).contains(&words(example)), "src/passes/edl.rs has another `record`");
}

/// Doctests compile both examples, and they are the same.
#[test]
fn the_example_of_the_readme_is_that_of_the_crate() {
    let library = fs::read_to_string(root().join("src/lib.rs")).unwrap();
    let readme = readme();
    let example = lines(&readme, "rust,no_run");
    assert!(example.len() > 10);
    for line in example.iter().filter(|line| !line.starts_with("Ok::")) {
        assert!(library.contains(&format!("\n//! {line}\n")), "the crate's example lacks {line}");
    }
}

/// A cloud in an empty program of another application; doctests compile it.
#[test]
fn the_example_of_embedding_has_at_most_sixty_lines() {
    let page = PAGES.iter().find(|page| page.name == "embedding").unwrap();
    let example = lines(page.text, "no_run");
    let code = |line: &&&str| !line.is_empty() && !line.trim_start().starts_with("//");
    let count = example.iter().filter(code).count();
    assert!((20..=60).contains(&count), "{count} lines");
}

#[test]
fn tables_are_those_that_were_measured() {
    let checked = Command::new("python3").arg(root().join("tools/measure")).arg("--check").output();
    succeeded(&checked.expect("start python3"));
}

#[test]
fn modules_and_files_are_those_that_exist() {
    let library = fs::read_to_string(root().join("src/lib.rs")).unwrap();
    let architecture = PAGES.iter().find(|page| page.name == "architecture").unwrap().text;
    for line in library.lines() {
        if let Some(module) = line.strip_prefix("pub mod ") {
            let module = module.trim_end_matches(';');
            assert!(architecture.contains(&format!("`{module}`")), "architecture lacks {module}");
        }
    }
    let readme = readme();
    for text in PAGES.iter().map(|page| page.text).chain([readme.as_str()]) {
        for path in text.split(['`', '(', ')']) {
            let is_path =
                ["src/", "glsl/", "tests/", "tools/"].iter().any(|at| path.starts_with(at))
                    && !path.contains([' ', '*', '\n'])
                    && !path.contains("NAME");
            assert!(!is_path || root().join(path).exists(), "there is no {path}");
        }
    }
}

/// A stranger reads all of its two pages.
#[test]
fn the_readme_is_short() {
    let readme = readme();
    let count = readme.lines().count();
    assert!(count <= 200, "{count} lines");
    for (number, line) in (1..).zip(readme.lines()) {
        let wide = line.chars().count();
        assert!(wide <= 120, "line {number} has {wide} characters");
    }
}

/// Cases of the numerics page.
const CASES: usize = 31;

/// Returns the tests of each case, by their names, and the files they are in.
fn tests_of_cases() -> Vec<Vec<(String, String)>> {
    let mut found = vec![Vec::new(); CASES];
    let mut folders = vec![root().join("tests"), root().join("src")];
    while let Some(folder) = folders.pop() {
        for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            if path.extension().is_none_or(|extension| extension != "rs") {
                continue;
            }
            let file = path.strip_prefix(root()).unwrap().to_str().unwrap().replace('\\', "/");
            let text = fs::read_to_string(&path).unwrap();
            let names = text.lines().filter_map(|line| line.trim().strip_prefix("fn hard_"));
            for name in names.filter_map(|name| name.split_once('(')).map(|(name, _)| name) {
                let case: usize = name[..2].parse().unwrap();
                if case > 0 {
                    found[case - 1].push((format!("hard_{name}"), file.clone()));
                }
            }
        }
    }
    found.iter_mut().for_each(|tests| tests.sort());
    found
}

#[test]
fn every_case_of_the_numerics_is_listed_with_its_tests() {
    let found = tests_of_cases();
    let mut table = String::from("\n| case | test | file |\n|---|---|---|\n");
    for (k, tests) in found.iter().enumerate() {
        assert!(!tests.is_empty(), "no test is named hard_{:02}_...", k + 1);
        for (name, file) in tests {
            table += &format!("| {} | `{name}` | `{file}` |\n", k + 1);
        }
    }
    let page = root().join("src/guide/numerics.md");
    let text = fs::read_to_string(&page).unwrap();
    let (before, rest) = text.split_once("<!-- tests of the cases -->\n").unwrap();
    let (listed, after) = rest.split_once("\n<!-- end of the tests -->").unwrap();
    if std::env::var_os("POINTILLIST_UPDATE").is_some() {
        let new = format!(
            "{before}<!-- tests of the cases -->\n{table}\n<!-- end of the tests -->{after}"
        );
        return fs::write(&page, new).unwrap();
    }
    assert!(
        listed == table,
        "src/guide/numerics.md lists other tests; POINTILLIST_UPDATE=1 cargo nextest run --release --test program every_case"
    );
}
