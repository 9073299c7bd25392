//! Batches of index nodes in GPU memory: for passes over all points of a cloud larger than memory
//! that use only positions.

use super::pages::{PAGE_BYTES, Pages};
use super::point_density::weighted_median;
use super::pool::Pool;
use super::{Resident, ResidentNode, in_metres};
use crate::cloud::attribute::{Attribute, DisplayAttribute};
use crate::config::POINTS_PER_PAGE;
use crate::error::Result;
use crate::graph::Gpu;
use crate::index::build::pack::Frame;
use crate::index::format::Axes;
use crate::index::format::spacing::spacing;
use crate::index::format::{Index, NodeRecord, PLANES, Plane};
use crate::select::clip::Clips;
use crate::select::opacity::Opacities;
use crate::view::linear_map::LinearMap;
use rayon::prelude::*;
use std::sync::Arc;

/// Leaves sampled for the point spacing.
const ASKED: usize = 64;

fn frame(record: &NodeRecord) -> Frame {
    Frame {
        origin: record.origin,
        bits: record.bits as u32,
        extent: record.extent,
        planes: record.position_planes(),
    }
}

/// Returns the point spacing of a node from the words of its coarsest plane `[m]`.
fn spacing_m(index: &Index, record: &NodeRecord, coarse: &[u32]) -> f64 {
    in_metres(spacing(coarse), &index.lattice(record), &frame(record))
}

impl Resident {
    /// Creates an empty pool of this many bytes for nodes of an index.
    pub fn room(gpu: &mut Gpu, index: &Index, bytes: u64) -> Resident {
        gpu.residents += 1;
        Resident {
            serial: gpu.residents,
            pool: Pool::new(gpu, (bytes / PAGE_BYTES).min(u32::MAX as u64) as u32),
            nodes: Vec::new(),
            shown: DisplayAttribute::indexed(Attribute::White, [0.0; 2], [0, 255]),
            points: index.directory.contents.points,
            stations: Vec::new(),
            spacing_m: None,
            counts: None,
            oriented: false,
            axes: Axes::default(),
            balance: None,
            filtered: false,
            opacities: Opacities::default(),
            clips: Clips::default(),
            map: LinearMap::default(),
            unit: index.reference().unit(),
            comes_and_goes: true,
            light: None,
        }
    }

    /// Returns the point spacing `[m]`, as [`Resident::spacing_m`], from the leaves or a sample of
    /// them.
    pub fn spacing_of(index: &Index, leaves: &[usize]) -> Result<f64> {
        let asked = leaves.len().min(ASKED);
        let of_leaf = |i: usize| {
            let node = leaves[i * leaves.len() / asked];
            let record = &index.nodes()[node];
            let mut words = vec![0u32; record.count as usize];
            index.read(node, Plane::Coarse, bytemuck::cast_slice_mut(&mut words))?;
            Ok((spacing_m(index, record, &words), record.count as u64))
        };
        Ok(weighted_median((0..asked).into_par_iter().map(of_leaf).collect::<Result<Vec<_>>>()?))
    }

    /// Returns how many of these nodes, from the first on, fit the pool; at least one.
    pub fn fitting(&self, index: &Index, nodes: &[usize]) -> usize {
        let mut pages = Pages::new(self.pool.pages.budget);
        nodes
            .iter()
            .take_while(|&&node| pages.take(index.nodes()[node].position_planes()).is_some())
            .count()
            .max(1)
            .min(nodes.len())
    }

    /// Replaces the nodes by these, with full positions; the device must be done with the previous
    /// ones.
    pub fn hold(&mut self, gpu: &mut Gpu, index: &Index, nodes: &[usize]) -> Result<()> {
        self.nodes.clear();
        let needed =
            nodes.iter().map(|&node| index.nodes()[node].position_planes()).max().unwrap_or(0);
        self.pool.pages = Pages::new(self.pool.pages.budget.max(needed));
        for (number, &node) in nodes.iter().enumerate() {
            let record = &index.nodes()[node];
            let planes = record.position_planes();
            let first_page = self.pool.take(gpu, planes)?.expect("nodes that fit the room");
            let (count, number) = (record.count, number as u32);
            self.nodes.push(ResidentNode {
                lattice: index.lattice(record),
                frame: frame(record),
                count,
                number,
                first_page,
                planes,
                own_spacing: 0.0,
                map: LinearMap::default(),
                clumps: Arc::default(),
                station: None,
            });
        }
        let runs = self
            .nodes
            .iter_mut()
            .zip(nodes)
            .map(|(held, &node)| (held.first_page, held.planes, (held, node)))
            .collect();
        let all = nodes.len();
        let written = self.pool.write(gpu, runs, |(held, node), pages| {
            let record = &index.nodes()[node];
            // Checked in main memory, then copied to device memory that may be slow to read.
            let mut words = vec![0u32; (record.count as usize).min(POINTS_PER_PAGE as usize)];
            for (plane, page) in pages.into_iter().enumerate() {
                index.read(node, PLANES[plane].0, bytemuck::cast_slice_mut(&mut words))?;
                if plane == 0 {
                    held.own_spacing = spacing_m(index, record, &words);
                }
                page[..words.len()].copy_from_slice(&words);
            }
            Ok(())
        })?;
        assert_eq!(written, all, "leaves are baked on a device of our own");
        Ok(())
    }
}
