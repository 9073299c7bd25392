//! What is fuzzed: a list of targets, each a reader or a parser with what is done to its results.
//!
//! The driver of `tools/fuzz` and the tests run the same functions. A target returns if an input is
//! refused or read, and panics if something is wrong with what was read.

mod forge;
mod look;
mod readers;
mod seeds;
mod trees;
mod words;

use std::path::{Path, PathBuf};

/// A target.
pub struct Target {
    pub name: &'static str,
    /// Most bytes of an input: what its grammar needs. Longer ones only take longer.
    pub most_bytes: usize,
    /// Reads an input, in a folder of its own.
    pub run: fn(&Path, &[u8]),
    /// Returns the inputs to begin with; files are written to the folder.
    pub seeds: fn(&Path) -> Vec<Vec<u8>>,
    /// Words of the format, which mutations insert.
    pub words: &'static [&'static str],
}

/// All targets.
pub const TARGETS: &[Target] = &[
    Target {
        name: "las",
        most_bytes: 8192,
        run: readers::las,
        seeds: seeds::las,
        words: &["LASF_Spec", "LASF"],
    },
    Target {
        name: "laz",
        most_bytes: 8192,
        run: readers::las,
        seeds: seeds::laz,
        words: &["laszip encoded", "LASF_Spec"],
    },
    Target {
        name: "copc",
        most_bytes: 16384,
        run: readers::copc,
        seeds: seeds::copc,
        words: &["copc", "laszip encoded"],
    },
    Target {
        name: "ply",
        most_bytes: 4096,
        run: readers::ply,
        seeds: seeds::ply,
        words: seeds::PLY_WORDS,
    },
    Target {
        name: "e57",
        most_bytes: 16384,
        run: readers::e57,
        seeds: seeds::e57,
        words: seeds::E57_WORDS,
    },
    Target {
        name: "obj",
        most_bytes: 4096,
        run: readers::obj,
        seeds: seeds::obj,
        words: &["v ", "vn ", "nan", "1e308"],
    },
    Target {
        name: "table",
        most_bytes: 4096,
        run: readers::table,
        seeds: seeds::table,
        words: seeds::TABLE_WORDS,
    },
    Target {
        name: "ptx",
        most_bytes: 4096,
        run: readers::ptx,
        seeds: seeds::ptx,
        words: &["1 0 0 0\n", "nan", "-1e30"],
    },
    Target {
        name: "pts",
        most_bytes: 4096,
        run: readers::pts,
        seeds: seeds::pts,
        words: &["\n", "1e308", "nan"],
    },
    Target {
        name: "potree",
        most_bytes: 16384,
        run: readers::potree,
        seeds: seeds::potree,
        words: seeds::OCTREE_WORDS,
    },
    Target {
        name: "ept",
        most_bytes: 16384,
        run: readers::ept,
        seeds: seeds::ept,
        words: seeds::OCTREE_WORDS,
    },
    Target {
        name: "index",
        most_bytes: 65536,
        run: trees::index,
        seeds: trees::index_seeds,
        words: seeds::INDEX_WORDS,
    },
    Target {
        name: "shadows",
        most_bytes: 32768,
        run: trees::shadows,
        seeds: trees::shadow_seeds,
        words: &["full", "light"],
    },
    Target {
        name: "scene",
        most_bytes: 4096,
        run: words::scene,
        seeds: words::scene_seeds,
        words: words::SCENE_WORDS,
    },
    Target {
        name: "camera",
        most_bytes: 4096,
        run: words::camera,
        seeds: words::camera_seeds,
        words: words::SCENE_WORDS,
    },
    Target {
        name: "path",
        most_bytes: 4096,
        run: words::path,
        seeds: words::path_seeds,
        words: words::SCENE_WORDS,
    },
    Target {
        name: "filter",
        most_bytes: 512,
        run: words::filter,
        seeds: words::filter_seeds,
        words: words::FILTER_WORDS,
    },
    Target {
        name: "option",
        most_bytes: 2048,
        run: words::option,
        seeds: words::option_seeds,
        words: words::OPTION_WORDS,
    },
];

/// Returns the target of this name.
pub fn target(name: &str) -> Option<&'static Target> {
    TARGETS.iter().find(|target| target.name == name)
}

/// Most bytes that reading an input may take beside it (guide: reliability).
pub const MOST_HEAP: usize = 256 << 20;

/// Writes an input to a file of its own.
fn file(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).expect("the fuzzer's folder can be written");
    path
}
