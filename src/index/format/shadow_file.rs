//! NAME.shadows: how much of a light reaches every point of an index, as a file beside it.
//!
//! ```text
//! header, 4096 bytes   magic, version, identity of the index, length, offset of the directory,
//!                      CRC-32C of both
//! shadows              node by node, a byte per point: in leaves as cast, in inner nodes the mean
//!                      of the points that a sample stands for
//! directory            CRC-32C of every node's shadows, then light and casting parameters, as JSON
//! ```
//!
//! All integers are little-endian. The header is written last (guide: reliability).

use super::schema::NodeRecord;
use crate::cloud::input::Input;
use crate::error::{Error, Result};
use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};
use std::path::Path;

pub(in crate::index) const MAGIC: [u8; 8] = *b"pnsh\r\n\x1a\n";
pub(in crate::index) const VERSION: u32 = 1;
pub(in crate::index) const HEADER_BYTES: u64 = 4096;

/// Light and casting parameters of saved shadows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ShadowContents {
    /// The light, as text of [`crate::view::light::Light`].
    pub light: String,
    /// Value of a fully lit point.
    pub full: u32,
    /// Casting parameters, as the caster wrote them.
    pub facts: serde_json::Value,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(in crate::index) struct FileHeader {
    pub(in crate::index) magic: [u8; 8],
    pub(in crate::index) version: u32,
    pub(in crate::index) nodes: u32,
    pub(in crate::index) index: u64,
    pub(in crate::index) length: u64,
    pub(in crate::index) directory_at: u64,
    pub(in crate::index) contents_bytes: u64,
    pub(in crate::index) directory_crc: u32,
    pub(in crate::index) header_crc: u32,
}

impl FileHeader {
    pub(in crate::index) fn own_crc(&self) -> u32 {
        crc32c::crc32c(bytemuck::bytes_of(&FileHeader { header_crc: 0, ..*self }))
    }
}

/// Returns the offset of each node's shadows, and their end.
pub(in crate::index) fn offsets(nodes: &[NodeRecord]) -> Vec<u64> {
    let counts = nodes.iter().map(|node| node.count as u64);
    let ends = counts.scan(HEADER_BYTES, |end, count| {
        *end += count;
        Some(*end)
    });
    std::iter::once(HEADER_BYTES).chain(ends).collect()
}

pub(in crate::index) fn is_shadow_file(path: &Path) -> Result<bool> {
    let input = Input::open(path)?;
    let mut magic = [0; MAGIC.len()];
    if input.length >= magic.len() as u64 {
        input.read_exactly(0, &mut magic)?;
    }
    Ok(magic == MAGIC)
}

/// Saved shadows, open for reading.
pub struct SavedShadows {
    input: Input,
    offsets: Vec<u64>,
    crcs: Vec<u32>,
    pub contents: ShadowContents,
}

impl SavedShadows {
    /// Opens the shadows of an index; checks everything except the shadows, which are checked when
    /// they are read.
    pub fn open(
        path: &Path,
        index: &Path,
        identity: u64,
        nodes: &[NodeRecord],
    ) -> Result<SavedShadows> {
        let input = Input::open_mapped(path)?;
        let again = format!(
            "make it again with `pointillist shadows {} -o {}`",
            index.display(),
            path.display()
        );
        let wrong = |what: &str| Error::format(path, format!("{what}; {again}"));
        let mut header = FileHeader::zeroed();
        if input.length < HEADER_BYTES {
            return Err(wrong("is not a complete shadow file"));
        }
        input.read_exactly(0, bytemuck::bytes_of_mut(&mut header))?;
        if header.magic != MAGIC {
            let make =
                format!("`pointillist shadows {} -o NAME.shadows` makes one", index.display());
            return Err(Error::format(path, format!("is not a shadow file; {make}")));
        }
        if header.version > VERSION {
            return Err(Error::format(
                path,
                format!(
                    "is of version {}, made by a newer pointillist; this one reads up to {VERSION}",
                    header.version
                ),
            ));
        }
        if header.own_crc() != header.header_crc || header.length != input.length {
            return Err(wrong("has a damaged header, or another length than it says"));
        }
        let offsets = offsets(nodes);
        if header.index != identity
            || header.nodes as usize != nodes.len()
            || offsets.last() != Some(&header.directory_at)
        {
            return Err(wrong(&format!("has shadows of another cloud than {}", index.display())));
        }
        let mut directory = vec![0; header.length.saturating_sub(header.directory_at) as usize];
        input.read_exactly(header.directory_at, &mut directory)?;
        let crcs_bytes = 4 * header.nodes as usize;
        if crc32c::crc32c(&directory) != header.directory_crc
            || (crcs_bytes as u64).checked_add(header.contents_bytes)
                != Some(directory.len() as u64)
        {
            return Err(wrong("has a damaged directory"));
        }
        let crcs = directory[..crcs_bytes]
            .as_chunks()
            .0
            .iter()
            .map(|&crc| u32::from_le_bytes(crc))
            .collect();
        let contents: ShadowContents = serde_json::from_slice(&directory[crcs_bytes..])
            .map_err(|error| wrong(&format!("has unreadable contents ({error})")))?;
        if !(1..=255).contains(&contents.full) {
            return Err(wrong("has an invalid value for full light"));
        }
        Ok(SavedShadows { input, offsets, crcs, contents })
    }

    pub fn path(&self) -> &Path {
        &self.input.path
    }

    /// Reads all shadows of a node and checks their checksum.
    pub fn read(&self, node: usize, into: &mut [u8]) -> Result<()> {
        assert_eq!(into.len() as u64, self.offsets[node + 1] - self.offsets[node], "node {node}");
        self.input.read_exactly(self.offsets[node], into)?;
        if crc32c::crc32c(into) != self.crcs[node] {
            return Err(Error::format(
                self.path(),
                format!("is damaged: the checksum of node {node}'s shadows is wrong"),
            ));
        }
        Ok(())
    }
}
