//! Points in, for any place those nearest to it out: a balanced kd-tree over the lattice of one part, in memory.
//!
//! ```text
//! build(points): halve them at the median of the longest axis, as often as leaves of a dozen need; both halves in parallel
//! nearest(place, k), within(place, radius): depth first, the nearer half before the farther, whole boxes left out that are too far
//! ```
//! A tree, and not a grid of cells: a scanner's points are a hundred times as dense beside it as where it hardly sees. Differences of coordinates are integers, so distances are as good 5,000 km from the
//! origin as at it (HARD_CASES 18). Coincident points are one place measured twice, and no neighbours of each other (HARD_CASES 21). The tree depends on the points alone, not on their order in the file,
//! and not on the number of threads.

use crate::cloud::{Columns, Lattice};
use glam::DVec3;
use rayon::prelude::*;

/// Points of a leaf at most; of 8 to 32 measured the fastest.
const LEAF: usize = 12;
/// Ranges with fewer points are halved by one thread.
const PARALLEL: usize = 1 << 14;
/// Points that `within` visits at most: a million in one place are no better known than some.
const MOST_WITHIN: usize = 4096;

type Steps = [i32; 3];

/// A point of the tree: where it is, and its number in the columns.
#[derive(Clone, Copy, Debug, Default)]
struct Point {
    at: Steps,
    number: u32,
}

/// A point found: how far it is, metres squared, and its place in the tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour {
    pub squared: f64,
    pub place: u32,
}

pub struct Tree {
    /// In the order of the leaves: neighbours in space are mostly neighbours here.
    points: Vec<Point>,
    /// Around the points of every node, a node before its halves, the first half before the second.
    boxes: Vec<[Steps; 2]>,
    step: DVec3,
}

/// What a search looks at: a node, the nodes below it, and its points.
#[derive(Clone, Copy)]
struct Branch {
    node: usize,
    nodes: usize,
    first: usize,
    count: usize,
}

impl Branch {
    fn halves(self) -> [Branch; 2] {
        let (nodes, count) = ((self.nodes - 1) / 2, self.count / 2);
        let first = Branch { node: self.node + 1, nodes, first: self.first, count };
        [first, Branch { node: first.node + nodes, first: self.first + count, count: self.count - count, ..first }]
    }
}

impl Tree {
    pub fn new(columns: &Columns, lattice: &Lattice) -> Tree {
        let point = |i: usize| Point { at: [columns.x[i], columns.y[i], columns.z[i]], number: i as u32 };
        let mut points: Vec<Point> = (0..columns.len()).into_par_iter().map(point).collect();
        let leaves = points.len().div_ceil(LEAF).next_power_of_two();
        let mut boxes = vec![[Steps::default(); 2]; 2 * leaves - 1];
        let step = lattice.step.abs();
        build(&mut points, &mut boxes, step);
        Tree { points, boxes, step }
    }

    pub fn len(&self) -> usize {
        self.points.len()
    }

    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// The number in the columns of the point at this place.
    pub fn number(&self, place: usize) -> usize {
        self.points[place].number as usize
    }

    pub fn steps(&self, place: usize) -> Steps {
        self.points[place].at
    }

    /// From one place to another, metres.
    pub fn between(&self, from: usize, to: usize) -> DVec3 {
        difference(self.points[from].at, self.points[to].at) * self.step
    }

    /// Those nearest to a point of the tree that are not where it is, nearest first; so many at most. Of those equally far some.
    pub fn nearest(&self, place: usize, most: usize, found: &mut Vec<Neighbour>) {
        found.clear();
        if most > 0 && !self.is_empty() {
            self.search(self.whole(), self.points[place].at, most, found);
        }
    }

    /// The same points in no order, which takes half as long where they are many; and how far the farthest is, metres squared. `known` is a distance squared that they are not beyond, or infinite.
    pub fn nearest_in_any_order(&self, place: usize, most: usize, known: f64, found: &mut Vec<Neighbour>) -> f64 {
        found.clear();
        if most == 0 || self.is_empty() {
            return 0.0;
        }
        let mut beyond = known;
        self.sift(self.whole(), self.points[place].at, most, &mut beyond, found);
        keep_nearest(found, most);
        found.iter().map(|neighbour| neighbour.squared).fold(0.0, f64::max)
    }

    /// Every point within a radius of a point of the tree, but for those where it is; its first `MOST_WITHIN`.
    pub fn within(&self, place: usize, radius: f64, found: &mut Vec<Neighbour>) {
        found.clear();
        self.collect(self.whole(), self.points[place].at, radius * radius, found);
    }

    fn whole(&self) -> Branch {
        Branch { node: 0, nodes: self.boxes.len(), first: 0, count: self.points.len() }
    }

    fn search(&self, branch: Branch, at: Steps, most: usize, found: &mut Vec<Neighbour>) {
        if branch.nodes == 1 {
            for neighbour in self.leaf(branch, at) {
                if found.len() == most {
                    if neighbour.squared >= found[most - 1].squared {
                        continue;
                    }
                    found.pop();
                }
                let after = found.iter().rposition(|nearer| nearer.squared <= neighbour.squared).map_or(0, |last| last + 1);
                found.insert(after, neighbour);
            }
            return;
        }
        let [mut near, mut far] = branch.halves().map(|half| (self.away(half, at), half));
        if far.0 < near.0 {
            std::mem::swap(&mut near, &mut far);
        }
        for (away, half) in [near, far] {
            if found.len() < most || away < found[most - 1].squared {
                self.search(half, at, most, found);
            }
        }
    }

    /// Keeps twice as many as are wanted at most before it leaves out those that are too far.
    fn sift(&self, branch: Branch, at: Steps, most: usize, beyond: &mut f64, found: &mut Vec<Neighbour>) {
        if branch.nodes == 1 {
            found.extend(self.leaf(branch, at).filter(|neighbour| neighbour.squared <= *beyond));
            if found.len() >= 2 * most {
                keep_nearest(found, most);
                *beyond = beyond.min(found[most - 1].squared);
            }
            return;
        }
        let [mut near, mut far] = branch.halves().map(|half| (self.away(half, at), half));
        if far.0 < near.0 {
            std::mem::swap(&mut near, &mut far);
        }
        for (away, half) in [near, far] {
            if away <= *beyond && away < f64::INFINITY {
                self.sift(half, at, most, beyond, found);
            }
        }
    }

    fn collect(&self, branch: Branch, at: Steps, squared: f64, found: &mut Vec<Neighbour>) {
        if found.len() >= MOST_WITHIN || self.away(branch, at) > squared {
            return;
        }
        if branch.nodes == 1 {
            return found.extend(self.leaf(branch, at).filter(|neighbour| neighbour.squared <= squared));
        }
        branch.halves().into_iter().for_each(|half| self.collect(half, at, squared, found));
    }

    fn leaf(&self, branch: Branch, at: Steps) -> impl Iterator<Item = Neighbour> + '_ {
        let places = branch.first..branch.first + branch.count;
        let neighbour = move |place: usize| Neighbour {
            squared: (difference(at, self.points[place].at) * self.step).length_squared(),
            place: place as u32,
        };
        places.map(neighbour).filter(|neighbour| neighbour.squared > 0.0)
    }

    /// How far a branch's box is, metres squared; infinitely, if all its points are where the place is.
    fn away(&self, branch: Branch, at: Steps) -> f64 {
        let [lo, hi] = self.boxes[branch.node];
        if lo == at && hi == at || branch.count == 0 {
            return f64::INFINITY;
        }
        let nearest = [0, 1, 2].map(|axis| at[axis].clamp(lo[axis], hi[axis]));
        (difference(at, nearest) * self.step).length_squared()
    }
}

/// The last of them is the farthest.
fn keep_nearest(found: &mut Vec<Neighbour>, most: usize) {
    if found.len() > most {
        found.select_nth_unstable_by(most - 1, |a, b| a.squared.total_cmp(&b.squared));
        found.truncate(most);
    }
}

/// Exact.
fn difference(from: Steps, to: Steps) -> DVec3 {
    let [x, y, z] = [0, 1, 2].map(|axis| (to[axis] as i64 - from[axis] as i64) as f64);
    DVec3::new(x, y, z)
}

fn build(points: &mut [Point], boxes: &mut [[Steps; 2]], step: DVec3) {
    let Some((own, below)) = boxes.split_first_mut() else { return };
    let Some(first) = points.first() else { return };
    *own = points
        .iter()
        .fold([first.at; 2], |[lo, hi], point| [[0, 1, 2].map(|k| lo[k].min(point.at[k])), [0, 1, 2].map(|k| hi[k].max(point.at[k]))]);
    if below.is_empty() {
        // What is in a leaf does not depend on the file's order; nor does in which order.
        return points.sort_unstable_by_key(|point| (point.at, point.number));
    }
    let extent = difference(own[0], own[1]) * step;
    let axis = extent.to_array().iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(axis, _)| axis);
    let middle = points.len() / 2;
    let order = |point: &Point| (point.at[axis], point.at, point.number);
    points.select_nth_unstable_by_key(middle, order);
    let parallel = points.len() > PARALLEL;
    let ((left, right), half) = (points.split_at_mut(middle), below.len() / 2);
    let (left_boxes, right_boxes) = below.split_at_mut(half);
    let (mut one, mut two) = (|| build(left, left_boxes, step), || build(right, right_boxes, step));
    if parallel {
        rayon::join(one, two);
    } else {
        one();
        two();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn tree(points: &[Steps], step: DVec3) -> Tree {
        let column = |axis: usize| points.iter().map(|p| p[axis]).collect();
        let columns = Columns { x: column(0), y: column(1), z: column(2), ..Columns::default() };
        Tree::new(&columns, &Lattice { step, offset: DVec3::splat(5e6) })
    }

    /// All distances to others, nearest first.
    fn by_hand(tree: &Tree, place: usize) -> Vec<f64> {
        let mut squares: Vec<f64> =
            (0..tree.len()).map(|other| tree.between(place, other).length_squared()).filter(|squared| *squared > 0.0).collect();
        squares.sort_by(f64::total_cmp);
        squares
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn the_nearest_are_those_that_looking_at_all_finds(points in prop::collection::vec(prop::array::uniform3(-40i32..40), 1..200), most in 1usize..12, radius in 0.0f64..30.0) {
            let tree = tree(&points, DVec3::new(0.5, 1.0, 2.0));
            let mut found = Vec::new();
            for place in 0..tree.len() {
                let all = by_hand(&tree, place);
                tree.nearest(place, most, &mut found);
                prop_assert_eq!(found.iter().map(|n| n.squared).collect::<Vec<_>>(), all[..most.min(all.len())].to_vec());
                prop_assert!(found.iter().all(|n| tree.between(place, n.place as usize).length_squared() == n.squared));
                for known in [f64::INFINITY, all.get(most - 1).copied().unwrap_or(f64::INFINITY)] {
                    let farthest = tree.nearest_in_any_order(place, most, known, &mut found);
                    found.sort_by(|a, b| a.squared.total_cmp(&b.squared));
                    prop_assert_eq!(found.iter().map(|n| n.squared).collect::<Vec<_>>(), all[..most.min(all.len())].to_vec());
                    prop_assert_eq!(farthest, found.last().map_or(0.0, |n| n.squared));
                }
                tree.within(place, radius, &mut found);
                prop_assert_eq!(found.len(), all.iter().filter(|squared| **squared <= radius * radius).count());
            }
        }
    }

    #[test]
    fn hard_21_coincident_points_are_no_neighbours_and_few_are_all_found() {
        let mut found = Vec::new();
        let alone = tree(&[[7, 7, 7]; 100_000], DVec3::ONE);
        alone.nearest(50_000, 8, &mut found);
        assert!(found.is_empty());
        let mut points = vec![[0; 3]; 100_000];
        points.extend([[3, 0, 0], [0, 4, 0]]);
        let tree = tree(&points, DVec3::ONE);
        let place = (0..tree.len()).find(|&place| tree.steps(place) == [0; 3]).unwrap();
        tree.nearest(place, 8, &mut found);
        assert_eq!(found.iter().map(|n| n.squared).collect::<Vec<_>>(), [9.0, 16.0]);
    }

    #[test]
    fn the_whole_range_of_the_lattice_does_not_overflow() {
        let tree = tree(&[[i32::MIN; 3], [i32::MAX; 3], [0; 3]], DVec3::ONE);
        let mut found = Vec::new();
        tree.nearest(0, 2, &mut found);
        assert_eq!(found.len(), 2);
        assert_eq!(found[1].squared, 3.0 * ((1u64 << 32) as f64 - 1.0).powi(2));
    }
}
