//! An index of a simulated scan, in a temporary folder that is removed with it.

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
    _folder: Folder,
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
        Ok(Scan { world, index: Arc::new(Index::open(&output)?), source, _folder: folder })
    }
}

const WANTED: ColumnSet = ColumnSet { gps_time: false, ..ColumnSet::ALL };
