//! An index of a simulated scan, whose files are removed once it is open.

use super::precision::UTM;
use crate::cloud::ColumnSet;
use crate::error::{Error, Result};
use crate::index::build::{self, Options};
use crate::index::format::Index;
use crate::progress::Progress;
use crate::synth::{self, LasFile, SceneKind, World};
use std::io::ErrorKind;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

pub struct Scan {
    pub world: World,
    pub index: Arc<Index>,
    /// Lattice coordinates of all points as written to the file.
    pub source: Vec<[i32; 3]>,
}

/// A folder that is removed when dropped.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Result<Folder> {
        static NUMBER: AtomicUsize = AtomicUsize::new(0);
        loop {
            let path = std::env::temp_dir().join(format!(
                "pointillist-study-{}-{}",
                std::process::id(),
                NUMBER.fetch_add(1, Relaxed)
            ));
            match std::fs::create_dir(&path) {
                Ok(()) => return Ok(Folder(path)),
                // Left by a killed process with the same id.
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => return Err(Error::io("create", &path, error)),
            }
        }
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        drop(std::fs::remove_dir_all(&self.0));
    }
}

impl Scan {
    /// Builds the index in survey coordinates, as LAS, on a lattice with `step` or the scene's own.
    pub fn new(
        scene: SceneKind,
        step: impl Fn(&World) -> f64,
        points: u64,
        seed: u64,
        progress: &dyn Progress,
    ) -> Result<Scan> {
        let mut world = synth::build(scene, seed, 0.0);
        world.offset = UTM;
        world.step = step(&world);
        let folder = Folder::new()?;
        let [input, output] = ["scan.las", "scan.pnti"].map(|name| folder.0.join(name));
        let mut file = LasFile::create(&input, world.lattice(), points)?;
        let mut source = Vec::with_capacity(points as usize);
        let mut keep = |chunk: &synth::Chunk| {
            source.extend((0..chunk.len()).map(|i| [chunk.x[i], chunk.y[i], chunk.z[i]]));
            file.write(chunk)
        };
        synth::scan(&world, points, seed, scene.default_noise(), &mut keep, progress)?;
        file.finish()?;
        let threads = rayon::current_num_threads();
        build::build(
            &[input],
            &output,
            &Options {
                memory: 1 << 30,
                threads,
                wanted: WANTED,
                strict: true,
                ..Options::usual(true)
            },
            progress,
        )?;
        // It holds its file, so the folder goes now: nothing drops a scan that a static or a thread
        // keeps until the process ends.
        Ok(Scan { world, index: Arc::new(Index::open(&output)?), source })
    }
}

const WANTED: ColumnSet = ColumnSet { gps_time: false, ..ColumnSet::ALL };

#[cfg(test)]
mod tests {
    use super::*;
    use crate::index::format::PLANES;
    use crate::progress::Silent;

    #[test]
    fn a_scan_that_is_never_dropped_leaves_no_file() {
        let scan = Scan::new(SceneKind::Torus, |world| world.step, 2000, 1, &Silent).unwrap();
        let scan = std::mem::ManuallyDrop::new(scan);
        let folder = scan.index.path().parent().unwrap();
        assert!(!folder.exists(), "{} is left", folder.display());
        assert_eq!(scan.source.len(), 2000);
        for number in 0..scan.index.nodes().len() {
            let node = &scan.index.nodes()[number];
            for &(plane, _) in PLANES.iter().filter(|(plane, _)| node.has(*plane)) {
                let mut bytes = vec![0; node.unpacked_bytes(plane) as usize];
                scan.index.read(number, plane, &mut bytes).unwrap();
            }
        }
    }
}
