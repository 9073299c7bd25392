//! Indexes of files that are drawn without one, kept in the user's cache folder.
//!
//! An index is named by a hash of each file's path, length, modification time and contents: of the
//! contents only 64 samples of 16 KiB, because reading a terabyte takes too long. A file edited
//! between the samples, with its length and time kept, is not noticed; nor are changed files of EPT
//! other than the description, the first list and the root. A damaged index is made again.

use super::build::{Options, Summary, build};
use crate::cloud::input::Input;
use crate::cloud::las::octree;
use crate::error::{Error, Result};
use crate::index::format::Index;
use crate::network::without_query;
use crate::progress::Progress;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Format generation: changes whenever an index of the same files would differ.
const GENERATION: u32 = 8;

const SAMPLES: u64 = 64;
const SAMPLE_BYTES: u64 = 16 << 10;

/// Place of cached indexes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CacheLocation {
    Folder(PathBuf),
    /// Made in the system's temporary folder, and gone with the process.
    Temporary,
}

impl CacheLocation {
    /// Returns the user's own cache folder.
    pub fn user_folder() -> Result<CacheLocation> {
        let set = |name: &str| {
            std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from)
        };
        let folder = set("XDG_CACHE_HOME")
            .filter(|path| path.is_absolute())
            .or_else(|| set("HOME").map(|home| home.join(".cache")));
        let folder = folder.ok_or_else(|| {
            Error::Request("no cache folder (neither HOME nor XDG_CACHE_HOME is set); give --cache-dir or --no-cache".into())
        })?;
        Ok(CacheLocation::Folder(folder.join("pointillist")))
    }
}

/// An index, and the summary of its build; `None` if it was found.
pub struct Cached {
    pub index: Index,
    pub made: Option<Summary>,
}

/// Returns whether there is an index of these files, without opening it.
pub fn is_there(paths: &[PathBuf], place: &CacheLocation, options: &Options) -> Result<bool> {
    let CacheLocation::Folder(folder) = place else { return Ok(false) };
    Ok(folder.join(name(paths, options)?).exists())
}

fn name(paths: &[PathBuf], options: &Options) -> Result<String> {
    Ok(format!("{}-{}.pnti", stem(&paths[0]), cache_key(paths, options)?))
}

pub fn find_or_build(
    paths: &[PathBuf],
    place: &CacheLocation,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Cached> {
    let name = name(paths, options)?;
    match place {
        CacheLocation::Folder(folder) => {
            let path = folder.join(name);
            if path.exists() {
                match Index::open(&path) {
                    Ok(index) => return Ok(Cached { index, made: None }),
                    // No message: it is made again.
                    Err(_) => drop(std::fs::remove_file(&path)),
                }
            }
            // Said before files are read.
            writable(folder).map_err(|error| {
                Error::Request(format!(
                    "cannot keep an index in the cache folder {}: {error}; name another with --cache-dir, or keep none with --no-cache",
                    folder.display()
                ))
            })?;
            let made = build(paths, &path, options, progress)?;
            Ok(Cached { index: Index::open(&path)?, made: Some(made) })
        }
        CacheLocation::Temporary => {
            let path =
                std::env::temp_dir().join(format!("pointillist-{}-{name}", std::process::id()));
            let made = build(paths, &path, options, progress)?;
            let index = Index::open(&path);
            // An open file keeps its contents.
            std::fs::remove_file(&path).map_err(|error| Error::io("remove", &path, error))?;
            Ok(Cached { index: index?, made: Some(made) })
        }
    }
}

/// Creates a folder, and tests whether files can be made in it.
fn writable(folder: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let test = folder.join(format!(".pointillist-{}", std::process::id()));
    File::create(&test)?;
    std::fs::remove_file(&test)
}

/// Returns a readable beginning for the name.
fn stem(path: &Path) -> String {
    let stem = without_query(path).file_stem().unwrap_or_default().to_string_lossy();
    stem.chars().filter(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_')).take(40).collect()
}

/// Returns a hash of all that an index depends on.
fn cache_key(paths: &[PathBuf], options: &Options) -> Result<String> {
    let mut hash = blake3::Hasher::new();
    hash.update(&GENERATION.to_le_bytes());
    hash.update(
        format!(
            "{:?} {} {:?} {:?}",
            options.wanted, options.strict, options.text, options.rgb_range
        )
        .as_bytes(),
    );
    add_files(&mut hash, paths)?;
    Ok(hash.finalize().to_hex()[..16].to_string())
}

/// Returns a hash of files: their paths, lengths, times and samples of their contents.
pub fn key_of_files(paths: &[PathBuf]) -> Result<String> {
    let mut hash = blake3::Hasher::new();
    add_files(&mut hash, paths)?;
    Ok(hash.finalize().to_hex()[..16].to_string())
}

fn add_files(hash: &mut blake3::Hasher, paths: &[PathBuf]) -> Result<()> {
    let mut files = Vec::new();
    for path in paths {
        let input = Input::open(path)?;
        match input.tag() {
            // Tags of a server stand for times and contents.
            Some(tag) => {
                let place = without_query(&input.path).display().to_string();
                hash.update(format!("{place} {} {tag}", input.length).as_bytes());
            }
            None => files.extend(octree::files(&input)),
        }
    }
    for path in &files {
        let failed = |error| Error::io("read", path, error);
        let place = path.canonicalize().map_err(failed)?;
        let mut file = File::open(path).map_err(failed)?;
        let metadata = file.metadata().map_err(failed)?;
        hash.update(place.as_os_str().as_encoded_bytes());
        hash.update(&metadata.len().to_le_bytes());
        let changed = metadata
            .modified()
            .ok()
            .and_then(|time| time.duration_since(std::time::UNIX_EPOCH).ok())
            .unwrap_or_default();
        hash.update(&changed.as_nanos().to_le_bytes());
        let mut sample = Vec::new();
        for k in 0..SAMPLES {
            // Evenly from the first bytes to the last.
            let at = metadata.len().saturating_sub(SAMPLE_BYTES) as u128 * k as u128
                / (SAMPLES - 1) as u128;
            sample.clear();
            file.seek(SeekFrom::Start(at as u64)).map_err(failed)?;
            file.by_ref().take(SAMPLE_BYTES).read_to_end(&mut sample).map_err(failed)?;
            hash.update(&sample);
        }
    }
    Ok(())
}
