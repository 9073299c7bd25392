//! The program, and how it ended.

use std::path::Path;
use std::process::{Command, Output, Stdio};

/// Signals that end a program in an orderly way, with their names.
#[allow(dead_code, reason = "tests of the program use it")]
#[cfg(unix)]
pub const SIGNALS: [(i32, &str); 3] =
    [(libc::SIGINT, "SIGINT"), (libc::SIGTERM, "SIGTERM"), (libc::SIGHUP, "SIGHUP")];

/// Returns the program, without variables of the environment that would change it.
pub fn pointillist() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pointillist"));
    command.env_remove("LP_NUM_THREADS").env("RUST_BACKTRACE", "0").stdin(Stdio::null());
    command
}

/// Runs `render` on a cloud, with the words of `line`.
pub fn render(cloud: &Path, line: &str) -> Output {
    pointillist()
        .arg("render")
        .arg(cloud)
        .args(line.split_whitespace())
        .output()
        .expect("start the program")
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Checks that a run succeeded without a panic. Returns its standard error.
#[track_caller]
pub fn succeeded(output: &Output) -> String {
    let said = text(&output.stderr);
    assert!(output.status.success(), "{}: {said}", output.status);
    assert!(!said.contains("panicked"), "{said}");
    said
}

/// Checks that a run failed with this code and without a panic. Returns its standard error.
#[track_caller]
pub fn failed(output: &Output, code: i32) -> String {
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    if code == 1 {
        assert!(
            said.starts_with("pointillist: ") && said.trim_end().lines().count() == 1,
            "not one line: {said}"
        );
    }
    said
}
