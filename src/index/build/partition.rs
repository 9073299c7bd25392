//! Partitions one part into nodes in memory by a coarse kd-tree (Pintus, section 7; guide: papers:
//! leaves below M samples, midpoint split of the longest axis).
//!
//! Splitting a cube at the midpoint of its longest axis, x after y after z, takes one more bit of
//! the Morton code. So:
//!
//! - split(points, cube): count the points on a grid of 32 x 32 x 32 cells, cut the cells, in
//!   Morton order, into the largest kd-cells with at most M points, and move each point to its kd-cell,
//!   with all that it shows
//! - a single grid cell with more than M is split again by itself
//! - a cell of one lattice step with more than M coincident points cannot be split, and is cut into
//!   full nodes (guide: numerics, case 27)
//!
//! Strays are split separately. Every point is in exactly one node. `pack` orders the points within
//! a node.

use crate::cloud::Columns;
use crate::cloud::strays::{Extent, RobustBounds};
use crate::config::{BITS_PER_PLANE, POINTS_PER_PAGE, POSITION_PLANES};
use crate::error::Result;
use crate::index::format::morton;
use crate::progress::Progress;
use rayon::prelude::*;
use std::ops::Range;
use std::slice::IterMut;

/// A point: three words of its place in lattice steps, then the words of what it shows. Rows are
/// moved as a whole, so that a node's points lie together.
pub type Row<const N: usize> = [u32; N];

/// Words of a row before those that it shows.
pub const PLACE_WORDS: usize = 3;

/// Returns the place of a point in lattice steps.
#[inline]
pub fn place<const N: usize>(row: &Row<N>) -> [i32; 3] {
    [row[0] as i32, row[1] as i32, row[2] as i32]
}

/// A node: a run of [`Partition::rows`].
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

/// Nodes of one part, in Morton order, and the points that they are runs of.
#[derive(Clone, Debug, Default)]
pub struct Partition<const N: usize> {
    pub nodes: Vec<Node>,
    pub rows: Vec<Row<N>>,
    pub arrangement: Arrangement,
}

/// A grid has at most 2^5 cells per axis: 32,768 counters, which fit the cache; fewer where cells
/// would hold fewer points than this. Nodes do not depend on it.
const GRID_BITS: u32 = 5;
const CELL_POINTS: usize = 16;
/// Nodes wider than 2^this lattice steps do not fit the position planes.
const MAX_NODE_BITS: u32 = BITS_PER_PLANE * POSITION_PLANES;
const NODE_POINTS: usize = POINTS_PER_PAGE as usize;

/// Points that are numbered or read together, in the cache.
const BLOCK: usize = 1 << 10;
/// Points between checks for cancellation: a multiple of a block.
const CHECK_INTERVAL: usize = 1 << 18;

/// Partitions a part into nodes. `words` writes what a range of points shows behind their places;
/// it may be asked for the last points first, since columns are freed as points are moved.
pub fn partition<const N: usize>(
    columns: Columns,
    words: &(impl Fn(&Columns, Range<usize>, &mut [Row<N>]) + Sync),
    arrangement: Arrangement,
    progress: &dyn Progress,
) -> Result<Partition<N>> {
    let mut rows = vec![[0; N]; columns.len()];
    let Some(extent) = columns.extent() else {
        return Ok(Partition { rows, arrangement, ..Partition::default() });
    };
    let ((grid, strays), core) = (grid_of(&columns, extent), extent.core);
    let fits = rows.len() <= NODE_POINTS && grid.bits <= MAX_NODE_BITS && core.is_none();
    let mut source = FromColumns { columns, words, grid: &grid, core, strays };
    if arrangement == Arrangement::Shuffled {
        source.read(0..rows.len(), &mut rows);
        return Ok(shuffled(rows));
    }
    if fits {
        source.read(0..rows.len(), &mut rows);
        let nodes = full_nodes(0..rows.len()).collect();
        return Ok(Partition { nodes, rows, arrangement });
    }
    let splitter = Splitter { progress, total: rows.len() };
    let pieces = splitter.distribute(&mut source, &grid, &mut rows, 0)?;
    drop(source);
    let nodes = splitter.settle(&mut rows, 0, &grid, pieces)?;
    Ok(Partition { nodes, rows, arrangement })
}

/// Returns random nodes.
fn shuffled<const N: usize>(mut rows: Vec<Row<N>>) -> Partition<N> {
    // Fisher and Yates, with xorshift64 (Marsaglia 2003): the benchmark needs disorder, not
    // quality.
    let mut state = 0x9E37_79B9_7F4A_7C15u64;
    for i in (1..rows.len()).rev() {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        rows.swap(i, (state % (i as u64 + 1)) as usize);
    }
    Partition {
        nodes: full_nodes(0..rows.len()).collect(),
        rows,
        arrangement: Arrangement::Shuffled,
    }
}

/// Cuts a run of points into full nodes, and a last one.
fn full_nodes(points: Range<usize>) -> impl Iterator<Item = Node> {
    let end = points.end;
    points.step_by(NODE_POINTS).map(move |at| Node { points: at..end.min(at + NODE_POINTS) })
}

/// Returns the grid over all points but strays, and the number of the cell that strays get.
fn grid_of(columns: &Columns, extent: &Extent) -> (Grid, u32) {
    let mut ends = [extent.low, extent.high];
    if let Some(core) = extent.core {
        let inside = (0..columns.len()).into_par_iter().filter(|&i| core.has(columns.place(i)));
        let none = || [[i32::MAX; 3], [i32::MIN; 3]];
        let both = |[low, high]: [[i32; 3]; 2], [a, b]: [[i32; 3]; 2]| {
            [[0, 1, 2].map(|k| low[k].min(a[k])), [0, 1, 2].map(|k| high[k].max(b[k]))]
        };
        let end = |i: usize| [[columns.x[i], columns.y[i], columns.z[i]]; 2];
        ends = inside.map(end).reduce(none, both);
    }
    let grid = Grid::around(ends, columns.len());
    let cells = grid.cells() as u32;
    (grid, cells)
}

/// The grid of 2^`levels` cells per axis over the cube of 2^`bits` steps at `min`, in Morton order.
struct Grid {
    min: [i64; 3],
    bits: u32,
    levels: u32,
}

impl Grid {
    /// Returns the grid of a number of points in a cube.
    fn new(min: [i64; 3], bits: u32, points: usize) -> Grid {
        let levels = (points / CELL_POINTS).max(1).ilog(8);
        Grid { min, bits, levels: levels.clamp(1, GRID_BITS).min(bits) }
    }

    /// Returns the grid of points in a box, given its ends.
    fn around(ends: [[i32; 3]; 2], points: usize) -> Grid {
        let [low, high] = ends.map(|end| end.map(i64::from));
        let extent = (0..3).map(|axis| high[axis] - low[axis]).max().unwrap_or(0);
        Grid::new(low, 64 - (extent as u64).leading_zeros(), points)
    }

    /// Returns the bits of the side of a cell.
    fn shift(&self) -> u32 {
        self.bits - self.levels
    }

    fn cells(&self) -> usize {
        1 << (3 * self.levels)
    }

    /// Returns the cell of a place inside; of one outside any number.
    #[inline]
    fn cell(&self, place: [i32; 3]) -> u32 {
        // Differences of 32 bits are exact, although a corner need not fit an i32.
        let along =
            |axis: usize| (place[axis] as u32).wrapping_sub(self.min[axis] as u32) >> self.shift();
        morton::code([along(0), along(1), along(2)])
    }

    /// Returns the grid over one cell, for its points.
    fn finer(&self, cell: u32, points: usize) -> Grid {
        let corner =
            [0, 1, 2].map(|axis| (morton::axis(cell, axis, GRID_BITS) as i64) << self.shift());
        let min = [0, 1, 2].map(|axis| self.min[axis] + corner[axis]);
        Grid::new(min, self.shift(), points)
    }

    /// Finds the largest kd-cells with at most M points, or single grid cells, that cover the
    /// occupied cells, given where each starts. Strays are a piece of their own.
    fn cut(&self, starts: &[usize]) -> Vec<Range<usize>> {
        let mut pieces = Vec::new();
        cut(starts, 0..self.cells(), self.bits, &mut pieces);
        let end = self.cells();
        pieces.extend((starts[end] < starts[end + 1]).then_some(end..end + 1));
        pieces
    }
}

fn cut(starts: &[usize], cells: Range<usize>, bits: u32, pieces: &mut Vec<Range<usize>>) {
    let count = starts[cells.end] - starts[cells.start];
    if count == 0 {
        return;
    }
    if cells.len() == 1 || count <= NODE_POINTS && bits <= MAX_NODE_BITS {
        return pieces.push(cells);
    }
    let middle = cells.start + cells.len() / 2;
    // Three halvings make a cube of half the side; cells in between count by their longest side.
    let half = if cells.len().trailing_zeros() % 3 == 1 { bits - 1 } else { bits };
    cut(starts, cells.start..middle, half, pieces);
    cut(starts, middle..cells.end, half, pieces);
}

/// A run of cells, and the run of its points.
struct Piece {
    cells: Range<usize>,
    points: Range<usize>,
}

/// Points that are to be moved.
trait Source<const N: usize>: Sync {
    /// Number of times that points are moved and freed.
    const TURNS: usize;

    /// Writes the cells of a range of points.
    fn number(&self, points: Range<usize>, cells: &mut [u32]);

    /// Writes the rows of a range of points.
    fn read(&self, points: Range<usize>, rows: &mut [Row<N>]);

    /// Frees the points from a number on.
    fn truncate(&mut self, left: usize);
}

struct FromColumns<'s, W> {
    columns: Columns,
    words: &'s W,
    grid: &'s Grid,
    /// Box around all points but strays, and the cell that those get.
    core: Option<RobustBounds>,
    strays: u32,
}

impl<const N: usize, W> Source<N> for FromColumns<'_, W>
where
    W: Fn(&Columns, Range<usize>, &mut [Row<N>]) + Sync,
{
    /// Columns and rows are hardly ever there together.
    const TURNS: usize = 8;

    fn number(&self, points: Range<usize>, cells: &mut [u32]) {
        let [x, y, z] = [0, 1, 2].map(|axis| &self.columns.along(axis)[points.clone()]);
        let places = x.iter().zip(y).zip(z).map(|((&x, &y), &z)| [x, y, z]);
        cells.iter_mut().zip(places).for_each(|(cell, place)| *cell = self.grid.cell(place));
        // Strays have nodes of their own: the nodes of all other points do not depend on them.
        if let Some(core) = self.core {
            for (cell, i) in cells.iter_mut().zip(points) {
                if !core.has(self.columns.place(i)) {
                    *cell = self.strays;
                }
            }
        }
    }

    fn read(&self, points: Range<usize>, rows: &mut [Row<N>]) {
        let [x, y, z] = [0, 1, 2].map(|axis| &self.columns.along(axis)[points.clone()]);
        for (((row, &x), &y), &z) in rows.iter_mut().zip(x).zip(y).zip(z) {
            [row[0], row[1], row[2]] = [x as u32, y as u32, z as u32];
        }
        (self.words)(&self.columns, points, rows);
    }

    fn truncate(&mut self, left: usize) {
        self.columns.truncate(left);
    }
}

struct FromRows<'s, const N: usize> {
    rows: Vec<Row<N>>,
    grid: &'s Grid,
}

impl<const N: usize> Source<N> for FromRows<'_, N> {
    const TURNS: usize = 1;

    fn number(&self, points: Range<usize>, cells: &mut [u32]) {
        let rows = &self.rows[points];
        cells.iter_mut().zip(rows).for_each(|(cell, row)| *cell = self.grid.cell(place(row)));
    }

    fn read(&self, points: Range<usize>, rows: &mut [Row<N>]) {
        rows.copy_from_slice(&self.rows[points]);
    }

    fn truncate(&mut self, left: usize) {
        self.rows.truncate(left);
    }
}

struct Splitter<'s> {
    progress: &'s dyn Progress,
    total: usize,
}

impl Splitter<'_> {
    /// Moves points to `rows`, piece by piece of a grid; they start at `first` of the whole order.
    fn distribute<const N: usize, S: Source<N>>(
        &self,
        source: &mut S,
        grid: &Grid,
        rows: &mut [Row<N>],
        first: usize,
    ) -> Result<Vec<Piece>> {
        let (count, threads) = (rows.len(), rayon::current_num_threads());
        let share = count.div_ceil(S::TURNS * threads).max(1);
        let shares: Vec<Range<usize>> =
            (0..count).step_by(share).map(|at| at..count.min(at + share)).collect();
        let blocks = |share: Range<usize>| {
            let end = share.end;
            share.step_by(BLOCK).map(move |at| at..end.min(at + BLOCK))
        };
        let look = |block: &Range<usize>| match block.start % CHECK_INTERVAL < BLOCK {
            true => self.progress.tick("organising", first as u64, self.total as u64),
            false => Ok(()),
        };
        // The last cell is that of strays.
        let cells = grid.cells() + 1;
        let count_cells = |share: &Range<usize>| {
            let (mut counts, mut numbers) = (vec![0u32; cells], [0; BLOCK]);
            for block in blocks(share.clone()) {
                look(&block)?;
                let numbers = &mut numbers[..block.len()];
                source.number(block, numbers);
                numbers.iter().for_each(|&cell| counts[cell as usize] += 1);
            }
            Ok(counts)
        };
        let counts: Vec<Vec<u32>> = shares.par_iter().map(count_cells).collect::<Result<_>>()?;
        let mut starts = vec![0; cells + 1];
        for cell in 0..cells {
            starts[cell + 1] =
                starts[cell] + counts.iter().map(|counts| counts[cell] as usize).sum::<usize>();
        }
        let pieces = grid.cut(&starts);
        let mut piece_of = vec![0u32; cells];
        // Every share writes to a section of its own of every piece.
        let mut sections: Vec<Vec<IterMut<Row<N>>>> = shares.iter().map(|_| Vec::new()).collect();
        let mut rest = rows;
        for (piece, range) in (0..).zip(&pieces) {
            piece_of[range.clone()].fill(piece);
            for (counts, sections) in counts.iter().zip(&mut sections) {
                let own = counts[range.clone()].iter().sum::<u32>() as usize;
                let (section, after) = rest.split_at_mut(own);
                sections.push(section.iter_mut());
                rest = after;
            }
        }
        drop(counts);
        // The last points are moved first, since columns are freed from their ends.
        for (shares, sections) in shares.chunks(threads).zip(sections.chunks_mut(threads)).rev() {
            let move_points = |(share, sections): (&Range<usize>, &mut Vec<IterMut<Row<N>>>)| {
                let (mut numbers, mut rows) = ([0; BLOCK], [[0; N]; BLOCK]);
                for block in blocks(share.clone()) {
                    look(&block)?;
                    let (numbers, rows) = (&mut numbers[..block.len()], &mut rows[..block.len()]);
                    source.number(block.clone(), numbers);
                    source.read(block, rows);
                    for (&cell, row) in numbers.iter().zip(&*rows) {
                        let section = &mut sections[piece_of[cell as usize] as usize];
                        let place = section.next();
                        *place.expect("a section has room for all points of its cells") = *row;
                    }
                }
                Ok(())
            };
            shares.par_iter().zip(sections).try_for_each(move_points)?;
            source.truncate(shares[0].start);
        }
        let points =
            |cells: Range<usize>| Piece { points: starts[cells.start]..starts[cells.end], cells };
        Ok(pieces.into_iter().map(points).collect())
    }

    /// Returns the nodes of pieces. Those that are too large are split again.
    fn settle<const N: usize>(
        &self,
        mut rows: &mut [Row<N>],
        first: usize,
        grid: &Grid,
        pieces: Vec<Piece>,
    ) -> Result<Vec<Node>> {
        let own = |Piece { cells, points }: Piece| {
            let (own, rest) = std::mem::take(&mut rows).split_at_mut(points.len());
            rows = rest;
            (cells, first + points.start, own)
        };
        let pieces: Vec<_> = pieces.into_iter().map(own).collect();
        let nodes = |(cells, start, rows): (Range<usize>, usize, &mut [Row<N>])| {
            let finer = match cells.start == grid.cells() {
                true => Grid::around(ends(rows), rows.len()),
                false => grid.finer(cells.start as u32, rows.len()),
            };
            let points = start..start + rows.len();
            let fits = rows.len() <= NODE_POINTS && finer.bits <= MAX_NODE_BITS;
            if cells.len() > 1 || fits {
                Ok(vec![Node { points }])
            } else if finer.bits == 0 {
                Ok(full_nodes(points).collect())
            } else {
                self.split(rows, start, finer)
            }
        };
        let nodes = pieces.into_par_iter().map(nodes).collect::<Result<Vec<_>>>()?;
        Ok(nodes.concat())
    }

    /// Splits the points of a cube.
    fn split<const N: usize>(
        &self,
        rows: &mut [Row<N>],
        first: usize,
        grid: Grid,
    ) -> Result<Vec<Node>> {
        let mut source = FromRows { rows: rows.to_vec(), grid: &grid };
        let pieces = self.distribute(&mut source, &grid, rows, first)?;
        drop(source);
        self.settle(rows, first, &grid, pieces)
    }
}

/// Returns the ends of the box around points.
pub fn ends<const N: usize>(rows: &[Row<N>]) -> [[i32; 3]; 2] {
    let mut ends = [[i32::MAX; 3], [i32::MIN; 3]];
    for place in rows.iter().map(place) {
        for axis in 0..3 {
            ends[0][axis] = ends[0][axis].min(place[axis]);
            ends[1][axis] = ends[1][axis].max(place[axis]);
        }
    }
    ends
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;
    use crate::progress::Silent;
    use proptest::prelude::*;
    use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

    /// Partitions points that show their numbers.
    fn numbered(columns: &Columns, progress: &dyn Progress) -> Result<Partition<4>> {
        let words = |_: &Columns, points: Range<usize>, rows: &mut [Row<4>]| {
            rows.iter_mut().zip(points).for_each(|(row, i)| row[PLACE_WORDS] = i as u32);
        };
        partition(columns.clone(), &words, Arrangement::Morton, progress)
    }

    fn check(columns: &Columns) -> Partition<4> {
        let partition = numbered(columns, &Silent).unwrap();
        for row in &partition.rows {
            let i = row[PLACE_WORDS] as usize;
            assert_eq!(place(row), [columns.x[i], columns.y[i], columns.z[i]]);
        }
        let mut seen: Vec<u32> = partition.rows.iter().map(|row| row[PLACE_WORDS]).collect();
        seen.sort_unstable();
        assert_eq!(seen, (0..columns.len() as u32).collect::<Vec<_>>(), "every point exactly once");
        let mut next = 0;
        for node in &partition.nodes {
            assert_eq!(node.points.start, next);
            assert!(!node.points.is_empty() && node.points.len() <= POINTS_PER_PAGE as usize);
            next = node.points.end;
            let [low, high] = ends(&partition.rows[node.points.clone()]);
            for axis in 0..3 {
                let wide = high[axis] as i64 - low[axis] as i64;
                assert!(
                    wide < 1 << MAX_NODE_BITS,
                    "a node of {wide} steps does not fit its planes"
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
            assert!(matches!(numbered(&part, &looks), Err(Error::Interrupted)));
        }
    }
}
