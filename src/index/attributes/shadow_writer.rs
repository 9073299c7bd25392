//! Writer of saved shadows: leaves as they are cast, inner nodes as means of their children.

use super::leaf_cache::LeafCache;
use crate::error::{Error, Result};
use crate::index::format::samples::Samples;
use crate::index::format::shadow_file::{
    FileHeader, HEADER_BYTES, MAGIC, ShadowContents, VERSION, is_shadow_file, offsets,
};
use crate::index::format::{self, Index, Plane};
use crate::index::merge;
use crate::progress::Progress;
use rayon::prelude::*;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Saved shadows being written.
pub struct ShadowWriter<'i> {
    index: &'i Index,
    file: format::Writer,
    offsets: Vec<u64>,
    crcs: Mutex<Vec<u32>>,
}

impl<'i> ShadowWriter<'i> {
    /// Creates the file. Refuses to replace a file that is not a shadow file: a scan has no copy.
    pub fn create(path: &Path, index: &'i Index) -> Result<ShadowWriter<'i>> {
        if path.metadata().is_ok_and(|file| file.is_file() && file.len() > 0)
            && !is_shadow_file(path)?
        {
            return Err(Error::format(
                path,
                "exists and is not a shadow file; choose another name with -o",
            ));
        }
        let crcs = Mutex::new(vec![0; index.nodes().len()]);
        Ok(ShadowWriter {
            index,
            file: format::Writer::create(path)?,
            offsets: offsets(index.nodes()),
            crcs,
        })
    }

    /// Writes all shadows of a node, replacing earlier ones.
    pub fn put(&self, node: usize, values: &[u8]) -> Result<()> {
        assert_eq!(values.len() as u32, self.index.nodes()[node].count, "node {node}");
        self.crcs.lock().unwrap_or_else(PoisonError::into_inner)[node] = crc32c::crc32c(values);
        self.file.put(self.offsets[node], values)
    }

    /// Reads back the shadows of a node.
    pub fn get(&self, node: usize) -> Result<Vec<u8>> {
        let mut values = vec![0; self.index.nodes()[node].count as usize];
        self.file.get(self.offsets[node], &mut values)?;
        if crc32c::crc32c(&values) != self.crcs.lock().unwrap_or_else(PoisonError::into_inner)[node]
        {
            return Err(Error::Request(format!(
                "cannot read back the shadows of node {node}: the disk has lost a write; try again"
            )));
        }
        Ok(values)
    }

    /// Computes the shadows of inner nodes from those of all leaves: of every sample the mean of
    /// the points that it stands for.
    pub fn merge_inner_nodes(&self, progress: &dyn Progress) -> Result<()> {
        let (directory, nodes) = (&self.index.directory, self.index.nodes());
        let read = |at: u64, bytes: &mut [u8]| self.index.copy(at, bytes);
        let leaves = LeafCache::new(directory, &read, false, 0, 0);
        let deepest = nodes.iter().map(|node| node.level).max().unwrap_or(0);
        for level in (0..=deepest).rev() {
            progress.tick("joining", (deepest - level) as u64, deepest as u64 + 1)?;
            let at_level: Vec<usize> = (0..nodes.len())
                .filter(|&node| nodes[node].level == level && !nodes[node].is_leaf())
                .collect();
            at_level.into_par_iter().try_for_each(|node| {
                // Shadows are sorted with their samples, in the column of classes.
                let value = |child: usize, samples: &mut Samples| {
                    samples.class = Some(self.get(child)?);
                    Ok(())
                };
                let samples = leaves.below(
                    node,
                    &|record| self.index.tree_corner(record),
                    &[Plane::Weight],
                    &value,
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
                        format!("node {node} does not match its children; make the index again"),
                    ));
                }
                self.put(node, &own)
            })?;
        }
        Ok(())
    }

    /// Completes the file and returns its length.
    pub fn finish(self, contents: &ShadowContents) -> Result<u64> {
        let crcs = self.crcs.into_inner().unwrap_or_else(PoisonError::into_inner);
        let contents =
            serde_json::to_vec(contents).map_err(|error| Error::Request(error.to_string()))?;
        let end = self.offsets.last().copied().unwrap_or(HEADER_BYTES);
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
