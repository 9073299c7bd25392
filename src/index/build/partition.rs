//! Partitions one part into nodes in memory by a coarse kd-tree (Pintus, section 7; guide: papers:
//! leaves below M samples, midpoint split of the longest axis).
//!
//! Splitter a cube at the midpoint of its longest axis, x after y after z, takes one more bit of
//! the Morton code. So:
//!
//! - split(points, cube): count the points on a grid of 64 x 64 x 64 cells, sort them by cell (a
//!   counting sort), and cut the cells, in Morton order, into the largest kd-cells with at most M
//!   points
//! - a single grid cell with more than M is split again by itself
//! - a cell of one lattice step with more than M coincident points cannot be split, and is cut into
//!   full nodes (guide: numerics, case 27)
//!
//! Strays are split separately. Every point is in exactly one node. `pack` orders the points within
//! a node.

use crate::cloud::Columns;
use crate::cloud::strays::Extent;
use crate::config::{BITS_PER_PLANE, POINTS_PER_PAGE, POSITION_PLANES};
use crate::error::Result;
use crate::index::format::morton;
use crate::progress::Progress;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// A node: a run of [`Partition::order`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Node {
    pub points: Range<usize>,
}

/// Arrangement of points; all but benchmarks use `Morton`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Arrangement {
    #[default]
    Morton,
    /// Every node is a random sample of the part: the worst case of a renderer without an index.
    Shuffled,
}

/// Nodes of one part, in Morton order, and the point numbers that they are runs of.
#[derive(Clone, Debug, Default)]
pub struct Partition {
    pub nodes: Vec<Node>,
    pub order: Vec<u32>,
    pub arrangement: Arrangement,
}

/// A grid has 2^6 cells per axis: 262,144 counters, which fit the cache.
const GRID_BITS: u32 = 6;
/// Nodes wider than 2^this lattice steps do not fit the position planes.
const MAX_NODE_BITS: u32 = BITS_PER_PLANE * POSITION_PLANES;

/// Points counted or sorted between checks for cancellation.
const CHECK_INTERVAL: usize = 1 << 18;

pub fn partition(columns: &Columns, progress: &dyn Progress) -> Result<Partition> {
    let mut partition = Partition::default();
    let Some(&Extent { low, high, core, .. }) = columns.extent() else { return Ok(partition) };
    partition.order = (0..columns.len() as u32).collect();
    // Strays have nodes of their own: the nodes of all other points do not depend on them.
    let inside = core.map_or(partition.order.len(), |core| {
        let (inside, strays): (Vec<u32>, Vec<u32>) =
            partition.order.iter().partition(|&&i| core.has(columns.place(i as usize)));
        partition.order = [&inside[..], &strays[..]].concat();
        inside.len()
    });
    let mut splitter = Splitter { columns, nodes: Vec::new(), progress };
    let (core, strays) = partition.order.split_at_mut(inside);
    if strays.is_empty() {
        splitter.whole(core, 0, [low, high])?;
    } else {
        splitter.whole(core, 0, around(columns, core))?;
        splitter.whole(strays, inside, around(columns, strays))?;
    }
    partition.nodes = splitter.nodes;
    Ok(partition)
}

/// Partitions a part into random nodes.
pub fn shuffled_partition(columns: &Columns, _progress: &dyn Progress) -> Result<Partition> {
    let mut order: Vec<u32> = (0..columns.len() as u32).collect();
    // Fisher and Yates, with xorshift64 (Marsaglia 2003): the benchmark needs disorder, not
    // quality.
    let mut state = 0x9E37_79B9_7F4A_7C15u64;
    for i in (1..order.len()).rev() {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        order.swap(i, (state % (i as u64 + 1)) as usize);
    }
    let limit = POINTS_PER_PAGE as usize;
    let nodes = (0..order.len())
        .step_by(limit)
        .map(|at| Node { points: at..order.len().min(at + limit) })
        .collect();
    Ok(Partition { nodes, order, arrangement: Arrangement::Shuffled })
}

/// Returns the ends of the box around some points.
fn around(columns: &Columns, points: &[u32]) -> [[i32; 3]; 2] {
    let mut ends = [[i32::MAX; 3], [i32::MIN; 3]];
    for &i in points {
        let place = [columns.x[i as usize], columns.y[i as usize], columns.z[i as usize]];
        for axis in 0..3 {
            ends[0][axis] = ends[0][axis].min(place[axis]);
            ends[1][axis] = ends[1][axis].max(place[axis]);
        }
    }
    ends
}

struct Splitter<'s> {
    columns: &'s Columns,
    /// Made so far.
    nodes: Vec<Node>,
    progress: &'s dyn Progress,
}

impl Splitter<'_> {
    /// Splits points within these ends, which start at `first` of the whole order.
    fn whole(&mut self, points: &mut [u32], first: usize, ends: [[i32; 3]; 2]) -> Result<()> {
        let [low, high] = ends.map(|end| end.map(i64::from));
        let extent = (0..3).map(|axis| high[axis] - low[axis]).max().unwrap_or(0);
        self.split(points, first, low, 64 - (extent as u64).leading_zeros())
    }

    /// Splits points in the cube of 2^bits steps at `min`; they start at `first` of the whole
    /// order.
    fn split(&mut self, points: &mut [u32], first: usize, min: [i64; 3], bits: u32) -> Result<()> {
        let limit = POINTS_PER_PAGE as usize;
        if points.len() <= limit && bits <= MAX_NODE_BITS {
            self.nodes.push(Node { points: first..first + points.len() });
            return Ok(());
        }
        if bits == 0 {
            self.nodes.extend(
                (0..points.len())
                    .step_by(limit)
                    .map(|at| Node { points: first + at..first + points.len().min(at + limit) }),
            );
            return Ok(());
        }
        let levels = bits.min(GRID_BITS);
        let shift = bits - levels;
        let columns = self.columns;
        let cell = |i: u32| {
            let i = i as usize;
            let q = [columns.x[i], columns.y[i], columns.z[i]];
            morton::code([0, 1, 2].map(|axis| ((q[axis] as i64 - min[axis]) >> shift) as u32))
                as usize
        };
        let look = || self.progress.tick("organising", first as u64, columns.len() as u64);
        let starts = sort_by_cell(points, 1 << (3 * levels), cell, look)?;
        cut(&starts, 0..starts.len() - 1, bits, &mut |cells| {
            let range = starts[cells.start] as usize..starts[cells.end] as usize;
            if cells.len() > 1 || range.len() <= limit && shift <= MAX_NODE_BITS {
                self.nodes.push(Node { points: first + range.start..first + range.end });
                return Ok(());
            }
            let corner = compact(cells.start as u32).map(|c| (c as i64) << shift);
            let min = [min[0] + corner[0], min[1] + corner[1], min[2] + corner[2]];
            self.split(&mut points[range.clone()], first + range.start, min, shift)
        })
    }
}

/// Finds the largest kd-cells with at most M points, or single grid cells, that cover the occupied
/// cells of `cells`.
fn cut(
    starts: &[u32],
    cells: Range<usize>,
    bits: u32,
    emit: &mut impl FnMut(Range<usize>) -> Result<()>,
) -> Result<()> {
    let count = starts[cells.end] - starts[cells.start];
    if count == 0 {
        return Ok(());
    }
    if cells.len() == 1 || count <= POINTS_PER_PAGE && bits <= MAX_NODE_BITS {
        return emit(cells);
    }
    let middle = cells.start + cells.len() / 2;
    // Three halvings make a cube of half the side; cells in between count by their longest side.
    let half = if cells.len().trailing_zeros() % 3 == 1 { bits - 1 } else { bits };
    cut(starts, cells.start..middle, half, emit)?;
    cut(starts, middle..cells.end, half, emit)
}

/// Sorts by cell (counting sort through a copy); returns where each cell starts, and the end. Stops
/// if `look` fails.
fn sort_by_cell(
    points: &mut [u32],
    cells: usize,
    cell: impl Fn(u32) -> usize + Sync,
    look: impl Fn() -> Result<()> + Sync,
) -> Result<Vec<u32>> {
    let chunk = points.len().div_ceil(rayon::current_num_threads()).max(1);
    let counts: Vec<Vec<u32>> = points
        .par_chunks(chunk)
        .map(|chunk| {
            let mut counts = vec![0u32; cells];
            for some in chunk.chunks(CHECK_INTERVAL) {
                look()?;
                some.iter().for_each(|&i| counts[cell(i)] += 1);
            }
            Ok(counts)
        })
        .collect::<Result<_>>()?;
    let mut starts = Vec::with_capacity(cells + 1);
    let mut next = counts;
    let mut sum = 0u32;
    for c in 0..cells {
        starts.push(sum);
        for chunk in &mut next {
            sum += std::mem::replace(&mut chunk[c], sum);
        }
    }
    starts.push(sum);
    // Relaxed atomics cost as much as plain stores, and let threads write one array without unsafe
    // code; no slot is written twice.
    let sorted: Vec<AtomicU32> = (0..points.len()).map(|_| AtomicU32::new(0)).collect();
    points.par_chunks(chunk).zip(&mut next).try_for_each(|(chunk, next)| {
        for some in chunk.chunks(CHECK_INTERVAL) {
            look()?;
            for &i in some {
                let slot = &mut next[cell(i)];
                sorted[*slot as usize].store(i, Relaxed);
                *slot += 1;
            }
        }
        Ok(())
    })?;
    points.par_iter_mut().zip(&sorted).for_each(|(point, sorted)| *point = sorted.load(Relaxed));
    Ok(starts)
}

/// Returns the three numbers of a Morton code.
fn compact(code: u32) -> [u32; 3] {
    [0, 1, 2].map(|axis| (0..GRID_BITS).map(|b| (code >> (3 * b + axis) & 1) << b).sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;
    use crate::progress::Silent;
    use proptest::prelude::*;

    fn check(columns: &Columns) -> Partition {
        let partition = partition(columns, &Silent).unwrap();
        let mut seen = partition.order.clone();
        seen.sort_unstable();
        assert_eq!(seen, (0..columns.len() as u32).collect::<Vec<_>>(), "every point exactly once");
        let mut next = 0;
        for node in &partition.nodes {
            assert_eq!(node.points.start, next);
            assert!(!node.points.is_empty() && node.points.len() <= POINTS_PER_PAGE as usize);
            next = node.points.end;
            for column in [&columns.x, &columns.y, &columns.z] {
                let values =
                    partition.order[node.points.clone()].iter().map(|&i| column[i as usize] as i64);
                let (lo, hi) =
                    values.fold((i64::MAX, i64::MIN), |(lo, hi), v| (lo.min(v), hi.max(v)));
                assert!(
                    hi - lo < 1 << MAX_NODE_BITS,
                    "a node of {} steps does not fit its planes",
                    hi - lo
                );
            }
        }
        assert_eq!(next, columns.len());
        partition
    }

    fn columns(points: Vec<[i32; 3]>) -> Columns {
        let column = |axis: usize| points.iter().map(|p| p[axis]).collect();
        Columns { x: column(0), y: column(1), z: column(2), ..Columns::default() }
    }

    proptest! {
        #[test]
        fn organise_keeps_every_point_once(points in prop::collection::vec(prop::array::uniform3(any::<i32>()), 0..300)) {
            check(&columns(points));
        }
    }

    #[test]
    fn hard_27_a_million_coincident_points_a_line_a_plane_and_one_point() {
        assert_eq!(check(&columns(vec![[7, 7, 7]; 1_000_000])).nodes.len(), 16);
        check(&columns((0..200_000).map(|i| [i, 0, 0]).collect()));
        check(&columns((0..300_000).map(|i| [i % 550, i / 550, 5]).collect()));
        check(&columns(vec![[i32::MIN, 0, i32::MAX]]));
        check(&columns(vec![]));
        check(&columns(
            (0..32)
                .map(|k| [1i32.checked_shl(k).unwrap_or(0), 0, 0])
                .cycle()
                .take(200_000)
                .collect(),
        ));
    }

    #[test]
    fn hard_28_an_aspect_of_a_billion_to_one() {
        check(&columns(
            (0..150_000u32)
                .map(|i| {
                    [(i.wrapping_mul(2_654_435_761) % 1_000_000_000) as i32, (i % 3) as i32, 0]
                })
                .collect(),
        ));
    }

    #[test]
    fn nodes_of_the_whole_int32_range_are_split_until_they_fit_their_planes() {
        let far = [i32::MIN, i32::MAX];
        check(&columns(
            (0..8)
                .map(|corner| [far[corner & 1], far[corner >> 1 & 1], far[corner >> 2]])
                .collect(),
        ));
    }

    /// Cancels after a number of checks.
    struct Looks {
        left: AtomicU32,
    }

    impl Progress for Looks {
        fn tick(&self, _doing: &str, _done: u64, _total: u64) -> Result<()> {
            let left = self.left.fetch_sub(1, Relaxed);
            if left == 0 { Err(Error::Interrupted) } else { Ok(()) }
        }
    }

    #[test]
    fn a_large_part_is_given_up_at_any_of_many_looks() {
        let part = columns((0..1 << 20).map(|i| [i % 1024, i / 1024, i % 7]).collect());
        for looks in 0..6 {
            let looks = Looks { left: AtomicU32::new(looks) };
            assert!(matches!(partition(&part, &looks), Err(Error::Interrupted)));
        }
    }
}
