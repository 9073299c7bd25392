//! A balanced kd-tree over the lattice of one part, for nearest neighbours.
//!
//! ```text
//! build(points): halve at the median of the longest axis until leaves hold a dozen; in parallel
//! nearest(place, k), within(place, radius): depth first, the nearer half first, skipping boxes
//!   that are too far
//! over several trees: one after the other, each search starting with earlier results (`knn_query`)
//! ```
//!
//! A tree instead of a grid, because points near a scanner are a hundred times denser than far from
//! it. Coordinate differences are integers, so that distances are as exact 5,000 km from the origin
//! as at it (guide: numerics, case 18). Coincident points are one place measured twice, and no
//! neighbours of each other (guide: numerics, case 21). A branch whose points all coincide is
//! looked at once, however many they are. The tree depends neither on the order of
//! the points in the file nor on the number of threads.

use crate::cloud::{Columns, Lattice};
use glam::DVec3;
use rayon::prelude::*;

/// Most points of a leaf; the fastest of 8 to 32.
const LEAF: usize = 12;
/// Smallest range that is halved in parallel.
const PARALLEL: usize = 1 << 14;

type Steps = [i32; 3];

/// A point of the tree: position, and index in the columns.
#[derive(Clone, Copy, Debug, Default)]
struct Point {
    at: Steps,
    number: u32,
}

/// A neighbour: squared distance `[m2]`, place in its tree, and number of the tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour {
    pub squared: f64,
    pub place: u32,
    pub tree: u32,
}

/// A search in one of several trees.
#[derive(Clone, Copy, Debug)]
pub struct Query {
    /// Query position in steps of that tree: integers if it is a point on the same lattice.
    pub at: DVec3,
    /// Tree number that its neighbours get.
    pub tree: u32,
}

pub struct KdTree {
    /// In leaf order: neighbours in space are mostly neighbours here.
    points: Vec<Point>,
    /// Bounding box of every node, a node before its halves, the first half before the second.
    boxes: Vec<[Steps; 2]>,
    step: DVec3,
}

/// A subtree: its root, number of nodes, and points.
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
        [
            first,
            Branch {
                node: first.node + nodes,
                first: self.first + count,
                count: self.count - count,
                ..first
            },
        ]
    }
}

impl KdTree {
    pub fn new(columns: &Columns, lattice: &Lattice) -> KdTree {
        let point =
            |i: usize| Point { at: [columns.x[i], columns.y[i], columns.z[i]], number: i as u32 };
        let mut points: Vec<Point> = (0..columns.len()).into_par_iter().map(point).collect();
        let leaves = points.len().div_ceil(LEAF).next_power_of_two();
        let mut boxes = vec![[Steps::default(); 2]; 2 * leaves - 1];
        let step = lattice.step.abs();
        // Coincident points are in the order of their colours, as ties are.
        let color =
            |number: u32| columns.rgb.as_ref().map_or([0; 3], |colors| colors[number as usize]);
        build(&mut points, &mut boxes, step, &color);
        KdTree { points, boxes, step }
    }

    pub fn len(&self) -> usize {
        self.points.len()
    }

    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Returns its size in memory `[bytes]`.
    pub fn bytes(&self) -> u64 {
        (size_of_val(&*self.points) + size_of_val(&*self.boxes)) as u64
    }

    /// Returns the column index of the point at this place.
    pub fn number(&self, place: usize) -> usize {
        self.points[place].number as usize
    }

    pub fn steps(&self, place: usize) -> Steps {
        self.points[place].at
    }

    /// Returns the vector between two places `[m]`.
    pub fn between(&self, from: usize, to: usize) -> DVec3 {
        self.steps_between(self.query(from).at, to) * self.step
    }

    /// Returns the vector from a position to a point `[steps]`.
    pub fn steps_between(&self, from: DVec3, to: usize) -> DVec3 {
        difference(from, self.points[to].at)
    }

    /// Returns the step along each axis `[m]`.
    pub fn step(&self) -> DVec3 {
        self.step
    }

    /// Returns a query at a point of the tree.
    pub fn query(&self, place: usize) -> Query {
        Query { at: difference(DVec3::ZERO, self.points[place].at), tree: 0 }
    }

    /// Finds the points nearest to a point of the tree, without coincident ones, nearest first; at
    /// most `most`. Ties are broken arbitrarily.
    pub fn nearest(&self, place: usize, most: usize, found: &mut Vec<Neighbour>) {
        found.clear();
        self.add_nearest(self.query(place), most, found);
    }

    /// Extends the nearest neighbours found in other trees by those of this one.
    pub fn add_nearest(&self, query: Query, most: usize, found: &mut Vec<Neighbour>) {
        if most > 0 && self.has_others(query) {
            self.search(self.whole(), query, most, found);
        }
    }

    /// Finds the nearest in no order, twice as fast if many are wanted, extending results of other
    /// trees. Points beyond a squared distance are left out; it shrinks to that of the farthest
    /// wanted point once more are found. Up to twice as many may be returned: [`keep_nearest`]
    /// removes the rest. `tied` orders points at equal distance.
    pub fn sift<K: Ord>(
        &self,
        query: Query,
        most: usize,
        beyond: &mut f64,
        tied: &impl Fn(&Neighbour) -> K,
        found: &mut Vec<Neighbour>,
    ) {
        if most > 0 && self.has_others(query) {
            self.sift_branch(self.whole(), query, most, beyond, tied, found);
        }
    }

    /// Adds the points within a squared distance that do not coincide with the query, in no order.
    /// Returns false, with some of them, if `found` would have more than `most`.
    #[must_use]
    pub fn add_within(
        &self,
        query: Query,
        squared: f64,
        most: usize,
        found: &mut Vec<Neighbour>,
    ) -> bool {
        self.is_empty() || self.collect(self.whole(), query, squared, most, found)
    }

    /// Tests whether some point does not coincide with the query.
    fn has_others(&self, query: Query) -> bool {
        self.away(self.whole(), query.at) < f64::INFINITY
    }

    fn whole(&self) -> Branch {
        Branch { node: 0, nodes: self.boxes.len(), first: 0, count: self.points.len() }
    }

    fn search(&self, branch: Branch, query: Query, most: usize, found: &mut Vec<Neighbour>) {
        if self.is_searched_through(branch) {
            for neighbour in self.leaf(branch, query).take(most.max(LEAF)) {
                if found.len() == most {
                    if neighbour.squared >= found[most - 1].squared {
                        continue;
                    }
                    found.pop();
                }
                let after = found
                    .iter()
                    .rposition(|nearer| nearer.squared <= neighbour.squared)
                    .map_or(0, |last| last + 1);
                found.insert(after, neighbour);
            }
            return;
        }
        let [mut near, mut far] = branch.halves().map(|half| (self.away(half, query.at), half));
        if far.0 < near.0 {
            std::mem::swap(&mut near, &mut far);
        }
        for (away, half) in [near, far] {
            let reach = if found.len() < most { f64::INFINITY } else { found[most - 1].squared };
            if away < reach {
                self.search(half, query, most, found);
            }
        }
    }

    /// Keeps at most twice the wanted number before it removes those that are too far.
    fn sift_branch<K: Ord>(
        &self,
        branch: Branch,
        query: Query,
        most: usize,
        beyond: &mut f64,
        tied: &impl Fn(&Neighbour) -> K,
        found: &mut Vec<Neighbour>,
    ) {
        if self.is_searched_through(branch) {
            let within = self.leaf(branch, query).filter(|neighbour| neighbour.squared <= *beyond);
            found.extend(within.take(most.max(LEAF)));
            if found.len() >= 2 * most {
                keep_nearest(found, most, tied);
                *beyond = beyond.min(found[most - 1].squared);
            }
            return;
        }
        let [mut near, mut far] = branch.halves().map(|half| (self.away(half, query.at), half));
        if far.0 < near.0 {
            std::mem::swap(&mut near, &mut far);
        }
        for (away, half) in [near, far] {
            if away <= *beyond && away < f64::INFINITY {
                self.sift_branch(half, query, most, beyond, tied, found);
            }
        }
    }

    fn collect(
        &self,
        branch: Branch,
        query: Query,
        squared: f64,
        most: usize,
        found: &mut Vec<Neighbour>,
    ) -> bool {
        if self.away(branch, query.at) > squared {
            return true;
        }
        if self.is_one_place(branch) && found.len() + branch.count > most {
            return false;
        }
        if self.is_searched_through(branch) {
            found.extend(self.leaf(branch, query).filter(|neighbour| neighbour.squared <= squared));
            return found.len() <= most;
        }
        branch.halves().into_iter().all(|half| self.collect(half, query, squared, most, found))
    }

    /// Tests whether all points of a branch coincide.
    fn is_one_place(&self, branch: Branch) -> bool {
        let [lo, hi] = self.boxes[branch.node];
        lo == hi
    }

    /// Tests whether the points of a branch are looked at one by one.
    fn is_searched_through(&self, branch: Branch) -> bool {
        branch.nodes == 1 || self.is_one_place(branch)
    }

    fn leaf(&self, branch: Branch, query: Query) -> impl Iterator<Item = Neighbour> + '_ {
        let places = branch.first..branch.first + branch.count;
        let neighbour = move |place: usize| Neighbour {
            squared: (difference(query.at, self.points[place].at) * self.step).length_squared(),
            place: place as u32,
            tree: query.tree,
        };
        places.map(neighbour).filter(|neighbour| neighbour.squared > 0.0)
    }

    /// Returns the squared distance to a branch's box `[m2]`; infinite if all its points coincide
    /// with the query.
    fn away(&self, branch: Branch, at: DVec3) -> f64 {
        let [lo, hi] = self.boxes[branch.node].map(|corner| difference(DVec3::ZERO, corner));
        if lo == at && hi == at || branch.count == 0 {
            return f64::INFINITY;
        }
        ((at.clamp(lo, hi) - at) * self.step).length_squared()
    }
}

/// Keeps the nearest `most`, the farthest last; ties are ordered by `tied`, so that the result does
/// not depend on the tree.
pub fn keep_nearest<K: Ord>(
    found: &mut Vec<Neighbour>,
    most: usize,
    tied: &impl Fn(&Neighbour) -> K,
) {
    if found.len() > most {
        found.select_nth_unstable_by(most - 1, |a, b| {
            a.squared.total_cmp(&b.squared).then_with(|| tied(a).cmp(&tied(b)))
        });
        found.truncate(most);
    }
}

/// Exact for integers, which are below 2^53.
fn difference(from: DVec3, to: Steps) -> DVec3 {
    DVec3::new(to[0] as f64, to[1] as f64, to[2] as f64) - from
}

fn build(
    points: &mut [Point],
    boxes: &mut [[Steps; 2]],
    step: DVec3,
    color: &(impl Fn(u32) -> [u8; 3] + Sync),
) {
    let Some((own, below)) = boxes.split_first_mut() else { return };
    let Some(first) = points.first() else { return };
    *own = points.iter().fold([first.at; 2], |[lo, hi], point| {
        [[0, 1, 2].map(|k| lo[k].min(point.at[k])), [0, 1, 2].map(|k| hi[k].max(point.at[k]))]
    });
    if below.is_empty() {
        // Sorted, so that a leaf does not depend on the file's order.
        return points.sort_unstable_by_key(|point| (point.at, color(point.number), point.number));
    }
    let extent = (difference(DVec3::ZERO, own[1]) - difference(DVec3::ZERO, own[0])) * step;
    let axis = extent
        .to_array()
        .iter()
        .enumerate()
        .max_by(|a, b| a.1.total_cmp(b.1))
        .map_or(0, |(axis, _)| axis);
    let middle = points.len() / 2;
    let order = |point: &Point| (point.at[axis], point.at, color(point.number), point.number);
    points.select_nth_unstable_by_key(middle, order);
    let parallel = points.len() > PARALLEL;
    let ((left, right), half) = (points.split_at_mut(middle), below.len() / 2);
    let (left_boxes, right_boxes) = below.split_at_mut(half);
    let (mut one, mut two) =
        (|| build(left, left_boxes, step, color), || build(right, right_boxes, step, color));
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

    fn tree(points: &[Steps], step: DVec3) -> KdTree {
        let column = |axis: usize| points.iter().map(|p| p[axis]).collect();
        let columns = Columns { x: column(0), y: column(1), z: column(2), ..Columns::default() };
        KdTree::new(&columns, &Lattice { step, offset: DVec3::splat(5e6) })
    }

    /// Returns all squared distances to others, nearest first.
    fn by_hand(tree: &KdTree, place: usize) -> Vec<f64> {
        let mut squares: Vec<f64> = (0..tree.len())
            .map(|other| tree.between(place, other).length_squared())
            .filter(|squared| *squared > 0.0)
            .collect();
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
                let at = |n: &Neighbour| tree.steps(n.place as usize);
                for known in [f64::INFINITY, all.get(most - 1).copied().unwrap_or(f64::INFINITY)] {
                    let mut beyond = known;
                    found.clear();
                    tree.sift(tree.query(place), most, &mut beyond, &at, &mut found);
                    keep_nearest(&mut found, most, &at);
                    found.sort_by(|a, b| a.squared.total_cmp(&b.squared));
                    prop_assert_eq!(found.iter().map(|n| n.squared).collect::<Vec<_>>(), all[..most.min(all.len())].to_vec());
                }
                found.clear();
                prop_assert!(tree.add_within(tree.query(place), radius * radius, usize::MAX, &mut found));
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
    fn many_points_in_few_places_are_searched_as_fast_as_few() {
        let places = [[0; 3], [3, 0, 0], [0, 4, 0]];
        let points: Vec<Steps> = (0..300_000).map(|number| places[number % 3]).collect();
        let (tree, mut found, began) =
            (tree(&points, DVec3::ONE), Vec::new(), std::time::Instant::now());
        for place in 0..tree.len() {
            tree.nearest(place, 8, &mut found);
            assert_eq!(found.len(), 8);
            let mut beyond = f64::INFINITY;
            found.clear();
            tree.sift(tree.query(place), 8, &mut beyond, &|n| n.place, &mut found);
            assert!(found.len() >= 8);
            found.clear();
            assert!(!tree.add_within(tree.query(place), 100.0, 4096, &mut found));
            assert!(tree.add_within(tree.query(place), 4.0, 4096, &mut found));
        }
        assert!(began.elapsed().as_secs() < 20, "{:?}", began.elapsed());
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
