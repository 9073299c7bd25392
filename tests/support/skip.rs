//! The list of tests that miss something.

use std::io::Write;
use std::path::Path;

/// Records that this test, or a part of it, is skipped. `tools/test` lists these lines at the end,
/// since test runners hide the output of passing tests.
pub fn skip(why: &str) {
    let thread = std::thread::current();
    let line = format!("skipped: {}: {why}\n", thread.name().unwrap_or("a test"));
    print!("{line}");
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let list = std::fs::create_dir_all(folder).and_then(|()| {
        std::fs::OpenOptions::new().create(true).append(true).open(folder.join("skipped"))
    });
    list.and_then(|mut file| file.write_all(line.as_bytes())).expect("list a skipped test");
}
