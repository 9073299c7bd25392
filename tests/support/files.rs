//! Scans and folders.

use pointillist::progress::Silent;
use pointillist::synth::{self, LasFile, SceneKind};
use std::path::Path;

/// Writes a scan of an analytic scene.
pub fn scan(path: &Path, scene: SceneKind, points: u64) {
    let world = synth::build(scene, 1, 0.1);
    let mut file = LasFile::create(path, world.lattice(), points).unwrap();
    synth::scan(&world, points, 1, scene.default_noise(), &mut |chunk| file.write(chunk), &Silent)
        .unwrap();
    file.finish().unwrap();
}

/// Returns the sorted names in a folder, hidden ones included.
pub fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}
