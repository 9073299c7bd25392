//! Recent files: a list in the user's state folder, newest first.

use crate::atomic_file::write_atomically;
use crate::error::{Error, Result};
use crate::network::is_address;
use std::path::{Path, PathBuf};

/// Most files in the list.
const MOST: usize = 8;

/// Returns the file with the list, `$XDG_STATE_HOME/pointillist/recent.json`; None if the user has
/// no folder.
fn place() -> Option<PathBuf> {
    let set =
        |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let folder = set("XDG_STATE_HOME")
        .filter(|path| path.is_absolute())
        .or_else(|| set("HOME").map(|home| home.join(".local/state")))
        .or_else(|| set("LOCALAPPDATA"));
    folder.map(|folder| folder.join("pointillist").join("recent.json"))
}

/// Returns the files in the list that are there, and addresses. A list that cannot be read is
/// empty.
pub fn read() -> Vec<PathBuf> {
    let read = |list: PathBuf| serde_json::from_slice(&std::fs::read(list).ok()?).ok();
    let files: Vec<PathBuf> = place().and_then(read).unwrap_or_default();
    files.into_iter().filter(|file| is_address(file) || file.exists()).collect()
}

/// Puts files at the front of the list; returns the list.
pub fn add(files: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let known = read();
    let listed = joined(files, &known);
    if let Some(list) = place().filter(|_| listed != known) {
        write(&list, &listed)?;
    }
    Ok(listed)
}

/// Returns a list with these files at its front. Names that JSON cannot hold are left out.
fn joined(files: &[PathBuf], known: &[PathBuf]) -> Vec<PathBuf> {
    let mut listed: Vec<PathBuf> = Vec::new();
    let whole = files.iter().map(|file| match std::path::absolute(file) {
        Ok(whole) if !is_address(file) => whole,
        _ => file.clone(),
    });
    for file in whole.chain(known.iter().cloned()) {
        if !listed.contains(&file) && file.to_str().is_some() {
            listed.push(file);
        }
    }
    listed.truncate(MOST);
    listed
}

fn write(list: &Path, files: &[PathBuf]) -> Result<()> {
    let folder = list.parent().expect("a file is in a folder");
    std::fs::create_dir_all(folder).map_err(|error| Error::io("create", folder, error))?;
    let text = serde_json::to_string_pretty(files).expect("names are text");
    write_atomically(list, |partial| {
        std::fs::write(partial, text).map_err(|error| Error::io("write", list, error))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_listed_once_and_the_newest_first() {
        let names = |names: &[&str]| names.iter().map(PathBuf::from).collect::<Vec<_>>();
        let known = names(&["/b", "/c"]);
        assert_eq!(joined(&names(&["/a"]), &known), names(&["/a", "/b", "/c"]));
        assert_eq!(joined(&names(&["/c"]), &known), names(&["/c", "/b"]));
        let address = ["s3://bucket/a.copc.laz"];
        assert_eq!(joined(&names(&address), &[]), names(&address));
        let many: Vec<PathBuf> = (0..20).map(|number| format!("/{number}").into()).collect();
        assert_eq!(joined(&many, &known), many[..MOST]);
    }
}
