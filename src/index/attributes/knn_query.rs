//! A place in a tree in, the points around it out, in whatever tree they are: that tree itself, and where it is a leaf of an index, the leaves beside it as far as they may matter.
//!
//! ```text
//! search the own tree; what was found there says how far others may be
//! search the leaves beside it, nearest first, until their boxes are farther than what is found
//! ```
//! Nothing is left out where a leaf ends, however far a point's neighbours are. What is found is the same for one tree of all points as for many (equally far points are ordered by where they are and by their
//! colours), so that what is made of it does not depend on how a cloud is cut.

use super::kd_tree::{Neighbour, Query, keep_nearest};
use super::leaf_cache::{Leaf, LeafCache, Near};
use crate::error::Result;
use glam::DVec3;

/// Points within a radius at most; where there are more the radius is halved until there are not: a million in one place tell no more of a surface than some.
const MOST_WITHIN: usize = 4096;

/// Bytes of leaves beside one that are held at hand, however little memory there is, and however much.
const HELD: std::ops::RangeInclusive<u64> = (12 << 20)..=(48 << 20);

/// Widths of a leaf, parts of its own or of what was looked at before, in which leaves beside it are looked for.
const FIRST_REACH: f64 = 1.0 / 16.0;
const WIDER: f64 = 3.0;
/// Where it is known how far, a little more, so that the next point finds its own there too.
const SLIGHTLY_WIDER: f64 = 1.25;

pub struct KnnQuery<'s> {
    own: &'s Leaf,
    leaf_cache: Option<(&'s LeafCache<'s>, usize)>,
    of_any_lattice: bool,
    /// Leaves within so many metres of the own one's box.
    near: Vec<Near>,
    covered: f64,
    /// Bytes of those at hand.
    held: u64,
}

impl<'s> KnnQuery<'s> {
    /// Of a tree that is all there is.
    pub fn alone(own: &'s Leaf) -> KnnQuery<'s> {
        KnnQuery {
            own,
            leaf_cache: None,
            of_any_lattice: false,
            near: Vec::new(),
            covered: f64::INFINITY,
            held: 0,
        }
    }

    /// Of a leaf: of those on its own lattice, or of all.
    pub fn of(
        leaf_cache: &'s LeafCache<'s>,
        node: usize,
        own: &'s Leaf,
        of_any_lattice: bool,
    ) -> KnnQuery<'s> {
        KnnQuery {
            own,
            leaf_cache: Some((leaf_cache, node)),
            of_any_lattice,
            near: Vec::new(),
            covered: -1.0,
            held: 0,
        }
    }

    pub fn own(&self) -> &'s Leaf {
        self.own
    }

    /// From a point to a neighbour on the same lattice, steps of it.
    pub fn steps_to(&self, place: usize, neighbour: &Neighbour) -> DVec3 {
        let at = self.own.tree.query(place).at;
        match neighbour.tree {
            0 => self.own.tree.steps_between(at, neighbour.place as usize),
            tree => {
                let near = &self.near[tree as usize - 1];
                leaf_of(near).tree.steps_between(near.seen_from(at), neighbour.place as usize)
            }
        }
    }

    pub fn color(&self, neighbour: &Neighbour) -> [u8; 3] {
        self.leaf(neighbour).colors[neighbour.place as usize]
    }

    fn leaf(&self, neighbour: &Neighbour) -> &Leaf {
        if neighbour.tree == 0 {
            self.own
        } else {
            leaf_of(&self.near[neighbour.tree as usize - 1])
        }
    }

    /// Of those equally far, which comes first: steps of the lattice, and colour.
    fn rank(&self, neighbour: &Neighbour) -> ([i64; 3], [u8; 3]) {
        let leaf = self.leaf(neighbour);
        let at = leaf.tree.steps(neighbour.place as usize);
        (
            [0, 1, 2].map(|axis| leaf.origin[axis] + at[axis] as i64),
            leaf.colors.get(neighbour.place as usize).copied().unwrap_or_default(),
        )
    }

    /// Those nearest to a point that are not where it is, nearest first; so many at most. Of those equally far some.
    pub fn nearest(&mut self, place: usize, most: usize, found: &mut Vec<Neighbour>) -> Result<()> {
        found.clear();
        let search = |own: &Self, query: Query, found: &mut Vec<Neighbour>| {
            own.leaf_at(query).tree.add_nearest(query, most, found)
        };
        let reach = |found: &[Neighbour]| {
            if found.len() < most { f64::INFINITY } else { found[most - 1].squared }
        };
        self.search(place, found, &search, &reach)
    }

    /// The same points in no order, which takes half as long where they are many, and how far the farthest is, metres squared. `known` is a distance squared that they are not beyond, or infinite.
    pub fn nearest_in_any_order(
        &mut self,
        place: usize,
        most: usize,
        known: f64,
        found: &mut Vec<Neighbour>,
    ) -> Result<f64> {
        found.clear();
        let beyond = std::cell::Cell::new(known);
        let search = |own: &Self, query: Query, found: &mut Vec<Neighbour>| {
            let mut least = beyond.get();
            own.leaf_at(query).tree.sift(
                query,
                most,
                &mut least,
                &|neighbour| own.rank(neighbour),
                found,
            );
            keep_nearest(found, most, &|neighbour| own.rank(neighbour));
            if found.len() == most {
                least =
                    least.min(found.iter().map(|neighbour| neighbour.squared).fold(0.0, f64::max));
            }
            beyond.set(least);
        };
        self.search(place, found, &search, &|_| beyond.get())?;
        Ok(found.iter().map(|neighbour| neighbour.squared).fold(0.0, f64::max))
    }

    /// Every point within a radius of a point but for those where it is, in no order; within a half of it, or less, where they are too many: within which, is the answer.
    pub fn within(
        &mut self,
        place: usize,
        mut radius: f64,
        found: &mut Vec<Neighbour>,
    ) -> Result<f64> {
        loop {
            found.clear();
            let squared = radius * radius;
            let search = |own: &Self, query: Query, found: &mut Vec<Neighbour>| {
                own.leaf_at(query).tree.add_within(query, squared, MOST_WITHIN + 1, found);
            };
            self.search(place, found, &search, &|_| squared)?;
            if found.len() <= MOST_WITHIN {
                return Ok(radius);
            }
            radius /= 2.0;
        }
    }

    fn leaf_at(&self, query: Query) -> &Leaf {
        if query.tree == 0 { self.own } else { leaf_of(&self.near[query.tree as usize - 1]) }
    }

    fn search(
        &mut self,
        place: usize,
        found: &mut Vec<Neighbour>,
        search: &dyn Fn(&Self, Query, &mut Vec<Neighbour>),
        reach: &dyn Fn(&[Neighbour]) -> f64,
    ) -> Result<()> {
        let query = self.own.tree.query(place);
        search(self, query, found);
        let Some((leaf_cache, _)) = self.leaf_cache else { return Ok(()) };
        if self.held > leaf_cache.hold.clamp(*HELD.start(), *HELD.end()) {
            self.near.iter_mut().for_each(|near| near.leaf = None);
            self.held = 0;
        }
        let step = self.own.tree.step();
        let mut next = 0;
        loop {
            while let Some(near) = self.near.get_mut(next).filter(|near| near.away <= reach(found))
            {
                if near.away_from(query.at, step) <= reach(found) {
                    if near.leaf.is_none() {
                        let leaf = leaf_cache.leaf(near.node)?;
                        self.held += leaf.bytes();
                        near.leaf = Some(leaf);
                    }
                    let query = Query { at: near.seen_from(query.at), tree: next as u32 + 1 };
                    search(self, query, found);
                }
                next += 1;
            }
            if !self.widen(reach(found)) {
                return Ok(());
            }
        }
    }

    /// Looks farther, if all within `squared` are not known yet. Leaves that were near stay where they are in the list.
    fn widen(&mut self, squared: f64) -> bool {
        let Some((leaf_cache, node)) = self.leaf_cache else { return false };
        if self.covered * self.covered >= squared && self.covered >= 0.0
            || self.covered > leaf_cache.diagonal
        {
            return false;
        }
        let own = &leaf_cache.directory.nodes[node];
        let step = self.own.tree.step();
        let width = (DVec3::from_array(own.extent.map(f64::from)) * step)
            .max_element()
            .max(step.max_element());
        let farther = (WIDER * self.covered).max(FIRST_REACH * width);
        self.covered = farther.min(SLIGHTLY_WIDER * squared.sqrt());
        let mut near = leaf_cache.beside(node, self.covered, self.of_any_lattice);
        near.iter_mut()
            .zip(&mut self.near)
            .for_each(|(near, before)| near.leaf = before.leaf.take());
        self.near = near;
        true
    }
}

fn leaf_of(near: &Near) -> &Leaf {
    near.leaf.as_deref().expect("what was searched is at hand")
}
