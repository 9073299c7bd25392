//! The ground of an index's points, from its own nodes.

use super::format::{Index, Refinement};
use crate::cloud::attribute::Attribute;
use crate::cloud::crs::Reference;
use crate::cloud::ground::{Batch, CELL, Points, Surface};
use crate::cloud::scalar::Scalar;
use crate::cloud::up::Up;
use crate::error::Result;
use crate::progress::Progress;
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Samples of a node stand for all of its points if they are no farther apart than this part of a
/// cell of the ground.
const FINE: f64 = 1.0 / 20.0;

/// The nodes that are read: leaves, or nodes above them whose samples are fine enough, and those
/// that they add to.
struct Nodes<'i> {
    index: &'i Index,
    nodes: Vec<usize>,
    progress: &'i dyn Progress,
}

impl Nodes<'_> {
    fn of<'i>(index: &'i Index, progress: &'i dyn Progress) -> Nodes<'i> {
        let finest = FINE * CELL / index.reference().unit().metres;
        let (mut nodes, mut open) = (Vec::new(), Vec::from_iter(0..index.directory.roots as usize));
        while let Some(node) = open.pop() {
            let record = &index.nodes()[node];
            let is_fine = record.is_leaf() || record.spacing <= finest;
            if is_fine || index.refinement == Refinement::Adds {
                nodes.push(node);
            }
            if !is_fine {
                open.extend(record.children());
            }
        }
        Nodes { index, nodes, progress }
    }
}

impl Points for Nodes<'_> {
    fn count(&self) -> u64 {
        self.nodes.iter().map(|&node| self.index.nodes()[node].count as u64).sum()
    }

    fn each(&self, sink: &(dyn Fn(Batch) + Sync)) -> Result<()> {
        let wanted = Attribute::Class.wanted();
        let (done, all) = (AtomicU64::new(0), self.nodes.len() as u64);
        self.nodes.par_iter().try_for_each(|&node| {
            let record = &self.index.nodes()[node];
            let columns = &self.index.columns(node, wanted)?;
            let lattice = &self.index.lattice(record);
            sink(Batch { columns, lattice, shift: record.origin, corner: [0; 3] });
            self.progress.tick("finding the ground", done.fetch_add(1, Relaxed) + 1, all)
        })
    }

    fn up(&self) -> Up {
        self.index.up
    }

    fn reference(&self) -> Reference {
        self.index.reference()
    }
}

impl Index {
    /// Finds the ground, so that points have heights above it. Returns a note on how; `None`
    /// without points, or if the heights are kept.
    pub fn find_ground(&mut self, progress: &dyn Progress) -> Result<Option<String>> {
        if self.shows(Attribute::Scalar(Scalar::HeightAboveGround)) {
            return Ok(None);
        }
        self.ground = Surface::of(&Nodes::of(self, progress))?.map(Arc::new);
        Ok(self.ground.as_ref().map(|ground| ground.note()))
    }
}
