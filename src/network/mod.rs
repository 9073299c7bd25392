//! Clouds on servers: objects at addresses, whose bytes are read by ranges.
//!
//! An address stands in place of a path: `https://host/scan.laz`, `s3://bucket/scan.copc.laz`.
//! Where a file is opened (`cloud::input::Input`) an address becomes an [`Object`], and no reader
//! knows the difference. What a server sends is in blocks of 64 KiB, which `blocks` keeps on the
//! disk; `store` speaks with the server by the `object_store` crate.
//!
//! - A read waits for its blocks. Requests for blocks side by side, or nearly so, are one.
//! - What will be read is requested beforehand ([`Object::ahead`]), many requests at a time.
//! - An object is known by its length and its tag when it was opened. An answer with others is an
//!   error: no picture mixes two versions of a file.
//!
//! Without the feature `network`, addresses are refused.

#[cfg(feature = "network")]
mod blocks;
#[cfg(feature = "network")]
mod object;
#[cfg(feature = "network")]
mod store;

#[cfg(not(feature = "network"))]
#[path = "refused.rs"]
mod object;

pub use object::{Object, release};

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

/// Beginnings of addresses.
pub const SCHEMES: [&str; 5] = ["https://", "http://", "s3://", "gs://", "az://"];

/// Default size of the cache `[bytes]`: a large cloud's nodes near the eye, of a few clouds.
pub const CACHE_BYTES: u64 = 4 << 30;

/// Where blocks are kept.
#[derive(Clone, Debug)]
pub struct Cache {
    /// Folder of all files; `None` for unnamed files that are gone with the process.
    pub folder: Option<PathBuf>,
    /// Most bytes in the folder.
    pub most: u64,
}

static CACHE: Mutex<Option<Cache>> = Mutex::new(None);

/// Sets where blocks are kept, for objects opened from now on. At first that is in unnamed files.
pub fn set_cache(cache: Cache) {
    *CACHE.lock().unwrap_or_else(PoisonError::into_inner) = Some(cache);
}

/// Returns where blocks are kept.
pub fn cache() -> Cache {
    let cache = CACHE.lock().unwrap_or_else(PoisonError::into_inner).clone();
    cache.unwrap_or(Cache { folder: None, most: CACHE_BYTES })
}

/// Requests answered, and bytes of their answers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Traffic {
    pub requests: u64,
    pub bytes: u64,
}

static REQUESTS: AtomicU64 = AtomicU64::new(0);
static BYTES: AtomicU64 = AtomicU64::new(0);

/// Returns the traffic of this process.
pub fn traffic() -> Traffic {
    Traffic { requests: REQUESTS.load(Relaxed), bytes: BYTES.load(Relaxed) }
}

static STOPPED: AtomicBool = AtomicBool::new(false);

/// Ends all waiting for servers with [`crate::error::Error::Interrupted`], from any thread, until
/// [`resume`].
pub fn stop() {
    STOPPED.store(true, Relaxed);
}

/// Allows waiting for servers again.
pub fn resume() {
    STOPPED.store(false, Relaxed);
}

/// Tests whether this is an address on a server.
pub fn is_address(path: &Path) -> bool {
    let text = path.to_str().unwrap_or_default();
    SCHEMES.iter().any(|scheme| text.starts_with(scheme))
}

/// Returns the path that an address `file://` names.
pub fn path_of_file_address(path: &Path) -> Option<PathBuf> {
    let path = path.to_str()?.strip_prefix("file://")?;
    let path = path.strip_prefix("localhost").unwrap_or(path).as_bytes();
    let (mut bytes, mut at) = (Vec::with_capacity(path.len()), 0);
    while let Some(&byte) = path.get(at) {
        let digits = path.get(at + 1..at + 3).filter(|_| byte == b'%');
        let code = digits.and_then(|digits| std::str::from_utf8(digits).ok());
        let code = code.and_then(|digits| u8::from_str_radix(digits, 16).ok());
        bytes.push(code.unwrap_or(byte));
        at += if code.is_some() { 3 } else { 1 };
    }
    Some(String::from_utf8(bytes).ok()?.into())
}

/// Returns an address without what follows `?`, which is no part of a name and may be secret.
pub fn without_query(path: &Path) -> &Path {
    let text = path.to_str().filter(|_| is_address(path)).and_then(|text| text.split('?').next());
    text.map_or(path, Path::new)
}

/// Returns the address of a file beside another one, or below it. What follows `?` stays.
pub fn beside(path: &Path, name: &str) -> PathBuf {
    let Some(text) = path.to_str().filter(|_| is_address(path)) else {
        return path.with_file_name(name);
    };
    let (text, query) = text.split_at(text.find('?').unwrap_or(text.len()));
    let folder = text.rfind('/').map_or(text, |end| &text[..end]);
    format!("{folder}/{name}{query}").into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_told_from_paths() {
        let address = Path::new("https://host:8080/a/ept.json?sig=a/b");
        assert!(is_address(address) && !is_address(Path::new("s3/a.laz")));
        assert_eq!(without_query(address), Path::new("https://host:8080/a/ept.json"));
        let list = beside(address, "ept-data/0-0-0-0.laz");
        assert_eq!(list, Path::new("https://host:8080/a/ept-data/0-0-0-0.laz?sig=a/b"));
        assert_eq!(beside(Path::new("/a/ept.json"), "b/c"), Path::new("/a/b/c"));
        let file = |text: &str| path_of_file_address(Path::new(text));
        assert_eq!(file("file:///a%20b/100%.laz"), Some("/a b/100%.laz".into()));
        assert_eq!(file("file://localhost/a"), Some("/a".into()));
        assert_eq!(file("/a"), None);
    }
}
