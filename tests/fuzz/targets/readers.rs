//! Readers of files and folders.

use super::{file, forge, look};
use pointillist::cloud;
use pointillist::index::format::Index;
use pointillist::progress::Silent;
use pointillist::render::source::Source;
use std::path::Path;

pub fn las(folder: &Path, bytes: &[u8]) {
    look::at_file(&file(folder, "a.las", bytes), bytes);
}

pub fn ply(folder: &Path, bytes: &[u8]) {
    look::at_file(&file(folder, "a.ply", bytes), bytes);
}

pub fn e57(folder: &Path, bytes: &[u8]) {
    look::at_file(&file(folder, "a.e57", &forge::e57(bytes)), bytes);
}

pub fn obj(folder: &Path, bytes: &[u8]) {
    look::at_file(&file(folder, "a.obj", bytes), bytes);
}

pub fn table(folder: &Path, bytes: &[u8]) {
    look::at_file(&file(folder, "a.csv", bytes), bytes);
}

pub fn ptx(folder: &Path, bytes: &[u8]) {
    look::at_file(&file(folder, "a.ptx", bytes), bytes);
}

pub fn pts(folder: &Path, bytes: &[u8]) {
    look::at_file(&file(folder, "a.pts", bytes), bytes);
}

pub fn copc(folder: &Path, bytes: &[u8]) {
    at_octree(&file(folder, "a.copc.laz", bytes), bytes);
}

/// Writes the files of an input; those that it lacks are absent.
fn unpack(folder: &Path, names: &[&str], bytes: &[u8]) {
    let files = forge::files(bytes);
    for (k, name) in names.iter().enumerate() {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().expect("in a folder")).expect("a folder");
        match files.get(k) {
            Some(own) => drop(file(folder, name, own)),
            None => drop(std::fs::remove_file(path)),
        }
    }
}

/// Reads a folder of Potree 2: metadata, hierarchy, points.
pub fn potree(folder: &Path, bytes: &[u8]) {
    unpack(folder, &POTREE_FILES, bytes);
    at_octree(&folder.join("metadata.json"), bytes);
}

/// Reads a folder of EPT: its description, its list, and its root in two encodings.
pub fn ept(folder: &Path, bytes: &[u8]) {
    unpack(folder, &EPT_FILES, bytes);
    at_octree(&folder.join("ept.json"), bytes);
}

pub const POTREE_FILES: [&str; 3] = ["metadata.json", "hierarchy.bin", "octree.bin"];
pub const EPT_FILES: [&str; 4] =
    ["ept.json", "ept-hierarchy/0-0-0-0.json", "ept-data/0-0-0-0.bin", "ept-data/0-0-0-0.laz"];

/// Reads an octree whole and in place.
fn at_octree(path: &Path, bytes: &[u8]) {
    look::at_file(path, bytes);
    drop(cloud::sample(&[path.to_owned()], &look::opening().read, 1000, &Silent));
    if let Ok(index) = Index::open_octree(path, None, false) {
        super::trees::walk(&index);
        look::at_source(&Source::Index(index.into()), look::choice(bytes));
    }
}
