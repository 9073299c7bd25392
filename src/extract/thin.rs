//! Thinning: one point a cell of a grid, or every n-th point.
//!
//! Of the points in a cell, the first is kept, in the order of the files. The occupied cells are in
//! memory; where the input has more points than [`CELLS`], cells are taken in turns, by a hash, and
//! the input is read once a turn.

use super::Packed;
use super::input::{Batch, Input};
use crate::cloud::strays::mix;
use crate::error::{Error, Result};
use std::collections::HashSet;

/// Most cells in memory: 2^24 are at most half a GiB.
const CELLS: u64 = 1 << 24;

/// How points are thinned.
#[derive(Clone, Debug)]
pub struct Thinning {
    /// Side of the cells, world `[m]`.
    pub cell: Option<f64>,
    /// One of this many points is kept, of those that cells leave.
    pub every: u64,
    /// Most cells in memory.
    pub cells: u64,
}

impl Default for Thinning {
    fn default() -> Thinning {
        Thinning { cell: None, every: 1, cells: CELLS }
    }
}

/// The cells of a batch's points that are left, if points are thinned by cells; `None` for points
/// of another turn.
pub type Cells = Option<Vec<Option<[i64; 3]>>>;

impl Thinning {
    /// Returns how often an input of this many points is read.
    pub fn passes(&self, points: u64) -> u64 {
        if self.cell.is_some() { points.div_ceil(self.cells).max(1) } else { 1 }
    }

    pub fn cells(&self, batch: &Batch, input: &Input, pass: u64) -> Result<Cells> {
        let Some(side) = self.cell else { return Ok(None) };
        let (lattice, passes) = (input.parts()[batch.part].lattice, self.passes(input.points()));
        let cell = |&i: &u32| {
            let cell = (lattice.world(batch.steps(i as usize)) / side).floor();
            if cell.abs().max_element() >= 2f64.powi(62) {
                return Err(Error::Request(format!("--thin {side} is too small for {cell}")));
            }
            let [x, y, z] = cell.as_i64vec3().to_array();
            let turn = mix(mix(mix(x as u64) ^ y as u64) ^ z as u64) % passes;
            Ok((turn == pass).then_some([x, y, z]))
        };
        batch.left.iter().map(cell).collect::<Result<_>>().map(Some)
    }
}

/// The state of thinning, for points in order.
pub struct Thinner {
    every: u64,
    /// Points so far.
    counted: u64,
    taken: HashSet<[i64; 3]>,
}

impl Thinner {
    pub fn new(thinning: &Thinning) -> Thinner {
        Thinner { every: thinning.every.max(1), counted: 0, taken: HashSet::new() }
    }

    pub fn next_pass(&mut self) {
        self.taken.clear();
    }

    /// Returns the number and the bytes of the points that stay.
    pub fn thin(&mut self, packed: Packed, cells: &Cells) -> (u64, Vec<u8>) {
        let Packed { bytes, ends } = packed;
        if cells.is_none() && self.every == 1 {
            return (ends.len() as u64, bytes);
        }
        let (mut kept, mut count, mut start) = (Vec::new(), 0, 0);
        for (i, &end) in ends.iter().enumerate() {
            let is_first = match cells {
                Some(cells) => cells[i].is_some_and(|cell| self.taken.insert(cell)),
                None => true,
            };
            if is_first {
                if self.counted.is_multiple_of(self.every) {
                    kept.extend_from_slice(&bytes[start..end]);
                    count += 1;
                }
                self.counted += 1;
            }
            start = end;
        }
        (count, kept)
    }
}
