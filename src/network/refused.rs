//! Objects where the program is built without the feature `network`: there are none.

use crate::error::{Error, Result};
use crate::progress::Progress;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub enum Object {}

pub fn release() {}

impl Object {
    pub fn open(path: &Path, _progress: &dyn Progress) -> Result<Arc<Object>> {
        let what = "is an address; this program is built without the feature `network`, which reads \
                    it: download the file";
        Err(Error::format(path, what))
    }

    pub fn is_missing(_path: &Path) -> bool {
        false
    }

    pub fn length(&self) -> u64 {
        match *self {}
    }

    pub fn tag(&self) -> &str {
        match *self {}
    }

    pub fn read_at(self: &Arc<Object>, _offset: u64, _into: &mut [u8]) -> Result<usize> {
        match **self {}
    }

    pub fn ahead(self: &Arc<Object>, _ranges: &[Range<u64>]) {
        match **self {}
    }

    pub fn download(self: &Arc<Object>, _name: &str, _progress: &dyn Progress) -> Result<()> {
        match **self {}
    }

    pub fn member(&self, _path: &Path) -> Result<Arc<Object>> {
        match *self {}
    }

    pub fn members_ahead(&self, _paths: &[PathBuf]) {
        match *self {}
    }
}
