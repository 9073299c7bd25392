//! Positions of point ids: the cloud is packed again on the CPU, and all planes are read back.
//! Lattice coordinates are exactly those of the file.

use crate::cloud::{Columns, Lattice, Part};
use crate::index::build::pack;
use crate::index::build::partition::PLACE_WORDS;
use crate::index::{self, Arrangement, Row};
use crate::progress::Silent;
use crate::resident::ResidentNode;
use glam::DVec3;
use rayon::prelude::*;

/// The points of a resident node, in the order of their ids.
pub struct NodePoints {
    pub first_point: u32,
    pub lattice: Lattice,
    pub steps: Vec<[i64; 3]>,
}

/// All points of a cloud by id.
pub struct Points(Vec<NodePoints>);

impl Points {
    /// Collects the points. `nodes` are resident in the order in which `parts` were partitioned.
    pub fn new(parts: &[Part], nodes: &[ResidentNode]) -> Points {
        let mut nodes = nodes.iter();
        let mut points = Vec::new();
        for part in parts {
            // Displayed words only break ties between coincident points.
            let nothing = |_: &Columns, _, _: &mut [Row<PLACE_WORDS>]| ();
            let organised =
                index::partition(part.columns.clone(), &nothing, Arrangement::Morton, &Silent)
                    .expect("Silent never cancels");
            let own: Vec<_> = organised.nodes.iter().zip(nodes.by_ref()).collect();
            points.par_extend(own.into_par_iter().map(|(range, node)| NodePoints {
                first_point: node.first_point(),
                lattice: node.lattice,
                steps: unpacked(&organised.rows[range.points.clone()]),
            }));
        }
        Points(points)
    }

    /// Returns the position of a point id relative to the eye `[m]`.
    pub fn relative(&self, id: u32, eye: DVec3) -> DVec3 {
        let after = self.0.partition_point(|node| node.first_point <= id);
        let node = &self.0[after - 1];
        super::project::relative(&node.lattice, node.steps[(id - node.first_point) as usize], eye)
    }
}

fn unpacked(rows: &[Row<PLACE_WORDS>]) -> Vec<[i64; 3]> {
    let frame = pack::frame(rows);
    let mut pages = vec![vec![0u32; rows.len()]; frame.planes as usize];
    let mut planes: Vec<&mut [u32]> = pages.iter_mut().map(Vec::as_mut_slice).collect();
    pack::pack(rows, &frame, Arrangement::Morton, &mut planes);
    let pad = 10 * frame.planes - frame.bits;
    let axis = |word: u32, axis: usize| (word >> (10 * axis) & 1023) as u64;
    let cells = |i: usize| {
        [0, 1, 2]
            .map(|k| pages.iter().fold(0u64, |cells, page| cells << 10 | axis(page[i], k)) >> pad)
    };
    (0..rows.len()).map(|i| [0, 1, 2].map(|k| frame.origin[k] + cells(i)[k] as i64)).collect()
}
