//! NAME.shadows: how much of a light reaches every point of an index, as a file beside it.
//!
//! ```text
//! header, 4096 bytes   magic, version, which index, length, where the directory lies, CRC-32C of both
//! marks                node by node, a byte a point: of leaves as they were cast, of inner nodes the mean of the points that a sample stands for
//! directory            CRC-32C of every node's marks, then which light and how it was cast, as JSON
//! ```
//! All integers are little-endian. The header is written last (RELIABILITY, write protocol).

use super::file::{Index, Plane, Writer as Planes};
use super::forest::Forest;
use super::map::Map;
use super::merge;
use super::samples::Samples;
use crate::error::{Error, Result};
use crate::progress::Progress;
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

const MAGIC: [u8; 8] = *b"pnsh\r\n\x1a\n";
const VERSION: u32 = 1;
const HEADER_BYTES: u64 = 4096;

/// Whose marks these are.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Contents {
    /// As [`crate::view::light::Light`] is written.
    pub light: String,
    /// The mark of a point that all of the light reaches.
    pub full: u32,
    /// How they were cast; whoever casts knows what that says.
    pub facts: serde_json::Value,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct FileHeader {
    magic: [u8; 8],
    version: u32,
    nodes: u32,
    index: u64,
    length: u64,
    directory_at: u64,
    contents_bytes: u64,
    directory_crc: u32,
    header_crc: u32,
}

impl FileHeader {
    fn own_crc(&self) -> u32 {
        crc32c::crc32c(bytemuck::bytes_of(&FileHeader { header_crc: 0, ..*self }))
    }
}

/// Where each node's marks begin, and where the last ones end.
fn places(index: &Index) -> Vec<u64> {
    let counts = index.nodes().iter().map(|node| node.count as u64);
    let ends = counts.scan(HEADER_BYTES, |end, count| {
        *end += count;
        Some(*end)
    });
    std::iter::once(HEADER_BYTES).chain(ends).collect()
}

/// Marks on their way.
pub struct Writer<'i> {
    index: &'i Index,
    file: Planes,
    places: Vec<u64>,
    crcs: Mutex<Vec<u32>>,
}

impl<'i> Writer<'i> {
    /// Refuses to replace what is no file of shadows: a scan has no copy.
    pub fn create(path: &Path, index: &'i Index) -> Result<Writer<'i>> {
        if path.metadata().is_ok_and(|file| file.is_file() && file.len() > 0)
            && !is_of_shadows(path)?
        {
            return Err(Error::format(
                path,
                "is there, and is no file of shadows; give -o another name",
            ));
        }
        let crcs = Mutex::new(vec![0; index.nodes().len()]);
        Ok(Writer { index, file: Planes::create(path)?, places: places(index), crcs })
    }

    /// All marks of a node, which replace those that were put before.
    pub fn put(&self, node: usize, marks: &[u8]) -> Result<()> {
        assert_eq!(marks.len() as u32, self.index.nodes()[node].count, "node {node}");
        self.crcs.lock().unwrap_or_else(PoisonError::into_inner)[node] = crc32c::crc32c(marks);
        self.file.put(self.places[node], marks)
    }

    /// What was put.
    pub fn get(&self, node: usize) -> Result<Vec<u8>> {
        let mut marks = vec![0; self.index.nodes()[node].count as usize];
        self.file.get(self.places[node], &mut marks)?;
        if crc32c::crc32c(&marks) != self.crcs.lock().unwrap_or_else(PoisonError::into_inner)[node]
        {
            return Err(Error::Request(format!(
                "node {node}'s marks read otherwise than they were written: the disk has lost a write; try again"
            )));
        }
        Ok(marks)
    }

    /// Marks of inner nodes, from those of all leaves: of every sample the mean of the points that it stands for.
    pub fn join(&self, progress: &dyn Progress) -> Result<()> {
        let (directory, nodes) = (&self.index.directory, self.index.nodes());
        let read = |at: u64, bytes: &mut [u8]| self.index.copy(at, bytes);
        let forest = Forest::new(directory, &read, false, 0, 0);
        let deepest = nodes.iter().map(|node| node.level).max().unwrap_or(0);
        for level in (0..=deepest).rev() {
            progress.tick("joining", (deepest - level) as u64, deepest as u64 + 1)?;
            let at_level: Vec<usize> = (0..nodes.len())
                .filter(|&node| nodes[node].level == level && !nodes[node].is_leaf())
                .collect();
            at_level.into_par_iter().try_for_each(|node| {
                // Marks go where their samples do, in the place of classes.
                let mark = |child: usize, samples: &mut Samples| {
                    samples.class = Some(self.get(child)?);
                    Ok(())
                };
                let samples = forest.below(
                    node,
                    &|record| self.index.corner(record),
                    &[Plane::Weight],
                    &mark,
                )?;
                let below = samples.class.as_deref().unwrap_or_default();
                let runs = merge::runs(&samples);
                let own = runs.each(|run| {
                    let (sum, weights) = run.fold((0u64, 0u64), |(sum, weights), i| {
                        let weight = runs.weight(i) as u64;
                        (sum + weight * below[i] as u64, weights + weight)
                    });
                    ((sum + weights / 2) / weights.max(1)) as u8
                });
                if own.len() as u32 != nodes[node].count {
                    return Err(Error::format(
                        self.index.path(),
                        format!(
                            "node {node} has other samples than its children say; make it again"
                        ),
                    ));
                }
                self.put(node, &own)
            })?;
        }
        Ok(())
    }

    /// Gives the file its name; its length.
    pub fn finish(self, contents: &Contents) -> Result<u64> {
        let crcs = self.crcs.into_inner().unwrap_or_else(PoisonError::into_inner);
        let contents =
            serde_json::to_vec(contents).map_err(|error| Error::Request(error.to_string()))?;
        let end = self.places.last().copied().unwrap_or(HEADER_BYTES);
        let crcs_bytes: &[u8] = bytemuck::cast_slice(&crcs);
        self.file.put(end, crcs_bytes)?;
        self.file.put(end + crcs_bytes.len() as u64, &contents)?;
        let length = end + (crcs_bytes.len() + contents.len()) as u64;
        let mut header = FileHeader {
            magic: MAGIC,
            version: VERSION,
            nodes: crcs.len() as u32,
            index: self.index.identity(),
            length,
            directory_at: end,
            contents_bytes: contents.len() as u64,
            directory_crc: crc32c::crc32c_append(crc32c::crc32c(crcs_bytes), &contents),
            header_crc: 0,
        };
        header.header_crc = header.own_crc();
        let mut page = vec![0; HEADER_BYTES as usize];
        page[..size_of::<FileHeader>()].copy_from_slice(bytemuck::bytes_of(&header));
        self.file.close(&page)?;
        Ok(length)
    }
}

fn is_of_shadows(path: &Path) -> Result<bool> {
    let map = Map::open(path)?;
    let mut magic = [0; MAGIC.len()];
    if map.len() >= magic.len() as u64 {
        map.copy(0, &mut magic)?;
    }
    Ok(magic == MAGIC)
}

/// Marks that can be read.
pub struct Marks {
    map: Map,
    places: Vec<u64>,
    crcs: Vec<u32>,
    pub contents: Contents,
}

impl Marks {
    /// Those of this index; checks everything but the marks, which are checked when they are read.
    pub fn open(path: &Path, index: &Index) -> Result<Marks> {
        let map = Map::open(path)?;
        let again = format!(
            "make it again with `pointillist shadows {} -o {}`",
            index.path().display(),
            path.display()
        );
        let wrong = |what: &str| Error::format(path, format!("{what}; {again}"));
        let mut header = FileHeader::zeroed();
        if map.len() < HEADER_BYTES {
            return Err(wrong("is no complete file of shadows"));
        }
        map.copy(0, bytemuck::bytes_of_mut(&mut header))?;
        if header.magic != MAGIC {
            let make = format!(
                "`pointillist shadows {} -o NAME.shadows` makes one",
                index.path().display()
            );
            return Err(Error::format(path, format!("is no file of shadows; {make}")));
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
        if header.own_crc() != header.header_crc || header.length != map.len() {
            return Err(wrong("has a damaged header, or another length than it says"));
        }
        let places = places(index);
        if header.index != index.identity()
            || header.nodes as usize != index.nodes().len()
            || places.last() != Some(&header.directory_at)
        {
            return Err(wrong(&format!(
                "has shadows of another cloud than {}",
                index.path().display()
            )));
        }
        let mut directory = vec![0; header.length.saturating_sub(header.directory_at) as usize];
        map.copy(header.directory_at, &mut directory)?;
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
        let contents: Contents = serde_json::from_slice(&directory[crcs_bytes..])
            .map_err(|error| wrong(&format!("has unreadable contents ({error})")))?;
        if !(1..=255).contains(&contents.full) {
            return Err(wrong("has contents that no marks have"));
        }
        Ok(Marks { map, places, crcs, contents })
    }

    pub fn path(&self) -> &Path {
        self.map.path()
    }

    /// Those of a node, all of them, and checks the copy.
    pub fn read(&self, node: usize, into: &mut [u8]) -> Result<()> {
        assert_eq!(into.len() as u64, self.places[node + 1] - self.places[node], "node {node}");
        self.map.copy(self.places[node], into)?;
        if crc32c::crc32c(into) != self.crcs[node] {
            return Err(Error::format(
                self.path(),
                format!("is damaged: the checksum of node {node}'s marks is wrong"),
            ));
        }
        Ok(())
    }
}
